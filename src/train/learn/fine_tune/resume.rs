//! A fine-tuning that is put aside as bytes, and gone on with.

use burn::module::Module as _;
use burn::tensor::Device;
use serde::{Deserialize, Serialize};

use super::super::parts::Beside;
use super::super::publish::Best;
use super::super::trainer::TrainerState;
use super::FineTuner;
use super::given::{ClipKey, Given};
use crate::model;
use gravisight_geometry::error::{Error, Result};

/// What a checkpoint is called in errors.
const CHECKPOINT: &str = "fine-tuning checkpoint";
/// Name of the weights that scored best.
const BEST: &str = "best";
/// Names of the weights that stay as they are.
const BESIDE: [&str; 2] = ["verifier", "motion"];

/// What a checkpoint holds besides networks.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct About {
    /// The card of the model that it started from, and the options, as JSON.
    origin: [String; 2],
    clips: Vec<ClipKey>,
    state: Beside,
    best: Option<SavedScore>,
}

/// Text, from which numbers are read to the bit.
#[derive(Serialize, Deserialize)]
struct SavedScore {
    score: Option<String>,
    confidence_threshold: String,
}

impl FineTuner {
    /// All that is needed to go on later, or elsewhere, but for the clips: a safetensors file. [`Self::resume`] takes it.
    ///
    /// # Errors
    /// [`Error::Device`] for a device that cannot be read.
    pub async fn checkpoint(&self) -> Result<Vec<u8>> {
        let (mut parts, state) = self.trainer.state().parts().await?;
        let best = match &self.best {
            Some(Best { score, confidence_threshold, average }) => {
                parts.push((BEST, model::save(&model::on_cpu(average).await?)?));
                let score = score.map(|score| score.to_string());
                Some(SavedScore { score, confidence_threshold: confidence_threshold.to_string() })
            }
            None => None,
        };
        parts.extend(BESIDE.into_iter().zip(self.beside.clone()));
        let about = About { origin: self.origin.clone(), clips: self.clips.keys(), state, best };
        model::bundled(&parts, &serde_json::to_string(&about).map_err(Error::format(CHECKPOINT))?)
    }

    /// Goes on from a [`checkpoint`](Self::checkpoint) once the clips of the run ([`Self::awaited`]) are given again, in any
    /// order: to the same bits as without the stop, on the same kind of device and machine.
    ///
    /// # Errors
    /// [`Error::WeightsFile`], [`Error::Format`] and [`Error::Data`] for bytes that are no checkpoint.
    pub fn resume(checkpoint: &[u8], device: &Device) -> Result<Self> {
        let (mut parts, about) = model::unbundled(checkpoint)?;
        let About { origin, clips, state, best } = serde_json::from_str(&about).map_err(Error::format(CHECKPOINT))?;
        let damaged = |reason: &str| Error::Data { what: CHECKPOINT.into(), reason: reason.into() };
        let mut kept = None;
        // Where the model has no such network, the file has no entry.
        let beside = BESIDE.map(|name| parts.remove(name).map_or_else(model::nothing, Ok));
        let [verifier, motion] = beside;
        let mut tuner = Self::of(origin, [verifier?, motion?], device, |recipe, blank| {
            if let Some(SavedScore { score, confidence_threshold }) = best {
                let number = |text: &str| text.parse::<f64>().map_err(|_| damaged("its best score is not a number"));
                let weights = parts.remove(BEST).ok_or_else(|| damaged("holds no best weights"))?;
                kept = Some(Best {
                    score: score.as_deref().map(number).transpose()?,
                    confidence_threshold: number(&confidence_threshold)?,
                    average: model::load_into(blank.valid(), weights)?,
                });
            }
            TrainerState::of_parts(parts, &state, blank, recipe, CHECKPOINT)
        })?;
        tuner.clips = Given::awaited(clips);
        tuner.best = kept;
        Ok(tuner)
    }
}
