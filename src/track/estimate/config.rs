//! The numbers of the estimator.

use serde::Serialize;

/// How the estimator judges a trajectory. Those without a physical source are fitted by `scripts/tune-estimator` on simulated flights.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct EstimatorConfig {
    /// Standard deviation of a label that is to be expected, px, and how many labels' worth that expectation is.
    pub noise_px: f64,
    pub noise_weight: f64,
    /// Fraction of labels that are this many times as noisy, and of those that are anywhere in the picture.
    pub rough_fraction: f64,
    pub rough_factor: f64,
    pub stray_fraction: f64,
    /// How exactly a trajectory is continuous, m, and how exactly the scene puts its surfaces, m.
    pub continuity: f64,
    pub surface: f64,
    /// How exactly a contact keeps its law at any speed, m/s; of the spin's change, a fraction.
    pub contact_speed: f64,
    pub contact_spin: f64,
    /// Hits a second.
    pub hit_rate: f64,
    /// Standard deviation of each component of the velocity at the start and after a hit, m/s.
    pub speed: f64,
    /// How deep a ball may seem to be in an obstacle and how surely it is not deeper, m; how much of the line of sight to a ball
    /// that is seen may pass through obstacles, m.
    pub depth: f64,
    pub depth_sigma: f64,
    pub hidden_sigma: f64,
    /// Common relative error of the apparent sizes: blur, a threshold, the ball's own size.
    pub size_sigma: f64,
}

impl Default for EstimatorConfig {
    fn default() -> Self {
        Self {
            noise_px: 1.5,
            noise_weight: 2.0,
            rough_fraction: 0.03,
            rough_factor: 5.0,
            stray_fraction: 0.01,
            continuity: 1e-3,
            surface: 3e-3,
            contact_speed: 0.1,
            contact_spin: 0.4,
            hit_rate: 0.2,
            speed: 12.0,
            depth: 5e-3,
            depth_sigma: 0.01,
            hidden_sigma: 0.05,
            size_sigma: 0.04,
        }
    }
}

impl EstimatorConfig {
    pub fn of(scene: &crate::physics::Scene) -> Self {
        let terminal = scene.terminal_speed();
        let mut config = Self { speed: if terminal.is_finite() { (0.8 * terminal).clamp(4.0, 25.0) } else { 12.0 }, ..Self::default() };
        for pair in std::env::var("CFG").unwrap_or_default().split(',').filter(|it| !it.is_empty()) {
            let (name, value) = pair.split_once('=').unwrap();
            let value: f64 = value.parse().unwrap();
            match name {
                "noise_px" => config.noise_px = value,
                "noise_weight" => config.noise_weight = value,
                "rough_fraction" => config.rough_fraction = value,
                "rough_factor" => config.rough_factor = value,
                "stray_fraction" => config.stray_fraction = value,
                "continuity" => config.continuity = value,
                "surface" => config.surface = value,
                "contact_speed" => config.contact_speed = value,
                "contact_spin" => config.contact_spin = value,
                "hit_rate" => config.hit_rate = value,
                "speed" => config.speed = value,
                _ => panic!("{name}"),
            }
        }
        config
    }
}
