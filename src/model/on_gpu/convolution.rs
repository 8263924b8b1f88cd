//! Convolutions as products of matrices.
//!
//! Without its tuning, which browsers do not allow and which has nothing better for f32, Burn computes each output pixel by itself, and a
//! gradient by weights as a convolution with a kernel of the map's size. Here the pixels under the taps are gathered, a part of the map at
//! a time, and Burn's product of matrices does the rest.

use std::ops::Range;

use burn::backend::ops::FloatTensorOps as _;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, backend_extension};
use burn::tensor::{DType, Shape};
use burn_cubecl::kernel::into_contiguous;
use burn_cubecl::kernel::matmul::{MatmulStrategy, matmul};
use burn_cubecl::ops::numeric::{add, empty_device_contiguous_dtype};
use burn_cubecl::ops::{permute, reshape};
use burn_cubecl::tensor::CubeTensor;
use burn_cubecl::{Cube, CubeBackend};

use super::gather::{Taps, gather};

/// Most bytes that gathered pixels take: what WebGPU binds everywhere.
const GATHERED: usize = 128 << 20;
/// Rows at which a part may begin: 256 bytes of any output, where buffers may be bound.
const ROWS: usize = 64;
/// Fewest rows of each of the sums that a gradient by weights is split into.
const SUMMED: usize = 256;
/// Most such sums.
const SUMS: usize = 64;

/// The fixed part of a square convolution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Convolution {
    /// Side of the kernel.
    pub kernel: usize,
    /// Step between output positions, input pixels.
    pub stride: usize,
    /// Zeros around the input.
    pub padding: usize,
}

impl Convolution {
    /// Output pixels along `count` input pixels.
    fn output(&self, count: usize) -> usize {
        (count + 2 * self.padding - self.kernel) / self.stride + 1
    }

    /// Shape of what `weights` (`[output, input, kernel, kernel]`) make of `x`.
    fn output_shape(&self, x: &Shape, weights: &Shape) -> Shape {
        Shape::new([x[0], self.output(x[1]), self.output(x[2]), weights[0]])
    }

    fn taps(&self, transposed: bool) -> Taps {
        Taps { kernel: self.kernel, stride: self.stride, padding: self.padding, transposed }
    }
}

/// A convolution's gradients. Maps are `[batch, height, width, channels]`, weights `[output, input, kernel, kernel]`.
#[backend_extension(Cube, Fusion: cfg(feature = "fusion"))]
pub trait ConvolutionGradients: Backend {
    /// By the input, which is `size` = `[height, width]`.
    #[fusion(dtype = output, shape = Shape::new([output[0], size[0], size[1], weights[1]]))]
    fn by_input(
        output: FloatTensor<Self>,
        weights: FloatTensor<Self>,
        convolution: Convolution,
        size: [usize; 2],
    ) -> FloatTensor<Self>;

    /// By the weights.
    #[fusion(dtype = x, shape = Shape::new([output[3], x[3], convolution.kernel, convolution.kernel]))]
    fn by_weights(x: FloatTensor<Self>, output: FloatTensor<Self>, convolution: Convolution) -> FloatTensor<Self>;
}

/// A convolution without bias.
#[backend_extension(Cube, Autodiff, Fusion: cfg(feature = "fusion"))]
pub trait ConvolutionOps: Backend {
    /// `x` is `[batch, height, width, channels]`, `weights` `[output, input, kernel, kernel]`.
    #[fusion(dtype = x, shape = convolution.output_shape(x, weights))]
    fn convolve(x: FloatTensor<Self>, weights: FloatTensor<Self>, convolution: Convolution) -> FloatTensor<Self>;
}

fn dims<const D: usize>(tensor: &CubeTensor) -> [usize; D] {
    std::array::from_fn(|axis| tensor.meta.shape()[axis])
}

/// `left · right`, where it is to be written if that is given.
fn product(left: CubeTensor, right: CubeTensor, out: Option<CubeTensor>) -> CubeTensor {
    matmul(left, right, out, MatmulStrategy::default(), DType::F32)
        .unwrap_or_else(|error| panic!("Burn's product of matrices does not take f32: {error:?}"))
}

/// Rows `rows` of a matrix `[all, columns]`, which lies whole in memory: the same memory.
fn view(matrix: &CubeTensor, rows: &Range<usize>) -> CubeTensor {
    let [_, columns] = dims(matrix);
    let mut view = matrix.clone();
    view.handle = view.handle.offset_start((rows.start * columns * size_of::<f32>()) as u64);
    view.meta.shape_mut()[0] = rows.len();
    view
}

/// Parts of `rows` rows of `columns` numbers that are gathered at a time.
fn parts(rows: usize, columns: usize) -> impl Iterator<Item = Range<usize>> {
    let part = (GATHERED / (columns * size_of::<f32>()) / ROWS * ROWS).max(ROWS);
    (0..rows).step_by(part).map(move |first| first..(first + part).min(rows))
}

/// `[pixels of a map of `size`, output]`: the pixels of `x` under the taps times `weights` `[taps·channels, output]`.
fn by_parts(x: CubeTensor, taps: Taps, size: [usize; 2], weights: CubeTensor) -> CubeTensor {
    let [batch, _, _, channels] = dims(&x);
    let [columns, output] = dims(&weights);
    let rows = batch * size[0] * size[1];
    if taps.are_pixels() {
        return product(reshape(into_contiguous(x), Shape::new([rows, channels])), weights, None);
    }
    let parts: Vec<Range<usize>> = parts(rows, columns).collect();
    if let [whole] = &parts[..] {
        return product(gather(x, taps, size, whole.clone()), weights, None);
    }
    let shape = Shape::new([rows, output]);
    let out = empty_device_contiguous_dtype(x.client.clone(), x.device.clone(), shape, x.dtype);
    for part in parts {
        product(gather(x.clone(), taps, size, part.clone()), weights.clone(), Some(view(&out, &part)));
    }
    out
}

