//! Fits the weights behind a model's confidence and σ, the fields of its card's `calibration`, and prints them. `scripts/fit-weights` runs it:
//!
//! - `cargo bench --bench all -- weights confidence FOLDER [CARD]`: `ball_log_odds` and `first_pass_log_odds`, by logistic regression on the
//!   candidates in the photographs of FOLDER, which the model must not have been trained with. Photographs without a ball count as they are and
//!   with a drawn ball, half each; those that FOLDER's `labels.csv` names, if any, as they are. Pictures with a ball weigh as much as those
//!   without. Beside them what a least probability by the first pass (`MIN_FIRST_PASS`) saves, and what it costs.
//! - `cargo bench --bench all -- weights edge [FOLDER] [CARD]`: `edge_log_odds`, `edge_log_sigma` and `network_sigma_factor`, by maximum
//!   likelihood on random renderings (with the photographs of FOLDER behind, if given): the error of log(radius) is Laplace-distributed, its
//!   location the mean of edge and network that the first weights give, its scale by the second. Half of the balls that FOLDER's `labels.csv`
//!   gives radii of (`quality` A) are fitted, too. The likelihood of the card's weights stands beside that of the fitted ones, on other
//!   renderings than were fitted, and on the other half of the labelled balls.

use std::path::Path;

use gravisight::internal::{Apparent, LabelledPhotograph, Photographs, RandomScenes};
use gravisight::model::DetectionCalibration;
use gravisight::{Camera, Card, Device, Localiser, Picture, Size};
use image::RgbImage;
use nalgebra::{SMatrix, SVector};
use pollster::block_on;

/// Drawings of each photograph that the confidence is fitted to; every other one shows a ball.
const DRAWINGS: u64 = 8;
/// Largest distance of a detection from the ball's centre, px, or half the radius.
const NEAR_PX: f64 = 3.0;
/// Newton's steps of the logistic regression; it has converged after a few.
const NEWTON_STEPS: usize = 30;
/// Strength of the prior that keeps the weights finite where the classes can be separated.
const RIDGE: f64 = 1e-3;

/// Weight of the logarithm of the number of cells searched: half of the pictures show a ball, and it is as likely in each of their cells. It is
/// not fitted, since photographs with and without a ball may be of different sizes.
const OF_CELLS: f64 = -1.0;
/// Least probabilities by the first pass that are compared, and the probability from which a ball is found.
const FIRST_PASSES: [f64; 6] = [0.002, 0.005, 0.01, 0.02, 0.05, 0.1];
const FOUND: f64 = 0.5;
/// Renderings that the edge's weights are fitted to, and those that the result is scored on; the seed of the first (a training's seeds come
/// from a hash, `benches/random.rs` takes those from 2⁴⁰ on).
const FITTED: u64 = 12_000;
const SCORED: u64 = 3_000;
const FIRST_SEED: u64 = 1 << 41;
/// Side of the renderings, px.
const SIDE: u32 = 256;
/// Standard deviation of a labelled log(radius): boxes of quality A are tight to about a tenth, four in five within a twentieth.
const LABEL_SIGMA: f64 = 0.04;
/// What the labelled balls weigh together, over the renderings. Chosen: they are few, and all that is real.
const LABELLED_WEIGHT: f64 = 0.5;
/// Steps of the descent (Adam), its learning rate at the start; it falls to zero.
const DESCENT_STEPS: usize = 4_000;
const LEARNING_RATE: f64 = 0.03;
/// Standard deviation over the scale of a Laplace distribution such that 68 % lie within it.
const SIGMA_OF_SCALE: f64 = 1.15;
/// The log-odds do not depend on the network's σ by itself, only by the disagreement: this weight stays 0.
const FIXED: usize = 1;

fn localiser(card: Option<&String>) -> Localiser {
    let card = card.map_or(concat!(env!("CARGO_MANIFEST_DIR"), "/models/any.json"), String::as_str);
    let (card, weights) = Card::with_weights(Path::new(card)).unwrap();
    Localiser::new(card, weights, &Device::flex()).unwrap()
}

/// Whether a detection at `x`, `y` is of a ball at `centre` with this radius, px.
fn is_near(centre: [f64; 2], radius: f64, x: f64, y: f64) -> bool {
    (x - centre[0]).hypot(y - centre[1]) <= NEAR_PX.max(radius / 2.0)
}

