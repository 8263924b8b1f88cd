//! Drawing batches: which frames, which part of them, with which labels.

use std::ops::Range;
use std::sync::Arc;

use nalgebra::{Matrix2, Vector2};
use rand::RngExt;
use rayon::iter::{IntoParallelRefIterator, ParallelIterator};

use super::super::recipe::{Phase, Recipe, STARTS, Supervision, Velocity};
use super::augment::{AugmentedView, CropGrid, change_light};
use super::teacher::{forecaster, scene_of};
use super::{
    Batch, Example, Examples, Labels, PictureTransform, Pictures, Start, Target, Window, distance_of_scene, true_point,
};
use gravisight_clips::Clip;
use gravisight_geometry::camera::Outline;
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::image::{NetworkInput, tile};
use gravisight_geometry::random::{Random, Stream, mixed};
use gravisight_geometry::size::Size;
use gravisight_physics::{Forecaster, Scene};

/// Radii, px, at which a network that reads sizes sees a ball again, and the largest enlargement for that.
const AGAIN: Range<f64> = 18.0..28.0;
const MOST_ENLARGED: f64 = 6.0;

/// Nearest that a ball is taken to be where nothing is known of its distance, radii.
const NEAREST: f64 = 4.0;

/// Draws batches.
pub struct Sampler {
    recipe: Recipe,
    examples: Examples,
    pictures: Pictures,
    /// Where forecasts teach: middles of windows, or the first frames of sequences; clip and frame.
    windows: Vec<(usize, usize)>,
    /// One a clip, likewise, with everything and with nothing to touch.
    forecasters: Vec<[Arc<Forecaster>; 2]>,
    /// Whether it is apparent radii that are learned.
    reads_size: bool,
    /// Grid of crops, px.
    grid: u32,
}

/// One picture to be drawn.
#[derive(Debug, Clone, Copy)]
struct SampledFrame {
    clip: usize,
    /// None for the empty scene.
    frame: Option<usize>,
    seed: u64,
}

/// A window in a batch.
#[derive(Debug)]
struct Opened {
    /// Its first picture.
    first: usize,
    clip: usize,
    /// Its middle frame.
    middle: usize,
    /// Frames that forecasts meet, and their pictures; where 2D positions tell the velocity these need none.
    ahead: Vec<(usize, usize)>,
}

/// One picture of a batch.
struct Drawn {
    /// `[height, width, 3]`.
    values: Vec<f32>,
    /// 2D target, px of the drawn picture.
    image: Option<[f64; 2]>,
    depth: [f64; 2],
    transform: PictureTransform,
}

