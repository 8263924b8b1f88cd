//! The built-in engine: `cargo test -p gravisight-synth -- --nocapture` prints how near it is to MuJoCo's pictures and
//! where the sheet of pictures side by side is.

use crate::{Disturbance, Engine as _, Set, Shot, Site, Split, Studio};
use gravisight_geometry::image::Picture;
use gravisight_geometry::size::Size;
use gravisight_testing::{root, scratch};
use image::{Rgb, RgbImage, imageops};
use nalgebra::{Point2, Point3, Vector3};
use serde_json::Value;

/// Centroid, px, and area, px², of what is teal near a place: half-covered pixels count half.
fn silhouette(picture: &RgbImage, near: [f64; 2]) -> ([f64; 2], f64) {
    const REACH: f64 = 16.0;
    let (mut area, mut sum) = (0.0, [0.0; 2]);
    for (x, y, Rgb([red, green, blue])) in picture.enumerate_pixels() {
        let at = [f64::from(x), f64::from(y)];
        if (at[0] - near[0]).hypot(at[1] - near[1]) > REACH {
            continue;
        }
        // The ball has no red but its highlight; floor and boxes have as much red as a quarter of green at least.
        let cool = (f64::from(*green) + f64::from(*blue)) / 2.0;
        let covered = ((1.0 - f64::from(*red) / cool.max(1.0)) / 0.75).clamp(0.0, 1.0);
        let covered = if cool < 8.0 { 0.0 } else { (covered - 0.5).clamp(0.0, 0.4) / 0.4 };
        area += covered;
        (0..2).for_each(|axis| sum[axis] += covered * at[axis]);
    }
    (sum.map(|sum| sum / area), area)
}

#[test]
fn the_ball_is_drawn_where_and_as_large_as_mujoco_draws_it() {
    let folder = root().join("tests/golden/synth");
    let golden: Value = serde_json::from_str(&std::fs::read_to_string(folder.join("frames.json")).unwrap()).unwrap();
    let clips = golden["clips"].as_array().unwrap();
    let mut sheet = RgbImage::new(224 * 6, 224 * clips.len() as u32);
    let (mut worst, mut differences, mut compared) = ([0.0_f64; 2], Vec::new(), 0);
    for (row, clip) in clips.iter().enumerate() {
        let id = clip["id"].as_str().unwrap();
        let number = |part: usize| id.split('/').nth(part).unwrap().trim_matches(char::is_alphabetic).parse().unwrap();
        let studio = Studio::new(Shot { site: Site::Environment(number(1)), camera: number(2) }).unwrap();
        for (column, frame) in clip["frames"].as_array().unwrap().iter().enumerate() {
            let theirs = Picture::open(&folder.join(frame["file"].as_str().unwrap())).unwrap().rgb().clone();
            let world: [f64; 3] = serde_json::from_value(frame["world"].clone()).unwrap();
            let image: [f64; 2] = serde_json::from_value(frame["image"].clone()).unwrap();
            let centre = Point3::from(world);
            let ours = studio.renderer().frame(&centre);
            imageops::replace(&mut sheet, &theirs, 448 * column as i64, 224 * row as i64);
            imageops::replace(&mut sheet, &ours, 448 * column as i64 + 224, 224 * row as i64);
            let found = studio.camera().image_from_world(&centre).unwrap();
            assert!((found.x - image[0]).hypot(found.y - image[1]) < 1e-6, "{id}: the camera is another one");
            assert_eq!(studio.renderer().visible(&centre) > 0.0, frame["visible"].as_bool().unwrap(), "{id}");
            let far = |a: u8, b: u8| f64::from(a.abs_diff(b));
            let mean: f64 = theirs.iter().zip(ours.iter()).map(|(&a, &b)| far(a, b)).sum::<f64>() / theirs.len() as f64;
            differences.push(mean);
            if studio.renderer().visible(&centre) < 1.0 {
                continue;
            }
            let [(theirs, their_area), (ours, our_area)] = [&theirs, &ours].map(|picture| silhouette(picture, image));
            let off = [(theirs[0] - ours[0]).hypot(theirs[1] - ours[1]), (our_area / their_area - 1.0).abs()];
            println!(
                "{id} {column}: centroid {:.3} px, area {:+.1} % of {their_area:.0} px, pixels differ by {mean:.1}",
                off[0],
                100.0 * (our_area / their_area - 1.0)
            );
            worst = [worst[0].max(off[0]), worst[1].max(off[1])];
            compared += 1;
        }
    }
    let place = scratch("synth").join("pictures.png");
    sheet.save(&place).unwrap();
    let mean = differences.iter().sum::<f64>() / differences.len() as f64;
    println!(
        "{compared} balls: centroid within {:.3} px, area within {:.1} %; pixels differ by {mean:.2} of 255; {}",
        worst[0],
        100.0 * worst[1],
        place.display()
    );
    assert!(compared >= 15 && worst[0] < 0.3 && worst[1] < 0.03, "{worst:?}");
    assert!(mean < 6.0, "{mean}");
}

