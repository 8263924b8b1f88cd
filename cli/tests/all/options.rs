//! Options whose effect no other test of the command checks: each is given twice, and what comes out differs. `src/commands/options.rs` in
//! the command's crate says which test checks which option.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::common::{root, scratch};
use serde_json::Value;

fn gravisight(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gravisight")).args(arguments).current_dir(root()).output().unwrap()
}

fn json(arguments: &[&str]) -> Value {
    let output = gravisight(&[arguments, &["--json"]].concat());
    let errors = String::from_utf8_lossy(&output.stderr);
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{arguments:?}: {error}: {errors}"))
}

fn refused(arguments: &[&str]) -> String {
    let output = gravisight(arguments);
    assert!(!output.status.success(), "{arguments:?}");
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A page's sample and its camera.
fn sample(name: &str) -> [String; 2] {
    let folder = root().join("web/public/samples");
    let list: Vec<Value> = serde_json::from_slice(&std::fs::read(folder.join("samples.json")).unwrap()).unwrap();
    let camera = scratch(name).join("camera.json");
    std::fs::write(&camera, list[0]["camera"].to_string()).unwrap();
    [folder.join(list[0]["file"].as_str().unwrap()), camera].map(|path| path.to_str().unwrap().into())
}

#[test]
fn localise_measures_the_ball_in_the_region_and_the_scene_that_are_given() {
    let [picture, camera] = sample("options-localise");
    let base = ["localise", picture.as_str(), "--camera", camera.as_str(), "--device", "cpu"];
    let depth = |more: &[&str]| json(&[&base, more].concat())["depth"].as_f64().unwrap();
    let tennis = depth(&["--ball", "tennis"]);
    assert!((depth(&["--ball-radius", "0.0335"]) - tennis).abs() < 1e-9);
    assert!((depth(&["--ball", "0.067"]) / tennis - 2.0).abs() < 0.01);
    let plain = json(&[&base[..], &["--ball", "0.2"]].concat());
    assert!(plain.get("candidates").is_none(), "{plain}");
    let several = json(&[&base[..], &["--ball", "0.2", "--candidates", "4"]].concat());
    assert!(several["candidates"].as_array().unwrap().len() > 1);
    let corner = [0, 1].map(|axis| if plain["image"][axis].as_f64().unwrap() > 112.0 { 0 } else { 160 });
    let region = format!("{},{},64,64", corner[0], corner[1]);
    let inside = json(&[&base[..], &["--ball", "0.2", "--region", &region]].concat());
    for axis in 0..2 {
        let at = inside["image"][axis].as_f64().unwrap() - f64::from(corner[axis]);
        assert!((-0.5..=63.5).contains(&at), "{inside}");
    }
    // A place that ends before the ball: its detection is refused.
    let scene = scratch("options-scene").join("scene.json");
    let bounds = r#"{"gravity": [0, 0, -1], "ball": {"radius": 0.2}, "bounds": {"low": [2, 2, 0], "high": [3, 3, 1]}}"#;
    std::fs::write(&scene, bounds).unwrap();
    let elsewhere = json(&[&base[..], &["--scene", text(&scene)]].concat());
    assert!(plain["ball_found"] == true && elsewhere["ball_found"] == false, "{elsewhere}");
}

#[test]
fn saliency_and_evaluate_take_the_ball_that_is_given() {
    let [picture, camera] = sample("options-saliency-own");
    let out = scratch("options-saliency-metres").join("out.png");
    let base = ["saliency", picture.as_str(), "--camera", camera.as_str(), "--out", text(&out)];
    let depth = |more: &[&str]| json(&[&base, more].concat())["depth"].as_f64().unwrap();
    let small = depth(&["--ball-radius", "0.2"]);
    assert!((depth(&["--ball", "0.4"]) / small - 2.0).abs() < 0.01);
    let evaluate = ["evaluate", "--data", "tests/samples"];
    let off = |more: &[&str]| json(&[&evaluate, more].concat())["dtg"]["mean"].as_f64().unwrap();
    // Twice as large, each ball is twice as far away.
    let (own, wrong) = (off(&[]), off(&["--ball-radius", "0.4"]));
    assert!(own < 0.1 && wrong > 2.0, "{own} {wrong}");
    assert!((off(&["--ball", "0.4"]) - wrong).abs() < 1e-6);
}

#[test]
fn saliency_needs_the_balls_radius_for_metres_alone() {
    let [picture, camera] = sample("options-saliency");
    let out = scratch("options-saliency-out").join("out.png");
    let base = ["saliency", picture.as_str(), "--camera", camera.as_str(), "--out", text(&out)];
    let relative = json(&base);
    let metres = json(&[&base[..], &["--ball-radius", "0.2"]].concat());
    assert!(relative.get("depth").is_none() && relative.get("world").is_none(), "{relative}");
    let [fraction, full] = [&relative["saliency"]["full_fraction"], &metres["saliency"]["full_m"]];
    let depth = metres["depth"].as_f64().unwrap();
    assert!((full.as_f64().unwrap() / (fraction.as_f64().unwrap() * depth) - 1.0).abs() < 1e-3, "{fraction} {full}");
    let [a, b] = [&relative, &metres].map(|found| found["saliency"]["near"].as_f64().unwrap());
    assert!((a - b).abs() < 1e-6, "{a} {b}");
}

#[test]
fn evaluate_scores_what_it_is_told_to() {
    let base = ["evaluate", "--data", "tests/samples", "--model", "sd-l", "--device", "cpu"];
    let all = json(&base);
    let clips = std::fs::read_to_string(root().join("tests/samples/clips.jsonl")).unwrap();
    let first: Value = serde_json::from_str(clips.lines().next().unwrap()).unwrap();
    let id = first["id"].as_str().unwrap();
    let only = json(&[&base[..], &["--only", id]].concat());
    assert!(only["dtg"]["n"].as_u64().unwrap() < all["dtg"]["n"].as_u64().unwrap(), "{only}");
    let bins = |more: &[&str]| json(&[&base, more].concat())["dtg_binned"].clone();
    assert_eq!(bins(&["--bins", "2"]).as_array().unwrap().len(), 2);
    assert_ne!(bins(&["--z-min", "1"]), bins(&[]));
    assert_ne!(bins(&["--z-max", "30"]), bins(&[]));
    assert!(refused(&[&base[..], &["--z-min", "9", "--z-max", "5"]].concat()).contains("--z-min"));
    let folder = scratch("options-record");
    for end in ["json", "safetensors"] {
        std::fs::copy(root().join(format!("models/sd-l.{end}")), folder.join(format!("sd-l.{end}"))).unwrap();
    }
    let card = folder.join("sd-l.json");
    let before = std::fs::read_to_string(&card).unwrap();
    let model =
        ["evaluate", "--data", "tests/samples", "--only", id, "--record", "--device", "cpu", "--model", text(&card)];
    json(&model);
    assert_ne!(std::fs::read_to_string(&card).unwrap(), before);
}

/// A table tennis ball that is thrown up before a camera and bounces on the floor, or is hit back on its way.
fn thrown(name: &str, is_hit: bool) -> [std::path::PathBuf; 3] {
    let folder = scratch(name);
    let write = |name: &str, content: String| {
        let path = folder.join(name);
        std::fs::write(&path, content).unwrap();
        path
    };
    let camera = serde_json::json!({"width": 1280, "height": 720, "intrinsic": [[900, 0, 639.5], [0, 900, 359.5], [0, 0, 1]],
        "camera_from_world": [[1, 0, 0, 0], [0, 0, -1, 1], [0, 1, 0, 4], [0, 0, 0, 1]]});
    let mut moved = camera.clone();
    moved["camera_from_world"][2][3] = 4.5.into();
    let fall = |t: f64, z: f64, v: f64| z + v * t - 4.905 * t * t;
    let lands = (1.0 + (1.0_f64 + 4.0 * 4.905 * 0.98).sqrt()) / (2.0 * 4.905);
    let mut track = String::from("Frame,Visibility,X,Y\n");
    for frame in 0..40 {
        let t = f64::from(frame) / 50.0;
        let [x, z] = match t {
            t if is_hit && t > 0.4 => [-0.2 - 2.5 * (t - 0.4), fall(t - 0.4, fall(0.4, 1.0, 1.0), 3.0)],
            t if t < lands => [-1.0 + 2.0 * t, fall(t, 1.0, 1.0)],
            t => [-1.0 + 2.0 * t, fall(t - lands, 0.02, 0.8 * (9.81 * lands - 1.0))],
        };
        track += &format!("{frame},1,{},{}\n", 639.5 + 900.0 * x / 4.0, 359.5 + 900.0 * (1.0 - z) / 4.0);
    }
    let sigma = serde_json::json!({"one_sigma": [moved]}).to_string();
    [write("track.csv", track), write("camera.json", camera.to_string()), write("sigma.json", sigma)]
}

/// The same uncertainty, of the focal length alone: the camera with this one, px.
fn with_lens(sigma: &Path, focal: f64) -> PathBuf {
    let mut sigmas: Value = serde_json::from_str(&std::fs::read_to_string(sigma).unwrap()).unwrap();
    sigmas["one_sigma"][0]["camera_from_world"][2][3] = 4.into();
    (0..2).for_each(|axis| sigmas["one_sigma"][0]["intrinsic"][axis][axis] = focal.into());
    let path = sigma.with_file_name("lens.json");
    std::fs::write(&path, sigmas.to_string()).unwrap();
    path
}

/// `fit` of such a track.
fn fit(track: &Path, camera: &Path, more: &[&str]) -> Value {
    let given = ["fit", "--track", text(track), "--camera", text(camera), "--scene", "floor", "--fps", "50"];
    json(&[&given[..], &["--ball", "table-tennis"], more].concat())
}

#[test]
fn fit_counts_in_noise_camera_and_what_the_scene_does_not_know() {
    let [track, camera, sigma] = thrown("options-fit", false);
    let fit = |more: &[&str]| fit(&track, &camera, more);
    let plain = fit(&[]);
    let of = |found: &Value| found["frames"][10]["sigma"].as_f64().unwrap();
    let unsure = fit(&["--camera-sigma", text(&sigma)]);
    assert!(of(&unsure) > 1.5 * of(&plain), "{} {}", of(&unsure), of(&plain));
    // A camera elsewhere has the same speeds; with another lens those along its view differ.
    let speed = |found: &Value| found["flights"][0]["speed_sigma"].as_f64().unwrap();
    let lens = with_lens(&sigma, 1080.0);
    let unsure = fit(&["--camera-sigma", text(&lens)]);
    assert!(speed(&unsure) > 1.03 * speed(&plain), "{} {}", speed(&unsure), speed(&plain));
    assert_eq!(fit(&["--noise-px", "3"])["noise_px"], 3.0);
    let drag = |found: &Value| found["estimates"]["drag"]["sigma"].as_f64().unwrap();
    let unknown = fit(&["--estimate", "drag"]);
    assert!(drag(&unknown) > 1.5 * drag(&plain), "{} {}", drag(&unknown), drag(&plain));
}

#[test]
fn the_cameras_uncertainty_counts_where_the_ball_is_held_at_first() {
    let [track, camera, sigma] = thrown("options-held", false);
    // Twelve frames in a hand, then the throw.
    let text_of = std::fs::read_to_string(&track).unwrap();
    let mut lines = text_of.lines();
    let mut held = format!("{}\n", lines.next().unwrap());
    let flight: Vec<&str> = lines.map(|line| line.split_once(',').unwrap().1).collect();
    let all = std::iter::repeat_n(flight[0], 12).chain(flight.iter().copied());
    all.enumerate().for_each(|(frame, rest)| held += &format!("{frame},{rest}\n"));
    let held_track = track.with_file_name("held.csv");
    std::fs::write(&held_track, held).unwrap();
    let plain = fit(&held_track, &camera, &[]);
    let unsure = fit(&held_track, &camera, &["--camera-sigma", text(&with_lens(&sigma, 1080.0))]);
    assert_eq!(plain["flights"][0]["reason"], "the ball is held, or lies still, before it flies");
    let of = |found: &Value| {
        let speed = found["flights"].as_array().unwrap().last().unwrap()["speed_sigma"].as_f64().unwrap();
        (found["frames"][40]["sigma"].as_f64().unwrap(), speed)
    };
    let ((place, speed), (unsure_place, unsure_speed)) = (of(&plain), of(&unsure));
    assert!(unsure_place > 1.5 * place, "{unsure_place} {place}");
    assert!(unsure_speed > 1.5 * speed, "{unsure_speed} {speed}");
}

#[test]
fn a_camera_that_is_hardly_known_leaves_the_distance_unknown() {
    let [track, camera, sigma] = thrown("options-doubtful", false);
    let found = fit(&track, &camera, &["--camera-sigma", text(&with_lens(&sigma, 1800.0))]);
    assert_eq!(found["explained"], false);
    let reason = found["flights"][0]["reason"].as_str().unwrap();
    assert!(reason.contains("the camera is not known well enough"), "{reason}");
}

#[test]
fn fit_makes_no_more_hits_than_are_allowed() {
    let [track, camera, _] = thrown("options-hits", true);
    let hits = |more: &[&str]| fit(&track, &camera, more)["hits"].as_array().unwrap().len();
    assert_eq!([hits(&[]), hits(&["--hits", "1"]), hits(&["--hits", "0"])], [1, 1, 0]);
}

#[test]
fn forecast_is_as_exact_as_its_tolerance_and_solves_numerically_on_request() {
    let end = |base: &[&str], more: &[&str]| {
        let found = json(&[base, more].concat());
        assert_eq!(found["r"].as_array().unwrap().len(), 1, "{found}");
        found["r"].clone()
    };
    let flight = ["forecast", "--scene", "tennis", "--state", "0,0,1,2,20,3", "--times", "0.4"];
    assert_ne!(end(&flight, &["--tolerance", "1e-2"]), end(&flight, &["--tolerance", "1e-10"]));
    // A spring has a closed form.
    let scene = scratch("options-forecast").join("scene.json");
    let spring =
        r#"{"gravity": [0, 0, -9.81], "ball": {"radius": 0.1}, "spring": {"stiffness": 20, "anchor": [0, 0, 2]}}"#;
    std::fs::write(&scene, spring).unwrap();
    let flight = ["forecast", "--scene", text(&scene), "--state", "0,0,9,2,1,3", "--times", "0.7"];
    let coarse = ["--tolerance", "1e-3"];
    assert_eq!(end(&flight, &coarse), end(&flight, &[]));
    assert_ne!(end(&flight, &["--tolerance", "1e-3", "--numeric"]), end(&flight, &coarse));
}

#[test]
fn calibrate_estimates_what_it_is_told_to() {
    let points = scratch("options-calibrate").join("points.json");
    let text_of = r#"{"width": 1920, "height": 1080, "intrinsic": [[2500, 0, 959.5], [0, 2500, 539.5], [0, 0, 1]], "court": "tennis",
        "names": ["near doubles corner left", "near doubles corner right", "far doubles corner left", "far doubles corner right"],
        "image": [[312.5, 905.0], [1630.0, 897.5], [601.0, 322.0], [1297.0, 319.5]]}"#;
    std::fs::write(&points, text_of).unwrap();
    let focal = |more: &[&str]| {
        let found = json(&[&["calibrate", "--points", text(&points)], more].concat());
        found["camera"]["intrinsic"][0][0].as_f64().unwrap()
    };
    assert!(focal(&[]) == 2500.0 && (focal(&["--estimate", "focal"]) - 2500.0).abs() > 100.0);
}

