//! What there is to learn: frames with their targets, and windows of frames.

use std::collections::BTreeMap;
use std::path::Path;

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use rayon::iter::{IntoParallelRefIterator, ParallelExtend, ParallelIterator};
use serde::Serialize;

use super::config::{Supervision, TrainConfig};
use super::teacher::{TaughtClip, check_taught, teach};
use crate::data::{Clip, Clips, Frame};
use crate::error::{Error, Result};
#[cfg(not(target_arch = "wasm32"))]
use crate::files::write_whole;

/// Share of the picture's side by which a label may lie outside (a ball cut by the edge).
const LABEL_MARGIN: f64 = 0.05;

/// Clips that are fitted between two reports of progress.
const FITTED_TOGETHER: usize = 20;

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

/// A clip that physics could not explain.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LeftOut {
    /// The clip's id.
    pub clip: String,
    /// Why, in words.
    pub reason: String,
}

/// All that a run learns from.
#[derive(Debug, Clone)]
pub struct Examples {
    /// The clips, as the configuration changes them.
    pub clips: Clips,
    /// Frames with targets.
    pub frames: Vec<Example>,
    /// For each frame of each clip the number of its example.
    of_frame: Vec<Vec<Option<usize>>>,
    /// Clips that physics could not explain.
    pub left_out: Vec<LeftOut>,
}

