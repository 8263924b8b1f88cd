//! A ball by the circle that somebody drew around it, and what an unsure camera makes of a ball's position.

use nalgebra::{Matrix3, Point2, Point3, Vector3};
use serde::Serialize;

use super::{Camera, Outline};
use crate::error::{Error, Result};
use crate::size::Size;
use crate::volume::check_ball_radius;

/// Standard deviation of a drawn circle's centre along each axis, and of its radius, px. Chosen: a person places a pointer to about a
/// pixel of the screen, and sees a picture's pixel at least as large.
pub const DRAWN_SIGMA: f64 = 1.0;
/// Steps from a circle to the ellipse of its area; each leaves the square of what is missing.
const STEPS: usize = 4;

/// A circle drawn around a ball in a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circle {
    /// Its centre, px.
    pub centre: [f64; 2],
    /// Its radius, px.
    pub radius_px: f64,
    /// Standard deviation of its centre along each axis and of its radius, px; 1 if missing.
    pub sigma_px: Option<f64>,
    /// Size of the picture, if it is not the camera's.
    pub picture: Option<Size>,
}

/// Where the ball in a circle is.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify), serde(rename_all = "camelCase"))]
pub struct BallAt {
    /// Where its centre is in the picture, px.
    pub image: [f64; 2],
    /// Position in the world frame, m.
    pub world: [f64; 3],
    /// Position in the camera frame, m.
    pub camera: [f64; 3],
    /// Camera z, m.
    pub depth: f64,
    /// Its standard deviation, m.
    pub depth_sigma: f64,
    /// Covariance of the position in the world frame, m², by row.
    pub covariance: [[f64; 3]; 3],
    /// Standard deviation of the position: the root of the covariance's trace, m.
    pub sigma: f64,
}

/// How a ball moves with a camera while its picture stays the same.
#[derive(Debug, Clone, Copy, PartialEq)]
#[doc(hidden)]
pub struct BallShift {
    /// In the world frame, m.
    pub world: Vector3<f64>,
    /// Camera z, m.
    pub depth: f64,
}

impl Camera {
    /// Where a ball of `radius` (m) is, of which somebody drew the outline as a circle. The outline is an ellipse; the circle has its
    /// area. `one_sigma` are this camera's displaced by one standard deviation each
    /// ([`Calibration::one_sigma`](super::Calibration::one_sigma)): what they change enters the covariance.
    ///
    /// # Errors
    /// [`Error::Value`] for a circle or a ball that is none; [`Error::NoBall`] and [`Error::Distortion`] for a circle that no ball has,
    /// or that lies outside the lens; [`Error::CameraMismatch`] for a picture of another aspect ratio.
    pub fn ball_at(&self, circle: &Circle, radius: f64, one_sigma: &[Self]) -> Result<BallAt> {
        check_ball_radius(radius)?;
        let sigma_px = circle.sigma_px.unwrap_or(DRAWN_SIGMA);
        let positive = |value: f64| value.is_finite() && value > 0.0;
        for (field, value) in [("radius", circle.radius_px), ("sigma", sigma_px)] {
            if !positive(value) {
                return Err(Error::value("circle", field, format!("must be a positive number of pixels, not {value}")));
            }
        }
        if !circle.centre.iter().all(|value| value.is_finite()) {
            return Err(Error::value("circle", "centre", "must be two finite numbers of pixels"));
        }
        let camera = circle.picture.map_or_else(|| Ok(self.clone()), |size| self.for_picture(size))?;
        let mut outline = Outline { centre: Point2::from(circle.centre), radius: circle.radius_px };
        for _ in 0..STEPS {
            let [minor, major] = camera.outline_axes(&camera.ball_from_outline(&outline, radius)?, radius)?;
            outline.radius = circle.radius_px * (minor / major).sqrt();
        }
        let (world, jacobian) = camera.world_from_outline_with_jacobian(&outline, radius)?;
        let in_camera = camera.camera_from_world(&world);
        let minor_sigma = sigma_px * outline.radius / circle.radius_px;
        let own = Matrix3::from_diagonal(&Vector3::new(sigma_px, sigma_px, minor_sigma).map(|sigma| sigma * sigma));
        let mut covariance = jacobian * own * jacobian.transpose();
        let axis = camera.rotation.row(2).transpose();
        let mut depth_variance = (axis.transpose() * covariance * axis)[0];
        for BallShift { world, depth } in camera.ball_shifts(&in_camera, radius, one_sigma)? {
            covariance += world * world.transpose();
            depth_variance += depth * depth;
        }
        Ok(BallAt {
            image: camera.image_from_camera(&in_camera)?.coords.into(),
            world: world.coords.into(),
            camera: in_camera.coords.into(),
            depth: in_camera.z,
            depth_sigma: depth_variance.sqrt(),
            covariance: symmetric(&covariance),
            sigma: covariance.trace().sqrt(),
        })
    }

    /// How far the ball of `radius` (m) at `in_camera` (m) moves with each of `one_sigma`: by what its picture looks the same to them.
    ///
    /// # Errors
    /// As [`Self::ball_at`].
    #[doc(hidden)]
    pub fn ball_shifts(&self, in_camera: &Point3<f64>, radius: f64, one_sigma: &[Self]) -> Result<Vec<BallShift>> {
        let outline = self.outline(in_camera, radius)?;
        let world = self.world_from_camera(in_camera);
        let shift = |camera: &Self| {
            let camera = camera.for_picture(self.size)?;
            let seen = camera.ball_from_outline(&outline, radius)?;
            Ok(BallShift { world: camera.world_from_camera(&seen) - world, depth: seen.z - in_camera.z })
        };
        one_sigma.iter().map(shift).collect()
    }
}

