//! What lies behind a ball: photographs or patterns, and things before them that are not balls.

use std::f32::consts::TAU;

use image::RgbImage;
use rand::RngExt;

use super::canvas::{Canvas, Ellipse, PaintColour, PaintedLine, PaintedShape, Polygon, mix};
use super::noise::smooth;
use gravisight_geometry::random::Random;
use gravisight_geometry::size::Size;

/// Fraction of the backgrounds that are photographs, where there are any.
const PHOTOGRAPHS: f64 = 0.55;
/// Axis ratio above which an ellipse is no ball.
const NOT_ROUND: f32 = 1.7;
/// Half the size below which corners cannot be told from a ball's outline, px: what is smaller is long.
const CORNERS: f32 = 8.0;

/// A colour like those of painted and dyed things: seldom pure.
pub fn colour(random: &mut Random) -> PaintColour {
    let grey = random.random_range(0.0..1.0_f32);
    let pure: PaintColour = std::array::from_fn(|_| random.random_range(0.0..1.0));
    mix([grey; 3], pure, random.random_range(0.0..1.0_f32).powf(0.7))
}

/// The largest whole number that is not larger. (The standard library's calls a function where there is no SSE4.1.)
fn floor(value: f32) -> f32 {
    let whole = value as i32 as f32;
    if whole > value { whole - 1.0 } else { whole }
}

/// What is left of `value` after whole `period`s, not negative.
fn wrap(value: f32, period: f32) -> f32 {
    value - period * floor(value / period)
}

/// A place in a photograph.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    /// Number of the photograph.
    pub photograph: usize,
    /// Its middle, px of the photograph.
    pub centre: [f32; 2],
    /// Its radius, px of the photograph.
    pub radius: f32,
}

/// Radii that a place in a photograph is drawn with, px.
const SPOT_RADII: [f32; 2] = [1.5, 40.0];
/// How often something is put before a photograph of a place.
const SPOT_CLUTTERED: f64 = 0.15;
/// Strongest change of a place's size, either way.
const SPOT_SCALE: f32 = 2.0;

/// A background of `size` about a place in one of the `photographs`; where that lies then: its middle and its radius, px.
pub fn draw_about(size: Size, photographs: &[RgbImage], spot: &Spot, random: &mut Random) -> (Canvas, [f32; 2], f32) {
    let mut canvas = Canvas::new(size, [0.0; 3]);
    let photograph = &photographs[spot.photograph];
    let [least, most] = [SPOT_RADII[1], SPOT_RADII[0]].map(|radius| spot.radius / radius);
    let scale = (random.random_range(-1.0..1.0_f32) * SPOT_SCALE.ln()).exp();
    let whole = (photograph.width() as f32 / size.width as f32).min(photograph.height() as f32 / size.height as f32);
    let step = scale.clamp(least, most.max(least)).min(whole * 0.999);
    let at = [size.width, size.height].map(|side| random.random_range(0.15..0.85_f32) * side as f32);
    let start = [0, 1].map(|axis| {
        let (side, count) = [(photograph.width(), size.width), (photograph.height(), size.height)][axis];
        let room = side as f32 - 1.0 - step * (count as f32 - 1.0);
        (spot.centre[axis] - step * at[axis]).clamp(0.0, room.max(0.0))
    });
    let mirrored = random.random_bool(0.5);
    lay(&mut canvas, photograph, start, step, [mirrored, false]);
    if random.random_bool(SPOT_CLUTTERED) {
        clutter(&mut canvas, random);
    }
    let [x, y] = [0, 1].map(|axis| (spot.centre[axis] - start[axis]) / step);
    let x = if mirrored { size.width as f32 - 1.0 - x } else { x };
    (canvas, [x, y], spot.radius / step)
}

/// A background of `size`, with clutter.
pub fn draw(size: Size, photographs: &[RgbImage], random: &mut Random) -> Canvas {
    let mut canvas = Canvas::new(size, colour(random));
    if !photographs.is_empty() && random.random_bool(PHOTOGRAPHS) {
        photograph(&mut canvas, &photographs[random.random_range(0..photographs.len())], random);
    } else {
        match random.random_range(0..10) {
            0 | 1 => gradient(&mut canvas, random),
            2..=4 => texture(&mut canvas, random),
            5 => tiles(&mut canvas, random),
            6 | 7 => ground(&mut canvas, random),
            8 => crowd(&mut canvas, random),
            _ => {}
        }
        if random.random_bool(0.3) {
            texture_over(&mut canvas, random);
        }
    }
    if random.random_bool(0.6) {
        for _ in 0..random.random_range(0..=5) {
            clutter(&mut canvas, random);
        }
    }
    canvas
}

