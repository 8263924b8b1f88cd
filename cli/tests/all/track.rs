//! A clip in, metres out: `gravisight track` as a user meets it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::common::{median, root, scratch};
use gravisight::{Camera, Clip, Clips, Scene, Track};
use serde_json::Value;

fn gravisight(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gravisight")).args(arguments).current_dir(root()).output().unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A clip of the paper's first scene, its frames copied as `0.png`, `1.png`, …, with its camera and scene.
fn sample(name: &str, index: usize) -> (Clip, PathBuf) {
    let folder = scratch(name);
    let made = folder.join("made");
    let arguments = ["synth", "--set", "sd-s", "--split", "test", "--clips", "2", "--seed", "7", "--out", text(&made)];
    let output = gravisight(&arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let clips = Clips::read(&made).unwrap();
    let clip = clips.clips[index].clone();
    std::fs::create_dir(folder.join("frames")).unwrap();
    for (number, frame) in clip.frames.iter().enumerate() {
        std::fs::copy(clips.folder.join(&frame.file), folder.join(format!("frames/{number}.png"))).unwrap();
    }
    std::fs::write(folder.join("camera.json"), serde_json::to_string(&clip.camera).unwrap()).unwrap();
    std::fs::write(folder.join("scene.json"), serde_json::to_string(&clip.scene).unwrap()).unwrap();
    (clip, folder)
}

fn distance<const N: usize>(found: &Value, truth: [f64; N]) -> f64 {
    let off = |axis: usize| found[axis].as_f64().unwrap() - truth[axis];
    (0..N).map(|axis| off(axis).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn a_video_without_a_calibration_is_measured_by_a_phone_that_is_assumed() {
    let clip = "web/public/real/toss_wall.mp4";
    let place = ["track", clip, "--scene", "free", "--ball", "0.0335", "--json"];
    let flight = |phone: &str| {
        let output = gravisight(&[&place[..], &[phone]].concat());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        // 3: the first frames, in the hand, may be a flight of their own that nothing explains.
        assert!(matches!(output.status.code(), Some(0 | 3)), "{said}");
        let found: Value = serde_json::from_slice(&output.stdout).unwrap();
        let flight = found["flights"].as_array().unwrap().last().unwrap();
        assert!(flight["explained"] == true && flight["start"].as_f64().unwrap() < 0.1, "{flight}");
        let number = |name: &str| flight[name].as_f64().unwrap();
        (said, number("speed_start"), number("speed_sigma"), found["frames"][15]["sigma"].as_f64().unwrap())
    };
    let (said, speed, sigma, unsure) = flight("--assume-phone");
    assert!(said.contains("Assumed, not measured") && said.contains("26 mm"), "{said}");
    // By the page, with the same assumption: 4.61 ± 0.09 m/s at 0.03 s; half a metre a second less at 0.08 s.
    assert!((speed - 4.4).abs() < 0.4 && (0.02..0.3).contains(&sigma), "{speed} ± {sigma}");
    let (said, _, _, surer) = flight("--assume-phone=26");
    assert!(said.contains("26 mm equivalent, which the file or a person states"), "{said}");
    assert!(surer < unsure, "{surer} {unsure}");
}

#[test]
fn a_clip_becomes_flights_in_metres() {
    for index in [0, 1] {
        let (clip, folder) = sample("metres", index);
        let [frames, camera, scene, track, page] =
            ["frames", "camera.json", "scene.json", "track.csv", "report.html"].map(|name| folder.join(name));
        let fps = clip.fps.to_string();
        let output = gravisight(&[
            "track",
            text(&frames),
            "--fps",
            &fps,
            "--camera",
            text(&camera),
            "--scene",
            text(&scene),
            "--out",
            text(&track),
            "--report",
            text(&page),
            "--json",
        ]);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{said}");
        let found: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert!(found["verdict"].as_str().unwrap().starts_with("explained"), "{}", found["verdict"]);
        let frames = found["frames"].as_array().unwrap();
        assert_eq!(frames.len(), clip.frames.len());
        let (mut in_picture, mut in_space) = (vec![], vec![]);
        for (number, (found, truth)) in frames.iter().zip(&clip.frames).enumerate() {
            assert_eq!(found["frame"], number);
            if !found["image"].is_null() {
                in_picture.push(distance(&found["image"], truth.image.unwrap()));
                assert!(found["confidence"].as_f64().unwrap() > 0.5);
            }
            in_space.push(distance(&found["world"], truth.world.unwrap()));
            assert!(found["sigma"].as_f64().unwrap() > 0.0 && found["flight"] == 0);
        }
        let near = in_picture.iter().filter(|&&off| off < 1.0).count();
        assert!(near as f64 >= 0.99 * clip.frames.len() as f64, "{near} of {} within 1 px", clip.frames.len());
        assert!(median(&in_space) < 0.03, "{} m", median(&in_space));
        assert_eq!(found["flights"].as_array().unwrap().len(), 1);
        assert!(found["hits"].as_array().unwrap().is_empty());
        let bounces = found["bounces"].as_array().unwrap();
        assert!(!bounces.is_empty() && bounces.iter().all(|bounce| bounce["sigma"].as_f64().unwrap() > 0.0));
        let findings = &found["findings"];
        assert!(findings["headline"].as_str().unwrap().starts_with("The flight is explained"), "{findings}");
        assert_eq!(findings["precise"].as_array().unwrap().len(), clip.frames.len());
        let drawn = findings["plan"]["bounces"].as_array().unwrap();
        assert_eq!(drawn.len(), bounces.len());
        for (spot, bounce) in drawn.iter().zip(bounces) {
            let sigma = [0, 1].map(|axis| spot["sigma"][axis].as_f64().unwrap());
            // The ellipse is of the place alone: the scalar of all three directions is larger.
            assert!(sigma[0] >= sigma[1] && sigma[1] > 0.0 && sigma[0] <= bounce["sigma"].as_f64().unwrap(), "{spot}");
        }
        // What `fit` takes.
        let track = Track::from_file(&track).unwrap();
        assert!(track.points.len() == clip.frames.len() && track.points[40].radius.is_some());
        let page = std::fs::read_to_string(&page).unwrap();
        let headline = found["findings"]["headline"].as_str().unwrap();
        for said in [
            "In space, with its shadow",
            headline,
            "Top view",
            "Bounces by number",
            "<ellipse",
            "The ball in the picture",
        ] {
            assert!(page.contains(said), "{said}");
        }
    }
}

#[test]
fn frames_that_are_doubtful_are_shown_in_the_report() {
    let (clip, folder) = sample("doubtful", 0);
    let frame = |number: usize| folder.join(format!("frames/{number}.png"));
    let elsewhere = image::open(frame(85)).unwrap().into_rgb8();
    // Something hides the ball for eight frames.
    for number in 40..48 {
        let mut picture = image::open(frame(number)).unwrap().into_rgb8();
        let [x, y] = clip.frames[number].image.unwrap().map(|at| (at - 25.0).clamp(0.0, 173.0) as u32);
        let patch = image::imageops::crop_imm(&elsewhere, x, y, 50, 50).to_image();
        image::imageops::replace(&mut picture, &patch, x.into(), y.into());
        picture.save(frame(number)).unwrap();
    }
    let [frames, camera, scene, page] =
        ["frames", "camera.json", "scene.json", "report.html"].map(|name| folder.join(name));
    let place = ["--camera", text(&camera), "--scene", text(&scene), "--report", text(&page)];
    let output = gravisight(&[&["track", text(&frames), "--fps", "15"], place.as_slice()].concat());
    assert!([Some(0), Some(3)].contains(&output.status.code()), "{}", String::from_utf8_lossy(&output.stderr));
    let page = std::fs::read_to_string(&page).unwrap();
    let (_, doubts) = page.split_once("Doubtful frames").expect("the chapter");
    assert!(doubts.contains("no ball found from frame 40 to 4"), "{}", &doubts[..doubts.len().min(400)]);
    assert!(doubts.contains("data:image/png"), "no picture");
}

#[test]
fn without_a_camera_there_is_a_track_alone() {
    let (clip, folder) = sample("flat", 0);
    let output = gravisight(&["track", text(&folder.join("frames")), "--fps", "15", "--json"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(found.get("explained"), Some(&Value::Null));
    for list in ["flights", "hits", "bounces"] {
        assert!(found[list].as_array().unwrap().is_empty(), "{list}");
    }
    let frames = found["frames"].as_array().unwrap();
    assert_eq!(frames.len(), clip.frames.len());
    for (found, truth) in frames.iter().zip(&clip.frames) {
        for metres in ["world", "sigma", "speed", "flight", "explained"] {
            assert_eq!(found.get(metres), Some(&Value::Null), "{metres} of {found}");
        }
        assert!(found["image"].is_null() || distance(&found["image"], truth.image.unwrap()) < 1.0, "{found}");
    }
    let seen = frames.iter().filter(|frame| !frame["image"].is_null()).count();
    assert!(seen >= 85, "{seen} of {} frames", frames.len());
}

#[test]
fn of_several_labels_for_a_frame_the_last_counts() {
    let (clip, folder) = sample("labels", 0);
    let frames = folder.join("frames");
    let track = |labels: &[&str]| {
        let mut arguments = vec!["track", text(&frames), "--fps", "15"];
        for label in labels {
            arguments.extend(["--seed-label", *label]);
        }
        let output = gravisight(&arguments);
        let [words, notes] = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes).into_owned());
        assert!(output.status.success(), "{notes}");
        (words, notes)
    };
    let [x, y] = clip.frames[3].image.unwrap();
    let (ball, beside) = (format!("3,{x},{y}"), "3,1,1");
    let unused = "no moving object passes through the ball marked at (1, 1) px in frame 3";
    let replaced = "is replaced by the later one in the same frame";
    let (alone, notes) = track(&[&ball]);
    assert!(!alone.contains(unused) && !notes.contains("--seed-label"), "{alone} {notes}");
    let (words, notes) = track(&[beside, &ball]);
    assert!(words == alone && notes.contains(replaced), "{words} {notes}");
    let (words, notes) = track(&[&ball, beside]);
    assert!(words.contains(unused) && notes.contains(replaced), "{words} {notes}");
}

#[test]
fn a_report_without_a_camera_shows_the_track_and_how_to_get_metres() {
    let (clip, folder) = sample("flat-report", 0);
    let page = folder.join("report.html");
    let output = gravisight(&["track", text(&folder.join("frames")), "--fps", "15", "--report", text(&page)]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let page = std::fs::read_to_string(&page).unwrap();
    let frames = clip.frames.len();
    for said in
        [&format!("of {frames} frames"), "The ball in the picture", "--camera camera.json", "Where the ball was found"]
    {
        assert!(page.contains(said), "{said}");
    }
    assert!(!page.contains("In space"));
}

#[test]
fn a_film_is_read_and_one_with_the_ball_marked_written() {
    let (_, folder) = sample("film", 0);
    let video = folder.join("film.mkv");
    let mut encode = Command::new("ffmpeg");
    encode.current_dir(&folder).args(["-v", "error", "-framerate", "15", "-i", "frames/%d.png", "-c:v", "ffv1"]);
    let status = encode.arg(&video).status();
    assert!(status.expect("this test needs ffmpeg: scripts/setup --browser").success());
    let marked = folder.join("marked.mp4");
    let output = gravisight(&["track", text(&video), "--overlay", text(&marked), "--json"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    let seen = found["frames"].as_array().unwrap().iter().filter(|frame| !frame["image"].is_null()).count();
    assert!(seen >= 85, "{seen}");
    assert!((found["frames"][30]["time"].as_f64().unwrap() - 2.0).abs() < 0.01);
    assert!(marked.metadata().unwrap().len() > 1000);
    let left =
        std::fs::read_dir(&folder).unwrap().filter(|it| text(&it.as_ref().unwrap().path()).contains("unfinished"));
    assert_eq!(left.count(), 0);
}

#[test]
fn no_ball_is_an_answer() {
    let (clip, folder) = sample("no_ball", 0);
    let frames = folder.join("frames");
    for number in 1..clip.frames.len() {
        std::fs::copy(frames.join("0.png"), frames.join(format!("{number}.png"))).unwrap();
    }
    let output = gravisight(&["track", text(&frames), "--fps", "15", "--json"]);
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(
        output.status.code() == Some(1) && found["verdict"].as_str().unwrap().starts_with("no flying ball"),
        "{found}"
    );
}

#[test]
fn bad_input_is_refused_in_words() {
    let (_, folder) = sample("refused", 0);
    let frames = folder.join("frames");
    let (frames, camera) = (text(&frames), folder.join("camera.json"));
    let other = folder.join("other.json");
    let wide = std::fs::read_to_string(&camera).unwrap().replace("\"width\":224", "\"width\":448");
    std::fs::write(&other, wide).unwrap();
    let broken = folder.join("broken.mp4");
    std::fs::write(&broken, b"no film").unwrap();
    let (camera, other, broken) = (text(&camera), text(&other), text(&broken));
    let cases: [(&[&str], &str); 8] = [
        (&[frames], "--fps (frames per second) is needed"),
        (&["no/such/film.mp4"], "no such video"),
        (&[broken], "broken.mp4"),
        (&["src", "--fps", "15"], "no PNG"),
        (&[frames, "--fps", "15", "--seed-label", "900,3,3"], "the last frame is 89"),
        (&[frames, "--fps", "15", "--camera", camera, "--scene", "curling"], "table-tennis"),
        (&[frames, "--fps", "15", "--camera", camera, "--scene", "floor", "--ball", "33.5"], "mm"),
        (&[frames, "--fps", "15", "--camera", other, "--scene", "floor"], "448"),
    ];
    for (arguments, named) in cases {
        let output = gravisight(&[&["track"], arguments].concat());
        let message = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(1) && message.contains(named), "{arguments:?}: {message}");
    }
    let half = gravisight(&["track", frames, "--fps", "15", "--camera", camera]);
    assert!(half.status.code() == Some(2) && String::from_utf8_lossy(&half.stderr).contains("--scene"));
}

#[test]
fn a_sports_scene_can_be_printed_and_used() {
    let listed = String::from_utf8(gravisight(&["scene"]).stdout).unwrap();
    assert!(listed.lines().any(|name| name == "tennis") && listed.lines().count() == Scene::names().len());
    let printed = String::from_utf8(gravisight(&["scene", "volleyball"]).stdout).unwrap();
    assert_eq!(Scene::from_json(&printed, "printed").unwrap(), Scene::named("volleyball").unwrap());
    let unknown = gravisight(&["scene", "curling"]);
    assert!(unknown.status.code() == Some(1) && String::from_utf8_lossy(&unknown.stderr).contains("squash"));
}

#[test]
fn footage_of_sports_is_made_with_its_truth() {
    let folder = scratch("footage");
    let arguments = ["synth", "--set", "broadcast", "--split", "val", "--clips", "1", "--out", text(&folder), "--json"];
    let output = gravisight(&arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let said: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(said["clips"], 4);
    for kind in ["tennis", "table-tennis", "volleyball", "toss"] {
        let file = |ending: &str| folder.join(format!("{kind}-000.{ending}"));
        assert!(file("mp4").metadata().unwrap().len() > 10_000, "{kind}");
        let truth = Track::from_file(&file("truth.csv")).unwrap();
        assert!(truth.points.iter().filter(|point| point.visibility > 0).count() > 10, "{kind}");
        Scene::from_file(&file("scene.json")).unwrap();
        let contacts: Value = serde_json::from_slice(&std::fs::read(file("truth.json")).unwrap()).unwrap();
        assert!(contacts["hits"].is_array() && contacts["bounces"].is_array());
    }
    // What is there is not made again.
    let before = folder.join("toss-000.mp4").metadata().unwrap().modified().unwrap();
    assert!(gravisight(&arguments).status.success());
    assert_eq!(folder.join("toss-000.mp4").metadata().unwrap().modified().unwrap(), before);
}

#[test]
fn hard_footage_is_made_with_a_camera_a_frame_and_clips_without_a_ball() {
    let folder = scratch("hard-footage");
    let arguments = ["synth", "--set", "footage", "--split", "val", "--clips", "1", "--out", text(&folder), "--json"];
    let output = gravisight(&arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let said: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(said["clips"], 5);
    for kind in ["tennis", "table-tennis", "volleyball", "toss", "empty"] {
        let file = |ending: &str| folder.join(format!("{kind}-000.{ending}"));
        let json = |ending: &str| serde_json::from_slice::<Value>(&std::fs::read(file(ending)).unwrap()).unwrap();
        let about = json("truth.json");
        let mut table = csv::Reader::from_path(file("truth.csv")).unwrap();
        let truth: Vec<BTreeMap<String, f64>> = table.deserialize().map(Result::unwrap).collect();
        assert_eq!(truth.iter().any(|row| row["Visibility"] > 0.0), kind != "empty", "{kind}");
        assert_eq!(about["ball"], kind != "empty");
        for repeated in about["repeated"].as_array().unwrap() {
            let frame = repeated.as_u64().unwrap() as usize;
            assert_eq!(truth[frame]["Time"], truth[frame - 1]["Time"]);
        }
        assert_eq!(file("cameras.json").exists(), about["moves"] != "still", "{kind}");
        if file("cameras.json").exists() {
            let cameras = json("cameras.json");
            let cameras = cameras.as_array().unwrap();
            assert_eq!(cameras.len(), truth.len());
            for (camera, row) in cameras.iter().zip(&truth).filter(|(_, row)| row["Visibility"] > 0.0) {
                let camera = Camera::from_json(&camera.to_string(), "cameras").unwrap();
                let at = ["WorldX", "WorldY", "WorldZ"].map(|name| row[name]);
                let seen = camera.image_from_world(&at.into()).unwrap();
                assert!((seen.x - row["X"]).hypot(seen.y - row["Y"]) < 0.2, "{kind}");
            }
        }
        let mut command = Command::new("ffprobe");
        command.args(["-v", "error", "-count_packets", "-show_entries", "stream=nb_read_packets", "-of", "csv=p=0"]);
        let shown = command.arg(file("mp4")).output().unwrap();
        assert_eq!(String::from_utf8_lossy(&shown.stdout).trim(), truth.len().to_string(), "{kind}");
    }
}

#[test]
fn odd_videos_are_read_and_named() {
    let (clip, folder) = sample("odd", 0);
    let frames = folder.join("frames/%d.png");
    let film = |name: &str, arguments: &[&str]| {
        let out = folder.join(name);
        let fps = clip.fps.to_string();
        let mut command = Command::new("ffmpeg");
        command.args(["-v", "error", "-y", "-framerate", &fps, "-i", text(&frames)]);
        command.args(arguments).arg(&out);
        assert!(command.status().unwrap().success(), "{name}");
        out
    };
    let x264 = ["-c:v", "libx264", "-crf", "12", "-pix_fmt", "yuv420p"];
    let plain = film("plain.mp4", &x264);
    let interlaced = film(
        "interlaced.mp4",
        &[
            "-c:v",
            "libx264",
            "-crf",
            "12",
            "-pix_fmt",
            "yuv420p",
            "-flags",
            "+ildct+ilme",
            "-vf",
            "setfield=tff",
            "-x264-params",
            "tff=1",
        ],
    );
    let hdr = film(
        "hdr.mp4",
        &[&x264[..], &["-color_trc", "smpte2084", "-color_primaries", "bt2020", "-colorspace", "bt2020nc"]].concat(),
    );
    // With sound, and two more streams of pictures.
    let crowded = folder.join("crowded.mkv");
    let mut command = Command::new("ffmpeg");
    command.args([
        "-v",
        "error",
        "-y",
        "-i",
        text(&plain),
        "-f",
        "lavfi",
        "-i",
        "testsrc=s=64x64:d=2",
        "-f",
        "lavfi",
        "-i",
        "sine=d=2",
    ]);
    command.args(["-map", "0:v", "-map", "1:v", "-map", "1:v", "-map", "2:a"]).arg(&crowded);
    assert!(command.status().unwrap().success());
    // A phone that was held upright: its pictures lie on their side, and the file says how to turn them.
    let turned = |transpose: &str| {
        let [side, turned] = ["side", "turned"].map(|name| folder.join(format!("{name}{transpose}.mp4")));
        let mut command = Command::new("ffmpeg");
        command.args(["-v", "error", "-y", "-i", text(&plain), "-vf", transpose]).args(x264).arg(&side);
        assert!(command.status().unwrap().success());
        // How it is written down is another option since ffmpeg 6.
        let written =
            [&["-display_rotation", "90", "-i", text(&side)][..], &["-i", text(&side), "-metadata:s:v:0", "rotate=90"]];
        let turn = |arguments: &&[&str]| {
            let mut command = Command::new("ffmpeg");
            command.args(["-v", "quiet", "-y"]).args(*arguments).args(["-c", "copy"]).arg(&turned);
            command.status().unwrap().success()
        };
        assert!(written.iter().any(turn));
        turned
    };
    for (video, word) in
        [(&plain, ""), (&interlaced, "interlaced"), (&hdr, "dynamic range"), (&crowded, "3 video streams")]
    {
        let output = gravisight(&["track", text(video), "--json"]);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{}: {said}", video.display());
        assert!(
            if word.is_empty() { !said.contains("note") } else { said.contains(word) },
            "{}: {said}",
            video.display()
        );
        let found: Value = serde_json::from_slice(&output.stdout).unwrap();
        let right = found["frames"].as_array().unwrap().iter().zip(&clip.frames).filter(|(found, frame)| {
            frame.image.zip(found["image"].as_array()).is_some_and(|(truth, _)| distance(&found["image"], truth) < 2.0)
        });
        let seen = clip.frames.iter().filter(|frame| frame.image.is_some()).count();
        let share = right.count() as f64 / seen as f64;
        println!("{}: {share:.2}", video.display());
        assert!(share > 0.8, "{}: {share}", video.display());
    }
    // One of the two is upright again, the other one upside down.
    let share = |transpose: &str| {
        let output = gravisight(&["track", text(&turned(transpose)), "--json"]);
        let found: Value = serde_json::from_slice(&output.stdout).unwrap();
        let frames = found["frames"].as_array().unwrap().iter().zip(&clip.frames);
        let right = frames.filter(|(found, frame)| {
            frame.image.is_some_and(|truth| found["image"].is_array() && distance(&found["image"], truth) < 2.0)
        });
        right.count() as f64 / clip.frames.len() as f64
    };
    let [clockwise, counterclockwise] = ["transpose=1", "transpose=2"].map(share);
    let [upright, upside_down] = [clockwise.max(counterclockwise), clockwise.min(counterclockwise)];
    assert!(upright > 0.7 && upside_down < 0.2, "{clockwise} {counterclockwise}");
}
