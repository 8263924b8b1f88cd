//! The network: backbone, heatmap head, depth head.

use burn::module::Module;
use burn::nn::Initializer;
use burn::tensor::activation::softplus_with_threshold;
use burn::tensor::{Device, Tensor};

use super::backbone::Backbone;
use super::config::{DepthActivation, DepthConfig, HeadConfig, PenConfig};
use super::head::Head;
use super::layers::upsample;

/// Softplus of the published depth head: beta, and where it turns linear.
const SOFTPLUS_BETA: f64 = 2.0;
const SOFTPLUS_THRESHOLD: f64 = 16.0;
/// The published heads work at stride 2; their maps are brought to the input's size.
const PAPER_UPSAMPLING: usize = 2;

/// Position estimation network.
#[derive(Module, Debug)]
pub struct Pen {
    backbone: Backbone,
    heatmap_head: Head,
    depth_head: Head,
    #[module(skip)]
    config: PenConfig,
}

/// The network's maps; a cell covers `stride`×`stride` input pixels.
#[derive(Debug, Clone)]
pub struct PenOutput {
    /// Heatmap before the softmax, `[batch, height/stride, width/stride]`.
    pub heatmap: Tensor<3>,
    /// Depth (camera z) in m, `[batch, height/stride, width/stride]`.
    pub depth: Tensor<3>,
}

impl Pen {
    /// A network with random weights on `device` (seed it with `device.seed`).
    ///
    /// # Errors
    /// As [`PenConfig::check`].
    pub fn new(config: &PenConfig, device: &Device) -> crate::error::Result<Self> {
        config.check()?;
        let features = Backbone::channels(&config.backbone);
        // A zero last layer starts the exponential depth at the prior.
        let depth_last = match config.depth.activation {
            DepthActivation::Exp => Initializer::Zeros,
            DepthActivation::Softplus => Initializer::XavierUniform { gain: 1.0 },
        };
        let head = |last| Head::new(&config.head, features, last, device);
        Ok(Self {
            backbone: Backbone::new(&config.backbone, device),
            heatmap_head: head(Initializer::XavierUniform { gain: 1.0 }),
            depth_head: head(depth_last),
            config: config.clone(),
        })
    }

    /// The architecture.
    pub fn config(&self) -> &PenConfig {
        &self.config
    }

    /// Runs the network on normalised pictures, `[batch, 3, height, width]`, sides multiples of
    /// [`PenConfig::input_multiple`].
    pub fn forward(&self, pictures: Tensor<4>) -> PenOutput {
        let features = self.backbone.forward(pictures);
        let mut heatmap = self.heatmap_head.forward(features.clone());
        let mut depth = activate(self.depth_head.forward(features), &self.config.depth);
        if let HeadConfig::Paper { .. } = self.config.head {
            heatmap = upsample(heatmap, PAPER_UPSAMPLING);
            depth = upsample(depth, PAPER_UPSAMPLING);
        }
        PenOutput { heatmap: heatmap.squeeze_dim(1), depth: depth.squeeze_dim(1) }
    }
}

/// Positive depth in m from the head's raw output, any shape.
fn activate(raw: Tensor<4>, config: &DepthConfig) -> Tensor<4> {
    let positive = match config.activation {
        DepthActivation::Softplus => softplus_with_threshold(raw, SOFTPLUS_BETA, SOFTPLUS_THRESHOLD),
        DepthActivation::Exp => raw.exp(),
    };
    positive.mul_scalar(config.scale)
}
