//! Where people put cameras to film a court, and which cameras.

use nalgebra::{Point3, Rotation3, Vector3};
use rand::RngExt;

use super::super::looking;
use super::lens;
use gravisight_geometry::camera::{Camera, Distortion};
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::random::{Random, normal_pair};
use gravisight_geometry::size::Size;

/// Sizes of pictures, px: of phones, broadcasts, streams and old cameras.
const SIZES: [[u32; 2]; 8] =
    [[640, 360], [854, 480], [960, 540], [1280, 720], [1280, 720], [1920, 1080], [1920, 1080], [1024, 768]];
/// Sizes of pictures of a phone that stands upright, px.
const UPRIGHT: [[u32; 2]; 3] = [[540, 960], [720, 1280], [1080, 1920]];
/// Cameras that are tried until one sees the court.
const TRIES: usize = 500;
/// How much of the picture's width the court fills where it can: a fraction of the width, more than 1 where part is out of view.
const FILLED: [f64; 2] = [0.45, 1.25];
/// Distance from the court's edge to the camera as a fraction of half the court's depth: people stand behind the lines, on the run-off.
const BESIDE: [f64; 2] = [0.1, 0.7];
/// The same in metres, at least: a camera beside a table still needs room for its operator.
const LEAST_BESIDE: f64 = 0.8;
/// Largest distance as a multiple of the court's length: the far end of a stadium.
const FARTHEST: f64 = 3.5;
/// Least and largest slope of the way down to the court's middle: below 4° lines merge; above 50° only drones film.
const SLOPES: [f64; 2] = [0.07, 1.2];
/// 1-σ of where the camera aims, as a fraction of half the court's width and length.
const AIM: f64 = 0.22;
/// How far above the court's surface it aims at most, m: at people's middles.
const ABOVE: f64 = 1.0;
/// 1-σ and limit of the roll, degrees: hand-held and hastily mounted.
const ROLL: [f64; 2] = [1.5, 5.0];
/// Least fraction of a grid over the court that is in view, and points of that grid along a side.
const IN_VIEW: f64 = 0.35;
const GRID: u32 = 9;
/// Least width and height of that part, as fractions of the picture's: less is a court in the distance that nobody calibrates by.
const LEAST: [f64; 2] = [0.3, 0.12];
/// Strength of a lens as a fraction of the bend at which the picture's corner would fold over: hardly visible, to action cameras.
const BENT: [f64; 2] = [0.03, 0.8];
/// The same above a focal length of [`LONG`] picture widths: long lenses hardly bend.
const BENT_LONG: [f64; 2] = [0.02, 0.15];
const LONG: f64 = 1.0;

/// A way to film.
struct Way {
    /// How often, of all [`WAYS`].
    often: f64,
    /// Direction from the court's middle, degrees from its length.
    turn: [f64; 2],
    /// Above the floor, m.
    height: [f64; 2],
    /// Focal length in the picture's longer sides.
    focal: [f64; 2],
    /// How often the lens bends; over all ways a third.
    bent: f64,
    is_upright: bool,
}

/// Behind an end, from a corner, from the side, from a gantry, with a phone that stands upright, by a security camera.
const WAYS: [Way; 6] = [
    Way { often: 0.25, turn: [0.0, 12.0], height: [1.3, 6.0], focal: [0.5, 5.0], bent: 0.25, is_upright: false },
    Way { often: 0.15, turn: [25.0, 65.0], height: [1.3, 6.0], focal: [0.5, 5.0], bent: 0.25, is_upright: false },
    Way { often: 0.15, turn: [75.0, 90.0], height: [1.3, 8.0], focal: [0.5, 5.0], bent: 0.25, is_upright: false },
    Way { often: 0.2, turn: [0.0, 90.0], height: [5.0, 14.0], focal: [0.5, 5.0], bent: 0.25, is_upright: false },
    Way { often: 0.1, turn: [0.0, 40.0], height: [1.2, 3.0], focal: [0.5, 1.5], bent: 0.25, is_upright: true },
    Way { often: 0.15, turn: [0.0, 90.0], height: [2.5, 6.0], focal: [0.5, 0.9], bent: 0.8, is_upright: false },
];

fn between([least, most]: [f64; 2], random: &mut Random) -> f64 {
    random.random_range(least..most)
}

fn logarithmic([least, most]: [f64; 2], random: &mut Random) -> f64 {
    between([least.ln(), most.ln()], random).exp()
}

