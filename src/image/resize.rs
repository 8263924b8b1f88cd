//! Pictures made smaller and larger.

use fast_image_resize::images::{Image, ImageRef};
use fast_image_resize::{PixelType, ResizeAlg, ResizeOptions, Resizer};
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
    let from = ImageRef::new(rgb.width(), rgb.height(), rgb.as_raw(), PixelType::U8x3).expect("three bytes a pixel");
    let mut to = Image::new(size.width, size.height, PixelType::U8x3);
    Resizer::new().resize(&from, &mut to, &options).expect("a part of the picture");
    RgbImage::from_raw(size.width, size.height, to.into_vec()).expect("three bytes a pixel")
}
