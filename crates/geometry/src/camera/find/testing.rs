//! What this folder's tests share: random views, and pictures of courts drawn from them.

use image::{Rgb, RgbImage};
use nalgebra::{Matrix3, Point2, Vector2, Vector3};
use rand::RngExt;

use super::model::CourtModel;
use super::view::View;
use crate::camera::CourtLine;
use crate::random::{Random, normal_pair};

/// Size of the drawn pictures, px.
pub(super) const WIDTH: f64 = 800.0;
pub(super) const HEIGHT: f64 = 450.0;
/// Rays a pixel, along each side.
const RAYS: u32 = 3;

/// A view of a court of a size and at a height, m, about so large that it fills the picture's width; focal lengths in widths, elevations in degrees.
pub(super) fn view_of([size, height]: [f64; 2], focal: [f64; 2], elevation: [f64; 2], random: &mut Random) -> View {
    let mut between = |[least, most]: [f64; 2]| least + (most - least) * random.random_range(0.0..1.0);
    let focal = (between(focal.map(f64::ln))).exp();
    let elevation = between(elevation).to_radians();
    let azimuth = between([0.0, std::f64::consts::TAU]);
    let distance = size * (focal * between([1.0, 1.4])).max(0.8);
    let level = Vector3::new(azimuth.sin(), -azimuth.cos(), 0.0);
    let place = (level * elevation.cos() + Vector3::z() * elevation.sin()) * distance + Vector3::z() * height;
    let target = Vector3::new(between([-0.1, 0.1]), between([-0.1, 0.1]), 0.0) * size + Vector3::z() * height;
    let forward = (target - place).normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    let rotation = Matrix3::from_rows(&[right.transpose(), forward.cross(&right).transpose(), forward.transpose()]);
    let centre = Vector2::new(WIDTH - 1.0, HEIGHT - 1.0) / 2.0;
    View { focal: focal * WIDTH, centre, rotation, translation: -rotation * place }
}

/// A view of a tennis court, as cameras from wide angle to telephoto see it.
pub(super) fn random_view(random: &mut Random) -> View {
    view_of([23.77, 0.0], [0.5, 8.0], [5.0, 50.0], random)
}

fn is_painted(line: &CourtLine, [x, y]: [f64; 2]) -> bool {
    let along = Vector2::new(line.to[0] - line.from[0], line.to[1] - line.from[1]);
    let off = Vector2::new(x - line.from[0], y - line.from[1]);
    let fraction = off.dot(&along) / along.norm_squared();
    let within = match line.paint {
        Some(paint) => (0.0..=line.width).contains(&off.dot(&Vector2::new(paint[0], paint[1]))),
        None => off.perp(&along).abs() / along.norm() <= line.width / 2.0,
    };
    (0.0..=1.0).contains(&fraction) && within
}

/// An upright line that lies flat, at the same place.
fn lying(line: &CourtLine) -> CourtLine {
    CourtLine { paint: None, ..line.clone() }
}

/// The images of the corners of a line's paint, in order around it.
fn strip(line: &CourtLine, view: &View) -> Option<[Point2<f64>; 4]> {
    let ([a, b], [d, c]) = (line.edges(0.0)?, line.edges(1.0)?);
    Some([view.image(&a)?, view.image(&b)?, view.image(&c)?, view.image(&d)?])
}

fn is_within(corners: &[Point2<f64>; 4], at: Point2<f64>) -> bool {
    let side = |index: usize| (corners[(index + 1) % 4] - corners[index]).perp(&(at - corners[index])) > 0.0;
    (1..4).all(|index| side(index) == side(0))
}

/// The picture of a court's paint that a view shows, with texture, noise and blur; a table has its net's tape and stands on a floor.
pub(super) fn drawn(
    model: &CourtModel,
    view: &View,
    ground: [f64; 3],
    paint: [f64; 3],
    random: &mut Random,
) -> RgbImage {
    let eye = view.place();
    let (flat, tape): (Vec<&CourtLine>, Vec<&CourtLine>) =
        model.painted.iter().partition(|line| line.from[2] == model.height);
    let tape: Vec<[Point2<f64>; 4]> =
        tape.into_iter().flat_map(|line| [strip(line, view), strip(&lying(line), view)]).flatten().collect();
    // Its paint is 2 cm wide and ends at the table's edges.
    let reach = [model.crossings[0][0], model.crossings[1][0]].map(|edge| edge.abs() + 0.01);
    let mut picture = RgbImage::new(WIDTH as u32, HEIGHT as u32);
    for (column, row, pixel) in picture.enumerate_pixels_mut() {
        let (mut share, mut floor) = (0.0, 0.0);
        for ray in 0..RAYS * RAYS {
            let part = |index: u32| (f64::from(index) + 0.5) / f64::from(RAYS) - 0.5;
            let image = Point2::new(f64::from(column) + part(ray % RAYS), f64::from(row) + part(ray / RAYS));
            let way = view.rotation.transpose() * ((image.coords - view.centre) / view.focal).push(1.0);
            let at = eye + way * ((model.height - eye.z) / way.z);
            let is_on_tape = tape.iter().any(|strip| is_within(strip, image));
            let is_there = way.z < 0.0;
            let is_paint = is_there && flat.iter().any(|line| is_painted(line, [at.x, at.y]));
            let is_floor = model.height > 0.0 && !(is_there && at.x.abs() < reach[0] && at.y.abs() < reach[1]);
            share += f64::from(u8::from(is_on_tape || is_paint)) / f64::from(RAYS * RAYS);
            floor += f64::from(u8::from(is_floor)) / f64::from(RAYS * RAYS);
        }
        let texture = 6.0 * (f64::from(column) / 37.0).sin() * (f64::from(row) / 23.0).cos();
        *pixel = Rgb(std::array::from_fn(|channel| {
            let [noise, _] = normal_pair::<f64>(random);
            let ground = ground[channel] + 15.0 * floor + texture;
            (ground + share * (paint[channel] - ground) + 3.0 * noise).clamp(0.0, 255.0) as u8
        }));
    }
    image::imageops::blur(&picture, 0.6)
}
