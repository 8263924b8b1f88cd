//! A ball's 3D position from a single picture of one calibrated camera, and its flight from a 2D track.
//!
//! ```text
//! picture ─► image ─► model (PEN) ─► heatmap, depth map ─► decode ─► x, y, z in the image
//!                                                                        │
//! camera.json ─────────────────────────────► camera ─► camera frame ─► world frame
//! ```
//!
//! Frames and units: `image` px with the first pixel's centre at (0, 0); `camera` OpenCV's axes (x right, y down, z forward);
//! `world` right-handed, z up; metres, seconds, radians.
//!
//! The method is that of "Towards Learning Monocular 3D Object Localization From 2D Labels Using the Physical Laws of Motion";
//! "paper eq. (n)" in the documentation speaks of it.
//!
//! A picture and a camera, and where the ball is:
//!
//! ```no_run
//! use gravisight::{Camera, Card, Device, LocaliseOptions, Localiser, Picture};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let (card, weights) = Card::with_weights("models/any.json".as_ref())?;
//! let localiser = Localiser::new(card, weights, &Device::flex())?;
//! let camera = Camera::from_file("camera.json".as_ref())?;
//! let picture = Picture::decode(&std::fs::read("tennis.jpg")?)?;
//! let options = LocaliseOptions { ball_radius: Some(0.0335), ..LocaliseOptions::default() };
//! let ball = pollster::block_on(localiser.localise(&picture, &camera, options))?;
//! println!("{:?} m, confidence {:.2}", ball.world, ball.confidence);
//! # Ok(())
//! # }
//! ```
//!
//! By subject, a module each; the names that a program begins with are at the top as well:
//!
//! - [`camera`]: [`Camera`]; from labelled points: [`Points`], [`Court`], [`Unknowns`], [`calibrate`], [`Calibration`]; from a
//!   picture of a court: [`find_court`]
//! - [`physics`]: [`Scene`], [`Contact`], [`State`]; [`Forecaster`], [`ForecastOptions`], [`Forecast`], [`Integrator`]
//! - [`track`]: [`Track`], [`Observation`]; [`Fit`], [`FitOptions`], [`Parameter`]; what [`VideoTracker`] finds in a video: [`TrackedVideo`]; in words for people: [`Findings`]
//! - [`image`], [`model`], [`localise`]: [`Picture`], [`Size`]; [`Card`], [`Device`]; [`Localiser`], [`LocaliseOptions`],
//!   [`Localisation`], [`Region`]
//! - [`clips`]: [`Clips`], [`Clip`], [`Frame`]
//! - [`train`]: [`FineTuner`], [`FineTuneOptions`], [`FineTuneSupervision`]; natively `TrainSettings`, `TrainConfig`, `TrainEvent`
//! - [`evaluate`]: [`score`], [`Sample`], [`Metrics`]
//! - [`Error`], [`Result`]
#![deny(missing_docs)]
#![warn(clippy::unwrap_used)]
#![cfg_attr(test, allow(clippy::unwrap_used))]
// What only the command and native training use; the native build says what nobody does.
#![cfg_attr(target_arch = "wasm32", allow(dead_code, unused_imports))]
#![deny(unsafe_code)]
#![recursion_limit = "256"]

/// Cameras: projection, lens models, files, and calibration from labelled points and lines, or from a picture of a court.
pub mod camera {
    pub use gravisight_geometry::camera::{
        AssumedCamera, Assumption, BallAt, Calibration, CalibrationMethod, Camera, CameraSigma, Circle, Court,
        CourtLine, CourtVerdict, Detection, Distortion, FoundCourt, FoundLine, KnownOfCamera, LensModel, LineSeen,
        OtherCourt, Outline, PointSigma, Points, Unknowns, WrongClick, assumed_camera, calibrate, calibrate_by_lines,
        find_court,
    };
}
/// Clips on disk: pictures with their labels, cameras and scenes.
pub mod clips {
    pub use gravisight_clips::{Clip, Clips, Frame};
}
/// Pictures: decoded, resized and normalised.
pub mod image {
    pub use gravisight_geometry::image::{MAX_PIXELS, MIN_SIDE, NetworkInput, Normalisation, Picture};
}
/// The laws of motion: scenes, forces, contacts, and forecasts with their derivatives.
pub mod physics {
    #[doc(hidden)]
    pub use gravisight_physics::Case;
    pub use gravisight_physics::{
        Ball, Bounds, Contact, Cuboid, Floor, Forecast, ForecastOptions, Forecaster, Impact, Integrator, Moved,
        Potential, Rotation, Scene, Spring, State, Status, Surface, Wall,
    };
}
/// A ball through time: from a video to its 2D track ([`VideoTracker`]), from a 2D track to its trajectory in space ([`Fit`]).
pub mod track {
    pub use gravisight_track::{
        AssociationConfig, BackgroundConfig, BlobsConfig, ClutterConfig, EvidenceConfig, FallConfig, FlightConfig,
        GravityConfig, QueriesConfig, RadiiConfig, RegistrationConfig, RepeatsConfig, SlowConfig, TrackletsConfig,
        WeightsConfig,
    };
    #[doc(hidden)]
    pub use gravisight_track::{BallTracker, FrameId, Hypotheses, Query, SOLVER_VERSION, Stack, TrackletFeatures};
    pub use gravisight_track::{
        CameraMotion, Estimate, EstimatorConfig, Fit, FitOptions, FitSummary, FittedFrame, FittedImpact, FittedSegment,
        Flight, FollowedFrame, Hit, Observation, OtherFrame, OtherTrack, OtherView, Parameter, Track, TrackPoint,
        TrackedBlob, TrackedFrame, TrackedVideo, TrackerConfig,
    };
}
pub use gravisight_track::findings;

