//! `gravisight evaluate`.

use std::path::{Path, PathBuf};
use std::time::Instant;

use super::print_line;
use crate::ball::BallArguments;
use crate::device::DeviceChoice;
use crate::model;
use crate::progress::Progress;
use crate::report::{self, Log, Report};
use anyhow::{Result, bail, ensure};
use clap::Args;
use gravisight::parts::{Bins, CalibrationGroup, ConfidenceKind, DepthMapScore, Statistic, score_depth_maps};
use gravisight::{Card, Clips, Metrics, score};

/// Most pictures whose depth map is compared with a depth image.
const DEPTH_MAPS: usize = 90;

/// Measure a model's errors on labelled clips with 3D truth.
///
/// The ball is taken from each clip's scene unless --ball-radius or --ball is given.
#[derive(Args)]
pub struct Arguments {
    /// Clips folder (with clips.jsonl).
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// Model: path of its card, its weights or both without extension, or the built-in `any` or `sd-l` [default: any].
    #[arg(long, value_name = "M")]
    model: Option<PathBuf>,
    /// Device to run on.
    #[arg(long, value_enum, default_value = "auto")]
    device: DeviceChoice,
    #[command(flatten)]
    ball: BallArguments,
    /// Score only the clips whose id contains this, as in env2/cam7.
    #[arg(long, value_name = "TEXT")]
    only: Option<String>,
    /// Depth bins of the binned DtG.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u16).range(1..=1000))]
    bins: u16,
    /// Lower edge of the first bin, m [default: the nearest ball].
    #[arg(long, value_name = "A")]
    z_min: Option<f64>,
    /// Upper edge of the last bin, m [default: the farthest ball].
    #[arg(long, value_name = "B")]
    z_max: Option<f64>,
    /// Write a report: one HTML file with charts, tables and pictures, without external files.
    #[arg(long, value_name = "OUT.HTML")]
    report: Option<PathBuf>,
    /// The log.jsonl of the run that trained the model; its curves are added to the report.
    #[arg(long, value_name = "LOG.JSONL", requires = "report")]
    log: Option<PathBuf>,
    /// Write the metrics into the model's card.
    #[arg(long, requires = "model")]
    record: bool,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: Arguments) -> Result<()> {
    let given = [arguments.z_min, arguments.z_max].map(|edge| edge.is_none_or(f64::is_finite));
    let ordered = arguments.z_min.zip(arguments.z_max).is_none_or(|(low, high)| low < high);
    if given != [true; 2] || !ordered {
        bail!("--z-min and --z-max must be finite numbers, and --z-min below --z-max");
    }
    let ball_radius = arguments.ball.radius()?;
    let log = arguments.log.as_deref().map(Log::read).transpose()?;
    let localiser = model::open(arguments.model.as_deref(), &arguments.device.open()?)?;
    let mut clips = Clips::read(&arguments.data)?;
    if let Some(part) = &arguments.only {
        clips.clips.retain(|clip| clip.id.contains(part));
        ensure!(!clips.clips.is_empty(), "--only {part}: no clip in {} has that in its id", arguments.data.display());
    }
    // The first picture would pay for memory and kernels, and the speed would tell.
    pollster::block_on(localiser.warm_up())?;
    let mut progress = Progress::new();
    let mut observe = |done: usize, all: usize| progress.set(done as u64, all as u64, "pictures");
    let began = Instant::now();
    let clock = || began.elapsed().as_secs_f64();
    let samples = pollster::block_on(score(&localiser, &clips, None, ball_radius, &clock, &mut observe))?;
    progress.finish();
    let Bins { count, z_min, z_max } = Bins::over(&samples, arguments.bins.into());
    let bins = Bins { count, z_min: arguments.z_min.unwrap_or(z_min), z_max: arguments.z_max.unwrap_or(z_max) };
    if bins.z_min > bins.z_max {
        bail!("no ball lies between --z-min {} and --z-max {} (m)", bins.z_min, bins.z_max);
    }
    let metrics = Metrics::of(&samples, bins);
    let depth_map = pollster::block_on(score_depth_maps(&localiser, &clips, DEPTH_MAPS))?;
    if let Some(path) = &arguments.report {
        let log = log.as_ref();
        report::write(path, &Report { localiser: &localiser, clips: &clips, samples: &samples, bins, log })?;
    }
    if let Some(model) = arguments.model.filter(|_| arguments.record) {
        record(&model::card_path(&model), &metrics)?;
    }
    if arguments.json {
        let mut object = serde_json::to_value(&metrics)?;
        if let Some(depth_map) = depth_map {
            object["depth_map"] = serde_json::to_value(depth_map)?;
        }
        return Ok(print_line(object)?);
    }
    print(&metrics, bins)?;
    match depth_map {
        Some(DepthMapScore { pictures, correlation, error_relative, error_of_constant }) => {
            let percent = |error: Statistic| 100.0 * error.median.unwrap_or_default();
            Ok(print_line(format_args!(
                "depth map of {pictures} pictures, away from the ball: correlation with the scene's depth {correlation:.2}; median error \
                 {:.0} %, against {:.0} % for a constant depth",
                percent(error_relative),
                percent(error_of_constant)
            ))?)
        }
        None => Ok(()),
    }
}

