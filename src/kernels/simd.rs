//! Register tiles: the innermost loops of every convolution, and the crate's only unsafe code.
//!
//! A tile keeps its sums in vector registers while it walks through memory by pointer. Two things
//! cannot be said in safe Rust at this speed: reading an input value without a bounds check for each
//! multiplication (there are 28 multiplications of a vector for 16 such reads), and several threads
//! writing to one buffer in turns of a few floats. Both are fenced in here: each entry checks, once a
//! tile and before the first read, that everything it will touch lies inside its slices (the tests
//! cross each limit), and [`Shared`] checks every range it is asked for.
#![allow(unsafe_code)]
// Loops over constants by index: they are unrolled.
#![allow(clippy::needless_range_loop, clippy::manual_memcpy)]

use std::marker::PhantomData;

use pulp::{Simd, WithSimd};

/// Most output positions in a tile.
pub const MAX_POSITIONS: usize = 14;
/// Floats after the last value that a vector may read (never use): the widest strip.
pub const SLACK: usize = if cfg!(any(target_arch = "x86", target_arch = "x86_64")) { 32 } else { 8 };
/// Output positions of a depthwise tile.
pub const DEPTHWISE_POSITIONS: usize = if cfg!(target_arch = "wasm32") { 4 } else { 8 };

/// An instruction set that this machine has.
#[derive(Debug, Clone, Copy)]
pub struct Vectors(Arch);

#[cfg(not(target_arch = "wasm32"))]
use pulp::Arch;

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
        #[cfg(feature = "relaxed-simd")]
        use pulp::wasm::RelaxedSimd as Set;
        #[cfg(not(feature = "relaxed-simd"))]
        use pulp::wasm::Simd128 as Set;
        // SAFETY: a module with instructions that the browser does not have would not have been loaded.
        let set = unsafe { Set::new_unchecked() };
        Simd::vectorize(set, op)
    }
}

impl Vectors {
    /// The widest set.
    pub fn best() -> Self {
        Self(Arch::new())
    }

    /// Every set that this machine has, for tests.
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

    /// Output positions that the registers hold sums for, `vectors` (1 or 2) vectors each.
    pub fn positions(self, vectors: usize) -> usize {
        struct Registers;
        impl WithSimd for Registers {
            type Output = usize;
            #[inline(always)]
            fn with_simd<S: Simd>(self, _: S) -> usize {
                S::REGISTER_COUNT
            }
        }
        // V8 gives wasm fewer registers than the machine has.
        let registers = if cfg!(target_arch = "wasm32") { 13 } else { self.0.dispatch(Registers) };
        match (registers, vectors) {
            (32.., _) => MAX_POSITIONS,
            (16.., 1) => 12,
            (16.., _) => 6,
            (_, 1) => 8,
            _ => 5,
        }
    }

    /// Runs `work`, compiled for these vectors (see [`vectorised`]).
    pub(super) fn run<W: WithSimd>(self, work: W) -> W::Output {
        self.0.dispatch(work)
    }

    /// Computes a tile.
    ///
    /// # Panics
    /// Where the tile would read or write outside its slices.
    pub fn convolve(self, tile: &ConvTile<'_>) {
        macro_rules! choose {
            ($vectors:literal: $($positions:literal)*) => {
                match tile.input.len() {
                    $($positions => self.0.dispatch(Conv::<$positions, $vectors>(tile)),)*
                    other => panic!("a tile has 1 to {MAX_POSITIONS} positions, not {other}"),
                }
            };
        }
        match tile.vectors {
            #[cfg(not(target_arch = "wasm32"))]
            1 => choose!(1: 1 2 3 4 5 6 7 8 9 10 11 12 13 14),
            #[cfg(not(target_arch = "wasm32"))]
            2 => choose!(2: 1 2 3 4 5 6 7 8 9 10 11 12 13 14),
            // Those that `positions` names, for a small download.
            #[cfg(target_arch = "wasm32")]
            1 => choose!(1: 1 2 3 4 5 6 7 8),
            #[cfg(target_arch = "wasm32")]
            2 => choose!(2: 1 2 3 4 5),
            other => panic!("a tile has 1 or 2 vectors, not {other}"),
        }
    }

