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
pub use self::parts::{
    Augmentation, FitConfig, FutureConfig, HeatmapLoss, Law, Network, Phase, Select, Supervision, Velocity,
};
#[cfg(not(target_arch = "wasm32"))]
pub use self::paths::{RunPaths, TrainConfig};
#[cfg(not(target_arch = "wasm32"))]
pub use self::settings::TrainSettings;
use crate::model::PenConfig;
use gravisight_geometry::image::Normalisation;
use gravisight_geometry::size::Size;
use gravisight_physics::Contact;

/// What is learned, and how: all of a training but its files. `run.toml` is this structure and the run's paths; the presets
/// are this structure; `train --set FIELD=VALUE` sets any field.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Name of the model made.
    pub name: String,
    /// Name of the training data for the model's card; the folder's name where absent.
    #[serde(default)]
    pub data_name: Option<String>,
    /// What users of the model should know, in words, for its card.
    #[serde(default)]
    pub description: String,
    /// Licence of the model, for its card.
    #[serde(default = "default_licence")]
    pub licence: String,
    /// Seed of weights and batches.
    #[serde(default = "default_seed")]
    pub seed: u64,
    /// What teaches depth.
    pub supervision: Supervision,
    /// Fraction of the clips whose 3D labels teach in supervision `mixed`; the physics of the others does.
    #[serde(default)]
    pub labelled_fraction: f64,
    /// Contact model instead of the scenes' own: for comparisons, or where the scenes name none.
    #[serde(default)]
    pub contact: Option<Contact>,
    /// Standard deviation of noise that is added to every 2D label, px, to see what labels by hand would do.
    #[serde(default)]
    pub label_noise_px: f64,
    /// Angle by which the training clips' cameras are rotated, degrees, to see what a bad calibration
    /// does: each camera once, about a random axis through its centre.
    #[serde(default)]
    pub camera_off_degrees: f64,
    /// Clips that are used of each camera and environment: all where absent.
    #[serde(default)]
    pub clips_per_camera: Option<usize>,
    /// How physics is fitted to the labels (supervision `physics-fit`, `mixed`).
    #[serde(default)]
    pub fit: FitConfig,
    /// How forecasts teach (supervision `future-2d-…`).
    #[serde(default)]
    pub future: FutureConfig,
    /// Fraction of the pictures of a batch that show the scene without its ball (the clips' median), so that the
    /// network learns to say that there is none.
    #[serde(default = "default_empty_fraction")]
    pub empty_fraction: f64,
    /// Network by name; [`Self::architecture`] overrides it.
    #[serde(default = "default_network")]
    pub network: Network,
    /// Depth the network starts at, m; where absent the mean of the depths that teach, or where forecasts do the cameras' distance from
    /// their scenes' origin.
    #[serde(default)]
    pub prior_depth: Option<f64>,
    /// Weight of the depth loss against the heatmap loss. It must stay small: with 2 the 2D error is four times
    /// worse early on.
    #[serde(default = "default_depth_weight")]
    pub depth_weight: f64,
    /// Weight of the decoded position's distance from the label, px, against the heatmap loss.
    #[serde(default)]
    pub centre_weight: f64,
    /// Depth error at which the depth loss turns from square to linear, m: of the size that is to be reached.
    #[serde(default = "default_depth_transition")]
    pub depth_transition: f64,
    /// Weight decay of AdamW (decoupled, times the learning rate). Zero makes it Adam.
    #[serde(default = "default_weight_decay")]
    pub weight_decay: f64,
    /// Adam's ε, against a division by a gradient that is zero.
    #[serde(default = "default_adam_epsilon")]
    pub adam_epsilon: f64,
    /// Decay of the exponential moving average of the weights, a step. The average is what is scored and kept.
    #[serde(default = "default_ema_decay")]
    pub ema_decay: f64,
    /// Whether that decay grows from 1/10 to its full value, so that the random start is forgotten.
    #[serde(default = "default_ema_warm_up")]
    pub ema_warm_up: bool,
    /// By what the weights are chosen that are kept.
    #[serde(default)]
    pub select: Select,
    /// Global gradient norm above which gradients are scaled down.
    #[serde(default = "default_clip_norm")]
    pub clip_norm: f64,
    /// Keep the norms' statistics as they are: to go on from a model (`start_from` of the run) with pictures of few places, which have
    /// other statistics.
    #[serde(default)]
    pub fixed_norms: bool,
    /// Random changes of the pictures.
    #[serde(default)]
    pub augmentation: Augmentation,
    /// Memory for decoded pictures, MB; what does not fit is decoded again each time.
    #[serde(default = "default_cache_mb")]
    pub cache_mb: usize,
    /// Steps between checkpoints.
    #[serde(default = "default_checkpoint_every")]
    pub checkpoint_every: usize,
    /// Steps between scores on the validation clips.
    #[serde(default = "default_validate_every")]
    pub validate_every: usize,
    /// Validation frames scored each time, in whole clips spread over all.
    #[serde(default = "default_validate_frames")]
    pub validate_frames: usize,
    /// Size of the network's input.
    pub input: Size,
    /// Normalisation of the network's input.
    #[serde(default)]
    pub normalisation: Normalisation,
    /// Architecture, where no named one fits.
    #[serde(default)]
    pub architecture: Option<PenConfig>,
    /// Heatmap loss; where absent, the published one for `paper` and cross-entropy for `compact`.
    #[serde(default)]
    pub heatmap_loss: Option<HeatmapLoss>,
    /// What is done, in order.
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
        self.heatmap_loss.unwrap_or(match self.network {
            Network::Compact | Network::CompactSize | Network::Verifier | Network::Motion => {
                HeatmapLoss::CrossEntropy { sigma: 4.0 }
            }
            Network::Paper | Network::ConvNextNano | Network::ConvNextV2Nano => {
                HeatmapLoss::Mse { amplitude: 100.0, sigma: 2.0 }
            }
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