#[test]
fn track_and_label_take_camera_ball_numbers_model_and_device() {
    let folder = scratch("options-track");
    let made = folder.join("made");
    let synth = ["synth", "--set", "sd-s", "--split", "test", "--clips", "1", "--seed", "7", "--out", text(&made)];
    assert!(gravisight(&synth).status.success());
    let clips = gravisight::Clips::read(&made).unwrap();
    let (clip, frames) = (&clips.clips[0], folder.join("frames"));
    std::fs::create_dir(&frames).unwrap();
    for (number, frame) in clip.frames.iter().enumerate() {
        std::fs::copy(clips.folder.join(&frame.file), frames.join(format!("{number}.png"))).unwrap();
    }
    let write = |name: &str, value: &Value| {
        let path = folder.join(name);
        std::fs::write(&path, value.to_string()).unwrap();
        path
    };
    let camera = serde_json::to_value(&clip.camera).unwrap();
    let mut moved = camera.clone();
    moved["camera_from_world"][2][3] = (camera["camera_from_world"][2][3].as_f64().unwrap() + 0.3).into();
    let sigma = write("sigma.json", &serde_json::json!({"one_sigma": [moved]}));
    let scene = write("scene.json", &serde_json::to_value(&clip.scene).unwrap());
    let camera = write("camera.json", &camera);
    let flat = ["track", text(&frames), "--fps", "15"];
    let place = [&flat[..], &["--camera", text(&camera), "--scene", text(&scene)]].concat();
    let with = |base: &[&str], more: &[&str]| json(&[base, more].concat());
    let plain = with(&place, &[]);
    let of = |found: &Value| found["frames"][10]["sigma"].as_f64().unwrap();
    assert!(of(&with(&place, &["--camera-sigma", text(&sigma)])) > 2.0 * of(&plain));
    // The clip's ball, twice as large, flies by no law.
    assert!(plain["explained"] == true && with(&place, &["--ball", "0.4"])["explained"] == false);
    let twice = ["track", text(&frames), "--fps", "30"];
    let time = |found: &Value| found["frames"][10]["time"].as_f64().unwrap();
    assert!((time(&plain) - 2.0 * time(&json(&twice))).abs() < 1e-9);
    // The configuration as it is printed changes nothing, and a number of it does; those that a file leaves out are the usual ones.
    let two_dimensional = with(&flat, &[]);
    let same = write("config.json", &two_dimensional["config"]);
    assert_eq!(with(&flat, &["--config", text(&same)]), two_dimensional);
    let differs = write("differs.json", &serde_json::json!({"tracklets": {"min_gain": 400.0}}));
    let changed = with(&flat, &["--config", text(&differs)]);
    assert!(changed["config"]["tracklets"]["min_gain"] == 400.0 && changed["frames"] != two_dimensional["frames"]);
    assert_eq!(changed["config"]["weights"], two_dimensional["config"]["weights"]);
    let wrong = write("wrong.json", &serde_json::json!({"tracklets": {"gate": 0}}));
    assert!(refused(&[&flat[..], &["--config", text(&wrong)]].concat()).contains("tracklets.gate"));
    assert!(refused(&[&flat[..], &["--hits", "many"]].concat()).contains("--hits"));
    let out = folder.join("labels");
    let label = ["label", text(&frames), "--camera", text(&camera), "--fps", "15", "--out", text(&out)];
    for command in [&flat[..], &label] {
        assert!(refused(&[command, &["--model", "no-such-model"]].concat()).contains("no-such-model"));
        // No such device in this build.
        if !cfg!(feature = "wgpu") {
            assert!(refused(&[command, &["--device", "wgpu"]].concat()).contains("--features wgpu"));
        }
    }
    with(&label, &["--scene", text(&scene)]);
    assert_eq!(gravisight::Clips::read(&out).unwrap().clips[0].scene, clip.scene);
}

