//! What differs between the frames of a video from a camera that stands still.

use image::RgbImage;

/// Frames of which the first background is the median.
pub(super) const FIRST_FRAMES: usize = 15;
/// Least difference of two levels that counts, and the same in median differences between a frame and the one before.
const LEAST_CONTRAST: u8 = 9;
const CONTRAST_OF_NOISE: f64 = 6.0;
/// Pixels left out between those that tell the noise.
const STEP: usize = 37;

/// Brightness and the difference of red and blue, 0 to 255, rows from the top: a yellow ball before green is as bright.
#[derive(Debug, Clone)]
pub(super) struct Planes {
    pub width: usize,
    pub height: usize,
    pub levels: [Vec<u8>; 2],
}

impl Planes {
    pub fn of(rgb: &RgbImage) -> Self {
        let (width, height) = (rgb.width() as usize, rgb.height() as usize);
        let bytes = rgb.as_raw();
        let brightness = bytes
            .chunks_exact(3)
            .map(|pixel| ((u16::from(pixel[0]) + 2 * u16::from(pixel[1]) + u16::from(pixel[2])) >> 2) as u8);
        let colour = bytes.chunks_exact(3).map(|pixel| ((255 + u16::from(pixel[0]) - u16::from(pixel[2])) >> 1) as u8);
        Self { width, height, levels: [brightness.collect(), colour.collect()] }
    }

    /// The largest difference of a pixel's levels in two pictures of one size.
    pub fn difference(&self, other: &Self) -> Vec<u8> {
        let [a, b] = &self.levels;
        let [c, d] = &other.levels;
        let pairs = a.iter().zip(c).zip(b.iter().zip(d));
        pairs.map(|((a, c), (b, d))| a.abs_diff(*c).max(b.abs_diff(*d).saturating_mul(2))).collect()
    }
}

/// What stands still.
#[derive(Debug, Clone)]
pub(super) struct Background(Planes);

impl Background {
    /// The median of frames.
    pub fn of(frames: &[Planes]) -> Option<Self> {
        let first = frames.first()?;
        let mut values = vec![0_u8; frames.len()];
        let mut background = first.clone();
        for (plane, levels) in background.levels.iter_mut().enumerate() {
            for (pixel, level) in levels.iter_mut().enumerate() {
                values.iter_mut().zip(frames).for_each(|(value, frame)| *value = frame.levels[plane][pixel]);
                let middle = values.len() / 2;
                *level = *values.select_nth_unstable(middle).1;
            }
        }
        Some(Self(background))
    }

    /// Follows light that changes slowly: a level a frame.
    pub fn follow(&mut self, frame: &Planes) {
        for (levels, now) in self.0.levels.iter_mut().zip(&frame.levels) {
            for (level, now) in levels.iter_mut().zip(now) {
                *level = level.wrapping_add(u8::from(*now > *level)).wrapping_sub(u8::from(*now < *level));
            }
        }
    }

    /// How much a frame's pixels are not the background's.
    pub fn difference(&self, frame: &Planes) -> Vec<u8> {
        self.0.difference(frame)
    }
}

/// The difference of levels that noise does not reach, of the differences of two frames.
pub(super) fn contrast_of(differences: &[u8]) -> u8 {
    let mut counts = [0_usize; 256];
    differences.iter().step_by(STEP).for_each(|&difference| counts[difference as usize] += 1);
    let all: usize = counts.iter().sum();
    let mut below = 0;
    // Most pixels show what stands still. The median of whole numbers, between them.
    let median = counts.iter().enumerate().find_map(|(level, &count)| {
        below += count;
        (2 * below >= all).then(|| level as f64 + 0.5 - (below as f64 - all as f64 / 2.0) / count.max(1) as f64)
    });
    LEAST_CONTRAST.max((CONTRAST_OF_NOISE * median.unwrap_or(0.0)).min(255.0) as u8)
}
