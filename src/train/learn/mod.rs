//! Learning: losses, the step, what it changes (`trainer`), which the loop with its files (`run`) and the one in memory
//! (`fine_tune`) fraction; scores, and the model made (`publish`).

#[cfg(not(target_arch = "wasm32"))]
mod checkpoint;
mod ema;
mod fine_tune;
mod flat;
mod future;
mod knowledge;
mod launch;
mod laws;
#[cfg(not(target_arch = "wasm32"))]
mod log;
mod loss;
#[cfg(not(target_arch = "wasm32"))]
mod memory;
mod optimiser;
mod parts;
mod publish;
#[cfg(not(target_arch = "wasm32"))]
mod run;
mod score;
mod step;
mod trainer;

#[cfg(test)]
mod tests;

pub use self::fine_tune::{Added, ClipKey, FineTuneOptions, FineTuneSupervision, FineTuner, Tuned};
pub use self::optimiser::AdamW;
pub(super) use self::parts::Beside;
#[cfg(not(target_arch = "wasm32"))]
pub use self::run::{TrainEvent, TrainProgress, Validation};
pub use self::score::{Score, SizeScore};
pub use self::step::{StepOptions, step};
pub(super) use self::trainer::{Trainer, TrainerState};
