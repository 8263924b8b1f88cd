//! Families of parallel lines, for courts whose corners are out of view or hidden.

use nalgebra::{Vector2, Vector3};

use super::evidence::Evidence;
use super::lines::PictureLine;

/// Most lines of the picture that are considered, and of a family.
const MOST_LINES: usize = 70;
const MOST_OF_FAMILY: usize = 12;
/// Most vanishing points, and most pairs of them.
const MOST_POINTS: usize = 30;
const MOST_PAIRS: usize = 30;
/// Sine of the angle, 1.2°, within which a line points to a vanishing point, and what short lines add, units, with their least length.
const TOWARDS: f64 = 0.020_94;
const TOWARDS_SHORT: f64 = 0.0015;
const SHORT: f64 = 0.02;
/// A line counts for no more than this length, units.
const LONGEST: f64 = 0.35;
/// Two points are the same if they share this fraction of their lines.
const SAME: f64 = 0.55;
/// A finite vanishing point (z above this) is at most this far below the picture's middle, units; the ground's lines meet on a horizon
/// that is above the lower part of the picture.
const FINITE: f64 = 0.15;
const LOWEST: f64 = 0.25;
/// Most slope of the direction to an infinitely far one.
const LEVEL: f64 = 0.5;
/// Two points must be orthogonal for one of these focal lengths: so many, from the first to the last, units.
const FOCALS: [f64; 2] = [0.4, 9.0];
const FOCAL_STEPS: i32 = 14;
/// Most cosine between them.
const ORTHOGONAL: f64 = 0.12;
/// Most slope of the horizon.
const HORIZON_SLOPE: f64 = 0.55;
/// Weight of the longer of two families.
const LONGER: f64 = 0.3;

/// A vanishing point and the lines that point to it.
struct VanishingPoint {
    /// Homogeneous, from the picture's middle, in units; norm 1.
    at: Vector3<f64>,
    is_member: Vec<bool>,
    /// Length of its lines, px.
    support: f64,
}

/// Pairs of families of lines that may be parallel and at right angles on a level ground, as equations in units; both ways round, the
/// best supported first.
pub(super) fn families(evidence: &Evidence) -> Vec<[Vec<Vector3<f64>>; 2]> {
    let lines = &evidence.lines[..evidence.lines.len().min(MOST_LINES)];
    let equations: Vec<Vector3<f64>> = lines.iter().map(|line| evidence.centred(line)).collect();
    let points = points(evidence, lines, &equations);
    let mut pairs = Vec::new();
    for (first, a) in points.iter().enumerate() {
        for (second, b) in points.iter().enumerate().filter(|(second, _)| *second != first) {
            if are_orthogonal(&a.at, &b.at) && is_level(&a.at.cross(&b.at)) {
                let support = a.support.min(b.support) + LONGER * a.support.max(b.support);
                pairs.push((support, [first, second]));
            }
        }
    }
    pairs.sort_by(|a, b| b.0.total_cmp(&a.0));
    // Lines are sorted by support.
    let family = |point: usize| {
        let members = equations.iter().zip(&points[point].is_member).filter(|(_, is_member)| **is_member);
        members.map(|(equation, _)| *equation).take(MOST_OF_FAMILY).collect()
    };
    pairs.into_iter().take(MOST_PAIRS).map(|(_, pair)| pair.map(family)).collect()
}

/// Vanishing points of pairs of lines, the best supported first.
fn points(evidence: &Evidence, lines: &[PictureLine], equations: &[Vector3<f64>]) -> Vec<VanishingPoint> {
    let unit = evidence.unit();
    let mut all = Vec::new();
    for (index, first) in equations.iter().enumerate() {
        for second in &equations[index + 1..] {
            let Some(at) = first.cross(second).try_normalize(1e-12).filter(is_on_horizon) else { continue };
            let is_member: Vec<bool> = lines.iter().map(|line| points_to(evidence, line, &at)).collect();
            let members = lines.iter().zip(&is_member).filter(|(_, is_member)| **is_member);
            let support = members.map(|(line, _)| line.support.min(LONGEST * unit)).sum();
            all.push(VanishingPoint { at, is_member, support });
        }
    }
    all.sort_by(|a, b| b.support.total_cmp(&a.support));
    let mut kept: Vec<VanishingPoint> = Vec::new();
    for point in all {
        let is_family = point.is_member.iter().filter(|is_member| **is_member).count() >= 2;
        if is_family && !kept.iter().any(|other| overlap(&other.is_member, &point.is_member) > SAME) {
            kept.push(point);
        }
        if kept.len() >= MOST_POINTS {
            break;
        }
    }
    kept
}

/// The fraction of the lines of two families that both have.
fn overlap(a: &[bool], b: &[bool]) -> f64 {
    let count = |of: fn(bool, bool) -> bool| a.iter().zip(b).filter(|(a, b)| of(**a, **b)).count() as f64;
    count(|a, b| a && b) / count(|a, b| a || b).max(1.0)
}

fn points_to(evidence: &Evidence, line: &PictureLine, at: &Vector3<f64>) -> bool {
    let unit = evidence.unit();
    let middle: Vector2<f64> = (line.middle.coords - evidence.centre()) / unit;
    let Some(towards) = (at.xy() - middle * at.z).try_normalize(1e-12) else { return false };
    towards.perp(&line.direction).abs() < TOWARDS + TOWARDS_SHORT / (line.length() / unit).max(SHORT)
}

/// Whether lines on a level ground, seen from above, may meet there.
fn is_on_horizon(at: &Vector3<f64>) -> bool {
    let deep = at.z.abs();
    if deep > FINITE { at.y * at.z.signum() < LOWEST * deep } else { at.y.abs() < LEVEL * at.x.abs() }
}

/// Whether the directions of two vanishing points are at right angles for some focal length.
fn are_orthogonal(a: &Vector3<f64>, b: &Vector3<f64>) -> bool {
    let ratio = FOCALS[1] / FOCALS[0];
    let cosine = |step: i32| {
        let focal = FOCALS[0] * ratio.powf(f64::from(step) / f64::from(FOCAL_STEPS - 1));
        let [a, b] = [a, b].map(|at| Vector3::new(at.x / focal, at.y / focal, at.z));
        a.dot(&b) / (a.norm() * b.norm())
    };
    (0..FOCAL_STEPS).any(|step| cosine(step).abs() <= ORTHOGONAL)
}

/// Whether a horizon is about level and above the lower part of the picture.
fn is_level(horizon: &Vector3<f64>) -> bool {
    horizon.xy().norm() > 1e-9 && horizon.x.abs() <= HORIZON_SLOPE * horizon.y.abs() && -horizon.z / horizon.y <= LOWEST
}
