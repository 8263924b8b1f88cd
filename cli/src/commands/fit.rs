//! `gravisight fit`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, bail, ensure};
use clap::Args;

use super::{nowhere, print_line};
use crate::cameras;
use crate::choice::{Choice, one_of};
use crate::report::{Flights, write_flights};
use gravisight::internal::{read_text, write_whole};
use gravisight::parts::Flight;
use gravisight::{Camera, Findings, Fit, FitOptions, Forecaster, Parameter, Scene, Track, WithFindings};

/// Exit status where some flight is not explained.
pub(super) const PARTLY: u8 = 3;
/// 1-σ of a position that counts as sure, m.
const SURE: f64 = 0.1;
/// In place of where something is that belongs to a flight that is not explained.
pub(super) const DOUBTFUL: &str = "(doubtful: its flight is not explained, so the position is unknown)";

/// Find the 3D trajectory whose projection best explains a 2D track.
///
/// Exit status: 0 if every flight is explained, 3 if some are not (the output is written anyway), 1 if there is no result.
#[derive(Args)]
pub struct Arguments {
    /// The 2D track (CSV with Frame,Visibility,X,Y and, optionally, Time in seconds).
    #[arg(long, value_name = "TRACK.CSV")]
    track: PathBuf,
    /// The camera that saw it (camera.json).
    #[arg(long, value_name = "CAMERA.JSON")]
    camera: PathBuf,
    /// Output of `calibrate --json` for this camera; its uncertainty is added to σ.
    #[arg(long, value_name = "CALIBRATION.JSON")]
    camera_sigma: Option<PathBuf>,
    /// The scene and its ball (scene.json).
    #[arg(long, value_name = "SCENE.JSON")]
    scene: PathBuf,
    /// Frames per second; neither needed nor used if the track has a column Time.
    #[arg(long, value_name = "F")]
    fps: Option<f64>,
    /// Use the ball of this sport instead of the scene's, and its bounce parameters if the scene has none.
    #[arg(long, value_parser = clap::builder::PossibleValuesParser::new(Scene::ball_names()))]
    ball: Option<String>,
    /// Maximum number of hits by a racket, foot or hand in the track.
    #[arg(long, value_name = "auto|N", default_value = "auto", value_parser = hits)]
    hits: Hits,
    /// Standard deviation of the labels, px [default: estimated from the track].
    #[arg(long, value_name = "S")]
    noise_px: Option<f64>,
    /// Estimate these freely. Drag and restitution are always estimated near the scene's values; named here, they may take almost any
    /// value.
    #[arg(long, value_delimiter = ',', value_parser = one_of(&PARAMETERS))]
    estimate: Vec<Parameter>,
    /// Configuration of the solver: an edited copy of `config` in the `--json` output.
    #[arg(long, value_name = "CONFIG.JSON")]
    config: Option<PathBuf>,
    /// Write the trajectory as CSV (position, velocity, 1-σ, residual by frame).
    #[arg(long, value_name = "TRAJECTORY.CSV")]
    out: Option<PathBuf>,
    /// Write a page with the trajectory, the track and its residuals, flights and contacts; one HTML file without external files.
    #[arg(long, value_name = "OUT.HTML")]
    plot: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// What `--estimate` takes.
const PARAMETERS: [Choice<Parameter>; 3] = [
    ("restitution", "The coefficient of restitution of the scene's bounces", Parameter::Restitution),
    ("drag", "The ball's drag coefficient", Parameter::Drag),
    ("spin", "The ball's spin at the start", Parameter::Spin),
];

/// How many hits there may be; as many as explain the track where none is said.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hits(Option<usize>);

impl Hits {
    /// Most that there may be, where it is said.
    pub fn most(self) -> Option<usize> {
        self.0
    }
}

pub(super) fn hits(text: &str) -> Result<Hits, String> {
    match text {
        "auto" => Ok(Hits(None)),
        number => number.parse().map(|most| Hits(Some(most))).map_err(|_| "must be `auto` or a number".into()),
    }
}

pub fn run(arguments: Arguments) -> Result<ExitCode> {
    ensure!(arguments.noise_px.is_none_or(|noise| noise.is_finite() && noise > 0.0), "--noise-px must be positive");
    let camera = cameras::open(&arguments.camera)?;
    let scene = Scene::open(&arguments.scene)?;
    let scene = match &arguments.ball {
        Some(name) => scene.with_ball(name)?,
        None => scene,
    };
    let forecaster = Forecaster::new(&scene)?;
    let name = || arguments.track.display().to_string();
    let track = Track::from_file(&arguments.track)?;
    let (frames, observations) = track.observations(arguments.fps).with_context(name)?;
    let own_times = track.points.iter().any(|point| point.time.is_some());
    if let Some(fps) = arguments.fps.filter(|_| own_times) {
        eprintln!("gravisight: note: {}: has a column Time, so --fps {fps} is ignored", arguments.track.display());
    }
    if track.nowhere > 0 {
        eprintln!("gravisight: note: {}: {}", arguments.track.display(), nowhere(track.nowhere));
    }
    let estimate = arguments.estimate.clone();
    if let Some((_, twice)) = estimate.iter().enumerate().find(|(index, one)| estimate[..*index].contains(one)) {
        bail!("--estimate names {} twice", twice.name());
    }
    let cameras = arguments.camera_sigma.as_deref().map(one_sigma).transpose()?.unwrap_or_default();
    let options = FitOptions {
        cameras,
        noise_px: arguments.noise_px,
        estimate,
        hits: arguments.hits.most(),
        config: arguments.config.as_deref().map(|path| config(path, "fit")).transpose()?,
        ..FitOptions::default()
    };
    let fit = forecaster.fit(&camera, &observations, &options).with_context(name)?.numbered(&frames);
    if let Some(out) = &arguments.out {
        write_whole(out, fit.to_csv()?.as_bytes())?;
    }
    let findings = Findings::of_fit(&fit, &camera, &scene);
    if let Some(plot) = &arguments.plot {
        let name = arguments.track.file_name().unwrap_or_default().to_string_lossy();
        let flights = Flights { camera: &camera, scene: &scene, observations: &observations, fit: &fit };
        write_flights(plot, &name, &findings, &[flights], [""; 2])?;
    }
    match arguments.json {
        true => print_line(serde_json::to_string(&WithFindings { result: &fit, findings })?)?,
        false => print(&fit, &camera, arguments.out.is_none())?,
    }
    if fit.explained {
        return Ok(ExitCode::SUCCESS);
    }
    let rate = if own_times { "the column Time" } else { "--fps" };
    eprintln!("gravisight: note: {}; check the scene, the camera and {rate}", fit.verdict);
    Ok(ExitCode::from(PARTLY))
}

/// The numbers of a file that a command judges by.
pub(super) fn config<T: serde::de::DeserializeOwned>(path: &Path, command: &str) -> Result<T> {
    let text = read_text(path)?;
    serde_json::from_str(&text).with_context(|| {
        format!("{}: does not have the form of `config` in the output of `gravisight {command} --json`", path.display())
    })
}

/// The cameras that are off by one standard deviation, of what `calibrate --json` prints.
pub(super) fn one_sigma(path: &Path) -> Result<Vec<Camera>> {
    #[derive(serde::Deserialize)]
    struct Calibrated {
        one_sigma: Vec<Camera>,
    }
    let text = read_text(path)?;
    let found: Calibrated = serde_json::from_str(&text)
        .with_context(|| format!("{}: is not the output of `gravisight calibrate --json`", path.display()))?;
    Ok(found.one_sigma)
}

fn print(fit: &Fit, camera: &Camera, table: bool) -> Result<()> {
    print_line(&fit.verdict)?;
    for note in &fit.notes {
        print_line(format_args!("note: {note}"))?;
    }
    for (index, flight) in fit.flights.iter().enumerate() {
        print_line(format_args!(
            "flight {}: {:.3} to {:.3} s, {}",
            index + 1,
            flight.start,
            flight.end,
            of_flight(flight)
        ))?;
    }
    for hit in &fit.hits {
        let [x, y, z] = hit.world.into();
        let place = match hit.explained {
            true => format!("x {x:.3}  y {y:.3}  z {z:.3} m"),
            false => DOUBTFUL.into(),
        };
        print_line(format_args!("hit before frame {}, t {:.3} s, {place}", hit.frame, hit.time))?;
    }
    if table {
        print_table(fit)?;
    }
    for impact in &fit.impacts {
        let [x, y, z] = impact.world.into();
        let place = match impact.explained {
            true => format!("x {x:.3}  y {y:.3}  z {z:.3} m, {:.2} m/s", impact.speed),
            false => DOUBTFUL.into(),
        };
        print_line(format_args!("touches {} at t {:.3} s, {place}", impact.surface, impact.time))?;
    }
    let doubtful = if fit.explained { "" } else { "  (doubtful: not every flight is explained)" };
    for (parameter, estimate) in &fit.estimates {
        let name = parameter.name();
        print_line(format_args!("{name} {:.3} ± {:.3}{doubtful}", estimate.value, estimate.sigma))?;
    }
    if fit.spin != [0.0; 3] && fit.frames.first().is_some_and(|first| first.explained) {
        let [x, y, z] = fit.spin;
        print_line(format_args!("spin at the first frame {x:.1} {y:.1} {z:.1} rad/s"))?;
    }
    for frame in &fit.frames {
        if let Some(reason) = &frame.refused {
            print_line(format_args!("frame {}: label left out: {reason}", frame.frame))?;
        }
    }
    let seen = fit.frames.iter().filter(|frame| frame.residual_px.is_some() || frame.refused.is_some()).count();
    let outliers = fit.frames.iter().filter(|frame| frame.outlier).count();
    print_line(format_args!("{} frames, ball labelled in {seen}, {outliers} outliers", fit.frames.len()))?;
    print_line(format_args!("labels: noise {:.2} px, residuals {:.2} px rms", fit.noise_px, fit.rms_px))?;
    let sigmas = fit.known_sigmas(camera);
    let sure = sigmas.iter().filter(|sigma| **sigma < SURE).count();
    match sigmas.get(sigmas.len() / 2) {
        None => print_line("positions: not known")?,
        Some(median) => print_line(format_args!(
            "positions: 1-σ {:.1} cm (median of the {} frames in which they are known), under {:.0} cm in {:.0} % of all frames",
            100.0 * median,
            sigmas.len(),
            100.0 * SURE,
            100.0 * sure as f64 / fit.frames.len() as f64
        ))?,
    }
    Ok(())
}

/// Speed and spin, where they are known.
fn of_flight(flight: &Flight) -> String {
    let turns = |spin: [f64; 3]| spin.iter().map(|w| w * w).sum::<f64>().sqrt() / std::f64::consts::TAU;
    match flight.known_speed() {
        _ if !flight.explained => "not explained: speed, spin and position are unknown".into(),
        None => "speed not known".into(),
        Some([speed, sigma]) => format!(
            "starts at {speed:.2} ± {sigma:.2} m/s, spin {:.0} ± {:.0} rev/s",
            turns(flight.spin),
            turns(flight.spin_sigma)
        ),
    }
}

/// Where the ball is in each frame.
fn print_table(fit: &Fit) -> Result<()> {
    print_line("frame        t s        x        y        z m   ± cm   residual px")?;
    for frame in &fit.frames {
        let r = frame.world;
        let residual = match (frame.residual_px, frame.outlier) {
            (None, false) => "not seen".into(),
            (None, true) => "outlier".into(),
            (Some(residual), false) => format!("{:.2}", residual.norm()),
            (Some(residual), true) => format!("{:.2} outlier", residual.norm()),
        };
        print_line(format_args!(
            "{:5} {:10.4} {:8.3} {:8.3} {:8.3} {:8.1}   {residual}{}",
            frame.frame,
            frame.time,
            r.x,
            r.y,
            r.z,
            100.0 * frame.sigma,
            if frame.explained { "" } else { "  doubtful" }
        ))?;
    }
    Ok(())
}
