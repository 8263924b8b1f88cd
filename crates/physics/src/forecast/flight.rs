//! Free flight, step by step, with derivatives by its start and by the sizes of the forces. Contacts are left out: they end a
//! flight.

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::Forecaster;
use crate::columns::{Column, column, part};
use crate::force::{FORCES, Forces, Partials};
use crate::motion::approach::{Path, first_contact};
use crate::obstacle::Obstacle;

/// Longest step of the integration (Runge and Kutta's, fourth order), s; shorter ones than half of it are read off a curve of third
/// order through the ends of one of that length.
const LONGEST_STEP: f64 = 0.05;
/// Least progress of the search for a contact where the ball only grazes something, s.
const GRAZED: f64 = 1e-6;

/// Derivatives of a vector by the start (position, velocity, spin) and by the logarithms of the forces' scales.
pub type Sensitivity = SMatrix<f64, 3, { 9 + FORCES }>;

/// A ball in free flight.
#[derive(Debug, Clone)]
#[doc(hidden)]
pub struct FreeFlight<'a> {
    forces: &'a Forces,
    /// Whether the derivatives are followed; else they are those of the start.
    derivatives: bool,
    scales: [f64; FORCES],
    /// m, m/s, rad/s.
    pub state: Column,
    /// Of the position and of the velocity.
    pub position: Sensitivity,
    pub velocity: Sensitivity,
    /// By what the spin has decayed since the start: its derivative by the spin there.
    pub spin: f64,
    /// The step that shorter ones are interpolated on (dense output).
    dense: Option<Box<DenseStep>>,
}

/// A moment of a flight.
#[derive(Debug, Clone, Copy)]
struct Moment {
    state: Column,
    position: Sensitivity,
    velocity: Sensitivity,
    spin: f64,
}

/// A step of a flight, and where on it the flight is.
#[derive(Debug, Clone)]
struct DenseStep {
    from: Moment,
    to: Moment,
    /// How long it lasts, and for how long of that the flight has been, s.
    lasting: f64,
    elapsed: f64,
}

impl Forecaster {
    /// A free flight from `start`, its forces `exp(log_scales)` times the scene's; with `derivatives` or without, which is faster.
    #[doc(hidden)]
    pub fn flight(&self, start: &Column, log_scales: &[f64; FORCES], derivatives: bool) -> FreeFlight<'_> {
        let unit = |first: usize| Sensitivity::from_fn(|row, column| f64::from(u8::from(column == first + row)));
        let (forces, scales) = (&self.forwards.forces, log_scales.map(f64::exp));
        FreeFlight {
            forces,
            derivatives,
            scales,
            state: *start,
            position: unit(0),
            velocity: unit(3),
            spin: 1.0,
            dense: None,
        }
    }

    /// Names and scale uncertainties of the forces: standard deviations of their sizes' logarithms.
    pub fn scale_sigmas(&self) -> impl Iterator<Item = (&'static str, f64)> {
        self.forwards.forces.scale_sigmas()
    }
}

