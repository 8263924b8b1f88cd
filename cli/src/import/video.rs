//! Labels by frame number, and the folder of frames or the video that they speak of.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::Point2;

use super::ImportOptions;
use super::ball::is_nowhere;
use super::draft::{Draft, Shot, fps_of, fps_of_numbers};
use super::pictures::by_number;
use crate::video::{count_frames, evenly, extract, frame_times};
use gravisight::{Camera, Error, Result};

/// Extensions of videos.
pub(super) const VIDEOS: [&str; 8] = ["mp4", "avi", "mov", "mkv", "webm", "m4v", "mpg", "mts"];
/// What trackers add to a video's name for its track.
const SUFFIXES: [&str; 3] = ["", "_ball", "_predict"];

/// What is said of a frame.
#[derive(Debug, Clone)]
pub(super) struct Labelled {
    /// File and line.
    pub what: String,
    /// 2D label, px; none where the ball is not seen.
    pub image: Option<Point2<f64>>,
    /// When the frame was taken, s, where the labels say it.
    pub time: Option<f64>,
    /// Whether it only carries on what an earlier frame shows, perhaps beyond the video's end: how many frames there are, annotation
    /// tools take from the duration, and may be a frame off.
    pub carried: bool,
}

/// Where frames are.
#[derive(Debug, Clone)]
pub(super) enum Media {
    /// A folder of pictures with numbers.
    Pictures(PathBuf),
    /// A video.
    Video(PathBuf),
}

/// The frames of a video or folder.
struct Frames {
    /// Pictures by frame number.
    pictures: BTreeMap<u64, PathBuf>,
    /// Their times, s.
    times: Vec<f64>,
}

impl Media {
    /// What belongs to the annotation file `source`: what was given, what is called `name`, a folder or a video
    /// of the file's name, or `images`.
    pub fn beside(source: &Path, options: &ImportOptions, name: Option<&str>) -> Result<Self> {
        if let Some(given) = &options.pictures {
            return Ok(if given.is_dir() { Self::Pictures(given.clone()) } else { Self::Video(given.clone()) });
        }
        let own = source.parent().unwrap_or(Path::new(""));
        let named = name.map(str::trim).filter(|name| !name.is_empty());
        if let Some(video) = named.map(|name| own.join(name)).filter(|path| path.is_file()) {
            return Ok(Self::Video(video));
        }
        let stem = source.file_stem().unwrap_or_default().to_string_lossy();
        for stem in SUFFIXES.iter().filter_map(|suffix| stem.strip_suffix(suffix)).filter(|stem| !stem.is_empty()) {
            if own.join(stem).is_dir() {
                return Ok(Self::Pictures(own.join(stem)));
            }
            let video = |extension| own.join(format!("{stem}.{extension}"));
            if let Some(video) = VIDEOS.iter().map(video).find(|path| path.is_file()) {
                return Ok(Self::Video(video));
            }
        }
        if named.is_some() && own.join("images").is_dir() {
            return Ok(Self::Pictures(own.join("images")));
        }
        let reason =
            format!("there is no folder `{stem}` of frames and no video `{stem}.mp4` beside it; give --pictures");
        Err(Error::Data { what: source.display().to_string(), reason })
    }
}

/// The clip of labels by frame number, from the first ball to the last; frames of which nothing is said are frames
/// without the ball. A video's frames are written to `scratch`.
pub(super) fn draft(
    labels: &BTreeMap<u64, Labelled>,
    media: &Media,
    camera: &Camera,
    options: &ImportOptions,
    scratch: &Path,
) -> Result<Draft> {
    let (Media::Pictures(path) | Media::Video(path)) = media;
    let what = path.display().to_string();
    let (labels, nowhere) = &without_nowhere(labels.clone());
    let seen = || labels.iter().filter(|(_, label)| label.image.is_some()).map(|(number, _)| *number);
    let (Some(first), Some(last)) = (seen().next(), seen().next_back()) else {
        return Err(Error::Data { what, reason: "has no labelled frame".into() });
    };
    let clock = options.fps.is_none().then(|| Clock::of(labels)).flatten();
    let fps = options.fps.or(clock.as_ref().map(Clock::fps));
    let mut frames = match media {
        Media::Pictures(folder) => pictures(folder, [first, last], fps.map_or_else(|| options.fps(), Ok)?)?,
        Media::Video(video) => decoded(video, [first, last], fps, scratch)?,
    };
    if let Some(clock) = clock {
        frames.times = frames.pictures.keys().map(|&number| clock.at(number)).collect();
    }
    let mut told = labels.range(first..=last);
    if let Some((number, label)) = told.find(|(number, label)| !label.carried && !frames.pictures.contains_key(number))
    {
        let reason = format!("is not in {what}; check that labels and video count frames alike");
        return Err(Error::value(&label.what, format!("frame {number}"), reason));
    }
    let nothing = Labelled { what: what.clone(), image: None, time: None, carried: false };
    let shot = |((number, picture), t): ((u64, PathBuf), f64)| {
        let Labelled { what, image, .. } = labels.get(&number).unwrap_or(&nothing).clone();
        Shot { picture, what, t, image, world: None }
    };
    let numbers: Vec<u64> = frames.pictures.keys().copied().collect();
    let shots: Vec<Shot> = frames.pictures.into_iter().zip(frames.times).map(shot).collect();
    let fps = match options.fps {
        Some(fps) => fps_of_numbers(numbers, fps),
        None => fps_of(&shots)?,
    };
    Ok(Draft { nowhere: *nowhere, ..Draft::new(camera.clone(), options.scene.clone(), fps, shots) })
}

