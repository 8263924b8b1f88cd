//! Where physics meets autodiff: the future loss of the paper, through the forecaster.
//!
//! All of it is computed in f64 outside the tensor graph, with its gradient g by the network's positions u, and enters
//! the graph as `value + ⟨g, u − detach(u)⟩`: the same on every device, and no tape of solver steps.

use burn::tensor::{Tensor, TensorData};
use nalgebra::{Matrix3, Point2, Point3, Vector2, Vector3};

use super::super::examples::{Start, Target, Window};
use super::knowledge::{Knowledge, OwnTrack};
use super::launch::{Launch, image_of, point, seen};
use super::step::{StepOptions, read};
use crate::model::Decoded;
use gravisight_geometry::error::Result;
use gravisight_physics::State;

/// The future loss and its gradient.
#[derive(Debug, Clone, PartialEq)]
pub struct FutureLoss {
    /// Mean over windows, times and axes, px; against true positions m.
    pub value: f64,
    /// By each picture's position (x and y in px of the drawn picture; depth in m, or apparent radius in px of it).
    pub gradient: Vec<[f64; 3]>,
    /// By the logarithm of each law that is learned.
    pub by_law: Vec<f64>,
    /// Windows whose forecast was whole; the others count as zero.
    pub whole: usize,
}

/// Step of the central differences by laws, which no forecast's Jacobian has: of a logarithm.
const LAW_STEP: f64 = 1e-4;

/// The future loss of `windows` as a scalar `[1]` of the graph of `decoded`. What was found in the pictures of windows that
/// start from one is added to `knowledge`, whose laws make their step.
///
/// # Errors
/// [`Error::Device`](gravisight_geometry::error::Error::Device) for a device that cannot be read.
pub async fn future(
    decoded: &Decoded,
    windows: &[Window],
    options: &StepOptions,
    knowledge: &mut Knowledge,
) -> Result<Tensor<1>> {
    let [batch, _] = decoded.image.dims();
    let device = decoded.image.device();
    let positions = Tensor::cat(vec![decoded.image.clone(), decoded.depth.clone().reshape([batch, 1])], 1);
    let still = positions.clone().detach();
    let numbers = read(still.clone()).await?;
    let read: Vec<[f64; 3]> = numbers.chunks_exact(3).map(|three| [three[0], three[1], three[2]]).collect();
    let loss = future_loss(&read, windows, options.robust_px, knowledge);
    knowledge.laws.advance(&loss.by_law, options.learning_rate);
    for window in windows {
        if let Start::Track { transform, frame, .. } = &window.start {
            let found = image_of(window, transform, read[window.first]);
            knowledge.own.extend(found.map(|image| (*frame, image.into())));
        }
    }
    let gradient: Vec<f32> = loss.gradient.iter().flatten().map(|&slope| slope as f32).collect();
    let gradient = Tensor::<2>::from_data(TensorData::new(gradient, [batch, 3]), &device);
    Ok(((positions - still) * gradient).sum().add_scalar(loss.value))
}

/// The future loss at `positions` (x and y in px of the drawn picture; depth in m, or apparent radius in px of it), one a picture
/// of the batch: L1
/// between forecast and target; with `robust_px`, s·ln(1 + e/s). A window whose forecast fails counts as zero.
pub fn future_loss(
    positions: &[[f64; 3]],
    windows: &[Window],
    robust_px: Option<f64>,
    knowledge: &Knowledge,
) -> FutureLoss {
    let Knowledge { own, laws } = knowledge;
    let gradient = vec![[0.0; 3]; positions.len()];
    let mut loss = FutureLoss { value: 0.0, gradient, by_law: vec![0.0; laws.count()], whole: 0 };
    let terms: usize = windows.iter().flat_map(|window| &window.ahead).map(|(_, target)| axes(target)).sum();
    for window in windows {
        let under = laws.window(window);
        let found = under.and_then(|under| window_loss(positions, &under, robust_px, own));
        let Ok(Some(WindowLoss { value, slopes, errors })) = found else { continue };
        loss.whole += 1;
        loss.value += value / terms as f64;
        for (picture, slope) in slopes {
            for (sum, part) in loss.gradient[picture].iter_mut().zip(slope.iter()) {
                *sum += part / terms as f64;
            }
        }
        for (law, sum) in loss.by_law.iter_mut().enumerate() {
            let at = |by: f64| images(positions, &laws.nudged(law, by).window(window)?, own);
            let (Ok(Some(less)), Ok(Some(more))) = (at(-LAW_STEP), at(LAW_STEP)) else { continue };
            for ((less, more), error) in less.iter().zip(&more).zip(&errors) {
                let Some(error) = error else { continue };
                *sum += error.dot(&(more - less)) / (2.0 * LAW_STEP * terms as f64);
            }
        }
    }
    loss
}

