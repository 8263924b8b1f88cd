//! What there is to learn: from clips to frames with their targets (`prepare`, by physics: `teacher`, kept in `fits`), and
//! from those to batches (`sampler`, ahead of time: `loader`).

mod augment;
mod batch;
mod candidates;
#[cfg(not(target_arch = "wasm32"))]
mod fits;
#[cfg(not(target_arch = "wasm32"))]
mod label_mistakes;
#[cfg(not(target_arch = "wasm32"))]
mod loader;
mod photographs;
mod pictures;
#[cfg(not(target_arch = "wasm32"))]
mod prepare;
mod renderings;
mod sampler;
#[cfg(not(target_arch = "wasm32"))]
mod source;
mod stacks;
mod teacher;
#[cfg(test)]
mod tests;

pub use self::batch::{Batch, FrameId, Labels, PictureTransform, Start, Target, Window};
pub(super) use self::candidates::{CROP_RADII, CandidateCrops, LabelledCrop, jittered};
#[cfg(not(target_arch = "wasm32"))]
pub(super) use self::fits::Fits;
#[cfg(not(target_arch = "wasm32"))]
pub(super) use self::loader::Loader;
pub use self::photographs::Photographs;
#[cfg(not(target_arch = "wasm32"))]
pub use self::photographs::read_photographs;
pub(super) use self::pictures::Pictures;
#[cfg(not(target_arch = "wasm32"))]
pub use self::prepare::LeftOut;
#[cfg(not(target_arch = "wasm32"))]
pub(super) use self::prepare::{Prepared, prepare};
pub(super) use self::renderings::Renderings;
pub(super) use self::sampler::Sampler;
#[cfg(not(target_arch = "wasm32"))]
pub(super) use self::source::Source;
pub(super) use self::stacks::{Stacks, stack_record};
pub(super) use self::teacher::{TaughtClip, teach};
use super::recipe::{Recipe, Velocity};
use gravisight_clips::{Clip, Clips, Frame};
use gravisight_geometry::error::{Error, Result};

/// Fraction of the picture's side by which a label may lie outside (a ball cut by the edge).
const LABEL_MARGIN: f64 = 0.05;

/// Fewest frames around one that tell its velocity.
const FEWEST_AROUND: usize = 3;

/// A frame and what it teaches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Example {
    /// Index of the clip.
    pub clip: usize,
    /// Index of the frame in it.
    pub frame: usize,
    /// 2D target, px of the clip's picture.
    pub image: [f64; 2],
    /// Depth target (camera z), m, and its weight from 0 to 1; none where forecasts teach.
    pub depth: Option<[f64; 2]>,
}

/// All that a run learns from.
#[derive(Debug, Clone)]
pub struct Examples {
    /// The clips, as the recipe changes them.
    pub clips: Clips,
    /// Frames with targets.
    pub frames: Vec<Example>,
    /// For each frame of each clip the number of its example.
    of_frame: Vec<Vec<Option<usize>>>,
}

impl Examples {
    /// Those of `clips` (as the recipe changes them) that were fitted already: `fits`, one a clip.
    ///
    /// # Errors
    /// [`Error::Data`] where nothing is left.
    pub fn of_fits(recipe: &Recipe, clips: Clips, fits: Vec<TaughtClip>) -> Result<Self> {
        let chosen: Vec<usize> = (0..clips.clips.len()).collect();
        Self::new(recipe, clips, examples_of(&chosen, &fits, recipe))
    }

    /// Those of `clips` (as the recipe changes them) where forecasts teach: frames with 2D labels.
    ///
    /// # Errors
    /// [`Error::Data`] where no forecast starts.
    pub fn of_labels(recipe: &Recipe, clips: Clips) -> Result<Self> {
        let frames = labelled_2d(&clips);
        Self::new(recipe, clips, frames)
    }

