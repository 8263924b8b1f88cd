//! Register tiles: the innermost loops of every convolution, and the crate's only unsafe code.
//!
//! A tile keeps its sums in vector registers while it walks through memory by pointer. Two things
//! cannot be said in safe Rust at this speed: reading an input value without a bounds check for each
//! multiplication (there are 28 multiplications of a vector for 16 such reads), and several threads
//! writing to one buffer in turns of a few floats. Both are fenced in here: each entry checks, before the first
//! read and in arithmetic that cannot overflow, that everything it will touch lies inside its slices (the tests cross
//! each limit).
#![allow(unsafe_code)]
// Loops over constants by index: they are unrolled.
#![allow(clippy::needless_range_loop, clippy::manual_memcpy)]

mod depthwise;
mod memory;
#[cfg(target_arch = "wasm32")]
pub(super) mod shuffles;
#[cfg(all(test, not(target_arch = "wasm32")))]
mod tests;
mod tile;
mod transform;

pub use depthwise::{DepthwiseGradientRow, DepthwiseRow};
pub use memory::Shared;
pub use tile::{ConvRow, WeightTile};
pub(super) use transform::{Finish, Patch, Transform};

#[cfg(not(target_arch = "wasm32"))]
use std::sync::LazyLock;

use pulp::{Simd, WithSimd};

/// Most output positions in a tile.
pub const MAX_POSITIONS: usize = 14;
/// Floats after the last value that a vector may read (never use): the widest strip.
pub const SLACK: usize = if cfg!(any(target_arch = "x86", target_arch = "x86_64")) { 32 } else { 8 };
/// Output positions of a depthwise tile.
pub const DEPTHWISE_POSITIONS: usize = 8;

/// An instruction set that this machine has.
#[derive(Debug, Clone, Copy)]
pub struct Vectors(Arch);

#[cfg(not(target_arch = "wasm32"))]
use pulp::Arch;
#[cfg(target_arch = "x86_64")]
use pulp::x86::V3;

/// In wasm the build decides, and only what it chose is compiled.
#[cfg(target_arch = "wasm32")]
#[derive(Debug, Clone, Copy)]
struct Arch;

#[cfg(target_arch = "wasm32")]
impl Arch {
    fn new() -> Self {
        Self
    }

    #[inline(always)]
    fn dispatch<Op: WithSimd>(self, op: Op) -> Op::Output {
        // SAFETY: a module with instructions that the browser does not have would not have been loaded.
        unsafe { on_wasm(op) }
    }
}

#[cfg(target_arch = "wasm32")]
#[cfg_attr(feature = "relaxed-simd", target_feature(enable = "relaxed-simd"))]
unsafe fn on_wasm<Op: WithSimd>(op: Op) -> Op::Output {
    // SAFETY: every build for browsers has SIMD128.
    let set = unsafe { pulp::wasm::Simd128::new_unchecked() };
    op.with_simd(set)
}

/// `a · b + c`, rounded once where that is one instruction.
#[inline(always)]
pub fn multiply_add<S: Simd>(simd: S, a: S::f32s, b: S::f32s, c: S::f32s) -> S::f32s {
    #[cfg(all(target_arch = "wasm32", feature = "relaxed-simd"))]
    if size_of::<S::f32s>() == size_of::<std::arch::wasm32::v128>() {
        // pulp has it too, behind a feature that gemm and all of Burn would be compiled again for.
        // SAFETY: of four floats each, and called within `on_wasm` alone, which has the instruction.
        return unsafe {
            let [a, b, c] = [a, b, c].map(|x| std::mem::transmute_copy::<S::f32s, std::arch::wasm32::v128>(&x));
            std::mem::transmute_copy(&relaxed_multiply_add(a, b, c))
        };
    }
    simd.mul_add_e_f32s(a, b, c)
}

#[cfg(all(target_arch = "wasm32", feature = "relaxed-simd"))]
#[target_feature(enable = "relaxed-simd")]
#[inline]
fn relaxed_multiply_add(
    a: std::arch::wasm32::v128,
    b: std::arch::wasm32::v128,
    c: std::arch::wasm32::v128,
) -> std::arch::wasm32::v128 {
    std::arch::wasm32::f32x4_relaxed_madd(a, b, c)
}

