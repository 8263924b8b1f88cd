//! The kernels' tests in a wasm engine (`wasm-pack test --node`), where the crate's other tests cannot run; natively they run
//! with the crate's.
//! The room knows nothing of the crate, so that it can be compiled by itself.
#![cfg(target_arch = "wasm32")]

#[allow(dead_code, unused_imports)] // what only networks call
#[path = "../src/kernels/mod.rs"]
mod kernels;
