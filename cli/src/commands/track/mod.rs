//! `gravisight track`.

mod say;

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use gravisight::internal::{TrackPoint, write_whole};
use gravisight::parts::{Flying, Followed, FollowedFrame, Measured};
use gravisight::{
    Camera, Fit, FitOptions, Follower, Forecaster, Localiser, Observation, Picture, Scene, Track, stretches,
};
use image::RgbImage;

use self::say::{as_json, cuts_in_words, print, verdict};
use super::fit::{Hits, PARTLY, hits, one_sigma};
use super::print_line;
use crate::device::DeviceChoice;
use crate::footage::Footage;
use crate::model;
use crate::overlay;
use crate::progress::Progress;
use crate::report::{Flights, write_flights};

/// Confidence of the network below which what it measures is not taken.
const SEEN: f64 = 0.3;
/// Length over width of a streak from which its width is no ball's radius.
const STREAK: f64 = 2.5;
/// Standard deviation of a place that the network did not see, px, and a share of its reach.
const PLACE_PX: f64 = 0.7;
const PLACE_OF_REACH: f64 = 0.08;
/// Share of the variance of a measured radius that frames have in common which are less than so many seconds apart.
const COMMON: f64 = 0.7;
const DOUBT_LASTS: f64 = 0.5;

/// Follow the ball through a video: its flights, bounces and hits in metres.
///
/// The camera must stand still. Without --camera and --scene only the 2D track comes out. Exit status: 0 where every flight is
/// explained, 3 where some are not (the output is written all the same), 1 where nothing can be said.
#[derive(Args)]
pub struct Arguments {
    /// A video (needs ffmpeg), a folder of frames, or frames in order.
    #[arg(required = true, value_name = "VIDEO|FRAMES")]
    input: Vec<PathBuf>,
    /// The camera that took it (camera.json).
    #[arg(long, value_name = "CAMERA.JSON", requires = "scene")]
    camera: Option<PathBuf>,
    /// What `calibrate --json` printed of that camera: its uncertainty enters σ.
    #[arg(long, value_name = "CALIBRATION.JSON", requires = "camera")]
    camera_sigma: Option<PathBuf>,
    /// The place and its ball: scene.json, or the name of a sport (`gravisight scene` lists them).
    #[arg(long, value_name = "SCENE.JSON|NAME", requires = "camera")]
    scene: Option<PathBuf>,
    /// The ball in place of the scene's: of a sport, or its radius in metres.
    #[arg(long, value_name = "NAME|M")]
    ball: Option<String>,
    /// Frames a second [default: the video's own times].
    #[arg(long, value_name = "F")]
    fps: Option<f64>,
    /// The ball as you see it, in one frame: its number from 0, and px. May be given several times.
    #[arg(long, value_name = "FRAME,X,Y", value_parser = seed)]
    seed_label: Vec<Seed>,
    /// Most hits of a racket, a foot or a hand between two pauses.
    #[arg(long, value_name = "auto|N", default_value = "auto", value_parser = hits)]
    hits: Hits,
    /// Model that measures the ball [default: the built-in `any`].
    #[arg(long, value_name = "M")]
    model: Option<PathBuf>,
    /// Device to run on.
    #[arg(long, value_enum, default_value = "auto")]
    device: DeviceChoice,
    /// Write the 2D track (CSV: Frame,Visibility,X,Y,Time,Radius,RadiusSigma,Sigma), which `fit` takes.
    #[arg(long, value_name = "TRACK.CSV")]
    out: Option<PathBuf>,
    /// Write the video with the ball marked.
    #[arg(long, value_name = "OUT.MP4")]
    overlay: Option<PathBuf>,
    /// Write a page with trajectories, speeds and contacts; it needs nothing else.
    #[arg(long, value_name = "OUT.HTML", requires = "camera")]
    report: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// A frame and a place in it, px.
#[derive(Debug, Clone, Copy)]
struct Seed(usize, [f64; 2]);

fn seed(text: &str) -> Result<Seed, String> {
    let wrong = || format!("`{text}` is not FRAME,X,Y, such as 12,640.5,360");
    let parts: Vec<&str> = text.split(',').map(str::trim).collect();
    let &[frame, x, y] = parts.as_slice() else { return Err(wrong()) };
    let number = |text: &str| text.parse::<f64>().ok().filter(|value| value.is_finite()).ok_or_else(wrong);
    Ok(Seed(frame.parse().map_err(|_| wrong())?, [number(x)?, number(y)?]))
}

/// The ball in a frame, of the picture.
#[derive(Debug, Clone, Copy)]
struct Sight {
    point: TrackPoint,
    confidence: f64,
}

/// What was fitted of a stretch of frames.
struct Part {
    frames: Range<usize>,
    observations: Vec<Observation>,
    /// Why nothing could be said of it, in words.
    fit: Result<Fit, String>,
}

pub fn run(arguments: Arguments) -> Result<ExitCode> {
    let place = place(&arguments)?;
    let localiser = model::open(arguments.model.as_deref(), Some(1.0), &arguments.device.open()?)?;
    let footage = Footage::open(&arguments.input, arguments.fps)?;
    if let (Some(place), Some(size)) = (&place, footage.size()) {
        place.camera.for_picture(size)?;
    }
    let name = || footage.name();
    let mut progress = Progress::new();
    let flying = flying(&footage, &arguments, &mut progress).with_context(name)?;
    let cuts = flying.cuts().to_vec();
    let (frames, sights) = measured(&footage, flying, &localiser, &mut progress).with_context(name)?;
    progress.finish();
    let track = Track { points: sights.iter().map(|sight| sight.point).collect() };
    if let Some(out) = &arguments.out {
        write_whole(out, track.to_csv()?.as_bytes())?;
    }
    let parts = match &place {
        Some(place) => {
            // Of a rate that was raised, a video's own times are no longer those of the frames.
            let known = footage.times_known() && !frames.iter().any(|frame| frame.repeated);
            place.fitted(&track, &footage, known, &arguments)?
        }
        None => vec![],
    };
    if let Some(out) = &arguments.overlay {
        let seen: Vec<Option<[f64; 3]>> = sights.iter().map(Sight::circle).collect();
        overlay::write(out, &footage, &seen)?;
    }
    if let (Some(out), Some(place)) = (&arguments.report, &place) {
        report(out, &footage, place, &parts)?;
    }
    let found = sights.iter().filter(|sight| sight.point.visibility > 0).count();
    let mut verdict = verdict(found, &frames, &parts, place.is_some());
    verdict += &cuts_in_words(&cuts, place.is_some());
    match arguments.json {
        true => print_line(as_json(&sights, &parts, &verdict))?,
        false => print(&verdict, &parts)?,
    }
    let explained = |part: &Part| part.fit.as_ref().is_ok_and(|fit| fit.explained);
    Ok(match () {
        () if found == 0 || (place.is_some() && parts.iter().all(|part| part.fit.is_err())) => ExitCode::FAILURE,
        () if parts.iter().all(explained) => ExitCode::SUCCESS,
        () => ExitCode::from(PARTLY),
    })
}

/// What is known of the place.
struct Place {
    camera: Camera,
    cameras: Vec<Camera>,
    forecaster: Forecaster,
}

fn place(arguments: &Arguments) -> Result<Option<Place>> {
    let (Some(camera), Some(scene)) = (&arguments.camera, &arguments.scene) else {
        ensure!(arguments.ball.is_none(), "--ball is for metres: give --camera and --scene");
        return Ok(None);
    };
    let mut scene = Scene::open(scene)?;
    if let Some(ball) = &arguments.ball {
        match ball.parse::<f64>() {
            Ok(radius) => {
                scene.ball.radius = radius;
                scene.check("--ball")?;
                ensure!(radius < 1.0, "--ball is a radius in metres, {radius} is too large: {} mm?", radius);
            }
            Err(_) => scene = scene.with_ball(ball)?,
        }
    }
    let cameras = arguments.camera_sigma.as_deref().map(one_sigma).transpose()?.unwrap_or_default();
    Ok(Some(Place { camera: Camera::from_file(camera)?, cameras, forecaster: Forecaster::new(&scene)? }))
}

/// What flies: once through the footage.
fn flying(footage: &Footage, arguments: &Arguments, progress: &mut Progress) -> Result<Flying> {
    let mut follower = Follower::new();
    let all = footage.times().len();
    footage.each(0..all, &mut |frame: usize, rgb: RgbImage| {
        follower.watch(&rgb, footage.times()[frame])?;
        progress.set(frame as u64 + 1, all as u64, "frames watched");
        Ok(())
    })?;
    let seeds: Vec<(usize, [f64; 2])> = arguments.seed_label.iter().map(|Seed(frame, at)| (*frame, *at)).collect();
    Ok(follower.finish(&seeds)?)
}

/// Measures what flies, once more through the footage, and says which of it is the ball.
fn measured(
    footage: &Footage,
    mut flying: Flying,
    localiser: &Localiser,
    progress: &mut Progress,
) -> Result<(Vec<FollowedFrame>, Vec<Sight>)> {
    let all = footage.times().len();
    let in_frames: Vec<Vec<Followed>> = (0..all).map(|frame| flying.in_frame(frame)).collect();
    let first = in_frames.iter().position(|flying| !flying.is_empty()).unwrap_or(all);
    let last = in_frames.iter().rposition(|flying| !flying.is_empty()).unwrap_or(0);
    let mut measured: BTreeMap<(usize, usize), Measured> = BTreeMap::new();
    progress.restart();
    footage.each(first..(last + 1).max(first), &mut |number: usize, rgb: RgbImage| {
        let picture = Picture::from_rgb(rgb);
        for it in &in_frames[number] {
            let found = pollster::block_on(localiser.measure(&picture, it.image, it.radius_px, it.reach_px))?;
            let found = found.filter(|found| found.confidence >= SEEN);
            flying.tell(number, it, found.is_some());
            found.map(|found| measured.insert((number, it.arc), found));
        }
        progress.set((number + 1 - first) as u64, (last + 1 - first) as u64, "frames measured");
        Ok(())
    })?;
    let frames = flying.frames();
    let sight = |(number, frame): (usize, &FollowedFrame)| {
        let found = frame.ball.and_then(|ball| measured.get(&(number, ball.arc)));
        Sight::of(number, frame, found)
    };
    let mut sights: Vec<Sight> = frames.iter().enumerate().map(sight).collect();
    share_doubt(&mut sights);
    Ok((frames, sights))
}

/// Makes the radii of neighbouring frames as unsure together as one of them is: what a network reads wrong in one, it reads
/// wrong in the next.
fn share_doubt(sights: &mut [Sight]) {
    let sized: Vec<f64> =
        sights.iter().filter(|sight| sight.point.radius.is_some()).filter_map(|sight| sight.point.time).collect();
    for Sight { point, .. } in sights {
        let (Some(sigma), Some(time)) = (&mut point.radius_sigma, point.time) else { continue };
        let near = sized.partition_point(|&other| other < time + DOUBT_LASTS)
            - sized.partition_point(|&other| other < time - DOUBT_LASTS);
        *sigma *= (1.0 - COMMON + COMMON * near.max(1) as f64).sqrt();
    }
}

impl Sight {
    fn of(number: usize, frame: &FollowedFrame, found: Option<&Measured>) -> Self {
        let nothing = TrackPoint { frame: number as u64, time: Some(frame.time), ..TrackPoint::default() };
        let Some(ball) = frame.ball else { return Self { point: nothing, confidence: 0.0 } };
        let at = |[x, y]: [f64; 2], sigma| TrackPoint {
            visibility: 1,
            x: Some(x),
            y: Some(y),
            sigma: Some(sigma),
            ..nothing
        };
        let point = match found {
            None => at(ball.image, PLACE_PX + PLACE_OF_REACH * ball.reach_px),
            Some(found) => {
                let sized = ball.reach_px < STREAK * ball.radius_px;
                let [radius, radius_sigma] = [found.radius_px, found.radius_sigma_px].map(|it| sized.then_some(it));
                TrackPoint { radius, radius_sigma, ..at(found.image, found.sigma_px) }
            }
        };
        Self { point, confidence: frame.confidence }
    }

