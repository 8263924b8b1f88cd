//! `gravisight adapt`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use clap::Args;
use gravisight::internal::write_whole;
use gravisight::{AdaptOptions, Adapted, Adapter, Device, FitOptions, Localiser, Scene, TrackedVideo, VideoTracker};
use serde_json::json;

use super::print_line;
use super::track::{self, PlaceArguments, SceneOfTrack, SeedArgument};
use crate::device::DeviceChoice;
use crate::footage::Footage;
use crate::model;
use crate::progress::Progress;

/// Adapt a model to your ball from videos of its flights, without labels.
///
/// The videos are tracked, and the flights that physics explains become training data. Without --scene, frames with a ball probability of at
/// least 0.9 do. Every third flight is held out, and the new model must do better on those. Otherwise, nothing is written and the exit status is
/// 1.
#[derive(Args)]
pub struct Arguments {
    /// Videos (needs ffmpeg) or folders of frames.
    #[arg(required = true, value_name = "VIDEO|FOLDER")]
    input: Vec<PathBuf>,
    #[command(flatten)]
    place: PlaceArguments,
    /// Frames per second of all videos; required for folders [default: the video's own times].
    #[arg(long, value_name = "F")]
    fps: Option<f64>,
    /// Ball position in one frame, in px; frames count from 0. Needs a single video. Can be repeated.
    #[arg(long, value_name = "FRAME,X,Y", value_parser = track::seed)]
    seed_label: Vec<SeedArgument>,
    /// Model to start from; it must measure sizes and have a verifier and a motion network [default: the built-in `any`].
    #[arg(long, value_name = "M")]
    model: Option<PathBuf>,
    /// Path and name of the new model, without extension: NAME.json and NAME.safetensors are written, over existing files.
    #[arg(long, value_name = "NAME")]
    out: PathBuf,
    /// Rounds of tracking and training; the second tracks with the model of the first.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=2))]
    rounds: u32,
    /// Optimiser steps for each of the three networks, per round.
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = clap::value_parser!(u32).range(1..))]
    steps: u32,
    /// Random seed of the training.
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// Device to run on.
    #[arg(long, value_enum, default_value = "cpu")]
    device: DeviceChoice,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// A video and its place.
struct Video {
    footage: Footage,
    place: Option<SceneOfTrack>,
}

pub fn run(arguments: Arguments) -> Result<()> {
    let name = arguments.out.file_name().context("--out must end in the name of the new model")?;
    let name = name.to_str().context("--out must be valid Unicode")?.trim_end_matches(".json").to_string();
    ensure!(arguments.seed_label.is_empty() || arguments.input.len() == 1, "--seed-label needs a single video");
    // A folder that cannot be had is no surprise after minutes.
    let folder = arguments.out.parent().filter(|folder| !folder.as_os_str().is_empty());
    if let Some(folder) = folder {
        std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    }
    let device = arguments.device.open()?;
    let scene = track::scene(&arguments.place)?;
    let (card, weights) = model::read(arguments.model.as_deref())?;
    let options = AdaptOptions { steps: arguments.steps as usize, seed: arguments.seed, ..AdaptOptions::default() };
    let videos = arguments.input.iter().map(|input| video(input, &arguments, scene.as_ref()));
    let videos = videos.collect::<Result<Vec<Video>>>()?;
    let mut progress = Progress::new();
    let mut best: Option<Adapted> = None;
    for round in 1..=arguments.rounds {
        let mut adapter = Adapter::new(card.clone(), weights.clone(), &options, &device)?;
        let localiser = match &best {
            None => adapter.localiser(),
            Some(adapted) => Arc::new(Localiser::new(adapted.card.clone(), adapted.weights.clone(), &device)?),
        };
        progress.say(&format!("round {round} of {}:", arguments.rounds));
        let adapted = learn(&mut adapter, &localiser, &videos, &arguments, &name, &mut progress);
        let adapted = match (adapted, &best) {
            (Ok(adapted), _) => adapted,
            (Err(error), None) => return Err(error),
            // The first round's model stays.
            (Err(error), Some(_)) => {
                progress.say(&format!(
                    "round {round} gave no better model ({error:#}); the model of round {} is kept",
                    round - 1
                ));
                break;
            }
        };
        if best.is_some() {
            let before = pollster::block_on(adapter.score(&localiser))?;
            if !adapted.after.finds_better_than(&before) {
                progress.say(&format!("round {round} is no better; the model of round {} is kept", round - 1));
                break;
            }
        }
        best = Some(adapted);
    }
    progress.finish();
    let adapted = best.context("no round was made")?;
    write(&arguments, &adapted, &device)
}

