//! Change points of a 2D track, where it bends sharply: smooth pieces by dynamic programming.

use nalgebra::{DMatrix, DVector, Point2, Vector2};

/// Observations that a piece holds at most.
const LONGEST: usize = 100;
/// Fewest observations of a piece.
const SHORTEST: usize = 2;
/// Residual, in standard deviations, beyond which a label costs no more.
const CAP: f64 = 4.0;
/// What another piece costs, in squared standard deviations, where only clear change points are wanted, and where faint ones are.
pub const CLEAR: f64 = 40.0;
pub const FAINT: f64 = 25.0;
/// Observations from which on a piece is a polynomial of degree 2, 3, 4.
const DEGREES: [usize; 3] = [4, 9, 24];

/// Highest degree of a piece.
pub const MOST: usize = 1 + DEGREES.len();

/// A place where a track bends.
#[derive(Debug, Clone, Copy)]
pub struct ChangePoint {
    /// s.
    pub time: f64,
    /// px.
    pub image: Point2<f64>,
    /// Whether the track bends there.
    pub bends: bool,
}

/// A polynomial in time for each coordinate.
pub struct Piece {
    middle: f64,
    scale: f64,
    /// Rows: powers of time; columns: x, y.
    coefficients: DMatrix<f64>,
    /// Of its labels, in squared standard deviations.
    pub cost: f64,
}

impl Piece {
    fn at(&self, time: f64) -> Vector2<f64> {
        let t = (time - self.middle) / self.scale;
        let mut sum = Vector2::zeros();
        for power in (0..self.coefficients.nrows()).rev() {
            sum = sum * t + Vector2::new(self.coefficients[(power, 0)], self.coefficients[(power, 1)]);
        }
        sum
    }

    /// Through labels, of which those far off count less; of a degree up to `most`.
    pub fn of(labels: &[(f64, Point2<f64>)], sigma: f64, most: usize) -> Option<Self> {
        let (first, last) = (labels.first()?.0, labels.last()?.0);
        let (middle, scale) = ((first + last) / 2.0, ((last - first) / 2.0).max(1e-9));
        let degree = most.min(1 + DEGREES.iter().filter(|&&from| labels.len() >= from).count());
        let powers = |time: f64| {
            let t = (time - middle) / scale;
            (0..=degree).map(move |power| t.powi(power as i32))
        };
        let mut weights = vec![1.0; labels.len()];
        let mut piece = Self { middle, scale, coefficients: DMatrix::zeros(0, 2), cost: 0.0 };
        for _ in 0..3 {
            let mut normal = DMatrix::identity(degree + 1, degree + 1) * 1e-9;
            let mut right = DMatrix::zeros(degree + 1, 2);
            for ((time, at), weight) in labels.iter().zip(&weights) {
                let row = DVector::from_iterator(degree + 1, powers(*time));
                normal.ger(*weight, &row, &row, 1.0);
                right.column_mut(0).axpy(weight * at.x, &row, 1.0);
                right.column_mut(1).axpy(weight * at.y, &row, 1.0);
            }
            piece.coefficients = normal.cholesky()?.solve(&right);
            piece.cost = 0.0;
            for ((time, at), weight) in labels.iter().zip(&mut weights) {
                let off = (piece.at(*time) - at.coords).norm_squared() / (sigma * sigma);
                piece.cost += off.min(CAP * CAP);
                *weight = 1.0 / (1.0 + off / 4.0);
            }
        }
        Some(piece)
    }
}

/// The change points of a track of `labels` (s, px) whose smooth part is known to `sigma` px and of which another piece costs `price`.
pub fn change_points(labels: &[(f64, Point2<f64>)], sigma: f64, price: f64) -> Vec<ChangePoint> {
    let count = labels.len();
    // Least cost of the first `n` labels, and where its last piece begins.
    let mut best: Vec<(f64, usize)> = vec![(0.0, 0)];
    for end in 1..=count {
        let starts = end.saturating_sub(LONGEST)..=end.saturating_sub(SHORTEST);
        let through = |start: usize| {
            let piece = Piece::of(&labels[start..end], sigma, MOST)?;
            Some((best[start].0 + piece.cost + price, start))
        };
        let found = starts.filter_map(through).min_by(|a, b| a.0.total_cmp(&b.0));
        best.push(found.unwrap_or((f64::INFINITY, end.saturating_sub(1))));
    }
    let mut ends = vec![count];
    while let Some(&end) = ends.last()
        && end > 0
    {
        ends.push(best[end].1);
    }
    ends.reverse();
    let pieces: Vec<Option<Piece>> =
        ends.windows(2).map(|pair| Piece::of(&labels[pair[0]..pair[1]], sigma, MOST)).collect();
    let mut found = Vec::new();
    for (index, pair) in pieces.windows(2).enumerate() {
        let [Some(before), Some(after)] = pair else { continue };
        let end = ends[index + 1];
        let (from, to) = (labels[end - 1].0, labels[end.min(count - 1)].0);
        // Where both pieces meet, near the gap between them.
        let reach = to - from;
        let at = |step: i32| from + reach * (f64::from(step) / 20.0 - 1.0);
        let apart = |time: f64| (before.at(time) - after.at(time)).norm();
        let time = (0..=60).map(at).min_by(|a, b| apart(*a).total_cmp(&apart(*b))).unwrap_or(to);
        found.push(ChangePoint { time, image: ((before.at(time) + after.at(time)) / 2.0).into(), bends: true });
    }
    found
}
