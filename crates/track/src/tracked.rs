//! A video's ball: where it is in each frame, and the flights of each segment of them.

mod revise;
mod verdict;

use std::ops::Range;

use nalgebra::{Point2, Point3};
use rayon::prelude::*;
use serde::Serialize;

use self::revise::{Fitter, Revised};
pub(crate) use self::verdict::listed;
use super::file::Track;
use super::segments::segments;
use super::video::{Alternatives, CameraMotion, Followed, FollowedFrame, Hypotheses, OtherTrack, TrackerConfig};
use crate::config::EstimatorConfig;
use crate::config::FitOptions;
use crate::observation::Observation;
use crate::result::{Fit, FittedImpact, Flight, Hit};
use gravisight_geometry::camera::{Camera, camera_by_homography};
use gravisight_geometry::error::Result;
use gravisight_geometry::statistics::median;
use gravisight_physics::{Forecaster, Scene};

/// Standard deviation of what the radii that are read in a video are off by in common, px: compression, sharpening and streaks make small balls
/// larger (a tennis ball of 3.5 px in a broadcast by 0.8 px).
const RADIUS_BIAS: f64 = 0.6;

/// Standard deviation of the common error of the radii of about `px` that are read in a video, as a fraction of them; `sigma` is that of a
/// single picture's.
#[doc(hidden)]
pub fn common_size_sigma(sigma: f64, px: f64) -> f64 {
    sigma.hypot(RADIUS_BIAS / px)
}

/// Segments that are fitted at a time, for each thread.
const SEGMENTS_A_THREAD: usize = 4;

/// The ball in a video (`VideoTracker::track`): in each frame, and its flights.
#[derive(Debug, Default, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify), tsify(missing_as_null))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct TrackedVideo {
    /// What came out, in a sentence.
    pub verdict: String,
    /// Whether there is a flight, and physics explains each; null without camera and scene.
    pub explained: Option<bool>,
    /// One a frame of the video.
    pub frames: Vec<TrackedFrame>,
    /// Other balls that may fly beside the one of `frames`, the likeliest first; in pixels only.
    pub tracks: Vec<OtherTrack>,
    /// From hit to hit, bounces between.
    pub flights: Vec<Flight>,
    /// Where something that the scene does not hold changes the ball's path.
    pub hits: Vec<Hit>,
    /// Where the ball touches something of the scene, by time. The command's JSON calls them `bounces`, as its first version did.
    #[cfg_attr(not(target_arch = "wasm32"), serde(rename = "bounces"))]
    pub impacts: Vec<FittedImpact>,
    /// Frames, to within one, from which on most of the picture is another: a cut, or the camera moved.
    pub cuts: Vec<usize>,
    /// Frames in which the camera looks elsewhere than at first. Without `moved_px` there are no metres.
    pub elsewhere: Vec<OtherView>,
    /// The numbers by which the ball was tracked.
    pub config: TrackerConfig,
    /// What is odd about the track, in words.
    pub notes: Vec<String>,
    /// Frames and places (px) in which a person saw the ball, and which no path goes through.
    #[serde(skip)]
    pub(crate) unused_seeds: Vec<(usize, [f64; 2])>,
    /// What may be the ball beside what was followed.
    #[serde(skip)]
    pub(crate) alternatives: Alternatives,
    /// The frames between pauses; none without [`Self::fit`].
    #[serde(skip)]
    pub segments: Vec<FittedSegment>,
}

/// The ball in a frame of a video.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(serde::Deserialize, tsify::Tsify), tsify(missing_as_null))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct TrackedFrame {
    /// The frame's index in the video.
    pub frame: usize,
    /// When it was taken, s.
    pub time: f64,
    /// Whether the picture is the one of the frame before again.
    pub repeated: bool,
    /// The ball's centre in the picture, px; null where it is not seen.
    pub image: Option<Point2<f64>>,
    /// Its apparent radius, px; null where it is not known.
    pub radius_px: Option<f64>,
    /// Probability that what was found is the ball, 0 to 1, by its motion, its size and what the networks see in it
    /// ([`WeightsConfig`](super::video::WeightsConfig)); no model's confidence. 0 where it is not seen.
    pub confidence: f64,
    /// The ball's centre in the world, m; null outside flights, as all that follows.
    pub world: Option<Point3<f64>>,
    /// Root mean square error of that to expect, m.
    pub sigma: Option<f64>,
    /// 1-σ of where the frame's view puts a point, px of the first view; 0 of a camera that stands still. Null where the view is not related to
    /// the first one; then there are no metres.
    pub camera_sigma_px: Option<f64>,
    /// m/s.
    pub speed: Option<f64>,
    /// Index of the flight that it belongs to.
    pub flight: Option<usize>,
    /// Whether that flight is explained; where it is not, the position is not known.
    pub explained: Option<bool>,
    /// Whether what was seen there does not belong to that flight's trajectory.
    pub outlier: bool,
    /// As it was followed through the pictures.
    #[serde(skip)]
    pub followed: FollowedFrame,
}

