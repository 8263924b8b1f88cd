//! The paper's synthetic data set and its ball on a spring: pictures, `label.csv`, `info.txt`.

use std::path::{Path, PathBuf};

use nalgebra::{Matrix3, Point2, Vector3};

use super::draft::{Draft, Job, Shot, fps_of};
use super::pictures::{files_below, id_of, one_a_row, read_text, tail};
use super::{Format, ImportOptions};
use gravisight::Picture;
use gravisight::Scene;
use gravisight::internal::{self, Table};
use gravisight::parts::Distortion;
use gravisight::{Camera, Size};
use gravisight::{Error, Result};

/// Largest mean distance of the labels from the projected positions, in widths of the picture: the published ones are
/// off by up to 3 px of 224, which is a quarter of it.
const MAX_DISAGREEMENT: f64 = 0.05;
/// The tables.
pub(super) const LABELS: &str = "label.csv";
/// The matrices.
const INFO: &str = "info.txt";

/// A job for every folder with a table.
pub(super) fn jobs(source: &Path, format: Format, options: &ImportOptions) -> Result<Vec<Job>> {
    let source = std::path::absolute(source).map_err(Error::io(source))?;
    let tables = files_below(&source, &|path| path.file_name().is_some_and(|name| name == LABELS))?;
    let job = |table: PathBuf| {
        let folder = table.parent().unwrap_or(&source).to_path_buf();
        let id = id(&folder, format);
        let name = id.as_ref().map_or_else(|_| folder.display().to_string(), String::clone);
        let scene = options.scene.clone().or_else(|| published_scene(&name, format));
        let misplaced = id.err();
        let read = move |_: &Path| match &misplaced {
            Some(reason) => Err(Error::Data { what: folder.display().to_string(), reason: reason.clone() }),
            None => draft(&folder, scene.clone()),
        };
        Job { id: name, read: Box::new(read) }
    };
    Ok(tables.into_iter().map(job).collect())
}

/// `train/env1/cam1/0007` of `train/xml0/camera0/7`; `train/spring/cam1/0007` of `train/7`.
fn id(folder: &Path, format: Format) -> std::result::Result<String, String> {
    let after = |name: &str, prefix: &str| name.strip_prefix(prefix).and_then(|number| number.parse::<u32>().ok());
    if format == Format::Spring {
        let [split, video] = tail(folder).ok_or("is not in SPLIT/VIDEO/")?;
        return Ok(id_of([split.as_str(), "spring", "cam1", &video]));
    }
    let misplaced = "is not in SPLIT/xmlN/cameraM/VIDEO/, where the synthetic data set has its videos";
    let [split, xml, camera, video] = tail(folder).ok_or(misplaced)?;
    let (xml, camera) = after(&xml, "xml").zip(after(&camera, "camera")).ok_or(misplaced)?;
    let [environment, camera] = [format!("env{}", u64::from(xml) + 1), format!("cam{}", u64::from(camera) + 1)];
    Ok(id_of([split.as_str(), &environment, &camera, &video]))
}

/// The scene that the paper made a clip in.
fn published_scene(id: &str, format: Format) -> Option<Scene> {
    let place = match format {
        Format::Spring => internal::Site::Spring,
        _ => internal::Site::Environment(id.split('/').nth(1)?.strip_prefix("env")?.parse().ok()?),
    };
    internal::Shot { site: place, camera: 1 }.scene().ok()
}

fn draft(folder: &Path, scene: Option<Scene>) -> Result<Draft> {
    let path = folder.join(LABELS);
    let table = Table::from_file(&path)?;
    let pictures = one_a_row(folder, "image-", table.rows.len(), LABELS)?;
    let what = path.display().to_string();
    let first = pictures.first().ok_or_else(|| Error::Format { what: what.clone(), message: "has no rows".into() })?;
    let size = Picture::open(first)
        .map_err(|error| Error::Data { what: first.display().to_string(), reason: error.to_string() })?
        .size();
    let info = folder.join(INFO);
    let camera = Matrices::from_text(&read_text(&info)?, &info.display().to_string())?.camera(size)?;
    let shots = shots(&table, pictures, f64::from(size.height))?;
    let draft = Draft::new(camera, scene, fps_of(&shots)?, shots);
    draft.agrees(&info)?;
    Ok(draft)
}

