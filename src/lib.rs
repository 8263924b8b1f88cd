//! A ball's 3D position from a single picture of one calibrated camera.
//!
//! ```text
//! picture ─► image ─► model (PEN) ─► heatmap, depth map ─► decode ─► x, y, z in the image
//!                                                                        │
//! camera.json ─────────────────────────────► camera ─► camera frame ─► world frame
//! ```
//!
//! Frames and units: `image` px with the first pixel's centre at (0, 0); `camera` OpenCV's axes
//! (x right, y down, z forward); `world` right-handed, z up; metres, seconds, radians.
//!
//! The method is that of "Towards Learning Monocular 3D Object Localization From 2D Labels Using
//! the Physical Laws of Motion"; "paper eq. (n)" in the documentation speaks of it.
#![warn(missing_docs, clippy::unwrap_used)]
#![deny(unsafe_code)]
#![recursion_limit = "256"]

pub mod camera;
pub mod data;
#[cfg(feature = "cli")]
pub mod draw;
pub mod error;
pub mod evaluate;
#[cfg(not(target_arch = "wasm32"))]
pub mod files;
pub mod image;
pub mod kernels;
pub mod localise;
pub mod model;
pub mod physics;
#[cfg(feature = "cli")]
pub mod report;
pub mod train;
#[cfg(target_arch = "wasm32")]
mod wasm;

// The browser's tests of the kernels, in a build of their own.
#[cfg(all(target_arch = "wasm32", feature = "check-kernels"))]
extern crate self as gravisight;
#[cfg(all(target_arch = "wasm32", feature = "check-kernels"))]
#[allow(missing_docs, clippy::unwrap_used)]
#[path = "../tests/web/kernels.rs"]
mod check_kernels;

pub use camera::Camera;
pub use error::{Error, Result};
pub use image::Picture;
pub use localise::{Localisation, Localiser};
