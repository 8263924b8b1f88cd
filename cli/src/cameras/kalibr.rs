//! Kalibr's camchain YAML.

use anyhow::{Context as _, Result, bail};
use gravisight::Size;
use gravisight::parts::Distortion;
use serde_json::Value;

use super::tree::array;
use super::{Found, Stated, brown, fisheye, pinhole};

/// Whether a tree has cameras as Kalibr names them.
pub fn is_one(tree: &Value) -> bool {
    cameras(tree).next().is_some()
}

fn cameras(tree: &Value) -> impl Iterator<Item = (&String, &Value)> {
    let is_camera = |(name, value): &(&String, &Value)| name.starts_with("cam") && value.get("camera_model").is_some();
    tree.as_object().into_iter().flatten().filter(is_camera)
}

pub fn read(tree: &Value, stated: &Stated) -> Result<Found> {
    let all: Vec<_> = cameras(tree).collect();
    let camera = match (&all[..], &stated.image) {
        ([(_, camera)], None) => camera,
        (all, chosen) => {
            let found = all.iter().find(|(name, _)| chosen.as_ref() == Some(name)).map(|(_, camera)| camera);
            let names = all.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ");
            found.with_context(|| {
                format!("has the cameras {names}: choose one with `gravisight camera import --image NAME`")
            })?
        }
    };
    let text = |name: &str| camera.get(name).and_then(Value::as_str).unwrap_or("none");
    let numbers = |name: &'static str, plain: &str| {
        let array = array(camera, &[plain])?;
        Ok::<_, anyhow::Error>(array.with_context(|| format!("`{name}` is missing"))?.values)
    };
    if text("camera_model") != "pinhole" {
        bail!(
            "has a camera of the unsupported model `{}`; supported is pinhole, with radtan or equi",
            text("camera_model")
        );
    }
    let intrinsics = numbers("intrinsics", "intrinsics")?;
    let intrinsics: [f64; 4] = intrinsics.try_into().ok().context("`intrinsics` must be fx, fy, cx and cy")?;
    let lens = || numbers("distortion_coeffs", "distortioncoeffs");
    let distortion = match text("distortion_model") {
        "radtan" => brown(&lens()?)?,
        "equi" => fisheye(&lens()?)?,
        "none" => Distortion::default(),
        other => bail!("has the unsupported lens model `{other}`; supported are radtan and equi"),
    };
    let [width, height]: [f64; 2] =
        numbers("resolution", "resolution")?.try_into().ok().context("`resolution` must be width and height")?;
    let size = Some(Size::new(width as u32, height as u32));
    // T_cam_imu and T_cn_cnm1 are poses to the IMU and to another camera, not to the world.
    Ok(Found { size, intrinsic: pinhole(intrinsics), distortion, pose: None, notes: Vec::new() })
}
