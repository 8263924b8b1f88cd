//! Feature maps in memory: channels last, with a halo of zeros.

use super::parallel::for_each;
use super::simd::Shared;

/// Size and layout of a feature map: `[batch, height + 2·halo, width + 2·halo, channels]`, row-major.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Extent {
    /// Pictures.
    pub batch: usize,
    /// Rows, without the halo.
    pub height: usize,
    /// Pixels in a row, without the halo.
    pub width: usize,
    /// Values at a pixel.
    pub channels: usize,
    /// Rows and columns of zeros on each side.
    pub halo: usize,
}

impl Extent {
    /// A map without halo.
    pub fn new([batch, height, width, channels]: [usize; 4]) -> Self {
        Self { batch, height, width, channels, halo: 0 }
    }

    /// The same map with a halo.
    pub fn with_halo(self, halo: usize) -> Self {
        Self { halo, ..self }
    }

    /// Values from row to row.
    pub fn pitch(&self) -> usize {
        (self.width + 2 * self.halo) * self.channels
    }

    /// Values from picture to picture.
    pub fn image(&self) -> usize {
        (self.height + 2 * self.halo) * self.pitch()
    }

    /// Values in all.
    pub fn len(&self) -> usize {
        self.batch * self.image()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Where a pixel's values are; rows and columns count from the halo's inner edge.
    pub fn at(&self, image: usize, row: usize, column: usize) -> usize {
        image * self.image() + (row + self.halo) * self.pitch() + (column + self.halo) * self.channels
    }

    /// One of its pictures.
    pub fn one(self) -> Self {
        Self { batch: 1, ..self }
    }
}

/// A map to read.
#[derive(Clone, Copy)]
pub struct Map<'a> {
    /// Its layout.
    pub extent: Extent,
    /// Its values; may be longer than the extent.
    pub values: &'a [f32],
}

impl<'a> Map<'a> {
    /// Values in a layout.
    ///
    /// # Panics
    /// Where there are too few.
    pub fn new(extent: Extent, values: &'a [f32]) -> Self {
        assert!(
            values.len() >= extent.len(),
            "a map of {extent:?} needs {} values, not {}",
            extent.len(),
            values.len()
        );
        Self { extent, values }
    }

    /// The values of a row without its halo.
    pub fn row(&self, image: usize, row: usize) -> &'a [f32] {
        let start = self.extent.at(image, row, 0);
        &self.values[start..start + self.extent.width * self.extent.channels]
    }

    /// The `count` pictures from `first`, and whatever values follow them.
    pub fn images(&self, first: usize, count: usize) -> Map<'a> {
        Map { extent: Extent { batch: count, ..self.extent }, values: &self.values[first * self.extent.image()..] }
    }

    /// Copies it to `to`, a buffer for the same map with `halo`, whose zeros are written too.
    pub fn pad_into(&self, halo: usize, to: &mut [f32]) {
        let extent = self.extent.with_halo(halo);
        let (images, rest) = to.split_at_mut(extent.len());
        rest.fill(0.0);
        let images = Shared::new(images);
        for_each(extent.batch, |image| {
            let values = images.part(image * extent.image(), extent.image());
            let edge = halo * extent.channels;
            for (row, line) in values.chunks_exact_mut(extent.pitch()).enumerate() {
                match row.checked_sub(halo).filter(|&row| row < extent.height) {
                    Some(row) => {
                        let (left, inner) = line.split_at_mut(edge);
                        let (inner, right) = inner.split_at_mut(inner.len() - edge);
                        left.fill(0.0);
                        inner.copy_from_slice(self.row(image, row));
                        right.fill(0.0);
                    }
                    None => line.fill(0.0),
                }
            }
        });
    }
}

/// A map to write, by several threads of one call at once.
// Not to be copied outside: two calls must not write to one map.
pub struct MapMut<'a> {
    pub(super) extent: Extent,
    pub(super) values: Shared<'a>,
}

impl<'a> MapMut<'a> {
    /// Values in a layout.
    ///
    /// # Panics
    /// Where there are too few.
    pub fn new(extent: Extent, values: &'a mut [f32]) -> Self {
        assert!(
            values.len() >= extent.len(),
            "a map of {extent:?} needs {} values, not {}",
            extent.len(),
            values.len()
        );
        Self { extent, values: Shared::new(values) }
    }

    /// The values of a row without its halo, for the task that it belongs to.
    pub(super) fn row(&self, image: usize, row: usize) -> &'a mut [f32] {
        self.values.part(self.extent.at(image, row, 0), self.extent.width * self.extent.channels)
    }
}
