//! Normal equations of a chain: block-tridiagonal, solved by block elimination in time that grows with its length.

use nalgebra::{Cholesky, Const, SMatrix, SVector};

/// The normal equations' blocks.
pub(super) struct Normal<const D: usize> {
    pub diagonal: Vec<SMatrix<f64, D, D>>,
    /// Block (k, k + 1).
    pub upper: Vec<SMatrix<f64, D, D>>,
    pub gradient: Vec<SVector<f64, D>>,
}

impl<const D: usize> Normal<D> {
    /// Cholesky factors of the pivots of block elimination.
    pub fn pivots(&self, damping: f64) -> Option<Vec<Cholesky<f64, Const<D>>>> {
        let mut pivots: Vec<Cholesky<f64, Const<D>>> = Vec::with_capacity(self.diagonal.len());
        for (index, diagonal) in self.diagonal.iter().enumerate() {
            let mut pivot = *diagonal;
            for i in 0..D {
                pivot[(i, i)] += damping * diagonal[(i, i)];
            }
            if let (Some(before), Some(upper)) = (pivots.last(), index.checked_sub(1).map(|i| &self.upper[i])) {
                pivot -= upper.transpose() * before.solve(upper);
                pivot = (pivot + pivot.transpose()) * 0.5;
            }
            pivots.push(pivot.cholesky()?);
        }
        Some(pivots)
    }

    /// The damped step.
    pub fn solve(&self, damping: f64) -> Option<Vec<SVector<f64, D>>> {
        let pivots = self.pivots(damping)?;
        let step = self.substituted(&pivots, self.gradient.iter().map(|gradient| -gradient).collect());
        step.iter().all(|step| step.iter().all(|value| value.is_finite())).then_some(step)
    }

    /// The solution for a right side.
    pub fn substituted(&self, pivots: &[Cholesky<f64, Const<D>>], mut x: Vec<SVector<f64, D>>) -> Vec<SVector<f64, D>> {
        for index in 1..x.len() {
            let before = self.upper[index - 1].transpose() * pivots[index - 1].solve(&x[index - 1]);
            x[index] -= before;
        }
        for index in (0..x.len()).rev() {
            if index + 1 < x.len() {
                let after = self.upper[index] * x[index + 1];
                x[index] -= after;
            }
            x[index] = pivots[index].solve(&x[index]);
        }
        x
    }

    /// Diagonal blocks of the inverse.
    pub fn covariances(&self) -> Option<Vec<SMatrix<f64, D, D>>> {
        let pivots = self.pivots(1e-12)?;
        let mut out: Vec<SMatrix<f64, D, D>> = pivots.iter().map(Cholesky::inverse).collect();
        for index in (0..out.len().saturating_sub(1)).rev() {
            let gain = pivots[index].solve(&self.upper[index]);
            out[index] = out[index] + gain * out[index + 1] * gain.transpose();
        }
        Some(out)
    }
}
