//! Sums of products kept in registers: positions × channels of a convolution, taps × channels of its weights' gradient.

use pulp::{Scalar, Simd, WithSimd};

#[cfg(target_arch = "x86_64")]
use super::V3;
use super::memory::{Shared, end, read, write};
use super::{Arch, MAX_POSITIONS, SLACK, Vectors, multiply_add, strip_kernel};

impl Vectors {
    /// Computes a row of tiles.
    ///
    /// # Panics
    /// Where it would read or write outside its slices.
    pub fn convolve(self, row: &ConvRow<'_>) {
        if row.positions == 0 {
            return;
        }
        row.check();
        let vectors = self.for_strip(row.size);
        // Tiles of nearly the same size: first those of one position more.
        let tiles = row.positions.div_ceil(vectors.positions(row.size));
        let (small, large) = (row.positions / tiles, row.positions % tiles);
        for (positions, first, tiles) in [(small + 1, 0, large), (small, large * (small + 1), tiles - large)] {
            if tiles > 0 {
                strip_kernel!(vectors, row.size, positions, half => Conv { row, half, first, tiles });
            }
        }
    }

    /// Adds a tile of the weights' gradient to its sums.
    ///
    /// # Panics
    /// As [`Self::convolve`].
    pub fn weight_gradient(self, tile: &mut WeightTile<'_>) {
        tile.check();
        strip_kernel!(self.for_strip(tile.size), tile.size, tile.taps, half => Weight { tile, half });
    }
}

/// Evenly spaced output positions × one strip of output channels:
/// `out[p] = slope(start + Σ input[p] · weights + skip[p])`.
pub struct ConvRow<'a> {
    /// Output positions.
    pub positions: usize,
    /// Values of the input, zeros around it.
    pub x: &'a [f32],
    /// Where the first position's first segment starts in `x`, and from position to position.
    pub input: [usize; 2],
    /// Segments (kernel rows): how many, how long, how far apart in `x`.
    pub segments: usize,
    /// See `segments`.
    pub length: usize,
    /// See `segments`.
    pub pitch: usize,
    /// `[segments, length, size]`.
    pub weights: &'a [f32],
    /// Floats in the strip, one of [`Vectors::strips`].
    pub size: usize,
    /// Channels in the strip that exist; the others are not written.
    pub width: usize,
    /// What the sums start from, `[size]`; from `out` itself if there is none.
    pub start: Option<&'a [f32]>,
    /// Added before the slope: values, where the first position's channels are in them, from position to position.
    pub skip: Option<(&'a [f32], [usize; 2])>,
    /// Negative results are multiplied by it, 0 to 1 (1: nothing happens).
    pub slope: f32,
    /// Where results go.
    pub out: Shared<'a>,
    /// Where the first position's channels are in `out`, and from position to position.
    pub output: [usize; 2],
}

impl ConvRow<'_> {
    /// Refuses a row that the kernel must not run on.
    fn check(&self) {
        let [input, input_step] = self.input;
        let [output, output_step] = self.output;
        let Self { positions, segments, length, size, width, .. } = *self;
        assert!(size <= SLACK && width <= size, "a strip of {width} in {size} floats");
        assert!(segments > 0 && self.weights.len() == segments.saturating_mul(length).saturating_mul(size));
        assert!(self.start.is_none_or(|start| start.len() == size));
        let reads = end(input, &[[positions, input_step], [segments, self.pitch]], length);
        assert!(reads <= self.x.len(), "a tile reads outside its input");
        assert!(end(output, &[[positions, output_step]], width) <= self.out.len, "a tile writes outside its output");
        if let Some((values, [skip, step])) = self.skip {
            assert!(end(skip, &[[positions, step]], width) <= values.len(), "a tile reads outside its skip");
        }
    }
}

/// Tiles of `M` positions × `N` vectors and `K` half ones.
struct Conv<'a, H, const M: usize, const N: usize, const K: usize> {
    row: &'a ConvRow<'a>,
    half: H,
    first: usize,
    tiles: usize,
}

impl<H: Simd, const M: usize, const N: usize, const K: usize> WithSimd for Conv<'_, H, M, N, K> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { row, half, first, tiles } = self;
        for tile in 0..tiles {
            let position = first + tile * M;
            // SAFETY: the row was checked to hold all that is read and written at each of its positions (`check`),
            // of which these are some: `segments` runs of `length` floats from each input, `size` floats a tap from
            // `weights`, `size` from start, `width` at each output and skip. Narrower strips than whole ones are
            // computed in local rows of `size` floats.
            unsafe {
                let x = row.x.as_ptr().add(row.input[0] + position * row.input[1]);
                let out = row.out.start.add(row.output[0] + position * row.output[1]);
                let skip = row.skip.map(|(values, [at, step])| (values.as_ptr().add(at + position * step), step));
                if row.width == row.size {
                    sum_up::<S, H, M, N, K>(simd, half, row, x, skip, (out, row.output[1]));
                    continue;
                }
                let mut results = [[0.0_f32; SLACK]; M];
                let mut added = [[0.0_f32; SLACK]; M];
                for m in 0..M {
                    if row.start.is_none() {
                        results[m].as_mut_ptr().copy_from_nonoverlapping(out.add(m * row.output[1]), row.width);
                    }
                    if let Some((values, step)) = skip {
                        added[m].as_mut_ptr().copy_from_nonoverlapping(values.add(m * step), row.width);
                    }
                }
                let skip = skip.map(|_| (added.as_ptr().cast(), SLACK));
                sum_up::<S, H, M, N, K>(simd, half, row, x, skip, (results.as_mut_ptr().cast(), SLACK));
                for m in 0..M {
                    out.add(m * row.output[1]).copy_from_nonoverlapping(results[m].as_ptr(), row.width);
                }
            }
        }
    }
}

