//! `gravisight calibrate`.

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::{Args, ValueEnum};
use serde_json::json;

use super::print_line;
use gravisight::internal::write_whole;
use gravisight::{Calibration, Court, Points, Unknowns, calibrate};

/// Find a camera from labelled points.
#[derive(Args)]
pub struct Arguments {
    /// The points (points.json: width, height, intrinsic if known, image, and world or court and names).
    #[arg(long, value_name = "POINTS.JSON", required_unless_present = "list")]
    points: Option<PathBuf>,
    /// Estimate these, too; the focal length is estimated where the file has no intrinsic.
    #[arg(long, value_enum, value_delimiter = ',')]
    estimate: Vec<Unknown>,
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

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Unknown {
    Focal,
    PrincipalPoint,
    /// k1 and k2.
    Distortion,
    /// k1, k2, p1, p2 and k3.
    FullDistortion,
}

pub fn run(arguments: Arguments) -> Result<()> {
    if let Some(court) = &arguments.list {
        return list(court, arguments.json);
    }
    let path = arguments.points.context("--points is missing")?;
    let points = Points::from_file(&path)?;
    let names =
        arguments.estimate.iter().filter_map(|unknown| Some(unknown.to_possible_value()?.get_name().to_string()));
    let unknowns = Unknowns::named(&names.collect::<Vec<_>>())?;
    let found = calibrate(&points, &unknowns).with_context(|| path.display().to_string())?;
    if let Some(out) = &arguments.out {
        write_whole(out, serde_json::to_string_pretty(&found.camera)?.as_bytes())?;
    }
    match arguments.json {
        true => print_line(found.as_json(&points)?)?,
        false => print(&points, &found, arguments.out.is_none())?,
    }
    Ok(())
}

fn list(court: &str, as_json: bool) -> Result<()> {
    let Court { about, points } = Court::named(court)?;
    if as_json {
        return Ok(print_line(json!({"court": court, "about": about, "points": points}))?);
    }
    print_line(about)?;
    print_line("origin on the floor in the middle; x right, y away, z up, as seen from the near end; metres")?;
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
        let mark = if found.outliers.contains(&index) { "  WRONG CLICK? left out" } else { "" };
        print_line(format_args!("{:7.1} {:8.1} {:9.2}      {name}{mark}", image.x, image.y, residual.norm()))?;
    }
    let used = points.image.len() - found.outliers.len();
    print_line(format_args!(
        "{used} points, {:.2} px rms (clicks are good to about {:.2} px a coordinate), start by {}",
        found.rms_px,
        found.noise_px,
        found.method.name()
    ))?;
    let centre = camera.world_from_camera(&nalgebra::Point3::origin());
    let [sx, sy, sz] = <[f64; 3]>::from(found.sigma_centre).map(|sigma| 100.0 * sigma);
    print_line(format_args!(
        "camera at x {:.3}  y {:.3}  z {:.3} m, ± {sx:.1} {sy:.1} {sz:.1} cm; turned to ± {:.2}°",
        centre.x,
        centre.y,
        centre.z,
        found.sigma_rotation.norm().to_degrees()
    ))?;
    print_line(format_args!("focal length {:.1} ± {:.1} px", camera.intrinsic()[(0, 0)], found.sigma_focal_px))?;
    let (image, depth) = found.middle(points);
    let sigma = 100.0 * found.point_sigma(&image, depth)?.norm();
    print_line(format_args!(
        "a ball in the picture's middle, {depth:.1} m away, is placed to ± {sigma:.1} cm by this camera"
    ))?;
    if with_camera {
        print_line(serde_json::to_string(camera)?)?;
    }
    Ok(())
}
