//! How a state moves from one contact to the next, with its sensitivities. What happens in a contact is a [`run::Model`]'s matter.

pub(crate) mod approach;
pub(crate) mod closed_form;
pub(crate) mod integrate;
mod outcome;
pub(crate) mod run;

pub use self::integrate::Integrator;
pub use self::outcome::{Forecast, ForecastOptions, Impact, Moved, Status};