#[test]
fn sets_are_nested_and_their_clips_repeat() {
    let shots = |set: Set, split| set.shots(split);
    assert_eq!(shots(Set::SdS, Split::Train).len(), 1);
    assert_eq!(shots(Set::SdM, Split::Train).len(), 6);
    assert_eq!(shots(Set::SdM, Split::Test).len(), 9);
    assert_eq!([Split::Val, Split::Test].map(|split| shots(Set::SdL, split).len()), [27, 27]);
    assert_eq!([Split::Train, Split::Test].map(|split| shots(Set::Rd, split).len()), [2, 2]);
    let all = |split| shots(Set::Rd, split).iter().map(|shot| shot.clips(split).unwrap()).sum::<usize>();
    assert_eq!([Split::Train, Split::Val, Split::Test].map(all), [251, 34, 81], "as the paper's real data set");
    for split in [Split::Train, Split::Val, Split::Test] {
        assert!(shots(Set::SdS, split).iter().all(|shot| shots(Set::SdM, split).contains(shot)));
        assert!(shots(Set::SdM, split).iter().all(|shot| shots(Set::SdL, split).contains(shot)));
    }
    let studio = Studio::new(Shot { site: Site::Environment(1), camera: 1 }).unwrap();
    let clip =
        |seed, split, number| studio.clip(&mut studio.builtin(), seed, split, number).unwrap().to_line().unwrap();
    assert_eq!(clip(1, Split::Train, 3), clip(1, Split::Train, 3));
    for other in [clip(2, Split::Train, 3), clip(1, Split::Val, 3), clip(1, Split::Train, 4)] {
        assert_ne!(clip(1, Split::Train, 3), other);
    }
}

#[test]
fn clips_are_as_the_paper_says() {
    for (environment, camera) in [(1, 1), (2, 9), (3, 4)] {
        let studio = Studio::new(Shot { site: Site::Environment(environment), camera }).unwrap();
        for number in 0..5 {
            let clip = studio.clip(&mut studio.builtin(), 7, Split::Train, number).unwrap();
            assert_eq!((clip.frames.len(), clip.fps), (90, 15.0));
            assert_eq!(clip.id, format!("train/env{environment}/cam{camera}/{number:04}"));
            for frame in &clip.frames {
                let [x, y] = frame.image.unwrap();
                assert!((0.0..=223.0).contains(&x) && (0.0..=223.0).contains(&y));
                assert!(frame.world.unwrap()[2] > 0.1, "the ball is above the floor");
            }
            assert!(clip.frames.iter().filter(|frame| frame.visible).count() > 45);
        }
    }
    let spring = Studio::new(Shot { site: Site::Spring, camera: 1 }).unwrap();
    let clip = spring.clip(&mut spring.builtin(), 7, Split::Test, 0).unwrap();
    assert_eq!(clip.frames.len(), 120);
    let nearest = clip.frames.iter().map(|frame| Point3::from(frame.world.unwrap()).coords.norm()).fold(9.0, f64::min);
    assert!((0.85..2.7).contains(&nearest), "{nearest} m");
    assert!(Studio::new(Shot { site: Site::Environment(4), camera: 1 }).is_err());
    assert!(Studio::new(Shot { site: Site::Environment(1), camera: 10 }).is_err());
}

