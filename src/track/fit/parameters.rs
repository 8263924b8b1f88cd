//! Estimation of what a scene says of its ball, together with the trajectory: Levenberg–Marquardt on
//! the chain's normal equations with a border of a few more unknowns (Schur complement).

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector, Matrix3, SVector};

use super::chain::{self, Chain, Trust};
use super::labels::residual_noise;
use super::problem::{Problem, Slack};
use super::search::FINAL;
use super::tridiagonal::Normal;
use super::{Estimate, FitOptions, Parameter, unexplained};
use crate::error::{Error, Result};
use crate::least_squares::{Damping, LeastSquares, minimised};
use crate::physics::{Contact, Forecaster, Scene};

/// How the damping goes: as for a trajectory alone, but on to where the parameters stand still.
const DAMPING: Damping = Damping { steps: 40, converged: 1e-6, ..chain::DAMPING };
/// Trajectories that the search starts from.
const CHAINS: usize = 4;
/// Uncertainty of a drag that is to be estimated, as an acceleration, m/s².
const UNKNOWN_DRAG: f64 = 1.0;
/// Uncertainty of a restitution that is to be estimated.
const UNKNOWN_RESTITUTION: f64 = 0.1;

impl Parameter {
    /// Step of its central differences, smallest and largest value.
    fn range(self) -> (f64, f64, f64) {
        match self {
            Self::Restitution => (1e-4, 0.02, 1.0 - 1e-4),
            Self::Drag | Self::Spin => (1e-4, 1e-4, 100.0),
        }
    }

    /// Distance between two starts of a search.
    fn stride(self) -> f64 {
        match self {
            Self::Restitution => 0.12,
            Self::Drag | Self::Spin => 0.25,
        }
    }

    fn get(self, scene: &Scene) -> Result<f64> {
        let (_, low, high) = self.range();
        match (self, &scene.contact) {
            (Self::Drag, _) => Ok(scene.ball.drag_coefficient.clamp(low, high)),
            (Self::Restitution, Contact::Bounce { restitution, .. }) => Ok(restitution.clamp(low, high)),
            _ => Err(Error::Fit {
                reason: "restitution can be estimated with the contact model `bounce` only; change scene.json".into(),
            }),
        }
    }

    fn set(self, scene: &mut Scene, value: f64) {
        match (self, &mut scene.contact) {
            (Self::Drag, _) => scene.ball.drag_coefficient = value,
            (Self::Restitution, Contact::Bounce { restitution, .. }) => *restitution = value,
            _ => {}
        }
    }
}

/// What is to be estimated of the scene: all but the spin, which is part of the trajectory.
pub(super) fn numbers(options: &FitOptions) -> Vec<Parameter> {
    options.estimate.iter().copied().filter(|&parameter| parameter != Parameter::Spin).collect()
}

/// How little the laws are to be trusted until these parameters are known.
pub(super) fn slack(parameters: &[Parameter]) -> Slack {
    let unknown = |parameter, size| if parameters.contains(&parameter) { size } else { 0.0 };
    Slack {
        acceleration: unknown(Parameter::Drag, UNKNOWN_DRAG),
        contact: unknown(Parameter::Restitution, UNKNOWN_RESTITUTION),
    }
}

/// The best trajectory and the numbers of the scene that `options` ask for, from the best of the chains; finds the labels' noise where it is not given.
pub(super) fn searched<const D: usize>(
    problem: &mut Problem,
    chains: &[Chain<D>],
    options: &FitOptions,
) -> Result<Estimated<D>> {
    let parameters = &numbers(options);
    let mut whole: Vec<_> = chains.iter().filter(|chain| chain.states.len() == problem.len()).collect();
    whole.sort_by(|a, b| a.total_cost(problem, FINAL).total_cmp(&b.total_cost(problem, FINAL)));
    let mut found: Option<Estimated<D>> = None;
    for start in starts(problem.forecaster, parameters)? {
        for chain in whole.iter().take(CHAINS) {
            // Coarsely first, with the laws as little trusted as they are known; then as the laws are.
            let coarse = estimated(problem, &start, (*chain).clone(), parameters)?;
            let mut strict = problem.with(problem.forecaster);
            strict.slack = Slack::default();
            let fine = estimated(&strict, &coarse.forecaster, coarse.chain, parameters)?;
            if found.as_ref().is_none_or(|found| fine.cost < found.cost) {
                found = Some(fine);
            }
        }
    }
    let found = found.ok_or_else(unexplained)?;
    problem.slack = Slack::default();
    if options.noise_px.is_none() {
        problem.sigma = residual_noise(problem, &found.chain);
    }
    estimated(problem, &found.forecaster, found.chain, parameters)
}

