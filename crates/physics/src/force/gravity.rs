//! Gravity, the same everywhere.

use std::sync::Arc;

use nalgebra::Vector3;

use super::{Depends, Force, Linear, Partials};
use crate::scene::Scene;

/// Scale uncertainty: gravity itself is known to 0.3 % (WGS 84); what is off by a percent is the clock's rate, which counts
/// twice, or the scene's size.
const SIGMA: f64 = 0.01;

/// g, m/s².
#[derive(Debug)]
pub(super) struct Gravity(Vector3<f64>);

impl Gravity {
    pub fn of(scene: &Scene) -> Option<Arc<dyn Force>> {
        Some(Arc::new(Self(scene.gravity.into())))
    }
}

impl Force for Gravity {
    fn acceleration(
        &self,
        _: &Vector3<f64>,
        _: &Vector3<f64>,
        _: &Vector3<f64>,
        _: Option<&mut Partials>,
    ) -> Vector3<f64> {
        self.0
    }

    fn name(&self) -> &'static str {
        "gravity"
    }

    fn scale_sigma(&self) -> f64 {
        SIGMA
    }

    fn depends(&self) -> Depends {
        Depends::default()
    }

    fn linear(&self, _: &Vector3<f64>) -> Option<Linear> {
        Some(Linear { pull: self.0, stiffness: 0.0 })
    }

    fn potential_energy(&self, r: &Vector3<f64>) -> f64 {
        -self.0.dot(r)
    }
}
