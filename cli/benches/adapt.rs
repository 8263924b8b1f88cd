//! What a model learns of a ball from the first half of a labelled video, measured on the second: recall and precision of `track`, and of
//! `localise` on single frames. Labels (`Frame,Visibility,X,Y`) are used to score alone.
//! `cargo bench --package gravisight-cli --bench all -- adapt VIDEO LABELS.csv …`, of as many pairs as are given; needs ffmpeg.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::labelled::{Label, NEAR_PX, labels};

/// Single frames of a video that are scored at most.
const FRAMES: usize = 40;

pub fn run(arguments: &[String]) {
    if arguments.is_empty() || !arguments.len().is_multiple_of(2) {
        return println!(
            "usage: cargo bench --package gravisight-cli --bench all -- adapt VIDEO LABELS.csv [VIDEO LABELS.csv]…"
        );
    }
    println!(
        "| video | flights | track: recall, precision | track, adapted | single frames: first, reported, wrong | adapted |"
    );
    println!("| --- | --- | --- | --- | --- | --- |");
    for pair in arguments.chunks_exact(2) {
        let folder = crate::common::scratch("adapt");
        println!("{}", row(&folder, &pair[0], &pair[1]));
        std::fs::remove_dir_all(&folder).unwrap();
    }
}

fn row(folder: &Path, video: &str, table: &str) -> String {
    let count: usize = printed(
        "ffprobe",
        &[
            "-v",
            "error",
            "-count_frames",
            "-select_streams",
            "v",
            "-show_entries",
            "stream=nb_read_frames",
            "-of",
            "csv=p=0",
            video,
        ],
    )
    .trim()
    .trim_end_matches(',')
    .parse()
    .unwrap();
    let half = count / 2;
    let place = |name: &str| folder.join(name).to_string_lossy().into_owned();
    let (first, second, model) = (place("first.mkv"), place("second.mkv"), place("model"));
    for (file, from, to) in [(&first, 0, half), (&second, half, count)] {
        let part = format!("select=between(n\\,{from}\\,{}),setpts=PTS-STARTPTS", to - 1);
        // Without loss: what is measured is the same pictures.
        printed(
            "ffmpeg",
            &[
                "-v",
                "error",
                "-i",
                video,
                "-vf",
                &part,
                "-fps_mode",
                "passthrough",
                "-an",
                "-c:v",
                "libx264",
                "-qp",
                "0",
                "-preset",
                "ultrafast",
                file,
            ],
        );
    }
    let labels: BTreeMap<usize, Label> =
        labels(table).into_iter().filter_map(|(frame, label)| Some((frame.checked_sub(half)?, label))).collect();
    let adapted = Command::new(env!("CARGO_BIN_EXE_gravisight"))
        .args(["adapt", &first, "--out", &model, "--json"])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&adapted.stderr);
    let flights = said
        .lines()
        .find(|line| line.contains("usable flights"))
        .and_then(|line| line.rsplit(": ").next())
        .unwrap_or("none");
    let parts: Vec<_> = Path::new(video).iter().map(|part| part.to_string_lossy()).collect();
    let name = parts[parts.len().saturating_sub(2)..].join("/");
    let frames = frames(folder, &second, &labels);
    let before = [track(&second, None, &labels), single(folder, &frames, None, &labels)];
    if !adapted.status.success() {
        let reason = said.lines().last().unwrap_or_default().to_string();
        return format!("| {name} | {flights} | {} | refused: {reason} | {} | |", before[0], before[1]);
    }
    let after = [track(&second, Some(&model), &labels), single(folder, &frames, Some(&model), &labels)];
    format!("| {name} | {flights} | {} | {} | {} | {} |", before[0], after[0], before[1], after[1])
}

