//! `gravisight synth --sheet`: what a set looks like, in one picture.

use std::path::Path;

use anyhow::Result;
use gravisight::{Camera, Clip, Clips};
use image::{Rgb, RgbImage, imageops};
use nalgebra::{Point3, Vector3};

use crate::draw;
use gravisight::internal::write_whole;

/// Pictures of a clip: one with the world's axes and the ball's path, and the others without, from the first to the last frame.
const COLUMNS: u32 = 6;
/// Between the pictures, px.
const GAP: u32 = 4;
/// Of the axes x, y and z.
const AXES: [Rgb<u8>; 3] = [Rgb([230, 25, 25]), Rgb([20, 170, 20]), Rgb([40, 80, 255])];
/// Of the path.
const PATH: Rgb<u8> = Rgb([255, 230, 0]);

/// Writes the sheet of `clips`, a row each: first the world's axes at its origin and the 2D labels of all frames, then five frames
/// from the first to the last.
pub fn write(path: &Path, all: &Clips, clips: &[&Clip]) -> Result<()> {
    let size = |side: fn(&Camera) -> u32| clips.iter().map(|clip| side(&clip.camera)).max().unwrap_or(0);
    let (width, height) = (size(|camera| camera.size().width), size(|camera| camera.size().height));
    let rows = clips.len() as u32;
    let mut sheet = RgbImage::from_pixel(
        COLUMNS * (width + GAP) - GAP,
        (rows * (height + GAP)).saturating_sub(GAP).max(1),
        Rgb([255; 3]),
    );
    for (row, clip) in (0..).zip(clips) {
        for column in 0..COLUMNS {
            let last = clip.frames.len() - 1;
            let frame = column.saturating_sub(1) as usize * last / (COLUMNS - 2) as usize;
            let mut picture = all.picture(clip, &clip.frames[frame])?.rgb().clone();
            if column == 0 {
                explain(&mut picture, clip);
            }
            let place = [column * (width + GAP), row * (height + GAP)].map(i64::from);
            imageops::replace(&mut sheet, &picture, place[0], place[1]);
        }
    }
    Ok(write_whole(path, &draw::png(&sheet)?)?)
}

/// Axes and path over a clip's picture.
fn explain(picture: &mut RgbImage, clip: &Clip) {
    let origin = Point3::origin();
    let length = axis_length(clip.camera.camera_from_world(&origin).coords.norm());
    for (axis, colour) in AXES.into_iter().enumerate() {
        draw::segment(picture, &clip.camera, [origin, origin + Vector3::ith(axis, length)], colour);
    }
    for [x, y] in clip.frames.iter().filter_map(|frame| frame.image) {
        let near = [0, 1].map(|step| (x.floor() as i64 + step, y.floor() as i64 + step));
        for (x, y) in [(near[0].0, near[0].1), (near[1].0, near[0].1), (near[0].0, near[1].1), (near[1].0, near[1].1)] {
            let at = (u32::try_from(x), u32::try_from(y));
            if let (Ok(x), Ok(y)) = at
                && let Some(pixel) = picture.get_pixel_mut_checked(x, y)
            {
                *pixel = PATH;
            }
        }
    }
}

/// A power of ten that is seen well from `distance`, m.
fn axis_length(distance: f64) -> f64 {
    10.0_f64.powf((distance / 2.0).log10().floor())
}
