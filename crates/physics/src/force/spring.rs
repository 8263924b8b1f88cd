//! A linear spring between the ball's centre and a fixed point.

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};

use super::{Depends, EXACT, Force, Linear, Partials};
use crate::scene::Scene;

/// `−stiffness·(r − anchor)`; the stiffness is per unit mass, 1/s².
#[derive(Debug)]
pub(super) struct Tether {
    stiffness: f64,
    anchor: Vector3<f64>,
}

impl Tether {
    pub fn of(scene: &Scene) -> Option<Arc<dyn Force>> {
        let spring = scene.spring.as_ref()?;
        Some(Arc::new(Self { stiffness: spring.stiffness / scene.ball.mass, anchor: spring.anchor.into() }))
    }
}

impl Force for Tether {
    fn acceleration(
        &self,
        r: &Vector3<f64>,
        _: &Vector3<f64>,
        _: &Vector3<f64>,
        partials: Option<&mut Partials>,
    ) -> Vector3<f64> {
        if let Some(partials) = partials {
            partials.position -= Matrix3::identity() * self.stiffness;
        }
        -self.stiffness * (r - self.anchor)
    }

    fn name(&self) -> &'static str {
        "spring"
    }

    fn scale_sigma(&self) -> f64 {
        EXACT
    }

    fn depends(&self) -> Depends {
        Depends { position: true, ..Depends::default() }
    }

    fn linear(&self, _: &Vector3<f64>) -> Option<Linear> {
        Some(Linear { pull: self.stiffness * self.anchor, stiffness: self.stiffness })
    }

    fn potential_energy(&self, r: &Vector3<f64>) -> f64 {
        0.5 * self.stiffness * (r - self.anchor).norm_squared()
    }
}
