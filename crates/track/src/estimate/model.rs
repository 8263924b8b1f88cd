//! What a trajectory has to explain, and what is known before anything is seen: the residuals of the least-squares problem, each
//! with its derivatives.

use nalgebra::{Matrix3, SMatrix, Vector1, Vector3};

use super::links::{Arrival, ContactNoise};
use super::net::Net;
use super::normal::BlockNormal;
use super::observation::{HeldDistance, RayObservation, interval};
use super::trajectory::{Begin, OF_SEGMENT, SHARED, Segment, Span, Trajectory};
use crate::config::EstimatorConfig;
use gravisight_physics::{Column, Contact, FORCES, Forecaster, FreeFlight, Obstacle, Rigid, Scene, part};

/// Step of the differences of a contact's law: m, m/s, rad/s.
pub(super) const LAW_STEP: [f64; 3] = [1e-6, 1e-5, 1e-3];
/// Standard deviation of a spin that the scene gives, rad/s.
const KNOWN_SPIN: f64 = 1e-3;
/// Where the scene does not say more: speed of the ball's surface by a spin of one standard deviation, m/s; of a bounce's normal and
/// tangential speed, fractions of the closing speed.
const SPIN_SPEED: f64 = 4.0;
pub(super) const RESTITUTION: f64 = 0.07;
const FRICTION: f64 = 0.2;
/// Residual, in standard deviations, from which on a barrier pulls with the same force.
const BARRIER: f64 = 3.0;
/// How far beyond what a scene describes its ball is found, and how far from the camera in a scene that describes nothing, m:
/// standard deviations.
const BEYOND: f64 = 2.0;
const FAR: f64 = 30.0;
/// How firmly the first segment begins when it begins, 1/s.
pub(super) const START_HELD: f64 = 1e6;
/// How exactly a sport's fastest ball is known, a fraction of its speed.
const SPEED_LIMIT: f64 = 0.03;
/// Least variance of labels, px².
const SMALLEST_NOISE: f64 = 1e-3;
/// Least closing speed of a contact, m/s: of a ball that rolls.
const SLOWEST_CLOSING: f64 = 0.05;

/// What large residuals of labels cost.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Loss {
    /// Huber's: pulls from afar.
    Growing,
    /// The mixture of labels' noise, rough labels and strays.
    Mixture,
}

/// A track, its scene, and what is known of both.
pub struct Model<'a> {
    pub forecaster: &'a Forecaster,
    pub rigid: Rigid,
    pub obstacles: Vec<Obstacle>,
    pub nets: Vec<Net>,
    /// Whether contacts take time, and the forecaster leads through them.
    pub lasting: bool,
    pub observations: &'a [RayObservation],
    /// None but for the profile of a distance.
    pub held: Option<HeldDistance>,
    /// Of the picture, px².
    pub area: f64,
    /// Standard deviation of the labels where it was given, px.
    pub noise: Option<f64>,
    pub config: EstimatorConfig,
    /// Standard deviation by which errors that last over frames make labels seem noisier, px.
    pub drift: f64,
    /// The same of the labels by their smoothness alone, or as given, px.
    pub smooth: f64,
    /// Where a flight begins before anything is seen: mean and standard deviations along the axes, m.
    pub place: (Vector3<f64>, Vector3<f64>),
    /// Mean of each component of the spin, and its standard deviation, rad/s.
    pub(super) spin: (Vector3<f64>, f64),
    /// Speed that no ball of its sport exceeds, m/s.
    pub(super) speed_max: f64,
    /// Standard deviation of each component of the spin after a hit, rad/s.
    pub(super) hit_spin: f64,
    pub(super) scale_sigmas: [f64; FORCES],
    pub(super) restitution_sigma: f64,
    pub(super) friction_sigma: f64,
}

