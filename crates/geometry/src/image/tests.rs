//! Pictures of every form, and those that are refused.

use std::io::Cursor;

use image::{DynamicImage, GrayImage, ImageBuffer, ImageFormat, Luma, Rgb, RgbImage, Rgba, RgbaImage};

use super::{Normalisation, Picture};
use crate::error::Error;
use crate::size::Size;
use gravisight_testing::claiming_size;

/// A 40×20 picture with a gradient.
fn gradient() -> RgbImage {
    RgbImage::from_fn(40, 20, |x, y| Rgb([(x * 6) as u8, (y * 12) as u8, 40]))
}

fn encoded(picture: impl Into<DynamicImage>, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    picture.into().write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

/// The header of a PNG of this size, without pixels.
fn png_header(width: u32, height: u32) -> Vec<u8> {
    claiming_size(encoded(gradient(), ImageFormat::Png), width, height)
}

#[test]
fn png_and_webp_keep_every_pixel_and_jpeg_nearly() {
    for format in [ImageFormat::Png, ImageFormat::WebP] {
        let picture = Picture::decode(&encoded(gradient(), format)).unwrap();
        assert_eq!(picture.rgb(), &gradient());
        assert!(picture.notes().is_empty());
    }
    let jpeg = Picture::decode(&encoded(gradient(), ImageFormat::Jpeg)).unwrap();
    let worst = jpeg.rgb().as_raw().iter().zip(gradient().as_raw()).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
    assert!(worst < 24, "{worst}");
}

#[test]
fn the_exif_orientation_is_applied() {
    let jpeg = encoded(gradient(), ImageFormat::Jpeg);
    // APP1 with one TIFF entry: orientation (0x0112) = 6, turn by 90° clockwise.
    let exif: &[u8] = b"\xff\xe1\x00\x22Exif\0\0MM\0\x2a\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0";
    let turned = [&jpeg[..2], exif, &jpeg[2..]].concat();
    assert_eq!(Picture::decode(&jpeg).unwrap().size(), Size::new(40, 20));
    let picture = Picture::decode(&turned).unwrap();
    assert_eq!(picture.size(), Size::new(20, 40));
    // The bright right end of the rows is now at the bottom.
    assert!(picture.rgb().get_pixel(10, 38).0[0] > 200 && picture.rgb().get_pixel(10, 1).0[0] < 40);
}

#[test]
fn grey_16_bit_and_transparent_pictures_are_converted_and_say_so() {
    let grey = Picture::decode(&encoded(GrayImage::from_pixel(20, 20, Luma([77])), ImageFormat::Png)).unwrap();
    assert_eq!(grey.rgb().get_pixel(3, 3).0, [77, 77, 77]);
    assert!(grey.notes()[0].contains("grey"), "{:?}", grey.notes());

    let deep: ImageBuffer<Rgb<u16>, Vec<u16>> = ImageBuffer::from_pixel(20, 20, Rgb([65535, 32896, 0]));
    let deep = Picture::decode(&encoded(deep, ImageFormat::Png)).unwrap();
    assert_eq!(deep.rgb().get_pixel(3, 3).0, [255, 128, 0]);
    assert!(deep.notes()[0].contains("16-bit"), "{:?}", deep.notes());

    let clear = RgbaImage::from_pixel(20, 20, Rgba([200, 100, 50, 128]));
    let clear = Picture::decode(&encoded(clear, ImageFormat::Png)).unwrap();
    assert_eq!(clear.rgb().get_pixel(3, 3).0, [100, 50, 25]);
    assert!(clear.notes()[0].contains("transparent"), "{:?}", clear.notes());

    let opaque = RgbaImage::from_pixel(20, 20, Rgba([200, 100, 50, 255]));
    assert!(Picture::decode(&encoded(opaque, ImageFormat::Png)).unwrap().notes().is_empty());
}

#[test]
fn pictures_too_small_or_too_large_are_refused_by_their_header() {
    for size in [[1, 1], [15, 40], [20_000, 20_000], [10_000, 10_000], [u32::MAX >> 1, 16]] {
        let error = Picture::decode(&png_header(size[0], size[1])).unwrap_err();
        match error {
            Error::ImageSize { width, height, .. } => assert_eq!([width, height], size),
            // The decoder itself refuses sides it cannot address.
            Error::ImageDecode { .. } => assert!(size[0] > 20_000, "{size:?}"),
            other => panic!("{size:?}: {other}"),
        }
    }
    let error = Picture::decode(&png_header(0, 0)).unwrap_err();
    assert!(matches!(error, Error::ImageDecode { .. } | Error::ImageSize { .. }), "{error}");
    assert!(matches!(Picture::from_rgba(&[], Size::square(0)), Err(Error::ImageSize { .. })));
}

#[test]
fn truncated_foreign_and_empty_files_are_refused() {
    // Noise, so that pixels and not headers fill the file.
    let noise = RgbImage::from_fn(200, 100, |x, y| {
        Rgb([0, 1, 2].map(|c| (x * 7919 + y * 104_729 + c * 31).wrapping_pow(2) as u8))
    });
    for format in [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::WebP] {
        let bytes = encoded(noise.clone(), format);
        for length in [10, bytes.len() / 2, bytes.len() * 9 / 10, bytes.len() - 20] {
            let error = Picture::decode(&bytes[..length]).unwrap_err();
            assert!(matches!(error, Error::ImageDecode { .. }), "{format:?} {length}: {error}");
        }
    }
    for bytes in [&b""[..], b"<html>", b"\0\0\0\0\0\0\0\0\0\0\0\0"] {
        assert!(matches!(Picture::decode(bytes), Err(Error::ImageDecode { .. })));
    }
    assert!(matches!(Picture::from_rgba(&[0; 100], Size::square(16)), Err(Error::ImageDecode { .. })));
}

#[test]
fn a_picture_of_the_input_size_is_only_normalised() {
    let picture = Picture::decode(&encoded(gradient(), ImageFormat::Png)).unwrap();
    let normalisation = Normalisation::default();
    let input = picture.network_input(Size::new(40, 20), &normalisation);
    assert_eq!(input.content, Size::new(40, 20));
    for (channel, (x, y)) in [(0, (7, 3)), (1, (39, 19)), (2, (0, 0))] {
        let byte = f32::from(gradient().get_pixel(x, y).0[channel]);
        let expected = (byte / 255.0 - normalisation.mean[channel]) / normalisation.std[channel];
        let found = input.values[3 * (y * 40 + x) as usize + channel];
        assert!((found - expected).abs() < 1e-5, "{found} {expected}");
    }
}

#[test]
fn another_aspect_ratio_is_fitted_and_padded_with_the_mean_colour() {
    let picture = Picture::decode(&encoded(gradient(), ImageFormat::Png)).unwrap();
    let input = picture.network_input(Size::square(64), &Normalisation::default());
    assert_eq!(input.content, Size::new(64, 32));
    assert!(input.values[3 * 64 * 32..].iter().all(|&value| value == 0.0));
}

#[test]
fn resizing_follows_the_pixel_centre_rule() {
    // A linear ramp stays the same ramp: value at (x + 1/2)·s - 1/2 of the original.
    let ramp = RgbImage::from_fn(32, 32, |x, _| Rgb([(8 * x) as u8, 0, 0]));
    let picture = Picture::decode(&encoded(ramp, ImageFormat::Png)).unwrap();
    let flat = Normalisation { mean: [0.0; 3], std: [1.0; 3] };
    let input = picture.network_input(Size::square(64), &flat);
    for x in 4..60 {
        let expected = 8.0 * ((x as f32 + 0.5) * 0.5 - 0.5);
        let found = input.values[3 * (64 * 32 + x)] * 255.0;
        assert!((found - expected).abs() <= 1.0, "{x}: {found} {expected}");
    }
}
