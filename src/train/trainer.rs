//! What a step of a training changes: the network, its average, the optimiser.

use burn::module::Module;
use burn::optim::{AdamWConfig, ModuleOptimizer};
use burn::tensor::Device;

use super::config::TrainConfig;
use super::ema::Ema;
use super::step::{Batch, StepOptions, StepReport, step};
use crate::error::{Error, Result};
use crate::model::Pen;

/// Steps over which the loss is averaged to see whether it explodes.
const WATCHED: f64 = 50.0;
/// How many times its lowest average the loss may rise to.
const EXPLODED: f64 = 10.0;

/// A training's state.
pub struct Trainer {
    config: TrainConfig,
    device: Device,
    /// Steps done.
    pub step: usize,
    /// The network.
    pub model: Pen,
    /// The optimiser's moments.
    pub optimiser: ModuleOptimizer,
    ema: Ema,
    /// Running mean of the loss, and its lowest value in this phase.
    watch: Option<(f64, f64)>,
}

impl Trainer {
    /// At step `step`, with `average` the moving average of `model`'s weights; `device` is an autodiff device.
    pub fn new(
        config: &TrainConfig,
        step: usize,
        model: Pen,
        average: Pen,
        optimiser: ModuleOptimizer,
        device: &Device,
    ) -> Self {
        let ema = Ema::new(average, config.ema_decay, step);
        let model = if config.fixed_norms { model.with_fixed_norms() } else { model };
        Self { config: config.clone(), device: device.clone(), step, model, optimiser, ema, watch: None }
    }

    /// Where it computes; an autodiff device.
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// The optimiser of a run at its start.
    pub fn optimiser(config: &TrainConfig) -> ModuleOptimizer {
        AdamWConfig::new().with_weight_decay(config.weight_decay as f32).init()
    }

    /// A copy of the averaged weights, which stays as it is. (A clone's norms would go on moving with the average.)
    pub fn average(&self) -> Pen {
        self.ema.model().valid()
    }

    /// The next step, on `batch`: what was found, and its learning rate. None after the last.
    ///
    /// # Errors
    /// [`Error::Diverged`]; as [`step`].
    pub async fn advance(&mut self, batch: Batch) -> Result<Option<(StepReport, f64)>> {
        let Some((phase, index)) = self.config.phase(self.step) else { return Ok(None) };
        let ramp = (self.step as f64 / self.config.future.ramp.max(1) as f64).min(1.0);
        let options = StepOptions {
            heatmap_loss: self.config.heatmap_loss(),
            depth_weight: self.config.depth_weight,
            depth_transition: self.config.depth_transition,
            future_weight: self.config.future.weight * ramp,
            robust_px: Some(self.config.future.robust_px).filter(|scale| scale.is_finite()),
            clip_norm: self.config.clip_norm,
            learning_rate: phase.learning_rate(index),
        };
        let (model, report) = step(self.model.clone(), &mut self.optimiser, batch, &options, &self.device).await?;
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
        let (mean, lowest) = match self.watch {
            Some((mean, lowest)) if index > 0 => (mean + (loss - mean) / WATCHED, lowest),
            _ => (loss, f64::INFINITY),
        };
        // the first steps' mean is not one yet
        let lowest = if index as f64 > WATCHED { lowest.min(mean) } else { lowest };
        self.watch = Some((mean, lowest));
        mean > EXPLODED * lowest
    }
}
