//! The trajectory as a chain of states, one a frame, tied by the laws of motion: its refinement by
//! Levenberg–Marquardt on a block-tridiagonal system (multiple shooting with weak constraints).
//!
//! One state at the start would do for exact laws, but its images after several contacts are so
//! sensitive to it that no solver finds it; neighbouring states are only a frame apart, and small
//! errors of the laws (a contact that is not quite the model's) stay where they arise.

use std::convert::Infallible;

use nalgebra::{SMatrix, SVector, Vector2};

use super::loss::Loss;
use super::problem::Problem;
use super::tridiagonal::Normal;
use crate::least_squares::{Damping, LeastSquares, minimised};
use crate::physics::{Column, Transition, part};

/// Longest change of a position in one iteration, m.
const LONGEST_STEP: f64 = 1.5;
/// Cost of a state whose observation cannot be projected, in squared standard deviations.
const UNSEEN: f64 = 1e8;
/// Where the loss of a contact's defect turns, in standard deviations: most contacts are the model's to
/// millimetres, some (an edge, a spin nobody knows) are far from it.
const CONTACT_SCALE: f64 = 4.0;
/// Precision of a contact that is to let go.
const LOOSE: f64 = 1e-6;
/// Intervals of a flight that is worth moving.
const SHORTEST_FLIGHT: usize = 4;
/// How the damping of a chain's steps goes; `steps` is the caller's.
pub(super) const DAMPING: Damping =
    Damping { first: 1e-3, relax: 0.2, least: 1e-12, stiffen: 6.0, most: 1e8, steps: 0, converged: 1e-4 };

impl Loss {
    /// The same kind of loss for the defect of an interval with a contact; one without costs its square.
    fn of_contact(self, square: f64) -> (f64, f64) {
        match self {
            Self::Huber(_) => Self::Huber(CONTACT_SCALE).of(square),
            Self::Cauchy(_) => Self::Cauchy(CONTACT_SCALE).of(square),
        }
    }
}

/// A trajectory over frames `first..first + states.len()`.
///
/// `D` components of each state are free: position and velocity (6), or spin, too (9).
#[derive(Debug, Clone)]
pub(super) struct Chain<const D: usize> {
    pub first: usize,
    pub states: Vec<Column>,
}

/// How far the laws of motion are trusted over an interval.
pub(super) struct Trust<const D: usize> {
    /// 1/variance of position, velocity and spin.
    pub precision: SVector<f64, D>,
    pub contact: bool,
}

/// A move of a chain.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shift {
    /// Whose position is moved.
    pub frame: usize,
    /// Standard deviations of it.
    pub by: f64,
    pub contacts: Contacts,
}

/// What contacts do when a chain is moved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Contacts {
    /// Flights on both sides move together.
    Held,
    /// A flight moves by what it knows on its own.
    Loose,
}

/// A range of a chain on its way to the least cost. Which intervals hold contacts, and so how far each is trusted, is
/// fixed while the cost is compared.
struct Refinement<'a, const D: usize> {
    chain: Chain<D>,
    transitions: Vec<Transition<D>>,
    cost: f64,
    trusts: &'a [Trust<D>],
    problem: &'a Problem<'a>,
    range: (usize, usize),
    loss: Loss,
}

impl<const D: usize> LeastSquares for Refinement<'_, D> {
    type Normal = Normal<D>;
    type Step = Vec<SVector<f64, D>>;
    type Error = Infallible;

    fn cost(&self) -> f64 {
        self.cost
    }

    fn linearised(&mut self) -> Result<Option<Normal<D>>, Infallible> {
        Ok(Some(self.chain.normal(self.problem, self.range, &self.transitions, self.trusts, self.loss)))
    }

    fn step(&self, normal: &Normal<D>, damping: f64) -> Option<Self::Step> {
        normal.solve(damping)
    }

    fn moved(&self, _: &Normal<D>, step: &Self::Step) -> Result<Option<Self>, Infallible> {
        let chain = self.chain.moved(self.range, step);
        Ok(chain.transitions(self.problem, self.range).map(|transitions| {
            let cost = chain.cost(self.problem, self.range, &transitions, self.trusts, self.loss);
            Self { chain, transitions, cost, ..*self }
        }))
    }
}

impl<const D: usize> Chain<D> {
    pub fn last(&self) -> usize {
        self.first + self.states.len() - 1
    }

    /// State at a frame of the track.
    pub fn at(&self, frame: usize) -> Option<&Column> {
        self.states.get(frame.checked_sub(self.first)?)
    }

    /// Cost of the observation at `frame`, its derivative by the squared residual, the residual (px).
    pub fn observed(&self, problem: &Problem, frame: usize, loss: Loss) -> Option<(f64, f64, Vector2<f64>)> {
        let image = problem.observations[frame].image?;
        if matches!(loss, Loss::Huber(_)) && problem.rays[frame].is_none() {
            return None;
        }
        let Some((projected, _)) = problem.project(self.at(frame)?) else {
            return Some((UNSEEN, 0.0, Vector2::repeat(f64::INFINITY)));
        };
        let residual = projected - image.coords;
        let (cost, weight) = loss.of(residual.norm_squared() / problem.sigma.powi(2));
        Some((cost, weight, residual))
    }

