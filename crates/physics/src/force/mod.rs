//! The forces that act on a ball in flight, per unit of its mass: a list, each in its own file.

mod air;
mod gravity;
mod potential;
mod spring;

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};

use self::air::{Drag, Lift};
use self::gravity::Gravity;
pub use self::potential::Potential;
use self::spring::Tether;
use super::columns::{Columns, column, part};
use super::scene::Scene;

/// Most forces that a scene has: gravity, drag, lift, a spring, a potential of the user's own.
pub const FORCES: usize = 5;
/// Scale uncertainty of a force that the scene gives exactly.
const EXACT: f64 = 1e-4;

/// A force per unit mass, a(r, v, ω) in the world frame, as time runs forwards.
pub(crate) trait Force: std::fmt::Debug + Send + Sync {
    /// Acceleration at position `r`, velocity `v` and spin `w`, m/s²; its derivatives are added to `partials`.
    fn acceleration(
        &self,
        r: &Vector3<f64>,
        v: &Vector3<f64>,
        w: &Vector3<f64>,
        partials: Option<&mut Partials>,
    ) -> Vector3<f64>;

    /// As in the results of a fit.
    fn name(&self) -> &'static str;

    /// Standard deviation of the logarithm of its size: how well the scene knows it.
    fn scale_sigma(&self) -> f64;

    /// What the acceleration changes with.
    fn depends(&self) -> Depends;

    /// The force on a ball of this spin, where it is linear in the position alone.
    fn linear(&self, _spin: &Vector3<f64>) -> Option<Linear> {
        None
    }

    /// Potential energy, J/kg; zero for a force that has none.
    fn potential_energy(&self, _r: &Vector3<f64>) -> f64 {
        0.0
    }
}

/// ∂(acceleration)/∂(position, velocity, spin).
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Partials {
    pub position: Matrix3<f64>,
    pub velocity: Matrix3<f64>,
    pub spin: Matrix3<f64>,
}

/// What an acceleration changes with; the other partials are zero.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Depends {
    pub position: bool,
    pub velocity: bool,
    pub spin: bool,
}

/// Forces whose motion has a closed form: `a = pull − stiffness·r`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Linear {
    pub pull: Vector3<f64>,
    pub stiffness: f64,
}

impl Linear {
    pub const ZERO: Self = Self { pull: Vector3::new(0.0, 0.0, 0.0), stiffness: 0.0 };

    fn plus(self, other: Self) -> Self {
        Self { pull: self.pull + other.pull, stiffness: self.stiffness + other.stiffness }
    }
}

/// A scene's forces.
#[derive(Debug, Clone)]
pub(crate) struct Forces {
    list: Vec<Arc<dyn Force>>,
    /// What any of them depends on.
    pub depends: Depends,
    /// Rate at which the spin decays, 1/s; negative when time runs backwards.
    spin_decay: f64,
    /// 1; −1 when time runs backwards: then velocities and spins given and taken are of reversed sign.
    time: f64,
}

impl Forces {
    /// The forces of a scene, and a potential of the user's own.
    pub fn of(scene: &Scene, potential: Option<&Arc<dyn Potential>>) -> Self {
        let list: Vec<Arc<dyn Force>> =
            [Gravity::of(scene), Drag::of(scene), Lift::of(scene), Tether::of(scene), potential::force(potential)]
                .into_iter()
                .flatten()
                .collect();
        let any = |depends: fn(Depends) -> bool| list.iter().any(|force| depends(force.depends()));
        let depends =
            Depends { position: any(|on| on.position), velocity: any(|on| on.velocity), spin: any(|on| on.spin) };
        Self { list, depends, spin_decay: scene.ball.spin_decay, time: 1.0 }
    }

    /// The same forces for (r, −v, −ω) as time runs backwards.
    pub fn reversed(&self) -> Self {
        Self { spin_decay: -self.spin_decay, time: -self.time, ..self.clone() }
    }

    /// Names and scale uncertainties ([`Force::scale_sigma`]), in the order of [`Self::scaled`]'s scales.
    pub fn scale_sigmas(&self) -> impl Iterator<Item = (&'static str, f64)> {
        self.list.iter().map(|force| (force.name(), force.scale_sigma()))
    }

    /// Acceleration of a ball whose forces are `scales` times the scene's, m/s².
    #[inline]
    pub fn scaled_sum(&self, [r, v, w]: [&Vector3<f64>; 3], scales: &[f64; FORCES]) -> Vector3<f64> {
        let forces = self.list.iter().zip(scales);
        forces.map(|(force, scale)| force.acceleration(r, v, w, None) * *scale).sum()
    }

