//! A model that learns a ball, a camera and a place from a video that the tracker has explained: no clicks.
//!
//! The frames of flights that are sure to be the ball's are labels; what else looks like a ball in them is none. Detector, verifier and
//! motion network go on from what they are; with the first two, renderings are mixed in. They are scored on flights that they did not
//! see.

mod labels;
mod networks;
mod patches;
mod resume;
mod score;
mod stacks;
mod videos;

use std::sync::Arc;

use burn::tensor::Device;
use serde::{Deserialize, Serialize};

use self::networks::Stage;
use self::patches::Patch;
use self::resume::{Given, SavedStages};
pub use self::score::AdaptScore;
use self::score::{Scored, calibrated, score};
pub use self::stacks::{BallsOfFrame, CutStack, StackCutter};
use self::videos::Video;
use crate::localise::Localiser;
use crate::model::{self, Card, sha256_hex};
use gravisight_geometry::error::{Error, Result};

/// Fewest flights: one to learn from and one to score on.
const FEWEST_FLIGHTS: usize = 2;
/// One flight of so many is held out.
const HELD_OUT_EVERY: usize = 3;
/// How an adaptation goes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(deny_unknown_fields, default, rename_all = "camelCase")]
pub struct AdaptOptions {
    /// Optimiser steps of each of the three networks. Default: 300.
    pub steps: usize,
    /// Learning rate at the start; it falls to zero. Default: 0.0003.
    pub learning_rate: f64,
    /// Seed of the batches. Default: 1.
    pub seed: u64,
}

impl Default for AdaptOptions {
    fn default() -> Self {
        Self { steps: 300, learning_rate: 3e-4, seed: 1 }
    }
}

impl AdaptOptions {
    fn check(&self) -> Result<()> {
        if self.steps == 0 {
            return Err(Error::value("options", "steps", "must be at least 1"));
        }
        if !(self.learning_rate > 0.0 && self.learning_rate.is_finite()) {
            let reason = format!("must be a positive number, not {}", self.learning_rate);
            return Err(Error::value("options", "learningRate", reason));
        }
        Ok(())
    }
}

/// What a video gives to learn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
pub struct AdaptFlights {
    /// Flights whose frames are labels.
    pub flights: usize,
    /// Those frames.
    pub frames: usize,
}

/// A step.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
pub struct AdaptStep {
    /// The network that made it: "detector", "verifier" or "motion network".
    pub network: &'static str,
    /// Steps done, of all networks.
    pub step: usize,
    /// Steps in all.
    pub steps: usize,
    /// Its loss.
    pub loss: f64,
}

/// The adapted model.
#[derive(Debug, Clone)]
pub struct Adapted {
    /// Its card.
    pub card: Card,
    /// Its weights, of all three networks.
    pub weights: Vec<u8>,
    /// What the model found in the held-out flights before.
    pub before: AdaptScore,
    /// What the adapted one finds there.
    pub after: AdaptScore,
}

/// Adapts a model to a ball. First [`Self::begin`], [`Self::add`] and [`Self::end`] for each tracked video, then [`Self::step`] until there is
/// none left, and [`Self::finish`].
///
/// ```no_run
/// # async fn adapted(card: gravisight::Card, weights: Vec<u8>, tracked: gravisight::TrackedVideo, pictures: Vec<gravisight::Picture>) -> gravisight::Result<()> {
/// use gravisight::{AdaptOptions, Adapter, Device};
///
/// let mut adapter = Adapter::new(card, weights, &AdaptOptions::default(), &Device::flex())?;
/// adapter.begin(&tracked, &[], None)?;
/// for (frame, picture) in pictures.into_iter().enumerate() {
///     adapter.add(picture, frame as f64 / 50.0).await?;
/// }
/// adapter.end().await?;
/// while let Some(step) = adapter.step().await? {
///     println!("{}: {} of {}: loss {:.3}", step.network, step.step, step.steps, step.loss);
/// }
/// let adapted = adapter.finish("my-ball").await?;
/// println!("found {} of {} before, {} now", adapted.before.found, adapted.before.balls, adapted.after.found);
/// # Ok(())
/// # }
/// ```
pub struct Adapter {
    card: Card,
    parts: [Vec<u8>; 3],
    localiser: Arc<Localiser>,
    options: AdaptOptions,
    device: Device,
    video: Option<Video>,
    patches: Vec<Patch>,
    /// To score on.
    scored: Vec<Scored>,
    /// Of each video the stacks and their flights.
    stacks: Vec<Vec<(CutStack, usize)>>,
    flights: usize,
    frames: usize,
    stages: Option<Vec<Stage>>,
    /// Of a resumed run, until its videos were given again.
    saved: Option<(Given, SavedStages)>,
}

