//! What the motion network sees of a candidate: its surroundings in five stabilised frames.

use image::RgbImage;
use nalgebra::{Matrix3, Vector3};

use gravisight_geometry::image::Picture;

/// Side of a stack's pictures, px, and the radius that a candidate has in it.
pub const STACK_SIDE: u32 = 64;
pub const STACK_RADIUS: f64 = 3.0;
const SIDE: usize = STACK_SIDE as usize;
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
    let samples = (magnification.recip().ceil() as usize).clamp(1, MOST_SAMPLES);
    let count = SIDE * samples;
    let step = (samples as f64 * magnification).recip();
    // From the middle of the stack to the sample of a number, along either axis, px of the middle frame.
    let offset = |index: usize| (index as f64 + 0.5 - count as f64 / 2.0) * step;
    let [width, height] = [rgb.width(), rgb.height()].map(|side| side as usize);
    let across = frame_from_own.column(0) * step;
    let first_of = |row: usize| frame_from_own * Vector3::new(centre[0] + offset(0), centre[1] + offset(row), 1.0);
    let window = Window::about([first_of(0), first_of(count - 1)], across * (count - 1) as f64, [width, height]);
    // Each pixel's level once, unless there are far more pixels than samples (those of a ball of 40 px: eleven times as many).
    let window =
        window.filter(|window| window.area() <= 2 * count * count).map(|window| (window.levels(rgb, &level), window));
    // Of the samples of one number in each of a row's pixels: where they are, and the levels of the four pixels about them.
    let mut places = [[Places::default(); 2]; MOST_SAMPLES];
    let [mut above, mut below] = [[[0.0; SIDE]; 2]; 2];
    // Of a camera that stands still all rows have the same columns.
    let is_still = *frame_from_own == Matrix3::identity();
    if is_still {
        for (number, [x, _]) in places.iter_mut().enumerate() {
            x.set(width, |column| centre[0] + offset(column * samples + number));
        }
    }
    let mut sums = vec![0.0; SIDE * SIDE];
    for row in 0..count {
        let first = first_of(row);
        let sums: &mut [f32; SIDE] = sums[row / samples * SIDE..].first_chunk_mut().expect("a row");
        for (number, [x, y]) in places.iter_mut().enumerate().take(samples) {
            if is_still {
                let (before, fraction) = between(first.y, height);
                (y.before, y.fraction) = ([before; SIDE], [fraction; SIDE]);
            } else {
                let at = |axis: usize, column: usize| first[axis] + across[axis] * (column * samples + number) as f64;
                x.set(width, |column| at(0, column) / at(2, column));
                y.set(height, |column| at(1, column) / at(2, column));
            }
            let places = x.before.iter().zip(&y.before).map(|(x, y)| [*x as usize, *y as usize]).enumerate();
            match &window {
                Some((levels, window)) => {
                    let width = window.width();
                    for (column, [x, y]) in places {
                        let at = (y - window.start[1]) * width + x - window.start[0];
                        let levels = &levels[at..][..width + 2];
                        (above[0][column], above[1][column]) = (levels[0], levels[1]);
                        (below[0][column], below[1][column]) = (levels[width], levels[width + 1]);
                    }
                }
                None => {
                    for (column, [x, y]) in places {
                        for (row, levels) in [&mut above, &mut below].into_iter().enumerate() {
                            let pixels = rgb.as_raw()[3 * ((y + row) * width + x)..].as_chunks::<3>().0;
                            (levels[0][column], levels[1][column]) =
                                (level(pixels[0].map(f32::from)), level(pixels[1].map(f32::from)));
                        }
                    }
                }
            }
            // Interpolated bilinearly.
            for (column, sum) in sums.iter_mut().enumerate() {
                let along =
                    |[from, to]: &[[f32; SIDE]; 2]| from[column] + x.fraction[column] * (to[column] - from[column]);
                let (above, below) = (along(&above), along(&below));
                *sum += above + y.fraction[column] * (below - above);
            }
        }
    }
    let weight = ((samples * samples) as f32).recip();
    sums.into_iter().map(|sum| weight * sum).collect()
}

/// The part of a picture that samples are taken of: its first column and row, and those after its last.
struct Window {
    start: [usize; 2],
    end: [usize; 2],
}

impl Window {
    /// That of samples between two points of their left edge (homogeneous coordinates) and `across` from there, in a picture of these
    /// `sides`; none where a sample may be at infinity.
    fn about(left: [Vector3<f64>; 2], across: Vector3<f64>, sides: [usize; 2]) -> Option<Self> {
        let corners = [left[0], left[1], left[0] + across, left[1] + across];
        if corners.iter().any(|corner| corner.z <= 0.0) {
            return None;
        }
        let corners = corners.map(|corner| [corner.x / corner.z, corner.y / corner.z]);
        let range = |axis: usize| {
            let at = corners.map(|corner| between(corner[axis], sides[axis]).0 as usize);
            let (first, last) = at.iter().fold((usize::MAX, 0), |(first, last), &at| (first.min(at), last.max(at)));
            // The next pixel of the last is needed; one more at either end, for rounding.
            (first.saturating_sub(1), (last + 3).min(sides[axis]))
        };
        let [(left, right), (top, bottom)] = [0, 1].map(range);
        Some(Self { start: [left, top], end: [right, bottom] })
    }

    fn width(&self) -> usize {
        self.end[0] - self.start[0]
    }

    fn area(&self) -> usize {
        self.width() * (self.end[1] - self.start[1])
    }

    /// The level of each of its pixels.
    fn levels(&self, rgb: &RgbImage, level: impl Fn([f32; 3]) -> f32) -> Vec<f32> {
        let mut levels = vec![0.0; self.area()];
        for (row, levels) in (self.start[1]..self.end[1]).zip(levels.chunks_exact_mut(self.width())) {
            let pixels = &rgb.as_raw()[3 * (row * rgb.width() as usize + self.start[0])..];
            for (out, pixel) in levels.iter_mut().zip(pixels.as_chunks::<3>().0) {
                *out = level(pixel.map(f32::from));
            }
        }
        levels
    }
}

/// A row of places along one side of a picture: for each the pixel before it, and the fraction of the way from there to the next.
#[derive(Clone, Copy)]
struct Places {
    before: [u32; SIDE],
    fraction: [f32; SIDE],
}

impl Default for Places {
    fn default() -> Self {
        Self { before: [0; SIDE], fraction: [0.0; SIDE] }
    }
}

impl Places {
    #[inline(always)]
    fn set(&mut self, side: usize, at: impl Fn(usize) -> f64) {
        let at: [f64; SIDE] = std::array::from_fn(at);
        for ((before, fraction), at) in self.before.iter_mut().zip(&mut self.fraction).zip(at) {
            (*before, *fraction) = between(at, side);
        }
    }
}

/// The pixel before a place along a side of a picture (two pixels at least), and the fraction of the way from it to the next; a place
/// beyond the picture is taken to its edge.
#[inline(always)]
fn between(at: f64, side: usize) -> (u32, f32) {
    // Truncated without a conversion, which is slower here: of a double between 2⁵² and 2⁵³ the low bits are its whole number.
    const WHOLE: f64 = (1_u64 << 52) as f64;
    let at = at.clamp(0.0, (side - 1) as f64);
    let nearest = at + WHOLE - WHOLE;
    let before = (if nearest > at { nearest - 1.0 } else { nearest }).min((side - 2) as f64);
    ((before + WHOLE).to_bits() as u32, (at - before) as f32)
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
