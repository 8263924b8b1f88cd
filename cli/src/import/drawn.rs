//! Pictures in which somebody drew shapes: the ball's as clips, one for every folder, and as a 2D track with its radii.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::ball::{Ball, is_nowhere};
use super::cvat::{Clock, cvat_track};
use super::draft::{Draft, Job, Shot, fps_of_numbers};
use super::pictures::{id_of, natural, numbers_of};
use super::{Format, ImportOptions, label_studio, labelme, yolo};
use gravisight::{Error, Result, Size, Track};

/// Folders that an error names.
const NAMED: usize = 10;

/// All that was drawn.
#[derive(Debug)]
pub(super) struct Drawn {
    /// The file or folder that says it.
    pub what: String,
    /// The pictures; those of one folder are one clip.
    pub pictures: Vec<Drawing>,
}

/// What was drawn in a picture.
#[derive(Debug)]
pub(super) struct Drawing {
    /// The picture as the tool calls it, in its folder there.
    pub name: PathBuf,
    /// Its file.
    pub file: PathBuf,
    /// File, and line, that speak of it.
    pub what: String,
    /// Its size as the tool says it, px.
    pub size: Option<[f64; 2]>,
    /// The shapes.
    pub shapes: Vec<Shape>,
}

/// A shape with a label.
#[derive(Debug)]
pub(super) struct Shape {
    /// What it is said to be.
    pub label: String,
    /// Which shape.
    pub kind: String,
    /// The ball, if it is one; none of a shape that no ball is read from.
    pub ball: Option<Ball>,
}

/// A ball's track as it was drawn.
#[derive(Debug)]
pub struct DrawnTrack {
    /// One point for each frame of which the file says something.
    pub track: Track,
    /// The ball's label.
    pub label: String,
    /// Ids of the tracks that it is made of (CVAT); none of images.
    pub objects: Vec<u64>,
    /// Frames in which it is hidden: outside or occluded.
    pub hidden: usize,
    /// Frames whose label is (0, 0) or (−1, −1): the ball is taken as not visible.
    pub nowhere: usize,
    /// Frames in which it is visible, and where the tool interpolated between key frames.
    pub interpolated: usize,
}

/// The ball's track by what was drawn around it. Times are those of the video `pictures` (CVAT), or by `fps`, or none.
///
/// # Errors
/// [`Error::Io`], [`Error::Format`], [`Error::Value`] with file and line; [`Error::Data`] for several balls or labels, which it names,
/// for none, and for a format in which nothing is drawn.
pub fn drawn_track(format: Format, source: &Path, options: &ImportOptions) -> Result<DrawnTrack> {
    options.check()?;
    match format {
        Format::Cvat => cvat_track(source, options),
        Format::Yolo => track(yolo::drawn(source, options)?, options),
        Format::Labelme => track(labelme::drawn(source)?, options),
        Format::LabelStudio => track(label_studio::drawn(source, options)?, options),
        _ => {
            let reason = "has no shapes from which to make a track".into();
            Err(Error::Data { what: source.display().to_string(), reason })
        }
    }
}

/// A job for every folder of pictures.
pub(super) fn jobs(drawn: Drawn, options: &ImportOptions) -> Result<Vec<Job>> {
    let (camera, fps) = (options.camera()?, options.fps()?);
    let label = drawn.label(options)?;
    let stem = Path::new(&drawn.what).file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let mut groups: BTreeMap<PathBuf, Vec<Drawing>> = BTreeMap::new();
    for picture in drawn.pictures {
        groups.entry(folder_of(&picture.name)).or_default().push(picture);
    }
    let job = |(group, mut pictures): (PathBuf, Vec<Drawing>)| {
        let parts = || group.iter().filter_map(|part| part.to_str()).filter(|part| !["..", "."].contains(part));
        let id = if parts().next().is_some() { id_of(parts()) } else { id_of([stem.as_str()]) };
        let (camera, scene, label) = (camera.clone(), options.scene.clone(), label.clone());
        let numbers = in_time(&mut pictures);
        let read = move |_: &Path| {
            let shot = |(picture, number): (&Drawing, &u64)| {
                picture.check_size(camera.size())?;
                let (file, what) = (picture.file.clone(), picture.what.clone());
                let image = picture.ball(&label)?.map(|ball| ball.centre);
                Ok(Shot { picture: file, what, t: (number - numbers[0]) as f64 / fps, image, world: None })
            };
            let shots = pictures.iter().zip(&numbers).map(shot).collect::<Result<_>>()?;
            let fps = fps_of_numbers(numbers.iter().copied(), fps);
            Ok(Draft::new(camera.clone(), scene.clone(), fps, shots))
        };
        Job { id, read: Box::new(read) }
    };
    Ok(groups.into_iter().map(job).collect())
}

