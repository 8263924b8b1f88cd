//! A ball in a picture: the outline of a sphere, and the sphere of an outline.

use nalgebra::{Matrix2, Point2, Point3, Vector2, Vector3};

use super::Camera;
use crate::error::{Error, Result};

/// Rays that touch the ball, by which its outline is measured.
const RAYS: usize = 96;
/// Steps of the search for the sphere of an outline; each makes the error about a hundredth.
const STEPS: usize = 100;
/// Error at which the sphere is found: px, and as a fraction of the radius.
const TOLERANCE: f64 = 1e-9;
/// Nearest that a ball's centre may be to the camera, in its radii.
const NEAREST: f64 = 1.05;

/// The outline of a ball's image, as an ellipse.
///
/// In perspective it is one: of semi-minor axis f·R/√(z² − R²), longer towards the picture's edge, its centre a little
/// further out than the image of the ball's centre. A lens with distortion bends it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outline {
    /// Centre of mass of what it covers, px.
    pub centre: Point2<f64>,
    /// Semi-minor axis of the ellipse with the same moments, px.
    pub radius: f64,
}

/// Standard deviation of a detection's centre along each axis over that of its radius, as of a circle fitted to noisy points.
const CENTRE_SIGMA_RATIO: f64 = std::f64::consts::SQRT_2;

/// A ball detected in a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detection {
    /// Centre and size of its outline, px.
    pub outline: Outline,
    /// Standard deviation of log(radius).
    pub log_sigma: f64,
    /// The fraction of the heatmap's mass around the centre, 0 to 1; after the verifier the probability that it is a ball.
    pub confidence: f64,
}

impl Detection {
    /// Standard deviation of the radius, px.
    pub fn radius_sigma_px(&self) -> f64 {
        self.log_sigma * self.outline.radius
    }

    /// Standard deviation of the centre along each axis, px.
    pub fn sigma_px(&self) -> f64 {
        CENTRE_SIGMA_RATIO * self.log_sigma * self.outline.radius
    }
}

impl Camera {
    /// The outline of a ball of `radius` (m) whose centre is at `centre` (camera frame, m).
    ///
    /// # Errors
    /// [`Error::BehindCamera`] for a ball that the camera touches; [`Error::OutsideLens`] for one that reaches beyond the
    /// lens model's range.
    #[doc(hidden)]
    pub fn outline(&self, centre: &Point3<f64>, radius: f64) -> Result<Outline> {
        let (centre, [minor, _]) = self.outline_ellipse(centre, radius)?;
        Ok(Outline { centre, radius: minor })
    }

    /// Semi-minor and semi-major axis of the same outline, px.
    ///
    /// # Errors
    /// As [`Self::outline`].
    pub(super) fn outline_axes(&self, centre: &Point3<f64>, radius: f64) -> Result<[f64; 2]> {
        Ok(self.outline_ellipse(centre, radius)?.1)
    }

    /// Centre of the outline, and the semi-minor and semi-major axis of the ellipse with the same moments, px.
    fn outline_ellipse(&self, centre: &Point3<f64>, radius: f64) -> Result<(Point2<f64>, [f64; 2])> {
        let distance = centre.coords.norm();
        if centre.z.is_nan() || centre.z <= NEAREST * radius {
            return Err(Error::BehindCamera { depth: centre.z });
        }
        let axis = centre.coords / distance;
        let side = axis.cross(&Vector3::y()).normalize();
        let up = side.cross(&axis);
        let sin = radius / distance;
        let cos = (1.0 - sin * sin).sqrt();
        let mut touching = [Vector2::zeros(); RAYS];
        for (index, point) in touching.iter_mut().enumerate() {
            let angle = std::f64::consts::TAU * index as f64 / RAYS as f64;
            let ray = axis * cos + (side * angle.cos() + up * angle.sin()) * sin;
            *point = self.image_from_camera(&Point3::from(ray))?.coords;
        }
        let (middle, spread) = moments(&touching);
        // A polygon's corners lie on the outline, its sides inside: by how much, for one that is regular.
        let angle = std::f64::consts::TAU / RAYS as f64;
        let shrunk = (2.0 + angle.cos()) / 3.0;
        let axes = spread.symmetric_eigenvalues();
        Ok((Point2::from(middle), [axes.min(), axes.max()].map(|variance| 2.0 * (variance / shrunk).sqrt())))
    }

