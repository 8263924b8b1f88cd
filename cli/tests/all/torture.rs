//! Runs that are killed at any moment: nothing half made is taken for whole, and what goes on ends in the same bits. Few times here;
//! `scripts/torture` sets TORTURE to many.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::{root, scratch};
use gravisight::Clips;

/// How often each is killed.
fn times() -> u32 {
    std::env::var("TORTURE").ok().and_then(|text| text.parse().ok()).unwrap_or(3)
}

fn start(arguments: &[&str]) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_gravisight"));
    command.args(arguments).current_dir(root()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Shares of 1 that look random and are the same each time.
fn share(number: u32) -> f64 {
    f64::from(number.wrapping_mul(2_654_435_769).rotate_left(13)) / f64::from(u32::MAX)
}

/// Every file below a folder, by its path there, without hidden ones.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(next) = folders.pop() {
        for entry in std::fs::read_dir(&next).into_iter().flatten().flatten() {
            let path = entry.path();
            match path.is_dir() {
                _ if entry.file_name().to_string_lossy().starts_with('.') => {}
                true => folders.push(path),
                false => drop(found.insert(path.strip_prefix(folder).unwrap().into(), std::fs::read(&path).unwrap())),
            }
        }
    }
    found
}

/// Runs may end before they are killed; of so many starts for each kill that is wanted, enough are killed.
const STARTS: u32 = 20;

/// How long a run may go on before it is killed: random shares of `lasts`, smaller ones wherever a run came to its end before.
struct Fuse {
    lasts: Duration,
    started: u32,
    died: u32,
}

impl Fuse {
    fn new(lasts: Duration) -> Self {
        Self { lasts, started: 0, died: 0 }
    }

    /// Lets `child` go on for a while and kills it; whether it was killed before its end.
    fn burns(&mut self, child: Child) -> bool {
        self.started += 1;
        assert!(
            self.started <= STARTS * times(),
            "of {} runs only {} were killed before their end",
            self.started,
            self.died
        );
        let died = killed(child, self.lasts.mul_f64(share(self.started)));
        match died {
            true => self.died += 1,
            false => self.lasts = self.lasts.mul_f64(0.8),
        }
        died
    }
}

/// Lets a run go on for a while, and kills it; whether it was killed before its end.
fn killed(mut child: Child, after: Duration) -> bool {
    std::thread::sleep(after);
    child.kill().ok();
    match child.wait().unwrap().code() {
        // By the signal.
        None => true,
        // 3: it came to its end, and not all is explained.
        Some(0 | 3) => false,
        Some(code) => panic!("it failed by itself, with status {code}"),
    }
}

#[test]
fn clips_are_clips_only_when_they_are_whole_and_go_on_where_they_were() {
    let folder = scratch("synth");
    let [first, out] = ["first", "clips"].map(|name| folder.join(name));
    let made = |out: &Path| {
        start(&["synth", "--set", "sd-s", "--split", "val", "--clips", "2", "--seed", "3", "--out", text(out)])
    };
    let started = Instant::now();
    assert!(made(&first).wait().unwrap().success());
    let lasts = started.elapsed();
    let whole = contents(&first);
    let (mut fuse, mut went_on) = (Fuse::new(lasts), 0);
    while fuse.died < times() || went_on == 0 {
        let died = fuse.burns(made(&out));
        let ended = Clips::read(&out).is_ok();
        assert!(died || ended, "it came to its end, and there are no clips");
        assert!(!ended || contents(&out) == whole, "it says that it is whole, and is not");
        // Every other time it goes on from what was left; of the others the next run does.
        if fuse.started % 2 == 1 || ended {
            assert!(made(&out).wait().unwrap().success());
            assert!(contents(&out) == whole, "what went on is not what is made at once");
            std::fs::remove_dir_all(&out).unwrap();
            went_on += u32::from(died);
        }
    }
    println!("synth: {} of {} killed before the end, {went_on} gone on with", fuse.died, fuse.started);
}

