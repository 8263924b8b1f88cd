//! `gravisight label`.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};
use clap::{Args, ValueEnum};
use gravisight::internal::{NewFolder, write_whole};
use gravisight::{Clip, Clips, Frame, Localiser, Picture, Scene, TrackedVideo, VideoTracker};
use serde_json::json;

use super::print_line;
use crate::cameras;
use crate::device::DeviceChoice;
use crate::export::{cvat_xml, is_doubtful, labels_csv};
use crate::footage::note_left_out;
use crate::import::{pictures_in, video_frames};
use crate::model;
use crate::progress::Progress;

/// Propose 2D labels of the ball in every frame, tracked as by `track`, for correction by hand.
#[derive(Args)]
pub struct Arguments {
    /// A clips folder (its labels are ignored), a folder of frames (in the order of their numbers), or a video (needs ffmpeg).
    #[arg(value_name = "DIR|VIDEO")]
    input: PathBuf,
    /// New folder for the labelled clips.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// The camera that took the frames (camera.json); not for a clips folder, which has its own.
    #[arg(long, value_name = "CAMERA.JSON")]
    camera: Option<PathBuf>,
    /// Frames per second [default: the video's].
    #[arg(long, value_name = "F")]
    fps: Option<f64>,
    /// The scene and its ball (scene.json), to store in the clip.
    #[arg(long, value_name = "SCENE.JSON")]
    scene: Option<PathBuf>,
    /// Model that detects the ball [default: the built-in `any`].
    #[arg(long, value_name = "M")]
    model: Option<PathBuf>,
    /// Device to run on.
    #[arg(long, value_enum, default_value = "auto")]
    device: DeviceChoice,
    /// What to write: a clips folder, CVAT's XML (for images, 1.1) with the pictures, or Frame,Visibility,X,Y.
    #[arg(long, value_enum, default_value = "clips")]
    format: LabelFormat,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum LabelFormat {
    Clips,
    Cvat,
    Csv,
}

/// A clip to label: its pictures are still elsewhere.
struct LabelSource {
    clip: Clip,
    /// Name of its folder and tables in the output.
    name: String,
    pictures: Vec<PathBuf>,
}

pub fn run(arguments: Arguments) -> Result<()> {
    let folder = NewFolder::at(&arguments.out)?;
    let localiser = Arc::new(model::open(arguments.model.as_deref(), &arguments.device.open()?)?);
    // A video's frames lie in the output from the start, or beside what is kept.
    let unpacked = folder.path().join(".frames");
    let mut sources = sources(&arguments, &unpacked)?;
    let all = sources.iter().map(|source| source.pictures.len()).sum::<usize>();
    let (mut progress, mut done) = (Progress::new(), 0);
    let mut labels = Vec::new();
    for source in &sources {
        let tracked = tracked(source, localiser.clone(), &mut || {
            done += 1;
            progress.set(done, all as u64, "frames");
        });
        labels.push(tracked.with_context(|| format!("clip `{}`", source.clip.id))?);
    }
    progress.finish();
    write(&folder, arguments.format, &mut sources, &labels)?;
    if unpacked.exists() {
        std::fs::remove_dir_all(&unpacked).with_context(|| unpacked.display().to_string())?;
    }
    folder.finish()?;
    report(&arguments, &sources, &labels)
}

/// The ball in the frames of a clip.
fn tracked(source: &LabelSource, localiser: Arc<Localiser>, observe: &mut dyn FnMut()) -> Result<TrackedVideo> {
    let camera = &source.clip.camera;
    let mut tracker = VideoTracker::new(localiser, Some(camera.clone()));
    for (path, frame) in source.pictures.iter().zip(&source.clip.frames) {
        let picture = Picture::open(path).with_context(|| path.display().to_string())?;
        let (size, expected) = (picture.size(), camera.size());
        ensure!(
            size == expected,
            "{}: is {size} px, but the camera is for {expected} px; give the camera of these pictures",
            path.display()
        );
        pollster::block_on(tracker.add(picture, frame.t))?;
        observe();
    }
    pollster::block_on(tracker.end())?;
    Ok(tracker.track(&[], None)?)
}

/// The clips to label; a video's frames are put into `unpacked`.
fn sources(arguments: &Arguments, unpacked: &Path) -> Result<Vec<LabelSource>> {
    let input = &arguments.input;
    if input.join("clips.jsonl").is_file() {
        let own = arguments.camera.is_none() && arguments.fps.is_none() && arguments.scene.is_none();
        ensure!(
            own,
            "{} is a clips folder, which has its own camera, frame rate and scene: leave out --camera, --fps \
                      and --scene",
            input.display()
        );
        return of_clips(Clips::read(input)?);
    }
    let Some(camera) = &arguments.camera else {
        bail!("{}: has no clips.jsonl, so --camera camera.json is needed", input.display());
    };
    let (camera, scene) = (cameras::open(camera)?, arguments.scene.as_deref().map(Scene::open).transpose()?);
    ensure!(arguments.fps.is_none_or(|fps| fps.is_finite() && fps > 0.0), "--fps must be positive");
    let (pictures, times, fps) = if input.is_dir() {
        let Some(fps) = arguments.fps else { bail!("{}: --fps is needed for a folder of frames", input.display()) };
        let pictures = pictures_in(input).with_context(|| "holds neither frames nor a clips.jsonl")?;
        note_left_out(&pictures);
        let times = (0..pictures.len()).map(|frame| frame as f64 / fps).collect();
        (pictures, times, fps)
    } else {
        ensure!(input.exists(), "{}: no such folder or video", input.display());
        let (pictures, times) = video_frames(input, arguments.fps, unpacked)?;
        let lasts = times.last().zip(times.first()).map_or(0.0, |(last, first)| last - first);
        let fps = arguments.fps.unwrap_or((times.len() as f64 - 1.0) / lasts);
        ensure!(fps.is_finite() && fps > 0.0, "{}: has no frame rate; give --fps", input.display());
        (pictures, times, fps)
    };
    let id = input.canonicalize().unwrap_or_else(|_| input.clone());
    let id = id.file_stem().map_or_else(|| "clip".into(), |name| name.to_string_lossy().into_owned());
    let clip = Clip { frames: vec![], id: id.clone(), fps, camera, scene };
    Ok(vec![LabelSource::new(clip, file_name(&id), pictures, times)])
}

fn of_clips(clips: Clips) -> Result<Vec<LabelSource>> {
    let mut names = BTreeSet::new();
    let source = |(number, clip): (usize, Clip)| {
        let mut name = file_name(&clip.id);
        if !names.insert(name.clone()) {
            name = format!("{name}_{number}");
            names.insert(name.clone());
        }
        let pictures = clip.frames.iter().map(|frame| clips.folder.join(&frame.file)).collect();
        let times = clip.frames.iter().map(|frame| frame.t).collect();
        LabelSource::new(clip, name, pictures, times)
    };
    Ok(clips.clips.into_iter().enumerate().map(source).collect())
}

impl LabelSource {
    fn new(mut clip: Clip, name: String, pictures: Vec<PathBuf>, times: Vec<f64>) -> Self {
        let file = |(number, picture): (usize, &PathBuf)| {
            let ending =
                picture.extension().map_or_else(|| "png".into(), |ending| ending.to_string_lossy().to_lowercase());
            PathBuf::from("frames").join(&name).join(format!("{number:06}.{ending}"))
        };
        let files = pictures.iter().enumerate().map(file);
        let frame = |(file, t)| Frame { file, t, image: None, visible: false, world: None };
        clip.frames = files.zip(times).map(frame).collect();
        Self { clip, name, pictures }
    }
}

/// A name that is one file's on any system.
fn file_name(id: &str) -> String {
    let plain = |c: char| if c.is_alphanumeric() || c == '-' || c == '_' { c } else { '_' };
    let name: String = id.chars().map(plain).collect();
    if name.is_empty() { "clip".into() } else { name }
}

fn write(folder: &NewFolder, format: LabelFormat, sources: &mut [LabelSource], labels: &[TrackedVideo]) -> Result<()> {
    let tables = folder.path().join("labels");
    std::fs::create_dir_all(&tables).with_context(|| tables.display().to_string())?;
    for (source, labels) in sources.iter_mut().zip(labels) {
        for (frame, label) in source.clip.frames.iter_mut().zip(&labels.frames) {
            (frame.image, frame.visible) = (label.image.map(|image| image.into()), label.image.is_some());
        }
        let table = labels_csv(&labels.frames, &source.files())?;
        write_whole(&tables.join(format!("{}.csv", source.name)), table.as_bytes())?;
        match format {
            LabelFormat::Csv => {
                let path = folder.path().join(format!("{}.csv", source.name));
                write_whole(&path, labels.track().to_csv()?.as_bytes())?;
            }
            LabelFormat::Clips | LabelFormat::Cvat => source.copy_pictures(folder.path())?,
        }
    }
    match format {
        LabelFormat::Clips => {
            let clips = sources.iter().map(|source| source.clip.clone()).collect();
            Clips { folder: folder.path().to_path_buf(), clips }.write_index()?;
        }
        LabelFormat::Cvat => {
            let files: Vec<Vec<String>> = sources.iter().map(LabelSource::files).collect();
            let pictures = sources.iter().zip(&files).zip(labels).flat_map(|((source, files), labels)| {
                let size = source.clip.camera.size();
                files.iter().zip(&labels.frames).map(move |(file, label)| (file.as_str(), size, *label))
            });
            write_whole(&folder.path().join("annotations.xml"), cvat_xml(pictures).as_bytes())?;
        }
        LabelFormat::Csv => {}
    }
    Ok(())
}

impl LabelSource {
    /// The pictures' names in the output, with `/` on any system.
    fn files(&self) -> Vec<String> {
        let name = |frame: &Frame| frame.file.iter().map(|part| part.to_string_lossy()).collect::<Vec<_>>().join("/");
        self.clip.frames.iter().map(name).collect()
    }

