//! What happens where the ball meets an obstacle: the contact models, each in its own file.

mod bounce;
mod penalty;
mod spring;

use nalgebra::Vector3;

use self::bounce::Bounce;
pub use self::bounce::Rigid;
use self::penalty::Penalty;
use self::spring::Elastic;
use super::motion::Status;
use super::motion::run::{Depth, Model, Run};
use super::obstacle::Obstacle;
use super::scene::{Contact, Scene};

/// A scene's contact model.
#[derive(Debug, Clone)]
pub(crate) enum Contacts {
    Penalty(Penalty),
    Elastic(Elastic),
    Bounce(Bounce),
}

/// The same expression for whichever model it is.
macro_rules! each {
    ($contacts:expr, $model:ident => $value:expr) => {
        match $contacts {
            Contacts::Penalty($model) => $value,
            Contacts::Elastic($model) => $value,
            Contacts::Bounce($model) => $value,
        }
    };
}

impl Contacts {
    pub fn of(scene: &Scene) -> Self {
        match scene.contact {
            Contact::Penalty { c, beta, beta_box } => Self::Penalty(Penalty::new(scene, c, beta, beta_box)),
            Contact::Spring { stiffness } => Self::Elastic(Elastic::new(scene, stiffness)),
            Contact::Bounce { restitution, friction, .. } => Self::Bounce(Bounce::new(scene, restitution, friction)),
        }
    }

    /// [`Model::reversed`].
    pub fn reversed(self) -> Self {
        match self {
            Self::Penalty(model) => Self::Penalty(model.reversed()),
            Self::Elastic(model) => Self::Elastic(model.reversed()),
            Self::Bounce(model) => Self::Bounce(model.reversed()),
        }
    }

    /// [`Model::depth`].
    pub fn depth(&self, obstacle: &Obstacle) -> Depth {
        each!(self, model => model.depth(obstacle))
    }

    /// [`Model::reach`].
    pub fn reach(&self) -> f64 {
        each!(self, model => model.reach())
    }

    /// [`Model::acceleration`], without its partials.
    pub fn acceleration(&self, obstacles: &[Obstacle], r: &Vector3<f64>) -> Vector3<f64> {
        each!(self, model => model.acceleration(obstacles, r, None))
    }

    /// [`Model::potential_energy`].
    pub fn potential_energy(&self, obstacles: &[Obstacle], r: &Vector3<f64>) -> f64 {
        each!(self, model => model.potential_energy(obstacles, r))
    }

    /// Runs to the last time, or to what stops it.
    pub fn drive<const M: usize>(&self, run: &mut Run<M>) -> Status {
        each!(self, model => run.driven_by(model))
    }
}
