//! `fit` on recordings with 3D truth: `cargo bench --bench all -- real FOLDER FPS [even|odd|spoilt|constants]`. The folder holds `camera.json`,
//! `scene.json`, and of each shot `NNN.csv` (Frame,Visibility,X,Y) and `NNN.truth.csv` (Frame,x,y,z). `spoilt`: every sixth shot from the
//! second on, with what people get wrong. `constants`: which numbers of the estimator make the tracks of every sixth shot most probable (their
//! truth is not read).

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use gravisight::parts::EstimatorConfig;
use gravisight::{Camera, Fit, FitOptions, Forecaster, Observation, Scene, Track};
use nalgebra::{Point2, Point3, distance};
use rayon::prelude::*;

/// Error from which a position with a smaller 2σ is confident and wrong, m.
const WRONG: f64 = 1.0;
/// Median error of a shot that must not call itself explained, m.
const BAD: f64 = 0.3;
/// Edges of the histogram of error over σ.
const EDGES: [f64; 7] = [0.5, 1.0, 1.5, 2.0, 3.0, 4.0, f64::INFINITY];

struct Shot {
    name: String,
    fit: Fit,
    /// Error and σ of each frame with truth, m.
    errors: Vec<[f64; 2]>,
    /// Error at each bounce, m.
    bounces: Vec<f64>,
    seconds: f64,
}

impl Shot {
    fn median(&self) -> f64 {
        quantile(self.errors.iter().map(|error| error[0]), 0.5)
    }

    fn is_confident_and_wrong(&self) -> bool {
        self.errors.iter().any(|[error, sigma]| *error > WRONG && 2.0 * sigma < *error)
    }
}

fn quantile(values: impl Iterator<Item = f64>, share: f64) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    let index = (share * values.len() as f64) as usize;
    values.get(index.min(values.len().saturating_sub(1))).copied().unwrap_or(f64::NAN)
}

/// Factors by which each number is tried.
const FACTORS: [f64; 4] = [0.5, 0.71, 1.41, 2.0];

/// Prints how much more probable (2 ln of the evidence) the tracks are with each of the estimator's numbers smaller or larger: what maximises
/// it is the number that they ask for (empirical Bayes).
fn constants(folder: &Path, fps: f64, names: &[String], camera: &Camera, forecaster: &Forecaster) {
    let tracks: Vec<Vec<Observation>> = names
        .iter()
        .map(|name| Track::from_file(&folder.join(format!("{name}.csv"))).unwrap().observations(Some(fps)).unwrap().1)
        .collect();
    let evidence = |config: EstimatorConfig| -> f64 {
        let options = FitOptions { config: Some(config), ..FitOptions::default() };
        let fit = |track: &Vec<Observation>| forecaster.fit(camera, track, &options);
        tracks.par_iter().filter_map(|track| fit(track).ok()).map(|fit| 2.0 * fit.summary.log_evidence).sum()
    };
    let config = EstimatorConfig::of(forecaster.scene(), camera.size());
    let serde_json::Value::Object(fields) = serde_json::to_value(config).unwrap() else { unreachable!() };
    let as_it_is = evidence(config);
    println!("{} tracks; 2 ln of the evidence, over {as_it_is:.1}, with each number times", tracks.len());
    println!("{:<18} {:>10} {}", "", "value", FACTORS.map(|factor| format!("{factor:>9}")).join(""));
    for (name, value) in fields.iter().filter_map(|(name, value)| Some((name, value.as_f64()?))) {
        let changed = |factor: f64| {
            let mut fields = fields.clone();
            fields[name] = (factor * value).into();
            evidence(serde_json::from_value(fields.into()).unwrap()) - as_it_is
        };
        let gains = FACTORS.map(|factor| format!("{:>9.1}", changed(factor)));
        println!("{name:<18} {value:>10.4} {}", gains.join(""));
    }
}

