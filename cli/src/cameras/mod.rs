//! Cameras of other tools, read into this project's.
//!
//! Every reader gives what its file says, in the file's units and world; what the file does not say is asked for by the option's name.

mod colmap;
mod kalibr;
mod opencv;
mod tree;
mod tsai;

use std::iter;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail, ensure};
use clap::ValueEnum;
use gravisight::parts::Distortion;
use gravisight::{Camera, Size};
use nalgebra::{Matrix3, Vector3};

/// The unit of a translation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Units {
    /// Metres.
    M,
    /// Centimetres.
    Cm,
    /// Millimetres.
    Mm,
}

impl Units {
    fn metres(self) -> f64 {
        match self {
            Self::M => 1.0,
            Self::Cm => 0.01,
            Self::Mm => 0.001,
        }
    }
}

/// Which way a right-handed world has its axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum World {
    /// z points up, as in camera.json.
    ZUp,
    /// y points up.
    YUp,
    /// z points down, as with a chessboard lying on the floor.
    ZDown,
    /// y points down, as in structure from motion.
    YDown,
}

impl World {
    /// Rotation of this world into this project's.
    fn to_ours(self) -> Matrix3<f64> {
        match self {
            Self::ZUp => Matrix3::identity(),
            Self::YUp => Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0),
            Self::ZDown => Matrix3::new(1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0),
            Self::YDown => Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0),
        }
    }
}

/// What four coefficients are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Lens {
    /// k1, k2, p1, p2, … from OpenCV's `calibrateCamera`.
    BrownConrady,
    /// k1 to k4 from OpenCV's `fisheye`.
    Fisheye,
}

/// What a file does not say.
#[derive(Debug, Clone, Default)]
pub struct Stated {
    /// Of the translation.
    pub units: Option<Units>,
    /// Of the pose.
    pub world: Option<World>,
    /// Of the pictures that the intrinsic matrix speaks of.
    pub size: Option<Size>,
    /// Of coefficients that may be either's.
    pub lens: Option<Lens>,
    /// The picture or the camera, where there are several.
    pub image: Option<String>,
}

/// World to camera, in the file's units and world.
struct Pose {
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
    units: Option<Units>,
    world: Option<World>,
}

/// What a file says.
struct Found {
    size: Option<Size>,
    /// px, of pixel centres.
    intrinsic: Matrix3<f64>,
    distortion: Distortion,
    pose: Option<Pose>,
    /// What a user should know, in words.
    notes: Vec<String>,
}

/// A camera without its pose.
pub struct Intrinsics {
    /// Of the pictures, where it is known.
    pub size: Option<Size>,
    /// px.
    pub intrinsic: Matrix3<f64>,
    /// Its lens.
    pub distortion: Distortion,
}

/// The camera of a command's `--camera`: a `camera.json`, or another tool's file that says all.
pub fn open(path: &Path) -> Result<Camera> {
    if let Kind::Ours = Kind::of(path) {
        return Ok(Camera::from_file(path)?);
    }
    let (camera, _) = import(path, &Stated::default(), None)?;
    Ok(camera)
}

/// The files of a command's `--camera`; COLMAP's `cameras.txt` has its poses beside it.
pub fn files(path: &Path) -> Vec<PathBuf> {
    let beside = path.ends_with(colmap::CAMERAS).then(|| path.with_file_name(colmap::IMAGES));
    iter::once(path.to_path_buf()).chain(beside).collect()
}

/// Intrinsics and lens of a `camera.json` or another tool's file.
pub fn intrinsics(path: &Path) -> Result<Intrinsics> {
    let Found { size, intrinsic, distortion, .. } = read(path, &Stated::default())?;
    Ok(Intrinsics { size, intrinsic, distortion })
}

/// The camera of another tool's file, its pose from the file `pose` where one is given; and what a user should know about it, in words.
pub fn import(path: &Path, stated: &Stated, pose: Option<&Path>) -> Result<(Camera, Vec<String>)> {
    let name = path.display();
    let mut found = read(path, stated)?;
    if let Some(path) = pose {
        found.pose = Some(read_pose(path, stated)?);
    }
    let size = match (found.size, stated.size) {
        (Some(size), Some(stated)) if size != stated => {
            bail!("{name}: is for {size} pictures, but --size says {stated}")
        }
        (size, stated) => size.or(stated),
    };
    let size =
        size.with_context(|| format!("{name}: does not state the size of its pictures: give --size WxH{}", at(path)))?;
    let Some(pose) = found.pose else { bail!("{name}: {}", no_pose(&found.intrinsic, &found.distortion)) };
    let (units, world) = (pose.units.or(stated.units), pose.world.or(stated.world));
    let missing = [
        units.is_none().then_some("the unit of its translation (--units m|cm|mm)"),
        world.is_none().then_some("which axis of its world points up (--world z-up|y-up|z-down|y-down)"),
    ];
    let missing: Vec<&str> = missing.into_iter().flatten().collect();
    let (Some(units), Some(world)) = (units, world) else {
        bail!("{name}: does not state {}{}", missing.join(", nor "), at(path));
    };
    let rotation = pose.rotation * world.to_ours().transpose();
    let camera = Camera::new(size, found.intrinsic, found.distortion, rotation, units.metres() * pose.translation);
    Ok((camera.with_context(|| name.to_string())?, found.notes))
}

