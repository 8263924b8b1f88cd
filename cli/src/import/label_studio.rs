//! Label Studio's export: JSON, a list of tasks. Places are in per cent of the picture's sides, from its corner.
//! Format: labelstud.io/guide/task_format.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use percent_encoding::percent_decode_str;
use serde::Deserialize;
use serde_json::Value;

use super::ImportOptions;
use super::ball::Ball;
use super::draft::Job;
use super::drawn::{self, Drawing, Drawn, Shape, chosen};
use super::pictures::{PICTURES, has_extension, id_of, read_text};
use super::video::{Labelled, Media, VIDEOS, draft};
use gravisight::{Error, Result, Size};

/// Digits with which an upload's name begins, and a dash.
const UPLOAD_DIGITS: usize = 8;
/// Longest that a straight line between two key frames may be, frames.
const LONGEST_GAP: u64 = 10_000;
/// Where uploads are, by their projects, and files of the server's own disk.
const UPLOADS: &str = "/data/upload/";
const LOCAL: &str = "/data/local-files/?d=";

/// A picture or a video with what people drew. It holds more; what is not needed is not looked at.
#[derive(Deserialize)]
struct Task {
    id: Value,
    data: BTreeMap<String, Value>,
    #[serde(alias = "completions")]
    annotations: Option<Vec<Annotation>>,
}

/// What one person drew.
#[derive(Deserialize)]
struct Annotation {
    result: Vec<Region>,
    #[serde(default)]
    was_cancelled: bool,
    #[serde(default)]
    ground_truth: bool,
}

#[derive(Deserialize)]
struct Region {
    #[serde(rename = "type")]
    kind: Option<String>,
    original_width: Option<f64>,
    original_height: Option<f64>,
    image_rotation: Option<f64>,
    #[serde(default)]
    value: Place,
}

/// A shape, %; which numbers it has depends on its kind.
#[derive(Deserialize, Default)]
#[serde(rename_all = "camelCase", default)]
struct Place {
    x: f64,
    y: f64,
    width: f64,
    height: f64,
    radius_x: f64,
    radius_y: f64,
    /// Clockwise, about the upper left corner, °.
    rotation: f64,
    #[serde(
        alias = "rectanglelabels",
        alias = "ellipselabels",
        alias = "keypointlabels",
        alias = "polygonlabels",
        alias = "brushlabels"
    )]
    labels: Vec<String>,
    /// A video's key frames.
    sequence: Vec<KeyFrame>,
    /// How many frames it has.
    #[serde(rename = "framesCount")]
    frames: Option<u64>,
}

#[derive(Deserialize, Clone)]
struct KeyFrame {
    /// From 1.
    frame: u64,
    x: f64,
    y: f64,
    width: f64,
    height: f64,
    #[serde(default)]
    rotation: f64,
    /// Whether it goes on to the next key frame, and after the last to the video's end.
    #[serde(default)]
    enabled: bool,
}

/// A file as a task's data name it.
#[derive(Default)]
struct Named {
    /// Without what an upload's name begins with.
    path: PathBuf,
    /// The whole name of an upload.
    uploaded: Option<String>,
}

/// A job for every folder of pictures, or for every video.
pub(super) fn jobs(source: &Path, options: &ImportOptions) -> Result<Vec<Job>> {
    let tasks = tasks(source)?;
    let videos = tasks.iter().filter(|task| task.file(&VIDEOS).is_some()).count();
    match videos {
        0 => drawn::jobs(pictures(tasks, source, options)?, options),
        _ if videos == tasks.len() => tasks.into_iter().map(|task| task.video(source, videos, options)).collect(),
        _ => {
            let reason = "holds videos and pictures; export them separately".into();
            Err(Error::Data { what: source.display().to_string(), reason })
        }
    }
}

