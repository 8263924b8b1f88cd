//! A ball's 3D position from a single picture of one calibrated camera.
#![warn(missing_docs, clippy::unwrap_used)]
#![cfg_attr(test, allow(clippy::unwrap_used))]
#![deny(unsafe_code)]
#![recursion_limit = "256"]

mod camera;
mod clips;
mod error;
mod evaluate;
#[cfg(not(target_arch = "wasm32"))]
mod files;
pub mod image;
pub mod kernels;
mod least_squares;
mod localise;
pub mod model;
mod physics;
mod size;
mod synth;
mod table;
mod track;
pub mod train;
#[cfg(target_arch = "wasm32")]
mod wasm;

// Tests beside the code share their helpers with those outside, which see the surface alone.
#[cfg(test)]
extern crate self as gravisight;
#[cfg(test)]
mod testing;

pub use burn::tensor::Device;

pub use self::camera::{Calibration, Camera, Court, Distortion, Points, Unknowns, calibrate};
pub use self::clips::{Clip, Clips, Frame};
pub use self::error::{Error, Result};
pub use self::evaluate::{Bins, Metrics, Sample, Statistic, score};
pub use self::image::Picture;
pub use self::localise::{Localisation, LocaliseOptions, Localiser, Maps, Saliency};
pub use self::model::Card;
pub use self::physics::{Case, Contact, Forecast, Forecaster, Integrator, Options, Scene, State};
pub use self::size::Size;
pub use self::synth::{Engine, Set, Shot, Split, Studio};
pub use self::track::{
    Fit, FitOptions, LabelOptions, Observation, Parameter, Proposal, Track, TrackPoint, propose_labels,
};
pub use self::train::{FineTuneOptions, FineTuner, Recipe};
#[cfg(not(target_arch = "wasm32"))]
pub use self::train::{TrainConfig, TrainEvent, TrainProgress, TrainSettings, Validation, resume_run, start_run};

/// What the workspace's other packages share with this one; no promise to anybody else.
#[doc(hidden)]
#[cfg(not(target_arch = "wasm32"))]
pub mod internal {
    pub use crate::files::{NewFolder, write_whole};
    pub use crate::table::{Row, Table};
}
