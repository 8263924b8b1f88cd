//! `camera.json` (docs/formats.md): reading, writing and checking.

use nalgebra::{Matrix3, Matrix4, Vector3};
use serde::{Deserialize, Serialize};

use super::{Camera, Distortion};
use crate::error::{Error, Result, json_refusal};
use crate::size::Size;

/// What a camera's file is, for who gave another.
const EXPECTED: &str = "a camera is a JSON object with width, height, intrinsic and camera_from_world, which `gravisight calibrate` (the \
                        page's Calibrate, `Toolbox.calibrate` in JavaScript) makes from points with known positions";
/// Largest number a camera of this world can hold (px, m): beyond it, products overflow.
const MAX_ENTRY: f64 = 1e9;
/// Largest entry of `RᵀR − 1` that rounding in a file explains.
const ROTATION_TOLERANCE: f64 = 1e-3;

/// A calibrated camera: the content of a `camera.json`. Matrices are arrays of rows.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify), tsify(rename = "Camera"))]
#[serde(deny_unknown_fields)]
struct CameraFile {
    /// Of the pictures that `intrinsic` speaks of, px.
    width: u32,
    /// Of the pictures that `intrinsic` speaks of, px.
    height: u32,
    /// M_int, px.
    intrinsic: [[f64; 3]; 3],
    /// Rigid, m.
    camera_from_world: [[f64; 4]; 4],
    /// Brown–Conrady, OpenCV's rational model or a fisheye.
    #[serde(default, skip_serializing_if = "Distortion::is_none")]
    distortion: Distortion,
    /// Of a rolling shutter: from the first row to the last, s.
    #[serde(default, skip_serializing_if = "is_zero")]
    readout_s: f64,
    /// Of a part of a picture: when its first row is read, after that of the whole one, s.
    #[serde(default, skip_serializing_if = "is_zero")]
    readout_start_s: f64,
}

/// Longest time that reading a picture takes, s.
const LONGEST_READOUT: f64 = 1.0;

fn is_zero(seconds: &f64) -> bool {
    *seconds == 0.0
}

impl TryFrom<CameraFile> for Camera {
    type Error = Error;

    fn try_from(file: CameraFile) -> Result<Self> {
        let extrinsic = Matrix4::from_fn(|row, column| file.camera_from_world[row][column]);
        let last = extrinsic.row(3);
        if last.iter().zip([0.0, 0.0, 0.0, 1.0]).any(|(&found, expected)| found != expected) {
            let reason = format!("must end with the row 0 0 0 1, not {:?}", file.camera_from_world[3]);
            return Err(Error::CameraValue { what: "camera".into(), field: "camera_from_world", reason });
        }
        check_readout("readout_s", file.readout_s, 0.0)?;
        check_readout("readout_start_s", file.readout_start_s, -LONGEST_READOUT)?;
        let camera = Camera::new(
            Size::new(file.width, file.height),
            Matrix3::from_fn(|row, column| file.intrinsic[row][column]),
            file.distortion,
            extrinsic.fixed_view::<3, 3>(0, 0).into_owned(),
            extrinsic.fixed_view::<3, 1>(0, 3).into_owned(),
        )?;
        Ok(Camera { readout: file.readout_s, readout_start: file.readout_start_s, ..camera })
    }
}

impl From<&Camera> for CameraFile {
    fn from(camera: &Camera) -> Self {
        let mut camera_from_world = [[0.0; 4]; 4];
        for (row, out) in camera_from_world.iter_mut().take(3).enumerate() {
            *out = [
                camera.rotation[(row, 0)],
                camera.rotation[(row, 1)],
                camera.rotation[(row, 2)],
                camera.translation[row],
            ];
        }
        camera_from_world[3][3] = 1.0;
        Self {
            width: camera.size.width,
            height: camera.size.height,
            intrinsic: std::array::from_fn(|row| std::array::from_fn(|column| camera.intrinsic[(row, column)])),
            camera_from_world,
            distortion: camera.distortion,
            readout_s: camera.readout,
            readout_start_s: camera.readout_start,
        }
    }
}

impl Serialize for Camera {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        CameraFile::from(self).serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Camera {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        Camera::try_from(CameraFile::deserialize(deserializer)?).map_err(serde::de::Error::custom)
    }
}