fn track(mut drawn: Drawn, options: &ImportOptions) -> Result<DrawnTrack> {
    let label = drawn.label(options)?;
    let folders: BTreeSet<PathBuf> = drawn.pictures.iter().map(|picture| folder_of(&picture.name)).collect();
    if folders.len() > 1 {
        let folders: Vec<String> = folders.iter().take(NAMED).map(|folder| format!("`{}`", folder.display())).collect();
        let reason = format!(
            "has pictures from several folders ({}), but a track is made from one; give a single folder",
            folders.join(", ")
        );
        return Err(Error::Data { what: drawn.what, reason });
    }
    let numbers = in_time(&mut drawn.pictures);
    let clock = Clock::of(&ImportOptions { pictures: None, ..options.clone() })?;
    let (mut points, mut nowhere) = (Vec::new(), 0);
    for (picture, frame) in drawn.pictures.iter().zip(numbers) {
        let ball = picture.ball(&label)?;
        let is_there = ball.is_some_and(|ball| !is_nowhere(&ball.centre));
        nowhere += usize::from(ball.is_some() && !is_there);
        points.push(clock.point(frame, ball.filter(|_| is_there), &picture.what)?);
    }
    Ok(DrawnTrack { track: Track::new(points)?, label, objects: vec![], hidden: 0, nowhere, interpolated: 0 })
}

fn folder_of(name: &Path) -> PathBuf {
    name.parent().unwrap_or(Path::new("")).to_path_buf()
}

/// Puts the pictures of a folder in the order of time; their frame numbers.
fn in_time(pictures: &mut [Drawing]) -> Vec<u64> {
    pictures.sort_by(|one, other| natural(&one.name.to_string_lossy(), &other.name.to_string_lossy()));
    numbers_of(pictures.iter().map(|picture| picture.name.as_path()))
}

/// The ball's label among `labels` of `what`: that asked for, or the only one.
///
/// # Errors
/// [`Error::Data`] where there is none, where that asked for is not there, and where there are several to choose from.
pub(super) fn chosen(labels: &BTreeSet<&str>, options: &ImportOptions, what: &str) -> Result<String> {
    let names = || labels.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
    let reason = match (options.category.as_deref(), labels.first()) {
        (_, None) => "holds no shapes".into(),
        (Some(wanted), _) if labels.contains(wanted) => return Ok(wanted.into()),
        (Some(wanted), _) => format!("has nothing with the label `{wanted}`; choose one of {}", names()),
        (None, Some(only)) if labels.len() == 1 => return Ok((*only).into()),
        (None, _) => format!("holds several labels: {}; choose the ball's with --category", names()),
    };
    Err(Error::Data { what: what.into(), reason })
}

impl Drawn {
    fn label(&self, options: &ImportOptions) -> Result<String> {
        let shapes = self.pictures.iter().flat_map(|picture| &picture.shapes);
        chosen(&shapes.map(|shape| shape.label.as_str()).collect(), options, &self.what)
    }
}

impl Drawing {
    /// The ball with that label.
    fn ball(&self, label: &str) -> Result<Option<&Ball>> {
        let mut shapes = self.shapes.iter().filter(|shape| shape.label == label);
        let (first, second) = (shapes.next(), shapes.next());
        if second.is_some() {
            let reason = format!("holds a second `{label}`; keep one ball, or give --category");
            return Err(Error::Data { what: self.what.clone(), reason });
        }
        let Some(Shape { kind, ball, .. }) = first else { return Ok(None) };
        let reason = || format!("is a `{kind}`; draw the ball as a point, a circle or ellipse, or a box");
        ball.as_ref().map(Some).ok_or_else(|| Error::value(&self.what, label, reason()))
    }

    /// Refuses a size that is not the camera's.
    fn check_size(&self, camera: Size) -> Result<()> {
        match self.size {
            Some([width, height]) if [width, height] != camera.xy() => {
                let reason =
                    format!("is {width}×{height} px, but the camera is for {camera} px; give this picture's camera");
                Err(Error::value(&self.what, "size", reason))
            }
            _ => Ok(()),
        }
    }
}