fn truth_of(path: &Path) -> BTreeMap<u64, Point3<f64>> {
    let text = std::fs::read_to_string(path).unwrap();
    let line = |line: &str| {
        let numbers: Vec<f64> = line.split(',').map(|field| field.trim().parse().unwrap()).collect();
        (numbers[0] as u64, Point3::new(numbers[1], numbers[2], numbers[3]))
    };
    text.lines().skip(1).map(line).collect()
}

pub fn run(arguments: &[String]) {
    let mut arguments = arguments.to_vec();
    if crate::common::is_check() {
        let (folder, fps) = simulated();
        arguments = vec![folder.to_string_lossy().into(), fps.to_string()];
    }
    let [folder, fps, rest @ ..] = arguments.as_slice() else {
        return println!("usage: cargo bench --bench all -- real FOLDER FPS [even|odd|spoilt|constants]");
    };
    let (folder, fps): (&Path, f64) = (Path::new(folder), fps.parse().unwrap());
    let wanted = |index: usize| match rest.first().map(String::as_str) {
        Some("even") => index.is_multiple_of(2),
        Some("odd") => !index.is_multiple_of(2),
        _ => true,
    };
    let camera = Camera::from_file(&folder.join("camera.json")).unwrap();
    let scene = Scene::from_file(&folder.join("scene.json")).unwrap();
    let forecaster = Forecaster::new(&scene).unwrap();
    let files = std::fs::read_dir(folder).unwrap().filter_map(|entry| entry.unwrap().file_name().into_string().ok());
    let mut names: Vec<String> = files.filter_map(|file| file.strip_suffix(".truth.csv").map(String::from)).collect();
    names.sort();
    if rest.first().is_some_and(|it| it == "spoilt") {
        let names: Vec<String> = names.into_iter().skip(1).step_by(6).collect();
        return spoilt(folder, fps, &names, &camera, &scene);
    }
    if rest.first().is_some_and(|it| it == "constants") {
        let names: Vec<String> = names.into_iter().step_by(6).collect();
        return constants(folder, fps, &names, &camera, &forecaster);
    }
    let names: Vec<String> =
        names.into_iter().enumerate().filter(|(index, _)| wanted(*index)).map(|(_, name)| name).collect();
    let shot = |name: &String| {
        let track = Track::from_file(&folder.join(format!("{name}.csv"))).unwrap();
        let (frames, observations) = track.observations(Some(fps)).unwrap();
        let truth = truth_of(&folder.join(format!("{name}.truth.csv")));
        let began = Instant::now();
        let fit = forecaster
            .fit(&camera, &observations, &FitOptions::default())
            .map_err(|error| (name.clone(), error.to_string()))?;
        let seconds = began.elapsed().as_secs_f64();
        let with_truth = frames.iter().zip(&fit.frames).filter_map(|(number, frame)| Some((frame, truth.get(number)?)));
        let errors = with_truth.map(|(frame, truth)| [distance(&frame.world, truth), frame.sigma]).collect();
        let near = |time: f64| {
            (0..frames.len())
                .min_by(|&a, &b| (fit.frames[a].time - time).abs().total_cmp(&(fit.frames[b].time - time).abs()))
        };
        let at = fit.impacts.iter().filter_map(|impact| near(impact.time));
        let bounces =
            at.filter_map(|index| Some(distance(&fit.frames[index].world, truth.get(&frames[index])?))).collect();
        Ok(Shot { name: name.clone(), fit, errors, bounces, seconds })
    };
    let fitted: Vec<Result<Shot, (String, String)>> = names.par_iter().map(shot).collect();
    let (shots, refused): (Vec<_>, Vec<_>) = fitted.into_iter().partition(Result::is_ok);
    for (name, reason) in refused.iter().filter_map(|it| it.as_ref().err()) {
        println!("{name} refused: {reason}");
    }
    let mut shots: Vec<Shot> = shots.into_iter().flatten().collect();
    let all: Vec<[f64; 2]> = shots.iter().flat_map(|shot| shot.errors.clone()).collect();
    let errors = || all.iter().map(|error| error[0]);
    let within = |sigmas: f64| {
        100.0 * all.iter().filter(|[error, sigma]| *error < sigmas * sigma).count() as f64 / all.len() as f64
    };
    let explained = || shots.iter().filter(|shot| shot.fit.explained);
    println!(
        "shots {}, refused {}, explained {}, of those off by more than 30 cm in the median {}",
        names.len(),
        refused.len(),
        explained().count(),
        explained().filter(|shot| shot.median() > BAD).count()
    );
    println!(
        "shots with a frame more than 1 m off and a 2-sigma below that: {}",
        shots.iter().filter(|shot| shot.is_confident_and_wrong()).count()
    );
    println!(
        "frames {}: error median {:.1}, mean {:.1}, p90 {:.1} cm",
        all.len(),
        100.0 * quantile(errors(), 0.5),
        100.0 * errors().sum::<f64>() / all.len() as f64,
        100.0 * quantile(errors(), 0.9)
    );
    println!("within 1 and 2 sigma: {:.0} %, {:.0} %", within(1.0), within(2.0));
    let bounces = || shots.iter().flat_map(|shot| shot.bounces.iter().copied());
    println!(
        "at {} bounces: error median {:.1}, p90 {:.1} cm",
        bounces().count(),
        100.0 * quantile(bounces(), 0.5),
        100.0 * quantile(bounces(), 0.9)
    );
    println!(
        "seconds a shot: median {:.2}, most {:.2}",
        quantile(shots.iter().map(|shot| shot.seconds), 0.5),
        quantile(shots.iter().map(|shot| shot.seconds), 1.0)
    );
    let mut from = 0.0;
    for to in EDGES {
        let count = all.iter().filter(|[error, sigma]| (from..to).contains(&(error / sigma))).count();
        let share = 100.0 * count as f64 / all.len() as f64;
        println!("error/sigma {from:>3} to {to:<3} {share:5.1} % {}", "#".repeat(share.round() as usize));
        from = to;
    }
    shots.sort_by(|a, b| b.median().total_cmp(&a.median()));
    println!("worst:");
    for shot in shots.iter().take(10) {
        let sigma = quantile(shot.errors.iter().map(|error| error[1]), 0.5);
        println!(
            "{} median {:.0} cm, sigma {:.0} cm: {}",
            shot.name,
            100.0 * shot.median(),
            100.0 * sigma,
            shot.fit.verdict
        );
    }
    if crate::common::is_check() {
        std::fs::remove_dir_all(folder).unwrap();
    }
}

