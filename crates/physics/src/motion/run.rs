//! The run of one trajectory, driven by the scene's contact model.

use nalgebra::Vector3;

use super::approach::{Reached, first_contact};
use super::closed_form::{ClosedForm, Course};
use super::integrate::{Flow, Step};
use super::outcome::{ForecastOptions, Impact, Status};
use crate::columns::{Columns, WITH_JACOBIAN, part};
use crate::force::{Forces, Linear, Partials};
use crate::obstacle::Obstacle;

/// Smallest closing speed that a contact time's derivative is divided by, m/s: a graze has none.
const MIN_CLOSING_SPEED: f64 = 1e-6;
/// Relative accuracy of a located crossing within its step.
const CROSSING_TOLERANCE: f64 = 1e-14;
/// Value at which a located crossing is exact, m or (m/s)².
const CROSSING_VALUE: f64 = 1e-15;

/// How deep is ordinary, and where deeper starts are put; distances from an obstacle's surface, m.
pub(crate) struct Depth {
    pub lowest: f64,
    pub target: f64,
    pub touching: f64,
}

/// A contact model.
pub(crate) trait Model {
    /// What the ball is doing: which obstacles press on it or carry it.
    type Phase;

    /// The same as time runs backwards.
    fn reversed(self) -> Self;

    /// How deep in `obstacle` a start may lie, and where deeper ones are put.
    fn depth(&self, obstacle: &Obstacle) -> Depth;

    /// Distance of the ball's centre from an obstacle below which it is in contact, m.
    fn reach(&self) -> f64;

    /// Acceleration by obstacles whose force is there all the time, m/s²; its partials are added.
    fn acceleration(&self, _: &[Obstacle], _: &Vector3<f64>, _: Option<&mut Partials>) -> Vector3<f64> {
        Vector3::zeros()
    }

    /// Potential energy of what the obstacles do, J/kg.
    fn potential_energy(&self, _: &[Obstacle], _: &Vector3<f64>) -> f64 {
        0.0
    }

    /// What the ball is doing at the start of a run.
    fn first<const M: usize>(&self, run: &Run<M>) -> Self::Phase;

    /// Moves a run on: to the next event, by a step, or to the last time. Returns what the ball is doing then.
    fn advance<const M: usize>(&self, run: &mut Run<M>, phase: Self::Phase) -> Self::Phase;
}

/// One run. Times go forwards; backward forecasts come with their laws reversed.
pub(crate) struct Run<'a, const M: usize> {
    pub forces: &'a Forces,
    pub obstacles: &'a [Obstacle],
    pub options: &'a ForecastOptions,
    /// Ascending, not negative, s.
    pub times: &'a [f64],
    pub y: Columns<M>,
    pub t: f64,
    /// Step that the error allowed last, s.
    pub h: f64,
    /// The slope at `y`, where the last step has left it and the forces are still its.
    pub slope: Option<Columns<M>>,
    pub steps: usize,
    pub out: Vec<Columns<M>>,
    pub impacts: Vec<Impact>,
    pub irreversible: Option<f64>,
}

impl<'a, const M: usize> Run<'a, M> {
    /// A run from `start` that hands out the states at `times`.
    pub fn new(
        forces: &'a Forces,
        obstacles: &'a [Obstacle],
        options: &'a ForecastOptions,
        start: Columns<M>,
        times: &'a [f64],
    ) -> Self {
        Self {
            forces,
            obstacles,
            options,
            times,
            y: start,
            t: 0.0,
            h: options.max_step,
            slope: None,
            steps: 0,
            out: Vec::with_capacity(times.len()),
            impacts: vec![],
            irreversible: None,
        }
    }

    /// Runs to the last time, or to what stops it.
    pub fn driven_by(&mut self, model: &impl Model) -> Status {
        let stopped = self.run_phases(model);
        // an arc may hand out states far beyond the region, or overflow, at once
        let region = self.options.region;
        let good = |y: &Columns<M>| y.is_finite() && y.position().norm() <= region;
        if let Some(bad) = self.out.iter().position(|y| !good(y)) {
            let (finite, time) = (self.out[bad].is_finite(), self.times[bad]);
            self.out.truncate(bad);
            return if finite { Status::LeftRegion { time } } else { Status::NotFinite { time } };
        }
        match (stopped, self.irreversible) {
            (Some(status), _) => status,
            (None, Some(time)) => Status::Irreversible { time },
            (None, None) => Status::Ok,
        }
    }

