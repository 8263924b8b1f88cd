//! What a camera makes of what is before it: its part of a panorama, softness, halos, flicker, noise.

use image::{Rgb, RgbImage};
use nalgebra::Matrix3;
use rand::RngExt;

use super::super::random::canvas::Canvas;
use super::super::random::noise::Normals;
use gravisight_geometry::camera::Camera;
use gravisight_geometry::random::Random;

/// Side of a grain of chroma noise, px: colours are coded at half the resolution, and smoothed.
const CHROMA_GRAIN: usize = 3;

/// How a clip's camera develops its pictures.
#[derive(Debug)]
pub(crate) struct Developing {
    normals: Normals,
    /// Standard deviation of the noise of brightness and of colour, fractions of full scale.
    noise: [f32; 2],
    /// Weight of a pixel's neighbours, and strength of the halo.
    soft: f32,
    halo: f32,
    /// Strength and rate, 1/s, of lamps' flicker, how often it is seen from the top to the bottom, and the corners' darkness.
    flicker: [f64; 3],
    dark_corners: f32,
}

/// A camera's picture of a panorama that another of the same centre took; the mean of `taps` cameras of one exposure.
pub(super) fn cut(panorama: &Canvas, taken: &Camera, cameras: &[Camera]) -> Canvas {
    if let [camera] = cameras
        && camera.size() == taken.size()
        && camera.intrinsic() == taken.intrinsic()
        && camera.rotation() == taken.rotation()
    {
        return panorama.clone();
    }
    let mut sum = Canvas::new(cameras[0].size(), [0.0; 3]);
    let weight = 1.0 / cameras.len() as f32;
    for camera in cameras {
        let back = camera.intrinsic().try_inverse().unwrap_or_else(Matrix3::identity);
        let map = taken.intrinsic() * taken.rotation() * camera.rotation().transpose() * back;
        add(&mut sum, panorama, &map, weight);
    }
    sum
}

fn add(sum: &mut Canvas, panorama: &Canvas, map: &Matrix3<f64>, weight: f32) {
    let [right, down] = [panorama.width - 2, panorama.height - 2].map(|most| most as f32 + 0.999);
    let step: [f32; 3] = std::array::from_fn(|axis| map[(axis, 0)] as f32);
    for row in 0..sum.height {
        let start: [f32; 3] = std::array::from_fn(|axis| (map[(axis, 1)] * row as f64 + map[(axis, 2)]) as f32);
        for column in 0..sum.width {
            let at: [f32; 3] = std::array::from_fn(|axis| start[axis] + step[axis] * column as f32);
            let x = (at[0] / at[2]).clamp(0.0, right);
            let y = (at[1] / at[2]).clamp(0.0, down);
            let (left, top) = (x as usize, y as usize);
            let (u, v) = (x - left as f32, y - top as f32);
            let above = top * panorama.width + left;
            let below = above + panorama.width;
            let index = row * sum.width + column;
            for (sum, plane) in sum.planes.iter_mut().zip(&panorama.planes) {
                let upper = plane[above] + u * (plane[above + 1] - plane[above]);
                let lower = plane[below] + u * (plane[below + 1] - plane[below]);
                sum[index] += weight * (upper + v * (lower - upper));
            }
        }
    }
}

/// Each value with its neighbours `reach` px away in a row and a column, which weigh `weight` each.
fn spread(plane: &mut [f32], width: usize, reach: usize, weight: f32) {
    let own = 1.0 - 2.0 * weight;
    let before = plane.to_vec();
    for (line, from) in plane.chunks_exact_mut(width).zip(before.chunks_exact(width)) {
        let sides = from[2 * reach..].iter().zip(from).zip(&from[reach..]);
        for (value, ((right, left), middle)) in line[reach..].iter_mut().zip(sides) {
            *value = own * middle + weight * (left + right);
        }
    }
    let before = plane.to_vec();
    let away = reach * width;
    let sides = before[2 * away..].iter().zip(&before).zip(&before[away..]);
    for (value, ((below, above), middle)) in plane[away..].iter_mut().zip(sides) {
        *value = own * middle + weight * (above + below);
    }
}

