//! The least-squares camera: Levenberg–Marquardt over the sum of squared reprojection errors, and its covariance.

use std::convert::Infallible;

use nalgebra::{DMatrix, DVector, Matrix3, Point2, Point3, Rotation3, Vector2, Vector3};

use super::start::{Pose, nearest_rotation};
use crate::camera::fold::Range;
use crate::camera::projection::{Projected, projected};
use crate::camera::{Camera, Distortion};
use crate::error::{self, Error};
use crate::least_squares::{Damping, LeastSquares, minimised};

/// How the damping goes: to the last digit, since the derivatives of what depends on the camera are taken there.
const DAMPING: Damping =
    Damping { first: 1e-3, relax: 0.1, least: 1e-15, stiffen: 10.0, most: 1e12, steps: 200, converged: 0.0 };
/// A step that changes no parameter by more than this (radians, metres, shares of the focal length) is the last.
const SMALLEST_STEP: f64 = 1e-14;
/// Smallest eigenvalue of the normal matrix (scaled to a unit diagonal) with which parameters are told apart.
const MIN_EIGENVALUE: f64 = 1e-12;

/// What is estimated beside the pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Unknowns {
    /// One factor on both focal lengths.
    pub focal: bool,
    /// The principal point.
    pub principal_point: bool,
    /// k1 and k2, then p1, p2 and k3, of the lens distortion: how many of them, 0 to 5.
    pub distortion: usize,
}

impl Unknowns {
    /// What can be estimated, by its name, and what that is.
    pub const NAMES: [(&str, &str); 4] = [
        ("focal", "The focal length"),
        ("principal-point", "Where the optical axis meets the picture"),
        ("distortion", "k1 and k2"),
        ("full-distortion", "k1, k2, p1, p2 and k3"),
    ];

    /// Those of `names`, which are of [`Self::NAMES`].
    ///
    /// # Errors
    /// [`Error::Value`] for a name that there is not.
    pub fn named(names: &[String]) -> error::Result<Self> {
        let mut unknowns = Self::default();
        for name in names {
            match name.as_str() {
                "focal" => unknowns.focal = true,
                "principal-point" => unknowns.principal_point = true,
                "distortion" => unknowns.distortion = unknowns.distortion.max(2),
                "full-distortion" => unknowns.distortion = 5,
                _ => {
                    let names = Self::NAMES.map(|(name, _)| name).join(", ");
                    let reason = format!("cannot be `{name}`; choose one of {names}");
                    return Err(Error::value("calibration", "estimate", reason));
                }
            }
        }
        Ok(unknowns)
    }

    /// How many parameters, with the six of the pose.
    pub(super) fn count(&self) -> usize {
        6 + usize::from(self.focal) + 2 * usize::from(self.principal_point) + self.distortion
    }
}

/// Where something known is seen.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    /// m.
    pub world: Point3<f64>,
    /// px.
    pub image: Point2<f64>,
    /// Of a line's point, the only direction (unit vector) in which the picture says where it is.
    pub across: Option<Vector2<f64>>,
    /// 1/σ, px⁻¹.
    pub weight: f64,
}

impl Seen {
    /// A click on a point.
    pub(super) fn click(world: Point3<f64>, image: Point2<f64>) -> Self {
        Self { world, image, across: None, weight: 1.0 }
    }
}

/// A camera as the refinement moves it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Guess {
    pub pose: Pose,
    pub intrinsic: Matrix3<f64>,
    pub distortion: Distortion,
}

impl Guess {
    /// Moved by parameters: rotation vector (in the camera frame, rad), translation (m), then the unknowns in order.
    fn moved(&self, unknowns: &Unknowns, by: &[f64]) -> Self {
        let mut moved = *self;
        let turn = Rotation3::new(Vector3::new(by[0], by[1], by[2]));
        moved.pose.rotation = turn * self.pose.rotation;
        moved.pose.translation += Vector3::new(by[3], by[4], by[5]);
        let mut rest = by[6..].iter();
        let mut next = || rest.next().copied().unwrap_or(0.0);
        if unknowns.focal {
            let factor = next().exp();
            moved.intrinsic[(0, 0)] *= factor;
            moved.intrinsic[(0, 1)] *= factor;
            moved.intrinsic[(1, 1)] *= factor;
        }
        if unknowns.principal_point {
            moved.intrinsic[(0, 2)] += next();
            moved.intrinsic[(1, 2)] += next();
        }
        let Distortion { k1, k2, p1, p2, k3, .. } = &mut moved.distortion;
        [k1, k2, p1, p2, k3].into_iter().take(unknowns.distortion).for_each(|value| *value += next());
        moved
    }

