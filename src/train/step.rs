//! One optimiser step.

use burn::module::{Module, ModuleVisitor, Param};
use burn::optim::{GradientsParams, ModuleOptimizer};
use burn::tensor::{Device, Tensor, TensorData};

use super::future::{Window, future};
use super::loss::{HeatmapLoss, Labels, map_losses};
use crate::model::{Pen, decode};

/// Pictures with their labels.
#[derive(Debug, Clone)]
pub struct Batch {
    /// Normalised pictures, `[batch, height, width, 3]`, row-major.
    pub pictures: Vec<f32>,
    /// Height and width of the pictures, px.
    pub size: [usize; 2],
    /// Their labels.
    pub labels: Labels,
    /// Windows among them, where forecasts teach.
    pub windows: Vec<Window>,
}

/// What a step optimises, and how.
#[derive(Debug, Clone, Copy)]
pub struct StepOptions {
    /// Heatmap loss.
    pub heatmap_loss: HeatmapLoss,
    /// Weight of the depth loss.
    pub depth_weight: f64,
    /// Weight of the future loss.
    pub future_weight: f64,
    /// Error beyond which the future loss grows only logarithmically, px.
    pub robust_px: Option<f64>,
    /// Depth error at which the depth loss turns linear, m.
    pub depth_transition: f64,
    /// Global gradient norm above which gradients are scaled down.
    pub clip_norm: f64,
    /// Learning rate.
    pub learning_rate: f64,
}

/// What a step found.
#[derive(Debug, Clone, Copy)]
pub struct StepReport {
    /// Total loss.
    pub loss: f64,
    /// Its heatmap part.
    pub heatmap: f64,
    /// Its depth part, unweighted.
    pub depth: f64,
    /// Its future part, unweighted, px; zero without windows.
    pub future: f64,
    /// Global gradient norm before clipping.
    pub gradient_norm: f64,
}

/// Forward, backward, clip, update: the new network and what was found. `pen` must be on `device`,
/// an autodiff device. A loss that is not finite leaves the weights alone; look at the report.
pub fn step(
    pen: Pen,
    optimiser: &mut ModuleOptimizer,
    batch: Batch,
    options: &StepOptions,
    device: &Device,
) -> (Pen, StepReport) {
    let [height, width] = batch.size;
    let shape = [batch.labels.depth.len(), height, width, 3];
    let pictures = Tensor::from_data(TensorData::new(batch.pictures, shape), device);
    let output = pen.forward(pictures);
    let config = pen.config().clone();
    let future = (!batch.windows.is_empty())
        .then(|| future(&decode(output.clone(), &config), &batch.windows, options.robust_px));
    let losses = map_losses(output, &batch.labels, &config, options.heatmap_loss, options.depth_transition);
    let mut loss = losses.heatmap.clone() + losses.depth.clone().mul_scalar(options.depth_weight);
    if let Some(future) = &future {
        loss = loss + future.clone().mul_scalar(options.future_weight);
    }
    let scalar = |tensor: Tensor<1>| f64::from(tensor.into_scalar::<f32>());
    let mut report = StepReport {
        loss: scalar(loss.clone()),
        heatmap: scalar(losses.heatmap),
        depth: scalar(losses.depth),
        future: future.map_or(0.0, scalar),
        gradient_norm: f64::NAN,
    };
    if !report.loss.is_finite() {
        return (pen, report);
    }
    let mut gradients = GradientsParams::from_grads(loss.backward(), &pen);
    report.gradient_norm = clip_global_norm(&pen, &mut gradients, options.clip_norm);
    if !report.gradient_norm.is_finite() {
        report.loss = f64::NAN;
        return (pen, report);
    }
    (optimiser.step(options.learning_rate, pen, gradients), report)
}

/// Scales all `gradients` of `pen` so that their joint norm is at most `limit`; the norm before.
fn clip_global_norm(pen: &Pen, gradients: &mut GradientsParams, limit: f64) -> f64 {
    let mut squares = SumOfSquares { gradients, sum: None };
    pen.visit(&mut squares);
    let norm = squares.sum.map_or(0.0, |sum| f64::from(sum.into_scalar::<f32>())).sqrt();
    if norm > limit {
        pen.visit(&mut Scale { gradients, factor: limit / norm });
    }
    norm
}

struct SumOfSquares<'a> {
    gradients: &'a GradientsParams,
    sum: Option<Tensor<1>>,
}

impl ModuleVisitor for SumOfSquares<'_> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        if let Some(gradient) = self.gradients.get::<D>(param.id) {
            let square = gradient.powi_scalar(2).sum();
            self.sum = Some(match self.sum.take() {
                Some(sum) => sum + square,
                None => square,
            });
        }
    }
}

struct Scale<'a> {
    gradients: &'a mut GradientsParams,
    factor: f64,
}

impl ModuleVisitor for Scale<'_> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        if let Some(gradient) = self.gradients.remove::<D>(param.id) {
            self.gradients.register(param.id, gradient.mul_scalar(self.factor));
        }
    }
}
