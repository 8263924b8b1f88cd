//! The paper's real data set: pictures, depth pictures, tables, `matrices.npz`.

use std::path::{Path, PathBuf};

use nalgebra::{Matrix3, Point2, Vector3};

use super::ImportOptions;
use super::draft::{Draft, Job, Shot, fps_of};
use super::npz;
use super::pictures::{by_number, files_below, id_of, last_number, one_a_row, tail};
use gravisight::Picture;
use gravisight::Scene;
use gravisight::internal::{Row, Table};
use gravisight::parts::Distortion;
use gravisight::{Camera, Size};
use gravisight::{Error, Result};

/// 2D labels, px of the resized pictures.
pub(super) const LABELS: &str = "labels.csv";
/// Times of the frames, ns.
const TIMES: &str = "timestamps.csv";
/// Sizes of the pictures, depth at full scale.
const METADATA: &str = "metadata.csv";
/// The camera, for the original size.
const MATRICES: &str = "matrices.npz";
/// Full scale of a depth picture.
const FULL_SCALE: f64 = 255.0;
/// Half the side of the window in which a depth is read, px.
const WINDOW: i64 = 1;
/// Nanoseconds in a second.
const NANOSECONDS: f64 = 1e9;

/// What `metadata.csv` says.
#[derive(Debug)]
struct Metadata {
    what: String,
    /// Width and height that the matrix speaks of, px.
    original: Size,
    /// Width and height of the pictures, px.
    resized: Size,
    /// Depth at full scale, m.
    max_depth: f64,
}

/// A job for every folder with labels.
pub(super) fn jobs(source: &Path, options: &ImportOptions) -> Result<Vec<Job>> {
    let source = std::path::absolute(source).map_err(Error::io(source))?;
    let tables = files_below(&source, &|path| path.file_name().is_some_and(|name| name == LABELS))?;
    let job = |table: PathBuf| {
        let folder = table.parent().unwrap_or(&source).to_path_buf();
        let id = id(&folder);
        let name = id.clone().unwrap_or_else(|| folder.display().to_string());
        let scene = options.scene.clone();
        let read = move |_: &Path| match id {
            Some(_) => draft(&folder, scene.clone()),
            None => {
                let reason = "is not in SPLIT/cameraN/VIDEO/, where the real data set has its videos".into();
                Err(Error::Data { what: folder.display().to_string(), reason })
            }
        };
        Job { id: name, read: Box::new(read) }
    };
    Ok(tables.into_iter().map(job).collect())
}

/// `train/real/cam1/0003` of `train/camera1/3`.
fn id(folder: &Path) -> Option<String> {
    let [split, camera, video] = tail(folder)?;
    let camera: u32 = camera.strip_prefix("camera")?.parse().ok()?;
    let plain = || last_number(&video).filter(|_| video.chars().all(|c| c.is_ascii_digit()));
    let video = plain().map_or_else(|| video.clone(), |number| number.to_string());
    Some(id_of([split.as_str(), "real", &format!("cam{camera}"), &video]))
}

fn draft(folder: &Path, scene: Option<Scene>) -> Result<Draft> {
    let labels = Table::from_file(&folder.join(LABELS))?;
    let times = Table::from_file(&folder.join(TIMES))?;
    if labels.rows.len() != times.rows.len() {
        let reason = format!("{LABELS} has {} rows, but {TIMES} has {}", labels.rows.len(), times.rows.len());
        return Err(Error::Data { what: folder.display().to_string(), reason });
    }
    let pictures = one_a_row(folder, "frame", labels.rows.len(), LABELS)?;
    let metadata = Metadata::from_file(&beside(folder, METADATA)?)?;
    let camera = camera(&beside(folder, MATRICES)?, &metadata)?;
    let seconds = seconds(&times)?;
    let depths = by_number(folder, "depth")?;
    let columns = labels.columns(["ball_x", "ball_y"])?;
    let shot = |((row, picture), t): ((&Row, PathBuf), f64)| {
        let image = match columns.map(|column| row.text(column)) {
            [Ok(None), Ok(None)] => None,
            _ => Some(Point2::from(row.numbers(columns)?)),
        };
        // A depth picture has its picture's number.
        let number = picture.file_stem().and_then(|stem| last_number(&stem.to_string_lossy()));
        let depth = number.and_then(|number| depths.get(&number));
        let world = match image.zip(depth) {
            Some((image, depth)) => position(&camera, &image, depth, &metadata)?,
            None => None,
        };
        Ok(Shot { picture, what: row.what.clone(), t, image, world })
    };
    let shots = labels.rows.iter().zip(pictures).zip(seconds).map(shot).collect::<Result<Vec<_>>>()?;
    Ok(Draft::new(camera, scene, fps_of(&shots)?, shots))
}

/// The file `name` of a video: in its folder, or of its camera, in whichever folder above.
fn beside(folder: &Path, name: &str) -> Result<PathBuf> {
    let camera = folder.parent().and_then(Path::file_name).unwrap_or_default();
    // The video's, the camera's, the split's, and what holds the splits.
    let above = folder.ancestors().take(4);
    let mut places = above.flat_map(|above| [above.join(name), above.join(camera).join(name)]);
    places.find(|path| path.is_file()).ok_or_else(|| {
        let reason = format!("has no {name}, and neither have its camera's folders");
        Error::Data { what: folder.display().to_string(), reason }
    })
}

