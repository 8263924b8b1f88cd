//! Configurations laid over each other: a preset, a file, flags.

use std::path::Path;

use super::config::TrainConfig;
use crate::error::{Error, Result};

/// Fields that hold paths.
const PATHS: [&str; 5] = ["train", "validation", "out", "backbone_weights", "start_from"];

/// The recipes of the published models and of the paper, and a short one, by name.
const PRESETS: [(&str, &str); 6] = [
    ("quick", include_str!("../../models/quick.toml")),
    ("sd-s", include_str!("../../models/sd-s.toml")),
    ("sd-m", include_str!("../../models/sd-m.toml")),
    ("sd-l", include_str!("../../models/sd-l.toml")),
    ("spring", include_str!("../../models/spring.toml")),
    ("paper", include_str!("../../models/paper.toml")),
];

/// Names of the presets.
pub fn presets() -> impl Iterator<Item = &'static str> {
    PRESETS.iter().map(|(name, _)| *name)
}

/// The fields of a preset: all but the folders.
///
/// # Errors
/// [`Error::Value`] for a name that there is not.
pub fn preset(name: &str) -> Result<toml::Table> {
    let Some((_, text)) = PRESETS.iter().find(|(known, _)| *known == name) else {
        let known: Vec<&str> = presets().collect();
        return Err(Error::value("presets", name, format!("is none; there are {}", known.join(", "))));
    };
    toml::from_str(text).map_err(Error::format(name))
}

/// The fields of a `run.toml`. Its paths are relative to the file.
///
/// # Errors
/// [`Error::Io`], [`Error::Format`].
pub fn read_fields(path: &Path) -> Result<toml::Table> {
    let text = std::fs::read_to_string(path).map_err(Error::io(path))?;
    let mut fields: toml::Table = toml::from_str(&text).map_err(Error::format(path.display().to_string()))?;
    let folder = path.parent().unwrap_or(Path::new("."));
    for name in PATHS {
        if let Some(toml::Value::String(relative)) = fields.get_mut(name) {
            *relative = folder.join(&*relative).display().to_string();
        }
    }
    Ok(fields)
}

/// Lays `upper` over `lower`: fields of `upper` count, tables are laid over each other.
pub fn lay_over(lower: &mut toml::Table, upper: toml::Table) {
    for (name, value) in upper {
        match (lower.get_mut(&name), value) {
            (Some(toml::Value::Table(lower)), toml::Value::Table(upper)) => lay_over(lower, upper),
            (_, value) => drop(lower.insert(name, value)),
        }
    }
}

/// The field that `FIELD=VALUE` sets: `seed=3`, `augmentation.shift=8`, `phases=[…]`. A value that is not TOML is text.
///
/// # Errors
/// [`Error::Value`] for text of another form.
pub fn assignment(text: &str) -> Result<toml::Table> {
    let wrong = || Error::value("--set", text, "must be FIELD=VALUE, as in seed=3 or augmentation.shift=8");
    let (field, value) = text.split_once('=').ok_or_else(wrong)?;
    let is_name = |part: &str| !part.is_empty() && part.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    if !field.split('.').all(is_name) {
        return Err(wrong());
    }
    let as_text = || toml::Table::from_iter([("it".into(), toml::Value::String(value.into()))]);
    let mut parsed = toml::from_str::<toml::Table>(&format!("it = {value}")).unwrap_or_else(|_| as_text());
    let mut value = parsed.remove("it").ok_or_else(wrong)?;
    for part in field.rsplit('.') {
        value = toml::Value::Table(toml::Table::from_iter([(part.into(), value)]));
    }
    match value {
        toml::Value::Table(table) => Ok(table),
        _ => Err(wrong()),
    }
}

impl TrainConfig {
    /// The configuration of `fields`, checked.
    ///
    /// # Errors
    /// [`Error::Format`] for unknown and missing fields, [`Error::Value`] for senseless values.
    pub fn of(fields: toml::Table) -> Result<Self> {
        let config: Self = fields.try_into().map_err(Error::format("run configuration"))?;
        config.check()?;
        Ok(config)
    }
}
