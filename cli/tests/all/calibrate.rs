//! `gravisight calibrate` as a user meets it.

use std::path::Path;
use std::process::{Command, Output};

use crate::common::{root, scratch};
use gravisight::Camera;
use nalgebra::Point3;
use serde_json::{Value, json};

fn gravisight(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gravisight")).args(arguments).current_dir(root()).output().unwrap()
}

fn read(output: &Output) -> Value {
    let errors = String::from_utf8_lossy(&output.stderr);
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {errors}"))
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn clicks_on_a_court_become_a_camera_that_localises() {
    let folder = scratch("calibrate");
    // Where a camera at (3, -20, 6) m that looks at the service T of the far side sees a tennis court.
    let names = [
        "near singles corner left",
        "near singles corner right",
        "far singles corner left",
        "far singles corner right",
        "near service T",
        "far service T",
        "net post top left",
        "net post top right",
    ];
    let listed = read(&gravisight(&["calibrate", "--list", "tennis", "--json"]));
    let camera = Camera::from_json(
        r#"{"width":1280,"height":720,"intrinsic":[[1100,0,639.5],[0,1100,359.5],[0,0,1]],
            "camera_from_world":[[1,0,0,-3],[0,-0.3,-0.9539392014169457,-0.2763647914983259],[0,0.9539392014169457,-0.3,20.878784028338914],[0,0,0,1]]}"#,
        "camera",
    )
    .unwrap();
    let image: Vec<[f64; 2]> = names
        .iter()
        .map(|name| {
            let world: [f64; 3] = serde_json::from_value(listed["points"][name].clone()).unwrap();
            camera.image_from_world(&world.into()).unwrap().into()
        })
        .collect();
    let points = json!({"width": 1280, "height": 720, "court": "tennis", "names": names, "image": image});
    let (file, out) = (folder.join("points.json"), folder.join("camera.json"));
    std::fs::write(&file, points.to_string()).unwrap();
    let found = read(&gravisight(&["calibrate", "--points", text(&file), "--out", text(&out), "--json"]));
    assert!(found["rms_px"].as_f64().unwrap() < 1e-6);
    let focal = found["camera"]["intrinsic"][0][0].as_f64().unwrap();
    assert!((focal - 1100.0).abs() < 1e-3, "{focal}");
    assert!(Camera::from_file(&out).is_ok());
    let table = gravisight(&["calibrate", "--points", text(&file)]);
    assert!(String::from_utf8_lossy(&table.stdout).contains("near service T"));
    // Refusals: one line, what to do, status 1.
    std::fs::write(&file, points.to_string().replace("far service T", "far service line")).unwrap();
    let refused = gravisight(&["calibrate", "--points", text(&file)]);
    let errors = String::from_utf8_lossy(&refused.stderr);
    assert_eq!((refused.status.code(), errors.lines().count()), (Some(1), 1), "{errors}");
    assert!(errors.contains("far service line"), "{errors}");
    assert_eq!(gravisight(&["calibrate"]).status.code(), Some(2));
}