fn listed(weights: &[f64], digits: usize) -> String {
    weights.iter().map(|weight| format!("{weight:.digits$}")).collect::<Vec<_>>().join(", ")
}

/// A candidate: the constant 1 and the features, the last one the cells'; whether it is a ball, 0 or 1; and how much it counts.
type Candidate<const N: usize> = (SVector<f64, N>, f64, f64);

/// The weights of a logistic regression, by Newton's method; the last one is [`OF_CELLS`].
fn logistic_regression<const N: usize>(rows: &[Candidate<N>]) -> SVector<f64, N> {
    let mut weights = SVector::<f64, N>::zeros();
    weights[N - 1] = OF_CELLS;
    for _ in 0..NEWTON_STEPS {
        let (mut gradient, mut hessian) = (weights * -RIDGE, SMatrix::identity() * RIDGE);
        gradient[N - 1] = 0.0;
        for (row, label, weight) in rows {
            let probability = logistic(weights.dot(row));
            let mut row = *row;
            row[N - 1] = 0.0;
            gradient += row * (weight * (label - probability));
            hessian += row * row.transpose() * (weight * probability * (1.0 - probability));
        }
        weights += hessian.cholesky().unwrap().solve(&gradient);
    }
    weights
}

fn logistic(log_odds: f64) -> f64 {
    1.0 / (1.0 + (-log_odds).exp())
}

/// The candidates of a picture; `is_ball` tells whether there is one at a place.
fn candidates(localiser: &Localiser, rgb: RgbImage, is_ball: impl Fn(f64, f64) -> bool) -> Vec<(SVector<f64, 5>, f64)> {
    let found = block_on(localiser.evidence(&Picture::from_rgb(rgb))).unwrap();
    let row = |features: [f64; 4]| SVector::from([1.0, features[0], features[1], features[2], features[3]]);
    let found = found.iter();
    found.map(|it| (row(it.features), f64::from(u8::from(is_ball(it.outline.centre.x, it.outline.centre.y))))).collect()
}

/// The candidates in the photographs without a ball, as they are and with a drawn one, and in the labelled ones.
fn all_candidates(photographs: &Photographs, localiser: &Localiser, drawings: u64) -> Vec<Candidate<5>> {
    let scenes = [1.0, 0.0].map(|empty| RandomScenes::new(vec![], empty));
    let of_drawing = |index: u64| {
        let scenes = &scenes[(index % 2) as usize];
        let photograph = &photographs.plain[(index / drawings) as usize];
        let seed = DRAWINGS * (index / drawings) + index % drawings;
        let drawing = scenes.draw_before(photograph, seed, 1);
        let is_ball = |x, y| drawing.balls.iter().any(|ball: &Apparent| is_near(ball.centre, ball.radius, x, y));
        (!drawing.balls.is_empty(), candidates(localiser, drawing.picture(), is_ball))
    };
    let of_labelled = |LabelledPhotograph { rgb, balls }: &LabelledPhotograph| {
        let is_ball = |x, y| balls.iter().any(|it| is_near(it.centre.map(f64::from), f64::from(it.radius), x, y));
        (true, candidates(localiser, rgb.clone(), is_ball))
    };
    let mut pictures: Vec<(bool, Vec<_>)> = (0..drawings * photographs.plain.len() as u64).map(of_drawing).collect();
    pictures.extend(photographs.labelled.iter().map(of_labelled));
    let with = pictures.iter().filter(|(has_ball, _)| *has_ball).count();
    let weights = [pictures.len() - with, with].map(|count| pictures.len() as f64 / 2.0 / count.max(1) as f64);
    let rows = pictures.into_iter().flat_map(|(has_ball, rows)| {
        rows.into_iter().map(move |(row, label)| (row, label, weights[usize::from(has_ball)]))
    });
    rows.collect()
}

