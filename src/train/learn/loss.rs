//! Losses on the network's maps.

use burn::tensor::{Device, Int, Tensor, TensorData, activation::log_softmax};

use super::super::examples::Labels;
use super::super::recipe::HeatmapLoss;
use crate::model::{CONFIDENCE_RADIUS, cell_centre, decode, weighted_depth};
use crate::model::{PenConfig, PenOutput};

/// Added to a logit whose cell is not to count: its fraction is zero.
const OUTSIDE: f32 = -1e4;

/// The parts of the loss on the maps, each a scalar tensor `[1]`.
#[derive(Debug, Clone)]
pub struct Losses {
    /// Heatmap loss.
    pub heatmap: Tensor<1>,
    /// Depth loss, unweighted.
    pub depth: Tensor<1>,
    /// Mean distance of the decoded position from the label along each axis, px; where it is asked for.
    pub centre: Option<Tensor<1>>,
}

/// Heatmap loss against 2D labels, and smooth-L1 depth loss (square below `transition` m) against depths; of a network that
/// reads sizes the negative log-likelihood of log(radius) under its Laplace distribution.
///
/// Depth is read out with the *target* heatmap's weights, so that it is taught where the ball is
/// from the first step on. A picture without the ball is to give the same everywhere; one with several balls, the same
/// fraction to each.
pub fn map_losses(
    output: PenOutput,
    labels: &Labels,
    config: &PenConfig,
    loss: HeatmapLoss,
    transition: f64,
    with_centre: bool,
) -> Losses {
    let device = output.heatmap.device();
    let pictures = output.heatmap.dims()[0];
    // Of each label its fraction of its picture.
    let mut counts = vec![0.0; pictures];
    labels.picture.iter().for_each(|&picture| counts[picture] += 1.0);
    let fractions: Vec<f64> = labels.picture.iter().map(|&picture| 1.0 / counts[picture]).collect();
    let output = if labels.picture.len() == pictures { output } else { of_labels(output, &labels.picture) };
    let [batch, height, width] = output.heatmap.dims();
    let column = |values: &[f64]| {
        let values: Vec<f32> = values.iter().map(|&value| value as f32).collect();
        Tensor::<1>::from_data(TensorData::new(values, [batch]), &device)
    };
    let centre = with_centre.then(|| centre_loss(output.clone(), labels, config));
    let target = gaussians(&labels.image, [height, width], config.output_stride(), loss, &device);
    // [batch, 1, 1]; a Gaussian around a label near the picture never sums to zero, and nothing is divided by 0
    let mass = target.clone().reshape([batch, height * width]).sum_dim(1).reshape([batch, 1, 1]);
    let fraction = target.clone() / mass.clamp_min(f32::MIN_POSITIVE);
    let heatmap = match loss {
        HeatmapLoss::CrossEntropy { .. } => {
            let logits = output.heatmap.mul_scalar(config.heatmap.beta).reshape([batch, height * width]);
            let log_probability = log_softmax(logits, 1).reshape([batch, height, width]);
            let of_label = weighted_depth(log_probability, fraction.clone());
            (of_label * column(&fractions)).sum().neg().div_scalar(pictures as f64)
        }
        HeatmapLoss::Mse { amplitude, .. } => (output.heatmap - target.mul_scalar(amplitude)).powi_scalar(2).mean(),
    };
    let error = match output.log_scale {
        Some(log_scale) => {
            let log_radii: Vec<f64> = labels.depth.iter().map(|radius| radius.ln()).collect();
            let log_scale = weighted_depth(log_scale, fraction.clone());
            let error = weighted_depth(output.depth.log(), fraction) - column(&log_radii);
            error.abs() * log_scale.clone().neg().exp() + log_scale
        }
        None => smooth_l1(weighted_depth(output.depth, fraction) - column(&labels.depth), transition),
    };
    let depth = (error * column(&labels.depth_weight)).mean();
    Losses { heatmap, depth, centre }
}

