//! Edges that move: where a frame has a gradient that the background has not.

use image::RgbImage;

use super::background::Background;
use crate::image::{Levels, levels_at};

/// Gradient that is an edge, in shares of the least contrast, per pixel: an edge is spread over two pixels or three.
const LEAST_GRADIENT: f32 = 0.4;

/// A pixel on an edge.
#[derive(Debug, Clone, Copy)]
pub(super) struct Edge {
    pub x: usize,
    pub y: usize,
    /// Unit vector across the edge.
    pub across: [f32; 2],
}

/// A gradient of the strength that moves.
#[derive(Debug, Clone, Copy, Default)]
struct Gradient {
    strength: f32,
    x: f32,
    y: f32,
}

/// The moving edges of `frame`, one pixel thin.
pub(super) fn moving_edges(frame: &RgbImage, background: &Background) -> Vec<Edge> {
    let (width, height) = (frame.width() as usize, frame.height() as usize);
    let changed: Vec<bool> =
        (0..width * height).map(|pixel| background.differs(frame, pixel % width, pixel / width)).collect();
    let mut gradients = vec![Gradient::default(); width * height];
    for y in 1..height - 1 {
        for x in 1..width - 1 {
            let here = y * width + x;
            let near = [here, here - 1, here + 1, here - width, here + width];
            if near.into_iter().any(|pixel| changed[pixel]) {
                gradients[here] = moving_gradient(frame, background.still.as_ref(), x, y);
            }
        }
    }
    let mut edges = Vec::new();
    for y in 1..height - 1 {
        for x in 1..width - 1 {
            let gradient = gradients[y * width + x];
            if gradient.strength < LEAST_GRADIENT * background.contrast(x, y) {
                continue;
            }
            let length = gradient.x.hypot(gradient.y);
            let across = [gradient.x / length, gradient.y / length];
            // The neighbour across the edge, of eight.
            let step = across.map(|part| part.round() as isize);
            let neighbour = |sign: isize| {
                let (x, y) = (x.wrapping_add_signed(sign * step[0]), y.wrapping_add_signed(sign * step[1]));
                gradients[y * width + x].strength
            };
            if gradient.strength >= neighbour(1) && gradient.strength > neighbour(-1) {
                edges.push(Edge { x, y, across });
            }
        }
    }
    edges
}

/// The strongest channel's gradient, as strong as the weaker of it and of its difference from the background's:
/// a standing edge has no difference, and where the ball hides one the frame has no gradient.
fn moving_gradient(frame: &RgbImage, still: Option<&RgbImage>, x: usize, y: usize) -> Gradient {
    let [right, down] = sobel(frame, x, y);
    let [still_right, still_down] = still.map_or([Levels::default(); 2], |still| sobel(still, x, y));
    let mut strongest = Gradient::default();
    for channel in 0..3 {
        let (gx, gy) = (right[channel], down[channel]);
        let difference = (gx - still_right[channel]).hypot(gy - still_down[channel]);
        let strength = gx.hypot(gy).min(difference);
        if strength > strongest.strength {
            strongest = Gradient { strength, x: gx, y: gy };
        }
    }
    strongest
}

/// Gradient to the right and down, levels a pixel (Sobel's weights).
fn sobel(rgb: &RgbImage, x: usize, y: usize) -> [Levels; 2] {
    let at = |dx: usize, dy: usize| levels_at(rgb, x + dx - 1, y + dy - 1);
    let [a, b, c] = [at(0, 0), at(1, 0), at(2, 0)];
    let [d, f] = [at(0, 1), at(2, 1)];
    let [g, h, i] = [at(0, 2), at(1, 2), at(2, 2)];
    [
        std::array::from_fn(|n| (c[n] + 2.0 * f[n] + i[n] - a[n] - 2.0 * d[n] - g[n]) / 8.0),
        std::array::from_fn(|n| (g[n] + 2.0 * h[n] + i[n] - a[n] - 2.0 * b[n] - c[n]) / 8.0),
    ]
}
