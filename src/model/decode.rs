//! From maps to coordinates: soft-argmax and softmax-weighted depth.

use burn::tensor::{Device, Tensor, TensorData, activation::softmax};

use super::config::PenConfig;
use super::pen::PenOutput;

/// Radius around the position found within which the heatmap's mass counts as confidence,
/// input px: three standard deviations of the training target.
pub const CONFIDENCE_RADIUS: f64 = 12.0;

/// Coordinates decoded from a [`PenOutput`].
#[derive(Debug, Clone)]
pub struct Decoded {
    /// 2D position, x then y, px of the network's input, `[batch, 2]`.
    pub image: Tensor<2>,
    /// Depth (camera z), m, `[batch]`.
    pub depth: Tensor<1>,
    /// Softmax of the heatmap, `[batch, height/stride, width/stride]`, sums to 1.
    pub probability: Tensor<3>,
}

/// Soft-argmax in 2D and softmax-weighted depth: paper eq. (1).
pub fn decode(output: PenOutput, config: &PenConfig) -> Decoded {
    let [batch, height, width] = output.heatmap.dims();
    let stride = config.output_stride();
    let device = output.heatmap.device();
    let logits = output.heatmap.mul_scalar(config.heatmap.beta).reshape([batch, height * width]);
    let probability = softmax(logits, 1).reshape([batch, height, width]);
    // Over tens of thousands of cells an f32 softmax sums to 1 only to some 1e-5, which would move
    // coordinates and depth by as much: divide by the mass that is really there.
    let mass = probability.clone().sum_dim(1).sum_dim(2); // [b, 1, 1]
    let probability = probability / mass;
    let columns = probability.clone().sum_dim(1).reshape([batch, width]); // [b, w]
    let rows = probability.clone().sum_dim(2).reshape([batch, height]); // [b, h]
    let x = (columns * cell_centres(width, stride, &device)).sum_dim(1); // [b, 1]
    let y = (rows * cell_centres(height, stride, &device)).sum_dim(1); // [b, 1]
    let depth = weighted_depth(output.depth, probability.clone());
    Decoded { image: Tensor::cat(vec![x, y], 1), depth, probability }
}

/// Mean of the depth map under `weights` (both `[batch, h, w]`, weights summing to 1): `[batch]`.
pub(crate) fn weighted_depth(depth: Tensor<3>, weights: Tensor<3>) -> Tensor<1> {
    let [batch, height, width] = depth.dims();
    (depth * weights).reshape([batch, height * width]).sum_dim(1).squeeze_dim(1)
}

/// Centres of `count` cells of `stride` input pixels, px: `[1, count]`.
fn cell_centres(count: usize, stride: usize, device: &Device) -> Tensor<2> {
    let centres: Vec<f32> = (0..count).map(|cell| cell_centre(cell, stride) as f32).collect();
    Tensor::from_data(TensorData::new(centres, [1, count]), device)
}

/// Centre of a cell of `stride` input pixels, px.
pub(crate) fn cell_centre(cell: usize, stride: usize) -> f64 {
    (cell as f64 + 0.5) * stride as f64 - 0.5
}

/// Share of the heatmap's mass within 12 input px of the position found, 0 to 1.
///
/// `probability` is one picture's, row-major, `width` cells wide. A single sharp peak gives nearly
/// 1; a ball that is not there spreads the mass and gives little.
pub fn confidence(probability: &[f32], width: usize, stride: usize, image: [f64; 2]) -> f64 {
    let near = |index: usize| {
        let dx = cell_centre(index % width, stride) - image[0];
        let dy = cell_centre(index / width, stride) - image[1];
        dx.hypot(dy) <= CONFIDENCE_RADIUS
    };
    let mass = probability.iter().enumerate().filter(|&(index, _)| near(index));
    mass.map(|(_, &share)| f64::from(share)).sum::<f64>().clamp(0.0, 1.0)
}
