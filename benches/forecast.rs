//! Time of a forecast with its Jacobian, one thread, and its ratio to torchdiffeq and diffrax on the same starts.
//!
//! `benches/forecast` prepares the peers and runs this; without them (`cargo bench --bench all -- forecast`) only our
//! own times are printed.

use std::ffi::OsStr;
use std::hint::black_box;
use std::io::Write as _;
use std::process::{Command, Stdio};
use std::time::Instant;

use gravisight::internal::median;
use gravisight::{Contact, ForecastOptions, Forecaster, Integrator, Scene, State};
use nalgebra::{Point3, Vector3};
use serde_json::{Value, json};

const RTOL: f64 = 1e-6;
const FRAMES: u32 = 15;
const STARTS: usize = 24;

/// Rounds of which the median is taken.
fn rounds() -> usize {
    if crate::common::is_check() { 1 } else { 200 }
}

/// Starts from the simulator's clips in scene 1, spread over their frames.
fn starts() -> (Scene, Vec<State>) {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden/tracks.json");
    let tracks: Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    let in_scene_1 = tracks.as_array().unwrap().iter().filter(|track| track["id"].as_str().unwrap().contains("env1"));
    let vector = |value: &Value| Vector3::from_iterator(value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()));
    let first = tracks[0]["scene"].clone();
    let states = in_scene_1.flat_map(|track| {
        [7, 31, 55].map(|frame| State {
            position: Point3::from(vector(&track["world"][frame])),
            velocity: vector(&track["velocity"][frame]),
            spin: Vector3::zeros(),
        })
    });
    (Scene::from_json(&first.to_string(), "scene").unwrap(), states.take(STARTS).collect())
}

/// Median seconds of one forecast, Jacobian included if `jacobian`.
fn seconds(forecaster: &Forecaster, starts: &[State], times: &[f64], jacobian: bool) -> f64 {
    let round = || {
        let begin = Instant::now();
        for start in starts {
            match jacobian {
                true => black_box(forecaster.forecast_with_jacobians(black_box(start), times)),
                false => black_box(forecaster.forecast(black_box(start), times)),
            };
        }
        begin.elapsed().as_secs_f64() / starts.len() as f64
    };
    median((0..rounds()).map(|_| round())).unwrap()
}

pub fn run(_arguments: &[String]) {
    let (scene, starts) = starts();
    let times: Vec<f64> = (1..=FRAMES).map(|frame| f64::from(frame) / 15.0).collect();
    let paper = Contact::Penalty { c: 1000.0, beta: 50.0, beta_box: 50.0 };
    let models = [
        ("penalty", paper.clone(), 0.0, 100.0),
        ("spring", Contact::Spring { stiffness: 1000.0 }, 0.0, 100.0),
        ("spring, drag", Contact::Spring { stiffness: 1000.0 }, 0.4, 100.0),
        ("bounce", Contact::bounce(0.8, 0.2), 0.0, 10.0),
        ("bounce, drag", Contact::bounce(0.8, 0.2), 0.4, f64::INFINITY),
    ];
    let integrator = Integrator::DormandPrince { rtol: RTOL, atol: RTOL };
    let options = ForecastOptions { integrator, ..ForecastOptions::default() };
    println!(
        "one forecast to {FRAMES} frames at 15 fps, one thread, rtol {RTOL:e}: median of {} rounds over {STARTS} starts",
        rounds()
    );
    println!("{:14} {:>12} {:>15} {:>12}", "model", "states µs", "+ Jacobians µs", "at most µs");
    for (name, contact, drag, limit) in models {
        let mut scene = scene.clone();
        (scene.contact, scene.ball.drag_coefficient) = (contact, drag);
        let forecaster = Forecaster::new(&scene).unwrap().with_options(options).unwrap();
        let [plain, full] = [false, true].map(|jacobian| 1e6 * seconds(&forecaster, &starts, &times, jacobian));
        let limit = if limit.is_finite() { format!("{limit:.0}") } else { "-".into() };
        println!("{name:14} {plain:12.1} {full:15.1} {limit:>12}");
    }
    let mut penalty = scene;
    penalty.contact = paper;
    let forecaster = Forecaster::new(&penalty).unwrap().with_options(options).unwrap();
    if crate::common::is_check() {
        return check_peers(&forecaster, &starts, &times);
    }
    if let Some(python) = std::env::var_os("GRAVISIGHT_PEERS") {
        for threads in [1, 0] {
            against_peers(&python, &forecaster, &starts, &times, threads);
        }
    }
}

