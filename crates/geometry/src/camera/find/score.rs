//! How much of a model's lines a picture shows, for one view.

use std::f64::consts::PI;

use nalgebra::{Point2, Point3, Vector2};

use super::maps::DirectionMaps;
use super::view::{NEAR, View};

/// Margin of the maps within which lines are clipped, in their own steps.
const MARGIN: f64 = 2.0;
/// Distance of samples along a line, px; two more are taken, up to the scale's most.
const EVERY: f64 = 6.0;
/// What a sample counts less at the tolerance than on the ridge. Measured on 41 scenes.
const AT_TOLERANCE: f64 = 0.3;
/// The mean of a sample that is seen, which lies about a third of the tolerance off: what a line that is seen throughout reaches.
pub(super) const ALL_SEEN: f64 = 0.9;
/// What a length that should be seen and is not costs, relative to one that is seen. Measured on 41 scenes.
pub(super) const UNSEEN: f64 = 0.7;

/// What is looked up, and how finely.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scale {
    /// A ridge within this of a sample counts, px.
    pub tolerance: f64,
    /// A line does not count for more than this length, px.
    pub longest: f64,
    /// Most samples of a line.
    pub samples: usize,
}

/// What a picture shows of one line.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Shown {
    /// Length in the picture, px; 0 outside.
    pub length: f64,
    /// Fraction of it on ridges; [`ALL_SEEN`] where it is seen throughout.
    pub fraction: f64,
}

/// The length seen less [`UNSEEN`] times that which is not, px, over all lines; each line's length counts up to `longest`.
pub(super) fn score<'a>(
    maps: &DirectionMaps,
    view: &View,
    lines: impl Iterator<Item = &'a [Point3<f64>; 2]>,
    scale: &Scale,
) -> f64 {
    lines.map(|line| shown(maps, view, line, scale)).map(|shown| worth(shown, scale.longest)).sum()
}

fn worth(Shown { length, fraction }: Shown, longest: f64) -> f64 {
    length.min(longest) * (fraction - UNSEEN * (1.0 - fraction))
}

/// What the picture shows of a line between two points, m.
pub(super) fn shown(maps: &DirectionMaps, view: &View, ends: &[Point3<f64>; 2], scale: &Scale) -> Shown {
    let Some([from, to]) = clipped_ends(view, ends) else { return Shown::default() };
    // In the maps' steps.
    let (start, along) = (from.coords / 2.0, (to - from) / 2.0);
    let Some([first, last]) = clipped(start, along, maps) else { return Shown::default() };
    let length = 2.0 * along.norm() * (last - first);
    let map = maps.towards(along.y.atan2(along.x).rem_euclid(PI));
    let count = ((length / EVERY) as usize + 2).min(scale.samples);
    let tolerance = 4.0 * scale.tolerance;
    let sample = |index: usize| {
        let at = start + along * (first + (last - first) * (index as f64 + 0.5) / count as f64);
        let place = (at.y + 0.5) as usize * maps.width + (at.x + 0.5) as usize;
        let off = f64::from(*map.get(place).unwrap_or(&u8::MAX));
        if off <= tolerance { 1.0 - AT_TOLERANCE * off / tolerance } else { 0.0 }
    };
    Shown { length, fraction: (0..count).map(sample).sum::<f64>() / count as f64 }
}

/// The images of a line's ends, px. An end behind the camera is moved along the line until it is in front. [`None`] if both are behind.
pub(super) fn clipped_ends(view: &View, ends: &[Point3<f64>; 2]) -> Option<[Point2<f64>; 2]> {
    let [mut from, mut to] = [&ends[0], &ends[1]].map(|end| view.camera_from_world(end));
    if from.z < NEAR && to.z < NEAR {
        return None;
    }
    let before = to + (from - to) * ((NEAR - to.z) / (from.z - to.z));
    if from.z < NEAR {
        from = before;
    } else if to.z < NEAR {
        to = before;
    }
    Some([from, to].map(|end| view.image_from_camera(&end)))
}

/// The part of a line in the maps, as fractions of it (Liang and Barsky, 1984).
fn clipped(start: Vector2<f64>, along: Vector2<f64>, maps: &DirectionMaps) -> Option<[f64; 2]> {
    let most = Vector2::new(maps.width as f64, maps.height as f64) - Vector2::repeat(MARGIN + 1.0);
    let sides = [
        (-along.x, start.x - MARGIN),
        (along.x, most.x - start.x),
        (-along.y, start.y - MARGIN),
        (along.y, most.y - start.y),
    ];
    let (mut first, mut last) = (0.0_f64, 1.0_f64);
    for (outward, room) in sides {
        if outward.abs() < 1e-12 {
            if room < 0.0 {
                return None;
            }
        } else if outward < 0.0 {
            first = first.max(room / outward);
        } else {
            last = last.min(room / outward);
        }
    }
    (last > first && along.norm().is_finite()).then_some([first, last])
}
