//! How well `gravisight track` does on footage with truth, as `synth --set broadcast` and `synth --set footage` make it:
//! `cargo bench --package gravisight-cli --bench all -- footage FOLDER`. Clips whose camera moves are counted by themselves: their truth is in
//! the first view's metres.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use gravisight::internal::median;
use serde_json::Value;

/// Least distance within which a ball is found, px; of larger balls their radius.
const NEAR_PX: f64 = 2.0;
/// Frames within which a contact is found.
const NEAR_FRAMES: f64 = 1.5;
/// How far a flight's ends may be from the true ones, as a share of how long it lasts.
const ENDS: f64 = 0.25;

/// Counts of a kind of footage: found, and of how many.
#[derive(Default)]
struct Score {
    recall: [usize; 2],
    precision: [usize; 2],
    flights: [usize; 2],
    hits: [usize; 2],
    bounces: [usize; 2],
    invented: usize,
    /// Errors as shares of the depth, and in stated sigmas.
    shares: Vec<f64>,
    sigmas: Vec<f64>,
    /// Of what was found: how sure it was said to be, and whether it is the ball.
    sure: Vec<(f64, bool)>,
    seconds: f64,
    /// Runs that gave nothing.
    failed: usize,
}

fn count(of: &mut [usize; 2], found: bool) {
    of[0] += usize::from(found);
    of[1] += 1;
}

fn number(row: &BTreeMap<String, String>, name: &str) -> f64 {
    row[name].parse().unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().into_iter().flatten().filter_map(Value::as_f64).collect()
}

fn score(video: &Path, kind: &str, score: &mut Score) {
    let file = |ending: &str| video.with_extension(ending);
    let [camera, scene] = ["camera.json", "scene.json"].map(file);
    let began = std::time::Instant::now();
    let mut command = Command::new(env!("CARGO_BIN_EXE_gravisight"));
    command.arg("track").arg(video).arg("--camera").arg(&camera).arg("--scene").arg(&scene).arg("--json");
    if let Some(court) = gravisight::Court::with_lines(kind) {
        command.args(["--court", court]);
    }
    let output = command.output().unwrap();
    score.seconds += began.elapsed().as_secs_f64();
    // Of a run that failed nothing is found, and what there was to be found counts all the same.
    let found = serde_json::from_slice::<Value>(&output.stdout).unwrap_or_else(|_| {
        println!("{}: FAILED: {}", video.display(), String::from_utf8_lossy(&output.stderr).trim_end());
        score.failed += 1;
        Value::Null
    });
    let mut table = csv::Reader::from_path(file("truth.csv")).unwrap();
    let truth: Vec<BTreeMap<String, String>> = table.deserialize().map(Result::unwrap).collect();
    let contacts: Value = serde_json::from_slice(&std::fs::read(file("truth.json")).unwrap()).unwrap();
    let pose: Value = serde_json::from_slice(&std::fs::read(&camera).unwrap()).unwrap();
    let axis = numbers(&pose["camera_from_world"][2]);
    let before = score.recall;
    let repeated: Vec<u64> = contacts["repeated"].as_array().into_iter().flatten().filter_map(Value::as_u64).collect();
    for (index, row) in truth.iter().enumerate().filter(|(index, _)| !repeated.contains(&(*index as u64))) {
        let frame = &found["frames"][index];
        let image = numbers(&frame["image"]);
        let near = image.len() == 2
            && (image[0] - number(row, "X")).hypot(image[1] - number(row, "Y")) <= NEAR_PX.max(number(row, "Radius"));
        if row["Visibility"] == "1" {
            count(&mut score.recall, near);
        }
        if image.len() == 2 {
            count(&mut score.precision, near);
            score.sure.push((frame["confidence"].as_f64().unwrap(), near));
        }
        let world = numbers(&frame["world"]);
        if world.len() == 3 {
            let at = ["WorldX", "WorldY", "WorldZ"].map(|name| number(row, name));
            let depth = (0..3).map(|index| axis[index] * at[index]).sum::<f64>() + axis[3];
            let error = (0..3).map(|index| (world[index] - at[index]).powi(2)).sum::<f64>().sqrt();
            score.shares.push(error / depth);
            score.sigmas.push(error / frame["sigma"].as_f64().unwrap());
        }
    }
    let last = number(&truth[truth.len() - 1], "Time");
    let interval = last / (truth.len() - 1) as f64;
    let times = |value: &Value, key: usize| -> Vec<f64> {
        value.as_array().into_iter().flatten().filter_map(|it| it[key].as_f64()).collect()
    };
    let said = |name: &str| -> Vec<f64> {
        found[name].as_array().into_iter().flatten().filter_map(|it| it["time"].as_f64()).collect()
    };
    let near = |time: f64, others: &[f64]| others.iter().any(|other| (other - time).abs() <= NEAR_FRAMES * interval);
    for (name, counts) in [("hits", &mut score.hits), ("bounces", &mut score.bounces)] {
        let (true_times, found_times) = (times(&contacts[name], 0), said(name));
        true_times.iter().for_each(|&time| count(counts, near(time, &found_times)));
        score.invented += found_times.iter().filter(|&&time| !near(time, &true_times)).count();
    }
    let ends = [vec![0.0], times(&contacts["hits"], 0), vec![last]].concat();
    for pair in ends.windows(2) {
        let within = (ENDS * (pair[1] - pair[0])).max(2.0 * interval);
        let right = |flight: &Value| {
            let near = |name: &str, time: f64| flight[name].as_f64().is_some_and(|it| (it - time).abs() <= within);
            flight["explained"] == true && near("start", pair[0]) && near("end", pair[1])
        };
        count(&mut score.flights, found["flights"].as_array().is_some_and(|flights| flights.iter().any(right)));
    }
    let [all, seen] = [score.recall[1] - before[1], score.recall[0] - before[0]];
    println!("{}: found {seen} of {all}; {}", video.display(), found["verdict"].as_str().unwrap_or_default());
}

