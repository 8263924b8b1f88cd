//! A track without long pauses: the hypotheses about its lost frames, its structure, and what may be wrong with it.

use std::sync::Arc;

use nalgebra::{Point2, Vector3};

use super::change_points::PolynomialPiece;
use super::drops;
use super::input_checks;
use super::model::{Loss, Model};
use super::observation::{RayObservation, interval};
use super::rays::Plane;
use super::search::Search;
use super::solve::Hypothesis;
use crate::config::EstimatorConfig;
use crate::config::FitOptions;
use crate::observation::{Observation as Label, noise_of, trusted};
use crate::result::{Fit, FittedFrame, Flight};
use gravisight_geometry::camera::Camera;
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::statistics::median;
use gravisight_physics::{Forecaster, State};

/// Noise that the search starts from, px: what the track's smoothness says, within these.
const START_NOISE: [f64; 2] = [0.3, 3.0];
/// Least noise of given ones, px.
const LEAST_NOISE: f64 = 0.03;
/// By how much the evidence must speak for lost frames (−2 ln) that nothing else is looked for, and steps to find that out.
const CERTAIN: f64 = 60.0;
const SAME_STEPS: usize = 15;
/// Excess over the limit (−2 ln) up to which a quick search is followed by a thorough one.
const MOST_EXCESS: f64 = 25.0;
/// Most labels of a ball that is held before it flies, fewest of the flight, and −2 ln of how probable that is: one track in twenty.
const LONGEST_HELD: usize = 8;
const FEWEST_FLYING: usize = 5;
const HELD: f64 = 6.0;
/// Clear change points up to which a track is tried with what may be wrong about it.
const BEGINNING: usize = 3;
/// Relative deviation of the apparent size from which there is a note, and fewest sizes for one.
const SIZE_OFF: f64 = 0.02;
const FEWEST_SIZES: usize = 8;

/// What is to be explained.
#[derive(Clone, Copy)]
pub struct Part<'a> {
    pub forecaster: &'a Forecaster,
    pub camera: &'a Camera,
    pub labels: &'a [Label],
    pub options: &'a FitOptions,
    /// Pixels of the camera's picture to one of the labels' own.
    pub scale: f64,
    /// Seconds of the labels' own clock to one of theirs.
    pub clock: f64,
}

/// A result.
pub struct Outcome {
    pub fit: Fit,
    /// −2 ln of the evidence.
    pub cost: f64,
    /// Whether labels or laws do not fit; not merely that the distance is unknown.
    pub doubtful: bool,
}

impl Outcome {
    /// Whether it calls for a look at what may be wrong: it is doubtful, or has hits where the scene should explain more.
    pub fn is_odd(&self) -> bool {
        self.doubtful || (!self.fit.hits.is_empty() && self.fit.hits.len() >= self.fit.impacts.len())
    }

    /// Whether it is a single flight: two that are explained, and what is between them, would not be so at another rate.
    pub fn is_alone(&self) -> bool {
        self.fit.hits.is_empty()
    }
}

/// Hypotheses, and the frames that are missing (or repeated) before a frame in all of them: frame, number.
pub type Found = (Vec<Hypothesis>, Vec<(usize, i32)>);

