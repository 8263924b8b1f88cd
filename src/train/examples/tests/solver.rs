//! Whether the solver still fits as its version says.

use serde::{Deserialize, Serialize};

use super::super::teach;
use crate::testing::{formula, golden, root};
use crate::train::recipe::FitConfig;
use gravisight_clips::{Clip, Frame};
use gravisight_geometry::camera::Camera;
use gravisight_physics::Scene;
use gravisight_track::SOLVER_VERSION;

/// Labels' noise, px: what is fitted then depends on every part of the solver.
const NOISE: f64 = 0.5;
/// Tracks of `tests/golden/tracks.json` that are fitted, one an environment, and of each fit the frames that are compared.
const TRACKS: [&str; 3] = ["env1", "env2", "env3"];
const EVERY: usize = 6;
/// Largest difference, px and m, that rounding explains on another processor.
const ROUNDING: f64 = 1e-6;

#[derive(Deserialize)]
struct LabelledTrack {
    id: String,
    fps: f64,
    camera: serde_json::Value,
    scene: serde_json::Value,
    image: Vec<[f64; 2]>,
    visible: Vec<bool>,
}

/// What the solver of a version says of some tracks.
#[derive(Serialize, Deserialize)]
struct GoldenTracks {
    generator: String,
    solver_version: u32,
    clips: Vec<Vec<Option<[f64; 4]>>>,
}

fn clip(track: &LabelledTrack) -> Clip {
    let noise = formula(&track.id, 2 * track.image.len());
    let frames = track.image.iter().zip(&track.visible).enumerate().map(|(index, (&[x, y], &visible))| Frame {
        file: format!("{index:03}.png").into(),
        t: index as f64 / track.fps,
        image: Some([x + NOISE * noise[2 * index], y + NOISE * noise[2 * index + 1]]),
        visible,
        world: None,
    });
    Clip {
        id: track.id.clone(),
        fps: track.fps,
        camera: Camera::from_json(&track.camera.to_string(), &track.id).unwrap(),
        scene: Some(Scene::from_json(&track.scene.to_string(), &track.id).unwrap()),
        frames: frames.collect(),
    }
}

/// 2D target (px), depth and its standard deviation (m) of some frames.
fn fitted(track: &LabelledTrack) -> Vec<Option<[f64; 4]>> {
    let taught = teach(&clip(track), &FitConfig::default());
    assert_eq!(taught.left_out, None, "{}", track.id);
    let numbers = taught.frames.iter().step_by(EVERY);
    numbers.map(|frame| frame.map(|frame| [frame.image[0], frame.image[1], frame.depth, frame.sigma])).collect()
}

#[test]
fn a_solver_that_fits_otherwise_has_another_version() {
    let tracks: Vec<LabelledTrack> = serde_json::from_slice(&golden("tracks.json")).unwrap();
    let of = |name: &&str| fitted(tracks.iter().find(|track| track.id.contains(*name)).unwrap());
    let clips: Vec<_> = TRACKS.iter().map(of).collect();
    let before: Option<GoldenTracks> = serde_json::from_slice(&golden("fits.json")).ok();
    let far = |a: &Option<[f64; 4]>, b: &Option<[f64; 4]>| match (a, b) {
        (Some(a), Some(b)) => a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max),
        (None, None) => 0.0,
        _ => f64::INFINITY,
    };
    let differs = before.as_ref().map_or(f64::INFINITY, |before| {
        clips.iter().flatten().zip(before.clips.iter().flatten()).map(|(a, b)| far(a, b)).fold(0.0, f64::max)
    });
    let version = before.map_or(0, |before| before.solver_version);
    if std::env::var_os("MAKE_REF").is_some() {
        assert!(differs > ROUNDING, "the solver fits as it did: there is nothing to write");
        assert!(version != SOLVER_VERSION, "raise `SOLVER_VERSION` (crates/track/src/fit/mod.rs) first");
        let generator = "MAKE_REF=1 cargo test --lib solver_that_fits; from tests/golden/tracks.json".into();
        let text = serde_json::to_string(&GoldenTracks { generator, solver_version: SOLVER_VERSION, clips }).unwrap();
        std::fs::write(root().join("tests/golden/fits.json"), text).unwrap();
        panic!("tests/golden/fits.json is written; run again without MAKE_REF");
    }
    assert_eq!(version, SOLVER_VERSION, "tests/golden/fits.json is of another version: MAKE_REF=1 writes it");
    assert!(
        differs <= ROUNDING,
        "the solver fits otherwise than it did, by {differs:.1e} px or m: raise `SOLVER_VERSION` (crates/track/src/fit/mod.rs), so that \
         training runs fit again, then write tests/golden/fits.json with MAKE_REF=1"
    );
}
