//! PEN, the position estimation network: one picture in, a heatmap and a depth map out.
//!
//! Burn only; no camera, no files but weights. The device is always an argument.

mod backbone;
mod card;
mod config;
mod convnext;
mod decode;
mod head;
mod layers;
mod operation;
mod pen;
mod plan;
mod tensors;
mod weights;

pub use self::card::{Card, InputSize, check_input, sha256_hex};
pub use self::config::{BackboneConfig, DepthActivation, DepthConfig, HeadConfig, HeatmapConfig, PenConfig};
pub use self::decode::{CONFIDENCE_RADIUS, Decoded, confidence, decode};
pub(crate) use self::decode::{cell_centre, weighted_depth};
pub use self::pen::{Pen, PenOutput, PenRunner};
pub use self::weights::{halved, load, load_backbone_timm, load_into, on_cpu, save};