/// The maps of each label's picture.
fn of_labels(output: PenOutput, pictures: &[usize]) -> PenOutput {
    let indices: Vec<i32> = pictures.iter().map(|&picture| picture as i32).collect();
    let indices = Tensor::<1, Int>::from_data(TensorData::new(indices, [pictures.len()]), &output.heatmap.device());
    let maps = |map: Tensor<3>| map.select(0, indices.clone());
    PenOutput { heatmap: maps(output.heatmap), depth: maps(output.depth), log_scale: output.log_scale.map(maps) }
}

/// How far the decoded positions are from the labels along each axis, px: the mean over the balls. Of a network that reads
/// sizes as [`peaks`](crate::model::peaks) decodes: by what is near the label.
fn centre_loss(output: PenOutput, labels: &Labels, config: &PenConfig) -> Tensor<1> {
    let batch = labels.image.len();
    let device = output.heatmap.device();
    let output = near_labels(output, labels, config);
    let values: Vec<f32> =
        labels.image.iter().flat_map(|label| label.unwrap_or_default().map(|at| at as f32)).collect();
    let there: Vec<f32> = labels.image.iter().flat_map(|label| [f32::from(u8::from(label.is_some())); 2]).collect();
    let count = there.iter().sum::<f32>().max(1.0);
    let [values, there] =
        [values, there].map(|values| Tensor::<2>::from_data(TensorData::new(values, [batch, 2]), &device));
    ((decode(output, config).image - values).abs() * there).sum().div_scalar(count)
}

/// The maps of which only what is near the labels (one a picture) is decoded, where the network reads sizes: elsewhere there may
/// be other balls.
pub fn near_labels(mut output: PenOutput, labels: &Labels, config: &PenConfig) -> PenOutput {
    if config.depth.is_size() {
        let [batch, height, width] = output.heatmap.dims();
        let stride = config.output_stride();
        let far = |cell: usize, [x, y]: [f64; 2]| {
            let [dx, dy] = [cell_centre(cell % width, stride) - x, cell_centre(cell / width, stride) - y];
            dx.hypot(dy) > CONFIDENCE_RADIUS
        };
        let of_label = |label: &Option<[f64; 2]>| -> Vec<f32> {
            let outside = |cell| label.is_some_and(|label| far(cell, label));
            (0..height * width).map(|cell| if outside(cell) { OUTSIDE } else { 0.0 }).collect()
        };
        let mask: Vec<f32> = labels.image.iter().flat_map(of_label).collect();
        let mask = Tensor::from_data(TensorData::new(mask, [batch, height, width]), &output.heatmap.device());
        output.heatmap = output.heatmap + mask;
    }
    output
}

/// `e²/(2t)` below the transition `t`, `|e| − t/2` above.
fn smooth_l1(error: Tensor<1>, transition: f64) -> Tensor<1> {
    let size = error.abs();
    let inside = size.clone().clamp_max(transition);
    // ½·inside²/t + (size − inside): both branches at once, differentiable everywhere
    inside.clone().powi_scalar(2).div_scalar(2.0 * transition) + (size - inside)
}

/// Gaussians of height 1 around `centres` (input px): `[batch, height, width]` cells of `stride` px. Without a ball:
/// the same everywhere, 1 as a distribution, 0 as a heatmap that is to be met.
fn gaussians(
    centres: &[Option<[f64; 2]>],
    [height, width]: [usize; 2],
    stride: usize,
    loss: HeatmapLoss,
    device: &Device,
) -> Tensor<3> {
    let along = |count: usize, centre: f64| -> Vec<f64> {
        let square = |cell| ((cell_centre(cell, stride) - centre) / loss.sigma()).powi(2);
        (0..count).map(|cell| (-0.5 * square(cell)).exp()).collect()
    };
    let empty = if matches!(loss, HeatmapLoss::CrossEntropy { .. }) { 1.0 } else { 0.0 };
    let mut values = Vec::with_capacity(centres.len() * height * width);
    for centre in centres {
        let Some([x, y]) = *centre else {
            values.extend(std::iter::repeat_n(empty, height * width));
            continue;
        };
        let (columns, rows) = (along(width, x), along(height, y));
        values.extend(rows.iter().flat_map(|row| columns.iter().map(move |column| (row * column) as f32)));
    }
    Tensor::from_data(TensorData::new(values, [centres.len(), height, width]), device)
}