    /// Runs phase by phase; returns what stops it before the last time.
    fn run_phases(&mut self, model: &impl Model) -> Option<Status> {
        let mut phase = model.first(self);
        while self.out.len() < self.times.len() {
            if !self.y.is_finite() {
                return Some(Status::NotFinite { time: self.t });
            }
            if self.y.position().norm() > self.options.region {
                return Some(Status::LeftRegion { time: self.t });
            }
            if self.steps >= self.options.step_limit {
                return Some(Status::StepLimit { time: self.t });
            }
            self.steps += 1;
            phase = model.advance(self, phase);
        }
        None
    }

    /// Time left to the next output, s.
    fn to_next(&self) -> f64 {
        self.times.get(self.out.len()).map_or(0.0, |time| time - self.t)
    }

    /// Time left to the last output, s.
    pub fn time_left(&self) -> f64 {
        self.times.last().map_or(0.0, |last| last - self.t)
    }

    /// Moves to the end of `step`; hands out the state where a time asked for is reached.
    pub fn commit(&mut self, step: &Step<M>) {
        let next = self.times[self.out.len()];
        let lands = step.h >= (next - self.t) * (1.0 - 1e-13);
        self.t = if lands { next } else { self.t + step.h };
        self.y = step.end;
        self.emit();
    }

    pub fn emit(&mut self) {
        while self.times.get(self.out.len()).is_some_and(|&time| time <= self.t) {
            self.out.push(self.y);
        }
    }

    /// A step of at most `longest` s whose error is in bounds, or `None` where no step is small enough: the run ends.
    pub fn trial(&mut self, flow: &impl Flow, longest: f64) -> Option<Step<M>> {
        let integrator = self.options.integrator;
        let slope = self.slope.take().unwrap_or_else(|| flow.derivative(&self.y));
        let cap = longest.min(self.options.max_step).min(integrator.max_step()).min(self.to_next());
        let mut h = self.h.min(cap);
        loop {
            let step = integrator.step(flow, &self.y, &slope, h);
            if step.error <= 1.0 {
                let next = h * integrator.growth(step.error);
                // a step cut short by an output says nothing about the error
                self.h = if h < self.h { self.h.max(next) } else { next };
                return Some(step);
            }
            self.steps += 1;
            let smaller = if step.error.is_finite() { h * integrator.growth(step.error) } else { h * 0.1 };
            if self.t + smaller <= self.t || self.steps >= self.options.step_limit {
                self.steps = self.options.step_limit;
                return None;
            }
            h = smaller;
            self.h = h;
        }
    }

    /// The step again, only as far as `theta` of it.
    pub fn shortened(&self, flow: &impl Flow, step: Step<M>, theta: f64) -> Step<M> {
        if theta >= 1.0 {
            return step;
        }
        let slope = flow.derivative(&self.y);
        self.options.integrator.step(flow, &self.y, &slope, (step.h * theta).max(f64::MIN_POSITIVE))
    }

    /// Commits `step` only as far as `theta` of it.
    pub fn commit_until(&mut self, flow: &impl Flow, step: Step<M>, theta: f64) {
        if theta > 0.0 {
            let step = self.shortened(flow, step, theta);
            self.commit(&step);
        }
    }

    /// The forces on the ball as it spins now, where they have a closed form that is to be used.
    pub fn closed_form(&self) -> Option<Linear> {
        self.options.closed_forms.then(|| self.forces.linear(&self.y.spin())).flatten()
    }

