//! `docs/formats.md` lists the fields that results have, all of them and no others.

use std::collections::BTreeSet;
use std::process::Command;

use crate::common::root;
use gravisight::camera::WrongClick;
use gravisight::findings::{ContactFinding, FlightFinding, Measured, Plan, Reason, Spot};
use gravisight::parts::{Candidate, ConfidenceKind, Hit, OtherFrame, OtherTrack, OtherView, TrackedFrame};
use gravisight::{
    Camera, Findings, Fit, FitOptions, Forecaster, LineSeen, Localisation, Observation, Points, Scene, TrackedVideo,
    Unknowns, calibrate,
};
use nalgebra::{Point3, Vector2, Vector3};
use serde::Serialize;
use serde_json::Value;

/// What is another file's content.
const FILES: [&str; 3] = ["camera", "one_sigma", "config"];
/// What has the names of what was asked for as fields.
const BY_NAME: &str = "estimates";

/// The fields of a result's table.
fn documented(section: &str) -> BTreeSet<String> {
    let text = std::fs::read_to_string(root().join("docs/formats.md")).unwrap();
    let (_, after) = text.split_once(&format!("\n### {section}\n")).unwrap();
    let rows = after.lines().take_while(|line| !line.starts_with('#')).filter(|line| line.starts_with("| `"));
    let names = rows.flat_map(|row| row.split(" | ").next().unwrap_or_default().split('`').skip(1).step_by(2));
    names.map(String::from).collect()
}

/// The fields of a result; the entries of a list as one.
fn fields(value: &Value, path: &str, found: &mut BTreeSet<String>) {
    match value {
        Value::Object(object) if !FILES.contains(&path) => {
            for (name, value) in object {
                let name = if path == BY_NAME { "NAME" } else { name };
                fields(value, &if path.is_empty() { name.into() } else { format!("{path}.{name}") }, found);
            }
        }
        Value::Array(list) if !FILES.contains(&path) && list.iter().any(Value::is_object) => {
            list.iter().for_each(|entry| fields(entry, &format!("{path}[]"), found));
        }
        _ => drop(found.insert(path.into())),
    }
}

fn compare(section: &str, result: &impl Serialize) {
    let mut found = BTreeSet::new();
    fields(&serde_json::to_value(result).unwrap(), "", &mut found);
    assert_eq!(documented(section), found, "docs/formats.md has other fields of `{section}` than its result");
}

/// A ball that comes down on a table and was seen by one camera.
fn fitted() -> Fit {
    let camera = r#"{"width": 1280, "height": 720, "intrinsic": [[1000, 0, 639.5], [0, 1000, 359.5], [0, 0, 1]],
        "camera_from_world": [[1, 0, 0, 0], [0, 0, -1, 0.5], [0, 1, 0, 4], [0, 0, 0, 1]]}"#;
    let camera = Camera::from_json(camera, "camera").unwrap();
    let forecaster = Forecaster::new(&Scene::named("table-tennis").unwrap()).unwrap();
    let start = forecaster.scene().start(Point3::new(-1.0, 0.1, 0.4), Vector3::new(3.0, 0.2, 0.5));
    let times: Vec<f64> = (0..30).map(|frame| f64::from(frame) / 60.0).collect();
    let states = forecaster.forecast(&start, &times).states;
    let label = |(state, &time): (&gravisight::State, &f64)| {
        let image = camera.image_from_world(&state.position).ok();
        Observation { time, image, ..Observation::default() }
    };
    let labels: Vec<Observation> = states.iter().zip(&times).map(label).collect();
    let mut fit = forecaster.fit(&camera, &labels, &FitOptions::default()).unwrap();
    assert!(!fit.impacts.is_empty() && !fit.estimates.is_empty(), "{fit:?}");
    fit.hits.push(Hit { time: 0.3, frame: 18, world: Point3::origin(), explained: true });
    fit
}

/// With something in each list.
fn findings() -> Findings {
    let number = || Some(Measured::default());
    Findings {
        reasons: vec![Reason::default()],
        flights: vec![FlightFinding { speed: number(), spin: number(), ..FlightFinding::default() }],
        contacts: vec![ContactFinding { place: number(), ..ContactFinding::default() }],
        plan: Some(Plan { bounces: vec![Spot::default()], ..Plan::default() }),
        ..Findings::default()
    }
}

#[test]
fn fit_and_track_have_the_fields_that_the_docs_list() {
    let fit = fitted();
    let findings = findings();
    compare("findings", &findings);
    compare("fit", &fit);
    let mut video = TrackedVideo::default();
    video.frames.push(TrackedFrame::default());
    video.tracks.push(OtherTrack { probability: 0.9, frames: vec![OtherFrame::default()] });
    video.elsewhere.push(OtherView { from: 1, to: 2, moved_px: None });
    (video.flights, video.hits, video.impacts) = (fit.flights, fit.hits, fit.impacts);
    compare("track", &video);
}

#[test]
fn calibrate_has_the_fields_that_the_docs_list() {
    let points = r#"{"width": 1920, "height": 1080, "court": "tennis",
        "names": ["near doubles corner left", "near doubles corner right", "far doubles corner left", "far doubles corner right"],
        "image": [[312.5, 905.0], [1630.0, 897.5], [601.0, 322.0], [1297.0, 319.5]]}"#;
    let mut found = calibrate(&Points::from_json(points, "points").unwrap(), &Unknowns::default()).unwrap();
    found.outliers.push(WrongClick { index: 0, name: None, residual_px: Vector2::zeros() });
    found.lines.push(LineSeen { index: 0, is_expected: true, share: 1.0, rms_px: 0.1 });
    compare("calibrate", &found);
}

#[test]
fn localise_has_the_fields_that_the_docs_list() {
    let (image, world) = ([0.0; 2], [0.0; 3]);
    let candidate = Candidate { image, radius_px: 1.0, depth: 1.0, depth_sigma: 0.1, world, confidence: 1.0 };
    let found = Localisation {
        image,
        depth: 1.0,
        depth_sigma: None,
        radius_px: Some(1.0),
        covariance: Some([[0.0; 3]; 3]),
        camera: world,
        world,
        ball_found: true,
        confidence: 1.0,
        confidence_kind: ConfidenceKind::BallProbability,
        candidates: vec![candidate],
        notes: vec![],
        maps: None,
    };
    compare("localise", &found);
}

#[test]
fn forecast_has_the_fields_that_the_docs_list() {
    let arguments =
        ["forecast", "--scene", "floor", "--state", "0,0,-1,0,0,3", "--times", "0.5,2", "--jacobian", "--json"];
    let output = Command::new(env!("CARGO_BIN_EXE_gravisight")).args(arguments).output().unwrap();
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    compare("forecast", &found);
}
