//! The network: backbone, heatmap head, depth head.

use burn::module::Module;
use burn::module::{Flag, ModuleMapper, Param};
use burn::nn::Initializer;
use burn::tensor::activation::softplus_with_threshold;
use burn::tensor::{Device, Tensor, TensorData};

use super::backbone::Backbone;
use super::config::{DepthActivation, DepthConfig, PenConfig};
use super::head::Head;
use super::layers::Layers;
use super::plan::Plan;
use super::tensors::{Tensors, is_cpu};
use gravisight_geometry::size::Size;

/// Softplus of the published depth head: beta, and where it turns linear.
const SOFTPLUS_BETA: f64 = 2.0;
const SOFTPLUS_THRESHOLD: f64 = 16.0;

/// How far a radius may be from the middle one, as a logarithm.
const REACH: f64 = 2.0;
/// Bounds of the logarithm of the error's scale.
const LOG_SCALE: [f64; 2] = [-6.0, 2.0];

/// How often a map's values lie in memory at the peak of a training step, with what the allocator holds: of maps that a batch norm
/// makes (result, sum before the norm, gradient; measured on the compact network: 2.5 to 3.5), and of others (measured on the
/// published one, 48 pictures of 224² px: 1.2).
const COPIES_IN_TRAINING: [f64; 2] = [4.0, 1.5];

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
    /// Depth (camera z) in m, `[batch, height/stride, width/stride]`; of a network that reads sizes the ball's apparent
    /// radius in px.
    pub depth: Tensor<3>,
    /// Logarithm of the scale of the error of log(radius), as large; of a network that reads sizes.
    pub log_scale: Option<Tensor<3>>,
}

impl Pen {
    /// A network with random weights on `device` (seed it with `device.seed`).
    ///
    /// # Errors
    /// As [`PenConfig::check`].
    pub fn new(config: &PenConfig, device: &Device) -> gravisight_geometry::error::Result<Self> {
        config.check()?;
        let features = config.backbone.shape().features;
        // A zero last layer starts the exponential depth at the prior.
        let depth_last = match config.depth.activation {
            DepthActivation::Exp | DepthActivation::Radius => Initializer::Zeros,
            DepthActivation::Softplus => Initializer::XavierUniform { gain: 1.0 },
        };
        let head = |maps, last| Head::new(&config.head, &features, maps, last, device);
        Ok(Self {
            backbone: Backbone::new(&config.backbone, device),
            heatmap_head: head(1, Initializer::XavierUniform { gain: 1.0 }),
            depth_head: head(config.depth.channels(), depth_last),
            config: config.clone(),
        })
    }

    /// The same network whose norms keep their running statistics while it is trained. Pictures of a single place have
    /// other statistics than those that the network was made with, and normalising by them would change all it knows.
    pub fn with_fixed_norms(self) -> Self {
        struct Fix;
        impl ModuleMapper for Fix {
            fn map_flag(&mut self, flag: Param<Flag>) -> Param<Flag> {
                flag.with_value(false)
            }
        }
        self.map(&mut Fix)
    }

    /// The architecture.
    pub fn config(&self) -> &PenConfig {
        &self.config
    }

    /// Runs the network on normalised pictures, `[batch, height, width, channels]` (3 a picture; the verifier's 6), sides multiples of
    /// [`PenConfig::input_multiple`].
    pub fn forward(&self, pictures: Tensor<4>) -> PenOutput {
        let [heatmap, depth] = self.maps(&mut Tensors, &pictures);
        self.output(heatmap, depth)
    }

    /// A runner for pictures of `size`: on the CPU with everything worked out beforehand, elsewhere as
    /// [`Self::forward`].
    pub fn runner(self, size: Size, device: &Device) -> PenRunner {
        let plan = is_cpu(device).then(|| {
            Plan::new(size, self.config.input_channels(), |layers, picture| self.maps(layers, picture).into())
        });
        PenRunner { pen: self, size, device: device.clone(), plan }
    }

    /// Memory that a training step on `batch` pictures of `size` takes, about, in bytes: values of maps,
    /// with their gradients and what the backward pass keeps.
    pub fn training_bytes(&self, batch: usize, size: Size) -> usize {
        let values =
            Plan::map_values(size, self.config.input_channels(), |layers, picture| self.maps(layers, picture).into());
        let kept = values.iter().zip(COPIES_IN_TRAINING).map(|(&values, copies)| values as f64 * copies).sum::<f64>();
        batch * (kept * size_of::<f32>() as f64) as usize
    }

    /// What the heads say of pictures.
    fn maps<L: Layers>(&self, layers: &mut L, pictures: &L::Map) -> [L::Map; 2] {
        let features = self.backbone.forward(layers, pictures);
        [&self.heatmap_head, &self.depth_head].map(|head| head.forward(layers, &features))
    }

    /// The output from what the heads say, `[batch, h, w, maps]` each.
    fn output(&self, heatmap: Tensor<4>, depth: Tensor<4>) -> PenOutput {
        let config = &self.config.depth;
        let log_scale = config.is_size().then(|| {
            let [least, most] = LOG_SCALE;
            depth.clone().narrow(3, 1, 1).clamp(least, most)
        });
        let depth = activate(depth.narrow(3, 0, 1), config);
        // Heads work at the finest feature's stride.
        let factor = self.config.backbone.finest_stride() / self.config.output_stride();
        let finished = |map: Tensor<4>| match factor {
            1 => map.squeeze_dim(3),
            _ => Tensors.upsample(&map, factor, None).squeeze_dim(3),
        };
        PenOutput { heatmap: finished(heatmap), depth: finished(depth), log_scale: log_scale.map(finished) }
    }
}

/// A network that runs again and again on pictures of one size.
#[derive(Debug)]
pub struct PenRunner {
    pen: Pen,
    size: Size,
    device: Device,
    plan: Option<Plan>,
}

impl PenRunner {
    /// Runs the network on normalised pictures `[batch, height, width, channels]` of the runner's size. May be called
    /// by several threads at once.
    ///
    /// # Panics
    /// Where `pictures` are not whole pictures.
    pub fn run(&self, pictures: Vec<f32>) -> PenOutput {
        let [height, width] = [self.size.height, self.size.width].map(|side| side as usize);
        let Some(plan) = &self.plan else {
            let channels = self.pen.config.input_channels();
            let shape = [pictures.len() / (channels * height * width), height, width, channels];
            return self.pen.forward(Tensor::from_data(TensorData::new(pictures, shape), &self.device));
        };
        let maps: Vec<Tensor<4>> = (plan.run(&pictures).into_iter())
            .map(|(extent, values)| {
                let shape = [extent.batch, extent.height, extent.width, extent.channels];
                Tensor::from_data(TensorData::new(values, shape), &self.device)
            })
            .collect();
        let Ok([heatmap, depth]) = <[Tensor<4>; 2]>::try_from(maps) else { unreachable!("there are two heads") };
        self.pen.output(heatmap, depth)
    }
}

/// Positive depth in m (or radius in px) from the head's raw output, any shape.
fn activate(raw: Tensor<4>, config: &DepthConfig) -> Tensor<4> {
    let positive = match config.activation {
        DepthActivation::Softplus => softplus_with_threshold(raw, SOFTPLUS_BETA, SOFTPLUS_THRESHOLD),
        DepthActivation::Exp => raw.exp(),
        DepthActivation::Radius => raw.clamp(-REACH, REACH).exp(),
    };
    positive.mul_scalar(config.scale)
}
