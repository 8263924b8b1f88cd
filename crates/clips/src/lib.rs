//! Clips on disk: pictures with their labels, cameras and scenes.
#![deny(missing_docs, unsafe_code)]
#![warn(clippy::unwrap_used)]
#![cfg_attr(test, allow(clippy::unwrap_used))]
// What only the command and native training use; the native build says what nobody does.
#![cfg_attr(target_arch = "wasm32", allow(dead_code, unused_imports))]

mod clip;

pub use self::clip::{Clip, Clips, Frame};
