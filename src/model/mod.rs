//! PEN, the position estimation network: one picture in, a heatmap and a depth map out.
//!
//! Burn only; no camera, no files but weights. The device is always an argument.

mod backbone;
#[cfg(not(target_arch = "wasm32"))]
mod built_in;
mod card;
mod config;
mod decode;
mod head;
mod layers;
mod operation;
mod pen;
mod plan;
mod tensors;
#[cfg(test)]
mod tests;
mod weights;

pub use self::backbone::BackboneConfig;
#[cfg(not(target_arch = "wasm32"))]
pub use self::built_in::{ANY, SD_L};
pub use self::card::{Card, ConfidenceKind, DepthFrom, check_input, sha256_hex};
#[cfg(test)]
pub use self::config::HeatmapConfig;
pub(crate) use self::config::{CLOSER_RADIUS, CLOSER_SIDE};
pub use self::config::{HeadConfig, PenConfig};
pub use self::decode::{CONFIDENCE_RADIUS, Decoded, Maps, Peak, confidence, decode, peaks};
pub(crate) use self::decode::{cell_centre, weighted_depth};
pub use self::pen::{Pen, PenOutput, PenRunner};
#[cfg(not(target_arch = "wasm32"))]
pub use self::weights::joined;
pub use self::weights::{halved, load, load_backbone_timm, load_into, on_cpu, parted, save};
