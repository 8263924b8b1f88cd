//! `gravisight calibrate`.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser};
use serde_json::json;

use super::print_line;
use gravisight::camera::{CalibrationMethod, PointSigma};
use gravisight::internal::write_whole;
use gravisight::{Calibration, Court, Picture, Points, Unknowns, calibrate, calibrate_by_lines};

use crate::cameras::{self, Intrinsics};
use crate::footage::Footage;
use crate::import::is_picture;

/// An example, which a test reads.
pub const EXAMPLE: &str = r#"{
  "width": 1920, "height": 1080,
  "court": "tennis",
  "names": ["near doubles corner left", "near doubles corner right", "far doubles corner left", "far doubles corner right"],
  "image": [[312.5, 905.0], [1630.0, 897.5], [601.0, 322.0], [1297.0, 319.5]]
}"#;

/// Find a camera from labelled points.
#[derive(Args)]
#[command(after_long_help = format!("\
points.json gives the points' positions in the picture (`image`, px from the centre of the top left pixel) and identifies them: by `names`
of a court's points (`gravisight calibrate --list tennis`), or by `world`, their positions in metres. Give at least 4 in one plane, or 6 in
space:\n\n{EXAMPLE}\n
`intrinsic` (3 rows of 3) and `distortion` (k1, k2, p1, p2, k3) may be given if known. `lines` are painted lines in addition to
the court's: {{\"from\": [x,y,z], \"to\": [x,y,z], \"width\": 0.05}}."))]
pub struct Arguments {
    /// The points (points.json: width, height, intrinsic if known, image, and world or court and names).
    #[arg(long, value_name = "POINTS.JSON", required_unless_present = "list")]
    points: Option<PathBuf>,
    /// Take intrinsics and lens from this camera: a camera.json, or another tool's file (see `gravisight camera import --help`).
    #[arg(long, value_name = "CAMERA", conflicts_with = "list")]
    camera: Option<PathBuf>,
    /// Estimate these as well; the focal length is estimated anyway if the file has no intrinsic.
    #[arg(long, value_delimiter = ',', value_parser = unknowns())]
    estimate: Vec<String>,
    /// Then refine the camera with the court's painted lines in this picture (or a video's first frame), to a fraction of a pixel. Four
    /// to six clicks are enough.
    #[arg(long, value_name = "PICTURE|VIDEO", conflicts_with = "list")]
    refine_lines: Option<PathBuf>,
    /// Write the camera here.
    #[arg(long, value_name = "CAMERA.JSON")]
    out: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
    /// List the named points of a court instead (tennis, volleyball, …).
    #[arg(long, value_name = "COURT", conflicts_with = "points")]
    list: Option<String>,
}

fn unknowns() -> PossibleValuesParser {
    PossibleValuesParser::new(Unknowns::NAMES.map(|(name, what)| PossibleValue::new(name).help(what)))
}

pub fn run(arguments: Arguments) -> Result<()> {
    if let Some(court) = &arguments.list {
        return list(court, arguments.json);
    }
    let path = arguments.points.context("--points is missing")?;
    let points = with_camera(Points::from_file(&path)?, arguments.camera.as_deref())?;
    let unknowns = Unknowns::named(&arguments.estimate)?;
    let found = match &arguments.refine_lines {
        Some(shown) => calibrate_by_lines(&points, &unknowns, &first_picture(shown)?),
        None => calibrate(&points, &unknowns),
    };
    let found = found.with_context(|| path.display().to_string())?;
    if let Some(out) = &arguments.out {
        write_whole(out, serde_json::to_string_pretty(&found.camera)?.as_bytes())?;
    }
    match arguments.json {
        true => {
            found.doubts.iter().for_each(|doubt| eprintln!("DOUBTFUL: {doubt}"));
            print_line(serde_json::to_string(&found)?)?;
        }
        false => print(&points, &found, arguments.out.is_none())?,
    }
    Ok(())
}

