//! A video with the ball marked in it.

use std::collections::VecDeque;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail, ensure};
use image::{Rgb, RgbImage};

use crate::footage::Footage;

/// Places of the ball in the frames before that are shown.
const TRAIL: usize = 15;
const MARK: Rgb<u8> = Rgb([255, 64, 0]);
/// Distance of the ring from the ball, px, and its strokes.
const APART: f64 = 4.0;
const STROKES: [f64; 3] = [0.0, 0.5, 1.0];

/// Writes the footage to `out` with a ring around each ball (centre and radius, px) and a trail behind it; whole, or not at all.
///
/// # Errors
/// Where ffmpeg is not installed or cannot write it.
pub fn write(out: &Path, footage: &Footage, balls: &[Option<[f64; 3]>]) -> Result<()> {
    let size = footage.size().context("the footage has no frames")?;
    let [first, .., last] = footage.times() else { bail!("--overlay: a film has more than one frame") };
    let fps = (footage.times().len() - 1) as f64 / (last - first);
    ensure!(fps.is_finite() && fps > 0.0, "--overlay: the footage has no frame rate; give --fps");
    let ending = out.extension().and_then(|ending| ending.to_str()).context("--overlay: OUT.MP4 needs an ending")?;
    let folder = out.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let unfinished = folder.join(format!(".{}.unfinished.{ending}", std::process::id()));
    let mut program = Command::new("ffmpeg")
        .args(["-v", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", &size.to_string().replace('×', "x")])
        .args(["-r", &fps.to_string(), "-i", "-", "-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p"])
        .arg(&unfinished)
        .stdin(Stdio::piped())
        .spawn()
        .context("--overlay is written by ffmpeg, which cannot be run; install it")?;
    let mut frames = program.stdin.take().context("ffmpeg takes no input")?;
    let mut trail: VecDeque<[f64; 3]> = VecDeque::new();
    let written = footage.each(0..balls.len(), &mut |number, mut rgb| {
        if let Some(ball) = balls[number] {
            trail.push_back(ball);
            STROKES.iter().for_each(|stroke| ring(&mut rgb, ball, ball[2] + APART + stroke));
        } else {
            trail.pop_front();
        }
        if trail.len() > TRAIL {
            trail.pop_front();
        }
        trail.iter().for_each(|&past| ring(&mut rgb, past, 1.5));
        frames.write_all(rgb.as_raw()).context("ffmpeg stopped")
    });
    drop(frames);
    let status = program.wait().context("ffmpeg")?;
    let done = written.and_then(|()| match status.success() {
        true => std::fs::rename(&unfinished, out).with_context(|| out.display().to_string()),
        false => bail!("{}: ffmpeg cannot write it", out.display()),
    });
    if done.is_err() {
        let _ = std::fs::remove_file(&unfinished);
    }
    done
}

fn ring(rgb: &mut RgbImage, [x, y, _]: [f64; 3], radius: f64) {
    let steps = (8.0 * radius).ceil().max(8.0) as usize;
    for step in 0..steps {
        let (sin, cos) = (std::f64::consts::TAU * step as f64 / steps as f64).sin_cos();
        let (x, y) = ((x + radius * cos).round(), (y + radius * sin).round());
        if x >= 0.0 && y >= 0.0 && x < f64::from(rgb.width()) && y < f64::from(rgb.height()) {
            rgb.put_pixel(x as u32, y as u32, MARK);
        }
    }
}
