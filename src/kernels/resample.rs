//! Bilinear upsampling and maximum pooling.

use super::map::{Extent, Map, MapMut};
use super::parallel::{for_each, with_scratch};
use super::simd::Vectors;

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
    for_each(fine.batch * x.extent.height, |line| {
        let (image, coarse_row) = (line / x.extent.height, line % x.extent.height);
        with_scratch(x.extent.width * channels, |mixed| {
            for row in coarse_row * factor..(coarse_row + 1) * factor {
                let (low, high, share) = between(row, factor, x.extent.height);
                let (low, high) = (x.row(image, low), x.row(image, high));
                let out = out.row(image, row);
                vectors.run(|| {
                    for ((mixed, &low), &high) in mixed.iter_mut().zip(low).zip(high) {
                        *mixed = low + share * (high - low);
                    }
                    for (column, out) in out.chunks_exact_mut(channels).enumerate() {
                        let (low, high, share) = between(column, factor, x.extent.width);
                        let low = &mixed[low * channels..(low + 1) * channels];
                        let high = &mixed[high * channels..(high + 1) * channels];
                        for ((out, &low), &high) in out.iter_mut().zip(low).zip(high) {
                            *out = low + share * (high - low);
                        }
                    }
                    if let Some(add) = add {
                        out.iter_mut().zip(add.row(image, row)).for_each(|(out, &add)| *out += add);
                    }
                });
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
    for_each(coarse.batch, |image| {
        for row in 0..coarse.height {
            dx.row(image, row).fill(0.0);
        }
        with_scratch(coarse.width * channels, |gathered| {
            for row in 0..dy.extent.height {
                let line = dy.row(image, row);
                vectors.run(|| {
                    gathered.fill(0.0);
                    for (column, pixel) in line.chunks_exact(channels).enumerate() {
                        let (low, high, share) = between(column, factor, coarse.width);
                        for (cell, share) in [(low, 1.0 - share), (high, share)] {
                            let to = &mut gathered[cell * channels..(cell + 1) * channels];
                            to.iter_mut().zip(pixel).for_each(|(to, &value)| *to += share * value);
                        }
                    }
                    let (low, high, share) = between(row, factor, coarse.height);
                    for (cell, share) in [(low, 1.0 - share), (high, share)] {
                        let to = dx.row(image, cell);
                        to.iter_mut().zip(&*gathered).for_each(|(to, &value)| *to += share * value);
                    }
                });
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
    for_each(expected.batch * expected.height, |line| {
        let (image, row) = (line / expected.height, line % expected.height);
        let rows = (2 * row).saturating_sub(1)..(2 * row + 2).min(height);
        vectors.run(|| {
            for (column, out) in out.row(image, row).chunks_exact_mut(channels).enumerate() {
                out.fill(f32::NEG_INFINITY);
                for y in rows.clone() {
                    let columns = (2 * column).saturating_sub(1)..(2 * column + 2).min(width);
                    let window = &x.row(image, y)[columns.start * channels..columns.end * channels];
                    for pixel in window.chunks_exact(channels) {
                        out.iter_mut().zip(pixel).for_each(|(out, &value)| *out = out.max(value));
                    }
                }
            }
        });
    });
}
