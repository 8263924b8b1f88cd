//! `gravisight import`.

use std::path::{Path, PathBuf};

use crate::cameras;
use crate::import::{DrawnTrack, Format, ImportOptions, ImportReport, drawn_track, import};
use anyhow::{Context, Result};
use clap::error::ErrorKind;
use clap::{Args, ValueEnum};
use gravisight::Scene;
use gravisight::internal::write_whole;
use gravisight::parts::Statistic;
use serde_json::{Value, json};

use super::{nowhere, print_line};
use crate::progress::Progress;

/// Refused clips that are printed.
const REFUSED: usize = 10;

/// Convert other data sets to clips, or an annotated ball to a 2D track for `fit`.
#[derive(Args)]
pub struct Arguments {
    /// The format.
    #[arg(long, value_enum, value_name = "FORMAT")]
    from: Format,
    /// The data: a folder, or an annotation file.
    source: PathBuf,
    /// The clips folder to make.
    #[arg(long, value_name = "DIR", required_unless_present = "track")]
    out: Option<PathBuf>,
    /// Write the ball's 2D track instead, with its radii (cvat, yolo, labelme, label-studio; needs no camera). The radius is the
    /// semi-minor axis of an ellipse, or half the shorter side of a box. A ball marked outside or occluded is written as not visible.
    #[arg(long, value_name = "TRACK.CSV", conflicts_with_all = ["out", "camera", "scene", "clip_frames"])]
    track: Option<PathBuf>,
    /// The camera of the pictures (camera.json); clips need it in all formats except sd, spring and rd, which include it.
    #[arg(long, value_name = "CAMERA.JSON")]
    camera: Option<PathBuf>,
    /// The scene and its ball (scene.json), for every clip.
    #[arg(long, value_name = "SCENE.JSON")]
    scene: Option<PathBuf>,
    /// Frames per second, for pictures, which have no times; for a video, it replaces the video's own times.
    #[arg(long, value_name = "F", required_if_eq("from", "coco"))]
    fps: Option<f64>,
    /// Folder of the pictures, or the video [default: what lies beside the annotations]; with --track, the video that provides the
    /// track's times.
    #[arg(long, value_name = "PATH")]
    pictures: Option<PathBuf>,
    /// Category (coco), class (yolo) or label (cvat, labelme, label-studio) of the ball, if there are several.
    #[arg(long, visible_alias = "class", value_name = "NAME")]
    category: Option<String>,
    /// Id of the ball's track (cvat), if several tracks have its label.
    #[arg(long, value_name = "ID")]
    object: Option<u64>,
    /// Cut into clips of this many frames [default: 16 for rd, otherwise uncut].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    clip_frames: Option<u32>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// What is missing, or means nothing, of how it was called.
fn misused(arguments: &Arguments) -> Option<(ErrorKind, String)> {
    let Arguments { from, camera, fps, pictures, category, object, track, .. } = arguments;
    let is_drawn = matches!(from, Format::Cvat | Format::Yolo | Format::Labelme | Format::LabelStudio);
    let brings_its_own = matches!(from, Format::Sd | Format::Spring | Format::Rd);
    let given = [
        ("--camera", camera.is_some(), brings_its_own),
        ("--fps", fps.is_some(), brings_its_own),
        ("--pictures", pictures.is_some(), brings_its_own),
        ("--category", category.is_some(), brings_its_own || *from == Format::Tracknet),
        ("--object", object.is_some(), *from != Format::Cvat),
        ("--track", track.is_some(), !is_drawn),
    ];
    let from = name(*from);
    if let Some((option, ..)) = given.into_iter().find(|(_, given, unused)| *given && *unused) {
        let why = if brings_its_own { ", which includes its own" } else { "" };
        return Some((ErrorKind::ArgumentConflict, format!("{option} cannot be used with --from {from}{why}")));
    }
    (camera.is_none() && track.is_none() && !brings_its_own).then(|| {
        let message = format!("--camera is missing: --from {from} does not include the camera");
        (ErrorKind::MissingRequiredArgument, message)
    })
}

pub fn run(arguments: Arguments) -> Result<()> {
    if let Some((kind, message)) = misused(&arguments) {
        clap::Error::raw(kind, message + "\n").exit();
    }
    let options = ImportOptions {
        camera: arguments.camera.as_deref().map(cameras::open).transpose()?,
        scene: arguments.scene.as_deref().map(Scene::open).transpose()?,
        fps: arguments.fps,
        clip_frames: arguments.clip_frames.map(|frames| frames as usize),
        category: arguments.category.clone(),
        object: arguments.object,
        pictures: arguments.pictures.clone(),
    };
    if let Some(path) = &arguments.track {
        let found = drawn_track(arguments.from, &arguments.source, &options)?;
        write_whole(path, found.track.to_csv()?.as_bytes())?;
        return print_track(path, &found, &arguments);
    }
    let out = arguments.out.as_deref().context("--out is missing")?;
    let mut progress = Progress::new();
    let mut observe = |done: usize, all: usize| progress.set(done as u64, all as u64, "clips");
    let report = import(arguments.from, &arguments.source, out, &options, &mut observe);
    progress.finish();
    match arguments.json {
        true => Ok(print_line(as_json(&arguments, &report?))?),
        false => print(out, &report?),
    }
}

fn print_track(path: &Path, found: &DrawnTrack, arguments: &Arguments) -> Result<()> {
    let DrawnTrack { track, label, objects, hidden, nowhere, interpolated } = found;
    let frames = track.points.len();
    let labels = track.points.iter().filter(|point| point.image().is_some()).count();
    let radii = track.points.iter().filter(|point| point.radius.is_some()).count();
    if arguments.json {
        return Ok(print_line(
            json!({"from": name(arguments.from), "track": path, "label": label, "objects": objects,
            "frames": frames, "labels": labels, "radii": radii, "hidden": hidden, "nowhere": nowhere,
            "interpolated": interpolated}),
        )?);
    }
    let ids = objects.iter().map(u64::to_string).collect::<Vec<_>>().join(", ");
    let of_tracks = if objects.is_empty() { String::new() } else { format!(", CVAT's track {ids}") };
    print_line(format_args!("track      {frames} frames of `{label}`{of_tracks}, in {}", path.display()))?;
    print_line(format_args!(
        "labels     {labels}, {radii} with a radius; ball outside or occluded in {hidden} frames"
    ))?;
    print_nowhere(*nowhere)?;
    if *interpolated > 0 {
        print_line(format_args!(
            "NOTE: {interpolated} labels are interpolated between key frames; CVAT interpolates linearly, but a ball's path is curved"
        ))?;
    }
    Ok(())
}

fn print_nowhere(frames: usize) -> Result<()> {
    match frames {
        0 => Ok(()),
        _ => Ok(print_line(format_args!("NOTE: {}", nowhere(frames)))?),
    }
}

fn name(from: Format) -> String {
    from.to_possible_value().map(|value| value.get_name().to_string()).unwrap_or_default()
}

fn as_json(arguments: &Arguments, report: &ImportReport) -> Value {
    let refused = report.refused.iter().map(
        |refused| json!({"clip": refused.clip, "code": refused.reason.code(), "reason": refused.reason.to_string()}),
    );
    json!({"from": name(arguments.from), "out": arguments.out, "clips": report.clips, "frames": report.frames,
        "labels": report.labels, "positions": report.positions, "scenes": report.scenes, "gaps": report.gaps, "nowhere": report.nowhere,
        "fps": Statistic::of(report.fps.iter().copied()),
        "reprojection_px": Statistic::of(report.reprojection_px.iter().copied()),
        "refused": refused.collect::<Vec<_>>()})
}

fn print(out: &Path, report: &ImportReport) -> Result<()> {
    let ImportReport { clips, frames, labels, positions, scenes, gaps, nowhere, .. } = report;
    print_line(format_args!("clips      {clips} in {}", out.display()))?;
    print_line(format_args!("frames     {frames}, {labels} with a 2D label, {positions} with a 3D position"))?;
    print_nowhere(*nowhere)?;
    let fps = |pick: fn(f64, f64) -> f64| report.fps.iter().copied().reduce(pick).unwrap_or_default();
    let (slowest, fastest) = (fps(f64::min), fps(f64::max));
    match fastest - slowest < 1e-3 {
        true => print_line(format_args!("frame rate {slowest:.3} per second; gaps: {gaps}"))?,
        false => print_line(format_args!("frame rate {slowest:.3} to {fastest:.3} per second; gaps: {gaps}"))?,
    }
    if let Statistic { mean: Some(mean), std: Some(std), n, .. } = Statistic::of(report.reprojection_px.iter().copied())
    {
        print_line(format_args!("2D label to projected 3D position: {mean:.3} ± {std:.3} px (mean of {n})"))?;
    }
    match scenes {
        0 => print_line("scene      none; training with physics needs --scene")?,
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
