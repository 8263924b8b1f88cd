//! Proposals for the ball's 2D label in the frames of a clip, for correction by hand.
//!
//! ```text
//! frames ─► background (median) ─► moving edges ─► votes for circles ─► outlines ─► path through the clip
//!                                                                          ▲               │
//!                                                                          └── second look ┘ ─► labels
//! ```
//!
//! No network and no training: a still camera, and a ball that moves and is round. A first path through the
//! candidates of all frames tells the ball's colour and its radius near each frame; frames where an outline is bad
//! or missing are looked at again with that. Nothing is interpolated: a label is where an outline is.

mod background;
mod ball;
mod confidence;
mod edges;
mod evidence;
mod link;
#[cfg(test)]
mod tests;
mod vote;

use serde::Serialize;

use self::background::Background;
use self::ball::Ball;
use self::evidence::Candidate;
use crate::camera::Camera;
use crate::contour::{Circle, Contour, Finder, RadiusPrior};
use crate::error::{Error, Result};
use crate::image::Picture;
use crate::size::Size;

/// Confidence below which a label is doubtful: where more than one in ten such labels would be over 1 px off.
pub const DOUBTFUL: f64 = 0.9;

/// Smallest radius looked for where none is given, px: smaller balls have no outline to fit.
const LEAST_RADIUS: f64 = 2.5;
/// Largest radius looked for where none is given, as a share of the picture's shorter side.
const MOST_RADIUS: f64 = 1.0 / 6.0;
/// Most candidates of a frame that are linked.
const MOST_CANDIDATES: usize = 7;
/// How far outside the radii asked for a fitted one may be, as a share.
const RADIUS_TOLERANCE: f64 = 0.1;
/// Coverage and rms (px) of an outline that needs no second look.
const GOOD_COVERAGE: f64 = 0.9;
const GOOD_RMS: f64 = 0.3;
/// Most that a radius unlike its neighbours' speaks against a candidate, log of odds.
const RADIUS_MOST: f64 = 4.0;

/// What to look for.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LabelOptions {
    /// Smallest and largest radius of the ball, px; by default 2.5 and a sixth of the picture's shorter side.
    pub radii_px: Option<[f64; 2]>,
}

/// A proposed 2D label.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify), tsify(rename = "LabelProposal"))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct Proposal {
    /// The image of the ball's centre, px.
    pub image: [f64; 2],
    /// Mean distance of the ball's outline from it, px.
    pub radius_px: f64,
    /// Share of such labels that are within 1 px of the truth, 0..1, as measured on rendered clips.
    pub confidence: f64,
    /// Whether a person should look at it: `confidence` is below `DOUBTFUL` (0.9).
    pub doubtful: bool,
}

/// Proposes the label of each of a clip's `count` frames; none where the ball is not seen.
///
/// `read` gives a frame's picture and is asked up to three times for it, so that a long clip need not be in
/// memory; `camera` took them all and did not move. `observe` is told of each frame that was looked at, in any
/// order. A clip of fewer than five frames has no background to compare with: what is round is found then, and
/// every label is doubtful.
///
/// # Errors
/// What `read` returns; [`Error::Data`] for a picture of another size than the camera's; [`Error::Value`] for
/// radii that do not ascend or are not positive.
pub fn propose_labels(
    count: usize,
    camera: &Camera,
    options: &LabelOptions,
    read: &(dyn Fn(usize) -> Result<Picture> + Sync),
    observe: &(dyn Fn() + Sync),
) -> Result<Vec<Option<Proposal>>> {
    let size = camera.size();
    let radii = radii(options, size)?;
    let read = |frame: usize| -> Result<Picture> {
        let picture = read(frame)?;
        if picture.size() != size {
            let reason = format!("is {} px, the camera says {size}; give the camera of these pictures", picture.size());
            return Err(Error::Data { what: format!("frame {frame}"), reason });
        }
        Ok(picture)
    };
    let background = Background::of(count, &read)?;
    let watch = |frame: usize| read(frame).map(|picture| Watch { picture, background: &background, camera, radii });
    let mut frames = each(count, &|frame| {
        let found = watch(frame)?.look();
        observe();
        Ok(found)
    })?;
    let ball = Ball::of(&frames);
    for candidate in frames.iter_mut().flatten() {
        candidate.gain += ball.colour_gain(candidate.colour);
    }
    let ball = ball.with(chosen(&frames));
    frames = each(count, &|frame| match needs_second_look(&ball, frame, &frames[frame]) {
        true => Ok(watch(frame)?.look_again(&ball, frame, &frames[frame])),
        false => Ok(frames[frame].clone()),
    })?;
    let labels = chosen(&frames);
    let ball = ball.with(labels.clone());
    let judge = confidence::Judge { ball: &ball, background: background.still.is_some() };
    let proposal = |(frame, label): (usize, &Option<Candidate>)| {
        label.as_ref().map(|label| {
            let Circle { x, y, radius } = label.outline.circle;
            let confidence = judge.confidence(frame, label, &frames[frame]);
            Proposal { image: [x, y], radius_px: radius, confidence, doubtful: confidence < DOUBTFUL }
        })
    };
    Ok(labels.iter().enumerate().map(proposal).collect())
}