    /// A point's error (found less clicked, px) and its derivative by the parameters; [`None`] behind the camera or
    /// outside the lens's range.
    pub(super) fn error(
        &self,
        range: &Range,
        unknowns: &Unknowns,
        world: &Point3<f64>,
        image: &Point2<f64>,
    ) -> Option<(Vector2<f64>, Vec<Vector2<f64>>)> {
        let turned = self.pose.rotation * world.coords;
        let in_camera = Point3::from(turned + self.pose.translation);
        let Projected { image: found, jacobian, ideal } =
            projected(&self.intrinsic, &self.distortion, range, &in_camera).ok()?;
        let mut derivatives = Vec::with_capacity(unknowns.count());
        derivatives.extend((0..3).map(|axis| jacobian * Vector3::ith(axis, 1.0).cross(&turned)));
        derivatives.extend((0..3).map(|axis| jacobian.column(axis).into_owned()));
        if unknowns.focal {
            derivatives.push(found.coords - self.intrinsic.fixed_view::<2, 1>(0, 2));
        }
        if unknowns.principal_point {
            derivatives.extend([Vector2::x(), Vector2::y()]);
        }
        let focal = self.intrinsic.fixed_view::<2, 2>(0, 0).into_owned();
        let lens = self.distortion.by_coefficients(&ideal).into_iter().take(unknowns.distortion);
        derivatives.extend(lens.map(|by| focal * by));
        Some((found - image, derivatives))
    }

    /// Weighted errors of all that is seen, and their derivatives; [`None`] where something has no image.
    fn errors(&self, unknowns: &Unknowns, all: &[Seen]) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let range = Range::of(&self.distortion);
        let rows = all.iter().map(|seen| if seen.across.is_some() { 1 } else { 2 }).sum();
        let mut errors = DVector::zeros(rows);
        let mut jacobian = DMatrix::zeros(rows, unknowns.count());
        let mut row = 0;
        for seen in all {
            let (error, derivatives) = self.error(&range, unknowns, &seen.world, &seen.image)?;
            let [x, y] = [Vector2::x(), Vector2::y()];
            let directions = seen.across.map_or_else(|| vec![x, y], |across| vec![across]);
            for direction in directions.iter().map(|direction| seen.weight * direction) {
                errors[row] = direction.dot(&error);
                for (column, derivative) in derivatives.iter().enumerate() {
                    jacobian[(row, column)] = direction.dot(derivative);
                }
                row += 1;
            }
        }
        errors.iter().chain(jacobian.iter()).all(|value| value.is_finite()).then_some((errors, jacobian))
    }

    /// The camera, for pictures of a size.
    pub(super) fn camera(&self, size: crate::size::Size) -> crate::error::Result<Camera> {
        Camera::new(size, self.intrinsic, self.distortion, self.pose.rotation, self.pose.translation)
    }

    /// The camera with each parameter moved up and down by its own step, for differences of what depends on it.
    pub(super) fn neighbours(&self, unknowns: &Unknowns, steps: &[f64]) -> Vec<[Self; 2]> {
        let moved = |index: usize, sign: f64| {
            let mut by = vec![0.0; unknowns.count()];
            by[index] = sign * steps[index];
            self.moved(unknowns, &by)
        };
        (0..unknowns.count()).map(|index| [moved(index, 1.0), moved(index, -1.0)]).collect()
    }
}

impl Guess {
    /// The camera moved by one standard deviation along each of as many independent directions as there are unknowns.
    pub(super) fn one_sigma(&self, unknowns: &Unknowns, covariance: &DMatrix<f64>) -> Vec<Self> {
        let Some(cholesky) = covariance.clone().cholesky() else { return vec![] };
        cholesky.l().column_iter().map(|by| self.moved(unknowns, by.into_owned().as_slice())).collect()
    }
}

/// The end of a refinement.
#[derive(Debug, Clone)]
pub(super) struct Refined {
    pub guess: Guess,
    /// Sum of squared weighted errors: px² where these are clicks of weight 1.
    pub cost: f64,
    /// Inverse of the normal matrix: the parameters' covariance for clicks of 1 px; [`None`] where the points do not
    /// tell some of the parameters apart.
    pub covariance: Option<DMatrix<f64>>,
}

/// A guess with its errors.
struct Reprojection<'a> {
    guess: Guess,
    errors: DVector<f64>,
    jacobian: DMatrix<f64>,
    unknowns: &'a Unknowns,
    seen: &'a [Seen],
}