impl Part<'_> {
    /// Its observations by a camera.
    fn observations(&self, camera: &Camera) -> Option<Vec<RayObservation>> {
        let radius = self.forecaster.scene().ball.radius;
        self.labels.iter().map(|label| RayObservation::of(label, camera, radius).ok()).collect()
    }

    /// The observations by each camera of the options; none by one whose lens leaves a label out.
    fn cameras(&self) -> Vec<Option<Vec<RayObservation>>> {
        self.options.cameras.iter().map(|camera| self.observations(camera)).collect()
    }

    fn model<'b>(&'b self, observations: &'b [RayObservation], noise: Option<f64>) -> Model<'b> {
        let numbers = [self.area(), self.smooth(), self.clock];
        let config =
            self.options.config.unwrap_or_else(|| EstimatorConfig::of(self.forecaster.scene(), self.camera.size()));
        Model::new(self.forecaster, observations, numbers, noise, config.scaled(self.scale))
    }

    /// Px².
    fn area(&self) -> f64 {
        let [width, height] = self.camera.size().xy();
        width * height * self.scale * self.scale
    }

    /// Noise of the labels by their smoothness, or as given, px.
    fn smooth(&self) -> f64 {
        self.options.noise_px.unwrap_or_else(|| noise_of(&trusted(self.labels))).max(LEAST_NOISE)
    }

    /// The same for the search to start from.
    fn noise(&self) -> f64 {
        match self.options.noise_px {
            Some(noise) => noise.max(LEAST_NOISE),
            None => self.smooth().clamp(START_NOISE[0], START_NOISE[1]),
        }
    }

    /// The result.
    ///
    /// # Errors
    /// [`Error::Fit`] for a track that nothing explains.
    pub fn fit(&self) -> Result<Fit> {
        let observations = self.observations(self.camera).ok_or_else(unexplained)?;
        let given = self.options.noise_px.map(|noise| noise.max(LEAST_NOISE));
        let model = self.model(&observations, given);
        let found = self.found(&model);
        let outcome = found
            .as_ref()
            .and_then(|(hypotheses, _)| model.result(hypotheses, &self.cameras(), self.options.camera_assumed));
        let mut reason = None;
        if outcome.as_ref().is_none_or(|outcome| outcome.is_odd() || outcome.is_alone()) && !model.lasting {
            // What is wrong is wrong from the beginning on: of a long track that is enough to see it.
            let beginning = Part { labels: &self.labels[..self.beginning(&model)], ..*self };
            let own = (beginning.labels.len() < self.labels.len())
                .then(|| beginning.outcome_of(beginning.labels, self.options.hits, f64::INFINITY));
            let given = own.as_ref().unwrap_or(&outcome).as_ref();
            if let Some(held) = beginning.held(given)
                && let Some(fit) = self.with_held(held)
            {
                return Ok(fit);
            }
            reason = input_checks::suspected(&beginning, given);
        }
        let (Some(Outcome { mut fit, .. }), Some((hypotheses, drops))) = (outcome, found) else {
            return Err(reason.map_or_else(unexplained, |reason| Error::Fit { reason }));
        };
        let times = &hypotheses[0].trajectory.times;
        fit.notes.extend(drops.iter().map(|&(frame, frames)| {
            let (count, at) = (frames.abs(), times[frame]);
            let are = if count == 1 { "frame is" } else { "frames are" };
            let what = if frames > 0 { "missing" } else { "duplicated" };
            format!("{count} {are} {what} before {at:.3} s: later times are shifted accordingly")
        }));
        fit.notes.extend(sizes(&model, &fit));
        if let Some(reason) = reason {
            fit.explained = false;
            for flight in &mut fit.flights {
                (flight.explained, flight.reason) = (false, Some(reason.clone()));
            }
            fit.frames.iter_mut().for_each(|frame| model.widen(frame));
        }
        Ok(fit)
    }

    /// Frames of its first flights; all of a short part.
    fn beginning(&self, model: &Model) -> usize {
        let times: Vec<f64> = self.labels.iter().map(|label| label.time).collect();
        let search = Search::new(model, Arc::new(times.clone()), self.noise(), None);
        let end = search.and_then(|search| search.change_point(BEGINNING));
        end.map_or(times.len(), |end| times.partition_point(|&time| time < end))
    }

    /// How many frames at the beginning show a ball that is held, or lies, where that is more probable than `outcome`.
    fn held(&self, outcome: Option<&Outcome>) -> Option<usize> {
        let begins_odd = |outcome: &Outcome| {
            let early = outcome.fit.hits.first().is_some_and(|hit| self.seen_before(hit.frame) <= LONGEST_HELD);
            outcome.doubtful || early
        };
        if !outcome.is_none_or(begins_odd) {
            return None;
        }
        let limit = outcome.map_or(f64::INFINITY, |outcome| outcome.cost);
        let seen: Vec<usize> = (0..self.labels.len()).filter(|&frame| self.labels[frame].image.is_some()).collect();
        let mut best: Option<(f64, usize)> = None;
        for count in 1..=LONGEST_HELD.min(seen.len().saturating_sub(FEWEST_FLYING)) {
            let (first, cost) = (seen[count], self.held_cost(&seen[..count])?);
            let Some(rest) = self.outcome_of(&self.labels[first..], self.options.hits, limit - cost) else { continue };
            let total = rest.cost + cost;
            if total < limit && best.is_none_or(|best| total < best.0) {
                best = Some((total, first));
            }
        }
        Some(best?.1)
    }

    /// The result of a part whose first frames, so many, show a ball that does not fly yet.
    fn with_held(&self, first: usize) -> Option<Fit> {
        let rest = Part { labels: &self.labels[first..], ..*self };
        let Outcome { mut fit, .. } = rest.outcome(f64::INFINITY)?;
        let start = fit.frames[0].clone();
        let state = State { velocity: Vector3::zeros(), ..start.state() };
        let held = |label: &Label| FittedFrame::new(label.time, state, start.covariance);
        let reason = "the ball is held, or lies still, before it flies".to_string();
        let flight = Flight {
            start: self.labels[0].time,
            end: start.time,
            speed_start: 0.0,
            speed_sigma: f64::INFINITY,
            spin: [0.0; 3],
            spin_sigma: [f64::INFINITY; 3],
            explained: false,
            reason: Some(reason),
        };
        fit.frames.iter_mut().for_each(|frame| frame.flight += 1);
        fit.hits.iter_mut().for_each(|hit| hit.frame += first);
        fit.frames.splice(0..0, self.labels[..first].iter().map(held));
        fit.flights.insert(0, flight);
        fit.explained = false;
        Some(fit)
    }

    /// Labels before a frame.
    fn seen_before(&self, frame: usize) -> usize {
        self.labels[..frame].iter().filter(|label| label.image.is_some()).count()
    }

    /// −2 ln of the evidence of labels of a ball that is held or lies still: they move evenly in the picture.
    fn held_cost(&self, frames: &[usize]) -> Option<f64> {
        let labels: Vec<(f64, Point2<f64>)> =
            frames.iter().filter_map(|&frame| Some((self.labels[frame].time, self.labels[frame].image?))).collect();
        let noise = self.noise().max(START_NOISE[0]);
        let even = PolynomialPiece::of(&labels, noise, if labels.len() > 2 { 1 } else { 0 })?;
        let count = labels.len() as f64;
        let constant = 2.0 * (std::f64::consts::TAU * noise * noise).ln();
        // A place anywhere in the picture, and a velocity of up to a picture's side a second.
        let numbers = if labels.len() > 2 { 2.0 } else { 1.0 };
        let occam = numbers * 2.0 * (self.area() * count / (std::f64::consts::TAU * noise * noise)).ln();
        Some(even.cost + count * constant + occam + HELD)
    }

    /// What a track says that may be another than this part's own; none where nothing explains it, or where that clearly costs more than
    /// `limit`.
    pub fn outcome_of(&self, labels: &[Label], hits: Option<usize>, limit: f64) -> Option<Outcome> {
        let options = FitOptions { hits, cameras: vec![], ..self.options.clone() };
        Part { labels, options: &options, ..*self }.outcome(limit)
    }

    /// The most probable trajectory of this part; none where nothing explains it, or where that clearly costs more than `limit`.
    fn outcome(&self, limit: f64) -> Option<Outcome> {
        let observations = self.observations(self.camera)?;
        let model = self.model(&observations, self.options.noise_px);
        let times: Vec<f64> = self.labels.iter().map(|label| label.time).collect();
        let quick = Search::new(&model, Arc::new(times), self.noise(), self.options.hits)?.quick();
        if quick.first()?.cost > limit + MOST_EXCESS {
            return None;
        }
        let (hypotheses, _) = self.found(&model)?;
        model.result(&hypotheses, &self.cameras(), self.options.camera_assumed)
    }

    /// The most probable hypotheses, with lost and repeated frames where that is more probable than without.
    fn found(&self, model: &Model) -> Option<Found> {
        let times: Vec<f64> = self.labels.iter().map(|label| label.time).collect();
        let noise = self.noise();
        let search = |drops: &[(usize, i32)]| -> Option<Vec<Hypothesis>> {
            let times = Arc::new(dropped(&times, drops));
            let mut found = Search::new(model, times, noise, self.options.hits)?.found();
            found.iter_mut().for_each(|it| it.cost += model.drop_cost(drops));
            Some(found).filter(|found| !found.is_empty())
        };
        let labels = Plane::of(model.observations)?.labels(model.observations);
        let timed: Vec<_> = labels.iter().map(|&(frame, point)| (times[frame], point)).collect();
        let drops: Vec<(usize, i32)> = match self.options.times_known || model.lasting {
            true => vec![],
            false => drops::drops(&timed, interval(times.iter().copied()), noise.hypot(model.drift))
                .iter()
                .map(|drop| (labels[drop.label].0, drop.frames))
                .collect(),
        };
        if drops.is_empty() {
            return Some((search(&[])?, vec![]));
        }
        let with = search(&drops);
        // The same trajectory by the times as they are: where that is out of the question, so is every other.
        let as_they_are = |best: &Hypothesis| {
            let moved = |time: f64| {
                let frame = best.trajectory.times.partition_point(|&other| other < time).min(times.len() - 1);
                time - best.trajectory.times[frame] + times[frame]
            };
            let mut same = best.trajectory.clone();
            same.segments.iter_mut().for_each(|segment| segment.time = moved(segment.time));
            same.times = Arc::new(times.clone());
            Some(model.refined(&same, &same.all(), Loss::Mixture, SAME_STEPS)?.cost)
        };
        if let Some(with) = &with
            && as_they_are(&with[0]).is_none_or(|cost| cost > with[0].cost + CERTAIN)
        {
            return Some((with.clone(), drops));
        }
        match (search(&[]), with) {
            (Some(without), Some(with)) if without[0].cost <= with[0].cost => Some((without, vec![])),
            (_, Some(with)) => Some((with, drops)),
            (without, None) => Some((without?, vec![])),
        }
    }
}

