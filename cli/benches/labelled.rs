//! How well `gravisight track` follows the ball in a video that was labelled by hand (`Frame,Visibility,X,Y`, optionally `Radius`, as in
//! `docs/labels`). Frames without a row do not count. A ball is found within its radius, at least 4 px.
//! `cargo bench --package gravisight-cli --bench all -- labelled VIDEO LABELS.csv [FPS]`, of as many pairs as are given.

use std::collections::BTreeMap;
use std::process::Command;

use serde_json::Value;

#[derive(serde::Deserialize)]
#[serde(rename_all = "PascalCase")]
pub struct Label {
    frame: usize,
    pub visibility: u8,
    pub x: Option<f64>,
    pub y: Option<f64>,
    #[serde(default)]
    radius: Option<f64>,
}

/// The labels of a table, by frame.
pub fn labels(table: &str) -> BTreeMap<usize, Label> {
    let mut table = csv::Reader::from_path(table).unwrap_or_else(|error| panic!("{table}: {error}"));
    table.deserialize().map(|label: Result<Label, _>| label.unwrap()).map(|label| (label.frame, label)).collect()
}

/// Least distance within which a ball is found, px: hand labels are good to about 2 px.
pub const NEAR_PX: f64 = 4.0;

pub fn run(arguments: &[String]) {
    let mut arguments = arguments.to_vec();
    if crate::common::is_check() {
        arguments = drawn();
    }
    if arguments.len() < 2 {
        return println!(
            "usage: cargo bench --package gravisight-cli --bench all -- labelled VIDEO LABELS.csv [FPS] [VIDEO LABELS.csv [FPS]]…"
        );
    }
    let mut sure = vec![];
    let mut rest = arguments.as_slice();
    while let [video, labels, more @ ..] = rest {
        let rate = more.first().filter(|text| text.parse::<f64>().is_ok());
        rest = &more[usize::from(rate.is_some())..];
        sure.extend(score(video, labels, rate));
    }
    crate::common::print_reliability(&sure);
    if crate::common::is_check() {
        std::fs::remove_dir_all(&arguments[0]).unwrap();
    }
}

/// Tracks a video and prints what is found. Returns the confidence of what was found in labelled frames, and whether it is the ball.
fn score(video: &str, table: &str, rate: Option<&String>) -> Vec<(f64, bool)> {
    let labels = labels(table);
    let output = Command::new(env!("CARGO_BIN_EXE_gravisight"))
        .args(["track", video, "--json"])
        .args(rate.iter().flat_map(|fps| ["--fps", fps]))
        .output()
        .unwrap();
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    let mut sure = vec![];
    for (number, frame) in found["frames"].as_array().unwrap().iter().enumerate() {
        let Some([x, y]) = frame["image"].as_array().map(|at| [0, 1].map(|axis| at[axis].as_f64().unwrap())) else {
            continue;
        };
        let Some(label) = labels.get(&number) else { continue };
        let confidence = frame["confidence"].as_f64().unwrap();
        let Label { visibility: 1.., x: Some(u), y: Some(v), radius, .. } = label else {
            println!("frame {number}: ({x:.0}, {y:.0}) px, where no ball is visible, confidence {confidence:.2}");
            sure.push((confidence, false));
            continue;
        };
        let off = (x - u).hypot(y - v);
        let near = radius.map_or(NEAR_PX, |radius| radius.max(NEAR_PX));
        if off > near {
            println!("frame {number}: {off:.0} px off, confidence {confidence:.2}");
        }
        sure.push((confidence, off <= near));
    }
    let visible = labels.values().filter(|label| label.visibility > 0).count();
    let right = sure.iter().filter(|(_, is_right)| *is_right).count();
    println!("{video}: found: {right} of {visible}; what was found is the ball: {right} of {}", sure.len());
    sure
}

/// Frames of a disc that flies before a grey wall, its labels, and the frame rate.
fn drawn() -> Vec<String> {
    let folder = crate::common::scratch("labelled");
    let mut labels = String::from("Frame,Visibility,X,Y,Radius\n");
    for number in 0..32 {
        let time = f64::from(number);
        let [u, v] = [10.0 + 4.0 * time, 80.0 - 5.0 * time + 0.14 * time * time];
        let frame = image::RgbImage::from_fn(160, 96, |x, y| {
            let inside = (f64::from(x) - u).hypot(f64::from(y) - v) < 5.0;
            image::Rgb(if inside { [230, 220, 60] } else { [90, 100, 110] })
        });
        frame.save(folder.join(format!("{number:02}.png"))).unwrap();
        labels += &format!("{number},1,{u},{v},5\n");
    }
    let table = folder.join("labels.csv");
    std::fs::write(&table, labels).unwrap();
    [folder.to_string_lossy().into(), table.to_string_lossy().into(), "30".into()].into()
}
