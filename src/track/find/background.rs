//! What stands still in a clip, and what differs from it.

use image::RgbImage;

use crate::error::Result;
use crate::image::{Levels, Picture, levels_at};

/// Frames that a median needs before it can be taken for the background.
const FEWEST_FRAMES: usize = 5;
/// Most frames that a median is taken of: more change it little.
const MOST_FRAMES: usize = 31;
/// Pixels of all frames of the median together, which bounds its memory (three bytes each).
const MOST_PIXELS: usize = 128 * 1024 * 1024;
/// Standard deviation of a normal distribution in units of its median absolute deviation.
const SIGMA_OF_MEDIAN: f32 = 1.4826;
/// Smallest difference of two levels that counts, of 255: what rounding and compression make is below.
const LEAST_CONTRAST: f32 = 6.0;
/// The same in standard deviations of the noise.
const LEAST_CONTRAST_SIGMAS: f32 = 4.0;

/// What stands still in a clip.
#[derive(Debug, Clone)]
pub(super) struct Background {
    /// The median of the frames; none where there are too few of them.
    pub still: Option<RgbImage>,
    /// Smallest difference of two levels that is not noise, by pixel; one for all where there is no median.
    contrasts: Vec<f32>,
    width: usize,
}

impl Background {
    /// The median of frames spread over a clip of `count`, and the noise about it.
    ///
    /// # Errors
    /// What `read` returns.
    pub fn of(count: usize, read: &dyn Fn(usize) -> Result<Picture>) -> Result<Self> {
        if count < FEWEST_FRAMES {
            return Ok(Self { still: None, contrasts: vec![LEAST_CONTRAST], width: 1 });
        }
        let first = read(0)?;
        let size = first.size();
        let [width, height] = [size.width as usize, size.height as usize];
        let most = (MOST_PIXELS / (width * height)).clamp(FEWEST_FRAMES, MOST_FRAMES).min(count);
        let chosen = (1..most).map(|index| index * (count - 1) / (most - 1));
        let mut frames = vec![first];
        for index in chosen {
            frames.push(read(index)?);
        }
        let bytes: Vec<&[u8]> = frames.iter().map(|frame| frame.rgb().as_raw().as_slice()).collect();
        let mut values = vec![0_u8; frames.len()];
        let mut still = RgbImage::new(size.width, size.height);
        let mut noise = Vec::with_capacity(width * height);
        for (pixel, colour) in still.pixels_mut().enumerate() {
            let middles = [0, 1, 2].map(|channel| median_and_deviation(&bytes, 3 * pixel + channel, &mut values));
            colour.0 = middles.map(|(median, _)| median);
            noise.push(middles.iter().map(|&(_, deviation)| f32::from(deviation)).fold(0.0, f32::max));
        }
        // Neighbours' noise is alike, and a median of so few frames jumps from pixel to pixel.
        let contrast = |pixel: usize| {
            let sigma = SIGMA_OF_MEDIAN * neighbours_mean(&noise, [width, height], pixel);
            LEAST_CONTRAST.max(LEAST_CONTRAST_SIGMAS * sigma)
        };
        let contrasts = (0..width * height).map(contrast).collect();
        Ok(Self { still: Some(still), contrasts, width })
    }

    /// Smallest difference of two levels that is not noise at a pixel.
    pub fn contrast(&self, x: usize, y: usize) -> f32 {
        self.contrasts[(y * self.width + x).min(self.contrasts.len() - 1)]
    }

    /// Whether a pixel of `frame` is not the background's.
    pub fn differs(&self, frame: &RgbImage, x: usize, y: usize) -> bool {
        self.still
            .as_ref()
            .is_none_or(|still| differ(levels_at(frame, x, y), levels_at(still, x, y), self.contrast(x, y)))
    }
}

/// Whether any channel differs by more than `contrast`.
pub(super) fn differ(a: Levels, b: Levels, contrast: f32) -> bool {
    a.iter().zip(b).any(|(a, b)| (a - b).abs() > contrast)
}

/// Median of byte `index` of the frames, and of its absolute deviations from that.
fn median_and_deviation(frames: &[&[u8]], index: usize, values: &mut [u8]) -> (u8, u8) {
    for (value, frame) in values.iter_mut().zip(frames) {
        *value = frame[index];
    }
    let middle = values.len() / 2;
    let median = *values.select_nth_unstable(middle).1;
    values.iter_mut().for_each(|value| *value = value.abs_diff(median));
    (median, *values.select_nth_unstable(middle).1)
}

/// Mean over the 3×3 pixels about one, those outside the picture left out.
fn neighbours_mean(values: &[f32], [width, height]: [usize; 2], pixel: usize) -> f32 {
    let (x, y) = (pixel % width, pixel / width);
    let (columns, rows) = (x.saturating_sub(1)..(x + 2).min(width), y.saturating_sub(1)..(y + 2).min(height));
    let count = columns.len() * rows.len();
    let sum: f32 = rows.map(|row| values[row * width..][columns.clone()].iter().sum::<f32>()).sum();
    sum / count as f32
}
