//! Whether a path through the picture bends as gravity bends that of a ball of its size. What turns at the end of a limb does not.

use nalgebra::{Matrix3, Point2, Vector2, Vector3};

use super::config::GravityConfig;
use gravisight_geometry::camera::Camera;
use gravisight_geometry::statistics::median;
use gravisight_physics::Scene;

/// Compares the bend of a path with that of a ball of its size under gravity.
pub(super) struct GravityTest<'a> {
    pub config: &'a GravityConfig,
    pub camera: &'a Camera,
    pub scene: &'a Scene,
}

/// A point of a path through the picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct ImagePoint {
    /// s.
    pub time: f64,
    /// px.
    pub at: Point2<f64>,
    pub radius: f64,
    pub sigma: f64,
}

impl GravityTest<'_> {
    /// Log-odds that a path bends as a ball's does.
    pub fn log_odds(&self, path: &[ImagePoint]) -> f64 {
        if self.scene.terminal_speed() < self.config.light {
            return 0.0;
        }
        let log_odds: f64 = parts(path, self.config.part).filter_map(|part| self.part_log_odds(part)).sum();
        log_odds.clamp(self.config.least, self.config.most)
    }

    fn part_log_odds(&self, part: &[ImagePoint]) -> Option<f64> {
        let config = self.config;
        if part.len() < config.fewest {
            return None;
        }
        let gravity = self.gravity(part)?;
        let Acceleration { along_axes: bend, sigma, .. } = Acceleration::of(part)?;
        let sigma = sigma / gravity.norm();
        let down = gravity.normalize();
        let [along, across] = [bend.dot(&down), bend.perp(&down)].map(|value| value / gravity.norm());
        let student = |value: f64, spread: f64| student(value, spread.hypot(sigma), config.freedom);
        let both = |spread: f64| student(along, spread) + student(across, spread);
        let spread = config.spread[usize::from(along > config.along)];
        let ball = student(along - config.along, spread) + student(across, config.spread_across);
        let (steady, anyhow) = (both(config.steady).exp(), both(config.anyhow).exp());
        let other = config.steady_fraction * steady + (1.0 - config.steady_fraction) * anyhow;
        Some((ball - other.ln()).clamp(-config.most_of_part, config.most_of_part))
    }

    /// The image of gravity where a ball of this size would be, px/s².
    fn gravity(&self, part: &[ImagePoint]) -> Option<Vector2<f64>> {
        let radius = median(part.iter().map(|point| point.radius))?;
        let sum = part.iter().fold(Vector2::zeros(), |sum, point| sum + point.at.coords);
        let depth = self.camera.intrinsic()[(1, 1)] * self.scene.ball.radius / radius;
        let at = self.camera.world_from_image(&Point2::from(sum / part.len() as f64), depth).ok()?;
        let (_, jacobian) = self.camera.image_from_world_with_jacobian(&at).ok()?;
        let gravity = jacobian * Vector3::from(self.scene.gravity);
        (gravity.norm() > 0.0 && gravity.norm().is_finite()).then_some(gravity)
    }
}

/// How a part of a path through the picture bends.
pub(super) struct Acceleration {
    /// px/s, in its middle.
    pub speed: f64,
    /// px/s².
    pub along_axes: Vector2<f64>,
    /// Standard deviation of that along each axis.
    pub sigma: f64,
}

impl Acceleration {
    /// By least squares of position, velocity and acceleration; none of fewer than three points.
    pub fn of(part: &[ImagePoint]) -> Option<Self> {
        let count = part.len() as f64;
        let middle = part.iter().map(|point| point.time).sum::<f64>() / count;
        let (mut normal, mut right) = (Matrix3::zeros(), [Vector3::zeros(); 2]);
        for point in part {
            let t = point.time - middle;
            let row = Vector3::new(1.0, t, t * t / 2.0);
            normal += row * row.transpose();
            right[0] += row * point.at.x;
            right[1] += row * point.at.y;
        }
        let inverse = normal.try_inverse()?;
        let [x, y] = right.map(|right| inverse * right);
        let (speed, along_axes) = (x[1].hypot(y[1]), Vector2::new(x[2], y[2]));
        let sigma = part.iter().map(|point| point.sigma).sum::<f64>() / count * inverse[(2, 2)].sqrt();
        Some(Self { speed, along_axes, sigma })
    }
}

/// The parts of a path that are one parabola each, of this duration (s) at most.
pub(super) fn parts(path: &[ImagePoint], duration: f64) -> impl Iterator<Item = &[ImagePoint]> {
    let mut from = 0;
    std::iter::from_fn(move || {
        let first = path.get(from)?;
        let count = path[from..].iter().take_while(|point| point.time - first.time <= duration).count();
        let part = &path[from..from + count];
        from += count;
        Some(part)
    })
}

/// Logarithm of Student's density, without what is the same in all.
pub(super) fn student(value: f64, spread: f64, freedom: f64) -> f64 {
    -(freedom + 1.0) / 2.0 * (1.0 + (value / spread).powi(2) / freedom).ln() - spread.ln()
}
