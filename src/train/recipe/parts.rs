//! The parts of a recipe.

use serde::{Deserialize, Serialize};

use gravisight_physics::{Contact, Scene};

/// Pictures of a window that the forecast starts from, where pictures tell the velocity.
pub(in crate::train) const STARTS: usize = 3;

/// What teaches depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Supervision {
    /// 2D labels and physics: each clip's track is fitted by the scene's physics, all frames at once, and the
    /// network learns the fitted depths.
    #[serde(rename = "physics-fit")]
    PhysicsFit,
    /// Forecasts must meet the network's own 2D positions in other frames (detached): the target of the paper's method, which takes
    /// the velocity from three pictures ([`Velocity::Pictures`]).
    #[serde(rename = "future-2d-predict")]
    Future2dPredict,
    /// Forecasts must meet the 2D labels of other frames: the target of the paper's 2D-gt. (Its text replaces the forecast by them, which
    /// would leave none in the loss.)
    #[serde(rename = "future-2d-gt")]
    Future2dGt,
    /// The network's own positions at the later times of a window must be the true ones in camera coordinates (L1): the paper's
    /// 3D-gt, as printed. Needs 3D labels.
    #[serde(rename = "future-3d-gt")]
    Future3dGt,
    /// 3D labels (`world` of each frame) teach the depth map: a baseline, not the paper's method.
    #[serde(rename = "3d-gt")]
    Labels3d,
    /// 3D labels on the recipe's `labelled_fraction` of the clips, `physics-fit` on the others.
    #[serde(rename = "mixed")]
    Mixed,
    /// Renderings of random scenes, without any clips: apparent radius for any ball (network `compact-size`).
    #[serde(rename = "rendered")]
    Rendered,
    /// Crops of such renderings around the candidates of the run's `detector`, for the verifier (network
    /// `verifier`).
    #[serde(rename = "candidates")]
    Candidates,
    /// Stacks of frames around what moves in videos, for the motion network (network `motion`) of the run's `detector`.
    #[serde(rename = "motion")]
    Motion,
}

impl Supervision {
    /// Whether it learns from renderings of random scenes, not from clips.
    pub fn is_rendered(self) -> bool {
        matches!(self, Self::Rendered | Self::Candidates | Self::Motion)
    }

    /// Which network of a model it trains: the detector (0), the verifier (1) or the motion network (2).
    pub fn network(self) -> usize {
        match self {
            Self::Candidates => 1,
            Self::Motion => 2,
            _ => 0,
        }
    }

    /// Whether it learns through forecasts.
    pub fn is_future(self) -> bool {
        matches!(self, Self::Future2dPredict | Self::Future2dGt | Self::Future3dGt)
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
    /// Largest fraction of outliers among the labels of a clip that teaches at all.
    pub largest_outlier_fraction: f64,
    /// Solve the equations of motion numerically even where there is a closed form, to compare.
    pub numeric: bool,
}

impl Default for FitConfig {
    /// Half weight at 5 cm, where a fit is no better than the network is to be; none beyond 30 cm.
    fn default() -> Self {
        Self {
            noise_px: None,
            half_weight_sigma: 0.05,
            largest_sigma: 0.3,
            largest_outlier_fraction: 0.2,
            numeric: false,
        }
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
    /// Where the forecast's velocity is from.
    pub velocity: Velocity,
    /// Consecutive frames of a clip that are drawn together, where pictures tell the velocity: each that has neighbours and a frame ahead
    /// among them is the middle of a window. A batch then has three times as many forecasts (the short ones more often), and noise in
    /// one frame's depth, which enters its neighbours' velocities with opposite signs, partly cancels. Where absent, each window has
    /// its own pictures, as in the paper.
    pub sequence: Option<usize>,
    /// Frames on either side that tell the velocity, with [`Velocity::Labels`].
    pub around: usize,
    /// Numbers of the scenes that are known only roughly, and learned along with the network.
    pub learn: Vec<Law>,
}

impl Default for FutureConfig {
    /// The paper's Δn for its synthetic data; robust, because one start inside a wall forecasts hundreds of px.
    fn default() -> Self {
        Self {
            ahead: vec![4, 8, 15],
            weight: 0.5,
            ramp: 300,
            robust_px: 3.0,
            numeric: false,
            velocity: Velocity::Labels,
            sequence: None,
            around: 5,
            learn: vec![],
        }
    }
}

/// A number of the clips' physics that forecasts can tell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Law {
    /// The size of the gravitational acceleration. Depth and gravity tell each other: this needs contacts, whose places are
    /// known.
    Gravity,
    /// The restitution of the contact model `bounce`.
    Restitution,
    /// The ball's drag coefficient.
    Drag,
}

impl Law {
    /// Its name in a recipe.
    pub fn name(self) -> &'static str {
        match self {
            Self::Gravity => "gravity",
            Self::Restitution => "restitution",
            Self::Drag => "drag",
        }
    }