fn video(input: &Path, arguments: &Arguments, scene: Option<&Scene>) -> Result<Video> {
    let footage = Footage::open(&[input.to_path_buf()], arguments.fps)?;
    let place = scene.map(|scene| track::place(&arguments.place, scene, &footage)).transpose();
    let place = place.with_context(|| footage.name())?;
    Ok(Video { footage, place })
}

/// Tracks the videos with `localiser`, and trains the adapter on what came out.
fn learn(
    adapter: &mut Adapter,
    localiser: &Arc<Localiser>,
    videos: &[Video],
    arguments: &Arguments,
    name: &str,
    progress: &mut Progress,
) -> Result<Adapted> {
    let seeds: Vec<(usize, [f64; 2])> = arguments.seed_label.iter().map(|seed| (seed.0, seed.1)).collect();
    for video in videos {
        let Video { footage, place } = video;
        let tracked = tracked(video, localiser.clone(), &seeds, arguments, progress).with_context(|| footage.name())?;
        let ball = place.as_ref().map(|place| (&place.camera, place.forecaster.scene().ball.radius));
        let flights = adapter.begin(&tracked, &seeds, ball)?;
        progress.say(&format!(
            "{}: usable flights: {}, with {} labelled frames",
            footage.name(),
            flights.flights,
            flights.frames
        ));
        if flights.flights == 0 {
            continue;
        }
        progress.restart();
        let times = footage.times();
        footage.each(0..times.len(), &mut |frame, picture| {
            pollster::block_on(adapter.add(picture, times[frame]))?;
            progress.set(frame as u64 + 1, times.len() as u64, "frames processed");
            Ok(())
        })?;
        pollster::block_on(adapter.end())?;
    }
    adapter.check()?;
    progress.restart();
    while let Some(step) = pollster::block_on(adapter.step())? {
        progress.set(step.step as u64, step.steps as u64, &format!("{}, loss {:.3}", step.network, step.loss));
    }
    Ok(pollster::block_on(adapter.finish(name))?)
}

fn tracked(
    Video { footage, place }: &Video,
    localiser: Arc<Localiser>,
    seeds: &[(usize, [f64; 2])],
    arguments: &Arguments,
    progress: &mut Progress,
) -> Result<TrackedVideo> {
    let mut tracker = VideoTracker::new(localiser, place.as_ref().map(|place| place.camera.clone()));
    if let Some(court) = place.as_ref().and_then(|place| place.court.as_deref()) {
        tracker = tracker.with_court(court)?;
    }
    progress.restart();
    let tracker = track::watched(footage, tracker, progress)?;
    let known = place.as_ref().map(|place| (&place.camera, place.forecaster.scene()));
    let mut tracked = tracker.track(seeds, known)?;
    if let Some(place) = place {
        let options = FitOptions {
            cameras: place.cameras.clone(),
            camera_assumed: arguments.place.assume_phone.is_some(),
            times_known: footage.times_known(),
            ..FitOptions::default()
        };
        tracked.fit(&place.forecaster, &place.camera, &options, |_, _| {})?;
    }
    Ok(tracked)
}

fn write(arguments: &Arguments, Adapted { card, weights, before, after }: &Adapted, device: &Device) -> Result<()> {
    // What is written works.
    Localiser::new(card.clone(), weights.clone(), device)?;
    let path = model::card_path(&arguments.out);
    write_whole(&path.with_file_name(&card.weights), weights)?;
    card.write(&path)?;
    if arguments.json {
        return Ok(print_line(json!({ "card": path.display().to_string(), "before": before, "after": after }))?);
    }
    let percent = |rate: Option<f64>| rate.map_or("unknown".into(), |rate| format!("{:.1} %", 100.0 * rate));
    print_line(format_args!(
        "{} written. In held-out flights, it reports the ball in {} of {} frames ({} before), with {} false positives ({} before). \
         Mean error of the radius: {} ({} before). Errors of the motion network: {} ({} before).",
        path.display(),
        after.found,
        after.balls,
        before.found,
        after.wrong,
        before.wrong,
        percent(after.size_error),
        percent(before.size_error),
        percent(after.motion_errors),
        percent(before.motion_errors)
    ))?;
    print_line(format_args!("Use it: gravisight track VIDEO --model {}", path.display()))?;
    Ok(())
}
