//! What a frame says of the ball in the world: a ray, and the distance by its apparent size. The camera is applied here, and nowhere
//! else in the estimator.

use nalgebra::{Matrix2, Matrix2x3, Matrix3x2, Point2, Point3, RowVector3, Vector2, Vector3};

use crate::observation::Observation as Label;
use gravisight_geometry::camera::{Camera, Outline};
use gravisight_geometry::error::Result;
use gravisight_geometry::statistics::median;

/// One frame.
#[derive(Debug, Clone, PartialEq)]
pub struct RayObservation {
    /// s.
    pub time: f64,
    /// Through the ball's centre, where it was seen.
    pub ray: Option<Ray>,
    /// Distance of the ball by its apparent size: its logarithm (of metres) and that one's standard deviation.
    pub log_distance: Option<[f64; 2]>,
}

/// A ray through a label, and how many pixels a ball beside it is away from that label.
#[derive(Debug, Clone, PartialEq)]
pub struct Ray {
    /// The camera's centre in the world, m.
    pub origin: Vector3<f64>,
    /// Unit vector.
    pub direction: Vector3<f64>,
    /// Unit vectors across it (rows).
    across: Matrix2x3<f64>,
    /// Pixels by tangent of the angle along each of those, at the label.
    px_from_tangent: Matrix2<f64>,
}

/// A distance from the camera at which the ball is held in one frame, whatever its apparent size.
#[derive(Debug, Clone, Copy)]
pub struct HeldDistance {
    pub frame: usize,
    /// Its logarithm, of metres, and how firmly it is held.
    pub log_distance: f64,
    pub sigma: f64,
}

impl RayObservation {
    /// Of a label in the picture of `camera`, of a ball of this `radius` (m).
    ///
    /// # Errors
    /// As [`Camera::camera_from_image`]: the camera's lens model does not reach the label.
    pub fn of(label: &Label, camera: &Camera, radius: f64) -> Result<Self> {
        let ray = label.image.map(|image| Ray::through(&image, camera)).transpose()?;
        let log_distance = label.radius.filter(|[size, _]| *size > 0.0).and_then(|[size, sigma]| {
            let ball = camera.ball_from_outline(&Outline { centre: label.image?, radius: size }, radius).ok()?;
            Some([ball.coords.norm().ln(), sigma / size])
        });
        Ok(Self { time: label.time, ray, log_distance })
    }
}

impl Ray {
    /// # Errors
    /// As [`Camera::camera_from_image`].
    pub fn through(image: &Point2<f64>, camera: &Camera) -> Result<Self> {
        let origin = camera.world_from_camera(&Point3::origin()).coords;
        let direction = (camera.world_from_image(image, 1.0)?.coords - origin).normalize();
        let first = direction.cross(&Vector3::ith(direction.iamin(), 1.0)).normalize();
        let across = Matrix3x2::from_columns(&[first, direction.cross(&first)]);
        let (_, px_from_metre) = camera.image_from_world_with_jacobian(&Point3::from(origin + direction))?;
        Ok(Self { origin, direction, across: across.transpose(), px_from_tangent: px_from_metre * across })
    }

    /// A point on it, m from its origin.
    pub fn at(&self, distance: f64) -> Vector3<f64> {
        self.origin + self.direction * distance
    }

    /// How far beside it a ball at `position` is seen, px (to first order in the angle), and its derivative; none for a ball
    /// behind the camera.
    pub fn residual(&self, position: &Vector3<f64>) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
        let off = position - self.origin;
        let depth = self.direction.dot(&off);
        if depth <= 0.0 {
            return None;
        }
        let tangent = self.across * off / depth;
        let jacobian = (self.across - tangent * self.direction.transpose()) / depth;
        Some((self.px_from_tangent * tangent, self.px_from_tangent * jacobian))
    }

    /// Pixels to a radian, the geometric mean over both directions.
    pub fn px_per_radian(&self) -> f64 {
        self.px_from_tangent.determinant().abs().sqrt()
    }

    /// The same as equations that are linear in the position: rows of `position`, right sides; px times metres.
    pub fn equations(&self) -> [(RowVector3<f64>, f64); 2] {
        let rows = self.px_from_tangent * self.across;
        let right = rows * self.origin;
        [(rows.row(0).into_owned(), right.x), (rows.row(1).into_owned(), right.y)]
    }
}

/// Median time from one of these to the next, s; 1 where there are fewer than two.
pub fn interval(times: impl IntoIterator<Item = f64>) -> f64 {
    let times: Vec<f64> = times.into_iter().collect();
    median(times.windows(2).map(|pair| pair[1] - pair[0])).unwrap_or(1.0)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Rotation3};

    use super::*;
    use gravisight_geometry::camera::Distortion;
    use gravisight_geometry::size::Size;

    /// A camera with a lens, two metres above the ground, turned down and aside.
    fn camera() -> Camera {
        let intrinsic = Matrix3::new(1100.0, 0.0, 639.5, 0.0, 1080.0, 359.5, 0.0, 0.0, 1.0);
        let lens = Distortion { k1: -0.2, k2: 0.05, p1: 0.001, p2: -0.002, ..Distortion::default() };
        let level = Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0);
        let rotation = Rotation3::from_euler_angles(0.3, 0.2, 0.05).into_inner() * level;
        Camera::new(Size::new(1280, 720), intrinsic, lens, rotation, rotation * Vector3::new(0.5, 4.0, -2.0)).unwrap()
    }

    #[test]
    fn a_rays_residual_is_how_far_the_ball_is_seen_from_the_label() {
        let camera = camera();
        let [width, height] = camera.size().xy();
        let label = Point2::new(0.3 * width, 0.6 * height);
        let ray = Ray::through(&label, &camera).unwrap();
        let on = ray.at(4.0);
        assert!(ray.residual(&on).unwrap().0.norm() < 1e-9);
        let beside = on + Vector3::new(0.01, -0.02, 0.015);
        let (residual, jacobian) = ray.residual(&beside).unwrap();
        let seen = camera.image_from_world(&Point3::from(beside)).unwrap() - label;
        assert!((residual - seen).norm() < 0.01 * seen.norm(), "{residual} {seen}");
        for axis in 0..3 {
            let step = Vector3::ith(axis, 1e-6);
            let slope = (ray.residual(&(beside + step)).unwrap().0 - ray.residual(&(beside - step)).unwrap().0) / 2e-6;
            assert!((slope - jacobian.column(axis)).norm() < 1e-5 * (1.0 + slope.norm()));
        }
        let behind = ray.origin - ray.direction;
        assert!(ray.residual(&behind).is_none());
    }
}