    fn copy_pictures(&self, folder: &Path) -> Result<()> {
        let own = folder.join("frames").join(&self.name);
        std::fs::create_dir_all(&own).with_context(|| own.display().to_string())?;
        for (frame, picture) in self.clip.frames.iter().zip(&self.pictures) {
            std::fs::copy(picture, folder.join(&frame.file)).with_context(|| picture.display().to_string())?;
        }
        Ok(())
    }
}

fn report(arguments: &Arguments, sources: &[LabelSource], labels: &[TrackedVideo]) -> Result<()> {
    let counts = |labels: &TrackedVideo| {
        let (frames, labelled) = (labels.frames.len(), labels.found());
        [frames, labelled, labels.frames.iter().filter(|label| is_doubtful(label)).count(), frames - labelled]
    };
    let all = labels.iter().map(counts).fold([0; 4], |sum, counts| [0, 1, 2, 3].map(|n| sum[n] + counts[n]));
    if arguments.json {
        let object = |[frames, labelled, doubtful, not_seen]: [usize; 4]| json!({"frames": frames, "labelled": labelled, "doubtful": doubtful, "not_seen": not_seen});
        let clips = sources.iter().zip(labels).map(|(source, labels)| {
            let mut clip = object(counts(labels));
            clip["id"] = source.clip.id.clone().into();
            clip
        });
        let mut report = object(all);
        report["clips"] = clips.collect();
        return Ok(print_line(report)?);
    }
    let line = |name: &str, [frames, labelled, doubtful, not_seen]: [usize; 4]| {
        print_line(format_args!(
            "{name}: {frames} frames, {labelled} labelled, {doubtful} of them doubtful; no ball found in {not_seen}"
        ))
    };
    if sources.len() > 1 {
        for (source, labels) in sources.iter().zip(labels) {
            line(&source.clip.id, counts(labels))?;
        }
    }
    line(&arguments.out.display().to_string(), all)?;
    Ok(())
}
