//! Depthwise convolutions of stride 1.

use super::conv::{ConvShape, Epilogue};
use super::map::{Map, MapMut};
use super::parallel::for_each;
use super::simd::{DepthwiseGradientRow, DepthwiseRow, Shared, Vectors};

/// A depthwise kernel in the order that rows read it: `[vectors of channels, kernel, kernel, lanes]`.
#[derive(Debug, Clone)]
pub struct PackedDepthwise(Vec<f32>);

impl PackedDepthwise {
    /// Packs `[channels, 1, kernel, kernel]`, turned by 180° for the input's gradient.
    pub(super) fn new(vectors: Vectors, shape: &ConvShape, weights: &[f32], mirrored: bool) -> Self {
        let (lanes, taps, channels) = (vectors.lanes(), shape.kernel * shape.kernel, shape.channels[0]);
        let mut values = vec![0.0; channels.div_ceil(lanes) * taps * lanes];
        for (index, &weight) in weights.iter().enumerate() {
            let (channel, tap) = (index / taps, index % taps);
            let tap = if mirrored { taps - 1 - tap } else { tap };
            values[(channel / lanes * taps + tap) * lanes + channel % lanes] = weight;
        }
        Self(values)
    }
}

/// The convolution of `x` with its own padding (the gradient's is another), which has a halo and slack.
pub(super) fn forward(
    vectors: Vectors,
    shape: &ConvShape,
    padding: usize,
    weights: &PackedDepthwise,
    x: Map<'_>,
    epilogue: Epilogue<'_>,
    out: MapMut<'_>,
) {
    assert!(epilogue.skip.is_none(), "a depthwise convolution takes no skip");
    let (lanes, taps) = (vectors.lanes(), shape.kernel * shape.kernel);
    let zeros = [0.0; super::simd::SLACK];
    let edge = x.extent.halo.checked_sub(padding).unwrap_or_else(|| panic!("{:?} has too small a halo", x.extent));
    let (extent, out) = (out.extent, Shared::new(out.values));
    for_each(extent.batch * extent.height, |line| {
        let (image, row) = (line / extent.height, line % extent.height);
        let corner = image * x.extent.image() + (row + edge) * x.extent.pitch() + edge * x.extent.channels;
        for (index, weights) in weights.0.chunks_exact(taps * lanes).enumerate() {
            let channel = index * lanes;
            vectors.depthwise(&DepthwiseRow {
                x: x.values,
                input: corner + channel,
                pitch: x.extent.pitch(),
                channels: x.extent.channels,
                kernel: shape.kernel,
                weights,
                width: lanes.min(extent.channels - channel),
                start: epilogue.start.map_or(&zeros[..lanes], |start| &start[channel..channel + lanes]),
                slope: epilogue.slope,
                columns: extent.width,
                out,
                output: extent.at(image, row, 0) + channel,
                output_step: extent.channels,
            });
        }
    });
}

/// Length of the sums of [`add_weight_gradient`].
pub(super) fn gradient_len(vectors: Vectors, shape: &ConvShape) -> usize {
    shape.channels[0].next_multiple_of(vectors.lanes()) * shape.kernel * shape.kernel
}

/// Adds the kernel's gradient to `sums`, laid out as [`PackedDepthwise`]; `x` and `dy` have slack.
pub(super) fn add_weight_gradient(vectors: Vectors, shape: &ConvShape, x: Map<'_>, dy: Map<'_>, sums: &mut [f32]) {
    let (lanes, kernel) = (vectors.lanes(), shape.kernel);
    let edge = x.extent.halo - shape.padding;
    for line in 0..dy.extent.batch * dy.extent.height {
        let (image, row) = (line / dy.extent.height, line % dy.extent.height);
        for (index, sums) in sums.chunks_exact_mut(kernel * lanes).enumerate() {
            let (channel, ky) = (index / kernel * lanes, index % kernel);
            let corner = image * x.extent.image() + (row + ky + edge) * x.extent.pitch() + edge * x.extent.channels;
            vectors.depthwise_gradient(&mut DepthwiseGradientRow {
                x: x.values,
                dy: dy.values,
                start: [corner + channel, dy.extent.at(image, row, 0) + channel],
                channels: x.extent.channels,
                columns: dy.extent.width,
                kernel,
                sums,
            });
        }
    }
}

/// Brings summed gradients to `[channels, 1, kernel, kernel]`.
pub(super) fn unpack(vectors: Vectors, shape: &ConvShape, sums: &[f32]) -> Vec<f32> {
    let (lanes, taps) = (vectors.lanes(), shape.kernel * shape.kernel);
    let of = |index: usize| {
        let (channel, tap) = (index / taps, index % taps);
        sums[(channel / lanes * taps + tap) * lanes + channel % lanes]
    };
    (0..shape.channels[0] * taps).map(of).collect()
}
