//! Integrators: one step of an ordinary differential equation, sensitivities included.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::approach::Path;
use crate::columns::{Column, Columns, part};
use crate::force::Forces;

/// How the equations of motion are solved where no closed form is used.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "method", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Integrator {
    /// Dormand–Prince 5(4), adaptive. Dormand & Prince 1980; dense output after Hairer, Nørsett & Wanner 1993, II.6.
    DormandPrince {
        /// Tolerance relative to the state.
        rtol: f64,
        /// Absolute tolerance, m, m/s and rad/s.
        atol: f64,
    },
    /// The classical fourth-order method with steps of at most `step` s.
    RungeKutta4 {
        /// s.
        step: f64,
    },
    /// Velocity Verlet, second order, symplectic where forces depend on position only; steps of at most `step` s.
    VelocityVerlet {
        /// s.
        step: f64,
    },
}

impl Default for Integrator {
    /// Dormand–Prince at 10⁻⁶: errs 20 µm over a second of the paper's scenes.
    fn default() -> Self {
        Self::DormandPrince { rtol: 1e-6, atol: 1e-6 }
    }
}

/// Something that says how a state moves on.
pub(crate) trait Flow {
    /// Sets `out` to the time derivative of the state and of its sensitivities (the variational equations).
    fn derivative_into<const M: usize>(&self, y: &Columns<M>, out: &mut Columns<M>);
    /// The same, returned.
    fn derivative<const M: usize>(&self, y: &Columns<M>) -> Columns<M> {
        let mut out = Columns::ZERO;
        self.derivative_into(y, &mut out);
        out
    }
    /// Whether the spin changes, or acts.
    fn spins(&self) -> bool;
    /// Whether the spin's error counts beside the velocity's.
    fn spin_errs(&self) -> bool {
        true
    }
}

impl Flow for Forces {
    #[inline]
    fn derivative_into<const M: usize>(&self, y: &Columns<M>, out: &mut Columns<M>) {
        self.free_slope(y, out);
    }

    fn spins(&self) -> bool {
        Self::spins(self)
    }
}

/// One step, and the path in between.
#[derive(Debug, Clone)]
pub(crate) struct Step<const M: usize> {
    pub h: f64,
    pub start: Column,
    pub end: Columns<M>,
    /// From the start's position to the end's, m: their difference without the rounding that far from the origin makes
    /// a slow ball seem to move.
    moved: Vector3<f64>,
    /// Slopes of the state at both ends.
    first: Column,
    pub last: Columns<M>,
    /// Fourth-order correction of the cubic between the ends.
    curve: Column,
    /// Estimated error / tolerance; at most 1 is accepted.
    pub error: f64,
}

/// A way to make one step.
trait Method {
    /// A step of `h` s from `y`, whose slope is `slope`, in the first `R` components of each column.
    fn step<const M: usize, const R: usize>(
        &self,
        flow: &impl Flow,
        y: &Columns<M>,
        slope: &Columns<M>,
        h: f64,
    ) -> Step<M>;
}

impl Integrator {
    /// A step of `h` s from `y`, whose slope is `slope`.
    #[inline]
    pub(super) fn step<const M: usize>(&self, flow: &impl Flow, y: &Columns<M>, slope: &Columns<M>, h: f64) -> Step<M> {
        match flow.spins() {
            true => self.step_of::<M, 9>(flow, y, slope, h),
            false => self.step_of::<M, 6>(flow, y, slope, h),
        }
    }

    #[inline]
    fn step_of<const M: usize, const R: usize>(
        &self,
        flow: &impl Flow,
        y: &Columns<M>,
        slope: &Columns<M>,
        h: f64,
    ) -> Step<M> {
        match *self {
            Self::DormandPrince { rtol, atol } => DormandPrince { rtol, atol }.step::<M, R>(flow, y, slope, h),
            Self::RungeKutta4 { .. } => RungeKutta4.step::<M, R>(flow, y, slope, h),
            Self::VelocityVerlet { .. } => VelocityVerlet.step::<M, R>(flow, y, slope, h),
        }
    }

    /// Longest step, s.
    pub(super) fn max_step(&self) -> f64 {
        match *self {
            Self::DormandPrince { .. } => f64::INFINITY,
            Self::RungeKutta4 { step } | Self::VelocityVerlet { step } => step,
        }
    }

    /// Factor for the next step after one with this error.
    pub(super) fn growth(&self, error: f64) -> f64 {
        match self {
            Self::DormandPrince { .. } => (0.9 * error.max(1e-10).powf(-0.2)).clamp(0.2, 5.0),
            Self::RungeKutta4 { .. } | Self::VelocityVerlet { .. } => f64::INFINITY,
        }
    }
}

