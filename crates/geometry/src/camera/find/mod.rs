//! A camera from a court's painted lines, without clicks.
//!
//! Straight ridges of paint form quadrilaterals; each gives a camera for every pair and pair of the court's lines (square pixels, the
//! principal point in the middle). Cameras are scored by how much of *all* the court's lines the picture shows. The best are refined,
//! and a strict verdict decides. If it is not sure, other colours of paint, families of parallel lines and bent lenses are tried.
//!
//! Related: Farin et al., "Robust camera calibration for sport videos using court models" (2003).

mod bend;
mod channel;
mod evidence;
mod found;
mod hypotheses;
mod judge;
mod lines;
mod maps;
mod model;
mod polish;
mod refine;
mod ridges;
mod score;
mod segments;
mod square;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
mod vanishing;
mod verdict;
mod view;

use std::cmp::Ordering;

use image::RgbImage;

use self::bend::straightened;
use self::channel::Paint;
use self::evidence::Evidence;
pub use self::found::{FoundCourt, FoundLine, OtherCourt};
use self::hypotheses::{Hypothesis, LONGEST, Search};
use self::judge::{Features, judged};
use self::model::CourtModel;
use self::refine::refined;
use self::score::{Scale, score};
pub use self::verdict::{CourtVerdict, FEATURES};
use self::view::View;
use crate::camera::Camera;
use crate::error::Result;
use crate::image::{Filter, MIN_SIDE, Picture, resized};
use crate::size::Size;

/// Longer side of the picture in which a court is searched, px; all lengths in px below are of this one. Measured on 41 scenes.
const WORKING_SIDE: u32 = 1280;
/// Radii within which lines are refined, px: all hypotheses, and those that are still good. Measured on 41 scenes.
const ROUGH: [f64; 3] = [12.0, 7.0, 4.0];
const FINE: [f64; 4] = [4.0, 3.0, 2.5, 2.5];
/// Tolerance of the score between the two, px, and most samples of a line.
const TOLERANCE: f64 = 3.0;
const SAMPLES: usize = 60;
/// How many are refined finely; they differ by more than this, as a fraction of the picture's width.
const BEST: usize = 8;
const DIFFERENT: f64 = 0.003;
/// The runner-up differs from the best by more than this, as a fraction of the picture's width.
const RUNNER_UP: f64 = 0.015;
/// After refinement, the camera's height: from this fraction of the court's size to that, or to this many metres.
const HEIGHT: [f64; 2] = [0.03, 1.7];
const HIGHEST: f64 = 27.0;
/// Then its focal length, in picture widths.
const FOCAL: [f64; 2] = [0.28, 14.0];
/// Then its distance: up to this many times the court's size, or this many metres.
const DISTANCE: f64 = 6.0;
const FARTHEST: f64 = 90.0;

/// One way to search.
#[derive(Debug, Clone, Copy)]
struct Stage {
    paint: Paint,
    /// The lens that is taken out of the picture first: [`straightened`].
    bend: f64,
    /// Whether quadrilaterals with visible corners are tried, and families of parallel lines.
    corners: bool,
    families: bool,
}

/// In this order, until one is sure: white paint; coloured paint; corners out of view; bent lenses (κ −0.25 and −0.5 cover security and
/// action cameras). One colour at a time: all at once give three times the lines and drown the right ones. Measured on 41 scenes.
const STAGES: [Stage; 9] = [
    Stage { paint: Paint::White, bend: 0.0, corners: true, families: false },
    Stage { paint: Paint::Red, bend: 0.0, corners: true, families: false },
    Stage { paint: Paint::Blue, bend: 0.0, corners: true, families: false },
    Stage { paint: Paint::Dark, bend: 0.0, corners: true, families: false },
    Stage { paint: Paint::Yellow, bend: 0.0, corners: true, families: false },
    Stage { paint: Paint::White, bend: 0.0, corners: false, families: true },
    Stage { paint: Paint::White, bend: -0.25, corners: true, families: true },
    Stage { paint: Paint::White, bend: -0.5, corners: true, families: true },
    Stage { paint: Paint::Blue, bend: -0.25, corners: true, families: false },
];

/// The best camera of a court in one stage.
struct Candidate {
    model: CourtModel,
    view: View,
    bend: f64,
    features: Features,
    /// Score of the best camera that puts the court elsewhere, units.
    runner_up: f64,
    /// Root mean square distance of lines from ridges, px of a picture [`WORKING_SIDE`] wide.
    rms: f64,
}

/// The name that stands for every court whose lines are known.
const AUTO: &str = "auto";

