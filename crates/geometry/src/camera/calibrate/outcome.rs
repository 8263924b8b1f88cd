//! What a calibration finds. The command's JSON, the library and (in camelCase) the npm package have these very fields.

use nalgebra::{DMatrix, Point2, Point3, Vector2, Vector3};
use serde::Serialize;

use super::noise::ClickNoise;
use super::{LineSeen, Points};
use crate::camera::Camera;
use crate::error::Result;

/// A calibrated camera and how good it is.
#[derive(Debug, Clone, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify), tsify(missing_as_null))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct Calibration {
    /// The camera.
    pub camera: Camera,
    /// Root mean square distance between clicks and points, px, outliers left out.
    pub rms_px: f64,
    /// The clicks' own standard deviation a coordinate, px: by the distances that are left, less the parameters' share, and by what is
    /// known of clicks beforehand (about 1 px), which counts as much as three distances along one axis.
    pub noise_px: f64,
    /// How the start was found.
    pub method: CalibrationMethod,
    /// Of each point: where the camera puts it less where it was clicked, px.
    pub residuals_px: Vec<Vector2<f64>>,
    /// Clicks that do not belong to the others; they had no part in the camera.
    pub outliers: Vec<WrongClick>,
    /// Of a calibration by a picture: each of the court's painted lines, in order; else empty.
    pub lines: Vec<LineSeen>,
    /// Where the camera stands in the world, m.
    pub centre: Point3<f64>,
    /// What is doubtful about it, in words; empty where nothing is.
    pub doubts: Vec<String>,
    /// Standard deviations of the camera.
    pub sigma: CameraSigma,
    /// The camera moved by one standard deviation along each independent direction of what the points leave open: what depends on the
    /// camera is off by the root of the sum of the squares of what these change. A fit takes them as its cameras.
    pub one_sigma: Vec<Camera>,
    /// Standard deviation of a position in the picture's middle, as far as the camera is to blame.
    pub point_sigma: PointSigma,
    /// The same as a distribution.
    #[serde(skip)]
    pub(super) noise: ClickNoise,
    /// The parameters' covariance, and the camera with each of them moved up and down a little.
    #[serde(skip)]
    pub(super) covariance: DMatrix<f64>,
    #[serde(skip)]
    pub(super) steps: Vec<f64>,
    #[serde(skip)]
    pub(super) neighbours: Vec<[Camera; 2]>,
}

/// How the start was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(rename_all = "kebab-case")]
pub enum CalibrationMethod {
    /// Direct linear transform, for points in space.
    #[serde(rename = "dlt")]
    DirectLinearTransform,
    /// Homography, for points in or near one plane.
    Homography,
}

/// A click that does not belong to the others.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify), tsify(missing_as_null))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct WrongClick {
    /// Its index in the list of points.
    pub index: usize,
    /// Its name; null where it has none.
    pub name: Option<String>,
    /// Where the camera puts it less where it was clicked, px.
    pub residual_px: Vector2<f64>,
}

/// Standard deviations of a camera.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct CameraSigma {
    /// Of the rotation about the camera's own axes, rad.
    pub rotation: Vector3<f64>,
    /// Of its place in the world, m.
    pub centre: Vector3<f64>,
    /// Of the focal length, px; 0 where it was given.
    pub focal_px: f64,
}

/// Standard deviation of a position.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
pub struct PointSigma {
    /// Where in the picture, px.
    pub image: Point2<f64>,
    /// How far away along the camera's axis, m: the points' mean.
    pub depth: f64,
    /// Along the world's axes, m.
    pub world: Vector3<f64>,
}

impl Calibration {
    /// 1-σ in world axes, m, of a point localised at pixel `image` and camera depth `depth` (m), as far as the camera
    /// is to blame.
    ///
    /// # Errors
    /// As [`Camera::world_from_image`].
    pub fn sigma_at(&self, image: &Point2<f64>, depth: f64) -> Result<Vector3<f64>> {
        self.sigma_of(|camera| camera.world_from_image(image, depth).map(|point| point.coords))
    }

    /// 1-σ of what depends on the camera, by its derivative.
    pub(super) fn sigma_of(&self, value: impl Fn(&Camera) -> Result<Vector3<f64>>) -> Result<Vector3<f64>> {
        let mut jacobian = DMatrix::zeros(3, self.steps.len());
        for (column, ([up, down], step)) in self.neighbours.iter().zip(&self.steps).enumerate() {
            jacobian.set_column(column, &((value(up)? - value(down)?) / (2.0 * step)));
        }
        let covariance = &jacobian * &self.covariance * jacobian.transpose();
        Ok(Vector3::from_fn(|axis, _| covariance[(axis, axis)].max(0.0).sqrt()))
    }

    /// The calibration by `points` with what follows from it: σ of a position, doubts.
    ///
    /// # Errors
    /// As [`Self::sigma_at`].
    pub(super) fn concluded(mut self, points: &Points) -> Result<Self> {
        let [width, height] = points.size.xy().map(|side| (side - 1.0) / 2.0);
        let (image, depth) = (Point2::new(width, height), self.mean_depth(points));
        self.point_sigma = PointSigma { image, depth, world: self.sigma_at(&image, depth)? };
        self.doubts = self.doubts_of(points);
        Ok(self)
    }

    /// Whether the clicks are farther from where the camera puts their points than clicks of this noise are, at this `share` of their
    /// distance.
    pub(super) fn are_clicks_unlike(&self, share: f64) -> bool {
        let clicks = self.residuals_px.len() - self.outliers.len();
        self.noise.is_unlike(clicks as f64 * (share * self.rms_px).powi(2), clicks)
    }

    /// The points' mean depth, m.
    pub(super) fn mean_depth(&self, points: &Points) -> f64 {
        let depths = points.world.iter().map(|point| self.camera.camera_from_world(point).z);
        depths.sum::<f64>() / points.world.len() as f64
    }
}
