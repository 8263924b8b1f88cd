//! One optimiser step.

use burn::optim::GradientsParams;
use burn::tensor::{Device, Tensor, TensorData};

use super::super::examples::Batch;
use super::super::recipe::HeatmapLoss;
use super::flat::Gradients;
use super::future::future;
use super::knowledge::Knowledge;
use super::loss::{map_losses, near_labels};
use super::optimiser::AdamW;
use crate::model::{Pen, decode};
use gravisight_geometry::error::{Error, Result};

/// What a step optimises, and how.
#[derive(Debug, Clone, Copy)]
pub struct StepOptions {
    /// Heatmap loss.
    pub heatmap_loss: HeatmapLoss,
    /// Weight of the depth loss.
    pub depth_weight: f64,
    /// Weight of the decoded position's distance from the label, px.
    pub centre_weight: f64,
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
/// an autodiff device. A loss that is not finite leaves the weights alone; look at the report. `knowledge` is what
/// forecasts need besides, where they teach.
///
/// # Errors
/// [`Error::Device`] for a device that cannot be read.
pub async fn step(
    pen: Pen,
    optimiser: &mut AdamW,
    batch: Batch,
    options: &StepOptions,
    knowledge: &mut Knowledge,
    device: &Device,
) -> Result<(Pen, StepReport)> {
    let [height, width] = batch.size;
    let shape = [batch.count(), height, width, batch.channels];
    let pictures = Tensor::from_data(TensorData::new(batch.pictures, shape), device);
    let output = pen.forward(pictures);
    let config = pen.config().clone();
    let future = match batch.windows.is_empty() {
        true => None,
        false => {
            let decoded = decode(near_labels(output.clone(), &batch.labels, &config), &config);
            Some(future(&decoded, &batch.windows, options, knowledge).await?)
        }
    };
    let (transition, with_centre) = (options.depth_transition, options.centre_weight > 0.0);
    let losses = map_losses(output, &batch.labels, &config, options.heatmap_loss, transition, with_centre);
    let mut loss = losses.heatmap.clone() + losses.depth.clone().mul_scalar(options.depth_weight);
    if let Some(centre) = losses.centre {
        loss = loss + centre.mul_scalar(options.centre_weight);
    }
    if let Some(future) = &future {
        loss = loss + future.clone().mul_scalar(options.future_weight);
    }
    let gradients = GradientsParams::from_grads(loss.backward(), &pen);
    // One read-back a step: a GPU waits for each.
    let mut numbers = vec![loss.inner(), losses.heatmap.inner(), losses.depth.inner()];
    let (mut moved, mut ahead) = (pen.clone(), optimiser.clone());
    if let Some(Gradients { layout, values }) = Gradients::of(&pen, gradients) {
        let square = values.clone().square().sum();
        // Nothing waits for the norm.
        let factor = square.clone().sqrt().recip().mul_scalar(options.clip_norm).clamp_max(1.0);
        let gradients = Gradients { layout, values: values * factor };
        moved = ahead.step_by(options.learning_rate, moved, gradients);
        numbers.push(square);
    }
    numbers.extend(future.map(Tensor::inner));
    let numbers = read(Tensor::cat(numbers, 0)).await?;
    let report = StepReport {
        loss: if numbers[3].is_finite() { numbers[0] } else { f64::NAN },
        heatmap: numbers[1],
        depth: numbers[2],
        future: numbers.get(4).copied().unwrap_or(0.0),
        gradient_norm: numbers[3].sqrt(),
    };
    if !report.loss.is_finite() {
        return Ok((pen, report));
    }
    *optimiser = ahead;
    Ok((moved, report))
}

/// A tensor's numbers. In a browser a GPU can be read only so: asynchronously.
///
/// # Errors
/// [`Error::Device`].
pub(super) async fn read<const D: usize>(tensor: Tensor<D>) -> Result<Vec<f64>> {
    let device = format!("{:?}", tensor.device());
    let data = tensor.into_data_async().await;
    let data = data.map_err(|error| Error::Device { device, reason: error.to_string() })?;
    Ok(data.iter::<f64>().collect())
}
