//! The trajectory as a chain of states, one a frame, tied by the laws of motion: its refinement by
//! Levenberg–Marquardt on a block-tridiagonal system (multiple shooting with weak constraints).
//!
//! One state at the start would do for exact laws, but its images after several contacts are so
//! sensitive to it that no solver finds it; neighbouring states are only a frame apart, and small
//! errors of the laws (a contact that is not quite the model's) stay where they arise.

use nalgebra::{Cholesky, Const, Vector2};

use super::problem::{Matrix9, Problem, Transition, Vector9};
use crate::physics::columns::Column;

/// Longest change of a position in one iteration, m.
const LONGEST_STEP: f64 = 1.5;
/// Relative decrease of the cost below which an iteration is the last.
const CONVERGED: f64 = 1e-5;
/// Cost of a state whose observation cannot be projected, in squared standard deviations.
const UNSEEN: f64 = 1e8;
/// Largest damping before a search is given up.
const MAX_DAMPING: f64 = 1e8;

/// What a large residual costs.
#[derive(Debug, Clone, Copy)]
pub(super) enum Loss {
    /// Linear beyond this many standard deviations: pulls from afar.
    Huber(f64),
    /// Logarithmic beyond this many standard deviations: lets go of outliers.
    Cauchy(f64),
}

impl Loss {
    /// Cost of a squared residual, and its derivative.
    fn of(self, square: f64) -> (f64, f64) {
        match self {
            Self::Huber(limit) if square > limit * limit => {
                let size = square.sqrt();
                (2.0 * limit * size - limit * limit, limit / size)
            }
            Self::Huber(_) => (square, 1.0),
            Self::Cauchy(scale) => {
                let ratio = square / (scale * scale);
                (scale * scale * ratio.ln_1p(), 1.0 / (1.0 + ratio))
            }
        }
    }
}

/// A trajectory over frames `first..first + states.len()`.
#[derive(Debug, Clone)]
pub(super) struct Chain {
    pub first: usize,
    pub states: Vec<Column>,
}

/// The normal equations' blocks.
struct Normal {
    diagonal: Vec<Matrix9>,
    /// Block (k, k + 1).
    upper: Vec<Matrix9>,
    gradient: Vec<Vector9>,
}

/// A chain's states with how they move on, and what it all costs.
struct Evaluation {
    cost: f64,
    transitions: Vec<Transition>,
}

