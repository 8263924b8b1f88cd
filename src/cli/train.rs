//! `gravisight train`.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use gravisight::train::run::{self, Progress};
use indicatif::{ProgressBar, ProgressStyle};

use super::device::DeviceChoice;

/// Steps between lines where there is no terminal to draw a bar on.
const LINE_EVERY: usize = 20;

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
    let bar = ProgressBar::new(0);
    bar.set_style(ProgressStyle::with_template("{bar:30} {pos}/{len} [{elapsed}<{eta}] {msg}")?);
    let mut observe = |progress: &Progress| show(&bar, progress);
    let card = match (arguments.config, arguments.resume) {
        (Some(config), _) => run::start(run::read_config(&config)?, &device, &mut observe)?,
        (None, Some(folder)) => run::resume(&folder, &device, &mut observe)?,
        (None, None) => unreachable!("clap requires one of them"),
    };
    bar.finish_and_clear();
    if arguments.json {
        println!("{}", serde_json::json!({ "card": card }));
    } else {
        println!("model written: {}", card.display());
        println!("score it on data it never saw: gravisight evaluate --data DIR --model {} --record", card.display());
    }
    Ok(())
}

fn show(bar: &ProgressBar, progress: &Progress) {
    let Progress { step, steps, loss, heatmap, depth, seconds, .. } = *progress;
    let losses = format!("loss {loss:.4} (heatmap {heatmap:.4}, depth {depth:.4} m)");
    bar.set_length(steps as u64);
    if bar.position() == 0 {
        // Steps done before a resume do not count towards the estimate.
        bar.reset_eta();
    }
    bar.set_position(step as u64);
    bar.set_message(losses.clone());
    let score = progress.validation.as_ref().map(|score| {
        let centimetres = |metres: Option<f64>| metres.unwrap_or(f64::NAN) * 100.0;
        format!(
            "step {step}: validation DtG {:.1} cm (median {:.1}), 2D error {:.2} px",
            centimetres(score.dtg.mean),
            centimetres(score.dtg.median),
            score.image_error_px.median.unwrap_or(f64::NAN),
        )
    });
    if !bar.is_hidden() {
        if let Some(score) = score {
            bar.println(score);
        }
        return;
    }
    if step % LINE_EVERY == 0 || step == steps {
        eprintln!("step {step}/{steps}: {losses}, {seconds:.2} s a step");
    }
    if let Some(score) = score {
        eprintln!("{score}");
    }
}
