//! Estimation of what a scene says of its ball: by the cost of the best trajectory as a function of
//! the parameter (profile likelihood), minimised by parabolas.

use super::chain::Chain;
use super::problem::Problem;
use super::{FINAL, GROWING};
use crate::error::{Error, Result};
use crate::physics::forecast::Forecaster;
use crate::physics::scene::{Contact, Scene};

/// Rounds over all parameters.
const ROUNDS: usize = 12;
/// Change, in standard deviations, below which a parameter is found.
const FOUND: f64 = 0.05;
/// First and smallest step of a parabola, in units of the parameter's scale.
const FIRST_STEP: f64 = 1.0;
const SMALLEST_STEP: f64 = 0.02;

/// What a fit can estimate beside the trajectory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Parameter {
    /// Restitution of the `bounce` contact model.
    Restitution,
    /// The ball's drag coefficient.
    Drag,
    /// The spin at the first frame.
    Spin,
}

/// An estimated parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Which.
    pub parameter: Parameter,
    /// Its value.
    pub value: f64,
    /// Standard deviation.
    pub sigma: f64,
}

impl Parameter {
    /// Size of a sensible step, and range.
    fn scale(self) -> (f64, f64, f64) {
        match self {
            Self::Restitution => (0.03, 0.02, 1.0),
            Self::Drag => (0.1, 0.0, 10.0),
            Self::Spin => (1.0, f64::NEG_INFINITY, f64::INFINITY),
        }
    }

    fn get(self, scene: &Scene) -> Result<f64> {
        match (self, &scene.contact) {
            (Self::Drag, _) => Ok(scene.ball.drag_coefficient),
            (Self::Restitution, Contact::Bounce { restitution, .. }) => Ok(*restitution),
            _ => Err(Error::Fit {
                reason: "restitution can be estimated with the contact model `bounce` only; change scene.json".into(),
            }),
        }
    }

    fn set(self, scene: &Scene, value: f64) -> Scene {
        let mut scene = scene.clone();
        match (self, &mut scene.contact) {
            (Self::Drag, _) => scene.ball.drag_coefficient = value,
            (Self::Restitution, Contact::Bounce { restitution, .. }) => *restitution = value,
            _ => {}
        }
        scene
    }
}

/// The forecaster with its scene's `parameters` (those that are numbers of the scene) at their best, and
/// the trajectory in it.
pub(super) fn estimated<const D: usize>(
    problem: &Problem,
    mut chain: Chain<D>,
    parameters: &[Parameter],
) -> Result<(Forecaster, Chain<D>, Vec<Estimate>)> {
    let mut forecaster = problem.forecaster.clone();
    let mut estimates = Vec::new();
    for &parameter in parameters {
        let (step, _, _) = parameter.scale();
        estimates.push((Estimate { parameter, value: parameter.get(forecaster.scene())?, sigma: step }, step * FIRST_STEP));
    }
    for _ in 0..ROUNDS {
        let mut moved = 0.0_f64;
        for (estimate, step) in &mut estimates {
            let (scale, low, high) = estimate.parameter.scale();
            let middle = estimate.value.clamp(low + *step, high - *step);
            let at = |value: f64, chain: &Chain<D>| -> Result<(f64, Chain<D>, Forecaster)> {
                let forecaster = forecaster.in_scene(&estimate.parameter.set(forecaster.scene(), value))?;
                let problem = problem.with(&forecaster);
                let mut chain = chain.clone();
                chain.refine(&problem, (0, problem.len()), GROWING, 15);
                let cost = chain.refine(&problem, (0, problem.len()), FINAL, 15);
                Ok((cost, chain, forecaster))
            };
            let costs = [at(middle - *step, &chain)?.0, at(middle, &chain)?.0, at(middle + *step, &chain)?.0];
            let (slope, bend) = ((costs[2] - costs[0]) / (2.0 * *step), (costs[0] + costs[2] - 2.0 * costs[1]) / step.powi(2));
            // cost is twice the negative logarithm of the likelihood
            let sigma = if bend > 0.0 { (2.0 / bend).sqrt() } else { f64::INFINITY };
            let newton = if bend > 0.0 { -slope / bend } else { -slope.signum() * 2.0 * *step };
            let value = (middle + newton.clamp(-3.0 * *step, 3.0 * *step)).clamp(low, high);
            let (cost, better, there) = at(value, &chain)?;
            let lowest = costs.iter().copied().fold(f64::INFINITY, f64::min);
            if cost <= lowest + 0.1 {
                moved = moved.max((value - estimate.value).abs() / sigma.min(scale));
                estimate.value = value;
                (chain, forecaster) = (better, there);
            } else {
                moved = f64::INFINITY;
                let (_, better, there) = at(middle, &chain)?;
                estimate.value = middle;
                (chain, forecaster) = (better, there);
            }
            estimate.sigma = sigma;
            *step = (0.5 * *step).max(sigma.min(scale)).clamp(SMALLEST_STEP * scale, scale);
            if cost > lowest + 0.1 {
                *step = (0.5 * *step).max(SMALLEST_STEP * scale);
            }
        }
        if moved < FOUND {
            break;
        }
    }
    Ok((forecaster, chain, estimates.into_iter().map(|(estimate, _)| estimate).collect()))
}
