//! From hypotheses to what a user is told: positions, how sure they are, flights, hits, and whether the laws explain them.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Point3, SMatrix, Vector2, Vector3};

use super::model::{Loss, Model};
use super::normal::Marginals;
use super::observation::RayObservation;
use super::part::Outcome;
use super::solve::Hypothesis;
use super::trajectory::{Begin, OF_SEGMENT, Trajectory};
use crate::physics::{FORCES, Impact, State, part};
use crate::track::fit::{Estimate, Fit, FitSummary, FittedFrame, FittedImpact, Flight, Hit, Parameter};

/// Residual, in standard deviations, of an outlier.
const OUTLIER: f64 = 4.0;
/// Fraction of outliers with which a flight is explained.
const MOST_OUTLIERS: f64 = 0.25;
/// Steps of the profile of a distance, in standard deviations, to either side; how firmly each is held; steps of refinement.
const PROFILE: i32 = 6;
const PINNED: f64 = 0.05;
const PROFILE_STEPS: usize = 12;
/// Weight of a step below which no more are tried, and of a hypothesis from which its profile is worth it.
const NEGLIGIBLE_STEP: f64 = 0.03;
const WORTH: f64 = 0.05;
/// Fraction of the distance beyond which a position is as good as unknown, and that of the distance of what is not explained.
const UNKNOWN: f64 = 0.06;
const DISTANCE_UNKNOWN: f64 = 0.5;
/// One case in a hundred, and in a thousand, in standard deviations.
const ODD: f64 = 2.33;
const VERY_ODD: f64 = 3.09;
/// Degrees of freedom of the noise by the labels' smoothness, per label.
const SMOOTH_FREEDOM: f64 = 0.6;
/// Slowest bounce that says what the restitution is, m/s.
const SLOWEST: f64 = 0.5;
/// Strongest correlation of one residual with the next that is believed.
const STRONGEST: f64 = 0.9;
/// Weight below which a hypothesis does not count.
const NEGLIGIBLE: f64 = 1e-3;

/// A hypothesis over all frames of the track, and its weight.
struct Weighed {
    /// Over all frames of the track, and over those that it was found on.
    trajectory: Trajectory,
    own: Trajectory,
    weight: f64,
    positions: Vec<Vector3<f64>>,
    covariances: Vec<Matrix3<f64>>,
}

