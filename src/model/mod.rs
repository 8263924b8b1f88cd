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
#[cfg(feature = "wgpu")]
mod on_gpu;
#[cfg(not(feature = "wgpu"))]
#[path = "no_gpu.rs"]
mod on_gpu;
mod operation;
mod pen;
mod plan;
mod tensors;
#[cfg(test)]
mod tests;
mod weights;

pub use self::backbone::BackboneConfig;
pub(crate) use self::backbone::PICTURE_CHANNELS;
#[cfg(not(target_arch = "wasm32"))]
#[doc(hidden)]
pub use self::built_in::{ANY, SD_L};
#[doc(hidden)]
pub use self::card::CARD_VERSION;
pub(crate) use self::card::check_input;
#[doc(hidden)]
pub use self::card::sha256_hex;
pub use self::card::{Card, ConfidenceKind, DepthFrom, DetectionCalibration};
pub use self::config::{DepthActivation, DepthConfig, HeadConfig, HeatmapConfig, PenConfig};
pub(crate) use self::config::{MOTION_SIDE, VERIFIER_RADIUS, VERIFIER_SIDE};
pub(crate) use self::decode::weighted_depth;
pub(crate) use self::decode::{CONFIDENCE_RADIUS, Decoded, Peak, SizeMaps, cell_centre, confidence, decode, peaks};
#[doc(hidden)]
pub use self::pen::{Pen, PenOutput, PenRunner};
pub(crate) use self::tensors::is_cpu;
#[doc(hidden)]
pub use self::weights::save;
pub(crate) use self::weights::{bundled, halved, load, load_backbone, load_into, on_cpu, parted, unbundled};
pub(crate) use self::weights::{joined, nothing};
