//! The training loop: steps, scores, log, checkpoints, and the model at the end.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use burn::module::Module;
use burn::tensor::Device;
use serde::Serialize;

use super::batch::Sampler;
use super::checkpoint::{Best, Checkpoint};
use super::config::{Supervision, TrainConfig};
use super::examples::LeftOut;
use super::loader::Loader;
use super::log::{LOG, LOG_CSV, log_until, table};
use super::memory::check_memory;
use super::pictures::Pictures;
use super::prepare::prepare;
use super::recipe::read_fields;
use super::score::{Score, score};
use super::step::StepReport;
use super::trainer::Trainer;
use crate::clips::Clips;
use crate::error::{Error, Result};
use crate::files::write_whole;
use crate::localise::Localiser;
use crate::model::{self, Card, Pen, PenConfig, sha256_hex};

/// The configuration's file in a run's folder.
pub const CONFIG: &str = "run.toml";
const CHECKPOINTS: &str = "checkpoints";
const FITS: &str = "fits.jsonl";

/// What the loop tells its caller after each step.
#[derive(Debug, Clone, Serialize)]
pub struct Progress {
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
    /// A frame could not be scored. Training goes on: early networks do that.
    Failed {
        /// Why, in words.
        failed: String,
    },
}

/// What the loop tells before its first step.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Prepared {
    /// Clips that are trained on.
    pub clips: usize,
    /// Frames with targets.
    pub frames: usize,
    /// Clips that physics cannot explain.
    pub left_out: Vec<LeftOut>,
}

/// What a run tells its caller.
#[derive(Debug, Clone)]
pub enum Event<'a> {
    /// Clips are fitted by physics.
    Fitting {
        /// Clips done.
        done: usize,
        /// Clips in all.
        all: usize,
    },
    /// What there is to learn.
    Prepared(&'a Prepared),
    /// A step was made.
    Step(&'a Progress),
}

/// A run in progress.
struct Run<'a> {
    config: &'a TrainConfig,
    sampler: Arc<Sampler>,
    validation: Pictures,
    device: Device,
    trainer: Trainer,
    best: Option<Best>,
    log: String,
}

/// Starts the run of `config` in its `out` folder: the path of the card of the model made.
///
/// # Errors
/// [`Error::Data`] for an `out` folder that already holds a run; else as [`resume`].
pub fn start(mut config: TrainConfig, device: &Device, observe: &mut dyn FnMut(Event)) -> Result<PathBuf> {
    config.check()?;
    let saved = config.out.join(CONFIG);
    if saved.exists() {
        let reason = "already holds a run; go on with `train --resume`, or choose another `out`".into();
        return Err(Error::Data { what: config.out.display().to_string(), reason });
    }
    for folder in [&mut config.train, &mut config.validation] {
        *folder = std::fs::canonicalize(&*folder).map_err(Error::io(&*folder))?;
    }
    std::fs::create_dir_all(&config.out).map_err(Error::io(&config.out))?;
    config.out = std::fs::canonicalize(&config.out).map_err(Error::io(&config.out))?;
    for file in [&mut config.backbone_weights, &mut config.start_from].into_iter().flatten() {
        *file = std::fs::canonicalize(&*file).map_err(Error::io(&*file))?;
    }
    if let Some(path) = &config.start_from {
        let card = Card::from_file(path)?;
        config.architecture = Some(card.architecture);
        (config.input, config.normalisation) = (card.input, card.normalisation);
    }
    let text = toml::to_string(&config).map_err(Error::format(saved.display().to_string()))?;
    // A run that cannot start leaves nothing that would have to be resumed.
    let run = Run::new(&config, device, observe)?;
    write_whole(&saved, text.as_bytes())?;
    run.finish(observe)
}