impl<'a> Reprojection<'a> {
    fn of(guess: Guess, unknowns: &'a Unknowns, seen: &'a [Seen]) -> Option<Self> {
        let (errors, jacobian) = guess.errors(unknowns, seen)?;
        Some(Self { guess, errors, jacobian, unknowns, seen })
    }
}

impl LeastSquares for Reprojection<'_> {
    /// Matrix and gradient.
    type Normal = (DMatrix<f64>, DVector<f64>);
    type Step = DVector<f64>;
    type Error = Infallible;

    fn cost(&self) -> f64 {
        self.errors.norm_squared()
    }

    fn linearised(&mut self) -> Result<Option<Self::Normal>, Infallible> {
        Ok(Some((self.jacobian.transpose() * &self.jacobian, self.jacobian.transpose() * &self.errors)))
    }

    fn step(&self, (normal, gradient): &Self::Normal, damping: f64) -> Option<DVector<f64>> {
        let mut damped = normal.clone();
        for index in 0..self.unknowns.count() {
            damped[(index, index)] += damping * normal[(index, index)].max(f64::MIN_POSITIVE);
        }
        Some(damped.cholesky()?.solve(&-gradient))
    }

    fn moved(&self, _: &Self::Normal, step: &DVector<f64>) -> Result<Option<Self>, Infallible> {
        Ok(Self::of(self.guess.moved(self.unknowns, step.as_slice()), self.unknowns, self.seen))
    }

    fn is_last(step: &DVector<f64>) -> bool {
        step.amax() < SMALLEST_STEP
    }
}

/// The nearest minimum; [`None`] where something that is seen has no image at the start.
pub(super) fn refine(start: Guess, unknowns: &Unknowns, seen: &[Seen]) -> Option<Refined> {
    let Ok(found) = minimised(Reprojection::of(start, unknowns, seen)?, &DAMPING);
    let mut guess = found.guess;
    // Rounding of many small turns.
    if let Some((rotation, _)) = nearest_rotation(&guess.pose.rotation) {
        guess.pose.rotation = rotation;
    }
    Some(Refined { guess, cost: found.errors.norm_squared(), covariance: covariance(&found.jacobian) })
}

/// The inverse of the normal matrix, if it has one.
fn covariance(jacobian: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let normal = jacobian.transpose() * jacobian;
    let scale = normal.diagonal().map(|value| 1.0 / value.sqrt());
    let scaled = DMatrix::from_fn(normal.nrows(), normal.ncols(), |i, j| normal[(i, j)] * scale[i] * scale[j]);
    if scaled.iter().any(|value| !value.is_finite()) {
        return None;
    }
    let eigen = scaled.clone().try_symmetric_eigen(f64::EPSILON, 1000)?;
    if eigen.eigenvalues.min() < MIN_EIGENVALUE {
        return None;
    }
    let inverse = scaled.try_inverse()?;
    Some(DMatrix::from_fn(normal.nrows(), normal.ncols(), |i, j| inverse[(i, j)] * scale[i] * scale[j]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_errors_derivatives_equal_central_differences() {
        let rotation = *Rotation3::from_euler_angles(0.3, -0.2, 0.9).matrix();
        let guess = Guess {
            pose: Pose { rotation, translation: Vector3::new(0.2, -0.1, 5.0) },
            intrinsic: Matrix3::new(900.0, 1.5, 640.0, 0.0, 880.0, 350.0, 0.0, 0.0, 1.0),
            distortion: Distortion {
                k1: -0.2,
                k2: 0.05,
                p1: 0.002,
                p2: -0.001,
                k3: 0.01,
                k4: 0.1,
                ..Distortion::default()
            },
        };
        let unknowns = Unknowns { focal: true, principal_point: true, distortion: 5 };
        for world in [Point3::new(0.5, -0.8, 0.3), Point3::new(-1.5, 0.4, 1.0)] {
            let error = |guess: &Guess| {
                guess.error(&Range::of(&guess.distortion), &unknowns, &world, &Point2::new(600.0, 400.0)).unwrap()
            };
            let (_, derivatives) = error(&guess);
            assert_eq!(derivatives.len(), unknowns.count());
            let step = 1e-5;
            for ([more, less], derivative) in
                guess.neighbours(&unknowns, &vec![step; unknowns.count()]).iter().zip(&derivatives)
            {
                let difference = (error(more).0 - error(less).0) / (2.0 * step) - derivative;
                assert!(difference.norm() < 1e-6 * (1.0 + derivative.norm()), "{difference} of {derivative}");
            }
        }
    }
}
