//! What the benches share.

/// Whether this is a check (`cargo test --bench NAME`, which passes no `--bench` to the program): then a bench runs once, on little, to show that it runs.
pub fn is_check() -> bool {
    !std::env::args().any(|argument| argument == "--bench")
}

/// The user's arguments, without options. A check has none: what `cargo test` passes on is meant for tests.
#[allow(dead_code)]
pub fn arguments() -> Vec<String> {
    match is_check() {
        true => vec![],
        false => std::env::args().skip(1).filter(|argument| !argument.starts_with("--")).collect(),
    }
}

/// An empty folder of a check's own in the system's folder for temporary files.
#[allow(dead_code)]
pub fn scratch(name: &str) -> std::path::PathBuf {
    let folder = std::env::temp_dir().join(format!("gravisight-check-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder for temporary files");
    folder
}
