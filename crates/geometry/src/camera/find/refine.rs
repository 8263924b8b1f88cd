//! A view moved to where the picture shows the court's lines.

use std::f64::consts::PI;

use nalgebra::{Point2, Point3, SMatrix, SVector, Vector2};

use super::evidence::Evidence;
use super::maps::between;
use super::model::{CourtModel, ModelLine};
use super::view::{UNKNOWNS, View};
use crate::statistics::median;

/// Steps in which a line's length in the picture is measured.
const STEPS: usize = 32;
/// Distance of samples along a line, px; most samples, and fewest, of a line.
const EVERY: f64 = 6.0;
const MOST_SAMPLES: usize = 80;
const FEWEST_SAMPLES: usize = 3;
/// Samples that lines in the picture need, samples on ridges, and lines with such samples.
const NEEDED: [usize; 3] = [20, 15, 4];
/// Most angle between a model's line and a segment that may be it, rad: 12°.
const TURNED: f64 = 0.8 * PI / 12.0;
/// Margin within which samples lie in the picture, px.
const MARGIN: f64 = 1.0;
/// Huber's limit: 1.5 times the median distance, at least this, px.
const HUBER: f64 = 1.5;
const LEAST_HUBER: f64 = 0.7;
/// Gauss–Newton steps with the same ridges.
const STEPS_A_ROUND: usize = 2;
/// Weight of a prior on the logarithm of the focal length, px²: it keeps what lines do not tell.
const PRIOR: f64 = 1.0;
/// A step that changes the logarithm of the focal length, or turns the camera (rad), by more is lost.
const LOST: [f64; 2] = [1.0, 0.5];

/// A place of a line and the ridge that shows it.
struct Match {
    line: usize,
    world: Point3<f64>,
    ridge: Point2<f64>,
    /// Unit vector across the ridge.
    normal: Vector2<f64>,
}

/// A view refined by the ridges that lie near the model's lines and have their directions. The search uses each radius, px, in turn.
/// Returns the root mean square distance that is left, px, as well; [`None`] where too few ridges are found.
pub(super) fn refined(evidence: &Evidence, model: &CourtModel, mut view: View, radii: &[f64]) -> Option<(View, f64)> {
    let mut rms = 0.0;
    for &radius in radii {
        let matches = matched(evidence, model, &view, radius)?;
        for _ in 0..STEPS_A_ROUND {
            view = moved(&view, &matches)?;
        }
        let errors = matches.iter().map(|found| found.error(&view)).collect::<Option<Vec<f64>>>()?;
        let weights = weights(&errors);
        let sum: f64 = errors.iter().zip(&weights).map(|(error, weight)| weight * error * error).sum();
        rms = (sum / weights.iter().sum::<f64>()).sqrt();
    }
    Some((view, rms))
}

impl Match {
    /// Distance of the ridge from where a view puts the line, px.
    fn error(&self, view: &View) -> Option<f64> {
        Some((view.image(&self.world)? - self.ridge).dot(&self.normal))
    }
}

/// Huber's weights.
fn weights(errors: &[f64]) -> Vec<f64> {
    let distances: Vec<f64> = errors.iter().map(|error| error.abs()).collect();
    let limit = (HUBER * median(distances.clone()).unwrap_or(0.0)).max(LEAST_HUBER);
    distances.into_iter().map(|distance| 1.0 / (distance / limit).max(1.0)).collect()
}

/// One step of Gauss–Newton.
fn moved(view: &View, matches: &[Match]) -> Option<View> {
    let errors = matches.iter().map(|found| found.error(view)).collect::<Option<Vec<f64>>>()?;
    let mut normal = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
    let mut gradient = SVector::<f64, UNKNOWNS>::zeros();
    for ((found, error), weight) in matches.iter().zip(&errors).zip(weights(&errors)) {
        let (_, jacobian) = view.image_with_jacobian(&found.world)?;
        let row = jacobian.transpose() * found.normal;
        normal += weight * row * row.transpose();
        gradient += weight * error * row;
    }
    normal[(0, 0)] += PRIOR;
    let step = normal.cholesky()?.solve(&-gradient);
    let is_lost = step[0].abs() > LOST[0] || step.fixed_rows::<3>(1).norm() > LOST[1];
    let moved = view.moved(&step);
    (!is_lost && moved.is_finite()).then_some(moved)
}

