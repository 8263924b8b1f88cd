//! Drawing batches: which frames, which part of them, with which labels.

use std::sync::Arc;

use nalgebra::{Matrix2, Vector2};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use rayon::iter::{IntoParallelRefIterator, ParallelIterator};

use super::super::recipe::{Phase, Recipe, Supervision};
use super::augment::{Crop, View, change_light};
use super::teacher::{forecaster, scene_of};
use super::{Batch, Example, Examples, Labels, Pictures, Place, Target, Window};
use crate::camera::Outline;
use crate::clips::Clip;
use crate::error::{Error, Result};
use crate::image::{NetworkInput, tile};
use crate::physics::Forecaster;
use crate::size::Size;

/// Pictures of a window that the forecast starts from.
const STARTS: usize = 3;

/// Draws batches.
pub struct Sampler {
    recipe: Recipe,
    examples: Examples,
    pictures: Pictures,
    /// Middles of windows, clip and frame; where forecasts teach.
    windows: Vec<(usize, usize)>,
    /// One a clip, likewise.
    forecasters: Vec<Arc<Forecaster>>,
    /// Whether it is apparent radii that are learned.
    reads_size: bool,
    /// Grid of crops, px.
    grid: u32,
}

/// One picture to be drawn.
#[derive(Debug, Clone, Copy)]
struct Shot {
    clip: usize,
    /// None for the empty scene.
    frame: Option<usize>,
    seed: u64,
}

/// One picture of a batch.
struct Drawn {
    /// `[height, width, 3]`.
    values: Vec<f32>,
    /// 2D target, px of the drawn picture.
    image: Option<[f64; 2]>,
    depth: [f64; 2],
    place: Place,
}

impl Sampler {
    /// Of `examples`, whose clips' pictures are `pictures`.
    ///
    /// # Errors
    /// [`Error::Value`] for scenes that cannot be forecast; [`Error::Data`] for a clip without one, where forecasts teach.
    pub fn new(recipe: &Recipe, examples: Examples, pictures: Pictures) -> Result<Self> {
        let (mut windows, mut forecasters) = (vec![], vec![]);
        if recipe.supervision.is_future() {
            windows = examples.windows(&recipe.future.ahead);
            for clip in &examples.clips.clips {
                forecasters.push(Arc::new(forecaster(scene_of(clip)?, recipe.future.numeric)?));
            }
        }
        let architecture = recipe.architecture(1.0);
        let (reads_size, grid) = (architecture.depth.is_size(), architecture.input_multiple());
        Ok(Self { recipe: recipe.clone(), examples, pictures, windows, forecasters, reads_size, grid })
    }

    /// What it draws from.
    pub fn examples(&self) -> &Examples {
        &self.examples
    }

    /// The batch of step `step`: the same for the same seed and step, whatever came before.
    ///
    /// # Errors
    /// As [`Clips::picture`](crate::clips::Clips::picture).
    pub fn batch(&self, phase: &Phase, step: usize) -> Result<Batch> {
        let (shots, middles) = self.shots(phase, step);
        let drawn: Vec<Drawn> = shots.par_iter().map(|shot| self.draw(shot, phase)).collect::<Result<_>>()?;
        let Size { width, height } = self.crop(phase).map_or(self.recipe.input, Size::square);
        let windows = middles.iter().enumerate().map(|(index, &middle)| self.window(index, middle, &drawn)).collect();
        let mut batch = Batch {
            pictures: Vec::with_capacity(drawn.len() * 3 * (width * height) as usize),
            size: [height as usize, width as usize],
            labels: Labels::default(),
            windows,
        };
        for (index, picture) in drawn.into_iter().enumerate() {
            batch.pictures.extend(picture.values);
            batch.labels.picture.push(index);
            batch.labels.image.push(picture.image);
            batch.labels.depth.push(picture.depth[0]);
            batch.labels.depth_weight.push(picture.depth[1]);
        }
        Ok(batch)
    }

    /// Side of the squares that are drawn in `phase`; none for whole pictures, which have one size only where they are
    /// scaled to the network's input.
    fn crop(&self, phase: &Phase) -> Option<u32> {
        let Size { width, height } = self.recipe.input;
        phase.crop.or_else(|| self.reads_size.then(|| width.min(height)))
    }

    /// What is drawn, and the middles of its windows.
    fn shots(&self, phase: &Phase, step: usize) -> (Vec<Shot>, Vec<(usize, usize)>) {
        let seed = |index: usize| seed(self.recipe.seed, step, index);
        let mut random = StdRng::seed_from_u64(seed(usize::MAX));
        let pick = |random: &mut StdRng| self.examples.frames[random.random_range(0..self.examples.frames.len())];
        if self.windows.is_empty() {
            let shot = |index: usize| {
                let example = pick(&mut random);
                let empty = random.random_bool(self.recipe.empty_share);
                Shot { clip: example.clip, frame: (!empty).then_some(example.frame), seed: seed(index) }
            };
            return ((0..phase.batch).map(shot).collect(), vec![]);
        }
        let ahead = &self.recipe.future.ahead;
        let count = (phase.batch / (STARTS + ahead.len())).max(1);
        let middles: Vec<(usize, usize)> =
            (0..count).map(|_| self.windows[random.random_range(0..self.windows.len())]).collect();
        let frames = middles.iter().flat_map(|&(clip, middle)| {
            let starts = [middle - 1, middle, middle + 1].into_iter();
            starts.chain(ahead.iter().map(move |by| middle + by)).map(move |frame| (clip, frame))
        });
        let shots =
            frames.enumerate().map(|(index, (clip, frame))| Shot { clip, frame: Some(frame), seed: seed(index) });
        (shots.collect(), middles)
    }

