//! What flew in a video, and which of it is the ball.

use std::collections::BTreeMap;

use super::super::file::TrackPoint;
use super::Kept;
use super::association::{Segment, chain, confirms};
use super::blobs::Blob;
use super::gravity::{GravityTest, Place};
use super::queries::Verdicts;
use super::tracklets::{Candidates, Tracklet, alike};
use super::view::View;
use crate::camera::{Camera, Detection};
use crate::physics::Scene;
use crate::statistics::median;

/// Length over width of a streak from which its width is no ball's radius.
const STREAK: f64 = 2.5;
/// Share of the variance of a measured radius that frames have in common which are less than so many seconds apart.
const COMMON: f64 = 0.7;
const DOUBT_LASTS: f64 = 0.5;
/// Most frames between two balls that are filled, and how far from between them a ball may be in those, radii.
const MOST_BETWEEN: usize = 4;
const NEAR: f64 = 1.5;
/// Frames in a row that the network says the same of where a tracklet is cut.
const RUN: usize = 3;
/// Radius below which a ball is small, px: networks miss those.
const SMALL: f64 = 3.0;
/// Gain of a tracklet that says nothing for or against a ball.
const USUAL_GAIN: f64 = 27.0;
/// What makes the odds that a tracklet is the ball's. Chosen by hand, after a logistic regression to tracklets of `synth --set broadcast`
/// (split train): milder than that on the network's verdicts, which are not as often right of what cameras take, and stronger on
/// the bend. So the confidence that follows from them is no measured fraction of being right.
struct Weights {
    constant: f64,
    /// Of the logarithm of the gain over the usual one.
    gain: f64,
    small: f64,
    /// Of the log of odds by the bend of the way.
    bend: f64,
    /// Of the log of odds that the network sees a ball in a frame of it: large ones, small ones.
    seen: [f64; 2],
}

const TOLD: Weights = Weights { constant: 0.0, gain: 0.8, small: -1.5, bend: 1.2, seen: [1.5, 0.6] };
const UNTOLD: Weights = Weights { constant: -1.5, gain: 1.6, small: -2.5, bend: 1.0, seen: [0.0; 2] };
/// Weights of [`Hypotheses::features`], by `scripts/fit-weights tracklets` on ten clips of `synth --set footage` on which the networks were not trained and
/// a real one of tennis on which the motion network was; that of the bend (0: the clips were followed without a camera) by hand.
const MOTION_WEIGHTS: [f64; 7] = [-5.57, 0.548, 1.653, 0.707, 0.237, 0.875, 0.5];
/// Log of odds of what a person pointed at.
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
    /// whose weights were chosen by hand; 0 without one. No model's confidence
    /// ([`ConfidenceKind`](crate::parts::ConfidenceKind)).
    pub confidence: f64,
    /// Where the camera looks, if not where it did at first: then a camera that was calibrated there makes no metres here.
    pub elsewhere: Option<CameraMotion>,
    /// Its view; none of a repeated frame.
    pub(in crate::track) view: Option<View>,
}

