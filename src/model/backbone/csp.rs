//! The backbone of NanoDet-g (<https://github.com/RangiLyu/nanodet>, Apache-2.0) under a top-down pyramid: cross-stage
//! partial blocks (Wang et al., 2020) of dense convolutions. Its published weights have their batch norms folded into the
//! convolutions, so these have biases instead.

use burn::module::Module;
use burn::nn::conv::Conv2d;
use burn::tensor::Device;

use super::{BackboneShape, Feature, PICTURE_CHANNELS};
use crate::model::layers::{ConvNorm, Layers, Slope, Unit, conv};

/// Stride of the stem, its pooling included: the finest feature's.
const FINEST_STRIDE: usize = 4;
/// Its leaky ReLU, as published.
const LEAKY: Slope = Slope(0.1);

/// See [`super::BackboneConfig::Csp`].
#[derive(Module, Debug)]
pub(in crate::model) struct Csp {
    body: Body,
    laterals: Vec<Conv2d>,
    fuse: ConvNorm,
}

/// The published part.
#[derive(Module, Debug)]
struct Body {
    stem: Conv2d,
    stages: Vec<Stage>,
}

/// A convolution, and its result beside what a chain of blocks makes of it.
#[derive(Module, Debug)]
struct Stage {
    first: Conv2d,
    blocks: Vec<Block>,
    last: Conv2d,
}

/// Two convolutions; the second's result beside the first's.
#[derive(Module, Debug)]
struct Block {
    first: Conv2d,
    second: Conv2d,
}

/// What the rest of the network must know of it.
pub(super) fn shape(stem: usize, stages: [usize; 4], blocks: [usize; 4], pyramid: usize) -> BackboneShape {
    BackboneShape {
        features: vec![Feature { stride: FINEST_STRIDE, channels: pyramid }],
        coarsest_stride: FINEST_STRIDE << (stages.len() - 1),
        // A block halves the channels of its stage, and a stage doubles its own.
        sizes: [
            &[stem, pyramid],
            &stages.map(|width| width / 2)[..],
            &stages.map(|width| width.saturating_mul(2)),
            &blocks,
        ]
        .concat(),
        published: Some("backbone.body."),
    }
}

impl Csp {
    pub(super) fn new(stem: usize, stages: [usize; 4], blocks: [usize; 4], pyramid: usize, device: &Device) -> Self {
        let inputs = [stem, 2 * stages[0], 2 * stages[1], 2 * stages[2]];
        let stage = |index: usize| Stage {
            // The stem has halved the picture twice.
            first: conv([inputs[index], stages[index]], 3, if index == 0 { 1 } else { 2 }).init(device),
            blocks: (0..blocks[index]).map(|_| Block::new(stages[index], device)).collect(),
            last: conv([stages[index], stages[index]], 3, 1).init(device),
        };
        Self {
            body: Body {
                stem: conv([PICTURE_CHANNELS, stem], 3, 2).init(device),
                stages: (0..stages.len()).map(stage).collect(),
            },
            laterals: stages.into_iter().map(|width| conv([2 * width, pyramid], 1, 1).init(device)).collect(),
            fuse: ConvNorm::new(conv([pyramid, pyramid], 3, 1), device),
        }
    }

    /// `[batch, h, w, 3]` -> its one feature.
    pub(super) fn forward<L: Layers>(&self, layers: &mut L, picture: &L::Map) -> Vec<L::Map> {
        let x = layers.unit(picture, Unit::new(&self.body.stem, None, LEAKY), None);
        let mut x = Side::Whole(layers.max_pool(&x));
        let mut features = Vec::with_capacity(self.laterals.len());
        for (stage, lateral) in self.body.stages.iter().zip(&self.laterals) {
            x = stage.forward(layers, &x);
            features.push(x.convolved(layers, lateral, Slope::NONE));
        }
        let top_down = features.into_iter().rev().reduce(|coarse, fine| layers.upsample(&coarse, 2, Some(&fine)));
        let top_down = top_down.unwrap_or_else(|| unreachable!("there are four stages"));
        vec![self.fuse.forward(layers, &top_down, None)]
    }
}

impl Stage {
    fn forward<L: Layers>(&self, layers: &mut L, x: &Side<L::Map>) -> Side<L::Map> {
        let first = x.convolved(layers, &self.first, LEAKY);
        let made = self.blocks.iter().fold(Side::Whole(first.clone()), |x, block| block.forward(layers, &x));
        Side::Beside(made.convolved(layers, &self.last, LEAKY), first)
    }
}

impl Block {
    fn new(width: usize, device: &Device) -> Self {
        let half = width / 2;
        Self { first: conv([width, half], 3, 1).init(device), second: conv([half, half], 3, 1).init(device) }
    }

    fn forward<L: Layers>(&self, layers: &mut L, x: &Side<L::Map>) -> Side<L::Map> {
        let first = x.convolved(layers, &self.first, LEAKY);
        let second = layers.unit(&first, Unit::new(&self.second, None, LEAKY), None);
        Side::Beside(second, first)
    }
}

/// A map, or two with as many channels each, laid side by side.
enum Side<M> {
    Whole(M),
    Beside(M, M),
}

impl<M: Clone> Side<M> {
    /// A convolution of it, then the activation `slope`. Two maps are convolved one after the other and summed: the wide map never exists.
    fn convolved<L: Layers<Map = M>>(&self, layers: &mut L, conv: &Conv2d, slope: Slope) -> M {
        match self {
            Self::Whole(map) => layers.unit(map, Unit::new(conv, None, slope), None),
            Self::Beside(left, right) => {
                let half = conv.weight.dims()[1] / 2;
                let part = |first, slope| {
                    let unit = Unit::new(conv, None, slope);
                    Unit { weight: unit.weight.narrow(1, first, half), ..unit }
                };
                // The bias belongs to the sum.
                let left = layers.unit(left, Unit { bias: None, ..part(0, Slope::NONE) }, None);
                layers.unit(right, part(half, slope), Some(&left))
            }
        }
    }
}