/// Where the search begins: with the scene's own numbers, with larger and with smaller ones.
fn starts(forecaster: &Forecaster, parameters: &[Parameter]) -> Result<Vec<Forecaster>> {
    let start = |by: f64| {
        let value = |parameter: &Parameter| {
            let (_, low, high) = parameter.range();
            Ok((parameter.get(forecaster.scene())? + by * parameter.stride()).clamp(low, high))
        };
        with_values(forecaster, parameters, &parameters.iter().map(value).collect::<Result<Vec<_>>>()?)
    };
    [0.0, 1.0, -1.0].into_iter().map(start).collect()
}

/// The forecaster with these parameters.
fn with_values(forecaster: &Forecaster, parameters: &[Parameter], values: &[f64]) -> Result<Forecaster> {
    let mut scene = forecaster.scene().clone();
    for (parameter, &value) in parameters.iter().zip(values) {
        parameter.set(&mut scene, value);
    }
    forecaster.in_scene(&scene)
}

/// A trajectory and the laws it was found with.
pub(super) struct Estimated<const D: usize> {
    pub cost: f64,
    pub forecaster: Forecaster,
    pub chain: Chain<D>,
    pub estimates: BTreeMap<Parameter, Estimate>,
    /// What the parameters' uncertainty adds to each position's covariance, m².
    pub spread: Vec<Matrix3<f64>>,
}

/// `base` with `parameters` (numbers of its scene) at their best, and the trajectory in it.
fn estimated<const D: usize>(
    problem: &Problem,
    base: &Forecaster,
    chain: Chain<D>,
    parameters: &[Parameter],
) -> Result<Estimated<D>> {
    let values = parameters.iter().map(|parameter| parameter.get(base.scene())).collect::<Result<Vec<_>>>()?;
    let forecaster = with_values(base, parameters, &values)?;
    let (sigmas, spread) = (vec![f64::INFINITY; values.len()], vec![Matrix3::zeros(); problem.len()]);
    let start =
        Estimation { problem, base, parameters, chain, values, forecaster, cost: f64::INFINITY, sigmas, spread };
    let Estimation { chain, values, forecaster, sigmas, spread, .. } = minimised(start, &DAMPING)?;
    let estimate = |index: usize| (parameters[index], Estimate { value: values[index], sigma: sigmas[index] });
    let cost = chain.total_cost(&problem.with(&forecaster), FINAL);
    Ok(Estimated { cost, forecaster, chain, estimates: (0..values.len()).map(estimate).collect(), spread })
}

/// Trajectory and parameters on their way to the least cost.
struct Estimation<'a, const D: usize> {
    problem: &'a Problem<'a>,
    base: &'a Forecaster,
    parameters: &'a [Parameter],
    chain: Chain<D>,
    values: Vec<f64>,
    /// `base` with the values.
    forecaster: Forecaster,
    /// With the intervals trusted as at the last linearisation.
    cost: f64,
    /// As of the last linearisation that had them.
    sigmas: Vec<f64>,
    spread: Vec<Matrix3<f64>>,
}

impl<const D: usize> LeastSquares for Estimation<'_, D> {
    type Normal = Bordered<D>;
    type Step = (Steps<D>, DVector<f64>);
    type Error = Error;

    fn cost(&self) -> f64 {
        self.cost
    }

    fn linearised(&mut self) -> Result<Option<Bordered<D>>> {
        let here = self.problem.with(&self.forecaster);
        let Some(system) = Bordered::new(&here, &self.chain, self.parameters, &self.values)? else { return Ok(None) };
        if let Some(found) = system.uncertainty() {
            (self.sigmas, self.spread) = found;
        }
        self.cost = system.cost;
        Ok(Some(system))
    }

    fn step(&self, system: &Bordered<D>, damping: f64) -> Option<Self::Step> {
        system.step(damping)
    }

    fn moved(&self, system: &Bordered<D>, (steps, by): &Self::Step) -> Result<Option<Self>> {
        let chain = self.chain.moved((0, self.problem.len() - 1), steps);
        let value = |((parameter, value), by): ((&Parameter, &f64), &f64)| {
            let (_, low, high) = parameter.range();
            (value + by).clamp(low, high)
        };
        let values: Vec<f64> = self.parameters.iter().zip(&self.values).zip(by.iter()).map(value).collect();
        let forecaster = with_values(self.base, self.parameters, &values)?;
        let cost = system.cost_of(&self.problem.with(&forecaster), &chain);
        let (sigmas, spread) = (self.sigmas.clone(), self.spread.clone());
        Ok(Some(Self { chain, values, forecaster, cost, sigmas, spread, ..*self }))
    }
}

/// One vector a state.
type Steps<const D: usize> = Vec<SVector<f64, D>>;

/// The normal equations of states and parameters.
struct Bordered<const D: usize> {
    cost: f64,
    states: Normal<D>,
    trusts: Vec<Trust<D>>,
    /// One column a parameter: blocks (state, parameter).
    border: Vec<Steps<D>>,
    corner: DMatrix<f64>,
    gradient: DVector<f64>,
}

