//! Lines of a picture: segments that continue one another.

use nalgebra::{Point2, Vector2, Vector3};

use super::segments::Segment;

/// Most lines of a picture.
const MOST: usize = 120;
/// Segments join a line if their ends are this close to it, px, plus this fraction of the gap between them.
const OFF: f64 = 1.5;
const OFF_BY_GAP: f64 = 0.008;
/// Longest gap that a line is continued over: this many times its length, plus this, px.
const GAP_BY_LENGTH: f64 = 2.0;
const GAP: f64 = 40.0;
/// How often a line is fitted anew with the segments that joined it.
const ROUNDS: usize = 3;

/// A straight line in a picture.
#[derive(Debug, Clone)]
pub(super) struct PictureLine {
    /// (a, b, c) with a² + b² = 1: points (x, y), px, with a·x + b·y + c = 0.
    pub equation: Vector3<f64>,
    /// Length that is seen, px: the sum over its segments.
    pub support: f64,
    /// Its outermost ends, px.
    pub ends: [Point2<f64>; 2],
    /// Its segments' centre of gravity, px.
    pub middle: Point2<f64>,
    /// Unit vector.
    pub direction: Vector2<f64>,
}

/// Segments merged into lines, those with the longest support first.
pub(super) fn merged(segments: &[Segment]) -> Vec<PictureLine> {
    let mut left: Vec<usize> = (0..segments.len()).collect();
    left.sort_by(|&a, &b| segments[b].length().total_cmp(&segments[a].length()));
    let mut lines = Vec::new();
    while !left.is_empty() && lines.len() < MOST {
        let mut members = vec![left.remove(0)];
        for _ in 0..ROUNDS {
            let line = PictureLine::through(segments, &members);
            let before = members.len();
            left.retain(|&index| {
                let joins = line.is_continued_by(&segments[index]);
                if joins {
                    members.push(index);
                }
                !joins
            });
            if members.len() == before {
                break;
            }
        }
        lines.push(PictureLine::through(segments, &members));
    }
    lines.sort_by(|a, b| b.support.total_cmp(&a.support));
    lines
}

impl PictureLine {
    /// The line of least squares through the ends of some segments, weighted by their lengths.
    fn through(segments: &[Segment], members: &[usize]) -> Self {
        let ends = || members.iter().flat_map(|&index| segments[index].ends.map(|end| (end, segments[index].length())));
        let weight = ends().map(|(_, weight)| weight).sum::<f64>().max(f64::MIN_POSITIVE);
        let mean = ends().map(|(end, weight)| end.coords * weight).sum::<Vector2<f64>>() / weight;
        let scatter = |product: fn(Vector2<f64>) -> f64| -> f64 {
            ends().map(|(end, weight)| weight * product(end.coords - mean)).sum()
        };
        let [xx, xy, yy] = [scatter(|off| off.x * off.x), scatter(|off| off.x * off.y), scatter(|off| off.y * off.y)];
        let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
        let direction = Vector2::new(angle.cos(), angle.sin());
        let normal = Vector2::new(-direction.y, direction.x);
        let along = ends().map(|(end, _)| (end.coords - mean).dot(&direction));
        let (least, most) = along.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), at| (a.min(at), b.max(at)));
        Self {
            equation: Vector3::new(normal.x, normal.y, -normal.dot(&mean)),
            support: members.iter().map(|&index| segments[index].length()).sum(),
            ends: [least, most].map(|along| Point2::from(mean + along * direction)),
            middle: Point2::from(mean),
            direction,
        }
    }

    /// Length between its outermost ends, px.
    pub(super) fn length(&self) -> f64 {
        (self.ends[1] - self.ends[0]).norm()
    }

    fn is_continued_by(&self, segment: &Segment) -> bool {
        let first = (self.ends[0] - self.middle).dot(&self.direction);
        let last = (self.ends[1] - self.middle).dot(&self.direction);
        let gap = |end: &Point2<f64>| {
            let along = (end - self.middle).dot(&self.direction);
            (first - along).max(along - last).max(0.0)
        };
        let off = |end: &Point2<f64>| self.equation.dot(&end.to_homogeneous()).abs();
        let is_near = segment.ends.iter().all(|end| off(end) < OFF + OFF_BY_GAP * gap(end));
        let nearest = segment.ends.iter().map(gap).fold(f64::INFINITY, f64::min);
        is_near && nearest < GAP_BY_LENGTH * (last - first) + GAP
    }
}
