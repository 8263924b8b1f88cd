//! Nonlinear least squares by Levenberg–Marquardt: the loop over damped steps. What is minimised, and how its normal
//! equations are solved (dense, block-tridiagonal, with a border), is each problem's own.

/// A sum of squares at a point; robust losses and bounds of the unknowns are in its `cost` and `moved`.
pub trait LeastSquares: Sized {
    /// The normal equations at a point.
    type Normal;
    /// A step of the unknowns.
    type Step;
    /// Why a point may not be worked out at all; [`std::convert::Infallible`] for most.
    type Error;

    /// The sum here.
    fn cost(&self) -> f64;

    /// The normal equations here; [`None`] where there are none, which ends the search. What the cost is measured by
    /// (weights that depend on the point) may be fixed anew.
    ///
    /// # Errors
    /// The problem's own.
    fn linearised(&mut self) -> Result<Option<Self::Normal>, Self::Error>;

    /// The step that solves the normal equations, their diagonal multiplied by 1 + `damping`.
    fn step(&self, normal: &Self::Normal, damping: f64) -> Option<Self::Step>;

    /// The point after a step; [`None`] where the sum is not defined.
    ///
    /// # Errors
    /// The problem's own.
    fn moved(&self, normal: &Self::Normal, step: &Self::Step) -> Result<Option<Self>, Self::Error>;

    /// Whether a step is too small to go on after it.
    fn is_last(_step: &Self::Step) -> bool {
        false
    }
}

/// How the damping changes, and when the search ends.
#[derive(Debug, Clone, Copy)]
pub struct Damping {
    /// Damping of the first step.
    pub first: f64,
    /// Its factor after a step that lowers the cost, down to `least`.
    pub relax: f64,
    /// The damping does not fall below it.
    pub least: f64,
    /// Its factor after one that does not, up to `most`.
    pub stiffen: f64,
    /// The damping at which the search ends.
    pub most: f64,
    /// Most steps that lower the cost.
    pub steps: usize,
    /// Relative decrease of the cost below which a step is the last.
    pub converged: f64,
}

/// The nearest minimum.
///
/// # Errors
/// The problem's own.
pub fn minimised<P: LeastSquares>(mut at: P, rule: &Damping) -> Result<P, P::Error> {
    let mut damping = rule.first;
    for _ in 0..rule.steps {
        let Some(normal) = at.linearised()? else { break };
        let before = at.cost();
        loop {
            let step = at.step(&normal, damping);
            let is_last = step.as_ref().is_some_and(P::is_last);
            let next = match &step {
                Some(step) => at.moved(&normal, step)?.filter(|next| next.cost() < before),
                None => None,
            };
            let Some(next) = next else {
                damping *= rule.stiffen;
                if is_last || damping > rule.most {
                    return Ok(at);
                }
                continue;
            };
            at = next;
            damping = (damping * rule.relax).max(rule.least);
            if is_last || before - at.cost() < rule.converged * at.cost() {
                return Ok(at);
            }
            break;
        }
    }
    Ok(at)
}
