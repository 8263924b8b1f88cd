//! What flew in a video, and which of it is the ball.

use std::collections::BTreeMap;
use std::ops::Range;

use serde::Serialize;

use super::super::file::TrackPoint;
use super::association::{TrackletSegment, tracks};
use super::blobs::Blob;
use super::config::{RadiiConfig, TrackerConfig};
use super::evidence::Evidence;
use super::fall;
use super::gravity::{GravityTest, ImagePoint};
use super::state::{BlobId, FrameId, State};
use super::tracklets::{Tracklet, alike};
use super::view::{CameraMotion, FirstView, Place, View};
use gravisight_geometry::camera::{Camera, Detection};
use gravisight_geometry::statistics::median;
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
    pub features: [f64; 8],
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
    pub fn frames(&self, place: Option<(&Camera, &Scene)>) -> (Vec<FollowedFrame>, Vec<OtherTrack>) {
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
        let gravity_test = place.map(|(camera, scene)| GravityTest { config: &self.config.gravity, camera, scene });
        let segments = self.tracklets.iter().flat_map(|tracklet| self.segments(tracklet, gravity_test.as_ref()));
        let mut tracks = tracks(state, &self.config, segments.collect()).into_iter();
        for (frame, (member, confidence)) in self.balls(&tracks.next().unwrap_or_default()) {
            let frame = &mut frames[state.frame(frame).number];
            let ball = self.followed(member);
            frame.point =
                point(&ball, state.blob(member).sigma, state.evidence(member).ball(), frame.point, &self.config.radii);
            (frame.ball, frame.confidence) = (Some(ball), confidence);
        }
        correlate_radius_errors(&mut frames, &self.config.radii);
        let other = |track: Vec<TrackletSegment>| OtherTrack {
            probability: track.iter().map(TrackletSegment::confidence).fold(0.0, f64::max),
            frames: (self.balls(&track).into_iter())
                .map(|(frame, (member, confidence))| {
                    let TrackedBlob { image, radius_px, .. } = self.followed(member);
                    OtherFrame { frame: state.frame(frame).number, image, radius_px, confidence }
                })
                .collect(),
        };
        (frames, tracks.map(other).collect())
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

    /// A tracklet, cut where the detector begins or ceases to see a ball for some frames: a ball's tracklet may go on as its shadow's. It is
    /// also cut before and after the part with the highest motion log-odds, where those of the rest reject a ball clearly: beyond a hit, a
    /// tracklet may go on as another object's.
    fn segments(&self, tracklet: &Tracklet, gravity_test: Option<&GravityTest>) -> Vec<TrackletSegment> {
        let members = &tracklet.members;
        let seen: Vec<Evidence> = members.iter().map(|&member| self.state.evidence(member)).collect();
        let frames = self.config.evidence.run;
        let lasts = |from: usize| {
            let run = seen[from..].iter().take(frames);
            run.len() == frames && run.clone().all(|it| it.agrees_with(&seen[from]))
        };
        let is_cut = |end: usize| lasts(end) && seen[end - 1].contradicts(&seen[end]);
        let mut cuts: Vec<usize> = (1..members.len()).filter(|&end| is_cut(end)).collect();
        if !tracklet.seeded {
            let motion: Vec<f64> = members.iter().map(|&member| self.state.motion(member).unwrap_or(0.0)).collect();
            let part = best_part(&motion);
            let sum = |values: &[f64]| values.iter().sum::<f64>();
            // A part of another object's tracklet may look like a ball.
            let is_other = |values: &[f64]| sum(&motion) > 0.0 && sum(values) <= -self.config.tracklets.min_gain;
            cuts.extend(is_other(&motion[..part.start]).then_some(part.start));
            cuts.extend(is_other(&motion[part.end..]).then_some(part.end));
        }
        cuts.extend([0, members.len()]);
        cuts.sort_unstable();
        let parts = cuts.windows(2).filter(|cut| cut[1] - cut[0] > 1).map(|cut| members[cut[0]..cut[1]].to_vec());
        let segment = |members: Vec<BlobId>| {
            let log_odds = self.log_odds(tracklet, &members, gravity_test);
            let confirms = !self.has_motion || log_odds >= self.config.association.confirmed;
            let frames = [members[0], members[members.len() - 1]].map(|member| self.state.frame_of(member));
            TrackletSegment { members, frames, log_odds, confirms }
        };
        parts.map(segment).collect()
    }

    /// What tells of all parts of tracklets whether they are the ball's.
    pub fn tracklet_features(&self, place: Option<(&Camera, &Scene)>) -> Vec<TrackletFeatures> {
        let gravity_test = place.map(|(camera, scene)| GravityTest { config: &self.config.gravity, camera, scene });
        let of_segment = |tracklet: &Tracklet, segment: TrackletSegment| {
            let features = self.features(tracklet, &segment.members, gravity_test.as_ref());
            let places = segment
                .members
                .iter()
                .map(|&member| (self.state.frame(self.state.frame_of(member)).number, self.followed(member).image));
            TrackletFeatures { features, places: places.collect() }
        };
        let features = self.tracklets.iter().flat_map(|tracklet| {
            let segments = self.segments(tracklet, gravity_test.as_ref());
            segments.into_iter().map(move |segment| of_segment(tracklet, segment))
        });
        features.collect()
    }

    /// Log-odds that a part of a tracklet is the ball.
    fn log_odds(&self, tracklet: &Tracklet, members: &[BlobId], gravity_test: Option<&GravityTest>) -> f64 {
        if tracklet.seeded {
            return self.config.weights.seeded;
        }
        let config = &self.config.weights;
        let weights = if self.has_motion { config.with_motion } else { config.without_motion };
        let features = self.features(tracklet, members, gravity_test);
        features.iter().zip(weights).map(|(value, weight)| value * weight).sum()
    }

    /// What tells whether a part of a tracklet is the ball's, as [`WeightsConfig`](super::config::WeightsConfig) lists it.
    fn features(&self, tracklet: &Tracklet, members: &[BlobId], gravity_test: Option<&GravityTest>) -> [f64; 8] {
        let (mut queried, mut detected) = (0.0_f64, 0.0);
        let image_point = |&member: &BlobId| {
            let blob = self.state.blob(member);
            let evidence = self.state.evidence(member);
            queried += f64::from(u8::from(evidence.is_queried()));
            detected += evidence.log_odds();
            ImagePoint {
                time: self.state.time_of(member),
                at: blob.at.xy.into(),
                radius: blob.radius,
                sigma: blob.sigma,
            }
        };
        let path: Vec<ImagePoint> = members.iter().map(image_point).collect();
        // Without an answer of the motion network there is no evidence for a ball.
        let motion: Vec<f64> = members.iter().filter_map(|&member| self.state.motion(member)).collect();
        let motion = motion.iter().sum::<f64>() / motion.len().max(1) as f64;
        let small =
            median(path.iter().map(|point| point.radius)).is_some_and(|radius| radius < self.config.weights.small);
        // Without an answer there is no evidence for a ball here either.
        let detector = match queried > 0.0 {
            true => detected / queried,
            false => Evidence::of(None, &self.config.evidence).log_odds(),
        };
        let [large, little] = if small { [0.0, detector] } else { [detector, 0.0] };
        let ratio = (tracklet.log_likelihood_ratio.max(1.0) / self.config.weights.usual_gain).ln();
        let [bend, fall] = match gravity_test {
            Some(gravity_test) => [gravity_test.log_odds(&path), 0.0],
            None => {
                // About as wide as a phone's or a broadcast's.
                let focal = self.state.size[0].max(self.state.size[1]) as f64;
                [0.0, fall::log_odds(&path, focal, &self.config.fall, &self.config.gravity)]
            }
        };
        [1.0, ratio, motion, f64::from(u8::from(small)), large, little, bend, fall]
    }

    fn followed(&self, member: BlobId) -> TrackedBlob {
        let view = &self.state.frame(self.state.frame_of(member)).view;
        let blob = self.state.blob(member).in_frame(view);
        TrackedBlob { image: blob.at.xy, radius_px: blob.radius, reach_px: blob.reach }
    }
}

/// The range of log-odds with the greatest sum, the longest of several; all of them if no sum is positive.
fn best_part(log_odds: &[f64]) -> Range<usize> {
    let mut best = (0.0, 0..log_odds.len());
    let (mut sum, mut start) = (0.0, 0);
    for (place, value) in log_odds.iter().enumerate() {
        if sum < 0.0 {
            (sum, start) = (0.0, place);
        }
        sum += value;
        if sum > 0.0 && sum >= best.0 {
            best = (sum, start..place + 1);
        }
    }
    best.1
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

#[cfg(test)]
mod tests {
    use super::best_part;

    #[test]
    fn the_best_part_leaves_out_what_speaks_against_it_at_its_ends_alone() {
        assert_eq!(best_part(&[0.0, -7.0, -7.0, 0.0, 6.0, -1.0, 7.0, 0.0]), 3..8);
        assert_eq!(best_part(&[5.0, 6.0, -1.0, -8.0]), 0..2);
        assert_eq!(best_part(&[0.0, 0.0]), 0..2);
        assert_eq!(best_part(&[-1.0, -2.0]), 0..2);
    }
}