/// Goes on with the run in folder `out` from its last checkpoint (from the start where there is
/// none): the path of the card of the model made.
///
/// # Errors
/// [`Error::Io`], [`Error::Format`] and [`Error::Data`] for missing or damaged files;
/// [`Error::Diverged`] for a loss that is not finite.
pub fn resume(out: &Path, device: &Device, observe: &mut dyn FnMut(Event)) -> Result<PathBuf> {
    if !out.join(CONFIG).exists() {
        let reason = format!("holds no run (no {CONFIG}); start one with `train --config`");
        return Err(Error::Data { what: out.display().to_string(), reason });
    }
    let mut config = TrainConfig::of(read_fields(&out.join(CONFIG))?)?;
    config.out = out.to_path_buf();
    Run::new(&config, device, observe)?.finish(observe)
}

impl<'a> Run<'a> {
    fn new(config: &'a TrainConfig, device: &Device, observe: &mut dyn FnMut(Event)) -> Result<Self> {
        let device = device.clone().autodiff();
        let validation = Pictures::new(Clips::read(&config.validation)?, 0);
        let examples = prepare(config, &config.out.join(FITS), &mut |done, all| observe(Event::Fitting { done, all }))?;
        let clips = examples.clips.clips.len();
        let prepared = Prepared { clips, frames: examples.frames.len(), left_out: examples.left_out.clone() };
        observe(Event::Prepared(&prepared));
        let pictures = Pictures::new(examples.clips.clone(), config.cache_mb << 20);
        let sampler = Arc::new(Sampler::new(config, examples, pictures)?);
        let architecture = architecture(config, &sampler);
        device.seed(config.seed);
        let blank = Pen::new(&architecture, &device)?;
        check_memory(config, &blank, &sampler)?;
        let optimiser = Trainer::optimiser(config);
        let folder = config.out.join(CHECKPOINTS);
        let Checkpoint { step, model, average, optimiser } =
            match Checkpoint::load_last(&folder, &blank, optimiser.clone())? {
                Some(state) => state,
                None => {
                    let model = with_start(blank, config)?;
                    Checkpoint { step: 0, average: model.valid(), model, optimiser }
                }
            };
        let best = Best::load(&folder, &average)?;
        let log = log_until(&config.out.join(LOG), step)?;
        let trainer = Trainer::new(config, step, model, average, optimiser, &device);
        Ok(Self { config, sampler, validation, device, trainer, best, log })
    }

    /// All steps that are left, then the model.
    fn finish(mut self, observe: &mut dyn FnMut(Event)) -> Result<PathBuf> {
        let loader = Loader::start(self.sampler.clone(), self.config, self.trainer.step)?;
        while let Some(progress) = self.next(&loader)? {
            let line = serde_json::to_string(&progress).map_err(Error::format(LOG))?;
            writeln!(self.log, "{line}").map_err(Error::format(LOG))?;
            if self.trainer.step.is_multiple_of(self.config.checkpoint_every) || progress.step == progress.steps {
                self.checkpoint()?;
            }
            observe(Event::Step(&progress));
        }
        self.publish()
    }

    /// One step; None after the last.
    fn next(&mut self, loader: &Loader) -> Result<Option<Progress>> {
        let steps = self.config.steps();
        if self.trainer.step >= steps {
            return Ok(None);
        }
        let began = Instant::now();
        let batch = loader.next()?;
        let waited = began.elapsed().as_secs_f64();
        let Some((report, learning_rate)) = pollster::block_on(self.trainer.advance(batch))? else { return Ok(None) };
        let StepReport { loss, heatmap, depth, future, gradient_norm } = report;
        let step = self.trainer.step;
        let scores = step.is_multiple_of(self.config.validate_every) || step == steps;
        Ok(Some(Progress {
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
            validation: if scores { Some(self.validate()?) } else { None },
        }))
    }

    /// Scores the averaged weights, and keeps them if none were better.
    fn validate(&mut self) -> Result<Validation> {
        let device = self.device.clone().without_autodiff();
        let average = self.trainer.average();
        let card = card(self.config, &self.sampler, average.config(), String::new());
        let localiser = Localiser::from_pen(average.clone(), card, &device);
        let scored = match pollster::block_on(score(&localiser, &self.validation, self.config.validate_frames)) {
            Ok(scored) => scored,
            Err(error) => return Ok(Validation::Failed { failed: error.to_string() }),
        };
        let score = scored.forecast_px.filter(|score| score.is_finite());
        if self.best.as_ref().is_none_or(|best| best.is_beaten_by(score)) {
            let best = Best { step: self.trainer.step, score, least_confidence: scored.least_confidence, average };
            best.save(&self.config.out.join(CHECKPOINTS))?;
            self.best = Some(best);
        }
        Ok(Validation::Score(scored))
    }

