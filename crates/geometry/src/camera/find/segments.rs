//! Straight segments: chains of ridge pixels along one line.

use nalgebra::{Point2, Vector2};

use super::ridges::Ridges;

/// Most segments of a picture: far more than a court has, and a bound on time where a crowd or foliage fills it.
const MOST: usize = 4000;
/// Pixels beside the expected one in which the chain's next pixel is searched.
const BESIDE: i32 = 2;
/// Cosine of 15°: how far a pixel's direction may be from the chain's.
const SAME_DIRECTION: f64 = 0.966;
/// Most distance of a pixel from the chain's line, px.
const OFF_LINE: f64 = 1.3;
/// Steps without a pixel that a chain may pass over: this many, and this fraction of its steps.
const GAP: [f64; 2] = [4.0, 0.06];
/// Steps from which on a line is fitted to the chain: at each new one, later at every eighth.
const FIRST_FIT: usize = 6;
const EVERY_FIT: usize = 20;
const FIT_STEP: usize = 8;
/// Least length of a segment, px, and as many steps. Texture has few of that length.
const LEAST_LENGTH: f64 = 12.0;
/// Least fraction of a segment's length that its pixels fill.
const LEAST_FILLED: f64 = 0.6;
/// Most distance of its pixels from its line, px, root mean square.
const MOST_RMS: f64 = 1.0;

/// A straight segment.
#[derive(Debug, Clone, Copy)]
pub(super) struct Segment {
    /// Its ends, px.
    pub ends: [Point2<f64>; 2],
}

/// The segments of a picture and the pixels of each.
pub(super) struct Segments {
    pub all: Vec<Segment>,
    /// For each of the picture's pixels the index of its segment plus one; 0 where there is none.
    pub labels: Vec<u32>,
}

impl Segment {
    /// Length, px.
    pub(super) fn length(&self) -> f64 {
        (self.ends[1] - self.ends[0]).norm()
    }

    /// Direction, rad, 0 to π.
    pub(super) fn direction(&self) -> f64 {
        let along = self.ends[1] - self.ends[0];
        along.y.atan2(along.x).rem_euclid(std::f64::consts::PI)
    }

    /// The point halfway between its ends, px.
    pub(super) fn middle(&self) -> Point2<f64> {
        nalgebra::center(&self.ends[0], &self.ends[1])
    }
}

/// Sums over the pixels of a chain, for the line of least squares.
#[derive(Debug, Clone, Copy, Default)]
struct Moments {
    count: f64,
    first: Vector2<f64>,
    /// Of x², xy and y².
    second: [f64; 3],
}

impl Moments {
    fn add(&mut self, at: Vector2<f64>) {
        self.count += 1.0;
        self.first += at;
        self.second[0] += at.x * at.x;
        self.second[1] += at.x * at.y;
        self.second[2] += at.y * at.y;
    }

    fn mean(&self) -> Vector2<f64> {
        self.first / self.count.max(1.0)
    }

    /// Direction of the line of least squares, on the side of `before`.
    fn direction(&self, before: Vector2<f64>) -> Vector2<f64> {
        let mean = self.mean();
        let [xx, xy, yy] = self.second.map(|second| second / self.count.max(1.0));
        let covariance = [xx - mean.x * mean.x, xy - mean.x * mean.y, yy - mean.y * mean.y];
        let angle = 0.5 * (2.0 * covariance[1]).atan2(covariance[0] - covariance[2]);
        let direction = Vector2::new(angle.cos(), angle.sin());
        if direction.dot(&before) < 0.0 { -direction } else { direction }
    }
}

/// Segments by growing: from the strongest free pixel along its direction, one way and then the other; the line is refitted on the
/// way. A seed without a segment is never used again.
pub(super) fn segments(ridges: &Ridges) -> Segments {
    let mut order: Vec<usize> = (0..ridges.contrast.len()).filter(|&at| ridges.contrast[at] > 0.0).collect();
    order.sort_by(|&a, &b| ridges.contrast[b].total_cmp(&ridges.contrast[a]));
    let mut growth =
        Growth { ridges, labels: vec![0; ridges.contrast.len()], spent: vec![false; ridges.contrast.len()] };
    let mut all = Vec::new();
    for seed in order {
        if all.len() >= MOST {
            break;
        }
        if growth.labels[seed] != 0 || growth.spent[seed] {
            continue;
        }
        let chain = growth.chain(seed, all.len() as u32 + 1);
        match chain.segment(ridges.width) {
            Some(segment) => all.push(segment),
            None => {
                chain.pixels.iter().for_each(|&at| growth.labels[at] = 0);
                growth.spent[seed] = true;
            }
        }
    }
    Segments { all, labels: growth.labels }
}

struct Growth<'a> {
    ridges: &'a Ridges,
    labels: Vec<u32>,
    /// Seeds from which no segment grew.
    spent: Vec<bool>,
}

/// Pixels along a line.
struct Chain {
    pixels: Vec<usize>,
    /// Steps along the line with such pixels.
    steps: usize,
    moments: Moments,
    direction: Vector2<f64>,
}

