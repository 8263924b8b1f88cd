//! Normalisation: batch statistics for training, layer norm over channels.

use super::conv::Epilogue;
use super::map::{Map, MapMut};
use super::parallel::for_each_of;
use super::simd::{Vectors, vectorised};

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
        let mut sums = vec![0.0; row];
        add_rows(vectors, values, &mut sums);
        let mean: Vec<f64> = per_channel(&sums, channels).iter().map(|sum| sum / pixels).collect();
        sums.fill(0.0);
        add_squares(vectors, values, &widen(&mean, row), &mut sums);
        let squares = per_channel(&sums, channels);
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

vectorised! {
    /// Adds rows to a row of sums.
    fn add_rows<'a>(values: &'a [f32], sums: &'a mut [f32]) {
        for line in values.chunks_exact(sums.len()) {
            for (sum, &value) in sums.iter_mut().zip(line) {
                *sum += value;
            }
        }
    }
}

vectorised! {
    /// Adds the squared deviations of rows from a row of means to a row of sums.
    fn add_squares<'a>(values: &'a [f32], mean: &'a [f32], sums: &'a mut [f32]) {
        for line in values.chunks_exact(sums.len()) {
            for ((sum, &value), &mean) in sums.iter_mut().zip(line).zip(mean) {
                *sum += (value - mean) * (value - mean);
            }
        }
    }
}

vectorised! {
    /// `slope(value · factor + offset + skip)` for rows; factors and offsets are a row's, an empty skip is none.
    pub(super) fn normalise_rows<'a>(
        values: &'a [f32],
        factors: &'a [f32],
        offsets: &'a [f32],
        skip: &'a [f32],
        slope: f32,
        out: &'a mut [f32],
    ) {
        let row = factors.len();
        for (index, (out, values)) in out.chunks_exact_mut(row).zip(values.chunks_exact(row)).enumerate() {
            if skip.is_empty() {
                for (((out, &value), &factor), &offset) in out.iter_mut().zip(values).zip(factors).zip(offsets) {
                    let value = value * factor + offset;
                    *out = value.max(value * slope);
                }
            } else {
                let skip = &skip[index * row..(index + 1) * row];
                let values = values.iter().zip(skip);
                for (((out, (&value, &skip)), &factor), &offset) in out.iter_mut().zip(values).zip(factors).zip(offsets) {
                    let value = value * factor + offset + skip;
                    *out = value.max(value * slope);
                }
            }
        }
    }
}

/// The gradient before an activation, from the output and its gradient.
#[inline(always)]
fn before(z: f32, dz: f32, slope: f32) -> f32 {
    let factor = if z > 0.0 { 1.0 } else { slope };
    dz * factor
}

vectorised! {
    /// The gradient before an activation.
    pub(super) fn before_activation<'a>(z: &'a [f32], dz: &'a [f32], slope: f32, out: &'a mut [f32]) {
        for ((out, &z), &dz) in out.iter_mut().zip(z).zip(dz) {
            *out = before(z, dz, slope);
        }
    }
}

vectorised! {
    /// Adds the gradient before an activation to a row of sums.
    pub(super) fn sum_gradient<'a>(z: &'a [f32], dz: &'a [f32], slope: f32, sums: &'a mut [f32]) {
        let row = sums.len();
        for (z, dz) in z.chunks_exact(row).zip(dz.chunks_exact(row)) {
            for ((sum, &z), &dz) in sums.iter_mut().zip(z).zip(dz) {
                *sum += before(z, dz, slope);
            }
        }
    }
}

vectorised! {
    /// Adds the gradient before an activation, and its product with the values' deviations from their mean, to
    /// rows of sums.
    pub(super) fn sum_norm_gradient<'a>(
        z: &'a [f32],
        dz: &'a [f32],
        slope: f32,
        values: &'a [f32],
        mean: &'a [f32],
        sums: &'a mut [f32],
        products: &'a mut [f32],
    ) {
        let row = sums.len();
        for ((z, dz), values) in z.chunks_exact(row).zip(dz.chunks_exact(row)).zip(values.chunks_exact(row)) {
            let sums = sums.iter_mut().zip(products.iter_mut());
            for ((((sum, product), &z), &dz), (&value, &mean)) in sums.zip(z).zip(dz).zip(values.iter().zip(mean)) {
                let gradient = before(z, dz, slope);
                *sum += gradient;
                *product += gradient * (value - mean);
            }
        }
    }
}

vectorised! {
    /// A row of the gradient before a norm: `a · gradient before the activation + b · value + c`.
    pub(super) fn norm_gradient<'a>(
        z: &'a [f32],
        dz: &'a [f32],
        slope: f32,
        values: &'a [f32],
        factors: [&'a [f32]; 3],
        out: &'a mut [f32],
    ) {
        let [a, b, c] = factors;
        let gradients = z.iter().zip(dz).zip(values);
        for (((out, ((&z, &dz), &value)), &a), (&b, &c)) in out.iter_mut().zip(gradients).zip(a).zip(b.iter().zip(c)) {
            *out = a * before(z, dz, slope) + (b * value + c);
        }
    }
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
    for_each_of(out.rows(), |line, out| {
        let (image, row) = (line / x.extent.height, line % x.extent.height);
        layer_norm_row(vectors, x.row(image, row), scale, shift, epsilon, slope, out);
    });
}