/// Frames of a video that show another view than the first.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify), tsify(missing_as_null))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct OtherView {
    /// The first of them.
    pub from: usize,
    /// The last.
    pub to: usize,
    /// How far what stands still is away at most from where it was, px; null where that is not known.
    pub moved_px: Option<f64>,
}

/// What was fitted of a segment of frames.
#[derive(Debug)]
pub struct FittedSegment {
    /// By index.
    pub frames: Range<usize>,
    /// The labels of these frames.
    pub observations: Vec<Observation>,
    /// Why it could not be fitted, in words.
    pub fit: std::result::Result<Fit, String>,
}

impl TrackedVideo {
    /// The ball in 2D. Where the camera (of these pictures) and the scene are known they help to tell it.
    #[doc(hidden)]
    pub fn new(hypotheses: &Hypotheses<'_>, place: Option<(&Camera, &Scene)>) -> Self {
        let Followed { frames, tracks, alternatives } = hypotheses.followed(place);
        let frames = frames.into_iter().enumerate().map(TrackedFrame::new).collect();
        let (cuts, config) = (hypotheses.cuts(), hypotheses.config());
        let mut video = Self { frames, tracks, cuts, config, alternatives, ..Self::default() };
        video.elsewhere = video.other_views();
        video.unused_seeds = hypotheses.unused_seeds().to_vec();
        video.verdict = video.verdict_text();
        video
    }

    /// The camera of each frame, by that of the first one (of these pictures): turned and zoomed about its centre. None where the view is not
    /// related to the first one.
    pub fn cameras(&self, first: &Camera) -> Vec<Option<Camera>> {
        let mut last = None;
        let camera = |frame: &TrackedFrame| {
            if !frame.repeated {
                last = match (frame.followed.elsewhere, frame.followed.view) {
                    (Some(CameraMotion::Cut), _) | (_, None) => None,
                    (None, _) => Some(first.clone()),
                    (Some(CameraMotion::Moved(_)), Some(view)) => camera_by_homography(first, &view.frame_from_first),
                };
            }
            last.clone()
        };
        self.frames.iter().map(camera).collect()
    }

    /// The 2D track.
    pub fn track(&self) -> Track {
        Track { points: self.frames.iter().map(|frame| frame.followed.point).collect(), nowhere: 0 }
    }

    /// Frames that show the ball.
    pub fn found(&self) -> usize {
        self.frames.iter().filter(|frame| frame.followed.point.visibility > 0).count()
    }

    /// Finds the flights, segment by segment; `progress` hears how many are done, and of how many.
    ///
    /// # Errors
    /// As [`Track::observations`]. That a segment cannot be fitted is a result ([`FittedSegment::fit`]).
    pub fn fit(
        &mut self,
        forecaster: &Forecaster,
        camera: &Camera,
        options: &FitOptions,
        mut progress: impl FnMut(usize, usize),
    ) -> Result<()> {
        // Of a rate that was raised, a video's own times are no longer those of the frames.
        let times_known = options.times_known && !self.frames.iter().any(|frame| frame.repeated);
        let (_, observations) = self.track().observations(None)?;
        let radius = median(observations.iter().filter_map(|seen| Some(seen.radius?[0])));
        let config = options.config.unwrap_or_else(|| {
            let own = EstimatorConfig::of(forecaster.scene(), camera.size());
            EstimatorConfig {
                size_sigma: radius.map_or(own.size_sigma, |px| common_size_sigma(own.size_sigma, px)),
                ..own
            }
        });
        let options = FitOptions { times_known, config: Some(config), sizes_measured: true, ..options.clone() };
        let observations: Vec<Observation> =
            self.frames.iter().map(|frame| revise::observation(&frame.followed)).collect();
        let ranges = segments(&observations);
        let count = ranges.len();
        self.forget();
        let alternatives = std::mem::take(&mut self.alternatives);
        // As many at a time as keep every thread busy, and still tell of the progress.
        for ranges in ranges.chunks(match rayon::current_num_threads() {
            1 => 1,
            threads => SEGMENTS_A_THREAD * threads,
        }) {
            let fitter =
                Fitter { frames: &self.frames, alternatives: &alternatives, forecaster, camera, options: &options };
            for revised in ranges.par_iter().map(|range| fitter.revised(range)).collect::<Vec<_>>() {
                self.revise(&revised);
                let segment = revised.segment;
                if let Ok(fit) = &segment.fit {
                    self.add(segment.frames.start, fit);
                }
                self.segments.push(segment);
                progress(self.segments.len(), count);
            }
        }
        self.alternatives = alternatives;
        // Both lists hold the same tracks.
        let mut is_left = self.tracks.iter().map(|track| !track.frames.is_empty());
        self.alternatives.tracks.retain(|_| is_left.next().unwrap_or(false));
        self.tracks.retain(|track| !track.frames.is_empty());
        self.explained = Some(!self.segments.is_empty() && self.segments.iter().all(FittedSegment::explained));
        self.verdict = self.verdict_text();
        Ok(())
    }