#[test]
fn a_trajectory_is_there_whole_or_not_at_all() {
    let folder = scratch("fit");
    let out = folder.join("trajectory.csv");
    let scene = folder.join("scene.json");
    std::fs::write(&scene, serde_json::to_string(&gravisight::Scene::named("floor").unwrap()).unwrap()).unwrap();
    let camera = folder.join("camera.json");
    std::fs::write(
        &camera,
        r#"{"width":1280,"height":720,"intrinsic":[[1100,0,639.5],[0,1100,359.5],[0,0,1]],
            "camera_from_world":[[1,0,0,0],[0,0,-1,1.5],[0,1,0,6],[0,0,0,1]]}"#,
    )
    .unwrap();
    let seen = gravisight::Camera::from_file(&camera).unwrap();
    let mut track = String::from("Frame,Visibility,X,Y\n");
    for frame in 0..40 {
        let t = f64::from(frame) / 50.0;
        let at = seen.image_from_world(&[-1.5 + 3.0 * t, 0.4 * t, 1.0 + 4.0 * t - 4.905 * t * t].into()).unwrap();
        track += &format!("{frame},1,{},{}\n", at.x, at.y);
    }
    let file = folder.join("track.csv");
    std::fs::write(&file, track).unwrap();
    let arguments = [
        "fit",
        "--track",
        text(&file),
        "--camera",
        text(&camera),
        "--scene",
        text(&scene),
        "--fps",
        "50",
        "--out",
        text(&out),
    ];
    let started = Instant::now();
    start(&arguments).wait().unwrap();
    let lasts = started.elapsed();
    let whole = std::fs::read(&out).unwrap();
    let mut fuse = Fuse::new(lasts);
    while fuse.died < times() {
        std::fs::remove_file(&out).ok();
        let died = fuse.burns(start(&arguments));
        let found = std::fs::read(&out);
        assert!(died || found.is_ok(), "it came to its end, and nothing is there");
        assert!(found.map_or(true, |found| found == whole), "it is there and is not whole");
    }
    println!("fit: {} of {} killed before the end", fuse.died, fuse.started);
}

#[test]
fn a_training_that_is_killed_often_ends_in_the_same_weights() {
    let folder = scratch("train");
    let [whole, out] = ["whole", "killed"].map(|name| folder.join(name));
    let train = |out: &Path| {
        start(&[
            "train",
            "--config",
            "tests/golden/tiny.toml",
            "--out",
            text(out),
            "--set",
            "checkpoint_every=2",
            "--set",
            "phases=[{steps=40, batch=4, crop=32, learning_rate=1e-3}]",
            "--set",
            "validate_every=20",
        ])
    };
    let started = Instant::now();
    assert!(train(&whole).wait().unwrap().success());
    let lasts = started.elapsed();
    let weights = |folder: &Path| {
        let names = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
        names
            .filter(|path| path.extension().is_some_and(|it| it == "safetensors"))
            .map(|path| std::fs::read(path).unwrap())
            .next()
    };
    let expected = weights(&whole).unwrap();
    let (mut died, mut resumed, mut rounds) = (0, 0, 0);
    let enough = |died: u32, resumed: u32| died >= times() && resumed > 0;
    while !enough(died, resumed) {
        assert!(rounds < STARTS * times(), "of {rounds} runs {died} were killed, and {resumed} left a checkpoint");
        std::fs::remove_dir_all(&out).ok();
        let mut child = train(&out);
        // Each round is killed again and again until it has come through.
        for number in 0.. {
            let after = lasts.mul_f64(0.1 + 0.6 * share(rounds * 1000 + number));
            if !killed(child, after) {
                break;
            }
            died += 1;
            let resumable = out.join("checkpoints").is_dir();
            // Killed before there was a run: it begins anew.
            if !resumable {
                std::fs::remove_dir_all(&out).ok();
            }
            resumed += u32::from(resumable);
            child = if resumable { start(&["train", "--resume", text(&out)]) } else { train(&out) };
            if enough(died, resumed) {
                assert!(child.wait().unwrap().success());
                break;
            }
        }
        assert!(weights(&out).unwrap() == expected, "the weights differ after {died} kills");
        rounds += 1;
    }
    println!("train: killed {died} times in {rounds} runs, resumed {resumed} times");
}

