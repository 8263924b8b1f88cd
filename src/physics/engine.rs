//! The run of one trajectory: free flight, soft contact, impacts, being carried.

use super::arc::{Arc, STILL, TOUCH, first_contact};
use super::columns::{Columns, part};
use super::field::{Field, Flow, Linear};
use super::forecast::{Impact, Options, Status};
use super::impact::{Rigid, contact_time_change};
use super::integrate::{Integrator, Step};
use super::obstacle::Obstacle;
use super::rest::{Support, normal_reaction};
use super::scene::Contact;

/// Height of a bounce below which a ball that is pressed on stays, m. What ends the infinitely many
/// bounces of a ball that comes to rest.
const REST_HEIGHT: f64 = 5e-8;
/// Largest force (m/s²), and largest gradient of it (1/s²), of a soft wall that is not felt; and with fixed steps.
const SOFT_FORCE: f64 = 1e-6;
const SOFT_FORCE_OF_STEPS: f64 = 1e-12;
/// Widths of a soft wall that one step may cross unseen.
const SOFT_WALL_WIDTHS: f64 = 8.0;
/// Relative accuracy of a located crossing within its step.
const CROSSING_TOLERANCE: f64 = 1e-14;
/// Value at which a located crossing is exact, m or (m/s)².
const CROSSING_VALUE: f64 = 1e-15;

/// What the ball is doing.
pub(super) enum Phase {
    /// In potentials without events (`penalty`).
    Smooth,
    /// Touching nothing.
    Flight,
    /// Pressing on soft obstacles (`spring`): which.
    Pressed(Vec<bool>),
    /// Carried by obstacles (`bounce`).
    Carried(Support),
}

/// One run. Times go forwards; backward forecasts come with their field reversed.
pub(crate) struct Engine<'a, const M: usize> {
    pub field: &'a Field,
    pub obstacles: &'a [Obstacle],
    pub contact: &'a Contact,
    pub rigid: Rigid,
    pub options: &'a Options,
    pub backwards: bool,
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