    /// The centre (camera frame, m) of the ball of `radius` (m) that has this outline.
    ///
    /// # Errors
    /// As [`Self::camera_from_image`] and [`Self::outline`]; [`Error::NoBall`] where no ball has this outline, or it is not
    /// found.
    #[doc(hidden)]
    pub fn ball_from_outline(&self, outline: &Outline, radius: f64) -> Result<Point3<f64>> {
        let focal = self.intrinsic.fixed_view::<2, 2>(0, 0).determinant().abs().sqrt();
        let mut image = outline.centre;
        let mut depth = radius * (1.0 + (focal / outline.radius).powi(2)).sqrt();
        for _ in 0..STEPS {
            let centre = self.camera_from_image(&image, depth)?;
            let found = self.outline(&centre, radius)?;
            let off = outline.centre - found.centre;
            let ratio = found.radius / outline.radius;
            if off.norm() < TOLERANCE && (ratio - 1.0).abs() < TOLERANCE {
                return Ok(centre);
            }
            image += off;
            // On the camera's axis and without a lens 1/√(depth² − radius²) is in proportion to the outline's radius.
            depth = radius.hypot((depth * depth - radius * radius).max(0.0).sqrt() * ratio);
        }
        Err(Error::NoBall { x: outline.centre.x, y: outline.centre.y, radius: outline.radius })
    }
}