#[test]
fn import_attaches_the_scene_cuts_clips_and_finds_pictures_elsewhere() {
    let folder = scratch("options-import");
    let fixtures = root().join("tests/golden/import");
    let [data, whole, cut] = [fixtures.join("sd"), folder.join("whole"), folder.join("cut")];
    let of = |out: &Path, more: &[&str]| {
        let base = ["import", "--from", "sd", text(&data), "--out", text(out)];
        let found = json(&[&base, more].concat());
        (found["clips"].clone(), gravisight::Clips::read(out).unwrap().clips[0].scene.clone())
    };
    let (clips, own) = of(&whole, &[]);
    let (pieces, floor) = of(&cut, &["--clip-frames", "4", "--scene", "floor"]);
    assert!(pieces.as_u64() > clips.as_u64(), "{pieces} {clips}");
    assert!(floor != own && floor == Some(gravisight::Scene::named("floor").unwrap()));
    // The annotations alone: their pictures are elsewhere.
    let alone = folder.join("instances.json");
    std::fs::copy(fixtures.join("coco/instances.json"), &alone).unwrap();
    let camera = fixtures.join("camera.json");
    let [none, found] = [folder.join("none"), folder.join("found")];
    let coco = |out: &Path, more: &[&str]| {
        let base = ["import", "--from", "coco", text(&alone), "--camera", text(&camera), "--fps", "30"];
        gravisight(&[&base[..], &["--category", "ball", "--out", text(out), "--json"], more].concat())
    };
    let frames = |output: &Output| {
        serde_json::from_slice::<Value>(&output.stdout).ok().and_then(|found| found["frames"].as_u64()).unwrap_or(0)
    };
    let images = fixtures.join("coco/images");
    let [without, with] = [coco(&none, &[]), coco(&found, &["--pictures", text(&images)])];
    assert!(frames(&without) == 0 && frames(&with) > 0, "{}", String::from_utf8_lossy(&with.stderr));
}