    /// Refines the states of `range` (frames; the others stay) and returns the cost.
    pub fn refine(&mut self, problem: &Problem, range: (usize, usize), loss: Loss, iterations: usize) -> f64 {
        let range = (range.0.max(self.first), range.1.min(self.last()));
        let Some(transitions) = self.transitions(problem, range) else { return f64::INFINITY };
        let trusts = self.trusts(problem, range, &transitions);
        let cost = self.cost(problem, range, &transitions, &trusts, loss);
        let start = Refinement { chain: self.clone(), transitions, cost, trusts: &trusts, problem, range, loss };
        let Ok(found) = minimised(start, &Damping { steps: iterations, ..DAMPING });
        *self = found.chain;
        found.cost
    }

    /// Cost with the chain's own contacts.
    pub fn total_cost(&self, problem: &Problem, loss: Loss) -> f64 {
        let range = (self.first, self.last());
        let Some(transitions) = self.transitions(problem, range) else { return f64::INFINITY };
        let trusts = self.trusts(problem, range, &transitions);
        self.cost(problem, range, &transitions, &trusts, loss)
    }

    /// Covariance of each state.
    pub fn covariances(&self, problem: &Problem, loss: Loss) -> Option<Vec<SMatrix<f64, D, D>>> {
        let range = (self.first, self.last());
        let transitions = self.transitions(problem, range)?;
        let trusts = self.trusts(problem, range, &transitions);
        self.normal(problem, range, &transitions, &trusts, loss).covariances()
    }

    /// The chain with one position moved along its least certain direction, its other states following.
    pub fn shifted(&self, problem: &Problem, shift: &Shift, loss: Loss) -> Option<Self> {
        let &Shift { frame, by, contacts } = shift;
        let range = (self.first, self.last());
        let transitions = self.transitions(problem, range)?;
        let mut trusts = self.trusts(problem, range, &transitions);
        for trust in trusts.iter_mut().filter(|trust| contacts == Contacts::Loose && trust.contact) {
            trust.precision *= LOOSE;
        }
        let mut normal = self.normal(problem, range, &transitions, &trusts, loss);
        let slot = frame - self.first;
        let covariance = normal.covariances()?[slot].fixed_view::<3, 3>(0, 0).into_owned();
        let eigen = covariance.symmetric_eigen();
        let (axis, variance) = eigen.eigenvalues.argmax();
        for (index, gradient) in normal.gradient.iter_mut().enumerate() {
            gradient.fill(0.0);
            if index == slot {
                let along = eigen.eigenvectors.column(axis) * (-by / variance.max(f64::MIN_POSITIVE).sqrt());
                gradient.fixed_rows_mut::<3>(0).copy_from(&along);
            }
        }
        Some(self.moved(range, &normal.solve(1e-12)?))
    }

    /// The middle frames of the flights between contacts.
    pub fn flights(&self, problem: &Problem) -> Vec<usize> {
        let Some(transitions) = self.transitions(problem, (self.first, self.last())) else { return vec![] };
        let mut flights = Vec::new();
        let mut begin = 0;
        for index in 0..=transitions.len() {
            if transitions.get(index).is_none_or(|transition| transition.contact) {
                if index >= begin + SHORTEST_FLIGHT {
                    flights.push(self.first + (begin + index) / 2);
                }
                begin = index + 1;
            }
        }
        flights
    }

    /// Intervals whose start or end is in `range`: index of the first state, number.
    fn intervals(&self, range: (usize, usize)) -> std::ops::Range<usize> {
        let from = range.0.saturating_sub(1).max(self.first) - self.first;
        let to = (range.1 + 1).min(self.last()) - self.first;
        from..to
    }

    pub fn transitions(&self, problem: &Problem, range: (usize, usize)) -> Option<Vec<Transition<D>>> {
        let intervals = self.intervals(range);
        let move_on = |index: usize| problem.transition(&self.states[index], problem.interval(self.first + index));
        intervals.map(move_on).collect()
    }

    /// How far the laws are trusted: less where there is a contact, or may be one a frame earlier or later.
    pub fn trusts(&self, problem: &Problem, range: (usize, usize), transitions: &[Transition<D>]) -> Vec<Trust<D>> {
        let intervals = self.intervals(range);
        let change = |offset: usize, part: usize| {
            let (start, end) = (&self.states[intervals.start + offset], &transitions[offset].end);
            (3 * part..3 * part + 3).map(|i| (end[i] - start[i]).powi(2)).sum::<f64>().sqrt()
        };
        let trust = |offset: usize| {
            let near = offset.saturating_sub(1)..(offset + 2).min(transitions.len());
            let contacts = near.filter(|&near| transitions[near].contact);
            let contact = contacts.map(|near| [change(near, 1), change(near, 2)]).max_by(|a, b| a[0].total_cmp(&b[0]));
            let precision = problem.precision(self.first + intervals.start + offset, contact);
            Trust { precision, contact: contact.is_some() }
        };
        (0..transitions.len()).map(trust).collect()
    }

