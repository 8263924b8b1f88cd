//! The command's benches, one program.
//! `cargo bench --package gravisight-cli --bench all -- NAME …` runs one; `cargo test --package gravisight-cli --bench all` each of those that can run on little, once.

mod adapt;
#[path = "../../benches/common/mod.rs"]
mod common;
mod footage;
mod labelled;
mod tracklets;

use mimalloc::MiMalloc;

/// The command's, for times as it has them.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

/// By name; whether it has something to run on by itself.
const ALL: [common::Bench; 4] = [
    ("adapt", adapt::run, false),
    ("footage", footage::run, false),
    ("labelled", labelled::run, true),
    ("tracklets", tracklets::run, true),
];

fn main() {
    common::main(&ALL, "cargo bench --package gravisight-cli --bench all -- NAME …");
}
