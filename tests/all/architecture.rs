//! What the documents promise: modules import downward only, the README's numbers are measured, links lead somewhere.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

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

/// Which of the modules in `folder`, whose path in its crate is `prefix`, each of them imports. Tests do not count.
fn imports(folder: &Path, prefix: &str) -> BTreeMap<String, BTreeSet<String>> {
    let entries: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    let name = |path: &PathBuf| path.file_stem().unwrap().to_str().unwrap().to_string();
    let is_module = |name: &String| !["lib", "main", "mod", "tests", "testing"].contains(&name.as_str());
    let names: BTreeSet<String> = entries.iter().map(name).filter(is_module).collect();
    let first = |path: &str| path.split(|c: char| !c.is_alphanumeric() && c != '_').next().unwrap().to_string();
    let mut found = BTreeMap::<String, BTreeSet<String>>::new();
    for entry in entries.iter().filter(|entry| names.contains(&name(entry))) {
        let sources = if entry.is_dir() { files(entry, "rs") } else { vec![entry.clone()] };
        let is_test =
            |source: &Path| source.components().any(|part| part.as_os_str().to_string_lossy().starts_with("tests"));
        for source in sources.iter().filter(|source| !is_test(source.strip_prefix(folder).unwrap())) {
            let text = std::fs::read_to_string(source).unwrap();
            let text = text.split("#[cfg(test)]\nmod tests {").next().unwrap();
            let code = text.lines().filter(|line| !line.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n");
            // In a module's own file, `super` is the folder.
            let is_own = source == entry || source == &entry.join("mod.rs");
            let starts = [Some(prefix), is_own.then_some(" super::")];
            let all = starts.into_iter().flatten().flat_map(|start| code.split(start).skip(1)).map(first);
            let lists = format!("use {prefix}{{");
            let lists = code.split(&lists).skip(1).flat_map(|list| list.split('}').next().unwrap().split(','));
            let all = all.chain(lists.map(|name| first(name.trim())));
            found.entry(name(entry)).or_default().extend(all.filter(|it| names.contains(it) && *it != name(entry)));
        }
    }
    found
}

#[test]
fn modules_import_downward_only() {
    let root = crate::common::root();
    let crates = std::fs::read_dir(root.join("crates")).unwrap().map(|entry| entry.unwrap().path().join("src"));
    let mut folders: Vec<(PathBuf, &str)> = crates.map(|folder| (folder, "crate::")).collect();
    folders.extend(["src", "cli/src", "wasm/src"].map(|folder| (root.join(folder), "crate::")));
    folders.push((root.join("src/localise"), "crate::localise::"));
    for (folder, prefix) in folders {
        let mut left = imports(&folder, prefix);
        assert!(left.len() > 1 || !folder.starts_with(root.join("src")), "{}: no modules", folder.display());
        // What imports nothing that is left is at the bottom.
        while let Some(lowest) = left.iter().find(|(_, of)| of.is_empty()).map(|(name, _)| name.clone()) {
            left.remove(&lowest);
            for of in left.values_mut() {
                of.remove(&lowest);
            }
        }
        assert!(left.is_empty(), "{}: these import one another, or what does: {left:?}", folder.display());
    }
}

/// Most lines of a module, and those that are longer, which may only get shorter.
const LINES: usize = 400;
const LONGER: [(&str, usize); 3] = [
    ("crates/geometry/src/camera/courts.rs", 494),
    ("crates/physics/src/scene.rs", 423),
    ("crates/track/src/estimate/model.rs", 485),
];

#[test]
fn modules_stay_short() {
    let root = crate::common::root();
    let crates = std::fs::read_dir(root.join("crates")).unwrap().map(|entry| entry.unwrap().path().join("src"));
    let sources = crates.chain(["src", "cli/src", "wasm/src"].map(|folder| root.join(folder)));
    let mut found = BTreeMap::new();
    for file in sources.flat_map(|folder| files(&folder, "rs")) {
        let lines = std::fs::read_to_string(&file).unwrap().lines().count();
        if lines > LINES {
            found.insert(file.strip_prefix(&root).unwrap().display().to_string(), lines);
        }
    }
    let allowed: BTreeMap<String, usize> = LONGER.map(|(file, lines)| (file.to_string(), lines)).into();
    assert_eq!(
        found, allowed,
        "a module has more than {LINES} lines; if one in the list is shorter now, correct its number"
    );
}

#[test]
fn the_device_is_always_an_argument() {
    // `Device::default()` follows compiled features, not the hardware.
    let root = crate::common::root();
    let mut sources: Vec<PathBuf> =
        ["src", "wasm/src", "cli/src"].iter().flat_map(|folder| files(&root.join(folder), "rs")).collect();
    sources.sort();
    for source in sources {
        let text = std::fs::read_to_string(&source).unwrap();
        let code = text.lines().filter(|line| !line.trim_start().starts_with("//"));
        assert!(code.into_iter().all(|line| !line.contains("Device::default")), "{}", source.display());
    }
}

#[test]
fn the_documents_numbers_are_those_that_evaluate_wrote_into_the_card() {
    let read = |path: &str| std::fs::read_to_string(crate::common::root().join(path)).unwrap();
    let accuracy = read("docs/accuracy.md");
    for model in ["sd-l", "any"] {
        let card: serde_json::Value = serde_json::from_str(&read(&format!("models/{model}.json"))).unwrap();
        let number = |metric: &str, field: &str| card["metrics"][metric][field].as_f64().unwrap();
        let [dtg, deviation, median] = ["mean", "std", "median"].map(|field| number("dtg", field) * 100.0);
        let [error, spread, middle] = ["mean", "std", "median"].map(|field| number("image_error_px", field));
        for claim in [
            format!("{dtg:.1} ± {deviation:.1} cm, median {median:.1}"),
            format!("{error:.2} ± {spread:.2} px, median {middle:.2}"),
        ] {
            assert!(accuracy.contains(&claim), "docs/accuracy.md lacks `{claim}`");
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
    let root = crate::common::root();
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
