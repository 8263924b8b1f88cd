//! A build for the CPU alone leaves the layers of other devices out.

use burn::nn::BatchNorm;
use burn::tensor::Tensor;

use super::layers::Unit;

pub(super) fn convolve(_: &Tensor<4>, _: &Unit<'_>, _: Option<Tensor<1>>) -> Tensor<4> {
    unreachable!("this build has no device but the CPU")
}

pub(super) fn normalise(_: Tensor<4>, _: &BatchNorm) -> Tensor<4> {
    unreachable!("this build has no device but the CPU")
}

pub(super) fn upsample(_: Tensor<4>, _: usize) -> Tensor<4> {
    unreachable!("this build has no device but the CPU")
}
