//! The search for the first contact along a path.

use nalgebra::Vector3;

use crate::obstacle::Obstacle;

/// Gap below which a ball touches, m.
pub(crate) const TOUCH: f64 = 1e-10;
/// Normal speed below which a touching ball does not approach, m/s.
pub(crate) const STILL: f64 = 1e-9;
/// Smallest advance of the search beside a surface that the ball just touches, s.
const MIN_ADVANCE: f64 = 1e-7;
/// Evaluations of a distance after which the search stops beside an obstacle that is only grazed.
const MAX_EVALUATIONS: usize = 2000;

/// A twice differentiable path from time 0 on.
pub(crate) trait Path {
    /// Position and velocity after `t` s.
    fn at(&self, t: f64) -> (Vector3<f64>, Vector3<f64>);
    /// Acceleration at the start, m/s².
    fn acceleration(&self) -> Vector3<f64>;
    /// Upper bound of the acceleration's size all along, m/s².
    fn bound(&self) -> f64;
    /// Whether an obstacle with this `normal` that the path's start touches, and to which it neither moves nor turns,
    /// need not be looked at again along it.
    fn slides_along(&self, normal: &Vector3<f64>) -> bool;
}

/// How far a path was followed.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reached {
    /// Up to here nothing is passed, s.
    pub time: f64,
    /// What is touched then, if anything.
    pub obstacle: Option<usize>,
}

/// When and with which obstacle a ball of `radius` first touches along `path` before `duration`, s.
///
/// Conservative advancement: the distance d to a convex obstacle along a straight line is convex, so
/// along the path d(t + h) ≥ d + ḋ·h − ½·bound·h². Stepping to this bound's zero never passes a
/// contact and converges like Newton's method.
pub(crate) fn first_contact(
    obstacles: &[Obstacle],
    skip: &[usize],
    radius: f64,
    path: &impl Path,
    duration: f64,
) -> Reached {
    let (start, bound) = (path.at(0.0), path.bound());
    let mut first = Reached { time: duration, obstacle: None };
    for (index, obstacle) in obstacles.iter().enumerate().filter(|(index, _)| !skip.contains(index)) {
        let reach = (start.1.norm() + 0.5 * bound * first.time) * first.time;
        if obstacle.distance(&start.0) - radius <= reach {
            let touches = contact(obstacle, radius, path, start, bound, first.time);
            first = touches.map_or(first, |(time, hit)| Reached { time, obstacle: hit.then_some(index) });
        }
    }
    first
}

/// When the ball touches this obstacle before `limit`, s; or (`false`) when the search stopped short of it.
fn contact(
    obstacle: &Obstacle,
    radius: f64,
    path: &impl Path,
    start: (Vector3<f64>, Vector3<f64>),
    bound: f64,
    limit: f64,
) -> Option<(f64, bool)> {
    let mut t = 0.0;
    for _ in 0..MAX_EVALUATIONS {
        let (r, v) = if t == 0.0 { start } else { path.at(t) };
        let near = obstacle.nearest(&r);
        let (gap, rate) = (near.distance - radius, near.normal.dot(&v));
        let mut shortest = 0.0;
        if gap <= TOUCH {
            if rate < -STILL {
                // the last bit of the way
                return Some(((t + (gap / -rate).max(0.0)).min(limit), true));
            }
            if t == 0.0 && rate <= STILL {
                if near.normal.dot(&path.acceleration()) + (near.curvature * v).dot(&v) < 0.0 {
                    return Some((0.0, true));
                }
                if path.slides_along(&near.normal) {
                    return None;
                }
            }
            shortest = MIN_ADVANCE;
        }
        let discriminant = (rate * rate + 2.0 * bound * gap.max(0.0)).sqrt();
        // of the two forms of the root, the one without cancellation
        let advance = match rate < 0.0 {
            true => 2.0 * gap.max(0.0) / (discriminant - rate),
            false if bound > 0.0 => (rate + discriminant) / bound,
            false => f64::INFINITY,
        };
        t += advance.max(shortest);
        if t.is_nan() || t >= limit {
            return None;
        }
    }
    Some((t, false))
}
