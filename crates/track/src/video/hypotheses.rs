//! What flew in a video, and which of it is the ball.

use std::collections::BTreeMap;

use serde::Serialize;

use super::super::file::TrackPoint;
use super::association::{TrackletSegment, tracks};
use super::blobs::Blob;
use super::config::{RadiiConfig, TrackerConfig};
use super::gravity::GravityTest;
use super::parts::{Features, Part, parts};
use super::state::{BlobId, FrameId, State};
use super::tracklets::{Tracklet, alike};
use super::view::{CameraMotion, FirstView, Place, View};
use gravisight_geometry::camera::{Camera, Detection};
use gravisight_physics::Scene;

/// Something that flies, in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackedBlob {
    /// Middle of it, or of the streak that it left, px.
    pub image: [f64; 2],
    /// Half the width of that, px.
    pub radius_px: f64,
    /// Half its length, px.
    pub reach_px: f64,
}

/// What the weights of paths are fitted to.
#[derive(Debug, Clone)]
pub struct TrackletFeatures {
    /// What tells whether a path is the ball's, as [`WeightsConfig`](super::config::WeightsConfig) lists it.
    pub features: Features,
    /// Frames and places (px) in which it is.
    pub places: Vec<(usize, [f64; 2])>,
}

/// Another ball that may fly beside the one that is reported.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct OtherTrack {
    /// Probability that it is a ball: that of its likeliest part.
    pub probability: f64,
    /// The frames in which it is seen, ascending.
    pub frames: Vec<OtherFrame>,
}

impl OtherTrack {
    fn of(track: &[(usize, Candidate, f64)]) -> Self {
        let frame = |&(frame, Candidate { ball, .. }, confidence): &(usize, Candidate, f64)| {
            let TrackedBlob { image, radius_px, .. } = ball;
            OtherFrame { frame, image, radius_px, confidence }
        };
        let probability = track.iter().map(|(.., confidence)| *confidence).fold(0.0, f64::max);
        Self { probability, frames: track.iter().map(frame).collect() }
    }
}

/// A frame of it.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct OtherFrame {
    /// The frame's index in the video.
    pub frame: usize,
    /// Its centre in the picture, px.
    pub image: [f64; 2],
    /// Its apparent radius, px.
    pub radius_px: f64,
    /// Probability that this part of the track is a ball.
    pub confidence: f64,
}

/// A frame of a video that was followed.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FollowedFrame {
    /// The ball as a line of a 2D track: the network's measure of it where it has one.
    pub point: TrackPoint,
    /// Whether it shows the frame before again.
    pub repeated: bool,
    /// What moves there, where that is the ball.
    pub ball: Option<TrackedBlob>,
    /// Probability that what was found is the ball, by the log-odds of its tracklet (motion, size, what the network sees in it),
    /// whose weights are fitted ([`TrackerConfig`](crate::TrackerConfig)); 0 without one. No model's confidence
    /// (`ConfidenceKind`).
    pub confidence: f64,
    /// Where the camera looks, if not where it did at first: then a camera that was calibrated there makes no metres here.
    pub elsewhere: Option<CameraMotion>,
    /// Its view; none of a repeated frame.
    pub(crate) view: Option<View>,
}

/// The ball through a video, and what may be the ball beside it.
#[derive(Debug)]
pub struct Followed {
    /// One a frame of the video.
    pub frames: Vec<FollowedFrame>,
    /// Other balls, the likeliest first.
    pub tracks: Vec<OtherTrack>,
    pub(crate) alternatives: Alternatives,
}

/// What may be the ball beside what is followed: physics chooses from it.
#[derive(Debug, Default)]
pub(crate) struct Alternatives {
    /// Of each frame of the video, the candidates that a ball that is followed may reach.
    pub candidates: Vec<Vec<Candidate>>,
    /// Of other tracks, the likeliest first, the frames and the probabilities that it is the ball.
    pub tracks: Vec<Vec<(usize, Candidate, f64)>>,
}

/// A candidate, as a line of a 2D track and as it was segmented.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Candidate {
    pub point: TrackPoint,
    pub ball: TrackedBlob,
}

/// All that flew in a video.
pub struct Hypotheses<'a> {
    config: TrackerConfig,
    state: &'a State,
    tracklets: Vec<Tracklet>,
    /// Seeds that no tracklet goes through.
    unused: Vec<(usize, [f64; 2])>,
    /// Whether a motion network answers.
    has_motion: bool,
}

impl<'a> Hypotheses<'a> {
    /// Of these tracklets; no tracklet goes through the `unused` seeds.
    pub(super) fn new(
        config: TrackerConfig,
        state: &'a State,
        tracklets: Vec<Tracklet>,
        unused: Vec<(usize, [f64; 2])>,
    ) -> Self {
        Self { config, state, tracklets, unused, has_motion: state.has_motion() }
    }