    /// Adds a tile of the weights' gradient to its sums.
    ///
    /// # Panics
    /// As [`Self::convolve`].
    pub fn weight_gradient(self, tile: &mut WeightTile<'_>) {
        macro_rules! choose {
            ($vectors:literal: $($taps:literal)*) => {
                match tile.taps {
                    $($taps => self.0.dispatch(Weight::<$taps, $vectors>(tile)),)*
                    other => panic!("a tile has 1 to {MAX_POSITIONS} taps, not {other}"),
                }
            };
        }
        match tile.vectors {
            #[cfg(not(target_arch = "wasm32"))]
            1 => choose!(1: 1 2 3 4 5 6 7 8 9 10 11 12 13 14),
            #[cfg(not(target_arch = "wasm32"))]
            2 => choose!(2: 1 2 3 4 5 6 7 8 9 10 11 12 13 14),
            // Those that `positions` names, for a small download.
            #[cfg(target_arch = "wasm32")]
            1 => choose!(1: 1 2 3 4 5 6 7 8),
            #[cfg(target_arch = "wasm32")]
            2 => choose!(2: 1 2 3 4 5),
            other => panic!("a tile has 1 or 2 vectors, not {other}"),
        }
    }

    /// Transforms a patch in both directions, `[N, N]` to `[P, P]`, every channel.
    ///
    /// # Panics
    /// As [`Self::convolve`].
    pub(super) fn transform<const N: usize, const P: usize, T: Transform<N, P>>(self, transform: T, patch: &Patch<'_>) {
        self.0.dispatch(TransformPatch::<N, P, T> { transform, patch });
    }

    /// Computes one row of a depthwise convolution, one vector of channels.
    ///
    /// # Panics
    /// As [`Self::convolve`]; for a kernel that is not 3, 5 or 7 wide.
    pub fn depthwise(self, row: &DepthwiseRow<'_>) {
        match row.kernel {
            3 => self.0.dispatch(Depthwise::<3>(row)),
            5 => self.0.dispatch(Depthwise::<5>(row)),
            7 => self.0.dispatch(Depthwise::<7>(row)),
            other => panic!("a depthwise kernel is 3, 5 or 7 wide, not {other}"),
        }
    }

    /// Adds one row's part to the gradient of a depthwise kernel's row.
    ///
    /// # Panics
    /// As [`Self::depthwise`].
    pub fn depthwise_gradient(self, row: &mut DepthwiseGradientRow<'_>) {
        match row.kernel {
            3 => self.0.dispatch(DepthwiseWeight::<3>(row)),
            5 => self.0.dispatch(DepthwiseWeight::<5>(row)),
            7 => self.0.dispatch(DepthwiseWeight::<7>(row)),
            other => panic!("a depthwise kernel is 3, 5 or 7 wide, not {other}"),
        }
    }
}

