//! The three networks' trainings.

use burn::tensor::Device;

use super::super::examples::{Batch, CandidateCrops, Photographs, Renderings, Stacks};
use super::super::learn::{Trainer, TrainerState};
use super::super::recipe::{HeatmapLoss, Network, Phase, Recipe, Supervision};
use super::AdaptOptions;
use super::patches::{Patch, PatchSampler, joined};
use super::resume::{CHECKPOINT, SavedStages};
use crate::localise::Localiser;
use crate::model::{self, Card, MOTION_SIDE, Pen, PenConfig, VERIFIER_SIDE, sha256_hex};
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::size::Size;

/// Side of the detector's pictures, px: mosaics of four windows.
const DETECTOR_SIDE: u32 = 256;
/// Pictures a step: of the video, and of those that the network was made with.
const DETECTOR_BATCH: [usize; 2] = [4, 2];
const VERIFIER_BATCH: [usize; 2] = [32, 16];
const MOTION_BATCH: usize = 48;
/// Decay of the average: an adaptation is short.
const EMA_DECAY: f64 = 0.98;
/// Part of the steps over which the learning rate rises.
const WARM_UP: usize = 20;

/// The networks, in the order of the parts of the weights.
pub const NAMES: [&str; 3] = ["detector", "verifier", "motion network"];

/// What a network learns from.
enum Source {
    Detector { own: Renderings, patches: PatchSampler },
    Verifier { own: Box<CandidateCrops>, patches: PatchSampler },
    Motion(Stacks),
}

/// A network in training.
pub struct Stage {
    trainer: Trainer,
    recipe: Recipe,
    source: Source,
}

/// The trainings of the networks of `card` with the weights `parts`, on `patches` and on the `stacks` of each video.
///
/// # Errors
/// As [`Localiser::new`].
pub fn stages(
    card: &Card,
    parts: &[Vec<u8>; 3],
    patches: Vec<Patch>,
    stacks: Vec<Vec<Vec<u8>>>,
    options: &AdaptOptions,
    device: &Device,
    mut saved: Option<SavedStages>,
) -> Result<Vec<Stage>> {
    let absent = |what: &str| Error::value("adapt", "model", format!("`{}` has no {what}", card.name));
    let verifier = card.verifier.clone().ok_or_else(|| absent("verifier"))?;
    let motion = card.motion.clone().ok_or_else(|| absent("motion network"))?;
    let recipe = |network, supervision, architecture: PenConfig, side, batch| {
        let phase = Phase {
            steps: options.steps,
            batch,
            crop: None,
            learning_rate: options.learning_rate,
            final_learning_rate: 0.0,
            warm_up: options.steps / WARM_UP,
        };
        let new = Recipe::new(card.name.clone(), supervision, Size::square(side), vec![phase]);
        Recipe {
            network,
            normalisation: card.normalisation,
            architecture: Some(architecture),
            seed: options.seed,
            ema_decay: EMA_DECAY,
            fixed_norms: true,
            depth_weight: 0.25,
            centre_weight: 0.1,
            ..new
        }
    };
    let mut stage = |recipe: Recipe, architecture: &PenConfig, part: usize, source| -> Result<Stage> {
        let device = device.clone().autodiff();
        let blank = Pen::new(architecture, &device)?;
        let state = match saved.as_mut().and_then(|saved| saved.take(part)) {
            Some((state, beside)) => TrainerState::of_parts(state, &beside, &blank, &recipe, CHECKPOINT)?,
            None => TrainerState::first(&recipe, model::load_into(blank, parts[part].clone())?),
        };
        Ok(Stage { trainer: Trainer::new(&recipe, state, &device), recipe, source })
    };
    let sampler = |patches: Vec<Patch>| PatchSampler::new(patches, card.normalisation, options.seed);

    let of_detector = recipe(
        Network::CompactSize,
        Supervision::Rendered,
        card.architecture.clone(),
        DETECTOR_SIDE,
        DETECTOR_BATCH[1],
    );
    let of_detector = Recipe { empty_fraction: 0.07, ..of_detector };
    let source = Source::Detector {
        own: Renderings::of(&of_detector, Photographs::default()),
        patches: sampler(patches.clone()),
    };
    let mut stages = vec![stage(of_detector, &card.architecture, 0, source)?];

    let of_verifier =
        recipe(Network::Verifier, Supervision::Candidates, verifier.clone(), VERIFIER_SIDE, VERIFIER_BATCH[1]);
    let of_verifier = Recipe { empty_fraction: 0.15, ..of_verifier };
    let weights = model::joined([&parts[0], &parts[1], &parts[2]])?;
    // On the CPU: a browser's GPU cannot be waited for.
    let detector = Localiser::new(Card { sha256: sha256_hex(&weights), ..card.clone() }, weights, &Device::flex())?;
    let own = Box::new(CandidateCrops::of(&of_verifier, Photographs::default(), detector)?);
    stages.push(stage(of_verifier, &verifier, 1, Source::Verifier { own, patches: sampler(patches) })?);

    let of_motion = recipe(Network::Motion, Supervision::Motion, motion.clone(), MOTION_SIDE, MOTION_BATCH);
    let of_motion =
        Recipe { heatmap_loss: Some(HeatmapLoss::CrossEntropy { sigma: 3.0 }), depth_weight: 0.1, ..of_motion };
    if let Some(stacks) = Stacks::of(&of_motion, stacks) {
        stages.push(stage(of_motion, &motion, 2, Source::Motion(stacks))?);
    }
    Ok(stages)
}

impl Stage {
    /// Which of the model's networks it is, in words.
    pub fn name(&self) -> &'static str {
        NAMES[self.part()]
    }

    /// Steps done.
    pub fn steps(&self) -> usize {
        self.trainer.step()
    }

    /// What it would go on from.
    pub fn state(&self) -> TrainerState {
        self.trainer.state()
    }

    /// Which it is among the parts of the weights.
    pub fn part(&self) -> usize {
        match self.source {
            Source::Detector { .. } => 0,
            Source::Verifier { .. } => 1,
            Source::Motion(_) => 2,
        }
    }

    /// A step: its number, from 1, and its loss. None after the last.
    ///
    /// # Errors
    /// As [`Trainer::advance`].
    pub async fn step(&mut self) -> Result<Option<(usize, f64)>> {
        let step = self.trainer.step();
        let Some((phase, _)) = self.recipe.phase(step) else { return Ok(None) };
        let batch: Batch = match &self.source {
            Source::Detector { own, patches } => {
                joined(patches.for_detector(DETECTOR_BATCH[0], DETECTOR_SIDE, step), own.batch(phase, step))
            }
            Source::Verifier { own, patches } => {
                joined(patches.for_verifier(VERIFIER_BATCH[0], step), own.batch(phase, step)?)
            }
            Source::Motion(stacks) => stacks.batch(phase, step),
        };
        Ok(self.trainer.advance(batch).await?.map(|(report, _)| (self.trainer.step(), report.loss)))
    }

    /// The averaged weights, in half precision.
    ///
    /// # Errors
    /// [`Error::WeightsFile`], [`Error::Device`].
    pub async fn weights(&self) -> Result<Vec<u8>> {
        model::halved(&model::save(&model::on_cpu(&self.trainer.average()).await?)?)
    }
}
