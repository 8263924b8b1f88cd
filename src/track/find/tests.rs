//! Proposed labels: drawn clips whose truth is known, rendered ones, and input that is no clip at all.

use crate::clips::Clips;
use crate::testing::root;
use crate::track::find::{DOUBTFUL, LabelOptions, Proposal, propose_labels};
use crate::{Camera, Error, Picture, Result, Size};
use proptest::prelude::*;
use serde_json::json;

/// Side of the drawn pictures, px.
const SIDE: usize = 128;
/// Samples along a pixel's side that a drawing is averaged over.
const FINE: usize = 8;
const BALL: [f64; 3] = [30.0, 110.0, 120.0];

type Colour = [f64; 3];

/// A camera with so long a lens that a ball's outline is a circle about its centre's image.
fn long_lens(focal_px: f64) -> Camera {
    let middle = (SIDE as f64 - 1.0) / 2.0;
    let file = json!({"width": SIDE, "height": SIDE,
        "intrinsic": [[focal_px, 0, middle], [0, focal_px, middle], [0, 0, 1]],
        "camera_from_world": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]});
    Camera::from_json(&file.to_string(), "camera").unwrap()
}

/// Blotches four pixels wide.
fn texture(x: f64, y: f64) -> Colour {
    let cell = ((x + 1.0) / 4.0) as u64 * 7919 + ((y + 1.0) / 4.0) as u64 * 104_729;
    let level = 120.0 + (cell.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 60) as f64 * 3.0;
    [level, level * 0.95, level * 0.9]
}

/// A picture of what `colour` says at each place, antialiased.
fn picture(colour: impl Fn(f64, f64) -> Colour) -> Picture {
    let mut rgba = Vec::with_capacity(4 * SIDE * SIDE);
    for pixel in 0..SIDE * SIDE {
        let (x, y) = ((pixel % SIDE) as f64, (pixel / SIDE) as f64);
        let offset = |index: usize| (index as f64 + 0.5) / FINE as f64 - 0.5;
        let fine = (0..FINE * FINE).map(|index| colour(x + offset(index % FINE), y + offset(index / FINE)));
        let sum = fine.fold([0.0; 3], |sum, colour| std::array::from_fn(|n| sum[n] + colour[n]));
        rgba.extend(sum.map(|sum| (sum / (FINE * FINE) as f64).round() as u8));
        rgba.push(255);
    }
    Picture::from_rgba(&rgba, Size::square(SIDE as u32)).unwrap()
}

/// Whether a place is in a disc.
fn in_disc([x, y]: [f64; 2], [cx, cy]: [f64; 2], radius: f64) -> bool {
    (x - cx).hypot(y - cy) < radius
}

fn propose(pictures: &[Picture], camera: &Camera) -> Result<Vec<Option<Proposal>>> {
    let read = |frame: usize| Ok(pictures[frame].clone());
    propose_labels(pictures.len(), camera, &LabelOptions::default(), &read, &|| ())
}

/// Labels of a clip in which `colour` is drawn over the texture where it is something.
fn labels(frames: usize, colour: impl Fn(usize, [f64; 2]) -> Option<Colour>) -> Vec<Option<Proposal>> {
    let drawn = |frame| picture(|x, y| colour(frame, [x, y]).unwrap_or_else(|| texture(x, y)));
    propose(&(0..frames).map(drawn).collect::<Vec<_>>(), &long_lens(5000.0)).unwrap()
}

/// Distance of a label from the truth, px.
fn error(label: &Option<Proposal>, [x, y]: [f64; 2]) -> f64 {
    label.map_or(f64::INFINITY, |label| (label.image[0] - x).hypot(label.image[1] - y))
}

/// A throw across the picture.
fn throw(frame: usize) -> [f64; 2] {
    let t = frame as f64;
    [20.3 + 4.37 * t, 70.0 - 5.0 * t + 0.21 * t * t]
}

#[test]
fn a_disc_on_a_textured_background_is_found_to_a_tenth_of_a_pixel() {
    for radius in [3.6, 6.0, 11.5] {
        let labels = labels(20, |frame, place| in_disc(place, throw(frame), radius).then_some(BALL));
        for (frame, label) in labels.iter().enumerate() {
            assert!(error(label, throw(frame)) < 0.1, "radius {radius}, frame {frame}: {label:?}");
            let found = label.unwrap();
            assert!((found.radius_px - radius).abs() < 0.25 && !found.doubtful, "{radius} {frame} {found:?}");
        }
    }
}