/// The sums of a tile of whole strips, finished and written: positions' values are at `x` and so on, skips and
/// outputs at a pointer and so on by a step.
///
/// # Safety
/// As [`ConvRow::check`] has made sure; outputs and skips hold a strip each.
// Small loops over constants only, or the compiler keeps the sums in memory.
#[inline(always)]
unsafe fn sum_up<S: Simd, H: Simd, const M: usize, const N: usize, const K: usize>(
    simd: S,
    half: H,
    row: &ConvRow<'_>,
    x: *const f32,
    skip: Option<(*const f32, usize)>,
    (out, output_step): (*mut f32, usize),
) {
    // SAFETY: the caller's promise.
    unsafe {
        let whole = N * S::F32_LANES;
        let size = whole + K * H::F32_LANES;
        let mut sums = [[simd.splat_f32s(0.0); N]; M];
        let mut halves = [[half.splat_f32s(0.0); K]; M];
        if let Some(start) = row.start {
            let (start, half_start) = (read(simd, start.as_ptr()), read(half, start.as_ptr().add(whole)));
            for m in 0..M {
                (sums[m], halves[m]) = (start, half_start);
            }
        } else {
            for m in 0..M {
                let from = out.add(m * output_step);
                (sums[m], halves[m]) = (read(simd, from), read(half, from.add(whole)));
            }
        }
        let mut rows = [x; M];
        for m in 0..M {
            rows[m] = x.add(m * row.input[1]);
        }
        let mut weights = row.weights.as_ptr();
        for segment in 0..row.segments {
            // Four taps to a round. The ways out between them keep each tap's reads and sums together: in one piece LLVM orders
            // them for wasm by sums, a sum's four taps at a time, and the values read do not fit the registers.
            let mut tap = 0;
            while tap < row.length {
                tap = hidden(tap);
                let taps = weights.add(tap * size);
                let mut at = rows;
                for m in 0..M {
                    at[m] = rows[m].add(segment * row.pitch + tap);
                }
                add_tap(simd, half, &at, 0, taps, &mut sums, &mut halves);
                if tap + 1 == row.length {
                    break;
                }
                add_tap(simd, half, &at, 1, taps.add(size), &mut sums, &mut halves);
                if tap + 2 == row.length {
                    break;
                }
                add_tap(simd, half, &at, 2, taps.add(2 * size), &mut sums, &mut halves);
                if tap + 3 == row.length {
                    break;
                }
                add_tap(simd, half, &at, 3, taps.add(3 * size), &mut sums, &mut halves);
                tap += 4;
            }
            weights = weights.add(row.length * size);
        }
        if let Some((skip, step)) = skip {
            for m in 0..M {
                let from = skip.add(m * step);
                let (skip, half_skip): ([S::f32s; N], [H::f32s; K]) = (read(simd, from), read(half, from.add(whole)));
                for n in 0..N {
                    sums[m][n] = simd.add_f32s(sums[m][n], skip[n]);
                }
                for k in 0..K {
                    halves[m][k] = half.add_f32s(halves[m][k], half_skip[k]);
                }
            }
        }
        if row.slope != 1.0 {
            let (slope, half_slope) = (simd.splat_f32s(row.slope), half.splat_f32s(row.slope));
            for m in 0..M {
                for n in 0..N {
                    sums[m][n] = simd.max_f32s(sums[m][n], simd.mul_f32s(sums[m][n], slope));
                }
                for k in 0..K {
                    halves[m][k] = half.max_f32s(halves[m][k], half.mul_f32s(halves[m][k], half_slope));
                }
            }
        }
        for m in 0..M {
            let to = out.add(m * output_step);
            write(to, sums[m]);
            write(to.add(whole), halves[m]);
        }
    }
}

/// `value`, of which the compiler is not told in wasm: of addresses that it can foresee LLVM makes a pointer for each position and
/// tap, and counts them all up, where V8 could add a constant for nothing.
#[inline(always)]
fn hidden(value: usize) -> usize {
    // SAFETY: it is there to be read.
    if cfg!(target_arch = "wasm32") { unsafe { (&raw const value).read_volatile() } } else { value }
}

