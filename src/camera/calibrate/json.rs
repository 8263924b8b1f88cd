//! A calibration as FORMATS.md's `calibrate --json` says it.

use nalgebra::Point2;
use serde_json::{Value, json};

use super::{Calibration, Method, Points};
use crate::error::Result;

impl Method {
    /// As in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::DirectLinearTransform => "dlt",
            Self::Homography => "homography",
        }
    }
}

impl Calibration {
    /// The picture's middle and the points' mean depth (m), where a position's 1-σ is told.
    pub fn middle(&self, points: &Points) -> (Point2<f64>, f64) {
        let [width, height] = points.size.xy().map(|side| (side - 1.0) / 2.0);
        let depths = points.world.iter().map(|point| self.camera.camera_from_world(point).z);
        (Point2::new(width, height), depths.sum::<f64>() / points.world.len() as f64)
    }

    /// The calibration by `points` as a JSON object; metres, radians and pixels.
    ///
    /// # Errors
    /// As [`Calibration::point_sigma`].
    pub fn as_json(&self, points: &Points) -> Result<Value> {
        let (image, depth) = self.middle(points);
        let outliers = self.outliers.iter().map(|&index| {
            let residual = <[f64; 2]>::from(self.residuals_px[index]);
            json!({"index": index, "name": points.names.get(index), "residual_px": residual})
        });
        Ok(json!({
            "camera": self.camera, "rms_px": self.rms_px, "noise_px": self.noise_px, "method": self.method.name(),
            "residuals_px": self.residuals_px.iter().map(|&residual| <[f64; 2]>::from(residual)).collect::<Vec<_>>(),
            "outliers": outliers.collect::<Vec<_>>(),
            "centre": <[f64; 3]>::from(self.centre().coords), "doubts": self.doubts(points), "lines": self.lines,
            "sigma": {"rotation": <[f64; 3]>::from(self.sigma_rotation), "centre": <[f64; 3]>::from(self.sigma_centre),
                "focal_px": self.sigma_focal_px},
            "one_sigma": self.one_sigma,
            "point_sigma": {"image": <[f64; 2]>::from(image), "depth": depth,
                "world": <[f64; 3]>::from(self.point_sigma(&image, depth)?)},
        }))
    }
}
