//! Feature extractors.

use burn::module::Module;
use burn::nn::conv::Conv2d;
use burn::nn::pool::{MaxPool2d, MaxPool2dConfig};
use burn::nn::{BatchNorm, BatchNormConfig, PaddingConfig2d};
use burn::tensor::{Device, Tensor, activation::relu};

use super::config::BackboneConfig;
use super::layers::{BasicBlock, ConvNorm, conv, upsample};

/// Blocks in ResNet34's layer1, layer2, layer3 (layer4 is not used by PEN).
const RESNET34_BLOCKS: [usize; 3] = [3, 4, 6];

/// Feature extractor of either kind.
#[derive(Module, Debug)]
#[allow(clippy::large_enum_variant)] // there is one a network
pub(super) enum Backbone {
    /// See [`BackboneConfig::ResNet34`].
    ResNet34(ResNet34),
    /// See [`BackboneConfig::Compact`].
    Compact(Compact),
}

impl Backbone {
    pub(super) fn new(config: &BackboneConfig, device: &Device) -> Self {
        match *config {
            BackboneConfig::ResNet34 { width } => Self::ResNet34(ResNet34::new(width, device)),
            BackboneConfig::Compact { stem, stages, pyramid } => {
                Self::Compact(Compact::new(stem, stages, pyramid, device))
            }
        }
    }

    /// `[batch, 3, height, width]` -> features `[batch, channels, height/stride, width/stride]`.
    pub(super) fn forward(&self, picture: Tensor<4>) -> Tensor<4> {
        match self {
            Self::ResNet34(net) => net.forward(picture),
            Self::Compact(net) => net.forward(picture),
        }
    }

    /// Channels of the features.
    pub(super) fn channels(config: &BackboneConfig) -> usize {
        match *config {
            BackboneConfig::ResNet34 { width } => width * (1 + 1 + 2 + 4),
            BackboneConfig::Compact { pyramid, .. } => pyramid,
        }
    }
}

/// ResNet34 (He et al., 2016) to layer3, with timm's names.
#[derive(Module, Debug)]
pub(super) struct ResNet34 {
    conv1: Conv2d,
    bn1: BatchNorm,
    maxpool: MaxPool2d,
    layer1: Vec<BasicBlock>,
    layer2: Vec<BasicBlock>,
    layer3: Vec<BasicBlock>,
}

impl ResNet34 {
    fn new(width: usize, device: &Device) -> Self {
        let layer = |index: usize, input: usize, output: usize, stride: usize| {
            (0..RESNET34_BLOCKS[index])
                .map(|block| match block {
                    0 => BasicBlock::new([input, output], stride, device),
                    _ => BasicBlock::new([output, output], 1, device),
                })
                .collect()
        };
        Self {
            conv1: conv([3, width], 7, 2).with_bias(false).init(device),
            bn1: BatchNormConfig::new(width).init(device),
            maxpool: MaxPool2dConfig::new([3, 3])
                .with_strides([2, 2])
                .with_padding(PaddingConfig2d::Explicit(1, 1, 1, 1))
                .init(),
            layer1: layer(0, width, width, 1),
            layer2: layer(1, width, 2 * width, 2),
            layer3: layer(2, 2 * width, 4 * width, 2),
        }
    }

    /// `[batch, 3, h, w]` -> `[batch, 8·width, h/2, w/2]`.
    fn forward(&self, picture: Tensor<4>) -> Tensor<4> {
        let stride2 = relu(self.bn1.forward(self.conv1.forward(picture)));
        let run = |blocks: &[BasicBlock], x| blocks.iter().fold(x, |x, block| block.forward(x));
        let stride4 = run(&self.layer1, self.maxpool.forward(stride2.clone()));
        let stride8 = run(&self.layer2, stride4.clone());
        let stride16 = run(&self.layer3, stride8.clone());
        Tensor::cat(vec![stride2, upsample(stride4, 2), upsample(stride8, 4), upsample(stride16, 8)], 1)
    }
}

/// Small residual network with a top-down pyramid.
#[derive(Module, Debug)]
pub(super) struct Compact {
    stem: ConvNorm,
    stages: Vec<Stage>,
    laterals: Vec<Conv2d>,
    fuse: ConvNorm,
}

/// A strided convolution and a residual block.
#[derive(Module, Debug)]
pub(super) struct Stage {
    down: ConvNorm,
    block: BasicBlock,
}

impl Compact {
    fn new(stem: usize, stages: [usize; 4], pyramid: usize, device: &Device) -> Self {
        let inputs = [stem, stages[0], stages[1], stages[2]];
        Self {
            stem: ConvNorm::new(conv([3, stem], 5, 2), device),
            stages: inputs
                .into_iter()
                .zip(stages)
                .map(|(input, output)| Stage {
                    down: ConvNorm::new(conv([input, output], 3, 2), device),
                    block: BasicBlock::new([output, output], 1, device),
                })
                .collect(),
            laterals: stages.into_iter().map(|input| conv([input, pyramid], 1, 1).init(device)).collect(),
            fuse: ConvNorm::new(conv([pyramid, pyramid], 3, 1), device),
        }
    }

    /// `[batch, 3, h, w]` -> `[batch, pyramid, h/4, w/4]`.
    fn forward(&self, picture: Tensor<4>) -> Tensor<4> {
        let mut x = relu(self.stem.forward(picture));
        let mut features = Vec::with_capacity(self.stages.len());
        for (stage, lateral) in self.stages.iter().zip(&self.laterals) {
            x = stage.block.forward(relu(stage.down.forward(x)));
            features.push(lateral.forward(x.clone()));
        }
        let top_down = features.into_iter().rev().reduce(|coarse, fine| upsample(coarse, 2) + fine);
        // Four stages, so there is always a map.
        relu(self.fuse.forward(top_down.unwrap_or(x)))
    }
}
