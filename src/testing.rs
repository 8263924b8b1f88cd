//! What the tests of several rooms share.

use std::path::{Path, PathBuf};

use safetensors::tensor::TensorView;

use crate::model::Card;

/// The bytes of tests/golden/`name`.
pub fn golden(name: &str) -> Vec<u8> {
    let path = root().join("tests/golden").join(name);
    std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The project's folder.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).to_path_buf()
}

/// The card of tests/golden/tiny.safetensors.
pub fn tiny_card() -> Card {
    Card::from_json(std::str::from_utf8(&golden("tiny.json")).unwrap(), "tiny.json").unwrap()
}

/// `count` numbers in [-1, 1) by name: `values` of tests/golden/pen.py.
pub fn formula(name: &str, count: usize) -> Vec<f64> {
    let state = name
        .bytes()
        .fold(0xcbf2_9ce4_8422_2325_u64, |state, byte| (state ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3));
    let number = |index: u64| {
        let mut z = state.wrapping_add((index + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        (z >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    };
    (0..count as u64).map(number).collect()
}

/// Weights by name and shape: `tensor` of tests/golden/pen.py.
pub fn formula_tensor(name: &str, shape: &[usize]) -> Vec<f32> {
    let small = if name.ends_with("last.weight") && shape[1] < 64 { 0.05 } else { 1.0 };
    let scale = |value: f64| match shape {
        [_, inputs, rows, columns] => value * (6.0 / (inputs * rows * columns) as f64).sqrt() * small,
        _ if name.ends_with("running_var") => 1.0 + 0.5 * value,
        _ if name.ends_with(".weight") => 1.0 + 0.2 * value,
        _ => 0.1 * value,
    };
    formula(name, shape.iter().product()).into_iter().map(|value| scale(value) as f32).collect()
}

/// A safetensors file of named f32 tensors.
pub fn safetensors_of(tensors: Vec<(String, Vec<usize>, Vec<f32>)>) -> Vec<u8> {
    let bytes: Vec<(String, Vec<usize>, Vec<u8>)> = tensors
        .into_iter()
        .map(|(name, shape, values)| (name, shape, values.iter().flat_map(|value| value.to_le_bytes()).collect()))
        .collect();
    let views = bytes.iter().map(|(name, shape, bytes)| {
        (name.clone(), TensorView::new(safetensors::Dtype::F32, shape.clone(), bytes).unwrap())
    });
    safetensors::serialize(views, None).unwrap()
}

/// The numbers of an f32 tensor in a file.
pub fn vector(view: &TensorView<'_>) -> Vec<f32> {
    view.data().chunks_exact(4).map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap())).collect()
}