impl<const D: usize> Bordered<D> {
    fn new(problem: &Problem, chain: &Chain<D>, parameters: &[Parameter], values: &[f64]) -> Result<Option<Self>> {
        let range = (0, problem.len() - 1);
        let Some(transitions) = chain.transitions(problem, range) else { return Ok(None) };
        let trusts = chain.trusts(problem, range, &transitions);
        let cost = chain.cost(problem, range, &transitions, &trusts, FINAL);
        let states = chain.normal(problem, range, &transitions, &trusts, FINAL);
        let count = parameters.len();
        let mut border = vec![vec![SVector::<f64, D>::zeros(); problem.len()]; count];
        let (mut corner, mut gradient) = (DMatrix::zeros(count, count), DVector::zeros(count));
        let mut slopes: Vec<Steps<D>> = Vec::with_capacity(count);
        for (index, parameter) in parameters.iter().enumerate() {
            let (step, _, _) = parameter.range();
            let ends = |by: f64| -> Result<Option<Vec<_>>> {
                let mut values = values.to_vec();
                values[index] += by;
                let forecaster = with_values(problem.forecaster, parameters, &values)?;
                Ok(chain.transitions(&problem.with(&forecaster), range))
            };
            let (Some(up), Some(down)) = (ends(step)?, ends(-step)?) else { return Ok(None) };
            let slope = |k: usize| SVector::from_fn(|i, _| (up[k].end[i] - down[k].end[i]) / (2.0 * step));
            slopes.push((0..transitions.len()).map(slope).collect());
        }
        for (k, (transition, trust)) in transitions.iter().zip(&trusts).enumerate() {
            let (_, weight, off) = chain.defect(k, transition, trust, FINAL);
            let precision = trust.precision * weight;
            for p in 0..count {
                let weighted = precision.component_mul(&slopes[p][k]);
                border[p][k] += transition.jacobian.transpose() * weighted;
                border[p][k + 1] -= weighted;
                gradient[p] -= weighted.dot(&off);
                for q in 0..count {
                    corner[(p, q)] += weighted.dot(&slopes[q][k]);
                }
            }
        }
        Ok(Some(Self { cost, states, trusts, border, corner, gradient }))
    }

    /// Cost of another chain under other laws, the intervals trusted as here.
    fn cost_of(&self, problem: &Problem, chain: &Chain<D>) -> f64 {
        let range = (0, problem.len() - 1);
        let transitions = chain.transitions(problem, range);
        transitions.map_or(f64::INFINITY, |transitions| chain.cost(problem, range, &transitions, &self.trusts, FINAL))
    }

    /// H⁻¹·border, the Schur complement, and H⁻¹·gradient of the states.
    fn reduced(&self, damping: f64) -> Option<(Vec<Steps<D>>, DMatrix<f64>, Steps<D>)> {
        let pivots = self.states.pivots(damping)?;
        let solved: Vec<_> =
            self.border.iter().map(|column| self.states.substituted(&pivots, column.clone())).collect();
        let own = self.states.substituted(&pivots, self.states.gradient.clone());
        let mut schur = self.corner.clone();
        for p in 0..solved.len() {
            schur[(p, p)] *= 1.0 + damping;
            for q in 0..solved.len() {
                schur[(p, q)] -= self.border[p].iter().zip(&solved[q]).map(|(a, b)| a.dot(b)).sum::<f64>();
            }
        }
        Some((solved, schur, own))
    }

    /// Damped step of states and parameters.
    fn step(&self, damping: f64) -> Option<(Steps<D>, DVector<f64>)> {
        let (solved, schur, own) = self.reduced(damping)?;
        let right = DVector::from_fn(solved.len(), |p, _| {
            self.border[p].iter().zip(&own).map(|(a, b)| a.dot(b)).sum::<f64>() - self.gradient[p]
        });
        let by = schur.cholesky()?.solve(&right);
        let states = (0..own.len())
            .map(|k| {
                -own[k] - solved.iter().zip(by.iter()).map(|(column, by)| column[k] * *by).sum::<SVector<f64, D>>()
            })
            .collect();
        Some((states, by))
    }

    /// Standard deviations of the parameters, and what they add to the positions' covariances.
    fn uncertainty(&self) -> Option<(Vec<f64>, Vec<Matrix3<f64>>)> {
        let (solved, schur, own) = self.reduced(1e-12)?;
        let covariance = schur.cholesky()?.inverse();
        let count = covariance.nrows();
        let spread = |k: usize| {
            let pairs = (0..count).flat_map(|p| (0..count).map(move |q| (p, q)));
            let position = |p: usize| solved[p][k].fixed_rows::<3>(0).into_owned();
            pairs.map(|(p, q)| position(p) * position(q).transpose() * covariance[(p, q)]).sum()
        };
        let sigmas = (0..count).map(|p| covariance[(p, p)].sqrt()).collect();
        Some((sigmas, (0..own.len()).map(spread).collect()))
    }
}
