//! `points.json`: labelled points, read and checked.

use std::path::Path;

use nalgebra::{Matrix3, Point2, Point3};
use serde::Deserialize;

use crate::camera::court::{Court, CourtLine};
use crate::camera::{Camera, Distortion};
use crate::error::{Error, Result, json_refusal};
use crate::size::Size;

/// What a file of points is, for who gave another.
const EXPECTED: &str = "points are a JSON object with width, height, image (px) and world (m), or court and names instead of world; \
                        `gravisight calibrate --help` shows one";

/// Known points and where they were clicked.
#[derive(Debug, Clone)]
pub struct Points {
    /// Size of the picture.
    pub size: Size,
    /// M_int, if it is known.
    pub intrinsic: Option<Matrix3<f64>>,
    /// The lens distortion, if it is known.
    pub distortion: Distortion,
    /// Names of the points; empty where they have none.
    pub names: Vec<String>,
    /// World coordinates, m.
    pub world: Vec<Point3<f64>>,
    /// Where they were clicked, px.
    pub image: Vec<Point2<f64>>,
    /// What is painted where, for [`calibrate_by_lines`](crate::camera::calibrate_by_lines).
    pub lines: Vec<CourtLine>,
    /// 1-σ of the points, px, if they were not clicked, but placed by a camera that was found
    /// ([`FoundCourt::points`](crate::camera::FoundCourt::points)). Its errors are in all of them: they count as four, however many they are. Its lens is a
    /// start, and estimated.
    pub sigma: Option<f64>,
}

/// The file's fields.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PointsFile {
    width: u32,
    height: u32,
    intrinsic: Option<[[f64; 3]; 3]>,
    #[serde(default)]
    distortion: Distortion,
    world: Option<Vec<[f64; 3]>>,
    court: Option<String>,
    names: Option<Vec<String>>,
    image: Vec<[f64; 2]>,
    lines: Option<Vec<CourtLine>>,
    sigma_px: Option<f64>,
}

impl Points {
    /// None yet, in a picture of this size; of a camera of which nothing is known.
    pub fn new(size: Size) -> Self {
        let distortion = Distortion::default();
        Self {
            size,
            intrinsic: None,
            distortion,
            names: vec![],
            world: vec![],
            image: vec![],
            lines: vec![],
            sigma: None,
        }
    }

    /// Reads the text of a `points.json`; `what` names it in errors. World coordinates are in the file (`world`), or
    /// those of named points of a court (`court` and `names`); so are painted lines (`lines`, else the court's).
    ///
    /// # Errors
    /// [`Error::Format`] for a text of another form; [`Error::Value`] for numbers that cannot be; as [`Court::named`].
    pub fn from_json(text: &str, what: &str) -> Result<Self> {
        let refuse = |error| Error::format(what)(json_refusal(&error)).expecting(EXPECTED);
        let file: PointsFile = serde_json::from_str(text).map_err(refuse)?;
        let world = match (&file.court, file.world) {
            (None, Some(world)) => world,
            (Some(court), None) => court_points(court, file.names.as_deref(), what)?,
            (None, None) => return Err(Error::value(what, "world", "is missing; give it, or `court` and `names`")),
            (Some(_), Some(_)) => return Err(Error::value(what, "world", "and `court` cannot both be given")),
        };
        if world.len() != file.image.len() {
            let reason = format!("has {} points, but `world` has {}", file.image.len(), world.len());
            return Err(Error::value(what, "image", reason));
        }
        let names = file.names.unwrap_or_default();
        if !names.is_empty() && names.len() != world.len() {
            return Err(Error::value(what, "names", format!("has {} names for {} points", names.len(), world.len())));
        }
        let of_court = || file.court.as_deref().map(|court| Ok(Court::named(court)?.lines.clone()));
        let lines = file.lines.map(Ok).or_else(of_court).transpose()?.unwrap_or_default();
        if let Some(index) = lines.iter().position(|line| !line.is_possible()) {
            let reason = "is not a valid line: it needs two distinct ends, a width above 0 and, if `paint` is given, a unit vector across the line";
            return Err(Error::value(what, format!("lines[{index}]"), reason));
        }
        if file.sigma_px.is_some_and(|sigma| !(sigma.is_finite() && sigma > 0.0)) {
            return Err(Error::value(what, "sigma_px", "must be positive"));
        }
        let intrinsic = file.intrinsic.map(|rows| Matrix3::from_fn(|row, column| rows[row][column]));
        let size = Size::new(file.width, file.height);
        // Refused as a camera's would be.
        let camera = intrinsic.unwrap_or_else(Matrix3::identity);
        Camera::new(size, camera, file.distortion, Matrix3::identity(), nalgebra::Vector3::zeros())
            .map_err(|error| Error::Data { what: what.into(), reason: error.to_string() })?;
        Ok(Self {
            size,
            intrinsic,
            distortion: file.distortion,
            names,
            world: world.into_iter().map(Point3::from).collect(),
            image: file.image.into_iter().map(Point2::from).collect(),
            lines,
            sigma: file.sigma_px,
        })
    }

    /// Reads a `points.json` file.
    ///
    /// # Errors
    /// [`Error::Io`], else as [`Self::from_json`].
    pub fn from_file(path: &Path) -> Result<Self> {
        let text = crate::files::read_text(path).map_err(|error| error.expecting(EXPECTED))?;
        Self::from_json(&text, &path.display().to_string())
    }
}

/// World coordinates of a court's points.
fn court_points(court: &str, names: Option<&[String]>, what: &str) -> Result<Vec<[f64; 3]>> {
    let court_points = &Court::named(court)?.points;
    let names = names.ok_or_else(|| Error::value(what, "names", "of the court's points are missing"))?;
    let point = |(index, name): (usize, &String)| {
        court_points.get(name).copied().ok_or_else(|| {
            let known = court_points.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
            Error::value(
                what,
                format!("names[{index}]"),
                format!("`{name}` is not a point of {court}; choose one of {known}"),
            )
        })
    };
    names.iter().enumerate().map(point).collect()
}
