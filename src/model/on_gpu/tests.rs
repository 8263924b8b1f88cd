//! Our convolutions on a GPU against Burn's on the CPU; scripts/wgpu runs these.

use std::sync::LazyLock;

use burn::nn::Initializer;
use burn::tensor::module::conv2d;
use burn::tensor::ops::ConvOptions;
use burn::tensor::{Device, Tensor, TensorData};

use super::super::layers::{Slope, Unit};
use super::convolve;

/// Largest difference, as a fraction of the largest value: sums of f32 in another order.
const RELATIVE: f32 = 1e-5;

/// A process opens it once.
static GPU: LazyLock<Device> = LazyLock::new(|| Device::wgpu_options().init().expect("no adapter"));

/// A map, its gradient by what went in, its gradient by the weights.
type Found = [Vec<f32>; 3];

fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().iter::<f32>().collect()
}

/// On a GPU by ours, on the CPU by Burn's.
fn found(device: &Device, x: &TensorData, weights: &TensorData, stride: usize) -> Found {
    let device = device.clone().autodiff();
    let [x, weights] = [x, weights].map(|data| Tensor::<4>::from_data(data.clone(), &device).require_grad());
    let padding = weights.dims()[2] / 2;
    let y = if super::super::tensors::is_cpu(&device) {
        let options = ConvOptions::new([stride; 2], [padding; 2], [1, 1], 1);
        conv2d(x.clone().permute([0, 3, 1, 2]), weights.clone(), None, options).permute([0, 2, 3, 1])
    } else {
        let (slope, weight) = (Slope::NONE, weights.clone());
        convolve(&x, &Unit { weight, bias: None, norm: None, stride, padding, depthwise: false, slope }, None)
    };
    // Each output weighs differently, so that none is mistaken for another.
    let [a, b, c, d] = y.dims();
    let weight: Vec<f32> = (0..a * b * c * d).map(|index| (index as f32 * 0.7).sin()).collect();
    let weight = Tensor::from_data(TensorData::new(weight, [a, b, c, d]), &device);
    let gradients = (y.clone() * weight).sum().backward();
    [values(y), values(x.grad(&gradients).unwrap()), values(weights.grad(&gradients).unwrap())]
}

fn random(shape: [usize; 4], seed: u64) -> TensorData {
    let device = Device::flex();
    device.seed(seed);
    Initializer::Normal { mean: 0.0, std: 1.0 }.init::<4, _>(shape, &device).val().into_data()
}

/// A convolution of `x` = `[batch, height, width, channels]` to `output` channels.
fn compare(shape: [usize; 4], output: usize, kernel: usize, stride: usize) {
    let x = random(shape, 1);
    let weights = random([output, shape[3], kernel, kernel], 2);
    let [ours, expected] = [&*GPU, &Device::flex()].map(|device| found(device, &x, &weights, stride));
    for (what, (ours, expected)) in ["map", "by input", "by weights"].iter().zip(ours.iter().zip(&expected)) {
        assert_eq!(ours.len(), expected.len());
        let largest = expected.iter().fold(0.0_f32, |most, value| most.max(value.abs()));
        let off = ours.iter().zip(expected).fold(0.0_f32, |most, (a, b)| most.max((a - b).abs()));
        let name = format!("{shape:?} to {output}, kernel {kernel}, stride {stride}: {what}");
        assert!(off <= RELATIVE * largest, "{name}: off by {off} of {largest}");
    }
}

#[test]
fn kernels_and_strides_on_even_and_odd_maps() {
    for kernel in [1, 3, 5, 7] {
        for stride in [1, 2] {
            compare([2, 12, 16, 8], 12, kernel, stride);
            compare([3, 11, 9, 3], 5, kernel, stride);
        }
    }
}

#[test]
fn a_map_whose_gathered_pixels_take_several_parts() {
    // 3,136 rows of 7 · 7 · 256 numbers: 157 MB.
    compare([1, 56, 56, 256], 4, 7, 1);
    // The other way round, the gradient by the input is gathered in parts.
    compare([1, 56, 56, 4], 256, 7, 1);
}
