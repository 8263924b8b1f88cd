//! How far the next ridge of a direction is, for every place in a picture.
//!
//! A model's line is looked up in the map of its own direction, so that crosswise paint does not count.

use std::f64::consts::PI;

use super::segments::Segments;

/// Directions, 15° apart. Each map holds segments within 15° of its own, so that none falls between two.
const DIRECTIONS: usize = 12;
/// Quarter pixels of the picture that a step of the maps, 2 px, is long.
const STEP: f32 = 8.0;
/// Lengths of a straight and of a diagonal step of the chamfer distance (Borgefors, 1986), as in OpenCV for a 3×3 mask.
const STRAIGHT: f32 = 0.955;
const DIAGONAL: f32 = 1.3693;

/// One map of distances for each direction, at half the picture's size.
pub(super) struct DirectionMaps {
    /// Quarter pixels of the picture, at most 255; directions after one another.
    distances: Vec<u8>,
    pub width: usize,
    pub height: usize,
}

/// The difference of two directions of lines, rad, 0 to π/2.
pub(super) fn between(a: f64, b: f64) -> f64 {
    ((a - b + PI / 2.0).rem_euclid(PI) - PI / 2.0).abs()
}

impl DirectionMaps {
    /// Of a picture `width` px wide and `height` px high.
    pub(super) fn of(segments: &Segments, width: usize, height: usize) -> Self {
        let directions: Vec<f64> = segments.all.iter().map(super::segments::Segment::direction).collect();
        let pixels: Vec<(usize, usize)> = (segments.labels.iter().enumerate())
            .filter(|(_, label)| **label > 0)
            .map(|(at, label)| (at, *label as usize - 1))
            .collect();
        let (half_width, half_height) = (width.div_ceil(2), height.div_ceil(2));
        let mut distances = Vec::with_capacity(DIRECTIONS * half_width * half_height);
        for index in 0..DIRECTIONS {
            let direction = index as f64 * PI / DIRECTIONS as f64;
            let is_here: Vec<bool> =
                directions.iter().map(|&other| between(other, direction) < PI / DIRECTIONS as f64).collect();
            let mut map = vec![f32::from(u8::MAX) / STEP; half_width * half_height];
            for (at, _) in pixels.iter().filter(|(_, segment)| is_here[*segment]) {
                map[at / width / 2 * half_width + at % width / 2] = 0.0;
            }
            chamfer(&mut map, half_width);
            distances.extend(map.into_iter().map(|steps| (STEP * steps).min(255.0) as u8));
        }
        Self { distances, width: half_width, height: half_height }
    }

    /// The map for lines of a direction, rad.
    pub(super) fn towards(&self, direction: f64) -> &[u8] {
        let index = (direction.rem_euclid(PI) / PI * DIRECTIONS as f64 + 0.5) as usize % DIRECTIONS;
        let size = self.width * self.height;
        &self.distances[index * size..][..size]
    }
}

/// Distances to the zeros of a map, in its own steps, in two passes.
fn chamfer(map: &mut [f32], width: usize) {
    let height = map.len() / width.max(1);
    // The least of a place's own distance and those by way of its neighbour in the row and of another row.
    let relax = |map: &mut [f32], [x, y]: [usize; 2], side: Option<usize>, row: Option<usize>| {
        let mut best = map[y * width + x];
        if let Some(side) = side.filter(|side| *side < width) {
            best = best.min(map[y * width + side] + STRAIGHT);
        }
        if let Some(row) = row.filter(|row| *row < height) {
            let row = &map[row * width..][..width];
            let diagonal = row[x.saturating_sub(1)].min(row[(x + 1).min(width - 1)]);
            best = best.min(row[x] + STRAIGHT).min(diagonal + DIAGONAL);
        }
        map[y * width + x] = best;
    };
    for y in 0..height {
        (0..width).for_each(|x| relax(map, [x, y], x.checked_sub(1), y.checked_sub(1)));
    }
    for y in (0..height).rev() {
        (0..width).rev().for_each(|x| relax(map, [x, y], Some(x + 1), Some(y + 1)));
    }
}
