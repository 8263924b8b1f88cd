//! `gravisight track`.

mod say;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use clap::Args;
use gravisight::camera::{KnownOfCamera, assumed_camera};
use gravisight::internal::{TrackPoint, write_whole};
use gravisight::{Camera, Findings, FitOptions, Forecaster, Picture, Scene, TrackedVideo, VideoTracker, WithFindings};

use self::say::print;
use super::fit::{Hits, PARTLY, config, hits, one_sigma};
use super::print_line;
use crate::ball::with_ball;
use crate::cameras;
use crate::court;
use crate::device::DeviceChoice;
use crate::footage::Footage;
use crate::model;
use crate::overlay;
use crate::progress::Progress;
use crate::report::{Flights, doubts, track2d, write_flights};

/// Follow the ball through a video: its flights, bounces and hits in metres.
///
/// The camera must stay in one place; it may turn and zoom. Without --camera, the camera is computed from the court's lines in the first
/// frames. Without --scene, the result is only the 2D track. Exit status: 0
/// if every flight is explained, 3 if some are not (the output is written anyway), 1 if there is no result.
#[derive(Args)]
pub struct Arguments {
    /// A video (needs ffmpeg), a folder of frames, or frames in order.
    #[arg(required = true, value_name = "VIDEO|FRAMES")]
    input: Vec<PathBuf>,
    #[command(flatten)]
    place: PlaceArguments,
    /// Frames per second [default: the video's own times].
    #[arg(long, value_name = "F")]
    fps: Option<f64>,
    /// Position of the ball in one frame: the frame's number, from 0, and px. Can be repeated; for two in the same frame, the last is used.
    #[arg(long, value_name = "FRAME,X,Y", value_parser = seed)]
    seed_label: Vec<SeedArgument>,
    /// Maximum number of hits by a racket, foot or hand between two pauses.
    #[arg(long, value_name = "auto|N", default_value = "auto", value_parser = hits)]
    hits: Hits,
    /// Configuration of the tracker: an edited copy of `config` in the `--json` output, or only what differs.
    #[arg(long, value_name = "CONFIG.JSON")]
    config: Option<PathBuf>,
    /// Model that detects the ball [default: the built-in `any`].
    #[arg(long, value_name = "M")]
    model: Option<PathBuf>,
    /// Device to run on.
    #[arg(long, value_enum, default_value = "auto")]
    device: DeviceChoice,
    /// Write the 2D track (CSV: Frame,Visibility,X,Y,Time,Radius,RadiusSigma,Sigma), which `fit` takes.
    #[arg(long, value_name = "TRACK.CSV")]
    out: Option<PathBuf>,
    /// Write the camera of each frame: a JSON list of cameras (as camera.json), `null` where it is not known.
    #[arg(long, value_name = "CAMERAS.JSON", requires = "scene")]
    cameras: Option<PathBuf>,
    /// Write the video with the ball marked.
    #[arg(long, value_name = "OUT.MP4")]
    overlay: Option<PathBuf>,
    /// Write a page with the verdict, the track and doubtful frames, with --scene also flights and contacts; one HTML file without
    /// external files.
    #[arg(long, value_name = "OUT.HTML")]
    report: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// Where a video was filmed: options that `adapt` shares.
#[derive(Args)]
pub(super) struct PlaceArguments {
    /// The camera that took it (camera.json) [default: found by the lines of the court].
    #[arg(long, value_name = "CAMERA.JSON", requires = "scene")]
    pub(super) camera: Option<PathBuf>,
    /// Assume a phone's main camera, held level 1.5 m above the ground, of this 35 mm equivalent; σ includes the assumptions [default: 26].
    #[arg(long, value_name = "MM", num_args = 0..=1, require_equals = true, conflicts_with_all = ["camera", "court"], requires = "scene")]
    pub(super) assume_phone: Option<Option<f64>>,
    /// Output of `calibrate --json` for this camera; its uncertainty is added to σ.
    #[arg(long, value_name = "CALIBRATION.JSON", requires = "camera")]
    pub(super) camera_sigma: Option<PathBuf>,
    /// The scene and its ball: scene.json, or the name of a sport (`gravisight scene` lists them).
    #[arg(long, value_name = "SCENE.JSON|NAME")]
    pub(super) scene: Option<PathBuf>,
    /// The court in the video; its painted lines give the camera's position and movement [default: the court of the sport in --scene, if its lines
    /// are known]; `auto` tries all courts whose lines are known.
    #[arg(long, value_name = "COURT", requires = "scene")]
    pub(super) court: Option<String>,
    /// Ball to use instead of the scene's: the name of a sport, or a radius in metres.
    #[arg(long, value_name = "NAME|M")]
    pub(super) ball: Option<String>,
}

/// What a report without metres says of them.
const FLAT: &str = "In pixels only. For metres, speeds and bounces, give the scene: --scene NAME. If the video shows no court whose lines are \
                    known, also give --camera camera.json (from `gravisight calibrate`).";

/// A frame and a place in it, px.
#[derive(Debug, Clone, Copy)]
pub(super) struct SeedArgument(pub(super) usize, pub(super) [f64; 2]);

pub(super) fn seed(text: &str) -> Result<SeedArgument, String> {
    let wrong = || format!("`{text}` is not FRAME,X,Y, such as 12,640.5,360");
    let parts: Vec<&str> = text.split(',').map(str::trim).collect();
    let &[frame, x, y] = parts.as_slice() else { return Err(wrong()) };
    let number = |text: &str| text.parse::<f64>().ok().filter(|value| value.is_finite()).ok_or_else(wrong);
    Ok(SeedArgument(frame.parse().map_err(|_| wrong())?, [number(x)?, number(y)?]))
}

pub fn run(arguments: Arguments) -> Result<ExitCode> {
    let scene = scene(&arguments.place)?;
    let localiser = model::open(arguments.model.as_deref(), &arguments.device.open()?)?;
    let footage = Footage::open(&arguments.input, arguments.fps)?;
    let name = || footage.name();
    let place = scene.map(|scene| place(&arguments.place, &scene, &footage)).transpose().with_context(name)?;
    let mut progress = Progress::new();
    let camera = place.as_ref().map(|place| place.camera.clone());
    let mut tracker = VideoTracker::new(Arc::new(localiser), camera);
    if let Some(court) = place.as_ref().and_then(|place| place.court.as_deref()) {
        tracker = tracker.with_court(court)?;
    }
    if let Some(path) = &arguments.config {
        tracker = tracker.with_config(config(path, "track")?)?;
    }
    let tracker = watched(&footage, tracker, &mut progress).with_context(name)?;
    let mut seeds = BTreeMap::new();
    for SeedArgument(frame, at) in &arguments.seed_label {
        if let Some([x, y]) = seeds.insert(*frame, *at) {
            eprintln!("gravisight: note: --seed-label {frame},{x},{y} is replaced by the later one in the same frame");
        }
    }
    let seeds: Vec<(usize, [f64; 2])> = seeds.into_iter().collect();
    let known = place.as_ref().map(|place| (&place.camera, place.forecaster.scene()));
    let mut tracked = tracker.track(&seeds, known)?;
    if let Some(out) = &arguments.out {
        write_whole(out, tracked.track().to_csv()?.as_bytes())?;
    }
    if let (Some(out), Some(place)) = (&arguments.cameras, &place) {
        write_whole(out, serde_json::to_string(&tracked.cameras(&place.camera))?.as_bytes())?;
    }
    if let Some(place) = &place {
        let options = FitOptions {
            cameras: place.cameras.clone(),
            camera_assumed: arguments.place.assume_phone.is_some(),
            hits: arguments.hits.most(),
            times_known: footage.times_known(),
            ..FitOptions::default()
        };
        progress.restart();
        tracked.fit(&place.forecaster, &place.camera, &options, |done, all| {
            progress.set(done as u64, all as u64, "segments fitted");
        })?;
    }
    progress.finish();
    let findings = Findings::of_video(&tracked, place.as_ref().map(|place| (&place.camera, place.forecaster.scene())));
    // First of all: what is to be drawn may fail, and this is not to be lost with it.
    match arguments.json {
        true => print_line(serde_json::to_string(&WithFindings { result: &tracked, findings: findings.clone() })?)?,
        false => print(&tracked, place.as_ref().map(|place| &place.camera))?,
    }
    if let Some(out) = &arguments.overlay {
        let seen: Vec<Option<[f64; 3]>> = tracked.frames.iter().map(|frame| circle(&frame.followed.point)).collect();
        overlay::write(out, &footage, &seen)?;
    }
    if let Some(out) = &arguments.report {
        report(out, &footage, place.as_ref(), &tracked, findings)?;
    }
    let nothing = place.is_some() && tracked.segments.iter().all(|segment| segment.fit.is_err());
    Ok(match () {
        () if tracked.found() == 0 || nothing => ExitCode::FAILURE,
        () if tracked.explained != Some(false) => ExitCode::SUCCESS,
        () => ExitCode::from(PARTLY),
    })
}

/// Centre and radius of a ball, px; a small one where the radius is not known.
fn circle(point: &TrackPoint) -> Option<[f64; 3]> {
    let at = point.image()?;
    Some([at.x, at.y, point.radius.unwrap_or(4.0)])
}

/// What is known of the place.
pub(super) struct SceneOfTrack {
    pub(super) camera: Camera,
    pub(super) cameras: Vec<Camera>,
    pub(super) forecaster: Forecaster,
    /// The court whose lines are known.
    pub(super) court: Option<String>,
}

pub(super) fn scene(arguments: &PlaceArguments) -> Result<Option<Scene>> {
    let Some(scene) = &arguments.scene else {
        ensure!(arguments.ball.is_none(), "--ball needs --scene");
        return Ok(None);
    };
    let scene = Scene::open(scene)?;
    Ok(Some(match &arguments.ball {
        Some(ball) => with_ball(scene, ball)?,
        None => scene,
    }))
}

pub(super) fn place(arguments: &PlaceArguments, scene: &Scene, footage: &Footage) -> Result<SceneOfTrack> {
    let forecaster = Forecaster::new(scene)?;
    let court = match &arguments.court {
        Some(court) => Some(court.clone()),
        None => arguments.scene.as_deref().and_then(court::of_scene),
    };
    if let Some(camera) = &arguments.camera {
        let camera = cameras::open(camera)?;
        let camera = footage.size().map_or(Ok(camera.clone()), |size| camera.for_picture(size))?;
        let cameras = arguments.camera_sigma.as_deref().map(one_sigma).transpose()?.unwrap_or_default();
        return Ok(SceneOfTrack { camera, cameras, forecaster, court });
    }
    if let Some(focal_35mm) = arguments.assume_phone {
        let size = footage.size().context("has no size: give --camera")?;
        let assumed = assumed_camera(size, &KnownOfCamera { focal_35mm, video: true, ..KnownOfCamera::default() })?;
        eprintln!("gravisight: {}", assumed.note);
        return Ok(SceneOfTrack { camera: assumed.camera, cameras: assumed.one_sigma, forecaster, court: None });
    }
    let court = court.context("--scene needs --camera, or --court with the name of the court that the video shows")?;
    let (found, calibration) = court::camera(footage, &court)?;
    eprintln!("gravisight: camera found: {}, probability {:.0} %", found.reason, 100.0 * found.probability);
    calibration.doubts.iter().for_each(|doubt| eprintln!("gravisight: DOUBTFUL: {doubt}"));
    let court = if court == court::AUTO { found.court } else { court };
    Ok(SceneOfTrack { camera: calibration.camera, cameras: calibration.one_sigma, forecaster, court: Some(court) })
}

/// Once through the footage.
pub(super) fn watched(footage: &Footage, mut tracker: VideoTracker, progress: &mut Progress) -> Result<VideoTracker> {
    let all = footage.times().len();
    footage.each(0..all, &mut |frame: usize, picture: Picture| {
        pollster::block_on(tracker.add(picture, footage.times()[frame]))?;
        progress.set(frame as u64 + 1, all as u64, "frames");
        Ok(())
    })?;
    pollster::block_on(tracker.end())?;
    Ok(tracker)
}

fn report(
    out: &Path,
    footage: &Footage,
    place: Option<&SceneOfTrack>,
    tracked: &TrackedVideo,
    mut findings: Findings,
) -> Result<()> {
    if place.is_none() {
        findings.notes.insert(0, FLAT.into());
    }
    let fitted = tracked.segments.iter().filter_map(|segment| Some((segment, segment.fit.as_ref().ok()?, place?)));
    let flights: Vec<Flights<'_>> = fitted
        .map(|(segment, fit, place)| Flights {
            camera: &place.camera,
            scene: place.forecaster.scene(),
            observations: &segment.observations,
            fit,
        })
        .collect();
    let doubts = doubts::doubts(tracked);
    let mut looks = BTreeMap::new();
    footage.each(doubts::frames(&doubts), &mut |frame, picture: Picture| {
        if let Some(doubt) = doubts.iter().find(|doubt| doubt.frame == frame) {
            looks.insert(frame, doubts::look(doubt, picture.rgb())?);
        }
        Ok(())
    })?;
    let in_the_picture = footage.size().map(|size| track2d::chapter(tracked, size)).transpose()?.unwrap_or_default();
    let doubtful = doubts::chapter(&doubts, &looks);
    // The doubtful frames are what there is to do; without a flight nothing else follows.
    Ok(write_flights(out, &footage.name(), &findings, &flights, [&(in_the_picture + &doubtful), ""])?)
}
