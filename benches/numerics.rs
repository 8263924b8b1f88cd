//! Whether processors compute the same: `cargo bench --bench numerics -- FOLDER NAME` writes what this one makes of the folder's pictures to
//! `NAME.safetensors`, and draws the pictures first where there are none; `… -- FOLDER` compares every such file with the first one.
//!
//! `scripts/numerics` runs it with each SIMD width; `node scripts/numerics.mjs` writes the same file with the wasm builds.

mod common;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use gravisight::internal::RandomScenes;
use gravisight::{Camera, Card, Device, LocaliseOptions, Localiser, Picture, Size};
use pollster::block_on;
use safetensors::tensor::{Dtype, SafeTensors, TensorView, serialize_to_file};

const COUNT: usize = 500;
const SIDE: u32 = 224;
/// Seed of the first picture: a training's seeds come from a hash.
const FIRST: u64 = 1 << 41;
/// m.
const BALL_RADIUS: f64 = 0.11;
/// The file of the pictures, [count, side, side, 3].
const PICTURES: &str = "pictures.safetensors";
/// Most that two may differ by: of the largest value of a map, and metres in a position.
const MOST: [f64; 2] = [1e-4, 1e-4];

fn camera() -> Camera {
    let text = include_str!("common/numerics.camera.json");
    Camera::from_json(text, "camera").unwrap()
}

fn bytes(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

fn floats(view: &TensorView) -> Vec<f32> {
    view.data().chunks_exact(4).map(|four| f32::from_le_bytes(four.try_into().unwrap())).collect()
}

fn draw(folder: &Path, count: usize) {
    let scenes = RandomScenes::new(vec![], 0.1);
    let values: Vec<u8> = (0..count as u64)
        .flat_map(|index| scenes.draw(Size::square(SIDE), FIRST + index, 1).picture().into_raw())
        .collect();
    let shape = vec![count, SIDE as usize, SIDE as usize, 3];
    let view = TensorView::new(Dtype::U8, shape, &values).unwrap();
    serialize_to_file([("pictures", view)], None, &folder.join(PICTURES)).unwrap();
}

/// Maps and positions of every picture, in one file.
fn write(folder: &Path, name: &str) {
    let (card, weights) = Card::with_weights(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/models/any.json"))).unwrap();
    let localiser = Localiser::new(card, weights, &Device::flex()).unwrap();
    let camera = camera();
    let file = std::fs::read(folder.join(PICTURES)).unwrap();
    let pictures = SafeTensors::deserialize(&file).unwrap();
    let pictures = pictures.tensor("pictures").unwrap();
    let (mut heatmaps, mut depths, mut worlds) = (vec![], vec![], vec![]);
    let mut cells = 0;
    for values in pictures.data().chunks_exact((SIDE * SIDE * 3) as usize) {
        let rgba: Vec<u8> = values.chunks_exact(3).flat_map(|rgb| [rgb[0], rgb[1], rgb[2], 255]).collect();
        let picture = Picture::from_rgba(&rgba, Size::square(SIDE)).unwrap();
        let options = LocaliseOptions { ball_radius: Some(BALL_RADIUS), maps: true, ..LocaliseOptions::default() };
        let found = block_on(localiser.localise(&picture, &camera, options)).unwrap();
        let maps = found.maps.unwrap();
        cells = maps.heatmap.len();
        heatmaps.extend(maps.heatmap);
        depths.extend(maps.depth);
        worlds.extend(found.world.map(|value| value as f32));
    }
    let count = worlds.len() / 3;
    let all = [("heatmap", bytes(&heatmaps), cells), ("depth", bytes(&depths), cells), ("world", bytes(&worlds), 3)];
    let views = all.iter().map(|(name, values, width)| {
        (*name, TensorView::new(Dtype::F32, vec![count, *width], values).unwrap())
    });
    serialize_to_file(views, None, &folder.join(format!("{name}.safetensors"))).unwrap();
}

/// Largest difference of two files: of a map in its largest value, of positions in metres, and the pictures in which one is too large.
fn difference(first: &[u8], other: &[u8]) -> ([f64; 3], usize) {
    let [first, other] = [first, other].map(|file| SafeTensors::deserialize(file).unwrap());
    let mut largest = [0.0_f64; 3];
    let mut apart: Vec<usize> = vec![];
    for (index, name) in ["heatmap", "depth", "world"].into_iter().enumerate() {
        let [a, b] = [&first, &other].map(|file| file.tensor(name).unwrap());
        assert_eq!(a.shape(), b.shape(), "{name}");
        let width = a.shape()[1];
        let [a, b] = [floats(&a), floats(&b)];
        for (picture, (a, b)) in a.chunks(width).zip(b.chunks(width)).enumerate() {
            let scale = if name == "world" { 1.0 } else { a.iter().fold(0.0_f32, |most, value| most.max(value.abs())) };
            let off = a.iter().zip(b).fold(0.0_f32, |most, (a, b)| most.max((a - b).abs())) / scale;
            largest[index] = largest[index].max(f64::from(off));
            if f64::from(off) > MOST[usize::from(name == "world")] {
                apart.push(picture);
            }
        }
    }
    apart.sort_unstable();
    apart.dedup();
    (largest, apart.len())
}

/// Whether all files agree with the first.
fn compare(folder: &Path) -> bool {
    let files: BTreeMap<String, PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|end| end == "safetensors") && !path.ends_with(PICTURES))
        .map(|path| (path.file_stem().unwrap().to_string_lossy().into_owned(), path))
        .collect();
    let mut files = files.into_iter();
    let Some((first, path)) = files.next() else {
        println!("{}: no results to compare", folder.display());
        return false;
    };
    let reference = std::fs::read(path).unwrap();
    let mut agree = true;
    for (name, path) in files {
        let ([heatmap, depth, world], apart) = difference(&reference, &std::fs::read(path).unwrap());
        agree &= apart == 0;
        println!("{name} and {first}: heatmap {heatmap:.1e} of its largest value, depth map {depth:.1e}, position {:.4} mm; {apart} pictures beyond the limits", 1000.0 * world);
    }
    agree
}

fn main() {
    let arguments = match common::is_check() {
        true => vec![common::scratch("numerics").to_string_lossy().into_owned(), "first".into()],
        false => common::arguments(),
    };
    let count = if common::is_check() { 2 } else { COUNT };
    let [folder, rest @ ..] = arguments.as_slice() else {
        return println!("usage: cargo bench --bench numerics -- FOLDER [NAME]");
    };
    let folder = Path::new(folder);
    std::fs::create_dir_all(folder).unwrap();
    let agree = match rest {
        [] => compare(folder),
        [name, ..] => {
            if !folder.join(PICTURES).exists() {
                draw(folder, count);
            }
            write(folder, name);
            true
        }
    };
    if common::is_check() {
        write(folder, "second");
        assert!(compare(folder));
        std::fs::remove_dir_all(folder).unwrap();
    }
    if !agree {
        std::process::exit(1);
    }
}