/// The ridges within `radius` of a view's lines; [`None`] where they are too few.
fn matched(evidence: &Evidence, model: &CourtModel, view: &View, radius: f64) -> Option<Vec<Match>> {
    let (mut matches, mut samples, mut lines) = (Vec::new(), 0, 0);
    for (index, line) in model.lines.iter().enumerate() {
        let places = places(evidence, view, line);
        samples += places.len();
        matches.extend(places.into_iter().filter_map(|world| nearest(evidence, view, line, index, world, radius)));
        lines += usize::from(matches.last().is_some_and(|last: &Match| last.line == index));
    }
    let is_enough = samples >= NEEDED[0] && matches.len() >= NEEDED[1] && lines >= NEEDED[2];
    is_enough.then_some(matches)
}

/// Places of a line, evenly spaced in the picture, m.
fn places(evidence: &Evidence, view: &View, line: &ModelLine) -> Vec<Point3<f64>> {
    let most = Vector2::new(evidence.width as f64, evidence.height as f64) - Vector2::repeat(1.0 + MARGIN);
    let is_inside = |at: &Point2<f64>| at.x > MARGIN && at.y > MARGIN && at.x < most.x && at.y < most.y;
    let fraction = |step: usize| step as f64 / STEPS as f64;
    let images: Vec<Option<Point2<f64>>> =
        (0..=STEPS).map(|step| view.image(&line.at(fraction(step))).filter(is_inside)).collect();
    let lengths: Vec<f64> =
        images.windows(2).map(|pair| if let [Some(a), Some(b)] = pair { (b - a).norm() } else { 0.0 }).collect();
    let length: f64 = lengths.iter().sum();
    let count = ((length / EVERY) as usize).min(MOST_SAMPLES);
    if count < FEWEST_SAMPLES {
        return Vec::new();
    }
    let (mut step, mut before) = (0, 0.0);
    let place = |number: usize| {
        let at = length * (number as f64 + 0.5) / count as f64;
        while step + 1 < STEPS && before + lengths[step] < at {
            before += lengths[step];
            step += 1;
        }
        line.at(fraction(step) + (at - before) / lengths[step].max(f64::MIN_POSITIVE) / STEPS as f64)
    };
    (0..count).map(place).collect()
}

/// The nearest ridge across a line at one of its places.
fn nearest(
    evidence: &Evidence,
    view: &View,
    line: &ModelLine,
    index: usize,
    world: Point3<f64>,
    radius: f64,
) -> Option<Match> {
    let image = view.image(&world)?;
    let along = (view.image(&(world + 1e-3 * line.direction()))? - image).try_normalize(0.0)?;
    let across = Vector2::new(-along.y, along.x);
    let direction = along.y.atan2(along.x).rem_euclid(PI);
    let at = |off: i32, beside: i32| {
        let near = image + f64::from(off) * across + f64::from(beside) * along;
        let (x, y) = ((near.x + 0.5).floor(), (near.y + 0.5).floor());
        if x < 0.0 || y < 0.0 || x >= evidence.width as f64 || y >= evidence.height as f64 {
            return None;
        }
        let label = evidence.segments.labels[y as usize * evidence.width + x as usize] as usize;
        let segment = evidence.directions[label.checked_sub(1)?];
        let normal = Vector2::new(-segment.sin(), segment.cos());
        (between(segment, direction) < TURNED).then(|| Match { line: index, world, ridge: Point2::new(x, y), normal })
    };
    // Chains of ridge pixels are one pixel wide: three places along the line miss none.
    let beside = |off: i32| [0, 1, -1].into_iter().find_map(|beside| at(off, beside));
    (0..=radius as i32 + 1).find_map(|off| beside(off).or_else(|| beside(-off)))
}