#[test]
fn a_spheres_label_is_its_centres_image_not_its_outlines_middle() {
    let focal = 110.0;
    let camera = long_lens(focal);
    // A sphere of radius 0.25 m at 2 m: a place shows it where its ray is within the cone about the centre's.
    let centre = |frame: usize| nalgebra::Point3::new(-0.85 + 0.085 * frame as f64, 0.7 - 0.03 * frame as f64, 2.0);
    let middle = (SIDE as f64 - 1.0) / 2.0;
    let seen = |frame: usize, x: f64, y: f64| {
        let ray = nalgebra::Vector3::new((x - middle) / focal, (y - middle) / focal, 1.0);
        centre(frame).coords.cross(&ray).norm() / ray.norm() < 0.25
    };
    let drawn = |frame| picture(|x, y| if seen(frame, x, y) { BALL } else { texture(x, y) });
    let labels = propose(&(0..20).map(drawn).collect::<Vec<_>>(), &camera).unwrap();
    let (mut largest, mut outlines): (f64, f64) = (0.0, 0.0);
    for (frame, label) in labels.iter().enumerate() {
        let truth = camera.image_from_camera(&centre(frame)).unwrap();
        largest = largest.max(error(label, [truth.x, truth.y]));
        let disc: Vec<[f64; 2]> = (0..SIDE * SIDE)
            .map(|pixel| [(pixel % SIDE) as f64, (pixel / SIDE) as f64])
            .filter(|&[x, y]| seen(frame, x, y))
            .collect();
        let mean = [0, 1].map(|axis| disc.iter().map(|place| place[axis]).sum::<f64>() / disc.len() as f64);
        outlines = outlines.max((mean[0] - truth.x).hypot(mean[1] - truth.y));
    }
    assert!(outlines > 0.5, "the test's ball is too small to tell: {outlines} px");
    assert!(largest < 0.2, "{largest} px");
}

#[test]
fn a_shadow_as_round_as_the_ball_is_not_taken_for_it() {
    let shadow = |frame: usize| [throw(frame)[0] + 9.0, 95.0];
    let labels = labels(24, |frame, place| {
        let shade = texture(place[0], place[1]).map(|level| 0.55 * level);
        let ball = in_disc(place, throw(frame), 6.0).then_some(BALL);
        ball.or(in_disc(place, shadow(frame), 6.5).then_some(shade))
    });
    for (frame, label) in labels.iter().enumerate().filter(|(frame, _)| throw(*frame)[0] < 120.0) {
        assert!(error(label, throw(frame)) < 0.3, "frame {frame}: {label:?}");
    }
}

#[test]
fn a_shadow_that_touches_the_ball_does_not_pull_its_centre() {
    let labels = labels(20, |frame, place| {
        let [x, y] = throw(frame);
        let shade = texture(place[0], place[1]).map(|level| 0.55 * level);
        let ball = in_disc(place, [x, y], 6.0).then_some(BALL);
        ball.or(in_disc(place, [x + 1.0, y + 5.0], 6.0).then_some(shade))
    });
    for (frame, label) in labels.iter().enumerate() {
        assert!(error(label, throw(frame)) < 0.5, "frame {frame}: {label:?}");
    }
}

#[test]
fn a_ball_half_behind_a_box_keeps_its_centre_and_one_behind_it_has_no_label() {
    let truth = |frame: usize| [20.0 + 3.0 * frame as f64, 60.5];
    let labels = labels(30, |frame, place| {
        let hidden = (60.0..80.0).contains(&place[0]) && (40.0..85.0).contains(&place[1]);
        if hidden {
            return Some([200.0, 180.0, 60.0]);
        }
        in_disc(place, truth(frame), 7.0).then_some(BALL)
    });
    for (frame, label) in labels.iter().enumerate() {
        // how far the ball's centre is from the box, px: below 0 it is half hidden, below -7 wholly
        let outside = (60.0 - truth(frame)[0]).max(truth(frame)[0] - 80.0);
        match outside {
            _ if outside >= 0.5 => assert!(error(label, truth(frame)) < 0.5, "frame {frame}: {label:?}"),
            _ if outside <= -7.0 => assert!(label.is_none(), "frame {frame}: {label:?}"),
            _ => assert!(label.is_none_or(|label| label.doubtful || error(&Some(label), truth(frame)) < 1.0)),
        }
    }
}

#[test]
fn of_two_moving_things_the_round_one_is_labelled() {
    let labels = labels(24, |frame, [x, y]| {
        let (left, top) = (100.0 - 3.0 * frame as f64, 90.0);
        let plank = (left..left + 16.0).contains(&x) && (top..top + 12.0).contains(&y);
        in_disc([x, y], throw(frame), 6.0).then_some(BALL).or(plank.then_some([210.0, 60.0, 40.0]))
    });
    for (frame, label) in labels.iter().enumerate().filter(|(frame, _)| throw(*frame)[0] < 120.0) {
        assert!(error(label, throw(frame)) < 0.3, "frame {frame}: {label:?}");
    }
}

#[test]
fn a_bounce_is_followed() {
    let truth = |frame: usize| [15.0 + 4.0 * frame as f64, 100.0 - (7.0 * (frame as f64 - 12.0)).abs()];
    let labels = labels(26, |frame, place| in_disc(place, truth(frame), 5.0).then_some(BALL));
    for (frame, label) in labels.iter().enumerate().filter(|(frame, _)| truth(*frame)[1] > 6.0) {
        assert!(error(label, truth(frame)) < 0.2, "frame {frame}: {label:?}");
    }
}

