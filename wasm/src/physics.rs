//! Physics without a network: the trajectory behind a track, forecasts.

use serde::Serialize;
use tsify::{Ts, Tsify};
use wasm_bindgen::prelude::{JsValue, wasm_bindgen};

use super::{js_error, object_of};
use gravisight_geometry::camera::Camera;
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::volume::check_ball_radius;
use gravisight_physics::{Forecaster, Impact, Scene, State};
use gravisight_track::findings::Findings;
use gravisight_track::{Fit, FitOptions, Observation, Parameter};

/// Names of the scenes of common sports, `floor` (nothing but a level one) and `free` (nothing to touch).
#[wasm_bindgen]
pub fn scenes() -> Vec<String> {
    Scene::names().into_iter().map(String::from).collect()
}

/// The scene of a common sport.
#[wasm_bindgen]
pub fn scene(name: &str) -> std::result::Result<Ts<Scene>, JsValue> {
    Scene::named(name).and_then(|scene| object_of(&scene)).map_err(js_error)
}

/// The scene with its ball at another radius, m.
#[wasm_bindgen(js_name = sceneWithBall)]
pub fn scene_with_ball(scene: &str, radius: f64) -> std::result::Result<Ts<Scene>, JsValue> {
    let changed = || {
        check_ball_radius(radius)?;
        let mut scene = Scene::from_json(scene, "scene")?;
        scene.ball = scene.ball.with_radius(radius);
        object_of(&scene)
    };
    changed().map_err(js_error)
}

/// A trajectory, and what a person is told of it.
#[derive(Serialize, Tsify)]
#[tsify(hashmap_as_object, missing_as_null)]
pub struct ToldFit {
    #[serde(flatten)]
    fit: Fit,
    /// The same in words, for people.
    findings: Findings,
}

/// The trajectory behind the track `frames` (JSON).
#[wasm_bindgen(js_name = fitTrack)]
pub fn fit_track(
    frames: &str,
    camera: &str,
    scene: &str,
    noise_px: Option<f64>,
    estimate: Vec<String>,
    camera_sigma: &str,
    camera_assumed: bool,
) -> std::result::Result<Ts<ToldFit>, JsValue> {
    fit(frames, [camera, camera_sigma], camera_assumed, scene, noise_px, estimate).map_err(js_error)
}

fn fit(
    frames: &str,
    [camera, camera_sigma]: [&str; 2],
    camera_assumed: bool,
    scene: &str,
    noise_px: Option<f64>,
    estimate: Vec<String>,
) -> Result<Ts<ToldFit>> {
    let observations: Vec<Observation> = serde_json::from_str(frames).map_err(Error::format("track"))?;
    if noise_px.is_some_and(|noise| !(noise.is_finite() && noise > 0.0)) {
        return Err(Error::value("track", "noisePx", "must be positive"));
    }
    let estimate: Vec<Parameter> = serde_json::from_value(estimate.into()).map_err(Error::format("estimate"))?;
    let forecaster = Forecaster::new(&Scene::from_json(scene, "scene")?)?;
    let cameras: Vec<Camera> = serde_json::from_str(camera_sigma).map_err(Error::format("cameraSigma"))?;
    let options = FitOptions { noise_px, estimate, cameras, camera_assumed, ..FitOptions::default() };
    let camera = Camera::from_json(camera, "camera")?;
    let fit = forecaster.fit(&camera, &observations, &options)?;
    let findings = Findings::of_fit(&fit, &camera, forecaster.scene());
    object_of(&ToldFit { fit, findings })
}

/// A ball's states at the times asked for.
#[derive(Serialize, Tsify)]
pub struct Forecast {
    /// One a time: x, y, z (metres), then the velocity (metres a second).
    pub states: Vec<[f64; 6]>,
    /// Where the ball touches something, by time.
    pub impacts: Vec<Impact>,
    /// How it ended, in words.
    pub status: String,
}

/// States of a ball at `times` (s), of the `start` (x, y, z in m, then the velocity in m/s) at time 0.
#[wasm_bindgen]
pub fn forecast(scene: &str, start: Vec<f64>, times: Vec<f64>) -> std::result::Result<Ts<Forecast>, JsValue> {
    let run = || {
        let forecaster = Forecaster::new(&Scene::from_json(scene, "scene")?)?;
        let forecast = forecaster.forecast(&start_of(forecaster.scene(), &start)?, &times);
        object_of(&Forecast {
            states: forecast.states.iter().map(flat).collect(),
            impacts: forecast.impacts,
            status: forecast.status.to_string(),
        })
    };
    run().map_err(js_error)
}

/// The state of six numbers.
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
