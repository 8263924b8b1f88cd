//! Views of a court that four lines of a picture allow.

use nalgebra::{Point2, Point3, Vector3};

use super::evidence::Evidence;
use super::lines::PictureLine;
use super::model::CourtModel;
use super::score::{Scale, score};
use super::square::{Fit, Square};
use super::view::View;

/// Tolerance of the search, px; all of a line, at most this fraction of the picture's width, counts. Measured on 41 scenes.
const TOLERANCE: f64 = 5.0;
pub(super) const LONGEST: f64 = 0.4;
/// Samples of a line, and those that come first, with a wider tolerance, to drop most hypotheses.
const SAMPLES: usize = 24;
const FIRST_SAMPLES: usize = 5;
const FIRST_TOLERANCE: f64 = 1.5 * TOLERANCE;
/// Fraction of the score to beat that the first samples must reach.
const PROMISING: f64 = 0.6;
/// Least score, in units.
const LEAST_SCORE: f64 = 0.05;
/// How many hypotheses are kept. Measured: the right one was among the best 18 of all 41 scenes.
const KEPT: usize = 18;
/// Hypotheses are the same whose focal lengths, rotations (sum over the matrix) and translations differ by less than these fractions.
const SAME: [f64; 3] = [0.05, 0.06, 0.04];
/// Height of the camera above the court: from this fraction of the court's size to that, or to this many metres.
const HEIGHT: [f64; 2] = [0.04, 1.6];
const HIGHEST: f64 = 25.0;
/// Distance of the camera: up to this many times the court's size, or this many metres.
const DISTANCE: f64 = 5.0;
const FARTHEST: f64 = 80.0;
/// Least z component of the camera's downward axis in the world, downward: cameras do not look straight down.
const LEAST_DOWN: f64 = 0.3;
/// Most roll, rad.
const ROLL: f64 = 0.5;
/// Lines shorter than this, in units, are no side of a quadrilateral; and most lines.
const SHORTEST: f64 = 0.025;
const MOST_LINES: usize = 80;
/// Two lines meet where they are seen: no farther beyond their ends than this fraction of their length, plus this, px.
const BEYOND: f64 = 0.08;
const BEYOND_PX: f64 = 6.0;
/// Least sine of the angle between lines that meet: 5°.
const LEAST_ANGLE: f64 = 0.087;
/// Most pairs of opposite sides, by the length of the shorter one; and most lines that cross both.
const MOST_PAIRS: usize = 1500;
const MOST_CROSSING: usize = 10;
/// Most rectangles of the court that are fitted to quadrilaterals, at about 5 µs each. Five tennis videos needed up to 13,000; a picture
/// of tiles has millions.
const MOST_FITTED: usize = 100_000;

/// A view with its score, px.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hypothesis {
    pub score: f64,
    pub view: View,
}

/// The search for one court in one picture.
pub(super) struct Search<'a> {
    evidence: &'a Evidence,
    model: &'a CourtModel,
    lines: Vec<[Point3<f64>; 2]>,
    /// The best, best first.
    best: Vec<Hypothesis>,
    /// Rectangles fitted so far.
    fitted: usize,
}

impl<'a> Search<'a> {
    pub(super) fn new(evidence: &'a Evidence, model: &'a CourtModel) -> Self {
        Self { evidence, model, lines: model.lines.iter().map(|line| line.ends).collect(), best: Vec::new(), fitted: 0 }
    }

    /// The best views of quadrilaterals whose corners are seen: two lines that do not meet, and two that meet both.
    pub(super) fn by_corners(mut self) -> Vec<Hypothesis> {
        let unit = self.evidence.unit();
        let long = self.evidence.lines.iter().filter(|line| line.support > SHORTEST * unit);
        let lines: Vec<&PictureLine> = long.take(MOST_LINES).collect();
        let equations: Vec<Vector3<f64>> = lines.iter().map(|line| self.evidence.centred(line)).collect();
        let meets: &Vec<Vec<bool>> =
            &lines.iter().map(|a| lines.iter().map(|b| do_meet(a, b) && do_meet(b, a)).collect()).collect();
        let crossing = |a: usize, b: usize| (0..lines.len()).filter(move |&c| meets[a][c] && meets[b][c]);
        let mut pairs = Vec::new();
        for (a, meets) in meets.iter().enumerate() {
            let opposite = (a + 1..lines.len()).filter(|&b| !meets[b] && crossing(a, b).nth(1).is_some());
            pairs.extend(opposite.map(|b| [a, b]));
        }
        // Lines are sorted by support.
        pairs.sort_by(|[_, a], [_, b]| lines[*b].support.total_cmp(&lines[*a].support));
        for [a, b] in pairs.into_iter().take(MOST_PAIRS) {
            let across: Vec<Vector3<f64>> = crossing(a, b).take(MOST_CROSSING).map(|index| equations[index]).collect();
            let pair = [equations[a], equations[b]];
            self.add(&pair, &across, Fit::CORNERS);
            self.add(&across, &pair, Fit::CORNERS);
        }
        self.best
    }

