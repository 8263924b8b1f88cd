//! Every limit that stands before unsafe code.

use super::*;

/// Values of each slice; every row below just fits.
const LEN: usize = 4096;
/// A step whose double is nothing in arithmetic that wraps.
const WRAPS: usize = usize::MAX / 2 + 1;

fn depthwise(change: impl FnOnce(&mut DepthwiseRow<'_>)) {
    let vectors = Vectors::best();
    let lanes = vectors.lanes();
    let (x, weights, start, mut out) = (vec![0.0; LEN], vec![0.0; 9 * lanes], vec![0.0; lanes], vec![0.0; LEN]);
    let mut row = DepthwiseRow {
        x: &x,
        // Two rows of 100 values, then three pixels of 10 and a vector.
        input: LEN - 2 * 100 - (2 + 3) * 10 - lanes,
        pitch: 100,
        channels: 10,
        kernel: 3,
        weights: &weights,
        width: 1,
        start: &start,
        slope: 1.0,
        columns: 4,
        out: Shared::new(&mut out),
        output: LEN - 31,
        output_step: 10,
    };
    change(&mut row);
    vectors.depthwise(&row);
}

fn depthwise_gradient(change: impl FnOnce(&mut DepthwiseGradientRow<'_>)) {
    let vectors = Vectors::best();
    let lanes = vectors.lanes();
    let (x, dy, mut sums) = (vec![0.0; LEN], vec![0.0; LEN], vec![0.0; 3 * lanes]);
    let start = [LEN - 5 * 10 - lanes, LEN - 3 * 10 - lanes];
    let mut row = DepthwiseGradientRow { x: &x, dy: &dy, start, channels: 10, columns: 4, kernel: 3, sums: &mut sums };
    change(&mut row);
    vectors.depthwise_gradient(&mut row);
}

#[derive(Clone, Copy)]
struct Same;

impl Transform<2, 2> for Same {
    fn apply<S: Simd>(self, _: S, values: [S::f32s; 2]) -> [S::f32s; 2] {
        values
    }
}

fn transform(change: impl FnOnce(&mut Patch<'_>)) {
    let vectors = Vectors::best();
    let lanes = vectors.lanes();
    let (x, mut out) = (vec![0.0; LEN], vec![0.0; LEN]);
    let mut patch = Patch {
        x: &x,
        start: LEN - 110 - lanes,
        steps: [100, 10],
        channels: lanes,
        out: Shared::new(&mut out),
        output: LEN - 110 - lanes,
        output_steps: [100, 10],
        finish: None,
    };
    change(&mut patch);
    vectors.transform::<2, 2, _>(Same, &patch);
}

fn convolve(change: impl FnOnce(&mut ConvRow<'_>)) {
    let vectors = Vectors::best();
    let size = vectors.strips()[0];
    let (x, weights, mut out) = (vec![0.0; LEN], vec![0.0; 3 * 10 * size], vec![0.0; LEN]);
    let zeros = vec![0.0; size];
    let mut row = ConvRow {
        positions: 5,
        x: &x,
        input: [LEN - 4 * 7 - 2 * 100 - 10, 7],
        segments: 3,
        length: 10,
        pitch: 100,
        weights: &weights,
        size,
        width: 1,
        start: Some(&zeros),
        skip: None,
        slope: 1.0,
        out: Shared::new(&mut out),
        output: [LEN - 4 * 7 - 1, 7],
    };
    change(&mut row);
    vectors.convolve(&row);
}

/// Whether `run` refuses, for the reason named.
fn refuses(what: &str, run: impl FnOnce() + std::panic::UnwindSafe) {
    let panic = std::panic::catch_unwind(run).expect_err("it was not refused");
    let text = panic.downcast_ref::<&str>().map(|text| text.to_string());
    let text = text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
    assert!(text.contains(what), "{text} instead of {what}");
}

#[test]
fn what_just_fits_runs() {
    depthwise(|_| {});
    depthwise_gradient(|_| {});
    transform(|_| {});
    convolve(|_| {});
}

#[test]
fn a_tile_one_float_too_far_is_refused() {
    refuses("outside its input", || depthwise(|row| row.input += 1));
    refuses("outside its output", || depthwise(|row| row.output += 1));
    refuses("outside its input", || depthwise_gradient(|row| row.start[0] += 1));
    refuses("outside its input", || depthwise_gradient(|row| row.start[1] += 1));
    refuses("outside its input", || transform(|patch| patch.start += 1));
    refuses("outside its output", || transform(|patch| patch.output += 1));
    refuses("outside its input", || convolve(|row| row.input[0] += 1));
    refuses("outside its output", || convolve(|row| row.output[0] += 1));
}

#[test]
fn lengths_that_overflow_are_refused() {
    refuses("outside its input", || depthwise(|row| row.pitch = WRAPS));
    refuses("outside its input", || depthwise(|row| row.input = usize::MAX));
    refuses("outside its input", || depthwise(|row| row.columns = usize::MAX));
    refuses("outside its output", || depthwise(|row| row.output_step = usize::MAX));
    refuses("outside its input", || depthwise_gradient(|row| row.channels = usize::MAX / 3));
    refuses("outside its input", || depthwise_gradient(|row| row.start[1] = usize::MAX));
    refuses("outside its input", || transform(|patch| patch.steps = [WRAPS, WRAPS]));
    refuses("outside its input", || transform(|patch| patch.channels = usize::MAX));
    refuses("outside its output", || transform(|patch| patch.output_steps = [WRAPS, WRAPS]));
    refuses("outside its input", || convolve(|row| row.pitch = WRAPS));
    refuses("outside its output", || convolve(|row| row.output[1] = usize::MAX / 2));
}
