//! `gravisight stacks`: the motion network's training data.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::Args;
use gravisight::internal::{BallsOfFrame, CutStack, StackCutter, TrackPoint, write_whole};
use gravisight::{Localiser, Track};

use super::print_line;
use crate::footage::Footage;

/// Cut labelled footage into the stacks of frames on which a model's motion network is trained.
#[derive(Args)]
pub struct Arguments {
    /// A video (needs ffmpeg) or a folder of frames.
    #[arg(value_name = "VIDEO")]
    input: PathBuf,
    /// The ball in its frames (Frame,Visibility,X,Y, optionally Radius), one file for each ball; frames that lack a line in a file are left out.
    #[arg(value_name = "LABELS.CSV", required = true)]
    labels: Vec<PathBuf>,
    /// File to write (`*.stacks`).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Also cut about the balls that this model's detector proposes, as `track` does (path of its card, or `any`).
    #[arg(long, value_name = "M")]
    model: Option<PathBuf>,
    /// Frames per second [default: the video's].
    #[arg(long, value_name = "F")]
    fps: Option<f64>,
}

/// Runs the command.
///
/// # Errors
/// What is wrong with the input, in words.
pub fn run(arguments: Arguments) -> Result<()> {
    let Arguments { input, labels, out, model, fps } = arguments;
    let localiser = model.map(|model| crate::model::open(Some(&model), &gravisight::Device::flex())).transpose()?;
    let of_ball = |path: &PathBuf| {
        let points = Track::from_file(path)?.points.into_iter();
        Ok(points.map(|point| (point.frame as usize, point)).collect())
    };
    let labels = labels.iter().map(of_ball).collect::<Result<Vec<HashMap<usize, TrackPoint>>>>()?;
    let stacks = cut(&input, &labels, localiser.as_ref(), fps).with_context(|| input.display().to_string())?;
    write_whole(Path::new(&out), &stacks.concat())?;
    Ok(print_line(format_args!("{} stacks in {}", stacks.len(), out.display()))?)
}

/// The records of the stacks of a video, with the labels of each of its balls by frame.
fn cut(
    input: &Path,
    labels: &[HashMap<usize, TrackPoint>],
    localiser: Option<&Localiser>,
    fps: Option<f64>,
) -> Result<Vec<Vec<u8>>> {
    let footage = Footage::open(&[input.to_path_buf()], fps)?;
    let times = footage.times().to_vec();
    // A frame that lacks a line in a file is left out.
    let balls = |frame: usize| -> BallsOfFrame {
        let seen = labels.iter().map(|ball| ball.get(&frame)).collect::<Option<Vec<&TrackPoint>>>()?;
        Some(seen.into_iter().filter_map(|label| Some((label.image()?, label.radius))).collect())
    };
    let (mut cutter, mut records) = (StackCutter::default(), vec![]);
    let mut keep = |stacks: Vec<CutStack>| records.extend(stacks.into_iter().map(|stack| stack.record));
    footage.each(0..times.len(), &mut |frame, picture| {
        keep(pollster::block_on(cutter.add(picture, times[frame], localiser, &balls))?);
        Ok(())
    })?;
    keep(pollster::block_on(cutter.end(localiser, &balls))?);
    Ok(records)
}