impl<const M: usize> Step<M> {
    /// State at `theta` in [0, 1] of the step.
    pub fn at(&self, theta: f64) -> Column {
        let rest = 1.0 - theta;
        std::array::from_fn(|i| {
            let difference = self.end.0[0][i] - self.start[i];
            let bend = self.h * self.first[i] - difference;
            let twist = difference - self.h * self.last.0[0][i] - bend;
            self.start[i] + theta * (difference + rest * (bend + theta * (twist + rest * self.curve[i])))
        })
    }

    /// The position's polynomial in θ: start + θ·(difference + (1−θ)·(bend + θ·(twist + (1−θ)·curve))).
    fn polynomial(&self) -> [Vector3<f64>; 4] {
        let bend = self.h * part(&self.first, 0) - self.moved;
        let twist = self.moved - self.h * part(&self.last.0[0], 0) - bend;
        [self.moved, bend, twist, part(&self.curve, 0)]
    }
}

/// The step's own polynomial, not the solution that it approximates.
impl<const M: usize> Path for Step<M> {
    fn at(&self, t: f64) -> (Vector3<f64>, Vector3<f64>) {
        let theta = t / self.h;
        let [difference, bend, twist, curve] = self.polynomial();
        let slopes =
            [1.0 - 2.0 * theta, theta * (2.0 - 3.0 * theta), 2.0 * theta * (1.0 - theta) * (1.0 - 2.0 * theta)];
        let slope = difference + slopes[0] * bend + slopes[1] * twist + slopes[2] * curve;
        (part(&self.at(theta), 0), slope / self.h)
    }

    fn acceleration(&self) -> Vector3<f64> {
        part(&self.first, 1)
    }

    /// The acceleration, a quadratic in θ, lies within the convex hull of its Bernstein coefficients.
    fn bound(&self) -> f64 {
        let [_, bend, twist, curve] = self.polynomial();
        let first = 2.0 * (twist + curve - bend);
        let middle = -2.0 * bend - twist - 4.0 * curve;
        let last = 2.0 * (curve - bend) - 4.0 * twist;
        first.norm().max(middle.norm()).max(last.norm()) / (self.h * self.h)
    }

    /// What it turns to within the step is touched, and pressed on, at the start of the next.
    fn slides_along(&self, _: &Vector3<f64>) -> bool {
        true
    }
}

/// Errors of the sensitivities count by this much less than the state's. They must count: where a
/// ball rolls from a box's face over its edge the state stays smooth, and its derivatives jump.
const SENSITIVITY_SLACK: f64 = 10.0;

