//! `--overlay`: the picture with the heatmap and the position found.

use std::io::Cursor;
use std::path::Path;

use anyhow::Result;
use gravisight::Picture;
use gravisight::files::write_whole;
use gravisight::localise::Maps;
use image::{ImageFormat, Luma, Rgb, RgbImage, imageops};

/// Colour of the heatmap and of the position.
const HEAT: [f32; 3] = [255.0, 96.0, 0.0];
const MARK: Rgb<u8> = Rgb([255, 255, 255]);
/// Share of the heatmap's colour at its peak.
const OPACITY: f32 = 0.7;
/// Inner and outer end of the four strokes around the position, px.
const STROKE: std::ops::Range<i64> = 6..14;

/// Writes a PNG to `path`, whole.
pub fn write(path: &Path, picture: &Picture, maps: &Maps, position: [f64; 2]) -> Result<()> {
    let mut out = picture.rgb().clone();
    blend(&mut out, maps);
    mark(&mut out, position);
    let mut png = Cursor::new(Vec::new());
    out.write_to(&mut png, ImageFormat::Png)?;
    Ok(write_whole(path, png.get_ref())?)
}

fn blend(out: &mut RgbImage, maps: &Maps) {
    let peak = maps.heatmap.iter().fold(f32::MIN_POSITIVE, |peak, &value| peak.max(value));
    let cells = image::ImageBuffer::from_fn(maps.width as u32, maps.height as u32, |x, y| {
        Luma([maps.heatmap[y as usize * maps.width + x as usize] / peak])
    });
    let heat = imageops::resize(&cells, out.width(), out.height(), imageops::FilterType::Triangle);
    for (pixel, heat) in out.pixels_mut().zip(heat.pixels()) {
        let share = heat.0[0] * OPACITY;
        for (channel, colour) in pixel.0.iter_mut().zip(HEAT) {
            *channel = (f32::from(*channel) * (1.0 - share) + colour * share).round() as u8;
        }
    }
}

fn mark(out: &mut RgbImage, [x, y]: [f64; 2]) {
    let (x, y) = (x.round() as i64, y.round() as i64);
    for offset in STROKE {
        for (dx, dy) in [(offset, 0), (-offset, 0), (0, offset), (0, -offset)] {
            let (px, py) = (u32::try_from(x + dx), u32::try_from(y + dy));
            if let (Ok(px), Ok(py)) = (px, py)
                && let Some(pixel) = out.get_pixel_mut_checked(px, py)
            {
                *pixel = MARK;
            }
        }
    }
}
