//! What rays alone tell, for the search to start from: ballistic flights through them, contacts on them, and the labels in a plane.

use nalgebra::{Matrix6, Point2, Vector3, Vector6};

use super::model::Model;
use super::observation::Observation;

/// Nearest and farthest that a ball is looked for, m.
const NEAREST: f64 = 0.1;
const FARTHEST: f64 = 500.0;
/// Fastest ball, m/s.
const FASTEST: f64 = 120.0;
/// How firmly a ball is at its anchor, m; rounds; residual from which on a label counts less, in standard deviations.
const ANCHORED: f64 = 0.01;
const ROUNDS: usize = 4;
const LOOSE: f64 = 8.0;
/// Cosine of the largest angle from the middle of the rays at which they still meet the plane before it.
const STEEPEST: f64 = 0.1;

/// A plane before the camera in which the rays' directions are drawn.
pub struct Plane {
    axis: Vector3<f64>,
    across: [Vector3<f64>; 2],
    /// Pixels to a unit.
    scale: f64,
}

impl Plane {
    /// About the middle of the rays; none where there are none.
    pub fn of(observations: &[Observation]) -> Option<Self> {
        let rays = || observations.iter().filter_map(|seen| seen.ray.as_ref());
        let axis = rays().map(|ray| ray.direction).sum::<Vector3<f64>>().try_normalize(1e-3)?;
        let first = axis.cross(&Vector3::ith(axis.iamin(), 1.0)).normalize();
        let scale = rays().map(|ray| ray.px_per_radian()).sum::<f64>() / rays().count() as f64;
        Some(Self { axis, across: [first, axis.cross(&first)], scale })
    }

    /// The direction that it is perpendicular to.
    pub fn axis(&self) -> Vector3<f64> {
        self.axis
    }

    /// Where a direction meets it, px.
    pub fn point(&self, direction: &Vector3<f64>) -> Option<Point2<f64>> {
        let along = self.axis.dot(direction);
        let [x, y] = [0, 1].map(|index| self.scale * self.across[index].dot(direction) / along);
        (along > STEEPEST).then(|| Point2::new(x, y))
    }

    /// The labels in it, px, with their frames.
    pub fn labels(&self, observations: &[Observation]) -> Vec<(usize, Point2<f64>)> {
        let of = |(frame, seen): (usize, &Observation)| Some((frame, self.point(&seen.ray.as_ref()?.direction)?));
        observations.iter().enumerate().filter_map(of).collect()
    }

    /// The unit direction to a point of it.
    pub fn direction(&self, point: &Point2<f64>) -> Vector3<f64> {
        (self.axis + (self.across[0] * point.x + self.across[1] * point.y) / self.scale).normalize()
    }
}

impl Model<'_> {
    /// Position and velocity at `time` of a ball that accelerates by `acceleration` and is seen in the `frames`, taken at
    /// `times`, with `noise` px; it is at `anchor` then, where that is given, and
    /// has about the velocity `drift` where nothing else is known. The most probable one, by Gauss and Newton's steps.
    pub fn ballistic(
        &self,
        times: &[f64],
        frames: std::ops::RangeInclusive<usize>,
        (time, anchor): (f64, Option<Vector3<f64>>),
        (acceleration, drift): (Vector3<f64>, Vector3<f64>),
        noise: f64,
    ) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let seen: Vec<_> =
            frames.filter_map(|frame| Some((times[frame] - time, self.observations[frame].ray.as_ref()?))).collect();
        if seen.len() < if anchor.is_some() { 1 } else { 4 } {
            return None;
        }
        let (place, place_sigma) = match anchor {
            Some(anchor) => (anchor, Vector3::repeat(ANCHORED)),
            None => self.place,
        };
        let mean = Vector6::from_iterator(place.iter().copied().chain(drift.iter().copied()));
        let precision = Vector6::from_iterator(place_sigma.iter().copied().chain([self.config.speed; 3]))
            .map(|sigma| sigma.powi(-2));
        let far = |at: &Vector3<f64>, ray: &super::observation::Ray| ray.direction.dot(&(at - ray.origin)).max(NEAREST);
        let mut weights: Vec<f64> = seen.iter().map(|(_, ray)| (far(&place, ray) * noise).powi(-2)).collect();
        let mut solution = mean;
        for _ in 0..ROUNDS {
            let mut normal = Matrix6::from_diagonal(&precision);
            let mut right = precision.component_mul(&mean);
            for ((t, ray), weight) in seen.iter().zip(&weights) {
                for (row, offset) in ray.equations() {
                    let row = row.transpose();
                    let mut a = Vector6::zeros();
                    a.fixed_rows_mut::<3>(0).copy_from(&row);
                    a.fixed_rows_mut::<3>(3).copy_from(&(row * *t));
                    let b = offset - row.dot(&acceleration) * t * t / 2.0;
                    normal += a * a.transpose() * *weight;
                    right += a * b * *weight;
                }
            }
            solution = normal.cholesky()?.solve(&right);
            for ((t, ray), weight) in seen.iter().zip(&mut weights) {
                let at = solution.fixed_rows::<3>(0) + solution.fixed_rows::<3>(3) * *t + acceleration * (t * t / 2.0);
                let off = ray.residual(&at).map_or(f64::INFINITY, |(off, _)| off.norm() / noise);
                // Labels far off count less.
                *weight = (far(&at, ray) * noise).powi(-2) / (1.0 + (off / LOOSE).powi(2));
            }
        }
        let (position, velocity) = (solution.fixed_rows::<3>(0).into_owned(), solution.fixed_rows::<3>(3).into_owned());
        let depth = seen[0].1.direction.dot(&(position - seen[0].1.origin));
        ((NEAREST..FARTHEST).contains(&depth) && velocity.norm() < FASTEST).then_some((position, velocity))
    }
}
