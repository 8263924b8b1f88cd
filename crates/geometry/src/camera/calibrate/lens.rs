//! Whether clicks ask for a lens that nobody gave.

use super::noise::f_tail;
use super::{BEST_CLICK, Problem, Solution, Unknowns};
use crate::error::Result;

/// Chance that clicks through a lens without distortion bow as much, below which one coefficient is estimated.
pub(super) const NO_LENS: f64 = 0.01;
/// Equations beyond the unknowns that one coefficient needs, and two.
const ENOUGH: [usize; 2] = [3, 10];

impl Problem<'_> {
    /// The same, with one coefficient of the lens (with clicks enough two) where none is given or asked for and it pays: where it
    /// explains clicks that would be called wrong without it, or where they bow so that chance hardly would.
    pub(super) fn by_clicks_and_lens(self) -> Result<(Self, (Solution, Vec<usize>))> {
        let open = self.points.distortion.is_none() && self.unknowns.distortion == 0;
        let mut best = self.by_clicks();
        let all: Vec<usize> = (0..self.points.image.len()).collect();
        let mut of_all = self.solve(&all).map_or(f64::INFINITY, |(found, _)| found.cost);
        let mut problem = self;
        for distortion in 1..=2 {
            let unknowns = Unknowns { distortion, ..problem.unknowns };
            let bent = Self { points: problem.points, unknowns };
            let Some(freedom) = bent.freedom(&[]).filter(|&freedom| open && freedom >= ENOUGH[distortion - 1]) else {
                break;
            };
            // To look for wrong clicks takes hundreds of solutions: not where all clicks together do not bow, and none is called wrong.
            let added = distortion - problem.unknowns.distortion;
            let bent_of_all = bent.solve(&all).map_or(f64::INFINITY, |(found, _)| found.cost);
            let bows = lens_chance(added, (of_all - bent_of_all).max(0.0), bent_of_all, freedom) < NO_LENS;
            if !bows && best.as_ref().is_ok_and(|(_, called_wrong)| called_wrong.is_empty()) {
                continue;
            }
            let Ok((with_lens, outliers)) = bent.by_clicks() else { continue };
            let reaches = with_lens.0.guess.camera(problem.points.size).is_ok_and(|camera| camera.sees_its_corners());
            let freedom = bent.freedom(&outliers).unwrap_or(freedom);
            let pays = best.as_ref().map_or(true, |((before, _), called_wrong)| {
                let better = (before.cost - with_lens.0.cost).max(0.0);
                outliers.len() < called_wrong.len()
                    || outliers == *called_wrong && lens_chance(added, better, with_lens.0.cost, freedom) < NO_LENS
            });
            if pays && reaches {
                best = Ok((with_lens, outliers));
                (problem, of_all) = (bent, bent_of_all);
            }
        }
        best.map(|best| (problem, best))
    }

    /// Equations less unknowns with these clicks left out; none where that is not above zero.
    fn freedom(&self, outliers: &[usize]) -> Option<usize> {
        let equations = 2 * (self.points.image.len() - outliers.len());
        equations.checked_sub(self.unknowns.count()).filter(|&freedom| freedom > 0)
    }
}

/// The chance that a lens without distortion lets a cost (px²) fall `better` below what is left, `cost`, when one or two coefficients
/// are `added`: F test.
fn lens_chance(added: usize, better: f64, cost: f64, freedom: usize) -> f64 {
    let variance = (cost / freedom as f64).max(BEST_CLICK * BEST_CLICK);
    match added {
        1 => two_sided((better / variance).sqrt(), freedom),
        _ => f_tail(1, freedom as f64, better / 2.0 / variance),
    }
}

/// The chance that a variable of Student's t distribution with `freedom` degrees of freedom is farther from zero than `t`
/// (Abramowitz and Stegun, 26.7.3 and 26.7.4).
pub(super) fn two_sided(t: f64, freedom: usize) -> f64 {
    let angle = (t / (freedom as f64).sqrt()).atan();
    let (sine, cosine) = angle.sin_cos();
    let odd = freedom % 2 == 1;
    // cos θ + 2/3 cos³ θ + …, or 1 + 1/2 cos² θ + …
    let (mut term, mut sum) = (if odd { cosine } else { 1.0 }, 0.0);
    let mut power = if odd { 1 } else { 0 };
    while power + 2 <= freedom {
        sum += term;
        term *= cosine * cosine * (power + 1) as f64 / (power + 2) as f64;
        power += 2;
    }
    let within = if odd { std::f64::consts::FRAC_2_PI * (angle + sine * sum) } else { sine * sum };
    (1.0 - within).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::two_sided;

    #[test]
    fn the_tails_of_students_distribution_are_the_tables() {
        // Abramowitz and Stegun, table 26.10: percentage points of the t distribution.
        for (t, freedom, chance) in [
            (12.706, 1, 0.05),
            (4.303, 2, 0.05),
            (3.182, 3, 0.05),
            (2.776, 4, 0.05),
            (2.571, 5, 0.05),
            (63.657, 1, 0.01),
            (3.169, 10, 0.01),
        ] {
            assert!((two_sided(t, freedom) - chance).abs() < 1e-4, "{t} {freedom}: {}", two_sided(t, freedom));
        }
        assert!((two_sided(0.0, 7) - 1.0).abs() < 1e-12);
    }
}
