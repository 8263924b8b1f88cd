//! Noise: smooth, over a picture, and of a sensor's pixels.

use rand::RngExt;

use super::canvas::Canvas;
use gravisight_geometry::random::{Random, normal_pair};

/// Length of the table of normal numbers; a power of two.
const TABLE: usize = 1 << 16;

/// Smooth noise over a picture from random values on a grid of `cell` px, from 0 to 1; `octaves` of it, each half as
/// large and `falloff` as strong.
pub fn smooth(canvas: &Canvas, cell: f32, octaves: u32, falloff: f32, random: &mut Random) -> Vec<f32> {
    let mut values = vec![0.0; canvas.width * canvas.height];
    let (mut strength, mut total) = (1.0, 0.0);
    for octave in 0..octaves {
        let cell = cell / 2_f32.powi(octave as i32);
        if cell < 1.5 {
            break;
        }
        add_octave(&mut values, canvas, cell, strength, random);
        total += strength;
        strength *= falloff;
    }
    values.iter_mut().for_each(|value| *value /= f32::max(total, 1e-6));
    values
}

fn add_octave(values: &mut [f32], canvas: &Canvas, cell: f32, strength: f32, random: &mut Random) {
    let count = |side: usize| (side as f32 / cell) as usize + 3;
    let (columns, rows) = (count(canvas.width), count(canvas.height));
    let grid: Vec<f32> = (0..columns * rows).map(|_| random.random_range(0.0..1.0)).collect();
    let offset: [f32; 2] = std::array::from_fn(|_| random.random_range(0.0..1.0));
    let ease = |fraction: f32| fraction * fraction * (3.0 - 2.0 * fraction);
    let mut line = vec![0.0; columns];
    let places: Vec<(usize, f32)> = (0..canvas.width)
        .map(|column| {
            let at = column as f32 / cell + offset[0];
            (at as usize, ease(at.fract()))
        })
        .collect();
    for (row, values) in values.chunks_exact_mut(canvas.width).enumerate() {
        let at = row as f32 / cell + offset[1];
        let (above, fraction) = (at as usize * columns, ease(at.fract()));
        for (column, value) in line.iter_mut().enumerate() {
            let upper = grid[above + column];
            *value = strength * (upper + fraction * (grid[above + columns + column] - upper));
        }
        for (value, &(left, fraction)) in values.iter_mut().zip(&places) {
            *value += line[left] + fraction * (line[left + 1] - line[left]);
        }
    }
}

/// Standard normal numbers, a table of them; read from random places they do for the noise of pixels.
#[derive(Debug)]
pub struct Normals(Vec<f32>);

impl Normals {
    pub fn new(random: &mut Random) -> Self {
        let mut values = Vec::with_capacity(TABLE);
        while values.len() < TABLE {
            values.extend(normal_pair::<f32>(random));
        }
        Self(values)
    }

    /// Adds noise of standard deviation `sigma` to `values`.
    pub fn add(&self, values: &mut [f32], sigma: f32, random: &mut Random) {
        // Row by row from another place, so that nothing repeats.
        for part in values.chunks_mut(256) {
            let start = random.random_range(0..TABLE - 256);
            part.iter_mut().zip(&self.0[start..]).for_each(|(value, normal)| *value += sigma * normal);
        }
    }
}
