//! `run.toml`: one structure is the file, its defaults and what is saved with the run.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::loss::HeatmapLoss;
use crate::image::Normalisation;
use crate::model::PenConfig;
use crate::physics::Contact;
use crate::size::Size;

/// A training run. `run.toml` is this structure; so are the presets, and `train --set FIELD=VALUE` sets any field.
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
    /// Share of the clips whose 3D labels teach in supervision `mixed`; the physics of the others does.
    #[serde(default)]
    pub labelled_share: f64,
    /// Contact model instead of the scenes' own: for comparisons, or where the scenes name none.
    #[serde(default)]
    pub contact: Option<Contact>,
    /// Standard deviation of noise that is added to every 2D label, px, to see what labels by hand would do.
    #[serde(default)]
    pub label_noise_px: f64,
    /// Clips that are used of each camera and environment: all where absent.
    #[serde(default)]
    pub clips_per_camera: Option<usize>,
    /// How physics is fitted to the labels (supervision `physics-fit`, `mixed`).
    #[serde(default)]
    pub fit: FitConfig,
    /// How forecasts teach (supervision `future-2d-…`).
    #[serde(default)]
    pub future: FutureConfig,
    /// Share of the pictures of a batch that show the scene without its ball (the clips' median), so that the
    /// network learns to say that there is none.
    #[serde(default = "default_empty_share")]
    pub empty_share: f64,
    /// Network by name; [`Self::architecture`] overrides it.
    #[serde(default = "default_network")]
    pub network: Network,
    /// Depth the network starts at, m; the mean of the training labels where absent.
    #[serde(default)]
    pub prior_depth: Option<f64>,
    /// Weight of the depth loss against the heatmap loss. It must stay small: with 2 the 2D error is four times
    /// worse early on.
    #[serde(default = "default_depth_weight")]
    pub depth_weight: f64,
    /// Depth error at which the depth loss turns from square to linear, m: of the size that is to be reached.
    #[serde(default = "default_depth_transition")]
    pub depth_transition: f64,
    /// Weight decay of AdamW (decoupled, times the learning rate). Zero makes it Adam.
    #[serde(default = "default_weight_decay")]
    pub weight_decay: f64,
    /// Decay of the exponential moving average of the weights, a step. The average is what is scored and kept.
    #[serde(default = "default_ema_decay")]
    pub ema_decay: f64,
    /// Global gradient norm above which gradients are scaled down.
    #[serde(default = "default_clip_norm")]
    pub clip_norm: f64,
    /// Keep the norms' statistics as they are: to go on from a model (`start_from`) with pictures of few places, which have
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
    /// The card of a model whose weights the network starts from; architecture and input are then that model's.
    #[serde(default)]
    pub start_from: Option<PathBuf>,
    /// A file with timm weights (ImageNet, say) for the backbone to start from.
    #[serde(default)]
    pub backbone_weights: Option<PathBuf>,
    /// Architecture, where no named one fits.
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
    /// 2D labels and physics: each clip's track is fitted by the scene's physics, all frames at once, and the
    /// network learns the fitted depths.
    #[serde(rename = "physics-fit")]
    PhysicsFit,
    /// The paper's method: the forecast from three neighbouring frames must meet the network's own later 2D
    /// positions (detached).
    #[serde(rename = "future-2d-predict")]
    Future2dPredict,
    /// The paper's variant: the forecast must meet the later 2D labels.
    #[serde(rename = "future-2d-gt")]
    Future2dGt,
    /// 3D labels (`world` of each frame): the paper's baseline, not its method.
    #[serde(rename = "3d-gt")]
    Labels3d,
    /// 3D labels on [`TrainConfig::labelled_share`] of the clips, `physics-fit` on the others.
    #[serde(rename = "mixed")]
    Mixed,
}

impl Supervision {
    /// As in `run.toml`.
    pub fn name(self) -> &'static str {
        match self {
            Self::PhysicsFit => "physics-fit",
            Self::Future2dPredict => "future-2d-predict",
            Self::Future2dGt => "future-2d-gt",
            Self::Labels3d => "3d-gt",
            Self::Mixed => "mixed",
        }
    }

    /// Whether it learns through forecasts.
    pub fn is_future(self) -> bool {
        matches!(self, Self::Future2dPredict | Self::Future2dGt)
    }
}

