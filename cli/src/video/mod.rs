//! Videos: read and written by ffmpeg and ffprobe, programs that the user installs.

mod encoder;
mod probe;

use std::collections::HashMap;
use std::ffi::{OsStr, OsString};
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::OnceLock;
use std::thread::JoinHandle;

use gravisight::{Error, Result, Size};
use image::RgbImage;

pub use self::encoder::Encoder;
use self::probe::Probe;

/// Rows from which on browsers read a video that names no colour matrix as BT.709 (Chromium, `media/ffmpeg/ffmpeg_common.cc`).
const HIGH_DEFINITION: u32 = 720;

/// Longest line of a picture's header.
const HEADER: u64 = 64;

/// The time of every frame, s, as the file says it.
///
/// # Errors
/// [`Error::Data`] where ffprobe is not installed, cannot read it, or finds no times.
pub fn frame_times(video: &Path) -> Result<Vec<f64>> {
    let shown = shown_times(video)?;
    let known: Vec<f64> = shown.iter().copied().flatten().collect();
    if known.len() == shown.len() && !known.is_empty() && Probe::of(video)?.has_times() {
        return Ok(known);
    }
    // AVI says when to decode, and frames that come late have no time to be shown at.
    let packets = packet_times(video, None)?;
    if packets.len() == shown.len() {
        return Ok(packets);
    }
    let reason = format!("has times for only {} of its {} frames; give --fps", known.len(), shown.len());
    Err(Error::Data { what: video.display().to_string(), reason })
}

/// How many frames ffprobe decodes.
///
/// # Errors
/// [`Error::Data`] where ffprobe is not installed or cannot read it.
pub fn count_frames(video: &Path) -> Result<usize> {
    Ok(shown_times(video)?.len())
}

/// The time of every frame, s, as ffprobe reads it; none where the file says nothing.
fn shown_times(video: &Path) -> Result<Vec<Option<f64>>> {
    let arguments = [
        "-v",
        "error",
        "-select_streams",
        "v:0",
        "-show_entries",
        "frame=best_effort_timestamp_time",
        "-of",
        "csv=p=0",
    ];
    let mut command = Command::new("ffprobe");
    command.args(arguments).arg(file_url(video)?);
    let text = output(command, "ffprobe", video)?;
    let time = |line: &str| line.trim().trim_end_matches(',').parse::<f64>().ok().filter(|time| time.is_finite());
    Ok(text.lines().filter(|line| !line.trim().is_empty()).map(time).collect())
}

/// Writes the frames from the first to the last, both included, as `NUMBER.png`, each once.
pub fn extract(video: &Path, [first, last]: [u64; 2], folder: &Path) -> Result<()> {
    let select = format!("select=between(n\\,{first}\\,{last}),{}", Oddities::of(video)?.to_rgb);
    let start = first.to_string();
    let mut command = Command::new("ffmpeg");
    // Run where the frames go: a `%` in a folder's name would count.
    command.current_dir(folder).args(["-v", "error", "-nostdin", "-i"]).arg(file_url(video)?);
    command.args(["-map", "0:v:0", "-vf", &select]).args(passthrough(video)?);
    command.args(["-pix_fmt", "rgb24", "-start_number", &start, "%06d.png"]);
    output(command, "ffmpeg", video).map(drop)
}

/// What a program prints.
fn output(mut command: Command, program: &str, video: &Path) -> Result<String> {
    let refuse = |reason: String| Error::Data { what: video.display().to_string(), reason };
    let output = command.output().map_err(|error| cannot_run(program, &error, video))?;
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        let said: Vec<&str> = said.lines().map(str::trim).collect();
        return Err(refuse(format!("`{program}` cannot read it: {}", said.join("; "))));
    }
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

/// The path as ffmpeg takes it: never an option, never a protocol.
fn file_url(video: &Path) -> Result<OsString> {
    let path = std::path::absolute(video).map_err(Error::io(video))?;
    let mut url = OsString::from("file:");
    url.push::<&OsStr>(path.as_ref());
    Ok(url)
}

/// The option by which each frame comes once: its name since ffmpeg 5.1, and before.
fn passthrough(video: &Path) -> Result<[&'static str; 2]> {
    static KNOWN: OnceLock<[&str; 2]> = OnceLock::new();
    if let Some(known) = KNOWN.get() {
        return Ok(*known);
    }
    let mut command = Command::new("ffmpeg");
    command.arg("-version");
    let text = output(command, "ffmpeg", video)?;
    let version = text.split_whitespace().nth(2).unwrap_or_default();
    let mut numbers = version.split(|c: char| !c.is_ascii_digit()).map(str::parse::<u32>);
    let option = match (numbers.next(), numbers.next()) {
        (Some(Ok(major)), Some(Ok(minor))) if (major, minor) < (5, 1) => ["-vsync", "0"],
        _ => ["-fps_mode", "passthrough"],
    };
    Ok(*KNOWN.get_or_init(|| option))
}

