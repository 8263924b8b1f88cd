//! A ball through time: from a video to its 2D track ([`VideoTracker`](crate::VideoTracker)), from a 2D track to its trajectory in
//! space ([`Fit`]).

mod estimate;
mod file;
mod fit;
mod tracked;
mod video;

pub use self::estimate::EstimatorConfig;
pub use self::file::{Track, TrackPoint};
pub(crate) use self::fit::SOLVER_VERSION;
pub use self::fit::{
    Estimate, Fit, FitOptions, FitSummary, FittedFrame, FittedImpact, Flight, Hit, Observation, Parameter,
};
pub(crate) use self::tracked::listed;
pub use self::tracked::{FittedSegment, OtherView, TrackedFrame, TrackedVideo};
#[cfg(not(target_arch = "wasm32"))]
pub(crate) use self::video::STACK_SIDE;
#[doc(hidden)]
pub use self::video::{BallTracker, Evidence, Query, Stack};
pub use self::video::{CameraMotion, FollowedFrame, TrackedBlob, TrackerConfig};
