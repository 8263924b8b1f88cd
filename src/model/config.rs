//! What a PEN is made of: one structure for code, card and training configuration.

use serde::{Deserialize, Serialize};

use super::backbone::{BackboneConfig, BackboneShape, PICTURE_CHANNELS};
use gravisight_geometry::error::{Error, Result};

/// Largest number of channels in any layer; a card asking for more is damaged or hostile.
const MAX_CHANNELS: usize = 4096;

/// Geometric mean of the radii that a network for any ball reads, px.
const MIDDLE_RADIUS: f64 = 9.5;
/// Radius that a ball has in the verifier's input, px.
pub(crate) const VERIFIER_RADIUS: f64 = 12.0;
/// Side of that input, px.
pub(crate) const VERIFIER_SIDE: u32 = 64;

/// Radius that a ball has in the motion network's input, px, and that input's side: those of a stack of frames (`track/video/stack.rs`).
pub(crate) const MOTION_RADIUS: f64 = 3.0;
pub(crate) const MOTION_SIDE: u32 = 64;

/// Architecture of a [`super::Pen`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PenConfig {
    /// Feature extractor.
    pub backbone: BackboneConfig,
    /// The two heads (same form, separate weights).
    pub head: HeadConfig,
    /// How the heatmap is decoded.
    pub heatmap: HeatmapConfig,
    /// How the depth map is made.
    pub depth: DepthConfig,
}

/// Form of a head.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum HeadConfig {
    /// As published: 1×1, two 7×7 with layer norm and leaky ReLU, 1×1; output upsampled to the input's size.
    Paper {
        /// Channels after the first 1×1, the first 7×7 and the second 7×7 (256, 256, 128).
        channels: [usize; 3],
    },
    /// Depthwise 7×7 and 1×1 with a skip, then 1×1.
    Depthwise,
}

/// Heatmap decoding.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeatmapConfig {
    /// Inverse temperature β of the soft-argmax. The published 10 with target amplitude 100 makes it
    /// a hard argmax (0.40 px on a perfect heatmap); β·amplitude of 18–20 gives 0.045 px.
    pub beta: f64,
}

/// Depth map.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DepthConfig {
    /// From the head's output to a positive number.
    pub activation: DepthActivation,
    /// Factor on the activation, m: the scene's prior depth (1 as published). Of a network that reads sizes the middle of
    /// the radii it can read, px.
    pub scale: f64,
}

/// From a head's raw output to a positive number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DepthActivation {
    /// Softplus with beta 2, linear above 16 (as published).
    Softplus,
    /// Exponential.
    Exp,
    /// Exponential, within a factor e² of the scale: the ball's apparent radius, px, instead of its depth. A second
    /// channel is the logarithm of the scale of that radius's error, a Laplace distribution's, of log(radius).
    Radius,
}

impl DepthConfig {
    /// Channels of the depth head.
    pub fn channels(&self) -> usize {
        match self.activation {
            DepthActivation::Softplus | DepthActivation::Exp => 1,
            DepthActivation::Radius => 2,
        }
    }

    /// Whether it is apparent size that is read, of which depth follows by the ball's radius.
    pub fn is_size(&self) -> bool {
        self.activation == DepthActivation::Radius
    }
}

impl PenConfig {
    /// The network as published: 18.07 M parameters, 127 GMAC at 224×224, β = 10 (with a heatmap of amplitude 100 a hard argmax).
    pub fn paper() -> Self {
        Self {
            backbone: BackboneConfig::ResNet34 { width: 64 },
            head: HeadConfig::Paper { channels: [256, 256, 128] },
            heatmap: HeatmapConfig { beta: 10.0 },
            depth: DepthConfig { activation: DepthActivation::Softplus, scale: 1.0 },
        }
    }

    /// The published network with timm's `convnext_nano` as its backbone.
    pub fn convnext_nano() -> Self {
        let (depths, widths) = ([2, 2, 8, 2], [80, 160, 320, 640]);
        Self { backbone: BackboneConfig::ConvNext { depths, widths, response_norm: false }, ..Self::paper() }
    }