/// A camera that films a court of half the size `half`, m, at a height, m.
///
/// # Errors
/// [`Error::Data`] where none is found.
pub fn draw(half: [f64; 2], height: f64, random: &mut Random) -> Result<Camera> {
    let way = way(random);
    let is_bent = random.random_bool(way.bent);
    for _ in 0..TRIES {
        let camera = candidate(way, is_bent, (half, height), random)?;
        if sees(&camera, half, height) && lens::without(&camera).is_ok() {
            return Ok(camera);
        }
    }
    let reason = format!("none of {TRIES} random cameras sees the court; choose another seed");
    Err(Error::Data { what: "court".into(), reason })
}

fn way(random: &mut Random) -> &'static Way {
    let mut left = random.random_range(0.0..WAYS.iter().map(|way| way.often).sum());
    for way in &WAYS {
        left -= way.often;
        if left < 0.0 {
            return way;
        }
    }
    &WAYS[0]
}

/// A random camera of a way to film, of a court of half a size and at a height, m.
fn candidate(way: &Way, is_bent: bool, (half, height): ([f64; 2], f64), random: &mut Random) -> Result<Camera> {
    let [wide, long] = half;
    let sizes: &[[u32; 2]] = if way.is_upright { &UPRIGHT } else { &SIZES };
    let [width, tall] = sizes[random.random_range(0..sizes.len())];
    let longer = f64::from(width.max(tall));
    let focal = logarithmic(way.focal, random);
    let distortion = if is_bent { bent(focal, [width, tall], random) } else { 0.0 };
    let end = if random.random_bool(0.5) { 0.0 } else { std::f64::consts::PI };
    let side = if random.random_bool(0.5) { 1.0 } else { -1.0 };
    let (sin, cos) = (end + side * between(way.turn, random).to_radians()).sin_cos();
    let across = 2.0 * (wide * cos.abs() + long * sin.abs());
    let deep = wide * sin.abs() + long * cos.abs();
    let wanted = across * focal * longer / f64::from(width) / between(FILLED, random);
    let farthest = FARTHEST * 2.0 * wide.max(long) * between([0.6, 1.0], random);
    let beside = (deep * between(BESIDE, random)).max(LEAST_BESIDE);
    let distance = wanted.min(farthest).max(deep + beside);
    let mut above = between(way.height, random) - height;
    let [flattest, steepest] = SLOPES;
    if above < flattest * distance {
        above = logarithmic([flattest, 3.0 * flattest], random) * distance;
    } else if above > steepest * distance {
        above = between([0.5 * steepest, steepest], random) * distance;
    }
    let eye = Vector3::new(distance * sin, -distance * cos, height + above);
    let [x, y] = normal_pair::<f64>(random).map(|normal| AIM * normal.clamp(-2.5, 2.5));
    let target = Vector3::new(x * wide, y * long, height + random.random_range(0.0..ABOVE));
    let size = Size::new(width, tall);
    let distortion = Distortion { k1: distortion, ..Distortion::default() };
    let camera = looking(eye, (target - eye).normalize(), focal * longer, size, distortion)?;
    let [roll, _] = normal_pair::<f64>(random).map(|normal| (ROLL[0] * normal).clamp(-ROLL[1], ROLL[1]));
    Ok(camera.turned(&Rotation3::from_axis_angle(&Vector3::z_axis(), roll.to_radians())))
}

/// The coefficient k1 of a random lens. A radius r (in longer sides) is seen at r − b·r³; that is at most 2/3 of the radius of the fold,
/// 1/√(3b), so the corner at R is seen while b < 4/(27·R²).
fn bent(focal: f64, [width, tall]: [u32; 2], random: &mut Random) -> f64 {
    let corner = 0.5 * f64::from(width).hypot(f64::from(tall)) / f64::from(width.max(tall));
    let strength = logarithmic(if focal > LONG { BENT_LONG } else { BENT }, random);
    // In focal lengths instead of sides.
    -strength * 4.0 / (27.0 * corner.powi(2)) * focal.powi(2)
}

/// Whether enough of a court is in view.
fn sees(camera: &Camera, half: [f64; 2], height: f64) -> bool {
    let [width, tall] = camera.size().xy();
    let at = |index: u32| 2.0 * f64::from(index) / f64::from(GRID - 1) - 1.0;
    let grid =
        (0..GRID * GRID).map(|index| Point3::new(half[0] * at(index % GRID), half[1] * at(index / GRID), height));
    let seen: Vec<_> = grid
        .filter_map(|point| camera.image_from_world(&point).ok())
        .filter(|at| (0.0..width).contains(&at.x) && (0.0..tall).contains(&at.y))
        .collect();
    let range = |axis: usize| {
        let most = seen.iter().map(|at| at[axis]).fold(f64::NEG_INFINITY, f64::max);
        most - seen.iter().map(|at| at[axis]).fold(f64::INFINITY, f64::min)
    };
    seen.len() as f64 >= IN_VIEW * f64::from(GRID * GRID) && range(0) >= LEAST[0] * width && range(1) >= LEAST[1] * tall
}
