//! Fine-tuning in memory: a model, a few clips of a new place, no files. What a browser can do.

mod given;
mod options;
mod resume;

use std::path::PathBuf;

use burn::tensor::Device;
use serde::Serialize;

pub use self::given::ClipKey;
use self::given::{Given, Here};
use self::options::recipe;
pub use self::options::{FineTuneOptions, FineTuneSupervision};
use super::super::examples::{Example, Examples, Pictures, Sampler, check_label, check_physics, teach};
use super::super::recipe::{Recipe, Select, Supervision};
use super::knowledge::OwnTrack;
use super::publish::{Best, card_of_fine_tuning, publish};
use super::score::{Score, score};
use super::step::StepReport;
use super::trainer::{Trainer, TrainerState};
use crate::localise::{LocaliseOptions, Localiser};
use crate::model::{self, Card, Pen, sha256_hex};
use gravisight_clips::{Clip, Clips};
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::image::Picture;

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
    /// Mean error of the forecasts, px, unweighted, where they teach; else zero.
    pub future: f64,
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
    /// The card and the options as text, of which the above are read: a resumed run reads the same.
    origin: [String; 2],
    /// The model before: its verifier and its motion network stay as they are.
    before: Localiser,
    /// Their weights.
    beside: [Vec<u8>; 2],
    trainer: Trainer,
    clips: Given,
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
        let [own, verifier, motion] = model::parted(&weights)?;
        let options = serde_json::to_string(options).map_err(Error::format("options"))?;
        let state = |recipe: &Recipe, blank: &Pen| {
            Ok(TrainerState::first(recipe, model::load_into(blank.clone(), own.clone())?))
        };
        Self::of([card.to_json()?, options], [verifier, motion], device, state)
    }

    /// In the state that `state` makes of the recipe and a blank network.
    fn of(
        origin: [String; 2],
        beside: [Vec<u8>; 2],
        device: &Device,
        state: impl FnOnce(&Recipe, &Pen) -> Result<TrainerState>,
    ) -> Result<Self> {
        let card = Card::from_json(&origin[0], "model card")?;
        let options: FineTuneOptions = serde_json::from_str(&origin[1]).map_err(Error::format("options"))?;
        let recipe = recipe(&card, &options)?;
        let (plain, device) = (device.clone().without_autodiff(), device.clone().autodiff());
        let state = state(&recipe, &Pen::new(&card.architecture, &device)?)?;
        let before = Localiser::of_parts(&card, state.average.clone(), &beside, &plain)?;
        let trainer = Trainer::new(&recipe, state, &device);
        let clips = Given::default();
        Ok(Self { card, recipe, origin, before, beside, trainer, clips, sampler: None, validation: None, best: None })
    }

    /// Gives a clip to learn from (its track is fitted by the physics of its scene, or forecasts start from its labels), or,
    /// `held_out`, to score with. `pictures` are its frames'.
    ///
    /// # Errors
    /// [`Error::Data`] for labels outside the picture, a clip without a scene or gravity, pictures of another size or
    /// number; [`Error::Value`] for a clip that comes after the first step or, held out, after the first score, and for one that
    /// a resumed run did not have.
    pub fn add_clip(&mut self, clip: Clip, pictures: Vec<Picture>, held_out: bool) -> Result<Added> {
        clip.frames.iter().try_for_each(|frame| check_label(&clip, frame))?;
        check_physics(std::slice::from_ref(&clip))?;
        // Refuses pictures that are not the clip's now, rather than at the first step.
        clip.check_pictures(&pictures)?;
        let key = ClipKey::of(&clip, &pictures, held_out)?;
        self.clips.check(&key)?;
        let (mut taught, mut left_out) = (None, None);
        let frames = if held_out {
            clip.frames.iter().filter(|frame| frame.visible).count()
        } else if self.recipe.supervision.is_future() {
            match Examples::of_labels(&self.recipe, alone(&clip)) {
                Ok(examples) => examples.windows(&self.recipe).len(),
                Err(Error::Data { reason, .. }) => {
                    left_out = Some(reason);
                    0
                }
                Err(error) => return Err(error),
            }
        } else {
            let fitted = teach(&clip, &self.recipe.fit);
            left_out = fitted.left_out.clone();
            taught.insert(fitted).frames.iter().flatten().count()
        };
        let added = Added { frames, left_out: left_out.clone() };
        self.clips.take(key, Here { clip, pictures, taught, left_out });
        if self.trainer.step() > 0 && !held_out && self.clips.missing().all(|key| key.held_out) {
            self.sampler = Some(sampler(&self.recipe, self.clips.hand_out(false)?)?);
        }
        Ok(added)
    }

    /// The clips that a resumed run had and that are still to be given again.
    pub fn awaited(&self) -> Vec<ClipKey> {
        self.clips.missing().cloned().collect()
    }

    /// Steps done, and steps in all.
    pub fn progress(&self) -> [usize; 2] {
        [self.trainer.step(), self.recipe.steps()]
    }

    /// One step; None after the last.
    ///
    /// # Errors
    /// [`Error::Data`] where no clip teaches anything; [`Error::Diverged`]; [`Error::Device`].
    pub async fn step(&mut self) -> Result<Option<Tuned>> {
        let Some((phase, _)) = self.recipe.phase(self.trainer.step()) else { return Ok(None) };
        let looks_first = self.trainer.step() == 0 && self.recipe.supervision == Supervision::Future2dPredict;
        let localiser = looks_first.then(|| self.localiser());
        let sampler = match &mut self.sampler {
            Some(sampler) => sampler,
            none => none.insert(sampler(&self.recipe, self.clips.hand_out(false)?)?),
        };
        if let Some(localiser) = &localiser {
            self.trainer.remember(first_seen(localiser, sampler).await?);
        }
        let batch = sampler.batch(phase, self.trainer.step())?;
        let Some((StepReport { loss, heatmap, depth, future, .. }, _)) = self.trainer.advance(batch).await? else {
            return Ok(None);
        };
        Ok(Some(Tuned { step: self.trainer.step(), steps: self.recipe.steps(), loss, heatmap, depth, future }))
    }

    /// Scores the averaged weights on the held-out clips, by 2D labels alone, and keeps them if none were better.
    ///
    /// # Errors
    /// [`Error::Data`] where no clip is held out; as evaluation does.
    pub async fn evaluate(&mut self) -> Result<Score> {
        let localiser = self.localiser();
        let validation = match &mut self.validation {
            Some(validation) => validation,
            none => {
                let held_out = self.clips.hand_out(true)?;
                let (clips, pictures) = held_out.into_iter().map(|here| (here.clip, here.pictures)).unzip();
                none.insert(Pictures::in_memory(in_memory(clips), pictures)?)
            }
        };
        let scored = score(&localiser, validation, None, self.trainer.laws()).await?;
        Best::keep(&mut self.best, &scored, Select::Forecast, self.trainer.average());
        Ok(scored)
    }

    /// The averaged weights as they are now, ready for pictures.
    pub fn localiser(&self) -> Localiser {
        let device = self.trainer.device().clone().without_autodiff();
        Localiser::from_pen(self.trainer.average(), self.card.clone(), &device).with_networks_of(&self.before)
    }

    /// The card and the weights that scored best on the held-out clips; where nothing was scored, the last.
    ///
    /// # Errors
    /// [`Error::WeightsFile`] where the weights cannot be written; [`Error::Device`] where they cannot be read.
    pub async fn export(&self) -> Result<(Card, Vec<u8>)> {
        let examples = self.sampler.as_ref().map(Sampler::examples);
        let card = card_of_fine_tuning(&self.card, examples, &self.recipe, self.trainer.step());
        let (card, own) = publish(card, self.best.as_ref(), self.trainer.average()).await?;
        let [verifier, motion] = &self.beside;
        let weights = model::joined([&own, verifier, motion])?;
        Ok((Card { sha256: sha256_hex(&weights), ..card }, weights))
    }
}

