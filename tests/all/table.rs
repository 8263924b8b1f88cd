//! A table and cameras about it: what simulated table tennis in several tests has in common.

use gravisight::parts::Distortion;
use gravisight::{Camera, Size};

use crate::common::looking;

/// A table and its ball, of spin that nobody knows.
pub const SCENE: &str = r#"{"gravity": [0, 0, -9.81], "ball": {"radius": 0.02}, "floor": {"height": -0.76},
    "boxes": [{"position": [0, 0, -0.38], "half_size": [0.7625, 1.37, 0.38]}]}"#;
/// Pictures' size, px, and focal length.
pub const SIZE: [f64; 2] = [1920.0, 1080.0];
pub const FOCAL: f64 = 1500.0;

/// A camera at `eye` that looks at the table's middle.
pub fn camera(eye: [f64; 3]) -> Camera {
    let size = Size::new(SIZE[0] as u32, SIZE[1] as u32);
    looking(eye, [0.0, 0.0, 0.1], FOCAL, size, Distortion::default())
}

/// Where cameras stand, m.
pub const VIEWS: [(&str, [f64; 3]); 3] =
    [("side", [5.5, 0.0, 1.2]), ("oblique", [4.5, -4.5, 2.0]), ("behind", [0.4, -6.5, 1.8])];
