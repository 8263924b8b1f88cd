//! How a fine-tuning goes.

use serde::{Deserialize, Serialize};

use super::super::super::recipe::{FutureConfig, Phase, Recipe, Supervision};
use crate::model::Card;
use gravisight_geometry::error::Result;

/// Fraction of the steps that see crops; the others see whole pictures, as the model will.
const CROPPED: f64 = 0.9;
/// How many times the pixels of a crop's batch a batch of whole pictures has at most.
const WHOLE: f64 = 1.5;
/// Decay of the average: a fine-tuning is short.
const EMA_DECAY: f64 = 0.98;
/// How far the learning rate falls during the crops, and where the whole pictures start.
const LAST_RATE: f64 = 0.1;
/// Part of the crops' steps over which the learning rate rises, and the forecasts' weight: the moments are not known at first.
const WARM_UP: usize = 20;

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
    /// What teaches depth. Default: "physics-fit".
    pub supervision: FineTuneSupervision,
    /// Seed of the batches. Default: 1.
    pub seed: u64,
}

impl Default for FineTuneOptions {
    fn default() -> Self {
        Self {
            steps: 200,
            batch: 12,
            crop: 128,
            learning_rate: 1e-3,
            supervision: FineTuneSupervision::default(),
            seed: 1,
        }
    }
}

/// What teaches depth: 2D labels and the scene's physics, in one of three ways.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
pub enum FineTuneSupervision {
    /// Each clip's labels are fitted by physics, all frames at once, and the network learns the fitted depths.
    #[default]
    #[serde(rename = "physics-fit")]
    PhysicsFit,
    /// The forecast from a frame must meet the network's own 2D positions in later and earlier ones, the target of the paper's 2D-predict.
    #[serde(rename = "future-2d-predict")]
    Future2dPredict,
    /// The forecast must meet the 2D labels there, the target of the paper's 2D-gt.
    #[serde(rename = "future-2d-gt")]
    Future2dGt,
}

impl From<FineTuneSupervision> for Supervision {
    fn from(supervision: FineTuneSupervision) -> Self {
        match supervision {
            FineTuneSupervision::PhysicsFit => Self::PhysicsFit,
            FineTuneSupervision::Future2dPredict => Self::Future2dPredict,
            FineTuneSupervision::Future2dGt => Self::Future2dGt,
        }
    }
}

/// The training that goes on from the model of `card` so.
///
/// # Errors
/// [`Error::Value`](gravisight_geometry::error::Error::Value) for options that cannot train.
pub fn recipe(card: &Card, options: &FineTuneOptions) -> Result<Recipe> {
    let FineTuneOptions { steps, batch, crop, learning_rate, supervision, seed } = *options;
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
    let warm_up = cropped / WARM_UP;
    let mut phases = vec![Phase { warm_up, ..phase(cropped, batch, Some(crop), learning_rate, last) }];
    if steps > cropped {
        phases.push(phase(steps - cropped, whole, None, last, 0.0));
    }
    let recipe = Recipe {
        normalisation: card.normalisation,
        architecture: Some(card.architecture.clone()),
        seed,
        ema_decay: EMA_DECAY,
        fixed_norms: true,
        // The model's depths forecast something sensible from the start.
        future: FutureConfig { ramp: warm_up, ..FutureConfig::default() },
        ..Recipe::new(card.name.clone(), supervision.into(), card.input, phases)
    };
    recipe.check()?;
    Ok(recipe)
}
