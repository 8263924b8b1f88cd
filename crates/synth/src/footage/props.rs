//! Things that lie and stand about, many of them like balls, and what a broadcaster writes over the picture.

use nalgebra::{Point3, Vector3};
use rand::RngExt;

use super::super::broadcast::Kind;
use super::super::random::canvas::{Canvas, PaintColour, Polygon};
use super::easel::Easel;
use super::lettering::{Lettering, ROWS};
use super::place::{Place, Style};
use gravisight_geometry::random::Random;

/// How often there is each: a microphone, lamps, a round clock, large balls as logos, other balls that lie about, spots of paint.
const MICROPHONE: f64 = 0.5;
const LAMPS: f64 = 0.6;
const CLOCK: f64 = 0.35;
const LARGE_BALLS: f64 = 0.1;
const LYING: f64 = 0.4;
const SPOTS: f64 = 0.3;
/// How often a broadcast has a score, and a station's name.
const SCORE: f64 = 0.75;
const STATION: f64 = 0.7;
/// Where points and a clock stand beside a name, dots.
const POINTS: f64 = 54.0;
const CLOCKS: f64 = 68.0;

/// Puts them before a still picture of the place; `lying` is a ball's radius, m, and colour, where others may lie about.
pub(crate) fn paint(easel: &mut Easel, place: &Place, lying: Option<(f64, PaintColour)>, random: &mut Random) {
    let [wide, long] = place.room;
    let [half_width, _] = place.court;
    let side = if random.random_bool(0.5) { 1.0 } else { -1.0 };
    if random.random_bool(LAMPS) {
        lamps(easel, place, random);
    }
    if random.random_bool(CLOCK) {
        let at = Point3::new(random.random_range(-0.8..0.8) * wide, long - 0.1, place.fence.max(0.7) * 0.7);
        clock(easel, &at, random);
    }
    if place.kind != Kind::Toss {
        if place.kind != Kind::TableTennis && place.style != Style::Park {
            chair(easel, place.chair, random);
        }
        boxes(easel, place.chair, random);
    }
    if random.random_bool(MICROPHONE) {
        let foot = Point3::new(random.random_range(-0.9..0.9) * wide, random.random_range(0.4..0.95) * long, 0.0);
        let top = foot + Vector3::z() * random.random_range(0.4..1.6);
        easel.limb(&foot, &top, 0.015, [0.1; 3]);
        let grey = random.random_range(0.1..0.9);
        easel.sphere(&top, random.random_range(0.03..0.09), [grey; 3]);
    }
    if random.random_bool(LARGE_BALLS) && place.kind != Kind::Toss {
        let at = Point3::new(-side * (half_width + 1.5).min(wide - 0.4), random.random_range(-2.0..2.0), 0.35);
        easel.sphere(&at, random.random_range(0.15..0.35), [0.85, 0.95, 0.1]);
    }
    if random.random_bool(SPOTS) {
        for _ in 0..random.random_range(1..6) {
            let [x, y] = place.room.map(|half| random.random_range(-half..half));
            easel.shadow(&Point3::new(x, y, 0.0), random.random_range(0.05..0.4), 0.25);
        }
    }
    if let Some((radius, paint)) = lying.filter(|_| random.random_bool(LYING)) {
        for _ in 0..random.random_range(1..=4) {
            // Seldom on the court itself.
            let y =
                if random.random_bool(0.3) { random.random_range(-0.9..0.9) } else { random.random_range(0.7..0.97) };
            let at = Point3::new(random.random_range(-0.97..0.97) * wide, y * long, radius);
            easel.shadow(&Point3::new(at.x, at.y, 0.0), 1.1 * radius, 0.4);
            easel.sphere(&at, radius, paint);
        }
    }
}

/// In the roof, or on masts.
fn lamps(easel: &mut Easel, place: &Place, random: &mut Random) {
    let [wide, long] = place.room;
    let bright = [1.1, 1.1, 1.05];
    match place.style {
        Style::Park => {
            for _ in 0..random.random_range(1..=4) {
                let foot = Point3::new(random.random_range(-1.5..1.5) * wide, long + 0.5, 0.0);
                let top = foot + Vector3::z() * random.random_range(5.0..9.0);
                easel.limb(&foot, &top, 0.07, [0.2; 3]);
                easel.sphere(&top, random.random_range(0.12..0.35), [0.8; 3]);
            }
        }
        Style::Stadium | Style::Hall => {
            let height = if place.style == Style::Hall { 7.0 } else { place.fence + place.rise * place.depth + 2.0 };
            let (y, gap) =
                (long + if place.style == Style::Hall { -0.5 } else { place.depth }, random.random_range(2.0..5.0));
            for number in -6..=6 {
                easel.sphere(&Point3::new(f64::from(number) * gap, y, height), random.random_range(0.1..0.3), bright);
            }
        }
    }
}

fn clock(easel: &mut Easel, at: &Point3<f64>, random: &mut Random) {
    let radius = random.random_range(0.15..0.35);
    easel.sphere(at, radius, [0.9, 0.9, 0.8]);
    let angle: f64 = random.random_range(0.0..std::f64::consts::TAU);
    let tip = at + Vector3::new(0.7 * radius * angle.sin(), -0.02, 0.7 * radius * angle.cos());
    easel.limb(at, &tip, 0.02, [0.05; 3]);
}