fn cannot_run(program: &str, error: &std::io::Error, video: &Path) -> Error {
    let reason = match error.kind() {
        std::io::ErrorKind::NotFound => format!(
            "reading videos needs `{program}`, which is not installed; install ffmpeg (apt install ffmpeg, brew \
             install ffmpeg, winget install ffmpeg), or give a folder of frames (for import, with --pictures)"
        ),
        _ => format!("`{program}` cannot be run: {error}"),
    };
    Error::Data { what: video.display().to_string(), reason }
}

/// The times of a video's frames, s, from the first one's, ascending, as its packets say them: nothing is decoded. A file without
/// times to show frames at, as AVI has none, says when to decode them: of evenly spaced frames that is the same but for a delay.
/// With `fps` the frames are so many a second, whatever their packets say.
///
/// # Errors
/// [`Error::Data`] where ffprobe is not installed, cannot read it, or finds no times.
pub fn packet_times(video: &Path, fps: Option<f64>) -> Result<Vec<f64>> {
    let probe = Probe::of(video)?;
    let column = |index: usize| probe.packets.iter().filter_map(|times| times[index]).collect::<Vec<f64>>();
    let [shown, decoded] = [0, 1].map(column);
    let mut times = if shown.len() < decoded.len() { decoded } else { shown };
    times.sort_by(f64::total_cmp);
    times.dedup();
    let refuse = |reason: String| Error::Data { what: video.display().to_string(), reason };
    if let Some(fps) = fps {
        let frames = if times.is_empty() { probe.packets.len() } else { times.len() };
        times = evenly(frames, fps);
        if times.is_empty() {
            return Err(refuse("has no picture".into()));
        }
    } else if times.is_empty() || !probe.has_times() {
        return Err(refuse(probe.refusal()));
    }
    let first = times.first().copied().unwrap_or_default();
    times.iter_mut().for_each(|time| *time -= first);
    Ok(times)
}

/// Times of frames, `fps` a second, s.
pub fn evenly(frames: usize, fps: f64) -> Vec<f64> {
    (0..frames).map(|frame| frame as f64 / fps).collect()
}

/// What is odd about a video's pictures.
#[derive(Debug, Default, PartialEq)]
pub struct Oddities {
    /// Each frame is two half pictures, one of odd rows and one of even ones, taken one after the other.
    pub interlaced: bool,
    /// High dynamic range: levels that no usual screen shows.
    pub hdr: bool,
    /// Streams of pictures besides the first.
    pub others: usize,
    /// ffmpeg's filter from its colours to RGB, within a level of what browsers show; the default is up to 2 levels too dark.
    pub to_rgb: String,
}

impl Oddities {
    /// # Errors
    /// [`Error::Data`] where ffprobe is not installed or cannot read it.
    pub fn of(video: &Path) -> Result<Self> {
        let probe = Probe::of(video)?;
        let is = |name: &str, values: &[&str]| {
            probe
                .streams
                .first()
                .and_then(|first| first.get(name))
                .is_some_and(|value| values.contains(&value.as_str()))
        };
        // A song's cover counts as a stream of pictures.
        let films = (probe.streams.iter())
            .filter(|stream| stream.get("disposition:attached_pic").is_none_or(|value| value != "1"));
        Ok(Self {
            interlaced: is("field_order", &["tt", "bb", "tb", "bt"]),
            hdr: is("color_transfer", &["smpte2084", "arib-std-b67"]),
            others: films.count().saturating_sub(1),
            to_rgb: format!("scale=in_color_matrix={}:flags=accurate_rnd+full_chroma_int", matrix_of(&probe.streams)),
        })
    }

    /// For people.
    pub fn words(&self) -> Vec<String> {
        let all = [
            (self.interlaced).then(|| {
                "it is interlaced: only the first field of every frame is used, so small balls are harder to detect; `ffmpeg -i \
                 IN -vf bwdif=send_field OUT` converts it to twice as many frames per second"
                    .to_string()
            }),
            self.hdr.then(|| "it has a high dynamic range (HDR), which is read without tone mapping: contrast is low, \
                              and small balls may be missed".into()),
            (self.others > 0).then(|| format!("it has {} video streams: the first is used", self.others + 1)),
        ];
        all.into_iter().flatten().collect()
    }
}

/// The colour matrix of the first stream, as ffmpeg names it. Where the file names none, browsers take BT.709 from 720 rows on, and
/// ffmpeg BT.601: a frame would not be the same picture in both.
fn matrix_of(streams: &[HashMap<String, String>]) -> &'static str {
    let first = streams.first();
    let value = |name: &str| first.and_then(|stream| stream.get(name)).map(String::as_str);
    let is_unknown = value("color_space").is_none_or(|space| matches!(space, "unknown" | "unspecified" | "N/A"));
    let rows = value("height").and_then(|rows| rows.parse::<u32>().ok()).unwrap_or_default();
    if is_unknown && rows >= HIGH_DEFINITION { "bt709" } else { "auto" }
}