/// What is done to a track: its frames, and which of the track's each of them shows.
type Spoil = fn(Vec<(usize, Observation)>, [f64; 2]) -> Vec<(usize, Observation)>;

/// Says of how many shots with each of the usual mistakes `fit` believes that it explains them.
fn spoilt(folder: &Path, fps: f64, names: &[String], camera: &Camera, scene: &Scene) {
    fn moved(
        track: Vec<(usize, Observation)>,
        to: impl Fn(f64, Point2<f64>) -> Point2<f64>,
    ) -> Vec<(usize, Observation)> {
        track
            .into_iter()
            .map(|(of, it)| (of, Observation { image: it.image.map(|at| to(it.time, at)), ..it }))
            .collect()
    }
    fn retimed(track: Vec<(usize, Observation)>, factor: f64) -> Vec<(usize, Observation)> {
        track.into_iter().map(|(of, it)| (of, Observation { time: it.time * factor, ..it })).collect()
    }
    /// Frames as a clock shows them that has a new time for each.
    fn shown(track: &[(usize, Observation)], which: impl Iterator<Item = usize>) -> Vec<(usize, Observation)> {
        let at =
            |(index, from): (usize, usize)| (track[from].0, Observation { time: track[index].1.time, ..track[from].1 });
        which.enumerate().take_while(|(index, _)| *index < track.len()).map(at).collect()
    }
    let kinds: [(&str, Spoil); 9] = [
        ("as it is", |track, _| track),
        ("mirrored", |track, [width, _]| moved(track, |_, at| Point2::new(width - 1.0 - at.x, at.y))),
        ("turned upside down", |track, [width, height]| {
            moved(track, |_, at| Point2::new(width - 1.0 - at.x, height - 1.0 - at.y))
        }),
        ("gravity upwards", |track, _| track),
        ("150 frames a second instead of 168", |track, _| retimed(track, 168.067 / 150.0)),
        ("120 instead of 168", |track, _| retimed(track, 168.067 / 120.0)),
        ("every third label another ball's", |track, [width, height]| {
            let other = |(index, (of, it)): (usize, (usize, Observation))| {
                let at = Point2::new((0.1 + 0.5 * it.time) * width, (0.8 - 0.3 * it.time) * height);
                let image = if index % 3 == 2 { it.image.map(|_| at) } else { it.image };
                (of, Observation { image, ..it })
            };
            track.into_iter().enumerate().map(other).collect()
        }),
        ("every fifth frame shown twice", |track, _| shown(&track, (0..).map(|index| 5 * index / 6))),
        ("four frames missing", |track, _| {
            let (count, middle) = (track.len(), track.len() / 2);
            shown(&track, (0..middle).chain(middle + 4..count))
        }),
    ];
    for (kind, spoil) in kinds {
        let mut scene = scene.clone();
        if kind == "gravity upwards" {
            scene.gravity = scene.gravity.map(|g| -g);
        }
        let forecaster = Forecaster::new(&scene).unwrap();
        let shot = |name: &String| -> Option<(bool, f64)> {
            let track = Track::from_file(&folder.join(format!("{name}.csv"))).unwrap();
            let truth = truth_of(&folder.join(format!("{name}.truth.csv")));
            let (frames, observations) = track.observations(Some(fps)).unwrap();
            let size = [camera.size().width, camera.size().height].map(f64::from);
            let (of, observations): (Vec<usize>, Vec<Observation>) =
                spoil(observations.into_iter().enumerate().collect(), size).into_iter().unzip();
            let fit = forecaster.fit(camera, &observations, &FitOptions::default()).ok()?;
            let seen = fit.frames.iter().zip(of).filter(|(frame, _)| frame.refused.is_none() && !frame.outlier);
            let errors = seen.filter_map(|(frame, of)| Some(distance(&frame.world, truth.get(&frames[of])?)));
            Some((fit.explained, quantile(errors, 0.5)))
        };
        let all: Vec<Option<(bool, f64)>> = names.par_iter().map(shot).collect();
        let explained = || all.iter().flatten().filter(|(explained, _)| *explained);
        println!(
            "{kind}: {} shots, refused {}, explained {}, of those off by more than 30 cm in the median {}",
            all.len(),
            all.iter().filter(|it| it.is_none()).count(),
            explained().count(),
            explained().filter(|(_, median)| *median > BAD).count()
        );
    }
}

