//! The detector's answer about a candidate.

use super::config::EvidenceConfig;
use gravisight_geometry::camera::Detection;

/// Log-odds of a network's probability.
pub(super) fn log_odds(probability: f64, config: &EvidenceConfig) -> f64 {
    let least = config.least_probability;
    let probability = probability.clamp(least, 1.0 - least);
    (probability / (1.0 - probability)).ln()
}

/// The detector's answer about a candidate, with its log-odds beyond those from which a ball counts as seen ([`EvidenceConfig::seen`]): negative for a
/// rejected one, positive for a ball, and 0 without a query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Evidence {
    Unqueried,
    Rejected(f64),
    Ball(Detection, f64),
}

impl Evidence {
    /// Of the likeliest ball there; none where there is nothing like one.
    pub fn of(ball: Option<Detection>, config: &EvidenceConfig) -> Self {
        let beyond = |confidence: f64| log_odds(confidence, config) - log_odds(config.seen, config);
        match ball {
            Some(ball) if ball.confidence >= config.seen => Self::Ball(ball, beyond(ball.confidence)),
            Some(ball) => Self::Rejected(beyond(ball.confidence)),
            None => Self::Rejected(beyond(0.0)),
        }
    }

    pub fn log_odds(&self) -> f64 {
        match self {
            Self::Unqueried => 0.0,
            Self::Rejected(log_odds) | Self::Ball(_, log_odds) => *log_odds,
        }
    }

    pub fn ball(&self) -> Option<&Detection> {
        match self {
            Self::Ball(ball, _) => Some(ball),
            Self::Unqueried | Self::Rejected(_) => None,
        }
    }

    pub fn is_queried(&self) -> bool {
        *self != Self::Unqueried
    }

    pub fn is_ball(&self) -> bool {
        self.ball().is_some()
    }

    /// Whether both are answers, and different ones.
    pub fn contradicts(&self, other: &Self) -> bool {
        self.is_queried() && other.is_queried() && self.is_ball() != other.is_ball()
    }

    /// Whether both are answers, and the same.
    pub fn agrees_with(&self, other: &Self) -> bool {
        self.is_queried() && other.is_queried() && self.is_ball() == other.is_ball()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gravisight_geometry::camera::Outline;

    #[test]
    fn a_rejected_candidate_has_lower_log_odds_than_an_unqueried_one() {
        let outline = Outline { centre: [10.0, 20.0].into(), radius: 4.0 };
        let ball = |confidence: f64| Some(Detection { outline, log_sigma: 0.05, confidence });
        let of = |ball: Option<Detection>| Evidence::of(ball, &EvidenceConfig::default());
        let ascending = [None, ball(0.1), ball(0.29)].map(of);
        let ascending = ascending.into_iter().chain([Evidence::Unqueried]).chain([ball(0.31), ball(1.0)].map(of));
        let log_odds: Vec<f64> = ascending.map(|evidence| evidence.log_odds()).collect();
        assert!(log_odds.windows(2).all(|pair| pair[0] < pair[1]), "{log_odds:?}");
        assert!(log_odds.iter().all(|log_odds| log_odds.is_finite()));
    }
}
