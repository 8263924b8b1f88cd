//! A part of the world, and how large a ball in it can be.

use crate::error::{Error, Result};

/// Radius from which on something is no ball, m: what is larger was given in millimetres.
const TOO_LARGE: f64 = 1.0;

/// A box along the world's axes; a side may be infinitely far.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Volume {
    /// Its lowest corner, m.
    pub low: [f64; 3],
    /// Its highest corner, m.
    pub high: [f64; 3],
}

impl Volume {
    /// All of space.
    pub const ALL: Self = Self { low: [f64::NEG_INFINITY; 3], high: [f64::INFINITY; 3] };
}

/// Refuses a ball's radius that is none in metres.
///
/// # Errors
/// [`Error::Value`] where it is not positive and finite, or from 1 m on.
pub fn check_ball_radius(radius: f64) -> Result<()> {
    radius_refusal(radius).map_or(Ok(()), |reason| Err(Error::value("ball", "radius", reason)))
}

/// Why a radius is no ball's in metres; none if it is one.
#[doc(hidden)]
pub fn radius_refusal(radius: f64) -> Option<String> {
    if !(radius.is_finite() && radius > 0.0) {
        return Some(format!("must be a positive number of metres, not {radius}"));
    }
    let metres = radius / 1000.0;
    (radius >= TOO_LARGE).then(|| format!("is {radius} m, larger than any ball; if it is {radius} mm, give {metres}"))
}