/// Fits the weights of the confidence.
fn fit_confidence(folder: &Path, localiser: &Localiser, drawings: u64) {
    let photographs = Photographs::read(folder).unwrap();
    let today = SVector::from(localiser.card().calibration.unwrap_or_default().ball_log_odds);
    let rows = all_candidates(&photographs, localiser, drawings);
    let weights = logistic_regression(&rows);
    let balls: f64 = rows.iter().map(|(_, label, _)| label).sum();
    let Photographs { plain, labelled } = &photographs;
    println!(
        "{} photographs without a ball, {} with: {} candidates, {balls} of them balls",
        plain.len(),
        labelled.len(),
        rows.len()
    );
    println!("\"ball_log_odds\": [{}],", listed(weights.as_slice(), 3));
    let log_loss = |weights: &SVector<f64, 5>| {
        let of = |(row, label, weight): &Candidate<5>| {
            let log_odds = weights.dot(row);
            weight * (log_odds.max(0.0) + (-log_odds.abs()).exp().ln_1p() - label * log_odds)
        };
        rows.iter().map(of).sum::<f64>() / rows.iter().map(|(_, _, weight)| weight).sum::<f64>()
    };
    println!("mean log-loss of these candidates: fitted {:.4}, today {:.4}", log_loss(&weights), log_loss(&today));
    let first_pass = |row: &SVector<f64, 5>| SVector::from([1.0, row[1], row[4]]);
    let of_first: Vec<Candidate<3>> =
        rows.iter().map(|(row, label, weight)| (first_pass(row), *label, *weight)).collect();
    let first = logistic_regression(&of_first);
    println!("\"first_pass_log_odds\": [{}],", listed(first.as_slice(), 3));
    for least in FIRST_PASSES {
        let is_below = |row: &SVector<f64, 5>| logistic(first.dot(&first_pass(row))) < least;
        let below: Vec<_> = rows.iter().filter(|(row, ..)| is_below(row)).collect();
        let found: Vec<_> = below.iter().filter(|(row, ..)| logistic(weights.dot(row)) >= FOUND).collect();
        println!(
            "below {least}: {:.1} % of the candidates, {} of the balls; found of those in the end: {}, {} of them balls",
            100.0 * below.len() as f64 / rows.len() as f64,
            below.iter().filter(|(_, label, _)| *label > 0.0).count(),
            found.len(),
            found.iter().filter(|(_, label, _)| *label > 0.0).count()
        );
    }
}

/// A detected ball: the errors of network and edge.
struct BallError {
    /// How much it counts.
    weight: f64,
    /// True log(radius) less the network's.
    error: f64,
    /// The network's standard deviation of log(radius).
    log_sigma: f64,
    /// The edge's log(radius) less the network's, the features, and the σ of a fading rim (and of the label).
    edge: Option<(f64, [f64; 5], f64)>,
}

/// A camera of this focal length and principal point, px.
fn camera(focal: f64, [x, y]: [f64; 2], size: Size) -> Camera {
    let Size { width, height } = size;
    let camera = format!(
        r#"{{"intrinsic": [[{focal}, 0, {x}], [0, {focal}, {y}], [0, 0, 1]], "width": {width}, "height": {height},
            "camera_from_world": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}}"#
    );
    Camera::from_json(&camera, "camera").unwrap()
}

/// The error of the detection that is near a ball at `centre` with this `radius`, px, if there is one.
fn ball_error(
    localiser: &Localiser,
    rgb: RgbImage,
    camera: &Camera,
    centre: [f64; 2],
    radius: f64,
) -> Option<BallError> {
    let found = block_on(localiser.edge_evidence(&Picture::from_rgb(rgb), camera)).unwrap();
    let found = found.into_iter().find(|it| is_near(centre, radius, it.outline.centre.x, it.outline.centre.y))?;
    let error = (radius / found.outline.radius).ln();
    Some(BallError { weight: 1.0, error, log_sigma: found.log_sigma, edge: found.edge })
}

/// The detected balls of `count` renderings.
fn ball_errors(scenes: &RandomScenes, localiser: &Localiser, first: u64, count: u64) -> Vec<BallError> {
    let of_seed = |seed: u64| {
        let drawing = scenes.draw(Size::square(SIDE), seed, 1);
        let ball = drawing.balls.first()?;
        let camera = camera(ball.focal, ball.principal_point, Size::square(SIDE));
        ball_error(localiser, drawing.picture(), &camera, ball.centre, ball.radius)
    };
    (first..first + count).filter_map(of_seed).collect()
}

