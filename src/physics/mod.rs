//! The laws of motion: scenes, forces, contacts, and forecasts with their derivatives.
//!
//! Plain f64 in SI units and the world frame (right-handed, z up); no tensors. [`Forecaster`] is the
//! paper's physics-aware forecaster (PAF): from a state to the states at other times and their
//! Jacobians by the start, contacts included.

mod arc;
mod carried;
mod cases;
mod columns;
mod engine;
mod field;
mod forecast;
mod forecaster;
mod guard;
mod impact;
mod integrate;
mod obstacle;
mod pressed;
mod rest;
mod scene;
#[cfg(test)]
mod tests;

pub use self::cases::Case;
pub(crate) use self::columns::{Column, column, part};
pub use self::field::Potential;
pub use self::forecast::{Forecast, Impact, Options, State, Status};
pub use self::forecaster::Forecaster;
pub(crate) use self::forecaster::Transition;
pub use self::guard::Moved;
pub use self::integrate::Integrator;
pub use self::obstacle::Surface;
pub use self::scene::{Ball, Contact, Cuboid, Floor, Scene, Spring, Wall};
