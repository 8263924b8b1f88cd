//! Free flight with drag and lift whose size is not quite known, and the law of a bounce.

use nalgebra::Vector3;

use crate::physics::{Contact, Rigid, Scene, air_coefficients};

/// Longest step of the integration, s.
const LONGEST_STEP: f64 = 0.05;

/// A ball in flight: m, m/s, rad/s, in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moving {
    pub position: Vector3<f64>,
    pub velocity: Vector3<f64>,
    pub spin: Vector3<f64>,
}

/// What acts on a ball in the scene.
#[derive(Debug, Clone)]
pub struct Laws {
    gravity: Vector3<f64>,
    /// 1/m.
    drag: f64,
    /// Of ω×v.
    lift: f64,
    spin_decay: f64,
    drag_coefficient: f64,
    pub rigid: Rigid,
}

/// By what the forces differ from the scene's: logarithms of drag and lift, and gravity's share.
pub type Off = [f64; 3];

impl Laws {
    /// Of a scene whose contact model is `bounce` and in which nothing but gravity and the air acts; none else.
    pub fn of(scene: &Scene) -> Option<Self> {
        let Contact::Bounce { restitution, friction, .. } = scene.contact else { return None };
        let ball = &scene.ball;
        let [drag, lift] = air_coefficients(ball);
        let rigid = Rigid { radius: ball.radius, restitution, friction, inertia_factor: ball.inertia_factor };
        let gravity = Vector3::from(scene.gravity);
        scene.spring.is_none().then_some(Self {
            gravity,
            drag,
            lift,
            spin_decay: ball.spin_decay,
            drag_coefficient: ball.drag_coefficient,
            rigid,
        })
    }

    /// With gravity the other way.
    pub fn turned(&self) -> Self {
        Self { gravity: -self.gravity, ..self.clone() }
    }

    pub fn gravity(&self) -> &Vector3<f64> {
        &self.gravity
    }

    /// The scene's.
    pub fn drag_coefficient(&self) -> f64 {
        self.drag_coefficient
    }

    /// Of the Magnus acceleration, of ω×v.
    pub fn lift(&self) -> f64 {
        self.lift
    }

    /// With these coefficients of gravity, drag and lift.
    fn acceleration(
        &self,
        velocity: &Vector3<f64>,
        spin: &Vector3<f64>,
        [gravity, drag, lift]: [f64; 3],
    ) -> Vector3<f64> {
        gravity * self.gravity - drag * velocity.norm() * velocity + lift * spin.cross(velocity)
    }

    /// The ball `dt` s later (negative: earlier), by Runge and Kutta's fourth-order steps.
    pub fn moved(&self, from: &Moving, dt: f64, off: &Off) -> Moving {
        let steps = (dt.abs() / LONGEST_STEP).ceil().max(1.0);
        let h = dt / steps;
        let coefficients = [1.0 + off[2], self.drag * off[0].exp(), self.lift * off[1].exp()];
        let mut at = *from;
        for _ in 0..steps as usize {
            let slope = |velocity: &Vector3<f64>| self.acceleration(velocity, &at.spin, coefficients);
            let v1 = at.velocity;
            let a1 = slope(&v1);
            let v2 = v1 + a1 * (h / 2.0);
            let a2 = slope(&v2);
            let v3 = v1 + a2 * (h / 2.0);
            let a3 = slope(&v3);
            let v4 = v1 + a3 * h;
            let a4 = slope(&v4);
            at.position += (v1 + 2.0 * (v2 + v3) + v4) * (h / 6.0);
            at.velocity += (a1 + 2.0 * (a2 + a3) + a4) * (h / 6.0);
        }
        at.spin *= (-self.spin_decay * dt).exp();
        at
    }
}