impl FreeFlight<'_> {
    /// Slope of the state, m/s and m/s².
    pub fn slope(&self) -> (Vector3<f64>, Vector3<f64>) {
        let v = part(&self.state, 1);
        let state = [&part(&self.state, 0), &v, &part(&self.state, 2)];
        (v, self.forces.scaled_sum(state, &self.scales))
    }

    /// The smallest change of the spin that adds `more` to the acceleration, as far as a spin can, rad/s.
    pub fn spin_for(&self, more: &Vector3<f64>) -> Vector3<f64> {
        let [r, v, w] = [0, 1, 2].map(|index| part(&self.state, index));
        let mut partials = Partials::default();
        self.forces.scaled([&r, &v, &w], &self.scales, &mut partials);
        let by_spin = partials.spin;
        let size = by_spin.norm_squared();
        let inverse = (by_spin * by_spin.transpose() + Matrix3::identity() * (1e-6 * size)).try_inverse();
        inverse.map_or(Vector3::zeros(), |inverse| by_spin.transpose() * inverse * more)
    }

    /// Largest acceleration that a spin of 1 rad/s adds, m/s².
    pub fn by_spin(&self) -> f64 {
        let [r, v, w] = [0, 1, 2].map(|index| part(&self.state, index));
        let mut partials = Partials::default();
        self.forces.scaled([&r, &v, &w], &self.scales, &mut partials);
        partials.spin.norm() / std::f64::consts::SQRT_2
    }

    /// Flies on for `dt` s; negative: back.
    pub fn advance(&mut self, dt: f64) {
        if dt.abs() < LONGEST_STEP / 2.0 {
            return self.advance_shortly(dt);
        }
        self.dense = None;
        let steps = (dt.abs() / LONGEST_STEP).ceil().max(1.0);
        for _ in 0..steps as usize {
            self.step(dt / steps);
        }
    }

    /// Flies on for up to `duration` s, to where a ball of `radius` first touches one of the `obstacles`: after how long (s), and which;
    /// none where it touches nothing. The forecaster's own search, so nothing thin or fast is passed.
    pub fn advance_to_contact(&mut self, obstacles: &[Obstacle], radius: f64, duration: f64) -> Option<(f64, usize)> {
        let mut elapsed = 0.0;
        while elapsed < duration {
            let lasting = LONGEST_STEP.min(duration - elapsed);
            let from = self.moment();
            self.step(lasting);
            let step = DenseStep { from, to: self.moment(), lasting, elapsed: 0.0 };
            let reached = first_contact(obstacles, &[], radius, &step, lasting);
            self.dense = None;
            if reached.obstacle.is_none() && reached.time >= lasting {
                elapsed += lasting;
                continue;
            }
            let time = if reached.obstacle.is_some() { reached.time } else { reached.time.max(GRAZED) };
            self.set(&from);
            self.step(time);
            elapsed += time;
            if let Some(obstacle) = reached.obstacle {
                return Some((elapsed, obstacle));
            }
        }
        None
    }

    fn moment(&self) -> Moment {
        Moment { state: self.state, position: self.position, velocity: self.velocity, spin: self.spin }
    }

    fn set(&mut self, moment: &Moment) {
        (self.state, self.position, self.velocity, self.spin) =
            (moment.state, moment.position, moment.velocity, moment.spin);
    }

    /// A short step along a long one.
    fn advance_shortly(&mut self, dt: f64) {
        let is_on = |dense: &DenseStep| (0.0..=1.0).contains(&((dense.elapsed + dt) / dense.lasting));
        let dense = self.dense.take().filter(|dense| is_on(dense));
        let mut dense = dense.unwrap_or_else(|| {
            let (from, lasting) = (self.moment(), LONGEST_STEP.copysign(dt));
            self.step(lasting);
            let to = self.moment();
            self.set(&from);
            Box::new(DenseStep { from, to, lasting, elapsed: 0.0 })
        });
        dense.elapsed += dt;
        let decay = (-self.forces.spin_decay() * dense.elapsed).exp();
        self.set(&dense.moment(decay, self.derivatives));
        self.dense = Some(dense);
    }

    /// One step: the state by Runge and Kutta's method, the derivatives by those of the forces in the middle of it.
    fn step(&mut self, h: f64) {
        let [r, v, w] = [0, 1, 2].map(|index| part(&self.state, index));
        let decay = |time: f64| (-self.forces.spin_decay() * time).exp();
        let half = h / 2.0;
        let (decayed, w2) = (decay(h), w * decay(half));
        let slope =
            |r: Vector3<f64>, v: Vector3<f64>, w: &Vector3<f64>| self.forces.scaled_sum([&r, &v, w], &self.scales);
        let a1 = slope(r, v, &w);
        let v2 = v + a1 * half;
        let a2 = slope(r + v * half, v2, &w2);
        let v3 = v + a2 * half;
        let a3 = slope(r + v2 * half, v3, &w2);
        let v4 = v + a3 * h;
        let a4 = slope(r + v3 * h, v4, &(w * decayed));
        let end = column(
            r + (v + 2.0 * (v2 + v3) + v4) * (h / 6.0),
            v + (a1 + 2.0 * (a2 + a3) + a4) * (h / 6.0),
            w * decayed,
        );
        if self.derivatives {
            let mut partials = Partials::default();
            let middle = [&(r + v2 * half), &v3, &w2];
            let (_, parts) = self.forces.scaled(middle, &self.scales, &mut partials);
            // What does not depend on the derivatives so far.
            let mut constant = Sensitivity::zeros();
            constant.fixed_view_mut::<3, 3>(0, 6).copy_from(&(partials.spin * (self.spin * decay(half))));
            for (index, part) in parts.iter().enumerate() {
                constant.column_mut(9 + index).copy_from(part);
            }
            let slope = |dr: &Sensitivity, dv: &Sensitivity| {
                let mut da = constant + partials.velocity * dv;
                if self.forces.depends.position {
                    da += partials.position * dr;
                }
                da
            };
            let (dr, dv) = (self.position, self.velocity);
            let da = slope(&dr, &dv);
            let (dr2, dv2) = (dr + dv * half, dv + da * half);
            let da2 = slope(&dr2, &dv2);
            let change = (da2 - da) * (h * h / 3.0);
            self.position += dv * h + da * (h * h / 2.0) + change;
            self.velocity += da2 * h + partials.velocity * change;
        }
        self.state = end;
        self.spin *= decayed;
    }
}