    /// The numbers that it is weighed by.
    pub fn config(&self) -> TrackerConfig {
        self.config
    }

    /// Frames and places (px) in which a person saw the ball, and which no tracklet goes through.
    pub fn unused_seeds(&self) -> &[(usize, [f64; 2])] {
        &self.unused
    }

    /// Frames, to within one, from which on most of the picture is another: a cut, or the camera moved.
    pub fn cuts(&self) -> Vec<usize> {
        self.state.cuts().iter().map(|&frame| self.state.frame(frame).number).collect()
    }

    /// The ball, frame by frame, and the tracks of other balls. Where the camera (of these pictures) and the scene are known, by how its path bends,
    /// too.
    pub fn followed(&self, place: Option<(&Camera, &Scene)>) -> Followed {
        let state = self.state;
        let frame = |number: usize| {
            let (time, repeated) = state.shown_at(number);
            let point = TrackPoint { frame: number as u64, time: Some(time), ..TrackPoint::default() };
            FollowedFrame { point, repeated, ..FollowedFrame::default() }
        };
        let mut frames: Vec<FollowedFrame> = (0..state.shown()).map(frame).collect();
        for own in state.frames() {
            (frames[own.number].view, frames[own.number].elsewhere) = (Some(own.view), own.elsewhere);
        }
        let segments = self.parts(place, &self.config).into_iter().map(|part| self.segment(part)).collect();
        let mut tracks = tracks(state, &self.config, segments).into_iter().map(|track| self.balls(&track));
        let followed = tracks.next().unwrap_or_default();
        for (&frame, &(member, confidence)) in &followed {
            let frame = &mut frames[state.frame(frame).number];
            let Candidate { point, ball } = self.candidate(member, frame.point);
            (frame.point, frame.ball, frame.confidence) = (point, Some(ball), confidence);
        }
        correlate_radius_errors(&mut frames, &self.config.radii);
        let candidate = |(frame, (member, confidence)): (FrameId, (BlobId, f64))| {
            let number = state.frame(frame).number;
            (number, self.candidate(member, frames[number].point), confidence)
        };
        let others: Vec<Vec<(usize, Candidate, f64)>> =
            tracks.map(|balls| balls.into_iter().map(candidate).collect()).collect();
        let tracks = others.iter().map(|track| OtherTrack::of(track)).collect();
        let candidates = if place.is_some() { self.candidates(&followed) } else { vec![] };
        Followed { frames, tracks, alternatives: Alternatives { candidates, tracks: others } }
    }

    fn candidate(&self, member: BlobId, nothing: TrackPoint) -> Candidate {
        let ball = self.followed_blob(member);
        let evidence = self.state.evidence(member);
        let point = point(&ball, self.state.blob(member).sigma, evidence.ball(), nothing, &self.config.radii);
        Candidate { point, ball }
    }

    /// Of each frame of the video, the candidates that the ball of the nearest frame in which it is followed may reach.
    fn candidates(&self, followed: &BTreeMap<FrameId, (BlobId, f64)>) -> Vec<Vec<Candidate>> {
        let state = self.state;
        let mut candidates = vec![vec![]; state.shown()];
        for (index, frame) in state.frames().iter().enumerate() {
            let id = FrameId(index);
            let beside = [followed.range(..=id).next_back(), followed.range(id..).next()].into_iter().flatten();
            let Some((&near, &(ball, _))) = beside.min_by_key(|(other, _)| other.0.abs_diff(index)) else { continue };
            let ball = state.blob(ball);
            let apart = (state.frame(near).time - frame.time).abs();
            let reach = (1.0 + self.config.flight.max_speed * apart) * ball.radius;
            let reached = frame.candidates().filter(|(_, blob)| {
                alike(blob, ball, self.config.tracklets.alike) && blob.at.distance(&ball.at) <= reach
            });
            let nothing = TrackPoint::default();
            candidates[frame.number] = reached.map(|(member, _)| self.candidate(member, nothing)).collect();
        }
        candidates
    }

    /// The ball of a track in each frame, and its confidence: the likeliest candidate, by the log-odds of its segment and of its own detection.
    fn balls(&self, track: &[TrackletSegment]) -> BTreeMap<FrameId, (BlobId, f64)> {
        let mut likeliest: BTreeMap<FrameId, (f64, BlobId, f64)> = BTreeMap::new();
        for segment in track {
            for &member in &segment.members {
                let log_odds = segment.log_odds + self.state.evidence(member).log_odds();
                let frame = self.state.frame_of(member);
                if likeliest.get(&frame).is_none_or(|other| log_odds >= other.0) {
                    likeliest.insert(frame, (log_odds, member, segment.confidence()));
                }
            }
        }
        let mut balls: BTreeMap<FrameId, (BlobId, f64)> =
            likeliest.into_iter().map(|(frame, (_, member, confidence))| (frame, (member, confidence))).collect();
        self.fill(&mut balls);
        balls
    }

