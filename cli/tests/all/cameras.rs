//! `gravisight camera import`: one camera in the formats of other tools (`cameras/make.py` made them, and says where it sees some points).

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::common::scratch;
use gravisight::{Camera, Court};
use nalgebra::Point3;
use serde_json::{Value, json};

fn gravisight(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gravisight")).args(arguments).current_dir(samples()).output().unwrap()
}

fn samples() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cameras")
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A refused call's message.
fn refused(arguments: &[&str]) -> String {
    let output = gravisight(arguments);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{arguments:?}: {message}");
    assert_eq!(message.lines().count(), 1, "{message}");
    message
}

fn imported(arguments: &[&str]) -> Value {
    let output = gravisight(&[&["camera", "import"], arguments, &["--json"]].concat());
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {message}");
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Largest distance between where a camera sees the points and where `which` lens does, px.
fn off(camera: &Value, which: &str) -> f64 {
    let expected: Value = serde_json::from_slice(&std::fs::read(samples().join("expected.json")).unwrap()).unwrap();
    let camera = Camera::from_json(&camera.to_string(), "camera").unwrap();
    let points: Vec<[f64; 3]> = serde_json::from_value(expected["points"].clone()).unwrap();
    let images: Vec<[f64; 2]> = serde_json::from_value(expected["images"][which].clone()).unwrap();
    assert!(points.len() == images.len() && points.len() > 3);
    let distance = |(point, image): (&[f64; 3], [f64; 2])| {
        let seen = camera.image_from_world(&Point3::from(*point)).unwrap();
        (seen - nalgebra::Point2::from(image)).norm()
    };
    points.iter().zip(images).map(distance).fold(0.0, f64::max)
}

#[test]
fn each_tools_camera_sees_what_its_tool_says() {
    let down = ["--world", "z-down"];
    let cases: [(&[&str], &str, f64); 13] = [
        (&["opencv.yml", "--units", "mm", down[0], down[1]], "brown", 1e-6),
        (&["opencv.xml", "--units", "mm", down[0], down[1]], "brown", 1e-6),
        (&["opencv.json", "--units", "mm", down[0], down[1]], "brown", 1e-6),
        (&["sample.yml", "--units", "cm", down[0], down[1], "--image", "1"], "rational", 1e-6),
        (&["opencv.npz", "--units", "m", down[0], down[1], "--image", "1", "--size", "1280x720"], "brown", 1e-6),
        (&["ros_plumb_bob.yaml", "--units", "mm", down[0], down[1], "--pose", "opencv.yml"], "brown", 1e-6),
        (&["ros_rational.yaml", "--units", "mm", down[0], down[1], "--pose", "opencv.xml"], "rational", 1e-6),
        (&["ros_equidistant.yaml", "--units", "mm", down[0], down[1], "--pose", "opencv.json"], "fisheye", 1e-6),
        (&["colmap", "--units", "m", "--world", "y-up", "--image", "view 1.jpg"], "simple radial", 1e-6),
        (&["colmap/cameras.txt", "--units", "m", "--world", "y-up", "--image", "view 2.jpg"], "radtan", 1e-6),
        (&["colmap", "--units", "m", "--world", "y-up", "--image", "view 3.jpg"], "rational", 1e-6),
        (&["colmap", "--units", "m", "--world", "y-up", "--image", "view 4.jpg"], "fisheye", 1e-6),
        (&["tsai.xml", "--units", "mm", "--world", "z-up"], "tsai", 0.02),
    ];
    for (arguments, lens, tolerance) in cases {
        let found = imported(arguments);
        let off = off(&found["camera"], lens);
        assert!(off < tolerance, "{arguments:?}: {off} px");
        assert_eq!(found["doubts"], json!([]), "{arguments:?}");
    }
}

#[test]
fn the_cameras_of_kalibr_take_their_pose_from_another_file() {
    let folder = scratch("cameras-kalibr");
    let ours = folder.join("pose.json");
    gravisight(&["camera", "import", "opencv.yml", "--units", "mm", "--world", "z-down", "--to", text(&ours)]);
    // A camera.json says its units and its world.
    for (name, lens) in [("cam0", "radtan"), ("cam1", "fisheye")] {
        let found = imported(&["camchain.yaml", "--image", name, "--pose", text(&ours)]);
        assert!(off(&found["camera"], lens) < 1e-6);
    }
    let message = refused(&["camera", "import", "camchain.yaml", "--pose", text(&ours)]);
    assert!(message.contains("cam0, cam1") && message.contains("--image"), "{message}");
}

#[test]
fn what_a_file_does_not_say_is_asked_for_by_name() {
    let cases: [(&[&str], &[&str]); 9] = [
        (&["opencv.yml"], &["--units", "--world"]),
        (&["opencv.yml", "--units", "mm"], &["--world z-up|y-up|z-down"]),
        (&["opencv.npz", "--image", "1"], &["--size WxH"]),
        (&["opencv.npz", "--size", "1280x720"], &["2 pictures", "--image N"]),
        (&["opencv.npz", "--size", "1280x720", "--image", "2"], &["0 to 1"]),
        (&["opencv.yml", "--size", "640x480"], &["1280×720", "640×480"]),
        (&["ros_plumb_bob.yaml"], &["no pose", "--pose", "gravisight calibrate", "\"k1\":-0.21", "1010.0"]),
        (&["colmap"], &["5 pictures", "view 1.jpg", "--image NAME"]),
        (&["colmap", "--image", "other.jpg"], &["no picture other.jpg"]),
    ];
    for (arguments, named) in cases {
        let message = refused(&[&["camera", "import"], arguments].concat());
        assert!(message.contains(arguments[0]), "{message}");
        assert!(named.iter().all(|name| message.contains(name)), "{arguments:?}: {message}");
    }
}

#[test]
fn what_cannot_be_read_is_refused_by_name() {
    let folder = scratch("cameras-refused");
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
    let ros = std::fs::read_to_string(samples().join("ros_plumb_bob.yaml")).unwrap();
    write("thin.yaml", &ros.replace("plumb_bob", "thin_prism"));
    let kalibr = std::fs::read_to_string(samples().join("camchain.yaml")).unwrap();
    write("omni.yaml", &kalibr.replace("camera_model: pinhole", "camera_model: omni"));
    write("fov.yaml", &kalibr.replace("distortion_model: radtan", "distortion_model: fov"));
    let opencv = std::fs::read_to_string(samples().join("opencv.yml")).unwrap();
    let k = "camera_matrix: [[900, 0, 320], [0, 900, 240], [0, 0, 1]]\n";
    write("nan.yml", &opencv.replace("1010.,", ".Nan,"));
    write("short.yml", &opencv.replace("rows: 3\n   cols: 3", "rows: 4\n   cols: 3"));
    write("four.yml", &format!("{k}dist: [0.1, 0.01, 0, 0]\n"));
    write("prism.yml", &format!("{k}dist: [0, 0, 0, 0, 0, 0, 0, 0, 0.1, 0, 0, 0]\n"));
    write("none.yml", "a: 1\n");
    write("broken.yml", "a: [1, 2\n");
    write("unit.yml", &format!("{opencv}units: feet\nworld: z-down\n"));
    write("other.xml", "<cameras/>");
    write("broken.xml", "<opencv_storage>");
    write("broken.npz", "PK");
    let tsai = std::fs::read_to_string(samples().join("tsai.xml")).unwrap();
    write("bent.xml", &tsai.replace("kappa1=\"0.005", "kappa1=\"-0.1"));
    write("blind.xml", &tsai.replace("focal=", "length="));
    let cases: [(&str, &[&str], &[&str]); 17] = [
        ("thin.yaml", &[], &["thin_prism", "rational_polynomial"]),
        ("omni.yaml", &["--image", "cam0"], &["omni", "pinhole"]),
        ("fov.yaml", &["--image", "cam0"], &["fov", "radtan"]),
        ("nan.yml", &[], &["camera_matrix", "not a number"]),
        ("short.yml", &[], &["camera_matrix", "9 numbers, which do not fill 4 rows"]),
        ("four.yml", &[], &["--lens fisheye"]),
        ("prism.yml", &[], &["thin prism"]),
        ("none.yml", &[], &["no intrinsic matrix"]),
        ("broken.yml", &[], &["broken.yml"]),
        ("unit.yml", &[], &["feet", "mm"]),
        ("other.xml", &[], &["opencv_storage"]),
        ("broken.xml", &[], &["broken.xml"]),
        ("broken.npz", &[], &["broken.npz"]),
        ("bent.xml", &[], &["kappa1"]),
        ("blind.xml", &[], &["<Intrinsic> has no focal"]),
        ("absent.yml", &[], &["absent.yml"]),
        ("../../cli/tests/cameras/colmap", &["--image", "view 5.jpg"], &["FOV", "OPENCV_FISHEYE"]),
    ];
    for (name, options, named) in cases {
        let path = if name.ends_with("colmap") { samples().join("colmap") } else { folder.join(name) };
        let message = refused(&[&["camera", "import", text(&path)], options].concat());
        assert!(named.iter().all(|name| message.contains(name)), "{name}: {message}");
    }
}

#[test]
fn wrong_axes_and_an_inverted_pose_are_doubted() {
    let found = imported(&["opencv.yml", "--units", "mm", "--world", "z-up"]);
    let doubts = found["doubts"].to_string();
    assert!(doubts.contains("below z = 0") && doubts.contains("--world"), "{doubts}");
    // The same with the camera's pose in place of its inverse.
    let folder = scratch("cameras-doubts");
    let inverse = folder.join("inverse.yml");
    let pose = "units: m\nworld: z-up\nR: [1, 0, 0, 0, 0, 1, 0, -1, 0]\nT: [0, 4, -8]\n";
    std::fs::write(&inverse, format!("image_size: [640, 480]\nK: [900, 0, 320, 0, 900, 240, 0, 0, 1]\n{pose}"))
        .unwrap();
    let found = imported(&[text(&inverse)]);
    assert!(found["doubts"].to_string().contains("behind the camera"), "{found}");
    assert!(found["notes"].to_string().contains("pinhole"), "{found}");
    let found = imported(&["opencv.yml", "--units", "mm", "--world", "z-down", "--scene", "tennis"]);
    assert_eq!(found["doubts"], json!([]));
}

#[test]
fn commands_take_a_file_that_says_all_and_name_the_import_for_one_that_does_not() {
    let folder = scratch("cameras-commands");
    let track = folder.join("track.csv");
    std::fs::write(&track, "Frame,Visibility,X,Y\n0,1,640,360\n1,1,641,361\n").unwrap();
    let fit = ["fit", "--scene", "tennis", "--fps", "25", "--track", text(&track), "--camera"];
    let message = refused(&[&fit[..], &["opencv.yml"]].concat());
    assert!(
        message.contains("--units") && message.contains("gravisight camera import opencv.yml --to camera.json"),
        "{message}"
    );
    // Whatever comes of two labels: the camera is read.
    let says = folder.join("says.yml");
    let opencv = std::fs::read_to_string(samples().join("opencv.yml")).unwrap();
    std::fs::write(&says, format!("{opencv}units: mm\nworld: z-down\n")).unwrap();
    let output = gravisight(&[&fit[..], &[text(&says)]].concat());
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(!message.contains("says.yml"), "{message}");
}

#[test]
fn a_calibration_takes_intrinsics_and_lens_of_another_tools_file() {
    let folder = scratch("cameras-calibrate");
    let ours = folder.join("camera.json");
    gravisight(&["camera", "import", "opencv.yml", "--units", "mm", "--world", "z-down", "--to", text(&ours)]);
    let camera = Camera::from_file(&ours).unwrap();
    let names = ["near corner left", "near corner right", "far corner left", "far corner right"];
    let court = Court::named("table-tennis").unwrap();
    let corners: Vec<_> = names.iter().filter(|name| court.points.contains_key(**name)).collect();
    assert_eq!(corners.len(), 4, "{:?}", court.points.keys());
    let image: Vec<[f64; 2]> =
        corners.iter().map(|name| camera.image_from_world(&court.points[**name].into()).unwrap().into()).collect();
    let points = folder.join("points.json");
    let file = json!({"width": 1280, "height": 720, "court": "table-tennis", "names": names, "image": image});
    std::fs::write(&points, file.to_string()).unwrap();
    let output = gravisight(&["calibrate", "--points", text(&points), "--camera", "ros_plumb_bob.yaml", "--json"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(off(&found["camera"], "brown") < 1e-3, "{found}");
    std::fs::write(
        &points,
        json!({"width": 640, "height": 360, "court": "table-tennis", "names": names, "image": image}).to_string(),
    )
    .unwrap();
    let message = refused(&["calibrate", "--points", text(&points), "--camera", "ros_plumb_bob.yaml"]);
    assert!(message.contains("1280×720") && message.contains("640×360"), "{message}");
}