#[test]
fn the_springs_balls_start_up_to_three_quarters_off_a_circles_speed() {
    let spring = Studio::new(Shot { site: Site::Spring, camera: 1 }).unwrap();
    let speeds = (0..60).map(|number| {
        let clip = spring.clip(&mut spring.builtin(), 7, Split::Test, number).unwrap();
        let at = |index: usize| Point3::from(clip.frames[index].world.unwrap()).coords;
        let least =
            clip.frames.iter().map(|frame| Point3::from(frame.world.unwrap()).coords.norm()).fold(9.0, f64::min);
        assert!(least > 0.2 + 0.3, "the balls never touch: {least} m");
        // x(t) = x0 cos ωt + v0/ω sin ωt
        let (sine, cosine) = (3_f64.sqrt() / 15.0).sin_cos();
        (at(1) - at(0) * cosine).norm() / sine / at(0).norm()
    });
    let speeds: Vec<f64> = speeds.collect();
    let (slowest, fastest) = speeds.iter().fold((9.0_f64, 0.0_f64), |(low, high), &v| (low.min(v), high.max(v)));
    println!("speeds {slowest:.2} to {fastest:.2} of a circle's");
    assert!((0.25..0.7).contains(&slowest) && (1.3..=1.75).contains(&fastest));
}

#[test]
fn the_rooms_clips_are_as_its_description_says() {
    let (mut off, mut bounces) = (Vec::<f64>::new(), 0);
    for camera in [1, 2] {
        let studio = Studio::new(Shot { site: Site::Room, camera }).unwrap();
        let eye = studio.camera().world_from_camera(&Point3::origin());
        assert!((1.3..1.4).contains(&eye.coords.norm()), "{} m from the origin", eye.coords.norm());
        for number in 0..10 {
            let clip = studio.clip(&mut studio.builtin(), 7, Split::Train, number).unwrap();
            assert_eq!((clip.frames.len(), clip.fps), (16, 60.0));
            let positions: Vec<Point3<f64>> = clip.frames.iter().map(|frame| frame.world.unwrap().into()).collect();
            for (frame, at) in clip.frames.iter().zip(&positions) {
                assert!((0.5..=2.5).contains(&(at - eye).norm()));
                assert!(at.x > 0.04 && at.y < 0.56 && at.z > 0.04, "inside the walls: {at}");
                let image = studio.camera().image_from_world(at).unwrap();
                off.extend((image - Point2::from(frame.image.unwrap())).iter());
            }
            let steps: Vec<Vector3<f64>> = positions.windows(2).map(|pair| pair[1] - pair[0]).collect();
            bounces += usize::from(steps.windows(2).any(|pair| (pair[1] - pair[0]).norm() > 0.01));
        }
    }
    let sigma = (off.iter().map(|error| error * error).sum::<f64>() / off.len() as f64).sqrt();
    println!("labels off by {sigma:.2} px; {bounces} of 20 clips have a bounce");
    assert!((1.35..1.65).contains(&sigma) && bounces >= 5);
}

#[test]
fn a_size_changes_the_picture_and_not_what_is_in_it() {
    let shot = Shot { site: Site::Environment(2), camera: 4 };
    let (usual, double) = (Studio::new(shot).unwrap(), Studio::of_size(shot, Some(Size::square(448))).unwrap());
    let clip = |studio: &Studio| studio.clip(&mut studio.builtin(), 7, Split::Val, 0).unwrap();
    let [usual, double] = [clip(&usual), clip(&double)];
    for (a, b) in usual.frames.iter().zip(&double.frames) {
        assert_eq!(a.world, b.world);
        let [[x, y], [wide, high]] = [a.image.unwrap(), b.image.unwrap()];
        // Pixel centres are whole numbers.
        assert!((wide + 0.5 - 2.0 * (x + 0.5)).abs() < 1e-9 && (high + 0.5 - 2.0 * (y + 0.5)).abs() < 1e-9);
    }
}

