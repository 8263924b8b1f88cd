//! A part of the world.

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
