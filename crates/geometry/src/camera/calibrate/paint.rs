//! A painted line in a picture: its two edges, where they are expected or beside.

use image::RgbImage;
use nalgebra::{Point2, Vector2};

/// A profile's step, px.
const STEP: f64 = 0.5;
/// Values of a profile on either side of a difference's middle.
const REACH: usize = 2;
/// Least change of brightness at an edge, levels of 255 a pixel.
const EDGE: f32 = 2.5;
/// A change from which on more of it says no more.
const CLEAR: f32 = 25.0;
/// Least measured width as a share of the expected one (base lines are 5 to 10 cm), and the most, with what blur adds, px.
const NARROW: f64 = 0.45;
const WIDE: f64 = 1.7;
const BLUR: f64 = 2.5;
/// Below this width, px, a line's edges look farther apart than they are.
const THIN: f64 = 2.6;
/// Distance from a straight line within which a sample speaks for it, px.
const NEAR: f64 = 1.2;
/// Least share of a line's samples, and least number, that speak for it.
const MOST_SEEN: f64 = 0.35;
const FEWEST: usize = 12;
/// Another straight line at least so far away, px, with so much of the best one's vote makes it unsure which is meant.
const APART: f64 = 3.0;
const RIVAL: f64 = 0.75;

/// A picture's brightness, 0 to 255.
pub(super) struct Grey {
    values: Vec<f32>,
    width: usize,
    height: usize,
}

impl Grey {
    pub(super) fn of(rgb: &RgbImage) -> Self {
        let grey = |[red, green, blue]: [u8; 3]| (f32::from(red) + 2.0 * f32::from(green) + f32::from(blue)) / 4.0;
        let values = rgb.pixels().map(|pixel| grey(pixel.0)).collect();
        Self { values, width: rgb.width() as usize, height: rgb.height() as usize }
    }

    /// Of brightness, rows from the top.
    pub(super) fn of_levels(levels: &[u8], width: usize, height: usize) -> Self {
        Self { values: levels.iter().map(|&level| f32::from(level)).collect(), width, height }
    }

    /// Between pixels; [`None`] outside.
    fn at(&self, at: Point2<f64>) -> Option<f32> {
        let (left, top) = (at.x.floor(), at.y.floor());
        if left < 0.0 || top < 0.0 || left as usize + 1 >= self.width || top as usize + 1 >= self.height {
            return None;
        }
        let (x, y) = ((at.x - left) as f32, (at.y - top) as f32);
        let first = top as usize * self.width + left as usize;
        let row = |first: usize| self.values[first] * (1.0 - x) + self.values[first + 1] * x;
        Some(row(first) * (1.0 - y) + row(first + self.width) * y)
    }
}

/// A place on a line as a camera expects it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Expected {
    /// How far along the line, 0 to 1.
    pub share: f64,
    /// The middle of the paint, px.
    pub middle: Point2<f64>,
    /// Unit vector across the line; of a line that is measured to an edge, from that towards the paint.
    pub across: Vector2<f64>,
    /// Half the paint's width along it, px.
    pub half: f64,
    /// Whether the line is measured to an edge, not to its middle.
    pub by_edge: bool,
}

/// What a profile may show: how far the line is from where it is expected, px, and how clearly (0 to 1).
#[derive(Debug, Clone, Copy)]
struct PaintCandidate {
    offset: f64,
    clear: f64,
}

/// A line that was found: of each sample that speaks for it, its index and how far it is from where it is expected, px.
pub(super) type Found = Vec<(usize, f64)>;

