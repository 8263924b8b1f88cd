//! Numbers of how evidence is gathered and weighed.

use serde::{Deserialize, Serialize};

/// What the networks' answers mean.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
#[serde(default, deny_unknown_fields)]
pub struct EvidenceConfig {
    /// Confidence of the detector from which it sees a ball where something flies. Source: chosen by hand.
    pub seen: f64,
    /// Confidence of the detector from which it sees a ball where nothing stands out from the background. Source: chosen by hand.
    pub seen_alone: f64,
    /// Least probability by a network that counts; the largest is as far from 1. Source: chosen by hand.
    pub least_probability: f64,
    /// Probability by the motion network from which a blob is measured. Source: chosen by hand.
    pub measured_from: f64,
    /// Distance of a blob's middle from what the detector finds, up to which it is a part of it, radii. Source: chosen by hand.
    pub part: f64,
    /// The same at least, px. Source: chosen by hand.
    pub part_least: f64,
    /// Ratio of the radii up to which it is. Source: chosen by hand.
    pub part_radius: f64,
    /// Confidence from which what the detector proposes in a whole picture is a candidate. Source: chosen on a real clip of football juggling, whose
    /// proposals have 0.03 and more.
    pub proposed_from: f64,
    /// Distance within which two proposals are of one thing at rest, radii. Source: chosen by hand.
    pub same_place: f64,
    /// Frames for which the detector's answer stays the same after it changed where a tracklet is cut. Source: chosen by hand.
    pub run: usize,
}

impl Default for EvidenceConfig {
    fn default() -> Self {
        Self {
            seen: 0.3,
            seen_alone: 0.5,
            least_probability: 5e-4,
            measured_from: 0.05,
            part: 0.9,
            part_least: 1.0,
            part_radius: 1.4,
            proposed_from: 0.01,
            same_place: 0.5,
            run: 3,
        }
    }
}

/// What the networks are asked while frames come.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
#[serde(default, deny_unknown_fields)]
pub struct QueriesConfig {
    /// Last frames in which tracklets are searched. Source: chosen by hand.
    pub window: usize,
    /// Frames after which they are searched again. Source: chosen by hand.
    pub step: usize,
    /// Fraction of its least displacement that a tracklet must reach in those. Source: chosen by hand.
    pub displacement: f64,
    /// One blob of so many of a tracklet is queried, until a ball is detected. Source: chosen by hand.
    pub every: usize,
    /// Answers of which one has to be a ball for all blobs of a tracklet to be queried. Source: chosen by hand.
    pub most_per_ball: usize,
    /// Blobs in which the detector saw a ball that make one known. Source: chosen by hand.
    pub fewest_seen: usize,
    /// Frames beyond a tracklet's ends in which its predicted positions are queried. Source: chosen by hand.
    pub beyond: usize,
    /// Largest standard deviation of a predicted position that is queried, radii. Source: chosen by hand.
    pub most_unsure: f64,
    /// Standard deviations about a predicted position that are searched. Source: chosen by hand.
    pub unsure_reach: f64,
    /// Distance within which two predicted positions are one, px, or their radius if that is larger. Source: chosen by hand.
    pub predicted_px: f64,
}

impl Default for QueriesConfig {
    fn default() -> Self {
        Self {
            window: 16,
            step: 8,
            displacement: 0.25,
            every: 3,
            most_per_ball: 3,
            fewest_seen: 3,
            beyond: 4,
            most_unsure: 4.0,
            unsure_reach: 2.0,
            predicted_px: 2.0,
        }
    }
}

/// A ball that hardly moves: it is part of its own background.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
#[serde(default, deny_unknown_fields)]
pub struct SlowConfig {
    /// A ball that moved less than that between two searches hardly moves, radii. Source: chosen by hand.
    pub most_displacement: f64,
    /// Least displacement of such a ball, px. Source: chosen by hand.
    pub least_displacement_px: f64,
    /// Largest ratio of the radii of one ball in two such frames. Source: chosen by hand.
    pub alike: f64,
    /// Most frames between two such frames. Source: chosen by hand.
    pub most_frames: usize,
}

impl Default for SlowConfig {
    fn default() -> Self {
        Self { most_displacement: 4.0, least_displacement_px: 1.0, alike: 1.3, most_frames: 23 }
    }
}

