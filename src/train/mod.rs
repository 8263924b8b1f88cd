//! Training: from 2D labels to targets, batches, losses, the step, the loop, scores, checkpoints.
//!
//! [`step`] and what it needs run wherever Burn does, a browser included; the loop with its files
//! is native.

mod check;
pub mod config;
pub mod ema;
pub mod future;
pub mod loss;
pub mod step;
pub mod teacher;

#[cfg(not(target_arch = "wasm32"))]
mod augment;
#[cfg(not(target_arch = "wasm32"))]
mod batch;
#[cfg(not(target_arch = "wasm32"))]
mod checkpoint;
#[cfg(not(target_arch = "wasm32"))]
pub mod examples;
#[cfg(not(target_arch = "wasm32"))]
mod loader;
#[cfg(not(target_arch = "wasm32"))]
pub mod log;
#[cfg(not(target_arch = "wasm32"))]
mod memory;
#[cfg(not(target_arch = "wasm32"))]
mod pictures;
#[cfg(not(target_arch = "wasm32"))]
pub mod recipe;
#[cfg(not(target_arch = "wasm32"))]
pub mod run;
#[cfg(not(target_arch = "wasm32"))]
pub mod score;
