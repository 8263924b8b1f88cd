//! One file a subcommand.

mod adapt;
mod batch;
mod calibrate;
mod camera;
mod courts;
mod evaluate;
mod film;
mod fit;
mod flights;
mod forecast;
mod import;
mod label;
mod localise;
#[cfg(test)]
mod options;
mod saliency;
mod scene;
mod sheet;
mod stacks;
mod synth;
mod track;
mod train;

use std::io::{self, Write as _};
use std::process::ExitCode;

use anyhow::Result;
use clap::{Parser, Subcommand};

/// A ball's 3D position from a single picture of one calibrated camera.
#[derive(Parser)]
#[command(name = "gravisight", version, about)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Localise(localise::Arguments),
    Track(track::Arguments),
    Calibrate(calibrate::Arguments),
    #[command(subcommand)]
    Camera(camera::Subcommands),
    Scene(scene::Arguments),
    Label(label::Arguments),
    Import(import::Arguments),
    Synth(synth::Arguments),
    Train(train::Arguments),
    Adapt(adapt::Arguments),
    Evaluate(evaluate::Arguments),
    Saliency(saliency::Arguments),
    Fit(fit::Arguments),
    Forecast(forecast::Arguments),
    Batch(batch::Arguments),
    #[command(hide = true)]
    Stacks(stacks::Arguments),
}

impl Arguments {
    /// Does what was asked for; the exit status says whether all of it came out.
    pub fn run(self) -> Result<ExitCode> {
        let done = match self.command {
            Command::Fit(arguments) => return fit::run(arguments),
            Command::Track(arguments) => return track::run(arguments),
            Command::Batch(arguments) => return batch::run(&arguments),
            Command::Scene(arguments) => scene::run(arguments),
            Command::Localise(arguments) => localise::run(arguments),
            Command::Evaluate(arguments) => evaluate::run(arguments),
            Command::Saliency(arguments) => saliency::run(arguments),
            Command::Train(arguments) => train::run(arguments),
            Command::Adapt(arguments) => adapt::run(arguments),
            Command::Forecast(arguments) => forecast::run(arguments),
            Command::Calibrate(arguments) => calibrate::run(arguments),
            Command::Camera(command) => camera::run(command),
            Command::Synth(arguments) => synth::run(arguments),
            Command::Import(arguments) => import::run(arguments),
            Command::Label(arguments) => label::run(arguments),
            Command::Stacks(arguments) => stacks::run(arguments),
        };
        done.map(|()| ExitCode::SUCCESS)
    }
}

/// What is said of labels where trackers and tools put a ball that is not visible.
fn nowhere(frames: usize) -> String {
    format!("{frames} frames have (0, 0) or (−1, −1): treated as not visible")
}

/// Prints a line of results; an error, not a panic, where nobody reads.
fn print_line(line: impl std::fmt::Display) -> io::Result<()> {
    writeln!(io::stdout(), "{line}")
}
