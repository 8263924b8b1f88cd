//! `gravisight import`.

use std::path::PathBuf;

use crate::import::{Format, ImportOptions, ImportReport, import};
use anyhow::Result;
use clap::{Args, ValueEnum};
use gravisight::parts::Statistic;
use gravisight::{Camera, Scene};
use serde_json::{Value, json};

use super::print_line;
use crate::progress::Progress;

/// Refused clips that are printed.
const REFUSED: usize = 10;
/// The formats whose pictures come without a camera.
const WITHOUT_CAMERA: [(&str, &str); 3] = [("from", "coco"), ("from", "cvat"), ("from", "tracknet")];

/// Turn other people's data into clips.
#[derive(Args)]
pub struct Arguments {
    /// The format.
    #[arg(long, value_enum, value_name = "FORMAT")]
    from: From,
    /// The data: a folder, or an annotation file.
    source: PathBuf,
    /// The clips folder to make.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// The camera of the pictures (camera.json): for coco, cvat and tracknet; sd, spring and rd bring theirs.
    #[arg(long, value_name = "CAMERA.JSON", required_if_eq_any(WITHOUT_CAMERA))]
    camera: Option<PathBuf>,
    /// The place and its ball (scene.json), for every clip.
    #[arg(long, value_name = "SCENE.JSON")]
    scene: Option<PathBuf>,
    /// Frames a second: for pictures, which bring no times; for a video, in place of its own.
    #[arg(long, value_name = "F", required_if_eq("from", "coco"))]
    fps: Option<f64>,
    /// Folder of the pictures, or the video [default: what lies beside the annotations].
    #[arg(long, value_name = "PATH")]
    pictures: Option<PathBuf>,
    /// Category (coco) or label (cvat) of the ball, where there are others.
    #[arg(long, value_name = "NAME")]
    category: Option<String>,
    /// Cut into clips of so many frames [default: 16 for rd, else whole].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    clip_frames: Option<u32>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum From {
    /// The paper's synthetic data set (synthetic_dataset/SPLIT/xmlN/cameraM/VIDEO).
    Sd,
    /// The paper's ball on a spring (ball_carousel/SPLIT/VIDEO).
    Spring,
    /// The paper's real data set (real_dataset/SPLIT/cameraN/VIDEO).
    Rd,
    /// COCO annotations (JSON): first visible keypoint, else the box's centre.
    Coco,
    /// CVAT annotations (XML 1.1), for images or for video: points or boxes.
    Cvat,
    /// Tracks (CSV with Frame,Visibility,X,Y) beside folders of frames or videos.
    Tracknet,
}

impl From {
    fn format(self) -> Format {
        match self {
            From::Sd => Format::Sd,
            From::Spring => Format::Spring,
            From::Rd => Format::Rd,
            From::Coco => Format::Coco,
            From::Cvat => Format::Cvat,
            From::Tracknet => Format::Tracknet,
        }
    }

    /// Options that mean nothing for this format.
    fn unused(self, arguments: &Arguments) -> Option<&'static str> {
        let published = matches!(self, From::Sd | From::Spring | From::Rd);
        let given = [
            ("--camera", arguments.camera.is_some(), published),
            ("--fps", arguments.fps.is_some(), published),
            ("--pictures", arguments.pictures.is_some(), published),
            ("--category", arguments.category.is_some(), published || self == From::Tracknet),
        ];
        given.into_iter().find(|(_, given, unused)| *given && *unused).map(|(name, ..)| name)
    }
}

pub fn run(arguments: Arguments) -> Result<()> {
    if let Some(option) = arguments.from.unused(&arguments) {
        let message = format!("{option} means nothing with --from {}, which brings its own", name(arguments.from));
        clap::Error::raw(clap::error::ErrorKind::ArgumentConflict, message + "\n").exit();
    }
    let options = ImportOptions {
        camera: arguments.camera.as_deref().map(Camera::from_file).transpose()?,
        scene: arguments.scene.as_deref().map(Scene::open).transpose()?,
        fps: arguments.fps,
        clip_frames: arguments.clip_frames.map(|frames| frames as usize),
        category: arguments.category.clone(),
        pictures: arguments.pictures.clone(),
    };
    let mut progress = Progress::new();
    let mut observe = |done: usize, all: usize| progress.set(done as u64, all as u64, "clips");
    let report = import(arguments.from.format(), &arguments.source, &arguments.out, &options, &mut observe);
    progress.finish();
    match arguments.json {
        true => Ok(print_line(as_json(&arguments, &report?))?),
        false => print(&arguments, &report?),
    }
}

fn name(from: From) -> String {
    from.to_possible_value().map(|value| value.get_name().to_string()).unwrap_or_default()
}

fn as_json(arguments: &Arguments, report: &ImportReport) -> Value {
    let refused = report.refused.iter().map(
        |refused| json!({"clip": refused.clip, "code": refused.reason.code(), "reason": refused.reason.to_string()}),
    );
    json!({"from": name(arguments.from), "out": arguments.out, "clips": report.clips, "frames": report.frames,
        "labels": report.labels, "positions": report.positions, "scenes": report.scenes, "gaps": report.gaps,
        "fps": Statistic::of(report.fps.iter().copied()),
        "reprojection_px": Statistic::of(report.reprojection_px.iter().copied()),
        "refused": refused.collect::<Vec<_>>()})
}

fn print(arguments: &Arguments, report: &ImportReport) -> Result<()> {
    let ImportReport { clips, frames, labels, positions, scenes, gaps, .. } = report;
    print_line(format_args!("clips      {clips} in {}", arguments.out.display()))?;
    print_line(format_args!("frames     {frames}, {labels} with a 2D label, {positions} with a 3D position"))?;
    let fps = |pick: fn(f64, f64) -> f64| report.fps.iter().copied().reduce(pick).unwrap_or_default();
    let (slowest, fastest) = (fps(f64::min), fps(f64::max));
    match fastest - slowest < 1e-3 {
        true => print_line(format_args!("frame rate {slowest:.3} a second; longer steps: {gaps}"))?,
        false => print_line(format_args!("frame rate {slowest:.3} to {fastest:.3} a second; longer steps: {gaps}"))?,
    }
    if let Statistic { mean: Some(mean), std: Some(std), n, .. } = Statistic::of(report.reprojection_px.iter().copied())
    {
        print_line(format_args!("2D label to projected 3D position: {mean:.3} ± {std:.3} px (mean of {n})"))?;
    }
    match scenes {
        0 => print_line("scene      none; give --scene for training with the laws of motion")?,
        _ => print_line(format_args!("scene      in {scenes} clips"))?,
    }
    print_line(format_args!("refused    {}", report.refused.len()))?;
    for refused in report.refused.iter().take(REFUSED) {
        print_line(format_args!("  {}: {}", refused.clip, refused.reason))?;
    }
    match report.refused.len().checked_sub(REFUSED) {
        Some(more) if more > 0 => Ok(print_line(format_args!("  and {more} more (--json prints all)"))?),
        _ => Ok(()),
    }
}
