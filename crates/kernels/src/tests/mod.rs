//! The kernels beside Burn's own operations on flex, natively and in a wasm engine (`scripts/test-wasm`).

#[cfg(not(target_arch = "wasm32"))]
mod random;

use burn::tensor::module::conv2d;
use burn::tensor::ops::ConvOptions;
use burn::tensor::{Device, Tensor, TensorData};
#[cfg(target_arch = "wasm32")]
use wasm_bindgen_test::wasm_bindgen_test;

use super::{ConvShape, Extent, Forward, Map, NormInput, UnitShape, Vectors, Wanted, unit_backward, unit_forward};

/// Largest difference allowed, as a share of the largest value expected.
const TOLERANCE: f32 = 1e-4;

/// Reproducible numbers in [-1, 1).
fn values(seed: u64, count: usize) -> Vec<f32> {
    (0..count as u64)
        .map(|index| {
            let mut z = (seed ^ 0x5bf0_3635).wrapping_add((index + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((z ^ (z >> 31)) >> 40) as f32 / (1 << 23) as f32 - 1.0
        })
        .collect()
}

fn tensor<const D: usize>(values: &[f32], shape: [usize; D], device: &Device) -> Tensor<D> {
    Tensor::from_data(TensorData::new(values.to_vec(), shape), device)
}

fn read<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().iter::<f32>().collect()
}

/// Refuses values further apart than [`TOLERANCE`] of the largest expected, or of `least` if that is
/// more (where sums of such terms cancel).
fn close(found: &[f32], expected: &[f32], least: f32, what: &str) -> Result<(), String> {
    if found.len() != expected.len() {
        return Err(format!("{what}: {} values instead of {}", found.len(), expected.len()));
    }
    let largest = expected.iter().fold(least, |largest, value| largest.max(value.abs()));
    for (index, (found, expected)) in found.iter().zip(expected).enumerate() {
        let off = (found - expected).abs() / largest;
        if off > TOLERANCE || off.is_nan() {
            return Err(format!("{what}[{index}]: {found} is not {expected} ({off:e} off)"));
        }
    }
    Ok(())
}

/// A convolution and the map it takes.
#[derive(Debug, Clone)]
struct Case {
    shape: ConvShape,
    input: Extent,
    slope: f32,
    seed: u64,
}

/// Burn's own result and gradients for a unit: output, then gradients of x, weights, shift, scale, skip.
/// Takes gradients away from outputs so near zero that rounding decides on which side.
fn reference(case: &Case, data: &mut Data, with_norm: bool) -> [Vec<f32>; 6] {
    let device = Device::flex().autodiff();
    let Case { shape, input, slope, .. } = case;
    let output = shape.output(*input);
    let dims = |extent: &Extent| [extent.batch, extent.height, extent.width, extent.channels];
    let x = tensor(&data.x, dims(input), &device).require_grad();
    let weights = tensor(&data.weights, shape.weights(), &device).require_grad();
    let shift = tensor(&data.shift, [shape.channels[1]], &device).require_grad();
    let scale = tensor(&data.scale, [shape.channels[1]], &device).require_grad();
    let skip = tensor(&data.skip, dims(&output), &device).require_grad();
    let groups = if shape.depthwise { shape.channels[0] } else { 1 };
    let options = ConvOptions::new([shape.stride; 2], [shape.padding; 2], [1, 1], groups);
    let nchw = x.clone().permute([0, 3, 1, 2]);
    let bias = (!with_norm).then(|| shift.clone());
    let y = conv2d(nchw, weights.clone(), bias, options).permute([0, 2, 3, 1]);
    let y = if with_norm {
        let mean = y.clone().mean_dims(&[0, 1, 2]);
        let centred = y - mean;
        let variance = centred.clone().powi_scalar(2).mean_dims(&[0, 1, 2]);
        let wide = |tensor: Tensor<1>| tensor.reshape([1, 1, 1, -1]);
        centred / (variance + 1e-5).sqrt() * wide(scale.clone()) + wide(shift.clone())
    } else {
        y
    };
    let y = if shape.depthwise { y } else { y + skip.clone() };
    let before = read(y.clone());
    let z = y.clone().clamp_min(0.0) + y.clamp_max(0.0).mul_scalar(*slope);
    let near = 1e-3 * before.iter().fold(0.0_f32, |largest, value| largest.max(value.abs()));
    data.dz.iter_mut().zip(&before).filter(|(_, value)| value.abs() <= near).for_each(|(dz, _)| *dz = 0.0);
    let dz = tensor(&data.dz, dims(&output), &device);
    let gradients = (z.clone() * dz).sum().backward();
    let of = |gradient: Option<Vec<f32>>| gradient.unwrap_or_default();
    [
        read(z),
        of(x.grad(&gradients).map(read)),
        of(weights.grad(&gradients).map(read)),
        of(shift.grad(&gradients).map(read)),
        of(scale.grad(&gradients).map(read)),
        of(skip.grad(&gradients).map(read)),
    ]
}

struct Data {
    x: Vec<f32>,
    weights: Vec<f32>,
    shift: Vec<f32>,
    scale: Vec<f32>,
    skip: Vec<f32>,
    dz: Vec<f32>,
}

impl Data {
    /// Random data for a case.
    pub fn new(case: &Case) -> Self {
        let output = case.shape.output(case.input).len();
        let channels = case.shape.channels[1];
        let weights: usize = case.shape.weights().iter().product();
        Self {
            x: values(case.seed, case.input.len()),
            weights: values(case.seed ^ 1, weights),
            shift: values(case.seed ^ 2, channels),
            scale: values(case.seed ^ 3, channels).iter().map(|scale| 1.5 + scale).collect(),
            skip: values(case.seed ^ 4, output),
            dz: values(case.seed ^ 5, output),
        }
    }
}

fn check(case: &Case, with_norm: bool) -> Result<(), String> {
    let mut data = Data::new(case);
    let [z, dx, dw, dshift, dscale, dskip] = reference(case, &mut data, with_norm);
    let unit = UnitShape { conv: case.shape, slope: case.slope };
    let output = case.shape.output(case.input);
    for vectors in Vectors::all() {
        let x = Map::new(case.input, &data.x);
        let skip = (!case.shape.depthwise).then(|| Map::new(output, &data.skip));
        let norm = with_norm.then_some(NormInput { scale: &data.scale, epsilon: 1e-5 });
        let (found, saved) = unit_forward(vectors, &unit, &data.weights, &data.shift, norm, x, skip);
        close(&found, &z, 1e-3, "output")?;
        // A norm takes mean and slope out of its gradient: what is left of few taps or channels may be
        // rounding, of sums as large as they would be without.
        let [least_x, least_weights] = if with_norm {
            let steepest = data.scale.iter().zip(&saved.variance).map(|(scale, variance)| scale / variance.sqrt());
            let steepest = steepest.fold(1.0, f32::max);
            [steepest, steepest * (output.len() as f32 / output.channels as f32).sqrt()]
        } else {
            [0.1; 2]
        };
        let wanted = Wanted { x: true, skip: skip.is_some() };
        let forward = Forward { shape: &unit, weights: &data.weights, norm, saved: &saved, x, z: &found };
        let gradients = unit_backward(vectors, forward, &data.dz, wanted);
        close(&gradients.x.unwrap_or_default(), &dx, least_x, "gradient of x")?;
        close(&gradients.weights, &dw, least_weights, "gradient of the weights")?;
        close(&gradients.shift, &dshift, 0.1, "gradient of the shift")?;
        close(&gradients.scale, &dscale, 1.0, "gradient of the scale")?;
        close(&gradients.skip.unwrap_or_default(), &dskip, 0.1, "gradient of the skip")?;
    }
    Ok(())
}

/// One of many shapes: odd sides, every padding, stride 2, one channel, batch 1 and 8, depthwise.
fn any_case(seed: u64) -> Case {
    let mut numbers = values(seed, 16).into_iter().map(|value| 0.5 * value + 0.5);
    let mut pick = |count: usize| (numbers.next().unwrap() * count as f32) as usize % count;
    let depthwise = pick(4) == 0;
    let kernel = if depthwise { [3, 5, 7][pick(3)] } else { [1, 3, 5, 7][pick(4)] };
    let channels = [[1, 3, 8, 17, 24, 32, 40][pick(7)], [1, 3, 8, 17, 24, 32, 40][pick(7)]];
    let shape = ConvShape {
        channels: if depthwise { [channels[0]; 2] } else { channels },
        kernel,
        stride: if depthwise { 1 } else { 1 + pick(2) },
        padding: if depthwise { kernel / 2 } else { pick(kernel) },
        depthwise,
    };
    let side = kernel.saturating_sub(2 * shape.padding).max(1);
    let input = Extent::new([[1, 2, 8][pick(3)], side + pick(20), side + pick(20), shape.channels[0]]);
    Case { shape, input, slope: [1.0, 0.0, 0.01][pick(3)], seed }
}

#[cfg_attr(not(target_arch = "wasm32"), test)]
#[cfg_attr(target_arch = "wasm32", wasm_bindgen_test)]
fn layers_and_their_gradients_are_flexs() {
    for seed in 0..200 {
        let case = any_case(seed);
        let output = case.shape.output(case.input);
        // One value a channel has no variance, and its gradient is only rounding.
        let with_norm = seed % 2 == 0 && output.len() >= 8 * output.channels;
        check(&case, with_norm).unwrap_or_else(|wrong| panic!("seed {seed}, {case:?}: {wrong}"));
    }
}
