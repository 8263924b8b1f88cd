//! Where the tracker's numbers come from: each says so, and ever fewer may have been chosen.

use std::path::PathBuf;

/// Numbers of the tracker that were chosen, by hand or on something, and not fitted or physical. It may only fall.
const CHOSEN: usize = 145;
/// The three forms of a source.
const FORMS: [&str; 5] = ["physical, ", "measured on ", "fitted by scripts/", "chosen on ", "chosen by hand"];
/// Constants that are no numbers of the tracker: sizes of a network's input, of a patch and of samples, and how work is divided.
const STRUCTURAL: [&str; 17] = [
    "BAND",
    "FEW",
    "FIRST",
    "GRID",
    "HALF",
    "LINES",
    "MOST_MAGNIFIED",
    "MOST_SAMPLES",
    "NEIGHBOURS",
    "NONE",
    "PART",
    "REDUCED",
    "SIDE",
    "STACK_RADIUS",
    "STACK_SIDE",
    "STEP",
    "WHOLE",
];

fn sources(folder: &str) -> Vec<(PathBuf, String)> {
    let entries = std::fs::read_dir(crate::common::root().join(folder)).unwrap().map(|entry| entry.unwrap().path());
    let sources = entries.filter(|path| path.extension().is_some_and(|extension| extension == "rs"));
    sources.map(|path| (path.clone(), std::fs::read_to_string(path).unwrap())).collect()
}

#[test]
fn each_number_of_the_tracker_names_its_source_and_ever_fewer_were_chosen() {
    let mut chosen = 0;
    let files = sources("crates/track/src/video/config");
    for (path, text) in files.iter().filter(|(path, _)| !path.ends_with("mod.rs")) {
        let mut documentation = String::new();
        for line in text.lines().map(str::trim) {
            if let Some(more) = line.strip_prefix("/// ") {
                documentation = documentation + " " + more;
                continue;
            }
            if let Some((name, _)) = line.strip_prefix("pub ").and_then(|field| field.split_once(':')) {
                let source = documentation.rsplit_once("Source: ").map_or("", |(_, source)| source);
                let is_form = FORMS.iter().any(|form| source.starts_with(form)) && source.ends_with('.');
                assert!(is_form, "{}: `{name}` names no source as in {FORMS:?}", path.display());
                chosen += usize::from(source.starts_with("chosen"));
            }
            documentation.clear();
        }
    }
    assert_eq!(chosen, CHOSEN, "measure or derive what is new, or lower CHOSEN to the number that is left");
}

#[test]
fn the_tracker_has_no_other_numbers() {
    for (path, text) in sources("crates/track/src/video") {
        let text = text.split("#[cfg(test)]\nmod tests {").next().unwrap();
        for constant in text.split("const ").skip(1).filter_map(|rest| rest.split_once(": ")) {
            let name = constant.0;
            let is_name = name.chars().all(|c| c.is_ascii_uppercase() || c == '_');
            assert!(!is_name || STRUCTURAL.contains(&name), "{}: `{name}` belongs into TrackerConfig", path.display());
        }
    }
}
