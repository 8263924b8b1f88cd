//! The `gravisight` command.
#![warn(clippy::unwrap_used)]

mod calibrate;
mod device;
mod evaluate;
mod fit;
mod forecast;
mod import;
mod label;
mod localise;
mod model;
mod progress;
mod saliency;
mod synth;
mod train;

use std::io::{self, Write as _};
use std::process::ExitCode;

use clap::{Parser, Subcommand};

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// A ball's 3D position from a single picture of one calibrated camera.
#[derive(Parser)]
#[command(version, about)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Localise(localise::Arguments),
    Calibrate(calibrate::Arguments),
    Label(label::Arguments),
    Import(import::Arguments),
    Synth(synth::Arguments),
    Train(train::Arguments),
    Evaluate(evaluate::Arguments),
    Saliency(saliency::Arguments),
    Fit(fit::Arguments),
    Forecast(forecast::Arguments),
}

fn main() -> ExitCode {
    let result = match Arguments::parse().command {
        Command::Localise(arguments) => localise::run(arguments),
        Command::Evaluate(arguments) => evaluate::run(arguments),
        Command::Saliency(arguments) => saliency::run(arguments),
        Command::Train(arguments) => train::run(arguments),
        Command::Forecast(arguments) => forecast::run(arguments),
        Command::Fit(arguments) => fit::run(arguments),
        Command::Calibrate(arguments) => calibrate::run(arguments),
        Command::Synth(arguments) => synth::run(arguments),
        Command::Import(arguments) => import::run(arguments),
        Command::Label(arguments) => label::run(arguments),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        // Whoever reads our output has seen enough.
        Err(error) if error.downcast_ref::<io::Error>().is_some_and(|e| e.kind() == io::ErrorKind::BrokenPipe) => {
            ExitCode::SUCCESS
        }
        Err(error) => {
            // One line, whatever the parser's message looked like.
            let text = format!("{error:#}");
            eprintln!("gravisight: {}", text.split_whitespace().collect::<Vec<_>>().join(" "));
            ExitCode::FAILURE
        }
    }
}

/// Prints a line of results; an error, not a panic, where nobody reads.
fn print_line(line: impl std::fmt::Display) -> io::Result<()> {
    writeln!(io::stdout(), "{line}")
}
