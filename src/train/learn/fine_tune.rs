//! Fine-tuning in memory: a model, a few clips of a new place, no files. What a browser can do.

use std::path::PathBuf;

use burn::tensor::Device;
use serde::{Deserialize, Serialize};

use super::super::examples::{Examples, Pictures, Sampler, TaughtClip, check_label, check_physics, teach};
use super::super::recipe::{Phase, Recipe, Supervision};
use super::publish::{Best, card_of_fine_tuning, publish};
use super::score::{Score, score};
use super::step::StepReport;
use super::trainer::{State, Trainer};
use crate::clips::{Clip, Clips};
use crate::error::{Error, Result};
use crate::image::Picture;
use crate::localise::Localiser;
use crate::model::{self, Card};

/// Share of the steps that see crops; the others see whole pictures, as the model will.
const CROPPED: f64 = 0.9;
/// How many times the pixels of a crop's batch a batch of whole pictures has at most.
const WHOLE: f64 = 1.5;
/// Decay of the average: a fine-tuning is short.
const EMA_DECAY: f64 = 0.98;
/// How far the learning rate falls during the crops, and where the whole pictures start.
const LAST_RATE: f64 = 0.1;

/// How a fine-tuning goes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(deny_unknown_fields, default, rename_all = "camelCase")]
pub struct FineTuneOptions {
    /// Optimiser steps in all; the learning rate falls over them. Default: 200.
    pub steps: usize,
    /// Crops a step. Default: 12.
    pub batch: usize,
    /// Side of the crops around the ball, px of the network's input. Default: 128.
    pub crop: u32,
    /// Learning rate at the start. Default: 0.001.
    pub learning_rate: f64,
    /// Seed of the batches. Default: 1.
    pub seed: u64,
}

impl Default for FineTuneOptions {
    fn default() -> Self {
        Self { steps: 200, batch: 12, crop: 128, learning_rate: 1e-3, seed: 1 }
    }
}

/// What a clip gives to learn.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(rename_all = "camelCase")]
pub struct Added {
    /// Frames that teach, or (held out) that are scored.
    pub frames: usize,
    /// Why the clip teaches nothing, in words.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub left_out: Option<String>,
}

/// A step.
#[derive(Debug, Clone, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(rename_all = "camelCase")]
pub struct Tuned {
    /// Steps done.
    pub step: usize,
    /// Steps in all.
    pub steps: usize,
    /// Total loss.
    pub loss: f64,
    /// Its part on the heatmap.
    pub heatmap: f64,
    /// Mean robust error of the depths, unweighted.
    pub depth: f64,
}

/// A model that learns the clips given to it, by physics from their 2D labels.
///
/// ```no_run
/// # async fn tuned(card: gravisight::Card, weights: Vec<u8>) -> gravisight::Result<()> {
/// use gravisight::{Clips, Device, FineTuneOptions, FineTuner};
///
/// let clips = Clips::read("clips".as_ref())?;
/// let mut tuner = FineTuner::new(card, weights, &FineTuneOptions::default(), &Device::flex())?;
/// for (number, clip) in clips.clips.iter().enumerate() {
///     let pictures = clip.frames.iter().map(|frame| clips.picture(clip, frame)).collect::<gravisight::Result<_>>()?;
///     // One in five is held out, to score with.
///     tuner.add_clip(clip.clone(), pictures, number % 5 == 4)?;
/// }
/// while let Some(step) = tuner.step().await? {
///     println!("{} of {}: loss {:.3}", step.step, step.steps, step.loss);
/// }
/// println!("{:?}", tuner.evaluate().await?);
/// let (card, weights) = tuner.export().await?;
/// # Ok(())
/// # }
/// ```
pub struct FineTuner {
    card: Card,
    recipe: Recipe,
    trainer: Trainer,
    clips: Vec<(Clip, Vec<Picture>, TaughtClip)>,
    held_out: Vec<(Clip, Vec<Picture>)>,
    /// From the first step on.
    sampler: Option<Sampler>,
    /// From the first score on.
    validation: Option<Pictures>,
    best: Option<Best>,
}

impl FineTuner {
    /// Starts from the model of `card` and `weights`, on `device`.
    ///
    /// # Errors
    /// As [`Localiser::new`]; [`Error::Value`] for options that cannot train.
    pub fn new(card: Card, weights: Vec<u8>, options: &FineTuneOptions, device: &Device) -> Result<Self> {
        card.check_weights(&weights)?;
        let recipe = recipe(&card, options)?;
        let device = device.clone().autodiff();
        let [own, _] = model::parted(&weights)?;
        let model = model::load(&card.architecture, own, &device)?;
        let trainer = Trainer::new(&recipe, State::first(&recipe, model), &device);
        let (clips, held_out) = (vec![], vec![]);
        Ok(Self { card, recipe, trainer, clips, held_out, sampler: None, validation: None, best: None })
    }