    /// Acceleration of a ball whose forces are `scales` times the scene's, m/s², and each force's part of it. The partials of
    /// the sum go to `partials`, which are zero before.
    #[inline]
    pub fn scaled(
        &self,
        [r, v, w]: [&Vector3<f64>; 3],
        scales: &[f64; FORCES],
        partials: &mut Partials,
    ) -> (Vector3<f64>, [Vector3<f64>; FORCES]) {
        let mut parts = [Vector3::zeros(); FORCES];
        for ((force, scale), part) in self.list.iter().zip(scales).zip(&mut parts) {
            let mut own = Partials::default();
            *part = force.acceleration(r, v, w, Some(&mut own)) * *scale;
            let depends = force.depends();
            if depends.position {
                partials.position += own.position * *scale;
            }
            if depends.velocity {
                partials.velocity += own.velocity * *scale;
            }
            if depends.spin {
                partials.spin += own.spin * *scale;
            }
        }
        (parts.iter().sum(), parts)
    }

    /// 1/s.
    pub fn spin_decay(&self) -> f64 {
        self.spin_decay
    }

    /// The motion of a ball of this spin, where it has a closed form.
    pub fn linear(&self, spin: &Vector3<f64>) -> Option<Linear> {
        self.list.iter().try_fold(Linear::ZERO, |sum, force| Some(sum.plus(force.linear(spin)?)))
    }

    /// Acceleration, m/s².
    #[inline]
    pub fn acceleration(&self, r: &Vector3<f64>, v: &Vector3<f64>, w: &Vector3<f64>) -> Vector3<f64> {
        let (v, w) = (self.time * v, self.time * w);
        self.list.iter().fold(Vector3::zeros(), |sum, force| sum + force.acceleration(r, &v, &w, None))
    }

    /// Acceleration, m/s²; its partials go to `partials`, which are zero before.
    #[inline]
    pub fn with_partials(
        &self,
        r: &Vector3<f64>,
        v: &Vector3<f64>,
        w: &Vector3<f64>,
        partials: &mut Partials,
    ) -> Vector3<f64> {
        let (v, w) = (self.time * v, self.time * w);
        let mut sum = Vector3::zeros();
        for force in &self.list {
            sum += force.acceleration(r, &v, &w, Some(partials));
        }
        if self.time < 0.0 {
            partials.velocity.neg_mut();
            partials.spin.neg_mut();
        }
        sum
    }

    /// Potential energy, J/kg; what drag and friction take is not in it.
    pub fn potential_energy(&self, r: &Vector3<f64>) -> f64 {
        self.list.iter().map(|force| force.potential_energy(r)).sum()
    }

    /// The slope of state and sensitivities under these forces and `more`, which adds an acceleration that depends on
    /// the position alone, with its partials, to `out`.
    #[inline]
    pub fn slope<const M: usize>(
        &self,
        y: &Columns<M>,
        more: impl FnOnce(&Vector3<f64>, Option<&mut Partials>) -> Vector3<f64>,
        out: &mut Columns<M>,
    ) {
        let (r, v, w) = (y.position(), y.velocity(), y.spin());
        let mut partials = Partials::default();
        let a = match M {
            1 => self.acceleration(&r, &v, &w) + more(&r, None),
            _ => self.with_partials(&r, &v, &w, &mut partials) + more(&r, Some(&mut partials)),
        };
        self.slope_of(y, a, &partials, Depends { position: true, ..self.depends }, out);
    }

    /// The slope of state and sensitivities under an acceleration, what it depends on, and its partials by that, to `out`.
    #[inline]
    pub fn slope_of<const M: usize>(
        &self,
        y: &Columns<M>,
        a: Vector3<f64>,
        partials: &Partials,
        depends: Depends,
        out: &mut Columns<M>,
    ) {
        out.0[0] = column(y.velocity(), a, -self.spin_decay * y.spin());
        for (out, sensitivity) in out.0.iter_mut().zip(&y.0).skip(1) {
            let (dr, dv, dw) = (part(sensitivity, 0), part(sensitivity, 1), part(sensitivity, 2));
            let mut da = Vector3::zeros();
            if depends.position {
                da += partials.position * dr;
            }
            if depends.velocity {
                da += partials.velocity * dv;
            }
            if depends.spin {
                da += partials.spin * dw;
            }
            *out = column(dv, da, -self.spin_decay * dw);
        }
    }

    /// The slope of state and sensitivities under these forces alone, to `out`.
    #[inline]
    pub fn free_slope<const M: usize>(&self, y: &Columns<M>, out: &mut Columns<M>) {
        let (r, v, w) = (y.position(), y.velocity(), y.spin());
        let mut partials = Partials::default();
        let a = match M {
            1 => self.acceleration(&r, &v, &w),
            _ => self.with_partials(&r, &v, &w, &mut partials),
        };
        self.slope_of(y, a, &partials, self.depends, out);
    }

    /// Whether the spin changes, or changes anything.
    pub fn spins(&self) -> bool {
        self.depends.spin || self.spin_decay != 0.0
    }
}