impl Expected {
    /// Strips of paint no farther than `search`, px, from where one is expected; `sign` is −1 for dark paint.
    fn candidates(&self, grey: &Grey, search: f64, sign: f32) -> Vec<PaintCandidate> {
        let reach = search + WIDE * self.half + BLUR + 2.0;
        let count = (reach / STEP).ceil() as i64;
        let along = Vector2::new(-self.across.y, self.across.x);
        let value = |index: i64| {
            let at = self.middle + self.across * (index as f64 * STEP);
            Some((grey.at(at - along)? + 2.0 * grey.at(at)? + grey.at(at + along)?) / 4.0)
        };
        let Some(profile) = (-count..=count).map(value).collect::<Option<Vec<f32>>>() else { return Vec::new() };
        // A difference over two pixels, smoothed over one.
        let slope: Vec<f32> = (0..profile.len())
            .map(|index| {
                let (Some(below), Some(above)) = (index.checked_sub(REACH), profile.get(index + REACH)) else {
                    return 0.0;
                };
                let inner = profile[index + 1] - profile[index - 1];
                sign * (above - profile[below] + inner) / ((2 * REACH + 2) as f32 * STEP as f32)
            })
            .collect();
        let edges = |sign: f32| -> Vec<(f64, f32)> {
            let top = |index: usize| {
                let [before, here, after] = [index - 1, index, index + 1].map(|index| sign * slope[index]);
                (here >= EDGE && here >= before && here > after).then(|| {
                    let curve = before - 2.0 * here + after;
                    let off = if curve < 0.0 { 0.5 * (before - after) / curve } else { 0.0 };
                    ((index as f64 - count as f64 + f64::from(off)) * STEP, here)
                })
            };
            (1..slope.len() - 1).filter_map(top).collect()
        };
        let (rises, falls) = (edges(1.0), edges(-1.0));
        let width = 2.0 * self.half;
        let mut found = Vec::new();
        for &(rise, first) in &rises {
            for &(fall, second) in falls.iter().filter(|(fall, _)| *fall > rise) {
                let seen = fall - rise;
                if seen < NARROW * width || seen > WIDE * width + BLUR {
                    continue;
                }
                let middle = (rise + fall) / 2.0;
                let half = if seen > THIN { seen / 2.0 } else { self.half.min(seen / 2.0) };
                let offset = if self.by_edge { middle - half + self.half } else { middle };
                if offset.abs() <= search {
                    found.push(PaintCandidate { offset, clear: f64::from((first.min(second) / CLEAR).min(1.0)) });
                }
            }
        }
        found
    }
}

/// Paint brighter than the ground, and darker.
pub(super) const SIGNS: [f32; 2] = [1.0, -1.0];

/// The straight line beside the expected one (offsets at either end) for which most samples speak; [`None`] where too few do or
/// two such lines might be meant. `sign` is one of [`SIGNS`].
pub(super) fn find(grey: &Grey, expected: &[Expected], search: f64, sign: f32) -> Option<Found> {
    let samples: Vec<(f64, Vec<PaintCandidate>)> =
        expected.iter().map(|place| (place.share, place.candidates(grey, search, sign))).collect();
    let vote = |from: f64, to: f64| -> f64 {
        let speaks = |(share, candidates): &(f64, Vec<PaintCandidate>)| {
            let at = from + share * (to - from);
            let weight = |found: &PaintCandidate| found.clear * (1.0 - ((found.offset - at) / NEAR).powi(2)).max(0.0);
            candidates.iter().map(weight).fold(0.0, f64::max)
        };
        samples.iter().map(speaks).sum()
    };
    let step = (search / 24.0).max(0.5);
    let count = (search / step).floor() as i64;
    let ends = || (-count..=count).map(|index| index as f64 * step);
    let votes: Vec<([f64; 2], f64)> = ends()
        .flat_map(|from| ends().map(move |to| [from, to]))
        .map(|[from, to]| ([from, to], vote(from, to)))
        .collect();
    let &(coarse, most) = votes.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let middle = |[from, to]: [f64; 2]| (from + to) / 2.0;
    let is_apart = |other: [f64; 2]| (middle(other) - middle(coarse)).abs() > APART;
    if votes.iter().any(|(other, votes)| *votes > RIVAL * most && is_apart(*other)) {
        return None;
    }
    // The best to a tenth of a step.
    let mut best = (coarse, most);
    for scale in [0.5, 0.25, 0.125] {
        let [from, to] = best.0;
        for first in [-1.0, 0.0, 1.0] {
            for second in [-1.0, 0.0, 1.0] {
                let ends = [from + first * scale * step, to + second * scale * step];
                let votes = vote(ends[0], ends[1]);
                if votes > best.1 {
                    best = (ends, votes);
                }
            }
        }
    }
    let [from, to] = best.0;
    let nearest = |(index, (share, candidates)): (usize, &(f64, Vec<PaintCandidate>))| {
        let at = from + share * (to - from);
        let off = |found: &&PaintCandidate| (found.offset - at).abs();
        let found = candidates.iter().min_by(|a, b| off(a).total_cmp(&off(b)))?;
        (off(&found) < NEAR).then_some((index, found.offset))
    };
    let found: Found = samples.iter().enumerate().filter_map(nearest).collect();
    (found.len() >= FEWEST && found.len() as f64 >= MOST_SEEN * samples.len() as f64).then_some(found)
}