/// The log-odds that a tracklet is the ball's. The weights are those of: a constant; its size, from 0 (small) to 1 (large); the logarithm of its
/// log-likelihood ratio over a usual one; the mean of the motion network's log-odds, of a small ball and of a large one; the mean of the detector's,
/// of both; the log-odds of how its path bends under gravity, with a camera and without. A network's weight between the two sizes is between the two.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
#[serde(default, deny_unknown_fields)]
pub struct WeightsConfig {
    /// Weights where a motion network answers. Source: fitted by scripts/fit-weights tracklets.
    pub with_motion: [f64; 9],
    /// Weights without one. Source: fitted by scripts/fit-weights tracklets.
    pub without_motion: [f64; 9],
    /// Log-odds against chance of a tracklet that are no evidence for or against a ball. Source: chosen by hand.
    pub usual_gain: f64,
    /// Radii up to which a ball is small and from which it is large, px: the detector misses small ones, and large things that move look alike to the
    /// motion network. Source: chosen by hand.
    pub sizes: [f64; 2],
    /// Log-odds of a tracklet that a person pointed at. Source: chosen by hand.
    pub seeded: f64,
}

impl Default for WeightsConfig {
    fn default() -> Self {
        Self {
            with_motion: [-4.935, 1.821, 0.699, 1.764, 0.464, 0.248, 0.595, 0.824, 1.777],
            without_motion: [-2.468, 1.365, 0.91, 0.0, 0.0, 0.0, 1.086, 0.769, 0.5],
            usual_gain: 27.0,
            sizes: [2.0, 32.0],
            seeded: 20.0,
        }
    }
}

/// Which tracklets are one ball's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
#[serde(default, deny_unknown_fields)]
pub struct AssociationConfig {
    /// Probability from which a tracklet is reported as the ball's. Source: chosen on what errors cost: a false positive twice what a
    /// missed ball does.
    pub min_confidence: f64,
    /// Log-odds that one tracklet of a track must have by itself: several that are unsure are no ball. Source: chosen by hand.
    pub confirmed: f64,
    /// Probability that a second ball flies beside one. Source: chosen by hand.
    pub second_ball: f64,
    /// Most tracks of balls that are listed. Source: chosen by hand.
    pub most_tracks: usize,
    /// What a tracklet that is the ball's adds to the one that continues it, log-odds. Source: chosen by hand.
    pub continuation: f64,
    /// Most frames between a tracklet and its continuation. Source: chosen by hand.
    pub between: usize,
    /// Largest distance between their ends, px. Source: chosen by hand.
    pub meets_px: f64,
    /// What is added to that, in steps. Source: chosen by hand.
    pub meets_step: f64,
    /// Frames after a tracklet's end within which the ball is still as large as there. Source: chosen by hand.
    pub soon: usize,
    /// Ratio of the radii up to which it is. Source: chosen by hand.
    pub as_large: f64,
    /// Blobs at either end that tell. Source: chosen by hand.
    pub at_end: usize,
    /// What going on elsewhere than where a tracklet ends costs soon after it, frames. Source: chosen by hand.
    pub jump: f64,
    /// Frames that two tracklets may share at no cost: one's last and the other's first. Source: chosen by hand.
    pub free_overlap: usize,
    /// Most frames between two balls that are filled with what the detector sees there. Source: chosen by hand.
    pub most_filled: usize,
    /// How far from between two balls a ball may be in those, radii. Source: chosen by hand.
    pub fill_reach: f64,
}

impl Default for AssociationConfig {
    fn default() -> Self {
        Self {
            min_confidence: 2.0 / 3.0,
            confirmed: 1.0,
            second_ball: 0.05,
            most_tracks: 8,
            continuation: 2.0,
            between: 8,
            meets_px: 12.0,
            meets_step: 1.5,
            soon: 12,
            as_large: 2.2,
            at_end: 3,
            jump: 1.0,
            free_overlap: 1,
            most_filled: 4,
            fill_reach: 1.5,
        }
    }
}

/// How well the radii of the reported balls are known.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
#[serde(default, deny_unknown_fields)]
pub struct RadiiConfig {
    /// Length over width of a streak from which its width is no ball's radius. Source: chosen by hand.
    pub streak: f64,
    /// Fraction of the variance of a measured radius that neighbouring frames have in common. Source: chosen by hand.
    pub common: f64,
    /// Distance of frames that do, s. Source: chosen by hand.
    pub lasting: f64,
}

impl Default for RadiiConfig {
    fn default() -> Self {
        Self { streak: 2.5, common: 0.7, lasting: 0.5 }
    }
}
