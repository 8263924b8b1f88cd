//! The training loop: steps, scores, log, checkpoints, and the model at the end.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use burn::tensor::Device;
use serde::Serialize;

use super::super::examples::{
    CandidateCrops, Fits, LeftOut, Loader, Pictures, Prepared, Renderings, Sampler, Source, Stacks, prepare,
};
use super::super::recipe::{Recipe, RunPaths, Supervision, TrainConfig};
use super::log::{LOG, log_until, table};
use super::memory::check_memory;
use super::publish::{Best, card_of_run, publish};
use super::score::{Score, SizeScore, clips_with, score, score_crops, score_sizes};
use super::step::StepReport;
use super::trainer::{Trainer, TrainerState};
use crate::localise::Localiser;
use crate::model::{self, Card, Pen, sha256_hex};
use gravisight_clips::Clips;
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::files::{Claim, write_whole};

/// What the loop tells its caller after each step.
#[derive(Debug, Clone, Serialize)]
pub struct TrainProgress {
    /// Steps done.
    pub step: usize,
    /// Steps of the run.
    pub steps: usize,
    /// Total loss of the step.
    pub loss: f64,
    /// Heatmap loss.
    pub heatmap: f64,
    /// Depth loss, unweighted.
    pub depth: f64,
    /// Future loss, unweighted, px; zero where forecasts do not teach.
    pub future: f64,
    /// Global gradient norm before clipping.
    pub gradient_norm: f64,
    /// Learning rate.
    pub learning_rate: f64,
    /// Wall time of the step, s.
    pub seconds: f64,
    /// Part of it that was spent waiting for pictures, s.
    pub waited: f64,
    /// Numbers of the scenes that are learned along, each as a factor of what the scenes say.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub laws: BTreeMap<&'static str, f64>,
    /// Score on the validation clips, after some steps.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub validation: Option<Validation>,
}

/// Score of the averaged weights on validation clips.
#[derive(Debug, Clone, Serialize)]
#[serde(untagged)]
pub enum Validation {
    /// It was scored.
    Score(Score),
    /// A network that reads sizes was.
    Size(SizeScore),
    /// A frame could not be scored. Training goes on: early networks do that.
    Failed {
        /// Why, in words.
        failed: String,
    },
}

/// What a run tells its caller.
#[derive(Debug, Clone)]
pub enum TrainEvent<'a> {
    /// Clips are fitted by physics.
    Fitting {
        /// Clips done.
        done: usize,
        /// Clips in all.
        all: usize,
    },
    /// What there is to learn is known.
    Prepared {
        /// Clips that are trained on.
        clips: usize,
        /// Frames with targets.
        frames: usize,
        /// Clips that physics cannot explain.
        left_out: &'a [LeftOut],
    },
    /// A step was made.
    Step(&'a TrainProgress),
}

/// What a run is scored on.
enum HeldOut {
    Clips(Pictures),
    Scenes(Renderings),
    Candidates(Box<CandidateCrops>),
    Motion(Stacks),
}

impl HeldOut {
    /// Memory of the pictures that are scored again and again, bytes.
    fn bytes(&self, recipe: &Recipe) -> usize {
        let Self::Clips(pictures) = self else { return 0 };
        let clips = pictures.clips();
        let bytes: usize = clips.iter().map(|clip| 3 * clip.camera.size().pixels() * clip.frames.len()).sum();
        bytes * clips_with(recipe.validate_frames, clips) / clips.len().max(1)
    }
}

/// A run in progress.
struct RunInProgress<'a> {
    recipe: &'a Recipe,
    paths: &'a RunPaths,
    /// To be kept, where physics teaches.
    fits: Option<Fits>,
    source: Arc<Source>,
    validation: HeldOut,
    device: Device,
    trainer: Trainer,
    /// Of the model that is made, but for its weights.
    card: Card,
    best: Option<Best>,
    log: String,
}

