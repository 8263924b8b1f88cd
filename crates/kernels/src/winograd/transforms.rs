//! A map's tiles, and the matrices that bring them to the points and back.

use pulp::Simd;

use super::POINTS;
use crate::map::{Extent, Map};
use crate::parallel::with_scratch;
use crate::simd::{Patch, SLACK, Shared, Transform, Vectors, multiply_add};

/// Some of the tiles of a map.
#[derive(Clone, Copy)]
pub(super) struct Tiles {
    pub grid: [usize; 3],
    pub side: usize,
    pub range: [usize; 2],
}

impl Tiles {
    /// Picture, first output row and first output column of each.
    pub fn corners(&self) -> impl Iterator<Item = [usize; 3]> {
        let Self { grid: [_, rows, columns], side, range: [from, to] } = *self;
        (from..to).map(move |tile| [tile / (rows * columns), tile / columns % rows * side, tile % columns * side])
    }
}

/// A `side`×`side` patch of a map whose corner is at `row`, `column` (which may lie outside): values,
/// where the patch starts in them, and their pitch. Outside the map there are zeros.
fn patch<'a>(
    map: &Map<'a>,
    [image, row, column]: [isize; 3],
    side: usize,
    copy: &'a mut [f32],
) -> (&'a [f32], usize, usize) {
    let Extent { height, width, channels, halo, .. } = map.extent;
    let inside =
        |start: isize, size: usize| start >= -(halo as isize) && start + side as isize <= (size + halo) as isize;
    let pitch = map.extent.pitch();
    if inside(row, height) && inside(column, width) {
        let start = image as usize * map.extent.image()
            + (row + halo as isize) as usize * pitch
            + (column + halo as isize) as usize * channels;
        if start + (side - 1) * pitch + side * channels + SLACK <= map.values.len() {
            return (map.values, start, pitch);
        }
    }
    let within = |start: isize, size: usize| {
        let first = start.clamp(0, size as isize) as usize;
        first..(start + side as isize).clamp(0, size as isize) as usize
    };
    copy.fill(0.0);
    let columns = within(column, width);
    for y in within(row, height) {
        if columns.is_empty() {
            continue;
        }
        let from = map.extent.at(image as usize, y, columns.start);
        let to = ((y as isize - row) as usize * side + (columns.start as isize - column) as usize) * channels;
        let len = columns.len() * channels;
        copy[to..to + len].copy_from_slice(&map.values[from..from + len]);
    }
    (copy, 0, side * channels)
}

/// `Bᵀ d B` of each tile's 6×6 patch, `corner` pixels from the tile's first output, to
/// `out[layout[0] + point·layout[1] + tile·layout[2] + channel]`.
pub(super) fn transform_patches(
    vectors: Vectors,
    x: Map<'_>,
    tiles: &Tiles,
    corner: [isize; 2],
    out: &Shared<'_>,
    layout: [usize; 3],
) {
    transform_tiles::<POINTS, _>(vectors, InputRow, x, tiles, corner, out, layout);
}

/// `G dy Gᵀ` of each tile's 4×4 gradients, as [`transform_patches`].
pub(super) fn transform_gradient(vectors: Vectors, dy: Map<'_>, tiles: &Tiles, out: &Shared<'_>, layout: [usize; 3]) {
    transform_tiles::<4, _>(vectors, KernelRow, dy, tiles, [0, 0], out, layout);
}

/// Transforms each tile's `N`×`N` patch.
fn transform_tiles<const N: usize, T: Transform<N, POINTS>>(
    vectors: Vectors,
    transform: T,
    x: Map<'_>,
    tiles: &Tiles,
    corner: [isize; 2],
    out: &Shared<'_>,
    [first, point_step, tile_step]: [usize; 3],
) {
    let channels = x.extent.channels;
    with_scratch(N * N * channels + SLACK, |copy| {
        for (index, [image, row, column]) in tiles.corners().enumerate() {
            let at = [image as isize, row as isize + corner[0], column as isize + corner[1]];
            let (values, start, pitch) = patch(&x, at, N, copy);
            vectors.for_channels(channels).transform::<N, POINTS, _>(
                transform,
                &Patch {
                    x: values,
                    start,
                    steps: [pitch, channels],
                    channels,
                    out: *out,
                    output: first + index * tile_step,
                    output_steps: [POINTS * point_step, point_step],
                    finish: None,
                },
            );
        }
    });
}

/// `Bᵀ`.
#[derive(Clone, Copy)]
struct InputRow;