    /// Centre and radius, px; a small one where the radius is not known.
    fn circle(&self) -> Option<[f64; 3]> {
        let at = self.point.image()?;
        Some([at.x, at.y, self.point.radius.unwrap_or(4.0)])
    }
}

impl Place {
    /// The flights, stretch by stretch.
    fn fitted(&self, track: &Track, footage: &Footage, times_known: bool, arguments: &Arguments) -> Result<Vec<Part>> {
        let camera = match footage.size() {
            Some(size) => self.camera.for_picture(size)?,
            None => self.camera.clone(),
        };
        let options = FitOptions {
            cameras: self.cameras.clone(),
            hits: arguments.hits.most(),
            times_known,
            ..FitOptions::default()
        };
        let (_, observations) = track.observations(None)?;
        let part = |frames: Range<usize>| {
            let observations = observations[frames.clone()].to_vec();
            let fit = self.forecaster.fit(&camera, &observations, &options).map_err(|error| error.to_string());
            Part { frames, observations, fit }
        };
        Ok(stretches(&observations).into_iter().map(part).collect())
    }
}

fn report(out: &Path, footage: &Footage, place: &Place, parts: &[Part]) -> Result<()> {
    let name = footage.name();
    let flights: Vec<Flights<'_>> = parts
        .iter()
        .filter_map(|part| {
            let fit = part.fit.as_ref().ok()?;
            Some(Flights {
                name: &name,
                camera: &place.camera,
                scene: place.forecaster.scene(),
                observations: &part.observations,
                fit,
            })
        })
        .collect();
    if flights.is_empty() {
        bail!("--report: no flight could be fitted, so there is nothing to show");
    }
    Ok(write_flights(out, &flights)?)
}
