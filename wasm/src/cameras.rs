//! Cameras without a network: calibration, courts, projection.

use serde::Serialize;
use tsify::{Ts, Tsify};
use wasm_bindgen::prelude::{JsValue, wasm_bindgen};

use super::picture::{self, AnyPicture};
use super::{js_error, object_of};
use gravisight_geometry::camera::{
    Calibration, Camera, Court, FoundCourt, Points, Unknowns, calibrate, calibrate_by_lines, find_court,
};
use gravisight_geometry::error::Error;

/// A camera from the labelled points of a `points.json`; where `picture` is given, with the court's painted lines as it shows
/// them.
#[wasm_bindgen(js_name = calibrate)]
pub async fn calibrate_points(
    points: String,
    estimate: Vec<String>,
    picture: Option<AnyPicture>,
) -> std::result::Result<Ts<Calibration>, JsValue> {
    let run = async || {
        let points = Points::from_json(&points, "points")?;
        let unknowns = Unknowns::named(&estimate)?;
        object_of(&match picture {
            None => calibrate(&points, &unknowns)?,
            Some(picture) => calibrate_by_lines(&points, &unknowns, &picture::read(&picture).await?)?,
        })
    };
    run().await.map_err(js_error)
}

/// A court that was searched in a picture, and its camera, refined by the court's painted lines.
#[derive(Serialize, Tsify)]
#[tsify(missing_as_null)]
pub struct CourtSearch {
    /// The court, how far it can be trusted, and a first camera.
    pub found: FoundCourt,
    /// The camera to use; null where no court was found, or where its camera cannot be refined.
    pub calibration: Option<Calibration>,
    /// Why there is no `calibration`; empty where there is one.
    pub reason: String,
}

/// Finds a court's camera in a picture without clicks. `court` is one of `courts()`, or `auto`.
#[wasm_bindgen(js_name = findCourt)]
pub async fn find_court_in(
    picture: AnyPicture,
    court: String,
    estimate: Vec<String>,
) -> std::result::Result<Ts<CourtSearch>, JsValue> {
    let run = async || {
        let unknowns = Unknowns::named(&estimate)?;
        let picture = picture::read(&picture).await?;
        let found = find_court(&picture, &court)?;
        let (calibration, reason) = match found.calibrate(&picture, &unknowns) {
            Ok(calibration) => (Some(calibration), String::new()),
            Err(Error::Calibration { reason }) => (None, reason),
            Err(other) => return Err(other),
        };
        object_of(&CourtSearch { found, calibration, reason })
    };
    run().await.map_err(js_error)
}

/// The court on which a sport is played, if its painted lines are known.
#[wasm_bindgen(js_name = courtWithLines)]
pub fn court_with_lines(sport: &str) -> Option<String> {
    Court::with_lines(sport).map(String::from)
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
