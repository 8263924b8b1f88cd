//! How well a course explains a track: residuals of its labels, and of what is known before anything is seen.

use nalgebra::{Point3, Vector2, Vector3};

use super::course::{Course, Event, Kind, OF_FORCES, Path};
use super::motion::{Laws, Moving};
use crate::camera::Camera;
use crate::physics::Obstacle;
use crate::track::fit::Observation;
use crate::track::fit::loss::Loss;

/// How far a contact is from where the scene puts its surface, m.
const SURFACE: f64 = 3e-3;
/// How deep a ball may seem to be in something, and how surely it is not deeper, m.
const DEPTH: f64 = 5e-3;
const DEPTH_SIGMA: f64 = 0.01;
/// How much of the way to a ball that is seen may lie in something: the scene's edges are known no better, m.
const HIDDEN_SIGMA: f64 = 0.05;
/// How surely a bounce keeps the law at any speed, m/s.
const SPEED: f64 = 0.1;
/// Spin after a bounce: share of its change.
const SPIN_SHARE: f64 = 0.4;
/// Speed after a hit, m/s: what anybody reaches.
const HIT_SPEED: f64 = 30.0;
/// Rows of a frame (label, apparent size, depth in obstacles, way to it through obstacles) and of an event (gap, velocity, spin).
pub const OF_FRAME: usize = 5;
pub const OF_CONTACT: usize = 8;
/// Rows of the start's spin and the forces.
pub const TAIL: usize = 3 + OF_FORCES;
/// How well the picture alone tells by how much the clock slips, frames.
const SLIP: f64 = 0.3;

/// What is known before anything is seen.
#[derive(Debug, Clone, Copy)]
pub struct Priors {
    /// Standard deviation of each component of the spin, rad/s.
    pub spin: f64,
    /// Of the logarithms of drag and lift, and of gravity's share.
    pub forces: [f64; 3],
    /// Of the normal and the tangential velocity after a bounce, as shares of the closing speed.
    pub restitution: f64,
    pub friction: f64,
}

/// A track to explain.
pub struct Task<'a> {
    pub laws: Laws,
    pub obstacles: &'a [Obstacle],
    pub camera: &'a Camera,
    /// Where the camera is, m.
    pub eye: Vector3<f64>,
    pub observations: &'a [Observation],
    /// By their numbers, s.
    pub times: Vec<f64>,
    /// Frames before which the clock slips, and by how much it seems to, s.
    pub slips: Vec<(usize, f64)>,
    /// Seconds from a frame to the next.
    pub interval: f64,
    /// Depth by the apparent size and its standard deviation, m, where it was measured.
    pub depths: Vec<Option<[f64; 2]>>,
    /// Standard deviation of the labels, px.
    pub sigma: f64,
    pub priors: Priors,
}

impl<'a> Task<'a> {
    /// Residuals, in standard deviations; none where the ball is behind the camera.
    pub fn fill(&self, course: &Course, path: &Path, laxness: &[[f64; 3]], rows: &mut Vec<f64>) -> Option<()> {
        let frames = path.frames.len();
        rows.resize(OF_FRAME * frames + OF_CONTACT * course.events.len() + TAIL + course.slips.len(), 0.0);
        for (index, moving) in path.frames.iter().enumerate() {
            let row = self.frame(course.first + index, &moving.position)?;
            rows[OF_FRAME * index..OF_FRAME * (index + 1)].copy_from_slice(&row);
        }
        self.events(course, path, laxness, &mut rows[OF_FRAME * frames..]);
        rows.iter().all(|row| row.is_finite()).then_some(())
    }

    /// Residuals of a frame with the ball at `position`.
    pub fn frame(&self, frame: usize, position: &Vector3<f64>) -> Option<[f64; OF_FRAME]> {
        let mut row = [0.0; OF_FRAME];
        let point = Point3::from(*position);
        if let Some(label) = self.observations[frame].image {
            let off = (self.camera.image_from_world(&point).ok()? - label) / self.sigma;
            (row[0], row[1]) = (off.x, off.y);
            // What is seen is not behind anything.
            let hidden = self.obstacles.iter().map(|it| it.between(&self.eye, position)).sum::<f64>();
            row[4] = hidden / HIDDEN_SIGMA;
        }
        if let Some([depth, sigma]) = self.depths[frame] {
            row[2] = (self.camera.camera_from_world(&point).z - depth) / sigma;
        }
        let radius = self.laws.rigid.radius;
        let deepest = self.obstacles.iter().map(|it| radius - it.distance(position)).fold(0.0, f64::max);
        row[3] = (deepest - DEPTH).max(0.0) / DEPTH_SIGMA;
        Some(row)
    }

    /// Which residuals of a frame are of something that was measured in it: its label, its apparent size.
    pub fn measured(&self, frame: usize) -> [bool; OF_FRAME] {
        let label = self.observations[frame].image.is_some();
        [label, label, self.depths[frame].is_some(), false, false]
    }

