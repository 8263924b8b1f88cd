//! Drawing training pictures: frames, crops, jitter.

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use rayon::iter::{IntoParallelIterator, ParallelIterator};

use super::config::{Phase, TrainConfig};
use super::loss::Labels;
use super::step::Batch;
use crate::data::{Clip, Clips, Frame};
use crate::error::{Error, Result};

/// Grid that crops are placed on, px: the compact backbone's largest stride, so that a crop sees
/// the same pixels in the same cells as the whole picture.
const CROP_GRID: u32 = 32;

/// Share of the picture's side by which a label may lie outside (a ball cut by the edge).
const LABEL_MARGIN: f64 = 0.05;

/// Training frames with 3D labels.
pub struct Sampler {
    clips: Clips,
    /// Clip, frame, depth.
    frames: Vec<(usize, usize, f64)>,
}

/// One picture of a batch: `[height, width, 3]`, its 2D label, its depth.
type Drawn = (Vec<f32>, [f64; 2], f64);

impl Sampler {
    /// All visible frames of `clips`.
    ///
    /// # Errors
    /// [`Error::Data`] for a visible frame without `world`, or for clips without visible frames.
    pub fn with_3d_labels(clips: Clips) -> Result<Self> {
        let mut frames = Vec::new();
        for (clip_index, clip) in clips.clips.iter().enumerate() {
            for (frame_index, frame) in clip.frames.iter().enumerate().filter(|(_, frame)| frame.visible) {
                check_label(clip, frame)?;
                frames.push((clip_index, frame_index, true_depth(clip, frame)?));
            }
        }
        if frames.is_empty() {
            let reason = "no frame shows the ball (`visible`: true)".into();
            return Err(Error::Data { what: clips.folder.display().to_string(), reason });
        }
        Ok(Self { clips, frames })
    }

    /// Number of frames.
    pub fn frame_count(&self) -> usize {
        self.frames.len()
    }

    /// Smallest, mean and largest depth, m.
    pub fn depths(&self) -> [f64; 3] {
        let depths = || self.frames.iter().map(|&(_, _, depth)| depth);
        let mean = depths().sum::<f64>() / self.frames.len() as f64;
        [depths().fold(f64::INFINITY, f64::min), mean, depths().fold(0.0, f64::max)]
    }

    /// The batch of step `step`: the same for the same seed and step, whatever came before.
    ///
    /// # Errors
    /// As [`Clips::picture`].
    pub fn batch(&self, config: &TrainConfig, phase: &Phase, step: usize) -> Result<Batch> {
        let draw = |index: usize| {
            let mut rng = StdRng::seed_from_u64(seed(config.seed, step, index));
            self.draw(config, phase, &mut rng)
        };
        let drawn: Vec<Drawn> = (0..phase.batch).into_par_iter().map(draw).collect::<Result<_>>()?;
        let [width, height] = phase.crop.map_or([config.input.width, config.input.height], |side| [side, side]);
        let mut batch = Batch {
            pictures: Vec::with_capacity(drawn.len() * 3 * (width * height) as usize),
            size: [height as usize, width as usize],
            labels: Labels { image: Vec::new(), depth: Vec::new() },
        };
        for (picture, image, depth) in drawn {
            batch.pictures.extend(picture);
            batch.labels.image.push(image);
            batch.labels.depth.push(depth);
        }
        Ok(batch)
    }

    fn draw(&self, config: &TrainConfig, phase: &Phase, rng: &mut StdRng) -> Result<Drawn> {
        let (clip, frame, depth) = self.frames[rng.random_range(0..self.frames.len())];
        let clip = &self.clips.clips[clip];
        let frame = &clip.frames[frame];
        let picture = self.clips.picture(clip, frame)?;
        let size = [config.input.width, config.input.height];
        let input = picture.network_input(size, &config.normalisation);
        let label = frame.image.unwrap_or_default(); // `Clips` refuses visible frames without one
        let scaled: [f64; 2] = std::array::from_fn(|axis| {
            let scale = f64::from(input.content[axis]) / f64::from(picture.size()[axis]);
            (label[axis] + 0.5) * scale - 0.5
        });
        let (mut values, image) = match phase.crop {
            Some(side) => {
                let corner = [0, 1].map(|axis| crop_start(scaled[axis], size[axis], side, rng));
                let part = crop(&input.values, size, corner, side);
                (part, [scaled[0] - f64::from(corner[0]), scaled[1] - f64::from(corner[1])])
            }
            None => (input.values, scaled),
        };
        jitter(&mut values, config, rng);
        Ok((values, image, depth))
    }
}

