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

use pulp::{Scalar, Simd, WithSimd};

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
        #[cfg(feature = "relaxed-simd")]
        use pulp::wasm::RelaxedSimd as Set;
        #[cfg(not(feature = "relaxed-simd"))]
        use pulp::wasm::Simd128 as Set;
        // SAFETY: a module with instructions that the browser does not have would not have been loaded.
        let set = unsafe { Set::new_unchecked() };
        Simd::vectorize(set, op)
    }
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
        // V8 gives wasm fewer registers than the machine has.
        let registers = if cfg!(target_arch = "wasm32") { 13 } else { self.0.dispatch(Registers) };
        match (registers, size > self.lanes()) {
            (32.., _) => MAX_POSITIONS,
            (16.., false) => 12,
            (16.., true) => 6,
            (_, false) => 8,
            _ => 5,
        }
    }

    /// Runs `work`, compiled for these vectors (see [`vectorised`]).
    pub(super) fn run<W: WithSimd>(self, work: W) -> W::Output {
        self.0.dispatch(work)
    }

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

/// The end of what is read or written from `start` on: the last of so many steps of so many floats, and `len`
/// floats there.
fn end(start: usize, steps: &[[usize; 2]], len: usize) -> usize {
    let far = steps.iter().map(|[count, step]| count.saturating_sub(1).saturating_mul(*step));
    far.fold(start.saturating_add(len), usize::saturating_add)
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
            let from = segment * row.pitch;
            for tap in from..from + row.length {
                let taps: [S::f32s; N] = read(simd, weights);
                let half_taps: [H::f32s; K] = read(half, weights.add(whole));
                for m in 0..M {
                    let value = *rows[m].add(tap);
                    for n in 0..N {
                        sums[m][n] = simd.mul_add_e_f32s(simd.splat_f32s(value), taps[n], sums[m][n]);
                    }
                    for k in 0..K {
                        halves[m][k] = half.mul_add_e_f32s(half.splat_f32s(value), half_taps[k], halves[m][k]);
                    }
                }
                weights = weights.add(whole + K * H::F32_LANES);
            }
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

/// `N` vectors from `from`.
///
/// # Safety
/// They must be readable.
// Functions, here and below, where closures would do: only these are certain to be compiled for the
// vectors they are called with.
#[inline(always)]
unsafe fn read<S: Simd, const N: usize>(simd: S, from: *const f32) -> [S::f32s; N] {
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
unsafe fn write<V: Copy, const N: usize>(to: *mut f32, vectors: [V; N]) {
    for n in 0..N {
        // SAFETY: the caller's promise.
        unsafe { to.cast::<V>().add(n).write_unaligned(vectors[n]) };
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
                            sums[m][n] = simd.mul_add_e_f32s(simd.splat_f32s(value), gradient[n], sums[m][n]);
                        }
                        for k in 0..K {
                            halves[m][k] = half.mul_add_e_f32s(half.splat_f32s(value), half_gradient[k], halves[m][k]);
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
        for channel in (0..patch.channels).step_by(lanes) {
            macro_rules! rows {
                ($($row:literal)*) => {
                    $(if $row < counts[0] {
                        // SAFETY: the furthest values read and written were checked above.
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
/// As [`TransformPatch`] has checked; `ROW` and `columns` are at most as many as it says.
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
            let out = row.sums.as_mut_ptr();
            let mut sums: [S::f32s; K] = read(simd, out);
            let x = row.x.as_ptr().add(row.start[0]);
            let dy = row.dy.as_ptr().add(row.start[1]);
            for column in 0..row.columns {
                let gradient = dy.add(column * row.channels).cast::<S::f32s>().read_unaligned();
                for (k, sum) in sums.iter_mut().enumerate() {
                    let value = x.add((column + k) * row.channels).cast::<S::f32s>().read_unaligned();
                    *sum = simd.mul_add_e_f32s(value, gradient, *sum);
                }
            }
            write(out, sums);
        }
    }
}
