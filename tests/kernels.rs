//! The kernels against Burn's own operations (flex) on random shapes, on every instruction set of this
//! machine: `cargo test --release --test kernels`.

use burn::tensor::module::conv2d;
use burn::tensor::ops::ConvOptions;
use burn::tensor::{Device, Tensor, TensorData};
use gravisight::kernels::{
    ConvShape, Extent, Map, NormInput, UnitShape, Vectors, unit_backward, unit_forward, upsample, upsample_backward,
};
use gravisight::kernels::{Convolution, MapMut, SLACK};
use proptest::prelude::*;

/// Largest difference allowed, as a share of the largest value expected.
const TOLERANCE: f32 = 1e-4;

/// Reproducible numbers in [-1, 1).
fn values(seed: u64, count: usize) -> Vec<f32> {
    (0..count as u64)
        .map(|index| {
            let mut z = (seed ^ 0x5bf0_3635).wrapping_add((index + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((z ^ (z >> 31)) >> 40) as f32 / (1 << 23) as f32 - 1.0
        })
        .collect()
}

fn tensor<const D: usize>(values: &[f32], shape: [usize; D], device: &Device) -> Tensor<D> {
    Tensor::from_data(TensorData::new(values.to_vec(), shape), device)
}

fn read<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().iter::<f32>().collect()
}

/// Refuses values further apart than [`TOLERANCE`] of the largest expected, or of `least` if that is
/// more (where sums of such terms cancel).
fn close(found: &[f32], expected: &[f32], least: f32, what: &str) -> Result<(), TestCaseError> {
    prop_assert_eq!(found.len(), expected.len(), "{}", what);
    let largest = expected.iter().fold(least, |largest, value| largest.max(value.abs()));
    for (index, (found, expected)) in found.iter().zip(expected).enumerate() {
        let off = (found - expected).abs() / largest;
        prop_assert!(off <= TOLERANCE, "{}[{}]: {} is not {} ({:e} off)", what, index, found, expected, off);
    }
    Ok(())
}

/// A convolution and the map it takes.
#[derive(Debug, Clone)]
struct Case {
    shape: ConvShape,
    input: Extent,
    slope: f32,
    seed: u64,
}

fn dense() -> impl Strategy<Value = Case> {
    let channels = || prop_oneof![Just(1_usize), Just(3), 2..40_usize, Just(64)];
    let side = || 1..33_usize;
    (
        prop_oneof![Just(1_usize), Just(3), Just(5), Just(7)],
        1..3_usize,
        0..7_usize,
        channels(),
        channels(),
        side(),
        side(),
    )
        .prop_flat_map(|(kernel, stride, padding, input, output, height, width)| {
            let shape = ConvShape {
                channels: [input, output],
                kernel,
                stride,
                padding: padding.min(kernel - 1),
                depthwise: false,
            };
            let least = kernel.saturating_sub(2 * shape.padding).max(1);
            let batch = prop_oneof![Just(1_usize), Just(8), 2..4_usize];
            (batch, prop_oneof![Just(1.0_f32), Just(0.0), Just(0.01)], any::<u64>()).prop_map(
                move |(batch, slope, seed)| {
                    let input = Extent::new([batch, height.max(least), width.max(least), input]);
                    Case { shape, input, slope, seed }
                },
            )
        })
}

/// Whole layers as PEN has them: tiles of every size, weights in several blocks.
fn wide() -> impl Strategy<Value = Case> {
    let channels = || prop_oneof![Just(32_usize), Just(96), Just(128), Just(200)];
    (prop_oneof![Just(3_usize), Just(7)], channels(), channels(), 5..30_usize, 5..30_usize, any::<u64>()).prop_map(
        |(kernel, input, output, height, width, seed)| Case {
            shape: ConvShape { channels: [input, output], kernel, stride: 1, padding: kernel / 2, depthwise: false },
            input: Extent::new([1, height, width, input]),
            slope: 0.01,
            seed,
        },
    )
}

fn depthwise() -> impl Strategy<Value = Case> {
    (prop_oneof![Just(3_usize), Just(5), Just(7)], 1..40_usize, 1..20_usize, 1..20_usize, 1..4_usize, any::<u64>())
        .prop_map(|(kernel, channels, height, width, batch, seed)| Case {
            shape: ConvShape { channels: [channels; 2], kernel, stride: 1, padding: kernel / 2, depthwise: true },
            input: Extent::new([batch, height, width, channels]),
            slope: 0.0,
            seed,
        })
}

/// Burn's own result and gradients for a unit: output, then gradients of x, weights, shift, scale, skip.
/// Takes gradients away from outputs so near zero that rounding decides on which side.
fn reference(case: &Case, data: &mut Data, with_norm: bool) -> [Vec<f32>; 6] {
    let device = Device::flex().autodiff();
    let Case { shape, input, slope, .. } = case;
    let output = shape.output(*input);
    let dims = |extent: &Extent| [extent.batch, extent.height, extent.width, extent.channels];
    let x = tensor(&data.x, dims(input), &device).require_grad();
    let weights = tensor(&data.weights, shape.weights(), &device).require_grad();
    let shift = tensor(&data.shift, [shape.channels[1]], &device).require_grad();
    let scale = tensor(&data.scale, [shape.channels[1]], &device).require_grad();
    let skip = tensor(&data.skip, dims(&output), &device).require_grad();
    let groups = if shape.depthwise { shape.channels[0] } else { 1 };
    let options = ConvOptions::new([shape.stride; 2], [shape.padding; 2], [1, 1], groups);
    let nchw = x.clone().permute([0, 3, 1, 2]);
    let bias = (!with_norm).then(|| shift.clone());
    let y = conv2d(nchw, weights.clone(), bias, options).permute([0, 2, 3, 1]);
    let y = if with_norm {
        let mean = y.clone().mean_dims(&[0, 1, 2]);
        let centred = y - mean;
        let variance = centred.clone().powi_scalar(2).mean_dims(&[0, 1, 2]);
        let wide = |tensor: Tensor<1>| tensor.reshape([1, 1, 1, -1]);
        centred / (variance + 1e-5).sqrt() * wide(scale.clone()) + wide(shift.clone())
    } else {
        y
    };
    let y = if shape.depthwise { y } else { y + skip.clone() };
    let before = read(y.clone());
    let z = y.clone().clamp_min(0.0) + y.clamp_max(0.0).mul_scalar(*slope);
    let near = 1e-3 * before.iter().fold(0.0_f32, |largest, value| largest.max(value.abs()));
    data.dz.iter_mut().zip(&before).filter(|(_, value)| value.abs() <= near).for_each(|(dz, _)| *dz = 0.0);
    let dz = tensor(&data.dz, dims(&output), &device);
    let gradients = (z.clone() * dz).sum().backward();
    let of = |gradient: Option<Vec<f32>>| gradient.unwrap_or_default();
    [
        read(z),
        of(x.grad(&gradients).map(read)),
        of(weights.grad(&gradients).map(read)),
        of(shift.grad(&gradients).map(read)),
        of(scale.grad(&gradients).map(read)),
        of(skip.grad(&gradients).map(read)),
    ]
}

struct Data {
    x: Vec<f32>,
    weights: Vec<f32>,
    shift: Vec<f32>,
    scale: Vec<f32>,
    skip: Vec<f32>,
    dz: Vec<f32>,
}

impl Data {
    fn new(case: &Case) -> Self {
        let output = case.shape.output(case.input).len();
        let channels = case.shape.channels[1];
        let weights: usize = case.shape.weights().iter().product();
        Self {
            x: values(case.seed, case.input.len()),
            weights: values(case.seed ^ 1, weights),
            shift: values(case.seed ^ 2, channels),
            scale: values(case.seed ^ 3, channels).iter().map(|scale| 1.5 + scale).collect(),
            skip: values(case.seed ^ 4, output),
            dz: values(case.seed ^ 5, output),
        }
    }
}

fn check(case: &Case, with_norm: bool) -> Result<(), TestCaseError> {
    let mut data = Data::new(case);
    let [z, dx, dw, dshift, dscale, dskip] = reference(case, &mut data, with_norm);
    let unit = UnitShape { conv: case.shape, slope: case.slope };
    let output = case.shape.output(case.input);
    // A norm takes mean and slope out of its gradient: what is left of few taps may be rounding.
    let least = if with_norm { 1.0 } else { 0.1 };
    for vectors in Vectors::all() {
        let x = Map::new(case.input, &data.x);
        let skip = (!case.shape.depthwise).then(|| Map::new(output, &data.skip));
        let norm = with_norm.then_some(NormInput { scale: &data.scale, epsilon: 1e-5 });
        let (found, saved) = unit_forward(vectors, &unit, &data.weights, &data.shift, norm, x, skip);
        close(&found, &z, 1e-3, "output")?;
        let wanted = [true, skip.is_some()];
        let gradients = unit_backward(vectors, &unit, &data.weights, norm, &saved, x, &found, &data.dz, wanted);
        close(&gradients.x.unwrap_or_default(), &dx, least, "gradient of x")?;
        close(&gradients.weights, &dw, least, "gradient of the weights")?;
        close(&gradients.shift, &dshift, least, "gradient of the shift")?;
        close(&gradients.scale, &dscale, least, "gradient of the scale")?;
        close(&gradients.skip.unwrap_or_default(), &dskip, least, "gradient of the skip")?;
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 150, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_convolution_and_its_gradients_are_flexs(case in dense()) {
        check(&case, false)?;
    }

    #[test]
    fn a_depthwise_convolution_and_its_gradients_are_flexs(case in depthwise()) {
        check(&case, false)?;
    }

    /// The same layer in maps with halos, as inference runs it.
    #[test]
    fn halos_change_nothing(case in dense(), more in 0..3_usize) {
        let mut data = Data::new(&case);
        let [z, ..] = reference(&case, &mut data, false);
        let output = case.shape.output(case.input);
        for vectors in Vectors::all() {
            let conv = Convolution::new(vectors, case.shape, &data.weights, Some(&data.shift), &output);
            let padded = |extent: Extent, values: &[f32], halo: usize| {
                let to = extent.with_halo(halo);
                let mut buffer = vec![f32::NAN; to.len() + SLACK];
                Map::new(extent, values).pad_into(halo, &mut buffer);
                (to, buffer)
            };
            let (input, x) = padded(case.input, &data.x, conv.halo() + more);
            let (skip_extent, skip) = padded(output, &data.skip, more);
            let to = output.with_halo(2);
            let mut out = vec![7.0; to.len()];
            conv.run(Map::new(input, &x), Some(Map::new(skip_extent, &skip)), case.slope, MapMut::new(to, &mut out));
            let found = Map::new(to, &out);
            let rows: Vec<f32> = (0..output.batch * output.height)
                .flat_map(|row| found.row(row / output.height, row % output.height).to_vec())
                .collect();
            close(&rows, &z, 1e-3, "output")?;
            prop_assert_eq!(out.iter().filter(|&&value| value == 7.0).count(), to.len() - output.len(), "halo touched");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn wide_layers_too(case in wide()) {
        check(&case, false)?;
    }

    #[test]
    fn batch_norm_and_its_gradients_are_burns(case in prop_oneof![dense(), depthwise()]) {
        // One value a channel has no variance, and its gradient is only rounding.
        prop_assume!(case.shape.output(case.input).len() >= 8 * case.shape.channels[1]);
        check(&case, true)?;
    }

    #[test]
    fn upsampling_is_burns(factor in 1..9_usize, height in 1..9_usize, width in 1..9_usize, channels in 1..40_usize, seed: u64) {
        use burn::tensor::ops::{InterpolateMode, InterpolateOptions};
        let device = Device::flex().autodiff();
        let coarse = Extent::new([2, height, width, channels]);
        let fine = Extent::new([2, height * factor, width * factor, channels]);
        let (x, dy) = (values(seed, coarse.len()), values(seed ^ 1, fine.len()));
        let tensor_x = tensor(&x, [2, height, width, channels], &device).require_grad();
        let options = InterpolateOptions::new(InterpolateMode::Bilinear).with_align_corners(false).with_output_size([fine.height, fine.width]);
        let y = burn::tensor::module::interpolate(tensor_x.clone().permute([0, 3, 1, 2]), options).permute([0, 2, 3, 1]);
        let weight = tensor(&dy, [2, fine.height, fine.width, channels], &device);
        let gradients = (y.clone() * weight).sum().backward();
        for vectors in Vectors::all() {
            let mut out = vec![0.0; fine.len()];
            upsample(vectors, Map::new(coarse, &x), factor, None, MapMut::new(fine, &mut out));
            close(&out, &read(y.clone()), 1e-3, "upsampled")?;
            let mut dx = vec![0.0; coarse.len()];
            upsample_backward(vectors, Map::new(fine, &dy), factor, MapMut::new(coarse, &mut dx));
            close(&dx, &tensor_x.grad(&gradients).map(read).unwrap_or_default(), 1e-3, "gradient")?;
        }
    }
}
