//! Convolutions of stride 1 with fewer multiplications (Winograd 1980; Lavin & Gray 2016).
//!
//! A tile of `m`×`m` outputs of an `r`×`r` kernel needs only 6×6 products a channel pair, with
//! `m + r - 1 = 6` and the interpolation points 0, ±1, ±2, ∞: 4 instead of 9 a pixel for a 3×3 kernel
//! (`m` = 4). A 7×7 kernel is four 4×4 kernels side by side (`m` = 3): 16 instead of 49. The products
//! are plain matrix products, one for each of the 36 points. Rounding grows by about a factor of three
//! over direct sums.

mod transforms;

use self::transforms::{KernelRow, OutputRow, Tiles, transform_gradient, transform_patches};
use super::conv::{Correlation, Epilogue, Packed, Steps, split, strips};
use super::gradient::{WeightSums, gradient_len};
use super::map::{Extent, Map, MapMut};
use super::parallel::{for_each, threads, with_scratch};
use super::simd::{Finish, Patch, SLACK, Shared, Transform, Vectors};

/// Points of a transform in one direction: `m + r - 1`.
const POINTS: usize = 6;
/// Points in all.
const POINTS_2D: usize = POINTS * POINTS;
/// Fewest and most transformed values that a task works on at once, floats.
const TASK_VALUES: [usize; 2] = [1 << 16, 1 << 21];
/// Fewest tiles for which a task of its own pays.
const TASK_TILES: usize = 24;
/// Fewest channels for which the transforms pay.
const MIN_CHANNELS: usize = 16;
/// Fewest tiles for which reading four times as many weights pays.
const MIN_TILES: usize = 12;
/// Widest strip.
const LANES_MAX: usize = SLACK;

/// How a kernel is cut up.
#[derive(Debug, Clone, Copy)]
struct WinogradPlan {
    /// Outputs of a tile in one direction.
    outputs: usize,
    /// Taps of a block in one direction.
    taps: usize,
    /// Blocks of the kernel in one direction.
    blocks: usize,
}

impl WinogradPlan {
    fn of(kernel: usize) -> Option<Self> {
        match kernel {
            3 => Some(Self { outputs: 4, taps: 3, blocks: 1 }),
            7 => Some(Self { outputs: 3, taps: 4, blocks: 2 }),
            _ => None,
        }
    }
}

/// Tiles of an output map: pictures, rows, columns.
fn tiles(output: &Extent, side: usize) -> [usize; 3] {
    [output.batch, output.height.div_ceil(side), output.width.div_ceil(side)]
}

/// Channels in the whole vectors that transforms read and write.
fn padded(vectors: Vectors, channels: usize) -> usize {
    channels.next_multiple_of(vectors.for_channels(channels).lanes())
}

/// Whether fewer multiplications win over the transforms.
pub(super) fn pays(kernel: usize, stride: usize, channels: [usize; 2], output: &Extent) -> bool {
    let Some(plan) = WinogradPlan::of(kernel).filter(|_| stride == 1) else { return false };
    let [images, rows, columns] = tiles(output, plan.outputs);
    // Outputs computed beyond the map's edges are wasted.
    let used = (output.height * output.width) as f64 / (rows * columns * plan.outputs * plan.outputs) as f64;
    channels.into_iter().min() >= Some(MIN_CHANNELS) && images * rows * columns >= MIN_TILES && used > 0.5
}

/// Transformed weights.
#[derive(Debug, Clone)]
pub struct Winograd {
    plan: WinogradPlan,
    channels: [usize; 2],
    /// For each point: `[blocks², input channels]` × output channels.
    points: Vec<Packed>,
}

impl Winograd {
    /// Transforms a dense kernel.
    ///
    /// # Panics
    /// For a kernel that is not 3 or 7 wide.
    pub(super) fn new(vectors: Vectors, kernel: usize, channels: [usize; 2], dense: &Packed) -> Self {
        let plan = WinogradPlan::of(kernel).unwrap_or_else(|| panic!("no transform for a {kernel}×{kernel} kernel"));
        let points = match plan.taps {
            3 => transform_weights::<3>(vectors, kernel, channels, plan.blocks, dense),
            _ => transform_weights::<4>(vectors, kernel, channels, plan.blocks, dense),
        };
        Self { plan, channels, points }
    }

