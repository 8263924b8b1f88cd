//! How well `gravisight track` follows the ball in a video that was labelled by hand (`docs/labels`: Frame,Visibility,X,Y,Radius):
//! `cargo bench --package gravisight-cli --bench labelled -- VIDEO LABELS.csv`.

use std::collections::BTreeMap;
use std::process::Command;

use serde_json::Value;

#[derive(serde::Deserialize)]
#[serde(rename_all = "PascalCase")]
struct Label {
    frame: usize,
    x: Option<f64>,
    y: Option<f64>,
    radius: Option<f64>,
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with("--")).collect();
    let [video, labels] = arguments.as_slice() else {
        return println!("usage: cargo bench --package gravisight-cli --bench labelled -- VIDEO LABELS.csv");
    };
    let mut table = csv::Reader::from_path(labels).unwrap();
    let labels: BTreeMap<usize, Label> =
        table.deserialize().map(|label: Result<Label, _>| label.unwrap()).map(|label| (label.frame, label)).collect();
    let output = Command::new(env!("CARGO_BIN_EXE_gravisight")).args(["track", video, "--json"]).output().unwrap();
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    let (mut right, mut shown) = (0, 0);
    for (number, frame) in found["frames"].as_array().unwrap().iter().enumerate() {
        let Some([x, y]) = frame["image"].as_array().map(|at| [0, 1].map(|axis| at[axis].as_f64().unwrap())) else {
            continue;
        };
        shown += 1;
        let Some(Label { x: Some(u), y: Some(v), radius: Some(radius), .. }) = labels.get(&number) else {
            println!("frame {number}: ({x:.0}, {y:.0}) px, where no ball is labelled");
            continue;
        };
        let off = (x - u).hypot(y - v);
        right += usize::from(off <= *radius);
        if off > *radius {
            println!("frame {number}: {off:.0} px off");
        }
    }
    let visible = labels.values().filter(|label| label.x.is_some()).count();
    println!("found within a radius: {right} of {visible}; what was found is the ball: {right} of {shown}");
}
