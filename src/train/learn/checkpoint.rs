//! Checkpoints: a file a step, whole or absent.

use std::path::{Path, PathBuf};

use burn::module::Module as _;
use serde::{Deserialize, Serialize};

use super::super::recipe::Recipe;
use super::parts::Beside;
use super::publish::Best;
use super::trainer::TrainerState;
use crate::model::{self, Pen};
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::files::{read, read_text, write_whole};

/// Beginning of the name of the weights that scored best so far.
const BEST: &str = "best";
const SCORE: &str = "score.json";
/// A checkpoint's file name: its step between these.
const NAME: [&str; 2] = ["step-", ".safetensors"];
/// Checkpoints kept: the last and the one before it.
const KEPT: usize = 2;

impl TrainerState {
    /// Writes the checkpoint under `folder` and removes old ones.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Device`] for a device that cannot be read.
    pub fn save(&self, folder: &Path) -> Result<()> {
        std::fs::create_dir_all(folder).map_err(Error::io(folder))?;
        let (parts, beside) = pollster::block_on(self.parts())?;
        let about = serde_json::to_string(&beside).map_err(Error::format("checkpoint"))?;
        let [before, after] = NAME;
        write_whole(&folder.join(format!("{before}{:08}{after}", self.step)), &model::bundled(&parts, &about)?)?;
        let outdated = list(folder)?.into_iter().rev().skip(KEPT).map(|(_, path)| path);
        for old in outdated.chain(unfinished(folder)?) {
            std::fs::remove_file(&old).map_err(Error::io(&old))?;
        }
        Ok(())
    }

    /// The newest checkpoint under `folder`, read into `blank`, a network of the run's architecture
    /// on the training device. None where there is no checkpoint yet.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Data`] for a damaged one.
    pub fn load_last(folder: &Path, blank: &Pen, recipe: &Recipe) -> Result<Option<Self>> {
        let Some((_, path)) = list(folder)?.pop() else { return Ok(None) };
        let what = path.display().to_string();
        let bytes = read(&path)?;
        let state = model::unbundled(&bytes).and_then(|(parts, about)| {
            let beside: Beside = serde_json::from_str(&about).map_err(Error::format(&what))?;
            Self::of_parts(parts, &beside, blank, recipe, &what)
        });
        state.map(Some).map_err(|error| damaged(&path, error))
    }
}

/// What is written beside the weights.
#[derive(Serialize, Deserialize)]
struct BestScore {
    step: usize,
    score: Option<f64>,
    confidence_threshold: f64,
}

impl Best {
    /// Writes it, of step `step`, under `folder` in place of the one before.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Device`] for a device that cannot be read.
    pub fn save(&self, folder: &Path, step: usize) -> Result<()> {
        std::fs::create_dir_all(folder).map_err(Error::io(folder))?;
        let Self { score, confidence_threshold, .. } = *self;
        let named = BestScore { step, score, confidence_threshold };
        let weights = weights_of(folder, step);
        write_whole(&weights, &model::save(&pollster::block_on(model::on_cpu(&self.average))?)?)?;
        let before = Self::score(folder)?;
        let text = serde_json::to_string(&named).map_err(Error::format(SCORE))?;
        // From here on the new one counts.
        write_whole(&folder.join(SCORE), text.as_bytes())?;
        match before.filter(|before| before.step != step) {
            Some(before) => {
                let old = weights_of(folder, before.step);
                std::fs::remove_file(&old).map_err(Error::io(&old))
            }
            None => Ok(()),
        }
    }

    /// The one under `folder`, read into `blank`, a network of the run's architecture without gradients. None where
    /// there is none yet.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Format`], [`Error::Data`] for a damaged file.
    pub fn load(folder: &Path, blank: &Pen) -> Result<Option<Self>> {
        let Some(BestScore { step, score, confidence_threshold }) = Self::score(folder)? else { return Ok(None) };
        let weights = weights_of(folder, step);
        let average = model::load_into(blank.valid(), read(&weights)?).map_err(|error| damaged(&weights, error))?;
        Ok(Some(Self { score, confidence_threshold, average }))
    }

    fn score(folder: &Path) -> Result<Option<BestScore>> {
        let file = folder.join(SCORE);
        if !file.exists() {
            return Ok(None);
        }
        let text = read_text(&file)?;
        serde_json::from_str(&text).map(Some).map_err(Error::format(file.display().to_string()))
    }
}

/// Name of the best weights' file: another one for each, so that the score never speaks of other weights.
fn weights_of(folder: &Path, step: usize) -> PathBuf {
    folder.join(format!("{BEST}-{step:08}.safetensors"))
}

/// Whole checkpoints under `folder`, oldest first.
fn list(folder: &Path) -> Result<Vec<(usize, PathBuf)>> {
    if !folder.exists() {
        return Ok(Vec::new());
    }
    let entries = std::fs::read_dir(folder).map_err(Error::io(folder))?;
    let mut found = Vec::new();
    for entry in entries {
        let path = entry.map_err(Error::io(folder))?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let step = name.strip_prefix(NAME[0]).and_then(|rest| rest.strip_suffix(NAME[1])?.parse().ok());
        if name.starts_with(NAME[0]) && path.is_dir() {
            let reason =
                "is a checkpoint of an earlier version, which this version cannot read: start the run again".into();
            return Err(Error::Data { what: path.display().to_string(), reason });
        }
        found.extend(step.map(|step| (step, path)));
    }
    found.sort();
    Ok(found)
}

/// What runs that were killed while they wrote have left behind.
fn unfinished(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(folder).map_err(Error::io(folder))?;
    let paths = entries.flatten().map(|entry| entry.path());
    let is_left = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with(&format!(".{}", NAME[0])) && name.ends_with(".tmp")
    };
    Ok(paths.filter(is_left).collect())
}

fn damaged(path: &Path, error: impl std::fmt::Display) -> Error {
    let reason = format!("{error}; delete this file to --resume from the previous checkpoint");
    Error::Data { what: path.display().to_string(), reason }
}