    pub(super) fn new(recipe: &Recipe, clips: Clips, frames: Vec<Example>) -> Result<Self> {
        let mut of_frame: Vec<Vec<Option<usize>>> =
            clips.clips.iter().map(|clip| vec![None; clip.frames.len()]).collect();
        for (index, example) in frames.iter().enumerate() {
            of_frame[example.clip][example.frame] = Some(index);
        }
        let what = clips.folder.display().to_string();
        let refuse = |reason: String| Err(Error::Data { what: what.clone(), reason });
        if frames.is_empty() {
            return refuse("no frame shows the ball (`visible`: true)".into());
        }
        let examples = Self { clips, frames, of_frame };
        if recipe.supervision.is_future() && examples.windows(recipe).is_empty() {
            let longest = match recipe.future.velocity {
                Velocity::Pictures => {
                    recipe.future.sequence.unwrap_or(recipe.future.ahead.iter().max().unwrap_or(&0) + 2)
                }
                Velocity::Labels => recipe.future.ahead.iter().min().unwrap_or(&0).max(&FEWEST_AROUND) + 1,
            };
            return refuse(format!(
                "no clip shows the ball in a window of {longest} frames; take shorter `future.ahead`, or longer clips"
            ));
        }
        Ok(examples)
    }

    /// The example of a frame.
    pub fn example(&self, clip: usize, frame: usize) -> Option<&Example> {
        self.frames.get((*self.of_frame.get(clip)?.get(frame)?)?)
    }

    /// Frames (clip, frame) that forecasts start from: those that have their neighbours and all frames ahead; where 2D
    /// positions tell the velocity, those that have enough of them, and one to be met. Where sequences are drawn, their first frames.
    pub fn windows(&self, recipe: &Recipe) -> Vec<(usize, usize)> {
        let ahead = &recipe.future.ahead;
        let has = |clip: usize, frame: usize| self.example(clip, frame).is_some();
        let whole = |&(clip, frame): &(usize, usize)| match recipe.future.velocity {
            Velocity::Pictures => {
                frame > 0
                    && has(clip, frame - 1)
                    && has(clip, frame + 1)
                    && ahead.iter().all(|by| has(clip, frame + by))
            }
            Velocity::Labels => {
                self.around(clip, frame, recipe.future.around).len() > FEWEST_AROUND
                    && !self.before_and_ahead(clip, frame, ahead).is_empty()
            }
        };
        let all = self.frames.iter().map(|example| (example.clip, example.frame));
        match recipe.future.sequence.filter(|_| recipe.future.velocity == Velocity::Pictures) {
            Some(length) => {
                all.filter(|&(clip, first)| (first..first + length).all(|frame| has(clip, frame))).collect()
            }
            None => all.filter(whole).collect(),
        }
    }

    /// Frames of `clip` with a 2D target that are at most `reach` from `frame`, itself included, in order.
    pub(super) fn around(&self, clip: usize, frame: usize, reach: usize) -> Vec<usize> {
        let near = frame.saturating_sub(reach)..=frame + reach;
        near.filter(|&frame| self.example(clip, frame).is_some()).collect()
    }

    /// Frames of `clip` with a 2D target that are one of `ahead` before or after `frame`.
    pub(super) fn before_and_ahead(&self, clip: usize, frame: usize, ahead: &[usize]) -> Vec<usize> {
        let both = ahead.iter().flat_map(|&by| [frame.checked_sub(by), Some(frame + by)]).flatten();
        both.filter(|&frame| self.example(clip, frame).is_some()).collect()
    }

    /// Memory that the pictures of all frames with targets take, and the empty scenes of all clips, bytes: as they are, not as
    /// the network sees them.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn picture_bytes(&self) -> [usize; 2] {
        let bytes = |clip: &Clip| 3 * clip.camera.size().pixels();
        let clips = &self.clips.clips;
        let frames = self.frames.iter().map(|example| bytes(&clips[example.clip])).sum();
        [frames, clips.iter().map(bytes).sum()]
    }

    /// Whether it teaches depths, which forecasts do not name.
    pub fn names_depths(&self) -> bool {
        self.frames.iter().any(|example| example.depth.is_some())
    }

    /// Smallest, mean and largest depth, m: of the depth targets; where forecasts teach, the distances between the
    /// cameras and the origin of their scenes, the only scale that is known beforehand.
    pub fn depths(&self) -> [f64; 3] {
        let taught: Vec<f64> = self.frames.iter().filter_map(|example| Some(example.depth?[0])).collect();
        let depths = match taught.is_empty() {
            true => self.clips.clips.iter().map(distance_of_scene).collect(),
            false => taught,
        };
        let mean = depths.iter().sum::<f64>() / depths.len() as f64;
        [depths.iter().copied().fold(f64::INFINITY, f64::min), mean, depths.iter().copied().fold(0.0, f64::max)]
    }
}