#[test]
fn synth_draws_what_its_options_say() {
    let folder = scratch("options-synth");
    let drawn = |name: &str, more: &[&str]| -> (Value, std::path::PathBuf) {
        let out = folder.join(name);
        let base =
            ["synth", "--set", "spring", "--split", "test", "--clips", "1", "--size", "64x64", "--out", text(&out)];
        let output = gravisight(&[&base, more].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let line = std::fs::read_to_string(out.join("clips.jsonl")).unwrap();
        (serde_json::from_str(line.lines().next().unwrap()).unwrap(), out)
    };
    let (plain, _) = drawn("plain", &[]);
    let (noisy, _) = drawn("noisy", &["--label-noise", "3"]);
    assert_ne!(plain["frames"][3]["image"], noisy["frames"][3]["image"]);
    assert_eq!(plain["frames"][3]["world"], noisy["frames"][3]["world"]);
    let (another, _) = drawn("another", &["--seed", "8"]);
    assert_ne!(plain["frames"][3]["world"], another["frames"][3]["world"]);
    let (_, deep) = drawn("deep", &["--depth"]);
    let depths = walk(&deep).into_iter().filter(|file| file.ends_with(".depth.png")).count();
    assert_eq!(depths, plain["frames"].as_array().unwrap().len());
    // One camera: a row of six pictures, the first with the ball's path, and the last with the last frame.
    let sheet = folder.join("sheet.png");
    let (shown, shots) = drawn("shown", &["--sheet", text(&sheet)]);
    let sheet = image::open(&sheet).unwrap().into_rgb8();
    assert_eq!(sheet.dimensions(), (6 * 64 + 5 * 4, 64));
    let frame = |frame: &Value| image::open(shots.join(frame["file"].as_str().unwrap())).unwrap().into_rgb8();
    let frames = shown["frames"].as_array().unwrap();
    let last = frame(frames.last().unwrap());
    assert_eq!(*image::imageops::crop_imm(&sheet, 5 * 68, 0, 64, 64).to_image(), *last);
    let [x, y] = [0, 1].map(|axis| frames[3]["image"][axis].as_f64().unwrap().floor() as u32);
    assert_eq!(sheet.get_pixel(x, y).0, [255, 230, 0]);
    let out = folder.join("windy");
    let wind = ["synth", "--set", "sd-s", "--split", "test", "--clips", "1", "--disturb", "wind", "--out", text(&out)];
    let calm = folder.join("calm");
    let still = ["synth", "--set", "sd-s", "--split", "test", "--clips", "1", "--out", text(&calm)];
    let ends = [wind.as_slice(), &still].map(|arguments| {
        assert!(gravisight(arguments).status.success(), "{arguments:?}");
        let out = Path::new(arguments.last().unwrap());
        let line = std::fs::read_to_string(out.join("clips.jsonl")).unwrap();
        let clip: Value = serde_json::from_str(line.lines().next().unwrap()).unwrap();
        clip["frames"][60]["world"].clone()
    });
    assert_ne!(ends[0], ends[1]);
}

/// All files below a folder.
fn walk(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.flat_map(|path| if path.is_dir() { walk(&path) } else { vec![path.to_str().unwrap().into()] }).collect()
}

#[test]
fn a_camera_of_four_coefficients_is_what_is_said_of_it() {
    let file = scratch("options-lens").join("four.yml");
    let text_of = "K: [800, 0, 319.5, 0, 800, 239.5, 0, 0, 1]\ndist: [0.1, 0.01, 0, 0]\nrvec: [0.1, 0.2, 0.3]\ntvec: [0.1, 0.2, 4]\n";
    std::fs::write(&file, text_of).unwrap();
    let base = ["camera", "import", text(&file), "--units", "m", "--world", "z-up", "--size", "640x480"];
    let asked = refused(&base);
    assert!(asked.contains("--lens"), "{asked}");
    let [flat, wide] = ["brown-conrady", "fisheye"].map(|lens| json(&[&base[..], &["--lens", lens]].concat()));
    assert_ne!(flat["camera"], wide["camera"]);
}

#[test]
fn train_starts_from_a_preset_on_the_folders_that_are_given() {
    let out = scratch("options-train").join("run");
    let nowhere = |more: &[&str]| refused(&[&["train", "--out", text(&out)], more].concat());
    assert!(nowhere(&["--preset", "abracadabra"]).contains("abracadabra"));
    let both = ["--preset", "quick", "--train", "no-such-train", "--validation", "no-such-validation"];
    assert!(nowhere(&both).contains("no-such-train"), "{}", nowhere(&both));
    let validation = ["--preset", "quick", "--train", "tests/samples", "--validation", "no-such-validation"];
    assert!(nowhere(&validation).contains("no-such-validation"), "{}", nowhere(&validation));
}

#[test]
fn train_says_what_it_made_and_where_it_cannot_run() {
    let folder = scratch("options-tiny");
    let [made, other] = [folder.join("made"), folder.join("other")];
    let phases = "phases=[{steps=2, batch=2, crop=32, learning_rate=1e-3}]";
    let train = |out: &Path, more: &[&str]| {
        let base = ["train", "--config", "tests/golden/tiny.toml", "--set", phases, "--out", text(out)];
        gravisight(&[&base, more].concat())
    };
    let said: Value = serde_json::from_slice(&train(&made, &["--json"]).stdout).unwrap();
    assert!(Path::new(said["card"].as_str().unwrap()).is_file(), "{said}");
    if !cfg!(feature = "wgpu") {
        let refused = train(&other, &["--device", "wgpu"]);
        assert!(String::from_utf8_lossy(&refused.stderr).contains("--features wgpu") && !other.exists());
    }
    let refused = train(&other, &["--device", "cuda"]);
    assert!(String::from_utf8_lossy(&refused.stderr).contains("--device wgpu") && !other.exists());
    // 40 degrees off no camera explains the labels.
    let refused = train(&other, &["--set", "supervision=physics-fit", "--set", "camera_off_degrees=40.0"]);
    assert!(!refused.status.success() && !other.exists(), "{}", String::from_utf8_lossy(&refused.stderr));
    let made: Value = serde_json::from_slice(&train(&other, &["--no-report", "--json"]).stdout).unwrap();
    assert!(made["report"].is_null() && !said["report"].is_null(), "{made}, {said}");
}

/// What is printed is a configuration: a run by it begins as one by the preset.
#[test]
fn train_prints_the_whole_configuration() {
    let run = gravisight(&["train", "--preset", "paper-compact", "--set", "seed=7", "--print"]);
    let printed = String::from_utf8(run.stdout).unwrap();
    let has = |line| printed.lines().any(|printed| printed == line);
    assert!(has("seed = 7") && has("clip_norm = 5.0") && has("name = \"paper-compact\""), "{printed}");
    let file = scratch("options-print").join("whole.toml");
    std::fs::write(&file, &printed).unwrap();
    let again = gravisight(&["train", "--config", text(&file), "--print"]);
    assert_eq!(String::from_utf8(again.stdout).unwrap(), printed);
}
