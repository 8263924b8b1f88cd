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

use image::RgbImage;

use self::bend::straightened;
use self::channel::Paint;
use self::evidence::Evidence;
pub use self::found::{FoundCourt, FoundLine};
use self::hypotheses::{Hypothesis, LONGEST, Search};
use self::judge::{Features, judged};
use self::model::CourtModel;
use self::refine::refined;
use self::score::{Scale, score};
pub use self::verdict::CourtVerdict;
use self::view::View;
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
    verdict: CourtVerdict,
    reason: String,
}

/// Finds the camera that took a picture by the painted lines of a court. `court` is one of [`Court::names`].
///
/// At least five lines of the court and some of their corners must be in view, from an upright camera above the court. The focal length
/// is estimated. The principal point is assumed in the picture's middle. A strong lens gets one coefficient, roughly.
/// [`FoundCourt::calibrate`] refines the camera and its lens.
///
/// Name the sport that is played there. On 142 courts with clicks, no camera with the verdict *sure* was more than 1.05 % of the
/// picture's width off. A *probable* camera needs a person who checks the lines that it draws.
///
/// ```no_run
/// # mod gravisight { pub use gravisight_geometry::{camera, camera::*, error::*, image::*, size::*}; }
/// use gravisight::{CourtVerdict, Picture, Unknowns, find_court};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let picture = Picture::decode(&std::fs::read("tennis.jpg")?)?;
/// let found = find_court(&picture, "tennis")?;
/// println!("{:?}: {}", found.verdict, found.reason);
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
    let models = CourtModel::of(court)?;
    let [width, height] = picture.size().xy();
    let scale = (f64::from(WORKING_SIDE) / width.max(height)).min(1.0);
    let working = Size::new((width * scale).round() as u32, (height * scale).round() as u32);
    if working.width.min(working.height) < MIN_SIDE {
        return FoundCourt::none(court, "the picture is too small or too narrow to show a court".into());
    }
    let rgb = match scale < 1.0 {
        true => &resized(picture.rgb(), [0, 0], picture.size(), working, Filter::Bilinear),
        false => picture.rgb(),
    };
    let best = best(rgb, &models);
    match best {
        Some(best) => FoundCourt::of(best, working, picture.size()),
        None => {
            let reason = format!("no lines in the picture form a {court} court as a camera above it would see it");
            FoundCourt::none(court, reason)
        }
    }
}

/// The best camera over the stages: the better verdict, then the higher score.
fn best(rgb: &RgbImage, models: &[CourtModel]) -> Option<Candidate> {
    let white = Evidence::of(rgb, Paint::White);
    let mut best: Option<Candidate> = None;
    for stage in STAGES {
        let seen = match (stage.paint, stage.bend != 0.0) {
            (Paint::White, false) => &white,
            (paint, false) => &Evidence::of(rgb, paint),
            (paint, true) => &Evidence::of(&straightened(rgb, stage.bend), paint),
        };
        for candidate in models.iter().filter_map(|model| candidate(seen, model, stage)) {
            let rank = |of: &Candidate| (of.verdict, of.features.score);
            if best.as_ref().is_none_or(|best| rank(&candidate) > rank(best)) {
                best = Some(candidate);
            }
        }
        if best.as_ref().is_some_and(|best| best.verdict == CourtVerdict::Sure) {
            break;
        }
    }
    best
}

/// The best camera of a court in what one stage sees.
fn candidate(evidence: &Evidence, model: &CourtModel, stage: Stage) -> Option<Candidate> {
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
    let mut all = all.into_iter();
    let (view, rms, features) = all.next()?;
    let other = all.find(|(other, _, _)| apart(&view, other, model) > RUNNER_UP * unit);
    let runner_up = other.map_or(0.0, |(_, _, features)| features.score);
    let case = verdict::Case { court: &model.name, is_table: model.is_table, features: &features, runner_up, rms };
    let (verdict, reason) = case.verdict();
    Some(Candidate { model: model.clone(), view, bend: stage.bend, runner_up, rms, verdict, reason, features })
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
