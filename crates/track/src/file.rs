//! 2D tracks: CSV with the columns `Frame,Visibility,X,Y`, the common format of 2D ball trackers, and optionally
//! `Time`, `Radius`, `RadiusSigma`, `Sigma`. Others' names of these are read as well.

use nalgebra::Point2;
use serde::Serialize;

use super::{Fit, FittedFrame, Observation};
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::table::{Column, Row, Table};

/// What a track's file is, for who gave another.
const EXPECTED: &str = "a 2D track is a CSV table whose first line is Frame,Visibility,X,Y (optionally also Time, in seconds); `gravisight \
                        track VIDEO --out track.csv` writes one, and so do other trackers";
/// The columns of a file, and those that it may have.
const COLUMNS: [&str; 4] = ["Frame", "Visibility", "X", "Y"];
const TIME: &str = "Time";
/// As other trackers call them (case, spaces and underscores are all the same).
const FRAMES: [&str; 6] = [COLUMNS[0], "frame index", "frame number", "frame num", "frame id", "frame no"];
const VISIBLE: [&str; 3] = [COLUMNS[1], "visible", "vis"];
const ACROSS: [&str; 8] = [COLUMNS[2], "x centroid", "x center", "x centre", "xc", "cx", "ball x", "x px"];
const DOWN: [&str; 8] = [COLUMNS[3], "y centroid", "y center", "y centre", "yc", "cy", "ball y", "y px"];
const TIMES: [&str; 7] = [TIME, "timestamp", "timestamp sec", "timestamp s", "time sec", "time s", "seconds"];
/// What a table of numbers alone holds.
const NAMELESS: [&str; 3] = [COLUMNS[0], COLUMNS[2], COLUMNS[3]];
/// Where trackers put a ball that they do not see, px.
const NOWHERE: [[f64; 2]; 2] = [[0.0, 0.0], [-1.0, -1.0]];
const SIZES: [&str; 3] = ["Radius", "RadiusSigma", "Sigma"];
/// Longest run of frames that a file may leave out: they are filled in as frames without the ball.
const LONGEST_GAP: u64 = 1000;

/// One line of a 2D track.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TrackPoint {
    /// Number of the frame.
    pub frame: u64,
    /// 0 where the ball is not seen; `x` and `y` mean nothing then.
    pub visibility: u8,
    /// px.
    pub x: Option<f64>,
    /// px.
    pub y: Option<f64>,
    /// When the frame was taken, s; all points of a track have one, or none.
    pub time: Option<f64>,
    /// Radius of the ball's picture, px.
    pub radius: Option<f64>,
    /// Standard deviation of the radius, px.
    pub radius_sigma: Option<f64>,
    /// Standard deviation of `x` and `y`, px.
    pub sigma: Option<f64>,
}

/// A 2D track, by ascending frames.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// Its lines.
    pub points: Vec<TrackPoint>,
    /// Lines of a file that have the ball at (0, 0) or (−1, −1) and do not say that it is not visible: it is taken as that.
    pub nowhere: usize,
}

/// One line of a fitted trajectory.
#[derive(Serialize)]
struct TrajectoryLine {
    #[serde(rename = "Frame")]
    frame: usize,
    time: f64,
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
    /// A frame in which the ball's centre is at `image`, px.
    pub fn seen(frame: u64, image: Point2<f64>) -> Self {
        Self { frame, visibility: 1, x: Some(image.x), y: Some(image.y), ..Self::default() }
    }

    /// A frame in which it is not seen.
    pub fn unseen(frame: u64) -> Self {
        Self { frame, ..Self::default() }
    }

    /// Which column of this line cannot follow `before`, and why.
    fn follows(&self, before: &Self) -> std::result::Result<(), (&'static str, String)> {
        if self.frame <= before.frame {
            return Err((COLUMNS[0], format!("must ascend: {} follows {}", self.frame, before.frame)));
        }
        match (self.time, before.time) {
            (Some(time), Some(earlier)) if time <= earlier || time.is_nan() => {
                Err((TIME, format!("must ascend: {time} s follows {earlier} s")))
            }
            _ => Ok(()),
        }
    }

