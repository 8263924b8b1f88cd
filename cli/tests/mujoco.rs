//! The MuJoCo engine, where its library is: scripts/mujoco runs these.
#![cfg(all(feature = "mujoco", libmujoco))]

mod common;

use std::process::{Command, Output};

use gravisight::Picture;
use gravisight::State;
use gravisight::internal::{Engine as _, Shot, Split, Studio};
use image::RgbImage;
use nalgebra::{Point3, Vector3};
use serde::Deserialize;
use serde_json::Value;

fn studio(environment: impl Into<Option<usize>>, camera: usize) -> Studio {
    Studio::new(Shot { environment: environment.into(), camera }).unwrap()
}

fn mean_difference(ours: &RgbImage, theirs: &RgbImage) -> f64 {
    let sum: u64 = ours.iter().zip(theirs.iter()).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
    sum as f64 / ours.len() as f64
}

#[test]
fn the_ball_is_where_an_independent_script_has_it() {
    #[derive(Deserialize)]
    struct Golden {
        seconds: f64,
        tracks: Vec<Track>,
    }
    #[derive(Deserialize)]
    struct Track {
        environment: usize,
        position: [f64; 3],
        velocity: [f64; 3],
        world: Vec<[f64; 3]>,
    }
    let golden: Golden =
        serde_json::from_slice::<Value>(&common::golden("mujoco_paths.json")).and_then(serde_json::from_value).unwrap();
    let mut worst: f64 = 0.0;
    for track in &golden.tracks {
        let start = State { position: track.position.into(), velocity: track.velocity.into(), spin: Vector3::zeros() };
        let times: Vec<f64> = (0..track.world.len()).map(|index| index as f64 * golden.seconds).collect();
        let path = studio(track.environment, 1).mujoco().unwrap().path(&start, &times).unwrap();
        for (ours, theirs) in path.iter().zip(&track.world) {
            worst = worst.max((ours - Point3::from(*theirs)).norm());
        }
    }
    println!("{} trajectories within {worst:.1e} m", golden.tracks.len());
    assert!(golden.tracks.len() >= 15 && worst < 1e-6, "{worst} m");
}

#[test]
fn the_pictures_are_those_of_an_independent_script() {
    let golden: Value = serde_json::from_slice(&common::golden("synth/frames.json")).unwrap();
    let (mut worst, mut count): (f64, _) = (0.0, 0);
    for clip in golden["clips"].as_array().unwrap() {
        let id = clip["id"].as_str().unwrap();
        let number = |part: usize| id.split('/').nth(part).unwrap().trim_matches(char::is_alphabetic).parse().unwrap();
        let studio = studio(number(1), number(2));
        let mut engine = studio.mujoco().unwrap();
        for frame in clip["frames"].as_array().unwrap() {
            let file = common::root().join("tests/golden/synth").join(frame["file"].as_str().unwrap());
            let world: [f64; 3] = serde_json::from_value(frame["world"].clone()).unwrap();
            let theirs = Picture::open(&file).unwrap();
            worst = worst.max(mean_difference(&engine.picture(&world.into()).unwrap(), theirs.rgb()));
            count += 1;
        }
    }
    println!("{count} pictures differ by {worst:.2e} of 255 at most");
    assert!(count >= 15 && worst < 0.1, "{worst}");
}

#[test]
fn the_ball_on_the_spring_follows_the_law() {
    let studio = studio(None, 1);
    let (position, velocity) = (Point3::new(1.2, -0.7, 1.4), Vector3::new(1.0, 2.0, -0.5));
    let start = State { position, velocity, spin: Vector3::zeros() };
    let times: Vec<f64> = (0..120).map(|frame| f64::from(frame) / 15.0).collect();
    let path = studio.mujoco().unwrap().path(&start, &times).unwrap();
    let law = studio.builtin().path(&start, &times).unwrap();
    let worst = path.iter().zip(&law).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    println!("within {worst:.1e} m");
    assert!(path.len() == 120 && worst < 1e-6, "{worst} m");
}

#[test]
fn every_thread_draws_the_same() {
    let studio = studio(2, 3);
    let centre = Point3::new(-0.5, 0.4, 1.1);
    let draw = || studio.mujoco().unwrap().picture(&centre).unwrap();
    let first = draw();
    std::thread::scope(|scope| {
        let threads: Vec<_> = (0..4).map(|_| scope.spawn(draw)).collect();
        assert!(threads.into_iter().all(|thread| thread.join().unwrap() == first));
    });
}

#[test]
fn both_engines_begin_alike() {
    let studio = studio(1, 1);
    let mut engine = studio.mujoco().unwrap();
    let same = (0..20).filter(|&number| {
        let first = |clip: gravisight::Clip| clip.frames[0].world.unwrap();
        let ours = studio.clip(&mut engine, 7, Split::Train, number).unwrap();
        first(ours) == first(studio.clip(&mut studio.builtin(), 7, Split::Train, number).unwrap())
    });
    let same = same.count();
    println!("{same} of 20 clips begin alike");
    assert!(same >= 17, "{same}");
}

#[test]
fn the_command_makes_a_set_with_mujoco_and_goes_on_with_it() {
    let out = common::scratch("mujoco").join("set");
    let synth = |engine: &str, clips: &str| -> Output {
        let arguments = ["synth", "--set", "spring", "--split", "val", "--json", "--engine", engine, "--clips", clips];
        Command::new(env!("CARGO_BIN_EXE_gravisight")).args(arguments).arg("--out").arg(&out).output().unwrap()
    };
    let drawn = |output: Output| serde_json::from_slice::<Value>(&output.stdout).unwrap()["frames_drawn"].clone();
    assert_eq!(drawn(synth("mujoco", "1")), 120);
    assert_eq!(drawn(synth("mujoco", "3")), 240);
    assert_eq!(gravisight::Clips::read(&out).unwrap().clips.len(), 3);
    let other = synth("builtin", "3");
    assert_eq!(other.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&other.stderr).contains("choose another --out"));
}
