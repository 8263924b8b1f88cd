//! The library's tests, one program: it links Burn once.
#![cfg(not(target_arch = "wasm32"))]

mod adapt;
mod any;
mod architecture;
mod calibrate;
mod camera;
mod clicking;
mod common;
mod court_lines;
mod data;
mod evaluate;
mod fit;
mod long;
mod prose;
mod published;
mod rallies;
mod sources;
mod spoilt;
mod table;
mod threads;
mod training;
