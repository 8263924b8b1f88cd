//! A potential of the user's own: the paper's "arbitrary physics".

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};

use super::{Depends, EXACT, Force, Partials};

/// Step of the default Hessian's central differences, m.
const HESSIAN_STEP: f64 = 1e-5;

/// A potential of the user's own: the paper's "arbitrary physics".
///
/// Everything is per unit of the ball's mass, in the world frame.
pub trait Potential: Send + Sync + std::fmt::Debug {
    /// V(r), J/kg.
    fn value(&self, position: &Vector3<f64>) -> f64;

    /// ∇V(r), m/s²: the ball is accelerated against it.
    fn gradient(&self, position: &Vector3<f64>) -> Vector3<f64>;

    /// ∇∇V(r), 1/s². Without it the gradient's central differences (10 µm apart) are used.
    fn hessian(&self, position: &Vector3<f64>) -> Matrix3<f64> {
        let column = |axis: usize| {
            let step = Vector3::ith(axis, HESSIAN_STEP);
            (self.gradient(&(position + step)) - self.gradient(&(position - step))) / (2.0 * HESSIAN_STEP)
        };
        Matrix3::from_columns(&[column(0), column(1), column(2)])
    }
}

/// Its force.
#[derive(Debug)]
struct Own(Arc<dyn Potential>);

pub(super) fn force(potential: Option<&Arc<dyn Potential>>) -> Option<Arc<dyn Force>> {
    Some(Arc::new(Own(potential?.clone())))
}

impl Force for Own {
    fn acceleration(
        &self,
        r: &Vector3<f64>,
        _: &Vector3<f64>,
        _: &Vector3<f64>,
        partials: Option<&mut Partials>,
    ) -> Vector3<f64> {
        if let Some(partials) = partials {
            partials.position -= self.0.hessian(r);
        }
        -self.0.gradient(r)
    }

    fn name(&self) -> &'static str {
        "potential"
    }

    fn scale_sigma(&self) -> f64 {
        EXACT
    }

    fn depends(&self) -> Depends {
        Depends { position: true, ..Depends::default() }
    }

    fn potential_energy(&self, r: &Vector3<f64>) -> f64 {
        self.0.value(r)
    }
}
