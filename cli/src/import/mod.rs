//! Other people's formats, read into clips.
//!
//! Every reader lists its clips first, then reads them one by one: what is wrong with the whole (an
//! annotation file that cannot be parsed) fails the import, what is wrong with one clip refuses that clip.
//! Pictures are copied byte for byte.

mod ball;
mod coco;
mod cvat;
mod draft;
mod drawn;
mod label_studio;
mod labelme;
pub(crate) mod npz;
mod pictures;
mod rd;
mod sd;
mod tracknet;
mod video;
mod yolo;

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use clap::ValueEnum;
use rayon::prelude::*;

use self::draft::{Draft, Job};
pub use self::drawn::{DrawnTrack, drawn_track};
pub use self::pictures::{is_picture, left_out, pictures_in};
pub use self::video::video_frames;
use gravisight::internal::NewFolder;
use gravisight::{Camera, Clip, Clips, Error, Result, Scene};

/// Clips read before the next report of progress.
const BATCH: usize = 16;
/// Frames of a clip of the paper's real data set.
const RD_CLIP_FRAMES: usize = 16;
/// A step of more than so many frame times is a gap.
const GAP: f64 = 1.5;

/// The formats; `--help` says the first paragraph of each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// The paper's synthetic data set (synthetic_dataset/SPLIT/xmlN/cameraM/VIDEO).
    Sd,
    /// The paper's ball on a spring (ball_carousel/SPLIT/VIDEO).
    Spring,
    /// The paper's real data set (real_dataset/SPLIT/cameraN/VIDEO), true positions from its depth pictures.
    Rd,
    /// COCO annotations (JSON): first visible keypoint, else the box's centre; a clip for every folder.
    ///
    /// Keypoints count from the centre of the top left pixel, boxes from its corner.
    Coco,
    /// CVAT annotations (XML 1.1), for images or for video: points, boxes or ellipses.
    ///
    /// The label is the first point, or the shape's centre; coordinates count from the picture's corner.
    Cvat,
    /// Tracks (CSV with Frame,Visibility,X,Y) beside folders of frames of the same name, or videos.
    ///
    /// X and Y count from the centre of the top left pixel.
    Tracknet,
    /// YOLO labels (text: class, cx, cy, width, height) beside pictures, or in `labels/` for pictures in `images/`.
    ///
    /// Give the folder, or its data.yaml. The label is the box's centre; a picture without labels shows no ball.
    Yolo,
    /// LabelMe annotations (one JSON file per picture): point, circle, rectangle or polygon.
    ///
    /// Give the folder of these files, or one file. The label is the shape's centre; for a polygon, that of its bounding box.
    Labelme,
    /// Label Studio's export (JSON): keypoints, rectangles, ellipses, or rectangles in a video.
    ///
    /// The label is the shape's centre; coordinates are in per cent of the picture.
    LabelStudio,
}

/// What the files themselves do not say.
#[derive(Debug, Clone, Default)]
pub struct ImportOptions {
    /// The camera of the pictures: for formats that bring none.
    pub camera: Option<Camera>,
    /// The scene of every clip.
    pub scene: Option<Scene>,
    /// Frames a second, for pictures without times; for a video, in place of its own times.
    pub fps: Option<f64>,
    /// Frames of a clip: longer ones are cut. Without it, 16 for the real data set, else they stay whole.
    pub clip_frames: Option<usize>,
    /// Name of the ball's category, class or label, where there are others.
    pub category: Option<String>,
    /// Id of the ball's track in CVAT, where several have its label.
    pub object: Option<u64>,
    /// The folder of pictures, or the video, where it is not beside the annotations.
    pub pictures: Option<PathBuf>,
}

/// A clip that was left out.
#[derive(Debug)]
pub struct Refusal {
    /// Its name.
    pub clip: String,
    /// What is wrong with it.
    pub reason: Error,
}

/// What an import found.
#[derive(Debug, Default)]
pub struct ImportReport {
    /// Clips written.
    pub clips: usize,
    /// Their frames.
    pub frames: usize,
    /// Frames with a 2D label.
    pub labels: usize,
    /// Frames with a 3D position.
    pub positions: usize,
    /// Clips with a scene.
    pub scenes: usize,
    /// Steps in time that are longer than a frame: frames are missing there.
    pub gaps: usize,
    /// Frames whose label is (0, 0) or (−1, −1): the ball is taken as not visible.
    pub nowhere: usize,
    /// Frames a second of every clip.
    pub fps: Vec<f64>,
    /// Distance of the 2D label from the projected 3D position of every frame that has both, px.
    pub reprojection_px: Vec<f64>,
    /// Clips left out.
    pub refused: Vec<Refusal>,
}

/// A clip and what it was made from, or why it was left out.
type Outcome = std::result::Result<(Clip, Draft), Refusal>;

