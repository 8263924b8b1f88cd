//! The laws of motion: scenes, forces, contacts, and forecasts with their derivatives.
//!
//! Plain f64 in SI units and the world frame (right-handed, z up); no tensors. [`Forecaster`] is the
//! paper's physics-aware forecaster (PAF): from a state to the states at other times and their
//! Jacobians by the start, contacts included.

mod balls;
mod cases;
mod check;
mod contact;
mod court;
mod force;
mod forecast;
mod obstacle;
mod places;
mod scene;
mod state;
#[cfg(test)]
mod tests;

#[doc(hidden)]
pub use self::cases::Case;
pub(crate) use self::contact::Rigid;
pub(crate) use self::force::FORCES;
pub use self::force::Potential;
pub(crate) use self::forecast::columns::{Column, column, part};
pub(crate) use self::forecast::flight::{FreeFlight, Sensitivity};
pub use self::forecast::{Forecast, ForecastOptions, Forecaster, Impact, Integrator, Moved, Status};
pub(crate) use self::obstacle::Obstacle;
pub use self::obstacle::Surface;
pub use self::scene::{Ball, Bounds, Contact, Cuboid, Floor, Rotation, Scene, Spring, Wall};
pub use self::state::State;
