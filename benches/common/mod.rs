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

/// A bench: its name, what it runs with the user's arguments, and whether it has something to run on by itself.
pub type Bench = (&'static str, fn(&[String]), bool);

/// Runs the bench that the first argument names; a check runs each that can run by itself.
pub fn main(all: &[Bench], usage: &str) {
    if is_check() {
        for (name, run, _) in all.iter().filter(|(_, _, alone)| *alone) {
            println!("== {name}");
            run(&[]);
        }
        return;
    }
    let arguments = arguments();
    match arguments.split_first().and_then(|(first, rest)| Some((all.iter().find(|(name, ..)| name == first)?, rest))) {
        Some(((_, run, _), rest)) => run(rest),
        None => {
            println!("usage: {usage}, one of {}", all.iter().map(|(name, ..)| *name).collect::<Vec<_>>().join(", "))
        }
    }
}

/// An empty folder of a check's own in the system's folder for temporary files.
#[allow(dead_code)]
pub fn scratch(name: &str) -> std::path::PathBuf {
    let folder = std::env::temp_dir().join(format!("gravisight-check-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder for temporary files");
    folder
}

/// Upper ends of the classes of confidence that are compared with the share of what is right.
const CONFIDENCE_CLASSES: [f64; 6] = [0.8, 0.9, 0.95, 0.98, 0.999, 1.1];

/// Prints how often detections of about the same confidence are right; of each detection its confidence and whether it is right.
#[allow(dead_code)]
pub fn print_reliability(detections: &[(f64, bool)]) {
    let mut from = 0.0;
    for to in CONFIDENCE_CLASSES {
        let class: Vec<&(f64, bool)> =
            detections.iter().filter(|(confidence, _)| (from..to).contains(confidence)).collect();
        let all = class.len().max(1) as f64;
        let said = class.iter().map(|(confidence, _)| confidence).sum::<f64>() / all;
        let right = class.iter().filter(|(_, is_right)| *is_right).count() as f64 / all;
        println!("confidence {from:.3} to {to:.3}: {:>5} frames, {said:.3} said, {right:.3} right", class.len());
        from = to;
    }
}
