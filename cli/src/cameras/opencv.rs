//! OpenCV's `FileStorage`, `.npz` of Python scripts, and ROS's `camera_info`: the same fields under many names.

use anyhow::{Context as _, Result, bail, ensure};
use gravisight::Size;
use gravisight::parts::Distortion;
use nalgebra::{Matrix3, Rotation3, Vector3};
use serde_json::Value;

use super::tree::{Array, array, field, whole};
use super::{Found, Lens, Pose, Stated, Units, World, brown, fisheye};

const MATRIX: [&str; 7] =
    ["cameramatrix", "mtx", "k", "intrinsicmatrix", "intrinsicsmatrix", "intrinsic", "intrinsics"];
const LENS: [&str; 8] = [
    "distortioncoefficients",
    "distortioncoeffs",
    "distcoeffs",
    "distcoefficients",
    "distcoef",
    "dist",
    "d",
    "distortion",
];
const VECTOR: [&str; 3] = ["rvec", "rvecs", "rotationvector"];
const ROTATION: [&str; 4] = ["r", "rotationmatrix", "rotation", "rmat"];
const TRANSLATION: [&str; 5] = ["tvec", "tvecs", "t", "translation", "translationvector"];
/// Rotation vector and translation of each picture, as OpenCV's own calibration program writes them.
const BOTH: [&str; 1] = ["extrinsicparameters"];

/// Whether there is an intrinsic matrix or a pose, under a name that no `camera.json` has.
pub fn is_one(tree: &Value) -> bool {
    let is_ours = tree.get("intrinsic").is_some() || tree.get("camera_from_world").is_some();
    !is_ours && [&MATRIX[..], &TRANSLATION].iter().any(|names| field(tree, names).is_some())
}

pub fn read(tree: &Value, stated: &Stated) -> Result<Found> {
    let Some(matrix) = array(tree, &MATRIX)? else {
        bail!(
            "has no intrinsic matrix (camera_matrix, mtx or K), and is not a camera file of any supported tool (see \
               `gravisight camera import --help`)"
        );
    };
    let values: [f64; 9] =
        matrix.values.try_into().map_err(|_| anyhow::anyhow!("the intrinsic matrix must have 9 numbers"))?;
    let mut notes = Vec::new();
    let distortion = match array(tree, &LENS)? {
        Some(Array { values, .. }) => lens(tree, &values, stated)?,
        None => {
            notes.push("the file has no distortion coefficients: a pinhole lens is assumed".into());
            Distortion::default()
        }
    };
    let intrinsic = Matrix3::from_row_slice(&values);
    Ok(Found { size: size(tree)?, intrinsic, distortion, pose: pose(tree, stated)?, notes })
}

fn size(tree: &Value) -> Result<Option<Size>> {
    if let (Some(width), Some(height)) =
        (whole(tree, &["imagewidth", "width", "w"]), whole(tree, &["imageheight", "height", "h"]))
    {
        return Ok(Some(Size::new(width, height)));
    }
    let Some(both) = array(tree, &["imagesize", "imgsize", "size", "resolution"])? else { return Ok(None) };
    match both.values[..] {
        [width, height] => Ok(Some(Size::new(width as u32, height as u32))),
        _ => bail!("the picture's size must be width and height, not {} numbers", both.values.len()),
    }
}

fn lens(tree: &Value, values: &[f64], stated: &Stated) -> Result<Distortion> {
    if let Some(model) = field(tree, &["distortionmodel"]).and_then(|(_, value)| value.as_str()) {
        return match model {
            "plumb_bob" | "rational_polynomial" => brown(values),
            "equidistant" | "fisheye" => fisheye(values),
            other => bail!(
                "has the unsupported lens model `{other}`; supported are plumb_bob, rational_polynomial and equidistant"
            ),
        };
    }
    let is_fisheye = field(tree, &["fisheyemodel"]).and_then(|(_, value)| value.as_f64()).map(|flag| flag != 0.0);
    let of_flag = |flag: bool| if flag { Lens::Fisheye } else { Lens::BrownConrady };
    match is_fisheye.map(of_flag).or(stated.lens) {
        Some(Lens::Fisheye) => fisheye(values),
        Some(Lens::BrownConrady) => brown(values),
        None if values.len() == 4 && values.iter().any(|&value| value != 0.0) => {
            bail!(
                "has 4 distortion coefficients, which may be k1, k2, p1, p2 or a fisheye's: choose with `gravisight camera import \
                 --lens brown-conrady` or `--lens fisheye`"
            )
        }
        None => brown(values),
    }
}