    /// Adds the balls that the network sees in the few frames between two that are known, where they are between those: a tracklet ends
    /// at a bounce or a hit, and the next begins after it.
    fn fill(&self, balls: &mut BTreeMap<FrameId, (BlobId, f64)>) {
        let config = &self.config.association;
        let known: Vec<(FrameId, (BlobId, f64))> = balls.iter().map(|(frame, ball)| (*frame, *ball)).collect();
        for pair in known.windows(2) {
            let [(before, (earlier, sure)), (after, (later, sure_after))] = [pair[0], pair[1]];
            if after.since(before) > config.most_filled + 1 {
                continue;
            }
            let [from, to] = [earlier, later].map(|member| self.state.blob(member));
            let [x, y] = to.at.minus(&from.at);
            let reach = config.fill_reach * from.radius.max(to.radius) + x.hypot(y) / 2.0;
            let middle = Place::new([from.at.xy[0] + x / 2.0, from.at.xy[1] + y / 2.0]);
            for frame in (before.0 + 1..after.0).map(FrameId) {
                let off = |blob: &Blob<FirstView>| blob.at.distance(&middle);
                let near = self.state.frame(frame).candidates().filter(|(_, blob)| {
                    blob.is_ball && alike(blob, from, self.config.tracklets.alike) && off(blob) <= reach
                });
                if let Some((member, _)) = near.min_by(|a, b| off(a.1).total_cmp(&off(b.1))) {
                    balls.insert(frame, (member, sure.min(sure_after)));
                }
            }
        }
    }

    /// The parts of all tracklets.
    fn parts(&self, place: Option<(&Camera, &Scene)>, config: &TrackerConfig) -> Vec<Part> {
        let gravity_test = place.map(|(camera, scene)| GravityTest { config: &config.gravity, camera, scene });
        parts(&self.tracklets, self.state, config, gravity_test.as_ref())
    }

    fn segment(&self, part: Part) -> TrackletSegment {
        let log_odds = part.log_odds(&self.config, self.has_motion);
        let confirms = !self.has_motion || log_odds >= self.config.association.confirmed;
        let members = part.members;
        let frames = [members[0], members[members.len() - 1]].map(|member| self.state.frame_of(member));
        TrackletSegment { members, frames, log_odds, confirms }
    }

    /// What tells of all parts of tracklets whether they are the ball's.
    pub fn tracklet_features(&self, place: Option<(&Camera, &Scene)>, config: &TrackerConfig) -> Vec<TrackletFeatures> {
        let place_of = |&member: &BlobId| {
            let frame = self.state.frame(self.state.frame_of(member));
            (frame.number, self.followed_blob(member).image)
        };
        let of_part = |Part { members, features, .. }: Part| TrackletFeatures {
            features,
            places: members.iter().map(place_of).collect(),
        };
        self.parts(place, config).into_iter().map(of_part).collect()
    }

    fn followed_blob(&self, member: BlobId) -> TrackedBlob {
        let view = &self.state.frame(self.state.frame_of(member)).view;
        let blob = self.state.blob(member).in_frame(view);
        TrackedBlob { image: blob.at.xy, radius_px: blob.radius, reach_px: blob.reach }
    }
}

/// A ball as a line of a 2D track, `sigma` (px) that of its place without a network; `nothing` has the frame's number and time.
fn point(
    ball: &TrackedBlob,
    sigma: f64,
    found: Option<&Detection>,
    nothing: TrackPoint,
    config: &RadiiConfig,
) -> TrackPoint {
    let at =
        |[x, y]: [f64; 2], sigma| TrackPoint { visibility: 1, x: Some(x), y: Some(y), sigma: Some(sigma), ..nothing };
    let Some(found) = found else { return at(ball.image, sigma) };
    let sized = ball.reach_px < config.streak * ball.radius_px;
    let [radius, radius_sigma] = [found.outline.radius, found.radius_sigma_px()].map(|it| sized.then_some(it));
    TrackPoint { radius, radius_sigma, ..at(found.outline.centre.coords.into(), found.sigma_px()) }
}

/// Enlarges the radii's standard deviations so that neighbouring frames together are hardly surer than one of them: a network's error in
/// one is its error in the next.
fn correlate_radius_errors(frames: &mut [FollowedFrame], &RadiiConfig { common, lasting, .. }: &RadiiConfig) {
    let sized: Vec<f64> =
        frames.iter().filter(|frame| frame.point.radius.is_some()).filter_map(|frame| frame.point.time).collect();
    for FollowedFrame { point, .. } in frames {
        let (Some(sigma), Some(time)) = (&mut point.radius_sigma, point.time) else { continue };
        let near = sized.partition_point(|&other| other < time + lasting)
            - sized.partition_point(|&other| other < time - lasting);
        *sigma *= (1.0 - common + common * near.max(1) as f64).sqrt();
    }
}
