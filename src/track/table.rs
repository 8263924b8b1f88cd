//! 2D tracks: CSV with the columns `Frame,Visibility,X,Y`, the common format of 2D ball trackers.

use nalgebra::Point2;
use serde::{Deserialize, Serialize};

use super::{Fit, Observation};
use crate::error::{Error, Result};

/// The columns of a file.
const COLUMNS: [&str; 4] = ["Frame", "Visibility", "X", "Y"];
/// Longest run of frames that a file may leave out: they are filled in as frames without the ball.
const LONGEST_GAP: u64 = 1000;

/// One line of a 2D track.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "PascalCase")]
pub struct TrackPoint {
    /// Number of the frame.
    pub frame: u64,
    /// 0 where the ball is not seen; `x` and `y` mean nothing then.
    pub visibility: u8,
    /// px.
    pub x: Option<f64>,
    /// px.
    pub y: Option<f64>,
}

/// A 2D track, by ascending frames.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// Its lines.
    pub points: Vec<TrackPoint>,
}

/// One line of a fitted trajectory.
#[derive(Serialize)]
struct TrajectoryLine {
    #[serde(rename = "Frame")]
    frame: u64,
    t: f64,
    x: f64,
    y: f64,
    z: f64,
    vx: f64,
    vy: f64,
    vz: f64,
    sigma: f64,
    residual_x_px: Option<f64>,
    residual_y_px: Option<f64>,
    outlier: bool,
}

impl TrackPoint {
    fn image(&self) -> Option<Point2<f64>> {
        let image = Point2::new(self.x?, self.y?);
        (image.x.is_finite() && image.y.is_finite()).then_some(image)
    }
}

impl Track {
    /// Reads a file.
    ///
    /// # Errors
    /// [`Error::Io`], else as [`Self::from_csv`].
    #[cfg(not(target_arch = "wasm32"))]
    pub fn from_file(path: &std::path::Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(Error::io(path))?;
        Self::from_csv(&text, &path.display().to_string())
    }

    /// Reads the text of a file; `what` names it in errors.
    ///
    /// # Errors
    /// [`Error::Format`] for a line that cannot be read (it is named), [`Error::Value`] for frames that do
    /// not ascend, a position that is not finite, or too long a gap.
    pub fn from_csv(text: &str, what: &str) -> Result<Self> {
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_bytes());
        let header = reader.headers().map_err(Error::format(what))?.clone();
        if !COLUMNS.iter().all(|column| header.iter().any(|found| found == *column)) {
            let found: Vec<&str> = header.iter().take(COLUMNS.len()).collect();
            let message =
                format!("no 2D track: the first line must be {}, not {}…", COLUMNS.join(","), found.join(","));
            return Err(Error::Format { what: what.into(), message });
        }
        let points: Vec<TrackPoint> = reader.deserialize().collect::<csv::Result<_>>().map_err(Error::format(what))?;
        for (index, point) in points.iter().enumerate() {
            let line = format!("{what}: line {}", index + 2);
            if point.visibility > 0 && point.image().is_none() {
                return Err(Error::value(line, "X, Y", "must be numbers where Visibility is not 0"));
            }
            let Some(before) = index.checked_sub(1).map(|before| points[before].frame) else { continue };
            if point.frame <= before {
                return Err(Error::value(line, "Frame", format!("must ascend: {} follows {before}", point.frame)));
            }
            if point.frame - before > LONGEST_GAP {
                let reason = format!("leaves out more than {LONGEST_GAP} frames after {before}; split the track there");
                return Err(Error::value(line, "Frame", reason));
            }
        }
        Ok(Self { points })
    }

    /// The text of a file.
    ///
    /// # Errors
    /// [`Error::Format`] where a number cannot be written.
    pub fn to_csv(&self) -> Result<String> {
        csv_of(&self.points)
    }

    /// One observation a frame, those left out among them (not seen), at `frame / fps` s; and the frames' numbers.
    ///
    /// # Errors
    /// [`Error::Value`] for an `fps` that is not positive.
    pub fn observations(&self, fps: f64) -> Result<(Vec<u64>, Vec<Observation>)> {
        if !(fps.is_finite() && fps > 0.0) {
            return Err(Error::value("track", "fps", format!("must be positive, not {fps}")));
        }
        let (Some(first), Some(last)) = (self.points.first(), self.points.last()) else { return Ok((vec![], vec![])) };
        let mut points = self.points.iter().peekable();
        let frames: Vec<u64> = (first.frame..=last.frame).collect();
        let observations = frames.iter().map(|&frame| {
            let point = points.next_if(|point| point.frame == frame);
            let seen = point.filter(|point| point.visibility > 0);
            Observation { time: frame as f64 / fps, image: seen.and_then(TrackPoint::image) }
        });
        let observations = observations.collect();
        Ok((frames, observations))
    }
}

impl Fit {
    /// As CSV: the frames' numbers, time (s), position (m), velocity (m/s), 1-σ of the position (m), residual (px), whether
    /// the label is an outlier.
    ///
    /// # Errors
    /// [`Error::Format`] where a number cannot be written.
    pub fn to_csv(&self, frames: &[u64]) -> Result<String> {
        let line = |(frame, fitted): (&u64, &super::FittedFrame)| {
            let (r, v) = (fitted.state.position, fitted.state.velocity);
            TrajectoryLine {
                frame: *frame,
                t: fitted.time,
                x: r.x,
                y: r.y,
                z: r.z,
                vx: v.x,
                vy: v.y,
                vz: v.z,
                sigma: fitted.sigma(),
                residual_x_px: fitted.residual_px.map(|residual| residual.x),
                residual_y_px: fitted.residual_px.map(|residual| residual.y),
                outlier: fitted.outlier,
            }
        };
        csv_of(&frames.iter().zip(&self.frames).map(line).collect::<Vec<_>>())
    }
}

/// Lines with a header.
fn csv_of<T: Serialize>(lines: &[T]) -> Result<String> {
    let refuse = |message: String| Error::Format { what: "CSV".into(), message };
    let mut writer = csv::Writer::from_writer(vec![]);
    for line in lines {
        writer.serialize(line).map_err(|error| refuse(error.to_string()))?;
    }
    let bytes = writer.into_inner().map_err(|error| refuse(error.to_string()))?;
    String::from_utf8(bytes).map_err(|error| refuse(error.to_string()))
}
