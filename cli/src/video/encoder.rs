//! Videos that are written, by ffmpeg.

use std::ffi::OsStr;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};

use gravisight::internal::Compression;
use gravisight::{Error, Result, Size};
use image::RgbImage;

use super::{cannot_run, file_url};

/// A broadcast's highest rate over its mean.
const MOST_RATE: f64 = 2.0;

/// A video in the making: it appears whole, or not at all.
pub struct Encoder {
    program: Child,
    frames: Option<ChildStdin>,
    unfinished: PathBuf,
    out: PathBuf,
}

impl Encoder {
    /// Of frames of `size`, `fps` a second; `quality` is x264's (0 best, 51 worst), where there is x264.
    ///
    /// # Errors
    /// [`Error::Data`] where ffmpeg is not installed.
    pub fn new(out: &Path, size: Size, fps: f64, quality: u8) -> Result<Self> {
        Self::compressed(out, size, fps, Compression::Quality(quality))
    }

    /// The same, compressed in one of several ways.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn compressed(out: &Path, size: Size, fps: f64, compression: Compression) -> Result<Self> {
        let ending = out.extension().and_then(OsStr::to_str).unwrap_or("mp4");
        let folder = out.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let stem = out.file_stem().unwrap_or_default().to_string_lossy();
        let unfinished = folder.join(format!(".{stem}.{}.unfinished.{ending}", std::process::id()));
        let mut command = Command::new("ffmpeg");
        command.args(["-v", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s"]);
        command.arg(format!("{}x{}", size.width, size.height)).args(["-r", &fps.to_string(), "-i", "-"]);
        // x264 wants even sides.
        command.args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p"]);
        match compression {
            Compression::Quality(quality) => command.args(["-crf", &quality.to_string()]),
            Compression::Rate { bits, group } => {
                let [rate, most] = [1.0, MOST_RATE].map(|times| format!("{:.0}", times * bits));
                command.args(["-b:v", &rate, "-maxrate", &most, "-bufsize", &most, "-g", &group.to_string()])
            }
        };
        command.arg(file_url(&unfinished)?).stdin(Stdio::piped());
        let mut program = command.spawn().map_err(|error| cannot_run("ffmpeg", &error, out))?;
        let frames = program.stdin.take();
        Ok(Self { program, frames, unfinished, out: out.to_path_buf() })
    }

    /// Adds a frame.
    ///
    /// # Errors
    /// [`Error::Data`] where ffmpeg has stopped.
    pub fn write(&mut self, rgb: &RgbImage) -> Result<()> {
        let written = self.frames.as_mut().map(|frames| frames.write_all(rgb.as_raw()));
        written.and_then(std::result::Result::ok).ok_or_else(|| self.refuse())
    }

    /// Writes what is left.
    ///
    /// # Errors
    /// [`Error::Data`] where ffmpeg cannot write it; [`Error::Io`].
    pub fn finish(mut self) -> Result<()> {
        self.frames = None;
        match self.program.wait() {
            Ok(status) if status.success() => {
                std::fs::rename(&self.unfinished, &self.out).map_err(Error::io(&self.out))
            }
            _ => Err(self.refuse()),
        }
    }

    fn refuse(&self) -> Error {
        Error::Data { what: self.out.display().to_string(), reason: "`ffmpeg` cannot write it".into() }
    }
}

impl Drop for Encoder {
    fn drop(&mut self) {
        self.frames = None;
        let _ = self.program.wait();
        let _ = std::fs::remove_file(&self.unfinished);
    }
}