/// The points, with intrinsics and lens of a camera's file.
fn with_camera(points: Points, camera: Option<&Path>) -> Result<Points> {
    let Some(path) = camera else { return Ok(points) };
    let name = path.display();
    ensure!(points.intrinsic.is_none(), "{name}: give either --camera or `intrinsic` in the points, not both");
    let Intrinsics { size, intrinsic, distortion } = cameras::intrinsics(path)?;
    if let Some(size) = size.filter(|&size| size != points.size) {
        bail!("{name}: is for {size} pictures, but the points are for {}", points.size);
    }
    Ok(Points { intrinsic: Some(intrinsic), distortion, ..points })
}

fn first_picture(path: &Path) -> Result<Picture> {
    if is_picture(path) {
        return Picture::open(path).with_context(|| path.display().to_string());
    }
    Footage::first(path)
}

fn list(court: &str, as_json: bool) -> Result<()> {
    let Court { about, points, .. } = Court::named(court)?;
    if as_json {
        return Ok(print_line(json!({"court": court, "about": about, "points": points}))?);
    }
    print_line(about)?;
    print_line("origin: middle of the floor; x right, y away from the viewer, z up, seen from the near end; metres")?;
    for (name, [x, y, z]) in points {
        print_line(format_args!("{x:9.3} {y:9.3} {z:7.3}  {name}"))?;
    }
    Ok(())
}

fn print(points: &Points, found: &Calibration, with_camera: bool) -> Result<()> {
    let camera = &found.camera;
    print_line("  x px     y px   residual px   point")?;
    for (index, (image, residual)) in points.image.iter().zip(&found.residuals_px).enumerate() {
        let name = points.names.get(index).cloned().unwrap_or_else(|| format!("{}", points.world[index]));
        let mark = if found.outliers.iter().any(|wrong| wrong.index == index) { "  WRONG CLICK? left out" } else { "" };
        print_line(format_args!("{:7.1} {:8.1} {:9.2}      {name}{mark}", image.x, image.y, residual.norm()))?;
    }
    for line in found.lines.iter().filter(|line| line.is_expected) {
        let [from, to] = [points.lines[line.index].from, points.lines[line.index].to];
        let seen = match line.share {
            0.0 => "NOT FOUND".into(),
            fraction => format!("{:.0} % found, {:.2} px rms", 100.0 * fraction, line.rms_px),
        };
        print_line(format_args!("line {} from {from:?} to {to:?}: {seen}", line.index))?;
    }
    let used = points.image.len() - found.outliers.len();
    print_line(format_args!(
        "{used} points, {:.2} px rms (click noise about {:.2} px per coordinate), initialised by {}",
        found.rms_px,
        found.noise_px,
        match found.method {
            CalibrationMethod::DirectLinearTransform => "direct linear transform",
            CalibrationMethod::Homography => "homography",
        }
    ))?;
    let centre = found.centre;
    let [sx, sy, sz] = <[f64; 3]>::from(found.sigma.centre).map(|sigma| 100.0 * sigma);
    print_line(format_args!(
        "camera at x {:.3}  y {:.3}  z {:.3} m, ± {sx:.1} {sy:.1} {sz:.1} cm; orientation ± {:.2}°",
        centre.x,
        centre.y,
        centre.z,
        found.sigma.rotation.norm().to_degrees()
    ))?;
    print_line(format_args!("focal length {:.1} ± {:.1} px", camera.intrinsic()[(0, 0)], found.sigma.focal_px))?;
    let PointSigma { depth, world, .. } = found.point_sigma;
    let sigma = 100.0 * world.norm();
    print_line(format_args!(
        "position error due to this camera: ± {sigma:.1} cm for a ball in the middle of the picture, {depth:.1} m away"
    ))?;
    for doubt in &found.doubts {
        print_line(format_args!("DOUBTFUL: {doubt}"))?;
    }
    if with_camera {
        print_line(serde_json::to_string(camera)?)?;
    }
    Ok(())
}
