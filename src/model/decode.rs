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
    /// Depth (camera z), m, `[batch]`; of a network that reads sizes the apparent radius, px.
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
    let depth = match config.depth.is_size() {
        true => weighted_depth(output.depth.log(), probability.clone()).exp(),
        false => weighted_depth(output.depth, probability.clone()),
    };
    Decoded { image: Tensor::cat(vec![x, y], 1), depth, probability }
}

/// Mean of the depth map under `weights` (both `[batch, h, w]`, weights summing to 1): `[batch]`.
pub(crate) fn weighted_depth(depth: Tensor<3>, weights: Tensor<3>) -> Tensor<1> {
    let [batch, height, width] = depth.dims();
    (depth * weights).reshape([batch, height * width]).sum_dim(1).squeeze_dim(1)
}

impl Decoded {
    /// [`confidence`] of each picture, where the maps are: `[batch]`.
    pub fn confidences(&self, stride: usize) -> Tensor<1> {
        let [batch, height, width] = self.probability.dims();
        let device = self.probability.device();
        let off = |axis: usize, count: usize| {
            (cell_centres(count, stride, &device) - self.image.clone().narrow(1, axis, 1)).square() // [b, count]
        };
        let far = off(1, height).reshape([batch, height, 1]) + off(0, width).reshape([batch, 1, width]);
        let near = far.lower_equal_elem(CONFIDENCE_RADIUS * CONFIDENCE_RADIUS).float();
        (self.probability.clone() * near).reshape([batch, height * width]).sum_dim(1).squeeze_dim(1)
    }
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

/// The maps of one picture of a network that reads sizes, row-major.
#[derive(Debug, Clone)]
pub struct SizeMaps {
    /// Cells in a row.
    pub width: usize,
    /// Input px to a cell's side.
    pub stride: usize,
    /// Probability of each cell.
    pub probability: Vec<f32>,
    /// Apparent radius, px.
    pub radius: Vec<f32>,
    /// Logarithm of the scale of the error of log(radius).
    pub log_scale: Vec<f32>,
}

/// A peak of the heatmap: a ball may be there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// Centre of the ball's outline, px of the network's input.
    pub image: [f64; 2],
    /// Its semi-minor axis, px of the network's input.
    pub radius: f64,
    /// Scale of the error of log(radius), a Laplace distribution's.
    pub log_scale: f64,
    /// Fraction of the heatmap's mass around it, 0 to 1.
    pub confidence: f64,
}

/// How often a peak's window is centred on the mean of its mass.
const CENTRINGS: usize = 3;

/// The `count` highest peaks, the highest first: position, radius and scale are means within [`CONFIDENCE_RADIUS`]. What lies within that
/// radius of a peak, or within its ball, is no other peak.
pub fn peaks(maps: &SizeMaps, count: usize) -> Vec<Peak> {
    let SizeMaps { width, stride, .. } = *maps;
    let height = maps.probability.len() / width;
    let mut left = maps.probability.clone();
    let mut found = Vec::new();
    // The cells around a point, with their centres.
    let around = |image: [f64; 2], reach: f64| {
        let range = |at: f64, cells: usize| {
            let cell = |at: f64| ((at + 0.5) / stride as f64 - 0.5).clamp(0.0, cells as f64 - 1.0);
            cell(at - reach).ceil() as usize..=cell(at + reach).floor() as usize
        };
        let columns = range(image[0], width);
        range(image[1], height).flat_map(move |row| columns.clone().map(move |column| (row, column))).filter_map(
            move |(row, column)| {
                let at = [cell_centre(column, stride), cell_centre(row, stride)];
                let near = (at[0] - image[0]).hypot(at[1] - image[1]) <= reach;
                near.then_some((row * width + column, at))
            },
        )
    };
    for _ in 0..count {
        let Some((best, &most)) = left.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)) else { break };
        if most <= 0.0 {
            break;
        }
        let mut image = [cell_centre(best % width, stride), cell_centre(best / width, stride)];
        let (mut mass, mut log_radius, mut log_scale) = (0.0, 0.0, 0.0);
        for _ in 0..CENTRINGS {
            let (mut sum, mut centre) = (0.0, [0.0; 2]);
            (log_radius, log_scale) = (0.0, 0.0);
            for (cell, at) in around(image, CONFIDENCE_RADIUS) {
                let fraction = f64::from(left[cell]);
                sum += fraction;
                (0..2).for_each(|axis| centre[axis] += fraction * at[axis]);
                log_radius += fraction * f64::from(maps.radius[cell]).ln();
                log_scale += fraction * f64::from(maps.log_scale[cell]);
            }
            if sum <= 0.0 {
                break;
            }
            mass = sum;
            image = centre.map(|axis| axis / sum);
            (log_radius, log_scale) = (log_radius / sum, log_scale / sum);
        }
        let radius = log_radius.exp();
        found.push(Peak { image, radius, log_scale: log_scale.exp(), confidence: mass.clamp(0.0, 1.0) });
        let taken: Vec<usize> = around(image, radius.max(CONFIDENCE_RADIUS)).map(|(cell, _)| cell).collect();
        taken.into_iter().chain([best]).for_each(|cell| left[cell] = 0.0);
    }
    found
}

/// Fraction of the heatmap's mass within 12 input px of the position found, 0 to 1.
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
    mass.map(|(_, &fraction)| f64::from(fraction)).sum::<f64>().clamp(0.0, 1.0)
}
