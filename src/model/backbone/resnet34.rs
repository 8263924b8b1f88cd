//! ResNet34 (He et al., 2016) to layer3, with timm's names, so that its weights load by name.

use burn::module::Module;
use burn::nn::conv::Conv2d;
use burn::nn::{BatchNorm, BatchNormConfig};
use burn::tensor::Device;

use super::{BackboneShape, Feature};
use crate::model::layers::{BasicBlock, Layers, Slope, Unit, conv};

/// Blocks in layer1, layer2, layer3 (layer4 is not used by PEN).
const BLOCKS: [usize; 3] = [3, 4, 6];
/// Stride of each feature, and its channels over those of the stem.
const FEATURES: [[usize; 2]; 4] = [[2, 1], [4, 1], [8, 2], [16, 4]];

/// See [`super::BackboneConfig::ResNet34`].
#[derive(Module, Debug)]
pub(in crate::model) struct ResNet34 {
    conv1: Conv2d,
    bn1: BatchNorm,
    layer1: Vec<BasicBlock>,
    layer2: Vec<BasicBlock>,
    layer3: Vec<BasicBlock>,
}

/// What the rest of the network must know of it.
pub(super) fn shape(width: usize) -> BackboneShape {
    // Nobody has checked the width yet.
    let feature = |[stride, times]: [usize; 2]| Feature { stride, channels: width.saturating_mul(times) };
    BackboneShape {
        features: FEATURES.map(feature).to_vec(),
        coarsest_stride: 16,
        sizes: vec![width],
        published: Some("backbone."),
    }
}

impl ResNet34 {
    pub(super) fn new(width: usize, device: &Device) -> Self {
        let layer = |index: usize, input: usize, output: usize, stride: usize| {
            (0..BLOCKS[index])
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

    /// `[batch, h, w, 3]` -> its features.
    pub(super) fn forward<L: Layers>(&self, layers: &mut L, picture: &L::Map) -> Vec<L::Map> {
        let stride2 = layers.unit(picture, Unit::new(&self.conv1, Some(&self.bn1), Slope::RELU), None);
        let pooled = layers.max_pool(&stride2);
        let mut run = |blocks: &[BasicBlock], x: L::Map| blocks.iter().fold(x, |x, block| block.forward(layers, &x));
        let stride4 = run(&self.layer1, pooled);
        let stride8 = run(&self.layer2, stride4.clone());
        let stride16 = run(&self.layer3, stride8.clone());
        vec![stride2, stride4, stride8, stride16]
    }
}
