//! What happens where the ball meets an obstacle: the contact models, each in its own file.

mod bounce;
mod penalty;
mod spring;

use nalgebra::Vector3;

use self::bounce::Bounce;
pub(crate) use self::bounce::Rigid;
use self::penalty::Penalty;
use self::spring::Elastic;
use super::force::Partials;
use super::forecast::Status;
use super::forecast::guard::Depth;
use super::forecast::run::Run;
use super::obstacle::Obstacle;
use super::scene::{Contact, Scene};

/// A contact model.
pub(crate) trait Model {
    /// What the ball is doing: which obstacles press on it or carry it.
    type Phase;

    /// The same as time runs backwards.
    fn reversed(self) -> Self;

    /// How deep in `obstacle` a start may lie, and where deeper ones are put.
    fn depth(&self, obstacle: &Obstacle) -> Depth;

    /// Distance of the ball's centre from an obstacle below which it is in contact, m.
    fn reach(&self) -> f64;

    /// Acceleration by obstacles whose force is there all the time, m/s²; its partials are added.
    fn acceleration(&self, _: &[Obstacle], _: &Vector3<f64>, _: Option<&mut Partials>) -> Vector3<f64> {
        Vector3::zeros()
    }

    /// Potential energy of what the obstacles do, J/kg.
    fn potential_energy(&self, _: &[Obstacle], _: &Vector3<f64>) -> f64 {
        0.0
    }

    /// What the ball is doing at the start of a run.
    fn first<const M: usize>(&self, run: &Run<M>) -> Self::Phase;

    /// Moves a run on: to the next event, by a step, or to the last time. Returns what the ball is doing then.
    fn advance<const M: usize>(&self, run: &mut Run<M>, phase: Self::Phase) -> Self::Phase;
}

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