/// The table of ratios; `threads` 1, or 0 for all cores.
fn against_peers(python: &OsStr, forecaster: &Forecaster, starts: &[State], times: &[f64], threads: u8) {
    let peers = ask_peers(python, &job(forecaster, starts, times, threads));
    let batch = || {
        let begin = Instant::now();
        black_box(forecaster.forecast_batch(black_box(starts), times));
        begin.elapsed().as_secs_f64()
    };
    let ours = match threads {
        1 => seconds(forecaster, starts, times, true) * starts.len() as f64,
        _ => median((0..rounds()).map(|_| batch())).unwrap(),
    };
    let cores = if threads == 1 { "one thread" } else { "all cores" };
    println!("\npenalty, {STARTS} starts, {cores}; ours: states and all Jacobians in {:.3} ms", 1e3 * ours);
    println!(
        "{:12} {:>18} {:>22} {:>22} {:>14}",
        "peer", "states", "+ one backward pass", "+ all Jacobians", "differs by mm"
    );
    for (name, peer) in peers.as_object().unwrap() {
        let time = |job: &str| match peer[job].as_f64() {
            Some(seconds) => format!("{:.1} ms, {:.0}×", 1e3 * seconds, seconds / ours),
            None => "-".into(),
        };
        let end = |index: usize| {
            let r = forecaster.forecast(&starts[index], times).states[FRAMES as usize - 1].position;
            (0..3).map(|axis| (r[axis] - peer["end"][index][axis].as_f64().unwrap()).powi(2)).sum::<f64>().sqrt()
        };
        let off = 1e3 * median((0..starts.len()).map(end)).unwrap();
        println!("{name:12} {:>18} {:>22} {:>22} {off:14.5}", time("forward"), time("gradient"), time("jacobian"));
    }
}

/// What the peers are to compute; `benches/peers/forecast.py` describes it.
fn job(forecaster: &Forecaster, starts: &[State], times: &[f64], threads: u8) -> Value {
    let states: Vec<Vec<f64>> =
        starts.iter().map(|s| s.position.iter().chain(s.velocity.iter()).copied().collect()).collect();
    json!({"scene": forecaster.scene(), "starts": states, "times": times, "rtol": RTOL, "atol": RTOL,
        "max_step": ForecastOptions::default().max_step, "rounds": 50, "threads": threads})
}

fn ask_peers(python: &OsStr, job: &Value) -> Value {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/peers/forecast.py");
    let mut peer = Command::new(python).arg(script).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    peer.stdin.take().unwrap().write_all(job.to_string().as_bytes()).unwrap();
    let output = peer.wait_with_output().unwrap();
    assert!(output.status.success(), "the peers failed");
    serde_json::from_slice(&output.stdout).unwrap()
}

/// The peers' equations of motion in plain Python, without the peers, are ours: they read the scene as we write it.
fn check_peers(forecaster: &Forecaster, starts: &[State], times: &[f64]) {
    let mut job = job(forecaster, starts, times, 1);
    job["check"] = json!(true);
    let accelerations = ask_peers(OsStr::new("python3"), &job);
    const STEP: f64 = 1e-4;
    for (start, theirs) in starts.iter().zip(accelerations.as_array().unwrap()) {
        let [before, after] = [-STEP, STEP].map(|time| forecaster.forecast(start, &[time]).states[0].velocity);
        for (axis, ours) in ((after - before) / (2.0 * STEP)).iter().enumerate() {
            let theirs = theirs[axis].as_f64().unwrap();
            assert!((ours - theirs).abs() < 1e-2 * (1.0 + theirs.abs()), "axis {axis}: {ours} and {theirs} m/s²");
        }
    }
    println!("the peers' accelerations at {} starts are ours", starts.len());
}
