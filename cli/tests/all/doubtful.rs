//! What is doubtful is said to be, in words, JSON and pages; what is another file than asked for is named, with where to get it.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::common::{root, scratch};
use gravisight::{Camera, Forecaster, Scene, State};
use nalgebra::{Point3, Vector3};
use serde_json::{Value, json};

fn gravisight(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gravisight")).args(arguments).current_dir(folder).output().unwrap()
}

fn words(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn errors(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

const CAMERA: &str = r#"{"width": 1280, "height": 720, "intrinsic": [[1200, 0, 639.5], [0, 1200, 359.5], [0, 0, 1]],
    "camera_from_world": [[1, 0, 0, 0], [0, 0, -1, 0.8], [0, 1, 0, 4], [0, 0, 0, 1]]}"#;
const SCENE: &str = r#"{"gravity": [0, 0, -9.81], "ball": {"radius": 0.02}, "floor": {"height": 0}}"#;

/// A folder with the track of a table tennis ball that bounces on the floor, of 60 frames a second, its camera and scene.
fn bounce(name: &str) -> PathBuf {
    let folder = scratch(name);
    std::fs::write(folder.join("scene.json"), SCENE).unwrap();
    std::fs::write(folder.join("camera.json"), CAMERA).unwrap();
    let scene = Scene::from_json(SCENE, "scene").unwrap().with_ball("table-tennis").unwrap();
    let start = State {
        position: Point3::new(-1.3, 0.1, 0.8),
        velocity: Vector3::new(3.5, 0.2, 0.5),
        spin: Vector3::new(0.0, 120.0, 30.0),
    };
    let times: Vec<f64> = (0..50).map(|frame| f64::from(frame) / 60.0).collect();
    let forecast = Forecaster::new(&scene).unwrap().forecast(&start, &times);
    let camera = Camera::from_json(CAMERA, "camera").unwrap();
    let (mut track, mut timed) = (String::from("Frame,Visibility,X,Y\n"), String::from("Frame,Visibility,X,Y,Time\n"));
    for (frame, (state, time)) in forecast.states.iter().zip(&times).enumerate() {
        let at = camera.image_from_world(&state.position).unwrap();
        track += &format!("{frame},1,{:.1},{:.1}\n", at.x, at.y);
        timed += &format!("{frame},1,{:.1},{:.1},{time:.5}\n", at.x, at.y);
    }
    std::fs::write(folder.join("track.csv"), track).unwrap();
    std::fs::write(folder.join("timed.csv"), timed).unwrap();
    folder
}

const FIT: [&str; 7] = ["fit", "--camera", "camera.json", "--scene", "scene.json", "--ball", "table-tennis"];

#[test]
fn nothing_of_a_flight_that_is_not_explained_is_told_as_a_fact() {
    let folder = bounce("unexplained");
    let fit = |rate: &str, more: &[&str]| {
        gravisight(&folder, &[&FIT[..], &["--track", "track.csv", "--fps", rate], more].concat())
    };
    // Right, it is told.
    let right = words(&fit("60", &[]));
    assert!(
        right.contains("starts at 3.") && right.contains("touches floor at t 0.") && right.contains("m/s"),
        "{right}"
    );
    assert!(!right.contains("doubtful") && right.contains("positions: 1-σ"), "{right}");
    let found: Value = serde_json::from_slice(&fit("60", &["--json"]).stdout).unwrap();
    for list in ["impacts", "flights", "frames"] {
        assert!(found[list].as_array().unwrap().iter().all(|it| it["explained"] == true), "{list}");
    }
    // At twice the rate gravity is four times too strong.
    let output = fit("120", &["--plot", "plot.html"]);
    assert_eq!(output.status.code(), Some(3), "{}", errors(&output));
    let said = words(&output);
    let found: Value = serde_json::from_slice(&fit("120", &["--json"]).stdout).unwrap();
    let contacts: Vec<&Value> = ["impacts", "hits"].iter().flat_map(|list| found[*list].as_array().unwrap()).collect();
    assert!(!contacts.is_empty() && contacts.iter().all(|it| it["explained"] == false), "{found}");
    assert!(found["frames"].as_array().unwrap().iter().all(|frame| frame["explained"] == false));
    for line in said.lines().filter(|line| line.starts_with("touches") || line.starts_with("hit")) {
        assert!(line.contains("doubtful") && !line.contains(" x "), "{line}");
    }
    assert!(said.contains("positions: not known") && !said.contains("starts at"), "{said}");
    let page = std::fs::read_to_string(folder.join("plot.html")).unwrap();
    assert!(page.contains("explained: no positions in metres") && page.contains("position unknown"), "{page:.2000}");
    // Why is folded away, and no number is bold.
    assert!(page.contains("<summary>What is not explained, and why</summary>") && !page.contains("<strong>"));
    for contact in contacts {
        let x = format!("<td>{:.3}</td>", contact["world"][0].as_f64().unwrap());
        assert!(!page.contains(&x), "{x}");
    }
}

#[test]
fn a_column_of_times_counts_and_that_is_said() {
    let folder = bounce("times");
    let fit = |more: &[&str]| gravisight(&folder, &[&FIT[..], more].concat());
    let output = fit(&["--track", "timed.csv", "--fps", "30"]);
    assert!(
        output.status.success() && errors(&output).contains("column Time, so --fps 30 is ignored"),
        "{}",
        errors(&output)
    );
    assert!(errors(&fit(&["--track", "timed.csv"])).is_empty());
}

/// A folder of frames that show nothing.
fn empty_frames(folder: &Path) {
    std::fs::create_dir(folder.join("frames")).unwrap();
    for number in 0..40 {
        let grey = image::RgbImage::from_fn(320, 180, |x, y| image::Rgb([(90 + (x * 7 + y * 13) % 40) as u8; 3]));
        grey.save(folder.join(format!("frames/{number:03}.png"))).unwrap();
    }
}

#[test]
fn a_report_without_a_flight_says_why_and_one_without_a_camera_how_to_get_metres() {
    let folder = bounce("no-flight");
    empty_frames(&folder);
    let track = |more: &[&str]| gravisight(&folder, &[&["track", "frames", "--fps", "60"][..], more].concat());
    let place = ["--camera", "camera.json", "--scene", "table-tennis", "--report", "report.html"];
    let output = track(&[&place[..], &["--json"]].concat());
    assert_eq!(output.status.code(), Some(1), "{}", errors(&output));
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(
        found["verdict"].as_str().unwrap().starts_with("no flying ball")
            && found["frames"].as_array().unwrap().len() == 40
    );
    let page = std::fs::read_to_string(folder.join("report.html")).unwrap();
    assert!(page.contains("No flying ball was found in these 40 frames.") && page.ends_with("</html>\n"));
    std::fs::remove_file(folder.join("report.html")).unwrap();
    let output = track(&["--report", "report.html"]);
    assert_eq!(output.status.code(), Some(1), "{}", errors(&output));
    let page = std::fs::read_to_string(folder.join("report.html")).unwrap();
    for said in ["No flying ball was found", "0 of 40", "--camera camera.json", "--scene NAME"] {
        assert!(page.contains(said), "{said}");
    }
}

#[test]
fn raw_streams_are_read_at_the_rate_that_is_given_and_asked_for_one_otherwise() {
    let folder = bounce("raw");
    for (codec, name, rest) in [
        ("libx264", "x.h264", "is a raw stream (h264)"),
        ("mjpeg", "x.mjpeg", "is a raw stream"),
        ("libx264", "x.avi", ""),
    ] {
        let mut command = Command::new("ffmpeg");
        command.current_dir(&folder).args(["-v", "error", "-f", "lavfi", "-i", "testsrc2=s=1280x720:r=30:d=0.5"]);
        let status = command.args(["-c:v", codec, name]).status();
        assert!(status.expect("this test needs ffmpeg: scripts/setup --browser").success());
        let label = ["label", name, "--camera", "camera.json", "--format", "csv", "--out"];
        let label = |out: &str, more: &[&str]| gravisight(&folder, &[&label[..], &[out], more].concat());
        for output in [gravisight(&folder, &["track", name]), label("unasked", &[])] {
            let said = errors(&output);
            match rest {
                "" => assert!(!said.contains("--fps"), "{name}: {said}"),
                rest => assert!(
                    output.status.code() == Some(1)
                        && said.contains(rest)
                        && said.contains("give the frames per second with --fps"),
                    "{said}"
                ),
            }
        }
        let _ = std::fs::remove_dir_all(folder.join("unasked"));
        let output = gravisight(&folder, &["track", name, "--fps", "15", "--json"]);
        let found: Value = serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", errors(&output)));
        let frames = found["frames"].as_array().unwrap();
        assert!(frames.len() == 15 && (frames[14]["time"].as_f64().unwrap() - 14.0 / 15.0).abs() < 1e-9, "{name}");
        let output = label(codec, &["--fps", "15"]);
        assert!(output.status.success(), "{name}: {}", errors(&output));
        let _ = std::fs::remove_dir_all(folder.join(codec));
        // A first frame has no need of times.
        std::fs::write(folder.join("points.json"), POINTS).unwrap();
        let output = gravisight(&folder, &["calibrate", "--points", "points.json", "--refine-lines", name]);
        assert!(!errors(&output).contains("--fps"), "{}", errors(&output));
    }
}

/// Of a court that no test picture shows.
const POINTS: &str = r#"{"width": 1280, "height": 720, "court": "tennis",
    "names": ["near doubles corner left", "near doubles corner right", "far doubles corner left", "far doubles corner right"],
    "image": [[208.5, 605.0], [1087.0, 598.5], [401.0, 215.0], [865.0, 213.5]]}"#;