/// Where a window's forecast lies in the picture at each time, px; none where it stops early.
fn images(positions: &[[f64; 3]], window: &Window, own: &OwnTrack) -> Result<Option<Vec<Point2<f64>>>> {
    let Some(launch) = Launch::of(window, positions, own)? else { return Ok(None) };
    let forecast = window.forecaster.forecast(&launch.state(window), &window.times());
    if forecast.states.len() != window.ahead.len() {
        return Ok(None);
    }
    let image = |state: &State| window.camera.image_from_world(&state.position);
    forecast.states.iter().map(image).collect::<Result<_>>().map(Some)
}

/// A window's loss.
struct WindowLoss {
    /// Sum over its times and axes, px; against true positions m.
    value: f64,
    /// Its gradient by each picture that it starts from.
    slopes: Vec<(usize, Vector3<f64>)>,
    /// Its gradient by where the forecast lies at each time; none where nothing is to be met.
    errors: Vec<Option<Vector2<f64>>>,
}

/// Sum over a window's times and axes, and its gradient by the pictures that it starts from; none where the forecast stops
/// early, or there is nothing to start from.
fn window_loss(
    positions: &[[f64; 3]],
    window: &Window,
    robust_px: Option<f64>,
    own: &OwnTrack,
) -> Result<Option<WindowLoss>> {
    if window.ahead.iter().any(|(_, target)| matches!(target, Target::True { .. })) {
        return true_loss(positions, window).map(Some);
    }
    let Some(launch) = Launch::of(window, positions, own)? else { return Ok(None) };
    let forecast = window.forecaster.forecast_with_jacobians(&launch.state(window), &window.times());
    if !forecast.status.is_exact() || forecast.states.len() != window.ahead.len() {
        return Ok(None);
    }
    let (mut value, mut errors) = (0.0, Vec::new());
    let (mut by_position, mut by_velocity) = (Vector3::zeros(), Vector3::zeros());
    for ((state, jacobian), (_, target)) in forecast.states.iter().zip(&forecast.jacobians).zip(&window.ahead) {
        let Some(target) = seen(window, *target, positions, own) else {
            errors.push(None);
            continue;
        };
        let (image, projection) = window.camera.image_from_world_with_jacobian(&state.position)?;
        let by_start = projection * jacobian.fixed_view::<3, 6>(0, 0);
        let weight = launch.weight * launch.trust(&by_start);
        let mut slope = Vector2::zeros();
        for axis in 0..2 {
            let error = image[axis] - target[axis];
            let (part, derivative) = penalty(error.abs(), robust_px);
            value += weight * part;
            slope[axis] = weight * derivative * error.signum();
        }
        errors.push(Some(slope));
        let by_state = projection.transpose() * slope;
        by_position += jacobian.fixed_view::<3, 3>(0, 0).transpose() * by_state;
        by_velocity += jacobian.fixed_view::<3, 3>(0, 3).transpose() * by_state;
    }
    let slope = |(picture, of_position, of_velocity): &(usize, Matrix3<f64>, Matrix3<f64>)| {
        (*picture, of_position.transpose() * by_position + of_velocity.transpose() * by_velocity)
    };
    let slopes: Vec<(usize, Vector3<f64>)> = launch.slopes.iter().map(slope).collect();
    let finite = value.is_finite() && slopes.iter().all(|(_, slope)| slope.iter().all(|part| part.is_finite()));
    Ok(finite.then_some(WindowLoss { value, slopes, errors }))
}

/// Axes along which `target` is met.
fn axes(target: &Target) -> usize {
    if matches!(target, Target::True { .. }) { 3 } else { 2 }
}

/// The sum over a window's true positions of how far the network's own are from them along each axis of the camera, m, and its
/// gradient. Paper, the 3D-gt of "Analysis of future loss".
fn true_loss(positions: &[[f64; 3]], window: &Window) -> Result<WindowLoss> {
    let mut loss = WindowLoss { value: 0.0, slopes: vec![], errors: vec![] };
    for (_, target) in &window.ahead {
        let Target::True { picture, transform, position } = target else { continue };
        let (world, slope) = point(window, transform, positions[*picture])?;
        let error = window.camera.camera_from_world(&world) - Point3::from(*position);
        loss.value += error.iter().map(|part| part.abs()).sum::<f64>();
        let by_world = window.camera.rotation().transpose() * error.map(f64::signum);
        loss.slopes.push((*picture, slope.transpose() * by_world));
        loss.errors.push(None);
    }
    Ok(loss)
}

/// What an error of `size` px costs, and its derivative.
fn penalty(size: f64, robust_px: Option<f64>) -> (f64, f64) {
    match robust_px {
        None => (size, 1.0),
        Some(scale) => (scale * (size / scale).ln_1p(), 1.0 / (1.0 + size / scale)),
    }
}
