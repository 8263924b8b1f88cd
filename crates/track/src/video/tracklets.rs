//! Tracklets: sequences of blobs on a path through the picture that bends as slowly as a ball's does.

use std::cell::RefCell;
use std::collections::{BTreeMap, HashMap};
use std::ops::Range;

use nalgebra::{Matrix3, Vector3};

use super::blobs::Blob;
use super::config::{ClutterConfig, FlightConfig, TrackletsConfig};
use super::state::{BlobId, BlobSet, FrameId, State};
use super::view::{FirstView, Place};

/// Blobs that may be one object in flight.
#[derive(Debug, Clone)]
pub(super) struct Tracklet {
    /// One a frame at most, by frame.
    pub members: Vec<BlobId>,
    /// Log-likelihood ratio of one object over chance.
    pub log_likelihood_ratio: f64,
    /// Whether a person saw the ball in it.
    pub seeded: bool,
}

/// A search for tracklets in the last frames of a video, or in all.
pub(super) struct TrackletSearch<'a> {
    pub config: &'a TrackletsConfig,
    pub flight: &'a FlightConfig,
    pub clutter: &'a ClutterConfig,
    pub state: &'a State,
    /// The first frame that is searched.
    pub from: FrameId,
    /// Fraction of the least displacement that a tracklet must reach: in few frames it cannot go far.
    pub displacement_fraction: f64,
    /// Log-likelihood ratio of a tracklet from which its blobs seed no other.
    pub strong_log_ratio: f64,
    /// Where a person saw the ball, by frame.
    pub seeds: &'a BTreeMap<FrameId, Place<FirstView>>,
    /// Results of [`Self::candidate_density`]: many tracklets go through one blob.
    pub density_cache: RefCell<HashMap<BlobId, f64>>,
}

