//! Motion with a closed form.

use nalgebra::Vector3;

use super::approach::Path;
use crate::columns::{Columns, column, part};
use crate::force::Linear;

/// Largest exponent of a spin that grows backwards in time: beyond, it overflows.
const LARGEST_EXPONENT: f64 = 700.0;
/// Cosine between normals below which a face's force does not act along the other.
const PERPENDICULAR: f64 = 1e-12;

/// `r̈ = pull − stiffness·r`, solved; where the ball presses on a face, with that face's force.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ClosedForm {
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

impl ClosedForm {
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

/// An arc from a state on.
pub(crate) struct Course<'a> {
    pub arc: &'a ClosedForm,
    pub start: Columns<1>,
}

impl Path for Course<'_> {
    fn at(&self, t: f64) -> (Vector3<f64>, Vector3<f64>) {
        let y = self.arc.at(&self.start, t);
        (y.position(), y.velocity())
    }

    fn acceleration(&self) -> Vector3<f64> {
        let (ClosedForm { linear, press, .. }, r) = (self.arc, self.start.position());
        let pressed = |press: &Press| press.stiffness * (press.level - press.normal.dot(&r)) * press.normal;
        linear.pull - linear.stiffness * r + press.as_ref().map_or(Vector3::zeros(), pressed)
    }

    /// Each of the motion's directions swings with its own stiffness ω², and |ẍ| ≤ |ẍ₀| + ω·|ẋ₀|.
    fn bound(&self) -> f64 {
        let stiffest = self.arc.linear.stiffness + self.arc.press.map_or(0.0, |press| press.stiffness);
        self.acceleration().norm() + stiffest.sqrt() * self.start.velocity().norm()
    }

    /// What swings and starts at rest stays on the side to which it is pulled: outside the tangent plane.
    fn slides_along(&self, normal: &Vector3<f64>) -> bool {
        let unpressed = self.arc.press.is_none_or(|press| press.normal.dot(normal).abs() < PERPENDICULAR);
        unpressed && normal.dot(&self.acceleration()) >= 0.0
    }
}