fn anywhere(canvas: &Canvas, random: &mut Random) -> [f32; 2] {
    [canvas.width, canvas.height].map(|side| random.random_range(-0.1..1.1_f32) * side as f32)
}

/// A part of a photograph, at any scale from a third of its pixels' size to three times.
fn photograph(canvas: &mut Canvas, photograph: &RgbImage, random: &mut Random) {
    let (width, height) = (photograph.width() as usize, photograph.height() as usize);
    let most = (width as f32 / canvas.width as f32).min(height as f32 / canvas.height as f32);
    // photograph pixels to one of the canvas
    let step = (random.random_range(-1.0..1.0_f32) * 3_f32.ln()).exp().min(most * 0.999);
    let start = |side: usize, count: usize, random: &mut Random| {
        let room = side as f32 - 1.0 - step * (count as f32 - 1.0);
        random.random_range(0.0..1.0) * room.max(0.0)
    };
    let start = [start(width, canvas.width, random), start(height, canvas.height, random)];
    let turned = [random.random_bool(0.5), random.random_bool(0.1)];
    lay(canvas, photograph, start, step, turned);
}

/// Fills `canvas` with the part of a photograph that begins at `start`, `step` of its pixels to one of the canvas, mirrored left to
/// right or upside down.
pub fn lay(canvas: &mut Canvas, photograph: &RgbImage, start: [f32; 2], step: f32, [mirrored, upside_down]: [bool; 2]) {
    let (width, height) = (photograph.width() as usize, photograph.height() as usize);
    let [left, top] = start;
    let pixels = photograph.as_raw();
    let value = |x: usize, y: usize| 3 * (y.min(height - 1) * width + x.min(width - 1));
    // Boxes of whole pixels where there are several to one, else bilinear.
    let boxed = (step.round() as usize).max(1);
    for row in 0..canvas.height {
        let y = top + step * if upside_down { canvas.height - 1 - row } else { row } as f32;
        for column in 0..canvas.width {
            let x = left + step * if mirrored { canvas.width - 1 - column } else { column } as f32;
            let (x0, y0) = (x as usize, y as usize);
            let mut found = [0.0; 3];
            if boxed > 1 {
                for at in (0..boxed * boxed).map(|index| value(x0 + index % boxed, y0 + index / boxed)) {
                    (0..3).for_each(|channel| found[channel] += f32::from(pixels[at + channel]));
                }
                found = found.map(|sum| sum / (boxed * boxed) as f32);
            } else {
                let (u, v) = (x - x0 as f32, y - y0 as f32);
                let corners = [value(x0, y0), value(x0 + 1, y0), value(x0, y0 + 1), value(x0 + 1, y0 + 1)];
                let fractions = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
                for (at, fraction) in corners.into_iter().zip(fractions) {
                    (0..3).for_each(|channel| found[channel] += fraction * f32::from(pixels[at + channel]));
                }
            }
            let index = row * canvas.width + column;
            (0..3).for_each(|channel| canvas.planes[channel][index] = found[channel] / 255.0);
        }
    }
}

/// Four colours, one a corner.
fn gradient(canvas: &mut Canvas, random: &mut Random) {
    let first = colour(random);
    let corners: [PaintColour; 4] = std::array::from_fn(|_| {
        let other = colour(random);
        mix(first, other, random.random_range(0.0..1.0))
    });
    for row in 0..canvas.height {
        let down = row as f32 / canvas.height as f32;
        let (left, right) = (mix(corners[0], corners[2], down), mix(corners[1], corners[3], down));
        for column in 0..canvas.width {
            let at = mix(left, right, column as f32 / canvas.width as f32);
            (0..3).for_each(|channel| canvas.planes[channel][row * canvas.width + column] = at[channel]);
        }
    }
}

/// Smooth noise between two or three colours.
fn texture(canvas: &mut Canvas, random: &mut Random) {
    let cell = (random.random_range(2_f32.ln()..128_f32.ln())).exp();
    let (octaves, falloff) = (random.random_range(1..=5), random.random_range(0.4..0.9));
    let noise = smooth(canvas, cell, octaves, falloff, random);
    let colours = [colour(random), colour(random), colour(random)];
    // Contrast up to a hard edge between the colours.
    let gain = random.random_range(0.0..1.5_f32).exp();
    for (index, value) in noise.into_iter().enumerate() {
        let level = (2.0 * (0.5 + gain * (value - 0.5))).clamp(0.0, 2.0);
        let found = match level < 1.0 {
            true => mix(colours[0], colours[1], level),
            false => mix(colours[1], colours[2], level - 1.0),
        };
        (0..3).for_each(|channel| canvas.planes[channel][index] = found[channel]);
    }
}