impl Transform<POINTS, POINTS> for InputRow {
    #[inline(always)]
    fn apply<S: Simd>(self, simd: S, d: [S::f32s; POINTS]) -> [S::f32s; POINTS] {
        let (even, odd) = (fma(simd, -4.0, d[2], d[4]), fma(simd, -4.0, d[1], d[3]));
        let (near, twice) = (simd.sub_f32s(d[4], d[2]), simd.sub_f32s(d[3], d[1]));
        let twice = simd.add_f32s(twice, twice);
        [
            fma(simd, 4.0, d[0], fma(simd, -5.0, d[2], d[4])),
            simd.add_f32s(even, odd),
            simd.sub_f32s(even, odd),
            simd.add_f32s(near, twice),
            simd.sub_f32s(near, twice),
            fma(simd, 4.0, d[1], fma(simd, -5.0, d[3], d[5])),
        ]
    }
}

/// `G`: values of a kernel's polynomial at the points, over the points' weights.
#[derive(Clone, Copy)]
pub(super) struct KernelRow;

impl Transform<3, POINTS> for KernelRow {
    #[inline(always)]
    fn apply<S: Simd>(self, simd: S, d: [S::f32s; 3]) -> [S::f32s; POINTS] {
        let even1 = simd.add_f32s(d[0], d[2]);
        let even2 = fma(simd, 4.0, d[2], d[0]);
        let odd2 = simd.add_f32s(d[1], d[1]);
        [
            scale(simd, 0.25, d[0]),
            scale(simd, -1.0 / 6.0, simd.add_f32s(even1, d[1])),
            scale(simd, -1.0 / 6.0, simd.sub_f32s(even1, d[1])),
            scale(simd, 1.0 / 24.0, simd.add_f32s(even2, odd2)),
            scale(simd, 1.0 / 24.0, simd.sub_f32s(even2, odd2)),
            d[2],
        ]
    }
}

impl Transform<4, POINTS> for KernelRow {
    #[inline(always)]
    fn apply<S: Simd>(self, simd: S, d: [S::f32s; 4]) -> [S::f32s; POINTS] {
        let (even1, odd1) = (simd.add_f32s(d[0], d[2]), simd.add_f32s(d[1], d[3]));
        let (even2, odd2) = (fma(simd, 4.0, d[2], d[0]), fma(simd, 4.0, d[3], d[1]));
        let odd2 = simd.add_f32s(odd2, odd2);
        [
            scale(simd, 0.25, d[0]),
            scale(simd, -1.0 / 6.0, simd.add_f32s(even1, odd1)),
            scale(simd, -1.0 / 6.0, simd.sub_f32s(even1, odd1)),
            scale(simd, 1.0 / 24.0, simd.add_f32s(even2, odd2)),
            scale(simd, 1.0 / 24.0, simd.sub_f32s(even2, odd2)),
            d[3],
        ]
    }
}

// Functions where closures would do: see `simd::memory::read`.

#[inline(always)]
fn fma<S: Simd>(simd: S, factor: f32, a: S::f32s, b: S::f32s) -> S::f32s {
    multiply_add(simd, simd.splat_f32s(factor), a, b)
}

#[inline(always)]
fn scale<S: Simd>(simd: S, factor: f32, a: S::f32s) -> S::f32s {
    simd.mul_f32s(simd.splat_f32s(factor), a)
}

/// `Aᵀ` for three and four outputs.
#[derive(Clone, Copy)]
pub(super) struct OutputRow;

impl Transform<POINTS, 3> for OutputRow {
    #[inline(always)]
    fn apply<S: Simd>(self, simd: S, m: [S::f32s; POINTS]) -> [S::f32s; 3] {
        let (sum1, difference1) = (simd.add_f32s(m[1], m[2]), simd.sub_f32s(m[1], m[2]));
        let (sum2, difference2) = (simd.add_f32s(m[3], m[4]), simd.sub_f32s(m[3], m[4]));
        [
            simd.add_f32s(simd.add_f32s(m[0], sum1), sum2),
            fma(simd, 2.0, difference2, difference1),
            simd.add_f32s(fma(simd, 4.0, sum2, sum1), m[5]),
        ]
    }
}

impl Transform<POINTS, 4> for OutputRow {
    #[inline(always)]
    fn apply<S: Simd>(self, simd: S, m: [S::f32s; POINTS]) -> [S::f32s; 4] {
        let (sum1, difference1) = (simd.add_f32s(m[1], m[2]), simd.sub_f32s(m[1], m[2]));
        let (sum2, difference2) = (simd.add_f32s(m[3], m[4]), simd.sub_f32s(m[3], m[4]));
        [
            simd.add_f32s(simd.add_f32s(m[0], sum1), sum2),
            fma(simd, 2.0, difference2, difference1),
            fma(simd, 4.0, sum2, sum1),
            simd.add_f32s(fma(simd, 8.0, difference2, difference1), m[5]),
        ]
    }
}