#[test]
fn nothing_is_labelled_before_the_ball_comes_and_after_it_went() {
    let labels = labels(30, |frame, place| {
        let ball = (8..20).contains(&frame) && in_disc(place, throw(frame - 4), 6.0);
        ball.then_some(BALL)
    });
    for (frame, label) in labels.iter().enumerate() {
        assert_eq!(label.is_some(), (8..20).contains(&frame), "frame {frame}: {label:?}");
    }
}

#[test]
fn no_frames_have_no_labels_and_a_single_one_only_doubtful_ones() {
    assert_eq!(labels(0, |_, _| None), []);
    assert_eq!(labels(12, |_, _| None), [None; 12]);
    let plain = |place| if in_disc(place, [60.0, 50.0], 8.0) { BALL } else { [140.0; 3] };
    let labels = propose(&[picture(|x, y| plain([x, y]))], &long_lens(5000.0)).unwrap();
    assert!(error(&labels[0], [60.0, 50.0]) < 0.2 && labels[0].unwrap().doubtful, "{labels:?}");
}

#[test]
fn a_picture_of_another_size_than_the_cameras_and_radii_that_cannot_be_are_refused() {
    let small = Picture::from_rgba(&[0; 64 * 64 * 4], Size::square(64)).unwrap();
    let error = propose(&[small], &long_lens(500.0)).unwrap_err();
    assert!(matches!(error, Error::Data { .. }) && error.to_string().contains("64×64"), "{error}");
    for radii in [[0.0, 5.0], [8.0, 4.0], [4.0, f64::NAN], [4.0, 1e9]] {
        let options = LabelOptions { radii_px: Some(radii) };
        let read = |_| -> Result<Picture> { panic!("no picture is asked for") };
        let error = propose_labels(3, &long_lens(500.0), &options, &read, &|| ()).unwrap_err();
        assert!(matches!(error, Error::Value { .. }), "{error}");
    }
}

#[test]
fn radii_outside_those_asked_for_are_not_found() {
    let drawn = |frame| picture(|x, y| if in_disc([x, y], throw(frame), 6.0) { BALL } else { texture(x, y) });
    let pictures: Vec<Picture> = (0..12).map(drawn).collect();
    let read = |frame: usize| Ok(pictures[frame].clone());
    let options = LabelOptions { radii_px: Some([12.0, 20.0]) };
    let labels = propose_labels(12, &long_lens(5000.0), &options, &read, &|| ()).unwrap();
    assert!(labels.iter().flatten().all(|label| label.radius_px > 10.0), "{labels:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn whatever_the_pictures_labels_are_finite_and_within_bounds(
        frames in 1_usize..9,
        side in 16_usize..40,
        focal in 1.0..500.0_f64,
        k1 in -1.0..1.0_f64,
        bytes in prop::collection::vec(any::<u8>(), 64..2048),
        repeat in 1_usize..5,
    ) {
        let file = json!({"width": side, "height": side, "intrinsic": [[focal, 0, 8], [0, focal, 8], [0, 0, 1]],
            "camera_from_world": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
            "distortion": {"k1": k1, "k2": 0, "p1": 0, "p2": 0, "k3": 0}});
        let camera = Camera::from_json(&file.to_string(), "camera").unwrap();
        let drawn = |frame: usize| {
            let byte = |index: usize| bytes[(index / repeat + frame * 31) % bytes.len()];
            Picture::from_rgba(&(0..4 * side * side).map(byte).collect::<Vec<_>>(), Size::square(side as u32)).unwrap()
        };
        let pictures: Vec<Picture> = (0..frames).map(drawn).collect();
        let labels = propose(&pictures, &camera).unwrap();
        prop_assert_eq!(labels.len(), frames);
        for label in labels.into_iter().flatten() {
            prop_assert!(label.image.iter().all(|value| value.is_finite()) && label.radius_px > 0.0);
            prop_assert!((0.0..1.0).contains(&label.confidence) && label.doubtful == (label.confidence < DOUBTFUL));
        }
    }
}

#[test]
fn rendered_clips_are_labelled_within_a_pixel_or_said_to_be_doubtful() {
    let clips = Clips::read(&root().join("tests/samples")).unwrap();
    let (mut frames, mut close, mut sure) = (0, 0, 0);
    for clip in &clips.clips {
        let read = |frame: usize| clips.picture(clip, &clip.frames[frame]);
        let labels = propose_labels(clip.frames.len(), &clip.camera, &LabelOptions::default(), &read, &|| ()).unwrap();
        for (label, frame) in labels.iter().zip(&clip.frames) {
            let error = error(label, frame.image.unwrap());
            (frames, close) = (frames + 1, close + usize::from(error < 1.0));
            sure += usize::from(label.is_some_and(|label| !label.doubtful));
            assert!(label.is_none_or(|label| label.doubtful) || error < 1.0, "{:?}: {label:?}", frame.file);
        }
    }
    assert!(close * 10 >= frames * 9 && sure * 10 >= frames * 8, "{close} of {frames} within 1 px, {sure} sure");
}
