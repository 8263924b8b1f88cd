//! Cameras without a network: calibration, courts, projection.

use serde::{Deserialize, Serialize};
use tsify::{Ts, Tsify};
use wasm_bindgen::prelude::{JsValue, wasm_bindgen};

use super::picture::{self, AnyPicture};
use super::{js_error, object_of};
use gravisight_geometry::camera::{
    AssumedCamera, BallAt, Calibration, Camera, Circle, Court, FoundCourt, KnownOfCamera, Points, Unknowns,
    assumed_camera, calibrate, calibrate_by_lines, find_court,
};
use gravisight_geometry::error::Error;
use gravisight_geometry::size::Size;

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

/// What is known of a camera that nobody calibrated.
#[derive(Deserialize, Tsify)]
#[serde(deny_unknown_fields, rename_all = "camelCase")]
pub struct CameraToAssume {
    /// Of its pictures, pixels.
    pub width: u32,
    /// Of its pictures, pixels.
    pub height: u32,
    /// 35 mm equivalent of the focal length, mm, as EXIF's `FocalLengthIn35mmFilm`. Default: a phone's main camera, 26 mm.
    #[serde(default)]
    pub focal35mm: Option<f64>,
    /// Height of the lens above the ground, metres. Default: 1.5.
    #[serde(default)]
    pub height_above_ground: Option<f64>,
    /// Whether the picture is a video's, which stabilisation crops. Default: false.
    #[serde(default)]
    pub video: bool,
}

/// A camera of pictures of a size, of which nothing else need be known: a phone's, held level.
#[wasm_bindgen(js_name = assumedCamera)]
pub fn camera_assumed(known: Ts<CameraToAssume>) -> std::result::Result<Ts<AssumedCamera>, JsValue> {
    let run = || {
        let CameraToAssume { width, height, focal35mm, height_above_ground, video } =
            known.to_rust().map_err(Error::format("assumed camera"))?;
        let known = KnownOfCamera { focal_35mm: focal35mm, height: height_above_ground, video };
        object_of(&assumed_camera(Size::new(width, height), &known)?)
    };
    run().map_err(js_error)
}

/// A circle drawn around a ball.
#[derive(Deserialize, Tsify)]
#[serde(deny_unknown_fields, rename_all = "camelCase")]
pub struct DrawnCircle {
    /// Its centre, pixels.
    pub centre: [f64; 2],
    /// Its radius, pixels.
    pub radius_px: f64,
    /// 1-σ of its centre along each axis and of its radius, pixels. Default: 1.
    #[serde(default)]
    pub sigma_px: Option<f64>,
    /// Size of the picture that it was drawn in, if it is not the camera's.
    #[serde(default)]
    pub picture: Option<Size>,
}

/// Where a ball of `ball_radius` (m) is that somebody drew a circle around, in a picture of `camera` (JSON). `camera_sigma` (JSON): the
/// camera displaced by one standard deviation each.
#[wasm_bindgen(js_name = ballAt)]
pub fn ball_at(
    camera: &str,
    circle: Ts<DrawnCircle>,
    ball_radius: f64,
    camera_sigma: &str,
) -> std::result::Result<Ts<BallAt>, JsValue> {
    let run = || {
        let camera = Camera::from_json(camera, "camera")?;
        let DrawnCircle { centre, radius_px, sigma_px, picture } = circle.to_rust().map_err(Error::format("circle"))?;
        let one_sigma: Vec<Camera> = serde_json::from_str(camera_sigma).map_err(Error::format("cameraSigma"))?;
        object_of(&camera.ball_at(&Circle { centre, radius_px, sigma_px, picture }, ball_radius, &one_sigma)?)
    };
    run().map_err(js_error)
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
