//! Pictures of random scenes with a ball of any look anywhere: what a network that reads apparent size learns from.
//!
//! A crop is drawn from its seed alone. Where a ball's picture is, and how large, is known exactly; nothing else is real.

mod background;
mod ball;
mod canvas;
mod noise;
mod sensor;
#[cfg(test)]
mod tests;

use image::{Rgb, RgbImage};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

use self::ball::{Layer, Look};
use self::canvas::{Canvas, Ellipse, mix};
use self::noise::Normals;
use crate::size::Size;

/// Smallest radius drawn, px.
pub const SMALLEST: f64 = 1.5;
/// Largest radius drawn, px; in small pictures at most a third of the shorter side.
pub const LARGEST: f64 = 60.0;
/// Share of a ball that must be seen for it to count as there.
const LEAST_VISIBLE: f32 = 0.4;
/// How often something is put before the ball.
const OCCLUDED: f64 = 0.2;
/// How often the ball casts a shadow on something near.
const SHADOWED: f64 = 0.4;

/// A ball in a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Apparent {
    /// Centre of its outline (of a streak: of its way), px.
    pub centre: [f64; 2],
    /// Semi-minor axis of its outline at rest, px.
    pub radius: f64,
}

/// A picture of a random scene.
#[derive(Debug, Clone)]
pub struct Drawing {
    canvas: Canvas,
    /// The ball, if it shows one.
    pub ball: Option<Apparent>,
    /// Share of the ball that is seen.
    pub visible: f64,
    /// Way of the ball during the exposure, px.
    pub streak: f64,
}

impl Drawing {
    /// Red, green, blue of each pixel as shares of full scale, row by row.
    pub fn rgb(&self) -> impl Iterator<Item = [f32; 3]> + '_ {
        let [red, green, blue] = &self.canvas.planes;
        red.iter().zip(green).zip(blue).map(|((&red, &green), &blue)| [red, green, blue])
    }

    /// As a picture.
    pub fn picture(&self) -> RgbImage {
        let pixels: Vec<[f32; 3]> = self.rgb().collect();
        let byte = |value: f32| (255.0 * value).round() as u8;
        RgbImage::from_fn(self.canvas.width as u32, self.canvas.height as u32, |x, y| {
            Rgb(pixels[y as usize * self.canvas.width + x as usize].map(byte))
        })
    }
}

/// Draws random scenes.
#[derive(Debug)]
pub struct RandomScenes {
    photographs: Vec<RgbImage>,
    normals: Normals,
    /// Share of the pictures that show no ball.
    empty: f64,
}

impl RandomScenes {
    /// With `photographs` behind some of the balls; a share of `empty` pictures shows no ball.
    pub fn new(photographs: Vec<RgbImage>, empty: f64) -> Self {
        Self { photographs, normals: Normals::new(&mut StdRng::seed_from_u64(0)), empty }
    }

    /// The picture of `size` that belongs to `seed`.
    pub fn draw(&self, size: Size, seed: u64) -> Drawing {
        let mut random = StdRng::seed_from_u64(seed);
        let mut drawing = self.scene(size, &mut random);
        sensor::expose(&mut drawing.canvas, &self.normals, &mut random);
        drawing
    }

    /// The scene before the camera changes it.
    fn scene(&self, size: Size, random: &mut StdRng) -> Drawing {
        let mut canvas = background::draw(size, &self.photographs, random);
        let none = |canvas| Drawing { canvas, ball: None, visible: 0.0, streak: 0.0 };
        if random.random_bool(self.empty) {
            return none(canvas);
        }
        let [width, height] = size.xy();
        let largest = LARGEST.min(width.min(height) / 3.0);
        let radius = random.random_range(SMALLEST.ln()..largest.ln()).exp() as f32;
        let centre = [width, height].map(|side| random.random_range(0.0..side - 1.0) as f32);
        let placed = ball::place(centre, radius, random);
        let look = Look::random(radius, random);
        let layer = Layer::still(&placed, &look);
        let whole = layer.area();
        let layer = layer.moved(placed.streak);
        let occluder = random.random_bool(OCCLUDED).then(|| background::occluder(centre, radius, random));
        let mut seen = 0.0;
        layer.over(&canvas, |_, x, y, value| {
            let hidden = occluder.as_ref().map_or(0.0, |(shape, ..)| background::covered(shape, x as f32, y as f32));
            seen += value[3] * (1.0 - hidden);
        });
        let visible = seen / whole;
        // Too little of it to be told from anything else: neither a ball nor none.
        if visible < LEAST_VISIBLE {
            return none(canvas);
        }
        if random.random_bool(SHADOWED) {
            shadow(&mut canvas, centre, radius, random);
        }
        // Hardly told from what is behind it is no use either; a fast small ball may be faint, but not gone.
        let planes = &mut canvas.planes;
        let width = canvas.width;
        layer.over(&Canvas { width, height: canvas.height, planes: [vec![], vec![], vec![]] }, |index, _, _, value| {
            for (plane, colour) in planes.iter_mut().zip(value) {
                plane[index] = plane[index] * (1.0 - value[3]) + colour;
            }
        });
        if let Some((shape, first, second)) = &occluder {
            let reach = 4.0 * radius;
            canvas.fill(shape, 1.0, 1.0, |x, _| mix(*first, *second, (0.5 + (x - centre[0]) / reach).clamp(0.0, 1.0)));
        }
        let [dx, dy] = placed.streak;
        let apparent = Apparent { centre: centre.map(f64::from), radius: f64::from(radius) };
        Drawing { canvas, ball: Some(apparent), visible: f64::from(visible), streak: f64::from(dx.hypot(dy)) }
    }
}

/// A ball's shadow on something flat, near it.
fn shadow(canvas: &mut Canvas, centre: [f32; 2], radius: f32, random: &mut StdRng) {
    let reach = radius * random.random_range(0.9..1.4_f32);
    let away = radius * random.random_range(0.3..4.0_f32);
    let (sin, cos) = random.random_range(-0.6..3.7_f32).sin_cos();
    let shape = Ellipse {
        centre: [centre[0] + away * cos, centre[1] + away * sin],
        semi: [reach, reach * random.random_range(0.2..0.8_f32)],
        axis: [1.0, 0.0],
    };
    let (softness, strength) = (random.random_range(1.0..1.0 + radius), random.random_range(0.1..0.7));
    canvas.fill(&shape, softness, strength, |_, _| [0.0; 3]);
}
