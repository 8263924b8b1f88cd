//! Gradients of direct convolutions: of the input, of the weights.

use super::conv::{ConvShape, Correlation, Packed, SERIAL_WORK, Steps, Strip, split, strips};
use super::map::{Extent, Map, MapMut};
use super::parallel::{for_each_of, threads};
use super::simd::{SLACK, Shared, Vectors, WeightTile};

/// Values of input and gradient that stay in the second-level cache while the weights' gradient is
/// summed, floats.
const GRADIENT_BLOCK: usize = 64 * 1024;

/// Gradient of a dense convolution's input, prepared from its weights: a convolution of the output's
/// gradient with the mirrored kernel for each phase of the stride.
pub(super) struct InputGradient {
    shape: ConvShape,
    /// For each row phase and column phase: taps in each direction and weights.
    phases: Vec<(usize, usize, Packed)>,
}

impl InputGradient {
    pub(super) fn new(vectors: Vectors, shape: ConvShape, weights: &[f32]) -> Self {
        let ConvShape { channels: [input, output], kernel, stride, .. } = shape;
        let taps = |phase: usize| kernel.saturating_sub(phase).div_ceil(stride);
        let phases = (0..stride * stride).map(|phase| {
            let (row, column) = (phase / stride, phase % stride);
            let (rows, columns) = (taps(row), taps(column));
            let mut packed = Packed::zeros(vectors, [rows, columns * output, input]);
            let places = packed.columns();
            let values = packed.values.values_mut();
            for (from, weights) in weights.chunks_exact(input * kernel * kernel).enumerate() {
                for ([start, step], weights) in places.iter().zip(weights.chunks_exact(kernel * kernel)) {
                    for segment in 0..rows {
                        let ky = row + (rows - 1 - segment) * stride;
                        for tap in 0..columns {
                            let kx = column + (columns - 1 - tap) * stride;
                            let to = (segment * columns + tap) * output + from;
                            values[start + to * step] = weights[ky * kernel + kx];
                        }
                    }
                }
            }
            (rows, columns, packed)
        });
        Self { shape, phases: phases.collect() }
    }

    /// For stride 1, the mirrored kernel as a dense convolution's.
    pub(super) fn mirrored(&self) -> Option<&Packed> {
        match self.phases.as_slice() {
            [(_, _, packed)] => Some(packed),
            _ => None,
        }
    }

    /// Halo that [`Self::run`] needs around the output's gradient.
    pub(super) fn halo(&self, input: Extent) -> usize {
        let ConvShape { kernel, stride, padding, .. } = self.shape;
        let before = (kernel - 1) / stride;
        let after = |side: usize| {
            let last = (side - 1 + padding) / stride;
            last.saturating_sub((side + 2 * padding - kernel) / stride)
        };
        before.max(after(input.height)).max(after(input.width))
    }

    /// Computes `dx` from `dy` with a halo.
    pub(super) fn run(&self, vectors: Vectors, dy: Map<'_>, dx: MapMut<'_>) {
        let ConvShape { stride, padding, .. } = self.shape;
        for (index, (rows, columns, packed)) in self.phases.iter().enumerate() {
            let phase = [index / stride, index % stride];
            // First pixel of the phase, and the output position that its first tap meets.
            let first = phase.map(|phase| (phase + stride - padding % stride) % stride);
            let sides = [dx.extent.height, dx.extent.width];
            let count = [0, 1].map(|axis| sides[axis].saturating_sub(first[axis]).div_ceil(stride));
            let output = Steps::over(&dx.extent, first.map(|pixel| pixel as isize), stride);
            if *rows == 0 || *columns == 0 {
                for place in 0..dx.extent.batch * count[0] * count[1] {
                    let (line, column) = (place / count[1], place % count[1]);
                    let at = output.at([line / count[0], line % count[0], column]);
                    dx.values[at..at + dx.extent.channels].fill(0.0);
                }
                continue;
            }
            let meets = |axis: usize, taps: usize| {
                ((first[axis] + padding - phase[axis]) / stride) as isize - (taps as isize - 1)
            };
            Correlation {
                vectors,
                packed,
                x: dy.values,
                grid: [dx.extent.batch, count[0], count[1]],
                input: Steps::over(&dy.extent, [meets(0, *rows), meets(1, *columns)], 1),
                pitch: dy.extent.pitch(),
                start: None,
                skip: None,
                slope: 1.0,
                out: Shared::new(dx.values),
                output,
            }
            .run();
        }
    }
}

/// The layout in which the weights' gradient is summed: `[segments, length, strip]` for each strip.
pub(super) fn gradient_len(vectors: Vectors, segments: usize, length: usize, channels: usize) -> usize {
    strips(vectors, channels, segments * length).1
}

