//! What is filmed is where the truth says.

use super::super::broadcast::Kind;
use super::{Moves, Recording};

/// The first clip of a kind and a motion.
fn moving(kind: Kind, moves: Moves) -> Recording {
    (0..50).map(|seed| Recording::draw(kind, false, seed).unwrap()).find(|clip| clip.moves == moves).unwrap()
}

#[test]
fn a_clip_is_drawn_from_its_seed_alone() {
    for (kind, empty) in [(Kind::Toss, false), (Kind::TableTennis, true)] {
        let [first, again, other] = [7, 7, 8].map(|seed| Recording::draw(kind, empty, seed).unwrap());
        // In another order, and other frames before.
        let last = again.frame(again.count() - 1).unwrap();
        assert_eq!(first.frame(3).unwrap(), again.frame(3).unwrap());
        assert_eq!(first.frame(first.count() - 1).unwrap(), last);
        assert_ne!(first.camera(0).unwrap(), other.camera(0).unwrap());
    }
}

#[test]
fn each_frames_camera_sees_the_ball_where_the_truth_says() {
    for moves in [Moves::Sway, Moves::Pan] {
        let clip = moving(Kind::Tennis, moves);
        let eye = |frame: usize| {
            let camera = clip.camera(frame).unwrap();
            camera.world_from_camera(&nalgebra::Point3::origin())
        };
        for frame in 0..clip.count() {
            let truth = clip.truth(frame).unwrap().unwrap();
            let seen = clip.camera(frame).unwrap().image_from_world(&truth.world.into()).unwrap();
            assert!((seen.x - truth.image[0]).hypot(seen.y - truth.image[1]) < 1e-9);
            assert!((eye(frame) - eye(0)).norm() < 1e-9, "the centre stays");
        }
        assert_ne!(clip.camera(0).unwrap(), clip.camera(clip.count() - 1).unwrap());
    }
    let still = moving(Kind::Toss, Moves::Still);
    assert_eq!(still.camera(0).unwrap(), still.camera(still.count() - 1).unwrap());
}

#[test]
fn the_ball_is_drawn_where_the_truth_says_in_moving_pictures_too() {
    for seed in 0..3 {
        let (with, without) = (Recording::draw(Kind::Volleyball, false, seed).unwrap(), {
            let mut clip = Recording::draw(Kind::Volleyball, false, seed).unwrap();
            clip.shadows = 0.0;
            clip.paint = clip.paint.map(|value| 1.0 - value);
            clip
        });
        let Some(frame) = (5..with.count()).find(|&frame| with.frame(frame).unwrap().1.unwrap().visible) else {
            continue;
        };
        let ((shown, truth), (hidden, _)) = (with.frame(frame).unwrap(), without.frame(frame).unwrap());
        let (mut sum, mut at) = (0.0, [0.0; 2]);
        let truth = truth.unwrap();
        let near = 4.0 * truth.radius_px + 12.0;
        for (x, y, pixel) in shown.enumerate_pixels() {
            let place = [f64::from(x), f64::from(y)];
            let off = (place[0] - truth.image[0]).hypot(place[1] - truth.image[1]);
            let other = hidden.get_pixel(x, y);
            let difference = (0..3).map(|channel| f64::from(pixel[channel].abs_diff(other[channel]))).sum::<f64>();
            if off < near && difference > 60.0 {
                sum += difference;
                (0..2).for_each(|axis| at[axis] += difference * place[axis]);
            }
        }
        let off = (at[0] / sum - truth.image[0]).hypot(at[1] / sum - truth.image[1]);
        assert!(off < 1.0 + 0.1 * truth.radius_px, "seed {seed}: {off} px off");
    }
}

#[test]
fn repeated_frames_show_the_same_picture_and_time() {
    let mut found = 0;
    for seed in 0..30 {
        let clip = Recording::draw(Kind::Tennis, false, seed).unwrap();
        let repeated: Vec<usize> = (0..clip.count()).filter(|&frame| clip.repeats(frame)).collect();
        assert_eq!(repeated.is_empty(), clip.fps == clip.filmed_fps());
        let Some(&frame) = repeated.first() else { continue };
        assert_eq!(clip.time(frame), clip.time(frame - 1));
        let [before, after] = repeated[..2] else { panic!("a conversion repeats more than once") };
        assert_eq!(after - before, if clip.filmed_fps() == 24.0 { 5 } else { 6 });
        if found == 0 {
            assert_eq!(clip.frame(frame).unwrap(), clip.frame(frame - 1).unwrap());
            assert_ne!(clip.frame(frame).unwrap().0, clip.frame(frame + 1).unwrap().0);
        }
        found += 1;
    }
    assert!(found > 3, "{found} of 30 are converted");
}

#[test]
fn empty_clips_have_no_ball() {
    for kind in Kind::ALL {
        let clip = Recording::draw(kind, true, 3).unwrap();
        assert!(clip.hits.is_empty() && clip.bounces.is_empty());
        assert!((0..clip.count()).all(|frame| clip.truth(frame).unwrap().is_none()));
        assert!(clip.frame(clip.count() / 2).unwrap().1.is_none());
    }
}

#[test]
fn half_of_the_cameras_stand_still_and_few_lose_the_ball() {
    let clips: Vec<Recording> =
        (0..60).map(|seed| Recording::draw(Kind::ALL[seed % 4], false, seed as u64).unwrap()).collect();
    let count = |moves: Moves| clips.iter().filter(|clip| clip.moves == moves).count();
    assert!((20..40).contains(&count(Moves::Still)) && count(Moves::Sway) > 5 && count(Moves::Pan) > 5);
    let mut seen = [0, 0];
    for clip in &clips {
        for frame in 0..clip.count() {
            seen[usize::from(clip.truth(frame).unwrap().unwrap().visible)] += 1;
        }
    }
    assert!(seen[1] > 8 * seen[0], "{seen:?}");
}
