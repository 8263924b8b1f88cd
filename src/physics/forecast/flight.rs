//! Free flight, step by step, with derivatives by its start and by the sizes of the forces. Contacts are left out: they end a
//! flight.

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::Forecaster;
use super::columns::{Column, column, part};
use crate::physics::force::{FORCES, Forces, Partials};

/// Longest step of the integration (Runge and Kutta's, fourth order), s.
const LONGEST_STEP: f64 = 0.05;

/// Derivatives of a vector by the start (position, velocity, spin) and by the logarithms of the forces' scales.
pub(crate) type Sensitivity = SMatrix<f64, 3, { 9 + FORCES }>;

/// A ball in free flight.
#[derive(Debug, Clone)]
pub(crate) struct Flight<'a> {
    forces: &'a Forces,
    scales: [f64; FORCES],
    /// m, m/s, rad/s.
    pub state: Column,
    /// Of the position and of the velocity.
    pub position: Sensitivity,
    pub velocity: Sensitivity,
    /// By what the spin has decayed since the start: its derivative by the spin there.
    pub spin: f64,
}

/// Slopes of velocity, and of the velocity's sensitivity.
type Slope = (Vector3<f64>, Sensitivity);

impl Forecaster {
    /// A free flight from `start`, its forces `exp(log_scales)` times the scene's.
    pub(crate) fn flight(&self, start: &Column, log_scales: &[f64; FORCES]) -> Flight<'_> {
        let unit = |first: usize| Sensitivity::from_fn(|row, column| f64::from(u8::from(column == first + row)));
        let (forces, scales) = (&self.forwards.forces, log_scales.map(f64::exp));
        Flight { forces, scales, state: *start, position: unit(0), velocity: unit(3), spin: 1.0 }
    }

    /// Names and scale uncertainties of the forces: standard deviations of their sizes' logarithms.
    pub(crate) fn scale_sigmas(&self) -> impl Iterator<Item = (&'static str, f64)> {
        self.forwards.forces.scale_sigmas()
    }
}

impl Flight<'_> {
    /// Slope of the state, m/s and m/s².
    pub fn slope(&self) -> (Vector3<f64>, Vector3<f64>) {
        let v = part(&self.state, 1);
        let state = [&part(&self.state, 0), &v, &part(&self.state, 2)];
        (v, self.forces.scaled(state, &self.scales, &mut Partials::default()).0)
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

    /// Flies on for `dt` s; negative: back.
    pub fn advance(&mut self, dt: f64) {
        let steps = (dt.abs() / LONGEST_STEP).ceil().max(1.0);
        for _ in 0..steps as usize {
            self.step(dt / steps);
        }
    }

    fn step(&mut self, h: f64) {
        let [r, v, w] = [0, 1, 2].map(|index| part(&self.state, index));
        let decay = |time: f64| (-self.forces.spin_decay() * time).exp();
        let slope = |time: f64, r: Vector3<f64>, v: Vector3<f64>, dr: &Sensitivity, dv: &Sensitivity| -> Slope {
            let (mut partials, by_spin) = (Partials::default(), self.spin * decay(time));
            let state = [&r, &v, &(w * decay(time))];
            let (a, parts) = self.forces.scaled(state, &self.scales, &mut partials);
            let mut da = partials.velocity * dv;
            if self.forces.depends.position {
                da += partials.position * dr;
            }
            let mut spins = da.fixed_view_mut::<3, 3>(0, 6);
            spins += partials.spin * by_spin;
            for (index, part) in parts.iter().enumerate() {
                let mut own = da.column_mut(9 + index);
                own += part;
            }
            (a, da)
        };
        let (dr, dv) = (self.position, self.velocity);
        let half = h / 2.0;
        let (a1, da1) = slope(0.0, r, v, &dr, &dv);
        let (v2, dv2) = (v + a1 * half, dv + da1 * half);
        let (a2, da2) = slope(half, r + v * half, v2, &(dr + dv * half), &dv2);
        let (v3, dv3) = (v + a2 * half, dv + da2 * half);
        let (a3, da3) = slope(half, r + v2 * half, v3, &(dr + dv2 * half), &dv3);
        let (v4, dv4) = (v + a3 * h, dv + da3 * h);
        let (a4, da4) = slope(h, r + v3 * h, v4, &(dr + dv3 * h), &dv4);
        let r = r + (v + 2.0 * (v2 + v3) + v4) * (h / 6.0);
        let v = v + (a1 + 2.0 * (a2 + a3) + a4) * (h / 6.0);
        self.position += (dv + 2.0 * (dv2 + dv3) + dv4) * (h / 6.0);
        self.velocity += (da1 + 2.0 * (da2 + da3) + da4) * (h / 6.0);
        self.state = column(r, v, w * decay(h));
        self.spin *= decay(h);
    }
}
