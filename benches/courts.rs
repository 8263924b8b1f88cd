//! How often a court's camera is found without clicks, and how far off it is: `cargo bench --bench all -- courts FOLDER`.
//!
//! `FOLDER/courts.csv` has a row a picture and court: `file`, `court`, `points`. `points` is a points.json with clicks or a camera.json with
//! the exact camera, to compare with; empty where neither is known; `-` where the picture does not show that court. Paths are relative to
//! the folder. `gravisight synth --set courts` makes such folders.
//!
//! *Error*: the greatest distance of a point of the court in view, as a share of the picture's width, from where the true camera puts it. A
//! camera at the other end of the court counts as the same. A camera is *right* if its error, refined by the lines, is at most 1 %.
//!
//! `cargo bench --bench all -- courts fit FOLDER …` (`scripts/fit-weights courts FOLDER …`) prints the log-odds that a camera is right (`LOG_ODDS` and
//! `GOOD` in crates/geometry/src/camera/find/verdict.rs): a logistic regression on the best two cameras of each way to search. Pictures whose camera
//! is known count, and those without the court, both together as much; each picture is also searched for two other courts.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use gravisight::internal::{COURT_FEATURES, court_evidence, median};
use gravisight::{Camera, Court, CourtVerdict, FoundCourt, Picture, Points, Unknowns, calibrate, find_court};
use nalgebra::{Point2, Point3, SMatrix, SVector};
use rayon::prelude::*;

/// What a picture without the court has in place of clicks.
const NO_COURT: &str = "-";
/// How the files of exact cameras end.
const CAMERA: &str = "camera.json";
/// Largest error of a right camera, % of the width.
const RIGHT: f64 = 1.0;
/// Largest error of a camera that refinement by the lines still makes right, % of the width: the search reaches 3 %.
const REFINABLE: f64 = 2.5;
/// Lines that have to be in view, as `find_court` documents.
const LINES: usize = 5;
/// Places of a line at which is measured whether it is in view, and the fraction of them that has to be.
const PLACES: u32 = 20;
const IN_VIEW: f64 = 0.25;

/// Largest relative difference of the cameras' heights and focal lengths of two courts on one ground, as they are found.
const AGREES: f64 = 0.05;
/// By their numbers, less the picture's, the other courts for which it is searched.
const OTHERS: [usize; 2] = [0, 3];
/// Newton's steps of the logistic regression, and the strength of its prior.
const NEWTON_STEPS: usize = 30;
const RIDGE: f64 = 1e-2;

#[derive(serde::Deserialize)]
struct Row {
    file: String,
    court: String,
    points: String,
}

/// What a picture shows.
enum Truth {
    /// Another court or none.
    NoCourt,
    Unknown,
    Known(Box<Camera>),
}

/// What was found in a picture.
struct Outcome {
    truth: Truth,
    verdict: CourtVerdict,
    /// % of the width, found and refined.
    errors: [Option<f64>; 2],
    /// Distance of the found camera from the true one over the true one's from the court's middle.
    away: Option<f64>,
    lines: usize,
    seconds: f64,
}

impl Truth {
    fn read(folder: &Path, points: &str) -> Self {
        let path = folder.join(points);
        if points == NO_COURT {
            Self::NoCourt
        } else if points.is_empty() {
            Self::Unknown
        } else if points.ends_with(CAMERA) {
            Self::Known(Box::new(Camera::from_file(&path).expect("a camera")))
        } else {
            let clicks = Points::from_file(&path).expect("clicks");
            Self::Known(Box::new(calibrate(&clicks, &Unknowns::default()).expect("a camera by clicks").camera))
        }
    }
}

/// Where a camera sees a point, if in its picture.
fn seen(camera: &Camera, at: &Point3<f64>) -> Option<Point2<f64>> {
    let [width, height] = camera.size().xy();
    camera.image_from_world(at).ok().filter(|at| (0.0..width).contains(&at.x) && (0.0..height).contains(&at.y))
}

