//! Clips (pictures with their labels, cameras and scenes) and 2D tracks.

mod clips;
#[cfg(feature = "cli")]
pub mod import;
mod track;

pub use self::clips::{Clip, Clips, Frame};
pub use self::track::{Track, TrackPoint, trajectory_csv};
