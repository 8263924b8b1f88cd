//! A run: its recipe, and where it lives.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::{Recipe, TrainSettings};
use gravisight_geometry::error::{Error, Result};

/// A training run: what is learned, and the files it is learned from and kept in. `run.toml` holds the fields of both.
#[derive(Debug, Clone)]
pub struct TrainConfig {
    /// What is learned, and how.
    pub recipe: Recipe,
    /// Where the run lives.
    pub paths: RunPaths,
}

/// The files of a run: those it reads, and the folder it fills.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunPaths {
    /// Folder of training clips. With supervision `rendered` or `candidates`: a folder of photographs, or none. With
    /// `motion`: a folder of stacks from `gravisight stacks`.
    pub train: Option<PathBuf>,
    /// Folder of the same kind for validation. It is never used for training, and its photographs must be others than those
    /// of `train`.
    pub validation: Option<PathBuf>,
    /// Output folder of the run, with checkpoints, log and trained model.
    pub out: PathBuf,
    /// Card of a model whose weights initialise the network that is trained: detector, verifier or motion network. The run
    /// takes over that model's architecture and normalisation and, for a detector, its input size.
    pub start_from: Option<PathBuf>,
    /// Card of the model that receives a new verifier (`candidates`) or a new motion network (`motion`). The result is this
    /// model with the new network.
    pub detector: Option<PathBuf>,
    /// File of timm's weights that initialise the backbone of the paper's networks, such as ImageNet's.
    pub backbone_weights: Option<PathBuf>,
}

impl TrainConfig {
    /// The run in folder `out`, as it was started; the folder may have moved since.
    ///
    /// # Errors
    /// [`Error::Data`] where there is no run; as [`TrainSettings::read`] and [`TrainSettings::config`].
    pub fn saved_in(out: &Path) -> Result<Self> {
        let file = run_file(out);
        if !file.exists() {
            let reason = format!("holds no run (no {RUN_FILE}); start one with `train --config`");
            return Err(Error::Data { what: out.display().to_string(), reason });
        }
        let mut config = TrainSettings::read(&file)?.config()?;
        config.paths.out = out.to_path_buf();
        Ok(config)
    }

    /// The text of `run.toml`.
    pub(in crate::train) fn to_toml(&self) -> Result<String> {
        let failed = || Error::format(RUN_FILE);
        // The paths are plain values, which in TOML come before all tables.
        Ok(toml::to_string(&self.paths).map_err(failed())? + &toml::to_string(&self.recipe).map_err(failed())?)
    }
}

const RUN_FILE: &str = "run.toml";

fn run_file(out: &Path) -> PathBuf {
    out.join(RUN_FILE)
}

fn needed(field: &'static str) -> Error {
    Error::value("run configuration", field, "is missing: give the folder of the clips")
}

impl RunPaths {
    /// The names of the fields.
    pub(super) const FIELDS: [&str; 6] = ["train", "validation", "out", "start_from", "detector", "backbone_weights"];

    /// The run's configuration.
    pub fn run_file(&self) -> PathBuf {
        run_file(&self.out)
    }

    /// A line of JSON a step.
    pub fn log(&self) -> PathBuf {
        self.out.join("log.jsonl")
    }

    /// The same as a table.
    pub fn log_table(&self) -> PathBuf {
        self.out.join("log.csv")
    }

    /// Folder of the checkpoints and the best weights.
    pub fn checkpoints(&self) -> PathBuf {
        self.out.join("checkpoints")
    }

    /// What physics says of the training clips.
    pub fn fits(&self) -> PathBuf {
        self.out.join("fits.jsonl")
    }

    /// The clips to train on.
    ///
    /// # Errors
    /// [`Error::Value`] where none are given.
    pub fn train(&self) -> Result<&Path> {
        self.train.as_deref().ok_or_else(|| needed("train"))
    }

    /// The card of the model whose verifier is trained.
    ///
    /// # Errors
    /// [`Error::Value`] where none is given.
    pub fn detector(&self) -> Result<&Path> {
        let missing = "is missing: give the card of the model whose verifier is trained";
        self.detector.as_deref().ok_or_else(|| Error::value("run configuration", "detector", missing))
    }

    /// The clips to score with.
    ///
    /// # Errors
    /// [`Error::Value`] where none are given.
    pub fn validation(&self) -> Result<&Path> {
        self.validation.as_deref().ok_or_else(|| needed("validation"))
    }

    /// The training clips' folder by its own name.
    pub(in crate::train) fn data_name(&self) -> String {
        let name = self.train.as_deref().and_then(Path::file_name);
        name.unwrap_or_default().to_string_lossy().into_owned()
    }

    /// The same from any folder; makes the run's folder.
    ///
    /// # Errors
    /// [`Error::Io`] with the path that is not there.
    pub(in crate::train) fn absolute(self) -> Result<Self> {
        let absolute = |path: PathBuf| std::fs::canonicalize(&path).map_err(Error::io(&path));
        let (train, validation) = (self.train.map(absolute).transpose()?, self.validation.map(absolute).transpose()?);
        std::fs::create_dir_all(&self.out).map_err(Error::io(&self.out))?;
        Ok(Self {
            train,
            validation,
            out: absolute(self.out)?,
            start_from: self.start_from.map(absolute).transpose()?,
            detector: self.detector.map(absolute).transpose()?,
            backbone_weights: self.backbone_weights.map(absolute).transpose()?,
        })
    }
}
