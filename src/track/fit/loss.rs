//! What a large residual costs.

/// A robust loss.
#[derive(Debug, Clone, Copy)]
pub(super) enum Loss {
    /// Linear beyond this many standard deviations: pulls from afar; for labels trusted from the start.
    Huber(f64),
    /// Logarithmic beyond this many standard deviations: lets go of outliers.
    Cauchy(f64),
}

impl Loss {
    /// Cost of a squared residual, and its derivative.
    pub fn of(self, square: f64) -> (f64, f64) {
        match self {
            Self::Huber(limit) if square > limit * limit => {
                let size = square.sqrt();
                (2.0 * limit * size - limit * limit, limit / size)
            }
            Self::Huber(_) => (square, 1.0),
            Self::Cauchy(scale) => {
                let ratio = square / (scale * scale);
                (scale * scale * ratio.ln_1p(), 1.0 / (1.0 + ratio))
            }
        }
    }
}
