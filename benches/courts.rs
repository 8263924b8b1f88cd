//! How often a court's camera is found without clicks, and how far off it is: `cargo bench --bench all -- courts FOLDER`.
//!
//! `FOLDER/courts.csv` has a row a picture and court: `file`, `court`, `points`. `points` is a points.json with clicks, to compare with; empty
//! where nobody clicked; `-` where the picture does not show that court. Paths are relative to the folder.
//!
//! *Error*: the greatest distance of a point of the court, as a share of the picture's width, from where the camera by clicks puts it. A
//! camera at the other end of the court counts as the same.

use std::path::Path;
use std::time::Instant;

use gravisight::{Camera, Court, CourtVerdict, Picture, Points, Unknowns, calibrate, find_court};
use nalgebra::Point3;

/// What a picture without the court has in place of clicks.
const NO_COURT: &str = "-";

#[derive(serde::Deserialize)]
struct Row {
    file: String,
    court: String,
    points: String,
}

/// The greatest distance of the court's points between two cameras, % of the width.
fn error(found: &Camera, truth: &Camera, court: &str) -> f64 {
    let points = &Court::named(court).expect("a court").points;
    let worst = |sign: f64| {
        let distance = |at: &[f64; 3]| {
            let turned = Point3::new(sign * at[0], sign * at[1], at[2]);
            let (Ok(a), Ok(b)) = (found.image_from_world(&turned), truth.image_from_world(&Point3::from(*at))) else {
                return f64::INFINITY;
            };
            (a - b).norm()
        };
        points.values().map(distance).fold(0.0, f64::max)
    };
    100.0 * worst(1.0).min(worst(-1.0)) / truth.size().xy()[0]
}

pub fn run(arguments: &[String]) {
    let Some(folder) = arguments.first().map(Path::new) else {
        println!("usage: cargo bench --bench all -- courts FOLDER");
        return;
    };
    let mut rows = csv::Reader::from_path(folder.join("courts.csv")).expect("courts.csv");
    // Of courts in view and of others: sure, probable, none.
    let mut counts = [[0; 3]; 2];
    println!("verdict    found  refined  seconds  picture");
    for row in rows.deserialize() {
        let Row { file, court, points } = row.expect("a row");
        let picture = Picture::decode(&std::fs::read(folder.join(&file)).expect("a picture")).expect("a picture");
        let start = Instant::now();
        let found = find_court(&picture, &court).expect("a court whose lines are known");
        let seconds = start.elapsed().as_secs_f64();
        let index = [CourtVerdict::Sure, CourtVerdict::Probable, CourtVerdict::None]
            .iter()
            .position(|verdict| *verdict == found.verdict);
        counts[usize::from(points == NO_COURT)][index.expect("a verdict")] += 1;
        let truth = (!points.is_empty() && points != NO_COURT).then(|| {
            let clicks = Points::from_file(&folder.join(&points)).expect("clicks");
            calibrate(&clicks, &Unknowns::default()).expect("a camera by clicks").camera
        });
        let off = |camera: Option<&Camera>| match (camera, &truth) {
            (Some(camera), Some(truth)) => format!("{:5.2} %", error(camera, truth, &court)),
            _ => "      -".into(),
        };
        let refined = found.calibrate(&picture, &Unknowns::default()).ok().map(|refined| refined.camera);
        println!(
            "{:9}  {}  {}  {seconds:7.2}  {file}: {}",
            format!("{:?}", found.verdict),
            off(found.camera.as_ref()),
            off(refined.as_ref()),
            found.reason
        );
    }
    let [shown, others] = counts.map(|[sure, probable, none]| format!("{sure} sure, {probable} probable, {none} none"));
    println!("courts in view: {shown}\npictures without the court: {others}");
}
