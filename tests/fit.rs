//! From 2D labels to 3D trajectories: against the simulator's truth, which the fit never sees.

mod common;

use std::time::Instant;

use gravisight::Camera;
use gravisight::physics::{Estimate, Fit, FitOptions, Forecaster, Observation, Parameter, Scene};
use nalgebra::{Point2, Vector3};
use serde_json::Value;

#[derive(serde::Deserialize)]
struct Track {
    id: String,
    fps: f64,
    camera: Value,
    scene: Value,
    image: Vec<[f64; 2]>,
    visible: Vec<bool>,
    world: Vec<[f64; 3]>,
}

fn tracks() -> Vec<Track> {
    // the training split's tracks, to tune on: tests/golden/tracks.py
    match std::env::var_os("GRAVISIGHT_TRACKS") {
        Some(path) => serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap(),
        None => serde_json::from_slice(&common::golden("tracks.json")).unwrap(),
    }
}

/// Numbers of a standard normal distribution, by name (Box and Muller).
fn normal(name: &str, count: usize) -> Vec<f64> {
    let uniform = common::formula(name, 2 * count);
    let pair = |two: &[f64]| (-2.0 * (0.5 * (two[0] + 1.0)).max(1e-300).ln()).sqrt() * (std::f64::consts::PI * two[1]).cos();
    uniform.chunks_exact(2).map(pair).collect()
}

/// The track's labels with noise of `sigma` px, every tenth frame or so missing if `gaps`.
fn observed(track: &Track, sigma: f64, gaps: f64) -> Vec<Observation> {
    let noise = normal(&format!("{} {sigma}", track.id), 2 * track.image.len());
    let missing = common::formula(&format!("{} gaps", track.id), track.image.len());
    let frame = |k: usize| {
        let [x, y] = track.image[k];
        let seen = track.visible[k] && 0.5 * (missing[k] + 1.0) >= gaps;
        let image = seen.then(|| Point2::new(x + sigma * noise[2 * k], y + sigma * noise[2 * k + 1]));
        Observation { time: k as f64 / track.fps, image }
    };
    (0..track.image.len()).map(frame).collect()
}

struct Score {
    errors: Vec<f64>,
    sigmas: Vec<f64>,
    slowest: f64,
}

fn score(tracks: &[Track], sigma: f64, gaps: f64, options: &FitOptions) -> Score {
    let mut score = Score { errors: vec![], sigmas: vec![], slowest: 0.0 };
    for track in tracks {
        let camera = Camera::from_json(&track.camera.to_string(), &track.id).unwrap();
        let forecaster = Forecaster::new(&Scene::from_json(&track.scene.to_string(), &track.id).unwrap()).unwrap();
        let begin = Instant::now();
        let fit = forecaster.fit(&camera, &observed(track, sigma, gaps), options).unwrap();
        let took = begin.elapsed().as_secs_f64();
        for Estimate { parameter, value, sigma } in &fit.estimates {
            println!("{} {parameter:?} {value:.3} ± {sigma:.3}", track.id);
        }
        println!("{} spin {:?} {:?}", track.id, fit.spin, track.scene["ball"]["spin"]);
        let errors = errors(&fit, &track.world);
        let sigmas: Vec<f64> = fit.frames.iter().map(|frame| frame.sigma()).collect();
        println!(
            "{:24} {sigma} px: mean {:7.2} median {:7.2} worst {:7.2} cm  noise {:.3} px rms {:.3}  median sigma {:.2} cm, {:.0} % sure  {took:.2} s",
            track.id, 100.0 * mean(&errors), 100.0 * median(&errors), 100.0 * errors.iter().copied().fold(0.0, f64::max),
            fit.noise_px, fit.rms_px, 100.0 * median(&sigmas), 100.0 * sigmas.iter().filter(|s| **s < 0.1).count() as f64 / sigmas.len() as f64
        );
        score.errors.extend(errors);
        score.sigmas.extend(sigmas);
        score.slowest = score.slowest.max(took);
    }
    println!("all: mean {:.2} median {:.2} cm, slowest {:.2} s", 100.0 * mean(&score.errors), 100.0 * median(&score.errors), score.slowest);
    score
}

fn errors(fit: &Fit, world: &[[f64; 3]]) -> Vec<f64> {
    let pairs = fit.frames.iter().zip(world);
    pairs.map(|(frame, truth)| (frame.state.position.coords - Vector3::from(*truth)).norm()).collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[sorted.len() / 2]
}

#[test]
fn exact_labels_give_whole_clips_to_half_a_centimetre() {
    let score = score(&tracks(), 0.0, 0.0, &FitOptions::default());
    assert!(mean(&score.errors) < 0.005, "{}", mean(&score.errors));
}

#[test]
fn noisy_labels_with_gaps_give_two_centimetres_and_say_where_they_do_not() {
    let score = score(&tracks(), 1.0, 0.1, &FitOptions::default());
    assert!(median(&score.errors) < 0.02, "{}", median(&score.errors));
    let sure: Vec<f64> =
        score.errors.iter().zip(&score.sigmas).filter(|(_, sigma)| **sigma < 0.1).map(|(error, _)| *error).collect();
    let share = sure.len() as f64 / score.errors.len() as f64;
    println!("sure of {:.1} %: mean {:.2} cm", 100.0 * share, 100.0 * mean(&sure));
    assert!(share > 0.85 && mean(&sure) < 0.03, "{share} {}", mean(&sure));
}

fn table_tennis() -> Vec<Track> {
    serde_json::from_slice(&common::golden("table_tennis.json")).unwrap()
}

#[test]
fn table_tennis_with_known_spin_is_found_to_three_centimetres() {
    let score = score(&table_tennis(), 1.0, 0.0, &FitOptions::default());
    assert!(median(&score.errors) < 0.03, "{}", median(&score.errors));
}

#[test]
fn table_tennis_with_unknown_spin_is_found_to_three_centimetres() {
    let mut tracks = table_tennis();
    for track in &mut tracks {
        track.scene["ball"]["spin"] = serde_json::json!([0, 0, 0]);
    }
    let score = score(&tracks, 1.0, 0.0, &FitOptions { estimate: vec![Parameter::Spin], ..FitOptions::default() });
    assert!(median(&score.errors) < 0.03, "{}", median(&score.errors));
}

#[test]
fn restitution_and_drag_are_estimated() {
    let mut tracks = table_tennis();
    for track in &mut tracks {
        track.scene["contact"]["restitution"] = serde_json::json!(0.75);
        track.scene["ball"]["drag_coefficient"] = serde_json::json!(0.2);
    }
    let estimate = vec![Parameter::Restitution, Parameter::Drag];
    score(&tracks, 0.3, 0.0, &FitOptions { estimate, ..FitOptions::default() });
}
