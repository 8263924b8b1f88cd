//! Pictures with maps painted over them.

use std::io::Cursor;

use gravisight::parts::{Maps, Saliency};
use gravisight::{Camera, CourtLine, Error, Result};
use image::imageops::{self, FilterType};
use image::{ImageBuffer, ImageFormat, Luma, Rgb, RgbImage};
use nalgebra::Point3;
use plotters::style::RGBColor;
use plotters::style::colors::colormaps::ViridisRGB;

/// Colour of the heatmap and of the position.
const HEAT: [f32; 3] = [255.0, 96.0, 0.0];
const MARK: Rgb<u8> = Rgb([255, 255, 255]);
/// Share of the map's colour where the heatmap peaks; everywhere on the depth map.
const HEAT_OPACITY: f32 = 0.7;
const DEPTH_OPACITY: f32 = 0.75;
/// Colour of a court's lines, which no court has, and the points of each: more than a picture has pixels along it.
const LINE: Rgb<u8> = Rgb([255, 0, 255]);
const LINE_STEPS: u32 = 8000;
/// Inner and outer end of the four strokes around the position, px.
const STROKE: std::ops::Range<i64> = 6..14;
/// Share of a saliency map's pixels that are below its full colour: a few strong pixels do not dim all others.
const SALIENCY_PERCENTILE: f64 = 0.999;

/// `picture` with the heatmap's glow over it.
pub fn with_heatmap(picture: &RgbImage, maps: &Maps) -> RgbImage {
    let peak = maps.heatmap.iter().fold(f32::MIN_POSITIVE, |peak, &value| peak.max(value));
    let levels = maps.heatmap.iter().map(|value| value / peak).collect();
    painted(picture, [maps.width, maps.height], levels, |level| (HEAT, level * HEAT_OPACITY))
}

/// The nearest and the farthest depth of some maps, m.
pub fn depth_range<'a>(maps: impl Iterator<Item = &'a Maps>) -> [f32; 2] {
    maps.flat_map(|maps| &maps.depth)
        .fold([f32::INFINITY, 0.0], |[nearest, farthest], &depth| [nearest.min(depth), farthest.max(depth)])
}

/// `picture` under its depth map; the range's ends (m) are the darkest and the brightest colour.
pub fn with_depth(picture: &RgbImage, maps: &Maps, [nearest, farthest]: [f32; 2]) -> RgbImage {
    let span = (farthest - nearest).max(f32::MIN_POSITIVE);
    let levels = maps.depth.iter().map(|depth| (depth - nearest) / span).collect();
    painted(picture, [maps.width, maps.height], levels, |level| (viridis(level), DEPTH_OPACITY))
}

/// `picture`, dimmed, with |∂depth/∂brightness| glowing in it, and the value of the full glow, m.
pub fn with_saliency(picture: &RgbImage, saliency: &Saliency) -> (RgbImage, f32) {
    let mut sorted: Vec<f32> = saliency.values.iter().map(|value| value.abs()).collect();
    sorted.sort_by(f32::total_cmp);
    let full = sorted.get(((sorted.len() - 1) as f64 * SALIENCY_PERCENTILE) as usize).copied().unwrap_or_default();
    let full = full.max(f32::MIN_POSITIVE);
    let levels = saliency.values.iter().map(|value| (value.abs() / full).min(1.0)).collect();
    let grey = ImageBuffer::from_fn(picture.width(), picture.height(), |x, y| {
        let Luma([brightness]) = image::Pixel::to_luma(picture.get_pixel(x, y));
        Rgb([brightness / 2; 3])
    });
    // The square root shows a hundredth of the full glow as a tenth.
    let glow = |level: f32| (viridis(level.sqrt()), level.sqrt());
    (painted(&grey, [saliency.width, saliency.height], levels, glow), full)
}

/// Four white strokes around `position`, px.
pub fn mark(picture: &mut RgbImage, [x, y]: [f64; 2]) {
    let (x, y) = (x.round() as i64, y.round() as i64);
    for offset in STROKE {
        for (dx, dy) in [(offset, 0), (-offset, 0), (0, offset), (0, -offset)] {
            let (px, py) = (u32::try_from(x + dx), u32::try_from(y + dy));
            if let (Ok(px), Ok(py)) = (px, py)
                && let Some(pixel) = picture.get_pixel_mut_checked(px, py)
            {
                *pixel = MARK;
            }
        }
    }
}

/// A court's lines as a camera sees them, over its picture.
pub fn lines(picture: &mut RgbImage, camera: &Camera, lines: &[CourtLine]) {
    for line in lines {
        segment(picture, camera, [line.from, line.to].map(Point3::from), LINE);
    }
}

/// A segment of the world as a camera sees it, over its picture.
pub fn segment(picture: &mut RgbImage, camera: &Camera, [from, to]: [Point3<f64>; 2], colour: Rgb<u8>) {
    for step in 0..=LINE_STEPS {
        let at = from + (to - from) * (f64::from(step) / f64::from(LINE_STEPS));
        let Ok(image) = camera.image_from_world(&at) else { continue };
        let (x, y) = (image.x.round(), image.y.round());
        if x >= 0.0 && y >= 0.0 && x < f64::from(picture.width()) && y < f64::from(picture.height()) {
            picture.put_pixel(x as u32, y as u32, colour);
        }
    }
}

/// The bytes of a PNG file.
///
/// # Errors
/// [`Error::Format`] where the encoder refuses.
pub fn png(picture: &RgbImage) -> Result<Vec<u8>> {
    let mut png = Cursor::new(Vec::new());
    picture.write_to(&mut png, ImageFormat::Png).map_err(Error::format("picture"))?;
    Ok(png.into_inner())
}

/// `picture` with `levels` (0 to 1, row-major, of any size) over it; `paint` gives a level's colour and opacity.
fn painted(
    picture: &RgbImage,
    [width, height]: [usize; 2],
    levels: Vec<f32>,
    paint: impl Fn(f32) -> ([f32; 3], f32),
) -> RgbImage {
    let mut out = picture.clone();
    let cells: ImageBuffer<Luma<f32>, _> =
        ImageBuffer::from_raw(width as u32, height as u32, levels).unwrap_or_default();
    let levels = imageops::resize(&cells, out.width(), out.height(), FilterType::Triangle);
    for (pixel, level) in out.pixels_mut().zip(levels.pixels()) {
        let (colour, share) = paint(level.0[0]);
        for (channel, colour) in pixel.0.iter_mut().zip(colour) {
            *channel = (f32::from(*channel) * (1.0 - share) + colour * share).round() as u8;
        }
    }
    out
}

/// Colour of a level between 0 (dark) and 1 (bright): perceptually uniform and safe for the colour-blind.
fn viridis(level: f32) -> [f32; 3] {
    let RGBColor(red, green, blue) = ViridisRGB::get_color(level.clamp(0.0, 1.0));
    [red, green, blue].map(f32::from)
}
