//! What flew in a video, and which of it is the ball.

use std::collections::BTreeMap;
use std::ops::Range;

use super::super::file::TrackPoint;
use super::Kept;
use super::association::{TrackletSegment, chain};
use super::blobs::Blob;
use super::config::TrackerConfig;
use super::evidence::Evidence;
use super::gravity::{GravityTest, ImagePoint};
use super::queries::Verdicts;
use super::tracklets::{Candidates, Tracklet, alike};
use super::view::View;
use gravisight_geometry::camera::{Camera, Detection};
use gravisight_geometry::statistics::median;
use gravisight_physics::Scene;

/// Length over width of a streak from which its width is no ball's radius.
const STREAK: f64 = 2.5;
/// Fraction of the variance of a measured radius that is common to frames less than so many seconds apart.
const COMMON: f64 = 0.7;
const DOUBT_LASTS: f64 = 0.5;
/// Most frames between two balls that are filled, and how far from between them a ball may be in those, radii.
const MOST_BETWEEN: usize = 4;
const NEAR: f64 = 1.5;
/// A tracklet is cut where the detector's answer changes and then stays the same for so many frames.
const RUN: usize = 3;
/// Radius below which a ball is small, px: networks miss those.
const SMALL: f64 = 3.0;
/// Log-likelihood ratio of a tracklet that is no evidence for or against a ball.
const USUAL_LOG_RATIO: f64 = 27.0;
/// Log-odds of a tracklet that a person pointed at.
const SEEDED: f64 = 20.0;

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

/// Where a camera looks that no longer looks where it did at first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CameraMotion {
    /// It turned, moved or zoomed: what stands still is so far away in the picture, px, from where it was.
    Moved(f64),
    /// Most of the picture changed at once.
    Cut,
}

/// What the weights of paths are fitted to.
#[derive(Debug, Clone)]
pub struct TrackletFeatures {
    /// What tells whether a path is the ball's, as [`TrackerConfig::weights`] lists it.
    pub features: [f64; 7],
    /// Frames and places (px) in which it is.
    pub places: Vec<(usize, [f64; 2])>,
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
    kept: &'a [Kept],
    seen: &'a [Candidates],
    tracklets: Vec<Tracklet>,
    verdicts: &'a Verdicts,
    /// Numbers of the frames of which `seen` tells.
    numbers: Vec<usize>,
    cuts: Vec<usize>,
    views: &'a [View],
    elsewhere: &'a [Option<CameraMotion>],
    /// Seeds that no tracklet goes through.
    unused: Vec<(usize, [f64; 2])>,
}

impl<'a> Hypotheses<'a> {
    pub(super) fn new(
        kept: &'a [Kept],
        seen: &'a [Candidates],
        tracklets: Vec<Tracklet>,
        verdicts: &'a Verdicts,
        cuts: &[usize],
        (views, elsewhere): (&'a [View], &'a [Option<CameraMotion>]),
    ) -> Self {
        let numbers: Vec<usize> =
            kept.iter().enumerate().filter(|(_, kept)| !kept.repeated).map(|(number, _)| number).collect();
        let cuts = cuts.iter().map(|&place| numbers[place]).collect();
        let config = TrackerConfig::default();
        Self { config, kept, seen, tracklets, verdicts, numbers, cuts, views, elsewhere, unused: vec![] }
    }

    /// The same, weighed by numbers of one's own.
    pub(super) fn with_config(self, config: TrackerConfig) -> Self {
        Self { config, ..self }
    }

    /// The numbers that it is weighed by.
    pub fn config(&self) -> TrackerConfig {
        self.config
    }

    /// The same, with seeds that no tracklet goes through.
    pub(super) fn with_unused(self, unused: Vec<(usize, [f64; 2])>) -> Self {
        Self { unused, ..self }
    }

    /// Frames and places (px) in which a person saw the ball, and which no tracklet goes through.
    pub fn unused_seeds(&self) -> &[(usize, [f64; 2])] {
        &self.unused
    }

    /// Frames, to within one, from which on most of the picture is another: a cut, or the camera moved.
    pub fn cuts(&self) -> &[usize] {
        &self.cuts
    }