    /// Where the ball is seen, px.
    pub fn image(&self) -> Option<Point2<f64>> {
        let image = Point2::new(self.x?, self.y?);
        (self.visibility > 0 && image.x.is_finite() && image.y.is_finite()).then_some(image)
    }

    /// Radius of the ball's picture and its standard deviation (where the file has none, the larger of 5 % and 0.3 px), px.
    pub fn size(&self) -> Option<[f64; 2]> {
        let radius = self.radius.filter(|&radius| radius > 0.0 && self.image().is_some())?;
        Some([radius, self.radius_sigma.filter(|&sigma| sigma > 0.0).unwrap_or((0.05 * radius).max(0.3))])
    }
}

impl Track {
    /// A track of these lines.
    ///
    /// # Errors
    /// [`Error::Value`] for frames or times that do not ascend, and for times that only some points have.
    ///
    /// ```
    /// # mod gravisight {
    /// # pub use gravisight_geometry::{camera, camera::*, error::*, image::*, size::*};
    /// # pub use gravisight_physics::*;
    /// # pub use gravisight_track::{self as track, findings::*, *};
    /// # }
    /// use gravisight::Track;
    /// use gravisight::track::TrackPoint;
    /// use nalgebra::Point2;
    ///
    /// let seen = [(0, 410.5, 300.0), (1, 421.0, 288.5), (3, 441.5, 267.0)];
    /// let track = Track::new(seen.map(|(frame, x, y)| TrackPoint::seen(frame, Point2::new(x, y))).to_vec())?;
    /// // One a frame: in frame 2 it was not seen.
    /// let (frames, observations) = track.observations(Some(30.0))?;
    /// assert_eq!(frames, [0, 1, 2, 3]);
    /// assert!(observations[2].image.is_none() && observations[3].time == 0.1);
    /// # Ok::<(), gravisight::Error>(())
    /// ```
    pub fn new(points: Vec<TrackPoint>) -> Result<Self> {
        for pair in points.windows(2) {
            pair[1].follows(&pair[0]).map_err(|(column, reason)| Error::value("track", column, reason))?;
        }
        let timed = points.iter().filter(|point| point.time.is_some()).count();
        if ![0, points.len()].contains(&timed) {
            let reason =
                format!("is given for {timed} of {} points: give it for all of them, or for none", points.len());
            return Err(Error::value("track", TIME, reason));
        }
        Ok(Self { points, nowhere: 0 })
    }

    /// Reads a file.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] for a file that is no text, else as [`Self::from_csv`].
    #[cfg(not(target_arch = "wasm32"))]
    pub fn from_file(path: &std::path::Path) -> Result<Self> {
        let text = Table::text_of(path).map_err(|error| error.expecting(EXPECTED))?;
        Self::from_csv(&text, &path.display().to_string())
    }

    /// Reads the text of a file; `what` names it in errors. `Visibility` may be left out: a ball that is nowhere, or at (0, 0) or
    /// (−1, −1), is not seen. Of `Frame` and `Time` one is enough. Three numbers a line without names are frame, x, y.
    ///
    /// # Errors
    /// [`Error::Format`] where a column is missing, [`Error::Value`] for a number that cannot be (line and column are
    /// named), and for frames or times that do not ascend.
    pub fn from_csv(text: &str, what: &str) -> Result<Self> {
        let table = match Table::without_names(text, what, &NAMELESS) {
            Some(table) => table,
            None => Table::from_text(text, what).map_err(|error| error.expecting(EXPECTED))?,
        };
        let columns = Columns::of(&table)?;
        let mut points: Vec<TrackPoint> = Vec::with_capacity(table.rows.len());
        let mut nowhere = 0;
        for (index, row) in table.rows.iter().enumerate() {
            let (point, is_nowhere) = columns.point(row, index as u64)?;
            nowhere += usize::from(is_nowhere);
            if let Some(before) = points.last() {
                point.follows(before).map_err(|(column, reason)| Error::value(&row.what, column, reason))?;
            }
            points.push(point);
        }
        Ok(Self { points, nowhere })
    }

