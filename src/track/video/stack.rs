//! What the motion network sees of a candidate: its surroundings in five stabilised frames.

use image::RgbImage;
use nalgebra::Matrix3;

use super::view::mapped;
use crate::image::Picture;

/// Side of a stack's pictures, px, and the radius that a candidate has in it.
pub(crate) const STACK_SIDE: u32 = 64;
pub(crate) const STACK_RADIUS: f64 = 3.0;
/// Frames before and after a candidate's that a stack holds.
pub(super) const NEIGHBOURS: usize = 2;
/// Largest magnification: a larger one shows nothing more.
const MOST_MAGNIFIED: f64 = 1.5;
/// Samples of a pixel of the stack along each axis, at most, where that covers several of the picture's.
const MOST_SAMPLES: usize = 4;

/// Two pictures of 64 px about a candidate. The first holds, as red, green and blue, the brightness of the two frames before
/// and of the candidate's own; the second that of the two frames after, and the difference of red and blue in its own.
#[derive(Debug, Clone)]
pub struct Stack {
    /// See above.
    pub pictures: [RgbImage; 2],
    /// Px of the stack per px of the frame.
    pub magnification: f64,
    /// The candidate's centre in the frame, px: the middle of the stack.
    pub centre: [f64; 2],
}

impl Stack {
    /// About a candidate of a `centre` and a `radius`, px, of the middle one of five `frames`, each with the homography to its pixels from
    /// those of the middle one.
    pub(super) fn of(centre: [f64; 2], radius: f64, frames: &[(&Picture, Matrix3<f64>); 2 * NEIGHBOURS + 1]) -> Self {
        let magnification = (STACK_RADIUS / radius).min(MOST_MAGNIFIED);
        let mut pictures = [(); 2].map(|()| RgbImage::new(STACK_SIDE, STACK_SIDE));
        let samples = (magnification.recip().ceil() as usize).clamp(1, MOST_SAMPLES);
        let middle = f64::from(STACK_SIDE - 1) / 2.0;
        for (number, (picture, frame_from_own)) in frames.iter().enumerate() {
            let rgb = picture.rgb();
            for y in 0..STACK_SIDE {
                for x in 0..STACK_SIDE {
                    let mut sum = [0.0; 3];
                    for sample in 0..samples * samples {
                        let part = |index: usize| (index as f64 + 0.5) / samples as f64 - 0.5;
                        let [u, v] = [(x, sample % samples), (y, sample / samples)]
                            .map(|(at, index)| (f64::from(at) + part(index) - middle) / magnification);
                        let at = mapped(frame_from_own, [centre[0] + u, centre[1] + v]);
                        let pixel = interpolated(rgb, at);
                        (0..3).for_each(|channel| sum[channel] += pixel[channel]);
                    }
                    let [red, green, blue] = sum.map(|sum| sum / (samples * samples) as f64);
                    let [of_before, of_after] = &mut pictures;
                    let grey = (0.299 * red + 0.587 * green + 0.114 * blue).round() as u8;
                    match number {
                        0..=NEIGHBOURS => of_before.get_pixel_mut(x, y)[number] = grey,
                        _ => of_after.get_pixel_mut(x, y)[number - NEIGHBOURS - 1] = grey,
                    }
                    if number == NEIGHBOURS {
                        of_after.get_pixel_mut(x, y)[2] = (128.0 + (red - blue) / 2.0).round() as u8;
                    }
                }
            }
        }
        Self { pictures, magnification, centre }
    }

    /// Where a point of the frame is in the stack, px.
    pub fn stack_from_frame(&self, at: [f64; 2]) -> [f64; 2] {
        let middle = f64::from(STACK_SIDE - 1) / 2.0;
        [0, 1].map(|axis| (at[axis] - self.centre[axis]) * self.magnification + middle)
    }
}

/// The colours at a point, interpolated between pixels; beyond the picture those at its edge.
fn interpolated(rgb: &RgbImage, [x, y]: [f64; 2]) -> [f64; 3] {
    let within = |at: f64, side: u32| at.clamp(0.0, f64::from(side - 1));
    let [x, y] = [within(x, rgb.width()), within(y, rgb.height())];
    let (left, top) = (x as u32, y as u32);
    let (right, below) = ((left + 1).min(rgb.width() - 1), (top + 1).min(rgb.height() - 1));
    let [u, v] = [x - f64::from(left), y - f64::from(top)];
    let corners =
        [(left, top, 1.0 - u, 1.0 - v), (right, top, u, 1.0 - v), (left, below, 1.0 - u, v), (right, below, u, v)];
    let mut colours = [0.0; 3];
    for (x, y, across, down) in corners {
        let pixel = rgb.get_pixel(x, y);
        (0..3).for_each(|channel| colours[channel] += f64::from(pixel[channel]) * across * down);
    }
    colours
}