impl TrackletSearch<'_> {
    fn blob(&self, blob: BlobId) -> &Blob<FirstView> {
        self.state.blob(blob)
    }

    /// What a path bends by perspective in a step, px a squared px of the step: a ball that flies towards the camera or away is about as fast as it
    /// looks, so that its image's speed changes by twice half of that over the focal length, which is about the picture's longer side.
    fn perspective(&self) -> f64 {
        let [width, height] = self.state.size;
        1.0 / width.max(height) as f64
    }

    /// Indices of the frames that are searched.
    fn frames(&self) -> Range<usize> {
        self.from.0..self.state.segmented()
    }

    /// The candidates of a frame with what they are believed to be, by the frame's index.
    fn blobs(&self, frame: usize) -> impl Iterator<Item = (BlobId, &Blob<FirstView>)> {
        self.state.frames()[frame].candidates()
    }

    /// All tracklets that are likelier than chance: seeded ones first, then by log-likelihood ratio. At least half of the blobs of each are
    /// in none before it.
    pub fn tracklets(&self) -> Vec<Tracklet> {
        let mut grown: Vec<Tracklet> = Vec::new();
        let mut used = BlobSet::from(self.state, self.from);
        for frame in self.frames() {
            for seed in self.seeds(frame) {
                if seed.iter().all(|&blob| used.contains(blob)) {
                    continue;
                }
                let Some(tracklet) = self.grow(seed) else { continue };
                if tracklet.log_likelihood_ratio >= self.strong_log_ratio {
                    tracklet.members.iter().for_each(|&blob| used.insert(blob));
                }
                grown.push(tracklet);
            }
        }
        grown.sort_by(|a, b| b.seeded.cmp(&a.seeded).then(b.log_likelihood_ratio.total_cmp(&a.log_likelihood_ratio)));
        let mut taken = BlobSet::from(self.state, self.from);
        let mut kept = Vec::new();
        for tracklet in grown {
            let free = tracklet.members.iter().filter(|&&blob| !taken.contains(blob)).count();
            if 2 * free < tracklet.members.len() {
                continue;
            }
            tracklet.members.iter().for_each(|&blob| taken.insert(blob));
            kept.push(tracklet);
        }
        kept
    }

    /// Three blobs in frames that follow one another (one may be left out) that may be one thing's.
    fn seeds(&self, frame: usize) -> Vec<[BlobId; 3]> {
        let frames = self.state.frames();
        let end = self.frames().end;
        let TrackletsConfig { step_px, step_fraction, least_step, radius_slack, least_radius, .. } = *self.config;
        let mut seeds = Vec::new();
        for (a, first) in self.blobs(frame) {
            for second_frame in frame + 1..(frame + 3).min(end) {
                let before = frames[second_frame].time - frames[frame].time;
                let steps = (second_frame - frame) as f64;
                for (b, second) in self.blobs(second_frame) {
                    let displacement = second.at.minus(&first.at);
                    let length = (displacement[0] * displacement[0] + displacement[1] * displacement[1]).sqrt();
                    let radius = radius_slack * first.radius.max(second.radius).max(least_radius);
                    let possible = length <= self.flight.max_speed * radius * before && length >= least_step * steps;
                    if !(possible
                        && self.alike(first, second)
                        && self.along(first, displacement)
                        && self.along(second, displacement))
                    {
                        continue;
                    }
                    for third_frame in second_frame + 1..(second_frame + 3).min(end) {
                        let after = frames[third_frame].time - frames[second_frame].time;
                        let fraction = after / before;
                        let step = length * fraction;
                        let bend = self.flight.max_acceleration * radius * after * (before + after) / 2.0
                            + (self.flight.drag / radius + self.perspective()) * step * step;
                        let allowed = step_px + step_fraction * step + bend;
                        let [x, y] = second.at.xy;
                        let to = Place::new([x + fraction * displacement[0], y + fraction * displacement[1]]);
                        for (c, third) in self.blobs(third_frame) {
                            let off = third.at.minus(&to);
                            if off[0] * off[0] + off[1] * off[1] <= allowed * allowed && self.alike(second, third) {
                                seeds.push([a, b, c]);
                            }
                        }
                    }
                }
            }
        }
        seeds
    }

    /// The tracklet that goes through `seed` as far as it can be followed, if it is more than chance.
    fn grow(&self, seed: [BlobId; 3]) -> Option<Tracklet> {
        let mut members = seed.to_vec();
        for forward in [true, false] {
            while let Some(next) = self.next(&members, forward) {
                match forward {
                    true => members.push(next),
                    false => members.insert(0, next),
                }
            }
        }
        self.trim(&mut members);
        if members.len() < self.config.fewest {
            return None;
        }
        let [first, last] = [self.blob(members[0]), self.blob(members[members.len() - 1])];
        let distances = members.iter().map(|&member| self.blob(member).at.distance(&first.at));
        let displacement = distances.fold(0.0, f64::max);
        let balls = members.iter().filter(|&&member| self.blob(member).is_ball).count();
        let least = match 2 * balls > members.len() {
            true => self.config.least_ball_displacement_px.max(first.radius.max(last.radius)),
            false => {
                self.displacement_fraction
                    * self
                        .config
                        .least_displacement_px
                        .max(self.config.least_displacement * first.radius.max(last.radius))
            }
        };
        if displacement < least {
            return None;
        }
        let (log_likelihood_ratio, seeded) = (self.log_likelihood_ratio(&members), self.is_seeded(&members)?);
        (seeded || log_likelihood_ratio >= self.config.min_gain).then_some(Tracklet {
            members,
            log_likelihood_ratio,
            seeded,
        })
    }

    /// Whether a seed is in a tracklet; none where one says that the ball was elsewhere then.
    fn is_seeded(&self, members: &[BlobId]) -> Option<bool> {
        let seed = |&member: &BlobId| Some((member, self.seeds.get(&self.state.frame_of(member))?));
        let mut seeds = members.iter().filter_map(seed).peekable();
        let seeded = seeds.peek().is_some();
        seeds.all(|(member, seed)| self.is_at(member, seed)).then_some(seeded)
    }

    /// Whether a tracklet goes through a seed.
    pub fn goes_through(&self, tracklet: &Tracklet, frame: FrameId, seed: &Place<FirstView>) -> bool {
        tracklet.members.iter().any(|&member| self.state.frame_of(member) == frame && self.is_at(member, seed))
    }

    /// Whether a blob is where a person saw the ball.
    fn is_at(&self, member: BlobId, seed: &Place<FirstView>) -> bool {
        let blob = self.blob(member);
        blob.at.distance(seed) <= self.config.seed_px + blob.reach
    }

    /// The blob by which a tracklet goes on.
    fn next(&self, members: &[BlobId], forward: bool) -> Option<BlobId> {
        let recent: Vec<BlobId> = match forward {
            true => members.iter().rev().take(self.config.recent).copied().collect(),
            false => members.iter().take(self.config.recent).copied().collect(),
        };
        let (radius_weight, usual_ratio) = (self.config.radius_weight, self.config.usual);
        let parabola = Parabola::through(self, &recent)?;
        let last = self.blob(recent[0]);
        let logs = recent.iter().map(|&member| self.blob(member).radius.ln());
        let usual = (logs.sum::<f64>() / recent.len() as f64).exp();
        let [end, before] = [recent[0], recent[1]].map(|member| self.state.frame_of(member).0);
        let step = last.at.distance(&self.blob(recent[1]).at) / end.abs_diff(before) as f64;
        for gap in 1..=self.config.max_missed + 1 {
            let frame = if forward { end.checked_add(gap)? } else { end.checked_sub(gap)? };
            if !self.frames().contains(&frame) {
                return None;
            }
            let (to, unsure) = parabola.at(self.state.frames()[frame].time);
            let fits = |blob: &Blob<FirstView>| {
                self.alike(last, blob) && (usual_ratio.recip()..usual_ratio).contains(&(blob.radius / usual))
            };
            let near = self.blobs(frame).filter(|(_, blob)| fits(blob)).filter_map(|(member, blob)| {
                let off = blob.at.minus(&to);
                let variance = self.deviation(blob, step).powi(2) + unsure * unsure;
                let off = ((off[0] * off[0] + off[1] * off[1]) / variance).sqrt();
                (off <= self.config.gate)
                    .then_some((member, off + radius_weight * (blob.radius / last.radius).ln().abs()))
            });
            if let Some((member, _)) = near.min_by(|a, b| a.1.total_cmp(&b.1)) {
                return Some(member);
            }
        }
        None
    }

    /// Where a tracklet leads in a frame beyond its ends or between its blobs; how far that may be off, px, and the radius there.
    pub fn leads(&self, tracklet: &Tracklet, frame: FrameId) -> Option<(Place<FirstView>, f64, f64)> {
        let recent = self.config.recent;
        let after = tracklet.members.partition_point(|&member| self.state.frame_of(member) < frame);
        let near = after.saturating_sub(recent)..(after + recent).min(tracklet.members.len());
        let mut near = tracklet.members[near].to_vec();
        near.sort_by_key(|&member| self.state.frame_of(member).0.abs_diff(frame.0));
        near.truncate(recent);
        let (at, unsure) = Parabola::through(self, &near)?.at(self.state.frame(frame).time);
        let logs = near.iter().map(|&member| self.blob(member).radius.ln());
        Some((at, unsure, (logs.sum::<f64>() / near.len() as f64).exp()))
    }

    /// Log-likelihood ratio of one object over chance, summed over its blobs: the density that a blob's neighbours predict there over the
    /// density of candidates. Frames without a blob lower it.
    fn log_likelihood_ratio(&self, members: &[BlobId]) -> f64 {
        let beside = self.config.recent / 2;
        let mut ratio = 0.0;
        for (number, &member) in members.iter().enumerate() {
            let near = number.saturating_sub(beside)..(number + beside + 1).min(members.len());
            let others: Vec<BlobId> = members[near].iter().filter(|&&other| other != member).copied().collect();
            let Some(parabola) = Parabola::through(self, &others) else { continue };
            let (to, unsure) = parabola.at(self.state.time_of(member));
            let blob = self.blob(member);
            let neighbour = self.blob(members[if number == 0 { 1 } else { number - 1 }]);
            let step = blob.at.distance(&neighbour.at);
            let sigma = self.deviation(blob, step).hypot(unsure);
            let off = blob.at.distance(&to) / sigma;
            let density = (-0.5 * off * off).exp() / (std::f64::consts::TAU * sigma * sigma);
            ratio += (density / self.candidate_density(member)).ln().max(self.config.least_per_blob);
        }
        let [first, last] = [members[0], members[members.len() - 1]].map(|member| self.state.frame_of(member));
        // Any three blobs make a path.
        ratio *= (members.len() as f64 - 3.0) / members.len() as f64;
        ratio - self.config.missed_cost * (last.since(first) + 1 - members.len()) as f64
    }

    /// Density of candidates about a blob, a px² and frame, in the frames around its own.
    pub fn candidate_density(&self, member: BlobId) -> f64 {
        *self.density_cache.borrow_mut().entry(member).or_insert_with(|| self.measured_density(member))
    }

    fn measured_density(&self, member: BlobId) -> f64 {
        let ClutterConfig { density_px, density_frames, .. } = *self.clutter;
        let own = self.blob(member);
        let at = &own.at;
        let (frame, searched) = (self.state.frame_of(member), self.frames());
        let frames = frame.0.saturating_sub(density_frames).max(searched.start)
            ..(frame.0 + density_frames + 1).min(searched.end);
        let count = frames.len() as f64;
        // One blob a frame is the object's own.
        let near = |frame: usize| {
            let near = self.blobs(frame).filter(|(_, blob)| {
                // Others of another size cannot belong to its path.
                let off = blob.at.minus(at);
                off[0] * off[0] + off[1] * off[1] < density_px * density_px && self.alike(blob, own)
            });
            near.count().saturating_sub(1)
        };
        let others: usize = frames.map(near).sum();
        let always = self.state.clutter().density(self.state, frame, at);
        let [width, height] = self.state.size.map(|side| side as f64);
        others as f64 / count / (std::f64::consts::PI * density_px * density_px) + always + 1.0 / (width * height)
    }

    /// Whether two blobs may be one ball's.
    fn alike(&self, a: &Blob<FirstView>, b: &Blob<FirstView>) -> bool {
        alike(a, b, self.config.alike)
    }

    /// Whether a streak lies along the displacement of the ball.
    fn along(&self, blob: &Blob<FirstView>, displacement: [f64; 2]) -> bool {
        blob.reach < self.config.streak * blob.radius
            || (displacement[1].atan2(displacement[0]) - blob.direction).sin().abs() < self.config.along
    }

    /// Standard deviation of a blob's position on the path of its ball, px.
    fn deviation(&self, blob: &Blob<FirstView>, step: f64) -> f64 {
        blob.sigma + self.config.place_of_step * step
    }

    /// Leaves out single blobs at a tracklet's ends that frames without any divide from the others.
    fn trim(&self, members: &mut Vec<BlobId>) {
        let gap = |earlier: BlobId, later: BlobId| self.state.frame_of(later).since(self.state.frame_of(earlier));
        while members.len() > 2 && gap(members[0], members[1]) > self.config.lonely {
            members.remove(0);
        }
        while members.len() > 2 && gap(members[members.len() - 2], members[members.len() - 1]) > self.config.lonely {
            members.pop();
        }
    }
}