/// The greatest distance between two cameras of the court's points in view, % of the width.
fn error(found: &Camera, truth: &Camera, court: &Court) -> f64 {
    let points: Vec<_> = court.points.values().filter_map(|at| Some((at, seen(truth, &Point3::from(*at))?))).collect();
    let worst = |sign: f64| {
        let distance = |(at, image): &(&[f64; 3], Point2<f64>)| {
            let turned = Point3::new(sign * at[0], sign * at[1], at[2]);
            found.image_from_world(&turned).map_or(f64::INFINITY, |there| (there - image).norm())
        };
        points.iter().map(distance).fold(0.0, f64::max)
    };
    100.0 * worst(1.0).min(worst(-1.0)) / truth.size().xy()[0]
}

/// How far a found camera's centre is from the true one, as a fraction of the distance of that from the court's middle.
fn away(found: &Camera, truth: &Camera) -> f64 {
    let [found, truth] = [found, truth].map(|camera| camera.world_from_camera(&Point3::origin()));
    let turned = Point3::new(-found.x, -found.y, found.z);
    (found - truth).norm().min((turned - truth).norm()) / truth.coords.norm()
}

/// How many of a court's lines are in view.
fn lines_in_view(camera: &Camera, court: &Court) -> usize {
    let is_in_view = |line: &&gravisight::camera::CourtLine| {
        let at = |place: u32| {
            let share = f64::from(place) / f64::from(PLACES - 1);
            Point3::from([0, 1, 2].map(|axis| line.from[axis] + share * (line.to[axis] - line.from[axis])))
        };
        let inside = (0..PLACES).filter(|place| seen(camera, &at(*place)).is_some()).count();
        inside as f64 >= IN_VIEW * f64::from(PLACES)
    };
    court.lines.iter().filter(is_in_view).count()
}

impl Outcome {
    fn of(found: &FoundCourt, picture: &Picture, truth: Truth, court: &str, seconds: f64) -> Self {
        let court = Court::named(court).expect("a court");
        let refined = found.calibrate(picture, &Unknowns::default()).ok().map(|refined| refined.camera);
        let cameras = [found.camera.as_ref(), refined.as_ref()];
        let known = if let Truth::Known(camera) = &truth { Some(camera.as_ref()) } else { None };
        Self {
            verdict: found.verdict,
            errors: cameras.map(|camera| Some(error(camera?, known?, court))),
            away: cameras[1].or(cameras[0]).zip(known).map(|(camera, known)| away(camera, known)),
            lines: known.map_or(0, |camera| lines_in_view(camera, court)),
            truth,
            seconds,
        }
    }

    fn is(&self, verdict: CourtVerdict, right: bool) -> bool {
        self.verdict == verdict && self.is_right() == right
    }

    fn is_right(&self) -> bool {
        self.errors[1].or(self.errors[0]).is_some_and(|error| error <= RIGHT)
    }

    fn line(&self, name: &str, reason: &str) -> String {
        let [found, refined] =
            self.errors.map(|error| error.map_or_else(|| "      -".into(), |error| format!("{error:5.2} %")));
        let verdict = format!("{:?}", self.verdict);
        format!("{verdict:9}  {found}  {refined}  {:5}  {:7.2}  {name}: {reason}", self.lines, self.seconds)
    }
}

/// The table of pictures whose camera is known, by court.
fn print_known(by_court: &BTreeMap<String, Vec<Outcome>>) {
    println!("\ncourts in view, whose camera is known");
    println!(
        "| court | pictures | ≥ {LINES} lines | right | right of these | sure, right | sure, wrong | probable, right | probable, wrong | none | centre, median | seconds, median |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|");
    let print = |court: &str, all: &[&Outcome]| {
        let known: Vec<&&Outcome> = all.iter().filter(|it| matches!(it.truth, Truth::Known(_))).collect();
        if known.is_empty() {
            return;
        }
        let count = |is: &dyn Fn(&Outcome) -> bool| known.iter().filter(|it| is(it)).count();
        let centre = median(known.iter().filter(|it| it.is_right()).filter_map(|it| it.away));
        let counts = [
            known.len(),
            count(&|it| it.lines >= LINES),
            count(&Outcome::is_right),
            count(&|it| it.lines >= LINES && it.is_right()),
            count(&|it| it.is(CourtVerdict::Sure, true)),
            count(&|it| it.is(CourtVerdict::Sure, false)),
            count(&|it| it.is(CourtVerdict::Probable, true)),
            count(&|it| it.is(CourtVerdict::Probable, false)),
            count(&|it| it.verdict == CourtVerdict::None),
        ];
        let counts = counts.map(|count| count.to_string()).join(" | ");
        let centre = centre.map_or_else(|| "-".into(), |away| format!("{:.1} %", 100.0 * away));
        let seconds = median(known.iter().map(|it| it.seconds)).unwrap_or_default();
        println!("| {court} | {counts} | {centre} | {seconds:.2} |");
    };
    by_court.iter().for_each(|(court, all)| print(court, &all.iter().collect::<Vec<_>>()));
    print("all", &by_court.values().flatten().collect::<Vec<_>>());
}

