//! `gravisight localise`.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::Args;

use super::print_line;
use crate::ball::BallArguments;
use crate::device::DeviceChoice;
use crate::{cameras, draw, model};
use gravisight::internal::write_whole;
use gravisight::parts::Candidate;
use gravisight::{Localisation, LocaliseOptions, Picture, Region, Scene};

/// Find the ball's 3D position in pictures.
#[derive(Args)]
pub struct Arguments {
    /// PNG, JPEG or WebP pictures.
    #[arg(required = true, value_name = "IMAGE")]
    images: Vec<PathBuf>,
    /// The camera that took them (camera.json).
    #[arg(long, value_name = "CAMERA.JSON")]
    camera: PathBuf,
    /// Model: path of its card, its weights or both without extension, or the built-in `any` or `sd-l` [default: any].
    #[arg(long, value_name = "M")]
    model: Option<PathBuf>,
    #[command(flatten)]
    ball: BallArguments,
    /// Scene (scene.json, or the name of a sport) that gives the ball's radius and the volume in which the ball can be.
    #[arg(long, value_name = "SCENE.JSON", conflicts_with_all = ["ball_radius", "ball"])]
    scene: Option<PathBuf>,
    /// Search region: left, top, width and height, px.
    #[arg(long, value_name = "X,Y,W,H", value_parser = region)]
    region: Option<Region>,
    /// Also print up to this many candidates.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u8).range(0..=100))]
    candidates: u8,
    /// Device to run on.
    #[arg(long, value_enum, default_value = "auto")]
    device: DeviceChoice,
    /// Write the picture with heatmap and position drawn over it (one picture only).
    #[arg(long, value_name = "OUT.PNG")]
    overlay: Option<PathBuf>,
    /// Print one JSON object per picture, with `"file"` if there are several.
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: Arguments) -> Result<()> {
    let several = arguments.images.len() > 1;
    ensure!(
        !(several && arguments.overlay.is_some()),
        "--overlay takes one picture, but {} were given",
        arguments.images.len()
    );
    if let Some(out) = &arguments.overlay {
        check_png("--overlay", out)?;
    }
    let given = arguments.ball.radius()?;
    let camera = cameras::open(&arguments.camera)?;
    let scene = arguments.scene.as_deref().map(Scene::open).transpose()?;
    let ball_radius = given.or(scene.as_ref().map(|scene| scene.ball.radius));
    let localiser = model::open(arguments.model.as_deref(), &arguments.device.open()?)?;
    // A model of one scene knows itself where its ball can be.
    let volume = scene.as_ref().and_then(Scene::volume).filter(|_| localiser.reads_size());
    let landmarks = scene.as_ref().map_or(vec![], Scene::landmarks);
    for path in &arguments.images {
        let name = || path.display().to_string();
        let picture = open_picture(path)?;
        let options = LocaliseOptions {
            maps: arguments.overlay.is_some(),
            ball_radius,
            region: arguments.region,
            candidates: arguments.candidates.into(),
            volume,
        };
        let mut found = pollster::block_on(localiser.localise(&picture, &camera, options)).with_context(name)?;
        found.doubt(&camera, &landmarks);
        if let (Some(out), Some(maps)) = (&arguments.overlay, &found.maps) {
            let mut drawn = draw::with_heatmap(picture.rgb(), maps);
            draw::mark(&mut drawn, found.image);
            write_whole(out, &draw::png(&drawn)?)?;
        }
        if arguments.json {
            let mut object = serde_json::to_value(&found)?;
            if several {
                object["file"] = path.to_string_lossy().into();
            }
            print_line(object)?;
        } else {
            print(several.then(name), &found)?;
        }
    }
    Ok(())
}

/// `X,Y,W,H`.
fn region(text: &str) -> Result<Region, String> {
    let numbers: Vec<u32> = text.split(',').filter_map(|number| number.trim().parse().ok()).collect();
    match (numbers.as_slice(), text.split(',').count()) {
        (&[left, top, width, height], 4) => Ok(Region { left, top, width, height }),
        _ => Err("must be four whole numbers of pixels, as in 800,300,256,256".into()),
    }
}

/// Refuses an `option` that is no PNG's name.
pub fn check_png(option: &str, out: &Path) -> Result<()> {
    let png = out.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png"));
    ensure!(png, "{option} writes a PNG: {} must end in .png", out.display());
    Ok(())
}

/// The picture at `path`; errors name it.
pub fn open_picture(path: &Path) -> Result<Picture> {
    match Picture::open(path) {
        // An I/O error names the file itself.
        Err(error @ gravisight::Error::Io { .. }) => Err(error.into()),
        other => other.with_context(|| path.display().to_string()),
    }
}

fn print(name: Option<String>, found: &Localisation) -> Result<()> {
    if let Some(name) = name {
        print_line(name)?;
    }
    let Localisation { image: [u, v], depth, depth_sigma, camera, world, confidence, .. } = found;
    if !found.ball_found {
        print_line("no ball found; the likeliest detection is")?;
    }
    let sigma = depth_sigma.map_or(String::new(), |sigma| format!(" ± {sigma:.3}"));
    let point = |[x, y, z]: &[f64; 3]| format!("x {x:8.3}  y {y:8.3}  z {z:8.3} m");
    print_line(format_args!("world       {}", point(world)))?;
    print_line(format_args!("camera      {}", point(camera)))?;
    print_line(format_args!("image       {u:.2}, {v:.2} px   depth {depth:.3}{sigma} m   confidence {confidence:.2}"))?;
    for Candidate { image: [u, v], radius_px, depth, depth_sigma, confidence, .. } in &found.candidates {
        print_line(format_args!(
            "candidate   {u:.2}, {v:.2} px   radius {radius_px:.2} px   depth {depth:.3} ± {depth_sigma:.3} m   confidence {confidence:.2}"
        ))?;
    }
    for note in &found.notes {
        print_line(format_args!("note        {note}"))?;
    }
    Ok(())
}
