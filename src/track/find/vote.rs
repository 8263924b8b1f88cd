//! Circles that edges vote for (Hough): each edge pixel names the centres that lie across it.

use super::edges::Edge;
use crate::contour::Circle;

/// Ratio of a circle's radius to that of the next class below.
const RATIO: f64 = 1.12;
/// Votes, in shares of the circumference, that make a circle worth a look.
const LEAST_SHARE: f32 = 0.18;
/// Most circles that a frame's votes name.
const MOST_CIRCLES: usize = 24;
/// Two circles are one where centres and radii differ by less, in radii (or by a pixel and a half).
const SAME: f64 = 0.35;
/// The same, px.
const SAME_PX: f64 = 1.5;

/// The part of the picture that holds votes.
struct Region {
    left: usize,
    top: usize,
    width: usize,
    height: usize,
}

/// Circles of radii `least..=most` px that the edges vote for, most votes first.
pub(super) fn circles(edges: &[Edge], [width, height]: [usize; 2], [least, most]: [f64; 2]) -> Vec<Circle> {
    let Some(region) = Region::about(edges, [width, height], most) else { return vec![] };
    let mut found: Vec<(f32, Circle)> = Vec::new();
    let mut votes = vec![0_u16; region.width * region.height];
    let mut sums = vec![0_u16; region.width * region.height];
    let mut low = least;
    while low < most {
        let high = (low * RATIO).max(low + 0.5).min(most.max(low + 0.5));
        let radius = (low + high) / 2.0;
        votes.fill(0);
        for edge in edges {
            region.vote(edge, low, high, &mut votes);
        }
        region.sum_neighbours(&votes, &mut sums);
        region.peaks(&sums, radius, &mut found);
        low = high;
    }
    found.sort_by(|(a, _), (b, _)| b.total_cmp(a));
    let mut circles: Vec<Circle> = Vec::new();
    for (_, circle) in found {
        if circles.len() < MOST_CIRCLES && !circles.iter().any(|other| is_same(other, &circle)) {
            circles.push(circle);
        }
    }
    circles
}

/// Whether two circles are about one thing.
pub(super) fn is_same(a: &Circle, b: &Circle) -> bool {
    let apart = (SAME * a.radius.min(b.radius)).max(SAME_PX);
    (a.x - b.x).hypot(a.y - b.y) < apart && (a.radius - b.radius).abs() < apart
}

impl Region {
    fn about(edges: &[Edge], [width, height]: [usize; 2], margin: f64) -> Option<Self> {
        let margin = margin.ceil() as usize;
        let left = edges.iter().map(|edge| edge.x).min()?.saturating_sub(margin);
        let top = edges.iter().map(|edge| edge.y).min()?.saturating_sub(margin);
        let right = edges.iter().map(|edge| edge.x).max()?.saturating_add(margin).min(width - 1);
        let bottom = edges.iter().map(|edge| edge.y).max()?.saturating_add(margin).min(height - 1);
        Some(Self { left, top, width: right + 1 - left, height: bottom + 1 - top })
    }

    /// One vote for every pixel across `edge` at distances `low..high`, on both sides: the ball may be the
    /// brighter side or the darker.
    fn vote(&self, edge: &Edge, low: f64, high: f64, votes: &mut [u16]) {
        let (x, y) = (edge.x as f32 - self.left as f32, edge.y as f32 - self.top as f32);
        let steps = ((high - low).round() as usize).max(1);
        for sign in [1.0, -1.0] {
            for step in 0..steps {
                let distance = sign * (low + (high - low) * (step as f64 + 0.5) / steps as f64) as f32;
                let column = (x + distance * edge.across[0]).round();
                let row = (y + distance * edge.across[1]).round();
                if column >= 0.0 && row >= 0.0 && column < self.width as f32 && row < self.height as f32 {
                    let vote = &mut votes[row as usize * self.width + column as usize];
                    *vote = vote.saturating_add(1);
                }
            }
        }
    }

    /// Sums over 3×3 pixels: an edge's direction is known to some degrees only.
    fn sum_neighbours(&self, votes: &[u16], sums: &mut [u16]) {
        sums.fill(0);
        for y in 1..self.height.saturating_sub(1) {
            let row = |dy: usize| &votes[(y + dy - 1) * self.width..(y + dy) * self.width];
            let (above, here, below) = (row(0), row(1), row(2));
            let column = |x: usize| above[x].saturating_add(here[x]).saturating_add(below[x]);
            for x in 1..self.width.saturating_sub(1) {
                sums[y * self.width + x] = column(x - 1).saturating_add(column(x)).saturating_add(column(x + 1));
            }
        }
    }

    fn peaks(&self, sums: &[u16], radius: f64, found: &mut Vec<(f32, Circle)>) {
        let circumference = (std::f64::consts::TAU * radius) as f32;
        let least = (LEAST_SHARE * circumference).max(3.0) as u16;
        for y in 1..self.height.saturating_sub(1) {
            for x in 1..self.width.saturating_sub(1) {
                let here = y * self.width + x;
                let sum = sums[here];
                if sum < least {
                    continue;
                }
                let before = [here - 1, here - self.width, here - self.width - 1, here - self.width + 1];
                let after = [here + 1, here + self.width, here + self.width - 1, here + self.width + 1];
                if before.iter().all(|&at| sums[at] < sum) && after.iter().all(|&at| sums[at] <= sum) {
                    let (x, y) = ((x + self.left) as f64, (y + self.top) as f64);
                    found.push((f32::from(sum) / circumference, Circle { x, y, radius }));
                }
            }
        }
    }
}
