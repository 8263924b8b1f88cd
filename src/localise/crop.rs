//! Square crops of a picture around a candidate, scaled until its ball has a given radius.

use image::{Rgb, RgbImage};
use nalgebra::Point2;

use crate::model::{VERIFIER_RADIUS, VERIFIER_SIDE};
use gravisight_geometry::camera::Outline;
use gravisight_geometry::image::{Filter, resized};
use gravisight_geometry::size::Size;

/// Size of a crop, and of the ball in it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CropSize {
    /// Side, px of the network's input.
    pub(super) side: u32,
    /// Radius that the ball is scaled to, px of the network's input.
    ball_radius: f64,
}

impl CropSize {
    /// Side, px of the network's input.
    pub(crate) fn side(&self) -> u32 {
        self.side
    }
}

/// Input of the detector's second pass: a radius among those that it measures best.
pub(crate) const DETECTOR_CROP: CropSize = CropSize { side: 128, ball_radius: 23.0 };
/// Input of the verifier.
pub(crate) const VERIFIER_CROP: CropSize = CropSize { side: VERIFIER_SIDE, ball_radius: VERIFIER_RADIUS };
/// Side of the verifier's second picture, the surroundings, over that of the crop: a head is recognised by its shoulders, a lamp by
/// its row.
const SURROUNDINGS_SCALE: f64 = 3.0;
/// Colour of the surroundings beyond the picture's edges: the middle grey of the normalisation.
const PADDING: Rgb<u8> = Rgb([124, 116, 104]);
/// Largest magnification: a larger one shows nothing more.
const MAX_MAGNIFICATION: f64 = 6.0;
/// Largest distance from the crop's centre to where the ball may be, as a fraction of the crop's side.
const MAX_REACH_FRACTION: f64 = 0.36;

/// A square part of a picture, and its scale in a network's input.
pub(crate) struct Crop {
    start: [u32; 2],
    side: u32,
    size: CropSize,
    /// Px of the network's input per px of the picture.
    magnification: f64,
}

impl Crop {
    /// The part of `rgb` in which the ball of `outline` has about the radius that `size` names, centred on it as far as the
    /// picture's edges allow. The ball may be `reach` px from the outline's centre.
    pub(crate) fn around(outline: &Outline, reach: f64, rgb: &RgbImage, size: CropSize) -> Self {
        // The crop must hold every position within reach.
        let radius = size.ball_radius.min(outline.radius * MAX_REACH_FRACTION * f64::from(size.side) / reach);
        let magnification = (radius / outline.radius).min(MAX_MAGNIFICATION);
        let (width, height) = rgb.dimensions();
        let side = ((f64::from(size.side) / magnification).round() as u32).clamp(1, width.min(height));
        let start = |at: f64, all: u32| ((at + 0.5 - f64::from(side) / 2.0).round().max(0.0) as u32).min(all - side);
        let start = [start(outline.centre.x, width), start(outline.centre.y, height)];
        Self { start, side, size, magnification: f64::from(size.side) / f64::from(side) }
    }

    /// The crop's pixels, scaled to the network's input.
    pub(crate) fn pixels(&self, rgb: &RgbImage) -> RgbImage {
        resized(rgb, self.start, Size::square(self.side), Size::square(self.size.side), Filter::Bicubic)
    }

    /// The verifier's input: the crop and its surroundings, of the same size in pixels.
    pub(crate) fn with_surroundings(&self, rgb: &RgbImage) -> [RgbImage; 2] {
        [self.pixels(rgb), self.surroundings(rgb)]
    }

    /// The part of `rgb` with the same centre that is [`SURROUNDINGS_SCALE`] times as wide, scaled to the network's input.
    fn surroundings(&self, rgb: &RgbImage) -> RgbImage {
        let whole = SURROUNDINGS_SCALE * f64::from(self.side);
        let scale = f64::from(self.size.side) / whole;
        // Along each axis the part inside the picture: its start and length there, and in the network's input.
        let parts = [(self.start[0], rgb.width()), (self.start[1], rgb.height())].map(|(start, all)| {
            let first = f64::from(start) + (f64::from(self.side) - whole) / 2.0;
            let from = first.max(0.0).floor() as u32;
            let to = ((first + whole).ceil() as u32).min(all);
            let at = (((f64::from(from) - first) * scale).round().max(0.0) as u32).min(self.size.side - 1);
            let length = (f64::from(to - from) * scale).round().max(1.0) as u32;
            (from, to - from, at, length.min(self.size.side - at))
        });
        let [(left, width, x, columns), (top, height, y, rows)] = parts;
        let size = Size::new(columns, rows);
        let part = resized(rgb, [left, top], Size::new(width, height), size, Filter::Bilinear);
        let mut surroundings = RgbImage::from_pixel(self.size.side, self.size.side, PADDING);
        image::imageops::replace(&mut surroundings, &part, i64::from(x), i64::from(y));
        surroundings
    }

    /// An outline in px of the picture, from one in px of the crop.
    pub(super) fn picture_from_crop(&self, outline: &Outline) -> Outline {
        let at = |axis: usize| (outline.centre[axis] + 0.5) / self.magnification - 0.5 + f64::from(self.start[axis]);
        Outline { centre: Point2::new(at(0), at(1)), radius: outline.radius / self.magnification }
    }

    /// An outline in px of the crop, from one in px of the picture.
    pub(crate) fn crop_from_picture(&self, outline: &Outline) -> Outline {
        let at = |axis: usize| (outline.centre[axis] - f64::from(self.start[axis]) + 0.5) * self.magnification - 0.5;
        Outline { centre: Point2::new(at(0), at(1)), radius: outline.radius * self.magnification }
    }
}
