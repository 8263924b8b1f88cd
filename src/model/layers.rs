//! Layers that the backbones and heads share.

use burn::module::Module;
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::nn::{BatchNorm, BatchNormConfig, Initializer, PaddingConfig2d};
use burn::tensor::{Device, Tensor, TensorData, activation::relu};

/// Kaiming normal for ReLU, by fan-out: the initialisation ResNet was published with.
const KAIMING: Initializer = Initializer::KaimingNormal { gain: std::f64::consts::SQRT_2, fan_out_only: true };

/// A square convolution that keeps the size at stride 1.
pub(super) fn conv(channels: [usize; 2], kernel: usize, stride: usize) -> Conv2dConfig {
    let pad = kernel / 2;
    Conv2dConfig::new(channels, [kernel, kernel])
        .with_stride([stride, stride])
        .with_padding(PaddingConfig2d::Explicit(pad, pad, pad, pad))
        .with_initializer(KAIMING)
}

/// Convolution without bias, batch norm.
#[derive(Module, Debug)]
pub(super) struct ConvNorm {
    conv: Conv2d,
    norm: BatchNorm,
}

impl ConvNorm {
    pub(super) fn new(config: Conv2dConfig, device: &Device) -> Self {
        let norm = BatchNormConfig::new(config.channels[1]).init(device);
        Self { conv: config.with_bias(false).init(device), norm }
    }

    /// `[batch, channels_in, height, width]` -> `[batch, channels_out, height/stride, width/stride]`.
    pub(super) fn forward(&self, x: Tensor<4>) -> Tensor<4> {
        self.norm.forward(self.conv.forward(x))
    }
}

/// ResNet's basic block: two 3×3 convolutions and a skip, projected where the shape changes.
/// Fields are named as in timm, so that its weights load by name.
#[derive(Module, Debug)]
pub(super) struct BasicBlock {
    conv1: Conv2d,
    bn1: BatchNorm,
    conv2: Conv2d,
    bn2: BatchNorm,
    downsample: Option<(Conv2d, BatchNorm)>,
}

impl BasicBlock {
    pub(super) fn new([input, output]: [usize; 2], stride: usize, device: &Device) -> Self {
        let projects = stride != 1 || input != output;
        let bare = |config: Conv2dConfig| config.with_bias(false).init(device);
        let norm = || BatchNormConfig::new(output).init(device);
        Self {
            conv1: bare(conv([input, output], 3, stride)),
            bn1: norm(),
            conv2: bare(conv([output, output], 3, 1)),
            bn2: norm(),
            downsample: projects.then(|| (bare(conv([input, output], 1, stride)), norm())),
        }
    }

    /// `[batch, channels_in, height, width]` -> `[batch, channels_out, height/stride, width/stride]`.
    pub(super) fn forward(&self, x: Tensor<4>) -> Tensor<4> {
        let skip = match &self.downsample {
            Some((conv, norm)) => norm.forward(conv.forward(x.clone())),
            None => x.clone(),
        };
        let x = relu(self.bn1.forward(self.conv1.forward(x)));
        relu(self.bn2.forward(self.conv2.forward(x)) + skip)
    }
}

/// Bilinear upsampling by a whole `factor` (pixel centres, edges clamped; PyTorch's
/// `align_corners = false`): `[batch, channels, h, w]` -> `[batch, channels, h·factor, w·factor]`.
///
/// Two products with fixed matrices instead of Burn's `interpolate`, whose backward pass is
/// missing on the GPU backends of 0.22.
pub(super) fn upsample(x: Tensor<4>, factor: usize) -> Tensor<4> {
    let [batch, channels, height, width] = x.dims();
    let device = x.device();
    let x = x.reshape([batch * channels * height, width]); // [b·c·h, w]
    let x = x.matmul(interpolation(width, factor, &device)); // [b·c·h, W]
    let x = x.reshape([batch * channels, height, width * factor]); // [b·c, h, W]
    let rows = interpolation(height, factor, &device).transpose(); // [H, h]
    let x = rows.unsqueeze::<3>().expand([(batch * channels) as i64, -1, -1]).matmul(x); // [b·c, H, W]
    x.reshape([batch, channels, height * factor, width * factor])
}

/// Weights of bilinear interpolation from `count` cells to `count·factor`: `[count, count·factor]`.
fn interpolation(count: usize, factor: usize, device: &Device) -> Tensor<2> {
    let fine = count * factor;
    let mut weights = vec![0.0_f32; count * fine];
    for to in 0..fine {
        let from = ((to as f32 + 0.5) / factor as f32 - 0.5).max(0.0);
        let low = from as usize;
        let share = from - low as f32;
        weights[low * fine + to] += 1.0 - share;
        weights[(low + 1).min(count - 1) * fine + to] += share;
    }
    Tensor::from_data(TensorData::new(weights, [count, fine]), device)
}
