//! Pictures: decoding, letterboxing to the network's input size, normalisation.

mod decode;
mod levels;
mod resize;
#[cfg(test)]
mod tests;

use image::{ImageBuffer, Rgb, RgbImage};
use serde::{Deserialize, Serialize};

pub use self::levels::{Levels, levels_between};
pub use self::resize::{Filter, resized};
use crate::error::{Error, Result};
use crate::size::Size;
use gravisight_kernels::Vectors;
use gravisight_kernels::pixels::rgb_of_rgba;

/// Smallest side of a picture that can show a ball, px.
pub const MIN_SIDE: u32 = 16;
/// Largest picture accepted, px (200 MB as RGB, which a browser tab still holds).
pub const MAX_PIXELS: u64 = 64 * 1024 * 1024;
/// Pixels that are copied at a time.
const COPIED_PIXELS: usize = 1 << 14;
/// Pixels of a byte's full scale.
const BYTE_SCALE: f32 = 255.0;

/// An 8-bit RGB picture, rows from the top, and what was changed to make it one.
///
/// ```
/// # mod gravisight { pub use gravisight_geometry::{camera, camera::*, error::*, image::*, size::*}; }
/// # fn main() -> gravisight::Result<()> {
/// use gravisight::{Picture, Size};
///
/// // Pixels that a program has already; `Picture::decode` takes a PNG, JPEG or WebP file's bytes.
/// let grey = Picture::from_rgba(&[128; 4 * 64 * 48], Size::new(64, 48))?;
/// assert_eq!(grey.size(), Size::new(64, 48));
/// assert!(Picture::decode(b"no picture").is_err());
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone)]
pub struct Picture {
    rgb: RgbImage,
    notes: Vec<String>,
}

/// Channel means and standard deviations that the network's input is normalised with.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(deny_unknown_fields)]
pub struct Normalisation {
    /// Mean of red, green, blue as shares of full scale.
    pub mean: [f32; 3],
    /// Standard deviation of red, green, blue as shares of full scale.
    pub std: [f32; 3],
}

impl Default for Normalisation {
    /// ImageNet's.
    fn default() -> Self {
        Self { mean: [0.485, 0.456, 0.406], std: [0.229, 0.224, 0.225] }
    }
}

/// A picture as the network takes it.
#[derive(Debug, Clone)]
pub struct NetworkInput {
    /// Normalised values, `[height, width, 3]`, row-major; 0 (the mean colour) outside the picture.
    pub values: Vec<f32>,
    /// Size of the input.
    pub size: Size,
    /// Size of the part that the picture fills, from the top left corner.
    pub content: Size,
}

impl Picture {
    /// A picture from 8-bit RGBA pixels, rows from the top (a canvas' `ImageData`).
    ///
    /// # Errors
    /// [`Error::ImageSize`] for a size outside the limits, [`Error::ImageDecode`] if `rgba` does
    /// not hold width·height·4 bytes.
    pub fn from_rgba(rgba: &[u8], size: Size) -> Result<Self> {
        Self::from_rgba_copied(rgba.len(), size, |from, part| part.copy_from_slice(&rgba[from..][..part.len()]))
    }

    /// The same of `length` bytes that are elsewhere; `copy` fills a slice with those from an index on.
    ///
    /// # Errors
    /// As [`Self::from_rgba`].
    #[doc(hidden)]
    pub fn from_rgba_copied(length: usize, size: Size, copy: impl Fn(usize, &mut [u8])) -> Result<Self> {
        check_size(size)?;
        let wrong = || Error::ImageDecode { reason: format!("{length} bytes are not {size} RGBA pixels") };
        if length != 4 * size.pixels() {
            return Err(wrong());
        }
        // A video's frames are opaque, and many: through a buffer that the processor's cache holds.
        let mut rgb = RgbImage::new(size.width, size.height);
        let mut buffer = vec![0; 4 * COPIED_PIXELS.min(size.pixels())];
        let parts = rgb.chunks_mut(3 * COPIED_PIXELS).enumerate();
        let all_opaque = parts.into_iter().all(|(number, rgb)| {
            let (rgba, mut opaque) = (&mut buffer[..rgb.len() / 3 * 4], 0);
            copy(4 * COPIED_PIXELS * number, rgba);
            rgb_of_rgba(Vectors::best(), rgba, rgb, &mut opaque);
            opaque == u8::MAX
        });
        if all_opaque {
            return Ok(Self::from_rgb(rgb));
        }
        let mut rgba = vec![0; length];
        copy(0, &mut rgba);
        let buffer = ImageBuffer::from_raw(size.width, size.height, rgba).ok_or_else(wrong)?;
        Ok(Self::from_dynamic(image::DynamicImage::ImageRgba8(buffer)))
    }

