//! A picture's levels, at its pixels and between them.

use image::RgbImage;

/// Red, green and blue, 0 to 255.
pub type Levels = [f32; 3];

/// Levels of the pixel (x, y), which lies in the picture.
fn levels_at(rgb: &RgbImage, x: usize, y: usize) -> Levels {
    let first = 3 * (y * rgb.width() as usize + x);
    let bytes = &rgb.as_raw()[first..first + 3];
    std::array::from_fn(|channel| f32::from(bytes[channel]))
}

/// Levels at a place between pixels (bilinear); none outside the picture, or in one that is a line.
pub fn levels_between(rgb: &RgbImage, x: f64, y: f64) -> Option<Levels> {
    let (width, height) = (rgb.width() as usize, rgb.height() as usize);
    let inside = width > 1 && height > 1 && x >= 0.0 && y >= 0.0 && x <= (width - 1) as f64 && y <= (height - 1) as f64;
    if !inside {
        return None;
    }
    let (column, row) = ((x as usize).min(width - 2), (y as usize).min(height - 2));
    let (u, v) = ((x - column as f64) as f32, (y - row as f64) as f32);
    let [a, b] = [levels_at(rgb, column, row), levels_at(rgb, column + 1, row)];
    let [c, d] = [levels_at(rgb, column, row + 1), levels_at(rgb, column + 1, row + 1)];
    Some(std::array::from_fn(|channel| {
        let above = a[channel] + u * (b[channel] - a[channel]);
        let below = c[channel] + u * (d[channel] - c[channel]);
        above + v * (below - above)
    }))
}
