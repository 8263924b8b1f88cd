//! A ball through time: from a video to its 2D track ([`propose_labels`] for labels,
//! [`VideoTracker`](crate::VideoTracker) for what flies), from a 2D track to its trajectory in space ([`Fit`]).

mod estimate;
mod file;
mod find;
mod fit;
mod tracked;
mod video;

pub use self::estimate::EstimatorConfig;
pub use self::file::{Track, TrackPoint};
pub use self::find::{LabelOptions, Proposal, propose_labels};
pub(crate) use self::fit::SOLVER_VERSION;
pub use self::fit::{
    Estimate, Fit, FitOptions, FitSummary, FittedFrame, FittedImpact, Flight, Hit, Observation, Parameter,
};
pub use self::tracked::{FittedSegment, OtherView, TrackedFrame, TrackedVideo};
#[cfg(not(target_arch = "wasm32"))]
pub(crate) use self::video::STACK_SIDE;
#[doc(hidden)]
pub use self::video::{BallTracker, Query, Stack};
pub use self::video::{CameraMotion, FollowedFrame, TrackedBlob};
