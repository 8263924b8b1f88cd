//! Depthwise sums: positions × one vector of channels.

use pulp::{Simd, WithSimd};

use super::memory::{Shared, end, read, write};
use super::{DEPTHWISE_POSITIONS, Vectors, multiply_add};

impl Vectors {
    /// Computes one row of a depthwise convolution, one vector of channels.
    ///
    /// # Panics
    /// As [`Self::convolve`].
    pub fn depthwise(self, row: &DepthwiseRow<'_>) {
        match row.kernel {
            // In wasm V8 has too few registers for what LLVM makes of a kernel's row at once, and one loop is a smaller download.
            #[cfg(not(target_arch = "wasm32"))]
            3 => self.0.dispatch(Depthwise::<3>(row)),
            #[cfg(not(target_arch = "wasm32"))]
            5 => self.0.dispatch(Depthwise::<5>(row)),
            #[cfg(not(target_arch = "wasm32"))]
            7 => self.0.dispatch(Depthwise::<7>(row)),
            _ => self.0.dispatch(Depthwise::<0>(row)),
        }
    }

    /// Adds one row's part to the gradient of a depthwise kernel's row.
    ///
    /// # Panics
    /// As [`Self::convolve`]; for a kernel that is not 3, 5 or 7 wide.
    pub fn depthwise_gradient(self, row: &mut DepthwiseGradientRow<'_>) {
        match row.kernel {
            3 => self.0.dispatch(DepthwiseWeight::<3>(row)),
            5 => self.0.dispatch(DepthwiseWeight::<5>(row)),
            7 => self.0.dispatch(DepthwiseWeight::<7>(row)),
            other => panic!("a depthwise kernel is 3, 5 or 7 wide, not {other}"),
        }
    }
}

/// One output row × one vector of channels of a depthwise convolution of stride 1.
pub struct DepthwiseRow<'a> {
    /// Input, zeros around it, [`SLACK`] floats after it.
    pub x: &'a [f32],
    /// Where the first position's first tap is.
    pub input: usize,
    /// From kernel row to kernel row.
    pub pitch: usize,
    /// Floats from pixel to pixel of the input.
    pub channels: usize,
    /// Side of the kernel.
    pub kernel: usize,
    /// `[kernel, kernel, lanes]`.
    pub weights: &'a [f32],
    /// Channels of the vector that exist.
    pub width: usize,
    /// Added first, `[lanes]`.
    pub start: &'a [f32],
    /// Negative results are multiplied by it.
    pub slope: f32,
    /// Output positions.
    pub columns: usize,
    /// Where results go.
    pub out: Shared<'a>,
    /// Where the first position's channels are in `out`.
    pub output: usize,
    /// Floats from pixel to pixel of the output.
    pub output_step: usize,
}

impl DepthwiseRow<'_> {
    /// Refuses a row that the kernel must not run on.
    fn check(&self, lanes: usize) {
        let Self { kernel, columns, .. } = *self;
        assert!(self.weights.len() == kernel * kernel * lanes && self.start.len() == lanes && self.width <= lanes);
        let pixels = columns.saturating_add(kernel - 1);
        let reads = end(self.input, &[[kernel, self.pitch], [pixels, self.channels]], lanes);
        assert!(reads <= self.x.len(), "a tile reads outside its input");
        let writes = end(self.output, &[[columns, self.output_step]], self.width);
        assert!(writes <= self.out.len, "a tile writes outside its output");
    }
}

/// `K` is the row's kernel, or 0 for one of any size.
struct Depthwise<'a, const K: usize>(&'a DepthwiseRow<'a>);

impl<const K: usize> WithSimd for Depthwise<'_, K> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        const T: usize = DEPTHWISE_POSITIONS;
        let row = self.0;
        if row.columns == 0 {
            return;
        }
        row.check(S::F32_LANES);
        // SAFETY: the row was checked (`check`); the tiles' positions are some of its columns.
        unsafe {
            if row.columns < T {
                (0..row.columns).for_each(|column| depthwise_tile::<S, 1, K>(simd, row, column));
                return;
            }
            for column in (0..row.columns).step_by(T) {
                // The last tile goes over what was done once more.
                depthwise_tile::<S, T, K>(simd, row, column.min(row.columns - T));
            }
        }
    }
}

