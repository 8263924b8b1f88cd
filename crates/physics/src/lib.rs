//! The laws of motion: scenes, forces, contacts, and forecasts with their derivatives.
//!
//! Plain f64 in SI units and the world frame (right-handed, z up); no tensors. [`Forecaster`] is the
//! paper's physics-aware forecaster (PAF): from a state to the states at other times and their
//! Jacobians by the start, contacts included.
#![deny(missing_docs, unsafe_code)]
#![warn(clippy::unwrap_used)]
#![cfg_attr(test, allow(clippy::unwrap_used))]
// What only the command and native training use; the native build says what nobody does.
#![cfg_attr(target_arch = "wasm32", allow(dead_code, unused_imports))]

mod balls;
mod cases;
mod check;
mod columns;
mod contact;
mod court;
mod force;
mod forecast;
mod motion;
mod obstacle;
mod places;
mod scene;
mod state;
#[cfg(test)]
mod tests;

#[doc(hidden)]
pub use self::cases::Case;
#[doc(hidden)]
pub use self::columns::{Column, column, part};
#[doc(hidden)]
pub use self::contact::Rigid;
#[doc(hidden)]
pub use self::force::FORCES;
pub use self::force::Potential;
pub use self::forecast::Forecaster;
#[doc(hidden)]
pub use self::forecast::Observed;
#[doc(hidden)]
pub use self::forecast::flight::{FreeFlight, Sensitivity};
pub use self::motion::{Forecast, ForecastOptions, Impact, Integrator, Moved, Status};
#[doc(hidden)]
pub use self::obstacle::Obstacle;
pub use self::obstacle::Surface;
pub use self::scene::{Ball, Bounds, Contact, Cuboid, Floor, Rotation, Scene, Spring, Wall};
pub use self::state::State;