    /// The published network with timm's `convnextv2_nano` as its backbone.
    pub fn convnextv2_nano() -> Self {
        let (depths, widths) = ([2, 2, 8, 2], [80, 160, 320, 640]);
        Self { backbone: BackboneConfig::ConvNext { depths, widths, response_norm: true }, ..Self::paper() }
    }

    /// The network for browsers: 0.7 M parameters, 0.2 GMAC at 224×224. `prior_depth` in m.
    pub fn compact(prior_depth: f64) -> Self {
        let stages = [24, 48, 96, 128];
        Self {
            backbone: BackboneConfig::Compact { stem: 16, stages, pyramid: 32, input_channels: PICTURE_CHANNELS },
            head: HeadConfig::Depthwise,
            heatmap: HeatmapConfig { beta: 1.0 },
            depth: DepthConfig { activation: DepthActivation::Exp, scale: prior_depth },
        }
    }

    /// [`Self::compact`] for any ball: reads apparent radii of 1.3 to 70 px.
    pub fn compact_size() -> Self {
        let depth = DepthConfig { activation: DepthActivation::Radius, scale: MIDDLE_RADIUS };
        Self { depth, ..Self::compact(MIDDLE_RADIUS) }
    }

    /// The verifier: 0.4 M parameters, balls of about 12 px radius in pictures of 64×64 px, each with a second one of what is around it.
    pub fn verifier() -> Self {
        let depth = DepthConfig { activation: DepthActivation::Radius, scale: VERIFIER_RADIUS };
        let (stages, input_channels) = ([24, 48, 72, 96], 2 * PICTURE_CHANNELS);
        let backbone = BackboneConfig::Compact { stem: 16, stages, pyramid: 32, input_channels };
        Self { backbone, depth, ..Self::compact(VERIFIER_RADIUS) }
    }

    /// The motion network: 0.2 M parameters, balls of about 3 px radius in stacks of five frames.
    pub fn motion() -> Self {
        let depth = DepthConfig { activation: DepthActivation::Radius, scale: MOTION_RADIUS };
        let (stages, input_channels) = ([16, 32, 48, 64], 2 * PICTURE_CHANNELS);
        let backbone = BackboneConfig::Compact { stem: 16, stages, pyramid: 24, input_channels };
        Self { backbone, depth, ..Self::compact(MOTION_RADIUS) }
    }

    /// Channels of the input: 3 a picture.
    pub fn input_channels(&self) -> usize {
        self.backbone.input_channels()
    }

    /// Number the input's sides must be multiples of, px.
    pub fn input_multiple(&self) -> u32 {
        self.backbone.shape().coarsest_stride as u32
    }

    /// Input pixels per cell of the output maps.
    pub fn output_stride(&self) -> usize {
        match self.head {
            HeadConfig::Paper { .. } => 1,
            HeadConfig::Depthwise => self.backbone.finest_stride(),
        }
    }

    /// Refuses values no network can be built from.
    ///
    /// # Errors
    /// [`Error::Value`] with the field.
    pub fn check(&self) -> Result<()> {
        let refuse = |field: &str, reason: String| Err(Error::value("model", field, reason));
        let BackboneShape { features, mut sizes, .. } = self.backbone.shape();
        if let HeadConfig::Paper { channels } = self.head {
            sizes.extend(channels);
        }
        if let Some(wrong) = sizes.iter().find(|&&count| count == 0 || count > MAX_CHANNELS) {
            return refuse("channels/depths", format!("must be 1 to {MAX_CHANNELS}, not {wrong}"));
        }
        let channels = self.input_channels();
        if ![1, 2].map(|pictures| pictures * PICTURE_CHANNELS).contains(&channels) {
            return refuse("backbone.input_channels", format!("must be 3 or 6, not {channels}"));
        }
        let several = features.len() > 1;
        if several != matches!(self.head, HeadConfig::Paper { .. }) {
            let count = features.len();
            return refuse(
                "head",
                format!("`paper` takes several feature maps, `depthwise` one; the backbone has {count}"),
            );
        }
        for (field, value) in [("heatmap.beta", self.heatmap.beta), ("depth.scale", self.depth.scale)] {
            if !(value.is_finite() && value > 0.0) {
                return refuse(field, format!("must be positive, not {value}"));
            }
        }
        Ok(())
    }
}
