//! Heads: features in, a map or two out.

use burn::module::Module;
use burn::nn::conv::Conv2d;
use burn::nn::{Initializer, LayerNorm, LayerNormConfig};
use burn::tensor::Device;

use super::backbone::Feature;
use super::config::HeadConfig;
use super::layers::{ConvNorm, Layers, Slope, Unit, conv};

/// Kernel of the wide convolutions of both kinds of head.
const KERNEL: usize = 7;
/// Added to layer norm's variance.
const EPSILON: f64 = 1e-5;
/// The published heads' leaky ReLU.
const LEAKY: Slope = Slope(0.01);

/// Head of either kind.
#[derive(Module, Debug)]
pub(super) enum Head {
    /// See [`HeadConfig::Paper`].
    Paper(PaperHead),
    /// See [`HeadConfig::Depthwise`].
    Depthwise(DepthwiseHead),
}

impl Head {
    /// A head with `maps` on a backbone's `features`; `last` initialises its final 1×1 convolution.
    pub(super) fn new(
        config: &HeadConfig,
        features: &[Feature],
        maps: usize,
        last: Initializer,
        device: &Device,
    ) -> Self {
        match *config {
            HeadConfig::Paper { channels } => Self::Paper(PaperHead::new(features, channels, maps, last, device)),
            HeadConfig::Depthwise => Self::Depthwise(DepthwiseHead::new(features[0].channels, maps, last, device)),
        }
    }

    /// Features -> `[batch, h, w, maps]`, the finest feature's size.
    pub(super) fn forward<L: Layers>(&self, layers: &mut L, features: &[L::Map]) -> L::Map {
        match self {
            Self::Paper(head) => head.forward(layers, features),
            Self::Depthwise(head) => head.forward(layers, &features[0]),
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
    #[module(skip)]
    features: Vec<Feature>,
}

impl PaperHead {
    fn new(features: &[Feature], [a, b, c]: [usize; 3], maps: usize, last: Initializer, device: &Device) -> Self {
        let xavier = |gain| Initializer::XavierUniform { gain };
        let wide = |channels| conv(channels, KERNEL, 1).with_initializer(xavier(std::f64::consts::SQRT_2)).init(device);
        let norm = |channels| LayerNormConfig::new(channels).with_epsilon(EPSILON).init(device);
        let channels = features.iter().map(|feature| feature.channels).sum();
        Self {
            reduce: conv([channels, a], 1, 1).with_initializer(xavier(1.0)).init(device),
            conv1: wide([a, b]),
            norm1: norm(b),
            conv2: wide([b, c]),
            norm2: norm(c),
            last: conv([c, maps], 1, 1).with_initializer(last).init(device),
            features: features.to_vec(),
        }
    }

    fn forward<L: Layers>(&self, layers: &mut L, features: &[L::Map]) -> L::Map {
        let x = self.reduce(layers, features);
        let x = layers.unit(&x, Unit::new(&self.conv1, None, Slope::NONE), None);
        let x = layers.layer_norm(&x, &self.norm1, EPSILON, LEAKY);
        let x = layers.unit(&x, Unit::new(&self.conv2, None, Slope::NONE), None);
        let x = layers.layer_norm(&x, &self.norm2, EPSILON, LEAKY);
        layers.unit(&x, Unit::new(&self.last, None, Slope::NONE), None)
    }

    /// The 1×1 convolution of all features, brought to one size and laid side by side. A 1×1 convolution
    /// and bilinear upsampling may change places, so each feature is reduced at its own size: a fifth of
    /// the work, and the wide map never exists.
    fn reduce<L: Layers>(&self, layers: &mut L, features: &[L::Map]) -> L::Map {
        let finest_stride = self.features[0].stride;
        let mut first = 0;
        let mut parts = features.iter().zip(&self.features).map(|(map, &Feature { stride, channels })| {
            let mut unit = Unit::new(&self.reduce, None, Slope::NONE);
            unit.weight = unit.weight.narrow(1, first, channels);
            // The bias belongs to the whole sum: the finest feature brings it.
            unit.bias = unit.bias.filter(|_| first == 0);
            first += channels;
            (map, stride / finest_stride, unit)
        });
        let (map, _, unit) = parts.next().unwrap_or_else(|| unreachable!("a backbone has features"));
        let finest = layers.unit(map, unit, None);
        parts.fold(finest, |sum, (map, factor, unit)| {
            let part = layers.unit(map, unit, None);
            layers.upsample(&part, factor, Some(&sum))
        })
    }
}

/// Depthwise 7×7 and 1×1 with a skip, then 1×1.
#[derive(Module, Debug)]
pub(super) struct DepthwiseHead {
    spatial: ConvNorm,
    mix: ConvNorm,
    last: Conv2d,
}

impl DepthwiseHead {
    fn new(features: usize, maps: usize, last: Initializer, device: &Device) -> Self {
        let square = [features, features];
        Self {
            spatial: ConvNorm::new(conv(square, KERNEL, 1).with_groups(features), device),
            mix: ConvNorm::new(conv(square, 1, 1), device),
            last: conv([features, maps], 1, 1).with_initializer(last).init(device),
        }
    }

    fn forward<L: Layers>(&self, layers: &mut L, features: &L::Map) -> L::Map {
        let x = self.spatial.forward(layers, features, None);
        let x = self.mix.forward(layers, &x, Some(features));
        layers.unit(&x, Unit::new(&self.last, None, Slope::NONE), None)
    }
}
