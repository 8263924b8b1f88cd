//! What differs between the frames of a video from a camera that stands still.

use std::sync::Arc;

use image::RgbImage;
use nalgebra::Matrix3;
use rayon::prelude::*;

use super::config::BackgroundConfig;
use gravisight_kernels::{Vectors, pixels};

/// Pixels left out between those that tell the noise.
const STEP: usize = 37;

/// Rows, and pixels, that a thread does at a time.
const BAND: usize = 60;
const PART: usize = 1 << 16;

/// Brightness and the difference of red and blue, 0 to 255, rows from the top: a yellow ball before green is as bright.
#[derive(Debug)]
pub(super) struct Planes {
    pub width: usize,
    pub height: usize,
    pub levels: [Vec<u8>; 2],
}

/// Memory of bytes that is used again: to be given 10 MB anew for each frame takes as long as to fill them.
#[derive(Default)]
pub(super) struct Spare(Vec<Vec<u8>>);

impl Spare {
    fn take(&mut self, length: usize) -> Vec<u8> {
        self.0.pop().filter(|bytes| bytes.len() == length).unwrap_or_else(|| vec![0; length])
    }

    pub fn give(&mut self, bytes: Vec<u8>) {
        self.0.push(bytes);
    }
}

impl Planes {
    pub fn of(rgb: &RgbImage, spare: &mut Spare) -> Self {
        let (width, height) = (rgb.width() as usize, rgb.height() as usize);
        let [mut brightness, mut colour] = [(); 2].map(|()| spare.take(width * height));
        let band = BAND * width.max(1);
        let bands = brightness.par_chunks_mut(band).zip(colour.par_chunks_mut(band));
        bands.zip(rgb.as_raw().par_chunks(3 * band)).for_each(|((brightness, colour), rgb)| {
            pixels::levels(Vectors::best(), rgb, brightness, colour);
        });
        Self { width, height, levels: [brightness, colour] }
    }

    /// The same as another view shows it: `own_from_other` maps that view's pixels to these. What is not in the picture is as `beyond`
    /// has it.
    pub fn warped(&self, own_from_other: &Matrix3<f64>, beyond: Option<&Self>, spare: &mut Spare) -> Self {
        let (width, height) = (self.width, self.height);
        let levels = [0, 1].map(|plane| {
            let mut warped = spare.take(width * height);
            let from = &self.levels[plane];
            let beyond = beyond.map(|beyond| &beyond.levels[plane]);
            warped.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
                let beyond = beyond.map(|beyond| &beyond[y * width..][..width]);
                warp_row(from, [width, height], own_from_other, y, beyond, row);
            });
            warped
        });
        Self { width, height, levels }
    }

    /// The largest difference of each pixel's levels in two pictures of one size.
    pub fn difference(&self, other: &Self, spare: &mut Spare) -> Vec<u8> {
        let mut differences = spare.take(self.width * self.height);
        let band = BAND * self.width.max(1);
        let [[a, b], [c, d]] = [self, other].map(|planes| planes.levels.each_ref().map(|it| it.par_chunks(band)));
        differences.par_chunks_mut(band).zip(a.zip(c)).zip(b.zip(d)).for_each(|((differences, (a, c)), (b, d))| {
            pixels::differences(Vectors::best(), [a, b], [c, d], differences);
        });
        differences
    }
}

/// A row of a plane of `size` as another view shows it, interpolated between pixels.
fn warp_row(
    from: &[u8],
    [width, height]: [usize; 2],
    own_from_other: &Matrix3<f64>,
    y: usize,
    beyond: Option<&[u8]>,
    row: &mut [u8],
) {
    let column = |index: usize| own_from_other.column(index).map(|value| value as f32);
    let (along, start) = (column(0), column(1) * y as f32 + column(2));
    for (x, out) in row.iter_mut().enumerate() {
        let at = start + along * x as f32;
        let (u, v) = (at.x / at.z, at.y / at.z);
        if !(u >= 0.0 && v >= 0.0 && u < (width - 1) as f32 && v < (height - 1) as f32) {
            *out = beyond.map_or(0, |beyond| beyond[x]);
            continue;
        }
        let (column, line) = (u as usize, v as usize);
        // Parts of 256.
        let [right, below] = [u - column as f32, v - line as f32].map(|part| (part * 256.0) as u32);
        let pixel = line * width + column;
        let between = |at: usize| u32::from(from[at]) * (256 - right) + u32::from(from[at + 1]) * right;
        *out = ((between(pixel) * (256 - below) + between(pixel + width) * below + (1 << 15)) >> 16) as u8;
    }
}

/// Takes `less` from each of `values`, down to zero.
pub(super) fn subtract(values: &mut [u8], less: &[u8]) {
    values.par_chunks_mut(PART).zip(less.par_chunks(PART)).for_each(|(values, less)| {
        values.iter_mut().zip(less).for_each(|(value, less)| *value = value.saturating_sub(*less));
    });
}

