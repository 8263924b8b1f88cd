//! Cameras without a network: calibration, courts, projection.

use serde::Serialize;
use tsify::{Ts, Tsify};
use wasm_bindgen::prelude::{JsValue, wasm_bindgen};

use super::picture::{self, AnyPicture};
use super::{js_error, object_of};
use crate::camera::{Calibration, Camera, Court, LineSeen, Points, Unknowns, calibrate, calibrate_by_lines};
use crate::error::Result;

/// A camera and how good it is.
#[derive(Serialize, Tsify)]
#[serde(rename_all = "camelCase")]
#[tsify(missing_as_null)]
pub struct CalibrationResult {
    /// The camera.
    pub camera: Camera,
    /// Root mean square distance between clicks and points, pixels, outliers left out.
    pub rms_px: f64,
    /// The clicks' own standard deviation a coordinate, pixels.
    pub noise_px: f64,
    /// How the start was found.
    #[tsify(type = "\"dlt\" | \"homography\"")]
    pub method: &'static str,
    /// Of each point: where the camera puts it less where it was clicked, pixels.
    pub residuals_px: Vec<[f64; 2]>,
    /// Clicks that do not fit the others; they had no part in the camera.
    pub outliers: Vec<WrongClick>,
    /// Of a calibration by a picture: each of the court's painted lines, in order; else empty.
    pub lines: Vec<CalibrationLine>,
    /// Where the camera stands, metres.
    pub centre: [f64; 3],
    /// What is doubtful about it, in words; empty where nothing is.
    pub doubts: Vec<String>,
    /// The camera moved by one standard deviation along each independent direction: `cameraSigma` of what depends on the camera.
    pub one_sigma: Vec<Camera>,
    /// Standard deviations of the camera.
    pub sigma: CameraSigma,
    /// Standard deviation of a position in the picture's middle, as far as the camera is to blame.
    pub point_sigma: PointSigma,
}

/// A click that does not fit the others.
#[derive(Serialize, Tsify)]
#[serde(rename_all = "camelCase")]
#[tsify(missing_as_null)]
pub struct WrongClick {
    /// Its place in the list of points.
    pub index: usize,
    /// Its name, where it has one.
    pub name: Option<String>,
    /// Where the camera puts it less where it was clicked, pixels.
    pub residual_px: [f64; 2],
}

/// A painted line as the picture shows it.
#[derive(Serialize, Tsify)]
#[serde(rename_all = "camelCase")]
pub struct CalibrationLine {
    /// Whether the picture should show it.
    pub is_expected: bool,
    /// Share of it in the picture that was found; 0 where none was.
    pub share: f64,
    /// Root mean square distance of that from where the camera puts the line, pixels.
    pub rms_px: f64,
}

/// Standard deviations of a camera.
#[derive(Serialize, Tsify)]
#[serde(rename_all = "camelCase")]
pub struct CameraSigma {
    /// Of the rotation about the camera's own axes, radians.
    pub rotation: [f64; 3],
    /// Of its place in the world, metres.
    pub centre: [f64; 3],
    /// Of the focal length, pixels; 0 where it was given.
    pub focal_px: f64,
}

/// Standard deviation of a position.
#[derive(Serialize, Tsify)]
pub struct PointSigma {
    /// Where in the picture, pixels.
    pub image: [f64; 2],
    /// How far away along the camera's axis, metres: the points' mean.
    pub depth: f64,
    /// Along the world's axes, metres.
    pub world: [f64; 3],
}

impl CalibrationResult {
    fn new(found: &Calibration, points: &Points) -> Result<Self> {
        let residuals_px: Vec<[f64; 2]> = found.residuals_px.iter().map(|&residual| residual.into()).collect();
        let wrong = |&index: &usize| WrongClick {
            index,
            name: points.names.get(index).cloned(),
            residual_px: residuals_px[index],
        };
        let (image, depth) = found.middle(points);
        Ok(Self {
            camera: found.camera.clone(),
            rms_px: found.rms_px,
            noise_px: found.noise_px,
            method: found.method.name(),
            outliers: found.outliers.iter().map(wrong).collect(),
            lines: (found.lines.iter())
                .map(|&LineSeen { is_expected, share, rms_px, .. }| CalibrationLine { is_expected, share, rms_px })
                .collect(),
            centre: found.centre().into(),
            doubts: found.doubts(points),
            one_sigma: found.one_sigma.clone(),
            sigma: CameraSigma {
                rotation: found.sigma_rotation.into(),
                centre: found.sigma_centre.into(),
                focal_px: found.sigma_focal_px,
            },
            point_sigma: PointSigma {
                image: <[f64; 2]>::from(image),
                depth,
                world: found.point_sigma(&image, depth)?.into(),
            },
            residuals_px,
        })
    }
}

/// A camera from the labelled points of a `points.json`; where `picture` is given, with the court's painted lines as it shows
/// them.
#[wasm_bindgen(js_name = calibrate)]
pub async fn calibrate_points(
    points: String,
    estimate: Vec<String>,
    picture: Option<AnyPicture>,
) -> std::result::Result<Ts<CalibrationResult>, JsValue> {
    let run = async || {
        let points = Points::from_json(&points, "points")?;
        let unknowns = Unknowns::named(&estimate)?;
        let found = match picture {
            None => calibrate(&points, &unknowns)?,
            Some(picture) => calibrate_by_lines(&points, &unknowns, &picture::read(&picture).await?)?,
        };
        object_of(&CalibrationResult::new(&found, &points)?)
    };
    run().await.map_err(js_error)
}

/// Names of the courts whose points are known.
#[wasm_bindgen]
pub fn courts() -> Vec<String> {
    Court::names().into_iter().map(String::from).collect()
}

/// A court's named points.
#[wasm_bindgen]
pub fn court(name: &str) -> std::result::Result<Ts<Court>, JsValue> {
    Court::named(name).and_then(object_of).map_err(js_error)
}

/// Where points of the world (x, y, z of each, m) are in the camera's picture: x and y of each, px; NaN for what the
/// camera cannot see.
#[wasm_bindgen]
pub fn project(camera: &str, points: Vec<f64>) -> std::result::Result<Vec<f64>, JsValue> {
    let camera = Camera::from_json(camera, "camera").map_err(js_error)?;
    let image = |point: &[f64]| {
        let seen = camera.image_from_world(&[point[0], point[1], point[2]].into());
        seen.map_or([f64::NAN; 2], <[f64; 2]>::from)
    };
    Ok(points.chunks_exact(3).flat_map(image).collect())
}