impl TrainConfig {
    /// Starts the run in its `out` folder: the path of the card of the model made.
    ///
    /// # Errors
    /// [`Error::Data`] for an `out` folder that already holds a run; else as [`Self::resume`].
    pub fn start(self, device: &Device, observe: &mut dyn FnMut(TrainEvent)) -> Result<PathBuf> {
        let out = self.paths.out.clone();
        let is_new = !out.exists();
        let made = self.make(device, observe);
        if made.is_err() && is_new {
            // A run that is refused leaves no folder; one with something in it cannot be removed so.
            drop(std::fs::remove_dir(&out));
        }
        made
    }

    fn make(self, device: &Device, observe: &mut dyn FnMut(TrainEvent)) -> Result<PathBuf> {
        let TrainConfig { mut recipe, paths } = self;
        recipe.check()?;
        if paths.run_file().exists() {
            let reason = "already holds a run; continue it with `train --resume`, or choose another `out`".into();
            return Err(Error::Data { what: paths.out.display().to_string(), reason });
        }
        let paths = paths.absolute()?;
        if let Some(path) = &paths.start_from {
            let card = Card::from_file(path)?;
            let network = recipe.supervision.network();
            let (architecture, name) = match network {
                1 => (card.verifier, "verifier"),
                2 => (card.motion, "motion network"),
                _ => (Some(card.architecture), "detector"),
            };
            let Some(architecture) = architecture else {
                return Err(Error::value("train", "start_from", format!("`{}` has no {name}", card.name)));
            };
            (recipe.architecture, recipe.normalisation) = (Some(architecture), card.normalisation);
            // The other networks see crops of one size.
            if network == 0 {
                recipe.input = card.input;
            }
            // Of another network, other values are allowed.
            recipe.check()?;
        }
        let config = TrainConfig { recipe, paths };
        let text = config.to_toml()?;
        // A run that cannot start leaves nothing that would have to be resumed.
        let run = RunInProgress::new(&config, device, observe)?;
        write_whole(&config.paths.run_file(), text.as_bytes())?;
        run.finish(observe)
    }

    /// Goes on with the run in folder `out` from its last checkpoint (from the start where there is
    /// none): the path of the card of the model made.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Format`] and [`Error::Data`] for missing or damaged files;
    /// [`Error::Diverged`] for a loss that is not finite.
    pub fn resume(out: &Path, device: &Device, observe: &mut dyn FnMut(TrainEvent)) -> Result<PathBuf> {
        RunInProgress::new(&TrainConfig::saved_in(out)?, device, observe)?.finish(observe)
    }
}

impl<'a> RunInProgress<'a> {
    fn new(config: &'a TrainConfig, device: &Device, observe: &mut dyn FnMut(TrainEvent)) -> Result<Self> {
        let TrainConfig { recipe, paths } = config;
        let device = device.clone().autodiff();
        let (source, validation, fits) = match recipe.supervision {
            Supervision::Rendered => {
                let source = Renderings::new(recipe, paths.train.as_deref())?;
                let held_out = Renderings::new(recipe, paths.validation.as_deref())?;
                (Source::Scenes(source), HeldOut::Scenes(held_out), None)
            }
            Supervision::Candidates => {
                let source = CandidateCrops::new(recipe, paths.train.as_deref(), paths.detector()?)?;
                let held_out = CandidateCrops::new(recipe, paths.validation.as_deref(), paths.detector()?)?;
                (Source::Candidates(Box::new(source)), HeldOut::Candidates(Box::new(held_out)), None)
            }
            Supervision::Motion => {
                let held_out = Stacks::new(recipe, paths.validation()?)?;
                (Source::Motion(Stacks::new(recipe, paths.train()?)?), HeldOut::Motion(held_out), None)
            }
            _ => {
                let validation = Pictures::new(Clips::read(paths.validation()?)?, recipe.cache_mb << 20);
                let (sampler, fits) = sampler(recipe, paths, observe)?;
                (Source::Clips(Box::new(sampler)), HeldOut::Clips(validation), fits)
            }
        };
        let architecture = recipe.architecture(recipe.prior_depth.unwrap_or_else(|| source.mean_depth()));
        let card = card_of_run(recipe, paths.data_name(), &source, &architecture);
        device.seed(recipe.seed);
        let blank = Pen::new(&architecture, &device)?;
        check_memory(recipe, &blank, &source, validation.bytes(recipe), model::is_cpu(&device))?;
        let state = match TrainerState::load_last(&paths.checkpoints(), &blank, recipe)? {
            Some(state) => state,
            None => TrainerState::first(recipe, with_start(blank, recipe.supervision, paths)?),
        };
        let best = Best::load(&paths.checkpoints(), &state.average)?;
        let log = log_until(&paths.log(), state.step)?;
        let trainer = Trainer::new(recipe, state, &device);
        Ok(Self { recipe, paths, fits, source: Arc::new(source), validation, device, trainer, card, best, log })
    }