    /// Follows an arc for `duration` s, or to where a ball of `radius` touches an obstacle not in `skip`.
    pub fn follow(&mut self, arc: &ClosedForm, skip: &[usize], radius: f64, duration: f64) -> Reached {
        let (start, begin) = (self.y, self.t);
        let course = Course { arc, start: start.head() };
        let reached = first_contact(self.obstacles, skip, radius, &course, duration);
        let until = begin + reached.time;
        while let Some(&time) = self.times.get(self.out.len()).filter(|&&time| time <= until) {
            self.out.push(arc.at(&start, time - begin));
        }
        (self.y, self.t, self.slope) = (arc.at(&start, reached.time), until, None);
        reached
    }

    /// Free flight of a ball of `radius`: all of it in closed form, else a step; returns the obstacle that it touches
    /// then.
    pub fn fly(&mut self, radius: f64) -> Option<usize> {
        let forces = self.forces;
        if let Some(linear) = self.closed_form() {
            let arc = ClosedForm { linear, spin_decay: forces.spin_decay(), press: None };
            return self.follow(&arc, &[], radius, self.time_left()).obstacle;
        }
        let step = self.trial(forces, f64::INFINITY)?;
        let reached = first_contact(self.obstacles, &[], radius, &step, step.h);
        if reached.obstacle.is_none() && reached.time >= step.h {
            self.commit(&step);
            self.slope = Some(step.last);
        } else {
            let theta = reached.time / step.h;
            self.commit_until(forces, step, theta);
        }
        reached.obstacle
    }

    /// Notes that the ball touches `obstacle` now.
    pub fn record(&mut self, obstacle: usize) {
        let near = self.obstacles[obstacle].nearest(&self.y.position());
        let closing = near.normal.dot(&self.y.velocity());
        // The first column is the state itself.
        let columns = self.y.0.get(1..WITH_JACOBIAN);
        let time_gradient = columns.map(|columns| {
            std::array::from_fn(|component| contact_time_change(&columns[component], &near.normal, closing))
        });
        let surface = self.obstacles[obstacle].surface;
        self.impacts.push(Impact {
            time: self.t,
            surface,
            world: self.y.position().into(),
            speed: -closing,
            time_gradient,
        });
    }

    /// Moves each sensitivity through an event whose time it changes by `time_changes`, at which the slope jumps.
    pub fn shift_columns(&mut self, time_changes: [f64; M], before: &Columns<1>, after: &Columns<1>) {
        for (column, dt) in self.y.0.iter_mut().zip(time_changes).skip(1) {
            for (value, (b, a)) in column.iter_mut().zip(before.0[0].iter().zip(&after.0[0])) {
                *value += (b - a) * dt;
            }
        }
    }
}

/// δt of a contact with normal `n` for a sensitivity column (implicit function theorem).
pub(crate) fn contact_time_change(sensitivity: &[f64; 9], n: &Vector3<f64>, closing: f64) -> f64 {
    n.dot(&part(sensitivity, 0)) / -closing.min(-MIN_CLOSING_SPEED)
}

/// Where in [0, 1] `f` changes sign, given that it does (`rising`: from negative to positive):
/// regula falsi with Illinois' halving, and a bisection wherever that is slow.
pub fn crossing(f: impl Fn(f64) -> f64, rising: bool) -> f64 {
    let sign = if rising { 1.0 } else { -1.0 };
    let f = |theta| sign * f(theta);
    let (mut low, mut high) = (0.0, 1.0);
    let (mut at_low, mut at_high) = (f(low).min(0.0), f(high).max(0.0));
    let mut side = 0;
    for iteration in 0..100 {
        if high - low <= CROSSING_TOLERANCE || at_high == 0.0 {
            break;
        }
        let secant = high - at_high * (high - low) / (at_high - at_low);
        let inside = secant > low && secant < high && iteration % 8 != 7;
        let theta = if inside { secant } else { 0.5 * (low + high) };
        let value = f(theta);
        if value.abs() < CROSSING_VALUE {
            return theta;
        }
        if value < 0.0 {
            (low, at_low) = (theta, value);
            at_high *= if side == -1 { 0.5 } else { 1.0 };
            side = -1;
        } else {
            (high, at_high) = (theta, value);
            at_low *= if side == 1 { 0.5 } else { 1.0 };
            side = 1;
        }
    }
    high
}