    /// Residuals of the events, of the start's spin, the forces and the clock.
    pub fn events(&self, course: &Course, path: &Path, laxness: &[[f64; 3]], rows: &mut [f64]) {
        for (index, ((event, before), [normal, across, turn])) in
            course.events.iter().zip(&path.before).zip(laxness).enumerate()
        {
            let row = &mut rows[OF_CONTACT * index..OF_CONTACT * (index + 1)];
            row.fill(0.0);
            let (gap, velocity, spin) = match event.kind {
                Kind::Bounce(obstacle) => {
                    let near = self.obstacles[obstacle].nearest(&before.position);
                    let rigid = &self.laws.rigid;
                    let (v, w) = rigid.rebound(&near.normal, &before.velocity, &before.spin);
                    let off = event.velocity - v;
                    let along = near.normal.dot(&off);
                    let beside = off - along * near.normal;
                    row[7] = along / normal;
                    ((near.distance - rigid.radius) / SURFACE, beside / *across, (event.spin - w) / *turn)
                }
                Kind::Hit => (0.0, event.velocity / HIT_SPEED, event.spin / self.priors.spin),
            };
            row[0] = gap;
            row[1..4].copy_from_slice(velocity.as_slice());
            row[4..7].copy_from_slice(spin.as_slice());
        }
        let tail = rows.len() - TAIL - course.slips.len();
        (0..3).for_each(|axis| rows[tail + axis] = course.start.spin[axis] / self.priors.spin);
        (0..OF_FORCES).for_each(|which| rows[tail + 3 + which] = course.off[which] / self.priors.forces[which]);
        for (index, (slip, (_, seems))) in course.slips.iter().zip(&self.slips).enumerate() {
            rows[tail + TAIL + index] = (slip - seems) / (SLIP * self.interval);
        }
    }

    /// How loosely each event keeps the law.
    pub fn laxness(&self, course: &Course, path: &Path) -> Vec<[f64; 3]> {
        let of = |(event, before): (&Event, &Moving)| {
            let Kind::Bounce(obstacle) = event.kind else { return [1.0; 3] };
            let normal = self.obstacles[obstacle].nearest(&before.position).normal;
            let closing = normal.dot(&before.velocity).abs();
            let (_, w) = self.laws.rigid.rebound(&normal, &before.velocity, &before.spin);
            let across = self.priors.friction * closing + SPEED;
            let turn = 2.0 * across / self.laws.rigid.radius + SPIN_SHARE * (w - before.spin).norm();
            [self.priors.restitution * closing + SPEED, across, turn]
        };
        course.events.iter().zip(&path.before).map(of).collect()
    }

    /// Weight of each residual's square, and the cost.
    pub fn weighed(&self, frames: usize, rows: &[f64], loss: Loss) -> (Vec<f64>, f64) {
        let mut weights = vec![1.0; rows.len()];
        let mut cost = 0.0;
        for index in 0..frames {
            let start = OF_FRAME * index;
            let row = &rows[start..start + OF_FRAME];
            let groups = [(0..2, row[0] * row[0] + row[1] * row[1], loss), (2..3, row[2] * row[2], loss)];
            let inside = [3, 4].map(|at| (at..at + 1, row[at] * row[at], Loss::Huber(3.0)));
            for (range, square, loss) in groups.into_iter().chain(inside) {
                let (paid, weight) = loss.of(square);
                cost += paid;
                range.for_each(|at| weights[start + at] = weight);
            }
        }
        let rest = &rows[OF_FRAME * frames..];
        (weights, cost + rest.iter().map(|row| row * row).sum::<f64>())
    }

    /// When each frame was taken by a course, s.
    pub fn times_of(&self, course: &Course) -> Vec<f64> {
        let frames: Vec<usize> = self.slips.iter().map(|slip| slip.0).collect();
        course.times(&self.times, &frames)
    }

    /// The way of a course.
    pub fn path(&self, course: &Course) -> Path {
        course.path(&self.laws, &self.times_of(course))
    }

    /// Residuals of the labels, px, frame by frame.
    pub fn residuals(&self, course: &Course, path: &Path) -> Vec<Option<Vector2<f64>>> {
        let of = |(index, moving): (usize, &Moving)| {
            let label = self.observations[course.first + index].image?;
            Some(self.camera.image_from_world(&Point3::from(moving.position)).ok()? - label)
        };
        path.frames.iter().enumerate().map(of).collect()
    }

    /// The same task with other depths.
    pub fn with_depths(&self, depths: Vec<Option<[f64; 2]>>) -> Task<'_> {
        let (laws, times, slips) = (self.laws.clone(), self.times.clone(), self.slips.clone());
        Task { depths, laws, times, slips, ..*self }
    }

    /// The same task with another camera.
    pub fn with_camera<'b>(&'b self, camera: &'b Camera) -> Task<'b> {
        let eye = camera.world_from_camera(&Point3::origin()).coords;
        Task { camera, eye, ..self.with_depths(self.depths.clone()) }
    }

    /// The same task with another standard deviation of gravity's share.
    pub fn with_gravity(&self, sigma: f64) -> Task<'_> {
        let mut task = self.with_depths(self.depths.clone());
        task.priors.forces[2] = sigma;
        task
    }
}