/// The pictures of a video, one after the other: none is kept.
pub struct VideoStream {
    program: Child,
    pictures: BufReader<ChildStdout>,
    /// What ffmpeg says, read beside.
    said: Option<JoinHandle<String>>,
    what: String,
    /// A frame that was looked at and is the next all the same.
    ahead: Option<RgbImage>,
}

impl VideoStream {
    /// From a video's first frame on.
    ///
    /// # Errors
    /// [`Error::Data`] where ffmpeg is not installed.
    pub fn open(video: &Path) -> Result<Self> {
        let what = video.display().to_string();
        let mut command = Command::new("ffmpeg");
        command.args(["-v", "error", "-nostdin", "-i"]).arg(file_url(video)?);
        // Each frame once; pictures with a header of their own: of a film that is turned, they are turned.
        command.args(["-map", "0:v:0"]).args(passthrough(video)?);
        let oddities = Oddities::of(video)?;
        let fields = if oddities.interlaced { "bwdif=mode=send_frame," } else { "" };
        command.args(["-vf", &format!("{fields}{}", oddities.to_rgb)]);
        command.args(["-f", "image2pipe", "-c:v", "ppm", "-pix_fmt", "rgb24", "-"]);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut program = command.spawn().map_err(|error| cannot_run("ffmpeg", &error, video))?;
        let (Some(pictures), Some(errors)) = (program.stdout.take(), program.stderr.take()) else {
            return Err(Error::Data { what, reason: "ffmpeg has no output".into() });
        };
        let said = std::thread::spawn(move || {
            let lines = BufReader::new(errors).lines().map_while(std::result::Result::ok);
            // A damaged film has a line a frame.
            lines.fold(String::new(), |said, line| if said.len() < 500 { said + line.trim() + "; " } else { said })
        });
        Ok(Self { program, pictures: BufReader::with_capacity(1 << 20, pictures), said: Some(said), what, ahead: None })
    }

    /// The size of the next frame, which stays the next; none after the last.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn size(&mut self) -> Result<Option<Size>> {
        self.ahead = self.read()?;
        Ok(self.ahead.as_ref().map(|rgb| Size::new(rgb.width(), rgb.height())))
    }

    /// The next frame; none after the last.
    ///
    /// # Errors
    /// [`Error::Data`] with what ffmpeg says.
    pub fn read(&mut self) -> Result<Option<RgbImage>> {
        if let Some(rgb) = self.ahead.take() {
            return Ok(Some(rgb));
        }
        let mut words = Vec::new();
        while words.len() < 4 {
            let mut line = String::new();
            let count = (&mut self.pictures).take(HEADER).read_line(&mut line);
            match count {
                Ok(0) if words.is_empty() => return self.ended(),
                Ok(1..) => words.extend(line.split_whitespace().map(str::to_owned)),
                _ => return Err(self.refuse("its frames are truncated")),
            }
        }
        let numbers: Vec<u32> = words[1..].iter().filter_map(|word| word.parse().ok()).collect();
        let &[width, height, 255] = numbers.as_slice() else { return Err(self.refuse("ffmpeg gave no picture")) };
        let mut bytes = vec![0; 3 * width as usize * height as usize];
        self.pictures.read_exact(&mut bytes).map_err(|_| self.refuse("its frames are truncated"))?;
        Ok(RgbImage::from_raw(width, height, bytes))
    }

    fn ended(&mut self) -> Result<Option<RgbImage>> {
        let status = self.program.wait();
        let said = self.said.take().and_then(|said| said.join().ok()).unwrap_or_default();
        match status {
            Ok(status) if status.success() => Ok(None),
            _ => Err(self.refuse(&format!("`ffmpeg` cannot read it: {}", said.trim_end_matches("; ")))),
        }
    }

    fn refuse(&self, reason: &str) -> Error {
        Error::Data { what: self.what.clone(), reason: reason.into() }
    }
}

impl Drop for VideoStream {
    fn drop(&mut self) {
        // Whoever stops before the end needs no more of it.
        let _ = self.program.kill();
        let _ = self.program.wait();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stream(fields: &[(&str, &str)]) -> [HashMap<String, String>; 1] {
        [fields.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect()]
    }

    #[test]
    fn a_high_definition_video_without_a_colour_matrix_is_read_as_bt_709() {
        assert_eq!(matrix_of(&stream(&[("height", "1080"), ("color_space", "unknown")])), "bt709");
        assert_eq!(matrix_of(&stream(&[("height", "720")])), "bt709");
        assert_eq!(matrix_of(&stream(&[("height", "576"), ("color_space", "unknown")])), "auto");
        assert_eq!(matrix_of(&stream(&[("height", "1080"), ("color_space", "smpte170m")])), "auto");
        assert_eq!(matrix_of(&[]), "auto");
    }
}
