//! Where a lens model ends: beyond its fold, points far outside the picture would be seen inside it.

use nalgebra::Vector2;

use super::Distortion;

/// Largest radius at which a fold is looked for, normalised units: 0.06° from the picture's plane.
const LARGEST_RADIUS: f64 = 1e3;
/// Halvings of an interval with a root in it; enough for the last digit of any radius.
const HALVINGS: usize = 100;

/// The ideal points that a lens maps one to one: those not beyond the fold on their ray from the centre.
///
/// The model's Jacobian is symmetric. Along a ray of direction d at radius ρ, with f(ρ) = 1 + k1·ρ² + k2·ρ⁴ + k3·ρ⁶ and
/// q = (p2, p1), it is (ρ·f)′ + 6·ρ·q∥ along the ray, f + 2·ρ·q∥ across it and 2·ρ·q⊥ beside the diagonal: a polynomial
/// in ρ whose determinant is 1 at the centre and changes its sign at the fold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Range {
    distortion: Distortion,
    /// Below this radius no ray has its fold, from the other on every ray has had it: with tangential terms the fold
    /// is no circle.
    within: f64,
    beyond: f64,
}

impl Range {
    pub fn of(distortion: &Distortion) -> Self {
        let (along, across) = parts(distortion);
        let reach = 6.0 * distortion.p1.hypot(distortion.p2);
        let first = |mut polynomial: [f64; 7], tangential: f64| {
            polynomial[1] += tangential;
            roots(&polynomial).first().copied().unwrap_or(f64::INFINITY)
        };
        let within = first(along, -reach).min(first(across, -reach));
        Self { distortion: *distortion, within, beyond: first(along, reach) }
    }

    /// Whether the lens maps the way from the centre to `ideal` without folding over.
    pub fn holds(&self, ideal: &Vector2<f64>) -> bool {
        let radius = ideal.norm();
        radius < self.within || (radius < self.beyond && radius < self.fold(&(ideal / radius)))
    }

    /// Radius of the fold on the ray of a unit vector; infinite where there is none.
    fn fold(&self, direction: &Vector2<f64>) -> f64 {
        let Distortion { p1, p2, .. } = self.distortion;
        let (mut along, mut across) = parts(&self.distortion);
        let parallel = p2 * direction.x + p1 * direction.y;
        let perpendicular = p1 * direction.x - p2 * direction.y;
        along[1] += 6.0 * parallel;
        across[1] += 2.0 * parallel;
        let mut determinant = [0.0; 13];
        for (power, a) in along.iter().enumerate() {
            for (more, b) in across.iter().enumerate() {
                determinant[power + more] += a * b;
            }
        }
        determinant[2] -= 4.0 * perpendicular * perpendicular;
        roots(&determinant).first().copied().unwrap_or(f64::INFINITY)
    }
}

/// Coefficients of the radial parts, (ρ·f)′ and f, by powers of ρ.
fn parts(&Distortion { k1, k2, k3, .. }: &Distortion) -> ([f64; 7], [f64; 7]) {
    ([1.0, 0.0, 3.0 * k1, 0.0, 5.0 * k2, 0.0, 7.0 * k3], [1.0, 0.0, k1, 0.0, k2, 0.0, k3])
}

/// Where a polynomial (coefficients by powers) changes its sign between 0 and the largest radius, ascending: once at
/// most between two roots of its derivative.
fn roots(polynomial: &[f64]) -> Vec<f64> {
    let Some(degree) = polynomial.iter().rposition(|&coefficient| coefficient != 0.0).filter(|&degree| degree > 0)
    else {
        return Vec::new();
    };
    let derivative: Vec<f64> = (1..=degree).map(|power| power as f64 * polynomial[power]).collect();
    let is_positive =
        |radius: f64| polynomial.iter().rev().fold(0.0, |sum, coefficient| sum * radius + coefficient) > 0.0;
    let mut found = Vec::new();
    let mut from = 0.0;
    for to in roots(&derivative).into_iter().chain([LARGEST_RADIUS]) {
        let at_start = is_positive(from);
        if at_start != is_positive(to) {
            let (mut low, mut high) = (from, to);
            for _ in 0..HALVINGS {
                let middle = 0.5 * (low + high);
                match is_positive(middle) == at_start {
                    true => low = middle,
                    false => high = middle,
                }
            }
            found.push(low);
        }
        from = to;
    }
    found
}
