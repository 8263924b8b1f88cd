//! Parts of tracklets, and how likely each is the ball's.

use std::ops::Range;

use super::config::TrackerConfig;
use super::evidence::Evidence;
use super::fall::{self, Fall};
use super::gravity::{GravityTest, ImagePoint};
use super::state::{BlobId, State};
use super::tracklets::Tracklet;
use gravisight_geometry::statistics::median;

/// What tells whether a part of a tracklet is the ball's, as [`WeightsConfig`](super::config::WeightsConfig) lists it.
pub(super) type Features = [f64; 9];

/// A part of a tracklet that is one object's.
#[derive(Debug, Clone)]
pub(super) struct Part {
    /// One a frame at most, by frame.
    pub members: Vec<BlobId>,
    /// Whether a person saw the ball in the tracklet.
    seeded: bool,
    pub features: Features,
}

impl Part {
    /// Log-odds that it is the ball's.
    pub fn log_odds(&self, config: &TrackerConfig, has_motion: bool) -> f64 {
        let config = &config.weights;
        if self.seeded {
            return config.seeded;
        }
        let weights = if has_motion { config.with_motion } else { config.without_motion };
        self.features.iter().zip(weights).map(|(value, weight)| value * weight).sum()
    }
}

/// The parts of tracklets that may be the ball's; `gravity_test` where camera and scene are known.
pub(super) fn parts(
    tracklets: &[Tracklet],
    state: &State,
    config: &TrackerConfig,
    gravity_test: Option<&GravityTest>,
) -> Vec<Part> {
    // About as wide as a phone's or a broadcast's.
    let focal = state.size[0].max(state.size[1]) as f64;
    let mut parts: Vec<Part> = vec![];
    let (mut ranges, mut falls) = (vec![], vec![]);
    for tracklet in tracklets {
        let first = parts.len();
        for members in cut(tracklet, state, config) {
            let features = features(tracklet, &members, state, config, gravity_test);
            parts.push(Part { members, seeded: tracklet.seeded, features });
        }
        // A part may be too short to tell.
        let fall = Fall::of(&path(&tracklet.members, state), focal, &config.fall, &config.gravity);
        if let Some(fall) = fall.filter(|_| gravity_test.is_none()) {
            let log_odds = parts[first..].iter().map(|part| part.log_odds(config, state.has_motion()));
            falls.push((fall, log_odds.fold(f64::NEG_INFINITY, f64::max)));
            ranges.push(first..parts.len());
        }
    }
    for (range, log_odds) in ranges.into_iter().zip(fall::log_odds(&falls, &config.fall)) {
        for Part { features: [.., fall], .. } in &mut parts[range] {
            *fall = log_odds;
        }
    }
    parts
}

/// A tracklet, cut where the detector begins or ceases to see a ball for some frames: a ball's tracklet may go on as its shadow's. It is
/// also cut before and after the part with the highest motion log-odds, where those of the rest reject a ball clearly: beyond a hit, a
/// tracklet may go on as another object's.
fn cut(tracklet: &Tracklet, state: &State, config: &TrackerConfig) -> Vec<Vec<BlobId>> {
    let members = &tracklet.members;
    let seen: Vec<Evidence> = members.iter().map(|&member| state.evidence(member)).collect();
    let frames = config.evidence.run;
    let lasts = |from: usize| {
        let run = seen[from..].iter().take(frames);
        run.len() == frames && run.clone().all(|it| it.agrees_with(&seen[from]))
    };
    let is_cut = |end: usize| lasts(end) && seen[end - 1].contradicts(&seen[end]);
    let mut cuts: Vec<usize> = (1..members.len()).filter(|&end| is_cut(end)).collect();
    if !tracklet.seeded {
        let motion: Vec<f64> = members.iter().map(|&member| state.motion(member).unwrap_or(0.0)).collect();
        let part = best_part(&motion);
        let sum = |values: &[f64]| values.iter().sum::<f64>();
        // A part of another object's tracklet may look like a ball.
        let is_other = |values: &[f64]| sum(&motion) > 0.0 && sum(values) <= -config.tracklets.min_gain;
        cuts.extend(is_other(&motion[..part.start]).then_some(part.start));
        cuts.extend(is_other(&motion[part.end..]).then_some(part.end));
    }
    cuts.extend([0, members.len()]);
    cuts.sort_unstable();
    cuts.windows(2).filter(|cut| cut[1] - cut[0] > 1).map(|cut| members[cut[0]..cut[1]].to_vec()).collect()
}

fn path(members: &[BlobId], state: &State) -> Vec<ImagePoint> {
    let image_point = |&member: &BlobId| {
        let blob = state.blob(member);
        ImagePoint { time: state.time_of(member), at: blob.at.xy.into(), radius: blob.radius, sigma: blob.sigma }
    };
    members.iter().map(image_point).collect()
}

/// All features but how the tracklet falls, which is told of all together.
fn features(
    tracklet: &Tracklet,
    members: &[BlobId],
    state: &State,
    config: &TrackerConfig,
    gravity_test: Option<&GravityTest>,
) -> Features {
    let path = path(members, state);
    let answers: Vec<Evidence> = members.iter().map(|&member| state.evidence(member)).collect();
    let answers = || answers.iter().filter(|it| it.is_queried());
    // Without an answer of a network there is no evidence for a ball.
    let detector = match answers().count() {
        0 => Evidence::of(None, &config.evidence).log_odds(),
        count => answers().map(Evidence::log_odds).sum::<f64>() / count as f64,
    };
    let motion: Vec<f64> = members.iter().filter_map(|&member| state.motion(member)).collect();
    let motion = motion.iter().sum::<f64>() / motion.len().max(1) as f64;
    let [small, large] = config.weights.sizes;
    let radius = median(path.iter().map(|point| point.radius)).unwrap_or(small);
    let size = ((radius / small).ln() / (large / small).ln()).clamp(0.0, 1.0);
    let by_size = |value: f64| [(1.0 - size) * value, size * value];
    let ([motion_small, motion_large], [seen_small, seen_large]) = (by_size(motion), by_size(detector));
    let ratio = (tracklet.log_likelihood_ratio.max(1.0) / config.weights.usual_gain).ln();
    let bend = gravity_test.map_or(0.0, |gravity_test| gravity_test.log_odds(&path));
    [1.0, size, ratio, motion_small, motion_large, seen_small, seen_large, bend, 0.0]
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
