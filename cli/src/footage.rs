//! The frames of a video, or pictures that are one.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use anyhow::{Context, Result, bail, ensure};
use gravisight::{Picture, Size};

use crate::import::{is_picture, left_out, pictures_in};
use crate::video::{Oddities, VideoStream, evenly, packet_times};

/// Frames in order, read one by one as often as wanted.
pub struct Footage {
    media: FootageSource,
    times: Vec<f64>,
    own_times: bool,
    size: Option<Size>,
    /// A video's stream that is at its first frame still: to start ffmpeg takes a third of a second.
    begun: Mutex<Option<VideoStream>>,
}

enum FootageSource {
    Video(PathBuf),
    Pictures(Vec<PathBuf>),
}

impl Footage {
    /// A video, a folder of frames, or frames in order; `fps` in place of a video's own times.
    ///
    /// # Errors
    /// What is wrong with the input, in words.
    pub fn open(input: &[PathBuf], fps: Option<f64>) -> Result<Self> {
        ensure!(fps.is_none_or(|fps| fps.is_finite() && fps > 0.0), "--fps must be positive");
        let media = match input {
            [folder] if folder.is_dir() => FootageSource::Pictures(pictures_in(folder)?),
            [file] if !is_picture(file) => {
                ensure!(file.exists(), "{}: no such video or folder", file.display());
                for words in Oddities::of(file)?.words() {
                    eprintln!("gravisight: note: {}: {words}", file.display());
                }
                FootageSource::Video(file.clone())
            }
            pictures => FootageSource::Pictures(pictures.to_vec()),
        };
        let times = match (&media, fps) {
            (FootageSource::Video(video), fps) => packet_times(video, fps)?,
            (FootageSource::Pictures(pictures), Some(fps)) => {
                note_left_out(pictures);
                evenly(pictures.len(), fps)
            }
            (FootageSource::Pictures(_), None) => bail!("--fps (frames per second) is needed for single frames"),
        };
        let own_times = matches!(media, FootageSource::Video(_)) && fps.is_none();
        let (mut size, mut begun) = (None, None);
        match &media {
            FootageSource::Video(video) => {
                let mut stream = VideoStream::open(video)?;
                size = stream.size()?;
                begun = Some(stream);
            }
            FootageSource::Pictures(pictures) => {
                if let Some(first) = pictures.first() {
                    size = Some(Picture::open(first).with_context(|| first.display().to_string())?.size());
                }
            }
        }
        Ok(Self { media, times, own_times, size, begun: Mutex::new(begun) })
    }

    /// The first frame of a video, whatever it says of its times.
    ///
    /// # Errors
    /// What it cannot be read for.
    pub fn first(video: &Path) -> Result<Picture> {
        Ok(Self::beginning(video, 1)?.swap_remove(0))
    }

    /// The first frames of a video, so many or fewer, whatever it says of its times.
    ///
    /// # Errors
    /// As [`Self::first`].
    pub fn beginning(video: &Path, count: usize) -> Result<Vec<Picture>> {
        ensure!(video.exists(), "{}: no such video", video.display());
        let mut stream = VideoStream::open(video)?;
        let mut pictures = Vec::new();
        while pictures.len() < count
            && let Some(rgb) = stream.read()?
        {
            pictures.push(Picture::from_rgb(rgb));
        }
        ensure!(!pictures.is_empty(), "{}: has no frames", video.display());
        Ok(pictures)
    }

    /// Its name, for people.
    pub fn name(&self) -> String {
        let path = match &self.media {
            FootageSource::Video(path) => Some(path.as_path()),
            FootageSource::Pictures(pictures) => pictures.first().and_then(|first| first.parent()),
        };
        path.unwrap_or(Path::new("")).display().to_string()
    }

    /// When the frames were taken, s.
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// Whether these are a video's own.
    pub fn times_known(&self) -> bool {
        self.own_times
    }

    /// Of its frames.
    pub fn size(&self) -> Option<Size> {
        self.size
    }

    /// Shows the frames of a range, one after the other.
    ///
    /// # Errors
    /// What a frame cannot be read for, and what `visit` returns.
    pub fn each(&self, range: Range<usize>, visit: &mut dyn FnMut(usize, Picture) -> Result<()>) -> Result<()> {
        match &self.media {
            FootageSource::Video(video) => {
                let begun = self.begun.lock().unwrap_or_else(PoisonError::into_inner).take();
                let mut stream = begun.map_or_else(|| VideoStream::open(video), Ok)?;
                let mut number = 0;
                // Some files end before or after what their packets say.
                while number < range.end.min(self.times.len()) {
                    let Some(rgb) = stream.read()? else { break };
                    if range.contains(&number) {
                        visit(number, Picture::from_rgb(rgb))?;
                    }
                    number += 1;
                }
            }
            FootageSource::Pictures(pictures) => {
                for (number, path) in pictures.iter().enumerate().take(range.end).skip(range.start) {
                    let picture = Picture::open(path).with_context(|| path.display().to_string())?;
                    visit(number, picture)?;
                }
            }
        }
        Ok(())
    }
}

/// Says which numbers frames lack: their times are missing, too.
pub fn note_left_out(pictures: &[PathBuf]) {
    let numbers = left_out(pictures);
    if let (Some(first), Some(last)) = (numbers.first(), numbers.last()) {
        eprintln!(
            "gravisight: note: {} numbers between {first} and {last} have no picture: times are computed as if no \
             frame were missing; add the missing frames",
            numbers.len()
        );
    }
}
