//! The camera's rays: flights and contacts by them alone, for the search to start from.

use nalgebra::{Matrix3, Matrix6, Point2, Point3, Vector3, Vector6};

use super::motion::Moving;
use super::search::slipped;
use super::task::Task;
use crate::physics::Obstacle;

/// Nearest and farthest that a ball is looked for, m.
const NEAREST: f64 = 0.1;
const FARTHEST: f64 = 500.0;
/// By how much a ray may miss what the ball met, m: labels are noisy, and edges are edges.
const MISSED: f64 = 0.05;

/// The camera's rays.
pub struct Rays {
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
    centre: Vector3<f64>,
    /// Ideal image of each frame's label.
    pub ideal: Vec<Option<Point2<f64>>>,
    /// When each frame was taken, as far as the picture alone tells, s.
    pub times: Vec<f64>,
}

impl Rays {
    pub fn of(task: &Task) -> Self {
        let origin = task.camera.camera_from_world(&Point3::origin());
        let axis = |index: usize| task.camera.camera_from_world(&Point3::from(Vector3::ith(index, 1.0))) - origin;
        let rotation = Matrix3::from_columns(&[axis(0), axis(1), axis(2)]);
        let translation = origin.coords;
        let ideal = |image: Point2<f64>| Some(task.camera.camera_from_image(&image, 1.0).ok()?.xy());
        let ideal = task.observations.iter().map(|seen| seen.image.and_then(ideal)).collect();
        Self { rotation, translation, centre: -rotation.transpose() * translation, ideal, times: slipped(task) }
    }

    /// The motion at `time` of a ball that is pulled by `acceleration` and seen in the frames of `range`; at `anchor` then,
    /// if it is known where.
    pub fn ballistic(
        &self,
        range: std::ops::RangeInclusive<usize>,
        time: f64,
        anchor: Option<Vector3<f64>>,
        acceleration: Vector3<f64>,
    ) -> Option<Moving> {
        let seen: Vec<(f64, Point2<f64>)> =
            range.filter_map(|frame| Some((self.times[frame] - time, self.ideal[frame]?))).collect();
        let needed = if anchor.is_some() { 2 } else { 4 };
        if seen.len() < needed {
            return None;
        }
        let mut weights = vec![1.0; seen.len()];
        let mut solution = Vector6::zeros();
        for _ in 0..3 {
            let mut normal = Matrix6::identity() * 1e-9;
            let mut right = Vector6::zeros();
            for ((t, ideal), weight) in seen.iter().zip(&weights) {
                for axis in 0..2 {
                    let row = (self.rotation.row(axis) - ideal[axis] * self.rotation.row(2)).transpose();
                    let offset = self.translation[axis] - ideal[axis] * self.translation.z;
                    let mut a = Vector6::zeros();
                    a.fixed_rows_mut::<3>(0).copy_from(&row);
                    a.fixed_rows_mut::<3>(3).copy_from(&(row * *t));
                    let mut b = -offset - row.dot(&acceleration) * t * t / 2.0;
                    if let Some(anchor) = anchor {
                        b -= row.dot(&anchor);
                        a.fixed_rows_mut::<3>(0).fill(0.0);
                    }
                    normal += a * a.transpose() * *weight;
                    right += a * b * *weight;
                }
            }
            if anchor.is_some() {
                (0..3).for_each(|at| normal[(at, at)] = 1.0);
            }
            solution = normal.cholesky()?.solve(&right);
            let start = anchor.unwrap_or_else(|| solution.fixed_rows::<3>(0).into_owned());
            for ((t, ideal), weight) in seen.iter().zip(&mut weights) {
                let at = start + solution.fixed_rows::<3>(3) * *t + acceleration * (t * t / 2.0);
                let camera = self.rotation * at + self.translation;
                let depth = camera.z.max(NEAREST);
                // Labels far off count less.
                let off = (camera.xy() / depth - ideal.coords).norm() / 0.01;
                *weight = 1.0 / (depth * depth) / (1.0 + off * off);
            }
        }
        let position = anchor.unwrap_or_else(|| solution.fixed_rows::<3>(0).into_owned());
        let velocity = solution.fixed_rows::<3>(3).into_owned();
        let depth = (self.rotation * position + self.translation).z;
        let sane = (NEAREST..FARTHEST).contains(&depth) && velocity.norm() < 100.0;
        sane.then_some(Moving { position, velocity, spin: Vector3::zeros() })
    }

    /// Where the ray of a point of the picture is one radius from an obstacle; none where it never is, or where the obstacle
    /// would hide the ball.
    pub fn contact(&self, task: &Task, image: &Point2<f64>, obstacle: &Obstacle) -> Option<Vector3<f64>> {
        let ideal = task.camera.camera_from_image(image, 1.0).ok()?;
        let along = self.rotation.transpose() * ideal.coords;
        let at = |depth: f64| self.centre + along * depth;
        let gap = |depth: f64| obstacle.distance(&at(depth)) - task.laws.rigid.radius;
        // The distance from something convex is convex along a ray: first its least value, then where it passes zero before.
        let (mut low, mut high) = (NEAREST, FARTHEST);
        for _ in 0..100 {
            let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
            if gap(a) < gap(b) { high = b } else { low = a }
        }
        let least = (low + high) / 2.0;
        if gap(least) > MISSED || gap(NEAREST) < 0.0 {
            return None;
        }
        if gap(least) > 0.0 {
            return Some(at(least));
        }
        let (mut outside, mut inside) = (NEAREST, least);
        for _ in 0..60 {
            let middle = (outside + inside) / 2.0;
            if gap(middle) > 0.0 { outside = middle } else { inside = middle }
        }
        Some(at(outside))
    }
}
