//! `gravisight calibrate`.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser};
use serde_json::json;

use super::print_line;
use gravisight::camera::{CalibrationMethod, OtherCourt, PointSigma};
use gravisight::internal::write_whole;
use gravisight::{
    Calibration, Court, CourtLine, CourtVerdict, FoundCourt, Picture, Points, Unknowns, calibrate, calibrate_by_lines,
};

use crate::cameras::{self, Intrinsics};
use crate::court;
use crate::draw;
use crate::footage::Footage;
use crate::import::is_picture;

/// An example, which a test reads.
pub const EXAMPLE: &str = r#"{
  "width": 1920, "height": 1080,
  "court": "tennis",
  "names": ["near doubles corner left", "near doubles corner right", "far doubles corner left", "far doubles corner right"],
  "image": [[312.5, 905.0], [1630.0, 897.5], [601.0, 322.0], [1297.0, 319.5]]
}"#;

/// Find a camera from labelled points, or from a court's painted lines.
#[derive(Args)]
#[command(after_long_help = format!("\
points.json gives the points' positions in the picture (`image`, px from the centre of the top left pixel) and identifies them: by `names`
of a court's points (`gravisight calibrate --list tennis`), or by `world`, their positions in metres. Give at least 4 in one plane, or 6 in
space:\n\n{EXAMPLE}\n
`intrinsic` (3 rows of 3) and `distortion` (k1, k2, p1, p2, k3) may be given if known. `lines` are painted lines that replace
the court's: {{\"from\": [x,y,z], \"to\": [x,y,z], \"width\": 0.05}}.\n
Without points: `gravisight calibrate match.mp4 --court tennis` finds the court's painted lines by itself. The picture must show at least
five of them and some of their corners. A sure result is right with a probability of at least 95 %. A probable one prints a warning: check it
with --overlay. If no court is found, the exit status is 1."))]
pub struct Arguments {
    /// With --court: a picture, or a video, whose first frames are used.
    #[arg(value_name = "PICTURE|VIDEO", requires = "court")]
    shown: Option<PathBuf>,
    /// Find the camera from this court's painted lines in a picture, without points (see --list for the names of the courts; not every court can
    /// be found); `auto` tries every court whose lines are known.
    #[arg(long, value_name = "COURT", requires = "shown", conflicts_with_all = ["points", "camera", "refine_lines", "list"])]
    court: Option<String>,
    /// With --court: draw the court's lines over the picture, as the camera sees them, into this PNG file.
    #[arg(long, value_name = "PICTURE.PNG", requires = "court")]
    overlay: Option<PathBuf>,
    /// The points (points.json: width, height, intrinsic if known, image, and world or court and names).
    #[arg(long, value_name = "POINTS.JSON", required_unless_present_any = ["list", "court"])]
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
    if let (Some(court), Some(shown)) = (&arguments.court, &arguments.shown) {
        return by_court(court, shown, &arguments);
    }
    let path = arguments.points.context("--points is missing")?;
    let points = with_camera(Points::from_file(&path)?, arguments.camera.as_deref())?;
    let unknowns = Unknowns::named(&arguments.estimate)?;
    let found = match &arguments.refine_lines {
        Some(shown) => calibrate_by_lines(&points, &unknowns, &first_picture(shown)?),
        None => calibrate(&points, &unknowns),
    };
    let found = found.with_context(|| path.display().to_string())?;
    write_camera(&found, arguments.out.as_deref())?;
    match arguments.json {
        true => print_json(&found, None)?,
        false => {
            print_points(&points, &found)?;
            print_lines(&points.lines, &found)?;
            print_fit(&points, &found)?;
            print_camera(&found, arguments.out.is_none())?;
        }
    }
    Ok(())
}

/// The camera by a court's painted lines alone.
fn by_court(court: &str, shown: &Path, arguments: &Arguments) -> Result<()> {
    let name = shown.display();
    let frame = if is_picture(shown) { "" } else { ", first frames" };
    let (found, picture) = court::search(court::first_frames(shown)?, court)?;
    let FoundCourt { verdict, reason, .. } = &found;
    ensure!(
        *verdict != CourtVerdict::None,
        "{name}{frame}: no court found: {reason}; try another picture, or mark points (`gravisight calibrate --help`)"
    );
    let unknowns = Unknowns::named(&arguments.estimate)?;
    let refined = found.calibrate(&picture, &unknowns);
    let refined = refined.with_context(|| format!("{name}{frame}: the camera cannot be refined ({reason})"))?;
    let lines: Vec<CourtLine> = found.lines.iter().map(|line| line.line.clone()).collect();
    write_camera(&refined, arguments.out.as_deref())?;
    if let Some(overlay) = &arguments.overlay {
        let mut drawn = picture.into_rgb();
        draw::lines(&mut drawn, &refined.camera, &lines);
        write_whole(overlay, &draw::png(&drawn)?)?;
    }
    if *verdict == CourtVerdict::Probable {
        eprintln!(
            "WARNING: the camera is right with a probability of {:.0} %: {reason}. Check with --overlay that the drawn lines lie on the court's lines.",
            100.0 * found.probability
        );
    }
    match arguments.json {
        true => print_json(&refined, Some(&found)),
        false => {
            let (court, percent) = (&found.court, 100.0 * found.probability);
            print_line(format_args!("{name}{frame}: {court}, probability {percent:.0} %: {reason}"))?;
            for other in &found.others {
                let OtherCourt { court, probability, .. } = other;
                print_line(format_args!("another camera fits: {court}, probability {:.0} %", 100.0 * probability))?;
            }
            print_lines(&lines, &refined)?;
            print_camera(&refined, arguments.out.is_none())
        }
    }
}

fn write_camera(found: &Calibration, out: Option<&Path>) -> Result<()> {
    let Some(out) = out else { return Ok(()) };
    Ok(write_whole(out, serde_json::to_string_pretty(&found.camera)?.as_bytes())?)
}

fn print_json(found: &Calibration, court: Option<&FoundCourt>) -> Result<()> {
    found.doubts.iter().for_each(|doubt| eprintln!("DOUBTFUL: {doubt}"));
    let mut all = serde_json::to_value(found)?;
    if let Some(court) = court {
        all["court"] = serde_json::to_value(court)?;
    }
    Ok(print_line(all)?)
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

fn print_points(points: &Points, found: &Calibration) -> Result<()> {
    print_line("  x px     y px   residual px   point")?;
    for (index, (image, residual)) in points.image.iter().zip(&found.residuals_px).enumerate() {
        let name = points.names.get(index).cloned().unwrap_or_else(|| format!("{}", points.world[index]));
        let mark = if found.outliers.iter().any(|wrong| wrong.index == index) { "  WRONG CLICK? left out" } else { "" };
        print_line(format_args!("{:7.1} {:8.1} {:9.2}      {name}{mark}", image.x, image.y, residual.norm()))?;
    }
    Ok(())
}

fn print_lines(lines: &[CourtLine], found: &Calibration) -> Result<()> {
    for line in found.lines.iter().filter(|line| line.is_expected) {
        let CourtLine { from, to, .. } = &lines[line.index];
        let seen = match line.share {
            0.0 => "NOT FOUND".into(),
            fraction => format!("{:.0} % found, {:.2} px rms", 100.0 * fraction, line.rms_px),
        };
        print_line(format_args!("line {} from {from:?} to {to:?}: {seen}", line.index))?;
    }
    Ok(())
}

fn print_fit(points: &Points, found: &Calibration) -> Result<()> {
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
    Ok(())
}

fn print_camera(found: &Calibration, with_camera: bool) -> Result<()> {
    let camera = &found.camera;
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
