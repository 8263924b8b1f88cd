//! The trajectory near another that explains a track best, and how probable its structure is.

use std::convert::Infallible;

use nalgebra::{SMatrix, SVector};

use super::links::ContactNoise;
use super::model::{Loss, Model};
use super::normal::{BlockNormal, Marginals};
use super::trajectory::{OF_SEGMENT, SHARED, Span, Trajectory};
use gravisight_geometry::least_squares::{Damping, LeastSquares, minimised};

/// Longest steps: s, m, m/s, rad/s, logarithm.
const LONGEST: [f64; 5] = [0.02, 1.0, 10.0, 400.0, 0.3];
/// Number of a segment that is in each of these units.
const UNITS: [usize; OF_SEGMENT] = [0, 1, 1, 1, 2, 2, 2, 3, 3, 3];
const DAMPING: Damping =
    Damping { first: 1e-3, relax: 0.2, least: 1e-9, stiffen: 5.0, most: 1e6, steps: 0, converged: 1e-4 };

/// A trajectory on its way to the least cost.
struct Refinement<'a> {
    model: &'a Model<'a>,
    trajectory: Trajectory,
    /// The segments that are searched; the others stay.
    span: Span,
    loss: Loss,
    noises: Vec<Option<ContactNoise>>,
    cost: f64,
    /// Squared residuals of the labels, px², and their weights.
    squares: Vec<(f64, f64)>,
}

/// A trajectory that explains a track, and how well.
#[derive(Debug, Clone)]
pub struct Hypothesis {
    pub trajectory: Trajectory,
    /// −2 ln of the evidence: of the probability of the labels, given that there are these contacts and hits. Comparable between
    /// hypotheses about the same labels.
    pub cost: f64,
}

impl Refinement<'_> {
    fn sums(&self, cost_only: bool) -> Option<(BlockNormal, Vec<(f64, f64)>)> {
        let mut sums = BlockNormal::new(self.span.len(), cost_only);
        // What is shared is searched with all segments only.
        if self.span != self.trajectory.all() {
            sums.hold_shared();
        }
        let mut squares = Vec::with_capacity(self.trajectory.last - self.trajectory.first + 1);
        self.model.add(&self.trajectory, (&self.span, self.loss), &self.noises, &mut sums, &mut squares)?;
        Some((sums, squares))
    }
}

impl LeastSquares for Refinement<'_> {
    type Normal = BlockNormal;
    type Step = (Vec<SVector<f64, OF_SEGMENT>>, [f64; SHARED]);
    type Error = Infallible;

    fn cost(&self) -> f64 {
        self.cost
    }

    fn linearised(&mut self) -> Result<Option<BlockNormal>, Infallible> {
        self.noises = self.model.contact_noises(&self.trajectory, &self.span);
        // The noise goes with it, one step of expectation and maximisation at a time.
        self.trajectory.noise = self.model.noise_of(&self.squares);
        let sums = self.sums(false).map(|(sums, _)| sums);
        self.cost = sums.as_ref().map_or(f64::INFINITY, |sums| sums.cost);
        Ok(sums)
    }

    fn step(&self, sums: &BlockNormal, damping: f64) -> Option<Self::Step> {
        let (mut segments, mut shared) = sums.step(damping)?;
        let own = segments.iter().flat_map(|step| step.iter().zip(UNITS)).map(|(by, unit)| by.abs() / LONGEST[unit]);
        let longest = own.chain(shared.iter().map(|by| by.abs() / LONGEST[4])).fold(1.0, f64::max);
        segments.iter_mut().for_each(|step| *step /= longest);
        shared.iter_mut().for_each(|by| *by /= longest);
        Some((segments, shared))
    }

    fn moved(&self, _: &BlockNormal, (segments, shared): &Self::Step) -> Result<Option<Self>, Infallible> {
        let trajectory = self.trajectory.moved(&self.span, segments, shared);
        if !trajectory.is_in_order() {
            return Ok(None);
        }
        let mut next =
            Self { trajectory, noises: self.noises.clone(), squares: vec![], span: self.span.clone(), ..*self };
        let Some((sums, squares)) = next.sums(true) else { return Ok(None) };
        (next.cost, next.squares) = (sums.cost, squares);
        Ok(Some(next))
    }
}

