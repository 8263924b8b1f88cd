//! Lens distortion as OpenCV models it, and its inverse.

use std::f64::consts::FRAC_PI_2;

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

/// What the coefficients of a [`Distortion`] mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(rename_all = "kebab-case")]
pub enum LensModel {
    /// Brown–Conrady (Brown, "Close-range camera calibration", 1971), with `k4`, `k5` or `k6` OpenCV's rational model: a point at
    /// radius r moves along it by (1 + k1·r² + k2·r⁴ + k3·r⁶) / (1 + k4·r² + k5·r⁴ + k6·r⁶).
    #[default]
    BrownConrady,
    /// Kannala–Brandt, OpenCV's `fisheye` (Kannala and Brandt, "A generic camera model", 2006): what is θ off the axis is seen at the
    /// radius θ·(1 + k1·θ² + k2·θ⁴ + k3·θ⁶ + k4·θ⁸). All other coefficients are 0.
    Fisheye,
}

/// Distortion of a lens, acting on normalised image points `x/z, y/z`; without coefficients a pinhole, or a fisheye that is equidistant.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(deny_unknown_fields, default)]
pub struct Distortion {
    /// What the coefficients mean.
    #[serde(skip_serializing_if = "is_default")]
    pub model: LensModel,
    /// Radial, r²; of a fisheye θ².
    pub k1: f64,
    /// Radial, r⁴; of a fisheye θ⁴.
    pub k2: f64,
    /// Tangential.
    pub p1: f64,
    /// Tangential.
    pub p2: f64,
    /// Radial, r⁶; of a fisheye θ⁶.
    pub k3: f64,
    /// Radial, r² of the denominator; of a fisheye θ⁸.
    #[serde(skip_serializing_if = "is_default")]
    pub k4: f64,
    /// Radial, r⁴ of the denominator.
    #[serde(skip_serializing_if = "is_default")]
    pub k5: f64,
    /// Radial, r⁶ of the denominator.
    #[serde(skip_serializing_if = "is_default")]
    pub k6: f64,
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

impl Distortion {
    /// Whether the lens is a pinhole.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// Whether the coefficients are a [`LensModel::Fisheye`]'s.
    pub fn is_fisheye(&self) -> bool {
        self.model == LensModel::Fisheye
    }

    /// Distorted normalised point of an ideal one, and its Jacobian d(distorted)/d(ideal).
    pub fn distort(&self, ideal: Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let Self { p1, p2, .. } = *self;
        let (x, y) = (ideal.x, ideal.y);
        let r2 = x * x + y * y;
        let (radial, slope) = self.radial(r2);
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

    /// The factor by which the lens moves a point at the squared radius `r2` along it, and its derivative by `r2`.
    fn radial(&self, r2: f64) -> (f64, f64) {
        let Self { k1, k2, k3, .. } = *self;
        if self.is_fisheye() {
            let radius = r2.sqrt();
            if radius < f64::EPSILON {
                return (1.0, k1 - 1.0 / 3.0);
            }
            let (seen, slope) = self.seen_at(radius.atan());
            return (seen / radius, (slope / (1.0 + r2) - seen / radius) / (2.0 * r2));
        }
        let factor = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let slope = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3);
        let (divisor, divisor_slope) = self.divisor(r2);
        (factor / divisor, (slope - factor / divisor * divisor_slope) / divisor)
    }

    /// The rational model's denominator at the squared radius `r2`, and its derivative by `r2`.
    fn divisor(&self, r2: f64) -> (f64, f64) {
        let Self { k4, k5, k6, .. } = *self;
        (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)), k4 + r2 * (2.0 * k5 + r2 * 3.0 * k6))
    }

    /// The radius at which a fisheye shows what is `angle` (rad) off its axis, and its derivative.
    fn seen_at(&self, angle: f64) -> (f64, f64) {
        let Self { k1, k2, k3, k4, .. } = *self;
        let a2 = angle * angle;
        let seen = angle * (1.0 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))));
        (seen, 1.0 + a2 * (3.0 * k1 + a2 * (5.0 * k2 + a2 * (7.0 * k3 + a2 * 9.0 * k4))))
    }

    /// Derivatives of the distorted point of an ideal one by k1, k2, p1, p2 and k3; not of a fisheye.
    pub(super) fn by_coefficients(&self, ideal: &Vector2<f64>) -> [Vector2<f64>; 5] {
        let (x, y, r2) = (ideal.x, ideal.y, ideal.norm_squared());
        let radial = ideal / self.divisor(r2).0;
        [
            radial * r2,
            radial * r2 * r2,
            Vector2::new(2.0 * x * y, r2 + 2.0 * y * y),
            Vector2::new(r2 + 2.0 * x * x, 2.0 * x * y),
            radial * r2 * r2 * r2,
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
        if self.is_fisheye() {
            return self.undistort_fisheye(range, distorted);
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

    /// By the angle off the axis, which grows with the radius: Newton's method, kept between what is too small and too large.
    fn undistort_fisheye(&self, range: &Range, distorted: Vector2<f64>) -> Result<Vector2<f64>> {
        let radius = distorted.norm();
        let (mut low, mut high) = (0.0, range.angle());
        if radius < f64::EPSILON {
            return Ok(distorted);
        }
        let mut angle = radius.min(high);
        for _ in 0..MAX_ITERATIONS {
            let (seen, slope) = self.seen_at(angle);
            if (seen - radius).abs() <= TOLERANCE {
                break;
            }
            *(if seen < radius { &mut low } else { &mut high }) = angle;
            let next = angle - (seen - radius) / slope;
            angle = if low < next && next < high { next } else { 0.5 * (low + high) };
        }
        let residual = (self.seen_at(angle).0 - radius).abs();
        let ideal = distorted / radius * angle.tan();
        if residual <= ACCEPTED && angle < FRAC_PI_2 && range.holds(&ideal) {
            return Ok(ideal);
        }
        Err(Error::Distortion { x: distorted.x, y: distorted.y, residual, iterations: MAX_ITERATIONS })
    }
}
