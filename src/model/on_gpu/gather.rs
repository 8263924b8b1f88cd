//! The pixels under a convolution's taps as the rows of a matrix, by a kernel of our own.

use burn_cubecl::cubecl::prelude::*;
use burn_cubecl::cubecl::{self, calculate_cube_count_elemwise};
use burn_cubecl::kernel::into_contiguous;
use burn_cubecl::ops::numeric::empty_device_contiguous_dtype;
use burn_cubecl::tensor::CubeTensor;

use std::ops::Range;

/// Channels that a thread copies at a time, where their number allows it.
const VECTOR: usize = 4;

/// Which pixels of a map lie under the taps of a square convolution.
#[derive(Debug, Clone, Copy)]
pub struct Taps {
    /// Side of the kernel.
    pub kernel: usize,
    /// Step between output positions, input pixels.
    pub stride: usize,
    /// Zeros around the input.
    pub padding: usize,
    /// From the output's pixels to the input's: whether the taps that read an input pixel are gathered, and not those that an output
    /// pixel reads.
    pub transposed: bool,
}

impl Taps {
    /// Whether a row is the pixel itself.
    pub fn are_pixels(&self) -> bool {
        self.kernel == 1 && self.stride == 1 && self.padding == 0
    }
}

#[cube(launch)]
fn gather_kernel<E: Numeric, N: Size>(
    input: &Tensor<Vector<E, N>>,
    output: &mut Tensor<Vector<E, N>>,
    height: u32,
    width: u32,
    vectors: u32,
    out_height: u32,
    out_width: u32,
    first: u32,
    count: u32,
    #[comptime] kernel: u32,
    #[comptime] stride: u32,
    #[comptime] padding: u32,
    #[comptime] transposed: bool,
    #[define(E)] _type: ElemType,
) {
    let at = ABSOLUTE_POS as u32;
    if at >= count {
        terminate!();
    }
    let vector = at % vectors;
    let tap = at / vectors % (kernel * kernel);
    let row = at / vectors / (kernel * kernel) + first;
    let x = (row % out_width) as i32;
    let y = (row / out_width % out_height) as i32;
    let picture = row / out_width / out_height;
    let (right, down) = ((tap % kernel) as i32, (tap / kernel) as i32);
    let (mut from_x, mut from_y) =
        (x * stride as i32 + right - padding as i32, y * stride as i32 + down - padding as i32);
    let mut is_tap = true;
    if transposed {
        let (back_x, back_y) = (x + padding as i32 - right, y + padding as i32 - down);
        is_tap = back_x % stride as i32 == 0 && back_y % stride as i32 == 0;
        // Towards zero: what is left of the map must stay so.
        (from_x, from_y) =
            (select(back_x < 0, -1, back_x / stride as i32), select(back_y < 0, -1, back_y / stride as i32));
    }
    let inside = is_tap && from_x >= 0 && from_y >= 0 && from_x < width as i32 && from_y < height as i32;
    let mut value = Vector::new(E::from_int(0));
    if inside {
        let pixel = (picture * height + from_y as u32) * width + from_x as u32;
        value = input[(pixel * vectors + vector) as usize];
    }
    output[at as usize] = value;
}

/// Rows `rows` of the matrix of the pixels of `x` (`[batch, height, width, channels]`) under `taps` of a map of `out_size`: one row a
/// pixel of that map, in it the channels of one tap after the other.
pub fn gather(x: CubeTensor, taps: Taps, out_size: [usize; 2], rows: Range<usize>) -> CubeTensor {
    let x = into_contiguous(x);
    let [height, width, channels] = [1, 2, 3].map(|axis| x.meta.shape()[axis]);
    let columns = taps.kernel * taps.kernel * channels;
    let shape = [rows.len(), columns].into();
    let output = empty_device_contiguous_dtype(x.client.clone(), x.device.clone(), shape, x.dtype);
    let vector = if channels.is_multiple_of(VECTOR) { VECTOR } else { 1 };
    let count = rows.len() * columns / vector;
    let client = x.client.clone();
    let cube = CubeDim::new(&client, count);
    gather_kernel::launch(
        &client,
        calculate_cube_count_elemwise(&client, count, cube),
        cube,
        vector,
        x.into_tensor_arg(),
        output.clone().into_tensor_arg(),
        height as u32,
        width as u32,
        (channels / vector) as u32,
        out_size[0] as u32,
        out_size[1] as u32,
        rows.start as u32,
        count as u32,
        taps.kernel as u32,
        taps.stride as u32,
        taps.padding as u32,
        taps.transposed,
        ElemType::Float(burn_cubecl::cubecl::ir::FloatKind::F32),
    );
    output
}
