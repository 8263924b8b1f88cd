//! Random changes of training pictures: which part, how bright, how sharp.

use rand::RngExt;
use rand::rngs::StdRng;

use super::config::Augmentation;

/// Grid that crops are placed on, px: the compact backbone's largest stride, so that a crop sees
/// the same pixels in the same cells as the whole picture.
const CROP_GRID: u32 = 32;

/// A part of the network's input, perhaps mirrored.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Left and top of the part, px; it may begin outside.
    pub corner: [i64; 2],
    /// Width and height of the part, px.
    pub size: [u32; 2],
    /// Whether left and right are exchanged (after the cut).
    pub mirrored: bool,
}

impl View {
    /// A random view of an input of `size`: with `crop`, a square of that side around `centre`, on a grid; moved by
    /// up to the configuration's shift; perhaps mirrored.
    pub fn random(
        size: [u32; 2],
        crop: Option<u32>,
        centre: [f64; 2],
        config: &Augmentation,
        random: &mut StdRng,
    ) -> Self {
        let mut corner = [0, 0];
        if let Some(side) = crop {
            corner = [0, 1].map(|axis| i64::from(crop_start(centre[axis], size[axis], side, random)));
        }
        if config.shift > 0 {
            let most = i64::from(config.shift);
            corner = corner.map(|start| start + random.random_range(-most..=most));
        }
        let mirrored = config.flip > 0.0 && random.random_bool(config.flip);
        Self { corner, size: crop.map_or(size, |side| [side, side]), mirrored }
    }

    /// Where a point of the input is in the view, px.
    pub fn of_input(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let x = x - self.corner[0] as f64;
        let x = if self.mirrored { f64::from(self.size[0]) - 1.0 - x } else { x };
        [x, y - self.corner[1] as f64]
    }

    /// Slope and offset of each axis from the view back to the input, px.
    pub fn to_input(&self) -> [[f64; 2]; 2] {
        let [left, top] = self.corner.map(|start| start as f64);
        let x = if self.mirrored { [-1.0, f64::from(self.size[0]) - 1.0 + left] } else { [1.0, left] };
        [x, [1.0, top]]
    }

    /// The view's part of `values`, `[height, width, 3]` of an input of `size`; beyond the edge, the edge's colour.
    pub fn cut(&self, values: Vec<f32>, size: [u32; 2]) -> Vec<f32> {
        if *self == (Self { corner: [0, 0], size, mirrored: false }) {
            return values;
        }
        let [width, height] = size.map(i64::from);
        let columns: Vec<usize> = (0..i64::from(self.size[0]))
            .map(|column| if self.mirrored { i64::from(self.size[0]) - 1 - column } else { column })
            .map(|column| (column + self.corner[0]).clamp(0, width - 1) as usize)
            .collect();
        let mut part = Vec::with_capacity(3 * (self.size[0] * self.size[1]) as usize);
        for row in 0..i64::from(self.size[1]) {
            let row = (row + self.corner[1]).clamp(0, height - 1) as usize;
            let row = &values[3 * row * width as usize..3 * (row + 1) * width as usize];
            for &column in &columns {
                part.extend_from_slice(&row[3 * column..3 * column + 3]);
            }
        }
        part
    }
}

/// A random start on the grid such that `[start, start + side)` holds `centre` and lies in `0..size`.
fn crop_start(centre: f64, size: u32, side: u32, random: &mut StdRng) -> u32 {
    let holds = |start: u32| (f64::from(start)..f64::from(start + side)).contains(&(centre + 0.5));
    let starts: Vec<u32> = (0..=size - side).step_by(CROP_GRID as usize).filter(|&start| holds(start)).collect();
    match starts.len() {
        // A label outside the picture, or between the grid's last start and the edge.
        0 => (centre - f64::from(side) / 2.0).clamp(0.0, f64::from(size - side)) as u32,
        count => starts[random.random_range(0..count)],
    }
}

/// Changes light, colour, sharpness and noise of normalised `values`, `[height, width, 3]`.
pub fn change_light(values: &mut Vec<f32>, [width, height]: [u32; 2], config: &Augmentation, random: &mut StdRng) {
    let blur = if config.blur > 0.0 { random.random_range(0.0..config.blur) } else { 0.0 };
    if blur > 0.0 {
        *values = blurred(values, [width as usize, height as usize], blur);
    }
    let mut within = |range: f32| if range > 0.0 { random.random_range(-range..range) } else { 0.0 };
    let (gain, offset) = (1.0 + within(config.brightness), within(config.brightness));
    let channels = [0, 1, 2].map(|_| (gain + within(config.colour), offset + within(config.colour)));
    for pixel in values.chunks_exact_mut(3) {
        for (value, (gain, offset)) in pixel.iter_mut().zip(channels) {
            *value = *value * gain + offset + within(config.noise);
        }
    }
}

/// Each pixel with `share` of each neighbour, along rows and columns.
fn blurred(values: &[f32], [width, height]: [usize; 2], share: f32) -> Vec<f32> {
    let along = |values: &[f32], step: usize, index: usize, at: usize, count: usize| {
        let before = if at > 0 { values[index - step] } else { values[index] };
        let after = if at + 1 < count { values[index + step] } else { values[index] };
        values[index] * (1.0 - 2.0 * share) + (before + after) * share
    };
    let indices = 0..values.len();
    let rows: Vec<f32> = indices.clone().map(|index| along(values, 3, index, index / 3 % width, width)).collect();
    indices.map(|index| along(&rows, 3 * width, index, index / (3 * width), height)).collect()
}