/// The verdicts on the pictures whose camera is not known, and on those without the court.
fn print_verdicts(title: &str, by_court: &BTreeMap<String, Vec<Outcome>>, is_one: impl Fn(&Truth) -> bool) {
    let verdicts = [CourtVerdict::Sure, CourtVerdict::Probable, CourtVerdict::None];
    let mut lines = vec![];
    for (court, all) in by_court {
        let all: Vec<&Outcome> = all.iter().filter(|it| is_one(&it.truth)).collect();
        let counts = verdicts.map(|verdict| all.iter().filter(|it| it.verdict == verdict).count().to_string());
        if !all.is_empty() {
            let seconds = median(all.iter().map(|it| it.seconds)).unwrap_or_default();
            lines.push(format!("| {court} | {} | {seconds:.2} |", counts.join(" | ")));
        }
    }
    if !lines.is_empty() {
        println!(
            "\n{title}\n| court | sure | probable | none | seconds, median |\n|---|---|---|---|---|\n{}",
            lines.join("\n")
        );
    }
}

/// What speaks for a camera, whether it is right, and how much it counts.
struct Example {
    row: SVector<f64, COURT_FEATURES>,
    is_right: bool,
    weight: f64,
}

/// Whether two cameras agree about how high they stand and their focal length: one may be of another court that is painted on the same ground.
fn do_agree(a: &Camera, b: &Camera) -> bool {
    let numbers = |camera: &Camera| [camera.intrinsic()[(0, 0)], camera.world_from_camera(&Point3::origin()).z];
    numbers(a).into_iter().zip(numbers(b)).all(|(a, b)| (a / b - 1.0).abs() < AGREES)
}

/// The cameras of a picture that may be a court's; `truth` is the right one, if it is in view. If another court is, `other` is its camera.
fn examples(picture: &Picture, court: &str, truth: Option<&Camera>, other: Option<&Camera>) -> Vec<Example> {
    let points = Court::named(court).expect("a court");
    let mut all = court_evidence(picture, court).expect("a court whose lines are known");
    all.retain(|(camera, _)| !other.is_some_and(|other| do_agree(camera, other)));
    let count = all.len();
    let example = |(camera, row): (Camera, [f64; COURT_FEATURES])| Example {
        row: row.into(),
        is_right: truth.is_some_and(|truth| error(&camera, truth, points) <= REFINABLE),
        weight: 1.0 / count as f64,
    };
    all.into_iter().map(example).collect()
}

/// Pictures of folders, and what is right in them.
fn all_examples(folders: &[String]) -> Vec<Example> {
    let courts: Vec<&str> =
        Court::names().into_iter().filter(|name| !Court::named(name).expect("a court").lines.is_empty()).collect();
    let mut rows: Vec<(PathBuf, Row)> = vec![];
    for folder in folders {
        let mut table = csv::Reader::from_path(Path::new(folder).join("courts.csv")).expect("courts.csv");
        rows.extend(table.deserialize().map(|row| (folder.into(), row.expect("a row"))));
    }
    let of = |(number, (folder, row)): (usize, &(PathBuf, Row))| {
        let picture = Picture::decode(&std::fs::read(folder.join(&row.file)).expect("a picture")).expect("a picture");
        let truth = Truth::read(folder, &row.points);
        let camera = if let Truth::Known(camera) = &truth { Some(camera.as_ref()) } else { None };
        let others = OTHERS.map(|step| courts[(number + step) % courts.len()]);
        let others = others.into_iter().filter(|other| *other != row.court);
        let others = others.flat_map(|other| examples(&picture, other, None, camera));
        let own = if matches!(truth, Truth::Unknown) { vec![] } else { examples(&picture, &row.court, camera, None) };
        own.into_iter().chain(others).collect::<Vec<Example>>()
    };
    rows.par_iter().enumerate().flat_map(of).collect()
}

