//! A table, cameras about it, and noise: what simulated table tennis in several tests has in common.

use gravisight::Camera;
use nalgebra::{Matrix3, Matrix4, Vector3};

/// A table and its ball, of spin that nobody knows.
pub const SCENE: &str = r#"{"gravity": [0, 0, -9.81], "ball": {"radius": 0.02}, "floor": {"height": -0.76},
    "boxes": [{"position": [0, 0, -0.38], "half_size": [0.7625, 1.37, 0.38]}]}"#;
/// Pictures' size, px, and focal length.
pub const SIZE: [f64; 2] = [1920.0, 1080.0];
pub const FOCAL: f64 = 1500.0;

/// A camera at `eye` that looks at the table's middle.
pub fn camera(eye: [f64; 3]) -> Camera {
    let eye = Vector3::from(eye);
    let forward = (Vector3::new(0.0, 0.0, 0.1) - eye).normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    let down = forward.cross(&right);
    let rotation = Matrix3::from_rows(&[right.transpose(), down.transpose(), forward.transpose()]);
    let mut pose = Matrix4::identity();
    pose.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
    pose.fixed_view_mut::<3, 1>(0, 3).copy_from(&(-rotation * eye));
    let rows = |matrix: &Matrix4<f64>| -> Vec<Vec<f64>> {
        matrix.row_iter().map(|row| row.iter().copied().collect()).collect()
    };
    let text = serde_json::json!({"width": SIZE[0] as u32, "height": SIZE[1] as u32, "camera_from_world": rows(&pose),
        "intrinsic": [[FOCAL, 0.0, SIZE[0] / 2.0 - 0.5], [0.0, FOCAL, SIZE[1] / 2.0 - 0.5], [0.0, 0.0, 1.0]]});
    Camera::from_json(&text.to_string(), "camera").unwrap()
}

/// Where cameras stand, m.
pub const VIEWS: [(&str, [f64; 3]); 3] =
    [("side", [5.5, 0.0, 1.2]), ("oblique", [4.5, -4.5, 2.0]), ("behind", [0.4, -6.5, 1.8])];
