//! A rigid sphere's impact, and its sensitivities (the saltation matrix).

use nalgebra::Vector3;

use crate::columns::{Columns, column, part};
use crate::motion::run::contact_time_change;
use crate::obstacle::Nearest;

/// The rigid sphere.
#[derive(Debug, Clone, Copy)]
#[doc(hidden)]
pub struct Rigid {
    pub radius: f64,
    pub restitution: f64,
    pub friction: f64,
    /// Moment of inertia / (mass·radius²).
    pub inertia_factor: f64,
}

impl Rigid {
    /// Velocity of the sphere's surface at the contact, tangential: `v − v_n·n − R·ω×n`.
    pub fn slip(&self, n: &Vector3<f64>, v: &Vector3<f64>, w: &Vector3<f64>) -> Vector3<f64> {
        v - n * n.dot(v) - self.radius * w.cross(n)
    }

    /// Share of the slip that a tangential impulse of the size of the slip leaves standing: 1 + 1/α.
    pub fn mobility(&self) -> f64 {
        1.0 + 1.0 / self.inertia_factor
    }

    /// Change of spin by a tangential impulse (per unit mass) at the contact.
    pub fn spin_change(&self, n: &Vector3<f64>, impulse: &Vector3<f64>) -> Vector3<f64> {
        -n.cross(impulse) / (self.inertia_factor * self.radius)
    }

    /// Impulses (per unit mass) along the normal and across it: normal restitution, Coulomb's friction up to sticking; and
    /// whether it sticks.
    fn impulses(&self, n: &Vector3<f64>, v: &Vector3<f64>, w: &Vector3<f64>) -> (f64, Vector3<f64>, bool) {
        let normal = -(1.0 + self.restitution) * n.dot(v);
        let slip = self.slip(n, v, w);
        let (speed, limit) = (slip.norm(), self.friction * normal);
        let sticks = speed <= limit * self.mobility();
        let across = match sticks {
            true if self.friction > 0.0 => -slip / self.mobility(),
            true => Vector3::zeros(),
            false => -limit * slip / speed,
        };
        (normal, across, sticks)
    }

    /// Velocity and spin after a contact with a surface of normal `n`.
    pub fn rebound(&self, n: &Vector3<f64>, v: &Vector3<f64>, w: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let (normal, across, _) = self.impulses(n, v, w);
        (v + normal * n + across, w + self.spin_change(n, &across))
    }

    /// Reflects `y` (touching, closing): normal restitution, Coulomb's friction up to sticking.
    ///
    /// The sensitivities pass through the saltation matrix: the contact time moves by
    /// `δt = −n·δr / v_n`; each column goes to the moved time along `before`, through the
    /// derivative of the reflection, and back along `after`'s slope, which `slope_after` gives.
    pub fn reflect<const M: usize>(
        &self,
        y: &Columns<M>,
        near: &Nearest,
        slope_before: &Columns<1>,
        slope_after: impl Fn(&Columns<1>) -> Columns<1>,
    ) -> Columns<M> {
        let (n, r, v, w) = (&near.normal, y.position(), y.velocity(), y.spin());
        let closing = n.dot(&v);
        let slip = self.slip(n, &v, &w);
        let (normal_impulse, impulse, sticks) = self.impulses(n, &v, &w);
        let (speed, limit) = (slip.norm(), self.friction * normal_impulse);
        let mut out = *y;
        out.0[0] = column(r, v + normal_impulse * n + impulse, w + self.spin_change(n, &impulse));
        let after = slope_after(&Columns([out.0[0]]));
        let (va, aa, wa) = (part(&after.0[0], 0), part(&after.0[0], 1), part(&after.0[0], 2));
        let (vb, ab, wb) = (part(&slope_before.0[0], 0), part(&slope_before.0[0], 1), part(&slope_before.0[0], 2));
        for sensitivity in out.0.iter_mut().skip(1) {
            let dt = contact_time_change(sensitivity, n, closing);
            let dr = part(sensitivity, 0) + vb * dt;
            let dv = part(sensitivity, 1) + ab * dt;
            let dw = part(sensitivity, 2) + wb * dt;
            let dn = near.curvature * dr;
            let d_closing = dn.dot(&v) + n.dot(&dv);
            let d_normal = -(1.0 + self.restitution) * d_closing;
            let d_slip = dv - dn * closing - n * d_closing - self.radius * (dw.cross(n) + w.cross(&dn));
            let d_impulse = match sticks {
                true if self.friction > 0.0 => -d_slip / self.mobility(),
                true => Vector3::zeros(),
                false => {
                    let along = slip / speed;
                    -self.friction * d_normal * along - limit * (d_slip - along * along.dot(&d_slip)) / speed
                }
            };
            let d_spin = self.spin_change(n, &d_impulse) + self.spin_change(&dn, &impulse);
            let dv = dv + d_normal * n + normal_impulse * dn + d_impulse;
            *sensitivity = column(dr - va * dt, dv - aa * dt, dw + d_spin - wa * dt);
        }
        out
    }
}
