//! `run.toml`: one structure is the file, its defaults and what is saved with the run.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::loss::HeatmapLoss;
use crate::error::{Error, Result};
use crate::image::Normalisation;
use crate::model::{InputSize, PenConfig, check_input};

/// A training run.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainConfig {
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
    /// Clips folder to train on.
    pub train: PathBuf,
    /// Clips folder that is scored while training, never trained on.
    pub validation: PathBuf,
    /// Folder of the run: checkpoints, log and the model made.
    pub out: PathBuf,
    /// Seed of weights and batches.
    #[serde(default = "default_seed")]
    pub seed: u64,
    /// What teaches depth.
    pub supervision: Supervision,
    /// Architecture by name; [`Self::architecture`] overrides it.
    #[serde(default = "default_preset")]
    pub preset: Preset,
    /// Depth the network starts at, m; the mean of the training labels where absent.
    #[serde(default)]
    pub prior_depth: Option<f64>,
    /// Weight of the depth loss against the heatmap loss.
    #[serde(default = "default_depth_weight")]
    pub depth_weight: f64,
    /// Depth error at which the depth loss turns from square to linear, m.
    #[serde(default = "default_depth_transition")]
    pub depth_transition: f64,
    /// Weight decay of AdamW (decoupled, times the learning rate).
    #[serde(default = "default_weight_decay")]
    pub weight_decay: f64,
    /// Decay of the exponential moving average of the weights, a step.
    #[serde(default = "default_ema_decay")]
    pub ema_decay: f64,
    /// Global gradient norm above which gradients are scaled down.
    #[serde(default = "default_clip_norm")]
    pub clip_norm: f64,
    /// Half range of the random contrast and brightness changes, as shares of the channels' deviation.
    #[serde(default = "default_jitter")]
    pub jitter: f32,
    /// Half range of the random noise of every pixel, as a share of the channels' deviation.
    #[serde(default = "default_jitter")]
    pub noise: f32,
    /// Steps between checkpoints.
    #[serde(default = "default_checkpoint_every")]
    pub checkpoint_every: usize,
    /// Steps between scores on the validation clips.
    #[serde(default = "default_validate_every")]
    pub validate_every: usize,
    /// Validation frames scored each time, spread over all.
    #[serde(default = "default_validate_frames")]
    pub validate_frames: usize,
    /// Size of the network's input.
    pub input: InputSize,
    /// Normalisation of the network's input.
    #[serde(default)]
    pub normalisation: Normalisation,
    /// A file with timm's `resnet34` weights (ImageNet, say) for the backbone to start from.
    #[serde(default)]
    pub backbone_weights: Option<PathBuf>,
    /// Architecture, where no preset fits.
    #[serde(default)]
    pub architecture: Option<PenConfig>,
    /// Heatmap loss; where absent, the published one for `paper` and cross-entropy for `compact`.
    #[serde(default)]
    pub heatmap_loss: Option<HeatmapLoss>,
    /// What is done, in order.
    pub phases: Vec<Phase>,
}

/// What teaches depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Supervision {
    /// 3D labels (`world` of each frame): the paper's baseline, not its method.
    #[serde(rename = "3d-gt")]
    Labels3d,
}

/// Architecture by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Preset {
    /// [`PenConfig::compact`].
    Compact,
    /// [`PenConfig::paper`].
    Paper,
}

/// Steps with the same crop and learning-rate schedule.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Phase {
    /// Optimiser steps.
    pub steps: usize,
    /// Pictures a step.
    pub batch: usize,
    /// Side of the square crops around the ball, px; whole pictures where absent.
    #[serde(default)]
    pub crop: Option<u32>,
    /// Learning rate after the warm-up.
    pub learning_rate: f64,
    /// Learning rate at the phase's end (half a cosine in between).
    #[serde(default)]
    pub final_learning_rate: f64,
    /// Steps over which the learning rate rises from zero.
    #[serde(default)]
    pub warm_up: usize,
}