/// The shapes in pictures.
pub(super) fn drawn(source: &Path, options: &ImportOptions) -> Result<Drawn> {
    let tasks = tasks(source)?;
    if tasks.iter().any(|task| task.file(&VIDEOS).is_some()) {
        let reason = "annotates a video in per cent of its size, but does not give the size; import it as clips (--out, --camera)";
        return Err(Error::Data { what: source.display().to_string(), reason: reason.into() });
    }
    pictures(tasks, source, options)
}

fn tasks(source: &Path) -> Result<Vec<Task>> {
    if source.is_dir() {
        let reason = "is a folder; give the exported file (.json)".into();
        return Err(Error::Data { what: source.display().to_string(), reason });
    }
    let expected = |error: serde_json::Error| format!("{error}; export as JSON, not as JSON-MIN");
    let refuse = Error::format(source.display().to_string());
    serde_json::from_str(&read_text(source)?).map_err(|error| refuse(expected(error)))
}

fn pictures(tasks: Vec<Task>, source: &Path, options: &ImportOptions) -> Result<Drawn> {
    let pictures = tasks.into_iter().map(|task| task.picture(source, options)).collect::<Result<_>>()?;
    Ok(Drawn { what: source.display().to_string(), pictures })
}

impl Task {
    fn what(&self, source: &Path) -> String {
        format!("{}: task {}", source.display(), self.id)
    }

    /// The file of which its data are a path or an address.
    fn file(&self, extensions: &[&str]) -> Option<Named> {
        let mut files = self.data.values().filter_map(Value::as_str).map(Named::of);
        files.find(|file| has_extension(&file.path, extensions))
    }

    /// What was drawn, where one person did, or one is marked as right.
    fn regions(&self, what: &str) -> Result<&[Region]> {
        let done = || self.annotations.iter().flatten().filter(|annotation| !annotation.was_cancelled);
        let right: Vec<&Annotation> = done().filter(|annotation| annotation.ground_truth).collect();
        match (done().count(), right.as_slice(), done().next()) {
            (_, &[one], _) | (1, _, Some(one)) => Ok(&one.result),
            (0, ..) => Ok(&[]),
            (count, ..) => {
                let reason = format!("has {count} annotations; mark one of them as ground truth");
                Err(Error::Data { what: what.into(), reason })
            }
        }
    }

    fn picture(self, source: &Path, options: &ImportOptions) -> Result<Drawing> {
        let what = self.what(source);
        let named = self.file(&PICTURES).ok_or_else(|| {
            let reason = "its data names neither a PNG, JPEG or WebP picture nor a video".into();
            Error::Data { what: what.clone(), reason }
        })?;
        let (mut shapes, mut size) = (Vec::new(), None);
        for region in self.regions(&what)? {
            if region.image_rotation.is_some_and(|angle| angle != 0.0) {
                let reason = "was rotated in Label Studio; rotate it back and export it again".into();
                return Err(Error::Data { what, reason });
            }
            let Some(sides) = region.original_width.zip(region.original_height).map(<[f64; 2]>::from) else { continue };
            size = Some(sides);
            shapes.extend(region.shape(sides));
        }
        let file = named.within(&folder(source, options));
        Ok(Drawing { name: named.path, file, what, size, shapes })
    }

    /// The job for a video, one of `videos`.
    fn video(self, source: &Path, videos: usize, options: &ImportOptions) -> Result<Job> {
        let (what, camera) = (self.what(source), options.camera()?);
        let named = self.file(&VIDEOS).unwrap_or_default();
        let file = named.within(&folder(source, options));
        let media = match file.is_file() || videos > 1 {
            true => Media::Video(file),
            false => Media::beside(source, options, None)?,
        };
        let labels = self.labels(&what, camera.size(), options)?;
        let id = id_of([named.path.file_stem().unwrap_or_default().to_string_lossy().as_ref()]);
        let options = options.clone();
        let read = move |scratch: &Path| draft(&labels, &media, &camera, &options, scratch);
        Ok(Job { id, read: Box::new(read) })
    }