vectorised! {
    fn layer_norm_row<'a>(
        x: &'a [f32],
        scale: &'a [f32],
        shift: &'a [f32],
        epsilon: f32,
        slope: f32,
        out: &'a mut [f32],
    ) {
        let channels = scale.len();
        for (pixel, out) in x.chunks_exact(channels).zip(out.chunks_exact_mut(channels)) {
            let mean = lane_sum(pixel, 0.0, false) / channels as f32;
            let variance = lane_sum(pixel, mean, true) / channels as f32;
            let factor = 1.0 / (variance + epsilon).sqrt();
            for (((out, &value), &scale), &shift) in out.iter_mut().zip(pixel).zip(scale).zip(shift) {
                let value = (value - mean) * factor * scale + shift;
                *out = value.max(value * slope);
            }
        }
    }
}

/// x·Φ(x), Φ the normal distribution (Hendrycks & Gimpel, 2016), by the error function.
pub fn gelu(x: Map<'_>, out: MapMut<'_>) {
    assert_eq!(x.extent.with_halo(0), out.extent.with_halo(0), "GELU keeps the size");
    for_each_of(out.rows(), |line, out| {
        let (image, row) = (line / x.extent.height, line % x.extent.height);
        for (out, &value) in out.iter_mut().zip(x.row(image, row)) {
            *out = 0.5 * value * (1.0 + libm::erff(value * std::f32::consts::FRAC_1_SQRT_2));
        }
    });
}

/// Global response norm (Woo et al., 2023): each channel times 1 + weight·(its norm over the picture / the channels'
/// mean norm), plus bias.
pub fn response_norm(x: Map<'_>, [weight, bias]: [&[f32]; 2], epsilon: f32, out: MapMut<'_>) {
    let channels = x.extent.channels;
    assert_eq!(x.extent.with_halo(0), out.extent.with_halo(0), "a response norm keeps the size");
    assert!(weight.len() == channels && bias.len() == channels, "response norm of {channels} channels");
    for (image, rows) in out.rows().chunks_exact_mut(x.extent.height).enumerate() {
        let mut squares = vec![0.0_f64; channels];
        for pixel in (0..x.extent.height).flat_map(|row| x.row(image, row).chunks_exact(channels)) {
            squares.iter_mut().zip(pixel).for_each(|(sum, &value)| *sum += f64::from(value) * f64::from(value));
        }
        let strengths: Vec<f32> = squares.iter().map(|sum| sum.sqrt() as f32).collect();
        let mean = strengths.iter().sum::<f32>() / channels as f32 + epsilon;
        let factors: Vec<f32> = strengths.iter().zip(weight).map(|(strength, w)| 1.0 + w * strength / mean).collect();
        for_each_of(rows.iter_mut().collect(), |row, out| {
            let pixels = out.chunks_exact_mut(channels).zip(x.row(image, row).chunks_exact(channels));
            for (out, pixel) in pixels {
                for (((out, &value), factor), bias) in out.iter_mut().zip(pixel).zip(&factors).zip(bias) {
                    *out = value * factor + bias;
                }
            }
        });
    }
}

/// A weighted sum over the channels of each pixel, plus bias and skip, then a leaky ReLU.
pub(super) fn weighted_sum(
    vectors: Vectors,
    x: Map<'_>,
    weights: &[f32],
    Epilogue { start, skip, slope }: Epilogue<'_>,
    out: MapMut<'_>,
) {
    let bias = start.map_or(0.0, |start| start[0]);
    for_each_of(out.rows(), |line, out| {
        let (image, row) = (line / x.extent.height, line % x.extent.height);
        let skip = skip.map_or(&[][..], |skip| skip.row(image, row));
        weighted_sum_row(vectors, x.row(image, row), weights, bias, skip, slope, out);
    });
}

vectorised! {
    fn weighted_sum_row<'a>(
        x: &'a [f32],
        weights: &'a [f32],
        bias: f32,
        skip: &'a [f32],
        slope: f32,
        out: &'a mut [f32],
    ) {
        for (index, (out, pixel)) in out.iter_mut().zip(x.chunks_exact(weights.len())).enumerate() {
            let ((values, rest), (factors, rest_factors)) = (pixel.as_chunks::<16>(), weights.as_chunks::<16>());
            let mut lanes = [0.0_f32; 16];
            for (values, factors) in values.iter().zip(factors) {
                for lane in 0..16 {
                    lanes[lane] += values[lane] * factors[lane];
                }
            }
            for ((lane, &value), &factor) in lanes.iter_mut().zip(rest).zip(rest_factors) {
                *lane += value * factor;
            }
            let halves: [f32; 8] = std::array::from_fn(|lane| lanes[lane] + lanes[lane + 8]);
            let value = halves.iter().sum::<f32>() + bias + skip.get(index).copied().unwrap_or(0.0);
            *out = value.max(value * slope);
        }
    }
}

/// Sum of the values less `centre`, or of their squares, in sixteen lanes, which the compiler turns into vectors.
#[inline(always)]
fn lane_sum(values: &[f32], centre: f32, squared: bool) -> f32 {
    let mut lanes = [0.0_f32; 16];
    let mut chunks = values.chunks_exact(16);
    for chunk in &mut chunks {
        for (lane, &value) in lanes.iter_mut().zip(chunk) {
            let value = value - centre;
            *lane += if squared { value * value } else { value };
        }
    }
    for (lane, &value) in lanes.iter_mut().zip(chunks.remainder()) {
        let value = value - centre;
        *lane += if squared { value * value } else { value };
    }
    lanes.iter().sum()
}