impl Adapter {
    /// Starts from the model of `card` and `weights`, which reads sizes and has a verifier and a motion network, as `any` does.
    ///
    /// # Errors
    /// [`Error::Value`] for another model, and for options that cannot train; as [`Localiser::new`].
    pub fn new(card: Card, weights: Vec<u8>, options: &AdaptOptions, device: &Device) -> Result<Self> {
        if !card.architecture.depth.is_size() || card.verifier.is_none() || card.motion.is_none() {
            let name = &card.name;
            let reason = format!(
                "must read the ball's size and have a verifier and a motion network, as `any` does; `{name}` does not"
            );
            return Err(Error::value("adapt", "model", reason));
        }
        options.check()?;
        card.check_weights(&weights)?;
        Self::of_parts(card, model::parted(&weights)?, options, device)
    }

    fn of_parts(card: Card, parts: [Vec<u8>; 3], options: &AdaptOptions, device: &Device) -> Result<Self> {
        let localiser = Arc::new(localiser_of(&card, &parts, device)?);
        Ok(Self {
            card,
            parts,
            localiser,
            options: *options,
            device: device.clone(),
            video: None,
            patches: vec![],
            scored: vec![],
            stacks: vec![],
            flights: 0,
            frames: 0,
            stages: None,
            saved: None,
        })
    }

    /// The model before, to track with.
    pub fn localiser(&self) -> Arc<Localiser> {
        self.localiser.clone()
    }

    /// Refuses too few flights.
    ///
    /// # Errors
    /// [`Error::Data`].
    pub fn check(&self) -> Result<()> {
        if self.flights >= FEWEST_FLIGHTS {
            return Ok(());
        }
        let reason = format!(
            "{} usable flight{} found, but training needs at least {FEWEST_FLIGHTS}: one to train on and one to test on; film more flights. If you gave no \
             scene, give it and the camera, or mark the ball in one frame of each flight",
            self.flights,
            if self.flights == 1 { "" } else { "s" }
        );
        Err(Error::Data { what: "videos".into(), reason })
    }

    fn is_held_out(&self, flight: usize) -> bool {
        is_held_out(flight, self.flights)
    }

    /// One step; none after the last.
    ///
    /// # Errors
    /// As [`Self::check`]; [`Error::Value`] while frames of a video are missing; [`Error::Diverged`]; [`Error::Device`].
    pub async fn step(&mut self) -> Result<Option<AdaptStep>> {
        if self.stages.is_none() {
            self.check_whole()?;
            self.check()?;
            let patches = self.patches.iter().filter(|patch| !self.is_held_out(patch.flight)).cloned().collect();
            let records = |stacks: &Vec<(CutStack, usize)>| -> Vec<Vec<u8>> {
                let taught = stacks.iter().filter(|(_, flight)| !self.is_held_out(*flight));
                taught.map(|(stack, _)| stack.record.clone()).collect()
            };
            let stacks = self.stacks.iter().map(records).collect();
            let saved = self.saved_stages()?;
            let stages =
                networks::stages(&self.card, &self.parts, patches, stacks, &self.options, &self.device, saved)?;
            self.stages = Some(stages);
        }
        let Some(stages) = &mut self.stages else { return Ok(None) };
        let steps = stages.len() * self.options.steps;
        for (number, stage) in stages.iter_mut().enumerate() {
            if let Some((step, loss)) = stage.step().await? {
                let step = number * self.options.steps + step;
                return Ok(Some(AdaptStep { network: stage.name(), step, steps, loss }));
            }
        }
        Ok(None)
    }

    /// Steps done, and steps in all; of a run that has no motion to learn from it is a third less.
    pub fn progress(&self) -> [usize; 2] {
        let (done, networks) = match (&self.stages, &self.saved) {
            (Some(stages), _) => (stages.iter().map(Stage::steps).sum(), stages.len()),
            (None, Some((_, saved))) => (saved.steps(), saved.count()),
            (None, None) => (0, self.parts.len()),
        };
        [done, networks * self.options.steps]
    }

