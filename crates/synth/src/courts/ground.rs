//! What a floor has besides its lines: planks or tiles, edges of shadows, reflections of lamps.

use nalgebra::Point3;
use rand::RngExt;

use super::super::footage::easel::Easel;
use super::super::random::canvas::{Canvas, PaintColour};
use super::piece::Piece;
use gravisight_geometry::camera::Camera;
use gravisight_geometry::error::Result;
use gravisight_geometry::random::{Random, mixed};

/// Width and length of planks and tiles, m: strips of parquet, boards, bathroom to paving tiles.
const PLANK: [[f64; 2]; 2] = [[0.06, 0.2], [0.5, 2.5]];
const TILE: [f64; 2] = [0.15, 1.0];
/// Width of a joint, m, and how much of the light it takes.
const JOINT: [f64; 2] = [0.002, 0.012];
const JOINT_OPACITY: [f32; 2] = [0.1, 0.7];
/// By how much planks or tiles differ in brightness.
const UNEQUAL: [f32; 2] = [0.0, 0.12];
/// Edges of shadows on a ground, and what they leave of the light: of a thin roof or net, and of a building in full sun.
const MOST_SHADOWS: u32 = 4;
const SHADED: [f32; 2] = [0.45, 0.85];
/// Width of a shadow, m: a mast's to a stand's; and of its blurred edge.
const SHADOW_WIDTH: [f64; 2] = [0.1, 12.0];
const SHADOW_EDGE: [f64; 2] = [0.02, 0.5];
/// Reflections of lamps: how many, their radius across the view, m, how much longer they are along it, how bright.
const MOST_LAMPS: u32 = 8;
const LAMP: [f64; 2] = [0.1, 0.7];
const LAMP_LONGER: [f64; 2] = [1.5, 6.0];
const LAMP_OPACITY: [f32; 2] = [0.1, 0.7];
/// How many radii a reflection reaches: beyond, less than a thousandth of it is left.
const LAMP_REACH: f64 = 2.7;
/// Their colour: of lamps and of windows, as fractions of full scale.
const LAMP_COLOUR: PaintColour = [0.97, 0.97, 0.94];

/// Joints between planks or tiles.
#[derive(Debug, Clone)]
pub struct Joints {
    /// Width and length of a plank, m.
    size: [f64; 2],
    /// Whether rows are shifted against one another, as planks are.
    is_shifted: bool,
    turned: bool,
    width: f64,
    opacity: f32,
    unequal: f32,
    seed: u64,
}

/// A band of shade on the ground: where `start < a·x + b·y < end`, with edges of a width; m.
#[derive(Debug, Clone)]
struct Shadow {
    normal: [f64; 2],
    from: f64,
    to: f64,
    edge: f64,
    left: f32,
}

/// A floor's look.
#[derive(Debug, Clone, Default)]
pub struct Ground {
    joints: Option<Joints>,
    shadows: Vec<Shadow>,
    lamps: u32,
}

fn between<T: rand::distr::uniform::SampleUniform + PartialOrd>([least, most]: [T; 2], random: &mut Random) -> T {
    random.random_range(least..most)
}

impl Joints {
    fn draw(random: &mut Random) -> Self {
        let is_wood = random.random_bool(0.6);
        let tile = between(TILE, random);
        let plank = PLANK.map(|range| between(range, random));
        Self {
            size: if is_wood { plank } else { [tile; 2] },
            is_shifted: is_wood,
            turned: random.random_bool(0.5),
            width: between(JOINT, random),
            opacity: between(JOINT_OPACITY, random),
            unequal: between(UNEQUAL, random),
            seed: random.random_range(0..u64::MAX),
        }
    }

    /// What is left of the light at a place of the floor, of which a pixel covers `pixel`, m.
    fn light(&self, at: [f64; 2], pixel: [f64; 2]) -> f32 {
        let turn = |of: [f64; 2]| if self.turned { [of[1], of[0]] } else { of };
        let ([across, along], pixel) = (turn(at), turn(pixel));
        let row = (across / self.size[0]).floor();
        let hash = |a: f64, b: f64| mixed(self.seed, a as i64 as u64, b as i64 as u64) as f64 / u64::MAX as f64;
        let along = along + if self.is_shifted { hash(row, 0.0) * self.size[1] } else { 0.0 };
        let tile = (along / self.size[1]).floor();
        let mut light = 1.0;
        for (place, size, pixel) in [(across, self.size[0], pixel[0]), (along, self.size[1], pixel[1])] {
            // Joints that are closer together than pixels darken all alike.
            let near = (place / size - (place / size).round()).abs() * size;
            let cover = ((0.5 * (self.width + pixel) - near) / pixel).clamp(0.0, (self.width / pixel).min(1.0));
            let cover = if pixel > size { self.width / size } else { cover };
            light *= 1.0 - self.opacity * cover as f32;
        }
        let fades = (self.size[0] / pixel[0]).min(1.0) as f32;
        light * (1.0 - self.unequal * fades * hash(row, tile + 1.0) as f32)
    }
}

