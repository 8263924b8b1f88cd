//! False positives of a model that reads sizes on photographs without a ball, and its recall on photographs with one:
//! `cargo bench --bench photographs -- FOLDER [CARD]`.
//!
//! The folder holds `negatives/` (pictures without a ball), `balls/` (with balls) and `balls.csv` (`file,x,y,radius_px`). The cameras are
//! not known, so one is made up for each picture (focal length: the longer side), and depths are not scored. A ball is found where the
//! first detection is within half a radius, at least 3 px, of a labelled one.

mod common;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use gravisight::internal::RandomScenes;
use gravisight::{Camera, Card, Device, LocaliseOptions, Localiser, Picture, Size};
use pollster::block_on;

/// The ball's radius, m: scales the depths, which are not scored.
const BALL_RADIUS: f64 = 0.11;
/// Detections of each picture that are scored.
const CANDIDATES: usize = 5;
/// Least distance within which a ball is found, px.
const NEAR_PX: f64 = 3.0;
/// Confidences above which a false positive is counted.
const THRESHOLDS: [f64; 2] = [0.5, 0.9];

#[derive(serde::Deserialize)]
struct Ball {
    file: String,
    x: f64,
    y: f64,
    radius_px: f64,
}

fn localiser(card: Option<&String>) -> Localiser {
    let card = card.map_or(concat!(env!("CARGO_MANIFEST_DIR"), "/models/any.json"), String::as_str);
    let (card, weights) = Card::with_weights(Path::new(card)).unwrap();
    Localiser::new(card, weights, &Device::flex()).unwrap()
}

/// Confidence and position (px) of each detection, the first one first.
fn detections(localiser: &Localiser, path: &Path) -> Vec<(f64, [f64; 2])> {
    let picture = Picture::decode(&std::fs::read(path).unwrap()).unwrap();
    let Size { width, height } = picture.size();
    let [focal, x, y] = [f64::from(width.max(height)), f64::from(width - 1) / 2.0, f64::from(height - 1) / 2.0];
    // 1.6 m above the ground and level.
    let camera = format!(
        r#"{{"intrinsic": [[{focal}, 0, {x}], [0, {focal}, {y}], [0, 0, 1]], "width": {width}, "height": {height},
            "camera_from_world": [[1, 0, 0, 0], [0, 0, -1, 1.6], [0, 1, 0, 0], [0, 0, 0, 1]]}}"#
    );
    let camera = Camera::from_json(&camera, "camera").unwrap();
    let options =
        LocaliseOptions { ball_radius: Some(BALL_RADIUS), candidates: CANDIDATES, ..LocaliseOptions::default() };
    let found = block_on(localiser.localise(&picture, &camera, options)).unwrap();
    found.candidates.iter().map(|candidate| (candidate.confidence, candidate.image)).collect()
}

fn pictures(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

fn percent(count: usize, of: usize) -> f64 {
    100.0 * count as f64 / of.max(1) as f64
}

fn main() {
    let mut arguments = common::arguments();
    if common::is_check() {
        arguments.push(small_set().to_string_lossy().into_owned());
    }
    let [folder, rest @ ..] = arguments.as_slice() else {
        return println!("usage: cargo bench --bench photographs -- FOLDER [CARD]");
    };
    let folder = Path::new(folder);
    let localiser = localiser(rest.first());

    let highest = |path: &PathBuf| detections(&localiser, path).iter().fold(0.0, |most: f64, (p, _)| most.max(*p));
    let negatives: Vec<f64> = pictures(&folder.join("negatives")).iter().map(highest).collect();
    let above = |limit: f64| percent(negatives.iter().filter(|&&p| p >= limit).count(), negatives.len());
    println!(
        "{} without a ball: false positives at a confidence of {} and more {:.1} %, of {} and more {:.1} %",
        negatives.len(),
        THRESHOLDS[0],
        above(THRESHOLDS[0]),
        THRESHOLDS[1],
        above(THRESHOLDS[1])
    );

    let mut labels: BTreeMap<String, Vec<Ball>> = BTreeMap::new();
    for ball in csv::Reader::from_path(folder.join("balls.csv")).unwrap().deserialize() {
        let ball: Ball = ball.unwrap();
        labels.entry(ball.file.clone()).or_default().push(ball);
    }
    let (mut first, mut among, mut wrong) = (0, 0, 0);
    for (file, balls) in &labels {
        let found = detections(&localiser, &folder.join("balls").join(file));
        let is_ball = |[x, y]: [f64; 2]| {
            balls.iter().any(|ball| (x - ball.x).hypot(y - ball.y) <= NEAR_PX.max(ball.radius_px / 2.0))
        };
        first += usize::from(found.first().is_some_and(|(_, image)| is_ball(*image)));
        among += usize::from(found.iter().any(|(_, image)| is_ball(*image)));
        wrong += usize::from(found.first().is_some_and(|(p, image)| *p >= THRESHOLDS[0] && !is_ball(*image)));
    }
    let fraction = |count| percent(count, labels.len());
    println!(
        "{} with a ball: recall of the first detection {:.0} %, of the first {CANDIDATES} {:.0} %; first detection a false positive at a confidence of {} and more in {:.0} %",
        labels.len(),
        fraction(first),
        fraction(among),
        THRESHOLDS[0],
        fraction(wrong)
    );
    if common::is_check() {
        std::fs::remove_dir_all(folder).unwrap();
    }
}

/// A rendering without a ball and one with, as such a folder.
fn small_set() -> PathBuf {
    let folder = common::scratch("photographs");
    let scenes = RandomScenes::new(vec![], 0.5);
    let drawings: Vec<_> = (0..64).map(|seed| scenes.draw(Size::square(96), seed, 1)).collect();
    let empty = drawings.iter().find(|drawing| drawing.balls.is_empty()).unwrap();
    let with = drawings.iter().find(|drawing| !drawing.balls.is_empty()).unwrap();
    for (name, drawing) in [("negatives", empty), ("balls", with)] {
        std::fs::create_dir_all(folder.join(name)).unwrap();
        drawing.picture().save(folder.join(name).join("0.png")).unwrap();
    }
    let ball = with.balls[0];
    let [x, y] = ball.centre;
    std::fs::write(folder.join("balls.csv"), format!("file,x,y,radius_px\n0.png,{x},{y},{}\n", ball.radius)).unwrap();
    folder
}