/// Centre and covariance of what a polygon covers.
fn moments(corners: &[Vector2<f64>]) -> (Vector2<f64>, Matrix2<f64>) {
    // About a corner, so that nothing large is subtracted.
    let origin = corners[0];
    let (mut area, mut first, mut second) = (0.0, Vector2::zeros(), Matrix2::zeros());
    for (index, corner) in corners.iter().enumerate() {
        let (a, b) = (corner - origin, corners[(index + 1) % corners.len()] - origin);
        let twice = a.perp(&b);
        area += twice / 2.0;
        first += (a + b) * twice / 6.0;
        let sum = a + b;
        second += (a * a.transpose() + b * b.transpose() + sum * sum.transpose()) * twice / 24.0;
    }
    let middle = first / area;
    (origin + middle, second / area - middle * middle.transpose())
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Rotation3, Vector3};
    use proptest::prelude::*;

    use super::super::{Distortion, LensModel};
    use super::*;
    use crate::size::Size;

    fn camera(focal: [f64; 2], distortion: Distortion) -> Camera {
        let intrinsic = Matrix3::new(focal[0], 0.0, 499.5, 0.0, focal[1], 399.5, 0.0, 0.0, 1.0);
        Camera::new(Size::new(1000, 800), intrinsic, distortion, Rotation3::identity().into(), Vector3::zeros())
            .unwrap()
    }

    /// Centre and covariance of what a ball covers, by casting a ray through each of many points.
    fn rendered(camera: &Camera, centre: &Point3<f64>, radius: f64) -> (Point2<f64>, Matrix2<f64>) {
        let about = camera.image_from_camera(centre).unwrap();
        let reach = 2.5 * 1000.0 * radius / centre.z;
        let count = 600;
        let step = 2.0 * reach / f64::from(count);
        let (mut inside, mut sum, mut squares) = (0.0, Vector2::zeros(), Matrix2::zeros());
        for row in 0..count {
            for column in 0..count {
                let offset = Vector2::new(f64::from(column), f64::from(row)).add_scalar(0.5) * step;
                let at = offset.add_scalar(-reach);
                let Ok(ray) = camera.camera_from_image(&(about + at), 1.0) else { continue };
                let ray = ray.coords.normalize();
                if centre.coords.cross(&ray).norm() < radius {
                    inside += 1.0;
                    sum += at;
                    squares += at * at.transpose();
                }
            }
        }
        let middle = sum / inside;
        (about + middle, squares / inside - middle * middle.transpose())
    }

    #[test]
    fn outlines_are_what_rays_see() {
        let bent = Distortion { k1: -0.2, k2: 0.05, p1: 0.002, p2: -0.001, ..Distortion::default() };
        let bent_little = Distortion { k1: -0.02, k4: 0.001, ..Distortion::default() };
        for (camera, centre, radius) in [
            (camera([500.0, 500.0], Distortion::default()), Point3::new(0.0, 0.0, 2.0), 0.2),
            (camera([500.0, 500.0], Distortion::default()), Point3::new(1.9, 1.5, 2.0), 0.3),
            (camera([500.0, 420.0], Distortion::default()), Point3::new(-1.8, 0.4, 2.0), 0.2),
            (
                camera([800.0, 800.0], Distortion { model: LensModel::Fisheye, ..bent_little }),
                Point3::new(2.0, 0.8, 2.0),
                0.3,
            ),
            (camera([600.0, 600.0], bent), Point3::new(1.2, -0.9, 2.0), 0.2),
        ] {
            let outline = camera.outline(&centre, radius).unwrap();
            let (middle, spread) = rendered(&camera, &centre, radius);
            let minor = 2.0 * spread.symmetric_eigenvalues().min().sqrt();
            assert!((outline.centre - middle).norm() < 0.05, "{outline:?} {middle}");
            assert!((outline.radius / minor - 1.0).abs() < 1e-3, "{outline:?} {minor}");
            // The picture gives the ball back: well within 0.2 % of its depth.
            let found = camera.ball_from_outline(&Outline { centre: middle, radius: minor }, radius).unwrap();
            assert!((found.z / centre.z - 1.0).abs() < 1.5e-3, "{found} {centre}");
        }
    }

    #[test]
    fn without_a_lens_the_minor_axis_is_the_textbook_one() {
        let camera = camera([700.0, 700.0], Distortion::default());
        for centre in [Point3::new(0.3, 0.1, 2.0), Point3::new(1.9, 1.9, 2.0)] {
            let outline = camera.outline(&centre, 0.25).unwrap();
            let expected = 700.0 * 0.25 / (centre.z.powi(2) - 0.25_f64.powi(2)).sqrt();
            assert!((outline.radius / expected - 1.0).abs() < 1e-4, "{} {expected}", outline.radius);
        }
    }

    proptest! {
        /// Anywhere in a picture of 90°, with and without a lens.
        #[test]
        fn outlines_give_their_balls_back(
            x in -0.95..0.95_f64, y in -0.75..0.75_f64, z in 0.5..60.0_f64, radius in 0.01..0.12_f64, k1 in -0.12..0.1_f64,
            model in prop_oneof![Just(LensModel::BrownConrady), Just(LensModel::Fisheye)],
        ) {
            let camera = camera([500.0, 480.0], Distortion { model, k1, ..Distortion::default() });
            let centre = Point3::new(x * z, y * z, z);
            let outline = camera.outline(&centre, radius).unwrap();
            let found = camera.ball_from_outline(&outline, radius).unwrap();
            prop_assert!((found - centre).norm() < 1e-6 * z, "{} {}", found, centre);
        }
    }

    proptest! {
        /// Outlines of any size anywhere in the picture of any lens: many are no ball's.
        #[test]
        fn a_ball_that_is_found_has_the_outline(
            focal in [200.0..800.0_f64, 200.0..800.0_f64], k1 in -0.4..0.4_f64, k2 in -0.3..0.3_f64,
            x in 0.0..1000.0_f64, y in 0.0..800.0_f64, size in 0.5..7.0_f64,
        ) {
            let camera = camera(focal, Distortion { k1, k2, ..Distortion::default() });
            let outline = Outline { centre: Point2::new(x, y), radius: size.exp() };
            if let Ok(ball) = camera.ball_from_outline(&outline, 0.1) {
                let again = camera.outline(&ball, 0.1).unwrap();
                prop_assert!((again.centre - outline.centre).norm() < 1e-6, "{:?} {:?}", again, outline);
                prop_assert!((again.radius / outline.radius - 1.0).abs() < 1e-6, "{:?} {:?}", again, outline);
            }
        }
    }

    #[test]
    fn an_outline_that_no_ball_has_is_refused() {
        let camera = camera([450.0, 420.0], Distortion { k1: 0.15, k2: 0.24, ..Distortion::default() });
        let outline = Outline { centre: Point2::new(916.0, 699.0), radius: 124.0 };
        let error = camera.ball_from_outline(&outline, 0.1).unwrap_err();
        assert!(matches!(error, Error::NoBall { .. }) && error.to_string().contains("124.0 px"), "{error}");
    }

    #[test]
    fn a_ball_that_touches_the_camera_has_no_outline() {
        let camera = camera([500.0, 500.0], Distortion::default());
        assert!(matches!(camera.outline(&Point3::new(0.0, 0.0, 0.1), 0.1), Err(Error::BehindCamera { .. })));
    }
}