    /// The ball in a video's frames, from 0.
    fn labels(&self, what: &str, size: Size, options: &ImportOptions) -> Result<BTreeMap<u64, Labelled>> {
        let regions: Vec<&Region> =
            self.regions(what)?.iter().filter(|region| !region.value.sequence.is_empty()).collect();
        let names = regions.iter().flat_map(|region| &region.value.labels).map(String::as_str);
        let label = chosen(&names.collect::<BTreeSet<_>>(), options, what)?;
        let mut labels = BTreeMap::new();
        for region in regions.into_iter().filter(|region| region.value.labels.contains(&label)) {
            let last = region.value.sequence.iter().map(|key| key.frame).max().unwrap_or(0);
            for (frame, ball) in along(&region.value.sequence, region.value.frames, size.xy(), what)? {
                let labelled =
                    Labelled { what: what.into(), image: Some(ball.centre), time: None, carried: frame >= last };
                if labels.insert(frame, labelled).is_some() {
                    let reason = format!("holds a second `{label}`; keep one ball, or give --category");
                    return Err(Error::value(what, format!("frame {}", frame + 1), reason));
                }
            }
        }
        Ok(labels)
    }
}

impl Region {
    /// In a picture of those sides, px.
    fn shape(&self, [width, height]: [f64; 2]) -> Option<Shape> {
        let Place { x, y, radius_x, radius_y, labels, .. } = &self.value;
        let kind = self.kind.clone().unwrap_or_default();
        let at = [x / 100.0 * width, y / 100.0 * height];
        let ball = match kind.as_str() {
            "keypointlabels" => Some(Ball::at(at)),
            "ellipselabels" => Some(Ball::in_ellipse(at, [radius_x / 100.0 * width, radius_y / 100.0 * height])),
            "rectanglelabels" => Some(self.value.rectangle([width, height])),
            _ => None,
        };
        // What is said of the whole picture has no label.
        Some(Shape { label: labels.first()?.clone(), kind, ball })
    }
}

impl Place {
    fn rectangle(&self, sides: [f64; 2]) -> Ball {
        let Self { x, y, width, height, rotation, .. } = *self;
        rectangle([x, y, width, height], rotation, sides)
    }
}

/// The ball in a rectangle (left, top, width, height, %) that is turned about its upper left corner, in a picture of those sides, px.
fn rectangle([x, y, w, h]: [f64; 4], rotation: f64, [width, height]: [f64; 2]) -> Ball {
    let (sin, cos) = rotation.to_radians().sin_cos();
    let [x, w] = [x, w].map(|share| share / 100.0 * width);
    let [y, h] = [y, h].map(|share| share / 100.0 * height);
    let [right, down] = [w / 2.0, h / 2.0];
    Ball::in_box([x + right * cos - down * sin, y + right * sin + down * cos], [w, h])
}

/// Frames after the last key frame, at most: an hour of 240 a second.
const MOST_FRAMES: u64 = 864_000;

/// The ball in each frame (from 0) of a video of so many frames with pictures of those sides, px: key frames, and straight lines between those
/// that go on. Where the last one goes on, the ball stays there to the end.
fn along(sequence: &[KeyFrame], frames: Option<u64>, sides: [f64; 2], what: &str) -> Result<Vec<(u64, Ball)>> {
    let mut keys = sequence.to_vec();
    keys.sort_by_key(|key| key.frame);
    let mut balls = Vec::new();
    let ball = |key: &KeyFrame| rectangle([key.x, key.y, key.width, key.height], key.rotation, sides);
    for (index, key) in keys.iter().enumerate() {
        let next = keys.get(index + 1);
        let until = next.map_or(frames, |next| Some(next.frame.saturating_sub(1)));
        let last = until.filter(|_| key.enabled).unwrap_or(key.frame).max(key.frame);
        if next.is_none() && last - key.frame > MOST_FRAMES {
            let reason = format!("is {last}; at most {MOST_FRAMES} frames may follow a key frame");
            return Err(Error::value(what, "framesCount", reason));
        }
        if key.frame == 0
            || next.is_some() && last - key.frame > LONGEST_GAP
            || next.is_some_and(|next| next.frame == key.frame)
        {
            let reason = format!(
                "of a key frame must count from 1, be unique, and be within {LONGEST_GAP} frames of the next one"
            );
            return Err(Error::value(what, "frame", reason));
        }
        for frame in key.frame..=last {
            let mut between = ball(key);
            if let Some(next) = next {
                let share = (frame - key.frame) as f64 / (next.frame - key.frame) as f64;
                between.centre += (ball(next).centre - between.centre) * share;
            }
            balls.push((frame - 1, between));
        }
    }
    Ok(balls)
}