    /// The text of a file; optional columns are there if a point has a number in them.
    ///
    /// # Errors
    /// [`Error::Format`] where a number cannot be written.
    pub fn to_csv(&self) -> Result<String> {
        let optional = |point: &TrackPoint| [point.time, point.radius, point.radius_sigma, point.sigma];
        let names = [TIME].into_iter().chain(SIZES).enumerate();
        let present: Vec<(usize, &str)> =
            names.filter(|(index, _)| self.points.iter().any(|point| optional(point)[*index].is_some())).collect();
        let header: Vec<&str> = COLUMNS.into_iter().chain(present.iter().map(|(_, name)| *name)).collect();
        let line = |point: &TrackPoint| {
            let more: Vec<Option<f64>> = present.iter().map(|(index, _)| optional(point)[*index]).collect();
            (point.frame, point.visibility, point.x, point.y, more)
        };
        text_of(Some(&header), self.points.iter().map(line))
    }

    /// One observation a frame, those left out among them (not seen), and the frames' numbers. They are at their own
    /// times, those left out evenly between; without times, at `frame / fps` s.
    ///
    /// # Errors
    /// [`Error::Value`] for an `fps` that is not positive, or missing where it is needed; for frames left out by the
    /// thousand.
    pub fn observations(&self, fps: Option<f64>) -> Result<(Vec<u64>, Vec<Observation>)> {
        if let Some(fps) = fps.filter(|fps| !(fps.is_finite() && *fps > 0.0)) {
            return Err(Error::value("track", "fps", format!("must be positive, not {fps}")));
        }
        let time = |point: &TrackPoint| {
            let missing = || Error::value("track", "fps", "is missing, and the track has no column `Time`");
            point.time.or_else(|| Some(point.frame as f64 / fps?)).ok_or_else(missing)
        };
        let (mut frames, mut observations): (Vec<u64>, Vec<Observation>) = (vec![], vec![]);
        for point in &self.points {
            let now = time(point)?;
            if let (Some(&frame), Some(&Observation { time: before, .. })) = (frames.last(), observations.last()) {
                if point.frame - frame > LONGEST_GAP {
                    let reason = format!("skips more than {LONGEST_GAP} frames after {frame}; split the track there");
                    return Err(Error::value("track", COLUMNS[0], reason));
                }
                for between in frame + 1..point.frame {
                    let fraction = (between - frame) as f64 / (point.frame - frame) as f64;
                    let time = match point.time {
                        Some(_) => before + (now - before) * fraction,
                        None => between as f64 / fps.unwrap_or(1.0),
                    };
                    frames.push(between);
                    observations.push(Observation { time, ..Observation::default() });
                }
            }
            frames.push(point.frame);
            observations.push(Observation { time: now, image: point.image(), radius: point.size() });
        }
        Ok((frames, observations))
    }
}

