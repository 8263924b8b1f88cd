//! How segments are tied: by continuity, and by the law of the contact between them.

use nalgebra::{Matrix3, SMatrix, SVector, Vector1, Vector3};

use super::model::{LAW_STEP, Loss, Model, START_HELD, huber};
use super::normal::BlockNormal;
use super::trajectory::{Begin, OF_SEGMENT, SHARED, Segment, Span, Trajectory};
use gravisight_physics::{Column, FORCES, FreeFlight, Obstacle, Sensitivity, part};

/// Weight of a gain of energy, which no contact has: two standard deviations of any speed's are as odd as one case in a thousand.
const GAINED: f64 = 1.5;
/// Residual of a contact that lasts, in standard deviations, from which on it counts less.
const LASTING_LIMIT: f64 = 4.0;

/// How loosely a contact keeps its law: standard deviations of the velocity along the normal and across it, and of the spin.
#[derive(Debug, Clone, Copy)]
pub struct ContactNoise {
    pub normal: Vector3<f64>,
    pub along: f64,
    pub across: f64,
    pub spin: f64,
    pub closing: f64,
}

/// A segment's end.
pub(super) struct Arrival<'a> {
    pub segment: usize,
    pub flight: FreeFlight<'a>,
    /// When its free flight ends, s.
    pub end: f64,
}

/// Cost of a squared residual of a contact that lasts (in standard deviations), and its derivative: most are the model's, some (at an edge)
/// far from it.
fn lasting_cost(square: f64, loss: Loss) -> (f64, f64) {
    let limit = LASTING_LIMIT * LASTING_LIMIT;
    match loss {
        Loss::Growing => huber(square, LASTING_LIMIT),
        Loss::Mixture => (limit * (square / limit).ln_1p(), 1.0 / (1.0 + square / limit)),
    }
}

