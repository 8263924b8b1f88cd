//! Feature extractors. Each is a file here, which also tells its strides and channels; and a variant of the two enums
//! below.

mod compact;
mod convnext;
mod resnet34;

use burn::module::Module;
use burn::tensor::Device;
use serde::{Deserialize, Serialize};

use self::compact::Compact;
use self::convnext::ConvNext;
use self::resnet34::ResNet34;
use super::layers::Layers;

/// Feature extractor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum BackboneConfig {
    /// ResNet34 to layer3, features of strides 2, 4, 8, 16 brought to stride 2 and concatenated.
    ResNet34 {
        /// Channels of stem and layer1 (64 as published); layer2 has twice, layer3 four times as many.
        width: usize,
    },
    /// ConvNeXt (Liu et al., 2022) or its second version (Woo et al., 2023), with timm's `conv_mlp`: features of
    /// strides 4, 8, 16, 32 brought to stride 4 and concatenated.
    ConvNext {
        /// Blocks of the four stages.
        depths: [usize; 4],
        /// Channels of the four stages.
        widths: [usize; 4],
        /// Version 2: a global response norm in each block instead of a factor on each of its channels.
        response_norm: bool,
    },
    /// Small residual network with a top-down pyramid, one feature map of stride 4.
    Compact {
        /// Channels of the 5×5 stem.
        stem: usize,
        /// Channels of the four stages (strides 4, 8, 16, 32).
        stages: [usize; 4],
        /// Channels of the pyramid.
        pyramid: usize,
        /// Channels of the input: 3 a picture.
        #[serde(default = "one_picture", skip_serializing_if = "is_one_picture")]
        input_channels: usize,
    },
}

/// Channels of a picture: red, green, blue.
pub(crate) const PICTURE_CHANNELS: usize = 3;

fn one_picture() -> usize {
    PICTURE_CHANNELS
}

#[allow(clippy::trivially_copy_pass_by_ref)] // serde's signature
fn is_one_picture(channels: &usize) -> bool {
    *channels == PICTURE_CHANNELS
}

/// What the rest of the network must know of a backbone.
#[derive(Debug, Clone)]
pub(super) struct BackboneShape {
    /// Its feature maps, at least one, the finest first. The network sees them as one map with the channels of all.
    pub features: Vec<Feature>,
    /// Input pixels per cell of the coarsest map inside: the input's sides are multiples of it.
    pub coarsest_stride: usize,
    /// All channel counts and depths that the configuration names.
    pub sizes: Vec<usize>,
    /// Where in the network the tensors lie that weights published by others hold, named as there; absent where there are none.
    pub published: Option<&'static str>,
}

/// A feature map.
#[derive(Debug, Clone, Copy)]
pub(super) struct Feature {
    /// Input pixels per cell.
    pub stride: usize,
    /// Values at a cell.
    pub channels: usize,
}

impl BackboneConfig {
    /// What the rest of the network must know of it. Asked before anybody has checked the numbers.
    pub(super) fn shape(&self) -> BackboneShape {
        match *self {
            Self::ResNet34 { width } => resnet34::shape(width),
            Self::ConvNext { depths, widths, .. } => convnext::shape(depths, widths),
            Self::Compact { stem, stages, pyramid, .. } => compact::shape(stem, stages, pyramid),
        }
    }

    /// Channels of the input: 3 a picture.
    pub(super) fn input_channels(&self) -> usize {
        match *self {
            Self::Compact { input_channels, .. } => input_channels,
            Self::ResNet34 { .. } | Self::ConvNext { .. } => PICTURE_CHANNELS,
        }
    }

    /// Input pixels per cell of the finest feature.
    pub(super) fn finest_stride(&self) -> usize {
        self.shape().features[0].stride
    }
}

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
            BackboneConfig::Compact { stem, stages, pyramid, input_channels } => {
                Self::Compact(Compact::new([input_channels, stem], stages, pyramid, device))
            }
        }
    }

    /// `[batch, height, width, input_channels]` -> the features of its [`BackboneShape`], `[batch, height/stride, width/stride, channels]`.
    pub(super) fn forward<L: Layers>(&self, layers: &mut L, picture: &L::Map) -> Vec<L::Map> {
        match self {
            Self::ResNet34(net) => net.forward(layers, picture),
            Self::ConvNext(net) => net.forward(layers, picture),
            Self::Compact(net) => net.forward(layers, picture),
        }
    }
}
