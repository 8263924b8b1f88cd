//! The state and its sensitivities, side by side.

use nalgebra::{Matrix6, Vector3};

use crate::state::State;

/// Position, velocity, spin: m, m/s, rad/s.
pub type Column = [f64; 9];

/// Column 0 is the state; with `M` = 7, column 1 + k is its derivative by component k of the start
/// (position, velocity).
#[derive(Debug, Clone, Copy)]
pub struct Columns<const M: usize>(pub [Column; M]);

/// Columns with the sensitivities.
pub const WITH_JACOBIAN: usize = 7;
/// Columns with the sensitivities to the spin at the start, too.
pub const WITH_SPIN_JACOBIAN: usize = 10;

/// Components 3·`part`… of a column: 0 position, 1 velocity, 2 spin.
#[inline(always)]
pub fn part(column: &Column, part: usize) -> Vector3<f64> {
    Vector3::new(column[3 * part], column[3 * part + 1], column[3 * part + 2])
}

/// A column of its three parts.
#[inline(always)]
pub fn column(position: Vector3<f64>, velocity: Vector3<f64>, spin: Vector3<f64>) -> Column {
    [position.x, position.y, position.z, velocity.x, velocity.y, velocity.z, spin.x, spin.y, spin.z]
}

impl<const M: usize> Columns<M> {
    /// A start, its sensitivities the identity.
    pub fn start(position: Vector3<f64>, velocity: Vector3<f64>, spin: Vector3<f64>) -> Self {
        let mut columns = Self([[0.0; 9]; M]);
        columns.0[0] = column(position, velocity, spin);
        for (component, sensitivity) in columns.0.iter_mut().skip(1).enumerate() {
            sensitivity[component] = 1.0;
        }
        columns
    }

    /// All zeros.
    pub const ZERO: Self = Self([[0.0; 9]; M]);

    /// Sets the first `R` components of each column to those of `from + Σ factor·slope`; the others stay. In place, for a copy
    /// takes as long as the sum.
    #[inline(always)]
    pub fn set_sum<const R: usize, const K: usize>(&mut self, from: &Self, terms: [(f64, &Self); K]) {
        for (index, column) in self.0.iter_mut().enumerate() {
            for (component, value) in column.iter_mut().enumerate().take(R) {
                let mut sum = from.0[index][component];
                for (factor, slope) in terms {
                    sum += factor * slope.0[index][component];
                }
                *value = sum;
            }
        }
    }

    #[inline(always)]
    pub fn position(&self) -> Vector3<f64> {
        part(&self.0[0], 0)
    }

    #[inline(always)]
    pub fn velocity(&self) -> Vector3<f64> {
        part(&self.0[0], 1)
    }

    #[inline(always)]
    pub fn spin(&self) -> Vector3<f64> {
        part(&self.0[0], 2)
    }

    /// The state without its sensitivities.
    #[inline(always)]
    pub fn head(&self) -> Columns<1> {
        Columns([self.0[0]])
    }

    /// The state alone.
    pub fn state(&self) -> State {
        State { position: self.position().into(), velocity: self.velocity(), spin: self.spin() }
    }

    /// (r, −v, −ω), in every column: the state as time runs the other way.
    pub fn mirrored(mut self) -> Self {
        for value in self.0.iter_mut().flat_map(|column| &mut column[3..]) {
            *value = -*value;
        }
        self
    }

    /// d(position, velocity)/d(start); zero without sensitivities.
    pub fn jacobian(&self) -> Matrix6<f64> {
        Matrix6::from_fn(|row, column| self.0.get(column + 1).map_or(0.0, |sensitivity| sensitivity[row]))
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        self.0.as_flattened().iter().fold(true, |finite, value| finite & value.is_finite())
    }
}
