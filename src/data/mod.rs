//! Clips (pictures with their labels, cameras and scenes), 2D tracks, proposals for labels, the paper's synthetic sets.

mod clips;
#[cfg(feature = "cli")]
pub mod import;
mod label;
pub mod synth;
mod table;
mod track;

pub use self::clips::{Clip, Clips, Frame};
pub use self::label::{DOUBTFUL, LabelOptions, Proposal, cvat_xml, labels_csv, propose_labels, track_of_labels};
pub use self::track::{Track, TrackPoint, trajectory_csv};
