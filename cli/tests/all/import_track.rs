//! A ball labelled in CVAT, as a 2D track with radii: `import --from cvat --track`.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::common::{root, scratch};
use gravisight::Track;
use serde_json::Value;

/// An ellipse, an occluded box, a box between key frames, the end of the track; and a player.
const VIDEO: &str = r#"<?xml version="1.0" encoding="utf-8"?>
<annotations>
  <version>1.1</version>
  <track id="0" label="ball" source="manual">
    <ellipse frame="4" keyframe="1" outside="0" occluded="0" cx="100.5" cy="50.25" rx="9.0" ry="6.0" rotation="30.0"/>
    <box frame="5" keyframe="1" outside="0" occluded="1" xtl="110.0" ytl="40.0" xbr="122.0" ybr="52.0"/>
    <box frame="6" keyframe="0" outside="0" occluded="0" xtl="120.0" ytl="40.0" xbr="132.0" ybr="52.0"/>
    <box frame="7" keyframe="1" outside="0" occluded="0" xtl="130.0" ytl="41.0" xbr="150.0" ybr="51.0"/>
    <box frame="8" keyframe="1" outside="1" occluded="0" xtl="130.0" ytl="41.0" xbr="150.0" ybr="51.0"/>
  </track>
  <track id="1" label="ball">
    <points frame="20" keyframe="1" outside="0" occluded="0" points="10.5,20.5"/>
  </track>
  <track id="2" label="player"><box frame="4" outside="0" occluded="0" xtl="0" ytl="0" xbr="30" ybr="90"/></track>
</annotations>"#;

const IMAGES: &str = r#"<annotations>
  <image id="0" name="shots/000.png" width="320" height="240"/>
  <image id="1" name="shots/001.png" width="320" height="240">
    <ellipse label="ball" occluded="0" cx="60.5" cy="70.5" rx="5.0" ry="5.5"/>
    <polygon label="table" points="0,0;1,1;2,0"/>
  </image>
  <image id="2" name="shots/002.png" width="320" height="240">
    <ellipse label="ball" occluded="1" cx="60.5" cy="70.5" rx="5.0" ry="5.5"/>
  </image>
</annotations>"#;

/// A file with this text in a folder of its own.
fn annotations(name: &str, text: &str) -> PathBuf {
    let path = scratch(name).join("annotations.xml");
    std::fs::write(&path, text).unwrap();
    path
}

fn import(source: &Path, more: &[&str]) -> (Output, PathBuf) {
    let track = source.with_file_name("track.csv");
    let mut command = Command::new(env!("CARGO_BIN_EXE_gravisight"));
    command.args(["import", "--from", "cvat"]).arg(source).arg("--track").arg(&track).args(more);
    (command.output().unwrap(), track)
}

/// What an import that must fail says.
fn refusal(name: &str, text: &str, more: &[&str]) -> String {
    let (output, track) = import(&annotations(name, text), more);
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(1) && output.stdout.is_empty() && !track.exists(), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
    said
}

