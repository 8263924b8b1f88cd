//! The MuJoCo engine, where its library is: scripts/mujoco runs these.
#![cfg(all(feature = "mujoco", libmujoco))]

#[path = "all/common.rs"]
mod common;

use std::process::{Command, Output};

use gravisight::Picture;
use gravisight::State;
use gravisight::internal::{Engine as _, Shot, Site, Split, Studio};
use image::RgbImage;
use nalgebra::{Point3, Vector3};
use serde::Deserialize;
use serde_json::Value;

fn studio(environment: impl Into<Option<usize>>, camera: usize) -> Studio {
    let site = environment.into().map_or(Site::Spring, Site::Environment);
    Studio::new(Shot { site, camera }).unwrap()
}

fn room(camera: usize) -> Studio {
    Studio::new(Shot { site: Site::Room, camera }).unwrap()
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
fn the_rooms_ball_bounces_as_its_scene_says() {
    let studio = room(1);
    // Dropped beside the box: the rebound's height is the restitution squared of the drop's.
    let start = State { position: Point3::new(1.0, -0.5, 1.05), velocity: Vector3::zeros(), spin: Vector3::zeros() };
    let times: Vec<f64> = (0..60).map(|frame| f64::from(frame) / 60.0).collect();
    let (theirs, ours) = (studio.mujoco().unwrap().path(&start, &times), studio.builtin().path(&start, &times));
    let [theirs, ours] = [theirs, ours].map(|path| path.unwrap());
    let rebound = |path: &[Point3<f64>]| path[30..].iter().map(|at| at.z - 0.05).fold(0.0, f64::max);
    println!("rebound from 1 m: {:.3} m, by the built-in engine {:.3} m", rebound(&theirs), rebound(&ours));
    assert!((rebound(&ours) - 0.64).abs() < 0.005 && (rebound(&theirs) - 0.64).abs() < 0.04);
}

#[test]
fn both_engines_draw_the_room_and_the_ball_in_the_centre_alike() {
    for (studio, ball) in [(room(1), [0.6, -0.3, 0.7]), (room(2), [0.3, -0.2, 0.9]), (studio(None, 1), [1.0, 0.8, 0.4])]
    {
        let ball = Point3::from(ball);
        let [ours, theirs] =
            [studio.builtin().picture(&ball), studio.mujoco().unwrap().picture(&ball)].map(Result::unwrap);
        let mean = mean_difference(&ours, &theirs);
        println!("{:?}: pixels differ by {mean:.2} of 255", studio.camera().size());
        let place = common::scratch("mujoco-room").join(format!("{}.png", ours.width()));
        let mut sheet = RgbImage::new(2 * ours.width(), ours.height());
        image::imageops::replace(&mut sheet, &ours, 0, 0);
        image::imageops::replace(&mut sheet, &theirs, ours.width().into(), 0);
        sheet.save(&place).unwrap();
        assert!(mean < 6.0, "{mean}: {}", place.display());
    }
}

#[test]
fn both_engines_see_the_same_depths() {
    let away = Point3::new(0.3, 0.4, 1.4);
    for (name, studio, ball) in [
        ("environment 1", studio(1, 1), away),
        ("environment 3", studio(3, 5), away),
        ("spring", studio(None, 1), away),
        ("room", room(2), Point3::new(0.35, -0.15, 0.62)),
    ] {
        let [ours, theirs] = [studio.builtin().depth(&ball), studio.mujoco().unwrap().depth(&ball)].map(Result::unwrap);
        let pairs = || ours.iter().zip(&theirs);
        // Where a surface ends, a pixel shows one or the other.
        let off = pairs().filter(|(a, b)| a.is_finite() != b.is_finite() || (*a - *b).abs() > 0.01 * a.abs());
        let share = off.count() as f64 / ours.len() as f64;
        println!("{name}: {:.2} % of the pixels differ by more than a hundredth", 100.0 * share);
        assert!(share < 0.03, "{name}: {share}");
        let image = studio.camera().image_from_world(&ball).unwrap();
        let at = image.y.round() as usize * studio.camera().size().width as usize + image.x.round() as usize;
        let nearest = studio.camera().camera_from_world(&ball).z - studio.scene().ball.radius;
        assert!((f64::from(ours[at]) - nearest).abs() < 0.02, "{name}: {} m, the ball at {nearest}", ours[at]);
    }
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
