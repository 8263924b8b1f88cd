//! Cameras that look at something: what tests of calibration share.

use gravisight::parts::Distortion;
use gravisight::{Camera, Size};
use nalgebra::{Matrix3, Vector3};

/// A camera that stands at `at` and looks at `to`.
pub fn looking(at: [f64; 3], to: [f64; 3], focal: f64, size: Size, distortion: Distortion) -> Camera {
    let forward = (Vector3::from(to) - Vector3::from(at)).normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    let rotation = Matrix3::from_rows(&[right.transpose(), forward.cross(&right).transpose(), forward.transpose()]);
    let middle = size.xy().map(|side| (side - 1.0) / 2.0);
    let intrinsic = Matrix3::new(focal, 0.0, middle[0], 0.0, focal, middle[1], 0.0, 0.0, 1.0);
    Camera::new(size, intrinsic, distortion, rotation, -rotation * Vector3::from(at)).unwrap()
}
