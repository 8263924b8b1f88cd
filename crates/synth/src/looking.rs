//! Cameras by where they stand and look.

use nalgebra::{Matrix3, Vector3};

use gravisight_geometry::camera::{Camera, Distortion};
use gravisight_geometry::error::Result;
use gravisight_geometry::size::Size;

/// An upright camera at `position` that looks along `forward` (a unit vector), world frame, m; its focal length is in px and its
/// principal point in the middle of the picture.
///
/// # Errors
/// As [`Camera::new`].
pub fn looking(
    position: Vector3<f64>,
    forward: Vector3<f64>,
    focal: f64,
    size: Size,
    distortion: Distortion,
) -> Result<Camera> {
    let right = forward.cross(&Vector3::z()).normalize();
    let rotation = Matrix3::from_rows(&[right.transpose(), forward.cross(&right).transpose(), forward.transpose()]);
    let middle = size.xy().map(|side| (side - 1.0) / 2.0);
    let intrinsic = Matrix3::new(focal, 0.0, middle[0], 0.0, focal, middle[1], 0.0, 0.0, 1.0);
    Camera::new(size, intrinsic, distortion, rotation, -(rotation * position))
}