    /// The ball, frame by frame. Where the camera (of these pictures) and the scene are known, by how its path bends, too.
    pub fn frames(&self, place: Option<(&Camera, &Scene)>) -> Vec<FollowedFrame> {
        let frame = |(number, kept): (usize, &Kept)| {
            let point = TrackPoint { frame: number as u64, time: Some(kept.time), ..TrackPoint::default() };
            FollowedFrame { point, repeated: kept.repeated, ..FollowedFrame::default() }
        };
        let mut frames: Vec<FollowedFrame> = self.kept.iter().enumerate().map(frame).collect();
        for (&number, (&view, &elsewhere)) in self.numbers.iter().zip(self.views.iter().zip(self.elsewhere)) {
            (frames[number].view, frames[number].elsewhere) = (Some(view), elsewhere);
        }
        let gravity_test = place.map(|(camera, scene)| GravityTest { camera, scene });
        let segments =
            (0..self.tracklets.len()).flat_map(|tracklet| self.segments(tracklet, gravity_test.as_ref())).collect();
        // Of each frame the likeliest candidate: by the log-odds of its segment and of its own detection.
        let mut likeliest: BTreeMap<usize, (f64, (usize, usize), f64)> = BTreeMap::new();
        for segment in chain(self.seen, &self.config, segments) {
            for &member in &segment.members {
                let log_odds = segment.log_odds + self.verdicts.of(member).log_odds();
                if likeliest.get(&member.0).is_none_or(|other| log_odds >= other.0) {
                    likeliest.insert(member.0, (log_odds, member, segment.confidence()));
                }
            }
        }
        let mut balls: BTreeMap<usize, ((usize, usize), f64)> =
            likeliest.into_iter().map(|(place, (_, member, confidence))| (place, (member, confidence))).collect();
        self.fill(&mut balls);
        for (place, (member, confidence)) in balls {
            let frame = &mut frames[self.numbers[place]];
            let ball = self.followed(member);
            let evidence = self.verdicts.of(member);
            let sigma = self.seen[member.0].blobs[member.1].sigma;
            frame.point = point(&ball, sigma, evidence.ball(), frame.point);
            (frame.ball, frame.confidence) = (Some(ball), confidence);
        }
        correlate_radius_errors(&mut frames);
        frames
    }

    /// Adds the balls that the network sees in the few frames between two that are known, where they are between those: a tracklet ends
    /// at a bounce or a hit, and the next begins after it.
    fn fill(&self, balls: &mut BTreeMap<usize, ((usize, usize), f64)>) {
        let known: Vec<((usize, usize), f64)> = balls.values().copied().collect();
        for pair in known.windows(2) {
            let [(before, sure), (after, sure_after)] = [pair[0], pair[1]];
            if after.0 - before.0 > MOST_BETWEEN + 1 {
                continue;
            }
            let [from, to] = [before, after].map(|(place, index)| &self.seen[place].blobs[index]);
            let displacement = [to.at[0] - from.at[0], to.at[1] - from.at[1]];
            let reach = NEAR * from.radius.max(to.radius) + displacement[0].hypot(displacement[1]) / 2.0;
            for place in before.0 + 1..after.0 {
                let middle = [from.at[0] + displacement[0] / 2.0, from.at[1] + displacement[1] / 2.0];
                let off = |blob: &Blob| (blob.at[0] - middle[0]).hypot(blob.at[1] - middle[1]);
                let blobs = self.seen[place].blobs.iter().enumerate();
                let near = blobs.filter(|(_, blob)| blob.is_ball && alike(blob, from) && off(blob) <= reach);
                if let Some((index, _)) = near.min_by(|a, b| off(a.1).total_cmp(&off(b.1))) {
                    balls.insert(place, ((place, index), sure.min(sure_after)));
                }
            }
        }
    }

    /// A tracklet, cut where the detector begins or ceases to see a ball for some frames: a ball's tracklet may go on as its shadow's. It is
    /// also cut before and after the part with the highest motion log-odds, where those of the rest reject a ball clearly: beyond a hit, a
    /// tracklet may go on as another object's.
    fn segments(&self, number: usize, gravity_test: Option<&GravityTest>) -> Vec<TrackletSegment> {
        let tracklet = &self.tracklets[number];
        let members = &tracklet.members;
        let seen: Vec<Evidence> = members.iter().map(|&member| self.verdicts.of(member)).collect();
        let lasts = |from: usize| {
            let run = seen[from..].iter().take(RUN);
            run.len() == RUN && run.clone().all(|it| it.agrees_with(&seen[from]))
        };
        let is_cut = |end: usize| lasts(end) && seen[end - 1].contradicts(&seen[end]);
        let mut cuts: Vec<usize> = (1..members.len()).filter(|&end| is_cut(end)).collect();
        if !tracklet.seeded {
            let motion: Vec<f64> = members.iter().map(|&member| self.verdicts.motion(member).unwrap_or(0.0)).collect();
            let part = best_part(&motion);
            let sum = |values: &[f64]| values.iter().sum::<f64>();
            // A part of another object's tracklet may look like a ball.
            let is_other = |values: &[f64]| sum(&motion) > 0.0 && sum(values) <= -self.config.min_gain;
            cuts.extend(is_other(&motion[..part.start]).then_some(part.start));
            cuts.extend(is_other(&motion[part.end..]).then_some(part.end));
        }
        cuts.extend([0, members.len()]);
        cuts.sort_unstable();
        let parts = cuts.windows(2).filter(|cut| cut[1] - cut[0] > 1).map(|cut| members[cut[0]..cut[1]].to_vec());
        let segment = |members: Vec<(usize, usize)>| {
            let log_odds = self.log_odds(tracklet, &members, gravity_test);
            let verified = self.verdicts.has_motion();
            let confirms = !verified || log_odds >= self.config.confirmed;
            TrackletSegment { log_odds, verified, confirms, members }
        };
        parts.map(segment).collect()
    }

