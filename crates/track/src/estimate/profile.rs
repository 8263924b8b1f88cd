//! What may be true, weighed: each hypothesis, with the ball nearer and farther where its distance is known least.

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::model::{Loss, Model};
use super::observation::HeldDistance;
use super::solve::Hypothesis;
use super::trajectory::{OF_SEGMENT, Trajectory};
use gravisight_physics::{FORCES, part};

/// Steps of the profile of a distance, in standard deviations, to either side; how firmly each is held; steps of refinement.
const PROFILE: i32 = 6;
const PINNED: f64 = 0.05;
pub const PROFILE_STEPS: usize = 12;
/// Weight of a step below which no more are tried, and of a hypothesis from which it is profiled.
const NEGLIGIBLE_STEP: f64 = 0.03;
const LEAST_PROFILED: f64 = 0.05;
/// Weight below which a hypothesis does not count.
pub const NEGLIGIBLE: f64 = 1e-3;

/// A hypothesis over all frames of the track, and its weight.
pub struct Weighed {
    /// Over all frames of the track, and over those that it was found on.
    pub trajectory: Trajectory,
    pub own: Trajectory,
    pub weight: f64,
    pub positions: Vec<Vector3<f64>>,
    pub covariances: Vec<Matrix3<f64>>,
}

impl Model<'_> {
    /// What may be true, with weights, the likeliest trajectory first: each hypothesis, and of those that count the trajectories with the
    /// ball nearer or farther where least is known of that. That error is no linear one, so its distribution is added up in steps. And
    /// the cost of the likeliest hypothesis by what that adds up to.
    pub(super) fn weighed(&self, found: &[Hypothesis]) -> (Vec<Weighed>, f64) {
        let least = found.first().map_or(0.0, |best| best.cost);
        let mut cost = least;
        let mut all = vec![];
        for hypothesis in found {
            let weight = (-0.5 * (hypothesis.cost - least)).exp();
            if weight < NEGLIGIBLE {
                continue;
            }
            let own = self.weigh(&hypothesis.trajectory, weight);
            let Some(own) = own else { continue };
            if weight < LEAST_PROFILED {
                all.push(own);
                continue;
            }
            let (profile, volume) = self.profile(hypothesis, own);
            cost = cost.min(hypothesis.cost - 2.0 * volume.ln());
            all.extend(profile);
        }
        (all, cost)
    }

    /// The trajectories of a hypothesis by the distance in the frame where it is known least, their weights adding up to its own; and
    /// what these add up to over what they would if the error were linear.
    fn profile(&self, hypothesis: &Hypothesis, own: Weighed) -> (Vec<Weighed>, f64) {
        let axis = |of: &Weighed, frame: usize| {
            let ray = self.observations[frame].ray.as_ref()?;
            let off = of.positions[frame] - ray.origin;
            let direction = off.normalize();
            let sigma = direction.dot(&(of.covariances[frame] * direction)).max(0.0).sqrt();
            Some((frame, off.norm(), sigma / off.norm()))
        };
        let worst = (0..own.positions.len()).filter_map(|frame| axis(&own, frame)).max_by(|a, b| a.2.total_cmp(&b.2));
        let Some((frame, distance, sigma)) = worst.filter(|it| it.2 > 0.0) else { return (vec![own], 1.0) };
        let at = |step: f64, from: &Trajectory| {
            let held = HeldDistance { frame, log_distance: distance.ln() + step * sigma, sigma: PINNED * sigma };
            let model = Model { held: Some(held), ..self.with_observations(self.observations) };
            let trajectory = model.refined(from, &from.all(), Loss::Mixture, PROFILE_STEPS)?.trajectory;
            let cost = self.judged(trajectory.clone(), &trajectory.all())?.cost;
            // The evidence there integrates over the distance, too; its density at this distance does not.
            let (_, _, free) = axis(&self.weigh(&trajectory, 1.0)?, frame).filter(|it| it.2 > 0.0)?;
            let weight = (-0.5 * (cost - hypothesis.cost)).exp() * sigma / free;
            Some((weight, model.weigh(&trajectory, 1.0)?))
        };
        let Some((_, centre)) = at(0.0, &hypothesis.trajectory) else { return (vec![own], 1.0) };
        let mut points = vec![(1.0, centre)];
        for side in [-1.0, 1.0] {
            let mut from = hypothesis.trajectory.clone();
            for step in 1..=PROFILE {
                let Some((weight, point)) = at(side * f64::from(step), &from) else { break };
                from = point.own.clone();
                if weight < NEGLIGIBLE_STEP {
                    break;
                }
                points.push((weight.min(2.0), point));
            }
        }
        let all: f64 = points.iter().map(|point| point.0).sum();
        let weigh = |(weight, point): (f64, Weighed)| Weighed { weight: own.weight * weight / all, ..point };
        (points.into_iter().map(weigh).collect(), all / std::f64::consts::TAU.sqrt())
    }

    fn weigh(&self, trajectory: &Trajectory, weight: f64) -> Option<Weighed> {
        // What is not seen any more is tied as all else is: by continuity and by the law of each contact, with its noise.
        let marginals = self.marginals(&self.followed_on(trajectory))?;
        let whole = self.whole(trajectory);
        let (mut positions, mut covariances) = (vec![], vec![]);
        for (index, segment) in whole.segments.iter().enumerate() {
            // The first segment's numbers are of its first label, not of the track's first frame.
            let segment = if index == 0 { &trajectory.segments[0] } else { segment };
            let mut flight = self.forecaster.flight(&segment.state, &whole.log_scales, true);
            let mut time = segment.time;
            let (own, cross) = (&marginals.segments[index], &marginals.cross[index]);
            for frame in whole.frames(index) {
                flight.advance(whole.times[frame] - time);
                time = whole.times[frame];
                positions.push(part(&flight.state, 0));
                let mut by_own = SMatrix::<f64, 3, OF_SEGMENT>::zeros();
                by_own.fixed_view_mut::<3, 1>(0, 0).copy_from(&-part(&flight.state, 1));
                by_own.fixed_view_mut::<3, 9>(0, 1).copy_from(&flight.position.fixed_view::<3, 9>(0, 0));
                let by_shared = flight.position.fixed_view::<3, FORCES>(0, 9).into_owned();
                let shared = marginals.shared.fixed_view::<FORCES, FORCES>(0, 0).into_owned();
                let mixed = by_own * cross.fixed_view::<OF_SEGMENT, FORCES>(0, 0) * by_shared.transpose();
                covariances.push(
                    by_own * own * by_own.transpose()
                        + by_shared * shared * by_shared.transpose()
                        + mixed
                        + mixed.transpose(),
                );
            }
        }
        Some(Weighed { trajectory: whole, own: trajectory.clone(), weight, positions, covariances })
    }
}

/// The trajectory that is least far from what may be true, by weight.
pub fn least_risk(weighed: &[Weighed]) -> Option<&Weighed> {
    let count = weighed.first()?.positions.len();
    let apart = |a: &Weighed, b: &Weighed| {
        let squares = a.positions.iter().zip(&b.positions).map(|(a, b)| (a - b).norm_squared());
        squares.sum::<f64>() / count as f64
    };
    let risk = |it: &&Weighed| weighed.iter().map(|other| other.weight * apart(it, other)).sum::<f64>();
    weighed.iter().min_by(|a, b| risk(a).total_cmp(&risk(b)))
}
