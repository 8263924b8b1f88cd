//! Where physics meets autodiff: the future loss of the paper, through the forecaster.
//!
//! All of it is computed in f64 outside the tensor graph, with its gradient g by the network's positions u, and enters
//! the graph as `value + ⟨g, u − detach(u)⟩`: the same on every device, and no tape of solver steps.

use burn::tensor::{Tensor, TensorData};
use nalgebra::{Matrix3, Point2, Vector2, Vector3};

use super::super::examples::{Target, Window};
use super::step::read;
use crate::error::Result;
use crate::model::Decoded;

/// The future loss and its gradient.
#[derive(Debug, Clone, PartialEq)]
pub struct FutureLoss {
    /// Mean over windows, times and axes, px.
    pub value: f64,
    /// By each picture's position (x and y in px of the drawn picture, depth in m).
    pub gradient: Vec<[f64; 3]>,
    /// Windows whose forecast was whole; the others count as zero.
    pub whole: usize,
}

/// The future loss of `windows` as a scalar `[1]` of the graph of `decoded`.
///
/// # Errors
/// [`Error::Device`](crate::error::Error::Device) for a device that cannot be read.
pub async fn future(decoded: &Decoded, windows: &[Window], robust_px: Option<f64>) -> Result<Tensor<1>> {
    let [batch, _] = decoded.image.dims();
    let device = decoded.image.device();
    let positions = Tensor::cat(vec![decoded.image.clone(), decoded.depth.clone().reshape([batch, 1])], 1);
    let still = positions.clone().detach();
    let numbers = read(still.clone()).await?;
    let read: Vec<[f64; 3]> = numbers.chunks_exact(3).map(|three| [three[0], three[1], three[2]]).collect();
    let loss = future_loss(&read, windows, robust_px);
    let gradient: Vec<f32> = loss.gradient.iter().flatten().map(|&slope| slope as f32).collect();
    let gradient = Tensor::<2>::from_data(TensorData::new(gradient, [batch, 3]), &device);
    Ok(((positions - still) * gradient).sum().add_scalar(loss.value))
}

/// The future loss at `positions` (x and y in px of the drawn picture, depth in m), one a picture of the batch: L1
/// between forecast and target; with `robust_px`, s·ln(1 + e/s). A window whose forecast fails counts as zero.
pub fn future_loss(positions: &[[f64; 3]], windows: &[Window], robust_px: Option<f64>) -> FutureLoss {
    let mut loss = FutureLoss { value: 0.0, gradient: vec![[0.0; 3]; positions.len()], whole: 0 };
    let terms: usize = windows.iter().map(|window| 2 * window.ahead.len()).sum();
    for window in windows {
        let Ok(Some((value, slopes))) = window_loss(positions, window, robust_px) else { continue };
        loss.whole += 1;
        loss.value += value / terms as f64;
        for (gradient, slope) in loss.gradient[window.first..].iter_mut().zip(slopes) {
            for (sum, part) in gradient.iter_mut().zip(slope.iter()) {
                *sum += part / terms as f64;
            }
        }
    }
    loss
}

/// Sum over a window's times and axes, and its gradient by the three positions; none where the forecast stops early.
fn window_loss(
    positions: &[[f64; 3]],
    window: &Window,
    robust_px: Option<f64>,
) -> Result<Option<(f64, [Vector3<f64>; 3])>> {
    let mut points = [Vector3::zeros(); 3];
    let mut jacobians = [Matrix3::zeros(); 3];
    for index in 0..3 {
        let [x, y, depth] = positions[window.first + index];
        let place = &window.places[index];
        let image = Point2::from(place.in_clip([x, y]));
        let (point, by_clip) = window.camera.world_from_image_with_jacobian(&image, depth * place.zoom)?;
        let mut by_drawn = Matrix3::from_diagonal_element(place.zoom);
        by_drawn.fixed_view_mut::<2, 2>(0, 0).copy_from(&place.linear);
        (points[index], jacobians[index]) = (point.coords, by_clip * by_drawn);
    }
    // The slope at the middle of the parabola through three points: exact in free flight.
    let (before, after) = (window.times[1] - window.times[0], window.times[2] - window.times[1]);
    let shares = [
        -after / (before * (before + after)),
        (after - before) / (before * after),
        before / (after * (before + after)),
    ];
    let velocity: Vector3<f64> = points.iter().zip(shares).map(|(point, share)| point * share).sum();
    let start = window.forecaster.scene().in_flight(points[1].into(), velocity, window.since_start);
    let times: Vec<f64> = window.ahead.iter().map(|(time, _)| *time).collect();
    let forecast = window.forecaster.forecast_with_jacobians(&start, &times);
    if !forecast.status.is_exact() || forecast.states.len() != times.len() {
        return Ok(None);
    }
    let mut value = 0.0;
    let (mut by_position, mut by_velocity) = (Vector3::zeros(), Vector3::zeros());
    for ((state, jacobian), (_, target)) in forecast.states.iter().zip(&forecast.jacobians).zip(&window.ahead) {
        let (image, projection) = window.camera.image_from_world_with_jacobian(&state.position)?;
        let target = match *target {
            Target::Label(label) => label,
            Target::Predicted { picture, place } => place.in_clip([positions[picture][0], positions[picture][1]]),
        };
        let mut slope = Vector2::zeros();
        for axis in 0..2 {
            let error = image[axis] - target[axis];
            let (part, derivative) = penalty(error.abs(), robust_px);
            value += part;
            slope[axis] = derivative * error.signum();
        }
        let by_state = projection.transpose() * slope;
        by_position += jacobian.fixed_view::<3, 3>(0, 0).transpose() * by_state;
        by_velocity += jacobian.fixed_view::<3, 3>(0, 3).transpose() * by_state;
    }
    if !value.is_finite() {
        return Ok(None);
    }
    let slopes = [0, 1, 2].map(|index| {
        let middle = if index == 1 { by_position } else { Vector3::zeros() };
        jacobians[index].transpose() * (middle + by_velocity * shares[index])
    });
    Ok(Some((value, slopes)))
}

/// What an error of `size` px costs, and its derivative.
fn penalty(size: f64, robust_px: Option<f64>) -> (f64, f64) {
    match robust_px {
        None => (size, 1.0),
        Some(scale) => (scale * (size / scale).ln_1p(), 1.0 / (1.0 + size / scale)),
    }
}