fn default_licence() -> String {
    "not stated".into()
}
fn default_seed() -> u64 {
    1
}
fn default_preset() -> Preset {
    Preset::Compact
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
fn default_ema_decay() -> f64 {
    0.998
}
fn default_clip_norm() -> f64 {
    5.0
}
fn default_jitter() -> f32 {
    0.05
}
fn default_checkpoint_every() -> usize {
    100
}
fn default_validate_every() -> usize {
    500
}
fn default_validate_frames() -> usize {
    100
}

impl TrainConfig {
    /// Refuses values that cannot train.
    ///
    /// # Errors
    /// [`Error::Value`] with the field.
    pub fn check(&self) -> Result<()> {
        let refuse = |field: &str, reason: String| Err(Error::value("run configuration", field, reason));
        if self.phases.is_empty() {
            return refuse("phases", "needs at least one [[phases]]".into());
        }
        check_input(&self.architecture(1.0), self.input, &self.normalisation, "run configuration")?;
        let multiple = self.architecture(1.0).input_multiple();
        if self.name.is_empty() || self.name.contains(['/', '\\']) {
            return refuse("name", format!("must be a file name, not `{}`", self.name));
        }
        for (index, phase) in self.phases.iter().enumerate() {
            let field = |name: &str| format!("phases[{index}].{name}");
            if phase.steps == 0 || phase.batch == 0 {
                return refuse(&field("steps/batch"), "must be positive".into());
            }
            if !(phase.learning_rate.is_finite() && phase.learning_rate > 0.0) {
                return refuse(&field("learning_rate"), format!("must be positive, not {}", phase.learning_rate));
            }
            if !(0.0..=phase.learning_rate).contains(&phase.final_learning_rate) {
                let reason = format!("must be from 0 to the learning rate, not {}", phase.final_learning_rate);
                return refuse(&field("final_learning_rate"), reason);
            }
            let largest = self.input.width.min(self.input.height);
            if let Some(side) = phase.crop.filter(|&side| side == 0 || side % multiple != 0 || side > largest) {
                let reason = format!("must be a multiple of {multiple} up to {largest}, not {side}");
                return refuse(&field("crop"), reason);
            }
        }
        if !(0.0..1.0).contains(&self.ema_decay) {
            return refuse("ema_decay", format!("must be in [0, 1), not {}", self.ema_decay));
        }
        if self.checkpoint_every == 0 || self.validate_every == 0 || self.validate_frames == 0 {
            return refuse("checkpoint_every/validate_every/validate_frames", "must be positive".into());
        }
        for (field, value) in [
            ("depth_weight", self.depth_weight),
            ("depth_transition", self.depth_transition),
            ("clip_norm", self.clip_norm),
            ("prior_depth", self.prior_depth.unwrap_or(1.0)),
            ("heatmap_loss.sigma", self.heatmap_loss().sigma()),
        ] {
            if !(value.is_finite() && value > 0.0) {
                return refuse(field, format!("must be positive, not {value}"));
            }
        }
        for (field, value) in
            [("jitter", f64::from(self.jitter)), ("noise", f64::from(self.noise)), ("weight_decay", self.weight_decay)]
        {
            if !(0.0..=1.0).contains(&value) {
                return refuse(field, format!("must be from 0 to 1, not {value}"));
            }
        }
        Ok(())
    }

    /// The heatmap loss of the run.
    pub fn heatmap_loss(&self) -> HeatmapLoss {
        self.heatmap_loss.unwrap_or(match self.preset {
            Preset::Compact => HeatmapLoss::CrossEntropy { sigma: 4.0 },
            Preset::Paper => HeatmapLoss::Mse { amplitude: 100.0, sigma: 2.0 },
        })
    }

    /// The architecture, with `prior_depth` in m where the preset takes one.
    pub fn architecture(&self, prior_depth: f64) -> PenConfig {
        match (&self.architecture, self.preset) {
            (Some(architecture), _) => architecture.clone(),
            (None, Preset::Compact) => PenConfig::compact(prior_depth),
            (None, Preset::Paper) => PenConfig::paper(),
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

impl Phase {
    /// Learning rate of the phase's step `step`: linear warm-up, then half a cosine.
    pub fn learning_rate(&self, step: usize) -> f64 {
        if step < self.warm_up {
            return self.learning_rate * (step + 1) as f64 / self.warm_up as f64;
        }
        let progress = (step - self.warm_up) as f64 / (self.steps - self.warm_up).max(1) as f64;
        let share = 0.5 * (1.0 + (std::f64::consts::PI * progress).cos());
        self.final_learning_rate + (self.learning_rate - self.final_learning_rate) * share
    }
}
