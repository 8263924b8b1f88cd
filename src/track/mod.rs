//! A ball through time: from a video to its 2D track ([`find`]), from a 2D track to its trajectory in space ([`fit`]).

mod file;
mod find;
mod fit;

pub use self::file::{Track, TrackPoint};
pub use self::find::{LabelOptions, Proposal, propose_labels};
pub use self::fit::{Fit, FitOptions, FittedFrame, Flight, Hit, Observation, Parameter};
