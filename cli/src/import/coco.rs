//! COCO's annotation files.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use nalgebra::Point2;
use serde::Deserialize;
use serde_json::Value;

use super::ImportOptions;
use super::draft::{Draft, Job, Shot, fps_of_numbers};
use super::pictures::{id_of, natural, numbers_of, read_text};
use gravisight::{Error, Result, Size};

/// A keypoint's flag where it is seen; 1 is one that is labelled though hidden.
const VISIBLE: f64 = 2.0;
/// A keypoint's flag where it is not labelled.
const UNLABELLED: f64 = 0.0;
/// From the picture's corner to the middle of its first pixel, px.
const HALF_PIXEL: f64 = 0.5;

/// The file. It holds more; what is not needed is not looked at.
#[derive(Debug, Deserialize)]
struct File {
    images: Vec<Image>,
    #[serde(default)]
    annotations: Vec<Annotation>,
    #[serde(default)]
    categories: Vec<Category>,
}

#[derive(Debug, Deserialize)]
struct Image {
    id: Value,
    file_name: String,
    width: Option<f64>,
    height: Option<f64>,
    #[serde(alias = "frame_id", alias = "frame_index")]
    frame: Option<u64>,
    date_captured: Option<Value>,
}

#[derive(Debug, Deserialize)]
struct Annotation {
    image_id: Value,
    category_id: Option<Value>,
    keypoints: Option<Vec<f64>>,
    bbox: Option<Vec<f64>>,
}

#[derive(Debug, Deserialize)]
struct Category {
    id: Value,
    name: String,
}

/// The balls by their image's id: an annotation's place in the file, and where the ball is, if it is seen.
type Balls = HashMap<String, Vec<(usize, Option<Point2<f64>>)>>;

/// A job for every folder of images.
pub(super) fn jobs(source: &Path, options: &ImportOptions) -> Result<Vec<Job>> {
    if source.is_dir() {
        let reason = "is a folder; give the annotation file (.json) in it".into();
        return Err(Error::Data { what: source.display().to_string(), reason });
    }
    let what = source.display().to_string();
    let file: File = serde_json::from_str(&read_text(source)?).map_err(Error::format(&what))?;
    let balls = file.balls(options.category.as_deref(), &what)?;
    let folder = folder(source, &file.images, options);
    let mut groups: BTreeMap<PathBuf, Vec<Image>> = BTreeMap::new();
    for image in file.images {
        let group = Path::new(&image.file_name).parent().unwrap_or(Path::new("")).to_path_buf();
        groups.entry(group).or_default().push(image);
    }
    let stem = source.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let (camera, fps) = (options.camera()?, options.fps()?);
    let balls = std::sync::Arc::new(balls);
    let job = |(group, mut images): (PathBuf, Vec<Image>)| {
        images.sort_by(in_time);
        let (folder, balls, what) = (folder.clone(), balls.clone(), what.clone());
        let (camera, scene) = (camera.clone(), options.scene.clone());
        let parts = || group.iter().filter_map(|part| part.to_str()).filter(|part| *part != "..");
        let id = if parts().next().is_some() { id_of(parts()) } else { id_of([stem.as_str()]) };
        let read = move |_: &Path| {
            let shots = shots(&images, &folder, &balls, camera.size(), fps, &what)?;
            let fps = fps_of_numbers(frame_numbers(&images), fps);
            Ok(Draft::new(camera.clone(), scene.clone(), fps, shots))
        };
        Job { id, read: Box::new(read) }
    };
    Ok(groups.into_iter().map(job).collect())
}

/// Where the images are: what was given, `images` beside the file, or its own folder.
fn folder(source: &Path, images: &[Image], options: &ImportOptions) -> PathBuf {
    let own = source.parent().unwrap_or(Path::new(""));
    let holds = |folder: &PathBuf| images.first().is_some_and(|image| folder.join(&image.file_name).is_file());
    let beside = Some(own.join("images")).filter(holds);
    options.pictures.clone().or(beside).unwrap_or_else(|| own.to_path_buf())
}

