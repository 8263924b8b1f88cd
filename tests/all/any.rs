//! `any`: a model that reads apparent size, on scenes and sizes of pictures that it was not trained on.

use std::sync::LazyLock;

use crate::common::{median, root};
use gravisight::internal::{Engine as _, Set, Split, Studio};
use gravisight::{
    Camera, Card, Clip, Clips, Device, Error, Frame, Localisation, LocaliseOptions, Localiser, Picture, Region, Result,
    Size,
};
use image::imageops::{self, FilterType};
use image::{Rgb, RgbImage};
use nalgebra::Point3;

/// The samples' ball, m.
const RADIUS: f64 = 0.2;
/// Share of the samples on which a single picture's depth must be within 15 %: stray sparks are the calibration's.
const MOSTLY: f64 = 0.95;

static ANY: LazyLock<Localiser> = LazyLock::new(|| {
    let (card, weights) = Card::with_weights(&root().join("models/any.json")).unwrap();
    Localiser::new(card, weights, &Device::flex()).unwrap()
});

fn options() -> LocaliseOptions {
    LocaliseOptions { ball_radius: Some(RADIUS), ..LocaliseOptions::default() }
}

fn localise(rgb: &RgbImage, camera: &Camera, options: LocaliseOptions) -> Result<Localisation> {
    pollster::block_on(ANY.localise(&Picture::from_rgb(rgb.clone()), camera, options))
}

/// The samples that show the whole ball.
fn samples() -> Vec<(Clip, Frame, RgbImage)> {
    let clips = Clips::read(&root().join("tests/samples")).unwrap();
    let frames = clips.clips.iter().flat_map(|clip| clip.frames.iter().map(move |frame| (clip, frame)));
    frames
        .filter(|(_, frame)| frame.visible)
        .map(|(clip, frame)| (clip.clone(), frame.clone(), clips.picture(clip, frame).unwrap().rgb().clone()))
        .collect()
}

fn off(found: &Localisation, clip: &Clip, frame: &Frame) -> f64 {
    let depth = clip.camera.camera_from_world(&frame.world.unwrap().into()).z;
    (found.depth / depth - 1.0).abs()
}

/// A sample on which the model is right, its camera and its frame.
fn good() -> (Clip, Frame, RgbImage) {
    let is_good = |(clip, frame, rgb): &(Clip, Frame, RgbImage)| {
        let found = localise(rgb, &clip.camera, options()).unwrap();
        off(&found, clip, frame) < 0.05 && found.confidence > 0.8
    };
    samples().into_iter().find(is_good).expect("a sample that it knows")
}

#[test]
fn scenes_that_it_never_saw() {
    let samples = samples();
    let found: Vec<(f64, Localisation)> = (samples.iter())
        .map(|(clip, frame, rgb)| {
            let found = localise(rgb, &clip.camera, options()).unwrap();
            (off(&found, clip, frame), found)
        })
        .collect();
    let share = |of: &dyn Fn(&(f64, Localisation)) -> bool| {
        found.iter().filter(|it| of(it)).count() as f64 / found.len() as f64
    };
    let near = share(&|(off, _)| *off < 0.15);
    let within = share(&|(off, it)| off * it.depth <= 3.0 * it.depth_sigma.unwrap());
    let median = median(&found.iter().map(|(off, _)| *off).collect::<Vec<_>>());
    println!("{} samples: median {median:.4}, {near:.2} within 15 %, {within:.2} within 3 sigma", found.len());
    assert!(near >= MOSTLY && within >= MOSTLY, "{near} {within}");
    assert!(median < 1.3 * 0.0027, "median {median}");
    for (_, it) in &found {
        // Symmetric, positive, and longest along the view.
        let covariance = it.covariance.unwrap();
        let trace: f64 = (0..3).map(|axis| covariance[axis][axis]).sum();
        assert!((0..3).all(|axis| covariance[axis][axis] > 0.0) && covariance[0][1] == covariance[1][0]);
        let sigma = it.depth_sigma.unwrap();
        assert!(trace >= sigma * sigma && trace < 3.0 * sigma * sigma, "{trace} {sigma}");
    }
}

#[test]
fn a_cards_calibration_counts_and_is_checked() {
    let (mut card, weights) = Card::with_weights(&root().join("models/any.json")).unwrap();
    let (clip, _, rgb) = good();
    let mut calibration = gravisight::model::DetectionCalibration::default();
    calibration.ball_log_odds[0] -= 20.0;
    card.calibration = Some(calibration);
    let strict = Localiser::new(card.clone(), weights, &Device::flex()).unwrap();
    let found = pollster::block_on(strict.localise(&Picture::from_rgb(rgb), &clip.camera, options())).unwrap();
    assert!(found.confidence < 0.01, "{}", found.confidence);
    calibration.network_sigma_factor = 0.0;
    card.calibration = Some(calibration);
    let error = Card::from_json(&card.to_json().unwrap(), "card").unwrap_err().to_string();
    assert!(error.contains("calibration") && error.contains("network_sigma_factor"), "{error}");
}