    /// What another model finds in the held-out flights.
    ///
    /// # Errors
    /// As [`Localiser::localise`].
    pub async fn score(&self, localiser: &Localiser) -> Result<AdaptScore> {
        let frames: Vec<&Scored> = self.scored.iter().filter(|frame| self.is_held_out(frame.flight)).collect();
        let stacks = self.stacks.iter().flatten().filter(|(_, flight)| self.is_held_out(*flight));
        score(localiser, &frames, &stacks.map(|(stack, _)| stack).collect::<Vec<_>>()).await
    }

    /// The adapted model, called `name`. Its networks are those that did better in the held-out flights than they did before.
    ///
    /// # Errors
    /// [`Error::Data`] where none did; [`Error::Value`] while steps are left, and for a name that no file can have; [`Error::WeightsFile`], [`Error::Device`].
    pub async fn finish(&self, name: &str) -> Result<Adapted> {
        if name.is_empty() || name.contains(['/', '\\', '\0']) {
            return Err(Error::value("adapt", "name", format!("must be a file name without a folder, not {name:?}")));
        }
        let [step, steps] = self.progress();
        let Some(stages) = self.stages.as_ref().filter(|_| step == steps) else {
            let reason = format!("has completed only {step} of {steps} steps; call `step` until no steps are left");
            return Err(Error::value("adapt", "model", reason));
        };
        let before = self.score(&self.localiser).await?;
        let mut new = self.parts.clone();
        for stage in stages {
            new[stage.part()] = stage.weights().await?;
        }
        let all = self.score(&localiser_of(&self.card, &new, &self.device)?).await?;
        // Each network that did not get better stays as it was.
        if !all.finds_better_than(&before) {
            new[..2].clone_from_slice(&self.parts[..2]);
        }
        if !all.moves_better_than(&before) {
            new[2].clone_from(&self.parts[2]);
        }
        if new == self.parts {
            let reason = format!(
                "no network improved without more false positives; in {} held-out frames (before, after): ball ranked first in {}, {}; reported \
                 in {}, {}; false positives {}, {}; mean error of the radius {}, {}. Film more flights, or mark the ball in one frame of each \
                 flight",
                before.balls,
                before.first,
                all.first,
                before.found,
                all.found,
                before.wrong,
                all.wrong,
                percent(before.size_error),
                percent(all.size_error)
            );
            return Err(Error::Data { what: "videos".into(), reason });
        }
        let localiser = localiser_of(&self.card, &new, &self.device)?;
        let mut after = self.score(&localiser).await?;
        let mut calibration = self.card.calibration;
        let frames: Vec<&Scored> = self.scored.iter().filter(|frame| self.is_held_out(frame.flight)).collect();
        let fitted = Some(calibrated(&localiser, calibration.unwrap_or_default(), &frames).await?);
        let refitted = Card { calibration: fitted, ..self.card.clone() };
        let with_it = self.score(&localiser_of(&refitted, &new, &self.device)?).await?;
        if with_it.wrong <= after.wrong.max(before.wrong) && with_it.found >= after.found {
            (calibration, after) = (fitted, with_it);
        }
        let weights = model::joined([&new[0], &new[1], &new[2]])?;
        let card = Card {
            name: name.into(),
            weights: format!("{name}.safetensors"),
            sha256: sha256_hex(&weights),
            calibration,
            training_data: format!(
                "{}; then {} labelled frames of {} flights in the user's videos, including held-out ones",
                self.card.training_data, self.frames, self.flights
            ),
            description: format!(
                "{} Adapted to one ball from its flights: {} steps per network, seed {}.",
                self.card.description, self.options.steps, self.options.seed
            ),
            metrics: serde_json::json!({ "adapted": { "before": before.metrics(), "after": after.metrics() } }),
            ..self.card.clone()
        };
        Ok(Adapted { card, weights, before, after })
    }
}

fn percent(fraction: Option<f64>) -> String {
    fraction.map_or("unknown".into(), |fraction| format!("{:.1} %", 100.0 * fraction))
}

/// Whether a flight of so many is held out.
fn is_held_out(flight: usize, flights: usize) -> bool {
    match flights {
        // The second of two: the first taught the tracker's background nothing yet.
        0..=2 => flight == 1,
        _ => flight % HELD_OUT_EVERY == HELD_OUT_EVERY - 1,
    }
}

/// The model of `card` with other weights.
fn localiser_of(card: &Card, parts: &[Vec<u8>; 3], device: &Device) -> Result<Localiser> {
    let weights = model::joined([&parts[0], &parts[1], &parts[2]])?;
    Localiser::new(Card { sha256: sha256_hex(&weights), ..card.clone() }, weights, device)
}
