//! Winograd's transforms: a patch of vectors, in both directions.

use pulp::{Simd, WithSimd};

use super::Vectors;
use super::memory::{Shared, end, load};

impl Vectors {
    /// Transforms a patch in both directions, `[N, N]` to `[P, P]`, every channel.
    ///
    /// # Panics
    /// As [`Self::convolve`].
    pub(in crate::kernels) fn transform<const N: usize, const P: usize, T: Transform<N, P>>(
        self,
        transform: T,
        patch: &Patch<'_>,
    ) {
        self.0.dispatch(TransformPatch::<N, P, T> { transform, patch });
    }
}

/// A transform in one direction.
pub(in crate::kernels) trait Transform<const N: usize, const P: usize>: Copy {
    /// Transforms a row or a column.
    fn apply<S: Simd>(self, simd: S, values: [S::f32s; N]) -> [S::f32s; P];
}

/// A patch of vectors, and where its transform goes.
pub(in crate::kernels) struct Patch<'a> {
    pub x: &'a [f32],
    /// Where the first value is in `x`.
    pub start: usize,
    /// From row to row and column to column of `x`.
    pub steps: [usize; 2],
    /// Channels; whole vectors of them are read.
    pub channels: usize,
    pub out: Shared<'a>,
    /// Where the first result goes in `out`.
    pub output: usize,
    /// From row to row and column to column of `out`.
    pub output_steps: [usize; 2],
    /// How results are written; without, in whole vectors as they are.
    pub finish: Option<Finish<'a>>,
}

/// What is done to results: a start and a skip are added, then the slope; of the results only some rows,
/// columns and channels exist.
pub(in crate::kernels) struct Finish<'a> {
    /// In whole vectors.
    pub start: Option<&'a [f32]>,
    /// Values, where the first one is, and from row to row and column to column.
    pub skip: Option<(&'a [f32], usize, [usize; 2])>,
    pub slope: f32,
    pub rows: usize,
    pub columns: usize,
}

impl Patch<'_> {
    /// Refuses a patch that a transform of `N`×`N` values to `P`×`P` must not run on. How many rows and columns of its
    /// results are written.
    fn check<const N: usize, const P: usize>(&self, lanes: usize) -> [usize; 2] {
        let padded = self.channels.div_ceil(lanes).saturating_mul(lanes);
        let end = |start: usize, steps: [usize; 2], counts: [usize; 2], len: usize| {
            end(start, &[[counts[0], steps[0]], [counts[1], steps[1]]], len)
        };
        assert!(end(self.start, self.steps, [N, N], padded) <= self.x.len(), "a patch outside its input");
        let (counts, written) = match &self.finish {
            Some(finish) => {
                let counts = [finish.rows, finish.columns];
                assert!(counts.iter().all(|count| (1..=P).contains(count)));
                assert!(finish.start.is_none_or(|start| start.len() >= padded));
                if let Some((values, start, steps)) = finish.skip {
                    assert!(end(start, steps, counts, self.channels) <= values.len(), "a patch outside its skip");
                }
                (counts, self.channels)
            }
            None => ([P, P], padded),
        };
        assert!(end(self.output, self.output_steps, counts, written) <= self.out.len, "a patch outside its output");
        counts
    }
}

struct TransformPatch<'a, 'b, const N: usize, const P: usize, T> {
    transform: T,
    patch: &'a Patch<'b>,
}

impl<const N: usize, const P: usize, T: Transform<N, P>> WithSimd for TransformPatch<'_, '_, N, P, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (transform, patch) = (self.transform, self.patch);
        let lanes = S::F32_LANES;
        let counts = patch.check::<N, P>(lanes);
        for channel in (0..patch.channels).step_by(lanes) {
            macro_rules! rows {
                ($($row:literal)*) => {
                    $(if $row < counts[0] {
                        // SAFETY: the furthest values read and written were checked (`check`).
                        unsafe { transform_row::<S, N, P, T, $row>(simd, transform, patch, channel, counts[1]) };
                    })*
                };
            }
            rows!(0 1 2 3 4 5);
        }
    }
}

/// One row of a patch's transform, one vector of channels. All rows at once would not fit the registers: to read
/// the patch again for each is cheaper.
///
/// # Safety
/// As [`Patch::check`] has made sure; `ROW` and `columns` are at most as many as it says.
#[inline(always)]
unsafe fn transform_row<S: Simd, const N: usize, const P: usize, T: Transform<N, P>, const ROW: usize>(
    simd: S,
    transform: T,
    patch: &Patch<'_>,
    channel: usize,
    columns: usize,
) {
    if ROW >= P {
        return;
    }
    let lanes = S::F32_LANES;
    // SAFETY: the caller's promise.
    unsafe {
        let x = patch.x.as_ptr().add(patch.start + channel);
        let mut half = [simd.splat_f32s(0.0); N];
        for j in 0..N {
            let mut column = [simd.splat_f32s(0.0); N];
            for i in 0..N {
                column[i] = x.add(i * patch.steps[0] + j * patch.steps[1]).cast::<S::f32s>().read_unaligned();
            }
            half[j] = transform.apply(simd, column)[ROW];
        }
        let values = transform.apply(simd, half);
        let out = patch.out.start.add(patch.output + ROW * patch.output_steps[0] + channel);
        let Some(finish) = &patch.finish else {
            for j in 0..P {
                out.add(j * patch.output_steps[1]).cast::<S::f32s>().write_unaligned(values[j]);
            }
            return;
        };
        let width = lanes.min(patch.channels - channel);
        let slope = simd.splat_f32s(finish.slope);
        let start = match finish.start {
            Some(start) => start.as_ptr().add(channel).cast::<S::f32s>().read_unaligned(),
            None => simd.splat_f32s(0.0),
        };
        for j in 0..P {
            if j >= columns {
                break;
            }
            let mut value = simd.add_f32s(values[j], start);
            if let Some((values, start, steps)) = finish.skip {
                let skip = values.as_ptr().add(start + ROW * steps[0] + j * steps[1] + channel);
                value = simd.add_f32s(value, load(simd, skip, width));
            }
            value = simd.max_f32s(value, simd.mul_f32s(value, slope));
            let to = out.add(j * patch.output_steps[1]);
            if width == lanes {
                to.cast::<S::f32s>().write_unaligned(value);
            } else {
                to.copy_from_nonoverlapping((&raw const value).cast(), width);
            }
        }
    }
}
