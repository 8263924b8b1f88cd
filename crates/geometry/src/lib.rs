//! What the rest of gravisight stands on: cameras, pictures and contours, sizes and volumes, errors, files and tables, random numbers,
//! statistics and least squares. No networks.
//!
//! Frames and units: `image` px with the first pixel's centre at (0, 0); `camera` OpenCV's axes (x right, y down, z forward);
//! `world` right-handed, z up; metres, seconds, radians.
#![deny(missing_docs, unsafe_code)]
#![warn(clippy::unwrap_used)]
#![cfg_attr(test, allow(clippy::unwrap_used))]
// What only the command and native training use; the native build says what nobody does.
#![cfg_attr(target_arch = "wasm32", allow(dead_code, unused_imports))]

pub mod camera;
pub mod contour;
pub mod error;
pub mod files;
pub mod image;
pub mod least_squares;
pub mod random;
pub mod size;
pub mod statistics;
pub mod table;
pub mod volume;
