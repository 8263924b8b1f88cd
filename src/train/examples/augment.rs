//! Random changes of training pictures: which part, how bright, how sharp.

use nalgebra::{Matrix2, Rotation2, Vector2};
use rand::RngExt;

use super::super::recipe::Augmentation;
use gravisight_geometry::random::Random;

/// Squares that are cut out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CropGrid {
    /// Their side, px.
    pub side: u32,
    /// The grid that they are placed on, px: the network's largest stride, so that a crop sees the same pixels in the
    /// same cells as the whole picture.
    pub grid: u32,
}

/// A view of the network's input: a part of it, perhaps moved, rotated, magnified or mirrored. All of it is what
/// another camera at the same place would see: one with another principal point, rolled, or with a longer lens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AugmentedView {
    /// Width and height, px.
    pub size: [u32; 2],
    /// From an offset in the view to an offset in the input, px.
    linear: Matrix2<f64>,
    /// Where the view's first pixel lies in the input, px.
    origin: Vector2<f64>,
    /// Magnification.
    pub zoom: f64,
}

impl AugmentedView {
    /// A random view of an input of `size`: with `crop`, a square of that side around `centre`, on a grid; then moved,
    /// rotated, magnified and mirrored within the configuration's bounds; and magnified `magnified` times in any case.
    pub fn random(
        size: [u32; 2],
        crop: Option<CropGrid>,
        centre: [f64; 2],
        magnified: f64,
        config: &Augmentation,
        random: &mut Random,
    ) -> Self {
        let size_of_view = crop.map_or(size, |crop| [crop.side, crop.side]);
        let mut corner = Vector2::zeros();
        if let Some(crop) = crop {
            corner = Vector2::from([0, 1].map(|axis| f64::from(crop_start(centre[axis], size[axis], crop, random))));
        }
        if config.shift > 0 {
            let most = i64::from(config.shift);
            corner += Vector2::from_fn(|_, _| random.random_range(-most..=most) as f64);
        }
        let mut within = |range: f64| if range > 0.0 { random.random_range(-range..range) } else { 0.0 };
        let rotation = Rotation2::new(within(config.roll_degrees.to_radians()));
        let zoom = magnified * (1.0 + config.zoom).powf(within(1.0) * f64::from(config.zoom > 0.0));
        let mirror = if config.flip > 0.0 && random.random_bool(config.flip) { -1.0 } else { 1.0 };
        let linear = rotation.matrix() / zoom * Matrix2::new(mirror, 0.0, 0.0, 1.0);
        // Turned and magnified about the ball where there is one to keep in sight, in a crop.
        let about = match crop {
            Some(_) => Vector2::from(centre),
            None => Vector2::from(size.map(|side| (f64::from(side) - 1.0) / 2.0)),
        };
        let in_view = about - corner;
        let in_view =
            if mirror < 0.0 { Vector2::new(f64::from(size_of_view[0]) - 1.0 - in_view.x, in_view.y) } else { in_view };
        Self { size: size_of_view, linear, origin: about - linear * in_view, zoom }
    }

    /// Where a point of the input is in the view, px.
    pub fn of_input(&self, point: [f64; 2]) -> [f64; 2] {
        let inverse = self.linear.try_inverse().unwrap_or_else(Matrix2::identity); // a rotation times a number is never singular
        (inverse * (Vector2::from(point) - self.origin)).into()
    }

    /// From px of the view to px of the input: slopes and offset.
    pub fn to_input(self) -> (Matrix2<f64>, Vector2<f64>) {
        (self.linear, self.origin)
    }

    /// The view's part of `values`, `[height, width, 3]` of an input of `size`; beyond the edge, the edge's colour.
    pub fn cut(&self, values: &[f32], size: [u32; 2]) -> Vec<f32> {
        let [width, height] = size.map(|side| side as usize);
        let mut part = Vec::with_capacity(3 * (self.size[0] * self.size[1]) as usize);
        // Most views lie on whole pixels: nothing is between any.
        if self.linear == Matrix2::identity() && self.origin == self.origin.map(f64::round) {
            let columns: Vec<usize> =
                (0..self.size[0]).map(|column| neighbours(f64::from(column) + self.origin.x, width).0).collect();
            for row in 0..self.size[1] {
                let row = 3 * width * neighbours(f64::from(row) + self.origin.y, height).0;
                part.extend(columns.iter().flat_map(|column| &values[row + 3 * column..row + 3 * column + 3]));
            }
            return part;
        }
        for row in 0..self.size[1] {
            for column in 0..self.size[0] {
                let at = self.linear * Vector2::new(f64::from(column), f64::from(row)) + self.origin;
                let (left, right) = neighbours(at.x, width);
                let (above, below) = neighbours(at.y, height);
                let [u, v] = [at.x - at.x.floor(), at.y - at.y.floor()].map(|fraction| fraction as f32);
                for channel in 0..3 {
                    let value = |x: usize, y: usize| values[3 * (y * width + x) + channel];
                    let upper = value(left, above) + u * (value(right, above) - value(left, above));
                    let lower = value(left, below) + u * (value(right, below) - value(left, below));
                    part.push(upper + v * (lower - upper));
                }
            }
        }
        part
    }
}

/// The pixels to both sides of a coordinate, within `0..count`.
fn neighbours(at: f64, count: usize) -> (usize, usize) {
    let within = |at: f64| at.clamp(0.0, (count - 1) as f64) as usize;
    (within(at.floor()), within(at.floor() + 1.0))
}

/// A random start on the grid such that `[start, start + side)` holds `centre` and lies in `0..size`.
fn crop_start(centre: f64, size: u32, CropGrid { side, grid }: CropGrid, random: &mut Random) -> u32 {
    let holds = |start: u32| (f64::from(start)..f64::from(start + side)).contains(&(centre + 0.5));
    // Beyond a picture that is smaller its edge goes on.
    let room = size.saturating_sub(side);
    let starts: Vec<u32> = (0..=room).step_by(grid as usize).filter(|&start| holds(start)).collect();
    match starts.len() {
        // A label outside the picture, or between the grid's last start and the edge.
        0 => (centre - f64::from(side) / 2.0).clamp(0.0, f64::from(room)) as u32,
        count => starts[random.random_range(0..count)],
    }
}

/// Changes light, colour, sharpness and noise of normalised `values`, `[height, width, 3]`.
pub fn change_light(values: &mut Vec<f32>, [width, height]: [u32; 2], config: &Augmentation, random: &mut Random) {
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

/// Each pixel with `fraction` of each neighbour, along rows and columns.
fn blurred(values: &[f32], [width, height]: [usize; 2], fraction: f32) -> Vec<f32> {
    let along = |values: &[f32], step: usize, index: usize, at: usize, count: usize| {
        let before = if at > 0 { values[index - step] } else { values[index] };
        let after = if at + 1 < count { values[index + step] } else { values[index] };
        values[index] * (1.0 - 2.0 * fraction) + (before + after) * fraction
    };
    let indices = 0..values.len();
    let rows: Vec<f32> = indices.clone().map(|index| along(values, 3, index, index / 3 % width, width)).collect();
    indices.map(|index| along(&rows, 3 * width, index, index / (3 * width), height)).collect()
}