/// A function whose plain loops the compiler turns into the vectors of its first argument. (A closure would
/// not do: it is compiled for the oldest machine, unless it happens to be inlined.)
macro_rules! vectorised {
    ($(#[$meta:meta])* $visibility:vis fn $name:ident<'a>($($argument:ident: $type:ty),* $(,)?) $body:block) => {
        $(#[$meta])*
        #[allow(clippy::too_many_arguments)] // rows of one loop
        $visibility fn $name<'a>(vectors: $crate::kernels::Vectors, $($argument: $type),*) {
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

/// A buffer that threads write to at the same time, each to its own places.
#[derive(Clone, Copy)]
pub struct Shared<'a> {
    start: *mut f32,
    len: usize,
    lifetime: PhantomData<&'a mut [f32]>,
}

// SAFETY: a `Shared` is made from an exclusive borrow and gives out nothing by itself; who asks for a
// part promises that no other thread has it (see `part`).
unsafe impl Send for Shared<'_> {}
// SAFETY: as above.
unsafe impl Sync for Shared<'_> {}

impl<'a> Shared<'a> {
    /// Shares `buffer` for as long as it is borrowed.
    pub fn new(buffer: &'a mut [f32]) -> Self {
        Self { start: buffer.as_mut_ptr(), len: buffer.len(), lifetime: PhantomData }
    }

    /// The `len` floats from `start`.
    ///
    /// The callers are this module's neighbours only (`kernels`), and each of them splits its work so
    /// that every float belongs to one task; two parts of one place must never live at once.
    ///
    /// # Panics
    /// Where the part is not inside the buffer.
    #[allow(clippy::mut_from_ref)]
    pub(super) fn part(&self, start: usize, len: usize) -> &'a mut [f32] {
        assert!(start <= self.len && len <= self.len - start, "a part outside the buffer");
        // SAFETY: inside the borrowed buffer (checked); exclusive by the callers' promise.
        unsafe { std::slice::from_raw_parts_mut(self.start.add(start), len) }
    }

    /// Pointer to `len` floats from `start`.
    fn pointer(&self, start: usize, len: usize) -> *mut f32 {
        assert!(start <= self.len && len <= self.len - start, "a tile writes outside its output");
        // SAFETY: inside the buffer.
        unsafe { self.start.add(start) }
    }
}

/// Up to [`MAX_POSITIONS`] output positions × one strip of output channels:
/// `out[p] = slope(start[p] + Σ input[p] · weights + skip[p])`.
pub struct ConvTile<'a> {
    /// Values of the input, zeros around it.
    pub x: &'a [f32],
    /// Where each position's first segment starts in `x`.
    pub input: &'a [usize],
    /// Segments (kernel rows): how many, how long, how far apart in `x`.
    pub segments: usize,
    /// See `segments`.
    pub length: usize,
    /// See `segments`.
    pub pitch: usize,
    /// `[segments, length, vectors · lanes]`.
    pub weights: &'a [f32],
    /// Vectors in the strip, 1 or 2.
    pub vectors: usize,
    /// Channels in the strip that exist; the others are not written.
    pub width: usize,
    /// What the sums start from, `[vectors · lanes]`; from `out` itself if there is none.
    pub start: Option<&'a [f32]>,
    /// Added before the slope, where each position's channels are in it.
    pub skip: Option<(&'a [f32], &'a [usize])>,
    /// Negative results are multiplied by it, 0 to 1 (1: nothing happens).
    pub slope: f32,
    /// Where results go.
    pub out: Shared<'a>,
    /// Where each position's channels are in `out`.
    pub output: &'a [usize],
    /// Whether this strip has all of the layer's channels, so that a position that follows another in memory
    /// begins with this strip, too.
    pub alone: bool,
}

struct Conv<'a, const M: usize, const N: usize>(&'a ConvTile<'a>);

impl<const M: usize, const N: usize> WithSimd for Conv<'_, M, N> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let tile = self.0;
        let strip = N * S::F32_LANES;
        assert!(strip <= SLACK && tile.input.len() == M && tile.output.len() == M && tile.width <= strip);
        assert!(tile.segments > 0 && tile.weights.len() == tile.segments * tile.length * strip);
        assert!(tile.start.is_none_or(|start| start.len() == strip));
        let reach = (tile.segments - 1) * tile.pitch + tile.length;
        let furthest = tile.input.iter().fold(0, |furthest, &at| furthest.max(at));
        assert!(furthest + reach <= tile.x.len(), "a tile reads outside its input");
        let furthest = tile.output.iter().fold(0, |furthest, &at| furthest.max(at));
        assert!(furthest + tile.width <= tile.out.len, "a tile writes outside its output");
        if let Some((values, at)) = tile.skip {
            let furthest = at.iter().fold(0, |furthest, &at| furthest.max(at));
            assert!(at.len() == M && furthest + tile.width <= values.len(), "a tile reads outside its skip");
        }
        // SAFETY: inputs, weights, start, skip and outputs were checked above to hold all that is read
        // and written: `segments` runs of `length` floats from each input, `strip` floats a tap from
        // `weights`, `strip` from start, `width` at each output and skip. Narrower strips than whole ones
        // are computed in local rows of `strip` floats.
        unsafe {
            let mut rows = [tile.x.as_ptr(); M];
            let mut outputs = [tile.out.start; M];
            let mut skips = [tile.x.as_ptr(); M];
            for m in 0..M {
                rows[m] = tile.x.as_ptr().add(tile.input[m]);
                outputs[m] = tile.out.start.add(tile.output[m]);
                if let Some((values, at)) = tile.skip {
                    skips[m] = values.as_ptr().add(at[m]);
                }
            }
            if tile.width == strip {
                return sum_up::<S, M, N>(simd, tile, &rows, &skips, &outputs);
            }
            let tight = tile.output.windows(2).all(|pair| pair[1] == pair[0] + tile.width);
            let mut results = [[0.0_f32; SLACK]; M];
            let mut added = [[0.0_f32; SLACK]; M];
            let mut local = outputs;
            for m in 0..M {
                local[m] = results[m].as_mut_ptr();
                if tile.start.is_none() {
                    results[m].as_mut_ptr().copy_from_nonoverlapping(outputs[m], tile.width);
                }
                if tile.skip.is_some() {
                    added[m].as_mut_ptr().copy_from_nonoverlapping(skips[m], tile.width);
                    skips[m] = added[m].as_ptr();
                }
            }
            sum_up::<S, M, N>(simd, tile, &rows, &skips, &local);
            for m in 0..M {
                // What a whole row writes too much is written again if what lies right behind it are this
                // tile's next positions.
                let rest = M - 1 - m;
                let covered = tile.alone && tight && rest * tile.width >= strip - tile.width;
                let count = if covered { strip } else { tile.width };
                outputs[m].copy_from_nonoverlapping(results[m].as_ptr(), count);
            }
        }
    }
}