#[test]
fn frames_of_h264_in_avi_are_read_with_and_without_a_rate() {
    let folder = scratch("avi");
    let mut command = Command::new("ffmpeg");
    command.current_dir(&folder).args(["-v", "error", "-f", "lavfi", "-i", "testsrc2=s=320x240:r=30:d=2"]);
    let status = command.args(["-c:v", "libx264", "x.avi"]).status();
    assert!(status.expect("this test needs ffmpeg: scripts/setup --browser").success());
    for (rate, last) in
        [(&[][..], 59.0 / 30.0), (&["--fps", "30"][..], 59.0 / 30.0), (&["--fps", "15"][..], 59.0 / 15.0)]
    {
        let output = gravisight(&folder, &[&["track", "x.avi", "--json"][..], rate].concat());
        let found: Value = serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", errors(&output)));
        let frames = found["frames"].as_array().unwrap();
        assert_eq!(frames.len(), 60);
        assert!((frames[59]["time"].as_f64().unwrap() - last).abs() < 1e-3, "{}", frames[59]);
    }
}

#[test]
fn another_file_than_asked_for_is_named_with_where_to_get_it() {
    let folder = bounce("foreign");
    let picture = root().join("tests/samples/frames/train_e1_c1_0000/000.png");
    std::fs::copy(picture, folder.join("ball.png")).unwrap();
    std::fs::write(folder.join("page.html"), "<!doctype html>\n<title>Not found</title>\n").unwrap();
    std::fs::write(folder.join("other.json"), r#"{"speed": 3.5, "spin": [0, 0, 1]}"#).unwrap();
    std::fs::create_dir(folder.join("clips")).unwrap();
    for foreign in ["ball.png", "page.html", "other.json"] {
        std::fs::copy(folder.join(foreign), folder.join("clips/clips.jsonl")).unwrap();
        let cases: [(&[&str], &str); 6] = [
            (&["localise", "ball.png", "--camera", foreign], "`gravisight calibrate`"),
            (
                &["fit", "--track", "track.csv", "--camera", "camera.json", "--scene", foreign, "--fps", "9"],
                "`gravisight scene tennis`",
            ),
            (
                &["fit", "--track", foreign, "--camera", "camera.json", "--scene", "scene.json", "--fps", "9"],
                "Frame,Visibility,X,Y",
            ),
            (&["calibrate", "--points", foreign], "`gravisight calibrate --help`"),
            (&["evaluate", "--data", "clips"], "`gravisight import`"),
            (&["localise", "ball.png", "--camera", "camera.json", "--model", "card.json"], "beside its weights"),
        ];
        std::fs::copy(folder.join(foreign), folder.join("card.json")).unwrap();
        for (arguments, named) in cases {
            let output = gravisight(&folder, arguments);
            let said = errors(&output);
            assert!(output.status.code() == Some(1) && said.lines().count() == 1, "{arguments:?}: {said}");
            assert!(said.contains(named), "{arguments:?}: {said}");
            let what = match foreign {
                "ball.png" => "is not a text file",
                _ if named.starts_with("Frame") => "no column `Frame`",
                "page.html" => "is not JSON",
                _ => "field `",
            };
            assert!(said.contains(what), "{foreign} {arguments:?}: {said}");
        }
    }
}

#[test]
fn a_camera_below_the_ground_is_said_wherever_it_is_used() {
    let folder = bounce("below");
    let mut camera: Value = serde_json::from_str(CAMERA).unwrap();
    camera["camera_from_world"][1][3] = json!(-3.0);
    std::fs::write(folder.join("camera.json"), camera.to_string()).unwrap();
    image::RgbImage::from_pixel(1280, 720, image::Rgb([90, 90, 90])).save(folder.join("grey.png")).unwrap();
    let localise = ["localise", "grey.png", "--camera", "camera.json"];
    for more in [&["--ball-radius", "0.0335"][..], &["--model", "sd-l", "--json"][..]] {
        let said = words(&gravisight(&folder, &[&localise[..], more].concat()));
        assert!(said.contains("the camera is 3.0 m below z = 0 m"), "{said}");
    }
    let output = gravisight(&folder, &[&FIT[..], &["--track", "track.csv", "--fps", "60"]].concat());
    assert!(
        words(&output).contains("the camera is 3.0 m below z = 0 m") || !output.status.success(),
        "{}",
        errors(&output)
    );
    let output = gravisight(&folder, &[&FIT[..], &["--track", "track.csv", "--fps", "60", "--json"]].concat());
    let found: Value = serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", errors(&output)));
    assert!(
        found["notes"].as_array().unwrap().iter().any(|note| note.as_str().unwrap().contains("below z")),
        "{found}"
    );
}
