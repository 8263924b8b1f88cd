//! What a fit found, as one HTML file that needs nothing else.

use std::path::Path;

use gravisight::internal::write_whole;
use gravisight::parts::{Cuboid, FittedFrame, Flight};
use gravisight::{Camera, Findings, Fit, Observation, Result, Scene};
use nalgebra::Point3;

use super::plots::{self, ACCENT, Axis, FOUND, Mark, OTHER, QUIET, TRUTH};
use super::{cm, findings, html};

/// Lines from a point to a point of a box's corners, by the corners' signs.
const EDGES: [[usize; 2]; 12] =
    [[0, 1], [1, 3], [3, 2], [2, 0], [4, 5], [5, 7], [7, 6], [6, 4], [0, 4], [1, 5], [2, 6], [3, 7]];

/// A fit and what it is a fit of.
pub struct Flights<'a> {
    /// The camera that saw it.
    pub camera: &'a Camera,
    /// Where.
    pub scene: &'a Scene,
    /// What was seen.
    pub observations: &'a [Observation],
    /// What was made of it.
    pub fit: &'a Fit,
}

/// Writes the page of what is called `name` to `path`, whole: what was found, in words and numbers, each fit of its track, and what
/// else there is to show (HTML) before the fits' details and after them.
///
/// # Errors
/// [`gravisight::Error::Io`] for a file that cannot be written.
pub fn write(
    path: &Path,
    name: &str,
    findings: &Findings,
    all: &[Flights<'_>],
    [before, after]: [&str; 2],
) -> Result<()> {
    let mut body = findings::head(name, findings) + "<main>\n";
    body += &findings::remarks(findings);
    body += &findings::contacts(findings);
    body += &findings::flights(findings);
    body += before;
    for (number, flights) in all.iter().enumerate() {
        if all.len() > 1 {
            let [from, to] = [flights.observations.first(), flights.observations.last()]
                .map(|seen| seen.map_or(0.0, |seen| seen.time));
            body += &html::text("h2", &format!("Segment {}: {from:.2} to {to:.2} s", number + 1));
        }
        body += &segment(flights)?;
    }
    body += after;
    body += "</main>\n";
    write_whole(path, html::page(name, &body).as_bytes())
}

fn segment(flights: &Flights<'_>) -> Result<String> {
    let mut body =
        html::section("In metres", "How well the labels and the laws of motion agree.", &html::tiles(&tiles(flights)));
    body +=
        &html::section("The ball's path", "In the world's frame: metres, z up.", &html::row("", &in_space(flights)?));
    body +=
        &html::section("Labels and trajectory", "In the picture: pixels.", &html::row("", &in_the_picture(flights)?));
    Ok(body)
}

/// Of what is not explained no number is shown as one that is known.
fn tiles(flights: &Flights<'_>) -> Vec<[String; 3]> {
    let fit = flights.fit;
    let sigmas = fit.known_sigmas(flights.camera);
    let position = match sigmas.get(sigmas.len() / 2) {
        Some(&median) => {
            [format!("{} cm", cm(median)), format!("median of the {} frames with a known position", sigmas.len())]
        }
        None => ["not known".into(), "no flight is explained".into()],
    };
    let fastest = fit.flights.iter().filter_map(Flight::known_speed).max_by(|a, b| a[0].total_cmp(&b[0]));
    let fastest = match fastest {
        Some([speed, sigma]) => [format!("{speed:.1} m/s"), format!("± {sigma:.1} m/s")],
        None => ["not known".into(), "no flight is explained".into()],
    };
    let explained = fit.flights.iter().filter(|flight| flight.explained).count();
    let outliers = fit.frames.iter().filter(|frame| frame.outlier).count();
    let tile = |name: &str, [value, about]: [String; 2]| [name.into(), value, about];
    vec![
        tile("Position, 1-σ", position),
        tile("Highest initial speed", fastest),
        [
            "Flights explained".into(),
            format!("{explained} of {}", fit.flights.len()),
            format!("{} hits, {} bounces", fit.hits.len(), fit.impacts.len()),
        ],
        [
            "Residuals".into(),
            format!("{:.2} px", fit.rms_px),
            format!("labels' noise {:.2} px, {outliers} outliers", fit.noise_px),
        ],
    ]
}

/// The edges of the scene's boxes.
fn edges(scene: &Scene) -> Vec<Vec<Point3<f64>>> {
    let of = |cuboid: &Cuboid| {
        let turn = cuboid.world_from_box();
        let corner = |index: usize| {
            let sign = |bit: usize| if index & bit == 0 { -1.0 } else { 1.0 };
            let [x, y, z] = cuboid.half_size;
            Point3::from(cuboid.position) + turn * nalgebra::Vector3::new(sign(1) * x, sign(2) * y, sign(4) * z)
        };
        EDGES.map(|[from, to]| vec![corner(from), corner(to)])
    };
    scene.boxes.iter().flat_map(of).collect()
}

/// What is painted on the ground, and the net's upper edge.
fn scene_lines(scene: &Scene) -> Vec<Vec<Point3<f64>>> {
    let lines = scene.lines.iter().map(|line| line.map(Point3::from).to_vec());
    lines
        .chain([scene.net.iter().copied().map(Point3::from).collect()])
        .filter(|line: &Vec<_>| line.len() > 1)
        .collect()
}

/// The frames whose positions are drawn: those of explained flights; all where no flight is.
fn shown(fit: &Fit) -> Vec<&FittedFrame> {
    let explained: Vec<&FittedFrame> = fit.frames.iter().filter(|frame| frame.explained).collect();
    if explained.is_empty() { fit.frames.iter().collect() } else { explained }
}

fn in_space(flights: &Flights<'_>) -> Result<Vec<String>> {
    let fit = flights.fit;
    let frames = shown(fit);
    let way: Vec<Point3<f64>> = frames.iter().map(|frame| frame.world).collect();
    let boxes = edges(flights.scene);
    let mut paths: Vec<plots::PlottedPath<'_>> =
        boxes.iter().map(|edge| plots::PlottedPath { points: edge, colour: QUIET, shadow: false }).collect();
    let lines: Vec<Vec<Point3<f64>>> = scene_lines(flights.scene);
    paths.extend(lines.iter().map(|line| plots::PlottedPath { points: line, colour: QUIET, shadow: false }));
    paths.push(plots::PlottedPath { points: &way, colour: FOUND, shadow: true });
    let space = plots::space(&paths)?;
    let caption = match (fit.explained, frames.len() < fit.frames.len()) {
        (true, _) => "In space, with its shadow on the ground",
        (false, true) => "In space, with its shadow on the ground; flights that are not explained are left out",
        (false, false) => "Doubtful because no flight is explained: in space, with its shadow on the ground",
    };
    let mut cards = vec![html::figure(&space, caption, &[("found", "the ball")])];
    for (axis, label) in ["x, m", "y, m", "z, m"].into_iter().enumerate() {
        let at = |sigmas: f64| -> Vec<(f64, f64)> {
            let value = |frame: &&FittedFrame| {
                (frame.time, frame.world[axis] + sigmas * frame.covariance[(axis, axis)].max(0.0).sqrt())
            };
            frames.iter().map(value).collect()
        };
        let (low, middle, high) = (at(-1.0), at(0.0), at(1.0));
        let x = Axis::around("time, s", middle.iter().map(|point| point.0));
        let y = Axis::around(label, low.iter().chain(&high).map(|point| point.1));
        let marks = [Mark::Line(low, OTHER), Mark::Line(high, OTHER), Mark::Line(middle, FOUND)];
        let keys = [("found", "the ball"), ("other", "± 1-σ")];
        cards.push(html::figure(&plots::chart(&x, &y, &marks)?, &format!("{} over time", &label[..1]), &keys));
    }
    Ok(cards)
}

fn in_the_picture(flights: &Flights<'_>) -> Result<Vec<String>> {
    let fit = flights.fit;
    let seen = || flights.observations.iter().zip(&fit.frames).filter_map(|(seen, frame)| Some((seen.image?, frame)));
    let image = |frame: &FittedFrame| flights.camera.image_from_world(&frame.world).ok();
    let way: Vec<(f64, f64)> = fit.frames.iter().filter_map(image).map(|at| (at.x, at.y)).collect();
    let labels: Vec<(f64, f64)> = seen().map(|(at, _)| (at.x, at.y)).collect();
    let outliers: Vec<(f64, f64)> = seen().filter(|(_, frame)| frame.outlier).map(|(at, _)| (at.x, at.y)).collect();
    let size = flights.camera.size();
    let x = Axis::new("x, px", 0.0..f64::from(size.width));
    // Rows count downwards.
    let y = Axis::new("y, px", f64::from(size.height)..0.0);
    let marks = [Mark::Dots(labels, TRUTH), Mark::Dots(outliers, OTHER), Mark::Line(way, FOUND)];
    let keys = [("truth", "labels"), ("other", "outliers"), ("found", "the projected trajectory")];
    let mut cards = vec![html::figure(&plots::chart(&x, &y, &marks)?, "Labels and projected trajectory", &keys)];
    let residual = |axis: usize| -> Vec<(f64, f64)> {
        let of = |frame: &FittedFrame| Some((frame.time, frame.residual_px.filter(|_| !frame.outlier)?[axis]));
        fit.frames.iter().filter_map(of).collect()
    };
    let (across, down) = (residual(0), residual(1));
    let x = Axis::around("time, s", fit.frames.iter().map(|frame| frame.time));
    let y = Axis::around("residual, px", across.iter().chain(&down).map(|point| point.1));
    let marks = [Mark::Dots(across, ACCENT), Mark::Dots(down, OTHER)];
    let keys = [("accent", "across"), ("other", "down")];
    cards.push(html::figure(&plots::chart(&x, &y, &marks)?, "Residuals, outliers left out", &keys));
    Ok(cards)
}