impl Candidate {
    fn case(&self) -> verdict::Case<'_> {
        let Self { model, features, runner_up, rms, .. } = self;
        verdict::Case { model, features, runner_up: *runner_up, rms: *rms }
    }

    /// The odds that the camera is right, and then the score.
    fn rank(&self) -> (f64, f64) {
        (self.case().odds(), self.features.score)
    }
}

/// Finds the camera that took a picture by the painted lines of a court. `court` is one of [`Court::names`], or `auto` for all of them.
///
/// At least five lines of the court and some of their corners must be in view, from an upright camera above the court. The focal length
/// is estimated. The principal point is assumed in the picture's middle. A strong lens gets one coefficient, roughly.
/// [`FoundCourt::calibrate`] refines the camera and its lens.
///
/// Name the sport that is played there if you know it. [`FoundCourt::probability`] and [`FoundCourt::verdict`] tell how far to trust the
/// camera. A *probable* camera needs a person who checks the lines that it draws. A court looks the same after a half-turn; the camera
/// is placed at its near end (y < 0).
///
/// ```no_run
/// # mod gravisight { pub use gravisight_geometry::{camera, camera::*, error::*, image::*, size::*}; }
/// use gravisight::{CourtVerdict, Picture, Unknowns, find_court};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let picture = Picture::decode(&std::fs::read("tennis.jpg")?)?;
/// let found = find_court(&picture, "tennis")?;
/// println!("{:?}, probability {:.2}: {}", found.verdict, found.probability, found.reason);
/// if found.verdict == CourtVerdict::Sure {
///     println!("{}", found.calibrate(&picture, &Unknowns::default())?.camera.intrinsic());
/// }
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// [`Error::Calibration`](crate::error::Error::Calibration) for an unknown court or one whose lines are not known. A picture without the
/// court is not an error: its verdict is [`CourtVerdict::None`].
///
/// [`Court::names`]: crate::camera::Court::names
pub fn find_court(picture: &Picture, court: &str) -> Result<FoundCourt> {
    let courts = match court {
        AUTO => CourtModel::all(),
        court => vec![CourtModel::of(court)?],
    };
    let (rgb, working) = worked(picture);
    if working.width.min(working.height) < MIN_SIDE {
        return FoundCourt::none(court, "the picture is too small or too narrow to show a court".into());
    }
    let found = likeliest(&rgb, &courts);
    if found.is_empty() {
        let what = if court == AUTO { "any court" } else { &format!("a {court} court") };
        return FoundCourt::none(
            court,
            format!("no lines in the picture form {what} as a camera above it would see it"),
        );
    }
    FoundCourt::of(found, working, picture.size())
}

/// What `scripts/fit-weights courts` fits the log-odds to: of each stage the best cameras of a court, and what speaks for each of them.
///
/// # Errors
/// As [`find_court`].
#[doc(hidden)]
pub fn court_evidence(picture: &Picture, court: &str) -> Result<Vec<(Camera, [f64; FEATURES])>> {
    let models = CourtModel::of(court)?;
    let (rgb, working) = worked(picture);
    let mut all = Vec::new();
    for stage in STAGES {
        let seen = match stage.bend != 0.0 {
            false => Evidence::of(&rgb, stage.paint),
            true => Evidence::of(&straightened(&rgb, stage.bend), stage.paint),
        };
        for found in models.iter().flat_map(|model| candidates(&seen, model, stage)) {
            if found.case().is_enough() {
                all.push((found.camera(working, picture.size())?, found.case().row()));
            }
        }
    }
    Ok(all)
}

/// The picture as it is searched, and its size.
fn worked(picture: &Picture) -> (RgbImage, Size) {
    let [width, height] = picture.size().xy();
    let scale = (f64::from(WORKING_SIDE) / width.max(height)).min(1.0);
    let working = Size::new((width * scale).round() as u32, (height * scale).round() as u32);
    let rgb = match scale < 1.0 && working.width.min(working.height) > 0 {
        true => resized(picture.rgb(), [0, 0], picture.size(), working, Filter::Bilinear),
        false => picture.rgb().clone(),
    };
    (rgb, working)
}