    /// Gives a clip to learn from (its track is fitted by the physics of its scene), or, `held_out`, to score with.
    /// `pictures` are its frames'.
    ///
    /// # Errors
    /// [`Error::Data`] for labels outside the picture, a clip without a scene or gravity, pictures of another size or
    /// number; [`Error::Value`] for a clip that comes after the first step or, held out, after the first score.
    pub fn add_clip(&mut self, clip: Clip, pictures: Vec<Picture>, held_out: bool) -> Result<Added> {
        let sealed = if held_out { self.validation.is_some() } else { self.sampler.is_some() };
        if sealed {
            let reason =
                "comes too late: give all clips before the first step, and those held out before the first score";
            return Err(Error::value("fine-tuning", "clip", reason));
        }
        clip.frames.iter().try_for_each(|frame| check_label(&clip, frame))?;
        let clips = Clips { folder: PathBuf::new(), clips: vec![clip.clone()] };
        check_physics(&clips.clips)?;
        // Refuses pictures that are not the clip's now, rather than at the first step.
        Pictures::in_memory(clips, vec![pictures.clone()])?;
        if held_out {
            let frames = clip.frames.iter().filter(|frame| frame.visible).count();
            self.held_out.push((clip, pictures));
            return Ok(Added { frames, left_out: None });
        }
        let taught = teach(&clip, &self.recipe.fit);
        let added = Added { frames: taught.frames.iter().flatten().count(), left_out: taught.left_out.clone() };
        self.clips.push((clip, pictures, taught));
        Ok(added)
    }

    /// One step; None after the last.
    ///
    /// # Errors
    /// [`Error::Data`] where no clip teaches anything; [`Error::Diverged`]; [`Error::Device`].
    pub async fn step(&mut self) -> Result<Option<Tuned>> {
        let Some((phase, _)) = self.recipe.phase(self.trainer.step()) else { return Ok(None) };
        let sampler = match &mut self.sampler {
            Some(sampler) => sampler,
            none => none.insert(sampler(&self.recipe, std::mem::take(&mut self.clips))?),
        };
        let batch = sampler.batch(phase, self.trainer.step())?;
        let Some((StepReport { loss, heatmap, depth, .. }, _)) = self.trainer.advance(batch).await? else {
            return Ok(None);
        };
        Ok(Some(Tuned { step: self.trainer.step(), steps: self.recipe.steps(), loss, heatmap, depth }))
    }

    /// Scores the averaged weights on the held-out clips, by 2D labels alone, and keeps them if none were better.
    ///
    /// # Errors
    /// [`Error::Data`] where no clip is held out; as evaluation does.
    pub async fn evaluate(&mut self) -> Result<Score> {
        if self.validation.is_none() && self.held_out.is_empty() {
            let reason = "none is held out, so there is nothing to score with".into();
            return Err(Error::Data { what: "clips".into(), reason });
        }
        let localiser = self.localiser();
        let validation = match &mut self.validation {
            Some(validation) => validation,
            none => {
                let (clips, pictures) = std::mem::take(&mut self.held_out).into_iter().unzip();
                none.insert(Pictures::in_memory(Clips { folder: PathBuf::new(), clips }, pictures)?)
            }
        };
        let scored = score(&localiser, validation, None, self.trainer.laws()).await?;
        Best::keep(&mut self.best, &scored, self.trainer.average());
        Ok(scored)
    }

    /// The averaged weights as they are now, ready for pictures.
    pub fn localiser(&self) -> Localiser {
        let device = self.trainer.device().clone().without_autodiff();
        Localiser::from_pen(self.trainer.average(), self.card.clone(), &device)
    }

    /// The card and the weights that scored best on the held-out clips; where nothing was scored, the last.
    ///
    /// # Errors
    /// [`Error::WeightsFile`] where the weights cannot be written; [`Error::Device`] where they cannot be read.
    pub async fn export(&self) -> Result<(Card, Vec<u8>)> {
        let examples = self.sampler.as_ref().map(Sampler::examples);
        let card = card_of_fine_tuning(&self.card, examples, self.trainer.step());
        publish(card, self.best.as_ref(), self.trainer.average()).await
    }
}

fn recipe(card: &Card, options: &FineTuneOptions) -> Result<Recipe> {
    let FineTuneOptions { steps, batch, crop, learning_rate, seed } = *options;
    let cropped = ((steps as f64 * CROPPED).round() as usize).clamp(1, steps.max(1));
    let pixels = f64::from(card.input.width * card.input.height) / f64::from(crop * crop).max(1.0);
    let whole = ((batch as f64 * WHOLE / pixels).round() as usize).clamp(1, batch.max(1));
    let last = learning_rate * LAST_RATE;
    let phase = |steps, batch, crop, learning_rate, final_learning_rate| Phase {
        steps,
        batch,
        crop,
        learning_rate,
        final_learning_rate,
        warm_up: 0,
    };
    let mut phases = vec![Phase { warm_up: cropped / 20, ..phase(cropped, batch, Some(crop), learning_rate, last) }];
    if steps > cropped {
        phases.push(phase(steps - cropped, whole, None, last, 0.0));
    }
    let recipe = Recipe {
        normalisation: card.normalisation,
        architecture: Some(card.architecture.clone()),
        seed,
        ema_decay: EMA_DECAY,
        fixed_norms: true,
        ..Recipe::new(card.name.clone(), Supervision::PhysicsFit, card.input, phases)
    };
    recipe.check()?;
    Ok(recipe)
}

fn sampler(recipe: &Recipe, clips: Vec<(Clip, Vec<Picture>, TaughtClip)>) -> Result<Sampler> {
    let (mut these, mut pictures, mut fits) = (Vec::new(), Vec::new(), Vec::new());
    for (clip, some, fit) in clips {
        these.push(clip);
        pictures.push(some);
        fits.push(fit);
    }
    if let Some(reason) =
        fits.first().and_then(|fit| fit.left_out.as_ref()).filter(|_| fits.iter().all(|fit| fit.left_out.is_some()))
    {
        let reason = format!("physics explains none of them; the first: {reason}");
        return Err(Error::Data { what: "clips".into(), reason });
    }
    let clips = Clips { folder: PathBuf::new(), clips: these };
    let examples = Examples::of_fits(recipe, clips.clone(), fits)?;
    Sampler::new(recipe, examples, Pictures::in_memory(clips, pictures)?)
}