impl Model<'_> {
    /// What the hypotheses `found` say, the most probable first. The camera may as well be one by which the observations are one of
    /// `cameras`.
    pub fn result(&self, found: &[Hypothesis], cameras: &[Vec<RayObservation>]) -> Option<Outcome> {
        let (weighed, cost) = self.weighed(found);
        let least = found.first()?.cost;
        let weights = found.iter().map(|it| (-0.5 * (it.cost - least)).exp()).filter(|weight| *weight >= NEGLIGIBLE);
        let summary = FitSummary {
            log_evidence: -0.5 * (cost + self.prior_constant()),
            structures: weights.clone().count(),
            probability: weights.sum::<f64>().recip(),
        };
        let all: f64 = weighed.iter().map(|it| it.weight).sum();
        let chosen = least_risk(&weighed)?;
        let whole = &chosen.trajectory;
        let (best, marginals) = (&chosen.own, self.marginals(&chosen.own)?);
        let states = self.states(whole);
        let residual = |frame: usize| -> Option<Vector2<f64>> {
            let ray = self.observations[frame].ray.as_ref()?;
            Some(ray.residual(&part(&states[frame], 0))?.0)
        };
        let residuals: Vec<Option<Vector2<f64>>> = (0..states.len()).map(residual).collect();
        let white = (best.noise * best.noise - self.drift * self.drift).max(1e-6).sqrt();
        let inflation = (correlation(&residuals, white) * (white / best.noise).powi(2)).max(1.0);
        let hits: Vec<usize> =
            (1..whole.segments.len()).filter(|&index| whole.segments[index].begin == Begin::Hit).collect();
        // Where each frame is by a camera that is off.
        let moved = |observations: &Vec<RayObservation>| {
            let model = self.with_observations(observations);
            let trajectory = model.refined(best, &best.all(), Loss::Mixture, PROFILE_STEPS)?.trajectory;
            Some(self.states(&self.whole(&trajectory)).iter().map(|state| part(state, 0)).collect::<Vec<_>>())
        };
        let moved: Vec<Vec<Vector3<f64>>> = cameras.iter().filter_map(moved).collect();
        let frame = |index: usize| {
            let position = chosen.positions[index];
            let mut covariance = Matrix3::zeros();
            for other in &weighed {
                let off = other.positions[index] - position;
                covariance += (other.covariances[index] * inflation + off * off.transpose()) * (other.weight / all);
            }
            for positions in &moved {
                let off = positions[index] - position;
                covariance += off * off.transpose();
            }
            let state = State {
                position: Point3::from(position),
                velocity: part(&states[index], 1),
                spin: part(&states[index], 2),
            };
            FittedFrame {
                residual_px: residuals[index],
                outlier: residuals[index].is_some_and(|residual| residual.norm() > OUTLIER * best.noise),
                flight: hits.partition_point(|&segment| whole.segments[segment].time <= whole.times[index]),
                ..FittedFrame::new(whole.times[index], state, covariance)
            }
        };
        let mut frames: Vec<FittedFrame> = (0..states.len()).map(frame).collect();
        let groups = self.prior_chi2(whole);
        let mut flights = vec![];
        for number in 0..=hits.len() {
            let first = number.checked_sub(1).map_or(0, |before| hits[before]);
            let last = hits.get(number).copied().unwrap_or(whole.segments.len());
            let own: Vec<&FittedFrame> = frames.iter().filter(|frame| frame.flight == number).collect();
            let doubt = self.doubt(whole, first..last, &own, &groups);
            let segment = &whole.segments[first];
            let covariance = &marginals.segments[first];
            let along = segment.velocity().normalize();
            let velocity: Matrix3<f64> = covariance.fixed_view::<3, 3>(4, 4).into_owned();
            let speed_sigma = ((along.transpose() * velocity * along)[(0, 0)] * inflation).max(0.0).sqrt();
            let reason = doubt.clone().or_else(|| self.unknown(&own));
            flights.push((
                doubt.is_some(),
                Flight {
                    start: segment.time,
                    end: whole.segments.get(last).map_or(whole.times[whole.last], |next| next.time),
                    speed_start: segment.velocity().norm(),
                    speed_sigma,
                    spin: part(&segment.state, 2).into(),
                    spin_sigma: [7, 8, 9].map(|at| (covariance[(at, at)] * inflation).max(0.0).sqrt()),
                    explained: reason.is_none(),
                    reason,
                },
            ));
        }
        frames.iter_mut().filter(|frame| flights[frame.flight].0).for_each(|frame| self.widen(frame));
        let doubtful = flights.iter().any(|(doubtful, _)| *doubtful);
        let flights: Vec<Flight> = flights.into_iter().map(|(_, flight)| flight).collect();
        let hit = |&index: &usize| {
            let segment = &whole.segments[index];
            let frame = whole.times.partition_point(|&at| at < segment.time);
            Hit { time: segment.time, frame, world: Point3::from(segment.position()), explained: false }
        };
        let impact = |(index, segment): (usize, &super::trajectory::Segment)| {
            let Begin::Bounce(obstacle) = segment.begin else { return None };
            if index >= best.segments.len() {
                return None;
            }
            let obstacle = &self.obstacles[obstacle];
            let arrived = self.arrival(whole, index - 1);
            let speed = -obstacle.nearest(&segment.position()).normal.dot(&part(&arrived, 1));
            let (time, surface, world) = (segment.time, obstacle.surface, segment.position().into());
            Some(Impact { time, surface, world, speed, time_gradient: None }.into())
        };
        let mut impacts: Vec<FittedImpact> = whole.segments.iter().enumerate().filter_map(impact).collect();
        impacts.extend(self.lasting_impacts(whole).into_iter().map(FittedImpact::from));
        let fit = Fit {
            noise_px: white,
            rms_px: rms(frames.iter()),
            explained: flights.iter().all(|flight| flight.explained),
            impacts,
            hits: hits.iter().map(hit).collect(),
            flights,
            estimates: self.estimates(whole, &marginals, inflation),
            spin: part(&whole.segments[0].state, 2).into(),
            summary,
            config: self.config,
            frames,
            ..Fit::default()
        };
        Some(Outcome { fit, cost, doubtful })
    }

    /// What is touched in contacts that last.
    fn lasting_impacts(&self, whole: &Trajectory) -> Vec<Impact> {
        let lasting = whole.segments.iter().enumerate().filter(|(_, segment)| segment.begin == Begin::LastingContact);
        let touched = lasting.flat_map(|(index, segment)| {
            let (arrived, from) = (self.arrival(whole, index - 1), whole.end_of_flight(index - 1));
            let [position, velocity, spin] = [0, 1, 2].map(|which| part(&arrived, which));
            let start = State { position: position.into(), velocity, spin };
            let impacts = self.forecaster.forecast(&start, &[segment.time - from]).impacts;
            impacts.into_iter().map(move |impact| Impact { time: from + impact.time, ..impact })
        });
        touched.collect()
    }

    /// The trajectory over all frames of the track, those before the first label and after the last included.
    fn whole(&self, trajectory: &Trajectory) -> Trajectory {
        let mut whole = trajectory.clone();
        let first = &mut whole.segments[0];
        let mut flight = self.forecaster.flight(&first.state, &trajectory.log_scales, false);
        flight.advance(trajectory.times[0] - first.time);
        (first.state, first.time) = (flight.state, trajectory.times[0]);
        (whole.first, whole.last) = (0, trajectory.times.len() - 1);
        // What is not seen any more bounces as the law has it.
        if whole.last > trajectory.last { self.followed(&whole).unwrap_or(whole) } else { whole }
    }

    /// Of each frame of the track.
    pub(super) fn states(&self, whole: &Trajectory) -> Vec<[f64; 9]> {
        let mut states = Vec::with_capacity(whole.times.len());
        for (index, segment) in whole.segments.iter().enumerate() {
            let mut flight = self.forecaster.flight(&segment.state, &whole.log_scales, false);
            let mut time = segment.time;
            for frame in whole.frames(index) {
                flight.advance(whole.times[frame] - time);
                time = whole.times[frame];
                states.push(flight.state);
            }
        }
        states
    }

    /// What may be true, with weights, the likeliest trajectory first: each hypothesis, and of those that count the trajectories with the
    /// ball nearer or farther where least is known of that. That error is no linear one, so its distribution is added up in steps. And
    /// the cost of the likeliest hypothesis by what that adds up to.
    fn weighed(&self, found: &[Hypothesis]) -> (Vec<Weighed>, f64) {
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
            if weight < WORTH {
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
        let axis = |frame: usize| {
            let ray = self.observations[frame].ray.as_ref()?;
            let off = own.positions[frame] - ray.origin;
            let direction = off.normalize();
            let sigma = direction.dot(&(own.covariances[frame] * direction)).max(0.0).sqrt();
            Some((frame, off.norm(), sigma / off.norm()))
        };
        let worst = (0..own.positions.len()).filter_map(axis).max_by(|a, b| a.2.total_cmp(&b.2));
        let Some((frame, distance, sigma)) = worst.filter(|it| it.2 > 0.0) else { return (vec![own], 1.0) };
        let at = |step: f64, from: &Trajectory| {
            let mut observations = self.observations.to_vec();
            observations[frame].log_distance = Some([distance.ln() + step * sigma, PINNED * sigma]);
            let model = self.with_observations(&observations);
            let trajectory = model.refined(from, &from.all(), Loss::Mixture, PROFILE_STEPS)?.trajectory;
            let cost = self.judged(trajectory.clone(), &trajectory.all())?.cost;
            let weight = (-0.5 * (cost - hypothesis.cost)).exp();
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
        let marginals = self.marginals(trajectory)?;
        let whole = self.whole(trajectory);
        let (mut positions, mut covariances) = (vec![], vec![]);
        let seen = trajectory.segments.len() - 1;
        for (index, segment) in whole.segments.iter().enumerate() {
            // The first segment's numbers are of its first label, not of the track's first frame.
            let segment = if index == 0 { &trajectory.segments[0] } else { segment };
            let mut flight = self.forecaster.flight(&segment.state, &whole.log_scales, true);
            let mut time = segment.time;
            let (own, cross) = (&marginals.segments[index.min(seen)], &marginals.cross[index.min(seen)]);
            for frame in whole.frames(index) {
                flight.advance(whole.times[frame] - time);
                time = whole.times[frame];
                positions.push(part(&flight.state, 0));
                let mut by_own = SMatrix::<f64, 3, OF_SEGMENT>::zeros();
                by_own.fixed_view_mut::<3, 1>(0, 0).copy_from(&-part(&flight.state, 1));
                by_own.fixed_view_mut::<3, 9>(0, 1).copy_from(&flight.position.fixed_view::<3, 9>(0, 0));
                let by_shared = flight.position.fixed_view::<3, FORCES>(0, 9).into_owned();
                let shared = marginals.shared.fixed_view::<FORCES, FORCES>(0, 0).into_owned();
                let cross = cross.fixed_view::<OF_SEGMENT, FORCES>(0, 0).into_owned();
                let mixed = by_own * cross * by_shared.transpose();
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

    /// Why the flight of these segments is not explained, in words.
    fn doubt(
        &self,
        whole: &Trajectory,
        segments: std::ops::Range<usize>,
        frames: &[&FittedFrame],
        prior_chi2: &[(f64, usize)],
    ) -> Option<String> {
        let seen: Vec<&&FittedFrame> = frames.iter().filter(|frame| frame.residual_px.is_some()).collect();
        if seen.is_empty() {
            return Some("the ball is not seen".into());
        }
        let outliers = seen.iter().filter(|frame| frame.outlier).count();
        if outliers as f64 > MOST_OUTLIERS * seen.len() as f64 {
            return Some(format!("{outliers} of its {} labels lie far off", seen.len()));
        }
        let largest = 0.01 * self.area.sqrt();
        if whole.noise > largest {
            return Some(format!(
                "its labels are off by {:.0} px from one to the next, which no ball's are",
                whole.noise
            ));
        }
        let speed = whole.segments[segments.clone()].iter().map(|it| it.velocity().norm()).fold(0.0, f64::max);
        if speed > self.speed_max {
            let most = self.speed_max;
            return Some(format!(
                "it would fly at {speed:.0} m/s, faster than a ball of its sport ever has ({most:.0} m/s)"
            ));
        }
        let rms = rms(frames.iter().copied());
        let smooth = self.smooth.hypot(self.drift);
        let spread = (2.0 / (2 * seen.len()) as f64 + 2.0 / (SMOOTH_FREEDOM * seen.len() as f64)).sqrt();
        if rms * rms > smooth * smooth * (VERY_ODD * spread).exp() {
            return Some(format!("its labels are off by {rms:.2} px, though they are known to {smooth:.2} px"));
        }
        let odd = |&&[_, off]: &&[f64; 2]| off.abs() > VERY_ODD;
        if let Some([restitution, _]) = self.restitutions(whole)[segments.clone()].iter().flatten().find(odd) {
            return Some(format!(
                "a bounce of it would have a restitution of {restitution:.2}, far from the scene's {:.2}: check the camera, \
                 the scene's heights and the frame rate",
                self.rigid.restitution
            ));
        }
        // The forces, what begins the first flight, and each contact by itself; then all together.
        let own = prior_chi2[..1].iter().chain(&prior_chi2[1 + segments.start..1 + segments.end]);
        if let Some((chi2, numbers)) = own.clone().find(|(chi2, numbers)| *chi2 > quantile(*numbers, VERY_ODD)) {
            return Some(format!("it takes spins and bounces that this ball has not (χ² {chi2:.0} of {numbers})"));
        }
        let (chi2, numbers) = own.fold((0.0, 0), |sum, it| (sum.0 + it.0, sum.1 + it.1));
        if chi2 > quantile(numbers, ODD) {
            return Some(format!("it takes spins and bounces that this ball has not (χ² {chi2:.0} of {numbers})"));
        }
        None
    }

    /// That a flight's distance is not known, in words.
    fn unknown(&self, frames: &[&FittedFrame]) -> Option<String> {
        let origin = self.observations.iter().find_map(|it| it.ray.as_ref())?.origin;
        let seen = frames.iter().filter(|frame| frame.residual_px.is_some());
        let distance = |frame: &FittedFrame| (frame.world.coords - origin).norm();
        let mut fractions: Vec<(f64, f64)> = seen.map(|frame| (frame.sigma / distance(frame), frame.sigma)).collect();
        fractions.sort_by(|a, b| a.0.total_cmp(&b.0));
        let &(fraction, sigma) = fractions.get(fractions.len() / 2)?;
        (fraction > UNKNOWN).then(|| {
            format!(
                "how far away the ball is stays unknown (±{sigma:.1} m): its spin is, and it touches nothing of the scene"
            )
        })
    }

    /// Adds to a position's covariance that nobody knows where it is: the laws do not hold, or the camera is another.
    pub fn widen(&self, frame: &mut FittedFrame) {
        let Some(ray) = self.observations.iter().find_map(|it| it.ray.as_ref()) else { return };
        let off = DISTANCE_UNKNOWN * (frame.world.coords - ray.origin).norm();
        frame.spread(&(Matrix3::identity() * (off * off / 3.0)));
    }

    /// What a track says of drag and, where the ball bounces, of restitution: the scene's own, as far as it says no more.
    fn estimates(&self, whole: &Trajectory, marginals: &Marginals, inflation: f64) -> BTreeMap<Parameter, Estimate> {
        let mut found = BTreeMap::new();
        if let Some(index) = self.forecaster.scale_sigmas().position(|(name, _)| name == "drag") {
            let value = self.forecaster.scene().ball.drag_coefficient * whole.log_scales[index].exp();
            let sigma = value * (marginals.shared[(index, index)] * inflation).max(0.0).sqrt();
            found.insert(Parameter::Drag, Estimate { value, sigma });
        }
        let (mut weights, mut sum) = (0.0, 0.0);
        for (index, segment) in whole.segments.iter().enumerate() {
            let Begin::Bounce(obstacle) = segment.begin else { continue };
            let normal = self.obstacles[obstacle].nearest(&segment.position()).normal;
            if index >= marginals.segments.len() {
                break;
            }
            let closing = -normal.dot(&part(&self.arrival(whole, index - 1), 1));
            let velocity = marginals.segments[index].fixed_view::<3, 3>(4, 4);
            let variance = (normal.transpose() * velocity * normal)[(0, 0)] * inflation / (closing * closing);
            if closing > SLOWEST && variance > 0.0 {
                weights += variance.recip();
                sum += normal.dot(&segment.velocity()) / closing / variance;
            }
        }
        if weights > 0.0 {
            let (value, sigma) = (sum / weights, weights.sqrt().recip());
            found.insert(Parameter::Restitution, Estimate { value, sigma });
        }
        found
    }
}

/// The trajectory that is least far from what may be true, by weight.
fn least_risk(weighed: &[Weighed]) -> Option<&Weighed> {
    let count = weighed.first()?.positions.len();
    let apart = |a: &Weighed, b: &Weighed| {
        let squares = a.positions.iter().zip(&b.positions).map(|(a, b)| (a - b).norm_squared());
        squares.sum::<f64>() / count as f64
    };
    let risk = |it: &&Weighed| weighed.iter().map(|other| other.weight * apart(it, other)).sum::<f64>();
    weighed.iter().min_by(|a, b| risk(a).total_cmp(&risk(b)))
}

/// What squares of so many standard deviations add up to with a probability of `odd` standard deviations (Wilson and Hilferty 1931).
pub fn quantile(numbers: usize, odd: f64) -> f64 {
    let n = numbers as f64;
    n * (1.0 - 2.0 / (9.0 * n) + odd * (2.0 / (9.0 * n)).sqrt()).powi(3)
}

/// Root mean square residual of labels that are no outliers, px.
fn rms<'a>(frames: impl Iterator<Item = &'a FittedFrame>) -> f64 {
    let squares: Vec<f64> = frames
        .filter(|frame| !frame.outlier)
        .filter_map(|frame| Some(frame.residual_px?.norm_squared() / 2.0))
        .collect();
    (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
}

/// By how much errors that last over frames make variances larger: of residuals that follow one another like a first-order
/// process, (1 + ρ)/(1 − ρ).
fn correlation(residuals: &[Option<Vector2<f64>>], sigma: f64) -> f64 {
    let (mut product, mut square) = (0.0, 0.0);
    let capped = |residual: Vector2<f64>| residual * (3.0 * sigma / residual.norm().max(3.0 * sigma));
    for pair in residuals.windows(2) {
        let (Some(a), Some(b)) = (pair[0], pair[1]) else { continue };
        let (a, b) = (capped(a), capped(b));
        product += a.dot(&b);
        square += (a.norm_squared() + b.norm_squared()) / 2.0;
    }
    let rho = if square > 0.0 { (product / square).clamp(0.0, STRONGEST) } else { 0.0 };
    (1.0 + rho) / (1.0 - rho)
}