/// Refuses a 2D label so far outside the picture that no cell of the heatmap is near it.
fn check_label(clip: &Clip, frame: &Frame) -> Result<()> {
    let size = [clip.camera.width(), clip.camera.height()].map(f64::from);
    let [x, y] = frame.image.unwrap_or_default();
    let near = |at: f64, side: f64| (-LABEL_MARGIN * side..side * (1.0 + LABEL_MARGIN)).contains(&at);
    if near(x, size[0]) && near(y, size[1]) {
        return Ok(());
    }
    let reason = format!("its `image` label ({x}, {y}) lies outside the {}×{} picture", size[0], size[1]);
    Err(Error::Data { what: name(clip, frame), reason })
}

/// Name of a frame for errors.
fn name(clip: &Clip, frame: &Frame) -> String {
    format!("clip `{}`, frame {}", clip.id, frame.file.display())
}

/// Depth (camera z) of a frame's 3D label, m.
fn true_depth(clip: &Clip, frame: &Frame) -> Result<f64> {
    let what = || name(clip, frame);
    let Some(world) = frame.world else {
        let reason = "has no `world` label, which supervision \"3d-gt\" needs".into();
        return Err(Error::Data { what: what(), reason });
    };
    let depth = clip.camera.camera_from_world(&world.into()).z;
    if depth > 0.0 {
        return Ok(depth);
    }
    Err(Error::Data { what: what(), reason: format!("its `world` label lies behind the camera (z = {depth} m)") })
}

/// One number of three, by SplitMix64's finaliser, so that neighbouring steps share nothing.
fn seed(seed: u64, step: usize, index: usize) -> u64 {
    [step as u64, index as u64].into_iter().fold(seed, |mixed, part| {
        let mut z = (mixed ^ part).wrapping_add(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    })
}

/// A random start on the grid such that `[start, start + side)` holds `centre` and lies in `0..size`.
fn crop_start(centre: f64, size: u32, side: u32, rng: &mut StdRng) -> u32 {
    let holds = |start: u32| (f64::from(start)..f64::from(start + side)).contains(&(centre + 0.5));
    let starts: Vec<u32> = (0..=size - side).step_by(CROP_GRID as usize).filter(|&start| holds(start)).collect();
    match starts.len() {
        // A label outside the picture, or between the grid's last start and the edge.
        0 => (centre - f64::from(side) / 2.0).clamp(0.0, f64::from(size - side)) as u32,
        count => starts[rng.random_range(0..count)],
    }
}

/// The square part of `[height, width, 3]` values at `corner`.
fn crop(values: &[f32], [width, _]: [u32; 2], [left, top]: [u32; 2], side: u32) -> Vec<f32> {
    let [width, left, top, side] = [width, left, top, side].map(|number| number as usize);
    let rows = values.chunks_exact(3 * width).skip(top).take(side);
    rows.flat_map(|row| &row[3 * left..3 * (left + side)]).copied().collect()
}

/// Random contrast and brightness of the picture, random noise of every pixel.
fn jitter(values: &mut [f32], config: &TrainConfig, rng: &mut StdRng) {
    let mut within = |range: f32| if range > 0.0 { rng.random_range(-range..range) } else { 0.0 };
    let (gain, offset) = (1.0 + within(config.jitter), within(config.jitter));
    for value in values {
        *value = *value * gain + offset + within(config.noise);
    }
}
