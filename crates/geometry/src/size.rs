//! Width and height, in one order everywhere.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Width and height of a picture or of a network's input, px.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(deny_unknown_fields)]
pub struct Size {
    /// px.
    pub width: u32,
    /// px.
    pub height: u32,
}

impl Size {
    /// A size of `width`×`height` px.
    pub const fn new(width: u32, height: u32) -> Self {
        Self { width, height }
    }

    /// A square of `side`×`side` px.
    pub const fn square(side: u32) -> Self {
        Self::new(side, side)
    }

    /// Its extent along x and along y, px.
    pub fn xy(self) -> [f64; 2] {
        [f64::from(self.width), f64::from(self.height)]
    }

    /// Pixels in all.
    pub fn pixels(self) -> usize {
        self.width as usize * self.height as usize
    }
}

impl fmt::Display for Size {
    /// As `640×480`.
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{}×{}", self.width, self.height)
    }
}
