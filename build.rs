//! Stops plain `wasm-pack build` in a checkout. It writes to `pkg`, which here is the npm package: its `package.json` and README would be
//! overwritten. The build script runs before wasm-pack touches that folder.

use std::env::var;
use std::path::Path;

/// Set by whoever calls wasm-pack with another folder, as scripts/build-wasm does.
const PERMIT: &str = "GRAVISIGHT_WASM_PACK";
/// How wasm-pack names the target; `cargo --target` does not set it.
const TARGET: &str = "CARGO_BUILD_TARGET";

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    for name in [TARGET, PERMIT] {
        println!("cargo::rerun-if-env-changed={name}");
    }
    let by_wasm_pack = var(TARGET).is_ok_and(|target| target.starts_with("wasm32"));
    // Not where we are somebody's dependency: the crate holds no npm package, and cargo marks what it fetched by git.
    let is_checkout = var("CARGO_MANIFEST_DIR").is_ok_and(|root| {
        let has = |file: &str| Path::new(&root).join(file).exists();
        has("pkg/package.json") && !has(".cargo-ok")
    });
    // `wasm-pack test` builds with cargo's profile for tests, and writes nothing. `wasm-pack build --dev` looks the same from here.
    let is_test = var("PROFILE").is_ok_and(|profile| profile == "debug");
    if by_wasm_pack && is_checkout && !is_test && var(PERMIT).is_err() {
        println!(
            "cargo::error=wasm-pack would overwrite the npm package in pkg/. Call `scripts/build-wasm cpu`, or name another \
             folder: `{PERMIT}=1 wasm-pack build --target web --out-dir FOLDER`."
        );
    }
}
