//! What a run is: the recipe, where it lives, and how the two are put together from presets, files and flags.

mod check;
mod parts;
#[cfg(not(target_arch = "wasm32"))]
mod paths;
#[cfg(not(target_arch = "wasm32"))]
mod settings;
#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};

pub(in crate::train) use self::parts::STARTS;
use self::parts::default_sigma;
pub use self::parts::{
    Augmentation, FitConfig, FutureConfig, HeatmapLoss, Law, Network, Phase, Select, Supervision, Velocity,
};
#[cfg(not(target_arch = "wasm32"))]
pub use self::paths::{RunPaths, TrainConfig};
#[cfg(not(target_arch = "wasm32"))]
pub use self::settings::TrainSettings;
use crate::model::{HeadConfig, PenConfig};
use gravisight_geometry::image::Normalisation;
use gravisight_geometry::size::Size;
use gravisight_physics::Contact;

/// What is learned, and how: all of a training but its files. `run.toml` is this structure and the run's paths; the presets
/// are this structure; `train --set FIELD=VALUE` sets any field.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Name of the trained model.
    pub name: String,
    /// Name of the training data on the model's card. If unset, it is the folder's name.
    #[serde(default)]
    pub data_name: Option<String>,
    /// Text for the model's card; empty by default.
    #[serde(default)]
    pub description: String,
    /// Licence of the model, as its card states it.
    #[serde(default = "default_licence")]
    pub licence: String,
    /// Random seed of the initial weights and the batches.
    #[serde(default = "default_seed")]
    pub seed: u64,
    /// Source of depth supervision; see below.
    pub supervision: Supervision,
    /// With supervision `mixed`: fraction of the clips that train on their 3D labels.
    #[serde(default)]
    pub labelled_fraction: f64,
    /// Contact model that replaces the scenes' own, for comparisons or for scenes without one.
    #[serde(default)]
    pub contact: Option<Contact>,
    /// Standard deviation of Gaussian noise that is added to every 2D label, px. It simulates hand-made labels.
    #[serde(default)]
    pub label_noise_px: f64,
    /// Angle by which each training camera is rotated about a random axis through its centre, degrees. It simulates a
    /// calibration error.
    #[serde(default)]
    pub camera_off_degrees: f64,
    /// Number of clips to use per camera and environment. If unset, all are used.
    #[serde(default)]
    pub clips_per_camera: Option<usize>,
    /// Settings of the physics fit, with supervision `physics-fit` or `mixed`.
    #[serde(default)]
    pub fit: FitConfig,
    /// Settings of the forecasts, with supervision `future-…`.
    #[serde(default)]
    pub future: FutureConfig,
    /// Fraction of the pictures in a batch that show the scene without the ball. They train the network to report that there
    /// is no ball. Each is the median of a clip's frames. Not used with `velocity = "pictures"` or with supervision `motion`.
    #[serde(default = "default_empty_fraction")]
    pub empty_fraction: f64,
    /// Name of the network. `architecture` overrides it.
    #[serde(default = "default_network")]
    pub network: Network,
    /// Depth that the network `compact` predicts before training, m. If unset, it is the mean of the target depths. With
    /// `future-…`, it is the mean depth of the scenes' origins.
    #[serde(default)]
    pub prior_depth: Option<f64>,
    /// Weight of the depth loss relative to the heatmap loss. Keep it small: with 2, the early 2D error is four times as
    /// large.
    #[serde(default = "default_depth_weight")]
    pub depth_weight: f64,
    /// Weight of the position loss relative to the heatmap loss. The position loss is the distance of the decoded position
    /// from the label, px.
    #[serde(default)]
    pub centre_weight: f64,
    /// Depth error at which the smooth L1 loss changes from quadratic to linear, m. Choose it near the accuracy that you
    /// want to reach.
    #[serde(default = "default_depth_transition")]
    pub depth_transition: f64,
    /// Decoupled weight decay of AdamW; each step multiplies it by the learning rate. With zero, the optimiser is Adam.
    #[serde(default = "default_weight_decay")]
    pub weight_decay: f64,
    /// Adam's ε. It avoids a division by zero where gradients vanish.
    #[serde(default = "default_adam_epsilon")]
    pub adam_epsilon: f64,
    /// Decay per step of the weights' exponential moving average (EMA). The averaged weights are validated and saved.
    #[serde(default = "default_ema_decay")]
    pub ema_decay: f64,
    /// Whether `ema_decay` grows from 1/10 to its full value. This removes the random initial weights from the average.
    #[serde(default = "default_ema_warm_up")]
    pub ema_warm_up: bool,
    /// Validation criterion that selects the saved weights.
    #[serde(default)]
    pub select: Select,
    /// Global gradient norm above which gradients are scaled down.
    #[serde(default = "default_clip_norm")]
    pub clip_norm: f64,
    /// Whether the batch-norm layers keep their running statistics. Use it to fine-tune a model (`start_from`) on pictures
    /// of few places, whose statistics differ.
    #[serde(default)]
    pub fixed_norms: bool,
    /// Random changes to the pictures of clips; see below.
    #[serde(default)]
    pub augmentation: Augmentation,
    /// Memory for decoded pictures, MB: for training and for validation each. Pictures that do not fit are decoded again
    /// each time.
    #[serde(default = "default_cache_mb")]
    pub cache_mb: usize,
    /// Steps between checkpoints.
    #[serde(default = "default_checkpoint_every")]
    pub checkpoint_every: usize,
    /// Steps between validations.
    #[serde(default = "default_validate_every")]
    pub validate_every: usize,
    /// Approximate number of frames per validation. They come from whole clips, evenly spread over the validation set.
    #[serde(default = "default_validate_frames")]
    pub validate_frames: usize,
    /// Width and height of the network's input, px, such as `{width=224, height=224}`.
    pub input: Size,
    /// Channel means and standard deviations that normalise the input; ImageNet's by default.
    #[serde(default)]
    pub normalisation: Normalisation,
    /// Custom architecture, in the format of a model's card. It replaces the named `network`.
    #[serde(default)]
    pub architecture: Option<PenConfig>,
    /// Heatmap loss. If unset, it is `mse` for the paper's networks, otherwise `cross_entropy`.
    #[serde(default)]
    pub heatmap_loss: Option<HeatmapLoss>,
    /// Training phases, in order; see below.
    pub phases: Vec<Phase>,
}

