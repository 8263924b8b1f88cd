//! `gravisight train`.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Result;
use clap::Args;
use gravisight::internal::{TrainProgress, Validation};
use gravisight::parts::Bins;
use gravisight::{Clips, Device, TrainConfig, TrainEvent, TrainSettings, score};

use super::print_line;
use crate::device::DeviceChoice;
use crate::model;
use crate::progress::Progress;
use crate::report::{Log, Report};

/// Depth bins of the report, as `evaluate`'s.
const BINS: usize = 3;

/// Train a model on labelled clips.
///
/// 2D labels and the scene's physics are enough: `--preset sd-s --train DIR --validation DIR --out DIR`. Checkpoints are written during
/// training; after an interruption, `--resume` continues from the last one.
#[derive(Args)]
#[command(group(clap::ArgGroup::new("what").required(true).multiple(true).args(["config", "preset", "resume"])))]
pub struct Arguments {
    /// Configuration of a new run (TOML; paths in it are relative to it).
    #[arg(long, value_name = "RUN.TOML")]
    config: Option<PathBuf>,
    /// Start from a preset; --config, the folder options and --set override it.
    #[arg(long, value_parser = clap::builder::PossibleValuesParser::new(TrainSettings::presets()))]
    preset: Option<String>,
    /// Clips folder to train on.
    #[arg(long, value_name = "DIR")]
    train: Option<PathBuf>,
    /// Clips folder for validation during training; never trained on.
    #[arg(long, value_name = "DIR")]
    validation: Option<PathBuf>,
    /// Folder of the run: checkpoints, log and the trained model.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Set any field of the configuration, as in seed=3 or augmentation.shift=8; can be repeated.
    #[arg(long = "set", value_name = "FIELD=VALUE")]
    fields: Vec<String>,
    /// Folder of a run to continue.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["config", "preset", "train", "validation", "out", "fields"])]
    resume: Option<PathBuf>,
    /// Device to train on.
    #[arg(long, value_enum, default_value = "cpu")]
    device: DeviceChoice,
    /// Print the configuration without paths and with all default values filled in. Do not train.
    #[arg(long, conflicts_with_all = ["resume", "json"])]
    print: bool,
    /// Skip the report on the validation clips, which scores each of their pictures once more.
    #[arg(long)]
    no_report: bool,
    /// Print one JSON object at the end instead of text: `{"card": PATH, "report": PATH or null}`.
    #[arg(long)]
    json: bool,
}

impl Arguments {
    /// The settings of a new run: preset, file, flags, each over the one before.
    fn settings(&self) -> Result<TrainSettings> {
        let mut settings =
            self.preset.as_deref().map_or_else(|| Ok(TrainSettings::default()), TrainSettings::preset)?;
        if let Some(file) = &self.config {
            settings.lay(TrainSettings::read(file)?);
        }
        for (name, folder) in [("train", &self.train), ("validation", &self.validation), ("out", &self.out)] {
            if let Some(folder) = folder {
                settings.set_path(name, folder);
            }
        }
        self.fields.iter().try_for_each(|text| settings.set(text))?;
        Ok(settings)
    }
}

pub fn run(arguments: Arguments) -> Result<()> {
    if arguments.print {
        return Ok(print_line(arguments.settings()?.whole()?.trim_end())?);
    }
    let device = arguments.device.open()?;
    let mut progress = Progress::new();
    let mut observe = |event: TrainEvent| match event {
        TrainEvent::Fitting { done, all } => progress.set(done as u64, all as u64, "clips fitted by physics"),
        TrainEvent::Prepared { clips, frames, left_out } => {
            progress.restart();
            progress.say(&format!("{frames} frames of {clips} clips to learn from"));
            if !left_out.is_empty() {
                progress.say(&format!("{} clips are left out because physics does not explain them:", left_out.len()));
            }
            left_out.iter().for_each(|it| progress.say(&format!("  {}: {}", it.clip, it.reason)));
        }
        TrainEvent::Step(now) => show(&mut progress, now),
    };
    let card = match &arguments.resume {
        Some(folder) => TrainConfig::resume(folder, &device, &mut observe)?,
        None => TrainConfig::start(arguments.settings()?.config()?, &device, &mut observe)?,
    };
    let report = if arguments.no_report { None } else { report(&card, &device, &mut progress)? };
    progress.finish();
    let path = card.display();
    if arguments.json {
        let report = report.map(|path| path.display().to_string());
        return Ok(print_line(serde_json::json!({ "card": path.to_string(), "report": report }))?);
    }
    print_line(format_args!("model written: {path}"))?;
    if let Some(report) = report {
        print_line(format_args!("report on the validation clips: {}", report.display()))?;
    }
    print_line(format_args!(
        "evaluate it on data it has never seen: gravisight evaluate --data DIR --model {path} --record"
    ))?;
    Ok(())
}