/// Sums of `x` × `dy` over all positions, for `segments` runs of `length` neighbouring values of `x`.
pub(super) struct WeightSums<'a> {
    pub vectors: Vectors,
    pub x: &'a [f32],
    pub dy: &'a [f32],
    pub grid: [usize; 3],
    pub input: Steps,
    pub gradient: Steps,
    pub segments: usize,
    pub length: usize,
    pub pitch: usize,
    pub channels: usize,
}

/// The sums of some neighbouring values of `x`, from the `tap`th of a segment on, and a strip of output channels.
struct SumsPart<'a> {
    segment: usize,
    tap: usize,
    strip: Strip,
    sums: &'a mut [f32],
}

impl WeightSums<'_> {
    /// Adds to `sums`, laid out as [`Packed`].
    pub(super) fn add_to(&self, sums: &mut [f32]) {
        let [images, rows, columns] = self.grid;
        let (strips, len) = strips(self.vectors, self.channels, self.segments * self.length);
        let mut parts = self.parts(&strips, &mut sums[..len]);
        // Rows whose input and gradient stay near while every tile passes over them.
        let row_values = self.input.steps[1] + self.gradient.steps[1];
        let block = (GRADIENT_BLOCK / row_values.max(1)).clamp(1, rows.max(1));
        let work = images * rows * columns * len;
        let pass = |part: &mut SumsPart<'_>, image: usize, first: usize| {
            let SumsPart { segment, tap, strip, .. } = *part;
            self.vectors.weight_gradient(&mut WeightTile {
                x: self.x,
                dy: self.dy,
                start: [
                    self.input.at([image, first, 0]) + segment * self.pitch + tap,
                    self.gradient.at([image, first, 0]) + strip.channel,
                ],
                rows: block.min(rows - first),
                columns,
                row_step: [self.input.steps[1], self.gradient.steps[1]],
                column_step: [self.input.steps[2], self.gradient.steps[2]],
                taps: part.sums.len() / strip.size,
                size: strip.size,
                sums: part.sums,
            });
        };
        let groups = if work < SERIAL_WORK { 1 } else { threads() };
        let each = parts.len().div_ceil(groups).max(1);
        for_each_of(parts.chunks_mut(each).collect(), |_, parts| {
            for image in 0..images {
                for first in (0..rows).step_by(block) {
                    parts.iter_mut().for_each(|part| pass(part, image, first));
                }
            }
        });
    }

    /// The sums in tiles, those of the same input beside each other.
    fn parts<'b>(&self, strips: &[Strip], mut sums: &'b mut [f32]) -> Vec<SumsPart<'b>> {
        let tiles = self.length.div_ceil(self.vectors.positions(SLACK));
        let mut parts = Vec::with_capacity(self.segments * tiles * strips.len());
        for &strip in strips {
            for (segment, tile) in (0..self.segments).flat_map(|segment| (0..tiles).map(move |tile| (segment, tile))) {
                let [tap, end] = split(self.length, tiles, tile);
                let (part, rest) = sums.split_at_mut((end - tap) * strip.size);
                sums = rest;
                parts.push(SumsPart { segment, tap, strip, sums: part });
            }
        }
        parts.sort_by_key(|part| (part.segment, part.tap));
        parts
    }
}

/// Adds the gradient of a dense convolution's weights to `sums`, laid out as [`Packed`]. `dy` has
/// [`SLACK`] values after it.
pub(super) fn add_weight_gradient(vectors: Vectors, shape: &ConvShape, x: Map<'_>, dy: Map<'_>, sums: &mut [f32]) {
    let edge = -(shape.padding as isize);
    WeightSums {
        vectors,
        x: x.values,
        dy: dy.values,
        grid: [dy.extent.batch, dy.extent.height, dy.extent.width],
        input: Steps::over(&x.extent, [edge, edge], shape.stride),
        gradient: Steps::over(&dy.extent, [0, 0], 1),
        segments: shape.kernel,
        length: shape.kernel * shape.channels[0],
        pitch: x.extent.pitch(),
        channels: shape.channels[1],
    }
    .add_to(sums);
}

/// Brings summed gradients from the layout of [`Packed`] to `[output, input, kernel, kernel]`.
pub(super) fn unpack(vectors: Vectors, shape: &ConvShape, sums: &[f32]) -> Vec<f32> {
    let ConvShape { channels: [input, output], kernel, .. } = *shape;
    let (strips, _) = strips(vectors, output, kernel * kernel * input);
    let mut weights = vec![0.0; output * input * kernel * kernel];
    for strip in strips {
        let size = strip.size;
        for lane in 0..strip.width {
            let to = &mut weights[(strip.channel + lane) * input * kernel * kernel..];
            for (channel, to) in to.chunks_exact_mut(kernel * kernel).take(input).enumerate() {
                for (tap, to) in to.iter_mut().enumerate() {
                    *to = sums[strip.start + (tap * input + channel) * size + lane];
                }
            }
        }
    }
    weights
}
