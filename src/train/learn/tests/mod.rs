//! Learning: steps, runs, fine-tuning.

mod fine_tune;
mod future;
mod memory;
mod run;
mod score;
mod step;
mod watch;