    /// From pixels that are 8-bit RGB already.
    pub fn from_rgb(rgb: RgbImage) -> Self {
        Self { rgb, notes: Vec::new() }
    }

    /// Its size.
    pub fn size(&self) -> Size {
        Size::new(self.rgb.width(), self.rgb.height())
    }

    /// What was changed to make it 8-bit RGB, in words.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// The pixels.
    pub fn rgb(&self) -> &RgbImage {
        &self.rgb
    }

    /// Its pixels.
    pub fn into_rgb(self) -> RgbImage {
        self.rgb
    }

    /// The picture scaled to fit `size` (antialiased, pixel-centre rule, aspect ratio kept),
    /// padded with the mean colour on the right or below, normalised.
    pub fn network_input(&self, size: Size, normalisation: &Normalisation) -> NetworkInput {
        let content = fit(self.size(), size);
        if content == self.size() {
            return normalised(&self.rgb, size, normalisation);
        }
        let scaled = resized(&self.rgb, [0, 0], self.size(), content, Filter::Bilinear);
        normalised(&scaled, size, normalisation)
    }
}

/// Largest size of the aspect ratio of `picture` that fits `frame`.
fn fit(picture: Size, frame: Size) -> Size {
    let [[width, height], [most_wide, most_high]] = [picture.xy(), frame.xy()];
    let scale = (most_wide / width).min(most_high / height);
    let scaled = |side: f64, most: u32| ((side * scale).round() as u32).clamp(1, most);
    Size::new(scaled(width, frame.width), scaled(height, frame.height))
}

fn normalised(rgb: &ImageBuffer<Rgb<u8>, Vec<u8>>, size: Size, normalisation: &Normalisation) -> NetworkInput {
    let scale: [f32; 3] = std::array::from_fn(|channel| 1.0 / (BYTE_SCALE * normalisation.std[channel]));
    let offset: [f32; 3] = std::array::from_fn(|channel| normalisation.mean[channel] / normalisation.std[channel]);
    let mut values = vec![0.0; 3 * size.pixels()];
    for (row, pixels) in values.chunks_exact_mut(3 * size.width as usize).zip(rgb.rows()) {
        for (value, pixel) in row.chunks_exact_mut(3).zip(pixels) {
            for channel in 0..3 {
                value[channel] = f32::from(pixel.0[channel]) * scale[channel] - offset[channel];
            }
        }
    }
    NetworkInput { values, size, content: Size::new(rgb.width(), rgb.height()) }
}

/// Normalised values `[height, width, 3]` of the part of a picture of `size` that begins at (left, top); 0 (the mean colour)
/// outside the picture.
#[doc(hidden)]
pub fn tile(rgb: &RgbImage, [left, top]: [u32; 2], size: Size, normalisation: &Normalisation) -> Vec<f32> {
    let count = |start: u32, side: u32, all: u32| side.min(all.saturating_sub(start));
    let part = (count(left, size.width, rgb.width()), count(top, size.height, rgb.height()));
    if (left, top) == (0, 0) && part == rgb.dimensions() {
        return normalised(rgb, size, normalisation).values;
    }
    let part = image::imageops::crop_imm(rgb, left, top, part.0, part.1).to_image();
    normalised(&part, size, normalisation).values
}

/// Refuses sizes outside [`MIN_SIDE`] and [`MAX_PIXELS`].
fn check_size(Size { width, height }: Size) -> Result<()> {
    if width.min(height) < MIN_SIDE || u64::from(width) * u64::from(height) > MAX_PIXELS {
        return Err(Error::ImageSize { width, height, min_side: MIN_SIDE, max_pixels: MAX_PIXELS });
    }
    Ok(())
}