/// The sums of a tile of whole strips, finished and written.
///
/// # Safety
/// As [`Conv`] has checked; `outputs` and `skips` (where the tile has any) hold a strip each.
// Small loops over constants only, or the compiler keeps the sums in memory.
#[inline(always)]
unsafe fn sum_up<S: Simd, const M: usize, const N: usize>(
    simd: S,
    tile: &ConvTile<'_>,
    rows: &[*const f32; M],
    skips: &[*const f32; M],
    outputs: &[*mut f32; M],
) {
    // SAFETY: the caller's promise.
    unsafe {
        let mut sums = [[simd.splat_f32s(0.0); N]; M];
        if let Some(start) = tile.start {
            let start = read::<S, N>(simd, start.as_ptr().cast());
            for m in 0..M {
                for n in 0..N {
                    sums[m][n] = start[n];
                }
            }
        } else {
            for m in 0..M {
                for n in 0..N {
                    sums[m][n] = outputs[m].cast::<S::f32s>().add(n).read_unaligned();
                }
            }
        }
        let mut weights = tile.weights.as_ptr().cast::<S::f32s>();
        for segment in 0..tile.segments {
            let from = segment * tile.pitch;
            for tap in from..from + tile.length {
                let taps = read::<S, N>(simd, weights);
                for m in 0..M {
                    let value = simd.splat_f32s(*rows[m].add(tap));
                    for n in 0..N {
                        sums[m][n] = simd.mul_add_e_f32s(value, taps[n], sums[m][n]);
                    }
                }
                weights = weights.add(N);
            }
        }
        if tile.skip.is_some() {
            for m in 0..M {
                for n in 0..N {
                    let skip = skips[m].cast::<S::f32s>().add(n).read_unaligned();
                    sums[m][n] = simd.add_f32s(sums[m][n], skip);
                }
            }
        }
        if tile.slope != 1.0 {
            let slope = simd.splat_f32s(tile.slope);
            for m in 0..M {
                for n in 0..N {
                    sums[m][n] = simd.max_f32s(sums[m][n], simd.mul_f32s(sums[m][n], slope));
                }
            }
        }
        for m in 0..M {
            for n in 0..N {
                outputs[m].cast::<S::f32s>().add(n).write_unaligned(sums[m][n]);
            }
        }
    }
}

/// `N` vectors from `from`.
///
/// # Safety
/// They must be readable.
// Functions, here and below, where closures would do: only these are certain to be compiled for the
// vectors they are called with.
#[inline(always)]
unsafe fn read<S: Simd, const N: usize>(simd: S, from: *const S::f32s) -> [S::f32s; N] {
    let mut vectors = [simd.splat_f32s(0.0); N];
    for (n, vector) in vectors.iter_mut().enumerate() {
        // SAFETY: the caller's promise.
        *vector = unsafe { from.add(n).read_unaligned() };
    }
    vectors
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
    /// Vectors in the strip, 1 or 2.
    pub vectors: usize,
    /// `[taps, vectors · lanes]`. Channels beyond the layer's hold rubbish: `dy` is read on.
    pub sums: &'a mut [f32],
}

struct Weight<'a, 'b, const M: usize, const N: usize>(&'a mut WeightTile<'b>);

