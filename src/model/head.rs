//! Heads: features in, one map out.

use burn::module::Module;
use burn::nn::conv::Conv2d;
use burn::nn::{Initializer, LayerNorm, LayerNormConfig};
use burn::tensor::{Device, Tensor, activation::leaky_relu, activation::relu};

use super::config::HeadConfig;
use super::layers::{ConvNorm, conv};

/// Kernel of the wide convolutions of both kinds of head.
const KERNEL: usize = 7;
/// Slope of the published heads' leaky ReLU.
const LEAK: f64 = 0.01;

/// Head of either kind.
#[derive(Module, Debug)]
pub(super) enum Head {
    /// See [`HeadConfig::Paper`].
    Paper(PaperHead),
    /// See [`HeadConfig::Depthwise`].
    Depthwise(DepthwiseHead),
}

impl Head {
    /// A head on `features` channels; `last` initialises its final 1×1 convolution.
    pub(super) fn new(config: &HeadConfig, features: usize, last: Initializer, device: &Device) -> Self {
        match *config {
            HeadConfig::Paper { channels } => Self::Paper(PaperHead::new(features, channels, last, device)),
            HeadConfig::Depthwise => Self::Depthwise(DepthwiseHead::new(features, last, device)),
        }
    }

    /// `[batch, features, h, w]` -> `[batch, 1, h, w]`.
    pub(super) fn forward(&self, features: Tensor<4>) -> Tensor<4> {
        match self {
            Self::Paper(head) => head.forward(features),
            Self::Depthwise(head) => head.forward(features),
        }
    }
}

/// 1×1, twice (7×7, layer norm over channels, leaky ReLU), 1×1 (as published).
#[derive(Module, Debug)]
pub(super) struct PaperHead {
    reduce: Conv2d,
    conv1: Conv2d,
    norm1: LayerNorm,
    conv2: Conv2d,
    norm2: LayerNorm,
    last: Conv2d,
}

impl PaperHead {
    fn new(features: usize, [a, b, c]: [usize; 3], last: Initializer, device: &Device) -> Self {
        let xavier = |gain| Initializer::XavierUniform { gain };
        let wide = |channels| conv(channels, KERNEL, 1).with_initializer(xavier(std::f64::consts::SQRT_2)).init(device);
        let norm = |channels| LayerNormConfig::new(channels).init(device);
        Self {
            reduce: conv([features, a], 1, 1).with_initializer(xavier(1.0)).init(device),
            conv1: wide([a, b]),
            norm1: norm(b),
            conv2: wide([b, c]),
            norm2: norm(c),
            last: conv([c, 1], 1, 1).with_initializer(last).init(device),
        }
    }

    fn forward(&self, x: Tensor<4>) -> Tensor<4> {
        let x = self.reduce.forward(x);
        let x = leaky_relu(over_channels(&self.norm1, self.conv1.forward(x)), LEAK);
        let x = leaky_relu(over_channels(&self.norm2, self.conv2.forward(x)), LEAK);
        self.last.forward(x)
    }
}

/// Layer norm over the channels of `[batch, channels, h, w]`.
fn over_channels(norm: &LayerNorm, x: Tensor<4>) -> Tensor<4> {
    norm.forward(x.permute([0, 2, 3, 1])).permute([0, 3, 1, 2])
}

/// Depthwise 7×7 and 1×1 with a skip, then 1×1.
#[derive(Module, Debug)]
pub(super) struct DepthwiseHead {
    spatial: ConvNorm,
    mix: ConvNorm,
    last: Conv2d,
}

impl DepthwiseHead {
    fn new(features: usize, last: Initializer, device: &Device) -> Self {
        let square = [features, features];
        Self {
            spatial: ConvNorm::new(conv(square, KERNEL, 1).with_groups(features), device),
            mix: ConvNorm::new(conv(square, 1, 1), device),
            last: conv([features, 1], 1, 1).with_initializer(last).init(device),
        }
    }

    fn forward(&self, features: Tensor<4>) -> Tensor<4> {
        let x = relu(self.spatial.forward(features.clone()));
        self.last.forward(relu(self.mix.forward(x) + features))
    }
}
