//! What flew in a video, and which of it is the ball.

use std::collections::BTreeMap;
use std::ops::Range;

use super::super::file::TrackPoint;
use super::Kept;
use super::association::{Segment, chain};
use super::blobs::Blob;
use super::config::TrackerConfig;
use super::evidence::Evidence;
use super::gravity::{GravityTest, Place};
use super::queries::Verdicts;
use super::tracklets::{Candidates, Tracklet, alike};
use super::view::View;
use gravisight_geometry::camera::{Camera, Detection};
use gravisight_geometry::statistics::median;
use gravisight_physics::Scene;

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
        // Of each frame the likeliest candidate: by its segment's log-odds, and by what the detector says of itself.
        let mut likeliest: BTreeMap<usize, (f64, (usize, usize), f64)> = BTreeMap::new();
        for segment in chain(self.seen, &self.config, segments) {
            for &member in &segment.members {
                let odds = segment.odds + self.verdicts.of(member).log_odds();
                if likeliest.get(&member.0).is_none_or(|other| odds >= other.0) {
                    likeliest.insert(member.0, (odds, member, segment.confidence()));
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

    /// A tracklet, cut where the detector begins or ceases to see a ball for some frames, for a ball's tracklet may end where its shadow's
    /// goes on; and, of what it says is the ball's, before and after the part for which the motion network says most, where it says as much against
    /// the rest as makes a tracklet: beyond a hit a tracklet may go on with something else.
    fn segments(&self, number: usize, gravity_test: Option<&GravityTest>) -> Vec<Segment> {
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
            let sum = |odds: &[f64]| odds.iter().sum::<f64>();
            // Of what is no ball's some part may look like one.
            let is_other = |odds: &[f64]| sum(&motion) > 0.0 && sum(odds) <= -self.config.min_gain;
            cuts.extend(is_other(&motion[..part.start]).then_some(part.start));
            cuts.extend(is_other(&motion[part.end..]).then_some(part.end));
        }
        cuts.extend([0, members.len()]);
        cuts.sort_unstable();
        let parts = cuts.windows(2).filter(|cut| cut[1] - cut[0] > 1).map(|cut| members[cut[0]..cut[1]].to_vec());
        let segment = |members: Vec<(usize, usize)>| {
            let odds = self.odds(tracklet, &members, gravity_test);
            let verified = self.verdicts.has_motion();
            let confirms = !verified || odds >= self.config.confirmed;
            Segment { odds, verified, confirms, members }
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

    /// That a part of a tracklet is the ball, log-odds.
    fn odds(&self, tracklet: &Tracklet, members: &[(usize, usize)], gravity_test: Option<&GravityTest>) -> f64 {
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
        let (mut told, mut seen) = (0.0, 0.0);
        let place = |&(place, index): &(usize, usize)| {
            let blob = &self.seen[place].blobs[index];
            let evidence = self.verdicts.of((place, index));
            told += f64::from(u8::from(evidence.is_asked()));
            seen += f64::from(u8::from(evidence.is_ball()));
            Place { time: self.seen[place].time, at: blob.at.into(), radius: blob.radius, sigma: blob.sigma }
        };
        let path: Vec<Place> = members.iter().map(place).collect();
        // What the motion network could not be asked about has nothing for it.
        let motion: Vec<f64> = members.iter().filter_map(|&member| self.verdicts.motion(member)).collect();
        let motion = motion.iter().sum::<f64>() / motion.len().max(1) as f64;
        let small = median(path.iter().map(|place| place.radius)).is_some_and(|radius| radius < SMALL);
        let detector = ((seen + 1.0) / (told - seen + 1.0_f64)).ln();
        let [large, little] = if small { [0.0, detector] } else { [detector, 0.0] };
        let gain = (tracklet.gain.max(1.0) / USUAL_GAIN).ln();
        let bend = gravity_test.map_or(0.0, |gravity_test| gravity_test.odds(&path));
        [1.0, gain, motion, f64::from(u8::from(small)), large, little, bend]
    }

    fn followed(&self, (frame, index): (usize, usize)) -> TrackedBlob {
        let blob = self.seen[frame].blobs[index].mapped(&self.views[frame].frame_from_first);
        TrackedBlob { image: blob.at, radius_px: blob.radius, reach_px: blob.reach }
    }
}

/// The part of log-odds that has the greatest sum, the longest of several; all where none is positive.
fn best_part(odds: &[f64]) -> Range<usize> {
    let mut best = (0.0, 0..odds.len());
    let (mut sum, mut start) = (0.0, 0);
    for (place, odds) in odds.iter().enumerate() {
        if sum < 0.0 {
            (sum, start) = (0.0, place);
        }
        sum += odds;
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
