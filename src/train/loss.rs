//! Losses on the network's maps.

use burn::tensor::{Device, Tensor, TensorData, activation::log_softmax};
use serde::{Deserialize, Serialize};

use crate::model::{PenConfig, PenOutput};
use crate::model::{cell_centre, weighted_depth};

/// How the heatmap is compared with the 2D label.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum HeatmapLoss {
    /// Cross-entropy of the decoded distribution against a Gaussian of `sigma` input px.
    CrossEntropy {
        /// Standard deviation, input px.
        sigma: f64,
    },
    /// Mean squared error of the raw heatmap against `amplitude`·Gaussian (as published: 100, 2 px).
    Mse {
        /// Peak of the target.
        amplitude: f64,
        /// Standard deviation, input px.
        sigma: f64,
    },
}

impl HeatmapLoss {
    /// Standard deviation of the target, input px.
    pub fn sigma(&self) -> f64 {
        match *self {
            Self::CrossEntropy { sigma } | Self::Mse { sigma, .. } => sigma,
        }
    }
}

/// Labels of a batch.
#[derive(Debug, Clone)]
pub struct Labels {
    /// 2D positions, px of the network's input.
    pub image: Vec<[f64; 2]>,
    /// Depths (camera z), m.
    pub depth: Vec<f64>,
}

/// The parts of the loss, each a scalar tensor `[1]`.
#[derive(Debug, Clone)]
pub struct Losses {
    /// Heatmap loss.
    pub heatmap: Tensor<1>,
    /// Depth loss, unweighted.
    pub depth: Tensor<1>,
}

/// Heatmap loss and smooth-L1 depth loss (square below `transition` m) against 3D labels.
///
/// Depth is read out with the *target* heatmap's weights, so that it is taught where the ball is
/// from the first step on.
pub fn labels_3d(output: PenOutput, labels: &Labels, config: &PenConfig, loss: HeatmapLoss, transition: f64) -> Losses {
    let [batch, height, width] = output.heatmap.dims();
    let device = output.heatmap.device();
    let target = gaussians(&labels.image, [height, width], config.output_stride(), loss.sigma(), &device);
    // [batch, 1, 1]; a Gaussian around a label in the picture never sums to zero
    let mass = target.clone().reshape([batch, height * width]).sum_dim(1).reshape([batch, 1, 1]);
    let share = target.clone() / mass;
    let heatmap = match loss {
        HeatmapLoss::CrossEntropy { .. } => {
            let logits = output.heatmap.mul_scalar(config.heatmap.beta).reshape([batch, height * width]);
            let log_probability = log_softmax(logits, 1).reshape([batch, height, width]);
            (log_probability * share.clone()).sum().neg().div_scalar(batch as f64)
        }
        HeatmapLoss::Mse { amplitude, .. } => (output.heatmap - target.mul_scalar(amplitude)).powi_scalar(2).mean(),
    };
    let true_depth: Vec<f32> = labels.depth.iter().map(|&depth| depth as f32).collect();
    let true_depth = Tensor::from_data(TensorData::new(true_depth, [batch]), &device);
    let error = weighted_depth(output.depth, share) - true_depth;
    Losses { heatmap, depth: smooth_l1(error, transition).mean() }
}

/// `e²/(2t)` below the transition `t`, `|e| − t/2` above.
fn smooth_l1(error: Tensor<1>, transition: f64) -> Tensor<1> {
    let size = error.abs();
    let inside = size.clone().clamp_max(transition);
    // ½·inside²/t + (size − inside): both branches at once, differentiable everywhere
    inside.clone().powi_scalar(2).div_scalar(2.0 * transition) + (size - inside)
}

/// Gaussians of height 1 around `centres` (input px): `[batch, height, width]` cells of `stride` px.
fn gaussians(
    centres: &[[f64; 2]],
    [height, width]: [usize; 2],
    stride: usize,
    sigma: f64,
    device: &Device,
) -> Tensor<3> {
    let along = |count: usize, centre: f64| -> Vec<f64> {
        let square = |cell| ((cell_centre(cell, stride) - centre) / sigma).powi(2);
        (0..count).map(|cell| (-0.5 * square(cell)).exp()).collect()
    };
    let mut values = Vec::with_capacity(centres.len() * height * width);
    for &[x, y] in centres {
        let (columns, rows) = (along(width, x), along(height, y));
        values.extend(rows.iter().flat_map(|row| columns.iter().map(move |column| (row * column) as f32)));
    }
    Tensor::from_data(TensorData::new(values, [centres.len(), height, width]), device)
}
