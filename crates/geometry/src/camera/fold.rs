//! Where a lens model ends: beyond its fold, points far outside the picture would be seen inside it.

use std::f64::consts::FRAC_PI_2;

use nalgebra::Vector2;

use super::Distortion;

/// Largest radius at which a fold is looked for, normalised units: 0.06° from the picture's plane.
const LARGEST_RADIUS: f64 = 1e3;
/// Halvings of an interval with a root in it; enough for the last digit of any radius.
const HALVINGS: usize = 100;

/// The ideal points that a lens maps one to one: those not beyond the fold on their ray from the centre.
///
/// The model's Jacobian is symmetric. Along a ray of direction d at radius ρ, with f = n/m, n(ρ) = 1 + k1·ρ² + k2·ρ⁴ + k3·ρ⁶,
/// m(ρ) = 1 + k4·ρ² + k5·ρ⁴ + k6·ρ⁶ and q = (p2, p1), it is (ρ·f)′ + 6·ρ·q∥ along the ray, f + 2·ρ·q∥ across it and 2·ρ·q⊥ beside the
/// diagonal. Times m², m and m³ these and the determinant are polynomials in ρ; the determinant is 1 at the centre and changes its
/// sign at the fold. Where m is 0 the model ends, too. A fisheye folds where its radius no longer grows with the angle.
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
        if distortion.is_fisheye() {
            let Distortion { k1, k2, k3, k4, .. } = *distortion;
            let slope = [1.0, 0.0, 3.0 * k1, 0.0, 5.0 * k2, 0.0, 7.0 * k3, 0.0, 9.0 * k4];
            let radius = first(&slope, FRAC_PI_2).map_or(f64::INFINITY, f64::tan);
            return Self { distortion: *distortion, within: radius, beyond: radius };
        }
        let Parts { along, across, divisor } = Parts::of(distortion);
        let reach = 6.0 * distortion.p1.hypot(distortion.p2);
        let end = first_or_infinity(&divisor);
        let first = |part: &[f64], divisor: &[f64], tangential: f64| {
            first_or_infinity(&plus(part, &times_radius(tangential, divisor))).min(end)
        };
        let squared = product(&divisor, &divisor);
        let within = first(&along, &squared, -reach).min(first(&across, &divisor, -reach));
        Self { distortion: *distortion, within, beyond: first(&along, &squared, reach) }
    }

    /// Whether the lens maps the way from the centre to `ideal` without folding over.
    pub fn holds(&self, ideal: &Vector2<f64>) -> bool {
        let radius = ideal.norm();
        radius < self.within || (radius < self.beyond && radius < self.fold(&(ideal / radius)))
    }

    /// The angle off the axis at which a fisheye ends, rad.
    pub fn angle(&self) -> f64 {
        self.within.atan()
    }

    /// Radius of the fold on the ray of a unit vector; infinite where there is none.
    fn fold(&self, direction: &Vector2<f64>) -> f64 {
        let Distortion { p1, p2, .. } = self.distortion;
        let Parts { along, across, divisor } = Parts::of(&self.distortion);
        let parallel = p2 * direction.x + p1 * direction.y;
        let perpendicular = p1 * direction.x - p2 * direction.y;
        let squared = product(&divisor, &divisor);
        let along = plus(&along, &times_radius(6.0 * parallel, &squared));
        let across = plus(&across, &times_radius(2.0 * parallel, &divisor));
        let beside =
            times_radius(-4.0 * perpendicular * perpendicular, &times_radius(1.0, &product(&squared, &divisor)));
        first_or_infinity(&plus(&product(&along, &across), &beside)).min(first_or_infinity(&divisor))
    }
}

/// Polynomials in the radius (coefficients by powers): (ρ·f)′ times m², f times m, and m.
struct Parts {
    along: Vec<f64>,
    across: Vec<f64>,
    divisor: Vec<f64>,
}

impl Parts {
    fn of(&Distortion { k1, k2, k3, k4, k5, k6, .. }: &Distortion) -> Self {
        let across = vec![1.0, 0.0, k1, 0.0, k2, 0.0, k3];
        let divisor = vec![1.0, 0.0, k4, 0.0, k5, 0.0, k6];
        let grown = [1.0, 0.0, 3.0 * k1, 0.0, 5.0 * k2, 0.0, 7.0 * k3];
        let less = times_radius(-1.0, &product(&across, &derivative(&divisor)));
        Self { along: plus(&product(&grown, &divisor), &less), across, divisor }
    }
}

fn product(a: &[f64], b: &[f64]) -> Vec<f64> {
    let mut product = vec![0.0; a.len() + b.len() - 1];
    for (power, a) in a.iter().enumerate() {
        for (more, b) in b.iter().enumerate() {
            product[power + more] += a * b;
        }
    }
    product
}

fn plus(a: &[f64], b: &[f64]) -> Vec<f64> {
    let at = |polynomial: &[f64], power: usize| polynomial.get(power).copied().unwrap_or(0.0);
    (0..a.len().max(b.len())).map(|power| at(a, power) + at(b, power)).collect()
}

/// factor·ρ times a polynomial.
fn times_radius(factor: f64, polynomial: &[f64]) -> Vec<f64> {
    product(&[0.0, factor], polynomial)
}

fn derivative(polynomial: &[f64]) -> Vec<f64> {
    polynomial.iter().enumerate().skip(1).map(|(power, coefficient)| power as f64 * coefficient).collect()
}

/// Where a polynomial first changes its sign between 0 and `end`.
fn first(polynomial: &[f64], end: f64) -> Option<f64> {
    roots(polynomial, end).first().copied()
}

fn first_or_infinity(polynomial: &[f64]) -> f64 {
    first(polynomial, LARGEST_RADIUS).unwrap_or(f64::INFINITY)
}

/// Where a polynomial changes its sign between 0 and `end`, ascending: once at most between two roots of its derivative.
fn roots(polynomial: &[f64], end: f64) -> Vec<f64> {
    let Some(degree) = polynomial.iter().rposition(|&coefficient| coefficient != 0.0).filter(|&degree| degree > 0)
    else {
        return Vec::new();
    };
    let derivative = derivative(&polynomial[..=degree]);
    let is_positive =
        |radius: f64| polynomial.iter().rev().fold(0.0, |sum, coefficient| sum * radius + coefficient) > 0.0;
    let mut found = Vec::new();
    let mut from = 0.0;
    for to in roots(&derivative, end).into_iter().chain([end]) {
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
