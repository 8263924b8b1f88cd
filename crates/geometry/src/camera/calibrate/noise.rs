//! How far clicks are off: what is known of that beforehand, and what a calibration's own errors add.
//!
//! Four clicks leave one residual, which is small by chance as often as the clicks are good. So the variance has a prior, a scaled
//! inverse χ² distribution, which is conjugate: its posterior has the same form, and the camera's parameters have a Student
//! distribution, whose covariance is the inverse of the normal matrix times the posterior mean of the variance (Gelman et al.,
//! Bayesian Data Analysis, 3rd edition, 14.2).

/// Chance that clicks as good as the others are as far off as clicks that are called unlike them.
const UNLIKE: f64 = 0.01;

/// The variance of a click's coordinate, as far as it is known: scaled inverse χ².
#[derive(Debug, Clone, Copy)]
pub(super) struct ClickNoise {
    /// Degrees of freedom times the scale, px².
    sum: f64,
    /// Degrees of freedom.
    freedom: f64,
}

impl ClickNoise {
    /// Before any click: 1 px with three degrees of freedom, the least that keep the variance's mean finite where there is no residual.
    /// Half of all clicks have a σ below 1.1 px, and 90 % one from 0.6 to 2.9 px. Chosen: clicks set with a loupe were measured at
    /// 0.3 to 1.2 px (`docs/experiments.md`), quick ones are two to three pixels off.
    const PRIOR: Self = Self { sum: 3.0, freedom: 3.0 };

    /// Degrees of freedom of a noise that is known well.
    const KNOWN: f64 = 100.0;

    /// By clicks that the best camera leaves at a sum of squared errors of `cost` px², with `freedom` equations more than unknowns.
    pub(super) fn by(cost: f64, freedom: usize) -> Self {
        Self { sum: Self::PRIOR.sum + cost, freedom: Self::PRIOR.freedom + freedom as f64 }
    }

    /// As many independent points as those that one camera has placed count for: it has seven unknowns.
    const INDEPENDENT: f64 = 4.0;

    /// Of so many points that are not clicked, but placed by a camera with a 1-σ of `sigma` px.
    pub(super) fn placed(sigma: f64, points: usize) -> Self {
        let variance = sigma * sigma * (points as f64 / Self::INDEPENDENT).max(1.0);
        Self { sum: variance * (Self::KNOWN - 2.0), freedom: Self::KNOWN }
    }

    /// The mean of the variance, px².
    pub(super) fn variance(&self) -> f64 {
        self.sum / (self.freedom - 2.0)
    }

    /// Whether so many `clicks` with a sum of squared distances of `cost` px² from their points are hardly of this noise: F test.
    pub(super) fn is_unlike(&self, cost: f64, clicks: usize) -> bool {
        let ratio = cost / (2 * clicks.max(1)) as f64 / (self.sum / self.freedom);
        f_tail(clicks, self.freedom, ratio) < UNLIKE
    }
}

/// The chance that a variable of the F distribution exceeds `ratio`, with two degrees of freedom for each of `pairs` in the numerator
/// and `freedom` in the denominator (Abramowitz and Stegun, 26.6.4).
pub(super) fn f_tail(pairs: usize, freedom: f64, ratio: f64) -> f64 {
    let rest = 1.0 / (1.0 + 2.0 * pairs as f64 * ratio / freedom);
    let (mut term, mut sum) = (1.0, 0.0);
    for index in 0..pairs {
        sum += term;
        term *= (1.0 - rest) * (freedom / 2.0 + index as f64) / (index + 1) as f64;
    }
    (sum * rest.powf(freedom / 2.0)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tails_of_the_f_distribution_are_the_tables() {
        // Abramowitz and Stegun, table 26.9: percentage points of the F distribution.
        for (pairs, freedom, ratio, chance) in [
            (1, 1.0, 199.5, 0.05),
            (1, 4.0, 6.94, 0.05),
            (1, 10.0, 7.56, 0.01),
            (2, 4.0, 6.39, 0.05),
            (2, 10.0, 5.99, 0.01),
            (4, 4.0, 14.80, 0.01),
            (15, 30.0, 1.84, 0.05),
        ] {
            let found = f_tail(pairs, freedom, ratio);
            assert!((found - chance).abs() < 0.005 * chance, "{pairs} {freedom} {ratio}: {found}");
        }
        assert!((f_tail(3, 5.0, 0.0) - 1.0).abs() < 1e-12 && f_tail(3, 5.0, f64::INFINITY) == 0.0);
    }

    #[test]
    fn without_a_residual_the_prior_is_left_and_many_outweigh_it() {
        assert!((ClickNoise::by(0.0, 0).variance() - 3.0).abs() < 1e-12);
        for noise in [0.25_f64, 4.0] {
            let many = ClickNoise::by(1000.0 * noise, 1000).variance();
            assert!((many / noise - 1.0).abs() < 0.02, "{many}");
        }
    }

    #[test]
    fn clicks_are_unlike_only_where_the_noise_is_known_well_enough() {
        // Four clicks of 2 px, whose one residual happens to be small; and twenty.
        let (few, many) = (ClickNoise::by(0.1, 1), ClickNoise::by(4.0 * 33.0, 33));
        assert!(!few.is_unlike(4.0 * 8.0, 4) && !many.is_unlike(4.0 * 40.0, 20));
        // A line beside it taken for the right one: dozens of pixels.
        assert!(few.is_unlike(4.0 * 30.0 * 30.0, 4) && many.is_unlike(20.0 * 10.0 * 10.0, 20));
    }
}
