//! What speaks for a refined view, and against it.

use std::array::from_fn;

use nalgebra::{Matrix3, Point2, Point3, Vector2, Vector3};

use super::evidence::Evidence;
use super::hypotheses::LONGEST;
use super::model::{CourtModel, ModelLine};
use super::score::{ALL_SEEN, Scale, UNSEEN, clipped_ends, shown};
use super::segments::Segment;
use super::view::View;
use crate::statistics::median;

/// Tolerance of lines, and of what lies beyond their ends, px, and most samples. Measured on 41 scenes, as all weights below.
const TOLERANCE: f64 = 2.5;
const SAMPLES: usize = 60;
const BEYOND_TOLERANCE: f64 = 2.0;
const BEYOND_SAMPLES: usize = 12;
/// A line shorter than this, in units, or thinner than this, px, need not be seen.
const SHORTEST: f64 = 0.015;
const THINNEST: f64 = 0.3;
/// Fraction of a line from which on it counts as seen.
pub(super) const IS_SEEN: f64 = 0.5;
/// Parts of a line's own length beyond its ends, and how long each has to be in the picture, px.
const BEYOND: [[f64; 2]; 2] = [[-0.14, -0.03], [1.03, 1.14]];
const BEYOND_SHORTEST: f64 = 6.0;
/// There another line goes on if it is this near, m, and reaches this far, m.
const SAME_PLACE: f64 = 0.1;
const REACH: f64 = 0.01;
/// Distance within which a line explains a segment, px.
const EXPLAINED: f64 = 3.5;
/// Weights of L*, a* and b* in the squared difference of two colours (shade matters less than hue), and the most of one paint.
const COLOUR_WEIGHTS: [f32; 3] = [0.15, 1.0, 1.0];
const SAME_COLOUR: f32 = 18.0;
/// What unexplained segments cost, up to this many times the length of the explained ones.
const UNEXPLAINED: f64 = 0.2;
const MOST_UNEXPLAINED: f64 = 2.0;
/// What lines cost that go on beyond their ends: 0.6 of the length of the parts there, 0.28 of a line's at both ends.
const BEYOND_COST: f64 = 0.6 * 0.28;

/// What a view's lines show.
#[derive(Debug, Clone)]
pub(super) struct Features {
    /// Length seen less what is missing or unexplained, in units.
    pub score: f64,
    /// Fraction of the length of the lines in view that is seen.
    pub recall: f64,
    /// Fraction of what lies beyond the ends of the lines that is seen as well: 0 where they end as they should.
    pub beyond: f64,
    /// Fraction of the length of all segments of the paint's colour, anywhere in the picture, that the lines explain.
    pub explained: f64,
    /// Of each line, whether it is in view, and the fraction of it that is seen, 0 to 1.
    pub lines: Vec<(bool, f64)>,
    /// Lines in view, and those seen; of the latter, lines along the court and across.
    pub visible: usize,
    pub seen: usize,
    pub along: usize,
    pub across: usize,
}

/// The features of a refined view.
pub(super) fn judged(evidence: &Evidence, model: &CourtModel, view: &View) -> Features {
    let unit = evidence.unit();
    let scale = Scale { tolerance: TOLERANCE, longest: f64::INFINITY, samples: SAMPLES };
    let shown_lines: Vec<_> = model.lines.iter().map(|line| shown(&evidence.maps, view, &line.ends, &scale)).collect();
    let lines: Vec<(bool, f64)> = (model.lines.iter().zip(&shown_lines))
        .map(|(line, shown)| {
            let is_visible = shown.length > SHORTEST * unit && width(view, line) > THINNEST;
            (is_visible, (shown.fraction / ALL_SEEN).min(1.0))
        })
        .collect();
    let is_seen = |&(is_visible, fraction): &(bool, f64)| is_visible && fraction > IS_SEEN;
    let seen: Vec<usize> = (0..lines.len()).filter(|&index| is_seen(&lines[index])).collect();
    let (mut all, mut found, mut total) = (0.0, 0.0, 0.0);
    for (shown, &(_, fraction)) in shown_lines.iter().zip(&lines).filter(|(_, (is_visible, _))| *is_visible) {
        all += shown.length;
        found += fraction * shown.length;
        total += shown.length.min(LONGEST * unit) * (fraction - UNSEEN * (1.0 - fraction));
    }
    let [explained, unexplained, all_painted] = explained(evidence, model, view);
    let (beyond, ends) = beyond(evidence, model, view, &seen);
    let mean = seen.iter().map(|&index| shown_lines[index].length).sum::<f64>() / seen.len().max(1) as f64;
    let cost = UNEXPLAINED * unexplained.min(MOST_UNEXPLAINED * explained) + BEYOND_COST * beyond * mean * ends as f64;
    let along = seen.iter().filter(|&&index| model.lines[index].is_along).count();
    Features {
        score: (total - cost) / unit,
        recall: found / f64::max(all, 1.0),
        explained: explained / f64::max(explained + all_painted, 1.0),
        beyond,
        visible: lines.iter().filter(|(is_visible, _)| *is_visible).count(),
        lines,
        seen: seen.len(),
        along,
        across: seen.len() - along,
    }
}

/// Width of a line's paint in the picture, px: the median over its length; 0 where it is behind the camera.
fn width(view: &View, line: &ModelLine) -> f64 {
    let along = line.direction();
    let at = |index: usize| {
        let middle = line.at(0.05 + 0.9 * index as f64 / 8.0);
        let image = |off: Vector3<f64>| view.image(&(middle + off));
        let direction = (image(along * 1e-3)? - image(along * -1e-3)?).try_normalize(0.0)?;
        Some((image(line.half_width)? - image(-line.half_width)?).perp(&direction).abs())
    };
    median((0..9).filter_map(at)).unwrap_or(0.0)
}

