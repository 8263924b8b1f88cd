//! The `bounce` contact model: a rigid sphere, reflected at the instant of contact; where it no longer leaves, it rests,
//! slides or rolls.

mod carried;
mod impact;
mod rest;

pub use self::impact::Rigid;
use self::rest::{Carried, Support, normal_reaction};
use crate::columns::part;
use crate::motion::approach::STILL;
use crate::motion::integrate::Flow as _;
use crate::motion::run::{Depth, Model, Run, contact_time_change};
use crate::obstacle::Obstacle;
use crate::scene::Scene;

/// Height of a bounce below which a ball that is pressed on stays, m. What ends the infinitely many
/// bounces of a ball that comes to rest.
const REST_HEIGHT: f64 = 5e-8;
/// Gap below which a ball touches, m, and depth that rounding explains.
const TOUCHING: f64 = 1e-9;

#[derive(Debug, Clone)]
pub(crate) struct Bounce {
    rigid: Rigid,
    backwards: bool,
}

impl Model for Bounce {
    /// What carries the ball; nothing in flight.
    type Phase = Option<Support>;

    fn reversed(self) -> Self {
        let rigid = Rigid { restitution: 1.0 / self.rigid.restitution, ..self.rigid };
        Self { rigid, backwards: !self.backwards }
    }

    /// None is ordinary; put to touching.
    fn depth(&self, _: &Obstacle) -> Depth {
        let radius = self.rigid.radius;
        Depth { lowest: radius - TOUCHING, target: radius, touching: radius }
    }

    fn reach(&self) -> f64 {
        self.rigid.radius + TOUCHING
    }

    fn first<const M: usize>(&self, _: &Run<M>) -> Option<Support> {
        None
    }

    fn advance<const M: usize>(&self, run: &mut Run<M>, carried: Option<Support>) -> Option<Support> {
        if let Some(support) = carried {
            return self.carried(run, support);
        }
        if let Some(support) = self.support(run) {
            run.slope = None; // other forces
            return Some(support);
        }
        let touched = run.fly(self.rigid.radius)?;
        self.touch(run, touched)
    }
}

impl Bounce {
    pub fn new(scene: &Scene, restitution: f64, friction: f64) -> Self {
        let ball = &scene.ball;
        let rigid = Rigid { radius: ball.radius, restitution, friction, inertia_factor: ball.inertia_factor };
        Self { rigid, backwards: false }
    }

    /// The ball touches `obstacle` now.
    fn touch<const M: usize>(&self, run: &mut Run<M>, obstacle: usize) -> Option<Support> {
        run.record(obstacle);
        let rigid = match self.backwards {
            // What a stuck or rubbing contact did cannot be told from its result: undone without friction.
            true => {
                if self.rigid.friction > 0.0 || self.rigid.restitution.is_infinite() {
                    run.irreversible.get_or_insert(run.t);
                }
                let rebound = if self.rigid.restitution.is_finite() { self.rigid.restitution } else { 0.0 };
                Rigid { friction: 0.0, restitution: rebound, ..self.rigid }
            }
            false => self.rigid,
        };
        let near = run.obstacles[obstacle].nearest(&run.y.position());
        let forces = run.forces;
        let before = forces.derivative(&run.y.head());
        let closing = near.normal.dot(&run.y.velocity());
        let time_changes = run.y.0.map(|column| contact_time_change(&column, &near.normal, closing));
        run.y = rigid.reflect(&run.y, &near, &before, |after| forces.derivative(after));
        let leaving = near.normal.dot(&run.y.velocity());
        let free = forces.derivative(&run.y.head());
        let reaction = normal_reaction(&near, &part(&free.0[0], 1), &run.y.velocity());
        if leaving > STILL.max(rest_speed(reaction)) {
            return None;
        }
        // Stays on the surface, exactly; from here on the support acts, too.
        run.y = self.carrier(run, &Support { contacts: vec![obstacle], rolling: false }).project(&run.y);
        let mut support = self.support(run)?;
        support.rolling = self.carrier(run, &support).rolls(&run.y);
        run.y = self.carrier(run, &support).project(&run.y);
        let carried = self.carrier(run, &support).derivative(&run.y.head());
        run.shift_columns(time_changes, &free, &carried);
        run.y = self.carrier(run, &support).project(&run.y);
        Some(support)
    }

    /// The motion on a support.
    fn carrier<'s, const M: usize>(&self, run: &Run<'s, M>, support: &'s Support) -> Carried<'s> {
        Carried { forces: run.forces, obstacles: run.obstacles, support, rigid: self.rigid }
    }
}

/// Normal speed below which a ball that is pressed on with `reaction` (m/s²) stays, m/s.
fn rest_speed(reaction: f64) -> f64 {
    (2.0 * reaction.max(0.0) * REST_HEIGHT).sqrt()
}