/// Where a table has what.
struct Columns<'a> {
    /// None where times stand for it.
    frame: Option<Column<'a>>,
    visibility: Option<Column<'a>>,
    place: [Column<'a>; 2],
    time: Option<Column<'a>>,
    sizes: [Option<Column<'a>>; 3],
}

impl Columns<'_> {
    fn of(table: &Table) -> Result<Self> {
        let required = |names: &[&'static str]| match table.column_of(names) {
            Some(column) => Ok(column),
            None => table.column(names[0]).map_err(|error| error.expecting(EXPECTED)),
        };
        let (time, sizes) = (table.column_of(&TIMES), SIZES.map(|name| table.column_if_any(name)));
        let frame = match time {
            Some(_) => table.column_of(&FRAMES),
            None => Some(required(&FRAMES)?),
        };
        Ok(Self {
            frame,
            visibility: table.column_of(&VISIBLE),
            place: [required(&ACROSS)?, required(&DOWN)?],
            time,
            sizes,
        })
    }

    /// The track's point of this `index`, from its row, and whether the row claims a visible ball at a placeholder position ([`NOWHERE`]).
    fn point(&self, row: &Row, index: u64) -> Result<(TrackPoint, bool)> {
        let level = match self.visibility {
            Some(column) if !row.flag(column)? => 0,
            Some(column) => row.count(column).map_or(1, |level| level.min(255) as u8),
            None => 1,
        };
        let place = match (level, self.visibility) {
            // They mean nothing then, whatever stands there.
            (0, _) => self.place.map(|column| row.number_if_any(column).unwrap_or_default()),
            (_, Some(_)) => row.numbers(self.place)?.map(Some),
            (_, None) => {
                let [x, y] = self.place.map(|column| row.number_if_any(column));
                [x?, y?]
            }
        };
        let [x, y] = place;
        let is_nowhere = level > 0 && x.zip(y).is_some_and(|(x, y)| NOWHERE.contains(&[x, y]));
        let visibility = if is_nowhere || x.is_none() || y.is_none() { 0 } else { level };
        let size = |column: Option<Column<'_>>| match column.map(|column| row.number_if_any(column)).transpose()? {
            Some(Some(size)) if size < 0.0 => {
                let reason = format!("must not be negative, but is {size}");
                Err(Error::value(&row.what, column.map_or("", |column| column.name()), reason))
            }
            size => Ok(size.flatten()),
        };
        let [radius, radius_sigma, sigma] = self.sizes;
        let point = TrackPoint {
            frame: self.frame.map_or(Ok(index), |column| row.count(column))?,
            visibility,
            x,
            y,
            time: self.time.map(|column| row.number(column)).transpose()?,
            radius: size(radius)?,
            radius_sigma: size(radius_sigma)?,
            sigma: size(sigma)?,
        };
        Ok((point, is_nowhere))
    }
}

impl Fit {
    /// As CSV: the frames' numbers, time (s), position (m), velocity (m/s), 1-σ of the position (m), residual (px), whether
    /// the label is an outlier.
    ///
    /// # Errors
    /// [`Error::Format`] where a number cannot be written.
    pub fn to_csv(&self) -> Result<String> {
        let line = |fitted: &FittedFrame| {
            let (r, v) = (fitted.world, fitted.velocity);
            TrajectoryLine {
                frame: fitted.frame,
                time: fitted.time,
                x: r.x,
                y: r.y,
                z: r.z,
                vx: v.x,
                vy: v.y,
                vz: v.z,
                sigma: fitted.sigma,
                residual_x_px: fitted.residual_px.map(|residual| residual.x),
                residual_y_px: fitted.residual_px.map(|residual| residual.y),
                outlier: fitted.outlier,
            }
        };
        text_of(None, self.frames.iter().map(line))
    }
}

/// Lines under `header`, or under the names of their fields.
fn text_of<T: Serialize>(header: Option<&[&str]>, lines: impl IntoIterator<Item = T>) -> Result<String> {
    let refuse = |error: csv::Error| Error::Format { what: "CSV".into(), message: error.to_string() };
    let mut writer = csv::WriterBuilder::new().has_headers(header.is_none()).from_writer(vec![]);
    header.map(|header| writer.write_record(header)).transpose().map_err(refuse)?;
    for line in lines {
        writer.serialize(line).map_err(refuse)?;
    }
    let bytes = writer.into_inner().map_err(|error| refuse(error.into_error().into()))?;
    String::from_utf8(bytes).map_err(Error::format("CSV"))
}
