//! Clips (pictures with their labels, cameras and scenes), 2D tracks, and the paper's synthetic sets.

mod clips;
#[cfg(feature = "cli")]
pub mod import;
pub mod synth;
mod track;

pub use self::clips::{Clip, Clips, Frame};
pub use self::track::{Track, TrackPoint, trajectory_csv};
