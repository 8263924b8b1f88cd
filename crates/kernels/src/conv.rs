//! Convolutions by direct sums: implicit products of matrices, no unfolded copy of the input.
//!
//! A tile of neighbouring output positions × a strip of output channels is summed in registers over the kernel's
//! rows; in a channels-last map a kernel row of `k·channels` values lies in one run of memory, so each
//! position needs one address a kernel row.

use super::map::{Extent, Map, MapMut};
use super::parallel::{Buffer, for_each, threads, with_scratch};
use super::simd::{ConvRow, SLACK, Shared, Vectors};

/// Weights that a strip's pass over the positions keeps in the second-level cache, floats.
const STRIP_BLOCK: usize = 48 * 1024;
/// Values of a padded copy that stay in the first-level cache, floats.
const PADDED_BLOCK: usize = 12 * 1024;
/// Multiplications below which starting threads costs more than it gains.
pub(super) const SERIAL_WORK: usize = 100_000;

/// A square convolution: what is fixed before its weights are known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ConvShape {
    /// Input and output channels; equal for a depthwise one.
    pub channels: [usize; 2],
    /// Side of the kernel.
    pub kernel: usize,
    /// Step between output positions, input pixels.
    pub stride: usize,
    /// Zeros around the input, less than `kernel`.
    pub padding: usize,
    /// Each channel by itself.
    pub depthwise: bool,
}

impl ConvShape {
    /// The output's layout without halo.
    ///
    /// # Panics
    /// Where the input has other channels or is smaller than the kernel.
    pub fn output(&self, input: Extent) -> Extent {
        assert_eq!(input.channels, self.channels[0], "a convolution of {self:?} cannot take {input:?}");
        let side = |side: usize| {
            assert!(side + 2 * self.padding >= self.kernel, "{input:?} is smaller than the kernel of {self:?}");
            (side + 2 * self.padding - self.kernel) / self.stride + 1
        };
        Extent { height: side(input.height), width: side(input.width), channels: self.channels[1], halo: 0, ..input }
    }

    /// Shape of the weights, `[output channels, input channels of a group, kernel, kernel]`.
    pub fn weights(&self) -> [usize; 4] {
        let [input, output] = self.channels;
        [output, if self.depthwise { 1 } else { input }, self.kernel, self.kernel]
    }
}

/// Weights in the order that tiles read them: strips of output channels, `[segments, length, strip]` each.
#[derive(Debug, Clone)]
pub struct Packed {
    strips: Vec<Strip>,
    pub(super) values: Buffer,
    segments: usize,
    length: usize,
}

/// Neighbouring output channels that are computed together.
#[derive(Debug, Clone, Copy)]
pub(super) struct Strip {
    /// First channel.
    pub channel: usize,
    /// Channels.
    pub width: usize,
    /// Floats that hold them.
    pub size: usize,
    /// First value in the packed weights.
    pub start: usize,
}

/// The strips of `channels` output channels with `taps` weights each, and their values in all.
pub(super) fn strips(vectors: Vectors, channels: usize, taps: usize) -> (Vec<Strip>, usize) {
    let sizes = vectors.strips();
    let (mut strips, mut start, mut channel) = (Vec::new(), 0, 0);
    while channel < channels {
        let rest = channels - channel;
        let size = sizes.iter().find(|&&size| size >= rest).or(sizes.last()).map_or(rest, |&size| size);
        strips.push(Strip { channel, width: rest.min(size), size, start });
        start += taps * size;
        channel += size;
    }
    (strips, start)
}

impl Packed {
    /// No weights yet, for `channels` output channels.
    pub(super) fn zeros(vectors: Vectors, [segments, length, channels]: [usize; 3]) -> Self {
        let (strips, len) = strips(vectors, channels, segments * length);
        Self { strips, values: Buffer::zeros(len), segments, length }
    }

    /// Where each output channel's first weight is, and from tap to tap.
    pub(super) fn columns(&self) -> Vec<[usize; 2]> {
        let of = |strip: &Strip| {
            let Strip { start, size, .. } = *strip;
            (0..strip.width).map(move |lane| [start + lane, size])
        };
        self.strips.iter().flat_map(of).collect()
    }

    /// A dense convolution's weights `[output, input, kernel, kernel]`.
    pub(super) fn dense(vectors: Vectors, shape: &ConvShape, weights: &[f32]) -> Self {
        let ConvShape { channels: [input, output], kernel, .. } = *shape;
        let taps = kernel * kernel;
        let mut packed = Self::zeros(vectors, [kernel, kernel * input, output]);
        let columns = packed.columns();
        let values = packed.values.values_mut();
        // In the weights' own order: it is the slower side to walk across.
        for ([start, step], weights) in columns.into_iter().zip(weights.chunks_exact(input * taps)) {
            for (channel, weights) in weights.chunks_exact(taps).enumerate() {
                for (tap, &weight) in weights.iter().enumerate() {
                    values[start + (tap * input + channel) * step] = weight;
                }
            }
        }
        packed
    }