impl Model<'_> {
    /// How far a trajectory is from what is known before anything is seen, in squared standard deviations, and of how many numbers:
    /// of its forces, of each segment's beginning.
    pub fn prior_chi2(&self, trajectory: &Trajectory) -> Vec<(f64, usize)> {
        let scales = trajectory.log_scales.iter().zip(&self.scale_sigmas);
        let forces: f64 = scales.map(|(value, sigma)| (value / sigma).powi(2)).sum();
        let size = trajectory.log_size / self.config.size_sigma;
        let mut all = vec![(forces + size * size, 1 + self.forecaster.scale_sigmas().count())];
        let spin = |segment: &Segment| match segment.begin {
            Begin::Start => ((part(&segment.state, 2) - self.spin.0) / self.spin.1).norm_squared(),
            _ => (part(&segment.state, 2) / self.hit_spin).norm_squared(),
        };
        let lasting = |index: usize, noise: &ContactNoise| {
            let (_, passed) = self.through_lasting(trajectory, index - 1)?;
            let off = |which: usize| part(&trajectory.segments[index].state, which) - part(&passed, which);
            let sigmas = [self.config.lasting[0], noise.along, noise.spin];
            let square = (0..3).map(|which| (off(which) / sigmas[which]).norm_squared()).sum();
            Some(lasting_cost(square, Loss::Mixture).0)
        };
        for (index, (segment, noise)) in
            trajectory.segments.iter().zip(self.contact_noises(trajectory, &trajectory.all())).enumerate()
        {
            if let (Begin::LastingContact, Some(noise)) = (segment.begin, &noise) {
                all.push((lasting(index, noise).unwrap_or(f64::INFINITY), 9));
                continue;
            }
            let (Begin::Bounce(obstacle), Some(noise)) = (segment.begin, noise) else {
                all.push((spin(segment), 3));
                continue;
            };
            let arrived = self.arrival(trajectory, index - 1);
            let near = self.obstacles[obstacle].nearest(&segment.position());
            let (v, w) = self.rigid.rebound(&near.normal, &part(&arrived, 1), &part(&arrived, 2));
            let off = segment.velocity() - v;
            let along = noise.normal.dot(&off);
            let across = (off - noise.normal * along).norm() / noise.across;
            let gap = (near.distance - self.rigid.radius) / self.config.surface;
            let spin_residual = (part(&segment.state, 2) - w).norm() / noise.spin;
            all.push(((along / noise.along).powi(2) + across * across + gap * gap + spin_residual * spin_residual, 7));
        }
        all
    }

    /// Of each contact the restitution that it would have, and by how many standard deviations that is not the scene's, or more than that
    /// no energy is gained.
    pub fn restitutions(&self, trajectory: &Trajectory) -> Vec<Option<[f64; 2]>> {
        let of = |(index, (segment, noise)): (usize, (&Segment, Option<ContactNoise>))| {
            let noise = noise.filter(|_| segment.begin != Begin::LastingContact)?;
            let arrived = part(&self.arrival(trajectory, index.checked_sub(1)?), 1);
            let [before, after] = [-noise.normal.dot(&arrived), noise.normal.dot(&segment.velocity())];
            let off = (after - self.rigid.restitution * before) / noise.along;
            let gained = GAINED * (after - before) / self.config.contact_speed;
            Some([after / before, if gained > off.abs() { gained } else { off }])
        };
        trajectory.segments.iter().zip(self.contact_noises(trajectory, &trajectory.all())).enumerate().map(of).collect()
    }

    /// Adds how a segment goes on from the one before.
    pub(super) fn add_link(
        &self,
        arrival: &Arrival,
        next: &Segment,
        (span, noise, loss): (&Span, Option<ContactNoise>, Loss),
        sums: &mut BlockNormal,
    ) -> Option<()> {
        if next.begin == Begin::LastingContact {
            return self.add_lasting_contact(arrival, next, (span, noise?, loss), sums);
        }
        let flight = &arrival.flight;
        let (velocity, acceleration) = flight.slope();
        let blocks = Blocks::new(arrival, &velocity, &acceleration, span);
        // Continuity.
        let off = (next.position() - part(&flight.state, 0)) / self.config.continuity;
        let scale = self.config.continuity.recip();
        let position = blocks.end(0) * -scale;
        let mut own = SMatrix::<f64, 3, OF_SEGMENT>::zeros();
        own.fixed_view_mut::<3, 1>(0, 0).copy_from(&(velocity * -scale));
        own.fixed_view_mut::<3, 3>(0, 1).copy_from(&(Matrix3::identity() * scale));
        blocks.add(sums, &off, position, own, arrival.flight_shared(0) * -scale);
        let (Begin::Bounce(index), Some(noise)) = (next.begin, noise) else {
            let sigma = self.config.speed;
            let mut own = SMatrix::<f64, 3, OF_SEGMENT>::zeros();
            own.fixed_view_mut::<3, 3>(0, 4).copy_from(&(Matrix3::identity() / sigma));
            blocks.alone(sums, &(next.velocity() / sigma), own);
            let mut own = SMatrix::<f64, 3, OF_SEGMENT>::zeros();
            own.fixed_view_mut::<3, 3>(0, 7).copy_from(&(Matrix3::identity() / self.hit_spin));
            blocks.alone(sums, &(part(&next.state, 2) / self.hit_spin), own);
            let inverse = self.place.1.map(f64::recip);
            let mut own = SMatrix::<f64, 3, OF_SEGMENT>::zeros();
            own.fixed_view_mut::<3, 3>(0, 1).copy_from(&Matrix3::from_diagonal(&inverse));
            blocks.alone(sums, &(next.position() - self.place.0).component_mul(&inverse), own);
            return Some(());
        };
        // The contact.
        let obstacle = &self.obstacles[index];
        let near = obstacle.nearest(&next.position());
        let mut own = SMatrix::<f64, 1, OF_SEGMENT>::zeros();
        own.fixed_view_mut::<1, 3>(0, 1).copy_from(&(near.normal.transpose() / self.config.surface));
        blocks.alone(sums, &Vector1::new((near.distance - self.rigid.radius) / self.config.surface), own);
        let (n, along, across) = (noise.normal, noise.along.recip(), noise.across.recip());
        let weigh_velocity = Matrix3::identity() * across + n * n.transpose() * (along - across);
        let weigh = [weigh_velocity, Matrix3::identity() / noise.spin];
        // The law at the arrival's velocity and spin, and at the next one's place.
        let arrived = [1, 2].map(|index| part(&flight.state, index));
        let law = |place: &Vector3<f64>, v: &Vector3<f64>, w: &Vector3<f64>| {
            let (v, w) = self.rigid.rebound(&obstacle.nearest(place).normal, v, w);
            [v, w]
        };
        let (place, [v, w]) = (next.position(), &arrived);
        let after = law(&place, v, w);
        let slope = |which: usize, of: usize| {
            Matrix3::from_fn(|row, axis| {
                let step = Vector3::ith(axis, LAW_STEP[of]);
                let moved = match of {
                    0 => law(&(place + step), v, w),
                    1 => law(&place, &(v + step), w),
                    _ => law(&place, v, &(w + step)),
                };
                (moved[which][row] - after[which][row]) / LAW_STEP[of]
            })
        };
        for (which, weigh) in weigh.into_iter().enumerate() {
            let off = weigh * (part(&next.state, 1 + which) - after[which]);
            let [by_place, by_velocity, by_spin] = [0, 1, 2].map(|of| slope(which, of));
            let end = by_velocity * blocks.end(1) + by_spin * blocks.end(2);
            let shared = by_velocity * arrival.flight_shared(1);
            let mut own = SMatrix::<f64, 3, OF_SEGMENT>::zeros();
            own.fixed_view_mut::<3, 1>(0, 0).copy_from(&(weigh * by_velocity * acceleration * -1.0));
            own.fixed_view_mut::<3, 3>(0, 1).copy_from(&(weigh * by_place * -1.0));
            own.fixed_view_mut::<3, 3>(0, 4 + 3 * which).copy_from(&weigh);
            blocks.add(sums, &off, weigh * end * -1.0, own, weigh * shared * -1.0);
        }
        Some(())
    }

    /// Adds that a segment begins where the forecaster leads the one before, through a contact that lasts; none where it leads nowhere.
    fn add_lasting_contact(
        &self,
        arrival: &Arrival,
        next: &Segment,
        (span, noise, loss): (&Span, ContactNoise, Loss),
        sums: &mut BlockNormal,
    ) -> Option<()> {
        let flight = &arrival.flight;
        let (velocity, acceleration) = flight.slope();
        let blocks = Blocks::new(arrival, &velocity, &acceleration, span);
        let passed = self.forecaster.transition::<9>(&flight.state, next.time - arrival.end)?;
        let sigmas = [self.config.lasting[0], noise.along, noise.spin];
        let weigh = SVector::<f64, 9>::from_fn(|row, _| sigmas[row / 3].recip());
        let off = SVector::<f64, 9>::from_fn(|row, _| weigh[row] * (next.state[row] - passed.end[row]));
        let (cost, weight) = lasting_cost(off.norm_squared(), loss);
        let slope = SMatrix::<f64, 9, 9>::from_diagonal(&-weigh) * passed.jacobian;
        let mut before = SMatrix::<f64, 9, OF_SEGMENT>::zeros();
        let mut shared = SMatrix::<f64, 9, SHARED>::zeros();
        for which in 0..3 {
            let part = slope.fixed_view::<9, 3>(0, 3 * which);
            before += part * blocks.end(which);
            if which < 2 {
                shared += part * arrival.flight_shared(which);
            }
        }
        let mut own = SMatrix::<f64, 9, OF_SEGMENT>::zeros();
        (0..9).for_each(|row| own[(row, 1 + row)] = weigh[row]);
        blocks.add_weighed((cost, weight), sums, &off, (before, own, shared));
        // It begins with a frame.
        let mut own = SMatrix::<f64, 1, OF_SEGMENT>::zeros();
        own[0] = START_HELD;
        blocks.alone(sums, &Vector1::zeros(), own);
        Some(())
    }

    /// The state to which the forecaster leads the segment before one that begins by a contact that lasts.
    fn through_lasting(&self, trajectory: &Trajectory, before: usize) -> Option<(Column, Column)> {
        let arrived = self.arrival(trajectory, before);
        let dt = trajectory.segments[before + 1].time - trajectory.end_of_flight(before);
        Some((arrived, self.forecaster.transition::<6>(&arrived, dt)?.end))
    }

    /// How loosely the contacts of a span of a trajectory, and the one after it, keep their law, one a segment; none of a segment that
    /// does not begin by one.
    pub fn contact_noises(&self, trajectory: &Trajectory, span: &Span) -> Vec<Option<ContactNoise>> {
        let of = |(index, segment): (usize, &Segment)| {
            let before = index.checked_sub(1).filter(|_| (span.start..=span.end).contains(&index))?;
            if segment.begin == Begin::LastingContact {
                let (arrived, left) = self.through_lasting(trajectory, before)?;
                return Some(self.lasting_noise(&arrived, &left));
            }
            let Begin::Bounce(obstacle) = segment.begin else { return None };
            let arrived = self.arrival(trajectory, before);
            Some(self.contact_noise(&self.obstacles[obstacle], &segment.position(), &arrived))
        };
        trajectory.segments.iter().enumerate().map(of).collect()
    }

    /// How loosely a contact that lasts changes a state.
    fn lasting_noise(&self, arriving: &Column, leaving: &Column) -> ContactNoise {
        let change = |which: usize| (part(leaving, which) - part(arriving, which)).norm();
        let ([_, speed, spin], by) = (self.config.lasting, self.config.lasting_fractions);
        let (along, spin) = (speed + by[0] * change(1), spin + by[1] * change(2));
        ContactNoise { normal: Vector3::zeros(), along, across: along, spin, closing: 0.0 }
    }

    pub fn contact_noise(&self, obstacle: &Obstacle, place: &Vector3<f64>, arriving: &Column) -> ContactNoise {
        let normal = obstacle.nearest(place).normal;
        let (v, w) = (part(arriving, 1), part(arriving, 2));
        let closing = -normal.dot(&v);
        let (_, after) = self.rigid.rebound(&normal, &v, &w);
        let across = self.friction_sigma * closing.abs() + self.config.contact_speed;
        let spin = 2.0 * across / self.rigid.radius + self.config.contact_spin * (after - w).norm();
        let along = self.restitution_sigma * closing.abs() + self.config.contact_speed;
        ContactNoise { normal, along, across, spin, closing }
    }
}

