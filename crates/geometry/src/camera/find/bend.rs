//! A picture without a strong lens's distortion.

use image::{Rgb, RgbImage};

use crate::image::levels_between;

/// The picture without a lens that puts a point at radius r, in picture widths, at r·(1 + `bend`·r²); width is the longer side.
pub(super) fn straightened(rgb: &RgbImage, bend: f64) -> RgbImage {
    let (width, height) = (f64::from(rgb.width()), f64::from(rgb.height()));
    let centre = [(width - 1.0) / 2.0, (height - 1.0) / 2.0];
    RgbImage::from_fn(rgb.width(), rgb.height(), |column, row| {
        let off = [f64::from(column) - centre[0], f64::from(row) - centre[1]];
        let factor = 1.0 + bend * (off[0] * off[0] + off[1] * off[1]) / width.max(height).powi(2);
        let at = |axis: usize, side: f64| (centre[axis] + factor * off[axis]).clamp(0.0, (side - 1.0).max(0.0));
        let levels = levels_between(rgb, at(0, width), at(1, height));
        levels.map_or(*rgb.get_pixel(column, row), |levels| Rgb(levels.map(|level| level.round() as u8)))
    })
}