/// Adds one tap's products: of each position's value at `x[m] + tap` with a strip of weights.
///
/// # Safety
/// They must be readable.
#[inline(always)]
unsafe fn add_tap<S: Simd, H: Simd, const M: usize, const N: usize, const K: usize>(
    simd: S,
    half: H,
    x: &[*const f32; M],
    tap: usize,
    weights: *const f32,
    sums: &mut [[S::f32s; N]; M],
    halves: &mut [[H::f32s; K]; M],
) {
    // SAFETY: the caller's promise.
    unsafe {
        let taps: [S::f32s; N] = read(simd, weights);
        let half_taps: [H::f32s; K] = read(half, weights.add(N * S::F32_LANES));
        for m in 0..M {
            let value = *x[m].add(tap);
            for n in 0..N {
                sums[m][n] = multiply_add(simd, simd.splat_f32s(value), taps[n], sums[m][n]);
            }
            for k in 0..K {
                halves[m][k] = multiply_add(half, half.splat_f32s(value), half_taps[k], halves[m][k]);
            }
        }
    }
}

/// `taps` neighbouring inputs × one strip of output channels of the weights' gradient, summed over a
/// block of output positions: `sums[t] += Σ x[position + t] · dy[position]`.
pub struct WeightTile<'a> {
    /// Input, zeros around it.
    pub x: &'a [f32],
    /// Gradient of the output.
    pub dy: &'a [f32],
    /// Where the first position's first tap is in `x`, and its channels in `dy`.
    pub start: [usize; 2],
    /// Rows of positions.
    pub rows: usize,
    /// Positions in a row.
    pub columns: usize,
    /// From row to row, in `x` and `dy`.
    pub row_step: [usize; 2],
    /// From position to position, in `x` and `dy`.
    pub column_step: [usize; 2],
    /// Neighbouring values of `x`, 1 to [`MAX_POSITIONS`].
    pub taps: usize,
    /// Floats in the strip, one of [`Vectors::strips`].
    pub size: usize,
    /// `[taps, size]`. Channels beyond the layer's hold rubbish: `dy` is read on.
    pub sums: &'a mut [f32],
}

impl WeightTile<'_> {
    /// Refuses a tile that the kernel must not run on.
    fn check(&self) {
        assert!(self.sums.len() == self.taps.saturating_mul(self.size));
        if self.rows == 0 || self.columns == 0 {
            return;
        }
        let reads = |side: usize, len: usize| {
            end(self.start[side], &[[self.rows, self.row_step[side]], [self.columns, self.column_step[side]]], len)
        };
        let inside = reads(0, self.taps) <= self.x.len() && reads(1, self.size) <= self.dy.len();
        assert!(inside, "a tile reads outside its input");
    }
}

/// Sums for `M` taps × `N` vectors and `K` half ones.
struct Weight<'a, 'b, H, const M: usize, const N: usize, const K: usize> {
    tile: &'a mut WeightTile<'b>,
    half: H,
}

impl<H: Simd, const M: usize, const N: usize, const K: usize> WithSimd for Weight<'_, '_, H, M, N, K> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { tile, half } = self;
        let whole = N * S::F32_LANES;
        let size = whole + K * H::F32_LANES;
        // SAFETY: the furthest position was checked to leave `M` floats in `x` and a strip in `dy`,
        // steps are not negative, `sums` holds `M` strips (`check`).
        unsafe {
            let out = tile.sums.as_mut_ptr();
            let mut sums = [[simd.splat_f32s(0.0); N]; M];
            let mut halves = [[half.splat_f32s(0.0); K]; M];
            for m in 0..M {
                let from = out.add(m * size);
                (sums[m], halves[m]) = (read(simd, from), read(half, from.add(whole)));
            }
            for row in 0..tile.rows {
                let mut x = tile.x.as_ptr().add(tile.start[0] + row * tile.row_step[0]);
                let mut dy = tile.dy.as_ptr().add(tile.start[1] + row * tile.row_step[1]);
                for column in 0..tile.columns {
                    let gradient: [S::f32s; N] = read(simd, dy);
                    let half_gradient: [H::f32s; K] = read(half, dy.add(whole));
                    for m in 0..M {
                        let value = *x.add(m);
                        for n in 0..N {
                            sums[m][n] = multiply_add(simd, simd.splat_f32s(value), gradient[n], sums[m][n]);
                        }
                        for k in 0..K {
                            halves[m][k] = multiply_add(half, half.splat_f32s(value), half_gradient[k], halves[m][k]);
                        }
                    }
                    if column + 1 < tile.columns {
                        x = x.add(tile.column_step[0]);
                        dy = dy.add(tile.column_step[1]);
                    }
                }
            }
            for m in 0..M {
                write(out.add(m * size), sums[m]);
                write(out.add(m * size + whole), halves[m]);
            }
        }
    }
}