/// Whether two blobs may be one ball's, of radii of this ratio at most.
pub(super) fn alike(a: &Blob<FirstView>, b: &Blob<FirstView>, most: f64) -> bool {
    (most.recip()..=most).contains(&(a.radius / b.radius))
}

/// Where blobs lead: a parabola through them (a line through three), in time.
struct Parabola {
    middle: f64,
    /// Coefficients of each coordinate; a line's third is 0.
    of: [Vector3<f64>; 2],
    /// (AᵀA)⁻¹; of a line without the third row and column.
    covariance: Matrix3<f64>,
    /// Of a blob's place, px.
    sigma: f64,
    is_line: bool,
    /// What bends a line that is not yet a flight, px: standard deviation.
    line_bend: f64,
}

impl Parabola {
    fn through(search: &TrackletSearch, members: &[BlobId]) -> Option<Self> {
        let is_line = members.len() <= 3;
        let count = members.len() as f64;
        let time = |&member: &BlobId| search.state.time_of(member);
        let middle = members.iter().map(time).sum::<f64>() / count;
        let (mut normal, mut right, mut sigma) = (Matrix3::zeros(), [Vector3::zeros(); 2], 0.0);
        for member in members {
            let blob = search.blob(*member);
            let powers = powers(time(member) - middle, is_line);
            normal += powers * powers.transpose();
            right[0] += powers * blob.at.xy[0];
            right[1] += powers * blob.at.xy[1];
            sigma += search.deviation(blob, 0.0) / count;
        }
        if is_line {
            normal[(2, 2)] = 1.0;
        }
        let covariance = normal.try_inverse()?;
        let radius = members.iter().map(|&member| search.blob(member).radius).sum::<f64>() / count;
        let times = members.iter().map(time);
        let (first, last) = (times.clone().fold(f64::INFINITY, f64::min), times.fold(f64::NEG_INFINITY, f64::max));
        let interval = (last - first) / (count - 1.0).max(1.0);
        // The gate admits the largest acceleration.
        let config = search.config;
        let of = right.map(|right| covariance * right);
        let step = of[0][1].hypot(of[1][1]) * interval;
        let bend = search.flight.max_acceleration * radius * interval * interval + search.perspective() * step * step;
        let bend = bend / config.gate;
        // A line is not yet a flight: what bends it is unknown.
        let line_bend = if is_line { config.step_px.hypot(config.beyond_line * bend) } else { 0.0 };
        Some(Self { middle, of, covariance, sigma, is_line, line_bend })
    }

    /// Where it is at a time, and how far that may be off, px.
    fn at(&self, time: f64) -> (Place<FirstView>, f64) {
        let powers = powers(time - self.middle, self.is_line);
        let spread = powers.dot(&(self.covariance * powers));
        let at = [0, 1].map(|axis| self.of[axis].dot(&powers));
        (Place::new(at), (self.sigma * spread.sqrt()).hypot(self.line_bend))
    }
}

fn powers(time: f64, is_line: bool) -> Vector3<f64> {
    Vector3::new(1.0, time, if is_line { 0.0 } else { time * time })
}
