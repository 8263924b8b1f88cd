//! What needs no network: fit, forecast, calibrate, courts.

use nalgebra::Point2;
use serde::Deserialize;
use wasm_bindgen::prelude::{JsValue, wasm_bindgen};

use super::{js_error, object_of};
use crate::camera::{Camera, Court, Points, Unknowns, calibrate};
use crate::error::{Error, Result};
use crate::physics::{Forecaster, Scene, State};
use crate::track::{FitOptions, Observation, Parameter};

/// One frame of a track.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TrackFrame {
    /// s.
    t: f64,
    /// px; none where the ball was not seen.
    image: Option<[f64; 2]>,
}

/// The trajectory behind the track `frames` (JSON): FORMATS.md's `fit --json` without frame numbers.
#[wasm_bindgen(js_name = fitTrack)]
pub fn fit_track(
    frames: &str,
    camera: &str,
    scene: &str,
    noise_px: Option<f64>,
    estimate: Vec<String>,
) -> std::result::Result<JsValue, JsValue> {
    fit(frames, camera, scene, noise_px, &estimate).map_err(js_error)
}

fn fit(frames: &str, camera: &str, scene: &str, noise_px: Option<f64>, estimate: &[String]) -> Result<JsValue> {
    let frames: Vec<TrackFrame> = serde_json::from_str(frames).map_err(Error::format("track"))?;
    if noise_px.is_some_and(|noise| !(noise.is_finite() && noise > 0.0)) {
        return Err(Error::value("track", "noisePx", "must be positive"));
    }
    let all = [Parameter::Restitution, Parameter::Drag, Parameter::Spin];
    let parameter = |name: &String| {
        let found = all.into_iter().find(|parameter| parameter.name() == name);
        found.ok_or_else(|| {
            Error::value("track", "estimate", format!("cannot be `{name}`; there are restitution, drag and spin"))
        })
    };
    let estimate = estimate.iter().map(parameter).collect::<Result<Vec<_>>>()?;
    let observations: Vec<Observation> =
        frames.iter().map(|frame| Observation { time: frame.t, image: frame.image.map(Point2::from) }).collect();
    let forecaster = Forecaster::new(&Scene::from_json(scene, "scene")?)?;
    let options = FitOptions { noise_px, estimate, ..FitOptions::default() };
    let fit = forecaster.fit(&Camera::from_json(camera, "camera")?, &observations, &options)?;
    object_of(&fit.as_json())
}

/// States (x, y, z in m, then the velocity in m/s) of a ball at `times` (s), of the `start` at time 0; and where it
/// touches something.
#[wasm_bindgen]
pub fn forecast(scene: &str, start: Vec<f64>, times: Vec<f64>) -> std::result::Result<JsValue, JsValue> {
    let run = || {
        let forecaster = Forecaster::new(&Scene::from_json(scene, "scene")?)?;
        let forecast = forecaster.forecast(&start_of(forecaster.scene(), &start)?, &times);
        let states: Vec<[f64; 6]> = forecast.states.iter().map(flat).collect();
        let impacts: Vec<serde_json::Value> = forecast
            .impacts
            .iter()
            .map(|impact| {
                serde_json::json!({"t": impact.time, "surface": impact.surface.to_string(),
                    "world": <[f64; 3]>::from(impact.position), "speed": impact.speed})
            })
            .collect();
        object_of(&serde_json::json!({"states": states, "impacts": impacts, "status": forecast.status.to_string()}))
    };
    run().map_err(js_error)
}

/// The start of six numbers, with the scene's spin.
pub(super) fn start_of(scene: &Scene, numbers: &[f64]) -> Result<State> {
    match *numbers {
        [x, y, z, vx, vy, vz] if numbers.iter().all(|number| number.is_finite()) => {
            Ok(scene.start([x, y, z].into(), [vx, vy, vz].into()))
        }
        _ => Err(Error::value("state", "start", "must be six finite numbers: x, y, z (m) and the velocity (m/s)")),
    }
}

fn flat(state: &State) -> [f64; 6] {
    let (r, v) = (state.position, state.velocity);
    [r.x, r.y, r.z, v.x, v.y, v.z]
}

/// A camera from the labelled points of a `points.json`: FORMATS.md's `calibrate --json`.
#[wasm_bindgen(js_name = calibrate)]
pub fn calibrate_points(points: &str, estimate: Vec<String>) -> std::result::Result<JsValue, JsValue> {
    let run = || {
        let points = Points::from_json(points, "points")?;
        let found = calibrate(&points, &Unknowns::named(&estimate)?)?;
        object_of(&found.as_json(&points)?)
    };
    run().map_err(js_error)
}

/// Names of the courts whose points are known.
#[wasm_bindgen]
pub fn courts() -> Vec<String> {
    Court::names().into_iter().map(String::from).collect()
}

/// A court's named points: `{ about, points: { NAME: [x, y, z] } }`, m.
#[wasm_bindgen]
pub fn court(name: &str) -> std::result::Result<JsValue, JsValue> {
    let run = || {
        let Court { about, points } = Court::named(name)?;
        object_of(&serde_json::json!({"about": about, "points": points}))
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