/// Writes the report of the run that made `card`, on its validation clips; none where those have no 3D truth.
fn report(card: &Path, device: &Device, progress: &mut Progress) -> Result<Option<PathBuf>> {
    let folder = card.parent().unwrap_or(Path::new("."));
    let TrainConfig { recipe, paths } = TrainConfig::saved_in(folder)?;
    // Random scenes are no clips.
    let Some(validation) = paths.validation.as_ref().filter(|_| !recipe.supervision.is_rendered()) else {
        return Ok(None);
    };
    let clips = Clips::read(validation)?;
    if !clips.clips.iter().flat_map(|clip| &clip.frames).any(|frame| frame.world.is_some() && frame.image.is_some()) {
        return Ok(None);
    }
    let localiser = model::open(Some(card), device)?;
    progress.restart();
    let mut observe = |done: usize, all: usize| progress.set(done as u64, all as u64, "pictures scored for the report");
    let began = Instant::now();
    let clock = || began.elapsed().as_secs_f64();
    let samples = pollster::block_on(score(&localiser, &clips, None, None, &clock, &mut observe))?;
    let path = folder.join("report.html");
    let (bins, log) = (Bins::over(&samples, BINS), Log::read(&paths.log())?);
    let report = Report { localiser: &localiser, clips: &clips, samples: &samples, bins, log: Some(&log) };
    crate::report::write(&path, &report)?;
    Ok(Some(path))
}

fn show(progress: &mut Progress, now: &TrainProgress) {
    let TrainProgress { step, steps, loss, heatmap, depth, future, seconds, .. } = *now;
    let mut losses = format!("loss {loss:.4} (heatmap {heatmap:.4}, depth {depth:.4} m");
    if future > 0.0 {
        losses += &format!(", future {future:.2} px");
    }
    for (law, factor) in &now.laws {
        losses += &format!(", {law} × {factor:.3}");
    }
    progress.set(step as u64, steps as u64, &format!("{losses}), {seconds:.2} s a step"));
    match &now.validation {
        Some(Validation::Score(score)) => {
            let pixels = |value: Option<f64>| value.map_or("none".into(), |value| format!("{value:.2} px"));
            let mut line = format!(
                "step {step}: validation: forecast error {}, 2D error {}",
                pixels(score.forecast_px),
                pixels(score.image_error_px.median)
            );
            if let (Some(mean), Some(median)) = (score.dtg.mean, score.dtg.median) {
                line += &format!("; DtG {:.1} cm (median {:.1})", 100.0 * mean, 100.0 * median);
            }
            progress.say(&line);
        }
        Some(Validation::Size(score)) => progress.say(&format!(
            "step {step}: validation: median radius error {:.2} % from 4 px up ({:.2} % over all sizes; gross errors {:.2} \
             %; {:.0} % and {:.0} % within 1 and 2 sigma), 2D error {:.2} px; ball confused with no ball in {:.1} %",
            100.0 * score.radius_error,
            100.0 * score.radius_error_of_all.median.unwrap_or(f64::NAN),
            100.0 * score.gross,
            100.0 * score.coverage[0],
            100.0 * score.coverage[1],
            score.image_error_px.median.unwrap_or(f64::NAN),
            100.0 * score.confused,
        )),
        Some(Validation::Failed { failed }) => progress.say(&format!("step {step}: validation failed: {failed}")),
        None => {}
    }
}