fn shots(table: &Table, pictures: Vec<PathBuf>, height: f64) -> Result<Vec<Shot>> {
    let position = table.columns(["ball x", "ball y", "ball z"])?;
    let image = table.columns(["ball imgx", "ball imgy"])?;
    let [time, visible] = table.columns(["t", "ball visible"])?;
    let shot = |(row, picture): (&gravisight::internal::Row, PathBuf)| {
        let seen = row.flag(visible)?;
        // Rows are counted from the bottom.
        let label = || row.numbers(image).map(|[x, from_bottom]| Point2::new(x, height - from_bottom));
        let image = seen.then(label).transpose()?;
        Ok(Shot { picture, what: row.what.clone(), t: row.number(time)?, image, world: Some(row.numbers(position)?) })
    };
    table.rows.iter().zip(pictures).map(shot).collect()
}

impl Draft {
    /// Refuses matrices that do not belong to the labels.
    fn agrees(&self, info: &Path) -> Result<()> {
        let both = self.shots.iter().filter(|shot| shot.image.is_some()).count();
        let distances: Vec<f64> = self.reprojection_px().collect();
        let mean = distances.iter().sum::<f64>() / distances.len().max(1) as f64;
        if distances.len() == both && mean <= MAX_DISAGREEMENT * f64::from(self.camera.size().width) {
            return Ok(());
        }
        let reason = format!(
            "its matrices do not belong to {LABELS}: {} of {both} balls are behind the camera, the others are {mean:.1} px \
             from their labels on average",
            both - distances.len()
        );
        Err(Error::Data { what: info.display().to_string(), reason })
    }
}

/// `info.txt`: `E` and four rows, `I` and three.
#[derive(Debug)]
struct Matrices {
    what: String,
    extrinsic: Vec<[f64; 4]>,
    intrinsic: Vec<[f64; 3]>,
}

impl Matrices {
    fn from_text(text: &str, what: &str) -> Result<Self> {
        let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
        let refuse = |what: String, message: String| Error::Format { what, message };
        let mut rows = |name: &str, count: usize| -> Result<Vec<Vec<f64>>> {
            let missing = || refuse(what.into(), format!("must have a line `{name}` and {count} rows below it"));
            lines.find(|(_, line)| line.trim().trim_end_matches([':', ',']) == name).ok_or_else(missing)?;
            let row = |_| {
                let (index, line) = lines.next().ok_or_else(missing)?;
                numbers(line).ok_or_else(|| {
                    refuse(format!("{what}:{}", index + 1), format!("must be a row of numbers, not `{}`", line.trim()))
                })
            };
            (0..count).map(row).collect()
        };
        let (extrinsic, intrinsic) = (rows("E", 4)?, rows("I", 3)?);
        let extrinsic = extrinsic.into_iter().map(|row| row.try_into().ok()).collect::<Option<Vec<[f64; 4]>>>();
        // A fourth column of zeros, of a 3×4 matrix, says nothing.
        let three = |row: Vec<f64>| match *row.as_slice() {
            [x, y, z] | [x, y, z, 0.0] => Some([x, y, z]),
            _ => None,
        };
        let intrinsic = intrinsic.into_iter().map(three).collect::<Option<Vec<_>>>();
        match (extrinsic, intrinsic) {
            (Some(extrinsic), Some(intrinsic)) => Ok(Self { what: what.into(), extrinsic, intrinsic }),
            _ => Err(refuse(what.into(), "`E` must have rows of four numbers, `I` rows of three".into())),
        }
    }

    /// The rows of the extrinsic matrix are left, up, forward; ours are right, down, forward. The intrinsic matrix
    /// acts on theirs, so its focal lengths have signs of their own.
    fn camera(&self, size: Size) -> Result<Camera> {
        let turn = Matrix3::from_diagonal(&Vector3::new(-1.0, -1.0, 1.0));
        let rotation = turn * Matrix3::from_fn(|row, column| self.extrinsic[row][column]);
        let translation = turn * Vector3::from_fn(|row, _| self.extrinsic[row][3]);
        let mut intrinsic = Matrix3::from_fn(|row, column| self.intrinsic[row][column]);
        intrinsic[(0, 0)] = intrinsic[(0, 0)].abs();
        intrinsic[(1, 1)] = intrinsic[(1, 1)].abs();
        let camera = Camera::new(size, intrinsic, Distortion::default(), rotation, translation);
        camera.map_err(|error| Error::Data { what: self.what.clone(), reason: error.to_string() })
    }
}

/// Finite numbers separated by commas or spaces, a comma at the end or not.
fn numbers(line: &str) -> Option<Vec<f64>> {
    let parts = line.split(|c: char| c == ',' || c.is_whitespace()).filter(|part| !part.is_empty());
    parts.map(|part| part.parse::<f64>().ok().filter(|value| value.is_finite())).collect()
}