    /// The convolution of `x` with zeros around it.
    pub(super) fn run(&self, vectors: Vectors, padding: usize, x: Map<'_>, epilogue: Epilogue<'_>, out: MapMut<'_>) {
        let grid = tiles(&out.extent, self.plan.outputs);
        let count: usize = grid.iter().product();
        let [input, _] = self.channels;
        let blocks = self.plan.blocks * self.plan.blocks;
        let (input_step, output_step) = (padded(vectors, input), self.points[0].padded_channels());
        let values = POINTS_2D * (blocks * input_step + output_step);
        let weights = self.points.len() * blocks * input * output_step;
        let most = (weights.clamp(TASK_VALUES[0], TASK_VALUES[1]) / values).max(TASK_TILES);
        // A task or more for each thread, all the same; but not so small that they all read the weights for little.
        let threads = threads();
        let (extent, out) = (out.extent, Shared::new(out.values));
        let tasks = match count.div_ceil(most) {
            1 if count < threads * TASK_TILES => 1,
            tasks => tasks.next_multiple_of(threads),
        };
        for_each(tasks, |task| {
            let [from, to] = split(count, tasks, task);
            let part = to - from;
            let (transformed, products) = (POINTS_2D * blocks * part * input_step, POINTS_2D * part * output_step);
            with_scratch(transformed + products, |scratch| {
                let (transformed, products) = scratch.split_at_mut(transformed);
                // A lone task shares each of its phases among the threads.
                let parts = if tasks < threads { threads } else { 1 };
                {
                    let transformed = Shared::new(transformed);
                    for_each(parts, |index| {
                        let [first, last] = split(part, parts, index);
                        let tiles = Tiles { grid, side: self.plan.outputs, range: [from + first, from + last] };
                        for block in 0..blocks {
                            let shift =
                                [block / self.plan.blocks, block % self.plan.blocks].map(|b| b * self.plan.taps);
                            let corner = shift.map(|shift| shift as isize - padding as isize);
                            let at = (block * part + first) * input_step;
                            transform_patches(
                                vectors,
                                x,
                                &tiles,
                                corner,
                                &transformed,
                                [at, blocks * part * input_step, input_step],
                            );
                        }
                    });
                }
                {
                    let products = Shared::new(products);
                    for_each(parts, |index| {
                        let [first, last] = split(POINTS_2D, parts, index);
                        for point in first..last {
                            Correlation {
                                vectors,
                                packed: &self.points[point],
                                x: transformed,
                                grid: [1, 1, part],
                                input: Steps { start: point * blocks * part * input_step, steps: [0, 0, input_step] },
                                pitch: part * input_step,
                                start: None,
                                skip: None,
                                slope: 1.0,
                                out: products,
                                output: Steps { start: point * part * output_step, steps: [0, 0, output_step] },
                            }
                            .run_here();
                        }
                    });
                }
                for_each(parts, |index| {
                    let [first, last] = split(part, parts, index);
                    let tiles = Tiles { grid, side: self.plan.outputs, range: [from + first, from + last] };
                    let at = [first * output_step, part * output_step, output_step];
                    match self.plan.outputs {
                        4 => finish::<4>(vectors, &tiles, products, at, epilogue, extent, out),
                        _ => finish::<3>(vectors, &tiles, products, at, epilogue, extent, out),
                    }
                });
            });
        });
    }
}

/// `Aᵀ M A`, start, skip and slope of each tile, from `products[layout[0] + point·layout[1] +
/// tile·layout[2] + channel]`.
fn finish<const M: usize>(
    vectors: Vectors,
    tiles: &Tiles,
    products: &[f32],
    layout: [usize; 3],
    Epilogue { start, skip, slope }: Epilogue<'_>,
    extent: Extent,
    out: Shared<'_>,
) where
    OutputRow: Transform<POINTS, M>,
{
    for (index, [image, row, column]) in tiles.corners().enumerate() {
        let steps = |extent: &Extent| [extent.pitch(), extent.channels];
        let skip = skip.map(|skip| (skip.values, skip.extent.at(image, row, column), steps(&skip.extent)));
        let (rows, columns) = (M.min(extent.height - row), M.min(extent.width - column));
        vectors.for_channels(extent.channels).transform::<POINTS, M, _>(
            OutputRow,
            &Patch {
                x: products,
                start: layout[0] + index * layout[2],
                steps: [POINTS * layout[1], layout[1]],
                channels: extent.channels,
                out,
                output: extent.at(image, row, column),
                output_steps: steps(&extent),
                finish: Some(Finish { start, skip, slope, rows, columns }),
            },
        );
    }
}