/// Where the model finds the ball before it learns: forecasts that must meet that are not to wait until training has come by.
async fn first_seen(localiser: &Localiser, sampler: &Sampler) -> Result<OwnTrack> {
    let mut found = OwnTrack::new();
    for &Example { clip, frame, .. } in &sampler.examples().frames {
        let Clip { camera, scene, .. } = &sampler.examples().clips.clips[clip];
        let picture = sampler.pictures().with(clip, frame, Picture::clone)?;
        let ball_radius = scene.as_ref().map(|scene| scene.ball.radius);
        let options = LocaliseOptions { ball_radius, ..LocaliseOptions::default() };
        match localiser.localise(&picture, camera, options).await {
            Ok(ball) => {
                found.insert([clip, frame], ball.image);
            }
            Err(error @ (Error::Device { .. } | Error::OutputNotFinite { .. })) => return Err(error),
            // Where the lens does not reach, say: nothing is seen there.
            Err(_) => {}
        }
    }
    Ok(found)
}

fn in_memory(clips: Vec<Clip>) -> Clips {
    Clips { folder: PathBuf::new(), clips }
}

fn alone(clip: &Clip) -> Clips {
    in_memory(vec![clip.clone()])
}

fn sampler(recipe: &Recipe, given: Vec<Here>) -> Result<Sampler> {
    let (mut clips, mut pictures, mut fits) = (vec![], vec![], vec![]);
    for here in given {
        clips.push(here.clip);
        pictures.push(here.pictures);
        fits.extend(here.taught);
    }
    let clips = in_memory(clips);
    let examples = match recipe.supervision.is_future() {
        true => Examples::of_labels(recipe, clips.clone())?,
        false => Examples::of_fits(recipe, clips.clone(), fits)?,
    };
    Sampler::new(recipe, examples, Pictures::in_memory(clips, pictures)?)
}