/// The pose, if there is one; of several that of `--image`, by its number.
pub fn pose(tree: &Value, stated: &Stated) -> Result<Option<Pose>> {
    // ROS's R makes a pair of pictures parallel; it is no pose.
    if field(tree, &["distortionmodel", "projectionmatrix", "rectificationmatrix"]).is_some() {
        return Ok(None);
    }
    let poses: Vec<(Matrix3<f64>, Vector3<f64>)> = match array(tree, &BOTH)? {
        Some(both) => {
            ensure!(both.values.len() == 6 * both.rows, "`extrinsic_parameters` must have 6 numbers a row");
            let rows = both.values.chunks(6);
            rows.map(|row| (turn(&row[..3]), Vector3::from_column_slice(&row[3..]))).collect()
        }
        None => {
            let Some(translations) = array(tree, &TRANSLATION)? else { return Ok(None) };
            let translations: Vec<_> = triples(&translations)?.map(Vector3::from_column_slice).collect();
            let rotations = rotations(tree)?;
            let (turns, moves) = (rotations.len(), translations.len());
            ensure!(turns == moves, "has {turns} rotations but {moves} translations");
            rotations.into_iter().zip(translations).collect()
        }
    };
    let (rotation, translation) = pick(&poses, stated)?;
    let (units, world) = (said::<Units>(tree, "units")?, said::<World>(tree, "world")?);
    Ok(Some(Pose { rotation, translation, units, world }))
}

fn rotations(tree: &Value) -> Result<Vec<Matrix3<f64>>> {
    if let Some(vectors) = array(tree, &VECTOR)? {
        return Ok(triples(&vectors)?.map(turn).collect());
    }
    let matrices = array(tree, &ROTATION)?.context("has a translation and no rotation (rvec or R)")?;
    match matrices.values.len() {
        3 => Ok(vec![turn(&matrices.values)]),
        count if count.is_multiple_of(9) => Ok(matrices.values.chunks(9).map(Matrix3::from_row_slice).collect()),
        count => bail!("the rotation must have 3 or 9 numbers, not {count}"),
    }
}

fn triples(array: &Array) -> Result<impl Iterator<Item = &[f64]>> {
    let count = array.values.len();
    ensure!(count.is_multiple_of(3), "rotation vectors and translations must have 3 numbers, not {count}");
    Ok(array.values.chunks(3))
}

fn turn(vector: &[f64]) -> Matrix3<f64> {
    Rotation3::new(Vector3::from_column_slice(vector)).into_inner()
}

fn pick<T: Copy>(poses: &[T], stated: &Stated) -> Result<T> {
    let chosen = match (poses, &stated.image) {
        (&[pose], None) => Some(pose),
        (poses, chosen) => chosen.as_ref().and_then(|chosen| poses.get(chosen.parse::<usize>().ok()?)).copied(),
    };
    chosen.with_context(|| {
        let count = poses.len();
        format!(
            "has the poses of {count} pictures: choose one with `gravisight camera import --image N`, N from 0 to {}",
            count - 1
        )
    })
}

/// What the file itself says of an option.
fn said<T: clap::ValueEnum>(tree: &Value, name: &str) -> Result<Option<T>> {
    let Some(text) = field(tree, &[name]).and_then(|(_, value)| value.as_str()) else { return Ok(None) };
    T::from_str(text, true).map(Some).map_err(|_| {
        let names: Vec<String> = T::value_variants()
            .iter()
            .filter_map(|value| Some(value.to_possible_value()?.get_name().to_string()))
            .collect();
        anyhow::anyhow!("`{name}` is `{text}`; it must be one of {}", names.join(", "))
    })
}
