//! A clip as a reader found it, before its pictures are looked at.

use std::path::{Path, PathBuf};

use nalgebra::{Point2, distance};

use super::ball::is_nowhere;
use super::pictures::format_of;
use gravisight::internal::read;
use gravisight::{Camera, Clip, Error, Frame, Picture, Result, Scene};

/// What reads a clip; it gets the name of a folder that is not there yet, for files of its own.
pub(super) type Read = Box<dyn Fn(&Path) -> Result<Draft> + Send + Sync>;

/// A clip to be read.
pub(super) struct Job {
    /// Its name.
    pub id: String,
    /// What reads it.
    pub read: Read,
}

/// A clip without a name.
#[derive(Debug)]
pub(super) struct Draft {
    /// The camera of its pictures.
    pub camera: Camera,
    /// The place and its ball.
    pub scene: Option<Scene>,
    /// Frames a second.
    pub fps: f64,
    /// Its frames.
    pub shots: Vec<Shot>,
    /// Frames whose label is where tools put a ball that is not visible.
    pub nowhere: usize,
}

/// A frame.
#[derive(Debug, Clone)]
pub(super) struct Shot {
    /// The picture's file.
    pub picture: PathBuf,
    /// File and line that speak of it.
    pub what: String,
    /// Time, s.
    pub t: f64,
    /// 2D label, px; none where the ball is not seen.
    pub image: Option<Point2<f64>>,
    /// 3D position in the world frame, m.
    pub world: Option<[f64; 3]>,
}

impl Draft {
    /// Labels that are nowhere are taken as not visible, and counted.
    pub fn new(camera: Camera, scene: Option<Scene>, fps: f64, mut shots: Vec<Shot>) -> Self {
        let is_there = |shot: &Shot| shot.image.as_ref().is_some_and(is_nowhere);
        let nowhere = shots.iter().filter(|shot| is_there(shot)).count();
        shots.iter_mut().filter(|shot| is_there(shot)).for_each(|shot| shot.image = None);
        Self { camera, scene, fps, shots, nowhere }
    }

    /// In clips of `length` frames; the last may be shorter.
    pub fn cut(self, id: &str, length: Option<usize>) -> Vec<(String, Draft)> {
        let length = length.unwrap_or(usize::MAX);
        if self.shots.len() <= length {
            return vec![(id.to_string(), self)];
        }
        let part = |(index, shots): (usize, &[Shot])| {
            let (camera, scene) = (self.camera.clone(), self.scene.clone());
            let nowhere = if index == 0 { self.nowhere } else { 0 };
            (format!("{id}/{index:02}"), Draft { camera, scene, fps: self.fps, shots: shots.to_vec(), nowhere })
        };
        self.shots.chunks(length).enumerate().map(part).collect()
    }

    /// Distance of the 2D label from the projected 3D position of every frame that has both, px.
    pub fn reprojection_px(&self) -> impl Iterator<Item = f64> {
        self.shots.iter().filter_map(|shot| {
            let projected = self.camera.image_from_world(&shot.world?.into()).ok()?;
            Some(distance(&projected, &shot.image?))
        })
    }

    /// Copies the pictures into `folder`. The inner error refuses the clip, of which nothing is left then.
    pub fn write(&self, id: &str, folder: &Path) -> Result<Result<Clip>> {
        if let Err(refused) = self.check() {
            return Ok(Err(refused));
        }
        let own = folder.join(id);
        std::fs::create_dir_all(&own).map_err(Error::io(&own))?;
        let mut frames = Vec::with_capacity(self.shots.len());
        for (index, shot) in self.shots.iter().enumerate() {
            let (bytes, extension) = match self.picture(&shot.picture) {
                Ok(picture) => picture,
                Err(refused) => {
                    std::fs::remove_dir_all(&own).map_err(Error::io(&own))?;
                    return Ok(Err(refused));
                }
            };
            let file = PathBuf::from(format!("{id}/{index:03}.{extension}"));
            let path = folder.join(&file);
            std::fs::write(&path, bytes).map_err(Error::io(&path))?;
            let image = shot.image.map(<[f64; 2]>::from);
            frames.push(Frame { file, t: shot.t, image, visible: image.is_some(), world: shot.world });
        }
        let (camera, scene) = (self.camera.clone(), self.scene.clone());
        Ok(Ok(Clip { id: id.to_string(), fps: self.fps, camera, scene, frames }))
    }