impl Camera {
    /// Reads the text of a `camera.json`; `what` names it in errors.
    ///
    /// # Errors
    /// [`Error::CameraFormat`] for a text of another form (the field is named), else as [`Camera::new`].
    pub fn from_json(text: &str, what: &str) -> Result<Self> {
        let file: CameraFile = serde_json::from_str(text).map_err(|error| {
            Error::CameraFormat { what: what.into(), message: json_refusal(&error) }.expecting(EXPECTED)
        })?;
        file.try_into().map_err(|error| match error {
            Error::CameraValue { field, reason, .. } => Error::CameraValue { what: what.into(), field, reason },
            Error::CameraSingular { field, determinant, .. } => {
                Error::CameraSingular { what: what.into(), field, determinant }
            }
            other => other,
        })
    }

    /// Reads a `camera.json` file.
    ///
    /// # Errors
    /// [`Error::Io`], else as [`Camera::from_json`].
    pub fn from_file(path: &std::path::Path) -> Result<Self> {
        let text = crate::files::read_text(path).map_err(|error| error.expecting(EXPECTED))?;
        Self::from_json(&text, &path.display().to_string())
    }
}

/// Refuses times of reading that no shutter has; `least` and the longest in s.
pub(super) fn check_readout(field: &'static str, seconds: f64, least: f64) -> Result<()> {
    if (least..=LONGEST_READOUT).contains(&seconds) {
        return Ok(());
    }
    let reason = format!("must be from {least} to {LONGEST_READOUT} s, not {seconds}");
    Err(Error::CameraValue { what: "camera".into(), field, reason })
}

/// The checks that [`Camera::new`] documents.
pub(super) fn check(
    size: Size,
    intrinsic: &Matrix3<f64>,
    distortion: &Distortion,
    rotation: &Matrix3<f64>,
    translation: &Vector3<f64>,
) -> Result<()> {
    let refuse = |field, reason| Err(Error::CameraValue { what: "camera".into(), field, reason });
    if size.width == 0 || size.height == 0 {
        return refuse("width/height", format!("must be positive, not {size}"));
    }
    let Distortion { k1, k2, p1, p2, k3, k4, k5, k6, model: _ } = *distortion;
    let sensible = |values: &[f64]| values.iter().all(|value| value.abs() <= MAX_ENTRY);
    for (field, fine) in [
        ("intrinsic", sensible(intrinsic.as_slice())),
        ("camera_from_world", sensible(rotation.as_slice()) && sensible(translation.as_slice())),
        ("distortion", sensible(&[k1, k2, p1, p2, k3, k4, k5, k6])),
    ] {
        if !fine {
            return refuse(field, format!("holds NaN, infinity or a number beyond {MAX_ENTRY:e}"));
        }
    }
    if distortion.is_fisheye() && [p1, p2, k5, k6] != [0.0; 4] {
        return refuse("distortion", "of a fisheye has only k1, k2, k3 and k4: p1, p2, k5 and k6 must be 0".into());
    }
    if intrinsic[(1, 0)] != 0.0 || intrinsic.row(2) != nalgebra::RowVector3::new(0.0, 0.0, 1.0) {
        return refuse("intrinsic", "must have the form [[fx, s, cx], [0, fy, cy], [0, 0, 1]]".into());
    }
    if intrinsic[(0, 0)] < 0.0 || intrinsic[(1, 1)] < 0.0 {
        return refuse("intrinsic", "must have positive focal lengths".into());
    }
    let determinant = rotation.determinant();
    if determinant.abs() < super::MIN_DETERMINANT {
        return Err(Error::CameraSingular { what: "camera".into(), field: "camera_from_world", determinant });
    }
    let off = (rotation.transpose() * rotation - Matrix3::identity()).amax();
    if off > ROTATION_TOLERANCE || determinant < 0.0 {
        let reason = format!(
            "must hold a rotation (RᵀR = 1 to {ROTATION_TOLERANCE}, determinant 1): it is off by {off:.2e}, \
             determinant {determinant:.4}"
        );
        return refuse("camera_from_world", reason);
    }
    Ok(())
}
