//! What networks are made of, and the blocks that backbones and heads share.
//!
//! A network says once which layers follow each other ([`Layers`]); Burn runs them for training and on
//! GPUs ([`super::tensors`]), the CPU's plan for inference ([`super::plan`]). Maps are channels-last.

use burn::module::{Module, Param};
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::nn::{BatchNorm, BatchNormConfig, Initializer, LayerNorm, PaddingConfig2d};
use burn::tensor::{Device, Tensor};

/// Kaiming normal for ReLU, by fan-out: the initialisation ResNet was published with.
const KAIMING: Initializer = Initializer::KaimingNormal { gain: std::f64::consts::SQRT_2, fan_out_only: true };

/// Added to the mean strength of the channels in a global response norm.
pub(super) const RESPONSE_NORM_EPSILON: f32 = 1e-6;

/// Activation: negative values are multiplied by `self.0`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Slope(pub f32);

impl Slope {
    /// No activation.
    pub(super) const NONE: Self = Self(1.0);
    /// ReLU.
    pub(super) const RELU: Self = Self(0.0);
}

/// A convolution with what follows it: norm or bias, then the activation.
pub(super) struct Unit<'a> {
    /// `[output channels, input channels of a group, kernel, kernel]`.
    pub weight: Tensor<4>,
    /// `[output channels]`.
    pub bias: Option<Tensor<1>>,
    /// Batch norm; then there is no bias.
    pub norm: Option<&'a BatchNorm>,
    /// Step between output positions, input pixels.
    pub stride: usize,
    /// Zeros around the input.
    pub padding: usize,
    /// Each channel by itself.
    pub depthwise: bool,
    /// Activation.
    pub slope: Slope,
}

impl<'a> Unit<'a> {
    /// A square convolution that keeps the size at stride 1.
    pub(super) fn new(conv: &Conv2d, norm: Option<&'a BatchNorm>, slope: Slope) -> Self {
        Self {
            weight: conv.weight.val(),
            bias: conv.bias.as_ref().map(|bias| bias.val()),
            norm,
            stride: conv.stride[0],
            padding: conv.kernel_size[0] / 2,
            depthwise: conv.groups > 1,
            slope,
        }
    }
}

/// Who runs a network's layers. Maps are `[batch, height, width, channels]`.
pub(super) trait Layers {
    /// A map, or what stands for it.
    type Map: Clone;

    /// Convolution, norm or bias, plus `skip`, activation.
    fn unit(&mut self, x: &Self::Map, unit: Unit<'_>, skip: Option<&Self::Map>) -> Self::Map;

    /// Bilinear upsampling by a whole `factor` (pixel centres, edges clamped; PyTorch's `align_corners =
    /// false`), plus `add`.
    fn upsample(&mut self, x: &Self::Map, factor: usize, add: Option<&Self::Map>) -> Self::Map;

    /// Maximum over 3×3 windows of stride 2, padded by 1.
    fn max_pool(&mut self, x: &Self::Map) -> Self::Map;

    /// Layer norm over channels (its `epsilon` is that which `norm` was made with), activation.
    fn layer_norm(&mut self, x: &Self::Map, norm: &LayerNorm, epsilon: f64, slope: Slope) -> Self::Map;

    /// x·Φ(x), by the error function.
    fn gelu(&mut self, x: &Self::Map) -> Self::Map;

    /// Global response norm.
    fn response_norm(&mut self, x: &Self::Map, norm: &ResponseNorm) -> Self::Map;
}

/// Global response norm (Woo et al., 2023): channels compete by their strength over the whole picture.
#[derive(Module, Debug)]
pub(super) struct ResponseNorm {
    /// `[channels]`.
    pub weight: Param<Tensor<1>>,
    /// `[channels]`.
    pub bias: Param<Tensor<1>>,
}

/// A square convolution that keeps the size at stride 1.
pub(super) fn conv(channels: [usize; 2], kernel: usize, stride: usize) -> Conv2dConfig {
    let pad = kernel / 2;
    Conv2dConfig::new(channels, [kernel, kernel])
        .with_stride([stride, stride])
        .with_padding(PaddingConfig2d::Explicit(pad, pad, pad, pad))
        .with_initializer(KAIMING)
}

/// Convolution without bias, batch norm.
#[derive(Module, Debug)]
pub(super) struct ConvNorm {
    conv: Conv2d,
    norm: BatchNorm,
}

impl ConvNorm {
    pub(super) fn new(config: Conv2dConfig, device: &Device) -> Self {
        let norm = BatchNormConfig::new(config.channels[1]).init(device);
        Self { conv: config.with_bias(false).init(device), norm }
    }

    /// `[batch, height, width, channels_in]` -> `[batch, height/stride, width/stride, channels_out]`, ReLU.
    pub(super) fn forward<L: Layers>(&self, layers: &mut L, x: &L::Map, skip: Option<&L::Map>) -> L::Map {
        layers.unit(x, Unit::new(&self.conv, Some(&self.norm), Slope::RELU), skip)
    }
}

/// ResNet's basic block: two 3×3 convolutions and a skip, projected where the shape changes.
/// Fields are named as in timm, so that its weights load by name.
#[derive(Module, Debug)]
pub(super) struct BasicBlock {
    conv1: Conv2d,
    bn1: BatchNorm,
    conv2: Conv2d,
    bn2: BatchNorm,
    downsample: Option<(Conv2d, BatchNorm)>,
}

impl BasicBlock {
    pub(super) fn new([input, output]: [usize; 2], stride: usize, device: &Device) -> Self {
        let projects = stride != 1 || input != output;
        let bare = |config: Conv2dConfig| config.with_bias(false).init(device);
        let norm = || BatchNormConfig::new(output).init(device);
        Self {
            conv1: bare(conv([input, output], 3, stride)),
            bn1: norm(),
            conv2: bare(conv([output, output], 3, 1)),
            bn2: norm(),
            downsample: projects.then(|| (bare(conv([input, output], 1, stride)), norm())),
        }
    }

    /// `[batch, height, width, channels_in]` -> `[batch, height/stride, width/stride, channels_out]`.
    pub(super) fn forward<L: Layers>(&self, layers: &mut L, x: &L::Map) -> L::Map {
        let skip = match &self.downsample {
            Some((conv, norm)) => layers.unit(x, Unit::new(conv, Some(norm), Slope::NONE), None),
            None => x.clone(),
        };
        let x = layers.unit(x, Unit::new(&self.conv1, Some(&self.bn1), Slope::RELU), None);
        layers.unit(&x, Unit::new(&self.conv2, Some(&self.bn2), Slope::RELU), Some(&skip))
    }
}