impl Growth<'_> {
    fn position(&self, at: usize) -> Vector2<f64> {
        Vector2::new((at % self.ridges.width) as f64, (at / self.ridges.width) as f64)
    }

    /// The chain through `seed`, whose pixels get `label`.
    fn chain(&mut self, seed: usize, label: u32) -> Chain {
        let angle = f64::from(self.ridges.direction[seed]);
        let mut chain = Chain {
            pixels: Vec::new(),
            steps: 0,
            moments: Moments::default(),
            direction: Vector2::new(angle.cos(), angle.sin()),
        };
        let start = self.position(seed);
        self.grow(&mut chain, start, label, 1.0);
        // The other way, from the place of the fitted line that is nearest to the seed.
        let mut back = start;
        if chain.steps >= FIRST_FIT {
            let mean = chain.moments.mean();
            back = mean + (start - mean).dot(&chain.direction) * chain.direction;
        }
        self.grow(&mut chain, back, label, -1.0);
        chain
    }

    /// Adds pixels to a chain from `origin` on, along its direction (`sign` 1) or against it (−1).
    fn grow(&mut self, chain: &mut Chain, mut origin: Vector2<f64>, label: u32, sign: f64) {
        let farthest = (self.ridges.width + self.ridges.height) as f64;
        let (mut along, mut gap): (f64, f64) = (if sign > 0.0 { 0.0 } else { -1.0 }, 0.0);
        while along.abs() <= farthest {
            let found = self.ridge(origin + along * chain.direction, origin, chain.direction, label);
            if found.is_empty() {
                gap += 1.0;
                if gap > GAP[0] + GAP[1] * chain.steps as f64 {
                    break;
                }
            } else {
                gap = 0.0;
            }
            let before = chain.pixels.len();
            for at in found {
                if self.labels[at] != label {
                    self.labels[at] = label;
                    chain.pixels.push(at);
                    chain.moments.add(self.position(at));
                }
            }
            if chain.pixels.len() > before {
                chain.steps += 1;
                if chain.steps >= FIRST_FIT && (chain.steps < EVERY_FIT || chain.steps.is_multiple_of(FIT_STEP)) {
                    let place = origin + along * chain.direction;
                    chain.direction = chain.moments.direction(chain.direction);
                    origin = chain.moments.mean();
                    along = (place - origin).dot(&chain.direction);
                }
            }
            along += sign;
        }
    }

    /// The free pixels of the chain's direction near its line, across from a place on it. Diagonal ridges are two pixels wide in places; a
    /// chain that took only one of them would leave another line beside it.
    fn ridge(&self, place: Vector2<f64>, origin: Vector2<f64>, direction: Vector2<f64>, label: u32) -> Vec<usize> {
        let across = Vector2::new(-direction.y, direction.x);
        let candidate = |beside: i32| {
            let near = place + f64::from(beside) * across;
            let (x, y) = ((near.x + 0.5).floor(), (near.y + 0.5).floor());
            let is_inside = x >= 0.0 && y >= 0.0 && x < self.ridges.width as f64 && y < self.ridges.height as f64;
            let at = if is_inside { y as usize * self.ridges.width + x as usize } else { return None };
            let is_free = !self.spent[at] && (self.labels[at] == 0 || self.labels[at] == label);
            if self.ridges.contrast[at] <= 0.0 || !is_free {
                return None;
            }
            let angle = f64::from(self.ridges.direction[at]);
            let alike = (angle.cos() * direction.x + angle.sin() * direction.y).abs();
            let off = (Vector2::new(x, y) - origin).dot(&across).abs();
            (alike >= SAME_DIRECTION && off <= OFF_LINE).then_some(at)
        };
        (-BESIDE..=BESIDE).filter_map(candidate).collect()
    }
}

impl Chain {
    /// The segment that it is, if it is long, straight and filled enough; `width` is the picture's, px.
    fn segment(&self, width: usize) -> Option<Segment> {
        let (count, steps) = (self.pixels.len() as f64, self.steps as f64);
        if steps < LEAST_LENGTH {
            return None;
        }
        let (mean, direction) = (self.moments.mean(), self.direction);
        let (mut least, mut most, mut square) = (f64::INFINITY, f64::NEG_INFINITY, 0.0);
        for &at in &self.pixels {
            let from_mean = Vector2::new((at % width) as f64, (at / width) as f64) - mean;
            let along = from_mean.dot(&direction);
            (least, most) = (least.min(along), most.max(along));
            square += direction.perp(&from_mean).powi(2);
        }
        let length = most - least;
        // A slanted line has as many steps with new pixels as its longer extent has pixels.
        let filled = steps / (length * direction.x.abs().max(direction.y.abs())).max(1.0);
        let is_one = length >= LEAST_LENGTH && filled >= LEAST_FILLED && (square / count).sqrt() <= MOST_RMS;
        is_one.then(|| Segment { ends: [least, most].map(|along| Point2::from(mean + along * direction)) })
    }
}
