//! Ridges: pixels in the middle of a bright strip that is darker on both sides.
//!
//! Eigenvalues of the Hessian at three scales (Lindeberg, "Edge detection and ridge detection with automatic scale selection", 1998);
//! a step edge has only one darker side and is no ridge (Farin et al., "Robust camera calibration for sport videos", 2003).

use std::f32::consts::{FRAC_PI_2, PI};

use super::channel::Channel;

/// Scales of the Hessian, px: paint of 1.5 to 8 px. Measured on 41 scenes.
const SIGMAS: [f32; 3] = [1.0, 1.7, 2.9];
/// The strength of a scale is its curvature times σ to this power (Lindeberg's γ-normalisation for ridges).
const NORMALISATION: i32 = 3;
/// The curvature along a ridge is at most this fraction of that across it.
const ELONGATION: f32 = 0.5;
/// Least strength, levels. Measured on 41 scenes.
const LEAST_STRENGTH: f32 = 0.3;
/// Where the two sides are compared with the middle: this many σ and px away from it.
const SIDE: [f32; 2] = [2.2, 0.5];
/// At scales below this, px, the sides are compared in a picture blurred only this much, px: thin lines stay bright.
const FINE: f32 = 1.5;
const FINE_BLUR: f64 = 0.7;

/// The ridges of a picture; all maps have one value a pixel.
pub(super) struct Ridges {
    /// How much brighter than the brighter of its two sides the ridge is, levels; 0 where there is none.
    pub contrast: Vec<f32>,
    /// Direction of the ridge, rad, 0 to π.
    pub direction: Vec<f32>,
    pub width: usize,
    pub height: usize,
}

/// A pixel's strongest curvature over the scales.
#[derive(Debug, Clone, Copy, Default)]
struct Curvature {
    strength: f32,
    contrast: f32,
    /// Unit vector across the ridge.
    normal: [f32; 2],
}

/// Ridges whose two sides are both darker by `least` levels, thinned to one pixel across.
pub(super) fn ridges(channel: &Channel, least: f32) -> Ridges {
    let (width, height) = (channel.width, channel.height);
    let mut found = vec![Curvature::default(); width * height];
    let fine = channel.blurred(FINE_BLUR);
    for sigma in SIGMAS {
        let blurred = channel.blurred(f64::from(sigma));
        let shown = if sigma < FINE { &fine } else { &blurred };
        for y in 1..height.saturating_sub(1) {
            for x in 1..width.saturating_sub(1) {
                let best = &mut found[y * width + x];
                let Some((strength, normal)) = curvature(&blurred, x, y, sigma, best.strength) else { continue };
                let contrast = contrast(shown, x, y, normal, SIDE[0] * sigma + SIDE[1]);
                if contrast > least {
                    *best = Curvature { strength, contrast, normal };
                }
            }
        }
    }
    thinned(&found, width, height)
}

/// Strength and normal of the ridge at a pixel, if it is stronger than `before`.
fn curvature(blurred: &Channel, x: usize, y: usize, sigma: f32, before: f32) -> Option<(f32, [f32; 2])> {
    let width = blurred.width;
    let at = y * width + x;
    let [above, here, below] = [at - width, at, at + width].map(|middle| &blurred.values[middle - 1..=middle + 1]);
    let xx = here[0] - 2.0 * here[1] + here[2];
    let yy = above[1] - 2.0 * here[1] + below[1];
    let xy = 0.25 * (above[0] - above[2] - below[0] + below[2]);
    let (trace, root) = (xx + yy, ((xx - yy).powi(2) + 4.0 * xy * xy).sqrt());
    let (across, along) = (0.5 * (trace - root), 0.5 * (trace + root));
    let strength = -across * sigma.sqrt().powi(NORMALISATION);
    let is_ridge = across < 0.0 && along.abs() < -ELONGATION * across;
    if !is_ridge || strength <= before.max(LEAST_STRENGTH) {
        return None;
    }
    let angle = 0.5 * (2.0 * xy).atan2(xx - yy) + FRAC_PI_2;
    Some((strength, [angle.cos(), angle.sin()]))
}

/// How much brighter a pixel is than the brighter of the two places `side` px beside it.
fn contrast(shown: &Channel, x: usize, y: usize, [across, down]: [f32; 2], side: f32) -> f32 {
    let beside = |side: f32| shown.at(x as f32 + side * across, y as f32 + side * down);
    shown.values[y * shown.width + x] - beside(side).max(beside(-side))
}

/// Only pixels that are at least as strong as those 1 px to either side.
fn thinned(found: &[Curvature], width: usize, height: usize) -> Ridges {
    let strength = Channel { values: found.iter().map(|found| found.strength).collect(), width, height };
    let is_top = |(at, found): (usize, &Curvature)| {
        let (x, y) = ((at % width) as f32, (at / width) as f32);
        let beside = |sign: f32| strength.at(x + sign * found.normal[0], y + sign * found.normal[1]);
        let is_top = found.strength > 0.0 && found.strength >= beside(1.0) && found.strength >= beside(-1.0);
        if is_top { found.contrast } else { 0.0 }
    };
    let direction = |found: &Curvature| (found.normal[1].atan2(found.normal[0]) + FRAC_PI_2).rem_euclid(PI);
    Ridges {
        contrast: found.iter().enumerate().map(is_top).collect(),
        direction: found.iter().map(direction).collect(),
        width,
        height,
    }
}
