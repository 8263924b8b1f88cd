//! The command as a user meets it: results, formats, exit statuses, messages.

use std::path::PathBuf;
use std::process::{Command, Output, Stdio};

use crate::common::{golden, root, scratch};
use serde_json::Value;

/// Largest difference of a position from the golden one, m (px for 2D).
const TOLERANCE: f64 = 1e-3;

fn gravisight(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gravisight")).args(arguments).current_dir(root()).output().unwrap()
}

fn json(output: &Output) -> Value {
    let errors = String::from_utf8_lossy(&output.stderr);
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {errors}"))
}

/// The page's samples: file, and its camera written where the command can read it.
fn samples() -> Vec<(PathBuf, PathBuf, Value)> {
    let folder = root().join("web/public/samples");
    let list: Vec<Value> = serde_json::from_slice(&std::fs::read(folder.join("samples.json")).unwrap()).unwrap();
    let cameras = scratch(&format!("cameras-{:?}", std::thread::current().id()));
    let with_camera = |(index, sample): (usize, Value)| {
        let camera = cameras.join(format!("{index}.json"));
        std::fs::write(&camera, sample["camera"].to_string()).unwrap();
        (folder.join(sample["file"].as_str().unwrap()), camera, sample)
    };
    list.into_iter().enumerate().map(with_camera).collect()
}

fn text(path: &std::path::Path) -> &str {
    path.to_str().unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(values) => values.iter().flat_map(numbers).collect(),
        other => vec![other.as_f64().unwrap()],
    }
}

/// The browser's tests compare the page with the same file. `MAKE_REF=1` writes it anew, and fails.
#[test]
fn samples_are_found_where_the_golden_file_says() {
    let found: serde_json::Map<String, Value> = samples()
        .iter()
        .map(|(file, camera, sample)| {
            let model = ["--model", "sd-l", "--device", "cpu", "--json"];
            let output = gravisight(&[&["localise", text(file), "--camera", text(camera)], &model[..]].concat());
            (sample["file"].as_str().unwrap().to_string(), json(&output))
        })
        .collect();
    if std::env::var_os("MAKE_REF").is_some() {
        let text = serde_json::to_string_pretty(&found).unwrap() + "\n";
        std::fs::write(root().join("tests/golden/samples.json"), text).unwrap();
        panic!("tests/golden/samples.json was written anew");
    }
    let expected: Value = serde_json::from_slice(&golden("samples.json")).unwrap();
    assert_eq!(found.len(), expected.as_object().unwrap().len());
    for (file, found) in &found {
        for key in ["image", "depth", "camera", "world"] {
            for (found, expected) in numbers(&found[key]).iter().zip(numbers(&expected[file][key])) {
                assert!((found - expected).abs() < TOLERANCE, "{file} {key}: {found} {expected}");
            }
        }
        let confidence = found["confidence"].as_f64().unwrap();
        assert!((0.0..=1.0).contains(&confidence));
    }
}

#[test]
fn the_built_in_model_finds_the_samples_within_half_a_metre_and_two_pixels() {
    for (file, camera, sample) in samples() {
        let ball = ["--ball-radius", "0.2", "--json"];
        let output = gravisight(&[&["localise", text(&file), "--camera", text(&camera)], &ball[..]].concat());
        let found = json(&output);
        let distance = |key: &str| {
            let pairs = numbers(&found[key]).into_iter().zip(numbers(&sample[key]));
            pairs.map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
        };
        assert!(distance("world") < 0.5 && distance("image") < 2.0, "{}: {found}", file.display());
    }
}

#[test]
fn a_picture_without_a_ball_gives_little_confidence() {
    let flat = scratch("flat").join("flat.png");
    image::RgbImage::from_pixel(224, 224, image::Rgb([90, 90, 90])).save(&flat).unwrap();
    let camera = &samples()[0].1;
    for more in [["--model", "sd-l"], ["--ball", "tennis"]] {
        let localise = ["localise", text(&flat), "--camera", text(camera), "--json"];
        let found = json(&gravisight(&[&localise[..], &more].concat()));
        assert!(found["confidence"].as_f64().unwrap() < 0.2, "{found}");
    }
}