    /// The strips.
    pub(super) fn strips(&self) -> &[Strip] {
        &self.strips
    }

    /// The weights of a strip's channels at a tap, in whole vectors.
    pub(super) fn row(&self, strip: usize, tap: usize) -> &[f32] {
        let Strip { start, size, .. } = self.strips[strip];
        &self.values.values()[start + tap * size..start + (tap + 1) * size]
    }

    /// As [`Self::row`].
    pub(super) fn row_mut(&mut self, strip: usize, tap: usize) -> &mut [f32] {
        let Strip { start, size, .. } = self.strips[strip];
        &mut self.values.values_mut()[start + tap * size..start + (tap + 1) * size]
    }

    /// Output channels, each strip filled up to whole vectors.
    pub(super) fn padded_channels(&self) -> usize {
        self.strips.iter().map(|strip| strip.size).sum()
    }
}

/// Addresses that depend evenly on picture, row and column.
#[derive(Debug, Clone, Copy)]
pub(super) struct Steps {
    /// Address of the first position.
    pub start: usize,
    /// From picture to picture, row to row, column to column.
    pub steps: [usize; 3],
}

impl Steps {
    /// Every `step`th pixel of a map, beginning at a pixel.
    pub(super) fn over(extent: &Extent, [row, column]: [isize; 2], step: usize) -> Self {
        let start = (row + extent.halo as isize) * extent.pitch() as isize
            + (column + extent.halo as isize) * extent.channels as isize;
        let start = usize::try_from(start).unwrap_or_else(|_| panic!("{extent:?} has too small a halo"));
        Self { start, steps: [extent.image(), step * extent.pitch(), step * extent.channels] }
    }

    pub(super) fn at(&self, [image, row, column]: [usize; 3]) -> usize {
        self.start + image * self.steps[0] + row * self.steps[1] + column * self.steps[2]
    }
}

/// Sums over kernel rows for a grid of output positions.
#[derive(Clone, Copy)]
pub(super) struct Correlation<'a> {
    pub vectors: Vectors,
    pub packed: &'a Packed,
    pub x: &'a [f32],
    /// Pictures, rows, columns of positions.
    pub grid: [usize; 3],
    /// Where each position's first segment starts.
    pub input: Steps,
    /// From segment to segment.
    pub pitch: usize,
    /// A value to start from for each channel, in whole vectors; 0 without.
    pub start: Option<&'a [f32]>,
    pub skip: Option<(&'a [f32], Steps)>,
    pub slope: f32,
    pub out: Shared<'a>,
    pub output: Steps,
}

impl Correlation<'_> {
    /// Computes every position, by all threads.
    pub(super) fn run(&self) {
        let [images, rows, columns] = self.grid;
        let lines = images * rows;
        let threads = if lines * columns * self.packed.values.values().len() < SERIAL_WORK { 1 } else { threads() };
        let strips = &self.packed.strips;
        if threads == 1 {
            self.run_here();
        } else if lines >= 4 * threads {
            for_each(4 * threads, |chunk| {
                let range = split(lines, 4 * threads, chunk);
                strips.iter().for_each(|strip| self.strip(strip, range));
            });
        } else {
            // Few rows: the threads share the channels.
            let chunks = threads.div_ceil(strips.len()).min(lines);
            for_each(chunks * strips.len(), |task| {
                self.strip(&strips[task / chunks], split(lines, chunks, task % chunks));
            });
        }
    }

    /// Computes every position, by this thread.
    pub(super) fn run_here(&self) {
        let lines = self.grid[0] * self.grid[1];
        self.packed.strips.iter().for_each(|strip| self.strip(strip, [0, lines]));
    }

    /// Computes the rows `from..to` (of all pictures) of a strip.
    fn strip(&self, strip: &Strip, [from, to]: [usize; 2]) {
        let Packed { segments, length, ref values, .. } = *self.packed;
        let Strip { channel, width, size, start } = *strip;
        let [_, rows, columns] = self.grid;
        let weights = &values.values()[start..start + segments * length * size];
        let zeros = [0.0; SLACK];
        let start = self.start.map_or(&zeros[..size], |start| &start[channel..channel + size]);
        let block = (STRIP_BLOCK / (length * size)).clamp(1, segments);
        for first in (0..segments).step_by(block) {
            let count = block.min(segments - first);
            let last = first + count == segments;
            for line in from..to {
                let at = [line / rows, line % rows, 0];
                let channels = |steps: &Steps| [steps.at(at) + channel, steps.steps[2]];
                self.vectors.convolve(&ConvRow {
                    positions: columns,
                    x: self.x,
                    input: [self.input.at(at) + first * self.pitch, self.input.steps[2]],
                    segments: count,
                    length,
                    pitch: self.pitch,
                    weights: &weights[first * length * size..(first + count) * length * size],
                    size,
                    width,
                    start: (first == 0).then_some(start),
                    skip: self.skip.as_ref().filter(|_| last).map(|(values, steps)| (*values, channels(steps))),
                    slope: if last { self.slope } else { 1.0 },
                    out: self.out,
                    output: channels(&self.output),
                });
            }
        }
    }
}

