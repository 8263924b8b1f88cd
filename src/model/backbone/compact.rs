//! A small residual network with a top-down pyramid, for browsers.

use burn::module::Module;
use burn::nn::conv::Conv2d;
use burn::tensor::Device;

use super::{BackboneShape, Feature};
use crate::model::layers::{BasicBlock, ConvNorm, Layers, Slope, Unit, conv};

/// Stride of the first stage, which the pyramid ends at.
const FINEST_STRIDE: usize = 4;

/// See [`super::BackboneConfig::Compact`].
#[derive(Module, Debug)]
pub(in crate::model) struct Compact {
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

/// What the rest of the network must know of it.
pub(super) fn shape(stem: usize, stages: [usize; 4], pyramid: usize) -> BackboneShape {
    BackboneShape {
        features: vec![Feature { stride: FINEST_STRIDE, channels: pyramid }],
        coarsest_stride: FINEST_STRIDE << (stages.len() - 1),
        sizes: [&[stem, pyramid], &stages[..]].concat(),
        published: None,
    }
}

impl Compact {
    /// `stem`: channels of the input and of the first map.
    pub(super) fn new(stem: [usize; 2], stages: [usize; 4], pyramid: usize, device: &Device) -> Self {
        let inputs = [stem[1], stages[0], stages[1], stages[2]];
        Self {
            stem: ConvNorm::new(conv(stem, 5, 2), device),
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

    /// `[batch, h, w, input_channels]` -> its one feature.
    pub(super) fn forward<L: Layers>(&self, layers: &mut L, picture: &L::Map) -> Vec<L::Map> {
        let mut x = self.stem.forward(layers, picture, None);
        let mut features = Vec::with_capacity(self.stages.len());
        for (stage, lateral) in self.stages.iter().zip(&self.laterals) {
            x = stage.down.forward(layers, &x, None);
            x = stage.block.forward(layers, &x);
            features.push(layers.unit(&x, Unit::new(lateral, None, Slope::NONE), None));
        }
        let top_down = features.into_iter().rev().reduce(|coarse, fine| layers.upsample(&coarse, 2, Some(&fine)));
        // Four stages, so there is always a map.
        vec![self.fuse.forward(layers, &top_down.unwrap_or(x), None)]
    }
}
