//! ConvNeXt, with timm's names, so that its weights load by name.

use burn::module::{Module, Param};
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::nn::{Initializer, LayerNorm, LayerNormConfig};
use burn::tensor::{Device, Tensor};

use super::{BackboneShape, Feature};
use crate::model::layers::{Layers, ResponseNorm, Slope, Unit, conv};

/// Side of the patches that the stem takes.
const PATCH: usize = 4;
/// Side of the depthwise convolutions.
const KERNEL: usize = 7;
/// Channels inside a block over those outside.
const EXPANSION: usize = 4;
/// Added to layer norm's variance.
const EPSILON: f64 = 1e-6;
/// Standard deviation of the initial weights, and the initial factor of a block (both as published).
const INITIAL: Initializer = Initializer::Normal { mean: 0.0, std: 0.02 };
const INITIAL_FACTOR: f64 = 1e-6;

/// See [`super::BackboneConfig::ConvNext`].
#[derive(Module, Debug)]
pub(in crate::model) struct ConvNext {
    stem: (Conv2d, LayerNorm),
    stages: Vec<ConvNextStage>,
}

#[derive(Module, Debug)]
struct ConvNextStage {
    downsample: Option<(LayerNorm, Conv2d)>,
    blocks: Vec<ConvNextBlock>,
}

/// Depthwise convolution, layer norm, an MLP over channels, and a skip.
#[derive(Module, Debug)]
struct ConvNextBlock {
    gamma: Option<Param<Tensor<1>>>,
    conv_dw: Conv2d,
    norm: LayerNorm,
    mlp: Mlp,
}

#[derive(Module, Debug)]
struct Mlp {
    fc1: Conv2d,
    grn: Option<ResponseNorm>,
    fc2: Conv2d,
}

/// What the rest of the network must know of it.
pub(super) fn shape(depths: [usize; 4], widths: [usize; 4]) -> BackboneShape {
    let features = widths.iter().enumerate().map(|(stage, &channels)| Feature { stride: PATCH << stage, channels });
    BackboneShape {
        features: features.collect(),
        coarsest_stride: PATCH << (widths.len() - 1),
        sizes: [depths, widths].concat(),
        published: Some("backbone."),
    }
}

impl ConvNext {
    pub(super) fn new(depths: [usize; 4], widths: [usize; 4], response_norm: bool, device: &Device) -> Self {
        let stages = (0..depths.len()).map(|stage| ConvNextStage {
            downsample: (stage > 0)
                .then(|| (norm(widths[stage - 1], device), patches([widths[stage - 1], widths[stage]], 2, device))),
            blocks: (0..depths[stage]).map(|_| ConvNextBlock::new(widths[stage], response_norm, device)).collect(),
        });
        let stem = (patches([3, widths[0]], PATCH, device), norm(widths[0], device));
        Self { stem, stages: stages.collect() }
    }

    /// `[batch, h, w, 3]` -> its features.
    pub(super) fn forward<L: Layers>(&self, layers: &mut L, picture: &L::Map) -> Vec<L::Map> {
        let (stem, stem_norm) = &self.stem;
        let x = layers.unit(picture, unpadded(stem), None);
        let mut x = layers.layer_norm(&x, stem_norm, EPSILON, Slope::NONE);
        let mut features = Vec::with_capacity(self.stages.len());
        for stage in &self.stages {
            if let Some((norm, conv)) = &stage.downsample {
                x = layers.layer_norm(&x, norm, EPSILON, Slope::NONE);
                x = layers.unit(&x, unpadded(conv), None);
            }
            x = stage.blocks.iter().fold(x, |x, block| block.forward(layers, &x));
            features.push(x.clone());
        }
        features
    }
}

impl ConvNextBlock {
    fn new(width: usize, response_norm: bool, device: &Device) -> Self {
        let inner = EXPANSION * width;
        let plain = |channels, kernel| conv(channels, kernel, 1).with_initializer(INITIAL);
        let factor = Initializer::Constant { value: INITIAL_FACTOR };
        Self {
            gamma: (!response_norm).then(|| factor.init([width], device)),
            conv_dw: plain([width, width], KERNEL).with_groups(width).init(device),
            norm: norm(width, device),
            mlp: Mlp {
                fc1: plain([width, inner], 1).init(device),
                grn: response_norm.then(|| ResponseNorm {
                    weight: Initializer::Zeros.init([inner], device),
                    bias: Initializer::Zeros.init([inner], device),
                }),
                fc2: plain([inner, width], 1).init(device),
            },
        }
    }

    fn forward<L: Layers>(&self, layers: &mut L, x: &L::Map) -> L::Map {
        let y = layers.unit(x, Unit::new(&self.conv_dw, None, Slope::NONE), None);
        let y = layers.layer_norm(&y, &self.norm, EPSILON, Slope::NONE);
        let y = layers.unit(&y, Unit::new(&self.mlp.fc1, None, Slope::NONE), None);
        let y = layers.gelu(&y);
        let y = match &self.mlp.grn {
            Some(norm) => layers.response_norm(&y, norm),
            None => y,
        };
        // The factor on each channel is part of the last convolution.
        let mut last = Unit::new(&self.mlp.fc2, None, Slope::NONE);
        if let Some(gamma) = &self.gamma {
            last.weight = last.weight * gamma.val().reshape([-1, 1, 1, 1]);
            last.bias = last.bias.map(|bias| bias * gamma.val());
        }
        layers.unit(&y, last, Some(x))
    }
}

fn norm(channels: usize, device: &Device) -> LayerNorm {
    LayerNormConfig::new(channels).with_epsilon(EPSILON).init(device)
}

/// A convolution of patches that do not overlap.
fn patches(channels: [usize; 2], side: usize, device: &Device) -> Conv2d {
    Conv2dConfig::new(channels, [side, side]).with_stride([side, side]).with_initializer(INITIAL).init(device)
}

fn unpadded(conv: &Conv2d) -> Unit<'_> {
    Unit { padding: 0, ..Unit::new(conv, None, Slope::NONE) }
}