impl<const M: usize, const N: usize> WithSimd for Weight<'_, '_, M, N> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let tile = self.0;
        let strip = N * S::F32_LANES;
        assert!(tile.taps == M && tile.sums.len() == M * strip);
        if tile.rows == 0 || tile.columns == 0 {
            return;
        }
        let last = |side: usize| {
            tile.start[side] + (tile.rows - 1) * tile.row_step[side] + (tile.columns - 1) * tile.column_step[side]
        };
        assert!(last(0) + M <= tile.x.len() && last(1) + strip <= tile.dy.len(), "a tile reads outside its input");
        // SAFETY: the furthest position was checked to leave `M` floats in `x` and a strip in `dy`,
        // steps are not negative, `sums` holds `M` strips.
        unsafe {
            let out = tile.sums.as_mut_ptr().cast::<S::f32s>();
            let mut sums = [[simd.splat_f32s(0.0); N]; M];
            for m in 0..M {
                sums[m] = read::<S, N>(simd, out.add(m * N));
            }
            for row in 0..tile.rows {
                let mut x = tile.x.as_ptr().add(tile.start[0] + row * tile.row_step[0]);
                let mut dy = tile.dy.as_ptr().add(tile.start[1] + row * tile.row_step[1]);
                for column in 0..tile.columns {
                    let gradient = read::<S, N>(simd, dy.cast());
                    for m in 0..M {
                        let value = simd.splat_f32s(*x.add(m));
                        for n in 0..N {
                            sums[m][n] = simd.mul_add_e_f32s(value, gradient[n], sums[m][n]);
                        }
                    }
                    if column + 1 < tile.columns {
                        x = x.add(tile.column_step[0]);
                        dy = dy.add(tile.column_step[1]);
                    }
                }
            }
            for m in 0..M {
                for n in 0..N {
                    out.add(m * N + n).write_unaligned(sums[m][n]);
                }
            }
        }
    }
}

/// A transform in one direction.
pub(super) trait Transform<const N: usize, const P: usize>: Copy {
    /// Transforms a row or a column.
    fn apply<S: Simd>(self, simd: S, values: [S::f32s; N]) -> [S::f32s; P];
}

