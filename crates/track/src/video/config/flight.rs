//! Numbers of the paths that a ball can fly, and of how candidates are linked to them.

use serde::{Deserialize, Serialize};

/// What the flight of a ball allows, in its own apparent radii: so it holds at any resolution and frame rate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
#[serde(default, deny_unknown_fields)]
pub struct FlightConfig {
    /// Fastest ball, radii/s. Source: physical, a tennis ball of 73 m/s (a serve of 263 km/h).
    pub max_speed: f64,
    /// Largest acceleration of a slow ball, radii/s². Source: physical, a table tennis ball's weight, 9.81 m/s² of radii of 0.02 m.
    pub max_acceleration: f64,
    /// By how many radii a faster ball is slowed besides on a radius of its path. Source: physical, a table tennis ball is slowed by the
    /// air by 0.14 a metre.
    pub drag: f64,
}

impl Default for FlightConfig {
    fn default() -> Self {
        Self { max_speed: 2200.0, max_acceleration: 490.0, drag: 0.0028 }
    }
}

/// How dense candidates are by chance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
#[serde(default, deny_unknown_fields)]
pub struct ClutterConfig {
    /// Side of a cell in which candidates are counted over all frames, px. Source: chosen by hand.
    pub cell: f64,
    /// Frames before and after a candidate's that do not count for that: its own thing is in them. Source: chosen by hand.
    pub own_frames: usize,
    /// Distance within which other blobs of these frames count, px. Source: chosen by hand.
    pub density_px: f64,
    /// Frames before and after a candidate's in which they count. Source: chosen by hand.
    pub density_frames: usize,
}

impl Default for ClutterConfig {
    fn default() -> Self {
        Self { cell: 4.0, own_frames: 12, density_px: 80.0, density_frames: 6 }
    }
}

/// How candidates are linked to tracklets.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
#[serde(default, deny_unknown_fields)]
pub struct TrackletsConfig {
    /// Standard deviations from where a tracklet leads within which a candidate belongs to it. Source: chosen by hand.
    pub gate: f64,
    /// Frames in a row in which a tracklet goes on without a candidate. Source: chosen by hand.
    pub max_missed: usize,
    /// What each of those speaks against it, log-odds. Source: chosen by hand.
    pub missed_cost: f64,
    /// Log-odds against chance from which candidates are a tracklet. Source: chosen by hand.
    pub min_gain: f64,
    /// Log-odds against chance from which the blobs of a tracklet seed no other. Source: chosen by hand.
    pub strong_gain: f64,
    /// Least log-odds against chance of a single blob. Source: chosen by hand.
    pub least_per_blob: f64,
    /// What a measured step may be off besides, px. Source: chosen by hand.
    pub step_px: f64,
    /// What a measured step of a streak whose ends are not seen may be off besides, as a fraction of it. Source: chosen by hand.
    pub step_fraction: f64,
    /// Least step, px a frame. Source: chosen by hand.
    pub least_step: f64,
    /// Factor by which a blob's radius may be too small. Source: chosen by hand.
    pub radius_slack: f64,
    /// Least radius that is assumed, px. Source: chosen by hand.
    pub least_radius: f64,
    /// How far from its line a parabola goes on, of its acceleration times the square of the time from one of three places to the next.
    /// Source: physical, a parabola's distance from the line through three of its places, at the next one.
    pub beyond_line: f64,
    /// Largest ratio of the radii of one ball's blobs. Source: chosen by hand.
    pub alike: f64,
    /// Largest ratio of a blob's radius to the mean of those before it. Source: chosen by hand.
    pub usual: f64,
    /// Standard deviations off its place that the logarithm of the ratio of two radii counts as. Source: chosen by hand.
    pub radius_weight: f64,
    /// Length over width from which a blob is a streak, which lies along its path. Source: chosen by hand.
    pub streak: f64,
    /// Sine of the angle to its path up to which a streak lies along it. Source: chosen by hand.
    pub along: f64,
    /// What a step adds to the standard deviation of a blob's place, as a fraction of the step. Source: chosen by hand.
    pub place_of_step: f64,
    /// Blobs that tell where a tracklet leads next. Source: chosen by hand.
    pub recent: usize,
    /// Fewest blobs of a tracklet. Source: chosen by hand.
    pub fewest: usize,
    /// Frames from a tracklet's first or last blob to the next beyond which that one is chance. Source: chosen by hand.
    pub lonely: usize,
    /// Least displacement of a tracklet from its first blob, radii. Source: chosen by hand.
    pub least_displacement: f64,
    /// The same, px. Source: chosen by hand.
    pub least_displacement_px: f64,
    /// The same where the detector sees a ball in most of its blobs, px, or its radius if that is larger. Source: chosen by hand.
    pub least_ball_displacement_px: f64,
    /// How far a place in which a person saw the ball may be from its blob's end, px. Source: chosen by hand.
    pub seed_px: f64,
}