impl Named {
    fn of(text: &str) -> Self {
        let address = text.split_once("://").map(|(_, rest)| rest.split_once('/').map_or(rest, |(_, path)| path));
        let (is_upload, path) = match (text.split_once(UPLOADS), text.split_once(LOCAL)) {
            (Some((_, path)), _) => (true, path.rsplit('/').next().unwrap_or_default()),
            (_, Some((_, path))) => (false, path),
            _ => (false, address.unwrap_or(text)),
        };
        let path = path.split(['?', '#']).next().unwrap_or_default();
        let path = percent_decode_str(path).decode_utf8_lossy();
        let is_mark = |mark: &str| mark.len() == UPLOAD_DIGITS && mark.bytes().all(|digit| digit.is_ascii_hexdigit());
        match path.split_once('-').filter(|(mark, _)| is_upload && is_mark(mark)) {
            Some((_, own)) => Self { path: own.into(), uploaded: Some(path.clone().into_owned()) },
            None => Self { path: path.trim_start_matches('/').into(), uploaded: None },
        }
    }

    /// Its file in `folder`: by its path there, by its name as it was uploaded, or by its name alone.
    fn within(&self, folder: &Path) -> PathBuf {
        let alone = folder.join(self.path.file_name().unwrap_or_default());
        let uploaded = self.uploaded.as_ref().map(|name| folder.join(name));
        let candidates = [Some(folder.join(&self.path)), uploaded];
        candidates.into_iter().flatten().find(|path| path.is_file()).unwrap_or(alone)
    }
}

/// Where the files are: what was given, `images` beside the export, or its own folder.
fn folder(source: &Path, options: &ImportOptions) -> PathBuf {
    let own = source.parent().unwrap_or(Path::new(""));
    let beside = Some(own.join("images")).filter(|folder| folder.is_dir());
    options.pictures.clone().or(beside).unwrap_or_else(|| own.to_path_buf())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_that_goes_on_after_its_last_key_frame_stays_to_the_end() {
        let key = |frame: u64, x: f64, enabled: bool| KeyFrame {
            frame,
            x,
            y: 10.0,
            width: 4.0,
            height: 4.0,
            rotation: 0.0,
            enabled,
        };
        let frames = |keys: &[KeyFrame], frames: Option<u64>| -> Vec<(u64, f64)> {
            let balls = along(keys, frames, [100.0, 100.0], "task 1").unwrap();
            balls.into_iter().map(|(frame, ball)| (frame, ball.centre.x)).collect()
        };
        let goes_on = frames(&[key(1, 10.0, true), key(3, 20.0, true)], Some(6));
        assert_eq!(goes_on.iter().map(|(frame, _)| *frame).collect::<Vec<_>>(), [0, 1, 2, 3, 4, 5]);
        assert!(goes_on[2..].iter().all(|(_, x)| (x - goes_on[2].1).abs() < 1e-9), "{goes_on:?}");
        assert_eq!(frames(&[key(1, 10.0, true), key(3, 20.0, false)], Some(6)).len(), 3);
        // An export that does not say how many frames there are.
        assert_eq!(frames(&[key(1, 10.0, true), key(3, 20.0, true)], None).len(), 3);
        let error = along(&[key(1, 10.0, true)], Some(u64::MAX), [100.0, 100.0], "task 1").unwrap_err().to_string();
        assert!(error.contains("framesCount"), "{error}");
    }
}
