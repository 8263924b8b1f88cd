//! Bilinear upsampling and maximum pooling.

use super::map::{Extent, Map, MapMut};
use super::parallel::{for_each_of, with_scratch};
use super::simd::{Vectors, vectorised};

/// The two input cells that an output cell lies between, and the second one's share (pixel centres,
/// edges clamped; PyTorch's `align_corners = false`).
fn between(output: usize, factor: usize, count: usize) -> (usize, usize, f32) {
    let at = ((output as f32 + 0.5) / factor as f32 - 0.5).max(0.0);
    let low = at as usize;
    (low, (low + 1).min(count - 1), at - low as f32)
}

/// Layout of a map upsampled by a whole factor, without halo.
fn upsampled(extent: Extent, factor: usize) -> Extent {
    Extent { height: extent.height * factor, width: extent.width * factor, halo: 0, ..extent }
}

/// Bilinear upsampling by a whole `factor`, plus `add`.
///
/// # Panics
/// Where `out` or `add` has another size.
pub fn upsample(vectors: Vectors, x: Map<'_>, factor: usize, add: Option<Map<'_>>, out: MapMut<'_>) {
    let fine = upsampled(x.extent, factor);
    assert_eq!(out.extent.with_halo(0), fine, "upsampling {:?} {factor} times", x.extent);
    assert!(add.is_none_or(|add| add.extent.with_halo(0) == fine), "adding to {fine:?}");
    let channels = x.extent.channels;
    for_each_of(out.rows().chunks_exact_mut(factor).collect(), |line, rows| {
        let (image, coarse_row) = (line / x.extent.height, line % x.extent.height);
        with_scratch(x.extent.width * channels, |mixed| {
            for (row, out) in (coarse_row * factor..).zip(rows) {
                let (low, high, share) = between(row, factor, x.extent.height);
                let (low, high) = (x.row(image, low), x.row(image, high));
                let add = add.map_or(&[][..], |add| add.row(image, row));
                mix_rows(vectors, low, high, share, mixed);
                stretch(vectors, mixed, factor, channels, add, out);
            }
        });
    });
}

/// Gradient of [`upsample`]'s input from that of its output.
///
/// # Panics
/// Where the sizes do not fit.
pub fn upsample_backward(vectors: Vectors, dy: Map<'_>, factor: usize, dx: MapMut<'_>) {
    let coarse = dx.extent;
    assert_eq!(dy.extent.with_halo(0), upsampled(coarse, factor), "upsampling {coarse:?} {factor} times");
    let channels = coarse.channels;
    for_each_of(dx.rows().chunks_exact_mut(coarse.height).collect(), |image, rows| {
        rows.iter_mut().for_each(|row| row.fill(0.0));
        with_scratch(coarse.width * channels, |gathered| {
            for row in 0..dy.extent.height {
                let line = dy.row(image, row);
                gather(vectors, line, factor, channels, gathered);
                let (low, high, share) = between(row, factor, coarse.height);
                add_share(vectors, gathered, 1.0 - share, rows[low]);
                add_share(vectors, gathered, share, rows[high]);
            }
        });
    });
}

/// Maximum over 3×3 windows of stride 2, padded by 1 (ResNet's).
///
/// # Panics
/// Where `out` has another size.
pub fn max_pool(vectors: Vectors, x: Map<'_>, out: MapMut<'_>) {
    let Extent { height, width, channels, .. } = x.extent;
    let expected = Extent { height: height.div_ceil(2), width: width.div_ceil(2), halo: 0, ..x.extent };
    assert_eq!(out.extent.with_halo(0), expected, "pooling {:?}", x.extent);
    for_each_of(out.rows(), |line, out| {
        let (image, row) = (line / expected.height, line % expected.height);
        let rows = (2 * row).saturating_sub(1)..(2 * row + 2).min(height);
        out.fill(f32::NEG_INFINITY);
        for y in rows {
            pool_row(vectors, x.row(image, y), channels, out);
        }
    });
}

vectorised! {
    /// `low + share · (high - low)`.
    fn mix_rows<'a>(low: &'a [f32], high: &'a [f32], share: f32, out: &'a mut [f32]) {
        for ((out, &low), &high) in out.iter_mut().zip(low).zip(high) {
            *out = low + share * (high - low);
        }
    }
}

vectorised! {
    /// A row upsampled along itself, plus `add` if that is not empty.
    fn stretch<'a>(row: &'a [f32], factor: usize, channels: usize, add: &'a [f32], out: &'a mut [f32]) {
        let count = row.len() / channels;
        for (column, out) in out.chunks_exact_mut(channels).enumerate() {
            let (low, high, share) = between(column, factor, count);
            let low = &row[low * channels..(low + 1) * channels];
            let high = &row[high * channels..(high + 1) * channels];
            for ((out, &low), &high) in out.iter_mut().zip(low).zip(high) {
                *out = low + share * (high - low);
            }
        }
        for (out, &add) in out.iter_mut().zip(add) {
            *out += add;
        }
    }
}

vectorised! {
    /// The adjoint of [`stretch`].
    fn gather<'a>(fine: &'a [f32], factor: usize, channels: usize, row: &'a mut [f32]) {
        row.fill(0.0);
        let count = row.len() / channels;
        for (column, pixel) in fine.chunks_exact(channels).enumerate() {
            let (low, high, share) = between(column, factor, count);
            for (cell, share) in [(low, 1.0 - share), (high, share)] {
                for (to, &value) in row[cell * channels..(cell + 1) * channels].iter_mut().zip(pixel) {
                    *to += share * value;
                }
            }
        }
    }
}

vectorised! {
    fn add_share<'a>(values: &'a [f32], share: f32, to: &'a mut [f32]) {
        for (to, &value) in to.iter_mut().zip(values) {
            *to += share * value;
        }
    }
}

vectorised! {
    /// Takes the maxima of a row's windows into `out`.
    fn pool_row<'a>(row: &'a [f32], channels: usize, out: &'a mut [f32]) {
        let width = row.len() / channels;
        for (column, out) in out.chunks_exact_mut(channels).enumerate() {
            let columns = (2 * column).saturating_sub(1)..(2 * column + 2).min(width);
            for pixel in row[columns.start * channels..columns.end * channels].chunks_exact(channels) {
                for (out, &value) in out.iter_mut().zip(pixel) {
                    *out = out.max(value);
                }
            }
        }
    }
}