/// A covariance by row. Rounding leaves it symmetric only nearly.
#[doc(hidden)]
pub fn symmetric(covariance: &Matrix3<f64>) -> [[f64; 3]; 3] {
    std::array::from_fn(|row| {
        std::array::from_fn(|column| (covariance[(row, column)] + covariance[(column, row)]) / 2.0)
    })
}

#[cfg(test)]
mod tests {
    use super::super::{KnownOfCamera, assumed_camera};
    use super::*;

    const RADIUS: f64 = 0.11;

    fn assumed() -> super::super::AssumedCamera {
        assumed_camera(Size::new(4000, 3000), &KnownOfCamera::default()).unwrap()
    }

    /// The circle that a person would draw around a ball: of the outline's area.
    fn drawn(camera: &Camera, at: &Point3<f64>) -> Circle {
        let in_camera = camera.camera_from_world(at);
        let [minor, major] = camera.outline_axes(&in_camera, RADIUS).unwrap();
        let outline = camera.outline(&in_camera, RADIUS).unwrap();
        Circle {
            centre: outline.centre.coords.into(),
            radius_px: (minor * major).sqrt(),
            sigma_px: None,
            picture: None,
        }
    }

    #[test]
    fn a_circle_around_a_ball_gives_its_place_back_in_the_middle_and_in_a_corner() {
        let camera = assumed().camera;
        for at in [Point3::new(0.0, 3.0, 1.5), Point3::new(1.6, 2.5, 2.6), Point3::new(-8.0, 20.0, 0.2)] {
            let found = camera.ball_at(&drawn(&camera, &at), RADIUS, &[]).unwrap();
            assert!((Point3::from(found.world) - at).norm() < 1e-4 * at.coords.norm(), "{found:?} {at}");
        }
    }

    #[test]
    fn sigma_is_the_spread_of_the_places_of_circles_that_are_off_by_it() {
        let camera = assumed().camera;
        let at = Point3::new(0.8, 4.0, 2.0);
        let circle = drawn(&camera, &at);
        let place = |[u, v, r]: [f64; 3]| {
            let moved = Circle {
                centre: [circle.centre[0] + u, circle.centre[1] + v],
                radius_px: circle.radius_px + r,
                ..circle
            };
            Point3::from(camera.ball_at(&moved, RADIUS, &[]).unwrap().world)
        };
        let off =
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|by| (place(by) - place(by.map(|x| -x))) / 2.0);
        let expected = off.iter().map(|off| off.norm_squared()).sum::<f64>().sqrt();
        let found = camera.ball_at(&circle, RADIUS, &[]).unwrap();
        assert!((found.sigma / expected - 1.0).abs() < 0.01, "{} {expected}", found.sigma);
        // The depth is known least: by the radius, as its share.
        assert!((found.depth_sigma / (found.depth / circle.radius_px) - 1.0).abs() < 0.05, "{found:?}");
        let twice = camera.ball_at(&Circle { sigma_px: Some(2.0), ..circle }, RADIUS, &[]).unwrap();
        assert!((twice.sigma / found.sigma - 2.0).abs() < 1e-6);
    }

    #[test]
    fn an_unsure_camera_makes_the_place_as_unsure_as_its_focal_length() {
        let assumed = assumed();
        let at = Point3::new(0.0, 6.0, 1.5);
        let circle = Circle { sigma_px: Some(0.01), ..drawn(&assumed.camera, &at) };
        let found = assumed.camera.ball_at(&circle, RADIUS, &assumed.one_sigma).unwrap();
        assert!((found.depth_sigma - 6.0 * 2.0 / 26.0).abs() < 0.02, "{found:?}");
        // Up or down by the pitch of 5° and by the height.
        let up = found.covariance[2][2].sqrt();
        assert!((up - (6.0 * 5_f64.to_radians().tan()).hypot(0.2)).abs() < 0.01, "{up}");
    }

    #[test]
    fn a_picture_of_another_size_gives_the_same_place() {
        let camera = assumed().camera;
        let circle = drawn(&camera, &Point3::new(0.5, 3.0, 1.2));
        let half = Circle {
            centre: circle.centre.map(|at| (at + 0.5) / 2.0 - 0.5),
            radius_px: circle.radius_px / 2.0,
            picture: Some(Size::new(2000, 1500)),
            sigma_px: None,
        };
        let [whole, half] = [circle, half].map(|circle| camera.ball_at(&circle, RADIUS, &[]).unwrap());
        assert!((Point3::from(whole.world) - Point3::from(half.world)).norm() < 1e-6);
        let other = Circle { picture: Some(Size::new(2000, 2000)), ..circle };
        assert!(matches!(camera.ball_at(&other, RADIUS, &[]), Err(Error::CameraMismatch { .. })));
    }

    #[test]
    fn circles_and_balls_that_are_none_are_refused_by_name() {
        let camera = assumed().camera;
        let circle = drawn(&camera, &Point3::new(0.0, 3.0, 1.5));
        let refused = |circle: Circle, radius| camera.ball_at(&circle, radius, &[]).unwrap_err().to_string();
        assert!(refused(Circle { radius_px: 0.0, ..circle }, RADIUS).contains("radius"));
        assert!(refused(Circle { sigma_px: Some(-1.0), ..circle }, RADIUS).contains("sigma"));
        assert!(refused(Circle { centre: [f64::NAN, 0.0], ..circle }, RADIUS).contains("centre"));
        assert!(refused(circle, 110.0).contains("0.11"));
    }
}
