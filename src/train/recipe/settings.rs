//! TrainSettings laid over each other: a preset, a file, flags.

use std::path::Path;

use super::{Recipe, RunPaths, TrainConfig};
use gravisight_geometry::error::{Error, Result};

/// The recipes of the published models and of the paper, and a short one, by name.
const PRESETS: [(&str, &str); 11] = [
    ("any", include_str!("../../../models/any.toml")),
    ("any-motion", include_str!("../../../models/any-motion.toml")),
    ("any-verifier", include_str!("../../../models/any-verifier.toml")),
    ("quick", include_str!("../../../models/quick.toml")),
    ("sd-s", include_str!("../../../models/sd-s.toml")),
    ("sd-s-future", include_str!("../../../models/sd-s-future.toml")),
    ("sd-m", include_str!("../../../models/sd-m.toml")),
    ("sd-l", include_str!("../../../models/sd-l.toml")),
    ("spring", include_str!("../../../models/spring.toml")),
    ("paper", include_str!("../../../models/paper.toml")),
    ("paper-compact", include_str!("../../../models/paper-compact.toml")),
];

/// Fields of a run's configuration, any part of them.
#[derive(Debug, Clone, Default)]
pub struct TrainSettings(toml::Table);

impl TrainSettings {
    /// Names of the presets.
    pub fn presets() -> impl Iterator<Item = &'static str> {
        PRESETS.iter().map(|(name, _)| *name)
    }

    /// A preset: all but the paths.
    ///
    /// # Errors
    /// [`Error::Value`] for a name that there is not.
    pub fn preset(name: &str) -> Result<Self> {
        let Some((_, text)) = PRESETS.iter().find(|(known, _)| *known == name) else {
            let known: Vec<&str> = Self::presets().collect();
            return Err(Error::value("presets", name, format!("is not a preset; choose one of {}", known.join(", "))));
        };
        toml::from_str(text).map(Self).map_err(Error::format(name))
    }

    /// Those of a `run.toml`. Its paths are relative to the file.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Format`].
    pub fn read(path: &Path) -> Result<Self> {
        let text = gravisight_geometry::files::read_text(path)?;
        let mut fields: toml::Table = toml::from_str(&text).map_err(Error::format(path.display().to_string()))?;
        let folder = path.parent().unwrap_or(Path::new("."));
        for name in RunPaths::FIELDS {
            if let Some(toml::Value::String(relative)) = fields.get_mut(name) {
                *relative = folder.join(&*relative).display().to_string();
            }
        }
        Ok(Self(fields))
    }

    /// Lays `upper` over these: its fields count, tables are laid over each other. A table of another kind takes the place of the one before.
    pub fn lay(&mut self, upper: Self) {
        lay_over(&mut self.0, upper.0);
    }

    /// Sets a field that holds a path.
    pub fn set_path(&mut self, field: &str, path: &Path) {
        self.0.insert(field.into(), path.display().to_string().into());
    }

    /// Sets the field that `FIELD=VALUE` names: `seed=3`, `augmentation.shift=8`, `phases=[…]`. A value that is not TOML
    /// is text.
    ///
    /// # Errors
    /// [`Error::Value`] for text of another form.
    pub fn set(&mut self, assignment: &str) -> Result<()> {
        let wrong = || Error::value("--set", assignment, "must be FIELD=VALUE, as in seed=3 or augmentation.shift=8");
        let (field, value) = assignment.split_once('=').ok_or_else(wrong)?;
        let is_name = |part: &str| !part.is_empty() && part.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
        if !field.split('.').all(is_name) {
            return Err(wrong());
        }
        let as_text = || toml::Table::from_iter([("it".into(), toml::Value::String(value.into()))]);
        let mut parsed = toml::from_str::<toml::Table>(&format!("it = {value}")).unwrap_or_else(|_| as_text());
        let value = parsed.remove("it").ok_or_else(wrong)?;
        let (outer, name) = field.rsplit_once('.').map_or((None, field), |(outer, name)| (Some(outer), name));
        let mut table = toml::Table::from_iter([(name.into(), value)]);
        for part in outer.into_iter().flat_map(|outer| outer.rsplit('.')) {
            table = toml::Table::from_iter([(part.into(), toml::Value::Table(table))]);
        }
        lay_over(&mut self.0, table);
        Ok(())
    }

    /// The whole recipe that they describe, checked, as TOML: what a preset leaves at its default is written out.
    ///
    /// # Errors
    /// As [`Self::config`].
    pub fn whole(mut self) -> Result<String> {
        self.0.entry("out").or_insert_with(|| String::new().into());
        toml::to_string(&self.config()?.recipe).map_err(Error::format("run configuration"))
    }

    /// The run they describe, checked.
    ///
    /// # Errors
    /// [`Error::Format`] for unknown and missing fields, [`Error::Value`] for senseless values.
    pub fn config(mut self) -> Result<TrainConfig> {
        let failed = || Error::format("run configuration");
        let paths = RunPaths::FIELDS.into_iter().filter_map(|name| self.0.remove_entry(name));
        let paths = paths.collect::<toml::Table>().try_into().map_err(failed())?;
        let recipe: Recipe = self.0.try_into().map_err(failed())?;
        recipe.check()?;
        Ok(TrainConfig { recipe, paths })
    }
}

/// Whether the second of two tables is of the kind of the first, or names none.
fn is_same_kind(lower: &toml::Table, upper: &toml::Table) -> bool {
    ["kind", "model"].iter().all(|&tag| upper.get(tag).is_none_or(|kind| lower.get(tag) == Some(kind)))
}

fn lay_over(lower: &mut toml::Table, upper: toml::Table) {
    for (name, value) in upper {
        match (lower.get_mut(&name), value) {
            (Some(toml::Value::Table(lower)), toml::Value::Table(upper)) if is_same_kind(lower, &upper) => {
                lay_over(lower, upper);
            }
            (_, value) => drop(lower.insert(name, value)),
        }
    }
}