fn default_licence() -> String {
    "not stated".into()
}
fn default_seed() -> u64 {
    1
}
fn default_empty_fraction() -> f64 {
    0.04
}
fn default_network() -> Network {
    Network::Compact
}
fn default_depth_weight() -> f64 {
    0.2
}
fn default_depth_transition() -> f64 {
    0.05
}
fn default_weight_decay() -> f64 {
    0.01
}
fn default_adam_epsilon() -> f64 {
    1e-5
}
fn default_ema_warm_up() -> bool {
    true
}
fn default_ema_decay() -> f64 {
    0.998
}
fn default_clip_norm() -> f64 {
    5.0
}
fn default_cache_mb() -> usize {
    2048
}
fn default_checkpoint_every() -> usize {
    100
}
fn default_validate_every() -> usize {
    500
}
fn default_validate_frames() -> usize {
    900
}

impl Recipe {
    /// With what must be said; all else at its default.
    pub(super) fn new(name: String, supervision: Supervision, input: Size, phases: Vec<Phase>) -> Self {
        Self {
            name,
            data_name: None,
            description: String::new(),
            licence: default_licence(),
            seed: default_seed(),
            supervision,
            labelled_fraction: 0.0,
            contact: None,
            label_noise_px: 0.0,
            camera_off_degrees: 0.0,
            clips_per_camera: None,
            fit: FitConfig::default(),
            future: FutureConfig::default(),
            empty_fraction: default_empty_fraction(),
            network: default_network(),
            prior_depth: None,
            depth_weight: default_depth_weight(),
            centre_weight: 0.0,
            depth_transition: default_depth_transition(),
            weight_decay: default_weight_decay(),
            adam_epsilon: default_adam_epsilon(),
            ema_decay: default_ema_decay(),
            ema_warm_up: default_ema_warm_up(),
            select: Select::default(),
            clip_norm: default_clip_norm(),
            fixed_norms: false,
            augmentation: Augmentation::default(),
            cache_mb: default_cache_mb(),
            checkpoint_every: default_checkpoint_every(),
            validate_every: default_validate_every(),
            validate_frames: default_validate_frames(),
            input,
            normalisation: Normalisation::default(),
            architecture: None,
            heatmap_loss: None,
            phases,
        }
    }

    /// The heatmap loss of the run.
    pub fn heatmap_loss(&self) -> HeatmapLoss {
        self.heatmap_loss.unwrap_or(match self.architecture(1.0).head {
            HeadConfig::Depthwise => HeatmapLoss::CrossEntropy { sigma: default_sigma() },
            HeadConfig::Paper { .. } => HeatmapLoss::Mse { amplitude: 100.0, sigma: 2.0 },
        })
    }

    /// The architecture, with `prior_depth` in m where the preset takes one.
    pub fn architecture(&self, prior_depth: f64) -> PenConfig {
        match (&self.architecture, self.network) {
            (Some(architecture), _) => architecture.clone(),
            (None, Network::Compact) => PenConfig::compact(prior_depth),
            (None, Network::CompactSize) => PenConfig::compact_size(),
            (None, Network::Verifier) => PenConfig::verifier(),
            (None, Network::Motion) => PenConfig::motion(),
            (None, Network::Paper) => PenConfig::paper(),
            (None, Network::ConvNextNano) => PenConfig::convnext_nano(),
            (None, Network::ConvNextV2Nano) => PenConfig::convnextv2_nano(),
        }
    }

    /// Steps of all phases.
    pub fn steps(&self) -> usize {
        self.phases.iter().map(|phase| phase.steps).sum()
    }

    /// The phase that step `step` (from 0) belongs to, and the step's number in it.
    pub fn phase(&self, step: usize) -> Option<(&Phase, usize)> {
        let mut first = 0;
        for phase in &self.phases {
            if step < first + phase.steps {
                return Some((phase, step - first));
            }
            first += phase.steps;
        }
        None
    }
}
