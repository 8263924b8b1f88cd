//! Feature extractors.

use burn::module::Module;
use burn::nn::conv::Conv2d;
use burn::nn::{BatchNorm, BatchNormConfig};
use burn::tensor::Device;

use super::config::BackboneConfig;
use super::convnext::ConvNext;
use super::layers::{BasicBlock, ConvNorm, Layers, Slope, Unit, conv};

/// Blocks in ResNet34's layer1, layer2, layer3 (layer4 is not used by PEN).
const RESNET34_BLOCKS: [usize; 3] = [3, 4, 6];

/// Feature maps side by side: each with the factor that brings it to the finest one's size. The network
/// sees them as one map with the channels of all.
pub(super) type Features<M> = Vec<(M, usize)>;

/// Feature extractor of any kind.
#[derive(Module, Debug)]
#[allow(clippy::large_enum_variant)] // there is one a network
pub(super) enum Backbone {
    /// See [`BackboneConfig::ResNet34`].
    ResNet34(ResNet34),
    /// See [`BackboneConfig::ConvNext`].
    ConvNext(ConvNext),
    /// See [`BackboneConfig::Compact`].
    Compact(Compact),
}

impl Backbone {
    pub(super) fn new(config: &BackboneConfig, device: &Device) -> Self {
        match *config {
            BackboneConfig::ResNet34 { width } => Self::ResNet34(ResNet34::new(width, device)),
            BackboneConfig::ConvNext { depths, widths, response_norm } => {
                Self::ConvNext(ConvNext::new(depths, widths, response_norm, device))
            }
            BackboneConfig::Compact { stem, stages, pyramid } => {
                Self::Compact(Compact::new(stem, stages, pyramid, device))
            }
        }
    }

    /// `[batch, height, width, 3]` -> features, the finest `[batch, height/stride, width/stride, _]`.
    pub(super) fn forward<L: Layers>(&self, layers: &mut L, picture: &L::Map) -> Features<L::Map> {
        match self {
            Self::ResNet34(net) => net.forward(layers, picture),
            Self::ConvNext(net) => net.forward(layers, picture),
            Self::Compact(net) => net.forward(layers, picture),
        }
    }

    /// Channels of each of the features.
    pub(super) fn channels(config: &BackboneConfig) -> Vec<usize> {
        match *config {
            BackboneConfig::ResNet34 { width } => vec![width, width, 2 * width, 4 * width],
            BackboneConfig::ConvNext { widths, .. } => widths.to_vec(),
            BackboneConfig::Compact { pyramid, .. } => vec![pyramid],
        }
    }

    /// Input pixels per cell of the finest feature.
    pub(super) fn finest_stride(config: &BackboneConfig) -> usize {
        match config {
            BackboneConfig::ResNet34 { .. } => 2,
            BackboneConfig::ConvNext { .. } | BackboneConfig::Compact { .. } => 4,
        }
    }
}

/// ResNet34 (He et al., 2016) to layer3, with timm's names.
#[derive(Module, Debug)]
pub(super) struct ResNet34 {
    conv1: Conv2d,
    bn1: BatchNorm,
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
            layer1: layer(0, width, width, 1),
            layer2: layer(1, width, 2 * width, 2),
            layer3: layer(2, 2 * width, 4 * width, 2),
        }
    }

    /// `[batch, h, w, 3]` -> features of strides 2, 4, 8, 16.
    fn forward<L: Layers>(&self, layers: &mut L, picture: &L::Map) -> Features<L::Map> {
        let stride2 = layers.unit(picture, Unit::new(&self.conv1, Some(&self.bn1), Slope::RELU), None);
        let pooled = layers.max_pool(&stride2);
        let mut run = |blocks: &[BasicBlock], x: L::Map| blocks.iter().fold(x, |x, block| block.forward(layers, &x));
        let stride4 = run(&self.layer1, pooled);
        let stride8 = run(&self.layer2, stride4.clone());
        let stride16 = run(&self.layer3, stride8.clone());
        vec![(stride2, 1), (stride4, 2), (stride8, 4), (stride16, 8)]
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

    /// `[batch, h, w, 3]` -> one map `[batch, h/4, w/4, pyramid]`.
    fn forward<L: Layers>(&self, layers: &mut L, picture: &L::Map) -> Features<L::Map> {
        let mut x = self.stem.forward(layers, picture, None);
        let mut features = Vec::with_capacity(self.stages.len());
        for (stage, lateral) in self.stages.iter().zip(&self.laterals) {
            x = stage.down.forward(layers, &x, None);
            x = stage.block.forward(layers, &x);
            features.push(layers.unit(&x, Unit::new(lateral, None, Slope::NONE), None));
        }
        let top_down = features.into_iter().rev().reduce(|coarse, fine| layers.upsample(&coarse, 2, Some(&fine)));
        // Four stages, so there is always a map.
        vec![(self.fuse.forward(layers, &top_down.unwrap_or(x), None), 1)]
    }
}
