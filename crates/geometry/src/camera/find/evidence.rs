//! What a picture shows for every court alike: segments, lines, maps.

use image::RgbImage;
use nalgebra::{Vector2, Vector3};

use super::channel::{Paint, lab, linear_levels};
use super::lines::{PictureLine, merged};
use super::maps::DirectionMaps;
use super::ridges::ridges;
use super::segments::{Segments, segments};

/// Least contrast of paint to its ground on both sides, levels of 255, in brightness and in chroma. Measured on 41 scenes.
const LEAST_CONTRAST: f32 = 5.0;
const LEAST_CHROMA: f32 = 3.0;
/// Weight of a neighbour, relative to the pixel, in the blur before colours are compared: a Gaussian of 0.6 px.
const NEIGHBOUR: f32 = 0.25;

/// What one channel of a picture shows.
pub(super) struct Evidence {
    pub width: usize,
    pub height: usize,
    pub segments: Segments,
    /// Direction of each segment, rad.
    pub directions: Vec<f64>,
    /// Mean CIE L* (scaled to 255), a* and b* of each segment.
    pub colours: Vec<[f32; 3]>,
    pub lines: Vec<PictureLine>,
    pub maps: DirectionMaps,
}

impl Evidence {
    /// Of a picture at least 1 px wide and high.
    pub(super) fn of(rgb: &RgbImage, paint: Paint) -> Self {
        let least = if paint.is_chroma() { LEAST_CHROMA } else { LEAST_CONTRAST };
        let (width, height) = (rgb.width() as usize, rgb.height() as usize);
        let segments = segments(&ridges(&paint.channel(rgb), least));
        Self {
            width,
            height,
            directions: segments.all.iter().map(super::segments::Segment::direction).collect(),
            colours: colours(rgb, &segments),
            lines: merged(&segments.all),
            maps: DirectionMaps::of(&segments, width, height),
            segments,
        }
    }

    /// The picture's longer side, px: the unit of what scales with the picture.
    pub(super) fn unit(&self) -> f64 {
        self.width.max(self.height) as f64
    }

    /// The picture's middle, px.
    pub(super) fn centre(&self) -> Vector2<f64> {
        Vector2::new(self.width as f64 - 1.0, self.height as f64 - 1.0) / 2.0
    }

    /// The equation of a line in coordinates from the picture's middle, in units.
    pub(super) fn centred(&self, line: &PictureLine) -> Vector3<f64> {
        let [a, b, c] = line.equation.into();
        let centre = self.centre();
        Vector3::new(a, b, (c + a * centre.x + b * centre.y) / self.unit())
    }
}

/// Mean colours of segments.
fn colours(rgb: &RgbImage, segments: &Segments) -> Vec<[f32; 3]> {
    let linear = linear_levels();
    let mut sums = vec![([0.0; 3], 0.0); segments.all.len()];
    let width = rgb.width() as usize;
    for (at, label) in segments.labels.iter().enumerate().filter(|(_, label)| **label > 0) {
        let colour = lab(&linear, blurred(rgb, at % width, at / width));
        let (sum, count) = &mut sums[*label as usize - 1];
        *count += 1.0;
        (0..3).for_each(|channel| sum[channel] += colour[channel]);
    }
    sums.into_iter().map(|(sum, count)| sum.map(|sum: f32| sum / f32::max(count, 1.0))).collect()
}

/// Red, green and blue of a pixel, blurred a little.
fn blurred(rgb: &RgbImage, x: usize, y: usize) -> [f32; 3] {
    let (width, height) = (rgb.width() as usize, rgb.height() as usize);
    let (mut levels, mut weights) = ([0.0; 3], 0.0);
    for row in y.saturating_sub(1)..=(y + 1).min(height - 1) {
        for column in x.saturating_sub(1)..=(x + 1).min(width - 1) {
            let weight = NEIGHBOUR.powi((row.abs_diff(y) + column.abs_diff(x)) as i32);
            let pixel = &rgb.as_raw()[3 * (row * width + column)..][..3];
            (0..3).for_each(|channel| levels[channel] += weight * f32::from(pixel[channel]));
            weights += weight;
        }
    }
    levels.map(|level| level / weights)
}
