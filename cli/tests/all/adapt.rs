//! `gravisight adapt`, on drawn videos.

use std::path::Path;
use std::process::{Command, Output};

use gravisight::{Card, Device, Localiser};
use serde_json::Value;

use crate::common::{root, scratch};

fn gravisight(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gravisight")).args(arguments).current_dir(root()).output().unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn errors(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// One film of each of four sports.
fn films(name: &str) -> std::path::PathBuf {
    let folder = scratch(name).join("films");
    let made = gravisight(&["synth", "--set", "broadcast", "--split", "val", "--clips", "1", "--out", text(&folder)]);
    assert!(made.status.success(), "{}", errors(&made));
    folder
}

#[test]
fn a_model_learns_a_ball_from_two_flights_and_finds_more_of_it() {
    let films = films("adapt");
    let of = |name: &str| films.join(format!("table-tennis-000.{name}"));
    let out = films.join("models/my-ball");
    let (video, camera, scene) = (of("mp4"), of("camera.json"), of("scene.json"));
    let arguments = ["adapt", text(&video), "--camera", text(&camera), "--scene", text(&scene), "--out", text(&out)];
    let more = ["--rounds", "1", "--steps", "30", "--seed", "7", "--json"];
    let made = gravisight(&[&arguments[..], &more].concat());
    let said = errors(&made);
    assert!(made.status.success(), "{said}");
    assert!(said.contains("round 1 of 1") && said.contains("usable flights: 2") && said.contains("90/90"), "{said}");
    let found: Value = serde_json::from_slice(&made.stdout).unwrap();
    let [before, after] = ["before", "after"].map(|when| found[when].clone());
    let count = |score: &Value, field: &str| score[field].as_u64().unwrap();
    assert!(count(&after, "balls") >= 5 && count(&after, "wrong") <= count(&before, "wrong"), "{found}");
    assert!(count(&after, "found") > count(&before, "found"), "{found}");

    // A whole model, which works wherever `any` does.
    let (card, weights) = Card::with_weights(&out.with_extension("json")).unwrap();
    assert_eq!((card.name.as_str(), card.weights.as_str()), ("my-ball", "my-ball.safetensors"));
    assert!(card.verifier.is_some() && card.motion.is_some() && card.calibration.is_some());
    assert!(card.description.contains("30 steps per network, seed 7"), "{}", card.description);
    Localiser::new(card, weights, &Device::flex()).unwrap();
    let track =
        ["track", text(&video), "--camera", text(&camera), "--scene", text(&scene), "--model", text(&out), "--json"];
    let tracked: Value = serde_json::from_slice(&gravisight(&track).stdout).unwrap();
    let frames = tracked["frames"].as_array().unwrap();
    let seen = frames.iter().filter(|frame| !frame["image"].is_null()).count();
    assert!(10 * seen >= 9 * frames.len(), "{seen} of {}", frames.len());
}

#[test]
fn one_flight_is_not_enough_and_nothing_is_written() {
    let films = films("adapt-refused");
    let of = |name: &str| films.join(format!("toss-000.{name}"));
    let (video, camera, out) = (of("mp4"), of("camera.json"), films.join("models/my-ball"));
    let base =
        ["adapt", text(&video), "--camera", text(&camera), "--scene", "floor", "--ball", "tennis", "--out", text(&out)];
    let refused = gravisight(&base);
    let said = errors(&refused);
    assert_eq!(refused.status.code(), Some(1), "{said}");
    assert!(said.contains("1 usable flight found") && said.contains("film more"), "{said}");
    assert_eq!(std::fs::read_dir(out.parent().unwrap()).unwrap().count(), 0);
}

#[test]
fn what_cannot_be_is_refused_before_anything_is_tracked() {
    let films = films("adapt-options");
    let video = films.join("toss-000.mp4");
    let (camera, out) = (films.join("toss-000.camera.json"), films.join("my-ball"));
    let frames = films.join("frames");
    std::fs::create_dir(&frames).unwrap();
    let sample = root().join("tests/samples/frames/test_e1_c1_0000/000.png");
    std::fs::copy(sample, frames.join("0.png")).unwrap();
    let place = ["--camera", text(&camera), "--scene", "floor"];
    let said = |arguments: &[&str]| {
        let output = gravisight(&[&["adapt"][..], arguments, &["--out", text(&out)]].concat());
        assert!(!output.status.success());
        errors(&output)
    };
    let video = text(&video);
    let refusals = [
        (said(&[video, "--model", "sd-l"]), "`sd-l` does not"),
        (said(&[video, "--device", "cuda"]), "--device wgpu"),
        (said(&[video, video, "--seed-label", "3,10,10"]), "single video"),
        (said(&[text(&frames)]), "--fps"),
        (said(&[text(&frames), "--fps", "0"]), "fps"),
        (said(&[video, "--scene", "tennis", "--court", "moon"]), "moon"),
        (said(&[&[video][..], &place, &["--camera-sigma", "absent.json"]].concat()), "absent.json"),
        (said(&[video, "--scene", "floor", "--assume-phone", "--ball", "moon"]), "moon"),
        (said(&[video, "--rounds", "3"]), "rounds"),
    ];
    for (said, expected) in refusals {
        assert!(said.contains(expected), "`{expected}` is not in: {said}");
    }
}