/// `M` positions from a column on. (Pointers step over the end after the last tap, where nothing is read.)
///
/// # Safety
/// As [`DepthwiseRow::check`] has made sure; the positions are in the row.
#[inline(always)]
unsafe fn depthwise_tile<S: Simd, const M: usize, const K: usize>(simd: S, row: &DepthwiseRow<'_>, column: usize) {
    let lanes = S::F32_LANES;
    // SAFETY: the caller's promise: there is a vector at each tap of each position, and the channels of each output.
    unsafe {
        let mut line = row.x.as_ptr().add(row.input + column * row.channels);
        let mut weights = row.weights.as_ptr().cast::<S::f32s>();
        let mut sums = [row.start.as_ptr().cast::<S::f32s>().read_unaligned(); M];
        let kernel = if K == 0 { row.kernel } else { K };
        for _ in 0..kernel {
            let mut from = line;
            for _ in 0..kernel {
                let tap = weights.read_unaligned();
                for m in 0..M {
                    let value = from.add(m * row.channels).cast::<S::f32s>().read_unaligned();
                    sums[m] = multiply_add(simd, value, tap, sums[m]);
                }
                from = from.wrapping_add(row.channels);
                weights = weights.add(1);
            }
            line = line.wrapping_add(row.pitch);
        }
        let slope = simd.splat_f32s(row.slope);
        for m in 0..M {
            let sum = simd.max_f32s(sums[m], simd.mul_f32s(sums[m], slope));
            let out = row.out.start.add(row.output + (column + m) * row.output_step);
            if row.width == lanes {
                out.cast::<S::f32s>().write_unaligned(sum);
            } else {
                out.copy_from_nonoverlapping((&raw const sum).cast(), row.width);
            }
        }
    }
}

/// One output row × one kernel row × one vector of channels of a depthwise kernel's gradient.
pub struct DepthwiseGradientRow<'a> {
    /// Input, zeros around it, [`SLACK`] floats after it.
    pub x: &'a [f32],
    /// Gradient of the output, [`SLACK`] floats after it.
    pub dy: &'a [f32],
    /// Where the first position's first tap is in `x`, and its channels in `dy`.
    pub start: [usize; 2],
    /// Floats from pixel to pixel of both.
    pub channels: usize,
    /// Positions.
    pub columns: usize,
    /// Side of the kernel.
    pub kernel: usize,
    /// `[kernel, lanes]`.
    pub sums: &'a mut [f32],
}

impl DepthwiseGradientRow<'_> {
    /// Refuses a row that the kernel must not run on.
    fn check(&self, lanes: usize) {
        assert!(self.sums.len() == self.kernel * lanes);
        let pixels = self.columns.saturating_add(self.kernel - 1);
        let inside = end(self.start[0], &[[pixels, self.channels]], lanes) <= self.x.len()
            && end(self.start[1], &[[self.columns, self.channels]], lanes) <= self.dy.len();
        assert!(inside, "a tile reads outside its input");
    }
}

/// `K` is the row's kernel.
struct DepthwiseWeight<'a, 'b, const K: usize>(&'a mut DepthwiseGradientRow<'b>);

impl<const K: usize> WithSimd for DepthwiseWeight<'_, '_, K> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let row = self.0;
        if row.columns == 0 {
            return;
        }
        row.check(S::F32_LANES);
        // SAFETY: the furthest reads were checked to leave a vector; `sums` holds `K` vectors (`check`).
        unsafe {
            let out = row.sums.as_mut_ptr();
            let mut sums: [S::f32s; K] = read(simd, out);
            let x = row.x.as_ptr().add(row.start[0]);
            let dy = row.dy.as_ptr().add(row.start[1]);
            for column in 0..row.columns {
                let gradient = dy.add(column * row.channels).cast::<S::f32s>().read_unaligned();
                for (k, sum) in sums.iter_mut().enumerate() {
                    let value = x.add((column + k) * row.channels).cast::<S::f32s>().read_unaligned();
                    *sum = multiply_add(simd, value, gradient, *sum);
                }
            }
            write(out, sums);
        }
    }
}