/// What `fits` teach, one each of the clips `chosen`.
pub(super) fn examples_of(chosen: &[usize], fits: &[TaughtClip], recipe: &Recipe) -> Vec<Example> {
    let mut examples = Vec::new();
    for (&clip, fit) in chosen.iter().zip(fits) {
        for (frame, taught) in fit.frames.iter().enumerate() {
            let Some(taught) = taught else { continue };
            let weight = 1.0 / (1.0 + (taught.sigma / recipe.fit.half_weight_sigma).powi(2));
            examples.push(Example { clip, frame, image: taught.image, depth: Some([taught.depth, weight]) });
        }
    }
    examples
}

/// Frames with 2D labels.
pub(super) fn labelled_2d(clips: &Clips) -> Vec<Example> {
    let frames = clips.clips.iter().enumerate().flat_map(|(clip, it)| {
        let labelled = it.frames.iter().enumerate().filter(|(_, frame)| frame.visible);
        labelled.filter_map(move |(frame, it)| Some(Example { clip, frame, image: it.image?, depth: None }))
    });
    frames.collect()
}

/// How far the camera is from its scene's origin along its axis, m: about as far as from the ball, before anything is learned.
pub(super) fn distance_of_scene(clip: &Clip) -> f64 {
    clip.camera.camera_from_world(&nalgebra::Point3::origin()).z.abs().max(0.1)
}

/// Refuses clips whose scenes say nothing of depth.
pub(super) fn check_physics(clips: &[Clip]) -> Result<()> {
    for clip in clips {
        let refuse = |reason: &str| Err(Error::Data { what: format!("clip `{}`", clip.id), reason: reason.into() });
        match &clip.scene {
            None => return refuse("has no `scene`; give it one, or train with supervision \"3d-gt\""),
            Some(scene) if scene.gravity == [0.0; 3] && scene.spring.is_none() => {
                return refuse(
                    "has a scene without gravity or spring, so 2D labels do not determine the depth; add one of them, \
                     or train with supervision \"3d-gt\"",
                );
            }
            Some(_) => {}
        }
    }
    Ok(())
}

/// Refuses a 2D label so far outside the picture that no cell of the heatmap is near it.
pub(super) fn check_label(clip: &Clip, frame: &Frame) -> Result<()> {
    let Some([x, y]) = frame.image.filter(|_| frame.visible) else { return Ok(()) };
    let size = clip.camera.size().xy();
    let near = |at: f64, side: f64| (-LABEL_MARGIN * side..side * (1.0 + LABEL_MARGIN)).contains(&at);
    if near(x, size[0]) && near(y, size[1]) {
        return Ok(());
    }
    let reason = format!("its `image` label ({x}, {y}) lies outside the {}×{} picture", size[0], size[1]);
    Err(Error::Data { what: name(clip, frame), reason })
}

/// Name of a frame for errors.
pub(super) fn name(clip: &Clip, frame: &Frame) -> String {
    format!("clip `{}`, frame {}", clip.id, frame.file.display())
}

/// Where a frame's 3D label is, camera coordinates, m.
///
/// # Errors
/// [`Error::Data`] for a frame without one, or with one that lies behind the camera.
fn true_point(clip: &Clip, frame: &Frame) -> Result<nalgebra::Point3<f64>> {
    let what = || name(clip, frame);
    let Some(world) = frame.world else {
        let reason = "has no `world` label, which 3D supervision needs".into();
        return Err(Error::Data { what: what(), reason });
    };
    let point = clip.camera.camera_from_world(&world.into());
    if point.z > 0.0 {
        return Ok(point);
    }
    Err(Error::Data { what: what(), reason: format!("its `world` label lies behind the camera (z = {} m)", point.z) })
}
