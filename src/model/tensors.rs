//! A network's layers as tensors of Burn: training everywhere, inference on GPUs.
//!
//! On flex a layer is one of our own operations ([`super::operation`]); on CubeCL's backends it is made
//! of Burn's.

use burn::backend::{Dispatch, DispatchDevice};
use burn::nn::{BatchNorm, LayerNorm};
use burn::tensor::activation::leaky_relu;
use burn::tensor::ops::MaxPoolOptions;
use burn::tensor::{Device, Tensor};

use super::layers::{Layers, RESPONSE_NORM_EPSILON, ResponseNorm, Slope, Unit};
use super::on_gpu;
use super::operation::{Skip, UnitOps};
use gravisight_kernels::{ConvShape, UnitShape};

/// Whether `device` is the CPU, whose kernels are ours.
pub(crate) fn is_cpu(device: &Device) -> bool {
    matches!(device.clone().without_autodiff().as_dispatch(), DispatchDevice::Flex(_))
}

/// Layers run by Burn.
pub(super) struct Tensors;

impl Layers for Tensors {
    type Map = Tensor<4>;

    fn unit(&mut self, x: &Tensor<4>, unit: Unit<'_>, skip: Option<&Tensor<4>>) -> Tensor<4> {
        let device = x.device();
        match unit.norm {
            Some(norm) if device.is_autodiff() && norm.training.is_enabled() => {
                if is_cpu(&device) {
                    normalised(x, &unit, norm, skip)
                } else {
                    let y = on_gpu::normalise(on_gpu::convolve(x, &unit, None), norm);
                    activate(plus(y, skip), unit.slope)
                }
            }
            norm => {
                let unit = match norm {
                    Some(norm) => folded(unit, norm),
                    None => unit,
                };
                if is_cpu(&device) {
                    plain(x, &unit, skip)
                } else {
                    activate(plus(on_gpu::convolve(x, &unit, unit.bias.clone()), skip), unit.slope)
                }
            }
        }
    }

    fn upsample(&mut self, x: &Tensor<4>, factor: usize, add: Option<&Tensor<4>>) -> Tensor<4> {
        let x = x.clone();
        let fine = if is_cpu(&x.device()) {
            Tensor::from_dispatch(<Dispatch as UnitOps>::upsample_map(x.into_dispatch(), factor))
        } else {
            on_gpu::upsample(x, factor)
        };
        plus(fine, add)
    }

    fn max_pool(&mut self, x: &Tensor<4>) -> Tensor<4> {
        let nchw = x.clone().permute([0, 3, 1, 2]);
        let options = MaxPoolOptions::new([3, 3]).with_stride([2, 2]).with_padding([1, 1]);
        burn::tensor::module::max_pool2d(nchw, options).permute([0, 2, 3, 1])
    }

    fn layer_norm(&mut self, x: &Tensor<4>, norm: &LayerNorm, _: f64, slope: Slope) -> Tensor<4> {
        activate(norm.forward(x.clone()), slope)
    }

    fn gelu(&mut self, x: &Tensor<4>) -> Tensor<4> {
        burn::tensor::activation::gelu(x.clone())
    }

    fn response_norm(&mut self, x: &Tensor<4>, norm: &ResponseNorm) -> Tensor<4> {
        let strength = x.clone().powi_scalar(2).sum_dim(1).sum_dim(2).sqrt(); // [b, 1, 1, c]
        let relative = strength.clone() / strength.mean_dim(3).add_scalar(RESPONSE_NORM_EPSILON);
        let [weight, bias] = [&norm.weight, &norm.bias].map(|values| values.val().reshape([1, 1, 1, -1]));
        x.clone() * (relative * weight).add_scalar(1.0) + bias
    }
}

fn plus(x: Tensor<4>, other: Option<&Tensor<4>>) -> Tensor<4> {
    match other {
        Some(other) => x + other.clone(),
        None => x,
    }
}

fn activate(x: Tensor<4>, slope: Slope) -> Tensor<4> {
    match slope {
        Slope::NONE => x,
        Slope::RELU => burn::tensor::activation::relu(x),
        Slope(slope) => leaky_relu(x, f64::from(slope)),
    }
}

/// The unit with its norm's running statistics as part of weights and bias.
fn folded<'a>(unit: Unit<'a>, norm: &BatchNorm) -> Unit<'a> {
    let (weight, bias) = fold(unit.weight, norm);
    Unit { weight, bias: Some(bias), norm: None, ..unit }
}

/// Weights and bias of a convolution followed by a norm with its running statistics.
pub(super) fn fold(weight: Tensor<4>, norm: &BatchNorm) -> (Tensor<4>, Tensor<1>) {
    let device = weight.device();
    let [mean, variance] = [&norm.running_mean, &norm.running_var].map(|state| state.value().to_device(&device));
    let factor = norm.gamma.val() / (variance + norm.epsilon).sqrt();
    let bias = norm.beta.val() - mean * factor.clone();
    (weight * factor.reshape([-1, 1, 1, 1]), bias)
}

/// A skip as the operations take it.
fn skip(map: Option<&Tensor<4>>) -> Skip<Dispatch> {
    map.map_or(Skip::Without, |map| Skip::With(map.clone().into_dispatch()))
}

/// The fixed part of a unit.
pub(super) fn shape(unit: &Unit<'_>) -> UnitShape {
    let [output, input, kernel, _] = unit.weight.dims();
    let input = if unit.depthwise { output } else { input };
    let conv = ConvShape {
        channels: [input, output],
        kernel,
        stride: unit.stride,
        padding: unit.padding,
        depthwise: unit.depthwise,
    };
    UnitShape { conv, slope: unit.slope.0 }
}

/// A unit without norm, on the CPU.
fn plain(x: &Tensor<4>, unit: &Unit<'_>, skip: Option<&Tensor<4>>) -> Tensor<4> {
    let shape = shape(unit);
    let bias = unit.bias.clone().unwrap_or_else(|| Tensor::zeros([shape.conv.channels[1]], &x.device()));
    Tensor::from_dispatch(<Dispatch as UnitOps>::unit(
        x.clone().into_dispatch(),
        unit.weight.clone().into_dispatch(),
        bias.into_dispatch(),
        self::skip(skip),
        shape,
    ))
}

/// A unit whose norm is trained, on the CPU; updates the norm's running statistics.
fn normalised(x: &Tensor<4>, unit: &Unit<'_>, norm: &BatchNorm, skip: Option<&Tensor<4>>) -> Tensor<4> {
    let (output, mean, variance) = <Dispatch as UnitOps>::norm_unit(
        x.clone().into_dispatch(),
        unit.weight.clone().into_dispatch(),
        norm.beta.val().into_dispatch(),
        norm.gamma.val().into_dispatch(),
        self::skip(skip),
        shape(unit),
        norm.epsilon as f32,
    );
    remember(norm, [mean, variance].map(Tensor::from_dispatch));
    Tensor::from_dispatch(output)
}

/// Moves a norm's running mean and variance towards those of a batch.
pub(super) fn remember(norm: &BatchNorm, found: [Tensor<1>; 2]) {
    for (state, found) in [&norm.running_mean, &norm.running_var].into_iter().zip(found) {
        let found = found.detach();
        let old = state.value_sync().to_device(&found.device());
        state.update((old.mul_scalar(1.0 - norm.momentum) + found.mul_scalar(norm.momentum)).detach());
    }
}
