//! What a video's file says of itself.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;

use gravisight::Result;

use super::{file_url, output};

/// Containers (ffprobe's names) that hold pictures alone: what ffprobe says of their times is a default of 25 frames a second.
const WITHOUT_TIMES: [&str; 12] =
    ["av1", "cavsvideo", "dirac", "h261", "h263", "h264", "hevc", "jpeg_pipe", "m4v", "mjpeg", "mpegvideo", "vvc"];

/// What ffprobe says of a file, of which it decodes nothing.
pub struct Probe {
    /// Its containers' names.
    formats: String,
    /// What its streams of pictures say, by name.
    pub streams: Vec<HashMap<String, String>>,
    /// When the packets of the first one are shown and decoded, s; as many as there are.
    pub packets: Vec<[Option<f64>; 2]>,
}

/// A file, when it was changed, and what was said of it.
type Known = (PathBuf, Option<SystemTime>, Arc<Probe>);

impl Probe {
    /// Asked once, and of the same file not again: to start ffprobe takes a third of a second.
    ///
    /// # Errors
    /// [`Error::Data`](gravisight::Error::Data) where ffprobe is not installed or cannot read it.
    pub fn of(video: &Path) -> Result<Arc<Self>> {
        static LAST: Mutex<Option<Known>> = Mutex::new(None);
        let changed = video.metadata().and_then(|said| said.modified()).ok();
        let mut last = LAST.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((path, then, probe)) = &*last
            && path == video
            && *then == changed
        {
            return Ok(probe.clone());
        }
        let probe = Arc::new(Self::asked(video)?);
        *last = Some((video.to_path_buf(), changed, probe.clone()));
        Ok(probe)
    }

    fn asked(video: &Path) -> Result<Self> {
        let entries = "format=format_name:stream=index,height,r_frame_rate,field_order,color_space,color_transfer\
                       :stream_disposition=attached_pic:packet=stream_index,pts_time,dts_time";
        let mut command = Command::new("ffprobe");
        command.args(["-v", "error", "-select_streams", "v", "-show_entries", entries, "-of", "compact"]);
        command.arg(file_url(video)?);
        let text = output(command, "ffprobe", video)?;
        let (mut formats, mut streams, mut packets) = (String::new(), vec![], vec![]);
        for line in text.lines() {
            let mut parts = line.trim().split('|');
            let kind = parts.next();
            let said = parts.filter_map(|part| part.split_once('='));
            match kind {
                Some("format") => formats = said.map(|(_, value)| value).collect(),
                Some("stream") => {
                    streams
                        .push(said.map(|(name, value)| (name.to_owned(), value.to_owned())).collect::<HashMap<_, _>>());
                }
                Some("packet") => {
                    let (mut stream, mut times) = (0, [None; 2]);
                    for (name, value) in said {
                        let time = || value.parse::<f64>().ok().filter(|time| time.is_finite());
                        match name {
                            "stream_index" => stream = value.parse::<usize>().unwrap_or_default(),
                            "pts_time" => times[0] = time(),
                            "dts_time" => times[1] = time(),
                            _ => {}
                        }
                    }
                    packets.push((stream, times));
                }
                _ => {}
            }
        }
        let first = streams.first().and_then(|first| first.get("index")?.parse::<usize>().ok());
        let packets =
            packets.into_iter().filter(|(stream, _)| Some(*stream) == first).map(|(_, times)| times).collect();
        Ok(Self { formats, streams, packets })
    }

    /// Frames a second, as the first stream has them; a raw stream that says none has 25.
    fn rate(&self) -> Option<f64> {
        let (above, below) = self.streams.first()?.get("r_frame_rate")?.split_once('/')?;
        let rate = above.parse::<f64>().ok()? / below.parse::<f64>().ok()?;
        (rate.is_finite() && rate > 0.0).then_some(rate)
    }

    pub fn has_times(&self) -> bool {
        !self.formats.split(',').any(|format| WITHOUT_TIMES.contains(&format))
    }

    /// Why there are no times, and what to do.
    pub fn refusal(&self) -> String {
        let rate = self.rate().map_or(String::new(), |rate| {
            let digits = if rate.fract().abs() < 5e-4 { 0 } else { 3 };
            format!(" (ffprobe reports {rate:.digits$} per second, which may be just a default)")
        });
        match self.has_times() {
            true => "has no frames, or no times for them; give --fps".into(),
            false => format!(
                "is a raw stream ({}) without times for its frames; give the frames per second with --fps{rate}",
                self.formats
            ),
        }
    }
}
