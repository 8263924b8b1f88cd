//! Where physics meets autodiff.

use burn::tensor::{Tensor, TensorData};
use nalgebra::{Point3, Vector3};

use crate::error::{Error, Result};
use crate::physics::{Forecaster, State, Status};

/// Forecasts of a batch, part of the tensor graph.
#[derive(Debug, Clone)]
pub struct Forecasts {
    /// Positions and velocities, m and m/s: `[batch, times, 6]`. Zero, without gradient, where `valid` is 0.
    pub states: Tensor<3>,
    /// 1 for a whole forecast, 0 for one that stopped early or went back through what cannot be undone: `[batch]`.
    pub valid: Tensor<1>,
    /// How each ended.
    pub statuses: Vec<Status>,
}

/// The states at `times` (s, negative: before) of balls that start at `starts`, `[batch, 6]` (position and
/// velocity in the world, m and m/s), with gradients that are exact to first order.
///
/// The forecast is computed in f64 outside the graph, with its Jacobian J, and enters it as
/// `forecast + J·(starts − detach(starts))`: the same on every device, and no tape of solver steps.
///
/// # Errors
/// [`Error::Data`] for starts of another shape, [`Error::Device`] where they cannot be read back.
pub async fn forecast(starts: Tensor<2>, forecaster: &Forecaster, times: &[f64]) -> Result<Forecasts> {
    let [batch, components] = starts.dims();
    if components != 6 {
        let reason = format!("must have the shape [batch, 6], not [{batch}, {components}]");
        return Err(Error::Data { what: "starts of a forecast".into(), reason });
    }
    let device = starts.device();
    let still = starts.clone().detach();
    let failed = |reason: String| Error::Device { device: format!("{device:?}"), reason };
    let data = still.clone().into_data_async().await.map_err(|error| failed(format!("{error:?}")))?;
    let numbers: Vec<f64> = data.iter::<f64>().collect();
    let state = |n: &[f64]| State { position: Point3::new(n[0], n[1], n[2]), velocity: Vector3::new(n[3], n[4], n[5]) };
    let states: Vec<State> = numbers.chunks_exact(6).map(state).collect();
    let count = times.len();
    let mut values = Vec::with_capacity(batch * count * 6);
    let mut slopes = Vec::with_capacity(batch * count * 36);
    let mut valid = Vec::with_capacity(batch);
    let mut statuses = Vec::with_capacity(batch);
    for forecast in forecaster.forecast_batch(&states, times) {
        let whole = forecast.status.is_exact();
        valid.push(if whole { 1.0_f32 } else { 0.0 });
        statuses.push(forecast.status);
        if !whole {
            values.extend(std::iter::repeat_n(0.0_f32, count * 6));
            slopes.extend(std::iter::repeat_n(0.0_f32, count * 36));
            continue;
        }
        for (state, jacobian) in forecast.states.iter().zip(&forecast.jacobians) {
            values.extend(state.position.iter().chain(state.velocity.iter()).map(|&value| value as f32));
            slopes
                .extend(jacobian.row_iter().flat_map(|row| row.iter().map(|&slope| slope as f32).collect::<Vec<_>>()));
        }
    }
    let values = Tensor::<3>::from_data(TensorData::new(values, [batch, count, 6]), &device);
    let jacobians = Tensor::<3>::from_data(TensorData::new(slopes, [batch, count * 6, 6]), &device);
    let valid = Tensor::<1>::from_data(TensorData::new(valid, [batch]), &device);
    // a start that is not finite differs from itself by NaN, which no zero Jacobian takes away
    let stopped = valid.clone().equal_elem(0.0).reshape([batch, 1]).expand([batch, 6]);
    let moved = (starts - still).mask_fill(stopped, 0.0).reshape([batch, 6, 1]);
    let states = values + jacobians.matmul(moved).reshape([batch, count, 6]);
    Ok(Forecasts { states, valid, statuses })
}