impl Sampler {
    /// Of `examples`, whose clips' pictures are `pictures`.
    ///
    /// # Errors
    /// [`Error::Value`] for scenes that cannot be forecast; [`Error::Data`] for a clip without one, where forecasts teach.
    pub fn new(recipe: &Recipe, examples: Examples, pictures: Pictures) -> Result<Self> {
        let (mut windows, mut forecasters) = (vec![], vec![]);
        if recipe.supervision.is_future() {
            windows = examples.windows(recipe);
            for clip in &examples.clips.clips {
                let scene = scene_of(clip)?;
                if let Some(law) = recipe.future.learn.iter().find(|law| !law.is_of(scene)) {
                    let reason = format!("its scene has no {} that could be learned (`future.learn`)", law.name());
                    return Err(Error::Data { what: format!("clip `{}`", clip.id), reason });
                }
                let [scene, free] =
                    [scene, &in_free_flight(scene)].map(|scene| forecaster(scene, recipe.future.numeric));
                forecasters.push([Arc::new(scene?), Arc::new(free?)]);
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

    /// The clips' pictures.
    pub fn pictures(&self) -> &Pictures {
        &self.pictures
    }

    /// The batch of step `step`: the same for the same seed and step, whatever came before.
    ///
    /// # Errors
    /// As [`Clips::picture`](gravisight_clips::Clips::picture).
    pub fn batch(&self, phase: &Phase, step: usize) -> Result<Batch> {
        let (shots, opened) = self.shots(phase, step);
        let drawn: Vec<Drawn> = shots.par_iter().map(|shot| self.draw(shot, phase)).collect::<Result<_>>()?;
        let Size { width, height } = self.crop(phase).map_or(self.recipe.input, Size::square);
        let windows = opened.iter().map(|opened| self.window(opened, &drawn)).collect::<Result<_>>()?;
        let mut batch = Batch {
            pictures: Vec::with_capacity(drawn.len() * 3 * (width * height) as usize),
            size: [height as usize, width as usize],
            channels: 3,
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

    /// What is drawn, and its windows.
    fn shots(&self, phase: &Phase, step: usize) -> (Vec<SampledFrame>, Vec<Opened>) {
        let seed = |index: usize| mixed(self.recipe.seed, step as u64, index as u64);
        let mut random = Stream::Batch.of(seed(0));
        if self.windows.is_empty() || self.recipe.future.velocity == Velocity::Labels {
            // Where forecasts teach, a frame that none starts from would only show where the ball is.
            let starts = &self.windows;
            let mut opened = Vec::new();
            let shot = |index: usize| {
                let (clip, frame) = match starts.is_empty() {
                    true => {
                        let example = self.examples.frames[random.random_range(0..self.examples.frames.len())];
                        (example.clip, example.frame)
                    }
                    false => starts[random.random_range(0..starts.len())],
                };
                let empty = random.random_bool(self.recipe.empty_fraction);
                if !starts.is_empty() && !empty {
                    opened.push(Opened { first: index, clip, middle: frame, ahead: vec![] });
                }
                SampledFrame { clip, frame: (!empty).then_some(frame), seed: seed(index) }
            };
            return ((0..phase.batch).map(shot).collect(), opened);
        }
        let ahead = &self.recipe.future.ahead;
        let (mut shots, mut opened) = (vec![], vec![]);
        let pictures = self.recipe.future.sequence.unwrap_or(STARTS + ahead.len());
        for _ in 0..(phase.batch / pictures).max(1) {
            let (clip, frame) = self.windows[random.random_range(0..self.windows.len())];
            let first = shots.len();
            let frames: Vec<usize> = match self.recipe.future.sequence {
                Some(length) => {
                    opened.extend((1..length - 1).filter_map(|middle| {
                        let within = ahead.iter().filter(|&by| middle + by < length);
                        let ahead: Vec<_> = within.map(|by| (frame + middle + by, first + middle + by)).collect();
                        let window = Opened { first: first + middle - 1, clip, middle: frame + middle, ahead };
                        (!window.ahead.is_empty()).then_some(window)
                    }));
                    (frame..frame + length).collect()
                }
                None => {
                    let pictures = ahead.iter().enumerate().map(|(index, by)| (frame + by, first + STARTS + index));
                    opened.push(Opened { first, clip, middle: frame, ahead: pictures.collect() });
                    [frame - 1, frame, frame + 1].into_iter().chain(ahead.iter().map(|by| frame + by)).collect()
                }
            };
            let seeds = (first..).map(seed);
            shots.extend(frames.iter().zip(seeds).map(|(&frame, seed)| SampledFrame {
                clip,
                frame: Some(frame),
                seed,
            }));
        }
        (shots, opened)
    }

    /// The window of pictures of `drawn`.
    fn window(&self, &Opened { first, clip, middle, ref ahead }: &Opened, drawn: &[Drawn]) -> Result<Window> {
        let frames = &self.pictures.clips()[clip].frames;
        let since = |frame: usize| frames[frame].t - frames[middle].t;
        let [forecaster, free] = &self.forecasters[clip];
        let label = |frame: usize| self.examples.example(clip, frame).map_or([0.0; 2], |example| example.image);
        let (start, ahead) = match self.recipe.future.velocity {
            Velocity::Pictures => {
                let target = |&(frame, picture): &(usize, usize)| {
                    let transform = drawn[picture].transform;
                    let target = match self.recipe.supervision {
                        Supervision::Future2dGt => Target::Label(label(frame)),
                        Supervision::Future3dGt => Target::True {
                            picture,
                            transform,
                            position: true_position(self.pictures.clips(), clip, frame)?,
                        },
                        _ => Target::Predicted { picture, transform },
                    };
                    Ok((since(frame), target))
                };
                let transforms = [0, 1, 2].map(|number| drawn[first + number].transform);
                let times = [0, 1, 2].map(|number| since(middle + number - 1));
                (Start::Pictures { transforms, times }, ahead.iter().map(target).collect::<Result<_>>()?)
            }
            Velocity::Labels => {
                let target = |frame: usize| {
                    let target = match self.recipe.supervision {
                        Supervision::Future2dGt => Target::Label(label(frame)),
                        _ => Target::Remembered([clip, frame]),
                    };
                    (since(frame), target)
                };
                let around = self.examples.around(clip, middle, self.recipe.future.around);
                let around = around.into_iter().map(target).collect();
                let frame = [clip, middle];
                let start = Start::Track { transform: drawn[first].transform, frame, around, free: free.clone() };
                let ahead = self.examples.before_and_ahead(clip, middle, &self.recipe.future.ahead);
                (start, ahead.into_iter().map(target).collect())
            }
        };
        Ok(Window {
            first,
            start,
            ball_radius: self.reads_size.then(|| forecaster.scene().ball.radius),
            since_start: since(middle) - since(0),
            camera: self.pictures.clips()[clip].camera.clone(),
            forecaster: forecaster.clone(),
            ahead,
        })
    }

    fn draw(&self, shot: &SampledFrame, phase: &Phase) -> Result<Drawn> {
        let mut random = Stream::Augmentation.of(shot.seed);
        let Some(frame) = shot.frame else {
            // a clip that has no empty scene gives one of its frames instead
            let centre = [0, 1].map(|_| random.random_range(0.0..1.0));
            let empty = self.pictures.with_empty(shot.clip, |picture| {
                let size = picture.size().xy();
                self.view(picture, [centre[0] * size[0], centre[1] * size[1]], 1.0, phase, &mut random)
            })?;
            return match empty {
                Some((values, _, transform)) => Ok(Drawn { values, image: None, depth: [1.0, 0.0], transform }),
                None => {
                    let frame = self.examples.frames.iter().find(|example| example.clip == shot.clip);
                    self.draw(&SampledFrame { frame: Some(frame.map_or(0, |example| example.frame)), ..*shot }, phase)
                }
            };
        };
        let example = self.examples.example(shot.clip, frame);
        let Some(example) = example else {
            let reason = format!("frame {frame} has no target");
            return Err(Error::Data { what: format!("clip `{}`", self.pictures.clips()[shot.clip].id), reason });
        };
        let [depth, weight] = example.depth.unwrap_or([1.0, 0.0]);
        let clip = &self.pictures.clips()[shot.clip];
        let outline = match self.reads_size {
            // Where forecasts teach, a rough size will do: how much a picture is enlarged follows it, and the outline's centre a
            // little.
            true => Some(outline(clip, example, example.depth.map_or_else(|| rough_depth(clip), |[depth, _]| depth))?),
            false => None,
        };
        let magnified = outline.as_ref().map_or(1.0, |outline| as_looked_at_again(outline, &mut random));
        let (values, image, transform) = self
            .pictures
            .with(shot.clip, frame, |picture| self.view(picture, example.image, magnified, phase, &mut random))?;
        if let Some(outline) = outline {
            let image = transform.picture_from_clip(outline.centre.into());
            return Ok(Drawn {
                values,
                image: Some(image),
                depth: [outline.radius / transform.scale(), weight],
                transform,
            });
        }
        Ok(Drawn { values, image: Some(image), depth: [depth / transform.zoom, weight], transform })
    }

    /// A random view of `picture` around `centre` (px of it), `magnified`: its values, where the centre is in it, and the way back.
    fn view(
        &self,
        picture: &gravisight_geometry::image::Picture,
        centre: [f64; 2],
        magnified: f64,
        phase: &Phase,
        random: &mut Random,
    ) -> (Vec<f32>, [f64; 2], PictureTransform) {
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
        let crop = crop.map(|side| CropGrid { side, grid: self.grid });
        let view = AugmentedView::random(size, crop, in_input, magnified, &self.recipe.augmentation, random);
        let mut values = view.cut(&input.values, size);
        change_light(&mut values, view.size, &self.recipe.augmentation, random);
        let (linear, origin) = view.to_input();
        let unscale = Matrix2::new(1.0 / scale[0], 0.0, 0.0, 1.0 / scale[1]);
        let half = Vector2::repeat(0.5);
        let transform =
            PictureTransform { linear: unscale * linear, origin: unscale * (origin + half) - half, zoom: view.zoom };
        (values, view.of_input(in_input), transform)
    }
}

/// How much larger a picture is shown: in half of the cases so much that the ball has a size at which the localiser looks at it
/// again, and not else.
fn as_looked_at_again(outline: &Outline, random: &mut Random) -> f64 {
    let (again, radius) = (random.random_bool(0.5), random.random_range(AGAIN));
    if again { (radius / outline.radius).clamp(1.0, MOST_ENLARGED) } else { 1.0 }
}

/// Where a frame's ball is, camera coordinates, m.
fn true_position(clips: &[Clip], clip: usize, frame: usize) -> Result<[f64; 3]> {
    let clip = &clips[clip];
    let frame = &clip.frames[frame];
    Ok(true_point(clip, frame)?.into())
}

/// About how far a clip's ball is, m: in sight in any case.
fn rough_depth(clip: &Clip) -> f64 {
    let radius = clip.scene.as_ref().map_or(0.0, |scene| scene.ball.radius);
    distance_of_scene(clip).max(NEAREST * radius)
}

/// `scene` with nothing in it to touch.
fn in_free_flight(scene: &Scene) -> Scene {
    Scene { floor: None, walls: vec![], boxes: vec![], ..scene.clone() }
}

/// The ball's outline in the clip's picture.
fn outline(clip: &Clip, example: &Example, depth: f64) -> Result<Outline> {
    let radius = scene_of(clip)?.ball.radius;
    let centre = clip.camera.camera_from_image(&example.image.into(), depth)?;
    clip.camera.outline(&centre, radius)
}