#[test]
fn the_model_of_rendered_scenes_is_taken_by_its_name_alone() {
    let (file, camera, _) = &samples()[0];
    let localise =
        |more: &[&str]| gravisight(&[&["localise", text(file), "--camera", text(camera), "--json"], more].concat());
    // Any photograph would get metres of scenes that it does not show.
    let asked = localise(&[]);
    let said = String::from_utf8_lossy(&asked.stderr).into_owned();
    assert!(asked.status.code() == Some(1) && asked.stdout.is_empty(), "{said}");
    assert!(said.contains("--ball-radius 0.0335") && said.contains("--ball tennis"), "{said}");
    assert_eq!(json(&localise(&["--model", "sd-l"]))["confidence_kind"], "heatmap-mass");
    assert_eq!(json(&localise(&["--ball", "tennis"]))["confidence_kind"], "ball-probability");
}

#[test]
fn a_radius_in_millimetres_is_refused_first_and_in_one_wording() {
    let (file, camera, _) = &samples()[0];
    let said = |arguments: &[&str]| {
        let output = gravisight(arguments);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(1) && output.stdout.is_empty(), "{arguments:?}: {said}");
        said
    };
    let scene = scratch("millimetres").join("scene.json");
    std::fs::write(&scene, r#"{"gravity": [0, 0, -9.81], "ball": {"radius": 33.5}}"#).unwrap();
    // None of the other files is there: the radius is looked at before them.
    for ball in [["--ball-radius", "33.5"], ["--ball", "33.5"]] {
        for command in [
            &["localise", "no.png", "--camera", "no.json"][..],
            &["saliency", "no.png", "--camera", "no.json", "--out", "out.png"],
            &["evaluate", "--data", "no-clips"],
        ] {
            let said = said(&[command, &ball].concat());
            assert!(said.contains("is 33.5 m, larger than any ball; if it is 33.5 mm, give 0.0335"), "{said}");
        }
    }
    let scene = text(&scene);
    for command in [
        &["localise", text(file), "--camera", text(camera), "--scene", scene][..],
        &["fit", "--track", "no.csv", "--camera", text(camera), "--scene", scene],
        &["track", "no.mp4", "--camera", text(camera), "--scene", scene],
        &["track", "no.mp4", "--camera", text(camera), "--scene", "tennis", "--ball", "33.5"],
    ] {
        let said = said(command);
        assert!(said.contains("is 33.5 m, larger than any ball; if it is 33.5 mm, give 0.0335"), "{said}");
    }
}

#[test]
fn several_pictures_give_one_object_a_line_with_their_files() {
    let samples = samples();
    let (a, b, camera) = (text(&samples[0].0), text(&samples[1].0), text(&samples[0].1));
    let output = gravisight(&["localise", a, b, "--camera", camera, "--ball", "0.2", "--json"]);
    let lines = String::from_utf8(output.stdout).unwrap();
    let files: Vec<Value> =
        lines.lines().map(|line| serde_json::from_str::<Value>(line).unwrap()["file"].clone()).collect();
    assert_eq!(files, [a, b]);
}

#[test]
fn words_and_an_overlay_for_people() {
    let (file, camera, _) = &samples()[0];
    let out = scratch("overlay").join("out.png");
    let localise = ["localise", text(file), "--camera", text(camera), "--ball", "0.2", "--overlay", text(&out)];
    let output = gravisight(&localise);
    let words = String::from_utf8(output.stdout).unwrap();
    for word in ["world", "camera", "px", "confidence"] {
        assert!(words.contains(word), "{words}");
    }
    let overlay = image::open(&out).unwrap().into_rgb8();
    let picture = image::open(file).unwrap().into_rgb8();
    assert_eq!(overlay.dimensions(), picture.dimensions());
    assert_ne!(overlay, picture);
    assert_eq!(std::fs::read_dir(out.parent().unwrap()).unwrap().count(), 1, "no temporary file is left");
}