/// What stands still.
#[derive(Debug)]
pub(super) struct Background(Planes);

impl Background {
    /// The median of frames.
    pub fn of(frames: &[Arc<Planes>]) -> Option<Self> {
        let first = frames.first()?;
        let mut background = Planes { levels: first.levels.clone(), ..**first };
        let band = BAND * first.width.max(1);
        for (plane, levels) in background.levels.iter_mut().enumerate() {
            levels.par_chunks_mut(band).enumerate().for_each(|(number, levels)| {
                let mut values = vec![0; frames.len()];
                for (pixel, level) in levels.iter_mut().enumerate() {
                    let index = number * band + pixel;
                    values.iter_mut().zip(frames).for_each(|(value, frame)| *value = frame.levels[plane][index]);
                    let middle = values.len() / 2;
                    *level = *values.select_nth_unstable(middle).1;
                }
            });
        }
        Some(Self(background))
    }

    /// Another one in its place, made of it.
    pub fn replace(&mut self, moved: &mut impl FnMut(&Planes) -> Arc<Planes>) {
        let planes = moved(&self.0);
        self.0 = Planes { levels: planes.levels.clone(), ..*planes };
    }

    /// A fraction of the range of brightness in the 3×3 pixels about each.
    pub fn edges(&self, fraction: f64, spare: &mut Spare) -> Vec<u8> {
        let Planes { width, height, levels: [levels, _] } = &self.0;
        let (width, height) = (*width, *height);
        let mut edges = spare.take(width * height);
        edges.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
            let lines = [y.saturating_sub(1), y, (y + 1).min(height - 1)].map(|line| &levels[line * width..][..width]);
            let extremes = |x: usize| {
                let of = lines.map(|line| line[x]);
                (of[0].min(of[1]).min(of[2]), of[0].max(of[1]).max(of[2]))
            };
            let mut columns = [extremes(0), extremes(0), extremes(1.min(width - 1))];
            for (x, edge) in row.iter_mut().enumerate() {
                let least = columns[0].0.min(columns[1].0).min(columns[2].0);
                let most = columns[0].1.max(columns[1].1).max(columns[2].1);
                *edge = (f64::from(most - least) * fraction) as u8;
                columns = [columns[1], columns[2], extremes((x + 2).min(width - 1))];
            }
        });
        edges
    }

    /// How much a frame's pixels are not the background's, which then follows light that changes slowly: a level a frame.
    pub fn follow(&mut self, frame: &Planes, spare: &mut Spare) -> Vec<u8> {
        let mut differences = spare.take(frame.width * frame.height);
        let band = BAND * frame.width.max(1);
        let [a, b] = self.0.levels.each_mut().map(|levels| levels.par_chunks_mut(band));
        let [c, d] = frame.levels.each_ref().map(|levels| levels.par_chunks(band));
        differences.par_chunks_mut(band).zip(a.zip(c)).zip(b.zip(d)).for_each(|((differences, (a, c)), (b, d))| {
            pixels::differences_followed(Vectors::best(), [a, b], [c, d], differences);
        });
        differences
    }
}

/// The less of two differences of each pixel.
pub(super) fn less_of(a: &[u8], b: &[u8], spare: &mut Spare) -> Vec<u8> {
    let mut less = spare.take(a.len());
    less.par_chunks_mut(PART).zip(a.par_chunks(PART)).zip(b.par_chunks(PART)).for_each(|((less, a), b)| {
        pixels::less(Vectors::best(), a, b, less);
    });
    less
}

/// Fraction of the pixels that differ by more than `least`.
pub(super) fn fraction_above(differences: &[u8], least: u8) -> f64 {
    let count = |part: &[u8]| {
        let mut count = 0;
        pixels::count_above(Vectors::best(), part, least, &mut count);
        count
    };
    let count: usize = differences.par_chunks(PART).map(count).sum();
    count as f64 / differences.len().max(1) as f64
}

/// The difference of levels that noise does not reach, of the differences of two frames.
pub(super) fn contrast_of(differences: &[u8], config: &BackgroundConfig) -> u8 {
    let mut counts = [0_usize; 256];
    differences.iter().step_by(STEP).for_each(|&difference| counts[difference as usize] += 1);
    let all: usize = counts.iter().sum();
    let mut below = 0;
    // Most pixels show what stands still. The median of whole numbers, between them.
    let median = counts.iter().enumerate().find_map(|(level, &count)| {
        below += count;
        (2 * below >= all).then(|| level as f64 + 0.5 - (below as f64 - all as f64 / 2.0) / count.max(1) as f64)
    });
    config.least_contrast.max((config.contrast_of_noise * median.unwrap_or(0.0)).min(255.0) as u8)
}