    pub fn cost(
        &self,
        problem: &Problem,
        range: (usize, usize),
        transitions: &[Transition<D>],
        trusts: &[Trust<D>],
        loss: Loss,
    ) -> f64 {
        let observed = (range.0..=range.1).filter_map(|frame| Some(self.observed(problem, frame, loss)?.0));
        let intervals = self.intervals(range).zip(transitions.iter().zip(trusts));
        let moved = intervals.map(|(index, (transition, trust))| self.defect(index, transition, trust, loss).0);
        observed.sum::<f64>() + moved.sum::<f64>() + self.spin_prior(problem, range).map_or(0.0, |(cost, _)| cost)
    }

    /// Cost of the interval after state `index`, the weight of its square, and the defect.
    pub fn defect(
        &self,
        index: usize,
        transition: &Transition<D>,
        trust: &Trust<D>,
        loss: Loss,
    ) -> (f64, f64, SVector<f64, D>) {
        let off = SVector::<f64, D>::from_fn(|i, _| self.states[index + 1][i] - transition.end[i]);
        let square = trust.precision.component_mul(&off).dot(&off);
        let (cost, weight) = if trust.contact { loss.of_contact(square) } else { (square, 1.0) };
        (cost, weight, off)
    }

    /// What is known of the first state's spin: cost and residual.
    fn spin_prior(&self, problem: &Problem, range: (usize, usize)) -> Option<(f64, nalgebra::Vector3<f64>)> {
        if range.0 != self.first || D < 9 {
            return None;
        }
        let off = part(&self.states[0], 2) - problem.spin_at(self.first);
        Some((off.norm_squared() / problem.spin_sigma.powi(2), off))
    }

    pub fn normal(
        &self,
        problem: &Problem,
        range: (usize, usize),
        transitions: &[Transition<D>],
        trusts: &[Trust<D>],
        loss: Loss,
    ) -> Normal<D> {
        let count = range.1 - range.0 + 1;
        let mut normal = Normal {
            diagonal: vec![SMatrix::<f64, D, D>::zeros(); count],
            upper: vec![SMatrix::<f64, D, D>::zeros(); count.saturating_sub(1)],
            gradient: vec![SVector::<f64, D>::zeros(); count],
        };
        for frame in range.0..=range.1 {
            let Some((_, weight, residual)) = self.observed(problem, frame, loss) else { continue };
            let Some((_, jacobian)) = self.at(frame).and_then(|state| problem.project(state)) else { continue };
            let weight = weight / problem.sigma.powi(2);
            let slot = frame - range.0;
            let mut block = normal.diagonal[slot].fixed_view_mut::<3, 3>(0, 0);
            block += jacobian.transpose() * jacobian * weight;
            let mut part = normal.gradient[slot].fixed_rows_mut::<3>(0);
            part += jacobian.transpose() * residual * weight;
        }
        for (index, (transition, trust)) in self.intervals(range).zip(transitions.iter().zip(trusts)) {
            let frame = self.first + index;
            let (_, weight, off) = self.defect(index, transition, trust, loss);
            let precision = trust.precision * weight;
            let weighted = precision.component_mul(&off);
            let trusted =
                SMatrix::<f64, D, D>::from_fn(|row, column| precision[row] * transition.jacobian[(row, column)]);
            if frame < range.1 {
                let slot = frame + 1 - range.0;
                normal.diagonal[slot] += SMatrix::<f64, D, D>::from_diagonal(&precision);
                normal.gradient[slot] += weighted;
            }
            if frame >= range.0 {
                let slot = frame - range.0;
                normal.diagonal[slot] += transition.jacobian.transpose() * trusted;
                normal.gradient[slot] -= transition.jacobian.transpose() * weighted;
                if frame < range.1 {
                    normal.upper[slot] -= trusted.transpose();
                }
            }
        }
        if let Some((_, off)) = self.spin_prior(problem, range) {
            let precision = problem.spin_sigma.powi(-2);
            for axis in 0..3 {
                normal.diagonal[0][(6 + axis, 6 + axis)] += precision;
                normal.gradient[0][6 + axis] += precision * off[axis];
            }
        }
        normal
    }

    pub fn moved(&self, range: (usize, usize), step: &[SVector<f64, D>]) -> Self {
        let longest = step.iter().map(|step| step.fixed_rows::<3>(0).norm()).fold(0.0, f64::max);
        let share = (LONGEST_STEP / longest.max(f64::MIN_POSITIVE)).min(1.0);
        let mut out = self.clone();
        for (state, step) in out.states[range.0 - self.first..].iter_mut().zip(step) {
            for (value, by) in state.iter_mut().zip(step.iter()) {
                *value += share * by;
            }
        }
        out
    }
}
