//! The `gravisight` command: [`main`] is all of it. [`cameras`], [`import`], [`report`] and [`footage`] are public for its tests, benches and fuzzing.
#![warn(missing_docs, clippy::unwrap_used)]
#![cfg_attr(test, allow(clippy::unwrap_used))]
#![deny(unsafe_code)]

mod ball;
pub mod cameras;
mod choice;
mod commands;
mod court;
mod device;
mod draw;
mod export;
pub mod footage;
pub mod import;
mod model;
mod overlay;
mod progress;
pub mod report;
mod video;

use std::io;
use std::process::ExitCode;

use clap::Parser as _;

/// Does what the command line asks for.
pub fn main() -> ExitCode {
    match commands::Arguments::parse().run() {
        Ok(status) => status,
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