pub mod evaluate;
#[cfg(all(feature = "wgpu", not(target_arch = "wasm32")))]
mod gpu;
pub mod localise;
pub mod model;
pub mod train;
mod video_tracker;

// Tests beside the code share their helpers with those outside, which see the surface alone.
#[cfg(test)]
extern crate self as gravisight;
#[cfg(test)]
mod testing;

pub use burn::tensor::Device;

pub use self::camera::{
    Calibration, Camera, Court, CourtLine, CourtVerdict, FoundCourt, LineSeen, Points, Unknowns, calibrate,
    calibrate_by_lines, find_court,
};
pub use self::clips::{Clip, Clips, Frame};
pub use self::evaluate::{Metrics, Sample, score};
pub use self::findings::{Findings, WithFindings};
#[cfg(all(feature = "wgpu", not(target_arch = "wasm32")))]
pub use self::gpu::Gpu;
pub use self::image::Picture;
pub use self::localise::{Localisation, LocaliseOptions, Localiser, Region};
pub use self::model::Card;
pub use self::physics::{Contact, Forecast, ForecastOptions, Forecaster, Integrator, Scene, State};
pub use self::track::{Fit, FitOptions, Observation, Parameter, Track, TrackedVideo};
pub use self::train::{AdaptOptions, AdaptScore, Adapted, Adapter, FineTuneOptions, FineTuneSupervision, FineTuner};
#[cfg(not(target_arch = "wasm32"))]
pub use self::train::{TrainConfig, TrainEvent, TrainSettings};
pub use self::video_tracker::VideoTracker;
pub use gravisight_geometry::error::{Error, Result};
pub use gravisight_geometry::size::Size;
pub use gravisight_geometry::volume::Volume;

/// Names that are in the modules of their subjects.
#[doc(hidden)]
pub mod parts {
    pub use crate::camera::{Detection, Distortion, LensModel, Outline};
    pub use crate::evaluate::{Bins, CalibrationGroup, DepthMapScore, Statistic, score_depth_maps};
    pub use crate::localise::{Candidate, Maps, Saliency};
    pub use crate::model::ConfidenceKind;
    pub use crate::physics::{Cuboid, Impact, Potential};
    pub use crate::track::{
        CameraMotion, Estimate, EstimatorConfig, FitSummary, FittedFrame, FittedImpact, FittedSegment, Flight,
        FollowedFrame, Hit, OtherFrame, OtherTrack, OtherView, TrackedBlob, TrackedFrame, TrackerConfig,
    };
    pub use crate::train::{Added, ClipKey, Score, Tuned};
}

/// What the workspace's other packages and benches share with this one; no promise to anybody else.
#[doc(hidden)]
#[cfg(not(target_arch = "wasm32"))]
pub mod internal {
    pub use crate::model::{
        ANY, BackboneConfig, CARD_VERSION, HeadConfig, Pen, PenConfig, PenOutput, SD_L, save, sha256_hex,
    };
    pub use crate::train::bench::{AdamW, Batch, HeatmapLoss, Labels, StepOptions, step};
    pub use crate::train::{BallsOfFrame, CutStack, StackCutter};
    pub use crate::train::{Photographs, read_photographs};
    pub use crate::train::{Supervision, TrainProgress, Validation};
    pub use gravisight_geometry::camera::{COURT_FEATURES, court_evidence};
    pub use gravisight_geometry::files::{Claim, NewFolder, read, read_text, write_whole};
    pub use gravisight_geometry::image::Normalisation;
    pub use gravisight_geometry::random::{Random, mixed, normal_pair};
    pub use gravisight_geometry::statistics::median;
    pub use gravisight_geometry::table::{Row, Table};
    pub use gravisight_geometry::volume::check_ball_radius;
    pub use gravisight_physics::Case;
    pub use gravisight_synth::looking;
    pub use gravisight_synth::{Apparent, Film, Filmed, Kind, LabelledPhotograph, RandomScenes};
    pub use gravisight_synth::{Balls, Drawn, Flights};
    pub use gravisight_synth::{Compression, Moves, Recording};
    pub use gravisight_synth::{CourtPicture, courts};
    pub use gravisight_synth::{Disturbance, Engine, Set, Shot, Site, Split, Studio};
    pub use gravisight_track::SOLVER_VERSION;
    pub use gravisight_track::{BallTracker, FrameId, Hypotheses, Query, Stack, TrackPoint, TrackletFeatures};
}
