//! `clips.jsonl`: reading, checking and writing.

use std::path::{Component, Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use gravisight_geometry::camera::Camera;
use gravisight_geometry::error::{Error, Result, json_refusal};
use gravisight_geometry::files::{read_text, write_whole};
use gravisight_geometry::image::Picture;
use gravisight_physics::Scene;

/// Name of the index in a clips folder.
const INDEX: &str = "clips.jsonl";
/// Broken clips that are named one by one.
const SHOWN: usize = 10;

/// A folder of clips.
///
/// ```no_run
/// # mod gravisight { pub use gravisight_clips::*; pub use gravisight_geometry::error::*; }
/// # fn main() -> gravisight::Result<()> {
/// use gravisight::Clips;
///
/// let clips = Clips::read("clips/train".as_ref())?;
/// for clip in &clips.clips {
///     let labelled = clip.frames.iter().filter(|frame| frame.image.is_some()).count();
///     println!("{}: {labelled} of {} frames have a label", clip.id, clip.frames.len());
/// }
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone)]
pub struct Clips {
    /// The folder.
    pub folder: PathBuf,
    /// Its clips, in the file's order.
    pub clips: Vec<Clip>,
}

/// Consecutive frames of one camera.
#[derive(Debug, Clone, Serialize)]
pub struct Clip {
    /// Name, e.g. `train/env1/cam1/0007`.
    pub id: String,
    /// Frames a second.
    pub fps: f64,
    /// The camera that took it.
    pub camera: Camera,
    /// The place and its ball.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scene: Option<Scene>,
    /// The frames.
    pub frames: Vec<Frame>,
}

/// One picture of a clip and its labels.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Frame {
    /// Picture file, relative to the folder.
    pub file: PathBuf,
    /// Time, s.
    pub t: f64,
    /// 2D label, px.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub image: Option<[f64; 2]>,
    /// Whether any of the ball is seen.
    pub visible: bool,
    /// 3D truth in the world frame, m: for evaluation, and for training only with 3D labels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub world: Option<[f64; 3]>,
}

/// A line of the file without its `camera` and `scene`, which may be objects or paths.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ClipLine {
    id: String,
    fps: f64,
    frames: Vec<Frame>,
}

/// What the file is, for who gave another.
const EXPECTED: &str = "clips.jsonl has one clip per line, a JSON object with id, fps, camera and frames; `gravisight import`, `label` and \
                        `synth` write it";

impl Clips {
    /// Reads `folder/clips.jsonl`. Pictures are read later, one by one.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] and [`Error::Value`] with the line; [`Error::Data`] for an
    /// empty file.
    pub fn read(folder: &Path) -> Result<Self> {
        let index = folder.join(INDEX);
        let text = read_text(&index).map_err(|error| error.expecting(EXPECTED))?;
        let (mut clips, mut refused) = (Vec::new(), Vec::new());
        for (number, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
            let what = format!("{}:{}", index.display(), number + 1);
            match Clip::from_line(line, folder, &what) {
                Ok(clip) => clips.push(clip),
                Err(error) => refused.push(error),
            }
        }
        match refused.len() {
            0 => {}
            1 => return Err(refused.remove(0).expecting(EXPECTED)),
            count => {
                let all = clips.len() + count;
                let shown: String = refused.iter().take(SHOWN).map(|error| format!("\n  {error}")).collect();
                let more = if count > SHOWN { format!("\n  and {} more", count - SHOWN) } else { String::new() };
                // Where none can be read, it is another file.
                let expected = if count == all { format!("\n{EXPECTED}") } else { String::new() };
                let reason = format!("{count} of its {all} clips cannot be read:{shown}{more}{expected}");
                return Err(Error::Data { what: index.display().to_string(), reason });
            }
        }
        if clips.is_empty() {
            return Err(Error::Data { what: index.display().to_string(), reason: "holds no clips".into() });
        }
        Ok(Self { folder: folder.to_path_buf(), clips })
    }

    /// Writes `folder/clips.jsonl`, whole. Pictures are there already.
    ///
    /// # Errors
    /// As [`Clip::to_line`]; [`Error::Io`].
    #[cfg(not(target_arch = "wasm32"))]
    pub fn write_index(&self) -> Result<()> {
        let mut text = String::new();
        for clip in &self.clips {
            text.push_str(&clip.to_line()?);
            text.push('\n');
        }
        write_whole(&self.folder.join(INDEX), text.as_bytes())
    }

    /// The picture of `frame`, checked to have the camera's size.
    ///
    /// # Errors
    /// [`Error::Io`] and [`Error::Data`] with the path: for a picture that [`Picture::open`] refuses; as
    /// [`Clip::check_picture`].
    pub fn picture(&self, clip: &Clip, frame: &Frame) -> Result<Picture> {
        let path = self.folder.join(&frame.file);
        let what = path.display().to_string();
        let picture = Picture::open(&path).map_err(|error| match error {
            io @ Error::Io { .. } => io,
            other => Error::Data { what: what.clone(), reason: other.to_string() },
        })?;
        clip.check_picture(&picture, &what)?;
        Ok(picture)
    }
}

