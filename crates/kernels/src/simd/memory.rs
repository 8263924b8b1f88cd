//! Memory as the kernels see it: pointers, and a buffer that threads share.

use std::marker::PhantomData;

use pulp::Simd;

/// A buffer that the tiles of a layer write to, by several threads at the same time, each tile to its own places.
///
/// It gives out no references: it can only be named as the output of a tile. What can be cut into slices goes to threads
/// as slices instead (`parallel::for_each_of`).
#[derive(Clone, Copy)]
pub struct Shared<'a> {
    pub(super) start: *mut f32,
    pub(super) len: usize,
    lifetime: PhantomData<&'a mut [f32]>,
}

// SAFETY: made from an exclusive borrow, so only the holders of its copies write to the buffer, through tiles, which check
// that they stay inside. These are the layers of `kernels`: each makes one in a call, and two of its tasks never compute
// the same output (lines × strips of channels in `conv`, lines in `depthwise`, Winograd's tiles in `winograd`).
unsafe impl Send for Shared<'_> {}
// SAFETY: as above.
unsafe impl Sync for Shared<'_> {}

impl<'a> Shared<'a> {
    /// Shares `buffer` for as long as it is borrowed.
    pub fn new(buffer: &'a mut [f32]) -> Self {
        Self { start: buffer.as_mut_ptr(), len: buffer.len(), lifetime: PhantomData }
    }
}

/// The end of what is read or written from `start` on: the last of so many steps of so many floats, and `len`
/// floats there. Where it cannot be counted it is beyond every buffer.
pub(super) fn end(start: usize, steps: &[[usize; 2]], len: usize) -> usize {
    let far = steps.iter().map(|[count, step]| count.saturating_sub(1).saturating_mul(*step));
    far.fold(start.saturating_add(len), usize::saturating_add)
}

/// `N` vectors from `from`.
///
/// # Safety
/// They must be readable.
// Functions, here and below, where closures would do: only these are certain to be compiled for the
// vectors they are called with.
#[inline(always)]
pub(super) unsafe fn read<S: Simd, const N: usize>(simd: S, from: *const f32) -> [S::f32s; N] {
    let mut vectors = [simd.splat_f32s(0.0); N];
    for n in 0..N {
        // SAFETY: the caller's promise.
        vectors[n] = unsafe { from.cast::<S::f32s>().add(n).read_unaligned() };
    }
    vectors
}

/// Writes `N` vectors.
///
/// # Safety
/// There must be room for them.
#[inline(always)]
pub(super) unsafe fn write<V: Copy, const N: usize>(to: *mut f32, vectors: [V; N]) {
    for n in 0..N {
        // SAFETY: the caller's promise.
        unsafe { to.cast::<V>().add(n).write_unaligned(vectors[n]) };
    }
}

/// The vector at `from`, of which the first `width` floats exist; zero after them.
///
/// # Safety
/// `width` floats must be readable at `from`, at most a vector.
#[inline(always)]
pub(super) unsafe fn load<S: Simd>(simd: S, from: *const f32, width: usize) -> S::f32s {
    // SAFETY: the caller's promise; both types are plain floats.
    unsafe {
        if width == S::F32_LANES {
            return from.cast::<S::f32s>().read_unaligned();
        }
        let mut vector = simd.splat_f32s(0.0);
        (&raw mut vector).cast::<f32>().copy_from_nonoverlapping(from, width);
        vector
    }
}
