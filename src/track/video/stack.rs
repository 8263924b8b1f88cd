//! What the motion network sees of a candidate: its surroundings in five stabilised frames.

use image::RgbImage;
use nalgebra::{Matrix3, Vector3};

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
        let [of_before, of_after] = &mut pictures;
        let set = |picture: &mut RgbImage, channel: usize, levels: Vec<f32>| {
            picture.pixels_mut().zip(levels).for_each(|(pixel, level)| pixel[channel] = level.round() as u8);
        };
        for (number, &(picture, frame_from_own)) in frames.iter().enumerate() {
            let rgb = picture.rgb();
            let grey = |[red, green, blue]: [f32; 3]| 0.299 * red + 0.587 * green + 0.114 * blue;
            let levels = averages(rgb, &frame_from_own, centre, magnification, grey);
            match number {
                0..=NEIGHBOURS => set(of_before, number, levels),
                _ => set(of_after, number - NEIGHBOURS - 1, levels),
            }
            if number == NEIGHBOURS {
                let difference = |[red, _, blue]: [f32; 3]| 128.0 + (red - blue) / 2.0;
                set(of_after, 2, averages(rgb, &frame_from_own, centre, magnification, difference));
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

/// For each pixel of a stack, row by row, the mean of `level` over samples of the colours in it. `rgb` is one of the stack's frames,
/// `frame_from_own` the homography to its pixels from those of the middle one, `centre` the candidate's there, px, and `magnification` px
/// of the stack per px.
fn averages(
    rgb: &RgbImage,
    frame_from_own: &Matrix3<f64>,
    centre: [f64; 2],
    magnification: f64,
    level: impl Fn([f32; 3]) -> f32,
) -> Vec<f32> {
    let side = STACK_SIDE as usize;
    let samples = (magnification.recip().ceil() as usize).clamp(1, MOST_SAMPLES);
    let step = (samples as f64 * magnification).recip();
    // From the middle of the stack to the sample of a number, along either axis, px of the middle frame.
    let offset = |index: usize| (index as f64 + 0.5 - (side * samples) as f64 / 2.0) * step;
    let [width, height] = [rgb.width(), rgb.height()].map(|side| side as usize);
    // Of a camera that stands still all rows have the same columns.
    let still = (*frame_from_own == Matrix3::identity())
        .then(|| (0..side * samples).map(|index| between(centre[0] + offset(index), width)).collect::<Vec<_>>());
    let across = frame_from_own.column(0) * step;
    let mut sums = vec![0.0; side * side];
    for row in 0..side * samples {
        let first = frame_from_own * Vector3::new(centre[0] + offset(0), centre[1] + offset(row), 1.0);
        let own_row = between(first.y, height);
        for (column, sum) in sums[row / samples * side..][..side].iter_mut().enumerate() {
            for index in column * samples..(column + 1) * samples {
                let (x, y) = match &still {
                    Some(columns) => (columns[index], own_row),
                    None => {
                        let at = first + across * index as f64;
                        (between(at.x / at.z, width), between(at.y / at.z, height))
                    }
                };
                *sum += interpolated(rgb, x, y, &level);
            }
        }
    }
    let share = ((samples * samples) as f32).recip();
    sums.into_iter().map(|sum| share * sum).collect()
}

/// The pixel before a place along a side of a picture (two pixels at least), and the fraction of the way from it to the next; a place
/// beyond the picture is taken to its edge.
fn between(at: f64, side: usize) -> (usize, f32) {
    let at = at.clamp(0.0, (side - 1) as f64);
    let before = (at as usize).min(side - 2);
    (before, (at - before as f64) as f32)
}

/// `level` of the colours, bilinearly interpolated from the pixels of two neighbouring columns and rows.
fn interpolated(
    rgb: &RgbImage,
    (left, u): (usize, f32),
    (top, v): (usize, f32),
    level: impl Fn([f32; 3]) -> f32,
) -> f32 {
    let across = |row: usize| {
        let first = 3 * (row * rgb.width() as usize + left);
        let pixels: &[u8; 6] = rgb.as_raw()[first..].first_chunk().expect("two pixels of a row");
        let [a, b, c, d, e, f] = pixels.map(f32::from);
        let (from, to) = (level([a, b, c]), level([d, e, f]));
        from + u * (to - from)
    };
    let (above, below) = (across(top), across(top + 1));
    above + v * (below - above)
}

#[cfg(all(test, not(target_arch = "wasm32")))]
mod tests {
    use super::*;

    /// Frames that grow brighter to the right and redder downwards, each seen by a camera that has turned on: what a stack holds.
    #[test]
    fn holds_the_brightness_of_five_frames_about_a_candidate() {
        let ramp = RgbImage::from_fn(200, 100, |x, y| image::Rgb([x as u8, x as u8, (x - x.min(y)) as u8]));
        let picture = Picture::from_rgb(ramp);
        for turned in [0.0, 3.0] {
            let frames = std::array::from_fn(|index| {
                let shift = turned * (index as f64 - NEIGHBOURS as f64);
                (&picture, Matrix3::new_translation(&[shift, 0.0].into()))
            });
            for radius in [2.0, 5.0] {
                let Stack { pictures: [before, after], magnification, .. } = Stack::of([100.0, 50.0], radius, &frames);
                let shown = |x: u32, y: u32, index: usize| {
                    let [u, v] = [x, y].map(|at| (f64::from(at) - 31.5) / magnification);
                    let x = 100.0 + u + turned * (index as f64 - 2.0);
                    let y = 50.0 + v;
                    (0.886 * x + 0.114 * (x - y.min(x)), 128.0 + y / 2.0)
                };
                for (x, y) in [(20, 20), (31, 32), (40, 37)] {
                    let found = [before[(x, y)], after[(x, y)]].map(|pixel| pixel.0.map(f64::from));
                    let [[a, b, c], [d, e, difference]] = found;
                    for (index, level) in [a, b, c, d, e].into_iter().enumerate() {
                        let (expected, _) = shown(x, y, index);
                        assert!((level - expected).abs() < 0.51, "{index} at {x}, {y}: {level}, not {expected}");
                    }
                    let (_, expected) = shown(x, y, NEIGHBOURS);
                    assert!((difference - expected).abs() < 0.51, "{difference}, not {expected}");
                }
            }
        }
    }
}
