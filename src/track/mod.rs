//! A ball through time: from a video to its 2D track ([`find`] for labels, [`follow`] for
//! what flies), from a 2D track to its trajectory in space ([`fit`]).

mod file;
mod find;
mod fit;
mod follow;
mod tracked;

pub use self::file::{Track, TrackPoint};
pub use self::find::{LabelOptions, Proposal, propose_labels};
pub use self::fit::{Fit, FitOptions, FittedFrame, Flight, Hit, Observation, Parameter, SOLVER_VERSION};
pub use self::follow::{Elsewhere, Followed, FollowedFrame, Follower};
pub use self::tracked::{Stretch, Tracked};