impl<'a> Model<'a> {
    /// The picture has an `area` (px²), labels are noisy by `smooth` px by themselves, and one of their clock's seconds is `clock` of the
    /// observations'.
    pub fn new(
        forecaster: &'a Forecaster,
        observations: &'a [RayObservation],
        [area, smooth, clock]: [f64; 3],
        noise: Option<f64>,
        config: EstimatorConfig,
    ) -> Self {
        let scene = forecaster.scene();
        let (lasting, [restitution, friction], [restitution_sigma, friction_sigma]) = match scene.contact {
            Contact::Bounce { restitution, friction, restitution_sigma, friction_sigma } => {
                (false, [restitution, friction], [restitution_sigma, friction_sigma])
            }
            _ => (true, [1.0, 0.0], [None; 2]),
        };
        let ball = &scene.ball;
        let mut scale_sigmas = [1e-4; FORCES];
        forecaster.scale_sigmas().zip(&mut scale_sigmas).for_each(|((_, sigma), out)| *out = sigma);
        let hit_spin = ball.spin_sigma.unwrap_or(SPIN_SPEED / ball.radius);
        let spin_sigma = if ball.spin == [0.0; 3] { hit_spin } else { KNOWN_SPIN };
        let labelled = observations.iter().filter(|it| it.ray.is_some()).map(|it| it.time);
        Self {
            forecaster,
            rigid: Rigid { radius: ball.radius, restitution, friction, inertia_factor: ball.inertia_factor },
            // What presses on a ball for a while lets it in: the forecaster says how far.
            obstacles: if lasting { vec![] } else { Obstacle::of(scene) },
            nets: Net::of(scene),
            lasting,
            observations,
            held: None,
            area,
            noise,
            config,
            smooth,
            drift: (config.drift / (clock * interval(labelled))).sqrt(),
            place: place_of(scene, observations),
            spin: (ball.spin.into(), spin_sigma),
            speed_max: ball.speed_max.unwrap_or(f64::INFINITY),
            hit_spin,
            scale_sigmas,
            restitution_sigma: restitution_sigma.unwrap_or(RESTITUTION),
            friction_sigma: friction_sigma.unwrap_or(FRICTION),
        }
    }