/// Weights of a logistic regression, by Newton's method.
fn fitted(examples: &[Example]) -> SVector<f64, COURT_FEATURES> {
    let mut weights = SVector::<f64, COURT_FEATURES>::zeros();
    for _ in 0..NEWTON_STEPS {
        let mut hessian = SMatrix::<f64, COURT_FEATURES, COURT_FEATURES>::identity() * RIDGE;
        let mut gradient = weights * -RIDGE;
        for Example { row, is_right, weight } in examples {
            let probability = 1.0 / (1.0 + (-weights.dot(row)).exp());
            gradient += row * (weight * (f64::from(u8::from(*is_right)) - probability));
            hessian += row * row.transpose() * (weight * probability * (1.0 - probability));
        }
        weights += hessian.cholesky().expect("a prior").solve(&gradient);
    }
    weights
}

fn fit(folders: &[String]) {
    let mut examples = all_examples(folders);
    let total = |right: bool| examples.iter().filter(|it| it.is_right == right).map(|it| it.weight).sum::<f64>();
    let totals = [total(false), total(true)];
    examples.iter_mut().for_each(|it| it.weight *= (totals[0] + totals[1]) / 2.0 / totals[usize::from(it.is_right)]);
    let weights = fitted(&examples);
    let list = |values: SVector<f64, COURT_FEATURES>| {
        values.iter().map(|value| format!("{value:.2}")).collect::<Vec<_>>().join(", ")
    };
    println!("LOG_ODDS: [{}]", list(weights));
    let right = || examples.iter().filter(|it| it.is_right);
    let mean = right().map(|it| it.row * it.weight).sum::<SVector<f64, COURT_FEATURES>>()
        / right().map(|it| it.weight).sum::<f64>();
    println!("GOOD: [{}]", list(mean));
    println!("{} right and {} wrong cameras", right().count(), examples.len() - right().count());
    for least in [0.5, 0.9, 0.95, 0.99] {
        let reaches = |it: &&Example| weights.dot(&it.row) >= f64::ln(least / (1.0 - least));
        let share = |right: bool| {
            let all = || examples.iter().filter(|it| it.is_right == right);
            100.0 * all().filter(reaches).count() as f64 / all().count().max(1) as f64
        };
        println!(
            "probability ≥ {least}: {:.1} % of the right ones, {:.2} % of the wrong ones",
            share(true),
            share(false)
        );
    }
}

pub fn run(arguments: &[String]) {
    if let [what, folders @ ..] = arguments
        && what == "fit"
        && !folders.is_empty()
    {
        return fit(folders);
    }
    let Some(folder) = arguments.first().map(Path::new) else {
        println!("usage: cargo bench --bench all -- courts FOLDER | courts fit FOLDER …");
        return;
    };
    let mut rows = csv::Reader::from_path(folder.join("courts.csv")).expect("courts.csv");
    let mut by_court = BTreeMap::<String, Vec<Outcome>>::new();
    println!("verdict    found    refined  lines  seconds  picture");
    for row in rows.deserialize() {
        let Row { file, court, points } = row.expect("a row");
        let picture = Picture::decode(&std::fs::read(folder.join(&file)).expect("a picture")).expect("a picture");
        let start = Instant::now();
        let found = find_court(&picture, &court).expect("a court whose lines are known");
        let seconds = start.elapsed().as_secs_f64();
        let outcome = Outcome::of(&found, &picture, Truth::read(folder, &points), &court, seconds);
        println!("{}", outcome.line(&format!("{file} ({court})"), &found.reason));
        by_court.entry(court).or_default().push(outcome);
    }
    print_known(&by_court);
    print_verdicts("courts in view, whose camera is not known", &by_court, |truth| matches!(truth, Truth::Unknown));
    print_verdicts("pictures without the court", &by_court, |truth| matches!(truth, Truth::NoCourt));
}
