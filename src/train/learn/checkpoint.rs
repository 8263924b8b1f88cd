//! Checkpoints: a folder a step, complete or absent.

use std::path::{Path, PathBuf};

use burn::module::Module;
use burn::store::{ModuleRecord, RecordError};
use serde::{Deserialize, Serialize};

use super::super::recipe::Recipe;
use super::knowledge::Knowledge;
use super::publish::Best;
use super::trainer::{State, Watch};
use crate::error::{Error, Result};
use crate::files::{read_text, temporary_name, write_whole};
use crate::model::Pen;

const MODEL: &str = "model.bpk";
const AVERAGE: &str = "average.bpk";
const OPTIMISER: &str = "optimiser.bpk";
/// The watch's two numbers as text, from which they are read to the bit. (JSON would round, and has no infinity.)
const WATCH: &str = "watch.txt";
/// What forecasts need besides.
const KNOWLEDGE: &str = "knowledge.txt";
/// Folder of the weights that scored best so far.
const BEST: &str = "best";
const SCORE: &str = "score.json";
/// Folders are named by their step.
const PREFIX: &str = "step-";
/// Checkpoints kept: the last and the one before it.
const KEPT: usize = 2;

impl State {
    /// Writes the checkpoint under `folder` and removes old ones.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Data`] where a record cannot be written.
    pub fn save(&self, folder: &Path) -> Result<()> {
        let target = folder.join(format!("{PREFIX}{:08}", self.step));
        let temporary = temporary_name(&target);
        std::fs::create_dir_all(&temporary).map_err(Error::io(&temporary))?;
        let at = |file: &str| temporary.join(file);
        self.model.clone().into_record().save(at(MODEL)).map_err(record(&at(MODEL)))?;
        self.average.clone().into_record().save(at(AVERAGE)).map_err(record(&at(AVERAGE)))?;
        self.optimiser.save(at(OPTIMISER)).map_err(record(&at(OPTIMISER)))?;
        let mut files = vec![MODEL, AVERAGE, OPTIMISER];
        if let Some(Watch { mean, lowest }) = self.watch {
            std::fs::write(at(WATCH), format!("{mean} {lowest}")).map_err(Error::io(at(WATCH)))?;
            files.push(WATCH);
        }
        if self.knowledge != Knowledge::default() {
            std::fs::write(at(KNOWLEDGE), self.knowledge.text()).map_err(Error::io(at(KNOWLEDGE)))?;
            files.push(KNOWLEDGE);
        }
        for file in files {
            std::fs::File::open(at(file)).and_then(|file| file.sync_all()).map_err(Error::io(at(file)))?;
        }
        if target.exists() {
            std::fs::remove_dir_all(&target).map_err(Error::io(&target))?;
        }
        std::fs::rename(&temporary, &target).map_err(Error::io(&target))?;
        let all = list(folder)?;
        let outdated = all.into_iter().rev().skip(KEPT).map(|(_, path)| path);
        for old in outdated.chain(unfinished(folder)?) {
            std::fs::remove_dir_all(&old).map_err(Error::io(&old))?;
        }
        Ok(())
    }

    /// The newest checkpoint under `folder`, read into `blank`, a network of the run's architecture
    /// on the training device. None where there is no checkpoint yet.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Data`] for a damaged record.
    pub fn load_last(folder: &Path, blank: &Pen, recipe: &Recipe) -> Result<Option<Self>> {
        let Some((step, path)) = list(folder)?.pop() else { return Ok(None) };
        let at = |file: &str| path.join(file);
        let read = |pen: Pen, file: &str| {
            let loaded = ModuleRecord::load(at(file)).map_err(record(&at(file)))?;
            pen.try_load_record(loaded).map_err(|error| damaged(&at(file), error))
        };
        Ok(Some(Self {
            step,
            model: read(blank.clone(), MODEL)?,
            average: read(blank.valid(), AVERAGE)?,
            optimiser: Self::blank_optimiser(recipe).load(at(OPTIMISER)).map_err(record(&at(OPTIMISER)))?,
            watch: read_watch(&at(WATCH))?,
            knowledge: read_knowledge(&at(KNOWLEDGE), recipe)?,
        }))
    }
}

/// The watch over the loss; none where there was no step yet, or in a checkpoint of before it was kept.
fn read_watch(file: &Path) -> Result<Option<Watch>> {
    if !file.exists() {
        return Ok(None);
    }
    let text = read_text(file)?;
    let numbers = text.split_once(' ').and_then(|(mean, lowest)| Some((mean.parse().ok()?, lowest.parse().ok()?)));
    let (mean, lowest) = numbers.ok_or_else(|| damaged(file, "not two numbers"))?;
    Ok(Some(Watch { mean, lowest }))
}

/// What the run knows besides; nothing where forecasts do not teach.
fn read_knowledge(file: &Path, recipe: &Recipe) -> Result<Knowledge> {
    if !file.exists() {
        return Ok(Knowledge::first(recipe));
    }
    let text = read_text(file)?;
    Knowledge::from_text(recipe, &text).ok_or_else(|| damaged(file, "not a step, laws and frames"))
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
    /// [`Error::Io`], [`Error::Data`] where the record cannot be written.
    pub fn save(&self, folder: &Path, step: usize) -> Result<()> {
        std::fs::create_dir_all(folder).map_err(Error::io(folder))?;
        let Self { score, confidence_threshold, .. } = *self;
        let named = BestScore { step, score, confidence_threshold };
        let weights = weights_of(folder, step);
        self.average.clone().into_record().save(&weights).map_err(record(&weights))?;
        std::fs::File::open(&weights).and_then(|file| file.sync_all()).map_err(Error::io(&weights))?;
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
    /// [`Error::Io`], [`Error::Format`], [`Error::Data`] for a damaged record.
    pub fn load(folder: &Path, blank: &Pen) -> Result<Option<Self>> {
        let Some(BestScore { step, score, confidence_threshold }) = Self::score(folder)? else { return Ok(None) };
        let weights = weights_of(folder, step);
        let loaded = ModuleRecord::load(&weights).map_err(record(&weights))?;
        let average = blank.valid().try_load_record(loaded).map_err(|error| damaged(&weights, error))?;
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
    folder.join(format!("{BEST}-{step:08}.bpk"))
}

/// Complete checkpoints under `folder`, oldest first.
fn list(folder: &Path) -> Result<Vec<(usize, PathBuf)>> {
    if !folder.exists() {
        return Ok(Vec::new());
    }
    let entries = std::fs::read_dir(folder).map_err(Error::io(folder))?;
    let mut found = Vec::new();
    for entry in entries {
        let path = entry.map_err(Error::io(folder))?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if let Some(step) = name.strip_prefix(PREFIX).and_then(|number| number.parse().ok()) {
            found.push((step, path));
        }
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
        name.starts_with(&format!(".{PREFIX}")) && name.ends_with(".tmp")
    };
    Ok(paths.filter(is_left).collect())
}

fn record(path: &Path) -> impl FnOnce(RecordError) -> Error {
    let path = path.to_path_buf();
    move |error| damaged(&path, error)
}

fn damaged(path: &Path, error: impl std::fmt::Display) -> Error {
    let reason = format!("{error}; without its folder, --resume takes the checkpoint before it");
    Error::Data { what: path.display().to_string(), reason }
}