/// Reads `source`, which is in `format`, into a new clips folder `out`. `observe` gets the number of source
/// clips done, and of all.
///
/// # Errors
/// [`Error::Io`], [`Error::Format`], [`Error::Value`] with file and line for what is wrong with the whole;
/// [`Error::Data`] where no clip is left, and where `out` is there already. What is wrong with a clip is in
/// [`ImportReport::refused`].
pub fn import(
    format: Format,
    source: &Path,
    out: &Path,
    options: &ImportOptions,
    observe: &mut dyn FnMut(usize, usize),
) -> Result<ImportReport> {
    options.check()?;
    let is_folder = matches!(format, Format::Sd | Format::Spring | Format::Rd);
    if is_folder && source.is_file() {
        let reason =
            "is a file, but this format is a folder; unpack it if it is an archive, and give the folder".into();
        return Err(Error::Data { what: source.display().to_string(), reason });
    }
    let mut jobs = match format {
        Format::Sd | Format::Spring => sd::jobs(source, format, options)?,
        Format::Rd => rd::jobs(source, options)?,
        Format::Coco => coco::jobs(source, options)?,
        Format::Cvat => cvat::jobs(source, options)?,
        Format::Tracknet => tracknet::jobs(source, options)?,
        Format::Yolo => drawn::jobs(yolo::drawn(source, options)?, options)?,
        Format::Labelme => drawn::jobs(labelme::drawn(source)?, options)?,
        Format::LabelStudio => label_studio::jobs(source, options)?,
    };
    let mut report = ImportReport::default();
    let mut names = HashSet::new();
    jobs.retain(|job| names.insert(job.id.clone()) || report.refuse(&job.id, same_name()));
    let length = options.clip_frames.or((format == Format::Rd).then_some(RD_CLIP_FRAMES));
    let new = NewFolder::at(out)?;
    let mut clips = Clips { folder: new.path().to_path_buf(), clips: Vec::new() };
    let all = jobs.len();
    for (number, batch) in jobs.chunks(BATCH).enumerate() {
        let done: Vec<_> = batch.par_iter().map(|job| outcomes(job, length, new.path())).collect();
        for outcome in done.into_iter().collect::<Result<Vec<_>>>()?.into_iter().flatten() {
            match outcome {
                Ok((clip, draft)) => {
                    report.count(&clip, &draft);
                    clips.clips.push(clip);
                }
                Err(Refusal { clip, reason }) => drop(report.refuse(&clip, reason)),
            }
        }
        observe((number * BATCH + batch.len()).min(all), all);
    }
    if clips.clips.is_empty() {
        return Err(nothing_left(source, &report.refused));
    }
    clips.write_index()?;
    new.finish()?;
    Ok(report)
}

/// The clips of a source clip, written into `folder`; the inner error leaves one out, the outer ends the import.
fn outcomes(job: &Job, length: Option<usize>, folder: &Path) -> Result<Vec<Outcome>> {
    let refusal = |clip: &str, reason| Refusal { clip: clip.to_string(), reason };
    // No clip's name begins with a dot.
    let scratch = folder.join(format!(".{}", job.id.replace('/', "_")));
    let outcomes = match (job.read)(&scratch) {
        Err(reason) => Ok(vec![Err(refusal(&job.id, reason))]),
        Ok(draft) => draft
            .cut(&job.id, length)
            .into_iter()
            .map(|(id, draft)| {
                let clip = draft.write(&id, folder)?;
                Ok(clip.map(|clip| (clip, draft)).map_err(|reason| refusal(&id, reason)))
            })
            .collect(),
    };
    if scratch.exists() {
        std::fs::remove_dir_all(&scratch).map_err(Error::io(&scratch))?;
    }
    outcomes
}

fn same_name() -> Error {
    Error::Data { what: "clip".into(), reason: "has the same name as another one; rename its folder".into() }
}

/// The published set that a folder holds, by the names of its tables.
fn other_format(source: &Path) -> Option<&'static str> {
    let has = |table: &str| {
        pictures::files_below(source, &|path| path.file_name().is_some_and(|name| name == table))
            .is_ok_and(|found| !found.is_empty())
    };
    match (has(sd::LABELS), has(rd::LABELS)) {
        (true, _) => Some("sd or --from spring"),
        (_, true) => Some("rd"),
        _ => None,
    }
}

fn nothing_left(source: &Path, refused: &[Refusal]) -> Error {
    let reason = match refused.first() {
        None => match other_format(source) {
            Some(other) => format!("holds no clips of this format; it looks like --from {other}"),
            None => "holds no clips of this format".into(),
        },
        Some(Refusal { clip, reason }) => {
            format!("no clip could be imported, {} refused; the first, `{clip}`: {reason}", refused.len())
        }
    };
    Error::Data { what: source.display().to_string(), reason }
}

impl ImportOptions {
    fn check(&self) -> Result<()> {
        if let Some(fps) = self.fps.filter(|fps| !(fps.is_finite() && *fps > 0.0)) {
            return Err(Error::value("import", "fps", format!("must be positive, not {fps}")));
        }
        if self.clip_frames == Some(0) {
            return Err(Error::value("import", "clip_frames", "must be positive"));
        }
        Ok(())
    }

    /// The camera, for a format that brings none.
    fn camera(&self) -> Result<Camera> {
        self.camera
            .clone()
            .ok_or_else(|| Error::value("import", "camera", "is missing: this format does not include one"))
    }

    /// Frames a second, for pictures without times.
    fn fps(&self) -> Result<f64> {
        self.fps.ok_or_else(|| Error::value("import", "fps", "is missing: pictures have no times"))
    }
}

impl ImportReport {
    fn refuse(&mut self, clip: &str, reason: Error) -> bool {
        self.refused.push(Refusal { clip: clip.to_string(), reason });
        false
    }

    fn count(&mut self, clip: &Clip, draft: &Draft) {
        self.clips += 1;
        self.frames += clip.frames.len();
        self.labels += clip.frames.iter().filter(|frame| frame.image.is_some()).count();
        self.positions += clip.frames.iter().filter(|frame| frame.world.is_some()).count();
        self.scenes += usize::from(clip.scene.is_some());
        self.gaps += clip.frames.windows(2).filter(|pair| (pair[1].t - pair[0].t) * clip.fps > GAP).count();
        self.nowhere += draft.nowhere;
        self.fps.push(clip.fps);
        self.reprojection_px.extend(draft.reprojection_px());
    }
}
