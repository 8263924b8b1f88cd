//! Clips: pictures with their labels, cameras and scenes.

mod clips;

pub use self::clips::{Clip, Clips, Frame};