    /// What tells of all parts of tracklets whether they are the ball's.
    pub fn tracklet_features(&self, place: Option<(&Camera, &Scene)>) -> Vec<TrackletFeatures> {
        let gravity_test = place.map(|(camera, scene)| GravityTest { camera, scene });
        let segments = (0..self.tracklets.len()).flat_map(|tracklet| {
            self.segments(tracklet, gravity_test.as_ref()).into_iter().map(move |it| (tracklet, it))
        });
        let features = segments.map(|(tracklet, segment)| {
            let features = self.features(&self.tracklets[tracklet], &segment.members, gravity_test.as_ref());
            let places = segment.members.iter().map(|&member| (self.numbers[member.0], self.followed(member).image));
            TrackletFeatures { features, places: places.collect() }
        });
        features.collect()
    }

    /// Log-odds that a part of a tracklet is the ball.
    fn log_odds(&self, tracklet: &Tracklet, members: &[(usize, usize)], gravity_test: Option<&GravityTest>) -> f64 {
        if tracklet.seeded {
            return SEEDED;
        }
        let config = &self.config;
        let weights = if self.verdicts.has_motion() { config.weights } else { config.weights_without_motion };
        let features = self.features(tracklet, members, gravity_test);
        features.iter().zip(weights).map(|(value, weight)| value * weight).sum()
    }

    /// What tells whether a part of a tracklet is the ball's, as [`TrackerConfig::weights`] lists it.
    fn features(
        &self,
        tracklet: &Tracklet,
        members: &[(usize, usize)],
        gravity_test: Option<&GravityTest>,
    ) -> [f64; 7] {
        let (mut queried, mut detected) = (0.0, 0.0);
        let image_point = |&(place, index): &(usize, usize)| {
            let blob = &self.seen[place].blobs[index];
            let evidence = self.verdicts.of((place, index));
            queried += f64::from(u8::from(evidence.is_queried()));
            detected += f64::from(u8::from(evidence.is_ball()));
            ImagePoint { time: self.seen[place].time, at: blob.at.into(), radius: blob.radius, sigma: blob.sigma }
        };
        let path: Vec<ImagePoint> = members.iter().map(image_point).collect();
        // Without an answer of the motion network there is no evidence for a ball.
        let motion: Vec<f64> = members.iter().filter_map(|&member| self.verdicts.motion(member)).collect();
        let motion = motion.iter().sum::<f64>() / motion.len().max(1) as f64;
        let small = median(path.iter().map(|point| point.radius)).is_some_and(|radius| radius < SMALL);
        let detector = ((detected + 1.0) / (queried - detected + 1.0_f64)).ln();
        let [large, little] = if small { [0.0, detector] } else { [detector, 0.0] };
        let ratio = (tracklet.log_likelihood_ratio.max(1.0) / USUAL_LOG_RATIO).ln();
        let bend = gravity_test.map_or(0.0, |gravity_test| gravity_test.log_odds(&path));
        [1.0, ratio, motion, f64::from(u8::from(small)), large, little, bend]
    }

    fn followed(&self, (frame, index): (usize, usize)) -> TrackedBlob {
        let blob = self.seen[frame].blobs[index].mapped(&self.views[frame].frame_from_first);
        TrackedBlob { image: blob.at, radius_px: blob.radius, reach_px: blob.reach }
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
fn point(ball: &TrackedBlob, sigma: f64, found: Option<&Detection>, nothing: TrackPoint) -> TrackPoint {
    let at =
        |[x, y]: [f64; 2], sigma| TrackPoint { visibility: 1, x: Some(x), y: Some(y), sigma: Some(sigma), ..nothing };
    let Some(found) = found else { return at(ball.image, sigma) };
    let sized = ball.reach_px < STREAK * ball.radius_px;
    let [radius, radius_sigma] = [found.outline.radius, found.radius_sigma_px()].map(|it| sized.then_some(it));
    TrackPoint { radius, radius_sigma, ..at(found.outline.centre.coords.into(), found.sigma_px()) }
}

/// Enlarges the radii's standard deviations so that neighbouring frames together are hardly surer than one of them: a network's error in
/// one is its error in the next.
fn correlate_radius_errors(frames: &mut [FollowedFrame]) {
    let sized: Vec<f64> =
        frames.iter().filter(|frame| frame.point.radius.is_some()).filter_map(|frame| frame.point.time).collect();
    for FollowedFrame { point, .. } in frames {
        let (Some(sigma), Some(time)) = (&mut point.radius_sigma, point.time) else { continue };
        let near = sized.partition_point(|&other| other < time + DOUBT_LASTS)
            - sized.partition_point(|&other| other < time - DOUBT_LASTS);
        *sigma *= (1.0 - COMMON + COMMON * near.max(1) as f64).sqrt();
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