impl Model<'_> {
    /// The trajectory, or one near it that explains the track better, segments outside of `span` as they are. Its cost is the span's.
    pub fn refined(&self, trajectory: &Trajectory, span: &Span, loss: Loss, steps: usize) -> Option<Hypothesis> {
        if !trajectory.is_in_order() {
            return None;
        }
        let noises = self.contact_noises(trajectory, span);
        let trajectory = trajectory.clone();
        let span = span.clone();
        let mut start = Refinement { model: self, trajectory, span, loss, noises, cost: 0.0, squares: vec![] };
        let (sums, squares) = start.sums(true)?;
        (start.cost, start.squares) = (sums.cost, squares);
        let Ok(found) = minimised(start, &Damping { steps, ..DAMPING });
        self.judged(found.trajectory, &found.span)
    }

    /// A trajectory with the evidence of a span of it, given the others (Laplace's approximation about it).
    pub fn judged(&self, trajectory: Trajectory, span: &Span) -> Option<Hypothesis> {
        let noises = self.contact_noises(&trajectory, span);
        let span = span.clone();
        let search =
            Refinement { model: self, trajectory, span, loss: Loss::Mixture, noises, cost: 0.0, squares: vec![] };
        let (sums, squares) = search.sums(false)?;
        let Refinement { trajectory, span, noises, .. } = search;
        let labels = squares.len() as f64 * self.label_constant(trajectory.noise) + self.noise_cost(trajectory.noise);
        let cost = sums.cost + labels + sums.log_determinant()? + self.structure_cost(&trajectory, &span, &noises);
        cost.is_finite().then_some(Hypothesis { trajectory, cost })
    }

    /// The trajectory with its position in a frame moved by so many standard deviations along the direction in which it is known least;
    /// its other numbers follow, through contacts that hold by `hold` (1: as they do).
    pub fn displaced(&self, trajectory: &Trajectory, frame: usize, by: f64, hold: f64) -> Option<Trajectory> {
        let span = trajectory.all();
        let mut noises = self.contact_noises(trajectory, &span);
        for noise in noises.iter_mut().flatten() {
            (noise.along, noise.across, noise.spin) = (noise.along / hold, noise.across / hold, noise.spin / hold);
        }
        let segment = span.clone().find(|&index| trajectory.frames(index).contains(&frame))?;
        let own = &trajectory.segments[segment];
        let mut flight = self.forecaster.flight(&own.state, &trajectory.log_scales, true);
        flight.advance(trajectory.times[frame] - own.time);
        let mut slope = SMatrix::<f64, 3, OF_SEGMENT>::zeros();
        slope.fixed_view_mut::<3, 9>(0, 1).copy_from(&flight.position.fixed_view::<3, 9>(0, 0));
        let trajectory = trajectory.clone();
        let search =
            Refinement { model: self, trajectory, span, loss: Loss::Growing, noises, cost: 0.0, squares: vec![] };
        let (mut sums, _) = search.sums(false)?;
        sums.hold_shared();
        let response = sums.response(segment, &slope.transpose())?;
        let covariance = slope * response[segment];
        let eigen = covariance.symmetric_eigen();
        let (axis, variance) = eigen.eigenvalues.argmax();
        let along = eigen.eigenvectors.column(axis) * (by / variance.max(f64::MIN_POSITIVE).sqrt());
        let steps: Vec<SVector<f64, OF_SEGMENT>> = response.iter().map(|it| it * along).collect();
        Some(search.trajectory.moved(&search.span, &steps, &[0.0; SHARED]))
    }

    /// What the labels say of each number of a trajectory.
    pub fn marginals(&self, trajectory: &Trajectory) -> Option<Marginals> {
        let span = trajectory.all();
        let noises = self.contact_noises(trajectory, &span);
        let trajectory = trajectory.clone();
        let search =
            Refinement { model: self, trajectory, span, loss: Loss::Mixture, noises, cost: 0.0, squares: vec![] };
        search.sums(false)?.0.marginals()
    }
}