/// The times, later ones moved by the frames that are missing before them.
fn dropped(times: &[f64], drops: &[(usize, i32)]) -> Vec<f64> {
    let (interval, mut out) = (interval(times.iter().copied()), times.to_vec());
    for &(frame, frames) in drops {
        out[frame..].iter_mut().for_each(|time| *time += f64::from(frames) * interval);
    }
    out
}

/// A note if the ball's apparent size contradicts its distance by all else.
fn sizes(model: &Model, fit: &Fit) -> Option<String> {
    let off = |(observation, frame): (&RayObservation, &FittedFrame)| {
        let own = (frame.world.coords - observation.ray.as_ref()?.origin).norm();
        Some((observation.log_distance?[0].exp() / own - 1.0, frame.sigma / own))
    };
    let all: Vec<(f64, f64)> = model.observations.iter().zip(&fit.frames).filter_map(off).collect();
    // Of a distance that is not known so well, as before a camera that is assumed, the sizes may be right.
    let known = median(all.iter().map(|&(_, sigma)| sigma))?;
    let median = median(all.iter().map(|&(off, _)| off))?;
    (median.abs() > SIZE_OFF.max(known) && all.len() >= FEWEST_SIZES).then(|| {
        format!(
            "judging by its apparent size, the ball is {:.0} % {} than its flight and contacts indicate: check the heights \
             of the scene, the ball's radius, the camera and the frame rate",
            100.0 * median.abs(),
            if median > 0.0 { "farther" } else { "nearer" }
        )
    })
}

fn unexplained() -> Error {
    let reason = "no trajectory in front of the camera explains the track; check camera.json, scene.json and fps";
    Error::Fit { reason: reason.into() }
}
