//! `gravisight label`.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::export::{cvat_xml, labels_csv, track_of_labels};
use crate::footage::note_left_out;
use crate::import::{pictures_in, video_frames};
use anyhow::{Context, Result, bail, ensure};
use clap::{Args, ValueEnum};
use gravisight::internal::{NewFolder, write_whole};
use gravisight::parts::Proposal;
use gravisight::{Camera, Clip, Clips, Frame, LabelOptions, Picture, Scene, propose_labels};
use serde_json::json;

use super::print_line;
use crate::progress::Progress;

/// Propose the ball's 2D label in every frame, for correction by hand.
#[derive(Args)]
pub struct Arguments {
    /// A clips folder (labels in it are not read), a folder of frames (in the order of their numbers), or a video (needs ffmpeg).
    #[arg(value_name = "DIR|VIDEO")]
    input: PathBuf,
    /// New folder for the labelled clips.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// The camera that took the frames (camera.json); a clips folder has its own.
    #[arg(long, value_name = "CAMERA.JSON")]
    camera: Option<PathBuf>,
    /// Frames a second [default: the video's].
    #[arg(long, value_name = "F")]
    fps: Option<f64>,
    /// The place and its ball (scene.json), to stand in the clip.
    #[arg(long, value_name = "SCENE.JSON")]
    scene: Option<PathBuf>,
    /// Smallest and largest radius of the ball in the picture, px [default: 2.5 to a sixth of the shorter side].
    #[arg(long, value_name = "MIN..MAX", value_parser = radii)]
    radius_px: Option<[f64; 2]>,
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

fn radii(text: &str) -> Result<[f64; 2], String> {
    let wrong = || format!("`{text}` is not MIN..MAX, two numbers such as 4..20");
    let (least, most) = text.split_once("..").ok_or_else(wrong)?;
    let number = |text: &str| text.trim().parse::<f64>().map_err(|_| wrong());
    Ok([number(least)?, number(most)?])
}

pub fn run(arguments: Arguments) -> Result<()> {
    let folder = NewFolder::at(&arguments.out)?;
    // A video's frames lie in the output from the start, or beside what is kept.
    let unpacked = folder.path().join(".frames");
    let mut sources = sources(&arguments, &unpacked)?;
    let options = LabelOptions { radii_px: arguments.radius_px };
    let all = sources.iter().map(|source| source.pictures.len() as u64).sum();
    let (progress, done) = (Mutex::new(Progress::new()), AtomicU64::new(0));
    let mut labels = Vec::new();
    for source in &sources {
        let read = |frame: usize| open(&source.pictures[frame]);
        let observe = || {
            let done = done.fetch_add(1, Ordering::Relaxed) + 1;
            if let Ok(mut progress) = progress.lock() {
                progress.set(done, all, "frames");
            }
        };
        let proposed = propose_labels(source.pictures.len(), &source.clip.camera, &options, &read, &observe);
        labels.push(proposed.with_context(|| format!("clip `{}`", source.clip.id))?);
    }
    if let Ok(progress) = progress.into_inner() {
        progress.finish();
    }
    write(&folder, arguments.format, &mut sources, &labels)?;
    if unpacked.exists() {
        std::fs::remove_dir_all(&unpacked).with_context(|| unpacked.display().to_string())?;
    }
    folder.finish()?;
    report(&arguments, &sources, &labels)
}

/// An error that names the picture.
fn open(path: &Path) -> gravisight::Result<Picture> {
    Picture::open(path).map_err(|error| match error {
        io @ gravisight::Error::Io { .. } => io,
        other => gravisight::Error::Data { what: path.display().to_string(), reason: other.to_string() },
    })
}

/// The clips to label; a video's frames are put into `unpacked`.
fn sources(arguments: &Arguments, unpacked: &Path) -> Result<Vec<LabelSource>> {
    let input = &arguments.input;
    if input.join("clips.jsonl").is_file() {
        let own = arguments.camera.is_none() && arguments.fps.is_none() && arguments.scene.is_none();
        ensure!(own, "{} is a clips folder, which has its own --camera, --fps and --scene", input.display());
        return of_clips(Clips::read(input)?);
    }
    let Some(camera) = &arguments.camera else {
        bail!("{}: --camera camera.json is needed where there is no clips.jsonl", input.display());
    };
    let (camera, scene) = (Camera::from_file(camera)?, arguments.scene.as_deref().map(Scene::open).transpose()?);
    ensure!(arguments.fps.is_none_or(|fps| fps.is_finite() && fps > 0.0), "--fps must be positive");
    let (pictures, times, fps) = if input.is_dir() {
        let Some(fps) = arguments.fps else { bail!("{}: --fps is needed for a folder of frames", input.display()) };
        let pictures = pictures_in(input).with_context(|| "neither frames nor a clips.jsonl")?;
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

fn write(
    folder: &NewFolder,
    format: LabelFormat,
    sources: &mut [LabelSource],
    labels: &[Vec<Option<Proposal>>],
) -> Result<()> {
    let tables = folder.path().join("labels");
    std::fs::create_dir_all(&tables).with_context(|| tables.display().to_string())?;
    for (source, labels) in sources.iter_mut().zip(labels) {
        for (frame, label) in source.clip.frames.iter_mut().zip(labels) {
            (frame.image, frame.visible) = (label.map(|label| label.image), label.is_some());
        }
        let table = labels_csv(labels, &source.files())?;
        write_whole(&tables.join(format!("{}.csv", source.name)), table.as_bytes())?;
        match format {
            LabelFormat::Csv => {
                let path = folder.path().join(format!("{}.csv", source.name));
                write_whole(&path, track_of_labels(labels).to_csv()?.as_bytes())?;
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
                files.iter().zip(labels).map(move |(file, label)| (file.as_str(), size, *label))
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

fn report(arguments: &Arguments, sources: &[LabelSource], labels: &[Vec<Option<Proposal>>]) -> Result<()> {
    let counts = |labels: &[Option<Proposal>]| {
        let labelled = labels.iter().flatten().count();
        let doubtful = labels.iter().flatten().filter(|label| label.doubtful).count();
        [labels.len(), labelled, doubtful, labels.len() - labelled]
    };
    let all = labels.concat();
    if arguments.json {
        let object = |[frames, labelled, doubtful, not_seen]: [usize; 4]| json!({"frames": frames, "labelled": labelled, "doubtful": doubtful, "not_seen": not_seen});
        let clips = sources.iter().zip(labels).map(|(source, labels)| {
            let mut clip = object(counts(labels));
            clip["id"] = source.clip.id.clone().into();
            clip
        });
        let mut report = object(counts(&all));
        report["clips"] = clips.collect();
        return Ok(print_line(report)?);
    }
    let line = |name: &str, [frames, labelled, doubtful, not_seen]: [usize; 4]| {
        print_line(format_args!(
            "{name}: {frames} frames, {labelled} labelled, {doubtful} of them doubtful, not seen in {not_seen}"
        ))
    };
    if sources.len() > 1 {
        for (source, labels) in sources.iter().zip(labels) {
            line(&source.clip.id, counts(labels))?;
        }
    }
    line(&arguments.out.display().to_string(), counts(&all))?;
    Ok(())
}
