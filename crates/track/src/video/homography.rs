//! The homography that moves most of the places that were found again.

use nalgebra::{Matrix2, Matrix3, SMatrix, SVector, Vector2};

use super::config::RegistrationConfig;
use super::patches::HALF;

/// A shift with a rotation and a scale: `at + rotation · at + shift`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Motion {
    rotation: Matrix2<f64>,
    shift: Vector2<f64>,
}

impl Motion {
    const NONE: Self = Self { rotation: Matrix2::new(0.0, 0.0, 0.0, 0.0), shift: Vector2::new(0.0, 0.0) };

    pub fn of(&self, at: &Vector2<f64>) -> Vector2<f64> {
        self.rotation * at + self.shift
    }

    /// That of two places; [`None`] where they are too near each other.
    fn through([a, moved_a]: [Vector2<f64>; 2], [b, moved_b]: [Vector2<f64>; 2]) -> Option<Self> {
        let (from, to) = (b - a, moved_b - moved_a);
        let square = from.norm_squared();
        if square < 100.0 * (HALF * HALF) as f64 {
            return None;
        }
        // The similarity that maps `from` to `from + to`, less the identity: scaled cosine and sine of its angle.
        let (cosine, sine) = (from.dot(&to) / square, from.perp(&to) / square);
        let rotation = Matrix2::new(cosine, -sine, sine, cosine);
        Some(Self { rotation, shift: moved_a - rotation * a })
    }
}

/// The homography that moves places as found (`[at, moved]`), of a picture of `size`, and the deviation of places that it maps, px.
pub(super) fn change_through(
    found: &[[Vector2<f64>; 2]],
    size: [usize; 2],
    config: &RegistrationConfig,
) -> Option<(Matrix3<f64>, f64)> {
    let RegistrationConfig { place_sigma, shear_sigma, perspective_sigma, .. } = *config;
    let half = size[0] as f64 / 2.0;
    let middle = Vector2::new(half, size[1] as f64 / 2.0);
    let mut change = SVector::<f64, 8>::zeros();
    let mut square = 0.0;
    for round in 0..config.rounds {
        let mut normal = SMatrix::<f64, 8, 8>::zeros();
        let mut right = SVector::<f64, 8>::zeros();
        // Aspect, shear and perspective are known to be small.
        let priors = [([(1, 1.0), (5, -1.0)], shear_sigma), ([(2, 1.0), (4, 1.0)], shear_sigma)];
        for (terms, sigma) in priors {
            for (row, a) in terms {
                terms.iter().for_each(|&(column, b)| normal[(row, column)] += a * b / (sigma * sigma));
            }
        }
        normal[(6, 6)] += perspective_sigma.powi(-2);
        normal[(7, 7)] += perspective_sigma.powi(-2);
        square = 0.0;
        for [at, moved] in found {
            let (place, moved) = ((at - middle) / half, moved / half);
            let (u, v) = (place.x, place.y);
            let rows = [[1.0, u, v, 0.0, 0.0, 0.0, u * u, v * u], [0.0, 0.0, 0.0, 1.0, u, v, u * v, v * v]];
            let rows = rows.map(SVector::<f64, 8>::from);
            let off = [0, 1].map(|axis| (moved[axis] - rows[axis].dot(&change)) * half / place_sigma);
            let off = off[0].hypot(off[1]);
            square += off * off;
            let weight = if round == 0 { 1.0 } else { 2.0 / off.max(2.0) } * (half / place_sigma).powi(2);
            for (axis, row) in rows.iter().enumerate() {
                normal += row * row.transpose() * weight;
                right += row * (weight * moved[axis]);
            }
        }
        change = normal.cholesky()?.solve(&right);
    }
    let [a, b, c, d, e, f, g, h] = change.into();
    let change = Matrix3::new(1.0 + b, c, a, e, 1.0 + f, d, -g, -h, 1.0);
    let from = Matrix3::new(1.0 / half, 0.0, -middle.x / half, 0.0, 1.0 / half, -middle.y / half, 0.0, 0.0, 1.0);
    let change = from.try_inverse()? * change * from;
    // Eight numbers are found of two a place.
    let numbers = 2.0 * found.len() as f64;
    let residual = (square / (numbers - 8.0).max(1.0)).sqrt() * place_sigma;
    Some((change / change[(2, 2)], residual.max(place_sigma) * (8.0 / numbers).sqrt()))
}

/// The motion for which most places speak, and how many do.
pub(super) fn consensus(found: &[[Vector2<f64>; 2]], config: &RegistrationConfig) -> Option<(Motion, usize)> {
    let agreeing =
        |motion: &Motion| found.iter().filter(|[at, moved]| (motion.of(at) - moved).norm() < config.near).count();
    // Numbers that look random, and are the same each time.
    let mut state = 1_u64;
    let mut draw = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % found.len()
    };
    let tried = (0..config.tries).filter_map(|_| Motion::through(found[draw()], found[draw()]));
    let motion = tried.chain([Motion::NONE]).max_by_key(|motion| agreeing(motion))?;
    Some((motion, agreeing(&motion)))
}
