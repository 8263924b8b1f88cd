//! What is to be explained, and by what: track, camera, laws of motion, and how far each is trusted.

use std::cell::Cell;

use nalgebra::{Matrix2x3, Matrix3, Point2, Point3, SVector, Vector2, Vector3};

use super::Observation;
use crate::camera::Camera;
use crate::error::Result;
use crate::physics::{Column, Forecaster, State, Transition};

/// Uncertainty of the laws of motion in flight: share of gravity (or of 1 m/s², where there is less).
const FLIGHT_ERROR: f64 = 0.002;
/// Uncertainty of a position from frame to frame, m.
const POSITION_ERROR: f64 = 1e-4;
/// Uncertainty of a contact: m, m/s, share of the change of velocity, share of the change of spin.
const CONTACT_POSITION_ERROR: f64 = 2e-3;
const CONTACT_VELOCITY_ERROR: f64 = 2e-3;
const CONTACT_VELOCITY_SHARE: f64 = 2e-3;
const CONTACT_SPIN_SHARE: f64 = 0.05;
/// Uncertainty of the spin from frame to frame, rad/s.
const SPIN_ERROR: f64 = 0.01;

/// How much less the laws are trusted while their numbers are unknown.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Slack {
    /// Uncertainty of the acceleration in flight, m/s².
    pub acceleration: f64,
    /// Of the velocity after a contact, as a share of its change.
    pub contact: f64,
}

/// A track to fit.
pub(super) struct Problem<'a> {
    pub forecaster: &'a Forecaster,
    pub camera: &'a Camera,
    pub observations: &'a [Observation],
    /// Standard deviation of the labels, px.
    pub sigma: f64,
    /// Standard deviation of the spin at the first frame, rad/s.
    pub spin_sigma: f64,
    /// What is not known of the laws yet.
    pub slack: Slack,
    /// Ideal (undistorted, normalised) image points of the labels that are trusted from the start.
    pub rays: Vec<Option<Point2<f64>>>,
    /// px per unit of the ideal image.
    pub focal: f64,
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
    /// Transitions computed so far, weighted: the measure of work.
    work: Cell<usize>,
}

impl<'a> Problem<'a> {
    pub fn new(
        forecaster: &'a Forecaster,
        camera: &'a Camera,
        observations: &'a [Observation],
        trusted: &[Observation],
        sigma: f64,
        spin_sigma: f64,
    ) -> Result<Self> {
        let origin = camera.camera_from_world(&Point3::origin());
        let axis = |index: usize| camera.camera_from_world(&Point3::from(Vector3::ith(index, 1.0))) - origin;
        let ray = |observation: &Observation| -> Result<Option<Point2<f64>>> {
            let Some(image) = observation.image else { return Ok(None) };
            Ok(Some(camera.camera_from_image(&image, 1.0)?.xy()))
        };
        Ok(Self {
            forecaster,
            camera,
            observations,
            sigma,
            spin_sigma,
            slack: Slack::default(),
            rays: trusted.iter().map(ray).collect::<Result<_>>()?,
            focal: 0.5 * (camera.intrinsic()[(0, 0)] + camera.intrinsic()[(1, 1)]),
            rotation: Matrix3::from_columns(&[axis(0), axis(1), axis(2)]),
            translation: origin.coords,
            work: Cell::new(0),
        })
    }

    /// The same track under other laws.
    pub fn with<'b>(&self, forecaster: &'b Forecaster) -> Problem<'b>
    where
        'a: 'b,
    {
        Problem { forecaster, rays: self.rays.clone(), work: self.work.clone(), ..*self }
    }

    pub fn len(&self) -> usize {
        self.observations.len()
    }

    /// The state of `frame` moved on by `dt` s.
    pub fn transition<const D: usize>(&self, state: &Column, dt: f64) -> Option<Transition<D>> {
        // with the spin free, a state's share of the linear algebra is larger
        self.work.set(self.work.get() + if D == 6 { 1 } else { 2 });
        self.forecaster.transition(state, dt)
    }

    /// Whether more than `limit` transitions a frame were computed.
    pub fn tired(&self, limit: usize) -> bool {
        self.work.get() > limit * self.len()
    }

    pub fn camera_coordinates(&self, r: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * r + self.translation
    }

    /// Direction in the world in which depth grows.
    pub fn depth_direction(&self) -> Vector3<f64> {
        self.rotation.row(2).transpose()
    }

    /// (row, offset) with `row·r + offset = 0` for world points r whose ideal image has this coordinate.
    pub fn ray_equation(&self, axis: usize, coordinate: f64) -> (Vector3<f64>, f64) {
        let row = self.rotation.row(axis) - coordinate * self.rotation.row(2);
        (row.transpose(), self.translation[axis] - coordinate * self.translation.z)
    }

    /// Reprojection of a state, px, with its Jacobian; `None` behind the camera.
    pub fn project(&self, state: &Column) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
        let point = Point3::new(state[0], state[1], state[2]);
        let (image, jacobian) = self.camera.image_from_world_with_jacobian(&point).ok()?;
        Some((image.coords, jacobian))
    }

    /// The scene's spin at a frame, as it decays in flight.
    pub fn spin_at(&self, frame: usize) -> Vector3<f64> {
        let ball = &self.forecaster.scene().ball;
        let passed = self.observations[frame].time - self.observations[0].time;
        Vector3::from(ball.spin) * (-ball.spin_decay * passed).exp()
    }

    /// Seconds from one frame to the next.
    pub fn interval(&self, frame: usize) -> f64 {
        self.observations[frame + 1].time - self.observations[frame].time
    }

    /// Precision (1/variance) of the laws of motion over the interval after `frame`; with a contact, by
    /// the velocity and spin that it changes.
    pub fn precision<const D: usize>(&self, frame: usize, contact: Option<[f64; 2]>) -> SVector<f64, D> {
        let dt = self.interval(frame);
        let gravity = Vector3::from(self.forecaster.scene().gravity).norm().max(1.0);
        let flight = (FLIGHT_ERROR * gravity + self.slack.acceleration) * dt;
        let sigmas = match contact {
            None => [POSITION_ERROR + flight * dt, flight, SPIN_ERROR],
            Some([velocity, spin]) => [
                CONTACT_POSITION_ERROR,
                CONTACT_VELOCITY_ERROR + (CONTACT_VELOCITY_SHARE + self.slack.contact) * velocity,
                SPIN_ERROR + CONTACT_SPIN_SHARE * spin,
            ],
        };
        SVector::from_fn(|row, _| sigmas[row / 3].powi(-2))
    }

    /// Double and single integral of the accelerations that no closed form knows, along a path at `times`.
    pub fn nonlinear_motion(&self, times: &[f64], path: impl Fn(usize) -> State) -> Vec<(Vector3<f64>, Vector3<f64>)> {
        let rest = |index: usize| self.forecaster.nonlinear_acceleration(&path(index));
        let mut out = Vec::with_capacity(times.len());
        let (mut r, mut v, mut a) = (Vector3::zeros(), Vector3::zeros(), rest(0));
        out.push((r, v));
        for index in 1..times.len() {
            let (dt, next) = (times[index] - times[index - 1], rest(index));
            r += v * dt + (2.0 * a + next) * dt * dt / 6.0;
            v += (a + next) * dt / 2.0;
            a = next;
            out.push((r, v));
        }
        out
    }
}