/// The detected balls of known radius in photographs: those to fit, and those to score.
fn labelled_errors(photographs: &[LabelledPhotograph], localiser: &Localiser) -> [Vec<BallError>; 2] {
    let of_photograph = |LabelledPhotograph { rgb, balls }: &LabelledPhotograph| {
        let ball = balls.iter().find(|ball| ball.is_sized)?;
        let [width, height] = [rgb.width(), rgb.height()].map(f64::from);
        let size = Size::new(rgb.width(), rgb.height());
        let camera = camera(width.max(height), [(width - 1.0) / 2.0, (height - 1.0) / 2.0], size);
        let error = ball_error(localiser, rgb.clone(), &camera, ball.centre.map(f64::from), f64::from(ball.radius))?;
        let edge = error.edge.map(|(difference, row, inside)| (difference, row, inside.hypot(LABEL_SIGMA)));
        Some(BallError { edge, ..error })
    };
    let (mut fitted, mut scored) = (vec![], vec![]);
    for (index, error) in photographs.iter().filter_map(of_photograph).enumerate() {
        if index % 2 == 0 { &mut fitted } else { &mut scored }.push(error);
    }
    [fitted, scored]
}

fn dot(row: &[f64; 5], weights: &[f64; 5]) -> f64 {
    row.iter().zip(weights).map(|(a, b)| a * b).sum()
}

/// The negative log-likelihood of a ball with an edge, and its gradient by both rows of `weights`.
fn loss((difference, row, inside): &(f64, [f64; 5], f64), error: f64, weights: &[[f64; 5]; 2]) -> (f64, [[f64; 5]; 2]) {
    let weight = 1.0 / (1.0 + (-dot(row, &weights[0])).exp());
    let residual = error - weight * difference;
    let own = dot(row, &weights[1]).exp();
    let sigma = own.hypot(*inside);
    let scale = sigma / SIGMA_OF_SCALE;
    let value = residual.abs() / scale + (2.0 * scale).ln();
    let by_log_odds = -residual.signum() / scale * difference * weight * (1.0 - weight);
    let by_log_sigma = (1.0 - residual.abs() / scale) * (own / sigma).powi(2);
    (value, [row.map(|feature| by_log_odds * feature), row.map(|feature| by_log_sigma * feature)])
}

/// Mean negative log-likelihood, median error, median of the estimate's signed error, and the fractions within 1 and 2 σ.
fn scores(balls: &[&BallError], weights: &[[f64; 5]; 2]) -> String {
    let count = balls.len() as f64;
    let (mut total, mut errors, mut signed, mut within) = (0.0, vec![], vec![], [0.0; 2]);
    for ball in balls {
        let Some(edge) = &ball.edge else { continue };
        total += loss(edge, ball.error, weights).0;
        let (difference, row, inside) = edge;
        signed.push(ball.error - difference / (1.0 + (-dot(row, &weights[0])).exp()));
        let error = signed[signed.len() - 1].abs();
        let sigma = dot(row, &weights[1]).exp().hypot(*inside);
        within[0] += f64::from(u8::from(error <= sigma));
        within[1] += f64::from(u8::from(error <= 2.0 * sigma));
        errors.push(error);
    }
    errors.sort_by(f64::total_cmp);
    signed.sort_by(f64::total_cmp);
    format!(
        "negative log-likelihood {:.3}, median error {:.2} %, bias {:+.2} %, within 1 / 2 σ {:.0} / {:.0} %",
        total / count,
        100.0 * errors[errors.len() / 2],
        -100.0 * signed[signed.len() / 2],
        100.0 * within[0] / count,
        100.0 * within[1] / count
    )
}