#[test]
fn what_must_be_said_is_asked_for() {
    let (clip, _, rgb) = &samples()[0];
    let reason = |options: LocaliseOptions| match localise(rgb, &clip.camera, options) {
        Err(error @ Error::Value { .. }) => error.to_string(),
        other => panic!("{other:?}"),
    };
    let none = reason(LocaliseOptions::default());
    assert!(none.contains("radius") && none.contains("--ball-radius"), "{none}");
    for wrong in [0.0, -0.2, f64::NAN, f64::INFINITY] {
        assert!(reason(LocaliseOptions { ball_radius: Some(wrong), ..options() }).contains("positive"), "{wrong}");
    }
    // In millimetres by mistake: what was meant.
    let millimetres = reason(LocaliseOptions { ball_radius: Some(33.5), ..options() });
    assert!(millimetres.contains("larger than any ball") && millimetres.contains("0.0335"), "{millimetres}");
    for region in [
        Region { left: 200, top: 0, width: 64, height: 64 },
        Region { left: 0, top: 0, width: 8, height: 64 },
        Region { left: u32::MAX, top: 0, width: 64, height: 64 },
    ] {
        assert!(reason(LocaliseOptions { region: Some(region), ..options() }).contains("224×224"));
    }
}

#[test]
fn a_picture_without_a_ball_is_refused() {
    let threshold = ANY.card().confidence_threshold.unwrap();
    // The scenes of the samples, with the ball far behind the camera.
    let shots = Set::SdL.shots(Split::Test);
    let (mut refused, mut most) = (0, 0.0_f64);
    for shot in &shots {
        let studio = Studio::new(*shot).unwrap();
        let empty = studio.builtin().picture(&Point3::new(0.0, 0.0, -1000.0)).unwrap();
        let found = localise(&empty, studio.camera(), options()).unwrap();
        let noted = found.notes.iter().any(|note| note.contains("no ball found"));
        assert_eq!([noted, !found.ball_found], [found.confidence < threshold; 2], "{found:?}");
        refused += usize::from(noted);
        most = most.max(found.confidence);
    }
    println!(
        "{refused} of {} empty scenes refused; the largest confidence is {most:.3}, the threshold {threshold}",
        shots.len()
    );
    assert_eq!(refused, shots.len());
}

#[test]
fn candidates_come_in_order() {
    for (clip, _, rgb) in samples().iter().take(6) {
        let found = localise(rgb, &clip.camera, LocaliseOptions { candidates: 5, ..options() }).unwrap();
        let plain = localise(rgb, &clip.camera, options()).unwrap();
        assert!(plain.candidates.is_empty() && (1..=5).contains(&found.candidates.len()));
        let first = found.candidates[0];
        assert_eq!((first.image, first.world, first.confidence), (plain.image, plain.world, plain.confidence));
        assert!(found.candidates.is_sorted_by(|a, b| a.confidence >= b.confidence));
        assert!(found.candidates.iter().all(|it| (0.0..=1.0).contains(&it.confidence)));
    }
}

/// `rgb` in a larger picture of its mean colours, its first pixel at (`left`, `top`), and the camera of that.
fn within(rgb: &RgbImage, camera: &Camera, [left, top]: [u32; 2], size: Size) -> (RgbImage, Camera) {
    let edge = |x: u32, y: u32| rgb.get_pixel(x.min(rgb.width() - 1), y.min(rgb.height() - 1));
    let mut large = RgbImage::from_fn(size.width, size.height, |x, y| {
        *edge(x.saturating_sub(left).min(rgb.width() - 1), y.saturating_sub(top))
    });
    imageops::replace(&mut large, rgb, left.into(), top.into());
    (large, camera.cropped([-f64::from(left), -f64::from(top)], size).unwrap())
}

#[test]
fn a_large_picture_is_searched_at_its_own_resolution() {
    let (clip, frame, rgb) = good();
    let alone = localise(&rgb, &clip.camera, options()).unwrap();
    // Whole, and in tiles whose edges meet in the ball.
    let ball = frame.image.unwrap().map(|at| at as u32);
    let at_seam = [900 - ball[0].min(200), 896 - ball[1].min(200)];
    for (place, size) in [([640, 320], Size::new(1280, 720)), (at_seam, Size::new(2000, 1504))] {
        let (large, camera) = within(&rgb, &clip.camera, place, size);
        let found = localise(&large, &camera, options()).unwrap();
        assert!((found.depth / alone.depth - 1.0).abs() < 0.03, "{size}: {found:?} {alone:?}");
        let apart: f64 = (0..3).map(|axis| (found.world[axis] - alone.world[axis]).powi(2)).sum::<f64>().sqrt();
        assert!(apart < 0.03 * alone.depth, "{size}: {apart} m");
        // A region around it says the same; one without it does not find it.
        let around = Region { left: place[0], top: place[1], width: 224, height: 224 };
        let found = localise(&large, &camera, LocaliseOptions { region: Some(around), ..options() }).unwrap();
        assert!((found.depth / alone.depth - 1.0).abs() < 0.03, "{size}: {found:?} {alone:?}");
        let elsewhere = Region { left: 0, top: 0, width: 160, height: 160 };
        let found = localise(&large, &camera, LocaliseOptions { region: Some(elsewhere), ..options() }).unwrap();
        assert!(found.image.iter().all(|at| (-0.5..=159.5).contains(at)), "{found:?}");
    }
}