/// Where options are given.
fn at(path: &Path) -> String {
    format!("; use these options with `gravisight camera import {} --to camera.json`", path.display())
}

fn no_pose(intrinsic: &Matrix3<f64>, distortion: &Distortion) -> String {
    let rows: Vec<Vec<f64>> = intrinsic.row_iter().map(|row| row.iter().copied().collect()).collect();
    format!(
        "has no pose: give a file that has one with --pose, or compute it from clicks with `gravisight calibrate --points \
         points.json --camera` and this file (intrinsic {rows:?}, {})",
        serde_json::to_string(distortion).unwrap_or_default()
    )
}

/// What a file is, by its name and, of XML and JSON, by what is in it.
enum Kind {
    /// A `camera.json`, or nothing that is known here: what is wrong with it is said as of a `camera.json`.
    Ours,
    Colmap,
    Tsai,
    /// OpenCV's, NumPy's, ROS's and Kalibr's.
    Tree,
}

impl Kind {
    fn of(path: &Path) -> Self {
        let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default().to_lowercase();
        match extension.as_str() {
            _ if !path.exists() => Self::Ours,
            _ if path.ends_with(colmap::CAMERAS) || path.join(colmap::CAMERAS).is_file() => Self::Colmap,
            "yml" | "yaml" | "npz" => Self::Tree,
            "xml" if tsai::is_one(path) => Self::Tsai,
            "xml" => Self::Tree,
            "json" if tree::read(path).is_ok_and(|tree| opencv::is_one(&tree)) => Self::Tree,
            _ => Self::Ours,
        }
    }
}

/// What the file at `path` says.
fn read(path: &Path, stated: &Stated) -> Result<Found> {
    let found = match Kind::of(path) {
        Kind::Ours => return Ok(of_ours(&Camera::from_file(path)?)),
        Kind::Colmap => colmap::read(path, stated),
        Kind::Tsai => tsai::read(path),
        Kind::Tree => {
            let tree = tree::read(path)?;
            match kalibr::is_one(&tree) {
                true => kalibr::read(&tree, stated),
                false => opencv::read(&tree, stated),
            }
        }
    };
    found.with_context(|| path.display().to_string())
}

fn read_pose(path: &Path, stated: &Stated) -> Result<Pose> {
    let name = || path.display().to_string();
    let pose = match Kind::of(path) {
        // A pose's file may have no intrinsics.
        Kind::Tree => opencv::pose(&tree::read(path)?, stated).with_context(name)?,
        _ => read(path, stated)?.pose,
    };
    pose.with_context(|| format!("{}: has no pose (rvec or R, and tvec or T)", path.display()))
}

fn of_ours(camera: &Camera) -> Found {
    let pose = Pose {
        rotation: *camera.rotation(),
        translation: camera.camera_from_world(&nalgebra::Point3::origin()).coords,
        units: Some(Units::M),
        world: Some(World::ZUp),
    };
    let (intrinsic, distortion) = (*camera.intrinsic(), *camera.distortion());
    Found { size: Some(camera.size()), intrinsic, distortion, pose: Some(pose), notes: Vec::new() }
}

fn pinhole([fx, fy, cx, cy]: [f64; 4]) -> Matrix3<f64> {
    Matrix3::new(fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0)
}

/// The distortion of coefficients in OpenCV's order.
fn brown(values: &[f64]) -> Result<Distortion> {
    let count = values.len();
    ensure!(matches!(count, 4 | 5 | 8 | 12 | 14), "has {count} distortion coefficients; OpenCV uses 4, 5, 8, 12 or 14");
    ensure!(
        values.iter().skip(8).all(|&value| value == 0.0),
        "has a thin prism or a tilted sensor (distortion coefficients 9 to 14), which are not modelled: calibrate without them"
    );
    let at = |index: usize| values.get(index).copied().unwrap_or(0.0);
    let [k1, k2, p1, p2, k3, k4, k5, k6] = std::array::from_fn(at);
    Ok(Distortion { k1, k2, p1, p2, k3, k4, k5, k6, ..Distortion::default() })
}

/// The distortion of a fisheye's coefficients.
fn fisheye(values: &[f64]) -> Result<Distortion> {
    let &[k1, k2, k3, k4] = values else { bail!("has {} fisheye coefficients; there must be 4", values.len()) };
    Ok(Distortion { model: gravisight::parts::LensModel::Fisheye, k1, k2, k3, k4, ..Distortion::default() })
}