/// Writes the metrics into the card at `path`, without the speed, which is this machine's.
fn record(path: &Path, metrics: &Metrics) -> Result<()> {
    let mut card = Card::from_file(path)?;
    card.metrics = serde_json::to_value(metrics)?;
    if let Some(fields) = card.metrics.as_object_mut() {
        fields.remove("seconds_per_picture");
    }
    Ok(card.write(path)?)
}

fn print(metrics: &Metrics, bins: Bins) -> Result<()> {
    let row = |name: &str, statistic: &Statistic, factor: f64, unit: &str| match statistic {
        Statistic { mean: Some(mean), std: Some(std), median: Some(median), n } => {
            let [mean, std, median] = [mean, std, median].map(|value| value * factor);
            print_line(format_args!(
                "{name:<22} {mean:>8.2} ± {std:>6.2} {unit:<2}  median {median:>7.2} {unit:<2}  n {n}"
            ))
        }
        _ => print_line(format_args!("{name:<22} no pictures")),
    };
    row("DtG", &metrics.dtg, 100.0, "cm")?;
    row("DtG, ball visible", &metrics.dtg_visible, 100.0, "cm")?;
    row("DtG / distance", &metrics.dtg_relative, 100.0, "%")?;
    row("2D error", &metrics.image_error_px, 1.0, "px")?;
    if let (Some(error), Some(coverage), Some(gross)) =
        (&metrics.depth_error_relative, &metrics.depth_coverage, metrics.gross)
    {
        row("depth error / depth", error, 100.0, "%")?;
        let fraction = |times: u8| 100.0 * coverage.get(&times).copied().unwrap_or(0.0);
        print_line(format_args!(
            "depth within 1 / 2 sigma {:.0} / {:.0} %, error above 30 %: {:.2} % of pictures",
            fraction(1),
            fraction(2),
            100.0 * gross
        ))?;
    }
    if let Some(kind) = metrics.confidence_kind {
        let all = metrics.dtg.n as f64;
        let mean = |of: &dyn Fn(&CalibrationGroup) -> f64| -> f64 {
            metrics.calibration.iter().map(|group| group.dtg.n as f64 * of(group)).sum::<f64>() / all
        };
        let said = mean(&|group| group.confidence.mean.unwrap_or_default());
        let right = 100.0 * mean(&|group| group.near);
        print_line(match kind {
            ConfidenceKind::BallProbability => {
                format!(
                    "confidence: the probability that the detection is the ball; mean {said:.3}, correct in {right:.1} %"
                )
            }
            ConfidenceKind::HeatmapMass => format!(
                "confidence: the fraction of the heatmap within 12 px (of the network's input); mean {said:.3}, and the ball is within \
                 them in {right:.1} %"
            ),
        })?;
    }
    for (edges, statistic) in bins.edges().windows(2).zip(&metrics.dtg_binned) {
        row(&format!("DtG at {:.2}–{:.2} m", edges[0], edges[1]), statistic, 100.0, "cm")?;
    }
    for (name, statistic) in metrics.per_environment.iter().chain(&metrics.per_camera) {
        row(&format!("DtG {name}"), statistic, 100.0, "cm")?;
    }
    let (network, with_decoding) = (&metrics.seconds_per_picture.network, &metrics.seconds_per_picture.with_decoding);
    row("network", network, 1000.0, "ms")?;
    row("with decoding", with_decoding, 1000.0, "ms")?;
    Ok(())
}