impl Developing {
    pub fn draw(random: &mut Random) -> Self {
        let noise = random.random_range(0.001_f32.ln()..0.025_f32.ln()).exp();
        let sharpened = random.random_bool(0.5);
        Self {
            noise: [noise, noise * random.random_range(0.3..1.5)],
            soft: random.random_range(0.0..0.25),
            halo: if sharpened { random.random_range(0.2..1.0) } else { 0.0 },
            flicker: [
                random.random_range(0.0..1.0_f64).powi(2) * 0.03,
                random.random_range(0.7..12.0),
                if random.random_bool(0.4) { random.random_range(0.3..4.0) } else { 0.0 },
            ],
            dark_corners: random.random_range(0.0..0.2),
            normals: Normals::new(random),
        }
    }

    /// The picture of what was drawn at a time, s.
    pub fn develop(&self, mut canvas: Canvas, time: f64, random: &mut Random) -> RgbImage {
        let width = canvas.width;
        if self.soft > 0.02 {
            canvas.planes.iter_mut().for_each(|plane| spread(plane, width, 1, self.soft));
        }
        if self.halo > 0.0 {
            self.sharpen(&mut canvas);
        }
        self.flicker(&mut canvas, time);
        self.grain(&mut canvas, random);
        for plane in &mut canvas.planes {
            self.normals.add(plane, self.noise[0], random);
        }
        let [red, green, blue] = &canvas.planes;
        let byte = |value: f32| (255.0 * value + 0.5).clamp(0.0, 255.0) as u8;
        RgbImage::from_fn(width as u32, canvas.height as u32, |x, y| {
            let index = y as usize * width + x as usize;
            Rgb([red[index], green[index], blue[index]].map(byte))
        })
    }

    /// Adds the difference of the brightness from its surroundings.
    fn sharpen(&self, canvas: &mut Canvas) {
        let [red, green, blue] = &canvas.planes;
        let levels = red.iter().zip(green).zip(blue);
        let mut bright: Vec<f32> = levels.map(|((r, g), b)| 0.299 * r + 0.587 * g + 0.114 * b).collect();
        let sharp = bright.clone();
        spread(&mut bright, canvas.width, 1, 0.25);
        spread(&mut bright, canvas.width, 2, 0.25);
        for plane in &mut canvas.planes {
            for ((value, sharp), soft) in plane.iter_mut().zip(&sharp).zip(&bright) {
                *value += self.halo * (sharp - soft);
            }
        }
    }

    fn flicker(&self, canvas: &mut Canvas, time: f64) {
        let [strength, rate, bands] = self.flicker;
        let (width, height) = (canvas.width, canvas.height as f64);
        for row in 0..canvas.height {
            let down = row as f64 / height;
            let wave = (std::f64::consts::TAU * (rate * time + bands * down)).sin();
            let corner = 1.0 - self.dark_corners * (2.0 * down as f32 - 1.0).powi(2);
            let gain = corner * (1.0 + strength * wave) as f32;
            for plane in &mut canvas.planes {
                plane[row * width..(row + 1) * width].iter_mut().for_each(|value| *value *= gain);
            }
        }
    }

    /// Coarse noise of colours.
    fn grain(&self, canvas: &mut Canvas, random: &mut Random) {
        let (columns, rows) = (canvas.width.div_ceil(CHROMA_GRAIN), canvas.height.div_ceil(CHROMA_GRAIN));
        let grains: [Vec<f32>; 2] = std::array::from_fn(|_| {
            let mut plane = vec![0.0; columns * rows];
            self.normals.add(&mut plane, self.noise[1], random);
            plane
        });
        let [red, green, blue] = &mut canvas.planes;
        for row in 0..canvas.height {
            let from = row / CHROMA_GRAIN * columns;
            for column in 0..canvas.width {
                let (index, grain) = (row * canvas.width + column, from + column / CHROMA_GRAIN);
                let (blueness, redness) = (grains[0][grain], grains[1][grain]);
                red[index] += 1.402 * redness;
                green[index] -= 0.344 * blueness + 0.714 * redness;
                blue[index] += 1.772 * blueness;
            }
        }
    }
}
