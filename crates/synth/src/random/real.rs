//! Real balls: random crops of labelled photographs, and balls cut out of them.

use std::f32::consts::TAU;

use image::RgbImage;
use rand::RngExt;

use super::background;
use super::ball::{Layer, Placed};
use super::canvas::{Canvas, PaintColour};
use super::{Apparent, LARGEST, LEAST_VISIBLE, SMALLEST};
use gravisight_geometry::image::{Filter, resized};
use gravisight_geometry::random::Random;
use gravisight_geometry::size::Size;

/// A ball that somebody labelled in a photograph.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LabelledBall {
    /// Its centre, px.
    pub centre: [f32; 2],
    /// Its radius, px.
    pub radius: f32,
    /// Whether the radius is accurate to about 10 %. Only such balls train the size output and supply cut-outs.
    pub is_sized: bool,
}

/// A photograph in which every ball is labelled.
#[derive(Debug, Clone)]
pub struct LabelledPhotograph {
    /// The photograph, its pixels square.
    pub rgb: RgbImage,
    /// Its balls.
    pub balls: Vec<LabelledBall>,
}

// The numbers below are chosen, not fitted. docs/experiments.md compares networks trained with and without white cut-outs.

/// Largest enlargement of a photograph or a cut-out: beyond it a ball is blurred as no camera blurs.
const ENLARGED: f32 = 1.3;
/// Fraction of the real balls whose hues are turned: few colours are labelled.
const TURNED_HUES: f64 = 0.4;
/// Fraction of the balls cut out that lose most of their colour, and the fraction of it that is left at most: no white ball is labelled, but footballs,
/// volleyballs and table tennis balls are white. What is white is bright: by what factor at most.
const BLEACHED: f64 = 0.3;
const COLOUR_LEFT: f32 = 0.3;
const BRIGHTER: f32 = 1.7;
/// Part of a cut-out's radius that is used: the labelled circle may be a few per cent too large, and its rim shows what was behind.
const INNER: f32 = 0.93;
/// Largest change of a cut-out's brightness and of each of its channels, as factors.
const RELIT: [f32; 2] = [1.35, 1.12];
/// Steepest change of its brightness across its radius.
const SHADED: f32 = 0.35;

/// Changes all colours alike, in the NTSC's YIQ: hues turn in the plane of I and Q.
#[derive(Debug, Clone, Copy)]
struct Recolouring([[f32; 3]; 3]);

