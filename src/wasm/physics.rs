//! Physics without a network: the trajectory behind a track, forecasts.

use std::collections::BTreeMap;

use nalgebra::Point2;
use serde::{Deserialize, Serialize};
use tsify::{Ts, Tsify};
use wasm_bindgen::prelude::{JsValue, wasm_bindgen};

use super::{js_error, object_of};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::physics::{self, Forecaster, Scene, State};
use crate::track::{self, FitOptions, FittedFrame, Observation, Parameter};

/// One frame of a track.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TrackFrame {
    /// s.
    t: f64,
    /// px; none where the ball was not seen.
    image: Option<[f64; 2]>,
    /// Apparent radius and its standard deviation, px, where they were measured.
    #[serde(default)]
    radius: Option<[f64; 2]>,
}

/// The trajectory that physics allows and what was seen explains.
#[derive(Serialize, Tsify)]
#[serde(rename_all = "camelCase")]
#[tsify(missing_as_null, hashmap_as_object)]
pub struct Fit {
    /// One a frame of the track, seen or not.
    pub frames: Vec<FitFrame>,
    /// Where the ball touches something, by time.
    pub impacts: Vec<Impact>,
    /// What was to be estimated.
    #[tsify(type = "Partial<Record<\"restitution\" | \"drag\" | \"spin\", Estimate>>")]
    pub estimates: BTreeMap<&'static str, Estimate>,
    /// Spin at the first frame along the world's axes, radians a second: the scene's, or the one found.
    pub spin: [f64; 3],
    /// Standard deviation of what was seen, pixels: given, or found.
    pub noise_px: f64,
    /// Root mean square of the residuals, pixels, outliers left out.
    pub rms_px: f64,
    /// Whether every flight is; if not, a force is unknown, scene or camera are wrong, or nothing tells the distance.
    pub explained: bool,
    /// What to think of it, in a sentence.
    pub verdict: String,
    /// From hit to hit, bounces between.
    pub flights: Vec<Flight>,
    /// Where something that the scene does not hold changes the ball's way.
    pub hits: Vec<Hit>,
    /// What is odd about the track, in words.
    pub notes: Vec<String>,
}

/// A part of a trajectory in which only the scene acts on the ball.
#[derive(Serialize, Tsify)]
#[serde(rename_all = "camelCase")]
#[tsify(missing_as_null)]
pub struct Flight {
    /// When it begins, seconds.
    pub start: f64,
    /// When it ends, seconds.
    pub end: f64,
    /// Speed at its start, metres a second.
    pub speed_start: f64,
    /// Standard deviation of that.
    pub speed_sigma: f64,
    /// Spin at its start along the world's axes, radians a second.
    pub spin: [f64; 3],
    /// Standard deviation of each of its components.
    pub spin_sigma: [f64; 3],
    /// Whether its trajectory explains what was seen of it to about its noise, and is known.
    pub explained: bool,
    /// Why not, in words; null where it is.
    pub reason: Option<String>,
}

/// A hit of a racket, a foot, a hand.
#[derive(Serialize, Tsify)]
pub struct Hit {
    /// Seconds.
    pub time: f64,
    /// Index of the first frame after it.
    pub frame: usize,
    /// The ball's centre, metres.
    pub world: [f64; 3],
    /// Whether the flights that it ends and begins are explained; where not, its place is not known.
    pub explained: bool,
}

impl From<&track::Flight> for Flight {
    fn from(flight: &track::Flight) -> Self {
        Self {
            start: flight.start,
            end: flight.end,
            speed_start: flight.speed[0],
            speed_sigma: flight.speed[1],
            spin: flight.spin,
            spin_sigma: flight.spin_sigma,
            explained: flight.explained,
            reason: flight.reason.clone(),
        }
    }
}

/// The hits of a fit.
pub fn hits(fit: &track::Fit) -> impl Iterator<Item = Hit> {
    fit.hits.iter().map(|hit| Hit {
        time: hit.time,
        frame: hit.frame,
        world: hit.position.coords.into(),
        explained: fit.is_explained_at(hit.time),
    })
}

/// One moment of a trajectory.
#[derive(Serialize, Tsify)]
#[serde(rename_all = "camelCase")]
#[tsify(missing_as_null)]
pub struct FitFrame {
    /// Seconds, as given.
    pub t: f64,
    /// Metres.
    pub world: [f64; 3],
    /// Metres a second.
    pub velocity: [f64; 3],
    /// Metres a second.
    pub speed: f64,
    /// Root mean square error of the position to expect, metres.
    pub sigma: f64,
    /// Covariance of the position, square metres.
    pub covariance: [[f64; 3]; 3],
    /// The trajectory's image less what was seen, pixels; null where nothing was seen.
    pub residual_px: Option<[f64; 2]>,
    /// Index of the flight that it belongs to.
    pub flight: usize,
    /// Whether what was seen there does not belong to the trajectory.
    pub outlier: bool,
    /// Why what was seen there was left out, in words: the camera's lens does not reach that far.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[tsify(optional)]
    pub refused: Option<String>,
}