/// Kills runs that make `out` and writes again where nothing is left of them; what is there under its name is `whole`.
fn killed_often(name: &str, out: &Path, made: &dyn Fn(&Path) -> Child) {
    let first = out.with_file_name(format!("first-{}", out.file_name().unwrap().to_string_lossy()));
    let started = Instant::now();
    assert!(ended(made(&first)));
    let mut fuse = Fuse::new(started.elapsed());
    let whole = all_of(&first);
    assert!(!whole.is_empty());
    let (mut went_on, mut there) = (0, 0);
    while fuse.died < times() || went_on == 0 {
        let died = fuse.burns(made(out));
        let found = all_of(out);
        there += u32::from(!found.is_empty());
        assert!(found.is_empty() || found == whole, "{name}: something is there and is not whole");
        assert!(died || found == whole, "{name}: it came to its end, and not all is there");
        if found.is_empty() {
            assert!(
                ended(made(out)) && all_of(out) == whole,
                "{name}: the run after a killed one gives something else"
            );
            went_on += 1;
        }
        remove(out);
    }
    println!(
        "{name}: {} of {} killed before the end, {there} had ended, {went_on} done again",
        fuse.died, fuse.started
    );
}

/// Whether a run came to its end, all explained or not.
fn ended(mut child: Child) -> bool {
    matches!(child.wait().unwrap().code(), Some(0 | 3))
}

/// What is in a folder's files, or in a file.
fn all_of(path: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    match std::fs::read(path) {
        Ok(bytes) => BTreeMap::from([(PathBuf::new(), bytes)]),
        Err(_) => contents(path),
    }
}

fn remove(path: &Path) {
    std::fs::remove_dir_all(path).or_else(|_| std::fs::remove_file(path)).ok();
}

#[test]
fn imported_clips_are_there_whole_or_not_at_all() {
    let folder = scratch("import");
    let source = folder.join("set");
    crate::common::copy_tree(&root().join("tests/golden/import/tracknet"), &source);
    // Many tracks, so that it lasts.
    for number in 0..60 {
        crate::common::copy_tree(&source.join("match"), &source.join(format!("more/{number}")));
    }
    let camera = "tests/golden/import/camera.json";
    killed_often("import", &folder.join("clips"), &|out| {
        start(&["import", "--from", "tracknet", text(&source), "--camera", camera, "--fps", "30", "--out", text(out)])
    });
}

/// Frames with a ball and their camera.
const FRAMES: &str = "tests/samples/frames/train_e1_c1_0000";

/// The camera of those frames.
fn camera_in(folder: &Path) -> PathBuf {
    let camera = folder.join("camera.json");
    let clips = Clips::read(&root().join("tests/samples")).unwrap();
    std::fs::write(&camera, serde_json::to_string(&clips.clips[0].camera).unwrap()).unwrap();
    camera
}

#[test]
fn labels_are_there_whole_or_not_at_all() {
    let folder = scratch("label");
    let camera = camera_in(&folder);
    killed_often("label", &folder.join("labels"), &|out| {
        start(&["label", FRAMES, "--out", text(out), "--camera", text(&camera), "--fps", "15", "--format", "csv"])
    });
}

#[test]
fn what_track_writes_is_there_whole_or_not_at_all() {
    let folder = scratch("track");
    killed_often("track", &folder.join("track.csv"), &|out| {
        start(&["track", FRAMES, "--fps", "15", "--out", text(out)])
    });
    killed_often("track --report", &folder.join("report.html"), &|out| {
        start(&["track", FRAMES, "--fps", "15", "--report", text(out)])
    });
    killed_often("track --overlay", &folder.join("overlay.mp4"), &|out| {
        start(&["track", FRAMES, "--fps", "15", "--overlay", text(out)])
    });
}
