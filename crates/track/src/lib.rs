//! A ball through time: from a video to its 2D track (`VideoTracker`), from a 2D track to its trajectory in
//! space ([`Fit`]).
#![deny(missing_docs, unsafe_code)]
#![warn(clippy::unwrap_used)]
#![cfg_attr(test, allow(clippy::unwrap_used))]
// What only the command and native training use; the native build says what nobody does.
#![cfg_attr(target_arch = "wasm32", allow(dead_code, unused_imports))]

mod config;
mod estimate;
mod file;
pub mod findings;
mod fit;
mod observation;
mod result;
mod segments;
mod tracked;
mod video;

pub use self::config::{EstimatorConfig, FitOptions, Parameter};
pub use self::file::{Track, TrackPoint};
#[doc(hidden)]
pub use self::fit::SOLVER_VERSION;
pub use self::observation::Observation;
pub use self::result::{Estimate, Fit, FitSummary, FittedFrame, FittedImpact, Flight, Hit};
#[doc(hidden)]
pub use self::tracked::common_size_sigma;
pub(crate) use self::tracked::listed;
pub use self::tracked::{FittedSegment, OtherView, TrackedFrame, TrackedVideo};
#[doc(hidden)]
pub use self::video::STACK_SIDE;
pub use self::video::{
    AssociationConfig, BackgroundConfig, BlobsConfig, ClutterConfig, EvidenceConfig, FallConfig, FlightConfig,
    GravityConfig, QueriesConfig, RadiiConfig, RegistrationConfig, RepeatsConfig, SlowConfig, TrackerConfig,
    TrackletsConfig, WeightsConfig,
};
#[doc(hidden)]
pub use self::video::{BallTracker, FrameId, Hypotheses, Query, Stack, TrackletFeatures};
pub use self::video::{CameraMotion, FollowedFrame, OtherFrame, OtherTrack, TrackedBlob};