#[test]
fn what_is_disturbed_is_what_the_name_says() {
    let shot = Shot { site: Site::Environment(1), camera: 1 };
    let usual = Studio::new(shot).unwrap();
    let with = |disturbance| Studio::new(shot).unwrap().disturbed(disturbance).unwrap();
    let clip = |studio: &Studio| studio.clip(&mut studio.builtin(), 7, Split::Test, 2).unwrap();
    let residual = |clip: &gravisight_clips::Clip| -> f64 {
        // The scene's own physics from the first two frames on.
        let at = |index: usize| Point3::from(clip.frames[index].world.unwrap());
        let dt = 1.0 / 15.0;
        let half_fall = Vector3::new(0.0, 0.0, -0.5) * dt * dt;
        let velocity = (at(1) - at(0) - half_fall) / dt;
        let start = usual.scene().start(at(0), velocity);
        let times: Vec<f64> = clip.frames.iter().map(|frame| frame.t).collect();
        let path = usual.builtin().path(&start, &times).unwrap();
        path.iter().enumerate().map(|(index, place)| (place - at(index)).norm()).fold(0.0, f64::max)
    };
    let plain = clip(&usual);
    for (disturbance, moves) in [
        (Disturbance::Wind, true),
        (Disturbance::Hand, true),
        (Disturbance::Ball, false),
        (Disturbance::Background, false),
    ] {
        let studio = with(disturbance);
        let disturbed = clip(&studio);
        assert_eq!(residual(&disturbed) > 0.5, moves, "{disturbance:?}: {} m", residual(&disturbed));
        assert_eq!(disturbed.scene.is_some(), plain.scene.is_some());
        if !moves {
            assert_eq!(disturbed.frames[5].world, plain.frames[5].world);
            let centre = Point3::from(plain.frames[5].world.unwrap());
            assert_ne!(studio.renderer().frame(&centre), usual.renderer().frame(&centre));
        }
    }
    let seen = |frame: &&gravisight_clips::Frame| usual.renderer().visible(&frame.world.unwrap().into()) == 1.0;
    let frame = plain.frames.iter().find(seen).unwrap();
    let centre = Point3::from(frame.world.unwrap());
    let area = |studio: &Studio| {
        let [with, without] = [centre, Point3::new(0.0, 0.0, -50.0)].map(|at| studio.renderer().frame(&at));
        let [x, y] = frame.image.unwrap();
        let near = |column: u32, row: u32| (f64::from(column) - x).hypot(f64::from(row) - y) < 12.0;
        let changed = with.enumerate_pixels().filter(|&(x, y, pixel)| near(x, y) && without.get_pixel(x, y) != pixel);
        changed.count() as f64
    };
    let grown = area(&with(Disturbance::Ball)) / area(&usual);
    assert!((1.25_f64.powi(2) - grown).abs() < 0.2, "the ball's area grew by {grown}");
}

#[test]
fn only_what_the_ball_touches_is_drawn_again() {
    // A frame drawn with shortcuts is the frame drawn in full: moving the ball far away leaves the same empty place.
    let studio = Studio::new(Shot { site: Site::Environment(1), camera: 3 }).unwrap();
    let empty = studio.renderer().frame(&Point3::new(0.0, 0.0, -50.0));
    let with = studio.renderer().frame(&Point3::new(-1.5, 1.0, 2.0));
    let changed: Vec<_> = with.enumerate_pixels().filter(|(x, y, pixel)| empty.get_pixel(*x, *y) != *pixel).collect();
    // The ball, its shadow and its mirror image.
    assert!((200..3000).contains(&changed.len()), "{}", changed.len());
}
