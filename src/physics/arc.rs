//! Motion with a closed form, and the search for the first contact along any path.

use nalgebra::Vector3;

use super::columns::{Columns, column, part};
use super::field::Linear;
use super::obstacle::Obstacle;

/// Gap below which a ball touches, m.
pub(crate) const TOUCH: f64 = 1e-10;
/// Normal speed below which a touching ball does not approach, m/s.
pub(crate) const STILL: f64 = 1e-9;
/// Largest exponent of a spin that grows backwards in time: beyond, it overflows.
const LARGEST_EXPONENT: f64 = 700.0;
/// Smallest advance of the contact search beside a surface that the ball just touches, s.
const MIN_ADVANCE: f64 = 1e-7;
/// Evaluations of a distance before the search gives up on an obstacle that is only grazed.
const MAX_EVALUATIONS: usize = 2000;

/// `r̈ = pull − stiffness·r`, solved; where the ball presses on a face, with that face's force.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Arc {
    pub linear: Linear,
    pub spin_decay: f64,
    pub press: Option<Press>,
}

/// The force of a soft face: `stiffness·(level − normal·r)` along its normal.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Press {
    pub normal: Vector3<f64>,
    pub stiffness: f64,
    /// `normal·r` at which the ball just touches, m.
    pub level: f64,
}

/// Weights of `ẍ = pull − stiffness·x` after a time: `x = c·x₀ + s·v₀ + forced·pull`.
struct Weights {
    stiffness: f64,
    c: f64,
    s: f64,
    forced: f64,
}

impl Weights {
    fn new(stiffness: f64, t: f64) -> Self {
        let omega = stiffness.sqrt();
        // sin(ωt)/ω and (1 − cos ωt)/ω² without dividing by a small ω²
        let small = omega * t.abs() < 1e-9;
        let s = if small { t } else { (omega * t).sin() / omega };
        let half = if small { t / 2.0 } else { (0.5 * omega * t).sin() / omega };
        Self { stiffness, c: (omega * t).cos(), s, forced: 2.0 * half * half }
    }

    fn of(&self, r: Vector3<f64>, v: Vector3<f64>, pull: Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let moved = self.c * r + self.s * v + self.forced * pull;
        (moved, self.c * v - self.stiffness * self.s * r + self.s * pull)
    }
}

impl Arc {
    /// State and sensitivities after `t` s.
    pub fn at<const M: usize>(&self, start: &Columns<M>, t: f64) -> Columns<M> {
        let Linear { pull, stiffness } = self.linear;
        let free = Weights::new(stiffness, t);
        let pressed = self.press.map(|press| (press, Weights::new(stiffness + press.stiffness, t)));
        let decay = if self.spin_decay == 0.0 { 1.0 } else { (-self.spin_decay * t).min(LARGEST_EXPONENT).exp() };
        let mut out = *start;
        for (index, values) in out.0.iter_mut().enumerate() {
            let (r, v, w) = (part(values, 0), part(values, 1), part(values, 2));
            let is_state = f64::from(u8::from(index == 0));
            let (mut r_moved, mut v_moved) = free.of(r, v, is_state * pull);
            if let Some((press, weights)) = &pressed {
                // along the normal, the stiffer motion instead
                let along = |x: Vector3<f64>| press.normal * press.normal.dot(&x);
                let pull = is_state * (along(pull) + press.stiffness * press.level * press.normal);
                let (r_pressed, v_pressed) = weights.of(along(r), along(v), pull);
                r_moved += r_pressed - along(r_moved);
                v_moved += v_pressed - along(v_moved);
            }
            *values = column(r_moved, v_moved, decay * w);
        }
        out
    }

    /// Position and velocity after `t` s.
    pub fn state_at(&self, start: &Columns<1>, t: f64) -> (Vector3<f64>, Vector3<f64>) {
        let y = self.at(start, t);
        (y.position(), y.velocity())
    }

    /// Acceleration, m/s².
    pub fn acceleration(&self, r: &Vector3<f64>) -> Vector3<f64> {
        let press = self
            .press
            .map_or(Vector3::zeros(), |press| press.stiffness * (press.level - press.normal.dot(r)) * press.normal);
        self.linear.pull - self.linear.stiffness * r + press
    }

    /// Bound of the acceleration's size along the way, m/s².
    pub fn acceleration_bound(&self, r: &Vector3<f64>, v: &Vector3<f64>) -> f64 {
        let stiffest = self.linear.stiffness + self.press.map_or(0.0, |press| press.stiffness);
        self.acceleration(r).norm() + stiffest.sqrt() * v.norm()
    }

    /// When a pressing ball leaves the face (its force back at zero, outwards), s, and how deep it gets, m.
    pub fn release(&self, start: &Columns<1>, press: &Press) -> (f64, f64) {
        let stiffness = self.linear.stiffness + press.stiffness;
        let omega = stiffness.sqrt();
        let centre = (press.normal.dot(&self.linear.pull) + press.stiffness * press.level) / stiffness;
        let (x, v) = (press.normal.dot(&start.position()) - centre, press.normal.dot(&start.velocity()) / omega);
        let (amplitude, phase) = (x.hypot(v), v.atan2(x));
        let depth = press.level - (centre - amplitude);
        let height = (press.level - centre) / amplitude;
        if height.is_nan() || height.abs() > 1.0 {
            return (f64::INFINITY, depth); // pressed down for good
        }
        let turn = std::f64::consts::TAU;
        let angle = (phase - height.acos()).rem_euclid(turn);
        // a start at the very release is a whole turn away
        (if angle < 1e-9 { angle + turn } else { angle } / omega, depth)
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
            if t.is_nan() || t >= limit {
                break;
            }
        }
    }
    first
}
