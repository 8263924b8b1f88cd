//! Resting, sliding and rolling of a rigid sphere: motion along what carries it.

use nalgebra::{Matrix3, Vector3};

use super::impact::Rigid;
use crate::columns::{Columns, column, part};
use crate::force::{Forces, Partials};
use crate::motion::integrate::Flow;
use crate::obstacle::{Nearest, Obstacle};

/// Slip below which a carried sphere rolls, m/s.
pub(crate) const ROLLING_SLIP: f64 = 1e-7;

/// What carries the sphere: one surface (with friction on faces), two (it moves along their
/// common line) or three (it does not move).
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Support {
    pub contacts: Vec<usize>,
    /// Whether it rolls without slipping.
    pub rolling: bool,
}

/// The constrained motion.
pub(crate) struct Carried<'a> {
    pub forces: &'a Forces,
    pub obstacles: &'a [Obstacle],
    pub support: &'a Support,
    pub rigid: Rigid,
}

/// Normal acceleration that keeps the sphere on a surface, m/s²; negative: it leaves.
pub(crate) fn normal_reaction(near: &Nearest, a: &Vector3<f64>, v: &Vector3<f64>) -> f64 {
    -(near.normal.dot(a) + v.dot(&(near.curvature * v)))
}

/// Projector onto the directions in which `contacts` leave the sphere free.
pub(crate) fn free_directions(normals: &[Vector3<f64>]) -> Matrix3<f64> {
    match normals {
        [] => Matrix3::identity(),
        [n] => Matrix3::identity() - n * n.transpose(),
        [n, m] => match n.cross(m).try_normalize(1e-9) {
            Some(line) => line * line.transpose(),
            None => Matrix3::identity() - n * n.transpose(),
        },
        _ => Matrix3::zeros(),
    }
}

