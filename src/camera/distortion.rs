//! Brown–Conrady lens distortion in OpenCV's order, and its inverse.

use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

use super::fold::Range;
use crate::error::{Error, Result};

/// Newton iterations before the inverse gives up; a lens within its range needs three to six.
const MAX_ITERATIONS: usize = 50;
/// Halvings of a Newton step that does not lower the residual.
const MAX_HALVINGS: i32 = 20;
/// Residual at which the inverse is taken as found, normalised units (1e-12 is 1e-9 px at f = 1000 px).
const TOLERANCE: f64 = 1e-13;
/// Residual still accepted when Newton's steps no longer improve (rounding), normalised units.
const ACCEPTED: f64 = 1e-10;

/// Radial (`k1`, `k2`, `k3`) and tangential (`p1`, `p2`) coefficients of the Brown–Conrady model
/// (Brown, "Close-range camera calibration", 1971), acting on normalised image points `x/z, y/z`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(deny_unknown_fields, default)]
pub struct Distortion {
    /// Radial, r².
    pub k1: f64,
    /// Radial, r⁴.
    pub k2: f64,
    /// Tangential.
    pub p1: f64,
    /// Tangential.
    pub p2: f64,
    /// Radial, r⁶.
    pub k3: f64,
}

impl Distortion {
    /// Whether the lens is a pinhole.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// Distorted normalised point of an ideal one, and its Jacobian d(distorted)/d(ideal).
    pub fn distort(&self, ideal: Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let Self { k1, k2, p1, p2, k3 } = *self;
        let (x, y) = (ideal.x, ideal.y);
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        // d(radial)/d(r²)
        let slope = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3);
        let distorted = Vector2::new(
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        );
        let cross = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y;
        let jacobian = Matrix2::new(
            radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x,
            cross,
            cross,
            radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x,
        );
        (distorted, jacobian)
    }

    /// Derivatives of the distorted point of an ideal one by k1, k2, p1, p2 and k3, of any distortion.
    pub(super) fn by_coefficients(ideal: &Vector2<f64>) -> [Vector2<f64>; 5] {
        let (x, y, r2) = (ideal.x, ideal.y, ideal.norm_squared());
        [
            ideal * r2,
            ideal * r2 * r2,
            Vector2::new(2.0 * x * y, r2 + 2.0 * y * y),
            Vector2::new(r2 + 2.0 * x * x, 2.0 * x * y),
            ideal * r2 * r2 * r2,
        ]
    }

    /// Ideal normalised point whose distortion is `distorted` (Newton's method with step halving).
    ///
    /// # Errors
    /// [`Error::Distortion`] where the model has no inverse on the branch that contains the centre.
    pub fn undistort(&self, distorted: Vector2<f64>) -> Result<Vector2<f64>> {
        self.undistort_within(&Range::of(self), distorted)
    }

    /// [`Self::undistort`] with the lens's own `range`.
    pub(super) fn undistort_within(&self, range: &Range, distorted: Vector2<f64>) -> Result<Vector2<f64>> {
        if self.is_none() {
            return Ok(distorted);
        }
        let mut ideal = distorted;
        let (mut at, mut jacobian) = self.distort(ideal);
        for _ in 0..MAX_ITERATIONS {
            let residual = (at - distorted).norm();
            let Some(inverse) = jacobian.try_inverse().filter(|_| residual > TOLERANCE) else { break };
            let step = inverse * (at - distorted);
            let improves = |next: &Vector2<f64>| (self.distort(*next).0 - distorted).norm() < residual;
            let shorter = (0..MAX_HALVINGS).map(|halvings| ideal - step * 0.5_f64.powi(halvings));
            let Some(next) = shorter.into_iter().find(improves) else { break };
            ideal = next;
            (at, jacobian) = self.distort(ideal);
        }
        let residual = (at - distorted).norm();
        if residual <= ACCEPTED && range.holds(&ideal) {
            return Ok(ideal);
        }
        Err(Error::Distortion { x: distorted.x, y: distorted.y, residual, iterations: MAX_ITERATIONS })
    }
}
