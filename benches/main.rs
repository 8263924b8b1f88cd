//! The library's benches, one program.
//! `cargo bench --bench all -- NAME …` runs one; `cargo test --bench all` each of those that can run on little, once.

mod common;
mod convolution;
mod courts;
mod forecast;
mod numerics;
mod photographs;
mod random;
mod real;
mod rendering;
mod tracking;
mod training;
mod weights;

use mimalloc::MiMalloc;

/// The command's, for times as it has them.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

/// By name; whether it has something to run on by itself.
const ALL: [common::Bench; 11] = [
    ("convolution", convolution::run, true),
    ("courts", courts::run, false),
    ("forecast", forecast::run, true),
    ("numerics", numerics::run, true),
    ("photographs", photographs::run, true),
    ("random", random::run, true),
    ("real", real::run, true),
    ("rendering", rendering::run, true),
    ("tracking", tracking::run, true),
    ("training", training::run, true),
    ("weights", weights::run, false),
];

fn main() {
    common::main(&ALL, "cargo bench --bench all -- NAME …");
}