impl Default for TrackletsConfig {
    fn default() -> Self {
        Self {
            gate: 3.5,
            max_missed: 4,
            missed_cost: 1.5,
            min_gain: 8.0,
            strong_gain: 20.0,
            least_per_blob: -4.0,
            step_px: 3.0,
            step_fraction: 0.05,
            least_step: 0.5,
            radius_slack: 1.4,
            least_radius: 1.5,
            beyond_line: 5.0 / 3.0,
            alike: 2.2,
            usual: 1.8,
            radius_weight: 2.0,
            streak: 2.0,
            along: 0.5,
            place_of_step: 0.02,
            recent: 7,
            fewest: 5,
            lonely: 2,
            least_displacement: 3.0,
            least_displacement_px: 8.0,
            least_ball_displacement_px: 3.0,
            seed_px: 6.0,
        }
    }
}

/// Whether a path bends as gravity bends that of a ball.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
#[serde(default, deny_unknown_fields)]
pub struct GravityConfig {
    /// Duration of a part of a path that is one parabola, s. Source: chosen by hand.
    pub part: f64,
    /// Fewest points of a part. Source: chosen by hand.
    pub fewest: usize,
    /// Acceleration of a ball along gravity's image, in units of that. Drag, spin and what comes of flying towards the camera are in it.
    /// Source: chosen by hand.
    pub along: f64,
    /// Spread of that below and above, in the same units. Source: chosen by hand.
    pub spread: [f64; 2],
    /// Spread of the acceleration across, in the same units. Source: chosen by hand.
    pub spread_across: f64,
    /// Spread of what does not fly and hardly bends for its size. Source: chosen by hand.
    pub steady: f64,
    /// Spread of what does not fly and bends anyhow. Source: chosen by hand.
    pub anyhow: f64,
    /// Fraction of the first of what does not fly. Source: chosen by hand.
    pub steady_fraction: f64,
    /// Degrees of freedom of all spreads (Student's t). Source: chosen by hand.
    pub freedom: f64,
    /// Largest log-odds of a part, for or against a ball. Source: chosen by hand.
    pub most_of_part: f64,
    /// Least log-odds of a path. Source: chosen by hand.
    pub least: f64,
    /// Largest log-odds of a path. Source: chosen by hand.
    pub most: f64,
    /// Terminal speed below which a ball soon falls steadily, as a shuttle does, and need not bend, m/s. Source: physical, between the
    /// terminal speeds of a shuttle and of a table tennis ball.
    pub light: f64,
}

impl Default for GravityConfig {
    fn default() -> Self {
        Self {
            part: 0.35,
            fewest: 5,
            along: 1.3,
            spread: [0.3, 1.0],
            spread_across: 1.0,
            steady: 0.5,
            anyhow: 6.0,
            steady_fraction: 0.6,
            freedom: 3.0,
            most_of_part: 5.0,
            least: -15.0,
            most: 6.0,
            light: 7.5,
        }
    }
}

/// Whether a path bends downwards as a ball's does, where neither camera nor ball is known: accelerations in apparent radii a second squared.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
#[serde(default, deny_unknown_fields)]
pub struct FallConfig {
    /// Gravity, radii/s². Source: physical, from 9.81 m/s² over the 0.12 m of a basketball to that over the 0.02 m of a table tennis ball.
    pub gravities: [f64; 2],
    /// The same in slow motion, or of larger balls that are seen steeply from above. Source: physical, down to 1 m/s² of the paper's balls of 0.2 m.
    pub slowed: [f64; 2],
    /// Probability of these. Source: chosen on 38 real clips with drawn flights, none of them in slow motion.
    pub slowed_fraction: f64,
    /// Accelerations of what does not fly, radii/s². Source: physical, from 0.1 m/s² of a car of 1 m that keeps its speed to
    /// 150 m/s² of a hand of 0.05 m.
    pub others: [f64; 2],
    /// Values of each that are tried, evenly in the logarithm. Source: physical, finer than the spreads.
    pub steps: usize,
    /// Duration of a part of a path that is one parabola, s. Source: fitted by scripts/fit-weights tracklets.
    pub part: f64,
    /// A ball's acceleration downwards, in units of gravity. Source: fitted by scripts/fit-weights tracklets.
    pub along: f64,
    /// Spread of that below and above, in the same units. Source: fitted by scripts/fit-weights tracklets.
    pub spread: [f64; 2],
    /// Spread of the acceleration across, in the same units. Source: fitted by scripts/fit-weights tracklets.
    pub spread_across: f64,
    /// Probability that a path of the ball has a gravity of its own: in a replay, or where its radius is wrong. Source: fitted by
    /// scripts/fit-weights tracklets.
    pub own_gravity: f64,
    /// Probability that how a path falls tells nothing: before a camera that lies on its side, or in extreme slow motion. Source: chosen by hand.
    pub untold: f64,
    /// Largest log-odds of a path for a ball. Source: chosen by hand.
    pub most: f64,
}

impl Default for FallConfig {
    fn default() -> Self {
        Self {
            gravities: [80.0, 490.0],
            slowed: [1.0, 80.0],
            slowed_fraction: 0.02,
            others: [0.1, 3000.0],
            steps: 24,
            part: 0.8,
            along: 1.1,
            spread: [0.3, 0.6],
            spread_across: 0.45,
            own_gravity: 0.3,
            untold: 0.15,
            most: 8.0,
        }
    }
}