/// The brightness of what is there changed by smooth noise, as grass, carpets and walls have it.
fn texture_over(canvas: &mut Canvas, random: &mut Random) {
    let cell = (random.random_range(2_f32.ln()..32_f32.ln())).exp();
    let strength = random.random_range(0.05..0.5_f32);
    let noise = smooth(canvas, cell, random.random_range(1..=3), 0.7, random);
    for plane in &mut canvas.planes {
        plane.iter_mut().zip(&noise).for_each(|(value, noise)| *value *= 1.0 + strength * (2.0 * noise - 1.0));
    }
}

/// Checkers, bricks or stripes, turned.
fn tiles(canvas: &mut Canvas, random: &mut Random) {
    let (first, second) = (colour(random), colour(random));
    let second = mix(first, second, random.random_range(0.1..1.0));
    let size: [f32; 2] = std::array::from_fn(|_| random.random_range(4_f32.ln()..60_f32.ln()).exp());
    let (sin, cos) = random.random_range(0.0..TAU).sin_cos();
    let (kind, joint) = (random.random_range(0..3), random.random_range(0.03..0.2_f32));
    for row in 0..canvas.height {
        for column in 0..canvas.width {
            let (x, y) = (column as f32, row as f32);
            let (u, v) = ((cos * x + sin * y) / size[0], (cos * y - sin * x) / size[1]);
            // signed distance from the nearest edge, in tiles, alternating
            let wave = |at: f32| 0.5 - (wrap(at, 2.0) - 1.0).abs();
            let edge = match kind {
                0 => (wave(u) * size[0]).clamp(-0.5, 0.5) * (wave(v) * size[1]).clamp(-0.5, 0.5) * 2.0 + 0.5,
                1 => 0.5 + (wave(u) * size[0]).clamp(-0.5, 0.5),
                _ => {
                    let shifted = u + 0.5 * wrap(floor(v), 2.0);
                    let inner =
                        |at: f32, size: f32| ((0.5 - joint - (wrap(at, 1.0) - 0.5).abs()) * size + 0.5).clamp(0.0, 1.0);
                    inner(shifted, size[0]) * inner(v, size[1])
                }
            };
            let found = mix(first, second, edge.clamp(0.0, 1.0));
            (0..3).for_each(|channel| canvas.planes[channel][row * canvas.width + column] = found[channel]);
        }
    }
}

/// A floor or a court in perspective, with lines or checkers, under a wall.
fn ground(canvas: &mut Canvas, random: &mut Random) {
    let (wall, surface, line) = (colour(random), colour(random), colour(random));
    let white = random.random_bool(0.6);
    let line = if white { [random.random_range(0.7..1.0); 3] } else { line };
    let height = canvas.height as f32;
    let horizon = random.random_range(-1.5..0.7_f32) * height;
    let tilt = random.random_range(-0.15..0.15_f32);
    let checkers = random.random_bool(0.35);
    let spacing = random.random_range(0.4..4.0_f32);
    let width = random.random_range(0.01..0.12_f32) * spacing;
    let (sin, cos) = random.random_range(0.0..TAU).sin_cos();
    let offset: [f32; 2] = std::array::from_fn(|_| random.random_range(0.0..spacing));
    let focal = random.random_range(0.5..4.0_f32) * height;
    for row in 0..canvas.height {
        for column in 0..canvas.width {
            let x = column as f32 - 0.5 * canvas.width as f32;
            let below = row as f32 - horizon - tilt * x;
            let index = row * canvas.width + column;
            if below < 0.5 {
                (0..3).for_each(|channel| canvas.planes[channel][index] = wall[channel]);
                continue;
            }
            // A plane one unit below the eye; how much of it a pixel sees.
            let (away, aside) = (focal / below, x / below);
            let footprint = away / below;
            let (u, v) = (cos * away + sin * aside + offset[0], cos * aside - sin * away + offset[1]);
            let fade = (1.0 - footprint / spacing).clamp(0.0, 1.0);
            let found = if checkers {
                let odd = wrap(floor(u / spacing) + floor(v / spacing), 2.0);
                mix(surface, line, 0.5 + (odd - 0.5) * fade)
            } else {
                let near = |at: f32| (wrap(at, spacing) - 0.5 * spacing).abs();
                let fraction = |at: f32| ((width - near(at)) / footprint.max(1e-3) + 0.5).clamp(0.0, 1.0);
                mix(surface, line, fraction(u).max(fraction(v)) * fade)
            };
            (0..3).for_each(|channel| canvas.planes[channel][index] = found[channel]);
        }
    }
}

