//! Normalisation: batch statistics for training, layer norm over channels.

use super::map::{Map, MapMut};
use super::parallel::for_each;
use super::simd::Vectors;

/// Mean and sum of squared deviations of each channel, over a number of pixels.
#[derive(Debug, Clone)]
pub(super) struct Moments {
    pixels: f64,
    mean: Vec<f64>,
    squares: Vec<f64>,
}

impl Moments {
    /// Of one picture's rows.
    pub(super) fn of(vectors: Vectors, values: &[f32], row: usize, channels: usize) -> Self {
        let pixels = (values.len() / channels) as f64;
        let sums = fold(vectors, values, row, channels, |sum, value, _| sum + value, &vec![0.0; row]);
        let mean: Vec<f64> = sums.iter().map(|sum| sum / pixels).collect();
        let centre = widen(&mean, row);
        let squares =
            fold(vectors, values, row, channels, |sum, value, mean| sum + (value - mean) * (value - mean), &centre);
        Self { pixels, mean, squares }
    }

    /// Of two sets of pixels together (Chan et al., 1979).
    pub(super) fn merge(mut self, other: &Self) -> Self {
        let pixels = self.pixels + other.pixels;
        for channel in 0..self.mean.len() {
            let difference = other.mean[channel] - self.mean[channel];
            self.mean[channel] += difference * other.pixels / pixels;
            self.squares[channel] +=
                other.squares[channel] + difference * difference * self.pixels * other.pixels / pixels;
        }
        self.pixels = pixels;
        self
    }

    /// Mean and variance (of the pixels themselves, not unbiased) of each channel.
    pub(super) fn mean_and_variance(self) -> [Vec<f32>; 2] {
        let variance = self.squares.iter().map(|squares| (squares / self.pixels) as f32).collect();
        [self.mean.iter().map(|&mean| mean as f32).collect(), variance]
    }
}

/// Folds rows of pixels into one sum a channel; `by` is given beside each value of a row.
fn fold(
    vectors: Vectors,
    values: &[f32],
    row: usize,
    channels: usize,
    step: impl Fn(f32, f32, f32) -> f32,
    by: &[f32],
) -> Vec<f64> {
    let mut sums = vec![0.0_f32; row];
    vectors.run(|| {
        for line in values.chunks_exact(row) {
            for ((sum, &value), &by) in sums.iter_mut().zip(line).zip(by) {
                *sum = step(*sum, value, by);
            }
        }
    });
    per_channel(&sums, channels)
}

/// Sums of every `channels`th value.
pub(super) fn per_channel(sums: &[f32], channels: usize) -> Vec<f64> {
    let mut totals = vec![0.0; channels];
    for pixel in sums.chunks_exact(channels) {
        totals.iter_mut().zip(pixel).for_each(|(total, &sum)| *total += f64::from(sum));
    }
    totals
}

/// A value a channel, repeated for a row of `len` values.
pub(super) fn widen(channels: &[f64], len: usize) -> Vec<f32> {
    channels.iter().map(|&value| value as f32).cycle().take(len).collect()
}

/// Layer norm over the channels of each pixel (Ba et al., 2016), then a leaky ReLU.
pub fn layer_norm(
    vectors: Vectors,
    x: Map<'_>,
    [scale, shift]: [&[f32]; 2],
    epsilon: f32,
    slope: f32,
    out: MapMut<'_>,
) {
    let channels = x.extent.channels;
    assert_eq!(x.extent.with_halo(0), out.extent.with_halo(0), "layer norm keeps the size");
    assert!(scale.len() == channels && shift.len() == channels, "layer norm of {channels} channels");
    for_each(x.extent.batch * x.extent.height, |line| {
        let (image, row) = (line / x.extent.height, line % x.extent.height);
        vectors.run(|| {
            let pixels = x.row(image, row).chunks_exact(channels).zip(out.row(image, row).chunks_exact_mut(channels));
            for (pixel, out) in pixels {
                let mean = lane_sum(pixel, |value| value) / channels as f32;
                let variance = lane_sum(pixel, |value| (value - mean) * (value - mean)) / channels as f32;
                let factor = 1.0 / (variance + epsilon).sqrt();
                for (((out, &value), &scale), &shift) in out.iter_mut().zip(pixel).zip(scale).zip(shift) {
                    let value = (value - mean) * factor * scale + shift;
                    *out = value.max(value * slope);
                }
            }
        });
    });
}

/// Sum in sixteen lanes, which the compiler turns into vectors.
#[inline(always)]
fn lane_sum(values: &[f32], of: impl Fn(f32) -> f32) -> f32 {
    let mut lanes = [0.0_f32; 16];
    let chunks = values.chunks_exact(16);
    let rest: f32 = chunks.remainder().iter().map(|&value| of(value)).sum();
    for chunk in chunks {
        lanes.iter_mut().zip(chunk).for_each(|(lane, &value)| *lane += of(value));
    }
    lanes.iter().sum::<f32>() + rest
}
