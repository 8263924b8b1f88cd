//! `gravisight camera`.

use std::path::PathBuf;

use anyhow::Result;
use clap::{Args, Subcommand};
use gravisight::internal::write_whole;
use gravisight::{Camera, Scene, Size};
use nalgebra::Point3;
use serde_json::json;

use super::print_line;
use super::synth::parse_size;
use crate::cameras::{self, Lens, Stated, Units, World};

/// Import cameras from other tools.
#[derive(Subcommand)]
pub enum Subcommands {
    Import(Arguments),
}

/// Convert another tool's camera to camera.json.
///
/// Supported formats: OpenCV's FileStorage (YAML, XML, JSON), NumPy's .npz with mtx, dist, rvecs and tvecs, ROS's camera_info, Kalibr's camchain,
/// COLMAP's cameras.txt (images.txt beside it) and Tsai's model in XML. If the file lacks something, the error message names the option
/// to add.
#[derive(Args)]
pub struct Arguments {
    /// The file; for COLMAP, the folder works too.
    file: PathBuf,
    /// Write the camera here.
    #[arg(long, value_name = "CAMERA.JSON")]
    to: Option<PathBuf>,
    /// Unit of the file's translation.
    #[arg(long, value_enum)]
    units: Option<Units>,
    /// Axes of the file's world, which is right-handed.
    #[arg(long, value_enum)]
    world: Option<World>,
    /// Size of the pictures, if the file does not state it.
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<Size>,
    /// Take the pose (rvec or R, and tvec or T) from this file.
    #[arg(long, value_name = "FILE")]
    pose: Option<PathBuf>,
    /// Which picture or camera to use, if there are several: its name (COLMAP, Kalibr) or its number, from 0.
    #[arg(long, value_name = "NAME")]
    image: Option<String>,
    /// Meaning of 4 distortion coefficients.
    #[arg(long, value_enum)]
    lens: Option<Lens>,
    /// Check that the camera looks at this scene (scene.json, or the name of a sport).
    #[arg(long, value_name = "SCENE.JSON")]
    scene: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

pub fn run(Subcommands::Import(arguments): Subcommands) -> Result<()> {
    let Arguments { file, to, units, world, size, pose, image, lens, scene, json } = arguments;
    let landmarks = scene.as_deref().map(Scene::open).transpose()?.map_or(vec![], |scene| scene.landmarks());
    let stated = Stated { units, world, size, lens, image };
    let (camera, notes) = cameras::import(&file, &stated, pose.as_deref())?;
    let doubts = doubts(&camera, &landmarks);
    if let Some(to) = &to {
        write_whole(to, serde_json::to_string_pretty(&camera)?.as_bytes())?;
    }
    let centre = camera.world_from_camera(&Point3::origin());
    if json {
        let centre = [centre.x, centre.y, centre.z];
        return Ok(print_line(json!({"camera": camera, "centre": centre, "notes": notes, "doubts": doubts}))?);
    }
    print_line(format_args!("camera at x {:.3}  y {:.3}  z {:.3} m (z up)", centre.x, centre.y, centre.z))?;
    for note in &notes {
        print_line(format_args!("NOTE: {note}"))?;
    }
    for doubt in &doubts {
        print_line(format_args!("DOUBTFUL: {doubt}"))?;
    }
    if to.is_none() {
        print_line(serde_json::to_string(&camera)?)?;
    }
    Ok(())
}

/// What is doubtful about the camera, and which options may be wrong then.
fn doubts(camera: &Camera, landmarks: &[Point3<f64>]) -> Vec<String> {
    let mut doubts = camera.doubts(None, landmarks);
    if landmarks.is_empty() && camera.camera_from_world(&Point3::origin()).z <= 0.0 {
        doubts.push(
            "the world's origin is behind the camera: does the pose transform world to camera, and not the inverse?"
                .into(),
        );
    }
    if !doubts.is_empty() {
        doubts.push("check that --units and --world match the file".into());
    }
    doubts
}
