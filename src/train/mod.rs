//! Training: the recipe (what a run is), the examples (clips, fitted and drawn in batches), the learning (loss, step, loop,
//! checkpoints).
//!
//! A step and what it needs run wherever Burn does, a browser included; the loop with its files is native.

mod adapt;
mod examples;
mod learn;
mod recipe;
#[cfg(test)]
mod testing;

pub use adapt::{AdaptFlights, AdaptOptions, AdaptScore, AdaptStep, Adapted, Adapter};
#[doc(hidden)]
pub use adapt::{BallsOfFrame, CutStack, StackCutter};
#[cfg(not(target_arch = "wasm32"))]
pub use examples::LeftOut;
#[cfg(not(target_arch = "wasm32"))]
#[doc(hidden)]
pub use examples::{Photographs, read_photographs};
pub use learn::{Added, ClipKey, FineTuneOptions, FineTuneSupervision, FineTuner, Score, SizeScore, Tuned};
#[cfg(not(target_arch = "wasm32"))]
pub use learn::{TrainEvent, TrainProgress, Validation};
pub use recipe::{
    Augmentation, FitConfig, FutureConfig, HeatmapLoss, Law, Network, Phase, Recipe, Select, Supervision, Velocity,
};
#[cfg(not(target_arch = "wasm32"))]
pub use recipe::{RunPaths, TrainConfig, TrainSettings};

/// For `benches/convolution`, which times a step by itself.
#[doc(hidden)]
pub mod bench {
    pub use super::examples::{Batch, Labels};
    pub use super::learn::{AdamW, StepOptions, step};
    pub use super::recipe::HeatmapLoss;
}
