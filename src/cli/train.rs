//! `gravisight train`.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use gravisight::train::run::{self, Validation};

use super::device::DeviceChoice;
use super::print_line;
use super::progress::Progress;

/// Train a model on labelled clips.
///
/// Checkpoints are written as it goes; after a stop at any point, `--resume` goes on from the last.
#[derive(Args)]
#[command(group(clap::ArgGroup::new("what").required(true).args(["config", "resume"])))]
pub struct Arguments {
    /// Configuration of a new run (TOML; paths in it are relative to it).
    #[arg(long, value_name = "RUN.TOML")]
    config: Option<PathBuf>,
    /// Folder of a run to go on with.
    #[arg(long, value_name = "DIR")]
    resume: Option<PathBuf>,
    /// Device to train on.
    #[arg(long, value_enum, default_value = "cpu")]
    device: DeviceChoice,
    /// Print one JSON object at the end instead of words: `{"card": PATH}`.
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: Arguments) -> Result<()> {
    let device = arguments.device.open()?;
    let mut progress = Progress::new();
    let mut observe = |now: &run::Progress| show(&mut progress, now);
    let card = match (arguments.config, arguments.resume) {
        (Some(config), _) => run::start(run::read_config(&config)?, &device, &mut observe)?,
        (None, Some(folder)) => run::resume(&folder, &device, &mut observe)?,
        (None, None) => unreachable!("clap requires one of them"),
    };
    progress.finish();
    let path = card.display();
    if arguments.json {
        return Ok(print_line(serde_json::json!({ "card": path.to_string() }))?);
    }
    print_line(format_args!("model written: {path}"))?;
    print_line(format_args!("score it on data it never saw: gravisight evaluate --data DIR --model {path} --record"))?;
    Ok(())
}

fn show(progress: &mut Progress, now: &run::Progress) {
    let run::Progress { step, steps, loss, heatmap, depth, seconds, .. } = *now;
    let losses = format!("loss {loss:.4} (heatmap {heatmap:.4}, depth {depth:.4} m), {seconds:.2} s a step");
    progress.set(step as u64, steps as u64, &losses);
    match &now.validation {
        Some(Validation::Score { dtg, image_error_px }) => {
            let centimetres = |metres: Option<f64>| metres.unwrap_or(f64::NAN) * 100.0;
            let (mean, median) = (centimetres(dtg.mean), centimetres(dtg.median));
            let pixels = image_error_px.median.unwrap_or(f64::NAN);
            progress.say(&format!(
                "step {step}: validation DtG {mean:.1} cm (median {median:.1}), 2D error {pixels:.2} px"
            ));
        }
        Some(Validation::Failed { failed }) => progress.say(&format!("step {step}: validation failed: {failed}")),
        None => {}
    }
}
