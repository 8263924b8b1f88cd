//! What a forecast is asked for and what it answers.

use nalgebra::{Matrix6, Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::integrate::Integrator;
use crate::obstacle::Surface;
use crate::state::State;

/// Longest step, s: one frame at the paper's 15 frames a second. Times asked for are steps' ends, too.
const MAX_STEP: f64 = 1.0 / 15.0;
/// Distance from the origin at which a ball is lost, m.
const REGION: f64 = 1e4;
/// Steps after which a trajectory is given up.
const STEP_LIMIT: usize = 100_000;

/// How a forecast is computed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct ForecastOptions {
    /// Solver where no closed form is used.
    pub integrator: Integrator,
    /// Use closed forms where they exist: arcs between contacts without drag and spin, the linear spring.
    pub closed_forms: bool,
    /// Longest step, s. Adaptive steps without a cap tunnel through boxes.
    pub max_step: f64,
    /// Steps, tried or made, after which a trajectory is given up.
    pub step_limit: usize,
    /// Distance from the world's origin beyond which a ball is lost, m.
    pub region: f64,
}

impl Default for ForecastOptions {
    fn default() -> Self {
        Self {
            integrator: Integrator::default(),
            closed_forms: true,
            max_step: MAX_STEP,
            step_limit: STEP_LIMIT,
            region: REGION,
        }
    }
}

/// A start that was moved out of an obstacle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Moved {
    /// The first obstacle it was in.
    pub surface: Surface,
    /// How deep: m below the distance at which the ball touches it.
    pub depth: f64,
    /// By how much the start was moved, m.
    pub by: Vector3<f64>,
    /// Whether it is out of everything now.
    pub clear: bool,
}

/// How a forecast ended. Where it stopped early, states exist only for the times before.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Status {
    /// Whole.
    Ok,
    /// Whole; the start lay inside an obstacle and was moved out ([`Forecast::moved`]).
    StartInside,
    /// Backwards through a contact that cannot be undone (friction, or no rebound) at this time, s:
    /// states before it are those of a contact without friction.
    Irreversible {
        /// s.
        time: f64,
    },
    /// Stopped: too many steps.
    StepLimit {
        /// s.
        time: f64,
    },
    /// Stopped: farther from the origin than [`ForecastOptions::region`].
    LeftRegion {
        /// s.
        time: f64,
    },
    /// Stopped: a start or a force that is not finite, or a start faster than 10⁹ m/s.
    NotFinite {
        /// s.
        time: f64,
    },
}

impl Status {
    /// Whether there is a state for every time, each as the laws say.
    pub fn is_exact(&self) -> bool {
        matches!(self, Self::Ok | Self::StartInside)
    }

    /// Whether there is a state for every time.
    pub fn is_whole(&self) -> bool {
        matches!(self, Self::Ok | Self::StartInside | Self::Irreversible { .. })
    }

    /// When it stopped, or went through what cannot be undone, s.
    pub fn time(&self) -> Option<f64> {
        match *self {
            Self::Ok | Self::StartInside => None,
            Self::Irreversible { time }
            | Self::StepLimit { time }
            | Self::LeftRegion { time }
            | Self::NotFinite { time } => Some(time),
        }
    }

    /// Stable name, for programs.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::StartInside => "start-inside",
            Self::Irreversible { .. } => "irreversible",
            Self::StepLimit { .. } => "step-limit",
            Self::LeftRegion { .. } => "left-region",
            Self::NotFinite { .. } => "not-finite",
        }
    }
}

/// The ball touches an obstacle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
pub struct Impact {
    /// s.
    pub time: f64,
    /// What it touches, as the scene names it.
    pub surface: Surface,
    /// The ball's centre in the world, m.
    pub world: Point3<f64>,
    /// Speed at which it approaches, m/s.
    pub speed: f64,
    /// ∂time/∂(position, velocity at the start), s/m and s²/m; `None` where it was not computed: without Jacobians.
    #[serde(skip)]
    pub time_gradient: Option<[f64; 6]>,
}

/// What a forecast found.
#[derive(Debug, Clone, PartialEq)]
pub struct Forecast {
    /// Times of the states, s: those asked for, in their order; without those after a stop.
    pub times: Vec<f64>,
    /// One state a time.
    pub states: Vec<State>,
    /// ∂(position, velocity at the time)/∂(position, velocity at the start), one a state; empty where not asked for.
    pub jacobians: Vec<Matrix6<f64>>,
    /// Contacts by time. `penalty` has none.
    pub impacts: Vec<Impact>,
    /// How it ended.
    pub status: Status,
    /// What was done about a start inside an obstacle.
    pub moved: Option<Moved>,
    /// Steps, tried or made.
    pub steps: usize,
}

impl std::fmt::Display for Status {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Ok => write!(f, "whole"),
            Self::StartInside => write!(f, "whole; the start was inside an obstacle and was moved out"),
            Self::Irreversible { time } => {
                write!(
                    f,
                    "a contact at t = {time:.4} s cannot be computed backwards (friction, or no rebound): states before it are unreliable"
                )
            }
            Self::StepLimit { time } => write!(f, "the solver needed too many steps at t = {time:.4} s"),
            Self::LeftRegion { time } => write!(f, "the ball has left the region at t = {time:.4} s"),
            Self::NotFinite { time } => write!(f, "the motion is not finite at t = {time:.4} s"),
        }
    }
}
