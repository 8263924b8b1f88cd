//! The parts of a recipe.

use serde::{Deserialize, Serialize};

use gravisight_physics::{Contact, Scene};

/// Pictures of a window that the forecast starts from, where pictures tell the velocity.
pub(in crate::train) const STARTS: usize = 3;

/// What teaches depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Supervision {
    /// 2D labels and physics. A trajectory is fitted to all 2D labels of each clip at once, and the network learns its
    /// depths. Of the methods that use only 2D labels, this is the most accurate.
    #[serde(rename = "physics-fit")]
    PhysicsFit,
    /// Forecasts must match the network's own 2D positions in other frames. With `future.velocity = "pictures"`, this is the
    /// paper's method.
    #[serde(rename = "future-2d-predict")]
    Future2dPredict,
    /// Forecasts must match the 2D labels of other frames: the paper's 2D-gt. (The paper's text replaces the forecast by the
    /// labels; the loss would then contain no forecast.)
    #[serde(rename = "future-2d-gt")]
    Future2dGt,
    /// The network's positions in a window's later frames must match the 3D labels: the paper's 3D-gt. The loss is L1, in
    /// camera coordinates. It needs `future.velocity = "pictures"`.
    #[serde(rename = "future-3d-gt")]
    Future3dGt,
    /// The depth map is trained on 3D labels (`world` of each frame). This is a baseline, not the paper's method.
    #[serde(rename = "3d-gt")]
    Labels3d,
    /// A fraction `labelled_fraction` of the clips is trained on 3D labels, the rest with `physics-fit`.
    #[serde(rename = "mixed")]
    Mixed,
    /// The network learns the apparent radius of any ball from rendered pictures of random scenes, not from clips. It needs
    /// the network `compact-size`.
    #[serde(rename = "rendered")]
    Rendered,
    /// The verifier learns from crops of rendered pictures, around the candidates that `detector` finds. It needs the
    /// network `verifier`.
    #[serde(rename = "candidates")]
    Candidates,
    /// The motion network learns from stacks of frames around moving objects in videos. It becomes part of the model
    /// `detector`. It needs the network `motion`.
    #[serde(rename = "motion")]
    Motion,
}

impl Supervision {
    /// Whether it learns from renderings of random scenes, not from clips.
    pub fn is_rendered(self) -> bool {
        matches!(self, Self::Rendered | Self::Candidates | Self::Motion)
    }

    /// Channels of the pictures that it gives a network: 3 a view.
    pub fn input_channels(self) -> usize {
        match self {
            Self::Candidates | Self::Motion => 6,
            _ => 3,
        }
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
    /// Standard deviation of the 2D labels, px. If unset, it is estimated from each track.
    pub noise_px: Option<f64>,
    /// Standard deviation of a fitted depth at which the frame's weight is one half, m.
    pub half_weight_sigma: f64,
    /// Maximum standard deviation of a fitted depth, m. Training omits frames above it.
    pub largest_sigma: f64,
    /// Maximum fraction of outliers among a clip's 2D labels. Training omits clips above it.
    pub largest_outlier_fraction: f64,
    /// Whether to solve the equations of motion numerically even where a closed form exists; for comparisons.
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
    /// Numbers of frames ahead at which the forecast is compared with the track (the paper's Δn).
    pub ahead: Vec<usize>,
    /// Weight of the future loss (px) relative to the heatmap loss, after the ramp.
    pub weight: f64,
    /// Steps over which the weight rises from zero. Early in training, the depths are too inaccurate for useful forecasts.
    pub ramp: usize,
    /// Scale s of the robust loss s·ln(1 + e/s), px: errors e well above s count little more. With `inf`, it is the paper's
    /// plain L1.
    pub robust_px: f64,
    /// Whether to solve the equations of motion numerically even where a closed form exists; for comparisons.
    pub numeric: bool,
    /// Source of the forecast's initial velocity.
    pub velocity: Velocity,
    /// With `velocity = "pictures"`: number of consecutive frames that a batch takes together. A frame is the middle of a
    /// window if the sequence contains both its neighbours and a frame to compare with. With 24, a batch has about three
    /// times as many forecasts. Noise in one frame's depth changes its neighbours' velocities in opposite directions, and
    /// partly cancels. If unset, each window has its own frames, as in the paper.
    pub sequence: Option<usize>,
    /// With `velocity = "labels"`: number of frames on each side that determine the velocity.
    pub around: usize,
    /// Scene parameters that training estimates along with the weights. Use it for parameters that are only roughly known.
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
    /// Magnitude of the gravitational acceleration. It needs contacts at known positions: in free flight, the 2D track
    /// cannot separate gravity from depth.
    Gravity,
    /// Coefficient of restitution of the contact model `bounce`.
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
    /// The network's positions in three consecutive frames, as in the paper. The velocity depends about twenty times as much
    /// on noise between the three depths as on their common depth. This therefore needs several thousand steps; `sequence`
    /// helps.
    Pictures,
    /// 2D positions in the frames around one frame, in free flight. The velocity has a closed form, linear in that frame's
    /// depth. `future-2d-predict` takes the network's own 2D positions, `future-2d-gt` the labels. Forecasts run forwards
    /// and backwards in time.
    #[default]
    Labels,
}

/// By what the weights are chosen that a run keeps, among those scored on the validation clips.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Select {
    /// The distance of forecasts from the 2D labels. This needs no 3D labels.
    #[default]
    Forecast,
    /// The mean distance to ground truth (DtG), as in the paper. This needs 3D labels of the validation clips.
    Dtg,
}