impl DenseStep {
    /// Weights of the positions at the ends and of the velocities there (Hermite's curve) after `t` s: the position's, the velocity's, the
    /// acceleration's.
    fn weights(&self, t: f64) -> [[f64; 4]; 3] {
        let (h, t) = (self.lasting, t / self.lasting);
        let (t2, t3) = (t * t, t * t * t);
        let place = [2.0 * t3 - 3.0 * t2 + 1.0, 3.0 * t2 - 2.0 * t3, h * (t3 - 2.0 * t2 + t), h * (t3 - t2)];
        let slope = [6.0 * (t2 - t) / h, 6.0 * (t - t2) / h, 3.0 * t2 - 4.0 * t + 1.0, 3.0 * t2 - 2.0 * t];
        let bend = (12.0 * t - 6.0) / (h * h);
        [place, slope, [bend, -bend, (6.0 * t - 4.0) / h, (6.0 * t - 2.0) / h]]
    }

    fn vector(&self, by: [f64; 4]) -> Vector3<f64> {
        let [r0, v0] = [0, 1].map(|index| part(&self.from.state, index));
        let [r1, v1] = [0, 1].map(|index| part(&self.to.state, index));
        r0 * by[0] + r1 * by[1] + v0 * by[2] + v1 * by[3]
    }

    /// The moment by Hermite's curve through its ends; the spin has `decayed`.
    fn moment(&self, decayed: f64, derivatives: bool) -> Moment {
        let [place, slope, _] = self.weights(self.elapsed);
        let (from, to) = (&self.from, &self.to);
        let mut moment = Moment { spin: from.spin * decayed, ..*from };
        moment.state = column(self.vector(place), self.vector(slope), part(&from.state, 2) * decayed);
        if derivatives {
            let of = |by: [f64; 4]| {
                from.position * by[0] + to.position * by[1] + from.velocity * by[2] + to.velocity * by[3]
            };
            (moment.position, moment.velocity) = (of(place), of(slope));
        }
        moment
    }
}

impl Path for DenseStep {
    fn at(&self, t: f64) -> (Vector3<f64>, Vector3<f64>) {
        let [place, slope, _] = self.weights(t);
        (self.vector(place), self.vector(slope))
    }

    fn acceleration(&self) -> Vector3<f64> {
        self.vector(self.weights(0.0)[2])
    }

    /// A curve of third order is bent most at one of its ends.
    fn bound(&self) -> f64 {
        self.acceleration().norm().max(self.vector(self.weights(self.lasting)[2]).norm())
    }

    fn slides_along(&self, _: &Vector3<f64>) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::{Scene, State};

    fn tennis() -> (Forecaster, Column) {
        let forecaster = Forecaster::new(&Scene::named("tennis").unwrap()).unwrap();
        let start =
            column(Vector3::new(0.2, -3.0, 1.4), Vector3::new(3.0, 21.0, 2.5), Vector3::new(-180.0, 40.0, 90.0));
        (forecaster, start)
    }

    fn flown(forecaster: &Forecaster, start: &Column, scales: &[f64; FORCES], derivatives: bool) -> Column {
        let mut flight = forecaster.flight(start, scales, derivatives);
        (0..10).for_each(|_| flight.advance(0.03));
        flight.state
    }

