//! The normal equations: a block a segment, tied to the next one's, and a border of numbers that all share.

use nalgebra::{Cholesky, Const, SMatrix, SVector};

use super::trajectory::{OF_SEGMENT, SHARED};

type Block = SMatrix<f64, OF_SEGMENT, OF_SEGMENT>;
type Border = SMatrix<f64, OF_SEGMENT, SHARED>;
type Step = SVector<f64, OF_SEGMENT>;
type Corner = SMatrix<f64, SHARED, SHARED>;

/// Sum of the residuals' squares, and JᵀJ and Jᵀr.
#[derive(Debug, Clone)]
pub struct BlockNormal {
    pub cost: f64,
    /// Whether only the cost is needed.
    cost_only: bool,
    /// Whether the shared numbers stay as they are.
    shared_held: bool,
    diagonal: Vec<Block>,
    /// Block (k, k + 1).
    upper: Vec<Block>,
    border: Vec<Border>,
    corner: Corner,
    gradient: Vec<Step>,
    shared: SVector<f64, SHARED>,
}

/// Numbers of two segments that follow one another, and the shared ones.
pub const OF_PAIR: usize = 2 * OF_SEGMENT + SHARED;

/// What the inverse of JᵀJ says.
pub struct Marginals {
    /// Covariance of each segment's numbers, of those with the next segment's, with the shared ones, and of those.
    pub segments: Vec<Block>,
    next: Vec<Block>,
    pub cross: Vec<Border>,
    pub shared: Corner,
}

/// Block elimination.
struct Eliminated {
    pivots: Vec<Cholesky<f64, Const<OF_SEGMENT>>>,
    /// A⁻¹ times the border.
    solved: Vec<Border>,
    /// The shared numbers' own.
    schur: Cholesky<f64, Const<SHARED>>,
}

impl BlockNormal {
    pub fn new(segments: usize, cost_only: bool) -> Self {
        let count = if cost_only { 0 } else { segments };
        Self {
            cost: 0.0,
            cost_only,
            shared_held: false,
            diagonal: vec![Block::zeros(); count],
            upper: vec![Block::zeros(); count.saturating_sub(1)],
            border: vec![Border::zeros(); count],
            corner: Corner::zeros(),
            gradient: vec![Step::zeros(); count],
            shared: SVector::zeros(),
        }
    }

    /// Leaves the shared numbers as they are.
    pub fn hold_shared(&mut self) {
        self.shared_held = true;
    }

    /// Whether only the cost is needed.
    pub fn cost_only(&self) -> bool {
        self.cost_only
    }

    pub fn is_finite(&self) -> bool {
        self.cost.is_finite()
    }

    /// Adds a residual, its derivatives by the numbers of one segment or of two that follow one another, and by the shared ones.
    pub fn add<const R: usize>(
        &mut self,
        cost: f64,
        weight: f64,
        residual: &SVector<f64, R>,
        parts: &[(usize, SMatrix<f64, R, OF_SEGMENT>)],
        shared: &SMatrix<f64, R, SHARED>,
    ) {
        self.cost += cost;
        if self.cost_only {
            return;
        }
        for (index, jacobian) in parts {
            let weighted = jacobian.transpose() * weight;
            self.diagonal[*index] += weighted * jacobian;
            self.gradient[*index] += weighted * residual;
            if !self.shared_held {
                self.border[*index] += weighted * shared;
            }
        }
        if let [(first, before), (_, after)] = parts {
            self.upper[*first] += before.transpose() * after * weight;
        }
        if self.shared_held {
            return;
        }
        let weighted = shared.transpose() * weight;
        self.corner += weighted * shared;
        self.shared += weighted * residual;
    }

    fn eliminated(&self, damping: f64) -> Option<Eliminated> {
        let mut pivots: Vec<Cholesky<f64, Const<OF_SEGMENT>>> = Vec::with_capacity(self.diagonal.len());
        for (index, diagonal) in self.diagonal.iter().enumerate() {
            let mut pivot = *diagonal;
            (0..OF_SEGMENT).for_each(|at| pivot[(at, at)] += damping * diagonal[(at, at)] + 1e-9);
            if let Some(before) = pivots.last() {
                let upper = &self.upper[index - 1];
                pivot -= upper.transpose() * before.solve(upper);
                pivot = (pivot + pivot.transpose()) * 0.5;
            }
            pivots.push(pivot.cholesky()?);
        }
        if self.shared_held {
            return Some(Eliminated { pivots, solved: self.border.clone(), schur: Corner::identity().cholesky()? });
        }
        let solved = self.substituted(&pivots, self.border.clone());
        let mut schur = self.corner;
        (0..SHARED).for_each(|at| schur[(at, at)] += damping * self.corner[(at, at)] + 1e-9);
        for (border, solved) in self.border.iter().zip(&solved) {
            schur -= border.transpose() * solved;
        }
        let schur = ((schur + schur.transpose()) * 0.5).cholesky()?;
        Some(Eliminated { pivots, solved, schur })
    }