#[test]
fn a_ball_beside_the_search_region_is_not_found_in_it() {
    let (clip, frame, rgb) = good();
    let (large, camera) = within(&rgb, &clip.camera, [640, 320], Size::new(1280, 720));
    let ball = [0, 1].map(|axis| frame.image.unwrap()[axis] + [640.0, 320.0][axis]);
    let mut beside = 0;
    for gap in [2, 9, 17, 25] {
        // The network's input goes on beyond the right and lower edges, up to a multiple of 32 px.
        let [right, bottom] = ball.map(|at| at as u32 - gap);
        for (left, top, width, height) in [
            (right - 131, ball[1] as u32 - 60, 131, 130),
            (ball[0] as u32 - 60, bottom - 99, 130, 99),
            (ball[0] as u32 + gap, ball[1] as u32 - 60, 131, 130),
        ] {
            let region = Region { left, top, width, height };
            let options = LocaliseOptions { region: Some(region), candidates: 5, ..options() };
            let found = localise(&large, &camera, options).unwrap();
            for candidate in &found.candidates {
                let [x, y] = candidate.image;
                let edge = |start: u32, side: u32| f64::from(start) - 0.5..=f64::from(start + side) - 0.5;
                assert!(edge(left, width).contains(&x) && edge(top, height).contains(&y), "{region:?}: {candidate:?}");
            }
            beside += 1;
        }
    }
    assert_eq!(beside, 12);
}

#[test]
fn a_ball_that_fills_the_picture_is_seen_in_a_smaller_one() {
    let (clip, _, rgb) = good();
    let alone = localise(&rgb, &clip.camera, options()).unwrap();
    let times = (150.0 / alone.radius_px.unwrap()).ceil() as u32;
    let large = imageops::resize(&rgb, 224 * times, 224 * times, FilterType::Triangle);
    let found = localise(&large, &clip.camera, options()).unwrap();
    assert!(found.radius_px.unwrap() > 100.0, "{found:?}");
    assert!((found.depth / alone.depth - 1.0).abs() < 0.1, "{found:?} {alone:?}");
}

#[test]
fn a_grey_camera_will_do() {
    let (clip, _, rgb) = good();
    let alone = localise(&rgb, &clip.camera, options()).unwrap();
    let grey = RgbImage::from_fn(rgb.width(), rgb.height(), |x, y| {
        let level = imageops::grayscale(&imageops::crop_imm(&rgb, x, y, 1, 1).to_image()).get_pixel(0, 0).0[0];
        Rgb([level; 3])
    });
    let found = localise(&grey, &clip.camera, options()).unwrap();
    assert!((found.depth / alone.depth - 1.0).abs() < 0.1, "{found:?} {alone:?}");
}

#[test]
fn a_wide_camera_without_a_lens_is_named() {
    let (clip, _, rgb) = good();
    let size = clip.camera.size();
    let wide = format!(
        r#"{{"width": {}, "height": {}, "intrinsic": [[60, 0, -100], [0, 60, 111.5], [0, 0, 1]],
            "camera_from_world": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}}"#,
        size.width, size.height
    );
    let found = localise(&rgb, &Camera::from_json(&wide, "wide").unwrap(), options()).unwrap();
    assert!(found.notes.iter().any(|note| note.contains("off the camera's axis")), "{:?}", found.notes);
}

#[test]
fn models_that_know_their_scene_take_whole_pictures() {
    let (card, weights) = Card::with_weights(&root().join("models/sd-l.json")).unwrap();
    let known = Localiser::new(card, weights, &Device::flex()).unwrap();
    let (clip, _, rgb) = &samples()[0];
    let picture = Picture::from_rgb(rgb.clone());
    let found = pollster::block_on(known.localise(&picture, &clip.camera, LocaliseOptions::default())).unwrap();
    assert_eq!((found.depth_sigma, found.radius_px, found.covariance), (None, None, None));
    let options = LocaliseOptions { candidates: 3, ..LocaliseOptions::default() };
    let error = pollster::block_on(known.localise(&picture, &clip.camera, options)).unwrap_err();
    assert!(error.to_string().contains("candidates"), "{error}");
}
