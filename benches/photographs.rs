//! How often a model that reads sizes takes a photograph without a ball for one with a ball, and how often it finds a ball:
//! `cargo bench --bench photographs -- FOLDER [CARD]`.
//!
//! The folder holds `negatives/` (pictures without a ball), `balls/` (with balls) and `balls.csv` (`file,x,y,radius_px`). The cameras are
//! not known, so one is made up for each picture (focal length: the longer side), and depths are not scored. A ball is found where the
//! first detection is within half a radius, at least 3 px, of a labelled one.
//!
//! `cargo bench --bench photographs -- fit FOLDER [CARD]` fits the weights of the confidence (`ODDS` in `src/localise/closer.rs`) to
//! the photographs without a ball in FOLDER, which the model must not have been trained with: as they are and with a drawn ball, half
//! each.

mod common;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use gravisight::internal::{RandomScenes, read_photographs};
use gravisight::{Camera, Card, Device, LocaliseOptions, Localiser, Picture, Size};
use nalgebra::{SMatrix, SVector};
use pollster::block_on;

/// The ball's radius, m: scales the depths, which are not scored.
const BALL_RADIUS: f64 = 0.11;
/// Detections that are asked for.
const CANDIDATES: usize = 5;
/// Least distance within which a ball is found, px.
const NEAR_PX: f64 = 3.0;
/// Confidences above which a wrong detection is counted.
const SURE: [f64; 2] = [0.5, 0.9];

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

/// Drawings of each photograph that the weights are fitted to; of each every other shows a ball.
const DRAWINGS: u64 = 8;
/// Newton's steps of the fit; it has converged after a few.
const NEWTON_STEPS: usize = 30;
/// Strength of the prior that keeps the weights finite where everything is told apart.
const RIDGE: f64 = 1e-3;

/// Fits the weights of the confidence.
fn fit(folder: &Path, localiser: &Localiser) {
    let photographs = read_photographs(folder).unwrap();
    let scenes = [1.0, 0.0].map(|empty| RandomScenes::new(vec![], empty));
    let (mut rows, mut labels) = (vec![], vec![]);
    for (number, photograph) in photographs.iter().enumerate() {
        for drawing in 0..DRAWINGS {
            let seed = DRAWINGS * number as u64 + drawing;
            let drawing = scenes[(drawing % 2) as usize].draw_before(photograph, seed, 1);
            for found in block_on(localiser.evidence(&Picture::from_rgb(drawing.picture()))).unwrap() {
                let [first, crop, verifier, size] = found.features;
                rows.push(SVector::from([1.0, first, crop, verifier, size]));
                let is_ball = drawing.balls.iter().any(|ball| {
                    let [x, y] = ball.centre;
                    (found.outline.centre.x - x).hypot(found.outline.centre.y - y) <= NEAR_PX.max(ball.radius / 2.0)
                });
                labels.push(f64::from(u8::from(is_ball)));
            }
        }
    }
    let mut weights = SVector::<f64, 5>::zeros();
    for _ in 0..NEWTON_STEPS {
        let (mut slope, mut bend) = (weights * -RIDGE, SMatrix::identity() * RIDGE);
        for (row, label) in rows.iter().zip(&labels) {
            let probability = 1.0 / (1.0 + (-weights.dot(row)).exp());
            slope += row * (label - probability);
            bend += row * row.transpose() * probability * (1.0 - probability);
        }
        weights += bend.cholesky().unwrap().solve(&slope);
    }
    let weights: Vec<String> = weights.iter().map(|weight| format!("{weight:.3}")).collect();
    let balls = labels.iter().sum::<f64>();
    println!("{} candidates, {balls} of them balls: {}", rows.len(), weights.join(", "));
}

/// Confidence and place (px) of each detection, the first one first.
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
    if let [first, folder, rest @ ..] = arguments.as_slice()
        && first == "fit"
    {
        return fit(Path::new(folder), &localiser(rest.first()));
    }
    let [folder, rest @ ..] = arguments.as_slice() else {
        return println!("usage: cargo bench --bench photographs -- FOLDER [CARD]");
    };
    let folder = Path::new(folder);
    let localiser = localiser(rest.first());

    let surest = |path: &PathBuf| detections(&localiser, path).iter().fold(0.0, |most: f64, (p, _)| most.max(*p));
    let negatives: Vec<f64> = pictures(&folder.join("negatives")).iter().map(surest).collect();
    let surer = |limit: f64| percent(negatives.iter().filter(|&&p| p >= limit).count(), negatives.len());
    println!(
        "{} without a ball: confidence from {} on in {:.1} %, from {} on in {:.1} %",
        negatives.len(),
        SURE[0],
        surer(SURE[0]),
        SURE[1],
        surer(SURE[1])
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
        wrong += usize::from(found.first().is_some_and(|(p, image)| *p >= SURE[0] && !is_ball(*image)));
    }
    let share = |count| percent(count, labels.len());
    println!(
        "{} with a ball: the first detection is one in {:.0} %, one of {CANDIDATES} in {:.0} %; the first is none and has a confidence from {} on in {:.0} %",
        labels.len(),
        share(first),
        share(among),
        SURE[0],
        share(wrong)
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
