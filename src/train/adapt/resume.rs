//! An adaptation that is put aside as bytes, and gone on with.

use std::collections::BTreeMap;

use burn::tensor::Device;
use serde::{Deserialize, Serialize};

use super::super::learn::Beside;
use super::networks::NAMES;
use super::{AdaptOptions, Adapter};
use crate::model::{self, Card};
use gravisight_geometry::error::{Error, Result};

/// What a checkpoint is called in errors.
pub const CHECKPOINT: &str = "adaptation checkpoint";
/// Names of the weights that the run started from.
const ORIGIN: [&str; 3] = ["own", "verifier", "motion"];

/// What the videos gave, by which a resumed run knows them again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Given {
    flights: usize,
    frames: usize,
    patches: usize,
    stacks: usize,
}

/// What a checkpoint holds besides networks.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct About {
    /// The card of the model that it started from, and the options, as JSON.
    origin: [String; 2],
    given: Given,
    /// Of each stage its steps and the rest of its state.
    stages: Vec<(usize, Beside)>,
}

/// The stages of a run that was put aside.
pub struct SavedStages {
    /// The networks' files by the names of stage and part.
    parts: BTreeMap<String, Vec<u8>>,
    stages: Vec<(usize, Beside)>,
}

impl SavedStages {
    /// The state of the stage of a part of the weights, if it had begun.
    pub fn take(&mut self, part: usize) -> Option<(BTreeMap<String, Vec<u8>>, Beside)> {
        let (_, beside) = self.stages.get(part)?.clone();
        let prefix = format!("{}/", NAMES[part]);
        let of_stage = self.parts.iter().filter_map(|(name, bytes)| {
            let name = name.strip_prefix(&prefix)?;
            Some((name.to_string(), bytes.clone()))
        });
        Some((of_stage.collect(), beside))
    }

    /// Steps done.
    pub fn steps(&self) -> usize {
        self.stages.iter().map(|(steps, _)| steps).sum()
    }

    /// Networks in training.
    pub fn count(&self) -> usize {
        self.stages.len()
    }
}

impl Adapter {
    /// All that is needed to go on later, or elsewhere, but for the videos: a safetensors file. [`Self::resume`] takes it. After the first
    /// [`Self::step`].
    ///
    /// # Errors
    /// [`Error::Value`] before the first step; [`Error::Device`] for a device that cannot be read.
    pub async fn checkpoint(&self) -> Result<Vec<u8>> {
        let Some(stages) = &self.stages else {
            return Err(Error::value("adapt", "checkpoint", "can be made only after the first step"));
        };
        let mut parts: Vec<(String, Vec<u8>)> = ORIGIN.into_iter().map(String::from).zip(self.parts.clone()).collect();
        let mut besides = vec![];
        for stage in stages {
            let (networks, beside) = stage.state().parts().await?;
            parts.extend(networks.into_iter().map(|(name, bytes)| (format!("{}/{name}", stage.name()), bytes)));
            besides.push((stage.steps(), beside));
        }
        let options = serde_json::to_string(&self.options).map_err(Error::format("options"))?;
        let about = About { origin: [self.card.to_json()?, options], given: self.given(), stages: besides };
        let parts: Vec<(&str, Vec<u8>)> = parts.iter().map(|(name, bytes)| (name.as_str(), bytes.clone())).collect();
        model::bundled(&parts, &serde_json::to_string(&about).map_err(Error::format(CHECKPOINT))?)
    }

    /// Goes on from a [`checkpoint`](Self::checkpoint) once its videos are given again ([`Self::begin`], [`Self::add`], [`Self::end`]), in the
    /// same order: to the same bits as without the stop, on the same kind of device and machine.
    ///
    /// # Errors
    /// [`Error::WeightsFile`], [`Error::Format`] and [`Error::Data`] for bytes that are no checkpoint.
    pub fn resume(checkpoint: &[u8], device: &Device) -> Result<Self> {
        let (mut parts, about) = model::unbundled(checkpoint)?;
        let About { origin, given, stages } = serde_json::from_str(&about).map_err(Error::format(CHECKPOINT))?;
        let mut of_origin = |name: &str| {
            let missing = || Error::Data { what: CHECKPOINT.into(), reason: format!("does not contain `{name}`") };
            parts.remove(name).ok_or_else(missing)
        };
        let [own, verifier, motion] = ORIGIN.map(&mut of_origin);
        let card = Card::from_json(&origin[0], "model card")?;
        let options: AdaptOptions = serde_json::from_str(&origin[1]).map_err(Error::format("options"))?;
        let mut adapter = Self::of_parts(card, [own?, verifier?, motion?], &options, device)?;
        adapter.saved = Some((given, SavedStages { parts, stages }));
        Ok(adapter)
    }

    /// The stages to go on with, once the videos of a resumed run are there again.
    ///
    /// # Errors
    /// [`Error::Data`] for other videos.
    pub(super) fn saved_stages(&mut self) -> Result<Option<SavedStages>> {
        let here = self.given();
        if self.saved.as_ref().is_some_and(|(given, _)| *given != here) {
            let reason = "these are not the videos of the saved run, or they were tracked differently; add the same videos with the same tracks";
            return Err(Error::Data { what: "videos".into(), reason: reason.into() });
        }
        Ok(self.saved.take().map(|(_, stages)| stages))
    }

    fn given(&self) -> Given {
        let stacks = self.stacks.iter().map(Vec::len).sum();
        Given { flights: self.flights, frames: self.frames, patches: self.patches.len(), stacks }
    }
}
