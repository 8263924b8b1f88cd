//! Physics revises which candidates are the ball. On an explained flight, a label that the flight contradicts is replaced with a candidate on its
//! path, and a frame without a label gets a candidate there; where no flight is explained, another track is tried. Once for each segment.

use std::ops::Range;

use nalgebra::Point2;

use super::{FittedSegment, TrackedFrame};
use crate::config::FitOptions;
use crate::file::TrackPoint;
use crate::observation::Observation;
use crate::result::Fit;
use crate::video::{Alternatives, CameraMotion, Candidate, FollowedFrame, Place};
use gravisight_geometry::camera::Camera;
use gravisight_physics::{Forecaster, Scene};

/// Distance of a candidate from a flight, in standard deviations of both, up to which it is on it: that from which the estimator calls a label an
/// outlier.
const ON_PATH: f64 = 4.0;
/// Other tracks that are tried.
const MOST_TRIED: usize = 3;

/// What was followed through a video, and by what it is fitted.
pub(super) struct Fitter<'a> {
    pub frames: &'a [TrackedFrame],
    pub alternatives: &'a Alternatives,
    pub forecaster: &'a Forecaster,
    pub camera: &'a Camera,
    pub options: &'a FitOptions,
}

/// A segment's fit, and the frames in which something else is the ball than what was followed.
pub(super) struct Revised {
    pub segment: FittedSegment,
    pub changes: Vec<(usize, FollowedFrame)>,
    /// Index of the other track that was taken.
    pub track: Option<usize>,
}

/// The label of a frame, in the pixels of the first view: those of the camera.
pub(super) fn observation(followed: &FollowedFrame) -> Observation {
    let FollowedFrame { point, elsewhere, view, .. } = followed;
    let mut seen = Observation { time: point.time.unwrap_or_default(), image: point.image(), radius: point.size() };
    match (elsewhere, view) {
        (Some(CameraMotion::Moved(_)), Some(view)) => {
            let Some(image) = seen.image else { return seen };
            let at = Place::new(image.into());
            let scale = view.scale(&at);
            seen.image = Some(view.first(&at).xy.into());
            seen.radius = seen.radius.map(|radius| radius.map(|px| px * scale));
        }
        (Some(_), _) => (seen.image, seen.radius) = (None, None),
        (None, _) => {}
    }
    seen
}

