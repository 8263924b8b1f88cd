//! COLMAP's `cameras.txt` and `images.txt`.

use std::path::Path;

use anyhow::{Context as _, Result, bail, ensure};
use gravisight::Size;
use gravisight::internal::read_text;
use gravisight::parts::Distortion;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::{Found, Pose, Stated, brown, fisheye, pinhole};

pub const CAMERAS: &str = "cameras.txt";
pub const IMAGES: &str = "images.txt";
/// Of the first pixel's centre: COLMAP counts from the picture's corner.
const CENTRE: f64 = 0.5;

/// The camera of the folder at `path`, or of its `cameras.txt`.
pub fn read(path: &Path, stated: &Stated) -> Result<Found> {
    let folder = if path.is_dir() { path } else { path.parent().unwrap_or(Path::new("")) };
    let cameras = read_text(&if path.is_dir() { path.join(CAMERAS) } else { path.to_path_buf() })?;
    let cameras: Vec<Vec<&str>> = lines(&cameras).map(words).collect();
    ensure!(
        cameras.iter().all(|camera| camera.len() > 4),
        "is not a COLMAP cameras.txt (CAMERA_ID MODEL WIDTH HEIGHT PARAMS)"
    );
    let images_at = folder.join(IMAGES);
    if !images_at.is_file() {
        let [camera] = &cameras[..] else {
            bail!(
                "has {} cameras, but no {IMAGES} beside it that assigns pictures to them; add that file",
                cameras.len()
            )
        };
        return camera_of(camera, None);
    }
    let images = read_text(&images_at)?;
    let image = image(&images, stated).with_context(|| images_at.display().to_string())?;
    let camera = cameras.iter().find(|camera| camera[0] == image[8]);
    let camera = camera.with_context(|| format!("has no camera {}, which took picture {}", image[8], image[9]))?;
    let numbers: [f64; 7] = numbers(&image[1..8])?.try_into().ok().context("a pose must have 7 numbers")?;
    let [w, x, y, z, tx, ty, tz] = numbers;
    let turn = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), f64::EPSILON)
        .context("a pose has a quaternion of zero length")?;
    let rotation = turn.to_rotation_matrix().into_inner();
    camera_of(camera, Some(Pose { rotation, translation: Vector3::new(tx, ty, tz), units: None, world: None }))
}

fn lines(text: &str) -> impl Iterator<Item = &str> {
    text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'))
}

fn words(line: &str) -> Vec<&str> {
    line.split_whitespace().collect()
}

fn numbers(words: &[&str]) -> Result<Vec<f64>> {
    let number = |word: &&str| {
        word.parse()
            .ok()
            .filter(|number: &f64| number.is_finite())
            .with_context(|| format!("`{word:.40}` is not a number"))
    };
    words.iter().map(number).collect()
}

/// The words of the picture that was asked for, or of the only one. Every picture has a second line, its points, which may be empty.
fn image<'a>(text: &'a str, stated: &Stated) -> Result<Vec<&'a str>> {
    let all =
        text.lines().filter(|line| !line.starts_with('#')).step_by(2).map(str::trim).filter(|line| !line.is_empty());
    let all: Vec<Vec<&str>> = all.map(|line| line.splitn(10, char::is_whitespace).collect()).collect();
    ensure!(
        all.iter().all(|image| image.len() == 10),
        "is not a COLMAP images.txt (IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME)"
    );
    let known = || all.iter().take(5).map(|image| image[9]).collect::<Vec<_>>().join(", ");
    match &stated.image {
        None if all.len() == 1 => Ok(all[0].clone()),
        None => bail!(
            "has {} pictures ({}, …): choose one with `gravisight camera import --image NAME`",
            all.len(),
            known()
        ),
        Some(name) => all
            .iter()
            .find(|image| image[9] == name)
            .cloned()
            .with_context(|| format!("has no picture {name}; there are {}, …", known())),
    }
}

fn camera_of(words: &[&str], pose: Option<Pose>) -> Result<Found> {
    let values = numbers(&words[4..])?;
    let (intrinsics, distortion) = match (words[1], &values[..]) {
        ("SIMPLE_PINHOLE", &[f, cx, cy]) => ([f, f, cx, cy], Distortion::default()),
        ("PINHOLE", &[fx, fy, cx, cy]) => ([fx, fy, cx, cy], Distortion::default()),
        ("SIMPLE_RADIAL", &[f, cx, cy, k1]) => ([f, f, cx, cy], Distortion { k1, ..Distortion::default() }),
        ("RADIAL", &[f, cx, cy, k1, k2]) => ([f, f, cx, cy], Distortion { k1, k2, ..Distortion::default() }),
        ("OPENCV", &[fx, fy, cx, cy, ref lens @ ..]) if lens.len() == 4 => ([fx, fy, cx, cy], brown(lens)?),
        ("FULL_OPENCV", &[fx, fy, cx, cy, ref lens @ ..]) if lens.len() == 8 => ([fx, fy, cx, cy], brown(lens)?),
        ("OPENCV_FISHEYE", &[fx, fy, cx, cy, ref lens @ ..]) => ([fx, fy, cx, cy], fisheye(lens)?),
        (model @ ("SIMPLE_PINHOLE" | "PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" | "OPENCV" | "FULL_OPENCV"), values) => {
            bail!("has a camera {model} with {} parameters, the wrong number for that model", values.len())
        }
        (model, _) => bail!(
            "has a camera of the unsupported model `{model}`; supported are SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, \
             FULL_OPENCV and OPENCV_FISHEYE"
        ),
    };
    let [fx, fy, cx, cy] = intrinsics;
    let side =
        |word: &str| word.parse().ok().with_context(|| format!("`{word:.40}` is not a valid picture width or height"));
    let size = Some(Size::new(side(words[2])?, side(words[3])?));
    let notes = match pose {
        Some(_) => vec![
            "COLMAP's scale and vertical are arbitrary unless the model was aligned: check the camera's position"
                .into(),
        ],
        None => Vec::new(),
    };
    Ok(Found { size, intrinsic: pinhole([fx, fy, cx - CENTRE, cy - CENTRE]), distortion, pose, notes })
}
