//! Convolutions by direct sums: implicit products of matrices, no unfolded copy of the input.
//!
//! A tile of output positions × a strip of output channels is summed in registers over the kernel's
//! rows; in a channels-last map a kernel row of `k·channels` values lies in one run of memory, so each
//! position needs one address a kernel row.

use super::map::{Extent, Map, MapMut};
use super::parallel::{Buffer, for_each, threads, with_scratch};
use super::simd::{ConvTile, MAX_POSITIONS, SLACK, Shared, Vectors};

/// Weights that a strip's pass over the positions keeps in the second-level cache, floats.
const STRIP_BLOCK: usize = 48 * 1024;
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
    /// Vectors that hold them.
    pub vectors: usize,
    /// First value in the packed weights.
    pub start: usize,
}

/// The strips of `channels` output channels with `taps` weights each, and their values in all.
pub(super) fn strips(vectors: Vectors, channels: usize, taps: usize) -> (Vec<Strip>, usize) {
    let lanes = vectors.lanes();
    let (mut strips, mut start, mut channel) = (Vec::new(), 0, 0);
    while channel < channels {
        let vectors = if channels - channel > lanes { 2 } else { 1 };
        let width = (channels - channel).min(vectors * lanes);
        strips.push(Strip { channel, width, vectors, start });
        start += taps * vectors * lanes;
        channel += width;
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
    pub(super) fn columns(&self, vectors: Vectors) -> Vec<[usize; 2]> {
        let of = |strip: &Strip| {
            let (start, size) = (strip.start, strip.vectors * vectors.lanes());
            (0..strip.width).map(move |lane| [start + lane, size])
        };
        self.strips.iter().flat_map(of).collect()
    }

    /// A dense convolution's weights `[output, input, kernel, kernel]`.
    pub(super) fn dense(vectors: Vectors, shape: &ConvShape, weights: &[f32]) -> Self {
        let ConvShape { channels: [input, output], kernel, .. } = *shape;
        let taps = kernel * kernel;
        let mut packed = Self::zeros(vectors, [kernel, kernel * input, output]);
        let columns = packed.columns(vectors);
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
    pub(super) fn row(&self, vectors: Vectors, strip: usize, tap: usize) -> &[f32] {
        let Strip { start, vectors: count, .. } = self.strips[strip];
        let size = count * vectors.lanes();
        &self.values.values()[start + tap * size..start + (tap + 1) * size]
    }

    /// As [`Self::row`].
    pub(super) fn row_mut(&mut self, vectors: Vectors, strip: usize, tap: usize) -> &mut [f32] {
        let Strip { start, vectors: count, .. } = self.strips[strip];
        let size = count * vectors.lanes();
        &mut self.values.values_mut()[start + tap * size..start + (tap + 1) * size]
    }

    /// Output channels, each strip filled up to whole vectors.
    pub(super) fn padded_channels(&self, vectors: Vectors) -> usize {
        self.strips.iter().map(|strip| strip.vectors * vectors.lanes()).sum()
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
        let positions = images * rows * columns;
        if positions == 0 {
            return;
        }
        let strips = &self.packed.strips;
        let widest = if strips.iter().any(|strip| strip.vectors == 2) { 2 } else { 1 };
        let tiles = positions.div_ceil(self.vectors.positions(widest));
        let work = positions * self.packed.values.values().len();
        let threads = if work < SERIAL_WORK { 1 } else { threads() };
        if threads == 1 {
            return self.run_here();
        }
        let chunks = tiles.min(4 * threads);
        if chunks >= threads {
            for_each(chunks, |chunk| {
                let range = split(positions, chunks, chunk);
                strips.iter().for_each(|strip| self.strip(strip, range));
            });
        } else {
            for_each(chunks * strips.len(), |task| {
                self.strip(&strips[task / chunks], split(positions, chunks, task % chunks));
            });
        }
    }

    /// Computes every position, by this thread.
    pub(super) fn run_here(&self) {
        let positions = self.grid.iter().product();
        self.packed.strips.iter().for_each(|strip| self.strip(strip, [0, positions]));
    }

    /// Computes the positions `from..to` of a strip.
    fn strip(&self, strip: &Strip, [from, to]: [usize; 2]) {
        let Packed { segments, length, ref values, .. } = *self.packed;
        let size = strip.vectors * self.vectors.lanes();
        let weights = &values.values()[strip.start..strip.start + segments * length * size];
        let (strips, columns) = (self.packed.strips.len(), self.grid[2]);
        let skip_step = self.skip.map_or(0, |(_, steps)| steps.steps[2]);
        let zeros = [0.0; SLACK];
        let start = self.start.map_or(&zeros[..size], |start| &start[strip.channel..strip.channel + size]);
        let block = (STRIP_BLOCK / (length * size)).clamp(1, segments);
        let most = self.vectors.positions(strip.vectors);
        let tiles = (to - from).div_ceil(most);
        for first in (0..segments).step_by(block) {
            let count = block.min(segments - first);
            let last = first + count == segments;
            let mut at = Position::new(self.grid, from);
            for tile in 0..tiles {
                let [begin, end] = split(to - from, tiles, tile);
                let mut addresses = [[0; MAX_POSITIONS]; 3];
                let mut index = 0;
                while index < end - begin {
                    let run = (end - begin - index).min(columns - at.place[2]);
                    let [mut input, mut output] = [self.input.at(at.place), self.output.at(at.place)];
                    let mut skip = self.skip.map_or(0, |(_, steps)| steps.at(at.place));
                    let [inputs, outputs, skips] = &mut addresses;
                    let places = inputs.iter_mut().zip(outputs).zip(skips);
                    for ((to_input, to_output), to_skip) in places.skip(index).take(run) {
                        *to_input = input + first * self.pitch;
                        *to_output = output + strip.channel;
                        *to_skip = skip + strip.channel;
                        input += self.input.steps[2];
                        output += self.output.steps[2];
                        skip += skip_step;
                    }
                    index += run;
                    at.advance(run);
                }
                let [input, output, skip] = &addresses;
                self.vectors.convolve(&ConvTile {
                    x: self.x,
                    input: &input[..end - begin],
                    segments: count,
                    length,
                    pitch: self.pitch,
                    weights: &weights[first * length * size..(first + count) * length * size],
                    vectors: strip.vectors,
                    width: strip.width,
                    start: (first == 0).then_some(start),
                    skip: self.skip.filter(|_| last).map(|(values, _)| (values, &skip[..end - begin])),
                    slope: if last { self.slope } else { 1.0 },
                    out: self.out,
                    output: &output[..end - begin],
                    alone: strips == 1,
                });
            }
        }
    }
}

/// A place in a grid of pictures, rows and columns, walked in order.
pub(super) struct Position {
    grid: [usize; 3],
    pub(super) place: [usize; 3],
}

impl Position {
    pub(super) fn new(grid: [usize; 3], index: usize) -> Self {
        let [_, rows, columns] = grid;
        Self { grid, place: [index / (rows * columns), index / columns % rows, index % columns] }
    }

    /// Goes on by `count` columns, at most to the row's end.
    fn advance(&mut self, count: usize) {
        let [image, row, column] = &mut self.place;
        *column += count;
        if *column == self.grid[2] {
            *column = 0;
            *row += 1;
            if *row == self.grid[1] {
                *row = 0;
                *image += 1;
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

/// A dense convolution, all of it.
pub(super) fn forward(
    vectors: Vectors,
    shape: &ConvShape,
    packed: &Packed,
    x: Map<'_>,
    epilogue: Epilogue<'_>,
    out: MapMut<'_>,
) {
    let edge = -(shape.padding as isize);
    Correlation {
        vectors,
        packed,
        x: x.values,
        grid: [out.extent.batch, out.extent.height, out.extent.width],
        input: Steps::over(&x.extent, [edge, edge], shape.stride),
        pitch: x.extent.pitch(),
        start: epilogue.start,
        skip: epilogue.skip.map(|skip| (skip.values, Steps::over(&skip.extent, [0, 0], 1))),
        slope: epilogue.slope,
        out: out.values,
        output: Steps::over(&out.extent, [0, 0], 1),
    }
    .run();
}

/// Lends a copy of `map` with `halo` and slack to `work`.
pub(super) fn with_padded<R>(map: Map<'_>, halo: usize, work: impl FnOnce(Map<'_>) -> R) -> R {
    let extent = map.extent.with_halo(halo);
    with_scratch(extent.len() + SLACK, |values| {
        map.pad_into(halo, values);
        work(Map::new(extent, values))
    })
}
