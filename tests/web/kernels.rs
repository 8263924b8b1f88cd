//! What tests/web/kernels.test.js calls: the kernels beside flex's own operations, compiled to wasm.

use wasm_bindgen::prelude::wasm_bindgen;

use crate::kernels::{ConvShape, Extent};
use common::Case;

#[path = "../common/kernels.rs"]
mod common;

/// Checks `count` random layers, with and without a norm; empty, or what is wrong.
#[wasm_bindgen(js_name = checkKernels)]
pub fn check_kernels(first: u32, count: u32) -> String {
    for seed in first..first + count {
        let case = random(u64::from(seed));
        let output = case.shape.output(case.input);
        // One value a channel has no variance, and its gradient is only rounding.
        let with_norm = seed % 2 == 0 && output.len() >= 8 * output.channels;
        if let Err(wrong) = common::check(&case, with_norm) {
            return format!("seed {seed}, {case:?}: {wrong}");
        }
    }
    String::new()
}

/// One of many shapes: odd sides, every padding, stride 2, one channel, batch 1 and 8, depthwise.
fn random(seed: u64) -> Case {
    let mut numbers = common::values(seed, 16).into_iter().map(|value| 0.5 * value + 0.5);
    let mut pick = |count: usize| (numbers.next().unwrap_or(0.0) * count as f32) as usize % count;
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