/// Where the ball touches something.
#[derive(Serialize, Tsify)]
#[serde(rename_all = "camelCase")]
#[tsify(missing_as_null)]
pub struct Impact {
    /// Seconds.
    pub t: f64,
    /// What it touches, as the scene names it: `floor`, `boxes[0]`, …
    pub surface: String,
    /// The ball's centre, metres.
    pub world: [f64; 3],
    /// Speed at which it approaches, metres a second.
    pub speed: f64,
    /// The probability that it is within the scene's outermost lines; null where those go round nothing, and of a forecast.
    pub within_lines: Option<f64>,
    /// Whether the flight that it belongs to is explained; where not, its place is not known. Null of a forecast.
    pub explained: Option<bool>,
}

/// A number of the scene that was estimated.
#[derive(Serialize, Tsify)]
pub struct Estimate {
    /// Its value.
    pub value: f64,
    /// Its standard deviation.
    pub sigma: f64,
}

impl From<&FittedFrame> for FitFrame {
    fn from(frame: &FittedFrame) -> Self {
        Self {
            t: frame.time,
            world: frame.state.position.coords.into(),
            velocity: frame.state.velocity.into(),
            speed: frame.state.velocity.norm(),
            sigma: frame.sigma(),
            // Symmetric: its columns are its rows.
            covariance: frame.covariance.into(),
            residual_px: frame.residual_px.map(<[f64; 2]>::from),
            flight: frame.flight,
            outlier: frame.outlier,
            refused: frame.refused.clone(),
        }
    }
}

impl From<&physics::Impact> for Impact {
    fn from(impact: &physics::Impact) -> Self {
        let (world, surface) = (impact.position.into(), impact.surface.to_string());
        Self { t: impact.time, surface, world, speed: impact.speed, within_lines: None, explained: None }
    }
}

/// The impacts of a fit.
pub fn impacts(fit: &track::Fit) -> impl Iterator<Item = Impact> {
    let both = fit.impacts.iter().zip(&fit.within_lines);
    both.map(|(impact, &within_lines)| {
        let explained = Some(fit.is_explained_at(impact.time));
        Impact { within_lines, explained, ..Impact::from(impact) }
    })
}

impl From<&track::Fit> for Fit {
    fn from(fit: &track::Fit) -> Self {
        let estimates = fit.estimates.iter();
        Self {
            frames: fit.frames.iter().map(FitFrame::from).collect(),
            impacts: impacts(fit).collect(),
            estimates: estimates
                .map(|it| (it.parameter.name(), Estimate { value: it.value, sigma: it.sigma }))
                .collect(),
            spin: fit.spin,
            noise_px: fit.noise_px,
            rms_px: fit.rms_px,
            explained: fit.explained,
            verdict: fit.verdict(),
            flights: fit.flights.iter().map(Flight::from).collect(),
            hits: hits(fit).collect(),
            notes: fit.notes.clone(),
        }
    }
}

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

/// The trajectory behind the track `frames` (JSON).
#[wasm_bindgen(js_name = fitTrack)]
pub fn fit_track(
    frames: &str,
    camera: &str,
    scene: &str,
    noise_px: Option<f64>,
    estimate: Vec<String>,
    camera_sigma: &str,
) -> std::result::Result<Ts<Fit>, JsValue> {
    fit(frames, [camera, camera_sigma], scene, noise_px, &estimate).map_err(js_error)
}

fn fit(
    frames: &str,
    [camera, camera_sigma]: [&str; 2],
    scene: &str,
    noise_px: Option<f64>,
    estimate: &[String],
) -> Result<Ts<Fit>> {
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
    let observations: Vec<Observation> = frames
        .iter()
        .map(|frame| Observation { time: frame.t, image: frame.image.map(Point2::from), radius: frame.radius })
        .collect();
    let forecaster = Forecaster::new(&Scene::from_json(scene, "scene")?)?;
    let cameras: Vec<Camera> = serde_json::from_str(camera_sigma).map_err(Error::format("cameraSigma"))?;
    let options = FitOptions { noise_px, estimate, cameras, ..FitOptions::default() };
    let fit = forecaster.fit(&Camera::from_json(camera, "camera")?, &observations, &options)?;
    object_of(&Fit::from(&fit))
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
            impacts: forecast.impacts.iter().map(Impact::from).collect(),
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