/// All that flew in a video.
pub struct Hypotheses<'a> {
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
        Self { kept, seen, tracklets, verdicts, numbers, cuts, views, elsewhere, unused: vec![] }
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

    /// The ball, frame by frame. Where the camera (of these pictures) and the scene are known, by how its way bends, too.
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
        let mut balls: BTreeMap<usize, ((usize, usize), f64)> = BTreeMap::new();
        for segment in chain(self.seen, segments) {
            for &member in &segment.members {
                // Where two tracklets fraction a frame, the network's word decides.
                if balls.get(&member.0).is_none_or(|ball| self.is_seen(member) >= self.is_seen(ball.0)) {
                    balls.insert(member.0, (member, segment.confidence()));
                }
            }
        }
        self.fill(&mut balls);
        for (place, (member, confidence)) in balls {
            let frame = &mut frames[self.numbers[place]];
            let ball = self.followed(member);
            let found = self.verdicts.of(member).and_then(Option::as_ref);
            let sigma = self.seen[member.0].blobs[member.1].sigma;
            frame.point = point(&ball, sigma, found, frame.point);
            (frame.ball, frame.confidence) = (Some(ball), confidence);
        }
        share_doubt(&mut frames);
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
            let way = [to.at[0] - from.at[0], to.at[1] - from.at[1]];
            let reach = NEAR * from.radius.max(to.radius) + way[0].hypot(way[1]) / 2.0;
            for place in before.0 + 1..after.0 {
                let middle = [from.at[0] + way[0] / 2.0, from.at[1] + way[1] / 2.0];
                let off = |blob: &Blob| (blob.at[0] - middle[0]).hypot(blob.at[1] - middle[1]);
                let blobs = self.seen[place].blobs.iter().enumerate();
                let near = blobs.filter(|(_, blob)| blob.is_ball && alike(blob, from) && off(blob) <= reach);
                if let Some((index, _)) = near.min_by(|a, b| off(a.1).total_cmp(&off(b.1))) {
                    balls.insert(place, ((place, index), sure.min(sure_after)));
                }
            }
        }
    }

    /// Whether the network sees a ball in a frame of those that are not repeated; none where it did not say.
    fn is_seen(&self, member: (usize, usize)) -> Option<bool> {
        self.verdicts.of(member).map(Option::is_some)
    }

    /// A tracklet, cut where the network begins or ceases to see a ball for some frames: a ball's tracklet may end where its shadow's
    /// goes on.
    fn segments(&self, number: usize, gravity_test: Option<&GravityTest>) -> Vec<Segment> {
        let members = &self.tracklets[number].members;
        let seen: Vec<Option<bool>> = members.iter().map(|&member| self.is_seen(member)).collect();
        let lasts = |from: usize| {
            let run = seen[from..].iter().take(RUN);
            run.len() == RUN && seen[from].is_some() && run.clone().all(|&it| it == seen[from])
        };
        let cut = |&end: &usize| {
            end == members.len() || (lasts(end) && seen[end - 1].is_some() && seen[end - 1] != seen[end])
        };
        let mut start = 0;
        let mut segments = Vec::new();
        for end in (1..=members.len()).filter(cut) {
            if end - start > 1 {
                let members = members[start..end].to_vec();
                let tracklet = &self.tracklets[number];
                let odds = self.odds(tracklet, &members, gravity_test);
                let verified = self.verdicts.has_motion();
                segments.push(Segment { odds, verified, confirms: confirms(odds, verified), members });
            }
            start = end;
        }
        segments
    }

    /// Of all parts of tracklets that the motion network has seen, what tells whether they are the ball's (`Hypotheses::features`), and the frames
    /// and places (px) in which they are: what [`MOTION_WEIGHTS`] are fitted to.
    pub fn evidence(&self, place: Option<(&Camera, &Scene)>) -> Vec<(Vec<f64>, Vec<(usize, [f64; 2])>)> {
        let gravity_test = place.map(|(camera, scene)| GravityTest { camera, scene });
        let segments = (0..self.tracklets.len()).flat_map(|tracklet| {
            self.segments(tracklet, gravity_test.as_ref()).into_iter().map(move |it| (tracklet, it))
        });
        let evidence = segments.filter_map(|(tracklet, segment)| {
            let features = self.features_of(&self.tracklets[tracklet], &segment.members, gravity_test.as_ref()).ok()?;
            let places = segment.members.iter().map(|&member| (self.numbers[member.0], self.followed(member).image));
            Some((features.to_vec(), places.collect()))
        });
        evidence.collect()
    }

    /// That a part of a tracklet is the ball, log of odds.
    fn odds(&self, tracklet: &Tracklet, members: &[(usize, usize)], gravity_test: Option<&GravityTest>) -> f64 {
        if tracklet.seeded {
            return SEEDED;
        }
        match self.features_of(tracklet, members, gravity_test) {
            Ok(features) => features.iter().zip(MOTION_WEIGHTS).map(|(value, weight)| value * weight).sum(),
            Err(odds) => odds,
        }
    }

    /// The features of a part of a tracklet; where the motion network has not seen it, the log of odds without that.
    fn features_of(
        &self,
        tracklet: &Tracklet,
        members: &[(usize, usize)],
        gravity_test: Option<&GravityTest>,
    ) -> Result<[f64; 7], f64> {
        let (mut told, mut seen) = (0.0, 0.0);
        let mut motion: Vec<f64> = members.iter().filter_map(|&member| self.verdicts.motion(member)).collect();
        if motion.is_empty() && self.verdicts.has_motion() {
            // What the motion network could not be asked about has nothing for it.
            motion.push(0.0);
        }
        let place = |&(place, index): &(usize, usize)| {
            let blob = &self.seen[place].blobs[index];
            let word = self.verdicts.of((place, index));
            told += f64::from(u8::from(word.is_some()));
            let ball = word.copied().flatten();
            seen += f64::from(u8::from(ball.is_some()));
            Place { time: self.seen[place].time, at: blob.at.into(), radius: blob.radius, sigma: blob.sigma }
        };
        let way: Vec<Place> = members.iter().map(place).collect();
        let weights = if told > 0.0 { TOLD } else { UNTOLD };
        let small = median(way.iter().map(|place| place.radius)).is_some_and(|radius| radius < SMALL);
        if let Some(features) =
            self.features(tracklet, &motion, [told, seen], small, gravity_test.map_or(0.0, |it| it.odds(&way)))
        {
            return Ok(features);
        }
        Err(weights.constant
            + weights.gain * (tracklet.gain / USUAL_GAIN).ln()
            + if small { weights.small } else { 0.0 }
            + weights.seen[usize::from(small)] * ((seen + 1.0) / (told - seen + 1.0)).ln()
            + weights.bend * gravity_test.map_or(0.0, |gravity_test| gravity_test.odds(&way)))
    }

    /// What tells whether a part of a tracklet is the ball, where the motion network has seen it: 1, the logarithm of its gain over the usual one, the
    /// mean of the motion network's log-odds, whether it is small, the log-odds of the detector, of a large ball and of a small one, and those of
    /// the bend.
    fn features(
        &self,
        tracklet: &Tracklet,
        motion: &[f64],
        [told, seen]: [f64; 2],
        small: bool,
        bend: f64,
    ) -> Option<[f64; 7]> {
        let count = motion.len() as f64;
        let mean = motion.iter().sum::<f64>() / count;
        let detector = ((seen + 1.0) / (told - seen + 1.0)).ln();
        let [large, little] = if small { [0.0, detector] } else { [detector, 0.0] };
        let gain = (tracklet.gain.max(1.0) / USUAL_GAIN).ln();
        (count > 0.0).then(|| [1.0, gain, mean, f64::from(u8::from(small)), large, little, bend])
    }

    fn followed(&self, (frame, index): (usize, usize)) -> TrackedBlob {
        let blob = self.seen[frame].blobs[index].mapped(&self.views[frame].frame_from_first);
        TrackedBlob { image: blob.at, radius_px: blob.radius, reach_px: blob.reach }
    }
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

/// Makes the radii of neighbouring frames as unsure together as one of them is: what a network reads wrong in one, it reads
/// wrong in the next.
fn share_doubt(frames: &mut [FollowedFrame]) {
    let sized: Vec<f64> =
        frames.iter().filter(|frame| frame.point.radius.is_some()).filter_map(|frame| frame.point.time).collect();
    for FollowedFrame { point, .. } in frames {
        let (Some(sigma), Some(time)) = (&mut point.radius_sigma, point.time) else { continue };
        let near = sized.partition_point(|&other| other < time + DOUBT_LASTS)
            - sized.partition_point(|&other| other < time - DOUBT_LASTS);
        *sigma *= (1.0 - COMMON + COMMON * near.max(1) as f64).sqrt();
    }
}
