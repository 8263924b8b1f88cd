//! What a track says of the scene's own numbers: drag and restitution. What the scene says of them counts once, however many contacts and
//! parts a track has: each adds what its labels say alone.

use std::collections::BTreeMap;

use nalgebra::SVector;

use super::model::{Model, RESTITUTION};
use super::normal::{Marginals, OF_PAIR};
use super::trajectory::{Begin, OF_SEGMENT, Trajectory};
use crate::config::Parameter;
use crate::result::Estimate;
use gravisight_physics::{Contact, FORCES, Forecaster};

/// Slowest bounce that says what the restitution is, m/s.
const SLOWEST: f64 = 0.5;
/// Fraction of a contact's own variance that labels have to take away for it to say anything: rounding.
const SAYS_NOTHING: f64 = 1e-9;

/// A normal distribution as its information, which adds up over what is independent.
#[derive(Debug, Clone, Copy, Default)]
struct Information {
    precision: f64,
    /// The mean times that.
    weighted: f64,
}

impl Information {
    fn of(mean: f64, variance: f64) -> Self {
        Self { precision: variance.recip(), weighted: mean / variance }
    }

    fn plus(self, other: Self) -> Self {
        Self { precision: self.precision + other.precision, weighted: self.weighted + other.weighted }
    }

    /// What is left without `prior`, which it contains; nothing where that is rounding.
    fn without(self, prior: Self) -> Self {
        let left = Self { precision: self.precision - prior.precision, weighted: self.weighted - prior.weighted };
        if left.precision > SAYS_NOTHING * prior.precision { left } else { Self::default() }
    }

    fn over(self, factor: f64) -> Self {
        Self { precision: self.precision / factor, weighted: self.weighted / factor }
    }
}

impl Parameter {
    /// What the scene says of it; of the drag's logarithm. None of what it has not, and of the spin, which each flight has for itself.
    fn prior(self, forecaster: &Forecaster) -> Option<Information> {
        let scene = forecaster.scene();
        let (mean, sigma) = match (self, &scene.contact) {
            (Self::Drag, _) => {
                let (_, sigma) = forecaster.scale_sigmas().find(|(name, _)| *name == "drag")?;
                (scene.ball.drag_coefficient.ln(), sigma)
            }
            (Self::Restitution, Contact::Bounce { restitution, restitution_sigma, .. }) => {
                (*restitution, restitution_sigma.unwrap_or(RESTITUTION))
            }
            _ => return None,
        };
        Some(Information::of(mean, sigma * sigma))
    }

    fn estimate(self, information: Information) -> Estimate {
        let (mean, sigma) = (information.weighted / information.precision, information.precision.sqrt().recip());
        match self {
            Self::Drag => Estimate { value: mean.exp(), sigma: mean.exp() * sigma },
            _ => Estimate { value: mean, sigma },
        }
    }

    fn information(self, Estimate { value, sigma }: Estimate) -> Information {
        match self {
            Self::Drag => Information::of(value.ln(), (sigma / value).powi(2)),
            _ => Information::of(value, sigma * sigma),
        }
    }
}

/// What several parts of a track say of the numbers of one scene.
pub fn combined(forecaster: &Forecaster, parts: &[BTreeMap<Parameter, Estimate>]) -> BTreeMap<Parameter, Estimate> {
    let mut totals: BTreeMap<Parameter, Information> = BTreeMap::new();
    for (&parameter, &estimate) in parts.iter().flatten() {
        let Some(prior) = parameter.prior(forecaster) else { continue };
        let own = parameter.information(estimate).without(prior);
        totals.entry(parameter).and_modify(|all| *all = all.plus(own)).or_insert(prior.plus(own));
    }
    totals.into_iter().map(|(parameter, information)| (parameter, parameter.estimate(information))).collect()
}

impl Model<'_> {
    /// What a track says of drag and, where the ball bounces, of restitution: the scene's own, as far as it says no more. `inflation`: of
    /// the labels' variances, by errors that last.
    pub(super) fn estimates(
        &self,
        trajectory: &Trajectory,
        marginals: &Marginals,
        inflation: f64,
    ) -> BTreeMap<Parameter, Estimate> {
        let mut found = BTreeMap::new();
        let drag = self.forecaster.scale_sigmas().position(|(name, _)| name == "drag");
        if let (Some(index), Some(prior)) = (drag, Parameter::Drag.prior(self.forecaster)) {
            let mean = self.forecaster.scene().ball.drag_coefficient.ln() + trajectory.log_scales[index];
            let both = Information::of(mean, marginals.shared[(index, index)]);
            let all = prior.plus(both.without(prior).over(inflation));
            found.insert(Parameter::Drag, Parameter::Drag.estimate(all));
        }
        let bounces = (1..trajectory.segments.len()).filter_map(|at| self.bounce(trajectory, marginals, at, inflation));
        let bounces = bounces.reduce(Information::plus);
        if let (Some(measured), Some(prior)) = (bounces, Parameter::Restitution.prior(self.forecaster)) {
            found.insert(Parameter::Restitution, Parameter::Restitution.estimate(prior.plus(measured)));
        }
        found
    }

    /// What the labels alone say of the restitution by the bounce that begins a segment; none where it begins otherwise, or slowly.
    fn bounce(&self, trajectory: &Trajectory, marginals: &Marginals, at: usize, inflation: f64) -> Option<Information> {
        let (before, segment) = (&trajectory.segments[at - 1], &trajectory.segments[at]);
        let Begin::Bounce(obstacle) = segment.begin else { return None };
        let mut flight = self.forecaster.flight(&before.state, &trajectory.log_scales, true);
        flight.advance(segment.time - before.time);
        let noise = self.contact_noise(&self.obstacles[obstacle], &segment.position(), &flight.state);
        let (normal, closing) = (noise.normal, noise.closing);
        if closing <= SLOWEST {
            return None;
        }
        let bend = normal.dot(&flight.slope().1);
        let by_arrival = normal.transpose() * flight.velocity;
        // Of the speed away from the surface, and so many times that of the arrival: by both segments' numbers and the shared ones.
        let slope = |ratio: f64| {
            let mut all = SVector::<f64, OF_PAIR>::zeros();
            (all[0], all[OF_SEGMENT]) = (-ratio * bend, ratio * bend);
            (0..9).for_each(|number| all[1 + number] = ratio * by_arrival[number]);
            (0..FORCES).for_each(|force| all[2 * OF_SEGMENT + force] = ratio * by_arrival[9 + force]);
            all.fixed_rows_mut::<3>(OF_SEGMENT + 4).copy_from(&normal);
            all
        };
        let leaving = normal.dot(&segment.velocity());
        let (found, known) = (leaving / closing, self.rigid.restitution);
        let (of_found, of_known) = (slope(found), slope(known));
        let covariance = marginals.pair(at - 1);
        let [own, both, law] = [(&of_found, &of_found), (&of_found, &of_known), (&of_known, &of_known)]
            .map(|(a, b)| a.dot(&(covariance * b)));
        // The law's own residual is taken out of what all residuals say (Sherman and Morrison 1950).
        let left = noise.along * noise.along - law;
        if left <= SAYS_NOTHING * noise.along * noise.along {
            return Some(Information::default());
        }
        let mean = found + both * (leaving - known * closing) / (left * closing);
        let variance = (own + both * both / left) / (closing * closing);
        // One bounce is not as the other, whatever the ball's restitution.
        let scatter = self.config.contact_speed / closing;
        let all = variance * inflation + scatter * scatter;
        (all.is_finite() && all > 0.0).then(|| Information::of(mean, all))
    }
}
