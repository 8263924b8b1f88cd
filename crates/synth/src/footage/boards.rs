//! Advertising boards: printed ones, and screens whose letters move and change.

use nalgebra::{Point3, Vector3};
use rand::RngExt;

use super::super::random::canvas::{PaintColour, Polygon};
use super::easel::{Easel, Rays};
use super::lettering::{Lettering, ROWS};
use gravisight_geometry::random::Random;

/// How long a screen shows one thing, s.
const SHOWN: std::ops::Range<f64> = 1.5..8.0;
/// How fast letters move, m/s.
const SCROLLED: std::ops::Range<f64> = 0.2..3.0;
/// Distance from one name to the next, in heights of the board.
const APART: std::ops::Range<f64> = 2.0..9.0;
/// Fractions of the screens whose letters move, and of things shown that are a pattern.
const MOVING: f64 = 0.6;
const PATTERNS: f64 = 0.2;
/// A board's height over its letters'.
const MARGIN: std::ops::Range<f64> = 1.0..2.4;
/// Parts in which what is behind the camera is looked for.
const PARTS: u32 = 40;

/// What a board shows at a time.
#[derive(Debug, Clone)]
struct Advert {
    name: Lettering,
    ground: PaintColour,
    ink: PaintColour,
    /// From one name to the next, m, and how fast they move, m/s.
    apart: f64,
    speed: f64,
    /// Stripes in place of a name.
    pattern: bool,
    /// The board's height over the letters'.
    margin: f64,
}

/// A board that stands upright.
#[derive(Debug, Clone)]
pub(crate) struct Board {
    from: Vector3<f64>,
    along: Vector3<f64>,
    length: f64,
    /// Heights of its edges, m.
    low: f64,
    high: f64,
    adverts: Vec<Advert>,
    /// How long each is shown, s.
    shown: f64,
    /// Whether it gives light.
    pub screen: bool,
}

impl Advert {
    fn draw(height: f64, screen: bool, ground: PaintColour, random: &mut Random) -> Self {
        let vivid = |random: &mut Random| -> PaintColour {
            let weak = random.random_range(0..3);
            std::array::from_fn(|channel| random.random_range(0.0..1.0_f32) * if channel == weak { 0.3 } else { 1.0 })
        };
        let dark = random.random_bool(0.6);
        let ground = if screen { vivid(random).map(|value| value * if dark { 0.4 } else { 1.1 }) } else { ground };
        let bright = ground.iter().sum::<f32>() > 1.6;
        let ink = if bright { vivid(random).map(|value| value * 0.3) } else { [random.random_range(0.75..1.1); 3] };
        let moving = screen && random.random_bool(MOVING);
        let sign = if random.random_bool(0.5) { 1.0 } else { -1.0 };
        let name = Lettering::name(random);
        let margin = random.random_range(MARGIN);
        let own = name.width() * height / ROWS / margin;
        Self {
            apart: own + height * random.random_range(APART),
            speed: if moving { sign * random.random_range(SCROLLED) } else { 0.0 },
            pattern: screen && random.random_bool(PATTERNS),
            name,
            ground,
            ink,
            margin,
        }
    }

    /// The colour at a place, m from the board's start and below its upper edge; `blur` m a pixel covers.
    fn at(&self, along: f64, down: f64, height: f64, blur: f64, time: f64) -> PaintColour {
        let place = (along - self.speed * time).rem_euclid(self.apart);
        let lit = if self.pattern {
            let slanted = (place + down) / self.apart;
            ((2.0 * std::f64::consts::TAU * slanted).sin() * self.apart / (12.0 * blur) + 0.5).clamp(0.0, 1.0) as f32
        } else {
            let dots = ROWS * self.margin / height;
            let below = down - 0.5 * height * (1.0 - 1.0 / self.margin);
            self.name.lit(place * dots, below * dots, blur * dots)
        };
        std::array::from_fn(|channel| self.ground[channel] + lit * (self.ink[channel] - self.ground[channel]))
    }
}

impl Board {
    /// A board from a point on the ground to another, m.
    pub fn draw(from: [f64; 2], to: [f64; 2], [low, high]: [f64; 2], screen: bool, random: &mut Random) -> Self {
        let [from, to] = [from, to].map(|[x, y]| Vector3::new(x, y, 0.0));
        let ground: PaintColour = {
            let [red, green, blue] = [0; 3].map(|_| random.random_range(0.0..0.45_f32));
            [red, green, blue]
        };
        let count = if screen { random.random_range(2..=5) } else { 1 };
        Self {
            from,
            along: (to - from).normalize(),
            length: (to - from).norm(),
            low,
            high,
            adverts: (0..count).map(|_| Advert::draw(high - low, screen, ground, random)).collect(),
            shown: random.random_range(SHOWN),
            screen,
        }
    }

    /// The middle of its foot, m.
    pub fn middle(&self) -> Point3<f64> {
        self.point(0.5 * self.length, 0.0)
    }

    fn point(&self, along: f64, height: f64) -> Point3<f64> {
        Point3::from(self.from + self.along * along + Vector3::z() * height)
    }

    /// The part that is before the camera, m along it.
    fn before(&self, easel: &Easel) -> Option<[f64; 2]> {
        let seen =
            |along: &f64| [self.low, self.high].iter().all(|&height| easel.seen(&self.point(*along, height)).is_some());
        let places = (0..=PARTS).map(|part| self.length * f64::from(part) / f64::from(PARTS));
        let seen: Vec<f64> = places.filter(seen).collect();
        Some([*seen.first()?, *seen.last()?]).filter(|[first, last]| last > first)
    }

    /// Lays it over a picture; `dimmed` is how bright printed ones are.
    pub fn paint(&self, easel: &mut Easel, rays: &Rays, time: f64, dimmed: f32) {
        let Some([first, last]) = self.before(easel) else { return };
        let corners = [(first, self.low), (last, self.low), (last, self.high), (first, self.high)];
        let corners: Vec<[f32; 2]> =
            corners.iter().filter_map(|&(along, height)| Some(easel.seen(&self.point(along, height))?.0)).collect();
        let normal = self.along.cross(&Vector3::z());
        let eye = Vector3::from(rays.eye);
        let distance = normal.dot(&(self.from - eye));
        let advert = &self.adverts[(time / self.shown) as usize % self.adverts.len()];
        let (height, focal) = (self.high - self.low, easel.camera.intrinsic()[(0, 0)]);
        let before = std::mem::replace(&mut easel.light, if self.screen { 1.0 } else { dimmed });
        easel.fill(&Polygon::new(&corners), 1.0, |x, y| {
            let ray = Vector3::from(rays.at(f64::from(x), f64::from(y)));
            let depth = distance / normal.dot(&ray);
            let at = eye + ray * depth;
            let along = self.along.dot(&(at - self.from));
            advert.at(along, self.high - at.z, height, depth / focal, time)
        });
        easel.light = before;
    }
}
