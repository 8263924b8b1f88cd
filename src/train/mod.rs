//! Training: configuration, batches, loss, step, loop, checkpoints.
//!
//! [`step`] and what it needs run wherever Burn does, a browser included; the loop with its files
//! is native.

pub mod config;
pub mod ema;
pub mod forecast;
pub mod loss;
pub mod step;

#[cfg(not(target_arch = "wasm32"))]
pub mod batch;
#[cfg(not(target_arch = "wasm32"))]
pub mod checkpoint;
#[cfg(not(target_arch = "wasm32"))]
pub mod run;