/// How physics is fitted to a clip's 2D labels, and which fits teach.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FitConfig {
    /// Standard deviation of the 2D labels, px; found from each track where absent.
    pub noise_px: Option<f64>,
    /// Standard deviation of a fitted depth at which a frame counts half, m.
    pub half_weight_sigma: f64,
    /// Largest standard deviation of a fitted depth that teaches at all, m.
    pub largest_sigma: f64,
    /// Largest share of outliers among the labels of a clip that teaches at all.
    pub largest_outlier_share: f64,
    /// Solve the equations of motion numerically even where there is a closed form, to compare.
    pub numeric: bool,
}

impl Default for FitConfig {
    /// Half weight at 5 cm, where a fit is no better than the network is to be; none beyond 30 cm.
    fn default() -> Self {
        Self { noise_px: None, half_weight_sigma: 0.05, largest_sigma: 0.3, largest_outlier_share: 0.2, numeric: false }
    }
}

/// How forecasts teach.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FutureConfig {
    /// Frames ahead at which forecast and track are compared (the paper's Δn).
    pub ahead: Vec<usize>,
    /// Weight of the future loss (px) against the heatmap loss, after the ramp.
    pub weight: f64,
    /// Steps over which the weight rises from zero: early depths forecast nothing sensible.
    pub ramp: usize,
    /// Error beyond which the loss grows only logarithmically, px; infinite for the paper's plain L1.
    pub robust_px: f64,
    /// Solve the equations of motion numerically even where there is a closed form, to compare.
    pub numeric: bool,
}

impl Default for FutureConfig {
    /// The paper's Δn for its synthetic data; robust, because one start inside a wall forecasts hundreds of px.
    fn default() -> Self {
        Self { ahead: vec![4, 8, 15], weight: 0.05, ramp: 500, robust_px: 10.0, numeric: false }
    }
}

/// Random changes of training pictures.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Augmentation {
    /// Half range of contrast and brightness changes, as shares of the channels' deviation.
    pub brightness: f32,
    /// Half range of each channel's own contrast and brightness changes, likewise.
    pub colour: f32,
    /// Half range of the noise of every pixel, likewise.
    pub noise: f32,
    /// Largest share that a pixel takes from its neighbours in each direction.
    pub blur: f32,
    /// Largest shift, px of the network's input; the camera's matrix moves along.
    pub shift: u32,
    /// Largest turn in the picture's plane, degrees: a rolled camera sees the same depths.
    pub roll_degrees: f64,
    /// Largest magnification less one, up or down: a longer lens shows a ball that is as large as a nearer one, and is
    /// taught as that.
    pub zoom: f64,
    /// Probability of a horizontal mirroring; physics and camera are mirrored along.
    pub flip: f64,
}

impl Default for Augmentation {
    /// Light only. A fixed camera's picture does not shift, and of its background the network learns depth.
    fn default() -> Self {
        Self {
            brightness: 0.05,
            colour: 0.0,
            noise: 0.05,
            blur: 0.0,
            shift: 0,
            roll_degrees: 0.0,
            zoom: 0.0,
            flip: 0.0,
        }
    }
}

/// Network by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Network {
    /// [`PenConfig::compact`].
    #[serde(rename = "compact")]
    Compact,
    /// [`PenConfig::paper`], with ResNet34.
    #[serde(rename = "paper")]
    Paper,
    /// [`PenConfig::convnext_nano`].
    #[serde(rename = "convnext-nano")]
    ConvNextNano,
    /// [`PenConfig::convnextv2_nano`].
    #[serde(rename = "convnextv2-nano")]
    ConvNextV2Nano,
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
fn default_empty_share() -> f64 {
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

impl TrainConfig {
    /// The heatmap loss of the run.
    pub fn heatmap_loss(&self) -> HeatmapLoss {
        self.heatmap_loss.unwrap_or(match self.network {
            Network::Compact => HeatmapLoss::CrossEntropy { sigma: 4.0 },
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
