//! What the tests of several packages share and what stands on none of them.
#![allow(missing_docs, clippy::unwrap_used)]

use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use safetensors::tensor::TensorView;

/// The bytes of tests/golden/`name`.
pub fn golden(name: &str) -> Vec<u8> {
    let path = root().join("tests/golden").join(name);
    std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The project's folder, from that of any of its packages.
pub fn root() -> PathBuf {
    // As cargo says it to what it runs: what was compiled in another checkout with the same target folder is not compiled again.
    let package = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_else(|_| env!("CARGO_MANIFEST_DIR").into());
    Path::new(&package).ancestors().find(|folder| folder.join("tests/golden").is_dir()).unwrap().to_path_buf()
}

/// A fresh folder for a test's files.
pub fn scratch(name: &str) -> PathBuf {
    let program = std::env::current_exe().unwrap();
    let target = program.ancestors().nth(3).unwrap();
    let folder = target.join("tmp").join(program.file_stem().unwrap()).join(name);
    if folder.exists() {
        std::fs::remove_dir_all(&folder).unwrap();
    }
    std::fs::create_dir_all(&folder).unwrap();
    folder
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

/// Held by each test that makes networks: Burn has one random generator for all threads.
pub fn alone() -> MutexGuard<'static, ()> {
    static ONE: Mutex<()> = Mutex::new(());
    ONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A copy of a folder and of all that is in it.
pub fn copy_tree(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap().map(|entry| entry.unwrap().path()) {
        let name = entry.file_name().unwrap();
        match entry.is_dir() {
            true => copy_tree(&entry, &to.join(name)),
            false => drop(std::fs::copy(&entry, to.join(name)).unwrap()),
        }
    }
}

/// A PNG whose header says that it is of this size.
pub fn claiming_size(mut png: Vec<u8>, width: u32, height: u32) -> Vec<u8> {
    png[16..20].copy_from_slice(&width.to_be_bytes());
    png[20..24].copy_from_slice(&height.to_be_bytes());
    let sum = png[12..29].iter().fold(u32::MAX, |sum, &byte| {
        (0..8).fold(sum ^ u32::from(byte), |sum, _| if sum & 1 == 1 { sum >> 1 ^ 0xedb8_8320 } else { sum >> 1 })
    });
    png[29..33].copy_from_slice(&(!sum).to_be_bytes());
    png
}