/// Dormand–Prince's coefficients.
mod tableau {
    pub const A: [[f64; 6]; 6] = [
        [1.0 / 5.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [3.0 / 40.0, 9.0 / 40.0, 0.0, 0.0, 0.0, 0.0],
        [44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0, 0.0, 0.0, 0.0],
        [19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0, 0.0, 0.0],
        [9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0, 0.0],
        [35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0],
    ];
    /// Fifth minus fourth order, slopes 1, 3, 4, 5, 6, 7.
    pub const E: [f64; 6] =
        [71.0 / 57600.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339200.0, 22.0 / 525.0, -1.0 / 40.0];
    /// Dense output, slopes 1, 3, 4, 5, 6, 7.
    pub const D: [f64; 6] = [
        -12715105075.0 / 11282082432.0,
        87487479700.0 / 32700410799.0,
        -10690763975.0 / 1880347072.0,
        701980252875.0 / 199316789632.0,
        -1453857185.0 / 822651844.0,
        69997945.0 / 29380423.0,
    ];
}

struct DormandPrince {
    rtol: f64,
    atol: f64,
}

impl Method for DormandPrince {
    #[inline]
    fn step<const M: usize, const R: usize>(
        &self,
        flow: &impl Flow,
        y: &Columns<M>,
        k1: &Columns<M>,
        h: f64,
    ) -> Step<M> {
        let a = tableau::A.map(|row| row.map(|factor| factor * h));
        let [mut k2, mut k3, mut k4, mut k5, mut k6, mut last] = [Columns::ZERO; 6];
        // What of a column is not summed stays as it was.
        let mut end = *y;
        end.set_sum::<R, _>(y, [(a[0][0], k1)]);
        flow.derivative_into(&end, &mut k2);
        end.set_sum::<R, _>(y, [(a[1][0], k1), (a[1][1], &k2)]);
        flow.derivative_into(&end, &mut k3);
        end.set_sum::<R, _>(y, [(a[2][0], k1), (a[2][1], &k2), (a[2][2], &k3)]);
        flow.derivative_into(&end, &mut k4);
        end.set_sum::<R, _>(y, [(a[3][0], k1), (a[3][1], &k2), (a[3][2], &k3), (a[3][3], &k4)]);
        flow.derivative_into(&end, &mut k5);
        end.set_sum::<R, _>(y, [(a[4][0], k1), (a[4][1], &k2), (a[4][2], &k3), (a[4][3], &k4), (a[4][4], &k5)]);
        flow.derivative_into(&end, &mut k6);
        let terms = [(a[5][0], k1), (a[5][2], &k3), (a[5][3], &k4), (a[5][4], &k5), (a[5][5], &k6)];
        end.set_sum::<R, _>(y, terms);
        flow.derivative_into(&end, &mut last);
        let slopes = [k1, &k3, &k4, &k5, &k6, &last];
        let e = tableau::E.map(|factor| factor * h);
        let mut errors = Columns::ZERO;
        errors.set_sum::<R, 6>(&Columns::ZERO, std::array::from_fn(|i| (e[i], slopes[i])));
        let measured = if flow.spin_errs() { R } else { 6 };
        let mut error = 0.0_f64;
        for (index, ((off, before), after)) in errors.0.iter().zip(&y.0).zip(&end.0).enumerate() {
            let mut squares = 0.0;
            for i in 0..measured {
                let scaled = off[i] / (self.atol + self.rtol * before[i].abs().max(after[i].abs()));
                squares += scaled * scaled;
            }
            let slack = if index == 0 { 1.0 } else { SENSITIVITY_SLACK };
            // the mean over position and velocity; the spin's errors come on top
            error = error.max((squares / 6.0).sqrt() / slack);
        }
        let curve = std::array::from_fn(|i| {
            h * tableau::D.iter().zip(slopes).map(|(weight, slope)| weight * slope.0[0][i]).sum::<f64>()
        });
        let moved = sum_of(terms);
        Step { h, start: y.0[0], end, moved, first: k1.0[0], last, curve, error }
    }
}

/// Σ factor·slope of the position.
fn sum_of<const M: usize, const K: usize>(terms: [(f64, &Columns<M>); K]) -> Vector3<f64> {
    terms.iter().map(|(factor, slope)| *factor * part(&slope.0[0], 0)).sum()
}

struct RungeKutta4;

impl Method for RungeKutta4 {
    #[inline]
    fn step<const M: usize, const R: usize>(
        &self,
        flow: &impl Flow,
        y: &Columns<M>,
        k1: &Columns<M>,
        h: f64,
    ) -> Step<M> {
        let [mut k2, mut k3, mut k4, mut last] = [Columns::ZERO; 4];
        let mut end = *y;
        end.set_sum::<R, _>(y, [(h / 2.0, k1)]);
        flow.derivative_into(&end, &mut k2);
        end.set_sum::<R, _>(y, [(h / 2.0, &k2)]);
        flow.derivative_into(&end, &mut k3);
        end.set_sum::<R, _>(y, [(h, &k3)]);
        flow.derivative_into(&end, &mut k4);
        let terms = [(h / 6.0, k1), (h / 3.0, &k2), (h / 3.0, &k3), (h / 6.0, &k4)];
        end.set_sum::<R, _>(y, terms);
        flow.derivative_into(&end, &mut last);
        let moved = sum_of(terms);
        Step { h, start: y.0[0], end, moved, first: k1.0[0], last, curve: [0.0; 9], error: 0.0 }
    }
}

struct VelocityVerlet;

impl Method for VelocityVerlet {
    #[inline]
    fn step<const M: usize, const R: usize>(
        &self,
        flow: &impl Flow,
        y: &Columns<M>,
        k1: &Columns<M>,
        h: f64,
    ) -> Step<M> {
        let mut ahead = *y;
        ahead.set_sum::<R, _>(y, [(h, k1)]);
        for (column, slope) in ahead.0.iter_mut().zip(&k1.0) {
            for i in 0..3 {
                column[i] += 0.5 * h * h * slope[3 + i];
            }
        }
        let k2 = flow.derivative(&ahead);
        let mut end = *y;
        end.set_sum::<R, _>(y, [(h / 2.0, k1), (h / 2.0, &k2)]);
        for (column, ahead) in end.0.iter_mut().zip(&ahead.0) {
            column[..3].copy_from_slice(&ahead[..3]);
        }
        let last = flow.derivative(&end);
        let moved = h * part(&k1.0[0], 0) + 0.5 * h * h * part(&k1.0[0], 1);
        Step { h, start: y.0[0], end, moved, first: k1.0[0], last, curve: [0.0; 9], error: 0.0 }
    }
}
