//! What the documents promise: arrows between the rooms run downward only, the README's numbers are measured.

#![cfg(not(target_arch = "wasm32"))]

mod common;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What each room may use. `error`, `size` and the tests' `testing` are open to all.
const ARROWS: [(&str, &[&str]); 22] = [
    ("size", &[]),
    ("volume", &[]),
    ("random", &[]),
    ("statistics", &[]),
    ("error", &["size"]),
    ("files", &[]),
    ("table", &["files"]),
    ("least_squares", &[]),
    ("camera", &["files", "image", "least_squares", "volume"]),
    ("image", &["files", "kernels"]),
    ("kernels", &[]),
    ("model", &["image", "files", "kernels"]),
    ("physics", &["files", "volume"]),
    ("contour", &["camera", "image", "statistics"]),
    ("track", &["camera", "contour", "image", "kernels", "least_squares", "physics", "statistics", "table"]),
    ("findings", &["camera", "physics", "track"]),
    ("clips", &["camera", "files", "image", "physics"]),
    ("localise", &["camera", "contour", "image", "kernels", "model", "volume"]),
    ("evaluate", &["camera", "clips", "image", "localise"]),
    ("synth", &["camera", "clips", "physics", "random"]),
    (
        "train",
        &[
            "camera",
            "clips",
            "evaluate",
            "files",
            "image",
            "localise",
            "model",
            "physics",
            "random",
            "statistics",
            "synth",
            "track",
        ],
    ),
    ("video_tracker", &["camera", "image", "localise", "physics", "track"]),
];
/// The browser's boundary, above everything.
const WASM: (&str, &[&str]) = (
    "wasm",
    &[
        "camera",
        "clips",
        "evaluate",
        "findings",
        "image",
        "kernels",
        "localise",
        "model",
        "physics",
        "synth",
        "track",
        "train",
        "video_tracker",
    ],
);
/// Rooms that compile without Burn.
const WITHOUT_BURN: [&str; 17] = [
    "random",
    "statistics",
    "volume",
    "size",
    "error",
    "files",
    "table",
    "least_squares",
    "camera",
    "contour",
    "image",
    "kernels",
    "physics",
    "track",
    "findings",
    "clips",
    "synth",
];

fn files(folder: &Path, ending: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries
        .flat_map(|path| match path.is_dir() {
            true => files(&path, ending),
            false if path.extension().is_some_and(|extension| extension == ending) => vec![path],
            false => vec![],
        })
        .collect()
}

/// Room name -> its source text, tests and comments left out.
fn rooms() -> BTreeMap<String, String> {
    let src = common::root().join("src");
    let mut rooms: BTreeMap<String, String> = BTreeMap::new();
    let tests =
        |path: &Path| path.iter().any(|part| ["tests", "tests.rs", "testing.rs"].iter().any(|name| part == *name));
    for path in files(&src, "rs").into_iter().filter(|path| !tests(path)) {
        let relative = path.strip_prefix(&src).unwrap();
        if relative.iter().any(|part| part == "tests" || part == "tests.rs" || part == "testing.rs") {
            continue; // tests may see all
        }
        let room = relative.iter().next().unwrap().to_string_lossy().trim_end_matches(".rs").to_string();
        let text = std::fs::read_to_string(&path).unwrap();
        let code = text.lines().filter(|line| !line.trim_start().starts_with("//"));
        rooms.entry(room).or_default().extend(code.map(|line| format!("{line}\n")));
    }
    rooms
}

/// Rooms named after `crate::` in `code`.
fn used(code: &str) -> Vec<&str> {
    let parts = code.split("crate::").skip(1);
    parts.map(|rest| rest.split(|c: char| !c.is_alphanumeric() && c != '_').next().unwrap()).collect()
}

#[test]
fn no_arrow_runs_up() {
    let rooms = rooms();
    let known: BTreeMap<_, _> = ARROWS.into_iter().chain([WASM]).collect();
    for (room, code) in &rooms {
        if room == "lib" || room == "testing" {
            continue; // the map, and what tests of all rooms share
        }
        let allowed = known.get(room.as_str()).unwrap_or_else(|| panic!("room `{room}` has no place in the diagram"));
        for target in used(code) {
            let fine = target == room || ["error", "size"].contains(&target) || allowed.contains(&target);
            assert!(fine, "`{room}` uses `{target}`, which is not below it");
        }
    }
}

#[test]
fn geometry_pictures_and_clips_know_no_burn() {
    for (room, code) in rooms() {
        let burn = code.contains("burn::");
        assert!(!(WITHOUT_BURN.contains(&room.as_str()) && burn), "`{room}` uses Burn");
    }
}

#[test]
fn the_device_is_always_an_argument() {
    // `Device::default()` follows compiled features, not the hardware.
    for (room, code) in rooms() {
        assert!(!code.contains("Device::default"), "`{room}` calls Device::default");
    }
}

#[test]
fn the_readmes_numbers_are_those_that_evaluate_wrote_into_the_card() {
    let read = |path: &str| std::fs::read_to_string(common::root().join(path)).unwrap();
    let readme = read("README.md");
    for model in ["sd-l", "any"] {
        let card: serde_json::Value = serde_json::from_str(&read(&format!("models/{model}.json"))).unwrap();
        let number = |metric: &str, field: &str| card["metrics"][metric][field].as_f64().unwrap();
        let [dtg, deviation, median] = ["mean", "std", "median"].map(|field| number("dtg", field) * 100.0);
        let [error, spread, middle] = ["mean", "std", "median"].map(|field| number("image_error_px", field));
        for claim in [
            format!("{dtg:.1} ± {deviation:.1} cm, median {median:.1}"),
            format!("{error:.2} ± {spread:.2} px, median {middle:.2}"),
        ] {
            assert!(readme.contains(&claim), "README.md lacks `{claim}`");
        }
    }
}

/// A heading's anchor, as forges make it.
fn anchor(heading: &str) -> String {
    let kept = heading.to_lowercase().chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c)).collect::<String>();
    kept.replace(' ', "-")
}

#[test]
fn links_between_the_documents_lead_somewhere() {
    let root = common::root();
    let mut documents: Vec<PathBuf> =
        ["docs", "models"].iter().flat_map(|folder| files(&root.join(folder), "md")).collect();
    documents.extend(
        ["README", "ARCHITECTURE", "CONTRIBUTING", "SECURITY", "pkg/README"]
            .map(|name| root.join(format!("{name}.md"))),
    );
    for document in documents {
        let text = std::fs::read_to_string(&document).unwrap();
        for link in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            if link.contains("://") {
                continue;
            }
            let (path, fragment) = link.split_once('#').unwrap_or((link, ""));
            let target = if path.is_empty() { document.clone() } else { document.parent().unwrap().join(path) };
            assert!(target.exists(), "{}: {link}", document.display());
            if !fragment.is_empty() && target.extension().is_some_and(|extension| extension == "md") {
                let text = std::fs::read_to_string(&target).unwrap();
                let headings = text
                    .lines()
                    .filter_map(|line| line.strip_prefix('#'))
                    .map(|line| anchor(line.trim_start_matches('#').trim()));
                let named = text.contains(&format!("id=\"{fragment}\""));
                assert!(
                    named || headings.into_iter().any(|heading| heading == fragment),
                    "{}: {link}",
                    document.display()
                );
            }
        }
    }
}