impl Clip {
    /// Refuses a picture of another size than the camera's, since labels in it would be wrong; `what` names it.
    ///
    /// # Errors
    /// [`Error::Data`].
    pub fn check_picture(&self, picture: &Picture, what: &str) -> Result<()> {
        let (found, expected) = (picture.size(), self.camera.size());
        if found == expected {
            return Ok(());
        }
        let reason = format!("is {found} px, but the camera of clip `{}` is for {expected} px", self.id);
        Err(Error::Data { what: what.into(), reason })
    }

    /// Refuses pictures that are not one a frame, each of the camera's size.
    ///
    /// # Errors
    /// [`Error::Data`].
    pub fn check_pictures(&self, pictures: &[Picture]) -> Result<()> {
        if pictures.len() != self.frames.len() {
            let reason = format!("has {} frames but {} pictures", self.frames.len(), pictures.len());
            return Err(Error::Data { what: format!("clip `{}`", self.id), reason });
        }
        let mut named = self.frames.iter().zip(pictures);
        named.try_for_each(|(frame, picture)| self.check_picture(picture, &frame.file.display().to_string()))
    }

    /// Reads a clip from the text of its line in `clips.jsonl`, camera and scene inside; `what` names it in errors.
    ///
    /// # Errors
    /// [`Error::Format`] and [`Error::Value`] with the field.
    pub fn from_json(text: &str, what: &str) -> Result<Self> {
        Self::from_line(text, Path::new(""), what)
    }

    /// Its line in `clips.jsonl`, with camera and scene inside.
    ///
    /// # Errors
    /// [`Error::Format`]; [`Error::Value`] where a number is outside its range.
    pub fn to_line(&self) -> Result<String> {
        self.check(&format!("clip `{}`", self.id))?;
        serde_json::to_string(self).map_err(Error::format(&self.id))
    }

    fn from_line(line: &str, folder: &Path, what: &str) -> Result<Self> {
        let mut fields: serde_json::Map<String, Value> =
            serde_json::from_str(line).map_err(|error| Error::format(what)(json_refusal(&error)))?;
        let missing = || Error::Format { what: what.into(), message: "missing field `camera`".into() };
        let (camera, where_from) = inlined(fields.remove("camera").ok_or_else(missing)?, folder, what, "camera")?;
        let scene = fields.remove("scene").map(|scene| -> Result<Scene> {
            let (scene, where_from) = inlined(scene, folder, what, "scene")?;
            Scene::from_json(&scene.to_string(), &where_from)
        });
        let line: ClipLine = serde_json::from_value(Value::Object(fields)).map_err(Error::format(what))?;
        let clip = Self {
            id: line.id,
            fps: line.fps,
            camera: Camera::from_json(&camera.to_string(), &where_from)?,
            scene: scene.transpose()?,
            frames: line.frames,
        };
        clip.check(what)?;
        Ok(clip)
    }

    fn check(&self, what: &str) -> Result<()> {
        if !(self.fps.is_finite() && self.fps > 0.0) {
            return Err(Error::value(what, "fps", format!("must be positive, not {}", self.fps)));
        }
        let mut before = f64::NEG_INFINITY;
        for (index, frame) in self.frames.iter().enumerate() {
            let refuse =
                |field: &str, reason: String| Err(Error::value(what, format!("frames[{index}].{field}"), reason));
            if frame.visible && frame.image.is_none() {
                return refuse("image", "is missing though `visible` is true".into());
            }
            if !(frame.t.is_finite() && frame.t > before) {
                return refuse("t", format!("must increase from frame to frame; here it is {}", frame.t));
            }
            before = frame.t;
            if !frame.file.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir)) {
                let file = frame.file.display();
                return refuse("file", format!("must be a path within the clips' folder, without `..`, not `{file}`"));
            }
            if frame.image.is_some_and(|image| image.iter().any(|value| !value.is_finite())) {
                return refuse("image", "must be finite".into());
            }
            if frame.world.is_some_and(|world| world.iter().any(|value| !value.is_finite())) {
                return refuse("world", "must be finite".into());
            }
        }
        Ok(())
    }
}

/// The object itself, or the one in the file it names (relative to `folder`); and its name for errors.
fn inlined(value: Value, folder: &Path, what: &str, field: &str) -> Result<(Value, String)> {
    let Value::String(path) = value else { return Ok((value, format!("{what}: {field}"))) };
    let path = folder.join(path);
    let text = read_text(&path)?;
    let name = path.display().to_string();
    Ok((serde_json::from_str(&text).map_err(Error::format(&name))?, name))
}