/// The best camera of each court over the stages, and its runner-up, with their probabilities, the likeliest first. `courts` are the
/// variants of each.
fn likeliest(rgb: &RgbImage, courts: &[Vec<CourtModel>]) -> Vec<(Candidate, f64)> {
    let white = Evidence::of(rgb, Paint::White);
    let mut best: Vec<Vec<Candidate>> = courts.iter().map(|_| Vec::new()).collect();
    for stage in STAGES {
        let seen = match (stage.paint, stage.bend != 0.0) {
            (Paint::White, false) => &white,
            (paint, false) => &Evidence::of(rgb, paint),
            (paint, true) => &Evidence::of(&straightened(rgb, stage.bend), paint),
        };
        for (best, variants) in best.iter_mut().zip(courts) {
            for found in variants.iter().map(|model| candidates(seen, model, stage)).filter(|found| !found.is_empty()) {
                if best.first().is_none_or(|best| found[0].rank() > best.rank()) {
                    *best = found;
                }
            }
        }
        let is_sure = |found: &Vec<Candidate>| found.first().is_some_and(|best| best.case().is_sure());
        if best.iter().any(is_sure) {
            break;
        }
    }
    // One of them is right, or none.
    let all = || best.iter().flatten().map(Candidate::case).map(|case| case.odds());
    let sum = 1.0 + all().sum::<f64>();
    let probabilities: Vec<f64> = all().map(|odds| odds / sum).collect();
    let mut all: Vec<(Candidate, f64)> = best.into_iter().flatten().zip(probabilities).collect();
    all.sort_by(|a, b| (b.1, b.0.features.score).partial_cmp(&(a.1, a.0.features.score)).unwrap_or(Ordering::Equal));
    all
}

/// The best camera of a court in what one stage sees, and its runner-up.
fn candidates(evidence: &Evidence, model: &CourtModel, stage: Stage) -> Vec<Candidate> {
    let mut starts = Vec::new();
    if stage.corners {
        starts.extend(Search::new(evidence, model).by_corners());
    }
    if stage.families {
        starts.extend(Search::new(evidence, model).by_families(&vanishing::families(evidence)));
    }
    let unit = evidence.unit();
    let fine = |start: &Hypothesis| {
        let (view, rms) =
            refined(evidence, model, start.view, &FINE).filter(|(view, _)| is_plausible(view, model, unit))?;
        Some((view.at_near_end(), rms * f64::from(WORKING_SIDE) / unit, judged(evidence, model, &view)))
    };
    let mut all: Vec<(View, f64, Features)> = refinable(evidence, model, &starts).iter().filter_map(fine).collect();
    all.sort_by(|a, b| b.2.score.total_cmp(&a.2.score));
    let other = all.iter().skip(1).position(|(other, _, _)| apart(&all[0].0, other, model) > RUNNER_UP * unit);
    let pair = all.first().into_iter().chain(other.map(|index| &all[index + 1]));
    let scores: Vec<f64> = pair.clone().map(|(_, _, features)| features.score).collect();
    let candidate = |(index, (view, rms, features)): (usize, &(View, f64, Features))| Candidate {
        model: model.clone(),
        view: *view,
        bend: stage.bend,
        features: features.clone(),
        runner_up: scores.get(1 - index).copied().unwrap_or(0.0),
        rms: *rms,
    };
    pair.enumerate().map(candidate).collect()
}

/// The hypotheses after a rough refinement: the best of those that differ.
fn refinable(evidence: &Evidence, model: &CourtModel, starts: &[Hypothesis]) -> Vec<Hypothesis> {
    let unit = evidence.unit();
    let scale = Scale { tolerance: TOLERANCE, longest: LONGEST * unit, samples: SAMPLES };
    let rough = |start: &Hypothesis| {
        let (view, _) =
            refined(evidence, model, start.view, &ROUGH).filter(|(view, _)| is_plausible(view, model, unit))?;
        let lines = model.lines.iter().map(|line| &line.ends);
        Some(Hypothesis { score: score(&evidence.maps, &view, lines, &scale), view })
    };
    let mut all: Vec<Hypothesis> = starts.iter().filter_map(rough).collect();
    all.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut kept: Vec<Hypothesis> = Vec::new();
    for next in all {
        if kept.len() < BEST && kept.iter().all(|other| apart(&next.view, &other.view, model) > DIFFERENT * unit) {
            kept.push(next);
        }
    }
    kept
}

/// Whether a refined camera may still stand there.
fn is_plausible(view: &View, model: &CourtModel, unit: f64) -> bool {
    let place = view.place();
    let height = place.z - model.height;
    let focal = view.focal / unit;
    height > HEIGHT[0] * model.size
        && height < (HEIGHT[1] * model.size).max(HIGHEST)
        && focal > FOCAL[0]
        && focal < FOCAL[1]
        && place.xy().norm() <= (DISTANCE * model.size).max(FARTHEST)
}

/// How far apart two cameras put a court, px: the median over its points; half-turns are the same. Infinite where it is in front of one
/// only.
fn apart(a: &View, b: &View, model: &CourtModel) -> f64 {
    let distance = |b: &View| {
        let off = model.grid().into_iter().filter_map(|at| Some((a.image(&at)? - b.image(&at)?).norm()));
        crate::statistics::median(off).unwrap_or(f64::INFINITY)
    };
    distance(b).min(distance(&b.turned()))
}
