//! docs/training.md lists every field of a run's configuration in the words of the source, with its default.
//! `GRAVISIGHT_WRITE=1 cargo test --test all training` writes the list anew.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::fs;

use gravisight::TrainSettings;

use crate::common::root;

const BEGIN: &str = "<!-- fields: written by tests/all/training.rs -->\n";
const END: &str = "<!-- /fields -->\n";

/// A field of a structure or a variant of an enumeration: its name in a configuration, and what its documentation says.
type Entry = (String, String);

/// The entries of `item` (`struct Recipe`) in a source, of its outermost braces alone.
fn entries(source: &str, item: &str) -> Vec<Entry> {
    let start = source.find(&format!("pub {item} {{")).unwrap_or_else(|| panic!("no `{item}`"));
    let head = source[..start].rsplit("\n\n").next().unwrap();
    let (mut found, mut depth, mut doc, mut renamed) = (vec![], 0_usize, String::new(), None);
    for line in source[start..].lines() {
        let line = line.trim();
        if depth == 1 {
            if let Some(text) = line.strip_prefix("///") {
                doc = format!("{doc} {}", text.trim());
            } else if let Some(name) = line.strip_prefix("#[serde(rename = \"") {
                renamed = name.split('"').next().map(String::from);
            } else if let Some(name) = line.strip_prefix("pub ") {
                found.push((name.split(':').next().unwrap().to_string(), std::mem::take(&mut doc)));
            } else if line.starts_with(char::is_uppercase) {
                let name: String = line.chars().take_while(|c| c.is_alphanumeric()).collect();
                let name = renamed.take().unwrap_or_else(|| in_configuration(&name, head));
                found.push((name, std::mem::take(&mut doc)));
            }
        }
        depth += line.matches('{').count();
        depth -= line.matches('}').count();
        if depth == 0 {
            break;
        }
    }
    assert!(!found.is_empty(), "`{item}` has nothing");
    found.into_iter().map(|(name, doc)| (name, doc.trim().to_string())).collect()
}

/// A variant's name by the rule of its enumeration.
fn in_configuration(name: &str, head: &str) -> String {
    let words = name.char_indices().map(|(at, c)| if at > 0 && c.is_uppercase() { format!("_{c}") } else { c.into() });
    match head.contains("snake_case") {
        true => words.collect::<String>().to_lowercase(),
        false => name.to_lowercase(),
    }
}

/// The configuration with what must be given and everything else at its default.
fn defaults() -> toml::Table {
    let mut settings = TrainSettings::default();
    for field in [
        "name=x",
        "supervision=physics-fit",
        "input={width=224,height=224}",
        "phases=[{steps=1,batch=1,learning_rate=1e-3}]",
    ] {
        settings.set(field).unwrap();
    }
    toml::from_str(&settings.whole().unwrap()).unwrap()
}

/// ` (default)` where there is one; what must be given says so.
fn default(table: &toml::Table, name: &str, needed: &[&str]) -> String {
    match table.get(name) {
        _ if needed.contains(&name) => " (required)".into(),
        Some(toml::Value::Table(_)) | None => String::new(),
        Some(toml::Value::String(text)) if text.is_empty() => String::new(),
        Some(value) => format!(" ({value})"),
    }
}

fn list(text: &mut String, entries: &[Entry], table: &toml::Table, needed: &[&str], values: &[(&str, Vec<Entry>)]) {
    for (name, doc) in entries {
        writeln!(text, "- `{name}`{}: {doc}", default(table, name, needed)).unwrap();
        for (value, doc) in values.iter().filter(|(of, _)| of == name).flat_map(|(_, values)| values) {
            writeln!(text, "  - `{value}`: {doc}").unwrap();
        }
    }
}

fn fields() -> String {
    let read = |name: &str| fs::read_to_string(root().join("src/train/recipe").join(name)).unwrap();
    let (recipe, parts, paths) = (read("mod.rs"), read("parts.rs"), read("paths.rs"));
    let all = defaults();
    let table = |name: &str| all[name].as_table().unwrap().clone();
    let none = toml::Table::new();
    let mut text = String::from("### Files\n\n");
    list(&mut text, &entries(&paths, "struct RunPaths"), &none, &["out"], &[]);
    text += "\n### Fields of a run\n\n";
    let fields = entries(&recipe, "struct Recipe");
    let names: BTreeSet<&str> = fields.iter().map(|(name, _)| name.as_str()).collect();
    assert!(all.keys().all(|name| names.contains(name.as_str())), "every field of a printed configuration is listed");
    let values = [
        ("network", entries(&parts, "enum Network")),
        ("select", entries(&parts, "enum Select")),
        ("heatmap_loss", entries(&parts, "enum HeatmapLoss")),
    ];
    list(&mut text, &fields, &all, &["name", "supervision", "input", "phases"], &values);
    text += "\n### `phases`: batch size and learning-rate schedule\n\n";
    list(&mut text, &entries(&parts, "struct Phase"), &none, &["steps", "batch", "learning_rate"], &[]);
    text += "\n### `supervision`: the source of depth supervision\n\n";
    list(&mut text, &entries(&parts, "enum Supervision"), &none, &[], &[]);
    text += "\n### `future`: supervision through forecasts\n\n";
    let values = [("velocity", entries(&parts, "enum Velocity")), ("learn", entries(&parts, "enum Law"))];
    list(&mut text, &entries(&parts, "struct FutureConfig"), &table("future"), &[], &values);
    text += "\n### `fit`: the physics fit to 2D labels\n\n";
    list(&mut text, &entries(&parts, "struct FitConfig"), &table("fit"), &[], &[]);
    text += "\n### `augmentation`: random changes to training pictures\n\n";
    list(&mut text, &entries(&parts, "struct Augmentation"), &table("augmentation"), &[], &[]);
    text
}

#[test]
fn the_page_lists_every_field_as_it_is() {
    let page = root().join("docs/training.md");
    let text = fs::read_to_string(&page).unwrap();
    let (before, rest) = text.split_once(BEGIN).expect("the list's beginning");
    let (listed, after) = rest.split_once(END).expect("the list's end");
    let fields = format!("\n{}\n", fields());
    if std::env::var_os("GRAVISIGHT_WRITE").is_some() {
        fs::write(&page, format!("{before}{BEGIN}{fields}{END}{after}")).unwrap();
        return;
    }
    assert!(listed == fields, "docs/training.md is out of date: GRAVISIGHT_WRITE=1 cargo test --test all training");
}

#[test]
fn the_page_names_every_preset() {
    let text = fs::read_to_string(root().join("docs/training.md")).unwrap();
    for preset in TrainSettings::presets() {
        assert!(text.contains(&format!("`{preset}`")), "`{preset}` is not in docs/training.md");
    }
}
