//! What a step of a training changes: the network, its average, the optimiser, the watch over the loss.

use burn::module::Module;
use burn::tensor::Device;

use super::super::examples::Batch;
use super::super::recipe::Recipe;
use super::ema::Ema;
use super::knowledge::{Knowledge, OwnTrack};
use super::laws::LearnedLaws;
use super::optimiser::AdamW;
use super::step::{StepOptions, StepReport, step};
use crate::model::Pen;
use gravisight_geometry::error::{Error, Result};

/// Steps over which the loss is averaged to see whether it explodes.
const WATCHED: f64 = 50.0;
/// How many times its lowest average the loss may rise to.
const EXPLODED: f64 = 10.0;

/// All that a training needs to go on, besides its recipe.
pub struct TrainerState {
    /// Steps done.
    pub step: usize,
    /// The network.
    pub model: Pen,
    /// Its moving average.
    pub average: Pen,
    /// The optimiser's moments, as networks.
    pub moments: [Pen; 2],
    /// Before the first step there is none.
    pub watch: Option<LossWatch>,
    /// What is known besides, where forecasts teach.
    pub knowledge: Knowledge,
}

/// What the loss on the maps was.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LossWatch {
    /// Its running mean.
    pub mean: f64,
    /// The lowest of that in this phase; infinite in the first steps.
    pub lowest: f64,
}

impl TrainerState {
    /// The start from `model`.
    pub fn first(recipe: &Recipe, model: Pen) -> Self {
        Self {
            step: 0,
            average: model.valid(),
            moments: AdamW::new(recipe.weight_decay, recipe.adam_epsilon).moments(&model),
            model,
            watch: None,
            knowledge: Knowledge::first(recipe),
        }
    }
}

/// A training in progress.
pub struct Trainer {
    recipe: Recipe,
    device: Device,
    step: usize,
    model: Pen,
    optimiser: AdamW,
    ema: Ema,
    watch: Option<LossWatch>,
    knowledge: Knowledge,
}

impl Trainer {
    /// Goes on from `state`; `device` is an autodiff device.
    pub fn new(recipe: &Recipe, state: TrainerState, device: &Device) -> Self {
        let TrainerState { step, model, average, moments, watch, knowledge } = state;
        let optimiser = AdamW::after(recipe.weight_decay, recipe.adam_epsilon, step, &moments);
        let ema = Ema::new(average, recipe.ema_decay, recipe.ema_warm_up.then_some(step));
        let model = if recipe.fixed_norms { model.with_fixed_norms() } else { model };
        Self { recipe: recipe.clone(), device: device.clone(), step, model, optimiser, ema, watch, knowledge }
    }

    /// What it would go on from.
    pub fn state(&self) -> TrainerState {
        let Self { step, watch, .. } = *self;
        let (model, moments) = (self.model.clone(), self.optimiser.moments(&self.model));
        TrainerState { step, model, average: self.average(), moments, watch, knowledge: self.knowledge.clone() }
    }

    /// Steps done.
    pub fn step(&self) -> usize {
        self.step
    }

    /// Where it computes; an autodiff device.
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// A copy of the averaged weights, which stays as it is. (A clone's norms would go on moving with the average.)
    pub fn average(&self) -> Pen {
        self.ema.model()
    }

    /// Physics that is learned along.
    pub fn laws(&self) -> &LearnedLaws {
        &self.knowledge.laws
    }

    /// Knows where the network finds the ball, as if it had just seen these frames.
    pub fn remember(&mut self, found: OwnTrack) {
        self.knowledge.own.extend(found);
    }

    /// The next step, on `batch`: what was found, and its learning rate. None after the last.
    ///
    /// # Errors
    /// [`Error::Diverged`]; as [`step`].
    pub async fn advance(&mut self, batch: Batch) -> Result<Option<(StepReport, f64)>> {
        let Some((phase, index)) = self.recipe.phase(self.step) else { return Ok(None) };
        let ramp = (self.step as f64 / self.recipe.future.ramp.max(1) as f64).min(1.0);
        let options = StepOptions {
            heatmap_loss: self.recipe.heatmap_loss(),
            depth_weight: self.recipe.depth_weight,
            depth_transition: self.recipe.depth_transition,
            centre_weight: self.recipe.centre_weight,
            future_weight: self.recipe.future.weight * ramp,
            robust_px: Some(self.recipe.future.robust_px).filter(|scale| scale.is_finite()),
            clip_norm: self.recipe.clip_norm,
            learning_rate: phase.learning_rate(index),
        };
        let (knowledge, device) = (&mut self.knowledge, &self.device);
        let (model, report) = step(self.model.clone(), &mut self.optimiser, batch, &options, knowledge, device).await?;
        self.step += 1;
        if !report.loss.is_finite() || self.explodes(report.heatmap + options.depth_weight * report.depth, index) {
            return Err(Error::Diverged { step: self.step, loss: report.loss });
        }
        self.ema.update(&model);
        self.model = model;
        Ok(Some((report, options.learning_rate)))
    }

    /// Whether the loss on the maps, averaged over some steps, has risen far above what it was in this phase; `index`
    /// counts the phase's steps. (The future loss rises by its ramp.)
    fn explodes(&mut self, loss: f64, index: usize) -> bool {
        let LossWatch { mean, lowest } = match self.watch {
            Some(LossWatch { mean, lowest }) if index > 0 => LossWatch { mean: mean + (loss - mean) / WATCHED, lowest },
            _ => LossWatch { mean: loss, lowest: f64::INFINITY },
        };
        // the first steps' mean is not one yet
        let lowest = if index as f64 > WATCHED { lowest.min(mean) } else { lowest };
        self.watch = Some(LossWatch { mean, lowest });
        mean > EXPLODED * lowest
    }
}
