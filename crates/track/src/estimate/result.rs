//! From hypotheses to the result: positions, how sure they are, flights, hits, and whether the laws explain them.

use nalgebra::{Matrix3, Point3, Vector2, Vector3};

use super::model::{Loss, Model};
use super::observation::RayObservation;
use super::part::Outcome;
use super::profile::{NEGLIGIBLE, PROFILE_STEPS, least_risk};
use super::solve::Hypothesis;
use super::trajectory::{Begin, Trajectory};
use crate::result::{Fit, FitSummary, FittedFrame, FittedImpact, Flight, Hit};
use gravisight_physics::{Impact, State, part};

/// Residual, in standard deviations, of an outlier.
const OUTLIER: f64 = 4.0;
/// Fraction of outliers with which a flight is explained.
const MOST_OUTLIERS: f64 = 0.25;
/// Fraction of the distance beyond which a position is as good as unknown, and that of the distance of what is not explained.
const UNKNOWN: f64 = 0.06;
const DISTANCE_UNKNOWN: f64 = 0.5;
/// One case in a hundred, and in a thousand, in standard deviations.
const ODD: f64 = 2.33;
const VERY_ODD: f64 = 3.09;
/// Degrees of freedom of the noise by the labels' smoothness, per label.
const SMOOTH_FREEDOM: f64 = 0.6;
/// Strongest correlation of one residual with the next that is believed.
const STRONGEST: f64 = 0.9;

/// What the labels say by a camera that is moved by one standard deviation along one direction of its uncertainty.
struct Moved {
    trajectory: Trajectory,
    /// Of each frame, m.
    positions: Vec<Vector3<f64>>,
}