    /// A⁻¹ times a right side.
    fn substituted<const C: usize>(
        &self,
        pivots: &[Cholesky<f64, Const<OF_SEGMENT>>],
        mut x: Vec<SMatrix<f64, OF_SEGMENT, C>>,
    ) -> Vec<SMatrix<f64, OF_SEGMENT, C>> {
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

    /// How all segments' numbers change where those of one are pulled by each column of `right`; the shared ones stay.
    pub fn response<const C: usize>(
        &self,
        segment: usize,
        right: &SMatrix<f64, OF_SEGMENT, C>,
    ) -> Option<Vec<SMatrix<f64, OF_SEGMENT, C>>> {
        let mut all = vec![SMatrix::<f64, OF_SEGMENT, C>::zeros(); self.diagonal.len()];
        all[segment] = *right;
        Some(self.substituted(&self.eliminated(0.0)?.pivots, all))
    }

    /// The damped step of the segments' numbers and of the shared ones.
    pub fn step(&self, damping: f64) -> Option<(Vec<Step>, [f64; SHARED])> {
        let eliminated = self.eliminated(damping)?;
        let own = self.substituted(&eliminated.pivots, self.gradient.clone());
        let mut right = -self.shared;
        for (border, own) in self.border.iter().zip(&own) {
            right += border.transpose() * own;
        }
        let shared = eliminated.schur.solve(&right);
        let segments: Vec<Step> =
            own.iter().zip(&eliminated.solved).map(|(own, solved)| -own - solved * shared).collect();
        let finite = segments.iter().flat_map(|step| step.iter()).chain(shared.iter()).all(|value| value.is_finite());
        finite.then(|| (segments, shared.into()))
    }

    /// ln det JᵀJ.
    pub fn log_determinant(&self) -> Option<f64> {
        Some(self.eliminated(0.0)?.log_determinant())
    }

    pub fn marginals(&self) -> Option<Marginals> {
        let eliminated = self.eliminated(0.0)?;
        let Eliminated { pivots, solved, schur } = &eliminated;
        let shared = schur.inverse();
        let mut segments: Vec<Block> = pivots.iter().map(Cholesky::inverse).collect();
        let mut next = vec![Block::zeros(); self.upper.len()];
        for index in (0..next.len()).rev() {
            let smoother_gain = pivots[index].solve(&self.upper[index]);
            next[index] = smoother_gain * segments[index + 1] * -1.0;
            segments[index] = segments[index] + smoother_gain * segments[index + 1] * smoother_gain.transpose();
        }
        for (segment, solved) in segments.iter_mut().zip(solved) {
            *segment += solved * shared * solved.transpose();
        }
        for (next, pair) in next.iter_mut().zip(solved.windows(2)) {
            *next += pair[0] * shared * pair[1].transpose();
        }
        let cross = solved.iter().map(|solved| solved * shared * -1.0).collect();
        Some(Marginals { segments, next, cross, shared })
    }
}

impl Marginals {
    /// Covariance of the numbers of a segment, of the next one's, and of the shared ones.
    pub fn pair(&self, segment: usize) -> SMatrix<f64, OF_PAIR, OF_PAIR> {
        const SHARED_AT: usize = 2 * OF_SEGMENT;
        let mut all = SMatrix::<f64, OF_PAIR, OF_PAIR>::zeros();
        for (at, index) in [(0, segment), (OF_SEGMENT, segment + 1)] {
            all.fixed_view_mut::<OF_SEGMENT, OF_SEGMENT>(at, at).copy_from(&self.segments[index]);
            all.fixed_view_mut::<OF_SEGMENT, SHARED>(at, SHARED_AT).copy_from(&self.cross[index]);
        }
        all.fixed_view_mut::<OF_SEGMENT, OF_SEGMENT>(0, OF_SEGMENT).copy_from(&self.next[segment]);
        all.fixed_view_mut::<SHARED, SHARED>(SHARED_AT, SHARED_AT).copy_from(&self.shared);
        all.fill_lower_triangle_with_upper_triangle();
        all
    }
}

impl Eliminated {
    fn log_determinant(&self) -> f64 {
        let of = |value: &f64| 2.0 * value.ln();
        let segments = self.pivots.iter().map(|pivot| pivot.l_dirty().diagonal().iter().map(of).sum::<f64>());
        segments.sum::<f64>() + self.schur.l_dirty().diagonal().iter().map(of).sum::<f64>()
    }
}