    /// Whether `scene` has it: what is zero stays zero.
    pub fn is_of(self, scene: &Scene) -> bool {
        match self {
            Self::Gravity => scene.gravity != [0.0; 3],
            Self::Drag => scene.ball.drag_coefficient > 0.0,
            Self::Restitution => matches!(scene.contact, Contact::Bounce { restitution, .. } if restitution > 0.0),
        }
    }
}

/// Where the velocity is from that a forecast starts with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Velocity {
    /// The network's positions in three neighbouring pictures, as in the paper. Their depth noise weighs some twenty
    /// times as much as their common depth, so this needs several thousand steps, and [`FutureConfig::sequence`] helps.
    Pictures,
    /// 2D positions around one picture (the labels; with `future-2d-predict` what the network itself found there), in
    /// free flight: closed form, linear in the depth of that picture. Forecasts go both ways in time.
    #[default]
    Labels,
}

/// By what the weights are chosen that a run keeps, among those scored on the validation clips.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Select {
    /// Forecasts against 2D labels: needs no 3D truth.
    #[default]
    Forecast,
    /// Mean distance to the true position, as in the paper: needs 3D labels of the validation clips.
    Dtg,
}

/// Random changes of training pictures.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Augmentation {
    /// Half range of contrast and brightness changes, as fractions of the channels' deviation.
    pub brightness: f32,
    /// Half range of each channel's own contrast and brightness changes, likewise.
    pub colour: f32,
    /// Half range of the noise of every pixel, likewise.
    pub noise: f32,
    /// Largest fraction that a pixel takes from its neighbours in each direction.
    pub blur: f32,
    /// Largest shift, px of the network's input; the camera's matrix moves along.
    pub shift: u32,
    /// Largest rotation in the picture's plane, degrees: a rolled camera sees the same depths.
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

/// How the heatmap is compared with the 2D label.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum HeatmapLoss {
    /// Cross-entropy of the decoded distribution against a Gaussian of `sigma` input px.
    CrossEntropy {
        /// Standard deviation, input px.
        sigma: f64,
    },
    /// Mean squared error of the raw heatmap against `amplitude`·Gaussian (as published: 100, 2 px).
    Mse {
        /// Peak of the target.
        amplitude: f64,
        /// Standard deviation, input px.
        sigma: f64,
    },
}

impl HeatmapLoss {
    /// Standard deviation of the target, input px.
    pub fn sigma(&self) -> f64 {
        match *self {
            Self::CrossEntropy { sigma } | Self::Mse { sigma, .. } => sigma,
        }
    }
}

/// Network by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Network {
    /// [`PenConfig::compact`](crate::model::PenConfig::compact).
    #[serde(rename = "compact")]
    Compact,
    /// [`PenConfig::compact_size`](crate::model::PenConfig::compact_size).
    #[serde(rename = "compact-size")]
    CompactSize,
    /// [`PenConfig::motion`](crate::model::PenConfig::motion).
    #[serde(rename = "motion")]
    Motion,
    /// [`PenConfig::verifier`](crate::model::PenConfig::verifier).
    #[serde(rename = "verifier")]
    Verifier,
    /// [`PenConfig::paper`](crate::model::PenConfig::paper), with ResNet34.
    #[serde(rename = "paper")]
    Paper,
    /// [`PenConfig::convnext_nano`](crate::model::PenConfig::convnext_nano).
    #[serde(rename = "convnext-nano")]
    ConvNextNano,
    /// [`PenConfig::convnext_nano`](crate::model::PenConfig::convnext_nano), the second version.
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

impl Phase {
    /// Learning rate of the phase's step `step`: linear warm-up, then half a cosine.
    pub fn learning_rate(&self, step: usize) -> f64 {
        if step < self.warm_up {
            return self.learning_rate * (step + 1) as f64 / self.warm_up as f64;
        }
        let progress = (step - self.warm_up) as f64 / (self.steps - self.warm_up).max(1) as f64;
        let fraction = 0.5 * (1.0 + (std::f64::consts::PI * progress).cos());
        self.final_learning_rate + (self.learning_rate - self.final_learning_rate) * fraction
    }
}