#[test]
fn evaluate_prints_the_metrics_of_the_contract() {
    let output = gravisight(&["evaluate", "--data", "tests/samples", "--model", "models/sd-l", "--json"]);
    let metrics = json(&output);
    for key in ["dtg", "dtg_relative", "image_error_px"] {
        for field in ["mean", "std", "median", "n"] {
            assert!(metrics[key][field].is_number(), "{key}.{field}: {metrics}");
        }
    }
    for statistic in [&metrics["dtg_visible"], &metrics["seconds_per_picture"]["with_decoding"]] {
        assert!(statistic["mean"].is_number(), "{metrics}");
    }
    assert_eq!(metrics["calibration"].as_array().unwrap().len(), 10);
    assert!(metrics["calibration"][0]["near"].is_number() && metrics["calibration"][0]["dtg"]["n"].is_number());
    assert_eq!(metrics["dtg_binned"].as_array().unwrap().len(), 3);
    assert_eq!(metrics["per_camera"]["cam1"]["n"], 24);
    assert_eq!(metrics["per_environment"]["env1"]["n"], 24);
    let output = gravisight(&["evaluate", "--data", "tests/samples"]);
    assert!(String::from_utf8(output.stdout).unwrap().contains("DtG"));
}

#[test]
fn evaluate_writes_a_report_and_says_how_fast_it_was() {
    let out = scratch("report-command").join("report.html");
    let output = gravisight(&["evaluate", "--data", "tests/samples", "--report", text(&out)]);
    let words = String::from_utf8(output.stdout).unwrap();
    for word in ["DtG, ball visible", "network", "with decoding"] {
        assert!(words.contains(word), "{words}");
    }
    assert!(String::from_utf8(output.stderr).unwrap().contains("24/24 pictures"));
    assert!(std::fs::read_to_string(&out).unwrap().ends_with("</html>\n"));
    assert_eq!(gravisight(&["evaluate", "--data", "tests/samples", "--log", "log.jsonl"]).status.code(), Some(2));
}