pub fn run(arguments: &[String]) {
    let [folder] = arguments else {
        return println!("usage: cargo bench --package gravisight-cli --bench all -- footage FOLDER");
    };
    let mut videos: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    videos.retain(|path| path.extension().is_some_and(|ending| ending == "mp4"));
    videos.sort();
    let mut scores: BTreeMap<String, Score> = BTreeMap::new();
    for video in &videos {
        let stem = video.file_stem().unwrap().to_string_lossy();
        let sport = stem.rsplit_once('-').map_or(&*stem, |(kind, _)| kind);
        let truth: Value = serde_json::from_slice(&std::fs::read(video.with_extension("truth.json")).unwrap()).unwrap();
        let moves = truth["moves"].as_str().filter(|moves| *moves != "still");
        let kind = moves.map_or(sport.to_string(), |moves| format!("{sport}, {moves}"));
        score(video, sport, scores.entry(kind).or_default());
    }
    let failed: usize = scores.values().map(|score| score.failed).sum();
    if failed > 0 {
        println!("{failed} of {} runs FAILED: nothing is found in these", videos.len());
    }
    let sure: Vec<(f64, bool)> = scores.values().flat_map(|score| score.sure.clone()).collect();
    crate::common::print_reliability(&sure);
    println!(
        "{:<13} {:>7} {:>10} {:>10} {:>9} {:>9} {:>9} {:>9} {:>8} {:>8} {:>7}",
        "", "found", "right", "3D median", "flights", "hits", "bounces", "invented", "1 sigma", "2 sigma", "s"
    );
    for (kind, score) in scores {
        let share = |[found, all]: [usize; 2]| 100.0 * found as f64 / all.max(1) as f64;
        let within = |times: f64| {
            100.0 * score.sigmas.iter().filter(|&&it| it < times).count() as f64 / score.sigmas.len().max(1) as f64
        };
        let within = [within(1.0), within(2.0)];
        let median = median(score.shares).unwrap_or(f64::NAN);
        let of = |[found, all]: [usize; 2]| format!("{found}/{all}");
        println!(
            "{kind:<13} {:>6.1}% {:>9.1}% {:>9.2}% {:>9} {:>9} {:>9} {:>9} {:>7.0}% {:>7.0}% {:>7.1}",
            share(score.recall),
            share(score.precision),
            100.0 * median,
            of(score.flights),
            of(score.hits),
            of(score.bounces),
            score.invented,
            within[0],
            within[1],
            score.seconds
        );
    }
}
