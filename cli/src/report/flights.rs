//! What a fit found, as one HTML file that needs nothing else.

use std::path::Path;

use gravisight::internal::write_whole;
use gravisight::parts::{Cuboid, FittedFrame, FittedImpact, Flight, Hit};
use gravisight::{Camera, Fit, Observation, Result, Scene};
use nalgebra::Point3;

use super::plots::{self, ACCENT, Axis, FOUND, Mark, OTHER, QUIET, TRUTH};
use super::{cm, html};

/// Of what belongs to a flight that is not explained.
const NOT_KNOWN: &str = "not known";

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

/// Writes the page of what is called `name` to `path`, whole: the `verdict`, each fit of its track, and what else there is to
/// show (HTML). Without a fit the verdict says why.
///
/// # Errors
/// [`gravisight::Error::Io`] for a file that cannot be written.
pub fn write(path: &Path, name: &str, verdict: &str, all: &[Flights<'_>], more: &str) -> Result<()> {
    let mut body = format!("<header>\n{}{}</header>\n<main>\n", html::text("h1", name), html::text("p", verdict));
    for (number, flights) in all.iter().enumerate() {
        if all.len() > 1 {
            let [from, to] = [flights.observations.first(), flights.observations.last()]
                .map(|seen| seen.map_or(0.0, |seen| seen.time));
            body += &html::text("h2", &format!("{}: {from:.2} to {to:.2} s", number + 1));
            body += &html::text("p", &flights.fit.verdict);
        }
        body += &stretch(flights)?;
    }
    body += more;
    body += "</main>\n";
    write_whole(path, html::page(name, &body).as_bytes())
}

fn stretch(flights: &Flights<'_>) -> Result<String> {
    let fit = flights.fit;
    let mut body: String = fit.notes.iter().map(|note| html::text("p", note)).collect();
    body += &html::tiles(&tiles(flights));
    body +=
        &html::section("The ball's way", "In the world's frame: metres, z up.", &html::row("", &in_space(flights)?));
    body += &html::section("The track", "In the picture: pixels.", &html::row("", &in_the_picture(flights)?));
    body += &html::section("Flights", "From hit to hit; bounces are within.", &table_of_flights(fit));
    body += &html::section(
        "Contacts",
        "Bounces on what the scene holds, hits by what it does not. Doubtful ones belong to a flight that is not explained.",
        &table_of_contacts(fit),
    );
    Ok(body)
}

/// Of what is not explained no number is shown as one that is known.
fn tiles(flights: &Flights<'_>) -> Vec<[String; 3]> {
    let fit = flights.fit;
    let sigmas = fit.known_sigmas(flights.camera);
    let position = match sigmas.get(sigmas.len() / 2) {
        Some(&median) => {
            [format!("{} cm", cm(median)), format!("median of the {} frames in which it is known", sigmas.len())]
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
        tile("Fastest start", fastest),
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
        (false, false) => "Doubtful, for no flight is explained: in space, with its shadow on the ground",
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
    let keys = [("truth", "labels"), ("other", "outliers"), ("found", "the trajectory's picture")];
    let mut cards =
        vec![html::figure(&plots::chart(&x, &y, &marks)?, "What was seen, and what should have been", &keys)];
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

fn table_of_flights(fit: &Fit) -> String {
    let turns = |spin: [f64; 3]| spin.iter().map(|w| w * w).sum::<f64>().sqrt() / std::f64::consts::TAU;
    let row = |(index, flight): (usize, &Flight)| {
        vec![
            (index + 1).to_string(),
            format!("{:.3}", flight.start),
            format!("{:.3}", flight.end),
            flight.known_speed().map_or(NOT_KNOWN.into(), |[speed, sigma]| format!("{speed:.2} ± {sigma:.2}")),
            match flight.explained {
                true => format!("{:.0} ± {:.0}", turns(flight.spin), turns(flight.spin_sigma)),
                false => NOT_KNOWN.into(),
            },
            flight.reason.clone().unwrap_or_else(|| "yes".into()),
        ]
    };
    let rows: Vec<Vec<String>> = fit.flights.iter().enumerate().map(row).collect();
    html::table(&["Flight", "from, s", "to, s", "speed at its start, m/s", "spin, rev/s", "explained"], &rows)
}

fn table_of_contacts(fit: &Fit) -> String {
    let row = |time: f64, what: String, at: Point3<f64>, within: Option<f64>, explained: bool| {
        if !explained {
            let unknown = vec![NOT_KNOWN.into(); 3];
            return (
                time,
                [vec![format!("{what} (doubtful)"), format!("{time:.3}")], unknown, vec![String::new()]].concat(),
            );
        }
        let place = <[f64; 3]>::from(at).map(|value| format!("{value:.3}"));
        let within = within.map_or(String::new(), |fraction| format!("{:.1} %", 100.0 * fraction));
        (time, [vec![what, format!("{time:.3}")], place.to_vec(), vec![within]].concat())
    };
    let bounce = |it: &FittedImpact| row(it.time, it.surface.to_string(), it.world, it.within_lines, it.explained);
    let hit = |it: &Hit| row(it.time, "hit".into(), it.world, None, it.explained);
    let mut rows: Vec<(f64, Vec<String>)> = fit.impacts.iter().map(bounce).chain(fit.hits.iter().map(hit)).collect();
    rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    let rows: Vec<Vec<String>> = rows.into_iter().map(|(_, row)| row).collect();
    html::table(&["What", "time, s", "x, m", "y, m", "z, m", "within the lines"], &rows)
}
