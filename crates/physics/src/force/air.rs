//! The air: drag, and the Magnus force on a ball that spins.

use std::f64::consts::PI;
use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};

use super::{Depends, Force, Linear, Partials};
use crate::scene::{Ball, Scene};

/// Scale uncertainty of a drag coefficient where the scene does not give one: chosen.
const DRAG_SIGMA: f64 = 0.15;
/// The same of the lift: chosen; from 0.1 to 0.4 flights of table tennis come out alike, for the spin makes up for it.
const LIFT_SIGMA: f64 = 0.2;

/// Drag `−c·|v|·v` with c = ½ρAC_d/m, 1/m.
#[derive(Debug)]
pub(super) struct Drag {
    coefficient: f64,
    sigma: f64,
}

/// Magnus force `c·ω×v` with c = ½ρARC_l/m.
#[derive(Debug)]
pub(super) struct Lift(f64);

/// c of the drag `−c·|v|·v`, 1/m, and of the Magnus force `c·ω×v`.
fn air_coefficients(ball: &Ball) -> [f64; 2] {
    let pressure = 0.5 * ball.air_density * PI * ball.radius.powi(2) / ball.mass;
    [pressure * ball.drag_coefficient, pressure * ball.radius * ball.lift_coefficient]
}

impl Drag {
    pub fn of(scene: &Scene) -> Option<Arc<dyn Force>> {
        let [drag, _] = air_coefficients(&scene.ball);
        let sigma = scene.ball.drag_sigma.unwrap_or(DRAG_SIGMA);
        (drag != 0.0).then(|| Arc::new(Self { coefficient: drag, sigma }) as _)
    }
}

impl Lift {
    pub fn of(scene: &Scene) -> Option<Arc<dyn Force>> {
        let [_, lift] = air_coefficients(&scene.ball);
        (lift != 0.0).then(|| Arc::new(Self(lift)) as _)
    }
}

impl Force for Drag {
    fn acceleration(
        &self,
        _: &Vector3<f64>,
        v: &Vector3<f64>,
        _: &Vector3<f64>,
        partials: Option<&mut Partials>,
    ) -> Vector3<f64> {
        let speed = v.norm();
        if let Some(partials) = partials
            && speed > 0.0
        {
            partials.velocity -= self.coefficient * (Matrix3::identity() * speed + v * v.transpose() / speed);
        }
        -self.coefficient * speed * v
    }

    fn name(&self) -> &'static str {
        "drag"
    }

    fn scale_sigma(&self) -> f64 {
        self.sigma
    }

    fn depends(&self) -> Depends {
        Depends { velocity: true, ..Depends::default() }
    }
}

impl Force for Lift {
    fn acceleration(
        &self,
        _: &Vector3<f64>,
        v: &Vector3<f64>,
        w: &Vector3<f64>,
        partials: Option<&mut Partials>,
    ) -> Vector3<f64> {
        if let Some(partials) = partials {
            partials.velocity += self.0 * w.cross_matrix();
            partials.spin -= self.0 * v.cross_matrix();
        }
        self.0 * w.cross(v)
    }

    fn name(&self) -> &'static str {
        "lift"
    }

    fn scale_sigma(&self) -> f64 {
        LIFT_SIGMA
    }

    fn depends(&self) -> Depends {
        Depends { velocity: true, spin: true, ..Depends::default() }
    }

    /// None acts on a ball that does not spin.
    fn linear(&self, spin: &Vector3<f64>) -> Option<Linear> {
        (*spin == Vector3::zeros()).then_some(Linear::ZERO)
    }
}
