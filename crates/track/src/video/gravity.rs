//! Whether a way through the picture bends as gravity bends a ball's of that size: what turns at a limb's end does not.

use nalgebra::{Matrix3, Point2, Vector2, Vector3};

use gravisight_geometry::camera::Camera;
use gravisight_geometry::statistics::median;
use gravisight_physics::Scene;

/// Time of a part of a way that is one parabola, s, and fewest places in it.
const PART: f64 = 0.35;
const FEWEST: usize = 5;
/// The acceleration of a ball along gravity's image, in units of that, and its spread below and above that, and across: drag,
/// spin and what comes of flying towards the camera are in it.
const ALONG: f64 = 1.3;
const SPREAD: [f64; 2] = [0.3, 1.0];
const SPREAD_ACROSS: f64 = 1.0;
/// Spread of what does not fly: most of it hardly bends for its size, the rest anyhow; the fraction of the first.
const STEADY: f64 = 0.5;
const ANYHOW: f64 = 6.0;
const STEADY_SHARE: f64 = 0.6;
/// Degrees of freedom of all spreads (Student's t).
const FREEDOM: f64 = 3.0;
/// Most that a part says for or against a ball, and a way against it and for it, log of odds.
const MOST_OF_PART: f64 = 5.0;
const LEAST: f64 = -15.0;
const MOST: f64 = 6.0;
/// A ball that falls no faster than this through the air, m/s, soon falls steadily, as a shuttle does: its way need not bend.
const LIGHT: f64 = 7.5;

/// What a ball's size says of how its way must bend.
pub(super) struct GravityTest<'a> {
    pub camera: &'a Camera,
    pub scene: &'a Scene,
}

/// A place on a way.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    /// s.
    pub time: f64,
    /// px.
    pub at: Point2<f64>,
    pub radius: f64,
    pub sigma: f64,
}

impl GravityTest<'_> {
    /// How much more a way bends as a ball's than as anything's, log of odds.
    pub fn odds(&self, way: &[Place]) -> f64 {
        if self.scene.terminal_speed() < LIGHT {
            return 0.0;
        }
        let mut odds = 0.0;
        let mut from = 0;
        while from < way.len() {
            let part = way[from..].iter().take_while(|place| place.time - way[from].time <= PART).count();
            odds += self.odds_of_part(&way[from..from + part]).unwrap_or(0.0);
            from += part;
        }
        odds.clamp(LEAST, MOST)
    }

    fn odds_of_part(&self, part: &[Place]) -> Option<f64> {
        if part.len() < FEWEST {
            return None;
        }
        let count = part.len() as f64;
        let gravity = self.gravity(part)?;
        let middle = part.iter().map(|place| place.time).sum::<f64>() / count;
        // Least squares of place, velocity and acceleration.
        let (mut normal, mut right) = (Matrix3::zeros(), [Vector3::zeros(); 2]);
        for place in part {
            let t = place.time - middle;
            let row = Vector3::new(1.0, t, t * t / 2.0);
            normal += row * row.transpose();
            right[0] += row * place.at.x;
            right[1] += row * place.at.y;
        }
        let inverse = normal.try_inverse()?;
        let bend = Vector2::new((inverse * right[0])[2], (inverse * right[1])[2]);
        let sigma = part.iter().map(|place| place.sigma).sum::<f64>() / count * inverse[(2, 2)].sqrt() / gravity.norm();
        let down = gravity.normalize();
        let [along, across] = [bend.dot(&down), bend.perp(&down)].map(|value| value / gravity.norm());
        let both = |spread: f64| student(along, spread.hypot(sigma)) + student(across, spread.hypot(sigma));
        let spread = SPREAD[usize::from(along > ALONG)];
        let ball = student(along - ALONG, spread.hypot(sigma)) + student(across, SPREAD_ACROSS.hypot(sigma));
        let other = STEADY_SHARE * both(STEADY).exp() + (1.0 - STEADY_SHARE) * both(ANYHOW).exp();
        Some((ball - other.ln()).clamp(-MOST_OF_PART, MOST_OF_PART))
    }

    /// The image of gravity where a ball of this size would be, px/s².
    fn gravity(&self, part: &[Place]) -> Option<Vector2<f64>> {
        let radius = median(part.iter().map(|place| place.radius))?;
        let sum = part.iter().fold(Vector2::zeros(), |sum, place| sum + place.at.coords);
        let depth = self.camera.intrinsic()[(1, 1)] * self.scene.ball.radius / radius;
        let at = self.camera.world_from_image(&Point2::from(sum / part.len() as f64), depth).ok()?;
        let (_, jacobian) = self.camera.image_from_world_with_jacobian(&at).ok()?;
        let gravity = jacobian * Vector3::from(self.scene.gravity);
        (gravity.norm() > 0.0 && gravity.norm().is_finite()).then_some(gravity)
    }
}

/// Logarithm of Student's density, without what is the same in all.
fn student(value: f64, spread: f64) -> f64 {
    -(FREEDOM + 1.0) / 2.0 * (1.0 + (value / spread).powi(2) / FREEDOM).ln() - spread.ln()
}