    /// All steps that are left, then the model.
    fn finish(mut self, observe: &mut dyn FnMut(TrainEvent)) -> Result<PathBuf> {
        let _claim = Claim::of(&self.paths.out)?;
        if let Some(fits) = &self.fits {
            fits.save(&self.paths.fits())?;
        }
        let on_cpu = model::is_cpu(&self.device);
        let mut loader = Loader::start(self.source.clone(), self.recipe, self.trainer.step(), on_cpu)?;
        while let Some(progress) = self.next(&mut loader)? {
            let line = serde_json::to_string(&progress).map_err(Error::format(LOG))?;
            writeln!(self.log, "{line}").map_err(Error::format(LOG))?;
            if progress.step.is_multiple_of(self.recipe.checkpoint_every) || progress.step == progress.steps {
                self.checkpoint()?;
            }
            observe(TrainEvent::Step(&progress));
        }
        self.publish()
    }

    /// One step; None after the last.
    fn next(&mut self, loader: &mut Loader) -> Result<Option<TrainProgress>> {
        let steps = self.recipe.steps();
        let Some((phase, _)) = self.recipe.phase(self.trainer.step()) else { return Ok(None) };
        let began = Instant::now();
        let batch = loader.next(phase)?;
        let waited = began.elapsed().as_secs_f64();
        let Some((report, learning_rate)) = pollster::block_on(self.trainer.advance(batch))? else { return Ok(None) };
        let StepReport { loss, heatmap, depth, future, gradient_norm } = report;
        let step = self.trainer.step();
        let scores = step.is_multiple_of(self.recipe.validate_every) || step == steps;
        Ok(Some(TrainProgress {
            step,
            steps,
            loss,
            heatmap,
            depth,
            future,
            gradient_norm,
            learning_rate,
            seconds: began.elapsed().as_secs_f64(),
            waited,
            laws: self.trainer.laws().factors().map(|(law, factor)| (law.name(), factor)).collect(),
            validation: if scores { Some(self.validate()?) } else { None },
        }))
    }

    /// Scores the averaged weights, and keeps them if none were better.
    fn validate(&mut self) -> Result<Validation> {
        let device = self.device.clone().without_autodiff();
        let average = self.trainer.average();
        let localiser = Localiser::from_pen(average.clone(), self.card.clone(), &device);
        let (frames, laws) = (self.recipe.validate_frames, self.trainer.laws());
        let scored = pollster::block_on(async {
            Ok::<_, Error>(match &self.validation {
                HeldOut::Clips(pictures) => Validation::Score(score(&localiser, pictures, Some(frames), laws).await?),
                HeldOut::Candidates(crops) => {
                    Validation::Size(score_crops(&localiser, &|index| crops.scored(index), frames).await?)
                }
                HeldOut::Motion(stacks) => {
                    Validation::Size(score_crops(&localiser, &|index| Ok(stacks.scored(index)), frames).await?)
                }
                HeldOut::Scenes(renderings) => Validation::Size(score_sizes(&localiser, renderings, frames).await?),
            })
        });
        let scored = match scored {
            Ok(scored) => scored,
            Err(error) => return Ok(Validation::Failed { failed: error.to_string() }),
        };
        let kept = match &scored {
            Validation::Score(scored) => Best::keep(&mut self.best, scored, self.recipe.select, average),
            Validation::Size(scored) => {
                let score = match self.recipe.supervision {
                    Supervision::Candidates | Supervision::Motion => scored.confused,
                    _ => scored.radius_error,
                };
                Best::keep_by(&mut self.best, Some(score), scored.confidence_threshold, average)
            }
            Validation::Failed { .. } => false,
        };
        if kept && let Some(best) = &self.best {
            best.save(&self.paths.checkpoints(), self.trainer.step())?;
        }
        Ok(scored)
    }