    #[test]
    fn a_flight_is_the_forecasters() {
        let (forecaster, start) = tennis();
        let [r, v, w] = [0, 1, 2].map(|index| part(&start, index));
        let end = forecaster.forecast(&State { position: r.into(), velocity: v, spin: w }, &[0.3]).states[0];
        for derivatives in [false, true] {
            let flown = flown(&forecaster, &start, &[0.0; FORCES], derivatives);
            assert!((part(&flown, 0) - end.position.coords).norm() < 1e-6);
            assert!((part(&flown, 1) - end.velocity).norm() < 1e-5);
            assert!((part(&flown, 2) - end.spin).norm() < 1e-6);
        }
    }

    #[test]
    fn a_contact_is_found_where_the_forecaster_finds_it() {
        let (forecaster, mut start) = tennis();
        // Down onto the court, so fast and so shallow that steps of a hundredth of a second would pass through a thin thing.
        start[3..6].copy_from_slice(&[2.0, 30.0, -3.0]);
        let [r, v, w] = [0, 1, 2].map(|index| part(&start, index));
        let expected = forecaster.forecast(&State { position: r.into(), velocity: v, spin: w }, &[1.0]).impacts[0];
        let obstacles = Obstacle::of(forecaster.scene());
        let mut flight = forecaster.flight(&start, &[0.0; FORCES], true);
        let (time, obstacle) = flight.advance_to_contact(&obstacles, forecaster.scene().ball.radius, 1.0).unwrap();
        assert!((time - expected.time).abs() < 1e-6, "{time} {}", expected.time);
        assert_eq!(obstacles[obstacle].surface, expected.surface);
        assert!((part(&flight.state, 0) - expected.world.coords).norm() < 1e-5);
        // Nothing in the way: all the way.
        let mut free = forecaster.flight(&start, &[0.0; FORCES], false);
        assert_eq!(free.advance_to_contact(&obstacles, forecaster.scene().ball.radius, time / 2.0), None);
        let mut flown = forecaster.flight(&start, &[0.0; FORCES], false);
        flown.advance(time / 2.0);
        assert!((part(&free.state, 0) - part(&flown.state, 0)).norm() < 1e-4);
    }

    #[test]
    fn many_short_steps_are_as_few_long_ones() {
        let (forecaster, start) = tennis();
        let mut few = forecaster.flight(&start, &[0.0; FORCES], true);
        (0..10).for_each(|_| few.advance(0.03));
        let mut many = forecaster.flight(&start, &[0.0; FORCES], true);
        (0..150).for_each(|_| many.advance(0.002));
        assert!((part(&few.state, 0) - part(&many.state, 0)).norm() < 1e-4);
        assert!((part(&few.state, 1) - part(&many.state, 1)).norm() < 1e-3);
        assert!((part(&few.state, 2) - part(&many.state, 2)).norm() < 1e-6);
        assert!((few.position - many.position).norm() < 1e-3 * few.position.norm());
        assert!((few.velocity - many.velocity).norm() < 1e-3 * few.velocity.norm());
        // And back.
        (0..150).for_each(|_| many.advance(-0.002));
        assert!((part(&many.state, 0) - part(&start, 0)).norm() < 1e-3);
    }

    #[test]
    fn its_derivatives_are_those_of_differences() {
        let (forecaster, start) = tennis();
        let mut flight = forecaster.flight(&start, &[0.0; FORCES], true);
        (0..10).for_each(|_| flight.advance(0.03));
        let steps = [1e-5, 1e-5, 1e-5, 1e-5, 1e-5, 1e-5, 1e-3, 1e-3, 1e-3];
        for number in 0..9 + FORCES {
            let at = |sign: f64| {
                let (mut start, mut scales) = (start, [0.0; FORCES]);
                match number.checked_sub(9) {
                    None => start[number] += sign * steps[number],
                    Some(force) => scales[force] += sign * 1e-4,
                }
                flown(&forecaster, &start, &scales, false)
            };
            let step = if number < 9 { steps[number] } else { 1e-4 };
            let (up, down) = (at(1.0), at(-1.0));
            for (which, sensitivity) in [&flight.position, &flight.velocity].into_iter().enumerate() {
                let slope = (part(&up, which) - part(&down, which)) / (2.0 * step);
                let off = (slope - sensitivity.column(number)).norm();
                // The derivatives are for steps of a search: to a thousandth.
                assert!(off < 1e-3 * (1.0 + slope.norm()), "{number} {which}: {off}");
            }
        }
    }
}