impl Chain {
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
        let mut damping = 1e-3;
        let Some(first) = self.transitions(problem, range) else { return f64::INFINITY };
        // Which intervals hold contacts, and so how far each is trusted, is fixed while the cost is compared.
        let precisions = self.precisions(problem, range, &first);
        let mut now = Evaluation { cost: self.cost(problem, range, &first, &precisions, loss), transitions: first };
        for _ in 0..iterations {
            let normal = self.normal(problem, range, &now.transitions, &precisions, loss);
            let before = now.cost;
            loop {
                let trial = normal.solve(damping).and_then(|step| {
                    let moved = self.moved(range, &step);
                    let transitions = moved.transitions(problem, range)?;
                    let cost = moved.cost(problem, range, &transitions, &precisions, loss);
                    (cost < now.cost).then_some((moved, Evaluation { cost, transitions }))
                });
                if let Some((moved, evaluation)) = trial {
                    (*self, now) = (moved, evaluation);
                    damping = (damping * 0.2).max(1e-12);
                    break;
                }
                damping *= 6.0;
                if damping > MAX_DAMPING {
                    return now.cost;
                }
            }
            if before - now.cost < CONVERGED * now.cost {
                break;
            }
        }
        now.cost
    }

    /// Cost with the chain's own contacts.
    pub fn total_cost(&self, problem: &Problem, loss: Loss) -> f64 {
        let range = (self.first, self.last());
        let Some(transitions) = self.transitions(problem, range) else { return f64::INFINITY };
        let precisions = self.precisions(problem, range, &transitions);
        self.cost(problem, range, &transitions, &precisions, loss)
    }

    /// Covariance of each state.
    pub fn covariances(&self, problem: &Problem, loss: Loss) -> Option<Vec<Matrix9>> {
        let range = (self.first, self.last());
        let transitions = self.transitions(problem, range)?;
        let precisions = self.precisions(problem, range, &transitions);
        self.normal(problem, range, &transitions, &precisions, loss).covariances()
    }

    /// Intervals whose start or end is in `range`: index of the first state, number.
    fn intervals(&self, range: (usize, usize)) -> std::ops::Range<usize> {
        let from = range.0.saturating_sub(1).max(self.first) - self.first;
        let to = (range.1 + 1).min(self.last()) - self.first;
        from..to
    }

    fn transitions(&self, problem: &Problem, range: (usize, usize)) -> Option<Vec<Transition>> {
        let intervals = self.intervals(range);
        let move_on = |index: usize| {
            problem.forecaster.transition(&self.states[index], problem.interval(self.first + index))
        };
        intervals.map(move_on).collect()
    }

    /// How far the laws are trusted: less where there is a contact, or may be one a frame earlier or later.
    fn precisions(&self, problem: &Problem, range: (usize, usize), transitions: &[Transition]) -> Vec<Vector9> {
        let intervals = self.intervals(range);
        let change = |offset: usize, part: usize| {
            let (start, end) = (&self.states[intervals.start + offset], &transitions[offset].end);
            (3 * part..3 * part + 3).map(|i| (end[i] - start[i]).powi(2)).sum::<f64>().sqrt()
        };
        let precision = |offset: usize| {
            let near = offset.saturating_sub(1)..(offset + 2).min(transitions.len());
            let contacts = near.filter(|&near| transitions[near].contact);
            let contact = contacts.map(|near| [change(near, 1), change(near, 2)]).max_by(|a, b| a[0].total_cmp(&b[0]));
            problem.precision(self.first + intervals.start + offset, contact)
        };
        (0..transitions.len()).map(precision).collect()
    }

    fn cost(
        &self,
        problem: &Problem,
        range: (usize, usize),
        transitions: &[Transition],
        precisions: &[Vector9],
        loss: Loss,
    ) -> f64 {
        let observed = (range.0..=range.1).filter_map(|frame| Some(self.observed(problem, frame, loss)?.0));
        let intervals = self.intervals(range).zip(transitions.iter().zip(precisions));
        let moved = intervals.map(|(index, (transition, precision))| {
            (0..9).map(|i| precision[i] * (self.states[index + 1][i] - transition.end[i]).powi(2)).sum::<f64>()
        });
        observed.sum::<f64>() + moved.sum::<f64>() + self.spin_prior(problem, range).map_or(0.0, |(cost, _)| cost)
    }

    /// What is known of the first state's spin: cost and residual.
    fn spin_prior(&self, problem: &Problem, range: (usize, usize)) -> Option<(f64, nalgebra::Vector3<f64>)> {
        if range.0 != self.first {
            return None;
        }
        let off = crate::physics::columns::part(&self.states[0], 2) - problem.spin_at(self.first);
        Some((off.norm_squared() / problem.spin_sigma.powi(2), off))
    }

    fn normal(
        &self,
        problem: &Problem,
        range: (usize, usize),
        transitions: &[Transition],
        precisions: &[Vector9],
        loss: Loss,
    ) -> Normal {
        let count = range.1 - range.0 + 1;
        let mut normal = Normal {
            diagonal: vec![Matrix9::zeros(); count],
            upper: vec![Matrix9::zeros(); count.saturating_sub(1)],
            gradient: vec![Vector9::zeros(); count],
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
        for (index, (transition, precision)) in self.intervals(range).zip(transitions.iter().zip(precisions)) {
            let frame = self.first + index;
            let off = Vector9::from_fn(|i, _| self.states[index + 1][i] - transition.end[i]);
            let weighted = precision.component_mul(&off);
            let trusted = Matrix9::from_fn(|row, column| precision[row] * transition.jacobian[(row, column)]);
            if frame + 1 <= range.1 {
                let slot = frame + 1 - range.0;
                normal.diagonal[slot] += Matrix9::from_diagonal(precision);
                normal.gradient[slot] += weighted;
            }
            if frame >= range.0 {
                let slot = frame - range.0;
                normal.diagonal[slot] += transition.jacobian.transpose() * trusted;
                normal.gradient[slot] -= transition.jacobian.transpose() * weighted;
                if frame + 1 <= range.1 {
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

    fn moved(&self, range: (usize, usize), step: &[Vector9]) -> Self {
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

impl Normal {
    /// Cholesky factors of the pivots of block elimination.
    fn pivots(&self, damping: f64) -> Option<Vec<Cholesky<f64, Const<9>>>> {
        let mut pivots: Vec<Cholesky<f64, Const<9>>> = Vec::with_capacity(self.diagonal.len());
        for (index, diagonal) in self.diagonal.iter().enumerate() {
            let mut pivot = *diagonal;
            for i in 0..9 {
                pivot[(i, i)] += damping * diagonal[(i, i)];
            }
            if let (Some(before), Some(upper)) = (pivots.last(), index.checked_sub(1).map(|i| &self.upper[i])) {
                pivot -= upper.transpose() * before.solve(upper);
                pivot = (pivot + pivot.transpose()) * 0.5;
            }
            pivots.push(pivot.cholesky()?);
        }
        Some(pivots)
    }

    /// The damped step.
    fn solve(&self, damping: f64) -> Option<Vec<Vector9>> {
        let pivots = self.pivots(damping)?;
        let mut step: Vec<Vector9> = self.gradient.iter().map(|gradient| -gradient).collect();
        for index in 1..step.len() {
            let before = self.upper[index - 1].transpose() * pivots[index - 1].solve(&step[index - 1]);
            step[index] -= before;
        }
        for index in (0..step.len()).rev() {
            if index + 1 < step.len() {
                let after = self.upper[index] * step[index + 1];
                step[index] -= after;
            }
            step[index] = pivots[index].solve(&step[index]);
        }
        step.iter().all(|step| step.iter().all(|value| value.is_finite())).then_some(step)
    }

    /// Diagonal blocks of the inverse.
    fn covariances(&self) -> Option<Vec<Matrix9>> {
        let pivots = self.pivots(1e-12)?;
        let mut out: Vec<Matrix9> = pivots.iter().map(Cholesky::inverse).collect();
        for index in (0..out.len().saturating_sub(1)).rev() {
            let gain = pivots[index].solve(&self.upper[index]);
            out[index] = out[index] + gain * out[index + 1] * gain.transpose();
        }
        Some(out)
    }
}