    /// Takes what physics says is the ball.
    fn revise(&mut self, revised: &Revised) {
        for &(number, followed) in &revised.changes {
            self.frames[number] = TrackedFrame::new((number, followed));
        }
        let Some(track) = revised.track else { return };
        let range = &revised.segment.frames;
        if let Some(other) = self.tracks.get_mut(track) {
            other.frames.retain(|frame| !range.contains(&frame.frame));
        }
        let (first, last) = (range.start, range.end - 1);
        self.notes.push(format!(
            "no flight explains the likeliest path in frames {first} to {last}; a flight explains another one, which is reported instead"
        ));
    }

    /// Takes back what was fitted.
    fn forget(&mut self) {
        for (number, frame) in self.frames.iter_mut().enumerate() {
            *frame = TrackedFrame::new((number, frame.followed));
        }
        (self.flights, self.hits, self.impacts, self.notes, self.segments) = Default::default();
    }

    /// Adds the fit of the frames from `first` on. Its flights count on from those before.
    fn add(&mut self, first: usize, fit: &Fit) {
        for (frame, fitted) in self.frames[first..].iter_mut().zip(&fit.frames) {
            frame.world = Some(fitted.world);
            frame.sigma = Some(fitted.sigma);
            frame.speed = Some(fitted.speed);
            frame.flight = Some(self.flights.len() + fitted.flight);
            frame.explained = Some(fitted.explained);
            frame.outlier = fitted.outlier;
        }
        self.hits.extend(fit.hits.iter().map(|hit| Hit { frame: first + hit.frame, ..*hit }));
        self.flights.extend_from_slice(&fit.flights);
        self.impacts.extend_from_slice(&fit.impacts);
        self.notes.extend_from_slice(&fit.notes);
    }

    /// Frames in which the camera looks elsewhere than at first.
    fn other_views(&self) -> Vec<OtherView> {
        let mut views: Vec<OtherView> = Vec::new();
        let mut goes_on = false;
        for TrackedFrame { frame, followed, .. } in self.frames.iter().filter(|frame| !frame.repeated) {
            let moved_px = match followed.elsewhere {
                None => {
                    goes_on = false;
                    continue;
                }
                Some(CameraMotion::Moved(px)) => Some(px),
                Some(CameraMotion::Cut) => None,
            };
            match views.last_mut().filter(|view| goes_on && view.moved_px.is_some() == moved_px.is_some()) {
                Some(view) => {
                    view.to = *frame;
                    view.moved_px = view.moved_px.zip(moved_px).map(|(most, px)| most.max(px));
                }
                None => views.push(OtherView { from: *frame, to: *frame, moved_px }),
            }
            goes_on = true;
        }
        views
    }
}

impl TrackedFrame {
    /// A frame of the video by its index, without metres.
    fn new((frame, followed): (usize, FollowedFrame)) -> Self {
        let FollowedFrame { point, repeated, confidence, .. } = followed;
        let (time, image, radius_px) = (point.time.unwrap_or_default(), point.image(), point.radius);
        let camera_sigma_px = match (followed.elsewhere, followed.view) {
            (Some(CameraMotion::Cut), _) | (_, None) => None,
            (None, _) => Some(0.0),
            (Some(CameraMotion::Moved(_)), Some(view)) => Some(view.sigma),
        };
        Self { frame, time, repeated, image, radius_px, confidence, camera_sigma_px, followed, ..Self::default() }
    }
}

impl FittedSegment {
    /// Whether physics explains it.
    pub fn explained(&self) -> bool {
        self.fit.as_ref().is_ok_and(|fit| fit.explained)
    }

    fn verdict(&self) -> String {
        match &self.fit {
            Ok(fit) => fit.verdict.clone(),
            Err(error) => format!("not explained: {error}"),
        }
    }
}

#[cfg(test)]
mod tests;