impl Ground {
    /// A ground in a hall or outside, `room` half its size, m.
    pub fn draw(is_hall: bool, room: [f64; 2], random: &mut Random) -> Self {
        let joints = random.random_bool(if is_hall { 0.5 } else { 0.1 }).then(|| Joints::draw(random));
        let is_lit = random.random_bool(if is_hall { 0.15 } else { 0.45 });
        let shadows = if is_lit { random.random_range(1..=MOST_SHADOWS) } else { 0 };
        let lamps = is_hall && random.random_bool(0.5);
        Self {
            joints,
            shadows: (0..shadows).map(|_| Shadow::draw(room, random)).collect(),
            lamps: if lamps { random.random_range(1..=MOST_LAMPS) } else { 0 },
        }
    }

    /// A floor of planks or tiles, whose joints may be mistaken for lines.
    pub fn jointed(is_hall: bool, room: [f64; 2], random: &mut Random) -> Self {
        Self { joints: Some(Joints::draw(random)), ..Self::draw(is_hall, room, random) }
    }

    /// Lays planks or tiles over a floor, half as large as `room`, m.
    ///
    /// # Errors
    /// As [`Piece::paint`].
    pub fn paint_joints(&self, canvas: &mut Canvas, camera: &Camera, room: [f64; 2]) -> Result<()> {
        let Some(joints) = &self.joints else { return Ok(()) };
        Piece::floor(room).paint(canvas, camera, |spot| ([0.0; 3], 1.0 - joints.light(spot.at, spot.pixel)))
    }

    /// Lays shadows over all that is painted on a floor, and reflections.
    ///
    /// # Errors
    /// As [`Piece::paint`].
    pub fn paint_light(&self, easel: &mut Easel, room: [f64; 2], random: &mut Random) -> Result<()> {
        let light =
            |[x, y]: [f64; 2]| self.shadows.iter().map(|shadow| shadow.light([x - room[0], y - room[1]])).product();
        if !self.shadows.is_empty() {
            let camera = easel.camera;
            Piece::floor(room).paint(&mut easel.canvas, camera, |spot| {
                let left: f32 = light(spot.at);
                ([0.0; 3], 1.0 - left)
            })?;
        }
        (0..self.lamps).try_for_each(|_| reflection(easel, room, random))
    }
}

impl Shadow {
    fn draw(room: [f64; 2], random: &mut Random) -> Self {
        let (sin, cos) = random.random_range(0.0..std::f64::consts::TAU).sin_cos();
        let from = random.random_range(-1.0..1.0) * room[0].max(room[1]);
        let width = between(SHADOW_WIDTH.map(f64::ln), random).exp();
        Self {
            normal: [cos, sin],
            from,
            to: from + width,
            edge: between(SHADOW_EDGE, random),
            left: between(SHADED, random),
        }
    }

    /// What is left of the light at a place, m.
    fn light(&self, [x, y]: [f64; 2]) -> f32 {
        let at = self.normal[0] * x + self.normal[1] * y;
        let within = (at - self.from).min(self.to - at) / self.edge + 0.5;
        1.0 - (1.0 - self.left) * within.clamp(0.0, 1.0) as f32
    }
}

/// Lays the reflection of a lamp over a floor, m: a streak towards the camera.
fn reflection(easel: &mut Easel, room: [f64; 2], random: &mut Random) -> Result<()> {
    let at = room.map(|half| random.random_range(0.0..2.0 * half));
    let (radius, longer) = (between(LAMP, random), between(LAMP_LONGER, random));
    let opacity = between(LAMP_OPACITY, random);
    let camera = easel.camera;
    let eye = camera.world_from_camera(&Point3::origin());
    let [x, y] = [eye.x + room[0] - at[0], eye.y + room[1] - at[1]];
    let away = x.hypot(y).max(f64::MIN_POSITIVE);
    let view = [x / away, y / away];
    Piece::floor(room).paint(&mut easel.canvas, camera, |spot| {
        let [dx, dy] = [spot.at[0] - at[0], spot.at[1] - at[1]];
        let along = (dx * view[0] + dy * view[1]) / (radius * longer);
        let across = (dx * view[1] - dy * view[0]) / radius;
        let squared = along * along + across * across;
        let left = if squared < LAMP_REACH * LAMP_REACH { (-squared).exp() as f32 } else { 0.0 };
        (LAMP_COLOUR, opacity * left)
    })
}
