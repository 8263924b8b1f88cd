//! A ball at one instant.

use nalgebra::{Point3, Vector3};

/// A ball at one instant, in the world frame. [`Scene::start`](super::Scene::start) makes one with the scene's spin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// Its centre, m.
    pub position: Point3<f64>,
    /// m/s.
    pub velocity: Vector3<f64>,
    /// Angular velocity ω, rad/s.
    pub spin: Vector3<f64>,
}

impl State {
    /// Whether every number is finite.
    pub(crate) fn is_finite(&self) -> bool {
        let numbers = self.position.iter().chain(&self.velocity).chain(&self.spin);
        numbers.into_iter().all(|value| value.is_finite())
    }
}