    /// Log first: a line too many is dropped on resume, a missing one could not be made up.
    fn checkpoint(&mut self) -> Result<()> {
        write_whole(&self.paths.log(), self.log.as_bytes())?;
        write_whole(&self.paths.log_table(), &table(&self.log)?)?;
        self.trainer.state().save(&self.paths.checkpoints())
    }

    /// Writes the averaged weights that scored best (where none could be scored: the last) and their card.
    fn publish(self) -> Result<PathBuf> {
        let (mut card, mut weights) =
            pollster::block_on(publish(self.card, self.best.as_ref(), self.trainer.average()))?;
        if matches!(self.recipe.supervision, Supervision::Candidates | Supervision::Motion) {
            let is_motion = self.recipe.supervision == Supervision::Motion;
            (card, weights) = with_second(Card::with_weights(self.paths.detector()?)?, card, &weights, is_motion)?;
        }
        write_whole(&self.paths.out.join(&card.weights), &weights)?;
        let path = self.paths.out.join(format!("{}.json", card.name));
        card.write(&path)?;
        Ok(path)
    }
}

/// What draws from the training clips, and the fits behind them where physics teaches.
fn sampler(recipe: &Recipe, paths: &RunPaths, observe: &mut dyn FnMut(TrainEvent)) -> Result<(Sampler, Option<Fits>)> {
    let mut fitting = |done, all| observe(TrainEvent::Fitting { done, all });
    let Prepared { examples, left_out, fits } = prepare(recipe, paths.train()?, &paths.fits(), &mut fitting)?;
    let (clips, frames) = (examples.clips.clips.len(), examples.frames.len());
    observe(TrainEvent::Prepared { clips, frames, left_out: &left_out });
    let pictures = Pictures::new(examples.clips.clone(), recipe.cache_mb << 20);
    Ok((Sampler::new(recipe, examples, pictures)?, fits))
}

/// A detector (its card and weights) with a second network: a verifier, or a motion network.
fn with_second(
    (detector, own): (Card, Vec<u8>),
    second: Card,
    weights: &[u8],
    is_motion: bool,
) -> Result<(Card, Vec<u8>)> {
    let [own, verifier, motion] = model::parted(&own)?;
    let parts: [&[u8]; 3] = if is_motion { [&own, &verifier, weights] } else { [&own, weights, &motion] };
    let weights = model::joined(parts)?;
    let (of_verifier, of_motion) = match is_motion {
        true => (detector.verifier.clone(), Some(second.architecture)),
        false => (Some(second.architecture), detector.motion.clone()),
    };
    let name = if is_motion { "motion network" } else { "verifier" };
    // Trained again, it takes the place of the one before.
    let before = |text: &str, name: &str| text.split(name).next().unwrap_or_default().to_string();
    let (data, said) = (format!("; the {name}: "), format!(" The {name}: "));
    let card = Card {
        sha256: sha256_hex(&weights),
        verifier: of_verifier,
        motion: of_motion,
        training_data: format!("{}{data}{}", before(&detector.training_data, &data), second.training_data),
        description: format!("{}{said}{}", before(&detector.description, &said), second.description),
        metrics: serde_json::Value::Null,
        ..detector
    };
    Ok((card, weights))
}

/// The fresh network with the weights that the run starts from: those of the same network of a model, or a backbone's.
fn with_start(pen: Pen, supervision: Supervision, paths: &RunPaths) -> Result<Pen> {
    if let Some(path) = &paths.start_from {
        let (card, weights) = Card::with_weights(path)?;
        card.check_weights(&weights)?;
        let mut networks = model::parted(&weights)?;
        return model::load_into(pen, std::mem::take(&mut networks[supervision.network()]));
    }
    let Some(path) = &paths.backbone_weights else { return Ok(pen) };
    model::load_backbone(pen, gravisight_geometry::files::read(path)?)
}