impl<const M: usize> Engine<'_, M> {
    /// Runs to the last time, or to what stops it.
    pub fn run(&mut self) -> Status {
        let stopped = self.run_phases();
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
    fn run_phases(&mut self) -> Option<Status> {
        let mut phase = self.first_phase();
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
            let before = std::mem::discriminant(&phase);
            phase = match phase {
                Phase::Smooth => self.smooth(),
                Phase::Flight => self.flight(),
                Phase::Pressed(active) => self.pressed(active),
                Phase::Carried(support) => self.carried(support),
            };
            if std::mem::discriminant(&phase) != before {
                self.slope = None; // other forces
            }
        }
        None
    }

    fn first_phase(&self) -> Phase {
        match self.contact {
            Contact::Penalty { .. } => Phase::Smooth,
            Contact::Bounce { .. } => Phase::Flight,
            Contact::Spring { .. } => {
                let r = self.y.position();
                let active: Vec<_> =
                    self.obstacles.iter().map(|o| o.distance(&r) < self.rigid.radius - TOUCH).collect();
                if active.contains(&true) { Phase::Pressed(active) } else { Phase::Flight }
            }
        }
    }

    /// Time left to the next output, s.
    fn to_next(&self) -> f64 {
        self.times.get(self.out.len()).map_or(0.0, |time| time - self.t)
    }

    /// Moves to the end of `step`; hands out the state where a time asked for is reached.
    pub(super) fn commit(&mut self, step: &Step<M>) {
        let next = self.times[self.out.len()];
        let lands = step.h >= (next - self.t) * (1.0 - 1e-13);
        self.t = if lands { next } else { self.t + step.h };
        self.y = step.end;
        self.emit();
    }

    pub(super) fn emit(&mut self) {
        while self.times.get(self.out.len()).is_some_and(|&time| time <= self.t) {
            self.out.push(self.y);
        }
    }

    /// A step of at most `longest` s whose error is in bounds, or `None` where no step is small enough.
    pub(super) fn trial(&mut self, flow: &impl Flow, longest: f64) -> Option<Step<M>> {
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
                return None;
            }
            h = smaller;
            self.h = h;
        }
    }

    /// The step again, only as far as `theta` of it.
    pub(super) fn shortened(&self, flow: &impl Flow, step: Step<M>, theta: f64) -> Step<M> {
        if theta >= 1.0 {
            return step;
        }
        let slope = flow.derivative(&self.y);
        self.options.integrator.step(flow, &self.y, &slope, (step.h * theta).max(f64::MIN_POSITIVE))
    }

    /// Gives up: no step is small enough.
    pub(super) fn stuck(&mut self) {
        self.steps = self.options.step_limit;
    }

    fn smooth(&mut self) -> Phase {
        let r = self.y.position();
        let clear = self.obstacles.iter().map(|o| o.distance(&r)).fold(f64::INFINITY, f64::min);
        let reach = self.soft_reach();
        if clear > reach
            && let Some(linear) = self.closed_form()
        {
            // where no soft wall is felt, an arc
            let arc = Arc { linear, spin_decay: self.field.spin_decay(), press: None };
            let duration = self.times.last().map_or(0.0, |last| last - self.t);
            if self.follow(&arc, &[], reach, duration).is_none() {
                return Phase::Smooth;
            }
        }
        // No step may jump over a wall: the ball must see it on the way.
        let r = self.y.position();
        let clear = self.obstacles.iter().map(|o| o.distance(&r)).fold(f64::INFINITY, f64::min);
        let sharpness = match *self.contact {
            Contact::Penalty { beta, beta_box, .. } => beta.min(beta_box),
            _ => 1.0,
        };
        let longest = (clear.max(0.0) + SOFT_WALL_WIDTHS / sharpness) / self.y.velocity().norm();
        let field = self.field;
        match self.trial(field, longest) {
            Some(step) => {
                self.commit(&step);
                self.slope = Some(step.last);
            }
            None => self.stuck(),
        }
        Phase::Smooth
    }

    /// Distance from the paper's soft obstacles beyond which their forces are below the solver's tolerance, m.
    fn soft_reach(&self) -> f64 {
        let Contact::Penalty { c, beta, beta_box } = *self.contact else { return 0.0 };
        let tolerance = match self.options.integrator {
            Integrator::DormandPrince { atol, .. } => atol.min(SOFT_FORCE),
            _ => SOFT_FORCE_OF_STEPS,
        };
        let strongest = c.max(self.field.gravity.norm()).max(1.0);
        let reach = |beta: f64| (strongest * beta.max(1.0) / tolerance).ln().max(0.0) / beta;
        reach(beta).max(reach(beta_box))
    }

    pub(super) fn closed_form(&self) -> Option<Linear> {
        self.options.closed_forms.then(|| self.field.linear(&self.y.spin())).flatten()
    }

    /// Follows an arc for `duration` s, or to where a ball of `radius` touches an obstacle not in `skip`, and returns that.
    pub(super) fn follow(&mut self, arc: &Arc, skip: &[usize], radius: f64, duration: f64) -> Option<usize> {
        let (start, begin, head) = (self.y, self.t, self.head());
        let (r, v) = (start.position(), start.velocity());
        let path = |t: f64| arc.state_at(&head, t);
        let (a, bound) = (arc.acceleration(&r), arc.acceleration_bound(&r, &v));
        let contact = first_contact(self.obstacles, skip, radius, path, &a, bound, duration);
        let passed = contact.map_or(duration, |(t, _)| t);
        let until = begin + passed;
        while let Some(&time) = self.times.get(self.out.len()).filter(|&&time| time <= until) {
            self.out.push(arc.at(&start, time - begin));
        }
        (self.y, self.t, self.slope) = (arc.at(&start, passed), until, None);
        contact.map(|(_, obstacle)| obstacle)
    }

    fn flight(&mut self) -> Phase {
        if matches!(self.contact, Contact::Bounce { .. })
            && let Some(support) = self.support()
        {
            return Phase::Carried(support);
        }
        let field = self.field;
        let a = part(&field.derivative(&self.head()).0[0], 1);
        if let Some(linear) = self.closed_form() {
            let arc = Arc { linear, spin_decay: field.spin_decay(), press: None };
            let duration = self.times.last().map_or(0.0, |last| last - self.t);
            return self
                .follow(&arc, &[], self.rigid.radius, duration)
                .map_or(Phase::Flight, |obstacle| self.touch(obstacle));
        }
        let Some(step) = self.trial(field, f64::INFINITY) else {
            self.stuck();
            return Phase::Flight;
        };
        let path = |t: f64| step.state_at(t);
        let bound = step.acceleration_bound();
        let contact = first_contact(self.obstacles, &[], self.rigid.radius, path, &a, bound, step.h);
        let Some((time, obstacle)) = contact else {
            self.commit(&step);
            self.slope = Some(step.last);
            return Phase::Flight;
        };
        if time > 0.0 {
            let theta = time / step.h;
            let step = self.shortened(field, step, theta);
            self.commit(&step);
        }
        self.touch(obstacle)
    }

    /// The ball touches `obstacle` now.
    pub(super) fn touch(&mut self, obstacle: usize) -> Phase {
        self.record(obstacle);
        if matches!(self.contact, Contact::Spring { .. }) {
            let mut active = vec![false; self.obstacles.len()];
            active[obstacle] = true;
            return Phase::Pressed(active);
        }
        if self.backwards
            && self.irreversible.is_none()
            && (self.rigid.friction > 0.0 || self.rigid.restitution.is_infinite())
        {
            self.irreversible = Some(self.t);
        }
        let rigid = match self.backwards {
            // What a stuck or rubbing contact did cannot be told from its result: undone without friction.
            true => {
                let rebound = if self.rigid.restitution.is_finite() { self.rigid.restitution } else { 0.0 };
                Rigid { friction: 0.0, restitution: rebound, ..self.rigid }
            }
            false => self.rigid,
        };
        let near = self.obstacles[obstacle].nearest(&self.y.position());
        let field = self.field;
        let before = field.derivative(&self.head());
        let closing = near.normal.dot(&self.y.velocity());
        let time_changes = self.y.0.map(|column| contact_time_change(&column, &near.normal, closing));
        self.y = rigid.reflect(&self.y, &near, &before, |after| field.derivative(after));
        let leaving = near.normal.dot(&self.y.velocity());
        let free = field.derivative(&self.head());
        let reaction = normal_reaction(&near, &part(&free.0[0], 1), &self.y.velocity());
        if leaving > STILL.max(rest_speed(reaction)) {
            return Phase::Flight;
        }
        // Stays on the surface, exactly; from here on the support acts, too.
        self.y = self.carrier(&Support { contacts: vec![obstacle], rolling: false }).project(&self.y);
        let Some(mut support) = self.support() else { return Phase::Flight };
        support.rolling = self.carrier(&support).rolls(&self.y);
        self.y = self.carrier(&support).project(&self.y);
        let carried = self.carrier(&support).derivative(&self.head());
        self.shift_columns(time_changes, &free, &carried);
        self.y = self.carrier(&support).project(&self.y);
        Phase::Carried(support)
    }

    /// The state without its sensitivities.
    pub(super) fn head(&self) -> Columns<1> {
        Columns([self.y.0[0]])
    }

    pub(super) fn record(&mut self, obstacle: usize) {
        let near = self.obstacles[obstacle].nearest(&self.y.position());
        let closing = near.normal.dot(&self.y.velocity());
        let gradient = |component: usize| match self.y.0.get(component + 1) {
            Some(column) => contact_time_change(column, &near.normal, closing),
            None => 0.0,
        };
        let time_gradient = std::array::from_fn(gradient);
        let surface = self.obstacles[obstacle].surface;
        self.impacts.push(Impact {
            time: self.t,
            surface,
            position: self.y.position(),
            speed: -closing,
            time_gradient,
        });
    }

    /// Moves each sensitivity through an event whose time it changes by `time_changes`, at which the slope jumps.
    pub(super) fn shift_columns(&mut self, time_changes: [f64; M], before: &Columns<1>, after: &Columns<1>) {
        for (column, dt) in self.y.0.iter_mut().zip(time_changes).skip(1) {
            for (value, (b, a)) in column.iter_mut().zip(before.0[0].iter().zip(&after.0[0])) {
                *value += (b - a) * dt;
            }
        }
    }
}

/// Normal speed below which a ball that is pressed on with `reaction` (m/s²) stays, m/s.
pub(super) fn rest_speed(reaction: f64) -> f64 {
    (2.0 * reaction.max(0.0) * REST_HEIGHT).sqrt()
}

/// Where in [0, 1] `f` changes sign, given that it does (`rising`: from negative to positive):
/// regula falsi with Illinois' halving, and a bisection wherever that is slow.
pub(super) fn crossing(f: impl Fn(f64) -> f64, rising: bool) -> f64 {
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