/// Adds the gradient of a 3×3 kernel to transformed sums, `[points]` × the layout of [`strips`].
pub(super) fn add_weight_gradient(
    vectors: Vectors,
    channels: [usize; 2],
    padding: usize,
    x: Map<'_>,
    dy: Map<'_>,
    sums: &mut [f32],
) {
    const SIDE: usize = 4;
    let grid = tiles(&dy.extent, SIDE);
    let count: usize = grid.iter().product();
    let [input_step, output_step] = channels.map(|channels| padded(vectors, channels));
    let values = POINTS_2D * (input_step + output_step);
    let tasks = count.div_ceil((TASK_VALUES[0] / values).max(TASK_TILES));
    let each = gradient_len(vectors, 1, channels[0], channels[1]);
    for task in 0..tasks {
        let [from, to] = split(count, tasks, task);
        let part = to - from;
        let sizes = [POINTS_2D * part * input_step, POINTS_2D * part * output_step];
        with_scratch(sizes[0] + sizes[1] + SLACK, |scratch| {
            let (inputs, gradients) = scratch.split_at_mut(sizes[0]);
            let tiles = Tiles { grid, side: SIDE, range: [from, to] };
            let corner = [-(padding as isize); 2];
            transform_patches(vectors, x, &tiles, corner, &Shared::new(inputs), [0, part * input_step, input_step]);
            transform_gradient(vectors, dy, &tiles, &Shared::new(gradients), [0, part * output_step, output_step]);
            for (point, sums) in sums.chunks_exact_mut(each).enumerate() {
                WeightSums {
                    vectors,
                    x: inputs,
                    dy: gradients,
                    grid: [1, 1, part],
                    input: Steps { start: point * part * input_step, steps: [0, 0, input_step] },
                    gradient: Steps { start: point * part * output_step, steps: [0, 0, output_step] },
                    segments: 1,
                    length: channels[0],
                    pitch: 0,
                    channels: channels[1],
                }
                .add_to(sums);
            }
        });
    }
}

/// Length of the sums of [`add_weight_gradient`].
pub(super) fn gradient_sums_len(vectors: Vectors, channels: [usize; 2]) -> usize {
    POINTS_2D * gradient_len(vectors, 1, channels[0], channels[1])
}

/// Brings transformed sums back to `[output, input, 3, 3]`.
pub(super) fn unpack(vectors: Vectors, channels: [usize; 2], sums: &[f32]) -> Vec<f32> {
    let [input, output] = channels;
    let (strips, each) = strips(vectors, output, input);
    let mut weights = vec![0.0; output * input * 9];
    let mut at = 0;
    for strip in strips {
        let size = strip.size;
        for channel in 0..input {
            let mut points = [[[0.0_f32; LANES_MAX]; POINTS]; POINTS];
            for (point, lanes) in points.as_flattened_mut().iter_mut().enumerate() {
                let from = point * each + at + channel * size;
                lanes[..size].copy_from_slice(&sums[from..from + size]);
            }
            let mut taps = [[[0.0_f32; LANES_MAX]; 3]; 3];
            both_sides(vectors, OutputRow, size, &points, &mut taps);
            for lane in 0..strip.width {
                let to = ((strip.channel + lane) * input + channel) * 9;
                let taps = taps.as_flattened().iter().map(|lanes| lanes[lane]);
                weights[to..to + 9].iter_mut().zip(taps).for_each(|(weight, tap)| *weight = tap);
            }
        }
        at += input * size;
    }
    weights
}

/// `G g Gᵀ` of every block of every channel pair, packed for the 36 products.
fn transform_weights<const R: usize>(
    vectors: Vectors,
    kernel: usize,
    [input, output]: [usize; 2],
    blocks: usize,
    dense: &Packed,
) -> Vec<Packed>
where
    KernelRow: Transform<R, POINTS>,
{
    let empty = Packed::zeros(vectors, [blocks * blocks, input, output]);
    let mut points = vec![empty; POINTS_2D];
    for (index, strip) in dense.strips().iter().enumerate() {
        let size = strip.size;
        for block in 0..blocks * blocks {
            let (top, left) = (block / blocks * R, block % blocks * R);
            for channel in 0..input {
                let mut taps = [[[0.0_f32; LANES_MAX]; R]; R];
                for ky in (0..R).filter(|ky| top + ky < kernel) {
                    for kx in (0..R).filter(|kx| left + kx < kernel) {
                        let row = (top + ky) * kernel * input + (left + kx) * input + channel;
                        taps[ky][kx][..size].copy_from_slice(dense.row(index, row));
                    }
                }
                let mut transformed = [[[0.0_f32; LANES_MAX]; POINTS]; POINTS];
                both_sides(vectors, KernelRow, size, &taps, &mut transformed);
                let row = block * input + channel;
                for (point, values) in points.iter_mut().zip(transformed.as_flattened()) {
                    point.row_mut(index, row).copy_from_slice(&values[..size]);
                }
            }
        }
    }
    points
}

/// A transform in both directions of `size` lanes.
fn both_sides<const N: usize, const P: usize>(
    vectors: Vectors,
    transform: impl Transform<N, P>,
    size: usize,
    values: &[[[f32; LANES_MAX]; N]; N],
    transformed: &mut [[[f32; LANES_MAX]; P]; P],
) {
    vectors.for_channels(size).transform::<N, P, _>(
        transform,
        &Patch {
            x: values.as_flattened().as_flattened(),
            start: 0,
            steps: [N * LANES_MAX, LANES_MAX],
            channels: size,
            out: Shared::new(transformed.as_flattened_mut().as_flattened_mut()),
            output: 0,
            output_steps: [P * LANES_MAX, LANES_MAX],
            finish: None,
        },
    );
}
