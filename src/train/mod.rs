//! Training: from 2D labels to targets, batches, losses, the step, the loop, scores, checkpoints.
//!
//! [`step`] and what it needs run wherever Burn does, a browser included; the loop with its files
//! is native.

mod augment;
mod batch;
mod check;
pub mod config;
pub mod ema;
pub mod examples;
pub mod fine_tune;
pub mod future;
pub mod loss;
pub mod pictures;
pub mod score;
pub mod step;
pub mod teacher;
mod trainer;

#[cfg(not(target_arch = "wasm32"))]
mod checkpoint;
#[cfg(not(target_arch = "wasm32"))]
mod loader;
#[cfg(not(target_arch = "wasm32"))]
pub mod log;
#[cfg(not(target_arch = "wasm32"))]
mod memory;
#[cfg(not(target_arch = "wasm32"))]
mod prepare;
#[cfg(not(target_arch = "wasm32"))]
pub mod recipe;
#[cfg(not(target_arch = "wasm32"))]
pub mod run;
