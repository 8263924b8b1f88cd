//! Letters and figures, as boards, scores and logos have them.

use rand::RngExt;

use gravisight_geometry::random::Random;

/// Dots of a letter: columns from the left, in each the top row is the lowest bit.
const LETTERS: [[u8; 5]; 22] = [
    [0x7e, 0x11, 0x11, 0x11, 0x7e],
    [0x7f, 0x49, 0x49, 0x49, 0x36],
    [0x3e, 0x41, 0x41, 0x41, 0x22],
    [0x7f, 0x41, 0x41, 0x22, 0x1c],
    [0x7f, 0x49, 0x49, 0x49, 0x41],
    [0x7f, 0x09, 0x09, 0x09, 0x01],
    [0x3e, 0x41, 0x49, 0x49, 0x7a],
    [0x7f, 0x08, 0x08, 0x08, 0x7f],
    [0x00, 0x41, 0x7f, 0x41, 0x00],
    [0x7f, 0x08, 0x14, 0x22, 0x41],
    [0x7f, 0x40, 0x40, 0x40, 0x40],
    [0x7f, 0x02, 0x0c, 0x02, 0x7f],
    [0x7f, 0x04, 0x08, 0x10, 0x7f],
    [0x3e, 0x41, 0x41, 0x41, 0x3e],
    [0x7f, 0x09, 0x09, 0x09, 0x06],
    [0x7f, 0x09, 0x19, 0x29, 0x46],
    [0x46, 0x49, 0x49, 0x49, 0x31],
    [0x01, 0x01, 0x7f, 0x01, 0x01],
    [0x3f, 0x40, 0x40, 0x40, 0x3f],
    [0x1f, 0x20, 0x40, 0x20, 0x1f],
    [0x63, 0x14, 0x08, 0x14, 0x63],
    [0x61, 0x51, 0x49, 0x45, 0x43],
];
/// The same of the figures from 0 to 9.
const FIGURES: [[u8; 5]; 10] = [
    [0x3e, 0x51, 0x49, 0x45, 0x3e],
    [0x00, 0x42, 0x7f, 0x40, 0x00],
    [0x42, 0x61, 0x51, 0x49, 0x46],
    [0x21, 0x41, 0x45, 0x4b, 0x31],
    [0x18, 0x14, 0x12, 0x7f, 0x10],
    [0x27, 0x45, 0x45, 0x45, 0x39],
    [0x3c, 0x4a, 0x49, 0x49, 0x30],
    [0x01, 0x71, 0x09, 0x05, 0x03],
    [0x36, 0x49, 0x49, 0x49, 0x36],
    [0x06, 0x49, 0x49, 0x29, 0x1e],
];
/// A ball before a name, as many makers have one, and a gap.
const DISC: [u8; 5] = [0x1c, 0x3e, 0x3e, 0x3e, 0x1c];
/// Dots from one letter to the next, and rows with a free one above and below.
const ADVANCE: usize = 6;
pub(super) const ROWS: f64 = 9.0;
/// Letters of a name.
const LENGTHS: std::ops::RangeInclusive<usize> = 3..=8;
/// How often a name has a disc before it.
const WITH_DISC: f64 = 0.4;

/// A line of dots.
#[derive(Debug, Clone)]
pub(super) struct Lettering(Vec<u8>);

impl Lettering {
    fn of<'a>(letters: impl Iterator<Item = &'a [u8; 5]>) -> Self {
        let mut columns = Vec::new();
        for letter in letters {
            columns.extend(letter);
            columns.resize(columns.len().next_multiple_of(ADVANCE), 0);
        }
        Self(columns)
    }

    /// A name that means nothing.
    pub fn name(random: &mut Random) -> Self {
        let disc = random.random_bool(WITH_DISC).then_some(&DISC);
        let count = random.random_range(LENGTHS);
        let letters: Vec<&[u8; 5]> = (0..count).map(|_| &LETTERS[random.random_range(0..LETTERS.len())]).collect();
        Self::of(disc.into_iter().chain(letters))
    }

    /// A number of so many figures.
    pub fn number(value: usize, figures: u32) -> Self {
        Self::of((0..figures).rev().map(|place| &FIGURES[value / 10_usize.pow(place) % 10]))
    }

    /// Dots from left to right.
    pub fn width(&self) -> f64 {
        self.0.len() as f64
    }

    /// How much of a place is lit, `x` dots from the left and `y` from the top of [`ROWS`]; `blur` is how many dots a pixel covers.
    pub fn lit(&self, x: f64, y: f64, blur: f64) -> f32 {
        let (left, top) = (x - 0.5, y - 1.5);
        let dot = |column: f64, row: f64| -> f32 {
            let fits = (0.0..self.width()).contains(&column) && (0.0..7.0).contains(&row);
            f32::from(u8::from(fits && self.0[column as usize] >> row as u8 & 1 == 1))
        };
        // Sharp letters where a pixel covers less than a dot.
        let sharp = (1.0 / blur.max(0.05)).clamp(1.0, 6.0);
        let ease = |fraction: f64| ((fraction - 0.5) * sharp + 0.5).clamp(0.0, 1.0) as f32;
        let (column, row) = (left.floor(), top.floor());
        let (u, v) = (ease(left - column), ease(top - row));
        let upper = dot(column, row) + u * (dot(column + 1.0, row) - dot(column, row));
        let lower = dot(column, row + 1.0) + u * (dot(column + 1.0, row + 1.0) - dot(column, row + 1.0));
        upper + v * (lower - upper)
    }
}
