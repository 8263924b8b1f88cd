//! Pictures made smaller and larger.

use fast_image_resize::images::{TypedImage, TypedImageRef};
use fast_image_resize::pixels::U8x3;
use fast_image_resize::{ResizeAlg, ResizeOptions, Resizer};
use image::RgbImage;

use crate::size::Size;

/// How a pixel is made of those about its place; made smaller, of all that it covers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Filter {
    /// Bilinear: a triangle.
    Bilinear,
    /// Bicubic, of Catmull and Rom: sharper.
    Bicubic,
}

/// The part of a picture that begins at `start` (left, top; px) and has the size `part`, as a picture of `size`. The part lies
/// in the picture; neither is empty.
pub fn resized(rgb: &RgbImage, start: [u32; 2], part: Size, size: Size, filter: Filter) -> RgbImage {
    let filter = match filter {
        Filter::Bilinear => fast_image_resize::FilterType::Bilinear,
        Filter::Bicubic => fast_image_resize::FilterType::CatmullRom,
    };
    let [left, top] = start.map(f64::from);
    let options = ResizeOptions::new().resize_alg(ResizeAlg::Convolution(filter)).crop(
        left,
        top,
        f64::from(part.width),
        f64::from(part.height),
    );
    // Of one kind of pixel: the code for all the others would be a fifth of what a browser downloads.
    let from =
        TypedImageRef::<U8x3>::from_buffer(rgb.width(), rgb.height(), rgb.as_raw()).expect("three bytes a pixel");
    let mut pixels = RgbImage::new(size.width, size.height);
    let mut to = TypedImage::<U8x3>::from_buffer(size.width, size.height, &mut pixels).expect("three bytes a pixel");
    Resizer::new().resize_typed(&from, &mut to, &options).expect("a part of the picture");
    drop(to);
    pixels
}