/// By frame, then by time, then by name.
fn in_time(one: &Image, other: &Image) -> std::cmp::Ordering {
    let date = |image: &Image| image.date_captured.as_ref().map(key);
    let by_date = date(one).zip(date(other)).map_or(std::cmp::Ordering::Equal, |(one, other)| natural(&one, &other));
    let by_frame = one.frame.cmp(&other.frame);
    by_frame.then(by_date).then_with(|| natural(&one.file_name, &other.file_name))
}

/// Frame numbers: those of the file, else as [`numbers_of`].
fn frame_numbers(images: &[Image]) -> Vec<u64> {
    let given = images.iter().map(|image| image.frame).collect::<Option<Vec<u64>>>();
    given.unwrap_or_else(|| numbers_of(images.iter().map(|image| Path::new(&image.file_name))))
}

fn shots(images: &[Image], folder: &Path, balls: &Balls, size: Size, fps: f64, what: &str) -> Result<Vec<Shot>> {
    let numbers = frame_numbers(images);
    let first = numbers.first().copied().unwrap_or_default();
    let shot = |(image, number): (&Image, u64)| {
        let what = format!("{what}: image `{}`", image.file_name);
        for (side, name, expected) in [(image.width, "width", size.width), (image.height, "height", size.height)] {
            if let Some(side) = side.filter(|side| *side != f64::from(expected)) {
                return Err(Error::value(what, name, format!("is {side} px, but the camera is for {expected} px")));
            }
        }
        let found = balls.get(&key(&image.id)).map(Vec::as_slice).unwrap_or_default();
        if let [(one, _), (other, _), ..] = found {
            let reason = format!("has two balls, annotations {one} and {other}; keep one, or give --category");
            return Err(Error::Data { what, reason });
        }
        let t = number.saturating_sub(first) as f64 / fps;
        let label = found.first().and_then(|(_, label)| *label);
        Ok(Shot { picture: folder.join(&image.file_name), what, t, image: label, world: None })
    };
    images.iter().zip(numbers).map(shot).collect()
}

impl File {
    fn balls(&self, category: Option<&str>, what: &str) -> Result<Balls> {
        let named = |wanted: &str| {
            let found = self.categories.iter().find(|category| category.name == wanted);
            let names = || self.categories.iter().map(|category| category.name.as_str()).collect::<Vec<_>>().join(", ");
            let missing = || Error::value(what, "categories", format!("has no `{wanted}`; choose one of {}", names()));
            found.map(|category| key(&category.id)).ok_or_else(missing)
        };
        let wanted = category.map(named).transpose()?;
        let mut balls = Balls::new();
        for (index, annotation) in self.annotations.iter().enumerate() {
            if wanted.is_some() && annotation.category_id.as_ref().map(key) != wanted {
                continue;
            }
            let label = annotation.label().map_err(|message| Error::Format {
                what: format!("{what}: annotations[{index}]"),
                message: message.into(),
            })?;
            balls.entry(key(&annotation.image_id)).or_default().push((index, label));
        }
        Ok(balls)
    }
}

impl Annotation {
    /// The first visible keypoint; where none is labelled, the box's centre.
    fn label(&self) -> std::result::Result<Option<Point2<f64>>, &'static str> {
        let (points, []) = self.keypoints.as_deref().unwrap_or_default().as_chunks::<3>() else {
            return Err("`keypoints` must hold x, y and visibility of every point");
        };
        if points.iter().any(|[_, _, flag]| *flag != UNLABELLED) {
            return Ok(points.iter().find(|[_, _, flag]| *flag == VISIBLE).map(|[x, y, _]| Point2::new(*x, *y)));
        }
        match self.bbox.as_deref() {
            Some(&[x, y, width, height]) if width >= 0.0 && height >= 0.0 => {
                Ok(Some(Point2::new(x + width / 2.0 - HALF_PIXEL, y + height / 2.0 - HALF_PIXEL)))
            }
            Some(_) => Err("`bbox` must hold x, y, width and height, neither of which is negative"),
            None if points.is_empty() => Err("has neither `keypoints` nor `bbox`"),
            None => Ok(None),
        }
    }
}

/// An id, which some write as a number and some as a string.
fn key(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_string)
}