impl Carried<'_> {
    /// The nearest points of what carries the sphere.
    pub fn nearest(&self, r: &Vector3<f64>) -> Vec<Nearest> {
        self.support.contacts.iter().map(|&index| self.obstacles[index].nearest(r)).collect()
    }

    /// Whether friction acts: on the face of a single support.
    fn rubs(&self, near: &Nearest) -> bool {
        self.rigid.friction > 0.0 && near.curvature == Matrix3::zeros()
    }

    /// Slip velocity on the support; `None` where there is no friction.
    pub fn slip(&self, r: &Vector3<f64>, v: &Vector3<f64>, w: &Vector3<f64>) -> Option<Vector3<f64>> {
        match self.nearest(r).as_slice() {
            [near] if self.rubs(near) => Some(self.rigid.slip(&near.normal, v, w)),
            _ => None,
        }
    }

    /// Whether friction acts and the sphere does not slip.
    pub fn rolls<const M: usize>(&self, y: &Columns<M>) -> bool {
        self.slip(&y.position(), &y.velocity(), &y.spin()).is_some_and(|slip| slip.norm() <= ROLLING_SLIP)
    }

    /// By how much the force that keeps the sphere rolling exceeds what friction gives, m/s²; negative: it rolls.
    pub fn lacking_grip(&self, y: &[f64; 9]) -> f64 {
        let (r, v, w) = (part(y, 0), part(y, 1), part(y, 2));
        match self.nearest(&r).as_slice() {
            [near] if self.rubs(near) => {
                let a = self.forces.acceleration(&r, &v, &w);
                let reaction = normal_reaction(near, &a, &v);
                let held = a + reaction * near.normal;
                self.grip(&near.normal, &held, &w).norm() - self.rigid.friction * reaction.max(0.0)
            }
            _ => -1.0,
        }
    }

    /// The friction, m/s², that keeps a rolling sphere from slipping under the acceleration `held`.
    fn grip(&self, n: &Vector3<f64>, held: &Vector3<f64>, w: &Vector3<f64>) -> Vector3<f64> {
        -(held + self.forces.spin_decay() * self.rigid.radius * w.cross(n)) / self.rigid.mobility()
    }

    /// Puts the state exactly on its supports and the sensitivities into their tangent space.
    pub fn project<const M: usize>(&self, y: &Columns<M>) -> Columns<M> {
        let mut out = *y;
        let near = self.nearest(&y.position());
        let normals: Vec<_> = near.iter().map(|near| near.normal).collect();
        let free = free_directions(&normals);
        let gap: Vector3<f64> = near.iter().map(|near| (self.rigid.radius - near.distance) * near.normal).sum();
        let v = free * y.velocity();
        out.0[0] = column(y.position() + gap, v, y.spin());
        for sensitivity in out.0.iter_mut().skip(1) {
            let dr = free * part(sensitivity, 0);
            let mut dv = free * part(sensitivity, 1);
            if let [near] = near.as_slice() {
                dv -= near.normal * (near.curvature * dr).dot(&v);
            }
            *sensitivity = column(dr, dv, part(sensitivity, 2));
        }
        out
    }

    /// Motion on a single surface: reaction, friction, and what they do to the sensitivities.
    fn on_surface<const M: usize>(
        &self,
        near: &Nearest,
        y: &Columns<M>,
        a: Vector3<f64>,
        partials: &Partials,
        out: &mut Columns<M>,
    ) {
        let (v, w) = (y.velocity(), y.spin());
        let (n, curvature, rigid) = (&near.normal, &near.curvature, &self.rigid);
        let bend = v.dot(&(curvature * v));
        let reaction = -(n.dot(&a) + bend);
        let held = a + reaction * n;
        let decay = self.forces.spin_decay();
        let slip = rigid.slip(n, &v, &w);
        let speed = slip.norm().max(ROLLING_SLIP * 1e-3);
        let rubs = self.rubs(near);
        let limit = rigid.friction * reaction.max(0.0);
        // what keeps a rolling sphere from slipping, as far as friction goes
        let grip = self.grip(n, &held, &w);
        let slips = grip.norm() > limit;
        let friction = match self.support.rolling {
            _ if !rubs => Vector3::zeros(),
            true if slips => grip * (limit / grip.norm()),
            true => grip,
            false => -limit * slip / speed,
        };
        out.0[0] = column(v, held + friction, rigid.spin_change(n, &friction) - decay * w);
        // derivative of the curvature term with respect to position, from d/dr of (P − nnᵀ)/d
        let bend_slope = -(2.0 * n.dot(&v) * (curvature * v) + bend * n) / near.distance.max(rigid.radius * 0.5);
        for (out, sensitivity) in out.0.iter_mut().zip(&y.0).skip(1) {
            let (dr, dv, dw) = (part(sensitivity, 0), part(sensitivity, 1), part(sensitivity, 2));
            let da = partials.position * dr + partials.velocity * dv + partials.spin * dw;
            let dn = curvature * dr;
            let d_bend = 2.0 * dv.dot(&(curvature * v)) + bend_slope.dot(&dr);
            let d_reaction = -(dn.dot(&a) + n.dot(&da) + d_bend);
            let d_held = da + d_reaction * n + reaction * dn;
            let d_friction = match self.support.rolling {
                _ if !rubs => Vector3::zeros(),
                true => {
                    let d_grip = self.grip(n, &d_held, &dw);
                    let along = grip / grip.norm().max(f64::MIN_POSITIVE);
                    let d_slipping = rigid.friction * d_reaction * along
                        + limit * (d_grip - along * along.dot(&d_grip)) / grip.norm().max(f64::MIN_POSITIVE);
                    if slips { d_slipping } else { d_grip }
                }
                false => {
                    let along = slip / speed;
                    let d_slip = rigid.slip(n, &dv, &dw);
                    -rigid.friction * (d_reaction * along + reaction * (d_slip - along * along.dot(&d_slip)) / speed)
                }
            };
            *out = column(dv, d_held + d_friction, rigid.spin_change(n, &d_friction) - decay * dw);
        }
    }
}

impl Flow for Carried<'_> {
    fn spins(&self) -> bool {
        true
    }

    /// On a support one friction changes both; the velocity's error speaks for the spin's.
    fn spin_errs(&self) -> bool {
        false
    }

    fn derivative_into<const M: usize>(&self, y: &Columns<M>, out: &mut Columns<M>) {
        let (r, v, w) = (y.position(), y.velocity(), y.spin());
        let mut partials = Partials::default();
        let a = self.forces.with_partials(&r, &v, &w, &mut partials);
        let near = self.nearest(&r);
        if let [near] = near.as_slice() {
            return self.on_surface(near, y, a, &partials, out);
        }
        let free = free_directions(&near.iter().map(|near| near.normal).collect::<Vec<_>>());
        partials.position = free * partials.position;
        partials.velocity = free * partials.velocity;
        partials.spin = free * partials.spin;
        self.forces.slope_of(y, free * a, &partials, self.forces.depends, out);
    }
}
