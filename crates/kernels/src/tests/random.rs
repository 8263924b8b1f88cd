//! Random shapes on every instruction set of this machine.

use burn::tensor::Device;
use proptest::prelude::*;

use super::{Case, Data, check, close, read, reference, tensor, values};
use crate::{ConvShape, Convolution, Extent, Map, MapMut, SLACK, Vectors, upsample, upsample_backward};

/// As proptest wants it.
fn holds(result: Result<(), String>) -> Result<(), TestCaseError> {
    result.map_err(TestCaseError::fail)
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

proptest! {
    #![proptest_config(ProptestConfig { cases: 150, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_convolution_and_its_gradients_are_flexs(case in dense()) {
        holds(check(&case, false))?;
    }

    #[test]
    fn a_depthwise_convolution_and_its_gradients_are_flexs(case in depthwise()) {
        holds(check(&case, false))?;
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
            let mut out = vec![f32::INFINITY; to.len()];
            conv.run(Map::new(input, &x), Some(Map::new(skip_extent, &skip)), case.slope, MapMut::new(to, &mut out));
            let found = Map::new(to, &out);
            let rows: Vec<f32> = (0..output.batch * output.height)
                .flat_map(|row| found.row(row / output.height, row % output.height).to_vec())
                .collect();
            holds(close(&rows, &z, 1e-3, "output"))?;
            prop_assert_eq!(out.iter().filter(|value| value.is_infinite()).count(), to.len() - output.len(), "halo touched");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn wide_layers_too(case in wide()) {
        holds(check(&case, false))?;
    }

    #[test]
    fn batch_norm_and_its_gradients_are_burns(case in prop_oneof![dense(), depthwise()]) {
        // One value a channel has no variance, and its gradient is only rounding.
        prop_assume!(case.shape.output(case.input).len() >= 8 * case.shape.channels[1]);
        holds(check(&case, true))?;
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
            holds(close(&out, &read(y.clone()), 1e-3, "upsampled"))?;
            let mut dx = vec![0.0; coarse.len()];
            upsample_backward(vectors, Map::new(fine, &dy), factor, MapMut::new(coarse, &mut dx));
            holds(close(&dx, &tensor_x.grad(&gradients).map(read).unwrap_or_default(), 1e-3, "gradient"))?;
        }
    }
}
