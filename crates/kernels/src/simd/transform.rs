//! Winograd's transforms: a patch of vectors, in both directions.

use std::mem::MaybeUninit;

use pulp::{Simd, WithSimd};

use super::Vectors;
use super::memory::{Shared, end, load};

impl Vectors {
    /// Transforms a patch in both directions, `[N, N]` to `[P, P]`, every channel.
    ///
    /// # Panics
    /// As [`Self::convolve`].
    pub(crate) fn transform<const N: usize, const P: usize, T: Transform<N, P>>(self, transform: T, patch: &Patch<'_>) {
        self.0.dispatch(TransformPatch::<N, P, T> { transform, patch });
    }
}

/// A transform in one direction.
pub(crate) trait Transform<const N: usize, const P: usize>: Copy {
    /// Transforms a row or a column.
    fn apply<S: Simd>(self, simd: S, values: [S::f32s; N]) -> [S::f32s; P];
}

/// A patch of vectors, and where its transform goes.
pub(crate) struct Patch<'a> {
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
pub(crate) struct Finish<'a> {
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
            // SAFETY: the furthest values read and written were checked (`check`).
            unsafe { transform_channels::<S, N, P, T>(simd, transform, patch, channel, counts) };
        }
    }
}

/// A patch's transform, one vector of channels: its columns, then its rows. What lies between is in memory: it would not fit
/// the registers.
///
/// # Safety
/// As [`Patch::check`] has made sure; `counts` are at most as many rows and columns as it says.
#[inline(always)]
unsafe fn transform_channels<S: Simd, const N: usize, const P: usize, T: Transform<N, P>>(
    simd: S,
    transform: T,
    patch: &Patch<'_>,
    channel: usize,
    counts: [usize; 2],
) {
    let lanes = S::F32_LANES;
    // SAFETY: the caller's promise.
    unsafe {
        let x = patch.x.as_ptr().add(patch.start + channel);
        // Not set to zeros first: they would cost as much as a tenth of the transform.
        let mut half = MaybeUninit::<[[S::f32s; N]; P]>::uninit();
        let between = half.as_mut_ptr().cast::<S::f32s>();
        for j in 0..N {
            let mut column = [simd.splat_f32s(0.0); N];
            for i in 0..N {
                column[i] = x.add(i * patch.steps[0] + j * patch.steps[1]).cast::<S::f32s>().read_unaligned();
            }
            let column = transform.apply(simd, column);
            for i in 0..P {
                between.add(i * N + j).write(column[i]);
            }
        }
        let half = half.assume_init_ref();
        let out = patch.out.start.add(patch.output + channel);
        let Some(finish) = &patch.finish else {
            for i in 0..P {
                let values = transform.apply(simd, half[i]);
                for j in 0..P {
                    let to = out.add(i * patch.output_steps[0] + j * patch.output_steps[1]);
                    to.cast::<S::f32s>().write_unaligned(values[j]);
                }
            }
            return;
        };
        let width = lanes.min(patch.channels - channel);
        let slope = simd.splat_f32s(finish.slope);
        let start = match finish.start {
            Some(start) => start.as_ptr().add(channel).cast::<S::f32s>().read_unaligned(),
            None => simd.splat_f32s(0.0),
        };
        for i in 0..counts[0] {
            let values = transform.apply(simd, half[i]);
            for j in 0..P {
                if j >= counts[1] {
                    break;
                }
                let mut value = simd.add_f32s(values[j], start);
                if let Some((values, start, steps)) = finish.skip {
                    let skip = values.as_ptr().add(start + i * steps[0] + j * steps[1] + channel);
                    value = simd.add_f32s(value, load(simd, skip, width));
                }
                value = simd.max_f32s(value, simd.mul_f32s(value, slope));
                let to = out.add(i * patch.output_steps[0] + j * patch.output_steps[1]);
                if width == lanes {
                    to.cast::<S::f32s>().write_unaligned(value);
                } else {
                    to.copy_from_nonoverlapping((&raw const value).cast(), width);
                }
            }
        }
    }
}
