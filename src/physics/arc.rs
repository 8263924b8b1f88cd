//! Motion with a closed form, and the search for the first contact along any path.

use nalgebra::Vector3;

use super::columns::{Columns, column, part};
use super::field::Linear;
use super::obstacle::Obstacle;

/// Gap below which a ball touches, m.
pub(crate) const TOUCH: f64 = 1e-10;
/// Normal speed below which a touching ball does not approach, m/s.
pub(crate) const STILL: f64 = 1e-9;
/// Smallest advance of the contact search beside a surface that the ball just touches, s.
const MIN_ADVANCE: f64 = 1e-7;
/// Evaluations of a distance before the search gives up on an obstacle that is only grazed.
const MAX_EVALUATIONS: usize = 2000;

/// `r̈ = pull − stiffness·r`, solved.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Arc {
    pub linear: Linear,
    pub spin_decay: f64,
}

impl Arc {
    /// State and sensitivities after `t` s.
    pub fn at<const M: usize>(&self, start: &Columns<M>, t: f64) -> Columns<M> {
        let Linear { pull, stiffness } = self.linear;
        let omega = stiffness.sqrt();
        let (sine, cosine) = (omega * t).sin_cos();
        // sin(ωt)/ω and (1 − cos ωt)/ω² without dividing by a small ω²
        let s = if omega * t.abs() < 1e-9 { t } else { sine / omega };
        let half = if omega * t.abs() < 1e-9 { t / 2.0 } else { (0.5 * omega * t).sin() / omega };
        let forced = 2.0 * half * half;
        let decay = if self.spin_decay == 0.0 { 1.0 } else { (-self.spin_decay * t).exp() };
        let mut out = *start;
        for (index, values) in out.0.iter_mut().enumerate() {
            let (r, v, w) = (part(values, 0), part(values, 1), part(values, 2));
            let pull = if index == 0 { pull } else { Vector3::zeros() };
            *values = column(
                cosine * r + s * v + forced * pull,
                cosine * v - stiffness * s * r + s * pull,
                decay * w,
            );
        }
        out
    }

    /// Position and velocity after `t` s.
    pub fn state_at(&self, start: &Columns<1>, t: f64) -> (Vector3<f64>, Vector3<f64>) {
        let y = self.at(start, t);
        (y.position(), y.velocity())
    }

    /// Bound of the acceleration's size, m/s².
    pub fn acceleration_bound(&self, r: &Vector3<f64>, v: &Vector3<f64>) -> f64 {
        let Linear { pull, stiffness } = self.linear;
        (pull - stiffness * r).norm() + stiffness.sqrt() * v.norm()
    }
}

/// When and with which obstacle a ball of `radius` first touches along `path` (position and velocity
/// by time) before `duration`, s. `acceleration` is the one at its start, `bound` bounds its size all along.
///
/// Conservative advancement: the distance d to a convex obstacle along a straight line is convex, so
/// along the path d(t + h) ≥ d + ḋ·h − ½·bound·h². Stepping to this bound's zero never passes a
/// contact and converges like Newton's method.
pub(crate) fn first_contact(
    obstacles: &[Obstacle],
    skip: &[usize],
    radius: f64,
    path: impl Fn(f64) -> (Vector3<f64>, Vector3<f64>),
    acceleration: &Vector3<f64>,
    bound: f64,
    duration: f64,
) -> Option<(f64, usize)> {
    let (r0, v0) = path(0.0);
    let mut first: Option<(f64, usize)> = None;
    for (index, obstacle) in obstacles.iter().enumerate() {
        if skip.contains(&index) {
            continue;
        }
        let limit = first.map_or(duration, |(t, _)| t);
        let reach = (v0.norm() + 0.5 * bound * limit) * limit;
        if obstacle.distance(&r0) - radius > reach {
            continue;
        }
        let mut t = 0.0;
        for _ in 0..MAX_EVALUATIONS {
            let (r, v) = if t == 0.0 { (r0, v0) } else { path(t) };
            let near = obstacle.nearest(&r);
            let (gap, rate) = (near.distance - radius, near.normal.dot(&v));
            if gap <= TOUCH {
                let still = rate.abs() <= STILL;
                let pressed = near.normal.dot(acceleration) + (near.curvature * v).dot(&v) < 0.0;
                if t == 0.0 && still && !pressed {
                    break; // slides along
                }
                if rate < -STILL || (t == 0.0 && still) {
                    // the last bit of the way
                    let rest = if rate < -STILL { (gap / -rate).max(0.0) } else { 0.0 };
                    first = Some(((t + rest).min(limit), index));
                    break;
                }
            }
            let discriminant = (rate * rate + 2.0 * bound * gap.max(0.0)).sqrt();
            // of the two forms of the root, the one without cancellation
            let advance = match rate < 0.0 {
                true => 2.0 * gap.max(0.0) / (discriminant - rate),
                false if bound > 0.0 => (rate + discriminant) / bound,
                false => f64::INFINITY,
            };
            t += if gap <= TOUCH { advance.max(MIN_ADVANCE) } else { advance };
            if !(t < limit) {
                break;
            }
        }
    }
    first
}
