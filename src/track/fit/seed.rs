//! First guesses: windows of a track that one free flight explains, solved in closed form.

use nalgebra::{Matrix6, Point2, Vector3, Vector6};

use super::problem::Problem;
use crate::physics::{State, column, part};

/// Lengths of the windows, in observations seen.
const LENGTHS: [usize; 5] = [8, 12, 18, 26, 36];
/// Rounds of reweighting: by depth (pixels, not metres, are what is measured), by outliers, by forces
/// that are not linear.
const ROUNDS: usize = 9;
/// Rounds of these that are linear in the label's rays.
const LINEAR_ROUNDS: usize = 2;
/// Residual, in standard deviations, beyond which an observation counts less.
const OUTLIER: f64 = 3.0;
/// Largest root mean square residual of a window in free flight, in standard deviations of the labels.
const ACCEPTED: f64 = 1.6;
/// Weakest pull of the solution towards the camera's middle distance, 1/m²: without any, a window
/// that says nothing about depth has no solution.
const REGULAR: f64 = 1e-9;

/// A window in free flight.
#[derive(Debug, Clone)]
pub(super) struct Seed {
    /// Frames it covers.
    pub first: usize,
    pub last: usize,
    /// State at each of them.
    pub states: Vec<[f64; 9]>,
    /// Standard deviation of 1/depth at its middle, 1/m: how little the window knows, wherever it believes the ball.
    pub inverse_depth_sigma: f64,
    /// Root mean square residual / standard deviation of the labels.
    pub misfit: f64,
}

/// At most `count` seeds, the best-determined first.
pub(super) fn seeds(problem: &Problem, count: usize) -> Vec<Seed> {
    let seen: Vec<usize> = (0..problem.len()).filter(|&frame| problem.rays[frame].is_some()).collect();
    let mut all = Vec::new();
    for length in LENGTHS.into_iter().filter(|&length| length <= seen.len()) {
        let stride = (length / 4).max(1);
        let starts = (0..=seen.len() - length).step_by(stride).chain([seen.len() - length]);
        all.extend(starts.filter_map(|start| seed(problem, &seen[start..start + length])));
    }
    if all.is_empty() {
        all.extend(seed(problem, &seen));
    }
    // A window with a contact in it fits badly; where all do, the least bad ones come first.
    let penalty = |seed: &Seed| seed.inverse_depth_sigma * (seed.misfit / ACCEPTED).max(1.0).powi(3);
    all.sort_by(|a, b| penalty(a).total_cmp(&penalty(b)));
    // Best first, but those that share most of their frames with a better one after all others.
    let mut chosen: Vec<Seed> = Vec::new();
    let mut similar: Vec<Seed> = Vec::new();
    for seed in all {
        let overlap = |other: &Seed| {
            let shared = (seed.last.min(other.last) + 1).saturating_sub(seed.first.max(other.first));
            2 * shared > seed.last + 1 - seed.first
        };
        if chosen.iter().any(overlap) { similar.push(seed) } else { chosen.push(seed) }
    }
    chosen.extend(similar);
    chosen.truncate(count);
    chosen
}

/// The free flight that best explains the observations `seen` (frames): linear least squares in
/// position and velocity at the window's first frame, reweighted.
fn seed(problem: &Problem, seen: &[usize]) -> Option<Seed> {
    let (first, last) = (*seen.first()?, *seen.last()?);
    let start_time = problem.observations[first].time;
    let times: Vec<f64> = (first..=last).map(|frame| problem.observations[frame].time - start_time).collect();
    let spin = problem.spin_at(first);
    let moved: Vec<_> = times.iter().map(|&time| problem.forecaster.linear_motion(&spin, time)).collect();
    let rays: Vec<(usize, Point2<f64>)> =
        seen.iter().filter_map(|&frame| Some((frame - first, problem.rays[frame]?))).collect();
    if rays.len() < 4 {
        return None;
    }
    let mut weights = vec![1.0; rays.len()];
    let mut extra = vec![(Vector3::zeros(), Vector3::zeros()); times.len()];
    let mut solution = Vector6::zeros();
    let mut normal = Matrix6::zeros();
    let mut squares = f64::INFINITY;
    let state = |solution: &Vector6<f64>, extra: &(Vector3<f64>, Vector3<f64>), index: usize| {
        let m = &moved[index];
        let v = m.jacobian * solution;
        let (dr, dv) = extra;
        (m.position + v.fixed_rows::<3>(0) + dr, m.velocity + v.fixed_rows::<3>(3) + dv)
    };
    for round in 0..ROUNDS {
        normal = Matrix6::identity() * REGULAR;
        let mut right = Vector6::zeros();
        for ((index, ray), weight) in rays.iter().zip(&weights) {
            let jacobian = moved[*index].jacobian;
            let known = moved[*index].position + extra[*index].0;
            let camera = problem.camera_coordinates(&state(&solution, &extra[*index], *index).0);
            for axis in 0..2 {
                // (row_axis − ray·row_depth)·camera_from_world(r) = 0 with the label's ray is linear, but noise
                // in the ray draws the solution to the camera; once there is a solution, Gauss–Newton on the
                // reprojection, whose coefficients have the predicted ray, does without.
                let predicted = camera[axis] / camera.z;
                let ((row, offset), left) = match round < LINEAR_ROUNDS {
                    true => (problem.ray_equation(axis, ray[axis]), 0.0),
                    false => (problem.ray_equation(axis, predicted), camera.z * (ray[axis] - predicted)),
                };
                let a = jacobian.fixed_view::<3, 6>(0, 0).transpose() * row;
                let b = left - (row.dot(&known) + offset);
                normal += a * a.transpose() * *weight;
                right += a * b * *weight;
            }
        }
        solution = normal.cholesky()?.solve(&right);
        squares = 0.0;
        for ((index, ray), weight) in rays.iter().zip(&mut weights) {
            let (r, _) = state(&solution, &extra[*index], *index);
            let camera = problem.camera_coordinates(&r);
            if camera.z <= 0.0 {
                return None;
            }
            let off = problem.focal * ((camera.xy() / camera.z) - ray.coords).norm() / problem.sigma;
            squares += off.min(2.0 * OUTLIER).powi(2);
            let robust = if off > OUTLIER { OUTLIER / off } else { 1.0 };
            *weight = robust * (problem.focal / (problem.sigma * camera.z)).powi(2);
        }
        if round + 1 < ROUNDS {
            extra = problem.nonlinear_motion(&times, |index| {
                let (r, v) = state(&solution, &extra[index], index);
                State { position: r.into(), velocity: v, spin: problem.spin_at(first + index) }
            });
        }
    }
    let states: Vec<_> = (0..times.len())
        .map(|index| {
            let (r, v) = state(&solution, &extra[index], index);
            column(r, v, problem.spin_at(first + index))
        })
        .collect();
    if states.iter().flatten().any(|value| !value.is_finite()) {
        return None;
    }
    let middle = times.len() / 2;
    let along = problem.depth_direction();
    let jacobian = moved[middle].jacobian.fixed_view::<3, 6>(0, 0).transpose() * along;
    let depth_variance = jacobian.dot(&normal.cholesky()?.solve(&jacobian));
    let depth = problem.camera_coordinates(&part(&states[middle], 0)).z;
    let misfit = (squares / (2.0 * rays.len() as f64 - 6.0).max(1.0)).sqrt();
    let inverse_depth_sigma = depth_variance.max(0.0).sqrt() / (depth * depth);
    Some(Seed { first, last, states, inverse_depth_sigma, misfit })
}
