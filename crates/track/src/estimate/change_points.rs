//! Change points of a 2D track, where it bends sharply: smooth pieces by dynamic programming.

use nalgebra::{Cholesky, Point2, SMatrix, SVector, Vector2};

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

/// Highest degree of a piece, and its coefficients.
pub const MOST: usize = 1 + DEGREES.len();
const POWERS: usize = MOST + 1;
/// Rounds in which labels far off come to count less.
const ROUNDS: usize = 4;

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
pub struct PolynomialPiece {
    middle: f64,
    scale: f64,
    /// Rows: powers of time; columns: x, y. Zero beyond its degree.
    coefficients: SMatrix<f64, POWERS, 2>,
    /// Of its labels, in squared standard deviations.
    pub cost: f64,
}

impl PolynomialPiece {
    fn at(&self, time: f64) -> Vector2<f64> {
        let t = (time - self.middle) / self.scale;
        (0..POWERS).rev().fold(Vector2::zeros(), |sum, power| sum * t + self.coefficients.row(power).transpose())
    }

    /// Through labels, of which those far off count less; of a degree up to `most`.
    pub fn of(labels: &[(f64, Point2<f64>)], sigma: f64, most: usize) -> Option<Self> {
        let (first, last) = (labels.first()?.0, labels.last()?.0);
        let (middle, scale) = ((first + last) / 2.0, ((last - first) / 2.0).max(1e-9));
        let degree = most.min(1 + DEGREES.iter().filter(|&&from| labels.len() >= from).count());
        let powers = |time: f64| {
            let (t, mut power) = ((time - middle) / scale, 1.0);
            SVector::<f64, POWERS>::from_fn(|index, _| {
                let own = if index <= degree { power } else { 0.0 };
                power *= t;
                own
            })
        };
        let mut piece = Self { middle, scale, coefficients: SMatrix::zeros(), cost: 0.0 };
        for round in 0..ROUNDS {
            let mut normal = SMatrix::<f64, POWERS, POWERS>::identity() * 1e-9;
            // Powers beyond its degree stay zero.
            (degree + 1..POWERS).for_each(|index| normal[(index, index)] = 1.0);
            let mut right = SMatrix::<f64, POWERS, 2>::zeros();
            let mut cost = 0.0;
            for (time, at) in labels {
                let row = powers(*time);
                let weight = if round == 0 {
                    1.0
                } else {
                    let off = (piece.coefficients.tr_mul(&row) - at.coords).norm_squared() / (sigma * sigma);
                    cost += off.min(CAP * CAP);
                    1.0 / (1.0 + off / 4.0)
                };
                let weighted = row * weight;
                normal += weighted * row.transpose();
                right += weighted * at.coords.transpose();
            }
            // The last round is for the cost alone.
            piece.cost = cost;
            if round + 1 < ROUNDS {
                piece.coefficients = Cholesky::new(normal)?.solve(&right);
            }
        }
        Some(piece)
    }
}

/// The change points of a track of `labels` (s, px) whose smooth part is known to `sigma` px, by what another piece costs.
pub fn change_points<const N: usize>(
    labels: &[(f64, Point2<f64>)],
    sigma: f64,
    prices: [f64; N],
) -> [Vec<ChangePoint>; N] {
    let count = labels.len();
    // Least cost of the first `n` labels at each price, and where its last piece begins.
    let mut best: Vec<[(f64, usize); N]> = vec![[(0.0, 0); N]];
    for end in 1..=count {
        let mut found = [(f64::INFINITY, end.saturating_sub(1)); N];
        // A piece that costs more by itself than all so far is too long, and so are longer ones.
        for start in (end.saturating_sub(LONGEST)..=end.saturating_sub(SHORTEST)).rev() {
            let Some(piece) = PolynomialPiece::of(&labels[start..end], sigma, MOST) else { continue };
            for ((found, before), price) in found.iter_mut().zip(best[start]).zip(prices) {
                let cost = before.0 + piece.cost + price;
                if cost < found.0 {
                    *found = (cost, start);
                }
            }
            if found.iter().all(|found| piece.cost > found.0) {
                break;
            }
        }
        best.push(found);
    }
    std::array::from_fn(|price| {
        let mut ends = vec![count];
        while let Some(&end) = ends.last()
            && end > 0
        {
            ends.push(best[end][price].1);
        }
        ends.reverse();
        between(labels, sigma, &ends)
    })
}

/// Where the pieces meet that end at these labels.
fn between(labels: &[(f64, Point2<f64>)], sigma: f64, ends: &[usize]) -> Vec<ChangePoint> {
    let count = labels.len();
    let pieces: Vec<Option<PolynomialPiece>> =
        ends.windows(2).map(|pair| PolynomialPiece::of(&labels[pair[0]..pair[1]], sigma, MOST)).collect();
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