/// Two flights of the tests' simulator as such a folder, and their frame rate.
fn simulated() -> (PathBuf, f64) {
    let folder = crate::common::scratch("real");
    let write = |name: &str, text: String| std::fs::write(folder.join(name), text).unwrap();
    let golden = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden/table_tennis.json");
    let flights: serde_json::Value = serde_json::from_slice(&std::fs::read(golden).unwrap()).unwrap();
    let first = &flights[0];
    for name in ["camera", "scene"] {
        write(&format!("{name}.json"), first[name].to_string());
    }
    let alike = flights.as_array().unwrap().iter().filter(|flight| flight["camera"] == first["camera"]).take(2);
    for (number, flight) in alike.enumerate() {
        let mut track = String::from("Frame,Visibility,X,Y\n");
        let mut truth = String::from("Frame,x,y,z\n");
        for (frame, (image, world)) in
            flight["image"].as_array().unwrap().iter().zip(flight["world"].as_array().unwrap()).enumerate()
        {
            let seen = u8::from(flight["visible"][frame] == true);
            track += &format!("{frame},{seen},{},{}\n", image[0], image[1]);
            truth += &format!("{frame},{},{},{}\n", world[0], world[1], world[2]);
        }
        write(&format!("{number:03}.csv"), track);
        write(&format!("{number:03}.truth.csv"), truth);
    }
    (folder, first["fps"].as_f64().unwrap())
}