#[test]
fn a_videos_lines_make_four_clicks_exact() {
    let folder = scratch("lines");
    let made = gravisight(&["synth", "--set", "broadcast", "--split", "val", "--clips", "1", "--out", text(&folder)]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let truth = Camera::from_file(&folder.join("tennis-000.camera.json")).unwrap();
    let court = read(&gravisight(&["calibrate", "--list", "tennis", "--json"]));
    let place = |name: &str| Point3::from(serde_json::from_value::<[f64; 3]>(court["points"][name].clone()).unwrap());
    let size = truth.size();
    let is_seen = |name: &&str| {
        truth
            .image_from_world(&place(name))
            .is_ok_and(|at| at.x > 0.0 && at.y > 0.0 && at.x < size.xy()[0] && at.y < size.xy()[1])
    };
    let corners = [
        "near singles corner left",
        "near singles corner right",
        "far doubles corner left",
        "far doubles corner right",
        "near service line left",
        "near service line right",
    ];
    let names: Vec<&str> = corners.into_iter().filter(is_seen).collect();
    // Clicks that are off by two pixels this way and that.
    let click = |(index, name): (usize, &&str)| {
        let at = truth.image_from_world(&place(name)).unwrap();
        let off = [[2.0, -1.0], [-1.5, 1.5], [-2.0, -1.0], [1.0, 2.0], [0.5, -2.0], [-1.0, 1.5]][index];
        [at.x + off[0], at.y + off[1]]
    };
    let image: Vec<[f64; 2]> = names.iter().enumerate().map(click).collect();
    let points = json!({"width": size.width, "height": size.height, "court": "tennis", "names": names, "image": image});
    let file = folder.join("points.json");
    std::fs::write(&file, points.to_string()).unwrap();
    let video = folder.join("tennis-000.mp4");
    let focal = truth.intrinsic()[(0, 0)];
    let off = |found: &Value| (found["camera"]["intrinsic"][0][0].as_f64().unwrap() / focal - 1.0).abs();
    let clicked = read(&gravisight(&["calibrate", "--points", text(&file), "--json"]));
    let lined = read(&gravisight(&["calibrate", "--points", text(&file), "--refine-lines", text(&video), "--json"]));
    println!("focal length off by {:.2} %, with lines {:.2} %", 100.0 * off(&clicked), 100.0 * off(&lined));
    assert!(off(&lined) < 0.003 && off(&lined) < 0.5 * off(&clicked));
    let sigma = lined["sigma"]["focal_px"].as_f64().unwrap() / focal;
    assert!(off(&lined) < 3.0 * sigma && sigma < 0.005, "{sigma}");
    assert!(lined["lines"].as_array().unwrap().iter().filter(|line| line["share"].as_f64() > Some(0.0)).count() >= 6);
    let said = gravisight(&["calibrate", "--points", text(&file), "--refine-lines", text(&video)]);
    let said = String::from_utf8_lossy(&said.stdout);
    assert!(said.contains("% found") && !said.contains("DOUBTFUL"), "{said}");
    // A picture of something else.
    let other =
        gravisight(&["calibrate", "--points", text(&file), "--refine-lines", text(&folder.join("toss-000.mp4"))]);
    assert_eq!(other.status.code(), Some(1));
}

#[test]
fn a_videos_lines_make_a_camera_without_clicks() {
    let folder = scratch("court");
    let made = gravisight(&["synth", "--set", "broadcast", "--split", "val", "--clips", "1", "--out", text(&folder)]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let truth = Camera::from_file(&folder.join("tennis-000.camera.json")).unwrap();
    let (video, out, drawn) = (folder.join("tennis-000.mp4"), folder.join("camera.json"), folder.join("overlay.png"));
    let arguments = ["calibrate", text(&video), "--court", "tennis", "--out", text(&out), "--overlay", text(&drawn)];
    let found = read(&gravisight(&[&arguments[..], &["--json"]].concat()));
    assert!(["sure", "probable"].contains(&found["court"]["verdict"].as_str().unwrap()), "{}", found["court"]);
    // Courts look the same from both ends.
    let camera = Camera::from_file(&out).unwrap();
    let off = |sign: f64| {
        let corners = [[-4.115, -6.4], [4.115, -6.4], [4.115, 6.4], [-4.115, 6.4]];
        let off = corners.map(|[x, y]| {
            let at = camera.image_from_world(&Point3::new(sign * x, sign * y, 0.0)).unwrap();
            (at - truth.image_from_world(&Point3::new(x, y, 0.0)).unwrap()).norm()
        });
        off.into_iter().fold(0.0, f64::max)
    };
    let off = off(1.0).min(off(-1.0));
    assert!(off < 0.01 * truth.size().xy()[0], "{off} px");
    let magenta = image::open(&drawn).unwrap().to_rgb8().pixels().filter(|pixel| pixel.0 == [255, 0, 255]).count();
    assert!(magenta > 500, "{magenta}");
    let said = gravisight(&arguments);
    let said = String::from_utf8_lossy(&said.stdout);
    assert!(said.contains("first frame") && said.contains("% found") && !said.contains("click"), "{said}");
    // Any court, and then half a second of the video by itself.
    let any = read(&gravisight(&["calibrate", text(&video), "--court", "auto", "--json"]));
    assert_eq!(any["court"]["court"], "tennis", "{}", any["court"]);
    let short = folder.join("short.mp4");
    let cut = ["-v", "error", "-y", "-i", text(&video), "-frames:v", "15", text(&short)];
    assert!(std::process::Command::new("ffmpeg").args(cut).status().unwrap().success());
    let cameras = folder.join("cameras.json");
    for court in ["tennis", "auto"] {
        let by_court = ["--scene", "tennis", "--court", court, "--cameras", text(&cameras), "--json"];
        let tracked = gravisight(&[&["track", text(&short)], &by_court[..]].concat());
        let told = String::from_utf8_lossy(&tracked.stderr);
        assert!(told.contains("camera found"), "{told}");
        let cameras: Vec<Option<Camera>> = serde_json::from_str(&std::fs::read_to_string(&cameras).unwrap()).unwrap();
        assert_eq!(cameras.len(), 15);
        let moved = (cameras[14].as_ref().unwrap().intrinsic() - camera.intrinsic()).norm();
        assert!(moved < 0.01 * camera.intrinsic()[(0, 0)], "{moved}");
        std::fs::remove_file(folder.join("cameras.json")).unwrap();
    }
    let none = gravisight(&["track", text(&folder.join("toss-000.mp4")), "--scene", "tennis"]);
    let errors = String::from_utf8_lossy(&none.stderr);
    assert_eq!(none.status.code(), Some(1), "{errors}");
    assert!(errors.contains("no camera") && errors.contains("--camera"), "{errors}");
    // A picture of something else: one line that says why.
    let none = gravisight(&["calibrate", text(&folder.join("toss-000.mp4")), "--court", "badminton"]);
    let errors = String::from_utf8_lossy(&none.stderr);
    assert_eq!((none.status.code(), errors.lines().count()), (Some(1), 1), "{errors}");
    assert!(errors.contains("no court found"), "{errors}");
    for wrong in [&["calibrate", "--court", "tennis"][..], &["calibrate", text(&video)]] {
        assert_eq!(gravisight(wrong).status.code(), Some(2), "{wrong:?}");
    }
}

#[test]
fn helps_example_is_one_that_works() {
    let help = gravisight(&["calibrate", "--help"]);
    let help = String::from_utf8_lossy(&help.stdout);
    let example = help.split_once("space:\n").unwrap().1.split_once("`intrinsic`").unwrap().0;
    let file = scratch("example").join("points.json");
    std::fs::write(&file, example).unwrap();
    let found = read(&gravisight(&["calibrate", "--points", text(&file), "--json"]));
    assert!(found["rms_px"].as_f64().unwrap() < 2.0 && found["doubts"] == json!([]), "{found}");
    let formats = std::fs::read_to_string(root().join("docs/formats.md")).unwrap();
    assert!(formats.contains(example.trim()), "docs/formats.md has another example of points.json than --help");
}

#[test]
fn a_camera_that_cannot_be_is_doubted() {
    // The court's right and left mixed up: only a camera under the ground sees it so.
    let example = r#"{"width": 1920, "height": 1080, "court": "tennis",
        "names": ["near doubles corner right", "near doubles corner left", "far doubles corner right", "far doubles corner left"],
        "image": [[312.5, 905.0], [1630.0, 897.5], [601.0, 322.0], [1297.0, 319.5]]}"#;
    let file = scratch("doubt").join("points.json");
    std::fs::write(&file, example).unwrap();
    let said = gravisight(&["calibrate", "--points", text(&file)]);
    let said = String::from_utf8_lossy(&said.stdout);
    assert!(said.contains("DOUBTFUL: the camera is") && said.contains("below the ground"), "{said}");
    // Where the output goes into a file, the terminal shows it.
    let with_json = gravisight(&["calibrate", "--points", text(&file), "--json"]);
    let shown = String::from_utf8_lossy(&with_json.stderr);
    assert!(shown.contains("DOUBTFUL: the camera is"), "{shown}");
}