/// Labels that are nowhere are taken as not visible; how many.
fn without_nowhere(mut labels: BTreeMap<u64, Labelled>) -> (BTreeMap<u64, Labelled>, usize) {
    let mut nowhere = 0;
    for label in labels.values_mut().filter(|label| label.image.as_ref().is_some_and(is_nowhere)) {
        label.image = None;
        nowhere += 1;
    }
    (labels, nowhere)
}

/// The times that labels say, in place of the pictures' own.
struct Clock(Vec<(u64, f64)>);

impl Clock {
    /// None where fewer than two labels say one.
    fn of(labels: &BTreeMap<u64, Labelled>) -> Option<Self> {
        let times: Vec<(u64, f64)> = labels.iter().filter_map(|(&number, label)| Some((number, label.time?))).collect();
        (times.len() > 1).then_some(Self(times))
    }

    /// Frames a second, in the mean.
    fn fps(&self) -> f64 {
        let ((first, start), (last, end)) = (self.0[0], self.0[self.0.len() - 1]);
        (last - first) as f64 / (end - start)
    }

    /// The time of a frame, s: between two that say theirs in proportion.
    fn at(&self, number: u64) -> f64 {
        let after = self.0.partition_point(|&(other, _)| other < number).clamp(1, self.0.len() - 1);
        let ((one, start), (other, end)) = (self.0[after - 1], self.0[after]);
        start + (end - start) * (number as f64 - one as f64) / (other - one) as f64
    }
}

fn pictures(folder: &Path, [first, last]: [u64; 2], fps: f64) -> Result<Frames> {
    let mut pictures = by_number(folder, "")?;
    pictures.retain(|number, _| (first..=last).contains(number));
    let times = pictures.keys().map(|&number| (number - first) as f64 / fps).collect();
    Ok(Frames { pictures, times })
}

/// The frames of a video, written to `folder` (which is made), and their times, s: its own, or evenly spaced by `fps`.
///
/// # Errors
/// [`Error::Data`] where ffmpeg or ffprobe is not installed or cannot read it; [`Error::Io`].
pub fn video_frames(video: &Path, fps: Option<f64>, folder: &Path) -> Result<(Vec<PathBuf>, Vec<f64>)> {
    let frames = decoded(video, [0, u64::MAX], fps, folder)?;
    Ok((frames.pictures.into_values().collect(), frames.times))
}

fn decoded(video: &Path, [first, last]: [u64; 2], fps: Option<f64>, scratch: &Path) -> Result<Frames> {
    let all = match fps {
        Some(fps) => evenly(count_frames(video)?, fps),
        None => frame_times(video)?,
    };
    let refuse = |reason: String| Error::Data { what: video.display().to_string(), reason };
    let last = last.min((all.len() as u64).saturating_sub(1));
    if first > last || all.is_empty() {
        return Err(refuse(format!("has {} frames, but the first label is for frame {first}", all.len())));
    }
    let start = if fps.is_some() { all[first as usize] } else { 0.0 };
    let times: Vec<f64> = all[first as usize..=last as usize].iter().map(|time| time - start).collect();
    std::fs::create_dir(scratch).map_err(Error::io(scratch))?;
    extract(video, [first, last], scratch)?;
    let pictures = by_number(scratch, "")?;
    if pictures.len() != times.len() {
        let reason = format!(
            "ffmpeg decoded {} frames, but ffprobe counts {}; the file may be damaged",
            pictures.len(),
            times.len()
        );
        return Err(refuse(reason));
    }
    Ok(Frames { pictures, times })
}