    /// Log first: a line too many is dropped on resume, a missing one could not be made up.
    fn checkpoint(&mut self) -> Result<()> {
        write_whole(&self.config.out.join(LOG), self.log.as_bytes())?;
        write_whole(&self.config.out.join(LOG_CSV), &table(&self.log)?)?;
        let Trainer { step, model, optimiser, .. } = &self.trainer;
        let (model, optimiser) = (model.clone(), optimiser.clone());
        let state = Checkpoint { step: *step, model, average: self.trainer.average(), optimiser };
        state.save(&self.config.out.join(CHECKPOINTS))
    }

    /// Writes the averaged weights that scored best (where none could be scored: the last) and their card.
    fn publish(&self) -> Result<PathBuf> {
        let pen = self.best.as_ref().map_or_else(|| self.trainer.average(), |best| best.average.clone());
        let weights = model::halved(&model::save(&pen)?)?;
        let mut card = card(self.config, &self.sampler, pen.config(), sha256_hex(&weights));
        card.confidence_threshold = self.best.as_ref().map(|best| best.least_confidence / 2.0);
        write_whole(&self.config.out.join(&card.weights), &weights)?;
        let path = self.config.out.join(format!("{}.json", card.name));
        card.write(&path)?;
        Ok(path)
    }
}

/// The fresh network with the weights that the configuration names: a model's, or a backbone's.
fn with_start(pen: Pen, config: &TrainConfig) -> Result<Pen> {
    if let Some(path) = &config.start_from {
        let (card, weights) = Card::with_weights(path)?;
        card.check_weights(&weights)?;
        return model::load_into(pen, weights);
    }
    let Some(path) = &config.backbone_weights else { return Ok(pen) };
    model::load_backbone_timm(pen, std::fs::read(path).map_err(Error::io(path))?)
}

/// The run's architecture, with the prior depth of its data.
fn architecture(config: &TrainConfig, sampler: &Sampler) -> PenConfig {
    let [_, mean, _] = sampler.examples().depths();
    config.architecture(config.prior_depth.unwrap_or(mean))
}

/// The card of the model this run makes.
fn card(config: &TrainConfig, sampler: &Sampler, architecture: &PenConfig, sha256: String) -> Card {
    let examples = sampler.examples();
    let [nearest, _, farthest] = examples.depths();
    let folder = || config.train.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let data = config.data_name.clone().unwrap_or_else(folder);
    let taught = match config.supervision {
        Supervision::PhysicsFit => "2D labels and physics, fitted clip by clip".into(),
        Supervision::Future2dPredict => "2D labels and physics, through forecasts (the paper's 2D-predict)".into(),
        Supervision::Future2dGt => "2D labels and physics, through forecasts (the paper's 2D-gt)".into(),
        Supervision::Labels3d => "3D labels (the paper's baseline, not its method)".into(),
        Supervision::Mixed => format!(
            "3D labels of {:.0} % of the clips, 2D labels and physics of the others",
            100.0 * config.labelled_share
        ),
    };
    let supervision = format!("Trained with {taught}: {} steps, seed {}.", config.steps(), config.seed);
    Card {
        name: config.name.clone(),
        weights: format!("{}.safetensors", config.name),
        sha256,
        architecture: architecture.clone(),
        input: config.input,
        normalisation: config.normalisation,
        depth_range: [nearest, farthest],
        confidence_threshold: None,
        training_data: format!("{data}: {} frames", examples.frames.len()),
        description: format!("{} {supervision}", config.description).trim().to_string(),
        metrics: serde_json::Value::Null,
        licence: config.licence.clone(),
    }
}
