//! Layers on CubeCL's devices: WebGPU, Vulkan, Metal, DX12.

mod convolution;
mod gather;
#[cfg(all(test, not(target_arch = "wasm32")))]
mod tests;

use burn::backend::Dispatch;
use burn::nn::BatchNorm;
use burn::tensor::module::conv2d;
use burn::tensor::ops::ConvOptions;
use burn::tensor::{Device, Tensor, TensorData};

use self::convolution::{Convolution, ConvolutionOps};
use super::layers::Unit;
use super::tensors::remember;

/// A unit's convolution alone, plus `bias`.
pub(super) fn convolve(x: &Tensor<4>, unit: &Unit<'_>, bias: Option<Tensor<1>>) -> Tensor<4> {
    let [output, _, kernel, _] = unit.weight.dims();
    if unit.depthwise {
        let options = ConvOptions::new([unit.stride; 2], [unit.padding; 2], [1, 1], output);
        return conv2d(x.clone().permute([0, 3, 1, 2]), unit.weight.clone(), bias, options).permute([0, 2, 3, 1]);
    }
    let convolution = Convolution { kernel, stride: unit.stride, padding: unit.padding };
    let (x, weights) = (x.clone().into_dispatch(), unit.weight.clone().into_dispatch());
    let y = Tensor::from_dispatch(<Dispatch as ConvolutionOps>::convolve(x, weights, convolution));
    match bias {
        Some(bias) => y + bias.reshape([1, 1, 1, -1]),
        None => y,
    }
}

/// Batch norm by the batch's own statistics; updates the running ones. Burn's takes the channels first, which here would copy the map
/// twice.
pub(super) fn normalise(x: Tensor<4>, norm: &BatchNorm) -> Tensor<4> {
    let shape = x.dims();
    let x = x.reshape([-1, shape[3] as i64]);
    let mean = x.clone().mean_dim(0);
    let centred = x - mean.clone();
    let variance = centred.clone().square().mean_dim(0);
    remember(norm, [mean, variance.clone()].map(|found| found.reshape([-1])));
    let scale = norm.gamma.val().reshape([1, -1]) / variance.add_scalar(norm.epsilon).sqrt();
    (centred * scale + norm.beta.val().reshape([1, -1])).reshape(shape)
}

/// Bilinear upsampling as two products with fixed matrices instead of Burn's `interpolate`, whose backward pass is missing on
/// the GPU backends of 0.22.
pub(super) fn upsample(x: Tensor<4>, factor: usize) -> Tensor<4> {
    let [batch, height, width, channels] = x.dims();
    let device = x.device();
    let (rows, columns) = (interpolation(height, factor, &device), interpolation(width, factor, &device));
    let x = x.reshape([batch, height, width * channels]); // [b, h, w·c]
    let x = rows.unsqueeze::<3>().expand([batch as i64, -1, -1]).matmul(x); // [b, H, w·c]
    let x = x.reshape([batch * height * factor, width, channels]); // [b·H, w, c]
    let x = columns.unsqueeze::<3>().expand([(batch * height * factor) as i64, -1, -1]).matmul(x); // [b·H, W, c]
    x.reshape([batch, height * factor, width * factor, channels])
}

/// Weights of bilinear interpolation from `count` cells to `count·factor`: `[count·factor, count]`.
fn interpolation(count: usize, factor: usize, device: &Device) -> Tensor<2> {
    let fine = count * factor;
    let mut weights = vec![0.0_f32; count * fine];
    for to in 0..fine {
        let from = ((to as f32 + 0.5) / factor as f32 - 0.5).max(0.0);
        let low = from as usize;
        let fraction = from - low as f32;
        weights[to * count + low] += 1.0 - fraction;
        weights[to * count + (low + 1).min(count - 1)] += fraction;
    }
    Tensor::from_data(TensorData::new(weights, [fine, count]), device)
}
