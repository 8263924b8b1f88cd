//! Clips (pictures with their labels, cameras and scenes), 2D tracks, and the paper's synthetic sets.

mod clips;
pub mod synth;
mod track;

pub use self::clips::{Clip, Clips, Frame};
pub use self::track::{Track, TrackPoint, trajectory_csv};