impl Recolouring {
    fn random(random: &mut Random) -> Self {
        if !random.random_bool(TURNED_HUES) {
            return Self([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        }
        Self::of_chroma(random.random_range(0.0..TAU), 1.0, 1.0)
    }

    /// Of a ball that is cut out: its hues turned, or little colour left, or as it is.
    fn of_ball(random: &mut Random) -> Self {
        if !random.random_bool(BLEACHED) {
            return Self::random(random);
        }
        let (left, brighter) = (random.random_range(0.0..COLOUR_LEFT), random.random_range(1.0..BRIGHTER));
        Self::of_chroma(0.0, left, brighter)
    }

    /// Chroma turned by `angle` and multiplied by `left`; all multiplied by `brighter`.
    fn of_chroma(angle: f32, left: f32, brighter: f32) -> Self {
        let (sin, cos) = angle.sin_cos();
        let luma = [0.299, 0.587, 0.114];
        let to = [[0.596, -0.274, -0.322], [0.211, -0.523, 0.312]];
        let from = [[0.956, 0.621], [-0.272, -0.647], [-1.106, 1.703]];
        let turned = |axis: usize| -> [f32; 2] { [[cos, -sin], [sin, cos]][axis].map(|factor| left * factor) };
        Self(std::array::from_fn(|row| {
            std::array::from_fn(|column| {
                let chroma = (0..2).map(|axis| {
                    let [i, q] = turned(axis);
                    from[row][axis] * (i * to[0][column] + q * to[1][column])
                });
                brighter * (luma[column] + chroma.sum::<f32>())
            })
        }))
    }

    fn of(&self, colour: PaintColour) -> PaintColour {
        self.0.map(|row| row.iter().zip(colour).map(|(factor, value)| factor * value).sum::<f32>().clamp(0.0, 1.0))
    }
}

/// Returns a random crop of `photograph`, resampled to `size` at a random scale, and the balls visible in it. The
/// crop contains one randomly chosen ball.
pub fn part(size: Size, photograph: &LabelledPhotograph, random: &mut Random) -> (Canvas, Vec<Apparent>) {
    let mut canvas = Canvas::new(size, [0.0; 3]);
    let LabelledPhotograph { rgb, balls } = photograph;
    let chosen = balls[random.random_range(0..balls.len())];
    let largest = (LARGEST as f32).min(size.width.min(size.height) as f32 / 3.0).min(ENLARGED * chosen.radius);
    let least = (SMALLEST as f32).min(0.9 * largest);
    let radius = random.random_range(least.ln()..largest.ln()).exp();
    // Photograph pixels to one of the canvas.
    let whole = (rgb.width() as f32 / size.width as f32).min(rgb.height() as f32 / size.height as f32);
    let step = (chosen.radius / radius).min(whole * 0.999);
    let start = [0, 1].map(|axis| {
        let (side, count) = [(rgb.width(), size.width), (rgb.height(), size.height)][axis];
        let room = side as f32 - 1.0 - step * (count as f32 - 1.0);
        let at = random.random_range(0.0..1.0_f32) * (count as f32 - 1.0);
        (chosen.centre[axis] - step * at).clamp(0.0, room.max(0.0))
    });
    let mirrored = random.random_bool(0.5);
    background::lay(&mut canvas, rgb, start, step, [mirrored, false]);
    let hues = Recolouring::random(random);
    for index in 0..canvas.width * canvas.height {
        let turned = hues.of([0, 1, 2].map(|channel| canvas.planes[channel][index]));
        (0..3).for_each(|channel| canvas.planes[channel][index] = turned[channel]);
    }
    let placed = |ball: &LabelledBall| {
        let [x, y] = [0, 1].map(|axis| (ball.centre[axis] - start[axis]) / step);
        let x = if mirrored { size.width as f32 - 1.0 - x } else { x };
        let (radius, middle) = (ball.radius / step, [size.width, size.height].map(|side| f64::from(side - 1) / 2.0));
        let visible = visible([x, y], radius, size);
        (visible >= LEAST_VISIBLE).then_some(Apparent {
            centre: [x, y].map(f64::from),
            radius: f64::from(radius),
            is_sized: ball.is_sized && visible > 0.99,
            visible: f64::from(visible),
            streak: 0.0,
            focal: f64::from(size.width.max(size.height)),
            principal_point: middle,
        })
    };
    let balls = balls.iter().filter_map(placed).collect();
    (canvas, balls)
}

/// Fraction of a circle that lies in a picture.
fn visible([x, y]: [f32; 2], radius: f32, size: Size) -> f32 {
    const GRID: i32 = 8;
    let (mut inside, mut all) = (0, 0);
    for row in -GRID..=GRID {
        for column in -GRID..=GRID {
            let [u, v] = [column, row].map(|at| at as f32 / GRID as f32);
            if u * u + v * v <= 1.0 {
                let [x, y] = [x + radius * u, y + radius * v];
                let within = |at: f32, side: u32| (-0.5..side as f32 - 0.5).contains(&at);
                all += 1;
                inside += i32::from(within(x, size.width) && within(y, size.height));
            }
        }
    }
    inside as f32 / all as f32
}

/// A ball cut out of a photograph, at its own size and at halves of it.
#[derive(Debug, Clone)]
pub struct CutOut {
    /// Squares about the ball, the largest first, and its radius in each, px.
    levels: Vec<(RgbImage, f32)>,
}

impl CutOut {
    /// Every ball of the photographs that can be cut out: of known size, and whole in its picture.
    pub fn all(photographs: &[LabelledPhotograph]) -> Vec<Self> {
        let of = |photograph: &LabelledPhotograph| {
            let cut = |ball: &LabelledBall| Self::new(&photograph.rgb, ball);
            photograph.balls.iter().filter(|ball| ball.is_sized).filter_map(cut).collect::<Vec<_>>()
        };
        photographs.iter().flat_map(of).collect()
    }

    fn new(rgb: &RgbImage, ball: &LabelledBall) -> Option<Self> {
        let half = ball.radius.ceil() as i64 + 2;
        let [left, top] = ball.centre.map(|at| at.round() as i64 - half);
        let side = 2 * half + 1;
        let fits = |start: i64, length: u32| start >= 0 && start + side <= i64::from(length);
        if ball.radius < SMALLEST as f32 || !fits(left, rgb.width()) || !fits(top, rgb.height()) {
            return None;
        }
        // About the ball's own centre to a pixel's fraction is not needed: the label is not better.
        let whole = image::imageops::crop_imm(rgb, left as u32, top as u32, side as u32, side as u32).to_image();
        let mut levels = vec![(whole, ball.radius)];
        while let Some((last, radius)) = levels.last().filter(|(_, radius)| *radius > 2.0 * SMALLEST as f32) {
            let size = Size::square(last.width());
            let half = Size::square(last.width().div_ceil(2).max(3));
            let radius = radius * half.width as f32 / size.width as f32;
            let smaller = resized(last, [0, 0], size, half, Filter::Bilinear);
            levels.push((smaller, radius));
        }
        Some(Self { levels })
    }

    /// The largest radius that it is drawn with, px.
    pub fn largest(&self) -> f32 {
        ENLARGED * self.levels[0].1
    }

    /// Paints the ball into a layer, with random rotation, mirroring, hue shift and lighting.
    pub fn layer(&self, placed: &Placed, random: &mut Random) -> Layer {
        let wanted = placed.outline.semi[1];
        let level = self.levels.iter().rev().find(|(_, radius)| *radius >= wanted).unwrap_or(&self.levels[0]);
        let (picture, radius) = level;
        let hues = Recolouring::of_ball(random);
        let factor = |most: f32, random: &mut Random| (random.random_range(-1.0..1.0_f32) * most.ln()).exp();
        let gain = factor(RELIT[0], random);
        let gains: PaintColour = std::array::from_fn(|_| gain * factor(RELIT[1], random));
        // Light comes from above more often than not: small turns more often than large ones.
        let angle = TAU / 2.0 * random.random_range(-1.0..1.0_f32).powi(3);
        let (sin, cos) = angle.sin_cos();
        let mirrored = if random.random_bool(0.5) { -1.0 } else { 1.0 };
        let (shade, slope) = (random.random_range(0.0..TAU), random.random_range(0.0..SHADED));
        let middle = (picture.width() as f32 - 1.0) / 2.0;
        let shader = |[u, v]: [f32; 2]| {
            let light = 1.0 + slope * (u * shade.cos() + v * shade.sin());
            let [u, v] = [mirrored * (cos * u - sin * v), sin * u + cos * v];
            let colour = bilinear(picture, middle + INNER * radius * u, middle + INNER * radius * v);
            let turned = hues.of(colour);
            std::array::from_fn(|channel| (light * gains[channel] * turned[channel]).min(1.0))
        };
        Layer::painted(&placed.outline, shader)
    }
}

/// The colour of a picture between its pixels.
fn bilinear(picture: &RgbImage, x: f32, y: f32) -> PaintColour {
    let within = |at: f32, side: u32| at.clamp(0.0, side as f32 - 1.001);
    let (x, y) = (within(x, picture.width()), within(y, picture.height()));
    let (column, row) = (x as u32, y as u32);
    let (u, v) = (x - column as f32, y - row as f32);
    std::array::from_fn(|channel| {
        let at = |column: u32, row: u32| f32::from(picture.get_pixel(column, row).0[channel]) / 255.0;
        let [above, below] = [row, row + 1].map(|row| at(column, row) + u * (at(column + 1, row) - at(column, row)));
        above + v * (below - above)
    })
}