/// An umpire's chair.
fn chair(easel: &mut Easel, [x, y]: [f64; 2], random: &mut Random) {
    let metal = [random.random_range(0.1..0.7); 3];
    for [dx, dy] in [[-0.4, -0.4], [0.4, -0.4], [-0.4, 0.4], [0.4, 0.4]] {
        easel.limb(&Point3::new(x + dx, y + dy, 0.0), &Point3::new(x + 0.6 * dx, y + 0.6 * dy, 1.7), 0.03, metal);
    }
    for (from, to) in [(1.65, 1.7), (1.7, 2.4)] {
        let back = if to > 2.0 { 0.25_f64.copysign(x) } else { 0.0 };
        easel.limb(&Point3::new(x + back, y - 0.2, from), &Point3::new(x + back, y + 0.2, to), 0.05, metal);
    }
}

/// Boxes and bags along a side.
fn boxes(easel: &mut Easel, [x, y]: [f64; 2], random: &mut Random) {
    for _ in 0..random.random_range(0..5) {
        let colour: PaintColour = std::array::from_fn(|_| random.random_range(0.05..0.9));
        let at = [x + random.random_range(-0.4..0.4), y + random.random_range(-5.0..5.0)];
        let [half, high] = [random.random_range(0.1..0.4), random.random_range(0.15..0.7)];
        let corner = |dy: f64, z: f64| Point3::new(at[0], at[1] + dy, z);
        easel.piece(&[corner(-half, 0.0), corner(half, 0.0), corner(half, high), corner(-half, high)], 1.0, colour);
        let wide = |dx: f64, z: f64| Point3::new(at[0] + dx, at[1], z);
        easel.piece(
            &[wide(-half, 0.0), wide(half, 0.0), wide(half, high), wide(-half, high)],
            1.0,
            colour.map(|it| 0.8 * it),
        );
        if random.random_bool(0.5) {
            easel.sphere(&Point3::new(at[0], at[1], high + 0.05), 0.06, [random.random_range(0.3..0.95); 3]);
        }
    }
}

/// A line of a broadcaster's: where, px, how large a dot is, its colours.
#[derive(Debug, Clone)]
struct Caption {
    at: [f64; 2],
    dot: f64,
    ground: Option<PaintColour>,
    ink: PaintColour,
    text: Lettering,
    /// Counts seconds from here on.
    counts: Option<usize>,
}

/// What is written over a picture.
#[derive(Debug, Clone, Default)]
pub(crate) struct Captions(Vec<Caption>);

impl Captions {
    pub fn draw([width, height]: [f64; 2], random: &mut Random) -> Self {
        let dot = width / 1920.0 * random.random_range(2.2..4.0);
        let mut all = if random.random_bool(SCORE) { score([width, height], dot, random) } else { vec![] };
        if random.random_bool(STATION) {
            let left = if all.is_empty() && random.random_bool(0.5) { 0.03 } else { 0.82 };
            let text = Lettering::name(random);
            let ink = [random.random_range(0.6..1.0), random.random_range(0.6..1.0), random.random_range(0.8..1.0)];
            let at = [left * width, 0.05 * height];
            all.push(Caption { at, dot: 1.3 * dot, ground: None, ink, text, counts: None });
        }
        Self(all)
    }

    /// Writes them over a picture; whether one of them covers a place, px.
    pub fn paint(&self, canvas: &mut Canvas, time: f64, place: [f64; 2]) -> bool {
        let mut covered = false;
        for caption in &self.0 {
            let counted = caption.counts.map(|first| Lettering::number(first + time as usize, 2));
            let text = counted.as_ref().unwrap_or(&caption.text);
            let ([left, top], dot) = (caption.at, caption.dot);
            let [wide, high] = [text.width() * dot, ROWS * dot];
            let middle = [(left + 0.5 * wide) as f32, (top + 0.5 * high) as f32];
            let shape = Polygon::rectangle(middle, [0.5 * wide as f32, 0.5 * high as f32], 0.0);
            if let Some(ground) = caption.ground {
                canvas.fill(&shape, 1.0, 1.0, |_, _| ground);
                covered |= (left..left + wide).contains(&place[0]) && (top..top + high).contains(&place[1]);
            }
            let mut dots = Vec::new();
            canvas.cover(&shape, 1.0, |index, x, y, _| {
                let [x, y] = [(f64::from(x) - left) / dot, (f64::from(y) - top) / dot];
                dots.push((index, text.lit(x, y, 1.0 / dot)));
            });
            dots.into_iter().for_each(|(index, lit)| canvas.blend(index, caption.ink, lit));
        }
        covered
    }
}

/// Two names, what they have scored, and a clock.
fn score([width, height]: [f64; 2], dot: f64, random: &mut Random) -> Vec<Caption> {
    let top = if random.random_bool(0.6) { 0.84 * height } else { 0.04 * height };
    let ground = Some([random.random_range(0.02..0.2), random.random_range(0.02..0.2), 0.15]);
    let first = random.random_range(0..60);
    let mut all = Vec::new();
    for row in 0..2 {
        let at = [0.04 * width, top + f64::from(row) * dot * ROWS];
        let text = Lettering::name(random);
        let name = Caption { at, dot, ground, ink: [0.92; 3], text, counts: None };
        let points = Caption {
            at: [at[0] + POINTS * dot, at[1]],
            ground: Some([0.9, 0.7, 0.1]),
            ink: [0.05; 3],
            text: Lettering::number(random.random_range(0..99), 2),
            ..name.clone()
        };
        if row == 0 {
            all.push(Caption { at: [at[0] + CLOCKS * dot, at[1]], counts: Some(first), ..name.clone() });
        }
        all.extend([name, points]);
    }
    all
}
