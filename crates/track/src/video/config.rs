//! The numbers of the tracker.

use serde::{Deserialize, Serialize};

use gravisight_geometry::error::{Error, Result};

/// How a ball is tracked in a video: what a ball's flight allows, and how evidence is weighed. Lengths are in the ball's own apparent radii,
/// so that they hold at any resolution and frame rate. Speed, acceleration and drag are physical, the two sets of weights are fitted; `gate`, `max_missed`, `missed_cost`,
/// `min_gain`, `continuation`, `min_confidence` and `confirmed` were chosen by hand.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
#[serde(deny_unknown_fields)]
pub struct TrackerConfig {
    /// Fastest ball, radii/s: a tennis ball of 73 m/s (a serve of 263 km/h).
    pub max_speed: f64,
    /// Largest acceleration of a slow ball, radii/s²: a table tennis ball's weight, 9.81 m/s² of radii of 0.02 m.
    pub max_acceleration: f64,
    /// By how many radii a faster ball is slowed besides on a radius of its path: a table tennis ball by the air, 0.14 a metre.
    pub drag: f64,
    /// Standard deviations from where a tracklet leads within which a candidate belongs to it.
    pub gate: f64,
    /// Frames in a row in which a tracklet goes on without a candidate.
    pub max_missed: usize,
    /// What each of those speaks against it, log-odds.
    pub missed_cost: f64,
    /// Log-odds against chance from which candidates are a tracklet.
    pub min_gain: f64,
    /// Weights by which a tracklet is the ball's (log-odds), where a motion network is queried: a constant; the logarithm of its log-likelihood
    /// ratio over a usual one (27); the mean of the motion network's log-odds; whether it is small (below 3 px); the log-odds of the detector, of
    /// a large ball and of a small one; those of how its path bends under gravity. By `scripts/fit-weights tracklets`.
    pub weights: [f64; 8],
    /// The same without a motion network.
    pub weights_without_motion: [f64; 8],
    /// What a tracklet that is the ball's adds to the one that continues it, log-odds.
    pub continuation: f64,
    /// Probability from which a tracklet is reported as the ball's: a false positive costs twice what a missed ball costs.
    pub min_confidence: f64,
    /// Log-odds that one tracklet of a track must have by itself: several that are unsure are no ball.
    pub confirmed: f64,
}

impl Default for TrackerConfig {
    fn default() -> Self {
        Self {
            max_speed: 2200.0,
            max_acceleration: 490.0,
            drag: 0.0028,
            gate: 3.5,
            max_missed: 4,
            missed_cost: 1.5,
            min_gain: 8.0,
            weights: [-2.662, 1.007, 1.179, -0.674, 0.063, 0.0, 0.876, 0.5],
            weights_without_motion: [-1.103, 0.91, 0.0, -1.365, 1.086, 0.0, 0.769, 0.5],
            continuation: 2.0,
            min_confidence: 2.0 / 3.0,
            confirmed: 1.0,
        }
    }
}

impl TrackerConfig {
    /// Refuses what makes no tracker.
    ///
    /// # Errors
    /// [`Error::Value`] for a limit that is not positive, and for a weight that is no finite number.
    pub fn check(&self) -> Result<()> {
        let limits = [
            ("max_speed", self.max_speed),
            ("max_acceleration", self.max_acceleration),
            ("drag", self.drag),
            ("gate", self.gate),
            ("missed_cost", self.missed_cost),
        ];
        if !(0.0..1.0).contains(&self.min_confidence) {
            let reason = format!("must be at least 0 and less than 1, not {}", self.min_confidence);
            return Err(Error::value("config", "min_confidence", reason));
        }
        if let Some((name, value)) = limits.into_iter().find(|(_, value)| !(value.is_finite() && *value > 0.0)) {
            return Err(Error::value("config", name, format!("must be positive, not {value}")));
        }
        let others = [self.min_gain, self.continuation, self.confirmed];
        match self.weights.iter().chain(&self.weights_without_motion).chain(&others).all(|value| value.is_finite()) {
            true => Ok(()),
            false => Err(Error::value("config", "weights", "must be finite numbers")),
        }
    }
}