    /// The same of other observations.
    pub fn with_observations<'b>(&self, observations: &'b [RayObservation]) -> Model<'b>
    where
        'a: 'b,
    {
        Model { observations, obstacles: self.obstacles.clone(), nets: self.nets.clone(), ..*self }
    }

    pub fn gravity(&self) -> Vector3<f64> {
        self.forecaster.scene().gravity.into()
    }

    pub fn spin_sigma(&self) -> f64 {
        self.spin.1
    }

    /// Cost of a label's squared residual (in standard deviations) over that of one that is met, and its derivative.
    pub fn label_cost(&self, square: f64, noise: f64, loss: Loss) -> (f64, f64) {
        let config = &self.config;
        if loss == Loss::Growing {
            return huber(square, BARRIER);
        }
        let good = self.good_fraction() * (-square / 2.0).exp();
        let stray = config.stray_fraction * std::f64::consts::TAU * noise * noise / self.area;
        let (mut all, mut slope) = (good + stray, good);
        for [fraction, factor] in config.rough {
            let wide = factor * factor;
            let rough = fraction / wide * (-square / (2.0 * wide)).exp();
            all += rough;
            slope += rough / wide;
        }
        (-2.0 * (all / self.met(noise)).ln(), slope / all)
    }

    /// Fraction of the labels that are neither rough nor strays.
    fn good_fraction(&self) -> f64 {
        1.0 - self.config.stray_fraction - self.config.rough.iter().map(|[fraction, _]| fraction).sum::<f64>()
    }

    /// Density of a label that is met, times 2πσ².
    fn met(&self, noise: f64) -> f64 {
        let config = &self.config;
        let rough = config.rough.iter().map(|[fraction, factor]| fraction / (factor * factor)).sum::<f64>();
        self.good_fraction() + rough + config.stray_fraction * std::f64::consts::TAU * noise * noise / self.area
    }

    /// What a label that is met costs: −2 ln of its density, px⁻².
    pub fn label_constant(&self, noise: f64) -> f64 {
        -2.0 * (self.met(noise) / (std::f64::consts::TAU * noise * noise)).ln()
    }

    /// The noise that the squared residuals (px²) of labels with these weights tell, and what was expected.
    pub fn noise_of(&self, squares: &[(f64, f64)]) -> f64 {
        if let Some(noise) = self.noise {
            return noise.hypot(self.drift);
        }
        let (expected, weight) = (self.config.noise_px, 2.0 * self.config.noise_weight);
        let sum: f64 = squares.iter().map(|(square, weight)| square * weight).sum();
        let count: f64 = squares.iter().map(|(_, weight)| 2.0 * weight).sum();
        ((weight * expected * expected + sum) / (weight + 2.0 + count)).sqrt().hypot(self.drift)
    }

    /// What a noise costs by what was expected of it (an inverse gamma distribution of its square).
    pub fn noise_cost(&self, noise: f64) -> f64 {
        if self.noise.is_some() {
            return 0.0;
        }
        let (expected, weight) = (self.config.noise_px, 2.0 * self.config.noise_weight);
        let square = (noise * noise - self.drift * self.drift).max(SMALLEST_NOISE) / (expected * expected);
        (weight + 2.0) * square.ln() + weight / square
    }

    /// Adds up all residuals of the segments of `span`, of how they are tied to those before and after, which stay, and of what is
    /// shared; none where the ball is behind the camera. Contacts keep their law as loosely as `noises` say, one a segment. `squares`:
    /// of the labels, px², and their weights.
    pub fn add(
        &self,
        trajectory: &Trajectory,
        (span, loss): (&Span, Loss),
        noises: &[Option<ContactNoise>],
        sums: &mut BlockNormal,
        squares: &mut Vec<(f64, f64)>,
    ) -> Option<()> {
        let segments = &trajectory.segments;
        let mut arrival = None;
        for index in span.start.saturating_sub(1)..(span.end + 1).min(segments.len()) {
            let segment = &segments[index];
            if let Some(arrival) = &arrival {
                self.add_link(arrival, segment, (span, noises[index], loss), sums)?;
            }
            if index == span.end {
                break;
            }
            let mut flight = self.forecaster.flight(&segment.state, &trajectory.log_scales, !sums.cost_only());
            let mut time = segment.time;
            if span.contains(&index) {
                self.add_speed_limit(segment, index - span.start, sums);
                let mut before = segment.position();
                for frame in trajectory.frames(index) {
                    let next = trajectory.times[frame];
                    flight.advance(next - time);
                    time = next;
                    self.add_frame(trajectory, frame, &flight, index - span.start, loss, sums, squares)?;
                    self.add_nets(&before, &flight, index - span.start, sums);
                    before = part(&flight.state, 0);
                }
            }
            arrival = match segments.get(index + 1) {
                Some(_) => {
                    flight.advance(trajectory.end_of_flight(index) - time);
                    Some(Arrival { segment: index, flight, end: trajectory.end_of_flight(index) })
                }
                None => None,
            };
        }
        self.add_priors(trajectory, span.start, sums);
        sums.is_finite().then_some(())
    }

    /// Adds that a ball is no faster than its sport's.
    fn add_speed_limit(&self, segment: &Segment, block: usize, sums: &mut BlockNormal) {
        let velocity = segment.velocity();
        let speed = velocity.norm();
        if speed > self.speed_max {
            let sigma = SPEED_LIMIT * self.speed_max;
            let residual = Vector1::new((speed - self.speed_max) / sigma);
            let mut own = SMatrix::<f64, 1, OF_SEGMENT>::zeros();
            own.fixed_view_mut::<1, 3>(0, 4).copy_from(&(velocity.transpose() / (speed * sigma)));
            sums.add(residual.norm_squared(), 1.0, &residual, &[(block, own)], &SMatrix::zeros());
        }
    }

    /// Adds that a ball does not go through a net on its way from `before`.
    fn add_nets(&self, before: &Vector3<f64>, flight: &FreeFlight, block: usize, sums: &mut BlockNormal) {
        for through in self.nets.iter().filter_map(|net| net.through(before, &part(&flight.state, 0))) {
            let excess = through.below - self.config.depth;
            if excess > 0.0 {
                let residual = Vector1::new(excess / self.config.depth_sigma);
                let (cost, weight) = huber(residual.norm_squared(), BARRIER);
                let slope = through.slope.transpose().scale(self.config.depth_sigma.recip());
                let (own, shared) = by_numbers(flight, &slope);
                sums.add(cost, weight, &residual, &[(block, own)], &shared);
            }
        }
    }

    #[allow(clippy::too_many_arguments)]
    fn add_frame(
        &self,
        trajectory: &Trajectory,
        frame: usize,
        flight: &FreeFlight,
        block: usize,
        loss: Loss,
        sums: &mut BlockNormal,
        squares: &mut Vec<(f64, f64)>,
    ) -> Option<()> {
        let (observation, position) = (&self.observations[frame], part(&flight.state, 0));
        let barrier = |sums: &mut BlockNormal, excess: f64, slope: Vector3<f64>, sigma: f64| {
            let residual = Vector1::new(excess / sigma);
            let (cost, weight) = huber(residual.norm_squared(), BARRIER);
            let (own, shared) = by_numbers(flight, &slope.transpose().scale(sigma.recip()));
            sums.add(cost, weight, &residual, &[(block, own)], &shared);
        };
        if let Some(ray) = &observation.ray {
            let (residual, jacobian) = ray.residual(&position)?;
            let noise = trajectory.noise;
            let square = residual.norm_squared();
            let (cost, weight) = self.label_cost(square / (noise * noise), noise, loss);
            squares.push((square, weight));
            let (own, shared) = by_numbers(flight, &(jacobian / noise));
            sums.add(cost, weight, &(residual / noise), &[(block, own)], &shared);
            // What is seen is not behind anything.
            let hidden = |at: &Vector3<f64>| self.obstacles.iter().map(|it| it.between(&ray.origin, at)).sum::<f64>();
            let depth = hidden(&position);
            if depth > 0.0 {
                let slope = Vector3::from_fn(|axis, _| {
                    (hidden(&(position + Vector3::ith(axis, LAW_STEP[0]))) - depth) / LAW_STEP[0]
                });
                barrier(sums, depth, slope, self.config.hidden_sigma);
            }
            let off = position - ray.origin;
            let distance = off.norm();
            let by_distance =
                |sigma: f64| by_numbers(flight, &(off.transpose() * (-1.0 / (distance * distance * sigma))));
            if let Some([log_distance, sigma]) = observation.log_distance {
                let residual = Vector1::new((log_distance - trajectory.log_size - distance.ln()) / sigma);
                let (cost, weight) = self.size_cost(residual.x * residual.x);
                let (own, mut shared) = by_distance(sigma);
                shared[(0, FORCES)] = -1.0 / sigma;
                sums.add(cost, weight, &residual, &[(block, own)], &shared);
            }
            if let Some(HeldDistance { log_distance, sigma, .. }) = self.held.filter(|held| held.frame == frame) {
                let residual = Vector1::new((log_distance - distance.ln()) / sigma);
                let (own, shared) = by_distance(sigma);
                sums.add(residual.norm_squared(), 1.0, &residual, &[(block, own)], &shared);
            }
        }
        let nearest = |obstacle: &Obstacle| obstacle.nearest(&position);
        let deepest = self.obstacles.iter().map(nearest).min_by(|a, b| a.distance.total_cmp(&b.distance));
        if let Some(near) = deepest {
            let excess = self.rigid.radius - near.distance - self.config.depth;
            if excess > 0.0 {
                barrier(sums, excess, -near.normal, self.config.depth_sigma);
            }
        }
        Some(())
    }

    /// Cost of a size's squared residual and its derivative: a mixture as the labels', of sizes that are good or anything.
    fn size_cost(&self, square: f64) -> (f64, f64) {
        let [fraction, factor] = self.config.rough[0];
        let stray = fraction / factor;
        let good = (1.0 - fraction) * (-square / 2.0).exp();
        let all = good + stray * (-square / (2.0 * factor * factor)).exp();
        let met = 1.0 - fraction + stray;
        let slow = factor.powi(-2);
        (-2.0 * (all / met).ln(), (good + (all - good) * slow) / all)
    }

    fn add_priors(&self, trajectory: &Trajectory, from: usize, sums: &mut BlockNormal) {
        let first = &trajectory.segments[0];
        if from == 0 {
            let block = |at: usize, sigma: f64| {
                let mut own = SMatrix::<f64, 3, OF_SEGMENT>::zeros();
                own.fixed_view_mut::<3, 3>(0, at).copy_from(&(Matrix3::identity() / sigma));
                own
            };
            let none = SMatrix::<f64, 3, SHARED>::zeros();
            let spin = (part(&first.state, 2) - self.spin.0) / self.spin.1;
            sums.add(spin.norm_squared(), 1.0, &spin, &[(0, block(7, self.spin.1))], &none);
            let inverse = self.place.1.map(f64::recip);
            let place = (first.position() - self.place.0).component_mul(&inverse);
            let mut own = SMatrix::<f64, 3, OF_SEGMENT>::zeros();
            own.fixed_view_mut::<3, 3>(0, 1).copy_from(&Matrix3::from_diagonal(&inverse));
            sums.add(place.norm_squared(), 1.0, &place, &[(0, own)], &none);
            let velocity = first.velocity() / self.config.speed;
            sums.add(velocity.norm_squared(), 1.0, &velocity, &[(0, block(4, self.config.speed))], &none);
            // The first segment begins at its own time; the labels determine where.
            let mut own = SMatrix::<f64, 1, OF_SEGMENT>::zeros();
            own[0] = START_HELD;
            sums.add(0.0, 1.0, &Vector1::zeros(), &[(0, own)], &SMatrix::zeros());
        }
        for index in 0..SHARED {
            let (value, sigma) = match trajectory.log_scales.get(index) {
                Some(&value) => (value, self.scale_sigmas[index]),
                None => (trajectory.log_size, self.config.size_sigma),
            };
            let mut shared = SMatrix::<f64, 1, SHARED>::zeros();
            shared[index] = sigma.recip();
            let residual = Vector1::new(value / sigma);
            sums.add(residual.norm_squared(), 1.0, &residual, &[], &shared);
        }
    }

    /// −2 ln of the densities that the priors of the contacts and hits of a span are normalised by, and of there being these hits.
    pub fn structure_cost(&self, trajectory: &Trajectory, span: &Span, noises: &[Option<ContactNoise>]) -> f64 {
        let config = &self.config;
        let ln = |sigma: f64| 2.0 * sigma.ln();
        let mut cost = 0.0;
        let begins = trajectory.segments.iter().map(|segment| segment.begin).zip(noises).enumerate();
        for (_, (begin, noise)) in begins.filter(|(index, _)| (span.start.max(1)..=span.end).contains(index)) {
            cost += 3.0 * ln(config.continuity);
            cost += match (begin, noise) {
                (Begin::Bounce(_), Some(noise)) => {
                    let closing = noise.closing.max(SLOWEST_CLOSING);
                    ln(config.surface) - ln(closing) + ln(noise.along) + 2.0 * ln(noise.across) + 3.0 * ln(noise.spin)
                }
                (Begin::LastingContact, Some(noise)) => {
                    3.0 * (ln(noise.along) + ln(noise.spin)) - 3.0 * ln(config.continuity) + 3.0 * ln(config.lasting[0])
                        - self.start_constant()
                }
                _ => {
                    3.0 * ln(config.speed) + 3.0 * ln(self.hit_spin) - ln(config.hit_rate) - std::f64::consts::TAU.ln()
                }
            };
        }
        cost
    }

    /// −2 ln of what normalises the priors of the noise (inverse gamma), the first speed and the sizes: the same for all hypotheses, but not for
    /// all configurations.
    pub fn prior_constant(&self) -> f64 {
        let config = &self.config;
        let weight = 2.0 * config.noise_weight;
        let noise = match self.noise {
            Some(_) => 0.0,
            None => 4.0 * config.noise_px.ln() - weight * (weight / 2.0).ln() + 2.0 * libm::lgamma(weight / 2.0),
        };
        noise + 6.0 * config.speed.ln() + 2.0 * config.size_sigma.ln()
    }

    /// What the time of a start, which is no unknown, adds to a logarithm of a determinant.
    pub fn start_constant(&self) -> f64 {
        2.0 * START_HELD.ln()
    }

    /// −2 ln of the probability that these frames are missing and no others.
    pub fn drop_cost(&self, drops: &[(usize, i32)]) -> f64 {
        // Each one more is half as probable.
        let each = |&(_, frames): &(usize, i32)| self.config.drop_rate * 0.5_f64.powi(frames.abs());
        drops.iter().map(|drop| -2.0 * each(drop).ln()).sum()
    }

    /// The state at the end of a segment's free flight, before what begins the next.
    pub fn arrival(&self, trajectory: &Trajectory, segment: usize) -> Column {
        let from = &trajectory.segments[segment];
        let mut flight = self.forecaster.flight(&from.state, &trajectory.log_scales, false);
        flight.advance(trajectory.end_of_flight(segment) - from.time);
        flight.state
    }
}