/// The `part`th of `parts` nearly equal parts of `0..count`.
pub(super) fn split(count: usize, parts: usize, part: usize) -> [usize; 2] {
    [count * part / parts, count * (part + 1) / parts]
}

/// What follows a convolution's sums.
#[derive(Clone, Copy)]
pub(super) struct Epilogue<'a> {
    /// Biases in whole vectors.
    pub start: Option<&'a [f32]>,
    /// Added before the slope.
    pub skip: Option<Map<'a>>,
    /// Negative results are multiplied by it.
    pub slope: f32,
}

impl Epilogue<'_> {
    /// Nothing.
    pub(super) const NONE: Self = Self { start: None, skip: None, slope: 1.0 };
}

/// A dense convolution, all of it. An input without the halo it needs is copied and padded, some rows at a time.
pub(super) fn forward(
    vectors: Vectors,
    shape: &ConvShape,
    packed: &Packed,
    x: Map<'_>,
    epilogue: Epilogue<'_>,
    out: MapMut<'_>,
) {
    let ConvShape { kernel, stride, padding, .. } = *shape;
    let Extent { batch, height, width, .. } = out.extent;
    let skip = epilogue.skip.map(|skip| (skip.values, Steps::over(&skip.extent, [0, 0], 1)));
    let correlation = Correlation {
        vectors,
        packed,
        x: x.values,
        grid: [batch, height, width],
        input: Steps { start: 0, steps: [0; 3] },
        pitch: x.extent.pitch(),
        start: epilogue.start,
        skip,
        slope: epilogue.slope,
        out: Shared::new(out.values),
        output: Steps::over(&out.extent, [0, 0], 1),
    };
    if x.extent.halo >= padding {
        let edge = -(padding as isize);
        return Correlation { input: Steps::over(&x.extent, [edge, edge], stride), ..correlation }.run();
    }
    let pitch = (x.extent.width + 2 * padding) * x.extent.channels;
    let rows = (PADDED_BLOCK / pitch).saturating_sub(kernel) / stride + 1;
    let rows = rows.min(height.div_ceil(threads().div_ceil(batch)));
    let blocks = height.div_ceil(rows);
    for_each(batch * blocks, |task| {
        let image = task / blocks;
        let [first, end] = split(height, blocks, task % blocks);
        let lines = (end - first - 1) * stride + kernel;
        with_scratch(lines * pitch, |scratch| {
            for (line, values) in scratch.chunks_exact_mut(pitch).enumerate() {
                let row = (first * stride + line).checked_sub(padding).filter(|&row| row < x.extent.height);
                let Some(row) = row else {
                    values.fill(0.0);
                    continue;
                };
                let (left, values) = values.split_at_mut(padding * x.extent.channels);
                let (inner, right) = values.split_at_mut(x.extent.width * x.extent.channels);
                left.fill(0.0);
                inner.copy_from_slice(x.row(image, row));
                right.fill(0.0);
            }
            let from = |steps: Steps| Steps { start: steps.at([image, first, 0]), ..steps };
            Correlation {
                x: scratch,
                grid: [1, end - first, width],
                input: Steps { start: 0, steps: [0, stride * pitch, stride * x.extent.channels] },
                pitch,
                skip: skip.map(|(values, steps)| (values, from(steps))),
                output: from(correlation.output),
                ..correlation
            }
            .run_here();
        });
    });
}

/// Lends a copy of `map` with `halo` and slack to `work`.
pub(super) fn with_padded<R>(map: Map<'_>, halo: usize, work: impl FnOnce(Map<'_>) -> R) -> R {
    let extent = map.extent.with_halo(halo);
    with_scratch(extent.len() + SLACK, |values| {
        map.pad_into(halo, values);
        work(Map::new(extent, values))
    })
}
