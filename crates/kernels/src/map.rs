//! Feature maps in memory: channels last, with a halo of zeros.

use super::parallel::for_each_of;

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

    /// Values in all; more than any buffer holds where they cannot be counted.
    #[allow(clippy::len_without_is_empty)] // an extent is a size, and holds nothing
    pub fn len(&self) -> usize {
        let padded = |side: usize| side.saturating_add(self.halo.saturating_mul(2));
        let sides = [padded(self.height), padded(self.width), self.channels];
        sides.into_iter().fold(self.batch, usize::saturating_mul)
    }

    /// Where a pixel's values are; rows and columns count from the halo's inner edge.
    pub fn at(&self, image: usize, row: usize, column: usize) -> usize {
        image * self.image() + (row + self.halo) * self.pitch() + (column + self.halo) * self.channels
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
        for_each_of(images.chunks_exact_mut(extent.image()).collect(), |image, values| {
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

/// A map to write.
pub struct MapMut<'a> {
    pub(super) extent: Extent,
    pub(super) values: &'a mut [f32],
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
        Self { extent, values }
    }

    /// The values of all rows without their halo, picture by picture.
    pub(super) fn rows(self) -> Vec<&'a mut [f32]> {
        let Extent { batch, height, width, channels, halo } = self.extent;
        let lines = height + 2 * halo;
        let inner = halo * channels..(halo + width) * channels;
        (self.values.chunks_exact_mut(self.extent.pitch()).take(batch * lines).enumerate())
            .filter(|(line, _)| (halo..halo + height).contains(&(line % lines)))
            .map(|(_, values)| &mut values[inner.clone()])
            .collect()
    }
}