/// What a program prints.
fn printed(program: &str, arguments: &[&str]) -> String {
    let output = Command::new(program).args(arguments).output().unwrap();
    assert!(output.status.success(), "{program}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn gravisight(arguments: &[&str], model: Option<&str>) -> String {
    let model = model.iter().flat_map(|model| ["--model", *model]);
    let output = Command::new(env!("CARGO_BIN_EXE_gravisight")).args(arguments).args(model).output().unwrap();
    String::from_utf8(output.stdout).unwrap()
}

/// Whether what was found is the ball; none where the label says that it is not visible.
fn is_ball(found: &Value, label: &Label) -> Option<bool> {
    let (Some(u), Some(v)) = (label.x, label.y) else { return None };
    let at = [0, 1].map(|axis| found["image"][axis].as_f64().unwrap());
    let near = found["radius_px"].as_f64().unwrap_or(0.0).max(NEAR_PX);
    (label.visibility > 0).then(|| (at[0] - u).hypot(at[1] - v) <= near)
}

fn track(video: &str, model: Option<&str>, labels: &BTreeMap<usize, Label>) -> String {
    let found: Value = serde_json::from_str(&gravisight(&["track", video, "--json"], model)).unwrap();
    let frames = found["frames"].as_array().unwrap();
    let seen = labels.iter().filter_map(|(frame, label)| Some((frames.get(*frame)?, label)));
    let verdicts: Vec<Option<bool>> =
        seen.filter(|(frame, _)| !frame["image"].is_null()).map(|(frame, label)| is_ball(frame, label)).collect();
    let visible = labels.values().filter(|label| label.visibility > 0).count();
    let right = verdicts.iter().filter(|verdict| **verdict == Some(true)).count();
    format!("{:.2}, {:.2}", right as f64 / visible as f64, right as f64 / verdicts.len().max(1) as f64)
}

/// Some of the labelled frames as pictures: the numbers of those that there are.
fn frames(folder: &Path, video: &str, labels: &BTreeMap<usize, Label>) -> Vec<usize> {
    let pattern = folder.join("%05d.png").to_string_lossy().into_owned();
    let every = labels.len().div_ceil(FRAMES).max(1);
    let wanted: Vec<usize> = labels.keys().copied().step_by(every).collect();
    let select: Vec<String> = wanted.iter().map(|frame| format!("eq(n\\,{frame})")).collect();
    printed(
        "ffmpeg",
        &[
            "-v",
            "error",
            "-i",
            video,
            "-vf",
            &format!("select={}", select.join("+")),
            "-fps_mode",
            "passthrough",
            "-start_number",
            "0",
            &pattern,
        ],
    );
    wanted
}

fn single(folder: &Path, frames: &[usize], model: Option<&str>, labels: &BTreeMap<usize, Label>) -> String {
    let pictures: Vec<String> = (0..frames.len())
        .map(|number| folder.join(format!("{number:05}.png")).to_string_lossy().into_owned())
        .collect();
    let (width, height) = image::image_dimensions(&pictures[0]).unwrap();
    // Metres do not matter here.
    let camera = folder.join("camera.json");
    let middle = [width, height].map(|side| f64::from(side) / 2.0 - 0.5);
    let text = serde_json::json!({
        "width": width, "height": height,
        "intrinsic": [[width, 0, middle[0]], [0, width, middle[1]], [0, 0, 1]],
        "camera_from_world": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 8], [0, 0, 0, 1]],
    });
    std::fs::write(&camera, text.to_string()).unwrap();
    let camera = camera.to_string_lossy().into_owned();
    let mut arguments = vec!["localise"];
    arguments.extend(pictures.iter().map(String::as_str));
    arguments.extend(["--camera", &camera, "--ball-radius", "0.033", "--json"]);
    let [mut balls, mut first, mut reported, mut wrong] = [0; 4];
    for (line, frame) in gravisight(&arguments, model).lines().zip(frames) {
        let found: Value = serde_json::from_str(line).unwrap();
        let (verdict, is_reported) = (is_ball(&found, &labels[frame]), found["ball_found"] == true);
        balls += usize::from(labels[frame].visibility > 0);
        first += usize::from(verdict == Some(true));
        reported += usize::from(verdict == Some(true) && is_reported);
        wrong += usize::from(verdict != Some(true) && is_reported);
    }
    format!("{first}, {reported} of {balls}; {wrong} of {}", frames.len())
}
