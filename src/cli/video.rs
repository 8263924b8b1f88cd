//! Frames of a video, by the `ffmpeg` that is installed.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};

/// Frames a second of a video's first picture stream, as ffprobe says it: a fraction, and its value.
pub fn rate(video: &Path) -> Result<(String, f64)> {
    let entries = ["-select_streams", "v:0", "-show_entries", "stream=avg_frame_rate", "-of", "csv=p=0"];
    let said = run(Command::new("ffprobe").args(["-v", "error"]).args(entries).arg(video), "ffprobe", video)?;
    let fraction = said.lines().next().unwrap_or_default().trim().trim_end_matches(',').to_string();
    let rate = match fraction.split_once('/') {
        Some((frames, seconds)) => frames.parse::<f64>().ok().zip(seconds.parse::<f64>().ok()).map(|(n, s)| n / s),
        None => fraction.parse().ok(),
    };
    match rate.filter(|rate| rate.is_finite() && *rate > 0.0) {
        Some(rate) => Ok((fraction, rate)),
        None => bail!("{}: ffprobe finds no frame rate (`{fraction}`); is it a video?", video.display()),
    }
}

/// Writes the frames of `video` into `folder` as PNG, evenly spaced at its `rate`, and returns them in order.
pub fn frames(video: &Path, rate: &str, folder: &Path) -> Result<Vec<PathBuf>> {
    let mut command = Command::new("ffmpeg");
    command.args(["-v", "error", "-nostdin", "-i"]).arg(video).args(["-map", "0:v:0", "-r", rate]);
    run(command.arg(folder.join("%06d.png")), "ffmpeg", video)?;
    let entries = std::fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    let mut frames = entries.map(|entry| entry.map(|entry| entry.path())).collect::<std::io::Result<Vec<_>>>()?;
    frames.sort();
    ensure!(!frames.is_empty(), "{}: ffmpeg found no frames in it", video.display());
    Ok(frames)
}

/// What a program prints; an error with its message where it fails.
fn run(command: &mut Command, program: &str, video: &Path) -> Result<String> {
    let output = match command.output() {
        Err(error) if error.kind() == ErrorKind::NotFound => bail!(
            "{}: a video needs `{program}`, which is not installed; install ffmpeg, or give a folder of the video's frames",
            video.display()
        ),
        other => other.with_context(|| program.to_string())?,
    };
    let message = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "{}: {program} failed: {}", video.display(), message.trim());
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}