impl Fitter<'_> {
    /// The fit of these frames, revised where physics contradicts what was followed.
    pub fn revised(&self, range: &Range<usize>) -> Revised {
        let followed: Vec<FollowedFrame> = self.frames[range.clone()].iter().map(|frame| frame.followed).collect();
        let segment = self.fit(range, &followed);
        let first = Revised { segment, changes: vec![], track: None };
        let Ok(fit) = &first.segment.fit else { return self.by_another_track(range, &followed).unwrap_or(first) };
        if fit.flights.iter().all(|flight| !flight.explained) {
            return self.by_another_track(range, &followed).unwrap_or(first);
        }
        let corrected = self.corrected(range, &followed, fit);
        if corrected == followed {
            return first;
        }
        let again = self.fit(range, &corrected);
        match &again.fit {
            Ok(refit) if explained_labels(refit) >= explained_labels(fit) => {
                Revised { segment: again, changes: changes(range, &followed, &corrected), track: None }
            }
            _ => first,
        }
    }

    fn fit(&self, range: &Range<usize>, followed: &[FollowedFrame]) -> FittedSegment {
        let observations: Vec<Observation> = followed.iter().map(observation).collect();
        let confidences: Vec<f64> = followed.iter().map(|frame| frame.confidence).collect();
        let fit = self.forecaster.fit(self.camera, &observations, self.options);
        let fit = fit.map_err(|error| error.to_string()).map(|fit| fit.doubted(&confidences, self.scene()));
        FittedSegment { frames: range.clone(), observations, fit }
    }

    fn scene(&self) -> &Scene {
        self.forecaster.scene()
    }

    /// The frames of a segment by its explained flights: where the label is an outlier or there is none, the candidate nearest to the path, if one is
    /// on it.
    fn corrected(&self, range: &Range<usize>, followed: &[FollowedFrame], fit: &Fit) -> Vec<FollowedFrame> {
        let labelled = |index: &usize| fit.frames[*index].residual_px.is_some() && !fit.frames[*index].outlier;
        let corrected = |(index, own): (usize, &FollowedFrame)| {
            let fitted = &fit.frames[index];
            if !fitted.explained || own.repeated || labelled(&index) {
                return *own;
            }
            let path = self.camera.image_from_world(&fitted.world).ok().and_then(|at| in_frame(own, at));
            let candidates = self.alternatives.candidates.get(range.start + index);
            let near = path.zip(candidates).and_then(|(path, candidates)| {
                let off = |candidate: &Candidate| {
                    let sigma = fit.noise_px.hypot(candidate.point.sigma.unwrap_or_default());
                    candidate.point.image().map_or(f64::INFINITY, |at| (at - path).norm() / sigma)
                };
                let on_path = candidates.iter().filter(|candidate| off(candidate) <= ON_PATH);
                on_path.min_by(|a, b| off(a).total_cmp(&off(b)))
            });
            // As sure as the labels beside it.
            let beside = [(0..index).rev().find(labelled), (index + 1..followed.len()).find(labelled)];
            let beside = beside.into_iter().flatten().map(|index| followed[index].confidence).reduce(f64::min);
            match near.zip(beside) {
                Some((candidate, confidence)) => taken(own, candidate, confidence),
                None => *own,
            }
        };
        followed.iter().enumerate().map(corrected).collect()
    }

    /// The likeliest other track that is explained there. A short one is explained easily: it must explain more than half as many labels as were
    /// followed.
    fn by_another_track(&self, range: &Range<usize>, followed: &[FollowedFrame]) -> Option<Revised> {
        self.alternatives.tracks.iter().enumerate().take(MOST_TRIED).find_map(|(track, frames)| {
            let mut other: Vec<FollowedFrame> = followed.iter().map(without).collect();
            for (frame, candidate, confidence) in frames.iter().filter(|(frame, ..)| range.contains(frame)) {
                let own = &mut other[frame - range.start];
                *own = taken(own, candidate, *confidence);
            }
            let segment = self.fit(range, &other);
            let labels = followed.iter().filter(|frame| frame.ball.is_some()).count();
            let is_explained =
                segment.fit.as_ref().is_ok_and(|fit| fit.explained && 2 * explained_labels(fit) > labels);
            is_explained.then(|| Revised { segment, changes: changes(range, followed, &other), track: Some(track) })
        })
    }
}

/// Where a place of the first view is in a frame; none where that is not known.
fn in_frame(frame: &FollowedFrame, at: Point2<f64>) -> Option<Point2<f64>> {
    match (frame.elsewhere, frame.view) {
        (None, _) => Some(at),
        (Some(CameraMotion::Moved(_)), Some(view)) => Some(view.frame(&Place::new(at.into())).xy.into()),
        _ => None,
    }
}

/// Labels that explained flights explain.
fn explained_labels(fit: &Fit) -> usize {
    fit.frames.iter().filter(|frame| frame.explained && frame.residual_px.is_some() && !frame.outlier).count()
}

fn taken(own: &FollowedFrame, candidate: &Candidate, confidence: f64) -> FollowedFrame {
    let point = TrackPoint { frame: own.point.frame, time: own.point.time, ..candidate.point };
    FollowedFrame { point, ball: Some(candidate.ball), confidence, ..*own }
}

fn without(own: &FollowedFrame) -> FollowedFrame {
    let point = TrackPoint { frame: own.point.frame, time: own.point.time, ..TrackPoint::default() };
    FollowedFrame { point, ball: None, confidence: 0.0, ..*own }
}

/// The frames that differ.
fn changes(range: &Range<usize>, before: &[FollowedFrame], after: &[FollowedFrame]) -> Vec<(usize, FollowedFrame)> {
    let both = before.iter().zip(after).enumerate();
    both.filter(|(_, (before, after))| before != after)
        .map(|(index, (_, after))| (range.start + index, *after))
        .collect()
}
