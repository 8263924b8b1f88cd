//! The published models: their files, their cards, and that they know when there is no ball.

use std::path::PathBuf;

use crate::common::root;
use gravisight::Camera;
use gravisight::Card;
use gravisight::Device;
use gravisight::LocaliseOptions;
use gravisight::Localiser;
use gravisight::Picture;
use gravisight::internal::{Engine as _, Set, Shot, Split, Studio};
use image::RgbImage;
use nalgebra::Point3;
use serde_json::Value;

/// Largest weights file, bytes.
const LARGEST: u64 = 3_000_000;
/// Balls looked for by each model, spread over its shots.
const BALLS: usize = 324;
/// Of one clip, at most.
const OF_A_CLIP: usize = 12;
/// How much larger the mean distance to the truth may be on these than on the card's thousands.
const SLACK: f64 = 1.5;

/// Name, set, what the mean DtG must reach where it was trained, and elsewhere (cm).
const MODELS: [(&str, Set, [f64; 2]); 6] = [
    ("sd-s", Set::SdS, [4.0, f64::NAN]),
    ("sd-s-1px", Set::SdS, [7.0, f64::NAN]),
    ("sd-s-future", Set::SdS, [12.0, f64::NAN]),
    ("sd-m", Set::SdM, [6.0, 12.0]),
    ("sd-l", Set::SdL, [6.0, 12.0]),
    ("spring", Set::Spring, [4.0, f64::NAN]),
];

fn file(name: &str, extension: &str) -> PathBuf {
    root().join("models").join(format!("{name}.{extension}"))
}

fn card(name: &str) -> Card {
    Card::from_file(&file(name, "json")).unwrap()
}

fn localiser(name: &str) -> Localiser {
    Localiser::new(card(name), std::fs::read(file(name, "safetensors")).unwrap(), &Device::flex()).unwrap()
}

fn confidence(localiser: &Localiser, picture: &RgbImage, camera: &Camera) -> (f64, Point3<f64>) {
    let picture = Picture::from_rgb(picture.clone());
    let found = pollster::block_on(localiser.localise(&picture, camera, LocaliseOptions::default())).unwrap();
    (found.confidence, found.world.into())
}

#[test]
fn every_model_is_small_and_says_what_it_is_for() {
    for (name, ..) in MODELS {
        assert!(std::fs::metadata(file(name, "safetensors")).unwrap().len() <= LARGEST, "{name}");
        let card = card(name);
        assert!(!card.description.is_empty() && card.confidence_threshold.is_some(), "{name}");
        assert_eq!(card.licence, "MIT OR Apache-2.0", "{name}");
        let text = std::fs::read_to_string(file(name, "md")).unwrap();
        let mean = card.metrics["dtg"]["mean"].as_f64().unwrap() * 100.0;
        assert!(text.contains(&format!("{mean:.1} ±")), "{name}.md lacks the card's mean of {mean:.1} cm");
    }
}

#[test]
fn the_cards_hold_what_the_project_promises() {
    let mean = |statistic: &Value| statistic["mean"].as_f64().unwrap() * 100.0;
    for (name, set, [known, other]) in MODELS {
        let metrics = card(name).metrics;
        assert!(metrics["image_error_px"]["median"].as_f64().unwrap() <= 0.3, "{name}");
        if matches!(set, Set::SdS | Set::Spring) {
            assert!(mean(&metrics["dtg"]) <= known, "{name}");
            continue;
        }
        for (camera, statistic) in metrics["per_camera"].as_object().unwrap() {
            let limit = if ["cam7", "cam8", "cam9"].contains(&camera.as_str()) { other } else { known };
            assert!(mean(statistic) <= limit, "{name} {camera}: {}", mean(statistic));
        }
    }
}

/// What a model made of one shot of its test set, drawn anew.
#[derive(Default)]
struct Seen {
    empty: usize,
    refused: usize,
    balls: usize,
    missed: usize,
    /// Sum of the distances to the truth, m.
    distance: f64,
}

impl Seen {
    /// Looks at empty pictures of the shot and at `balls` visible balls.
    fn look(&mut self, localiser: &Localiser, threshold: f64, shot: Shot, balls: usize) {
        let studio = Studio::new(shot).unwrap();
        let mut engine = studio.builtin();
        let nowhere = engine.picture(&Point3::new(0.0, 0.0, -1000.0)).unwrap();
        for noise in 0..4 {
            self.empty += 1;
            let confidence = confidence(localiser, &noisy(&nowhere, noise), studio.camera()).0;
            self.refused += usize::from(confidence < threshold);
        }
        // A few frames of several clips: neighbouring frames are alike.
        for number in 0..balls.div_ceil(OF_A_CLIP) {
            let clip = studio.clip(&mut engine, 99, Split::Test, shot.camera + number).unwrap();
            let visible: Vec<_> = clip.frames.iter().filter(|frame| frame.visible).collect();
            for frame in visible.iter().step_by(visible.len().div_ceil(OF_A_CLIP.min(balls))) {
                let truth = Point3::from(frame.world.unwrap());
                let (confidence, found) = confidence(localiser, &engine.picture(&truth).unwrap(), &clip.camera);
                self.balls += 1;
                self.missed += usize::from(confidence < threshold);
                self.distance += (found - truth).norm();
            }
        }
    }
}

#[test]
#[ignore = "long: a quarter of a minute; scripts/test runs it"]
fn visible_balls_are_found_as_well_as_the_card_says_and_scenes_without_one_are_refused() {
    for (name, set, _) in MODELS {
        let (localiser, card) = (localiser(name), card(name));
        let shots = set.shots(Split::Test);
        let mut seen = Seen::default();
        for shot in &shots {
            seen.look(&localiser, card.confidence_threshold.unwrap(), *shot, BALLS / shots.len());
        }
        let Seen { empty, refused, balls, missed, distance } = seen;
        let mean = distance / balls as f64;
        let promised = card.metrics["dtg_visible"]["mean"].as_f64().unwrap();
        println!("{name}: {refused} of {empty} empty pictures refused, {missed} of {balls} visible balls missed");
        println!("{name}: {:.2} cm from the truth, the card says {:.2}", mean * 100.0, promised * 100.0);
        assert!(refused * 100 >= empty * 99, "{name}: {refused} of {empty} refused");
        assert!(missed * 100 <= balls, "{name}: {missed} of {balls} missed");
        assert!(mean <= SLACK * promised, "{name}: {mean} m from the truth, the card says {promised} m");
    }
}

/// The picture with noise of up to ±`by` of 255 on every channel.
fn noisy(picture: &RgbImage, by: i32) -> RgbImage {
    let mut state = 1_u32;
    let mut picture = picture.clone();
    for value in picture.iter_mut() {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let noise = (state >> 16) as i32 % (2 * by + 1) - by;
        *value = (i32::from(*value) + noise).clamp(0, 255) as u8;
    }
    picture
}