/// A patch of vectors, and where its transform goes.
pub(super) struct Patch<'a> {
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
pub(super) struct Finish<'a> {
    /// In whole vectors.
    pub start: Option<&'a [f32]>,
    /// Values, where the first one is, and from row to row and column to column.
    pub skip: Option<(&'a [f32], usize, [usize; 2])>,
    pub slope: f32,
    pub rows: usize,
    pub columns: usize,
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
        let padded = patch.channels.next_multiple_of(lanes);
        let span = |start: usize, steps: [usize; 2], counts: [usize; 2]| {
            start + (counts[0] - 1) * steps[0] + (counts[1] - 1) * steps[1]
        };
        assert!(span(patch.start, patch.steps, [N, N]) + padded <= patch.x.len(), "a patch outside its input");
        let (counts, written) = match &patch.finish {
            Some(finish) => {
                let counts = [finish.rows, finish.columns];
                assert!(counts.iter().all(|count| (1..=P).contains(count)));
                assert!(finish.start.is_none_or(|start| start.len() >= padded));
                if let Some((values, start, steps)) = finish.skip {
                    assert!(span(start, steps, counts) + patch.channels <= values.len(), "a patch outside its skip");
                }
                (counts, patch.channels)
            }
            None => ([P, P], padded),
        };
        assert!(
            span(patch.output, patch.output_steps, counts) + written <= patch.out.len,
            "a patch outside its output"
        );
        // SAFETY: the furthest values read and written were checked above.
        unsafe {
            for channel in (0..patch.channels).step_by(lanes) {
                let x = patch.x.as_ptr().add(patch.start + channel);
                let zero = simd.splat_f32s(0.0);
                let mut half = [[zero; P]; N];
                for i in 0..N {
                    let mut row = [zero; N];
                    for j in 0..N {
                        row[j] = x.add(i * patch.steps[0] + j * patch.steps[1]).cast::<S::f32s>().read_unaligned();
                    }
                    half[i] = transform.apply(simd, row);
                }
                let mut whole = [[zero; P]; P];
                for j in 0..P {
                    let mut column = [zero; N];
                    for i in 0..N {
                        column[i] = half[i][j];
                    }
                    let column = transform.apply(simd, column);
                    for i in 0..P {
                        whole[i][j] = column[i];
                    }
                }
                let out = patch.out.start.add(patch.output + channel);
                let Some(finish) = &patch.finish else {
                    for i in 0..P {
                        for j in 0..P {
                            let to = out.add(i * patch.output_steps[0] + j * patch.output_steps[1]);
                            to.cast::<S::f32s>().write_unaligned(whole[i][j]);
                        }
                    }
                    continue;
                };
                let width = lanes.min(patch.channels - channel);
                let slope = simd.splat_f32s(finish.slope);
                let start = match finish.start {
                    Some(start) => start.as_ptr().add(channel).cast::<S::f32s>().read_unaligned(),
                    None => zero,
                };
                for i in 0..finish.rows {
                    for j in 0..finish.columns {
                        let mut value = simd.add_f32s(whole[i][j], start);
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
    }
}

/// The vector at `from`, of which the first `width` floats exist; zero after them.
///
/// # Safety
/// `width` floats must be readable at `from`, at most a vector.
#[inline(always)]
unsafe fn load<S: Simd>(simd: S, from: *const f32, width: usize) -> S::f32s {
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

struct Depthwise<'a, const K: usize>(&'a DepthwiseRow<'a>);

impl<const K: usize> WithSimd for Depthwise<'_, K> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        const T: usize = DEPTHWISE_POSITIONS;
        let row = self.0;
        let lanes = S::F32_LANES;
        assert!(row.weights.len() == K * K * lanes && row.start.len() == lanes && row.width <= lanes);
        let mut done = 0;
        while done < row.columns {
            // The last tile goes over what was done once more, where the row has a tile's width.
            let at = if row.columns >= T { done.min(row.columns - T) } else { done };
            let here = (row.columns - at).min(T);
            let input = row.input + at * row.channels;
            let pixels = here + K - 1;
            assert!(
                input + (K - 1) * row.pitch + (pixels - 1) * row.channels + lanes <= row.x.len(),
                "a tile reads outside its input"
            );
            // SAFETY: the furthest read was checked to leave a vector; pixels beyond `pixels` are not
            // read; writes are checked by `pointer`.
            unsafe {
                let x = row.x.as_ptr().add(input);
                let weights = row.weights.as_ptr().cast::<S::f32s>();
                let start = row.start.as_ptr().cast::<S::f32s>().read_unaligned();
                // A narrow row's sums are in memory, a whole tile's in registers.
                let mut results = [start; T];
                let mut sums = [start; T];
                for ky in 0..K {
                    let line = x.add(ky * row.pitch);
                    for kx in 0..K {
                        let tap = weights.add(ky * K + kx).read_unaligned();
                        let from = line.add(kx * row.channels);
                        if here == T {
                            for m in 0..T {
                                let value = from.add(m * row.channels).cast::<S::f32s>().read_unaligned();
                                sums[m] = simd.mul_add_e_f32s(value, tap, sums[m]);
                            }
                        } else {
                            for (m, sum) in results.iter_mut().enumerate().take(here) {
                                let value = from.add(m * row.channels).cast::<S::f32s>().read_unaligned();
                                *sum = simd.mul_add_e_f32s(value, tap, *sum);
                            }
                        }
                    }
                }
                if here == T {
                    for m in 0..T {
                        results[m] = sums[m];
                    }
                }
                let slope = simd.splat_f32s(row.slope);
                for (m, &sum) in results.iter().enumerate().take(here) {
                    let sum = simd.max_f32s(sum, simd.mul_f32s(sum, slope));
                    let out = row.out.pointer(row.output + (at + m) * row.output_step, row.width);
                    if row.width == lanes {
                        out.cast::<S::f32s>().write_unaligned(sum);
                    } else {
                        out.copy_from_nonoverlapping((&raw const sum).cast(), row.width);
                    }
                }
            }
            done = at + here;
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

struct DepthwiseWeight<'a, 'b, const K: usize>(&'a mut DepthwiseGradientRow<'b>);

impl<const K: usize> WithSimd for DepthwiseWeight<'_, '_, K> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let row = self.0;
        let lanes = S::F32_LANES;
        assert!(row.sums.len() == K * lanes);
        if row.columns == 0 {
            return;
        }
        let last = (row.columns - 1) * row.channels + lanes;
        assert!(
            row.start[0] + (K - 1) * row.channels + last <= row.x.len() && row.start[1] + last <= row.dy.len(),
            "a tile reads outside its input"
        );
        // SAFETY: the furthest reads were checked to leave a vector; `sums` holds `K` vectors.
        unsafe {
            let out = row.sums.as_mut_ptr().cast::<S::f32s>();
            let mut sums = read::<S, K>(simd, out);
            let x = row.x.as_ptr().add(row.start[0]);
            let dy = row.dy.as_ptr().add(row.start[1]);
            for column in 0..row.columns {
                let gradient = dy.add(column * row.channels).cast::<S::f32s>().read_unaligned();
                for (k, sum) in sums.iter_mut().enumerate() {
                    let value = x.add((column + k) * row.channels).cast::<S::f32s>().read_unaligned();
                    *sum = simd.mul_add_e_f32s(value, gradient, *sum);
                }
            }
            for (k, sum) in sums.into_iter().enumerate() {
                out.add(k).write_unaligned(sum);
            }
        }
    }
}
