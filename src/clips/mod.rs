//! Clips on disk: pictures with their labels, cameras and scenes.

mod clip;

pub use self::clip::{Clip, Clips, Frame};