/// Seconds since the first frame.
fn seconds(times: &Table) -> Result<Vec<f64>> {
    let column = times.column("timestamp")?;
    let nanoseconds = |row: &Row| match row.text(column)?.map(str::parse::<i64>) {
        // Whole numbers are subtracted as such: as floats they are sixty years since 1970 to 256 ns.
        Some(Ok(whole)) => Ok(i128::from(whole)),
        _ => Ok(i128::from(row.number(column)? as i64)),
    };
    let all = times.rows.iter().map(nanoseconds).collect::<Result<Vec<i128>>>()?;
    if let Some(at) = all.windows(2).position(|pair| pair[1] <= pair[0]) {
        let reason = format!("must increase from frame to frame: {} follows {}", all[at + 1], all[at]);
        return Err(Error::value(&times.rows[at + 1].what, "timestamp", reason));
    }
    let first = all.first().copied().unwrap_or_default();
    Ok(all.into_iter().map(|time| (time - first) as f64 / NANOSECONDS).collect())
}

/// The camera of the resized pictures.
fn camera(path: &Path, metadata: &Metadata) -> Result<Camera> {
    let (intrinsic, extrinsic) = (npz::matrix(path, "Mint")?, npz::matrix(path, "Mext")?);
    let shape = |name: &str, words: &str| {
        let message = format!("{name} must be {words}");
        Error::Format { what: path.display().to_string(), message }
    };
    let intrinsic: [[f64; 3]; 3] = intrinsic.part().ok_or_else(|| shape("Mint", "3×3"))?;
    let extrinsic: [[f64; 4]; 3] = extrinsic.part().ok_or_else(|| shape("Mext", "4×4 or 3×4"))?;
    let camera = Camera::new(
        metadata.original,
        Matrix3::from_fn(|row, column| intrinsic[row][column]),
        Distortion::default(),
        Matrix3::from_fn(|row, column| extrinsic[row][column]),
        Vector3::from_fn(|row, _| extrinsic[row][3]),
    );
    let camera = camera.and_then(|camera| camera.resized(metadata.resized));
    camera.map_err(|error| Error::Data { what: path.display().to_string(), reason: error.to_string() })
}

/// Where the ball is by its depth picture: the mean of what is not zero in the window around the label.
fn position(camera: &Camera, image: &Point2<f64>, depth: &Path, metadata: &Metadata) -> Result<Option<[f64; 3]>> {
    let refuse = |reason: String| Error::Data { what: depth.display().to_string(), reason };
    let picture = Picture::open(depth).map_err(|error| refuse(error.to_string()))?;
    if picture.size() != metadata.resized {
        let (found, expected) = (picture.size(), metadata.resized);
        return Err(refuse(format!("is {found} px, but {} says {expected}", metadata.what)));
    }
    let [width, height] = [metadata.resized.width, metadata.resized.height].map(i64::from);
    let (column, row) = (image.x.round() as i64, image.y.round() as i64);
    let window = (-WINDOW..=WINDOW).flat_map(|dy| (-WINDOW..=WINDOW).map(move |dx| (dx, dy)));
    let values = window.filter_map(|(dx, dy)| {
        let (x, y) = (column.checked_add(dx)?, row.checked_add(dy)?);
        let inside = (0..width).contains(&x) && (0..height).contains(&y);
        inside.then(|| f64::from(picture.rgb().get_pixel(x as u32, y as u32).0[0])).filter(|value| *value > 0.0)
    });
    let values: Vec<f64> = values.collect();
    if values.is_empty() {
        return Ok(None);
    }
    let z = values.iter().sum::<f64>() / values.len() as f64 / FULL_SCALE * metadata.max_depth;
    let world = camera.world_from_image(image, z).map_err(|error| refuse(error.to_string()))?;
    Ok(Some(world.coords.into()))
}

impl Metadata {
    fn from_file(path: &Path) -> Result<Self> {
        let table = Table::from_file(path)?;
        let [row] = table.rows.as_slice() else {
            let message = format!("must have one row below the names, not {}", table.rows.len());
            return Err(Error::Format { what: path.display().to_string(), message });
        };
        let side = |name: &str| -> Result<u32> {
            let side = row.count(table.column(name)?)?;
            u32::try_from(side).ok().filter(|side| *side > 0).ok_or_else(|| {
                Error::value(&row.what, name, format!("must be a picture's width or height in px, not {side}"))
            })
        };
        let max_depth = row.number(table.column("max_depth")?)?;
        if max_depth <= 0.0 {
            return Err(Error::value(&row.what, "max_depth", format!("must be positive, not {max_depth}")));
        }
        Ok(Self {
            what: row.what.clone(),
            original: Size::new(side("original_width")?, side("original_height")?),
            resized: Size::new(side("resized_width")?, side("resized_height")?),
            max_depth,
        })
    }
}
