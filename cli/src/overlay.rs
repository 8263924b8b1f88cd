//! A video with the ball marked in it.

use std::collections::VecDeque;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use image::{Rgb, RgbImage};

use crate::footage::Footage;
use crate::video::Encoder;

/// Places of the ball in the frames before that are shown.
const TRAIL: usize = 15;
/// x264's.
const QUALITY: u8 = 20;
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
    let [first, .., last] = footage.times() else { bail!("--overlay needs at least two frames") };
    let fps = (footage.times().len() - 1) as f64 / (last - first);
    ensure!(fps.is_finite() && fps > 0.0, "--overlay: the footage has no frame rate; give --fps");
    let mut encoder = Encoder::new(out, size, fps, QUALITY)?;
    let mut trail: VecDeque<[f64; 3]> = VecDeque::new();
    footage.each(0..balls.len(), &mut |number, picture| {
        let mut rgb = picture.into_rgb();
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
        Ok(encoder.write(&rgb)?)
    })?;
    Ok(encoder.finish()?)
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