/// Where a ball is before anything is seen: about what the scene describes, mean and standard deviations, m; about the camera where it
/// describes nothing.
fn place_of(scene: &Scene, observations: &[RayObservation]) -> (Vector3<f64>, Vector3<f64>) {
    let mut corners: Vec<Vector3<f64>> = scene.landmarks().iter().map(|point| point.coords).collect();
    for cuboid in &scene.boxes {
        let (world_from_box, half) = (cuboid.world_from_box(), Vector3::from(cuboid.half_size));
        let centre = Vector3::from(cuboid.position);
        for axis in 0..3 {
            let arm = world_from_box.column(axis) * half[axis];
            corners.extend([centre + arm, centre - arm]);
        }
    }
    if let Some(bounds) = &scene.bounds {
        corners.extend([Vector3::from(bounds.low), Vector3::from(bounds.high)]);
    }
    let Some(first) = corners.first() else {
        let eye = observations.iter().find_map(|it| it.ray.as_ref()).map_or(Vector3::zeros(), |ray| ray.origin);
        return (eye, Vector3::repeat(FAR));
    };
    let low = corners.iter().fold(*first, |low, corner| low.inf(corner));
    let high = corners.iter().fold(*first, |high, corner| high.sup(corner));
    ((low + high) / 2.0, (high - low) / 2.0 + Vector3::repeat(BEYOND))
}

/// Huber's loss: cost of a squared residual, and its derivative.
pub(super) fn huber(square: f64, limit: f64) -> (f64, f64) {
    if square <= limit * limit {
        return (square, 1.0);
    }
    let size = square.sqrt();
    (2.0 * limit * size - limit * limit, limit / size)
}

/// By what a segment's numbers, and the shared ones, change something that changes with the position by `slope`.
fn by_numbers<const R: usize>(
    flight: &FreeFlight,
    slope: &SMatrix<f64, R, 3>,
) -> (SMatrix<f64, R, OF_SEGMENT>, SMatrix<f64, R, SHARED>) {
    let by_start = slope * flight.position;
    let mut own = SMatrix::<f64, R, OF_SEGMENT>::zeros();
    own.fixed_view_mut::<R, 1>(0, 0).copy_from(&(slope * part(&flight.state, 1) * -1.0));
    own.fixed_view_mut::<R, 9>(0, 1).copy_from(&by_start.fixed_view::<R, 9>(0, 0));
    let mut shared = SMatrix::<f64, R, SHARED>::zeros();
    shared.fixed_view_mut::<R, FORCES>(0, 0).copy_from(&by_start.fixed_view::<R, FORCES>(0, 9));
    (own, shared)
}