impl Arrival<'_> {
    /// Derivative of position or velocity there by the shared numbers.
    fn flight_shared(&self, which: usize) -> SMatrix<f64, 3, SHARED> {
        let all: &Sensitivity = [&self.flight.position, &self.flight.velocity][which];
        let mut shared = SMatrix::<f64, 3, SHARED>::zeros();
        shared.fixed_view_mut::<3, FORCES>(0, 0).copy_from(&all.fixed_view::<3, FORCES>(0, 9));
        shared
    }
}

/// Adds residuals that tie two segments, of which one may be one that stays.
struct Blocks {
    /// Of the earlier one, and of the later one; none where it stays.
    before: Option<usize>,
    after: Option<usize>,
    /// Derivatives of position, velocity and spin at the earlier one's end by its numbers.
    ends: [SMatrix<f64, 3, OF_SEGMENT>; 3],
}

impl Blocks {
    fn new(arrival: &Arrival, velocity: &Vector3<f64>, acceleration: &Vector3<f64>, span: &Span) -> Self {
        let flight = &arrival.flight;
        let of = |sensitivity: &Sensitivity, slope: &Vector3<f64>| {
            let mut end = SMatrix::<f64, 3, OF_SEGMENT>::zeros();
            end.fixed_view_mut::<3, 1>(0, 0).copy_from(&-slope);
            end.fixed_view_mut::<3, 9>(0, 1).copy_from(&sensitivity.fixed_view::<3, 9>(0, 0));
            end
        };
        let mut spin = SMatrix::<f64, 3, OF_SEGMENT>::zeros();
        spin.fixed_view_mut::<3, 3>(0, 7).copy_from(&(Matrix3::identity() * flight.spin));
        let ends = [of(&flight.position, velocity), of(&flight.velocity, acceleration), spin];
        let block = |segment: usize| span.contains(&segment).then(|| segment - span.start);
        Self { before: block(arrival.segment), after: block(arrival.segment + 1), ends }
    }