#[test]
fn saliency_is_strongest_around_the_ball() {
    let (file, camera, _) = &samples()[0];
    let out = scratch("saliency").join("out.png");
    let arguments = ["saliency", text(file), "--camera", text(camera), "--model", "sd-l", "--out", text(&out)];
    let found = json(&gravisight(&[&arguments[..], &["--json"]].concat()));
    // The circle of 12 px is 0.9 % of the picture.
    assert!(found["saliency"]["near"].as_f64().unwrap() > 0.1, "{found}");
    assert!(found["saliency"]["full_m"].as_f64().unwrap() > 0.0);
    let drawn = image::open(&out).unwrap().into_rgb8();
    assert_eq!(drawn.dimensions(), image::open(file).unwrap().into_rgb8().dimensions());
    assert!(String::from_utf8(gravisight(&arguments).stdout).unwrap().contains("% within 12 px of the ball"));
    let refused = gravisight(&["saliency", text(file), "--camera", text(camera), "--out", "out.jpg"]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(String::from_utf8(refused.stderr).unwrap().contains("--out writes a PNG"));
}

#[test]
fn refused_input_is_one_line_and_status_1() {
    let (file, camera, _) = &samples()[0];
    let (file, camera) = (text(file), text(camera));
    let folder = scratch("refused");
    let bad = |name: &str, bytes: &[u8]| {
        let path = folder.join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    let picture = std::fs::read(file).unwrap();
    let truncated = bad("truncated.png", &picture[..picture.len() / 2]);
    let nonsense = bad("nonsense.json", b"{\"width\": 3}");
    let card = std::fs::read(root().join("models/sd-l.json")).unwrap();
    let lone = bad("lone.json", &card);
    let altered = scratch("altered").join("sd-l.json");
    std::fs::write(&altered, &card).unwrap();
    let mut weights = std::fs::read(root().join("models/sd-l.safetensors")).unwrap();
    *weights.last_mut().unwrap() ^= 1;
    std::fs::write(altered.with_extension("safetensors"), &weights).unwrap();
    let cases: [(&[&str], &str); 10] = [
        (&["localise", "no.png", "--camera", camera], "no.png"),
        (&["localise", file, "--camera", "no.json"], "no.json"),
        (&["localise", file, "--camera", text(&nonsense)], "height"),
        (&["localise", text(&truncated), "--camera", camera], "truncated.png"),
        (&["localise", file, "--camera", camera, "--model", text(&lone)], "sd-l.safetensors"),
        (&["localise", file, "--camera", camera, "--model", text(&altered)], "sha256"),
        (&["localise", file, file, "--camera", camera, "--overlay", "x.png"], "--overlay"),
        (&["evaluate", "--data", "no-folder"], "no-folder"),
        (&["train", "--config", "no.toml"], "no.toml"),
        (&["train", "--resume", "tests/samples"], "holds no run"),
    ];
    for (arguments, named) in cases {
        let output = gravisight(arguments);
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {message}");
        assert_eq!(message.lines().count(), 1, "{message}");
        assert!(message.contains(named), "{arguments:?}: {message}");
        assert!(message.matches("os error").count() <= 1, "{message}");
        assert!(output.stdout.is_empty());
    }
}

#[test]
fn wrong_usage_is_status_2_and_help_is_there() {
    assert_eq!(gravisight(&["localise"]).status.code(), Some(2));
    assert_eq!(gravisight(&["train"]).status.code(), Some(2));
    assert_eq!(gravisight(&["fly"]).status.code(), Some(2));
    for command in ["localise", "evaluate", "train"] {
        let output = gravisight(&[command, "--help"]);
        assert_eq!(output.status.code(), Some(0));
        assert!(String::from_utf8(output.stdout).unwrap().contains("--device"));
    }
}

#[test]
fn a_device_that_was_not_built_in_says_how_to_build_it() {
    if cfg!(feature = "wgpu") {
        return;
    }
    let (file, camera, _) = &samples()[0];
    let output = gravisight(&["localise", text(file), "--camera", text(camera), "--device", "wgpu"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8(output.stderr).unwrap().contains("--features wgpu"));
}

/// A scene, a camera and a track of the golden clips, in a folder.
fn track_files(name: &str) -> (PathBuf, Value) {
    let folder = scratch(name);
    let tracks: Value = serde_json::from_slice(&golden("tracks.json")).unwrap();
    let track = tracks[5].clone();
    std::fs::write(folder.join("camera.json"), track["camera"].to_string()).unwrap();
    std::fs::write(folder.join("scene.json"), track["scene"].to_string()).unwrap();
    let mut csv = String::from("Frame,Visibility,X,Y\n");
    for (frame, image) in track["image"].as_array().unwrap().iter().enumerate().filter(|(frame, _)| frame % 11 != 4) {
        csv += &match frame % 7 {
            3 => format!("{frame},0,0,0\n"),
            _ => format!("{frame},1,{},{}\n", image[0], image[1]),
        };
    }
    std::fs::write(folder.join("track.csv"), csv).unwrap();
    (folder, track)
}

fn fit(folder: &std::path::Path, more: &[&str]) -> Output {
    let file = |name: &str| folder.join(name).to_str().unwrap().to_string();
    let [track, camera, scene] = ["track.csv", "camera.json", "scene.json"].map(file);
    let mut arguments = vec!["fit", "--track", &track, "--camera", &camera, "--scene", &scene, "--fps", "15"];
    arguments.extend(more);
    gravisight(&arguments)
}

#[test]
fn fit_finds_the_trajectory_of_a_track_with_gaps() {
    let (folder, track) = track_files("fit");
    let out = folder.join("trajectory.csv");
    let found = json(&fit(&folder, &["--json", "--out", text(&out)]));
    let frames = found["frames"].as_array().unwrap();
    assert_eq!(frames.len(), 90);
    for frame in frames {
        let truth = numbers(&track["world"][frame["frame"].as_u64().unwrap() as usize]);
        let off = numbers(&frame["world"]).iter().zip(truth).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        assert!(off < 0.01, "{frame}");
    }
    assert_eq!(found["explained"], true);
    assert!(!found["impacts"].as_array().unwrap().is_empty());
    let csv = std::fs::read_to_string(&out).unwrap();
    assert!(csv.starts_with("Frame,time,x,y,z,vx,vy,vz,sigma,residual_x_px,residual_y_px,outlier\n"), "{csv}");
    assert_eq!(csv.lines().count(), 91);
    let words = String::from_utf8(fit(&folder, &[]).stdout).unwrap();
    for word in ["not seen", "touches", "1-σ", "px rms"] {
        assert!(words.contains(word), "{words}");
    }
}

#[test]
fn fit_takes_the_numbers_that_it_says_it_judged_by() {
    let (folder, _) = track_files("fit-config");
    let config = folder.join("config.json");
    let as_it_is = json(&fit(&folder, &["--json"]));
    std::fs::write(&config, as_it_is["config"].to_string()).unwrap();
    assert_eq!(json(&fit(&folder, &["--json", "--config", text(&config)])), as_it_is);
    let mut changed = as_it_is["config"].clone();
    changed["noise_px"] = 4.0.into();
    std::fs::write(&config, changed.to_string()).unwrap();
    let noisier = json(&fit(&folder, &["--json", "--config", text(&config)]));
    assert_eq!(noisier["config"], changed);
    let evidence = |fit: &Value| fit["summary"]["log_evidence"].as_f64().unwrap();
    assert!(evidence(&noisier) < evidence(&as_it_is), "{} {}", noisier["summary"], as_it_is["summary"]);
    for (value, words) in [(Value::from(-1.0), "config: `noise_px` must be positive"), (Value::Null, "config.json")] {
        changed["noise_px"] = value;
        std::fs::write(&config, changed.to_string()).unwrap();
        let message = String::from_utf8(fit(&folder, &["--config", text(&config)]).stderr).unwrap();
        assert!(message.contains(words), "{message}");
    }
}

#[test]
fn fit_refuses_in_one_line() {
    let (folder, _) = track_files("fit-refused");
    let refused = |output: Output, words: &str| {
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{message}");
        assert!(message.contains(words) && message.lines().count() == 1, "{message}");
    };
    refused(fit(&folder, &["--noise-px", "0"]), "--noise-px must be positive");
    refused(fit(&folder, &["--estimate", "restitution"]), "`bounce` only");
    refused(fit(&folder, &["--estimate", "spin,spin"]), "twice");
    for (csv, words) in [
        ("x,y\n1,2\n", "no column `Frame`"),
        ("Frame,Visibility,X,Y\n0,1,1,1\n", "labelled in 1 frames"),
        ("Frame,Visibility,X,Y\n0,1,1,1\n0,1,2,2\n", "must ascend"),
        ("Frame,Visibility,X,Y\n0,1,nan,1\n", "track.csv:2: `X` must be a finite number"),
        ("Frame,Visibility,X,Y\n0,1,one,1\n", "track.csv"),
        ("Frame,Visibility,X,Y\n0,1,1,1\n9999999999,1,1,1\n", "split the track"),
    ] {
        std::fs::write(folder.join("track.csv"), csv).unwrap();
        refused(fit(&folder, &[]), words);
    }
}

#[test]
fn forecast_prints_states_and_jacobians() {
    let (folder, _) = track_files("forecast");
    let scene = folder.join("scene.json");
    let run = |more: &[&str]| {
        let mut arguments =
            vec!["forecast", "--scene", text(&scene), "--state", "-1.5,-1.5,1,0,0,0", "--times", "0.5,-0.1"];
        arguments.extend(more);
        gravisight(&arguments)
    };
    let found = json(&run(&["--json", "--jacobian"]));
    // free fall under 1 m/s²
    assert!((found["r"][0][2].as_f64().unwrap() - 0.875).abs() < 1e-9, "{found}");
    assert!((found["v"][1][2].as_f64().unwrap() - 0.1).abs() < 1e-9, "{found}");
    assert!((found["jacobian"][0][2][5].as_f64().unwrap() - 0.5).abs() < 1e-9, "{found}");
    assert_eq!(found["status"], "ok");
    assert!(String::from_utf8(run(&[]).stdout).unwrap().contains("0.87500"));
    assert_eq!(
        gravisight(&["forecast", "--scene", text(&scene), "--state", "1,2", "--times", "1"]).status.code(),
        Some(2)
    );
    assert_eq!(gravisight(&["forecast"]).status.code(), Some(2));
    let lost = gravisight(&["forecast", "--scene", text(&scene), "--state", "0,0,900,5000,0,0", "--times", "5"]);
    let message = String::from_utf8(lost.stderr).unwrap();
    assert_eq!(lost.status.code(), Some(1));
    assert!(message.contains("left the region at t = 5.0000 s") && message.lines().count() == 1, "{message}");
}

#[test]
fn forecast_fills_in_the_reference_cases() {
    let path = root().join("tests/golden/forecast_penalty.json");
    let found = json(&gravisight(&["forecast", "--cases", text(&path)]));
    let expected: Value = serde_json::from_slice(&golden("forecast_penalty.json")).unwrap();
    let cases = found["cases"].as_array().unwrap();
    assert_eq!(cases.len(), expected["cases"].as_array().unwrap().len());
    for (found, expected) in cases.iter().zip(expected["cases"].as_array().unwrap()) {
        assert_eq!(found["name"], expected["name"]);
        if found["status"] == "start-inside" {
            continue;
        }
        for (a, b) in numbers(&found["r"]).iter().zip(numbers(&expected["r"])) {
            assert!((a - b).abs() < 1e-8, "{}", found["name"]);
        }
        assert_eq!(found["jacobian"].as_array().unwrap().len(), found["times"].as_array().unwrap().len());
    }
}

#[test]
fn a_training_that_is_killed_goes_on_to_the_same_weights() {
    let folder = scratch("killed");
    let start = |name: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_gravisight"));
        let out = folder.join(name);
        command.args([
            "train",
            "--config",
            "tests/golden/tiny.toml",
            "--out",
            text(&out),
            "--set",
            "checkpoint_every=3",
        ]);
        command.args([
            "--set",
            "phases=[{steps=60, batch=4, crop=32, learning_rate=1e-3}]",
            "--set",
            "validate_every=20",
        ]);
        (command.current_dir(root()).stderr(Stdio::null()).stdout(Stdio::null()).spawn().unwrap(), out)
    };
    let (mut whole, expected) = start("whole");
    assert!(whole.wait().unwrap().success());
    let (mut running, out) = start("killed");
    let checkpoints = out.join("checkpoints");
    let last = || {
        let names = std::fs::read_dir(&checkpoints).into_iter().flatten().flatten();
        names.filter_map(|entry| entry.file_name().into_string().ok()).filter(|name| !name.starts_with('.')).count()
    };
    while last() == 0 {
        assert!(running.try_wait().unwrap().is_none(), "it ended before it could be killed");
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    running.kill().unwrap();
    running.wait().unwrap();
    let model = |folder: &std::path::Path| {
        let mut names = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
        names.find(|path| path.extension().is_some_and(|extension| extension == "safetensors"))
    };
    assert_eq!(model(&out), None, "it was killed too late");
    let resumed = gravisight(&["train", "--resume", text(&out)]);
    assert!(resumed.status.success(), "{}", String::from_utf8_lossy(&resumed.stderr));
    let weights = |folder| std::fs::read(model(folder).unwrap()).unwrap();
    assert!(weights(&out) == weights(&expected), "the weights differ");
}

#[test]
fn a_synthetic_set_is_gone_on_with_after_a_kill_and_can_be_read() {
    let out = scratch("synth").join("set");
    let synth = |split: &str, clips: &str| {
        gravisight(&["synth", "--set", "sd-s", "--split", split, "--out", text(&out), "--clips", clips, "--json"])
    };
    assert_eq!(json(&synth("val", "1"))["frames_drawn"], 90);
    let first = std::fs::read(out.join("frames/val_e1_c1_0000/045.png")).unwrap();
    // A kill leaves a hidden folder and no index.
    std::fs::remove_file(out.join("clips.jsonl")).unwrap();
    std::fs::create_dir(out.join("frames/.val_e1_c1_0001.1.tmp")).unwrap();
    let whole = json(&synth("val", "2"));
    assert_eq!((&whole["frames"], &whole["frames_drawn"]), (&Value::from(180), &Value::from(90)));
    assert_eq!(std::fs::read(out.join("frames/val_e1_c1_0000/045.png")).unwrap(), first);
    let clips = gravisight::Clips::read(&out).unwrap();
    assert_eq!(clips.clips.len(), 2);
    assert!(clips.picture(&clips.clips[1], &clips.clips[1].frames[89]).is_ok());
    let other = synth("train", "1");
    assert_eq!(other.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&other.stderr).contains("choose another --out"));
}

#[cfg(not(all(feature = "mujoco", libmujoco)))]
#[test]
fn a_build_without_mujoco_says_how_to_get_one() {
    let out = scratch("mujoco").join("set");
    let arguments = ["synth", "--set", "sd-s", "--split", "val", "--engine", "mujoco", "--out", text(&out)];
    let refused = gravisight(&arguments);
    let errors = String::from_utf8_lossy(&refused.stderr);
    assert_eq!((refused.status.code(), errors.lines().count()), (Some(1), 1), "{errors}");
    assert!(errors.contains("scripts/mujoco") && !out.exists(), "{errors}");
}

/// A table tennis ball that bounces once, seen from the side: a scene in which its spin matters and is unknown.
fn thrown(folder: &std::path::Path, bounces: bool) -> std::path::PathBuf {
    let scene = r#"{"gravity": [0, 0, -9.81], "ball": {"radius": 0.02}, "floor": {"height": 0}}"#;
    std::fs::write(folder.join("scene.json"), scene).unwrap();
    let camera = r#"{"width": 1280, "height": 720, "intrinsic": [[1200, 0, 639.5], [0, 1200, 359.5], [0, 0, 1]],
        "camera_from_world": [[1, 0, 0, 0], [0, 0, -1, 0.8], [0, 1, 0, 4], [0, 0, 0, 1]]}"#;
    std::fs::write(folder.join("camera.json"), camera).unwrap();
    let scene = gravisight::Scene::from_json(scene, "scene").unwrap().with_ball("table-tennis").unwrap();
    let start = gravisight::State {
        position: nalgebra::Point3::new(-1.3, 0.1, if bounces { 0.8 } else { 1.2 }),
        velocity: nalgebra::Vector3::new(3.5, 0.2, 0.5),
        spin: nalgebra::Vector3::new(0.0, 120.0, 30.0),
    };
    let times: Vec<f64> = (0..if bounces { 50 } else { 25 }).map(|frame| f64::from(frame) / 60.0).collect();
    let forecast = gravisight::Forecaster::new(&scene).unwrap().forecast(&start, &times);
    let camera = gravisight::Camera::from_json(camera, "camera").unwrap();
    let mut track = String::from("Frame,Visibility,X,Y\n");
    for (frame, state) in forecast.states.iter().enumerate() {
        let at = camera.image_from_world(&state.position).unwrap();
        track += &format!("{frame},1,{:.1},{:.1}\n", at.x, at.y);
    }
    std::fs::write(folder.join("track.csv"), track).unwrap();
    folder.join("plot.html")
}

#[test]
fn fit_of_an_unknown_spin_says_whether_it_knows_how_far_away_the_ball_is() {
    let folder = scratch("fit-spin");
    let fit = |more: &[&str]| {
        let file = |name: &str| folder.join(name).to_str().unwrap().to_string();
        let [track, camera, scene] = ["track.csv", "camera.json", "scene.json"].map(file);
        let mut arguments = vec!["fit", "--track", &track, "--camera", &camera, "--scene", &scene, "--fps", "60"];
        arguments.extend(["--ball", "table-tennis"]);
        arguments.extend(more);
        gravisight(&arguments)
    };
    let plot = thrown(&folder, true);
    let output = fit(&["--json", "--plot", text(&plot)]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let found = json(&output);
    assert_eq!(found["flights"].as_array().unwrap().len(), 1, "{found}");
    assert_eq!(found["hits"].as_array().unwrap().len(), 0);
    assert_eq!(found["impacts"][0]["surface"], "floor");
    assert!(found["verdict"].as_str().unwrap().starts_with("explained"));
    assert!(found["frames"].as_array().unwrap().iter().all(|frame| frame["flight"] == 0));
    let page = std::fs::read_to_string(&plot).unwrap();
    assert!(page.contains("<svg") && page.contains("floor") && page.ends_with("</html>\n"));
    let words = String::from_utf8(fit(&[]).stdout).unwrap();
    assert!(words.starts_with("explained: 1 flight, 0 hits, 1 bounce\n"), "{words}");
    // Without a contact nothing tells: that is said, and the exit status says so.
    thrown(&folder, false);
    let output = fit(&["--json"]);
    assert_eq!(output.status.code(), Some(3));
    let found = json(&output);
    assert_eq!(found["explained"], false);
    assert!(found["flights"][0]["reason"].as_str().unwrap().contains("distance is unknown"), "{found}");
    let message = String::from_utf8(fit(&["--hits", "many"]).stderr).unwrap();
    assert!(message.contains("auto"), "{message}");
}
