//! PNG, JPEG and WebP files into 8-bit RGB.

use std::io::Cursor;

use image::{ColorType, DynamicImage, ImageDecoder, ImageError, ImageFormat, ImageReader, Limits, Rgb, RgbImage};

use super::{MAX_PIXELS, Picture, check_size};
use crate::error::{Error, Result};
use crate::size::Size;

/// Memory a decoder may take, bytes: the largest picture with four 16-bit channels.
const MAX_ALLOC: u64 = MAX_PIXELS * 8;

impl Picture {
    /// Decodes a PNG, JPEG or WebP file. The EXIF orientation is applied; grey becomes RGB, 16-bit
    /// channels are rounded to 8, transparent pixels are laid on black. [`Picture::notes`] says so.
    ///
    /// # Errors
    /// [`Error::ImageDecode`] for other bytes or a truncated file; [`Error::ImageSize`] for a size
    /// outside the limits, before any pixel is decoded.
    pub fn decode(bytes: &[u8]) -> Result<Self> {
        let refuse = |error: ImageError| Error::ImageDecode {
            reason: match error {
                // Some sizes do not even come to the check below.
                ImageError::Limits(_) => format!("its header claims more than {MAX_PIXELS} pixels"),
                other => other.to_string(),
            },
        };
        let reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format();
        let reader = reader.map_err(|error| Error::ImageDecode { reason: error.to_string() })?;
        let Some(format) = reader.format() else {
            return Err(Error::ImageDecode { reason: "these bytes are not a picture in a known format".into() });
        };
        if !is_whole(bytes, format) {
            return Err(Error::ImageDecode { reason: "the file is truncated".into() });
        }
        let mut decoder = reader.into_decoder().map_err(refuse)?;
        let (width, height) = decoder.dimensions();
        check_size(Size { width, height })?;
        let mut limits = Limits::default();
        limits.max_alloc = Some(MAX_ALLOC);
        decoder.set_limits(limits).map_err(refuse)?;
        let orientation = decoder.orientation().map_err(refuse)?;
        let mut decoded = DynamicImage::from_decoder(decoder).map_err(refuse)?;
        decoded.apply_orientation(orientation);
        Ok(Self::from_dynamic(decoded))
    }

    /// Decodes a picture file.
    ///
    /// # Errors
    /// [`Error::Io`] with the path, else as [`Picture::decode`], which does not know it.
    pub fn open(path: &std::path::Path) -> Result<Self> {
        Self::decode(&crate::files::read(path)?)
    }

    pub(super) fn from_dynamic(decoded: DynamicImage) -> Self {
        let colour = decoded.color();
        let mut notes = Vec::new();
        if matches!(colour, ColorType::L8 | ColorType::La8 | ColorType::L16 | ColorType::La16) {
            notes.push("the picture is grey, but the model was trained on colour: the result is less reliable".into());
        }
        if colour.bytes_per_pixel() / colour.channel_count() > 1 {
            notes.push("the picture's 16-bit channels were rounded to 8 bits".into());
        }
        if !colour.has_alpha() {
            return Self { rgb: decoded.into_rgb8(), notes };
        }
        let rgba = decoded.into_rgba8();
        if rgba.pixels().any(|pixel| pixel.0[3] < u8::MAX) {
            notes.push("the picture's transparent pixels were drawn on black".into());
        }
        let rgb = RgbImage::from_fn(rgba.width(), rgba.height(), |x, y| {
            let [red, green, blue, alpha] = rgba.get_pixel(x, y).0;
            Rgb([red, green, blue].map(|channel| over_black(channel, alpha)))
        });
        Self { rgb, notes }
    }
}

/// Whether a file reaches its end. PNG's decoder sees to that itself; the others would fill the rest with grey.
fn is_whole(bytes: &[u8], format: ImageFormat) -> bool {
    let last = |marker: [u8; 2]| bytes.windows(2).rposition(|pair| pair == marker);
    match format {
        // The end of the image after the last start of a scan.
        ImageFormat::Jpeg => last([0xff, 0xd9]) > last([0xff, 0xda]),
        // RIFF: the length of what follows, little-endian, in bytes 4 to 7.
        ImageFormat::WebP => bytes
            .get(4..8)
            .and_then(|length| length.try_into().ok())
            .is_some_and(|length| u64::from(u32::from_le_bytes(length)) + 8 <= bytes.len() as u64),
        _ => true,
    }
}

/// `channel`·`alpha`, rounded.
fn over_black(channel: u8, alpha: u8) -> u8 {
    let full = u16::from(u8::MAX);
    ((u16::from(channel) * u16::from(alpha) + full / 2) / full) as u8
}