    fn end(&self, which: usize) -> SMatrix<f64, 3, OF_SEGMENT> {
        self.ends[which]
    }

    fn add<const R: usize>(
        &self,
        sums: &mut BlockNormal,
        residual: &SVector<f64, R>,
        before: SMatrix<f64, R, OF_SEGMENT>,
        after: SMatrix<f64, R, OF_SEGMENT>,
        shared: SMatrix<f64, R, SHARED>,
    ) {
        self.add_weighed((residual.norm_squared(), 1.0), sums, residual, (before, after, shared));
    }

    /// The same with a cost that is not the square's, and its derivative by that.
    fn add_weighed<const R: usize>(
        &self,
        (cost, weight): (f64, f64),
        sums: &mut BlockNormal,
        residual: &SVector<f64, R>,
        (before, after, shared): (SMatrix<f64, R, OF_SEGMENT>, SMatrix<f64, R, OF_SEGMENT>, SMatrix<f64, R, SHARED>),
    ) {
        let both = [(self.before.unwrap_or(0), before), (self.after.unwrap_or(0), after)];
        let parts = match (self.before, self.after) {
            (Some(_), Some(_)) => &both[..],
            (Some(_), None) => &both[..1],
            (None, Some(_)) => &both[1..],
            (None, None) => &[],
        };
        sums.add(cost, weight, residual, parts, &shared);
    }

    fn alone<const R: usize>(
        &self,
        sums: &mut BlockNormal,
        residual: &SVector<f64, R>,
        after: SMatrix<f64, R, OF_SEGMENT>,
    ) {
        if let Some(block) = self.after {
            sums.add(residual.norm_squared(), 1.0, residual, &[(block, after)], &SMatrix::zeros());
        }
    }
}