    /// The bytes of a picture, which is whole and of the camera's size, and the extension it should have.
    fn picture(&self, path: &Path) -> Result<(Vec<u8>, &'static str)> {
        let bytes = read(path)?;
        let refuse = |reason: String| Error::Data { what: path.display().to_string(), reason };
        let extension = format_of(&bytes).ok_or_else(|| refuse("is not a PNG, JPEG or WebP picture".into()))?;
        let found = Picture::decode(&bytes).map_err(|error| refuse(error.to_string()))?.size();
        let expected = self.camera.size();
        if found != expected {
            return Err(refuse(format!(
                "is {found} px, but its camera is for {expected} px; give this picture's camera"
            )));
        }
        Ok((bytes, extension))
    }

    fn check(&self) -> Result<()> {
        let Some(first) = self.shots.first() else {
            return Err(Error::Data { what: "clip".into(), reason: "has no frames".into() });
        };
        if self.shots.iter().all(|shot| shot.image.is_none()) {
            return Err(Error::Data { what: first.what.clone(), reason: "no frame of the clip has a label".into() });
        }
        if !(self.fps.is_finite() && self.fps > 0.0) {
            return Err(Error::value(&first.what, "fps", format!("must be positive, not {}", self.fps)));
        }
        let [right, bottom] = self.camera.size().xy().map(|side| side - 0.5);
        let mut before = f64::NEG_INFINITY;
        for shot in &self.shots {
            if !(shot.t.is_finite() && shot.t > before) {
                return Err(not_growing(shot, before));
            }
            before = shot.t;
            let outside =
                |image: &Point2<f64>| !((-0.5..=right).contains(&image.x) && (-0.5..=bottom).contains(&image.y));
            if let Some(image) = shot.image.filter(outside) {
                let size = self.camera.size();
                let reason = format!("({}, {}) is outside the picture of {size} px", image.x, image.y);
                return Err(Error::value(&shot.what, "label", reason));
            }
            if shot.world.is_some_and(|world| world.iter().any(|value| !value.is_finite())) {
                return Err(Error::value(&shot.what, "position", "must be finite"));
            }
        }
        Ok(())
    }
}

/// Frames a second by the frames' times: the median step is one frame, longer steps are so many frames that lie between.
///
/// # Errors
/// [`Error::Value`] for fewer than two frames, and for times that do not grow.
pub(super) fn fps_of(shots: &[Shot]) -> Result<f64> {
    let (Some(first), Some(last)) = (shots.first(), shots.last()) else {
        return Err(Error::Data { what: "clip".into(), reason: "has no frames".into() });
    };
    if let Some([before, after]) = shots.array_windows().find(|[before, after]| after.t <= before.t) {
        return Err(not_growing(after, before.t));
    }
    let mut steps: Vec<f64> = shots.windows(2).map(|pair| pair[1].t - pair[0].t).collect();
    steps.sort_by(f64::total_cmp);
    let Some(&step) = steps.get(steps.len() / 2) else {
        return Err(Error::value(&first.what, "time", "at least two frames are needed to determine the frame rate"));
    };
    let frames: f64 = steps.iter().map(|other| (other / step).round().max(1.0)).sum();
    Ok(frames / (last.t - first.t))
}

/// Frames a second of a clip that has these of a film's frames (`fps` a second): every fifth are a fifth as many.
pub(super) fn fps_of_numbers(numbers: impl IntoIterator<Item = u64>, fps: f64) -> f64 {
    let numbers: Vec<u64> = numbers.into_iter().collect();
    let steps = numbers.windows(2).map(|pair| pair[1].abs_diff(pair[0]));
    fps / steps.fold(0, common_divisor).max(1) as f64
}

/// Greatest common divisor (Euclid's algorithm).
fn common_divisor(one: u64, other: u64) -> u64 {
    if other == 0 { one } else { common_divisor(other, one % other) }
}

fn not_growing(shot: &Shot, before: f64) -> Error {
    Error::value(&shot.what, "time", format!("must increase from frame to frame: {} s follows {before} s", shot.t))
}