    /// The best views of quadrilaterals whose sides are lines of two families, as equations in units.
    pub(super) fn by_families(mut self, families: &[[Vec<Vector3<f64>>; 2]]) -> Vec<Hypothesis> {
        for [first, second] in families {
            self.add(first, second, Fit::LINES);
        }
        self.best
    }

    /// Adds the views in which two lines of `along` run along the court's y axis, and two of `across` along its x axis.
    fn add(&mut self, along: &[Vector3<f64>], across: &[Vector3<f64>], fit: Fit) {
        let model = self.model;
        let [xs, ys] = &model.crossings;
        for [left, right] in pairs_of(along) {
            for [near, far] in pairs_of(across) {
                if self.fitted > MOST_FITTED {
                    return;
                }
                let Some(square) = Square::between([left, right], [near, far]) else { continue };
                for x in pairs_of(xs) {
                    for y in pairs_of(ys) {
                        let Some(views) = square.views(x.map(|x| *x), y.map(|y| *y), model.height, fit) else {
                            continue;
                        };
                        self.fitted += 1;
                        views.for_each(|view| self.consider(view));
                    }
                }
            }
        }
    }

    /// Keeps a view, in units, if it is a likely one and among the best.
    fn consider(&mut self, view: View) {
        let (evidence, unit) = (self.evidence, self.evidence.unit());
        let view = View { focal: view.focal * unit, centre: evidence.centre(), ..view };
        if !is_likely(&view, self.model) {
            return;
        }
        let is_full = self.best.len() == KEPT;
        let least = self.best.last().filter(|_| is_full).map_or(LEAST_SCORE * unit, |worst| worst.score);
        let scored = |tolerance: f64, samples: usize| {
            let scale = Scale { tolerance, longest: LONGEST * unit, samples };
            score(&evidence.maps, &view, self.lines.iter(), &scale)
        };
        if scored(FIRST_TOLERANCE, FIRST_SAMPLES) < PROMISING * least {
            return;
        }
        let score = scored(TOLERANCE, SAMPLES);
        if score.is_nan() || score <= least {
            return;
        }
        if let Some(same) = self.best.iter().position(|other| are_same(&other.view, &view)) {
            if self.best[same].score >= score {
                return;
            }
            self.best.remove(same);
        }
        let place = self.best.partition_point(|other| other.score >= score);
        self.best.insert(place, Hypothesis { score, view });
        self.best.truncate(KEPT);
    }
}

/// Whether a camera may stand there and look so.
fn is_likely(view: &View, model: &CourtModel) -> bool {
    let place = view.place();
    let height = place.z - model.height;
    let is_high = height >= HEIGHT[0] * model.size && height <= (HEIGHT[1] * model.size).max(HIGHEST);
    let is_near = place.xy().norm() <= (DISTANCE * model.size).max(FARTHEST);
    let down = -view.rotation[(1, 2)];
    let roll = view.rotation[(0, 2)].atan2(down);
    view.is_finite() && is_high && is_near && down >= LEAST_DOWN && roll.abs() <= ROLL
}

fn are_same(a: &View, b: &View) -> bool {
    let sum = |numbers: &[f64]| numbers.iter().map(|number| number.abs()).sum::<f64>();
    (a.focal / b.focal - 1.0).abs() < SAME[0]
        && sum((a.rotation - b.rotation).as_slice()) < SAME[1]
        && sum((a.translation - b.translation).as_slice()) < SAME[2] * sum(b.translation.as_slice())
}

/// Whether `a` is seen where `b` meets it.
fn do_meet(a: &PictureLine, b: &PictureLine) -> bool {
    let cross = a.equation.cross(&b.equation);
    let Some(place) = Point2::from_homogeneous(cross).filter(|_| cross.z.abs() > LEAST_ANGLE) else { return false };
    let (length, along) = (a.length(), (place - a.ends[0]).dot(&a.direction));
    let beyond = BEYOND_PX + BEYOND * length;
    along > -beyond && along < length + beyond
}

/// All pairs of two of them, in order.
fn pairs_of<T>(all: &[T]) -> impl Iterator<Item = [&T; 2]> {
    all.iter().enumerate().flat_map(|(index, first)| all[index + 1..].iter().map(move |second| [first, second]))
}