/// The radii to look for, px.
fn radii(options: &LabelOptions, size: Size) -> Result<[f64; 2]> {
    let shorter = f64::from(size.width.min(size.height));
    let [least, most] = options.radii_px.unwrap_or([LEAST_RADIUS, (MOST_RADIUS * shorter).max(2.0 * LEAST_RADIUS)]);
    if !(least.is_finite() && most.is_finite() && least >= 1.0 && most >= least && most <= shorter) {
        let reason =
            format!("must ascend and lie between 1 and the picture's shorter side ({shorter}), not be {least}..{most}");
        return Err(Error::value("label", "radius", reason));
    }
    Ok([least, most])
}

/// The candidates on the best path.
fn chosen(frames: &[Vec<Candidate>]) -> Vec<Option<Candidate>> {
    let path = link::best_path(frames);
    frames.iter().zip(path).map(|(candidates, index)| index.map(|index| candidates[index])).collect()
}

/// Whether `frame` has no good outline of the ball yet.
fn needs_second_look(ball: &Ball, frame: usize, candidates: &[Candidate]) -> bool {
    let radius = ball.radius(frame);
    let good = |candidate: Candidate| {
        let Contour { circle, coverage, rms, .. } = candidate.outline;
        let ordinary = radius.is_none_or(|prior| (circle.radius - prior.radius).abs() < prior.sigma);
        coverage > GOOD_COVERAGE && rms < GOOD_RMS && ordinary
    };
    match ball.label(frame) {
        Some(label) => !good(label),
        None => !candidates.is_empty() || !ball.places(frame).is_empty(),
    }
}

/// A frame and what it is compared with.
struct Watch<'a> {
    picture: Picture,
    background: &'a Background,
    camera: &'a Camera,
    radii: [f64; 2],
}

impl Watch<'_> {
    /// The candidates of a frame, best first.
    fn look(&self) -> Vec<Candidate> {
        let edges = edges::moving_edges(self.picture.rgb(), self.background);
        let [width, height] = [self.picture.rgb().width(), self.picture.rgb().height()].map(|side| side as usize);
        let guesses = vote::circles(&edges, [width, height], self.radii);
        best(guesses.iter().filter_map(|guess| self.candidate(guess, None, true)).collect())
    }

    /// The candidates, and those that an outline of the ball's radius gives where the ball may be.
    fn look_again(&self, ball: &Ball, number: usize, candidates: &[Candidate]) -> Vec<Candidate> {
        let Some(prior) = ball.radius(number) else { return candidates.to_vec() };
        let mut places = ball.places(number);
        places.extend(ball.label(number).map(|label| [label.outline.circle.x, label.outline.circle.y]));
        let mut found = candidates.to_vec();
        for [x, y] in places {
            let guess = Circle { x, y, radius: prior.radius };
            // A ball that rests has become background: its edges stand.
            let moving = self.candidate(&guess, Some(prior), true);
            let mut candidate = moving.or_else(|| self.candidate(&guess, Some(prior), false));
            if let Some(candidate) = &mut candidate {
                candidate.gain += ball.colour_gain(candidate.colour);
            }
            found.extend(candidate);
        }
        for candidate in &mut found {
            let off = (candidate.outline.circle.radius - prior.radius) / (2.0 * prior.sigma);
            candidate.gain -= off.powi(2).min(RADIUS_MOST);
        }
        best(found)
    }

    fn candidate(&self, guess: &Circle, prior: Option<RadiusPrior>, moving: bool) -> Option<Candidate> {
        let finder = Finder {
            rgb: self.picture.rgb(),
            still: self.background.still.as_ref().filter(|_| moving),
            contrast: &|x, y| self.background.contrast(x, y),
            camera: self.camera,
        };
        let outline = finder.contour(guess, prior)?;
        let [least, most] = self.radii;
        let radius = outline.circle.radius;
        let asked = radius >= least * (1.0 - RADIUS_TOLERANCE) && radius <= most * (1.0 + RADIUS_TOLERANCE);
        asked.then(|| Candidate::of(outline, self.picture.rgb(), self.background))
    }
}

/// The best of the candidates, each thing once.
fn best(mut found: Vec<Candidate>) -> Vec<Candidate> {
    found.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let mut kept: Vec<Candidate> = Vec::new();
    for candidate in found {
        let known = kept.iter().any(|other| vote::is_same(&other.outline.circle, &candidate.outline.circle));
        if kept.len() < MOST_CANDIDATES && !known {
            kept.push(candidate);
        }
    }
    kept
}

/// `work(0)`, …, `work(count - 1)`, on every core where there are several.
fn each<T: Send>(count: usize, work: &(dyn Fn(usize) -> Result<T> + Sync)) -> Result<Vec<T>> {
    #[cfg(not(target_arch = "wasm32"))]
    {
        use rayon::iter::{IntoParallelIterator, ParallelIterator};
        (0..count).into_par_iter().map(work).collect()
    }
    #[cfg(target_arch = "wasm32")]
    (0..count).map(work).collect()
}