impl Model<'_> {
    /// What the hypotheses `found` say, the most probable first. `cameras` are the observations by the camera moved by one standard
    /// deviation along each direction of its uncertainty; none where such a camera does not see the labels. The uncertainty of a camera
    /// that is assumed rejects no flight.
    pub fn result(
        &self,
        found: &[Hypothesis],
        cameras: &[Option<Vec<RayObservation>>],
        is_camera_assumed: bool,
    ) -> Option<Outcome> {
        let (weighed, cost) = self.weighed(found);
        let least = found.first()?.cost;
        let weights = found.iter().map(|it| (-0.5 * (it.cost - least)).exp()).filter(|weight| *weight >= NEGLIGIBLE);
        let summary = FitSummary {
            log_evidence: -0.5 * (cost + self.prior_constant()),
            structures: u32::try_from(weights.clone().count()).unwrap_or(u32::MAX),
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
        // The trajectory by a camera that is off, and where that has the ball in each frame.
        let moved = |observations: &Option<Vec<RayObservation>>| {
            let model = self.with_observations(observations.as_ref()?);
            let trajectory = model.refined(best, &best.all(), Loss::Mixture, PROFILE_STEPS)?.trajectory;
            let trajectory = self.whole(&trajectory);
            let positions = self.states(&trajectory).iter().map(|state| part(state, 0)).collect();
            Some(Moved { trajectory, positions })
        };
        let moved: Vec<Option<Moved>> = cameras.iter().map(moved).collect();
        // Without a trajectory by one of them nobody knows what it would change.
        let is_camera_known = moved.iter().all(Option::is_some);
        let moved: Vec<Moved> = moved.into_iter().flatten().collect();
        let by_camera = |index: usize| -> Matrix3<f64> {
            let off = moved.iter().map(|it| it.positions[index] - chosen.positions[index]);
            off.map(|off| off * off.transpose()).sum()
        };
        let frame = |index: usize| {
            let position = chosen.positions[index];
            let mut covariance = Matrix3::zeros();
            for other in &weighed {
                let off = other.positions[index] - position;
                covariance += (other.covariances[index] * inflation + off * off.transpose()) * (other.weight / all);
            }
            covariance += by_camera(index);
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
        if !is_camera_known {
            frames.iter_mut().for_each(|frame| self.widen(frame));
        }
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
            let spin = part(&segment.state, 2);
            let spin_sigma = Vector3::new(7, 8, 9).map(|at| (covariance[(at, at)] * inflation).max(0.0).sqrt());
            // What the camera's uncertainty adds.
            let starts = || moved.iter().filter_map(|it| it.trajectory.segments.get(first));
            let speed_sigma = starts().fold(speed_sigma, |sigma, by_moved| {
                sigma.hypot(by_moved.velocity().norm() - segment.velocity().norm())
            });
            let spin_sigma = starts().fold(spin_sigma, |sigma: Vector3<f64>, by_moved| {
                sigma.zip_map(&(part(&by_moved.state, 2) - spin), f64::hypot)
            });
            let known = |index: usize| {
                let variance = frames[index].covariance.trace();
                let allowed = if is_camera_assumed { by_camera(index).trace() } else { 0.0 };
                (&frames[index], (variance - allowed).max(0.0).sqrt())
            };
            let counted: Vec<_> =
                (0..frames.len()).filter(|&index| frames[index].flight == number).map(known).collect();
            let is_by_camera = !is_camera_known || {
                let inside = (0..frames.len()).filter(|&index| frames[index].flight == number);
                let sums = inside.map(|index| (by_camera(index).trace(), frames[index].covariance.trace()));
                let (by_camera, all) = sums.fold((0.0, 0.0), |(by, all), (a, b)| (by + a, all + b));
                by_camera > 0.5 * all
            };
            let reason = doubt.clone().or_else(|| self.unknown(&counted, is_by_camera && !is_camera_assumed));
            flights.push((
                doubt.is_some(),
                Flight {
                    start: segment.time,
                    end: whole.segments.get(last).map_or(whole.times[whole.last], |next| next.time),
                    speed_start: segment.velocity().norm(),
                    speed_sigma,
                    spin: spin.into(),
                    spin_sigma: spin_sigma.into(),
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
            explained: Fit::all_explained(&flights),
            impacts,
            hits: hits.iter().map(hit).collect(),
            flights,
            estimates: self.estimates(best, &marginals, inflation),
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
    pub(super) fn whole(&self, trajectory: &Trajectory) -> Trajectory {
        let mut whole = self.followed_on(trajectory);
        let first = &mut whole.segments[0];
        let mut flight = self.forecaster.flight(&first.state, &trajectory.log_scales, false);
        flight.advance(trajectory.times[0] - first.time);
        (first.state, first.time) = (flight.state, trajectory.times[0]);
        (whole.first, whole.last) = (0, trajectory.times.len() - 1);
        whole
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

    /// Why the flight of these segments is not explained.
    fn doubt(
        &self,
        whole: &Trajectory,
        segments: std::ops::Range<usize>,
        frames: &[&FittedFrame],
        prior_chi2: &[(f64, usize)],
    ) -> Option<String> {
        let seen: Vec<&&FittedFrame> = frames.iter().filter(|frame| frame.residual_px.is_some()).collect();
        if seen.is_empty() {
            return Some("it has no labels".into());
        }
        let outliers = seen.iter().filter(|frame| frame.outlier).count();
        if outliers as f64 > MOST_OUTLIERS * seen.len() as f64 {
            return Some(format!("{outliers} of its {} labels lie far from the trajectory", seen.len()));
        }
        let largest = 0.01 * self.area.sqrt();
        if whole.noise > largest {
            return Some(format!("its labels jump by {:.0} px from one to the next, too much for a ball", whole.noise));
        }
        let speed = whole.segments[segments.clone()].iter().map(|it| it.velocity().norm()).fold(0.0, f64::max);
        if speed > self.speed_max {
            let most = self.speed_max;
            return Some(format!("it would fly at {speed:.0} m/s, faster than any ball of its sport ({most:.0} m/s)"));
        }
        let rms = rms(frames.iter().copied());
        let smooth = self.smooth.hypot(self.drift);
        let spread = (2.0 / (2 * seen.len()) as f64 + 2.0 / (SMOOTH_FREEDOM * seen.len() as f64)).sqrt();
        if rms * rms > smooth * smooth * (VERY_ODD * spread).exp() {
            return Some(format!(
                "its labels are {rms:.2} px from the trajectory, but their noise is only {smooth:.2} px"
            ));
        }
        let odd = |&&[_, off]: &&[f64; 2]| off.abs() > VERY_ODD;
        if let Some([restitution, _]) = self.restitutions(whole)[segments.clone()].iter().flatten().find(odd) {
            return Some(format!(
                "one of its bounces would have a restitution of {restitution:.2}, far from the scene's {:.2}: check the \
                 camera, the scene's heights and the frame rate",
                self.rigid.restitution
            ));
        }
        // The forces, what begins the first flight, and each contact by itself; then all together.
        let own = prior_chi2[..1].iter().chain(&prior_chi2[1 + segments.start..1 + segments.end]);
        if let Some((chi2, numbers)) = own.clone().find(|(chi2, numbers)| *chi2 > quantile(*numbers, VERY_ODD)) {
            return Some(format!(
                "it needs a spin or rebound that this ball is very unlikely to have (χ² {chi2:.0} for \
                                 {numbers} parameters)"
            ));
        }
        let (chi2, numbers) = own.fold((0.0, 0), |sum, it| (sum.0 + it.0, sum.1 + it.1));
        if chi2 > quantile(numbers, ODD) {
            return Some(format!(
                "it needs a spin or rebound that this ball is very unlikely to have (χ² {chi2:.0} for \
                                 {numbers} parameters)"
            ));
        }
        None
    }

    /// The reason if a flight's distance is not known, by its frames and the σ of each that counts.
    fn unknown(&self, frames: &[(&FittedFrame, f64)], is_by_camera: bool) -> Option<String> {
        let origin = self.observations.iter().find_map(|it| it.ray.as_ref())?.origin;
        let seen = frames.iter().filter(|(frame, _)| frame.residual_px.is_some());
        let distance = |frame: &FittedFrame| (frame.world.coords - origin).norm();
        let mut fractions: Vec<(f64, f64)> = seen.map(|(frame, sigma)| (sigma / distance(frame), *sigma)).collect();
        fractions.sort_by(|a, b| a.0.total_cmp(&b.0));
        let &(fraction, sigma) = fractions.get(fractions.len() / 2)?;
        (fraction > UNKNOWN).then(|| {
            let why = match is_by_camera {
                true => "the camera is not known well enough; calibrate it with more points, farther apart",
                false => "its spin is unknown, and it touches nothing in the scene",
            };
            format!("the ball's distance is unknown (±{sigma:.1} m): {why}")
        })
    }

    /// Adds to a position's covariance that nobody knows where it is: the laws do not hold, or the camera is another.
    pub fn widen(&self, frame: &mut FittedFrame) {
        let Some(ray) = self.observations.iter().find_map(|it| it.ray.as_ref()) else { return };
        let off = DISTANCE_UNKNOWN * (frame.world.coords - ray.origin).norm();
        frame.spread(&(Matrix3::identity() * (off * off / 3.0)));
    }
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

#[cfg(test)]
mod tests {
    use gravisight_geometry::camera::{KnownOfCamera, assumed_camera};
    use gravisight_geometry::size::Size;
    use gravisight_physics::{Forecaster, Scene};
    use nalgebra::{Point3, Vector3};

    use crate::{Fit, FitOptions, Observation};

    /// A throw before a phone that is assumed, by its labels and sizes.
    fn thrown(camera_assumed: bool) -> Fit {
        let assumed = assumed_camera(Size::new(1920, 1080), &KnownOfCamera::default()).unwrap();
        let mut scene = Scene::named("free").unwrap();
        scene.ball.radius = 0.0335;
        let observation = |frame: u32| {
            let time = f64::from(frame) / 30.0;
            let fallen = Vector3::new(1.2, 0.3, 3.0) * time + 0.5 * time * time * Vector3::from(scene.gravity);
            let ball = assumed.camera.camera_from_world(&(Point3::new(-0.6, 3.0, 1.4) + fallen));
            let outline = assumed.camera.outline(&ball, 0.0335).unwrap();
            // Labels are never exact.
            let off = 0.3 * f64::from(1 - 2 * i32::try_from(frame % 2).unwrap());
            Observation {
                time,
                image: Some([outline.centre.x + off, outline.centre.y - off].into()),
                radius: Some([outline.radius, 0.3]),
            }
        };
        let observations: Vec<Observation> = (0..20).map(observation).collect();
        let options = FitOptions { cameras: assumed.one_sigma, camera_assumed, ..FitOptions::default() };
        Forecaster::new(&scene).unwrap().fit(&assumed.camera, &observations, &options).unwrap()
    }

    #[test]
    fn an_assumed_camera_makes_a_flight_less_sure_and_rejects_none() {
        let [measured, assumed] = [thrown(false), thrown(true)];
        assert!(measured.flights[0].reason.as_ref().unwrap().contains("the camera is not known well enough"));
        assert!(assumed.explained, "{:?}", assumed.flights[0].reason);
        let frame = &assumed.frames[10];
        assert!(frame.sigma > 0.06 * 3.0 && (frame.sigma - measured.frames[10].sigma).abs() < 1e-9);
        let speed = Vector3::<f64>::new(1.2, 0.3, 3.0).norm();
        let flight = &assumed.flights[0];
        assert!((flight.speed_start - speed).abs() < 2.0 * flight.speed_sigma, "{} {speed}", flight.speed_start);
        // Gravity gives the upward speed, whatever the focal length: 9 % of distance is 2 % of speed.
        assert!((0.01..0.05).contains(&(flight.speed_sigma / speed)), "{}", flight.speed_sigma);
    }
}