/// Many small things of all colours: spectators, leaves, shelves.
fn crowd(canvas: &mut Canvas, random: &mut Random) {
    let size = random.random_range(2_f32.ln()..12_f32.ln()).exp();
    let area = (canvas.width * canvas.height) as f32;
    let dim = random.random_range(0.2..1.0_f32);
    for _ in 0..((area / (size * size)) as usize).min(1500) {
        let half = [size * random.random_range(0.6..1.2_f32), size * random.random_range(0.15..0.35_f32)];
        let found = colour(random).map(|value| value * dim);
        let shape = Polygon::rectangle(anywhere(canvas, random), half, random.random_range(0.0..TAU));
        canvas.fill(&shape, 1.0, 1.0, |_, _| found);
    }
}

/// One thing that is no ball: a polygon, a line, an ellipse far from round, a bar, a crescent, letters' strokes.
pub fn clutter(canvas: &mut Canvas, random: &mut Random) {
    let at = anywhere(canvas, random);
    let side = canvas.width.min(canvas.height) as f32;
    let reach = side * (random.random_range(0.02_f32.ln()..0.7_f32.ln())).exp();
    let softness = if random.random_bool(0.7) { 1.0 } else { random.random_range(1.0..6.0) };
    let opacity = if random.random_bool(0.8) { 1.0 } else { random.random_range(0.2..1.0) };
    let (first, second) = (colour(random), colour(random));
    let second = mix(first, second, random.random_range(0.0..0.6));
    let widest = if reach < CORNERS { 0.5 } else { 1.0 };
    let (sin, cos) = random.random_range(0.0..TAU).sin_cos();
    let shade = move |x: f32, y: f32| {
        mix(first, second, (0.5 + (cos * (x - at[0]) + sin * (y - at[1])) / (2.0 * reach)).clamp(0.0, 1.0))
    };
    match random.random_range(0..6) {
        0 | 1 => canvas.fill(&Polygon::random(at, reach, widest, random), softness, opacity, shade),
        2 => {
            let half = random.random_range(0.3..(0.06 * side).min(reach / NOT_ROUND).max(0.5));
            let to = [at[0] + reach * 2.0 * cos, at[1] + reach * 2.0 * sin];
            canvas.fill(&PaintedLine { from: at, to, half }, softness, opacity, shade);
        }
        3 => {
            let ratio = random.random_range(NOT_ROUND..5.0);
            let shape = Ellipse { centre: at, semi: [reach, reach / ratio], axis: [cos, sin] };
            canvas.fill(&shape, softness, opacity, shade);
        }
        4 => {
            let half = [reach, reach * random.random_range(0.15..widest)];
            canvas.fill(&Polygon::rectangle(at, half, random.random_range(0.0..TAU)), softness, opacity, shade);
        }
        _ => strokes(canvas, at, reach.min(0.2 * side), first, random),
    }
}

/// A few strokes beside each other, as letters and digits have them.
fn strokes(canvas: &mut Canvas, at: [f32; 2], reach: f32, ink: PaintColour, random: &mut Random) {
    let half = (reach * random.random_range(0.05..0.2_f32)).max(0.4);
    for letter in 0..random.random_range(1..5) {
        for _ in 0..random.random_range(2..4) {
            let corner = |random: &mut Random| {
                let across = at[0] + reach * (1.2 * letter as f32 + [0.0, 0.5, 1.0][random.random_range(0..3)]);
                [across, at[1] + 1.6 * reach * [0.0, 0.5, 1.0][random.random_range(0..3)]]
            };
            let shape = PaintedLine { from: corner(random), to: corner(random), half };
            canvas.fill(&shape, 1.0, 1.0, |_, _| ink);
        }
    }
}

/// Something that hides a part of a ball about `centre`: its fraction of each pixel, and its colours.
pub fn occluder(centre: [f32; 2], radius: f32, random: &mut Random) -> (Polygon, PaintColour, PaintColour) {
    let (sin, cos) = random.random_range(0.0..TAU).sin_cos();
    let colours = (colour(random), colour(random));
    let shape = if random.random_bool(0.5) {
        // A straight edge of something large.
        let reach = radius * random.random_range(3.0..8.0_f32);
        let distance = reach + radius * random.random_range(-0.35..1.0_f32);
        let half = [reach, radius * random.random_range(1.0..6.0_f32)];
        Polygon::rectangle([centre[0] + distance * cos, centre[1] + distance * sin], half, sin.atan2(cos))
    } else {
        // A bar: a net's cord, a racket, a post.
        let half = [radius * random.random_range(2.0..8.0_f32), radius * random.random_range(0.04..0.35_f32)];
        let aside = radius * random.random_range(-1.0..1.0_f32);
        Polygon::rectangle([centre[0] - aside * sin, centre[1] + aside * cos], half, sin.atan2(cos))
    };
    (shape, colours.0, colours.1)
}

/// The fraction of a pixel that a shape with sharp edges covers.
pub fn covered(shape: &impl PaintedShape, x: f32, y: f32) -> f32 {
    (0.5 + shape.inside(x, y)).clamp(0.0, 1.0)
}