impl ConvolutionOps for CubeBackend {
    fn convolve(x: CubeTensor, weights: CubeTensor, convolution: Convolution) -> CubeTensor {
        let shape = convolution.output_shape(&x.meta.shape, &weights.meta.shape);
        let [output, input, kernel, _] = dims(&weights);
        // [taps·input, output]
        let weights = into_contiguous(permute(weights, &[2, 3, 1, 0]));
        let weights = reshape(weights, Shape::new([kernel * kernel * input, output]));
        reshape(by_parts(x, convolution.taps(false), [shape[1], shape[2]], weights), shape)
    }
}

impl ConvolutionGradients for CubeBackend {
    fn by_input(output: CubeTensor, weights: CubeTensor, convolution: Convolution, size: [usize; 2]) -> CubeTensor {
        let [batch, ..] = dims::<4>(&output);
        let [channels, input, kernel, _] = dims(&weights);
        // [taps·output, input]
        let weights = into_contiguous(permute(weights, &[2, 3, 0, 1]));
        let weights = reshape(weights, Shape::new([kernel * kernel * channels, input]));
        let gradient = by_parts(output, convolution.taps(true), size, weights);
        reshape(gradient, Shape::new([batch, size[0], size[1], input]))
    }

    fn by_weights(x: CubeTensor, output: CubeTensor, convolution: Convolution) -> CubeTensor {
        let [batch, height, width, channels] = dims(&output);
        let [.., input] = dims::<4>(&x);
        let (kernel, rows) = (convolution.kernel, batch * height * width);
        let columns = kernel * kernel * input;
        let output = reshape(into_contiguous(output), Shape::new([rows, channels]));
        let taps = convolution.taps(false);
        let sum = parts(rows, columns).map(|part| {
            let pixels = match taps.are_pixels() {
                true => view(&reshape(into_contiguous(x.clone()), Shape::new([rows, input])), &part),
                false => gather(x.clone(), taps, [height, width], part.clone()),
            };
            transposed_product(pixels, view(&output, &part))
        });
        // There is always a pixel.
        let Some(sum) = sum.reduce(add) else { unreachable!("a map without pixels") };
        // [taps·input, output]
        permute(reshape(sum, Shape::new([kernel, kernel, input, channels])), &[3, 2, 0, 1])
    }
}

/// `leftᵀ · right` of matrices with many rows: in sums of fewer, which run side by side.
fn transposed_product(left: CubeTensor, right: CubeTensor) -> CubeTensor {
    let [rows, columns] = dims(&left);
    let [_, output] = dims(&right);
    let sums = (0..=SUMS.ilog2())
        .rev()
        .map(|power| 1 << power)
        .find(|sums| rows.is_multiple_of(*sums) && rows / sums >= SUMMED)
        .unwrap_or(1);
    let left = permute(reshape(left, Shape::new([sums, rows / sums, columns])), &[0, 2, 1]);
    let right = reshape(right, Shape::new([sums, rows / sums, output]));
    let products = product(left, right, None);
    let whole = |tensor| reshape(tensor, Shape::new([columns, output]));
    if sums == 1 {
        return whole(products);
    }
    whole(CubeBackend::float_sum_dim(products, 0))
}

mod backward {
    use burn::backend::Autodiff;
    use burn::backend::autodiff::checkpoint::base::Checkpointer;
    use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
    use burn::backend::autodiff::grads::Gradients;
    use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};

    use super::*;

    type Plain = FloatTensor<Cube>;
    type Tracked = FloatTensor<Autodiff<Cube>>;

    /// Gradients of the map and of the weights.
    #[derive(Debug)]
    struct ConvolutionBackward;

    impl Backward<Cube, 2> for ConvolutionBackward {
        type State = (Plain, Plain, Convolution, [usize; 2]);

        fn backward(self, ops: Ops<Self::State, 2>, grads: &mut Gradients, _: &mut Checkpointer) {
            let gradient = grads.consume::<Cube>(&ops.node);
            let (x, weights, convolution, size) = ops.state;
            let [of_x, of_weights] = ops.parents;
            if let Some(node) = of_x {
                grads.register::<Cube>(node.id, Cube::by_input(gradient.clone(), weights, convolution, size));
            }
            if let Some(node) = of_weights {
                grads.register::<Cube>(node.id, Cube::by_weights(x, gradient, convolution));
            }
        }
    }

    impl<C: CheckpointStrategy> ConvolutionOps for Autodiff<Cube, C> {
        fn convolve(x: Tracked, weights: Tracked, convolution: Convolution) -> Tracked {
            use burn::backend::TensorMetadata as _;
            let prepared = ConvolutionBackward.prepare::<C>([x.node(), weights.node()]).compute_bound().stateful();
            let (x, weights) = (x.into_primitive(), weights.into_primitive());
            let shape = x.shape();
            let size = [shape[1], shape[2]];
            let output = Cube::convolve(x.clone(), weights.clone(), convolution);
            match prepared {
                OpsKind::Tracked(prepared) => prepared.finish((x, weights, convolution, size), output),
                OpsKind::UnTracked(prepared) => prepared.finish(output),
            }
        }
    }
}
