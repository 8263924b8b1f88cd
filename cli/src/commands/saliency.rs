//! `gravisight saliency`.

use std::path::PathBuf;

use crate::draw;
use anyhow::{Context, Result};
use clap::Args;
use gravisight::internal::write_whole;
use gravisight::parts::Saliency;
use gravisight::{Localisation, LocaliseOptions, Size};
use serde_json::json;

use super::localise::{check_png, open_picture};
use super::print_line;
use crate::ball::BallArguments;
use crate::cameras;
use crate::device::DeviceChoice;
use crate::model;

/// A radius for what does not depend on it, m.
const ANY_RADIUS: f64 = 0.1;
/// Fields that only a radius gives.
const IN_METRES: [&str; 5] = ["depth", "depth_sigma", "camera", "world", "covariance"];

/// Show which pixels of a picture the ball's depth depends on.
///
/// Writes the picture with |∂depth/∂pixel| as a bright overlay: how much the estimated depth would change if the pixel got brighter,
/// computed through the whole network (on the CPU).
/// Without the ball's radius, a model that measures apparent size gives it as a fraction of the depth, not in metres.
#[derive(Args)]
pub struct Arguments {
    /// PNG, JPEG or WebP picture.
    #[arg(value_name = "IMAGE")]
    image: PathBuf,
    /// The camera that took it (camera.json).
    #[arg(long, value_name = "CAMERA.JSON")]
    camera: PathBuf,
    #[command(flatten)]
    ball: BallArguments,
    /// Where to write the picture.
    #[arg(long, value_name = "OUT.PNG")]
    out: PathBuf,
    /// Model: path of its card, its weights or both without extension, or the built-in `any` or `sd-l` [default: any].
    #[arg(long, value_name = "M")]
    model: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: Arguments) -> Result<()> {
    check_png("--out", &arguments.out)?;
    let given = arguments.ball.radius()?;
    let camera = cameras::open(&arguments.camera)?;
    let localiser = model::open(arguments.model.as_deref(), &DeviceChoice::Cpu.open()?)?;
    let picture = open_picture(&arguments.image)?;
    let name = || arguments.image.display().to_string();
    // What a size depends on does not change with the ball's radius.
    let is_relative = localiser.reads_size() && given.is_none();
    let ball_radius = given.or(is_relative.then_some(ANY_RADIUS));
    let options = LocaliseOptions { ball_radius, ..LocaliseOptions::default() };
    let found = pollster::block_on(localiser.localise(&picture, &camera, options)).with_context(name)?;
    let mut saliency = pollster::block_on(localiser.saliency(&picture)).with_context(name)?;
    if saliency.depth.is_none() && !is_relative {
        // Fractions of the depth, to metres.
        saliency.values.iter_mut().for_each(|value| *value *= found.depth as f32);
    }
    let (drawn, full) = draw::with_saliency(picture.rgb(), &saliency);
    write_whole(&arguments.out, &draw::png(&drawn)?)?;
    let radius = localiser.confidence_radius(picture.size());
    let near = share_near(&saliency, &found, picture.size(), radius);
    if arguments.json {
        let mut object = serde_json::to_value(&found)?;
        if let Some(fields) = object.as_object_mut().filter(|_| is_relative) {
            IN_METRES.iter().for_each(|field| _ = fields.remove(*field));
        }
        let full_name = if is_relative { "full_fraction" } else { "full_m" };
        object["saliency"] = json!({full_name: full, "near": near, "radius_px": radius});
        return Ok(print_line(object)?);
    }
    let Localisation { image: [u, v], depth, .. } = found;
    let (depth, unit) = match is_relative {
        true => ("depth unknown without --ball-radius or --ball".into(), "of the depth"),
        false => (format!("depth {depth:.3} m"), "m of depth"),
    };
    print_line(format_args!("image       {u:.2}, {v:.2} px   {depth}"))?;
    let percent = near * 100.0;
    print_line(format_args!("saliency    {percent:.0} % within {radius:.0} px of the ball"))?;
    Ok(print_line(format_args!("full colour {full:.2e} {unit} for a pixel from black to white"))?)
}

/// Fraction of all |∂depth/∂brightness| that is within `radius` px of the position found.
fn share_near(saliency: &Saliency, found: &Localisation, size: Size, radius: f64) -> f64 {
    let [width, height] = size.xy();
    let scale = [width / saliency.width as f64, height / saliency.height as f64];
    let [mut near, mut all] = [0.0; 2];
    for (index, value) in saliency.values.iter().enumerate() {
        let cell = [index % saliency.width, index / saliency.width];
        let off = [0, 1].map(|axis| (cell[axis] as f64 + 0.5) * scale[axis] - 0.5 - found.image[axis]);
        let strength = f64::from(value.abs());
        all += strength;
        near += if off[0].hypot(off[1]) <= radius { strength } else { 0.0 };
    }
    if all > 0.0 { near / all } else { 0.0 }
}