impl Examples {
    /// Those of `config`'s training clips. Fits are kept in the file `fits` and taken from it if it is there; `progress`
    /// gets the number of clips fitted and of all.
    ///
    /// # Errors
    /// [`Error::Data`] for labels that cannot teach (with the clip), for clips that physics cannot explain, and
    /// where nothing is left; [`Error::Io`] and [`Error::Format`] for `fits`.
    pub fn of(config: &TrainConfig, fits: &Path, progress: &mut dyn FnMut(usize, usize)) -> Result<Self> {
        let clips = prepared(config)?;
        let what = clips.folder.display().to_string();
        let (frames, left_out) = match config.supervision {
            Supervision::Labels3d => (labelled_3d(&clips, |_| true)?, vec![]),
            Supervision::Future2dGt | Supervision::Future2dPredict => {
                check_physics(&clips.clips)?;
                (labelled_2d(&clips), vec![])
            }
            Supervision::PhysicsFit => taught(&clips, config, fits, |_| true, progress)?,
            Supervision::Mixed => {
                let share = config.labelled_share;
                // evenly spread: the clips at which the running share passes a whole number
                let is_labelled = |clip: usize| ((clip + 1) as f64 * share).floor() > (clip as f64 * share).floor();
                let (mut frames, left_out) = taught(&clips, config, fits, |clip| !is_labelled(clip), progress)?;
                frames.extend(labelled_3d(&clips, is_labelled)?);
                (frames, left_out)
            }
        };
        let mut of_frame: Vec<Vec<Option<usize>>> =
            clips.clips.iter().map(|clip| vec![None; clip.frames.len()]).collect();
        for (index, example) in frames.iter().enumerate() {
            of_frame[example.clip][example.frame] = Some(index);
        }
        let refuse = |reason: String| Err(Error::Data { what: what.clone(), reason });
        if frames.is_empty() {
            return refuse("no frame shows the ball (`visible`: true)".into());
        }
        let examples = Self { clips, frames, of_frame, left_out };
        if config.supervision.is_future() && examples.windows(&config.future.ahead).is_empty() {
            let longest = config.future.ahead.iter().max().unwrap_or(&0) + 2;
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

    /// Middles (clip, frame) of the windows that have their neighbours and all frames `ahead`.
    pub fn windows(&self, ahead: &[usize]) -> Vec<(usize, usize)> {
        let has = |clip: usize, frame: usize| self.example(clip, frame).is_some();
        let whole = |&(clip, frame): &(usize, usize)| {
            frame > 0 && has(clip, frame - 1) && has(clip, frame + 1) && ahead.iter().all(|by| has(clip, frame + by))
        };
        self.frames.iter().map(|example| (example.clip, example.frame)).filter(whole).collect()
    }

    /// Smallest, mean and largest depth, m: of the depth targets; where forecasts teach, the distances between the
    /// cameras and the origin of their scenes, the only scale that is known beforehand.
    pub fn depths(&self) -> [f64; 3] {
        let taught: Vec<f64> = self.frames.iter().filter_map(|example| Some(example.depth?[0])).collect();
        let origin = |clip: &Clip| clip.camera.camera_from_world(&nalgebra::Point3::origin()).z.abs().max(0.1);
        let depths = match taught.is_empty() {
            true => self.clips.clips.iter().map(origin).collect(),
            false => taught,
        };
        let mean = depths.iter().sum::<f64>() / depths.len() as f64;
        [depths.iter().copied().fold(f64::INFINITY, f64::min), mean, depths.iter().copied().fold(0.0, f64::max)]
    }
}

/// The training clips with what the configuration changes: fewer, noisier, with another contact model.
fn prepared(config: &TrainConfig) -> Result<Clips> {
    let mut clips = Clips::read(&config.train)?;
    if let Some(most) = config.clips_per_camera {
        let mut counts: BTreeMap<String, usize> = BTreeMap::new();
        clips.clips.retain(|clip| {
            let group = clip.id.rsplit_once('/').map_or("", |(group, _)| group);
            let count = counts.entry(group.into()).or_default();
            *count += 1;
            *count <= most
        });
    }
    for clip in &mut clips.clips {
        clip.frames.iter().try_for_each(|frame| check_label(clip, frame))?;
        if let (Some(contact), Some(scene)) = (&config.contact, &mut clip.scene) {
            scene.contact = contact.clone();
            scene.check(&format!("clip `{}` with the configuration's `contact`", clip.id))?;
        }
        if config.label_noise_px > 0.0 {
            add_noise(clip, config.label_noise_px, config.seed);
        }
    }
    Ok(clips)
}

/// Adds Gaussian noise to the clip's 2D labels: the same for the same seed and clip.
fn add_noise(clip: &mut Clip, sigma: f64, seed: u64) {
    let name = clip.id.bytes().fold(seed, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3));
    let mut random = StdRng::seed_from_u64(name);
    for frame in &mut clip.frames {
        // Box and Muller's pair
        let radius = (-2.0 * random.random_range(f64::MIN_POSITIVE..1.0).ln()).sqrt();
        let angle = random.random_range(0.0..std::f64::consts::TAU);
        frame.image = frame.image.map(|[x, y]| [x + sigma * radius * angle.cos(), y + sigma * radius * angle.sin()]);
    }
}

/// Frames whose 3D truth teaches, hidden balls included; in the clips that `wanted` names.
fn labelled_3d(clips: &Clips, wanted: impl Fn(usize) -> bool) -> Result<Vec<Example>> {
    let mut examples = Vec::new();
    for (index, clip) in clips.clips.iter().enumerate().filter(|&(index, _)| wanted(index)) {
        for (number, frame) in clip.frames.iter().enumerate() {
            if let Some(image) = frame.image.filter(|_| frame.visible || frame.world.is_some()) {
                let depth = Some([true_depth(clip, frame)?, 1.0]);
                examples.push(Example { clip: index, frame: number, image, depth });
            }
        }
    }
    Ok(examples)
}

/// Frames with 2D labels.
fn labelled_2d(clips: &Clips) -> Vec<Example> {
    let frames = clips.clips.iter().enumerate().flat_map(|(clip, it)| {
        let labelled = it.frames.iter().enumerate().filter(|(_, frame)| frame.visible);
        labelled.filter_map(move |(frame, it)| Some(Example { clip, frame, image: it.image?, depth: None }))
    });
    frames.collect()
}

/// Frames that physics teaches, and the clips that it does not explain.
fn taught(
    clips: &Clips,
    config: &TrainConfig,
    file: &Path,
    wanted: impl Fn(usize) -> bool,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<(Vec<Example>, Vec<LeftOut>)> {
    let chosen: Vec<usize> = (0..clips.clips.len()).filter(|&clip| wanted(clip)).collect();
    let of_chosen: Vec<Clip> = chosen.iter().map(|&clip| clips.clips[clip].clone()).collect();
    check_physics(&of_chosen)?;
    let fits = match file.exists() {
        true => read_fits(file, &of_chosen)?,
        false => {
            let mut fits: Vec<TaughtClip> = Vec::new();
            for some in of_chosen.chunks(FITTED_TOGETHER) {
                fits.par_extend(some.par_iter().map(|clip| teach(clip, &config.fit)));
                progress(fits.len(), of_chosen.len());
            }
            check_taught(&of_chosen, &fits, &config.fit, &clips.folder.display().to_string())?;
            write_fits(file, &fits)?;
            fits
        }
    };
    let mut examples = Vec::new();
    for (&clip, fit) in chosen.iter().zip(&fits) {
        for (frame, taught) in fit.frames.iter().enumerate() {
            let Some(taught) = taught else { continue };
            let weight = 1.0 / (1.0 + (taught.sigma / config.fit.half_weight_sigma).powi(2));
            examples.push(Example { clip, frame, image: taught.image, depth: Some([taught.depth, weight]) });
        }
    }
    let left_out = fits.into_iter().filter_map(|fit| Some(LeftOut { clip: fit.id, reason: fit.left_out? }));
    Ok((examples, left_out.collect()))
}

fn write_fits(file: &Path, fits: &[TaughtClip]) -> Result<()> {
    let mut text = String::new();
    for fit in fits {
        text.push_str(&serde_json::to_string(fit).map_err(Error::format(file.display().to_string()))?);
        text.push('\n');
    }
    write_whole(file, text.as_bytes())
}

fn read_fits(file: &Path, clips: &[Clip]) -> Result<Vec<TaughtClip>> {
    let name = file.display().to_string();
    let text = std::fs::read_to_string(file).map_err(Error::io(file))?;
    let fits: Vec<TaughtClip> =
        text.lines().map(|line| serde_json::from_str(line).map_err(Error::format(&name))).collect::<Result<_>>()?;
    let same = |(fit, clip): (&TaughtClip, &Clip)| fit.id == clip.id && fit.frames.len() == clip.frames.len();
    if fits.len() != clips.len() || !fits.iter().zip(clips).all(same) {
        let reason = "speaks of other clips than the run's; delete it, and the clips are fitted again".into();
        return Err(Error::Data { what: name, reason });
    }
    Ok(fits)
}

/// Refuses clips whose scenes say nothing of depth.
fn check_physics(clips: &[Clip]) -> Result<()> {
    for clip in clips {
        let refuse = |reason: &str| Err(Error::Data { what: format!("clip `{}`", clip.id), reason: reason.into() });
        match &clip.scene {
            None => return refuse("has no `scene`; give it one, or train with supervision \"3d-gt\""),
            Some(scene) if scene.gravity == [0.0; 3] && scene.spring.is_none() => {
                return refuse(
                    "has a scene without gravity or spring: motion then has no scale, and 2D labels no depth",
                );
            }
            Some(_) => {}
        }
    }
    Ok(())
}

/// Refuses a 2D label so far outside the picture that no cell of the heatmap is near it.
fn check_label(clip: &Clip, frame: &Frame) -> Result<()> {
    let Some([x, y]) = frame.image.filter(|_| frame.visible) else { return Ok(()) };
    let size = [clip.camera.width(), clip.camera.height()].map(f64::from);
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
        let reason = "has no `world` label, which 3D supervision needs".into();
        return Err(Error::Data { what: what(), reason });
    };
    let depth = clip.camera.camera_from_world(&world.into()).z;
    if depth > 0.0 {
        return Ok(depth);
    }
    Err(Error::Data { what: what(), reason: format!("its `world` label lies behind the camera (z = {depth} m)") })
}