#[test]
fn a_labelled_video_becomes_a_track_with_radii() {
    let (output, path) = import(&annotations("video", VIDEO), &["--category", "ball", "--fps", "50", "--json"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!([&report["frames"], &report["labels"], &report["radii"], &report["hidden"]], [6, 4, 3, 2]);
    assert_eq!((&report["interpolated"], &report["label"]), (&1.into(), &"ball".into()));
    assert_eq!(report["objects"], serde_json::json!([0, 1]));
    let track = Track::from_file(&path).unwrap();
    let frames: Vec<(u64, bool)> = track.points.iter().map(|point| (point.frame, point.image().is_some())).collect();
    assert_eq!(frames, [(4, true), (5, false), (6, true), (7, true), (8, false), (20, true)]);
    let [ellipse, _, square, streak, _, point] = track.points.as_slice() else { panic!("{track:?}") };
    // CVAT counts from the corner of the first pixel.
    assert_eq!((ellipse.x, ellipse.y, ellipse.time), (Some(100.0), Some(49.75), Some(0.08)));
    assert_eq!([ellipse.radius, square.radius, streak.radius, point.radius], [Some(6.0), Some(6.0), Some(5.0), None]);
    let sigma = |point: &gravisight::track::TrackPoint| point.radius_sigma.unwrap();
    assert!((0.7..0.8).contains(&sigma(ellipse)) && sigma(ellipse) == sigma(square));
    assert!(sigma(streak) > 3.0, "{}", sigma(streak));
    // As `fit` takes it: those left out between are not seen.
    let (numbers, observations) = track.observations(None).unwrap();
    assert!(numbers.len() == 17 && observations[0].radius.is_some() && observations[10].image.is_none());
}

#[test]
fn fit_reads_such_a_track() {
    // A ball that falls before a level camera, seen in 30 frames.
    let mut shapes = String::new();
    for frame in 0..30 {
        let (t, focal, radius) = (f64::from(frame) / 60.0, 900.0, 0.1);
        let (x, z) = (639.5 + focal * (0.5 * t - 0.3) / 4.0, 2.5 - 9.81 * t * t / 2.0);
        let (y, r) = (359.5 - focal * (z - 1.5) / 4.0, focal * radius / 4.0);
        shapes += &format!(
            r#"<ellipse frame="{frame}" outside="0" occluded="0" keyframe="1" cx="{}" cy="{}" rx="{r}" ry="{r}"/>"#,
            x + 0.5,
            y + 0.5
        );
    }
    let text = format!(r#"<annotations><track id="7" label="ball">{shapes}</track></annotations>"#);
    let (output, track) = import(&annotations("fit", &text), &["--fps", "60"]);
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(said.contains("30 frames of `ball`, CVAT's track 7") && !said.contains("NOTE"), "{said}");
    let lines = std::fs::read_to_string(&track).unwrap();
    std::fs::write(&track, lines + "30,1,0,0,0.5,,\n").unwrap();
    let file = |name: &str, text: &str| {
        let path = track.with_file_name(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    let camera = r#"{"width": 1280, "height": 720, "intrinsic": [[900,0,639.5],[0,900,359.5],[0,0,1]],
        "camera_from_world": [[1,0,0,0],[0,0,-1,1.5],[0,1,0,4],[0,0,0,1]]}"#;
    let scene = r#"{"gravity": [0, 0, -9.81], "ball": {"radius": 0.1, "drag_coefficient": 0.0}}"#;
    let output = Command::new(env!("CARGO_BIN_EXE_gravisight"))
        .args(["fit", "--json", "--track"])
        .arg(&track)
        .arg("--camera")
        .arg(file("camera.json", camera))
        .arg("--scene")
        .arg(file("scene.json", scene))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("track.csv: 1 frames have (0, 0) or (−1, −1): treated as not visible"), "{said}");
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    let start: Vec<f64> = serde_json::from_value(found["frames"][0]["world"].clone()).unwrap();
    assert!((start[1]).abs() < 0.3 && (start[2] - 2.5).abs() < 0.2, "{start:?}");
}

#[test]
fn labelled_pictures_become_a_track() {
    let (output, path) = import(&annotations("images", IMAGES), &[]);
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(
        output.status.success() && said.contains("1, 1 with a radius; ball outside or occluded in 1 frames"),
        "{said}"
    );
    let text = std::fs::read_to_string(path).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines[0], "Frame,Visibility,X,Y,Radius,RadiusSigma");
    assert!(lines[1] == "0,0,,,," && lines[2].starts_with("1,1,60.0,70.0,5.0,0.7") && lines[3] == "2,0,,,,", "{text}");
}

#[test]
fn the_golden_export_is_read_too() {
    let source = scratch("golden").join("rally.xml");
    std::fs::copy(root().join("tests/golden/import/cvat/rally.xml"), &source).unwrap();
    let (output, path) = import(&source, &["--category", "ball"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let track = Track::from_file(&path).unwrap();
    assert_eq!(track.points.iter().filter(|point| point.radius == Some(1.5)).count(), 5);
}

#[test]
fn several_balls_are_named_and_one_can_be_chosen() {
    let said = refusal("labels", VIDEO, &[]);
    assert!(said.contains("`ball`, `player`") && said.contains("--category"), "{said}");
    let said = refusal("no-label", VIDEO, &["--category", "racket"]);
    assert!(said.contains("`racket`") && said.contains("`ball`, `player`"), "{said}");
    // The second ball is there while the first one is.
    let text = VIDEO.replace(r#"<points frame="20""#, r#"<points frame="6""#);
    let said = refusal("two", &text, &["--category", "ball"]);
    for part in ["tracks 0 and 1", "frame 6", "--object", "0 (frames 4 to 7)", "1 (frames 6 to 6)"] {
        assert!(said.contains(part), "{said}");
    }
    let source = annotations("chosen", &text);
    let (output, path) = import(&source, &["--object", "1"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(Track::from_file(&path).unwrap().points.len(), 1);
    let said = refusal("no-object", VIDEO, &["--object", "9"]);
    assert!(said.contains("no track 9"), "{said}");
    let again = r#"<ellipse label="ball" occluded="0" cx="9" cy="9" rx="5.0" ry="5.5"/><polygon"#;
    let said = refusal("two-in-an-image", &IMAGES.replace("<polygon", again), &[]);
    assert!(said.contains("second `ball`") && said.contains("annotations.xml:5"), "{said}");
}

#[test]
fn what_cannot_be_a_track_is_refused() {
    let hidden = VIDEO.replace(r#"occluded="0""#, r#"occluded="1""#);
    assert!(refusal("hidden", &hidden, &["--category", "ball"]).contains("no frame shows the ball"));
    let polygons =
        r#"<annotations><image id="0" name="a.png"><polygon label="ball" points="0,0;1,1"/></image></annotations>"#;
    assert!(refusal("polygons", polygons, &[]).contains("no ellipse, no box and no point"));
    assert!(refusal("object", IMAGES, &["--object", "1"]).contains("for video"));
    let folders = IMAGES.replace("shots/000", "others/000");
    assert!(refusal("folders", &folders, &[]).contains("several folders (`others`, `shots`)"));
    assert!(refusal("number", &VIDEO.replace("rx=\"9.0\"", "rx=\"nine\""), &["--object", "0"]).contains("xml:5"));
    let folder = scratch("times");
    let said = refusal("folder", IMAGES, &["--pictures", folder.to_str().unwrap()]);
    assert!(said.contains("--fps"), "{said}");
    for (more, from) in [(&["--out", "clips"][..], "cvat"), (&["--camera", "camera.json"], "cvat"), (&[], "tracknet")] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_gravisight"));
        let output = command.args(["import", "--from", from, "x", "--track", "track.csv"]).args(more).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{more:?}");
    }
}