/// Dispatches a kernel for so many positions and a strip of so many floats, whole vectors and half ones.
macro_rules! strip_kernel {
    ($vectors:expr, $size:expr, $positions:expr, $half:ident => $kernel:ident $fields:tt) => {
        match ($vectors.0, $size / $vectors.lanes()) {
            #[cfg(target_arch = "x86_64")]
            (Arch::V4(wide), _) if $size == 24 => {
                let $half: V3 = *wide;
                strip_kernel!(1, 1, $positions, wide, Simd::vectorize, $kernel $fields)
            }
            (arch, vectors) => {
                let $half = Scalar::new();
                match vectors {
                    1 => strip_kernel!(1, 0, $positions, arch, Arch::dispatch, $kernel $fields),
                    2 => strip_kernel!(2, 0, $positions, arch, Arch::dispatch, $kernel $fields),
                    _ => panic!("there are no strips of {} floats", $size),
                }
            }
        }
    };
    // wasm has those that `positions` names, for a small download.
    ($n:literal, $k:literal, $positions:expr, $set:expr, $run:path, $kernel:ident $fields:tt) => {
        strip_kernel!($n, $k, $positions, $set, $run, $kernel $fields, 1 2 3 4 5 6 7 8, 9 10 11 12 13 14)
    };
    ($n:literal, $k:literal, $positions:expr, $set:expr, $run:path, $kernel:ident $fields:tt, $($few:literal)*, $($many:literal)*) => {
        match $positions {
            $($few => $run($set, strip_kernel!($kernel, $few, $n, $k, $fields)),)*
            $(#[cfg(not(target_arch = "wasm32"))] $many => $run($set, strip_kernel!($kernel, $many, $n, $k, $fields)),)*
            other => panic!("a tile has 1 to {MAX_POSITIONS} positions, not {other}"),
        }
    };
    ($kernel:ident, $m:literal, $n:literal, $k:literal, { $($field:ident),* }) => {
        $kernel::<_, $m, $n, $k> { $($field),* }
    };
}

use strip_kernel;

impl Vectors {
    /// The widest set; natively, to compare them, a narrower one that `GRAVISIGHT_VECTORS` names (`avx2`, `scalar`).
    #[cfg(not(target_arch = "wasm32"))]
    pub fn best() -> Self {
        static BEST: LazyLock<Vectors> = LazyLock::new(|| match std::env::var("GRAVISIGHT_VECTORS").as_deref() {
            #[cfg(target_arch = "x86_64")]
            Ok("avx2") => Vectors(V3::try_new().map_or_else(Arch::new, Arch::V3)),
            Ok("scalar") => Vectors(Arch::Scalar),
            _ => Vectors(Arch::new()),
        });
        *BEST
    }

    /// The build's set.
    #[cfg(target_arch = "wasm32")]
    pub fn best() -> Self {
        Self(Arch::new())
    }

    /// Every set that this machine has.
    #[cfg(test)]
    pub fn all() -> Vec<Self> {
        #[allow(unused_mut)] // one set in wasm
        let mut all = vec![Self::best()];
        #[cfg(target_arch = "x86_64")]
        {
            all.push(Self(Arch::Scalar));
            all.extend(pulp::x86::V3::try_new().map(|set| Self(Arch::V3(set))));
        }
        #[cfg(target_arch = "aarch64")]
        all.push(Self(Arch::Scalar));
        all
    }

    /// Floats in a vector.
    pub fn lanes(self) -> usize {
        struct Lanes;
        impl WithSimd for Lanes {
            type Output = usize;
            #[inline(always)]
            fn with_simd<S: Simd>(self, _: S) -> usize {
                S::F32_LANES
            }
        }
        self.0.dispatch(Lanes)
    }

    /// Strips of channels that tiles can have, floats, narrowest first. Half a vector is there only
    /// where it costs half as much.
    pub fn strips(self) -> &'static [usize] {
        match self.lanes() {
            16 => &[8, 16, 24, 32],
            8 => &[8, 16],
            4 => &[4, 8],
            _ => &[1, 2],
        }
    }

    /// The set whose vectors `channels` channels fill best.
    pub fn for_channels(self, channels: usize) -> Self {
        #[cfg(target_arch = "x86_64")]
        if let Arch::V4(wide) = self.0
            && (1..=8).contains(&(channels % 16))
        {
            return Self(Arch::V3(*wide));
        }
        let _ = channels;
        self
    }

    /// The set for a strip: half as wide for half a vector.
    fn for_strip(self, size: usize) -> Self {
        if size < self.lanes() { self.for_channels(size) } else { self }
    }

    /// Output positions (or taps) that the registers hold sums for, a strip of `size` floats each.
    pub fn positions(self, size: usize) -> usize {
        struct Registers;
        impl WithSimd for Registers {
            type Output = usize;
            #[inline(always)]
            fn with_simd<S: Simd>(self, _: S) -> usize {
                S::REGISTER_COUNT
            }
        }
        // V8 gives wasm fewer registers than the machine has, and without fused multiply-add products take some of them.
        let registers = match (cfg!(target_arch = "wasm32"), cfg!(feature = "relaxed-simd")) {
            (true, true) => 15,
            (true, false) => 13,
            (false, _) => self.0.dispatch(Registers),
        };
        match (registers, size > self.lanes()) {
            (32.., _) => MAX_POSITIONS,
            (16.., false) => 12,
            (15.., true) => 6,
            (_, false) => 8,
            _ => 5,
        }
    }

    /// Runs `work`, compiled for these vectors (see [`vectorised`]).
    pub(super) fn run<W: WithSimd>(self, work: W) -> W::Output {
        self.0.dispatch(work)
    }
}

/// A function whose plain loops the compiler turns into the vectors of its first argument. (A closure would
/// not do: it is compiled for the oldest machine, unless it happens to be inlined.)
macro_rules! vectorised {
    ($(#[$meta:meta])* $visibility:vis fn $name:ident<'a>($($argument:ident: $type:ty),* $(,)?) $body:block) => {
        $(#[$meta])*
        #[allow(clippy::too_many_arguments)] // rows of one loop
        $visibility fn $name<'a>(vectors: $crate::Vectors, $($argument: $type),*) {
            struct Work<'a> {
                $($argument: $type,)*
                lifetime: std::marker::PhantomData<&'a ()>,
            }
            impl<'a> pulp::WithSimd for Work<'a> {
                type Output = ();

                #[inline(always)]
                fn with_simd<S: pulp::Simd>(self, _: S) {
                    let Self { $($argument,)* lifetime: _ } = self;
                    $body
                }
            }
            vectors.run(Work { $($argument,)* lifetime: std::marker::PhantomData });
        }
    };
}
pub(super) use vectorised;
