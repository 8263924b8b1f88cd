//! The training loop: steps, scores, log, checkpoints, and the model at the end.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use burn::module::Module;
use burn::optim::{AdamWConfig, ModuleOptimizer};
use burn::tensor::Device;
use serde::Serialize;

use super::batch::Sampler;
use super::checkpoint::{Best, Checkpoint};
use super::config::{Supervision, TrainConfig};
use super::ema::Ema;
use super::examples::{Examples, LeftOut};
use super::loader::Loader;
use super::log::{LOG, LOG_CSV, log_until, table};
use super::memory::check_memory;
use super::recipe::read_fields;
use super::score::{Score, score};
use super::step::{StepOptions, StepReport, step};
use crate::data::Clips;
use crate::error::{Error, Result};
use crate::files::write_whole;
use crate::localise::Localiser;
use crate::model::{self, Card, Pen, PenConfig, sha256_hex};

/// The configuration's file in a run's folder.
pub const CONFIG: &str = "run.toml";
const CHECKPOINTS: &str = "checkpoints";
const FITS: &str = "fits.jsonl";
/// Steps over which the loss is averaged to see whether it explodes.
const WATCHED: f64 = 50.0;
/// How many times its lowest average the loss may rise to.
const EXPLODED: f64 = 10.0;

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
    validation: Clips,
    device: Device,
    state: Checkpoint,
    best: Option<Best>,
    ema: Ema,
    log: String,
    /// Running mean of the loss, and its lowest value in this phase.
    watch: Option<(f64, f64)>,
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
    if let Some(weights) = &mut config.backbone_weights {
        *weights = std::fs::canonicalize(&*weights).map_err(Error::io(&*weights))?;
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
        let validation = Clips::read(&config.validation)?;
        let examples =
            Examples::of(config, &config.out.join(FITS), &mut |done, all| observe(Event::Fitting { done, all }))?;
        let clips = examples.clips.clips.len();
        let prepared = Prepared { clips, frames: examples.frames.len(), left_out: examples.left_out.clone() };
        observe(Event::Prepared(&prepared));
        let sampler = Arc::new(Sampler::new(config, examples)?);
        let architecture = architecture(config, &sampler);
        device.seed(config.seed);
        let blank = Pen::new(&architecture, &device)?;
        check_memory(config, &blank, &sampler)?;
        let optimiser: ModuleOptimizer = AdamWConfig::new().with_weight_decay(config.weight_decay as f32).init();
        let folder = config.out.join(CHECKPOINTS);
        let state = match Checkpoint::load_last(&folder, &blank, optimiser.clone())? {
            Some(state) => state,
            None => {
                let model = with_backbone(blank, config)?;
                Checkpoint { step: 0, average: model.valid(), model, optimiser }
            }
        };
        let best = Best::load(&folder, &state.average)?;
        let ema = Ema::new(state.average.valid(), config.ema_decay, state.step);
        let log = log_until(&config.out.join(LOG), state.step)?;
        Ok(Self { config, sampler, validation, device, state, best, ema, log, watch: None })
    }

    /// All steps that are left, then the model.
    fn finish(mut self, observe: &mut dyn FnMut(Event)) -> Result<PathBuf> {
        let loader = Loader::start(self.sampler.clone(), self.config, self.state.step)?;
        while let Some(progress) = self.next(&loader)? {
            let line = serde_json::to_string(&progress).map_err(Error::format(LOG))?;
            writeln!(self.log, "{line}").map_err(Error::format(LOG))?;
            if self.state.step.is_multiple_of(self.config.checkpoint_every) || progress.step == progress.steps {
                self.checkpoint()?;
            }
            observe(Event::Step(&progress));
        }
        self.publish()
    }

    /// One step; None after the last.
    fn next(&mut self, loader: &Loader) -> Result<Option<Progress>> {
        let Some((phase, index)) = self.config.phase(self.state.step) else { return Ok(None) };
        let began = Instant::now();
        let batch = loader.next()?;
        let waited = began.elapsed().as_secs_f64();
        let ramp = (self.state.step as f64 / self.config.future.ramp.max(1) as f64).min(1.0);
        let options = StepOptions {
            heatmap_loss: self.config.heatmap_loss(),
            depth_weight: self.config.depth_weight,
            depth_transition: self.config.depth_transition,
            future_weight: self.config.future.weight * ramp,
            robust_px: Some(self.config.future.robust_px).filter(|scale| scale.is_finite()),
            clip_norm: self.config.clip_norm,
            learning_rate: phase.learning_rate(index),
        };
        let model = self.state.model.clone();
        let (model, report) = step(model, &mut self.state.optimiser, batch, &options, &self.device);
        self.state.step += 1;
        let StepReport { loss, heatmap, depth, future, gradient_norm } = report;
        if !loss.is_finite() || self.explodes(heatmap + options.depth_weight * depth, index) {
            return Err(Error::Diverged { step: self.state.step, loss });
        }
        self.ema.update(&model);
        self.state.model = model;
        let steps = self.config.steps();
        let scores = self.state.step.is_multiple_of(self.config.validate_every) || self.state.step == steps;
        Ok(Some(Progress {
            step: self.state.step,
            steps,
            loss,
            heatmap,
            depth,
            future,
            gradient_norm,
            learning_rate: options.learning_rate,
            seconds: began.elapsed().as_secs_f64(),
            waited,
            validation: if scores { Some(self.validate()?) } else { None },
        }))
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

    /// Scores the averaged weights, and keeps them if none were better.
    fn validate(&mut self) -> Result<Validation> {
        let device = self.device.clone().without_autodiff();
        let card = card(self.config, &self.sampler, self.ema.model().config(), String::new());
        let localiser = Localiser::from_pen(self.ema.model().valid(), card, &device);
        let scored = match pollster::block_on(score(&localiser, &self.validation, self.config.validate_frames)) {
            Ok(scored) => scored,
            Err(error) => return Ok(Validation::Failed { failed: error.to_string() }),
        };
        let score = scored.forecast_px.filter(|score| score.is_finite());
        if self.best.as_ref().is_none_or(|best| best.is_beaten_by(score)) {
            // `valid` makes a copy of its own: a clone shares its norms' statistics, which go on moving.
            let (step, average) = (self.state.step, self.ema.model().valid());
            let best = Best { step, score, least_confidence: scored.least_confidence, average };
            best.save(&self.config.out.join(CHECKPOINTS))?;
            self.best = Some(best);
        }
        Ok(Validation::Score(scored))
    }

    /// Log first: a line too many is dropped on resume, a missing one could not be made up.
    fn checkpoint(&mut self) -> Result<()> {
        write_whole(&self.config.out.join(LOG), self.log.as_bytes())?;
        write_whole(&self.config.out.join(LOG_CSV), &table(&self.log)?)?;
        self.state.average = self.ema.model().valid();
        self.state.save(&self.config.out.join(CHECKPOINTS))
    }

    /// Writes the averaged weights that scored best (where none could be scored: the last) and their card.
    fn publish(&self) -> Result<PathBuf> {
        let pen = self.best.as_ref().map_or(self.ema.model(), |best| &best.average);
        let weights = model::halved(&model::save(pen)?)?;
        let mut card = card(self.config, &self.sampler, pen.config(), sha256_hex(&weights));
        card.confidence_threshold = self.best.as_ref().map(|best| best.least_confidence / 2.0);
        write_whole(&self.config.out.join(&card.weights), &weights)?;
        let path = self.config.out.join(format!("{}.json", card.name));
        card.write(&path)?;
        Ok(path)
    }
}

/// The fresh network with the backbone weights of the configuration, where it names some.
fn with_backbone(pen: Pen, config: &TrainConfig) -> Result<Pen> {
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
