//! Cameras of Tsai's model in XML, as PETS and CAVIAR publish them.
//!
//! Tsai, "A versatile camera calibration technique", 1987: the lens takes a seen point to the ideal one, which is the inverse of what
//! [`Distortion`] does; three coefficients are fitted to it over the picture.

use std::path::Path;

use anyhow::{Context as _, Result, ensure};
use gravisight::internal::read_text;
use gravisight::parts::Distortion;
use gravisight::{Camera, Size};
use nalgebra::{DMatrix, DVector, Rotation3, Vector3};
use roxmltree::{Document, Node};

use super::{Found, Pose, pinhole};

/// Places from the middle to the farthest corner at which the lens is fitted.
const SAMPLES: usize = 100;
/// How far the fitted lens may be off, px.
const LARGEST_ERROR: f64 = 0.1;

/// Whether a file is XML with a Tsai camera's elements.
pub fn is_one(path: &Path) -> bool {
    let is_xml = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("xml"));
    let Some(text) = is_xml.then(|| read_text(path).ok()).flatten() else { return false };
    Document::parse(&text).is_ok_and(|document| element(&document, "Geometry").is_ok())
}

fn element<'a, 'input>(document: &'a Document<'input>, name: &str) -> Result<Node<'a, 'input>> {
    document.descendants().find(|node| node.has_tag_name(name)).with_context(|| format!("<{name}> is missing"))
}

/// Attributes of an element, finite numbers.
fn numbers<const N: usize>(element: &Node, names: [&str; N]) -> Result<[f64; N]> {
    let tag = element.tag_name().name();
    let mut values = [0.0; N];
    for (value, name) in values.iter_mut().zip(names) {
        let text = element.attribute(name).with_context(|| format!("<{tag}> has no {name}"))?;
        let number = text.trim().parse().ok().filter(|number: &f64| number.is_finite());
        *value = number.with_context(|| format!("<{tag} {name}={text:?}> is not a number"))?;
    }
    Ok(values)
}

pub fn read(path: &Path) -> Result<Found> {
    let text = read_text(path)?;
    let document = Document::parse(&text)?;
    let geometry = element(&document, "Geometry")?;
    let [width, height, dpx, dpy] = numbers(&geometry, ["width", "height", "dpx", "dpy"])?;
    let [focal, kappa, cx, cy, sx] = numbers(&element(&document, "Intrinsic")?, ["focal", "kappa1", "cx", "cy", "sx"])?;
    let [tx, ty, tz, rx, ry, rz] = numbers(&element(&document, "Extrinsic")?, ["tx", "ty", "tz", "rx", "ry", "rz"])?;
    ensure!(
        [width, height, focal, dpx, dpy, sx].iter().all(|&value| value > 0.0),
        "width, height, focal, dpx, dpy and sx must be positive"
    );
    let intrinsic = pinhole([focal * sx / dpx, focal / dpy, cx, cy]);
    let size = Size::new(width as u32, height as u32);
    // Rz·Ry·Rx.
    let rotation = Rotation3::from_euler_angles(rx, ry, rz).into_inner();
    let reach = |at: f64, side: f64, focal: f64| at.abs().max((side - 1.0 - at).abs()) / focal;
    let corner = reach(cx, width, intrinsic[(0, 0)]).hypot(reach(cy, height, intrinsic[(1, 1)]));
    let distortion = inverse(kappa * focal * focal, corner, intrinsic[(0, 0)].max(intrinsic[(1, 1)]))?;
    let camera = Camera::new(size, intrinsic, distortion, rotation, Vector3::zeros())?;
    let pose = Pose { rotation: *camera.rotation(), translation: Vector3::new(tx, ty, tz), units: None, world: None };
    Ok(Found { size: Some(size), intrinsic, distortion, pose: Some(pose), notes: Vec::new() })
}

/// The lens that takes ideal radii to seen ones, where the ideal one is seen·(1 + κ·seen²) up to the seen radius `corner`; `focal` (px)
/// is for its error.
fn inverse(kappa: f64, corner: f64, focal: f64) -> Result<Distortion> {
    ensure!(
        1.0 + 3.0 * kappa * corner * corner > 0.0,
        "kappa1 makes the distortion fold over inside the picture; \
                                                        check kappa1, dpx and dpy"
    );
    let seen = DVector::from_fn(SAMPLES, |index, _| corner * (index + 1) as f64 / SAMPLES as f64);
    let ideal = seen.map(|seen| seen * (1.0 + kappa * seen * seen));
    // In units of the largest radius, so that the powers are alike.
    let most = ideal[SAMPLES - 1];
    let powers = DMatrix::from_fn(SAMPLES, 3, |row, power| (ideal[row] / most).powi(2 * power as i32 + 3));
    let moved = (&seen - &ideal) / most;
    let found = powers.clone().svd(true, true).solve(&moved, f64::EPSILON).map_err(anyhow::Error::msg)?;
    let error = (powers * &found - &moved).amax() * most * focal;
    ensure!(
        error < LARGEST_ERROR,
        "kappa1 bends the picture more than camera.json's lens model can represent (error {error:.2} px)"
    );
    let [k1, k2, k3] = std::array::from_fn(|index| found[index] / most.powi(2 * index as i32 + 2));
    Ok(Distortion { k1, k2, k3, ..Distortion::default() })
}