    /// The `index`-th window of a batch, whose pictures are in order.
    fn window(&self, index: usize, (clip, middle): (usize, usize), drawn: &[Drawn]) -> Window {
        let ahead = &self.recipe.future.ahead;
        let first = index * (STARTS + ahead.len());
        let frames = &self.pictures.clips()[clip].frames;
        let later = ahead.iter().enumerate().map(|(number, by)| {
            let label = self.examples.example(clip, middle + by).map_or([0.0; 2], |example| example.image);
            let picture = first + STARTS + number;
            match self.recipe.supervision {
                Supervision::Future2dGt => Target::Label(label),
                _ => Target::Predicted { picture, place: drawn[picture].place },
            }
        });
        Window {
            first,
            places: [0, 1, 2].map(|number| drawn[first + number].place),
            times: [0, 1, 2].map(|number| frames[middle + number - 1].t - frames[middle].t),
            since_start: frames[middle].t - frames[0].t,
            camera: self.pictures.clips()[clip].camera.clone(),
            forecaster: self.forecasters[clip].clone(),
            ahead: ahead.iter().map(|by| frames[middle + by].t - frames[middle].t).zip(later).collect(),
        }
    }

    fn draw(&self, shot: &Shot, phase: &Phase) -> Result<Drawn> {
        let mut random = StdRng::seed_from_u64(shot.seed);
        let Some(frame) = shot.frame else {
            // a clip that has no empty scene gives one of its frames instead
            let centre = [0, 1].map(|_| random.random_range(0.0..1.0));
            let empty = self.pictures.with_empty(shot.clip, |picture| {
                let size = picture.size().xy();
                self.view(picture, [centre[0] * size[0], centre[1] * size[1]], phase, &mut random)
            })?;
            return match empty {
                Some((values, _, place)) => Ok(Drawn { values, image: None, depth: [1.0, 0.0], place }),
                None => {
                    let frame = self.examples.frames.iter().find(|example| example.clip == shot.clip);
                    self.draw(&Shot { frame: Some(frame.map_or(0, |example| example.frame)), ..*shot }, phase)
                }
            };
        };
        let example = self.examples.example(shot.clip, frame);
        let Some(example) = example else {
            let reason = format!("frame {frame} has no target");
            return Err(Error::Data { what: format!("clip `{}`", self.pictures.clips()[shot.clip].id), reason });
        };
        let (values, image, place) =
            self.pictures.with(shot.clip, frame, |picture| self.view(picture, example.image, phase, &mut random))?;
        let [depth, weight] = example.depth.unwrap_or([1.0, 0.0]);
        if self.reads_size {
            let (clip, scale) = (&self.pictures.clips()[shot.clip], place.linear.determinant().abs().sqrt());
            let outline = outline(clip, example, depth)?;
            let image = place.of_clip(outline.centre.into());
            return Ok(Drawn { values, image: Some(image), depth: [outline.radius / scale, weight], place });
        }
        Ok(Drawn { values, image: Some(image), depth: [depth / place.zoom, weight], place })
    }

    /// A random view of `picture` around `centre` (px of it): its values, where the centre is in it, and the way back.
    fn view(
        &self,
        picture: &crate::image::Picture,
        centre: [f64; 2],
        phase: &Phase,
        random: &mut StdRng,
    ) -> (Vec<f32>, [f64; 2], Place) {
        let normalisation = &self.recipe.normalisation;
        // Sizes are read at a picture's own resolution.
        let (input, content, crop) = match self.reads_size {
            true => {
                let size = picture.size();
                let values = tile(picture.rgb(), [0, 0], size, normalisation);
                (NetworkInput { values, size, content: size }, size, self.crop(phase))
            }
            false => {
                let input = picture.network_input(self.recipe.input, normalisation);
                let content = input.content;
                (input, content, phase.crop)
            }
        };
        let (content, given) = (content.xy(), picture.size().xy());
        let scale = [0, 1].map(|axis| content[axis] / given[axis]);
        let size = [input.size.width, input.size.height];
        let in_input = [0, 1].map(|axis| (centre[axis] + 0.5) * scale[axis] - 0.5);
        let crop = crop.map(|side| Crop { side, grid: self.grid });
        let view = View::random(size, crop, in_input, &self.recipe.augmentation, random);
        let mut values = view.cut(&input.values, size);
        change_light(&mut values, view.size, &self.recipe.augmentation, random);
        let (linear, origin) = view.to_input();
        let unscale = Matrix2::new(1.0 / scale[0], 0.0, 0.0, 1.0 / scale[1]);
        let half = Vector2::repeat(0.5);
        let place = Place { linear: unscale * linear, origin: unscale * (origin + half) - half, zoom: view.zoom };
        (values, view.of_input(in_input), place)
    }
}

/// The ball's outline in the clip's picture.
fn outline(clip: &Clip, example: &Example, depth: f64) -> Result<Outline> {
    let radius = scene_of(clip)?.ball.radius;
    let centre = clip.camera.camera_from_image(&example.image.into(), depth)?;
    clip.camera.outline(&centre, radius)
}

/// One number of three, by SplitMix64's finaliser, so that neighbouring steps share nothing.
pub(super) fn seed(seed: u64, step: usize, index: usize) -> u64 {
    [step as u64, index as u64].into_iter().fold(seed, |mixed, part| {
        let mut z = (mixed ^ part).wrapping_add(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    })
}
