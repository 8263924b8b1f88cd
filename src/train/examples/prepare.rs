//! From a run's training clips to what they teach.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Rotation3, Unit, Vector3};
use rayon::iter::{IntoParallelRefIterator, ParallelExtend, ParallelIterator};

use super::super::recipe::{FitConfig, Recipe, Supervision};
use super::fits::Fits;
use super::label_mistakes::check_taught;
use super::{Example, Examples, TaughtClip, check_label, check_physics, examples_of, labelled_2d, teach, true_point};
use gravisight_clips::{Clip, Clips};
use gravisight_geometry::error::Result;
use gravisight_geometry::random::{Stream, normal_pair};

/// Clips that are fitted between two reports of progress.
const FITTED_TOGETHER: usize = 20;

/// What a run learns from.
pub struct Prepared {
    /// Frames with their targets.
    pub examples: Examples,
    /// Clips that physics could not explain.
    pub left_out: Vec<LeftOut>,
    /// The fits behind them, where physics teaches.
    pub fits: Option<Fits>,
}

/// A clip that physics could not explain.
#[derive(Debug, Clone, PartialEq)]
pub struct LeftOut {
    /// The clip's id.
    pub clip: String,
    /// Why, in words.
    pub reason: String,
}

/// What the clips in `folder` teach by `recipe`. Fits are taken from `file` if it holds those of
/// the same clips and settings, and are to be kept there by a run that starts; `progress` gets the number of clips fitted
/// and of all.
///
/// # Errors
/// [`Error::Data`] for labels that cannot teach (with the clip), for clips that physics cannot explain, and
/// where nothing is left; [`Error::Io`] and [`Error::Format`] for `file`.
pub fn prepare(
    recipe: &Recipe,
    folder: &Path,
    file: &Path,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Prepared> {
    let clips = prepared(recipe, folder)?;
    let (mut fits, mut left_out) = (None, vec![]);
    let mut by_physics = |wanted: &dyn Fn(usize) -> bool| -> Result<_> {
        let chosen: Vec<usize> = (0..clips.clips.len()).filter(|&clip| wanted(clip)).collect();
        let of_chosen: Vec<Clip> = chosen.iter().map(|&clip| clips.clips[clip].clone()).collect();
        let found = fitted(&of_chosen, &clips.folder, &recipe.fit, file, progress)?;
        let taught = fits.insert(found).clips()?;
        let frames = examples_of(&chosen, &taught, recipe);
        left_out.extend(taught.into_iter().filter_map(|fit| Some(LeftOut { clip: fit.id, reason: fit.left_out? })));
        Ok(frames)
    };
    let frames = match recipe.supervision {
        Supervision::Labels3d => labelled_3d(&clips, |_| true)?,
        Supervision::Future2dGt | Supervision::Future2dPredict | Supervision::Future3dGt => {
            check_physics(&clips.clips)?;
            labelled_2d(&clips)
        }
        Supervision::PhysicsFit => by_physics(&|_| true)?,
        Supervision::Rendered | Supervision::Candidates | Supervision::Motion => {
            unreachable!("renderings are no clips")
        }
        Supervision::Mixed => {
            let fraction = recipe.labelled_fraction;
            // evenly spread: the clips at which the running fraction passes a whole number
            let is_labelled = |clip: usize| ((clip + 1) as f64 * fraction).floor() > (clip as f64 * fraction).floor();
            let mut frames = by_physics(&|clip| !is_labelled(clip))?;
            frames.extend(labelled_3d(&clips, is_labelled)?);
            frames
        }
    };
    Ok(Prepared { examples: Examples::new(recipe, clips, frames)?, left_out, fits })
}

/// The training clips with what the recipe changes: fewer, noisier, with another contact model.
fn prepared(recipe: &Recipe, folder: &Path) -> Result<Clips> {
    let mut clips = Clips::read(folder)?;
    if let Some(most) = recipe.clips_per_camera {
        let mut counts: BTreeMap<String, usize> = BTreeMap::new();
        clips.clips.retain(|clip| {
            let count = counts.entry(group(clip).into()).or_default();
            *count += 1;
            *count <= most
        });
    }
    for clip in &mut clips.clips {
        clip.frames.iter().try_for_each(|frame| check_label(clip, frame))?;
        if let (Some(contact), Some(scene)) = (&recipe.contact, &mut clip.scene) {
            scene.contact = contact.clone();
            scene.check(&format!("clip `{}` with the configuration's `contact`", clip.id))?;
        }
        if recipe.label_noise_px > 0.0 {
            add_noise(clip, recipe.label_noise_px, recipe.seed);
        }
        if recipe.camera_off_degrees > 0.0 {
            let mut random = Stream::CameraError.of_named(recipe.seed, group(clip));
            let axis = Unit::new_normalize(Vector3::from_fn(|_, _| normal_pair::<f64>(&mut random)[0]));
            let rotation = Rotation3::from_axis_angle(&axis, recipe.camera_off_degrees.to_radians());
            clip.camera = clip.camera.turned(&rotation);
        }
    }
    Ok(clips)
}

/// What a clip's id names before its number: its camera and environment.
fn group(clip: &Clip) -> &str {
    clip.id.rsplit_once('/').map_or("", |(group, _)| group)
}

/// Adds Gaussian noise to the clip's 2D labels: the same for the same seed and clip.
fn add_noise(clip: &mut Clip, sigma: f64, seed: u64) {
    let mut random = Stream::LabelNoise.of_named(seed, &clip.id);
    for frame in &mut clip.frames {
        let [right, down]: [f64; 2] = normal_pair(&mut random);
        frame.image = frame.image.map(|[x, y]| [x + sigma * right, y + sigma * down]);
    }
}

/// Frames whose 3D truth teaches, hidden balls included; in the clips that `wanted` names.
fn labelled_3d(clips: &Clips, wanted: impl Fn(usize) -> bool) -> Result<Vec<Example>> {
    let mut examples = Vec::new();
    for (index, clip) in clips.clips.iter().enumerate().filter(|&(index, _)| wanted(index)) {
        for (number, frame) in clip.frames.iter().enumerate() {
            if let Some(image) = frame.image.filter(|_| frame.visible || frame.world.is_some()) {
                let depth = Some([true_point(clip, frame)?.z, 1.0]);
                examples.push(Example { clip: index, frame: number, image, depth });
            }
        }
    }
    Ok(examples)
}

/// What physics says of `clips`, which come from `folder`: kept in `file`, or found now.
fn fitted(
    clips: &[Clip],
    folder: &Path,
    config: &FitConfig,
    file: &Path,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Fits> {
    check_physics(clips)?;
    if let Some(kept) = Fits::read(file, clips, config)? {
        return Ok(kept);
    }
    let mut fits: Vec<TaughtClip> = Vec::new();
    for some in clips.chunks(FITTED_TOGETHER) {
        fits.par_extend(some.par_iter().map(|clip| teach(clip, config)));
        progress(fits.len(), clips.len());
    }
    check_taught(clips, &fits, config, &folder.display().to_string())?;
    Fits::new(clips, config, &fits)
}