/// The fraction seen of what lies beyond the ends of the lines that are seen, where no other line goes on; and how many such ends.
fn beyond(evidence: &Evidence, model: &CourtModel, view: &View, seen: &[usize]) -> (f64, usize) {
    let is_covered = |at: Point3<f64>, by: &ModelLine| {
        let (along, length) = (by.direction(), (by.ends[1] - by.ends[0]).norm());
        let fraction = (at - by.ends[0]).dot(&along);
        let off = (at - by.ends[0] - fraction * along).norm();
        off < SAME_PLACE && fraction > -REACH && fraction < length + REACH
    };
    let scale = Scale { tolerance: BEYOND_TOLERANCE, longest: f64::INFINITY, samples: BEYOND_SAMPLES };
    let (mut found, mut all, mut count) = (0.0, 0.0, 0);
    for &index in seen {
        for part in BEYOND {
            let ends = part.map(|fraction| model.lines[index].at(fraction));
            let middle = nalgebra::center(&ends[0], &ends[1]);
            if model.lines.iter().enumerate().any(|(other, line)| other != index && is_covered(middle, line)) {
                continue;
            }
            let shown = shown(&evidence.maps, view, &ends, &scale);
            if shown.length > BEYOND_SHORTEST {
                found += shown.length * shown.fraction / ALL_SEEN;
                all += shown.length;
                count += 1;
            }
        }
    }
    (found / f64::max(all, 1.0), count)
}

/// Length of the segments that the court's lines explain, px. Then that of the unexplained segments that have the colour of its paint: inside the
/// court, and anywhere, px.
fn explained(evidence: &Evidence, model: &CourtModel, view: &View) -> [f64; 3] {
    let segments = &evidence.segments.all;
    let images: Vec<[Point2<f64>; 2]> = model.lines.iter().filter_map(|line| clipped_ends(view, &line.ends)).collect();
    let is_explained: Vec<bool> =
        segments.iter().map(|segment| images.iter().any(|line| explains(line, segment))).collect();
    let lengths = || segments.iter().zip(&is_explained);
    let explained = lengths().filter(|(_, is)| **is).map(|(segment, _)| segment.length()).sum();
    let Some(paint) = paint(evidence, &is_explained) else { return [0.0; 3] };
    let Some(ground) = ground_from_image(model, view) else { return [explained, 0.0, 0.0] };
    let is_painted = |colour: &[f32; 3]| {
        let square = |channel: usize| COLOUR_WEIGHTS[channel] * (colour[channel] - paint[channel]).powi(2);
        (0..3).map(square).sum::<f32>().sqrt() < SAME_COLOUR
    };
    let (mut inside, mut anywhere) = (0.0, 0.0);
    for ((segment, is_explained), colour) in lengths().zip(&evidence.colours) {
        if !is_explained && is_painted(colour) {
            anywhere += segment.length();
            inside += if is_inside(model, &ground, view, segment) { segment.length() } else { 0.0 };
        }
    }
    [explained, inside, anywhere]
}

/// Whether a segment lies on a line's image.
fn explains([from, to]: &[Point2<f64>; 2], segment: &Segment) -> bool {
    let Some(along) = (to - from).try_normalize(1e-9) else { return false };
    let length = (to - from).norm();
    let off = |at: Point2<f64>| {
        let distance = (at - from).dot(&along);
        (at - from).perp(&along).abs() + (-distance).max(distance - length).max(0.0)
    };
    [segment.ends[0], segment.ends[1], segment.middle()].into_iter().all(|at| off(at) < EXPLAINED)
}

/// The colour of the paint: the median over the explained segments, weighted by their lengths; [`None`] if there are none.
fn paint(evidence: &Evidence, is_explained: &[bool]) -> Option<[f32; 3]> {
    let mut all: Vec<usize> = (0..is_explained.len()).filter(|&index| is_explained[index]).collect();
    let length = |index: usize| evidence.segments.all[index].length();
    let half = all.iter().map(|&index| length(index)).sum::<f64>() / 2.0;
    let last = *all.last()?;
    Some(from_fn(|channel| {
        let value = |index: usize| evidence.colours[index][channel];
        all.sort_by(|&a, &b| value(a).total_cmp(&value(b)));
        let mut sum = 0.0;
        let middle = all.iter().find(|&&index| {
            sum += length(index);
            sum >= half
        });
        value(*middle.unwrap_or(&last))
    }))
}

/// Maps homogeneous image points, from the principal point and in focal lengths, to the court's plane, m.
fn ground_from_image(model: &CourtModel, view: &View) -> Option<Matrix3<f64>> {
    let column = |axis: usize| view.rotation.column(axis).into_owned();
    Matrix3::from_columns(&[column(0), column(1), column(2) * model.height + view.translation]).try_inverse()
}

/// Whether the middle of a segment lies in the court.
fn is_inside(model: &CourtModel, ground: &Matrix3<f64>, view: &View, segment: &Segment) -> bool {
    let at: Vector2<f64> = (segment.middle().coords - view.centre) / view.focal;
    let place = ground * at.push(1.0);
    let is_within = |axis: usize| match (model.crossings[axis].first(), model.crossings[axis].last()) {
        (Some(first), Some(last)) => (*first..*last).contains(&(place[axis] / place.z)),
        _ => false,
    };
    place.z > 0.0 && is_within(0) && is_within(1)
}
