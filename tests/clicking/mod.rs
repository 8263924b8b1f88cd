//! Cameras that look at something, and noise for clicks: what tests of calibration share.

use gravisight::parts::Distortion;
use gravisight::{Camera, Size};
use nalgebra::{Matrix3, Vector3};

/// Reproducible Gaussian noise.
pub struct Noise(pub u64);

impl Noise {
    /// From 0 to 1.
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Standard normal.
    pub fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.uniform()).ln()).sqrt() * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

/// A camera that stands at `at` and looks at `to`.
pub fn looking(at: [f64; 3], to: [f64; 3], focal: f64, size: Size, distortion: Distortion) -> Camera {
    let forward = (Vector3::from(to) - Vector3::from(at)).normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    let rotation = Matrix3::from_rows(&[right.transpose(), forward.cross(&right).transpose(), forward.transpose()]);
    let middle = size.xy().map(|side| (side - 1.0) / 2.0);
    let intrinsic = Matrix3::new(focal, 0.0, middle[0], 0.0, focal, middle[1], 0.0, 0.0, 1.0);
    Camera::new(size, intrinsic, distortion, rotation, -rotation * Vector3::from(at)).unwrap()
}