/// Random changes of training pictures.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Augmentation {
    /// Maximum change of contrast (a factor) and brightness, up or down. Brightness is in units of the channel's standard
    /// deviation (`normalisation`).
    pub brightness: f32,
    /// Maximum additional change of contrast and brightness of each colour channel, in the same units.
    pub colour: f32,
    /// Maximum amplitude of uniform noise in each pixel and channel, in the same units.
    pub noise: f32,
    /// Maximum blur: the fraction that each of a pixel's two neighbours in a row, and in a column, contributes; at most
    /// 0.25.
    pub blur: f32,
    /// Maximum shift, px of the network's input. The intrinsic matrix changes accordingly.
    pub shift: u32,
    /// Maximum rotation in the image plane, degrees. It does not change the depths.
    pub roll_degrees: f64,
    /// Maximum zoom: 0.1 scales the picture by a factor from 1/1.1 to 1.1. A magnified ball looks nearer, so its target
    /// depth is divided by the factor.
    pub zoom: f64,
    /// Probability of a horizontal flip. The camera and the physics are mirrored too.
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
    /// Cross-entropy between the decoded distribution and a Gaussian with standard deviation `sigma`, px of the input
    /// (default 4).
    CrossEntropy {
        /// Standard deviation, input px.
        #[serde(default = "default_sigma")]
        sigma: f64,
    },
    /// Mean squared error between the raw heatmap and a Gaussian of height `amplitude` with standard deviation `sigma`. The
    /// published values are 100 and 2 px.
    Mse {
        /// Peak of the target.
        amplitude: f64,
        /// Standard deviation, input px.
        sigma: f64,
    },
}

pub(super) fn default_sigma() -> f64 {
    4.0
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
    /// This project's small network: 0.7 M parameters.
    #[serde(rename = "compact")]
    Compact,
    /// The small network that measures the ball's apparent radius, as in `any`.
    #[serde(rename = "compact-size")]
    CompactSize,
    /// The motion network of `any`.
    #[serde(rename = "motion")]
    Motion,
    /// The verifier of `any`.
    #[serde(rename = "verifier")]
    Verifier,
    /// The paper's network with a ResNet34 backbone: 18.07 M parameters.
    #[serde(rename = "paper")]
    Paper,
    /// The paper's network with a ConvNeXt nano backbone.
    #[serde(rename = "convnext-nano")]
    ConvNextNano,
    /// The paper's network with a ConvNeXt V2 nano backbone.
    #[serde(rename = "convnextv2-nano")]
    ConvNextV2Nano,
}

/// Steps with the same crop and learning-rate schedule.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Phase {
    /// Number of optimiser steps.
    pub steps: usize,
    /// Pictures per step (batch size). With `velocity = "pictures"`, it is rounded down to whole windows or sequences, but to
    /// at least one.
    pub batch: usize,
    /// Side of square crops around the ball, px. If unset, whole pictures are used.
    #[serde(default)]
    pub crop: Option<u32>,
    /// Peak learning rate, after the warm-up.
    pub learning_rate: f64,
    /// Learning rate at the end of the phase, after cosine decay; 0 if unset.
    #[serde(default)]
    pub final_learning_rate: f64,
    /// Steps of linear warm-up from zero; 0 if unset.
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
