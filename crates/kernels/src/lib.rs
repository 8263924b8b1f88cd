//! The arithmetic of PEN's layers on plain slices: convolutions, normalisation, resampling, forward
//! and backward, for the CPU, native and wasm. Maps are channels-last (`[batch, height, width,
//! channels]`); nothing here knows of tensors or networks.
#![deny(unsafe_code)]
#![warn(clippy::unwrap_used)]
#![cfg_attr(test, allow(clippy::unwrap_used))]

mod conv;
mod depthwise;
mod gradient;
mod map;
mod norm;
mod parallel;
pub mod pixels;
mod resample;
mod simd;
#[cfg(test)]
mod tests;
mod unit;
mod winograd;

pub use conv::ConvShape;
pub use map::{Extent, Map, MapMut};
pub use norm::{gelu, layer_norm, response_norm};
pub use parallel::{Buffer, for_each, for_each_of, threads, with_threads_awake, zeros};
pub use resample::{max_pool, upsample, upsample_backward};
pub use simd::{SLACK, Vectors};
pub use unit::{Forward, NormInput, Saved, UnitGradients, UnitShape, Wanted, unit_backward, unit_forward};

use conv::{Epilogue, Packed};
use depthwise::PackedDepthwise;
use winograd::Winograd;

/// A convolution ready to run: weights in the kernels' own order.
#[derive(Debug, Clone)]
pub struct Convolution {
    vectors: Vectors,
    shape: ConvShape,
    method: Method,
    /// Biases in whole vectors.
    start: Option<Vec<f32>>,
}

#[derive(Debug, Clone)]
enum Method {
    Direct(Packed),
    Winograd(Winograd),
    Depthwise(PackedDepthwise),
    /// One output channel of a 1×1 kernel: its weights.
    Single(Vec<f32>),
}

impl Convolution {
    /// Prepares `weights` (of [`ConvShape::weights`]) and `bias` (a value for each output channel) for
    /// outputs like `output`.
    ///
    /// # Panics
    /// Where the slices have other lengths, or for a depthwise convolution that is not of stride 1
    /// and a kernel of 3, 5 or 7.
    pub fn new(vectors: Vectors, shape: ConvShape, weights: &[f32], bias: Option<&[f32]>, output: &Extent) -> Self {
        assert_eq!(weights.len(), shape.weights().iter().product::<usize>(), "weights of {shape:?}");
        let method = if shape.depthwise {
            let plain = shape.stride == 1 && shape.channels[0] == shape.channels[1];
            assert!(plain && matches!(shape.kernel, 3 | 5 | 7), "{shape:?} is not supported");
            Method::Depthwise(PackedDepthwise::new(vectors, &shape, weights, false))
        } else if shape.kernel == 1 && shape.stride == 1 && shape.channels[1] == 1 {
            Method::Single(weights.to_vec())
        } else {
            let dense = Packed::dense(vectors, &shape, weights);
            if winograd::pays(shape.kernel, shape.stride, shape.channels, output) {
                Method::Winograd(Winograd::new(vectors, shape.kernel, shape.channels, &dense))
            } else {
                Method::Direct(dense)
            }
        };
        let start = bias.map(|bias| {
            assert_eq!(bias.len(), shape.channels[1], "biases of {shape:?}");
            let mut start = bias.to_vec();
            start.resize(bias.len() + SLACK, 0.0);
            start
        });
        Self { vectors, shape, method, start }
    }

    /// Halo of zeros with which its input is taken as it is. Without it dense convolutions copy what is at the edges.
    pub fn halo(&self) -> usize {
        self.shape.padding
    }

    /// `out = slope(convolution of x + bias + skip)`: negative results are multiplied by `slope`, 0 to
    /// 1. For a depthwise convolution `x` has a halo of at least [`Self::halo`] and [`SLACK`] values after it.
    ///
    /// # Panics
    /// Where a map's size or halo is not as stated; for a skip of a depthwise convolution.
    pub fn run(&self, x: Map<'_>, skip: Option<Map<'_>>, slope: f32, out: MapMut<'_>) {
        let (vectors, shape, start) = (self.vectors, &self.shape, self.start.as_deref());
        let expected = shape.output(x.extent);
        assert_eq!(out.extent.with_halo(0), expected, "output of {shape:?}");
        assert!(skip.is_none_or(|skip| skip.extent.with_halo(0) == expected), "skip of {shape:?}");
        let epilogue = Epilogue { start, skip, slope };
        match &self.method {
            Method::Direct(packed) => conv::forward(vectors, shape, packed, x, epilogue, out),
            Method::Winograd(winograd) => winograd.run(vectors, shape.padding, x, epilogue, out),
            Method::Single(weights) => norm::weighted_sum(vectors, x, weights, epilogue, out),
            Method::Depthwise(packed) => depthwise::forward(vectors, shape, shape.padding, packed, x, epilogue, out),
        }
    }
}