/// Fits the weights of edge refinement.
fn fit_edge(photographs: Option<&Path>, localiser: &Localiser, [fitted, scored]: [u64; 2]) {
    let Photographs { plain, labelled } =
        photographs.map(|folder| Photographs::read(folder).unwrap()).unwrap_or_default();
    let scenes = RandomScenes::new(plain, 0.0);
    let mut all = ball_errors(&scenes, localiser, FIRST_SEED, fitted);
    let drawn = ball_errors(&scenes, localiser, FIRST_SEED + FITTED, scored);
    let with_edge = |all: &[BallError]| all.iter().filter(|ball| ball.edge.is_some()).count();
    println!("{} balls detected in {fitted} renderings, {} with an edge", all.len(), with_edge(&all));
    let [mut of_labels, real] = labelled_errors(&labelled, localiser);
    println!("{} labelled balls to fit, {} with an edge", of_labels.len(), with_edge(&of_labels));
    let weight = LABELLED_WEIGHT * all.len() as f64 / of_labels.len().max(1) as f64;
    of_labels.iter_mut().for_each(|ball| ball.weight = weight);
    all.extend(of_labels);

    let mut weights = [[0.0; 5]; 2];
    let (mut mean, mut square) = ([[0.0; 5]; 2], [[0.0; 5]; 2]);
    for step in 0..DESCENT_STEPS {
        let mut gradient = [[0.0; 5]; 2];
        for (edge, ball) in all.iter().filter_map(|ball| Some((ball.edge.as_ref()?, ball))) {
            let (_, of_ball) = loss(edge, ball.error, &weights);
            (0..10).for_each(|at| gradient[at / 5][at % 5] += ball.weight * of_ball[at / 5][at % 5] / all.len() as f64);
        }
        let rate = LEARNING_RATE * (1.0 - step as f64 / DESCENT_STEPS as f64);
        let steps = 1 + step as i32;
        for at in 0..10 {
            let (row, column) = (at / 5, at % 5);
            let slope = gradient[row][column];
            mean[row][column] = 0.9 * mean[row][column] + 0.1 * slope;
            square[row][column] = 0.999 * square[row][column] + 0.001 * slope * slope;
            let corrected = mean[row][column] / (1.0 - 0.9_f64.powi(steps));
            let size = (square[row][column] / (1.0 - 0.999_f64.powi(steps))).sqrt() + 1e-12;
            weights[row][column] -= if (row, column) == (0, FIXED) { 0.0 } else { rate * corrected / size };
        }
    }
    println!("\"edge_log_odds\": [{}],", listed(&weights[0], 2));
    println!("\"edge_log_sigma\": [{}],", listed(&weights[1], 2));
    let alone: Vec<_> = all.iter().filter(|it| it.edge.is_none()).collect();
    let sum = |of: &dyn Fn(&BallError) -> f64| alone.iter().map(|ball| ball.weight * of(ball)).sum::<f64>();
    let factor = SIGMA_OF_SCALE * sum(&|ball| ball.error.abs() / ball.log_sigma) / sum(&|_| 1.0).max(1.0);
    println!("\"network_sigma_factor\": {factor:.1} ({} balls without an edge)", alone.len());
    let DetectionCalibration { edge_log_odds, edge_log_sigma, .. } = localiser.card().calibration.unwrap_or_default();
    for (name, balls) in [("other renderings", drawn), ("other labelled balls", real)] {
        let with_edge: Vec<&BallError> = balls.iter().filter(|ball| ball.edge.is_some()).collect();
        if with_edge.is_empty() {
            continue;
        }
        println!("on {} {name} with an edge:", with_edge.len());
        println!("  fitted: {}", scores(&with_edge, &weights));
        println!("  today:  {}", scores(&with_edge, &[edge_log_odds, edge_log_sigma]));
    }
}

pub fn run(arguments: &[String]) {
    if crate::common::is_check() {
        let folder = crate::common::scratch("weights");
        RandomScenes::new(vec![], 1.0).draw(Size::square(SIDE), 0, 1).picture().save(folder.join("0.png")).unwrap();
        fit_confidence(&folder, &localiser(None), 4);
        fit_edge(None, &localiser(None), [60, 60]);
        return std::fs::remove_dir_all(folder).unwrap();
    }
    match arguments.iter().map(String::as_str).collect::<Vec<_>>().as_slice() {
        ["confidence", folder, ..] => fit_confidence(Path::new(folder), &localiser(arguments.get(2)), DRAWINGS),
        ["edge", ..] => {
            fit_edge(arguments.get(1).map(Path::new), &localiser(arguments.get(2)), [FITTED, SCORED]);
        }
        _ => println!("usage: cargo bench --bench all -- weights confidence FOLDER [CARD] | edge [FOLDER] [CARD]"),
    }
}
