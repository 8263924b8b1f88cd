//! Whether processors compute the same: `cargo bench --bench all -- numerics FOLDER NAME` writes what this one makes of the folder's pictures to
//! `NAME.safetensors`, and draws the pictures first where there are none; `… -- FOLDER` compares every such file with the first one.
//!
//! `scripts/numerics` runs it with each SIMD width; `node scripts/numerics.mjs` writes the same file with the wasm builds.

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
/// Most that maps may differ by, of their largest value.
const MAP: f32 = 1e-4;
/// Positions that differ by less are the same, m. Others come of a crop whose corner rounds to the next pixel: by less than this of their σ.
const SAME: f64 = 1e-4;
const SIGMAS: f64 = 0.5;

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
    let (card, weights) =
        Card::with_weights(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/models/any.json"))).unwrap();
    let localiser = Localiser::new(card, weights, &Device::flex()).unwrap();
    let camera = camera();
    let file = std::fs::read(folder.join(PICTURES)).unwrap();
    let pictures = SafeTensors::deserialize(&file).unwrap();
    let pictures = pictures.tensor("pictures").unwrap();
    let (mut heatmaps, mut depths, mut worlds, mut sigmas) = (vec![], vec![], vec![], vec![]);
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
        sigmas.push(found.depth_sigma.unwrap() as f32);
    }
    let count = worlds.len() / 3;
    let all = [
        ("heatmap", bytes(&heatmaps), cells),
        ("depth", bytes(&depths), cells),
        ("world", bytes(&worlds), 3),
        ("sigma", bytes(&sigmas), 1),
    ];
    let views = all
        .iter()
        .map(|(name, values, width)| (*name, TensorView::new(Dtype::F32, vec![count, *width], values).unwrap()));
    serialize_to_file(views, None, &folder.join(format!("{name}.safetensors"))).unwrap();
}

/// How two files differ.
#[derive(Default)]
struct Difference {
    /// Largest one of the maps, of their largest values.
    maps: [f32; 2],
    /// Largest one of positions that are closer than [`SAME`], m; and of the others, in their σ.
    same: f64,
    sigmas: f64,
    /// How many positions are farther apart than [`SAME`].
    apart: usize,
}

impl Difference {
    fn of(first: &[u8], other: &[u8]) -> Self {
        let [first, other] = [first, other].map(|file| SafeTensors::deserialize(file).unwrap());
        let both = |name: &str| [&first, &other].map(|file| floats(&file.tensor(name).unwrap()));
        let mut found = Self::default();
        for (index, name) in ["heatmap", "depth"].into_iter().enumerate() {
            let cells = first.tensor(name).unwrap().shape()[1];
            let [a, b] = both(name);
            assert_eq!(a.len(), b.len(), "{name}");
            for (a, b) in a.chunks(cells).zip(b.chunks(cells)) {
                let largest = a.iter().fold(0.0_f32, |most, value| most.max(value.abs()));
                let off = a.iter().zip(b).fold(0.0_f32, |most, (a, b)| most.max((a - b).abs()));
                found.maps[index] = found.maps[index].max(off / largest);
            }
        }
        let ([a, b], [sigma, _]) = (both("world"), both("sigma"));
        for ((a, b), sigma) in a.chunks(3).zip(b.chunks(3)).zip(sigma) {
            let off = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt();
            if off <= SAME {
                found.same = found.same.max(off);
            } else {
                found.apart += 1;
                found.sigmas = found.sigmas.max(off / f64::from(sigma));
            }
        }
        found
    }

    fn is_small(&self) -> bool {
        self.maps.iter().all(|&off| off <= MAP) && self.sigmas <= SIGMAS
    }
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
        let difference = Difference::of(&reference, &std::fs::read(path).unwrap());
        agree &= difference.is_small();
        let Difference { maps: [heatmap, depth], same, sigmas, apart } = difference;
        println!(
            "{name} and {first}: heatmap to {heatmap:.1e} of its largest value, depth map to {depth:.1e}; positions to {:.3} mm, but {apart}, which \
             are up to {sigmas:.2} sigma apart",
            1000.0 * same
        );
    }
    agree
}

pub fn run(arguments: &[String]) {
    let arguments = match crate::common::is_check() {
        true => vec![crate::common::scratch("numerics").to_string_lossy().into_owned(), "first".into()],
        false => arguments.to_vec(),
    };
    let count = if crate::common::is_check() { 2 } else { COUNT };
    let [folder, rest @ ..] = arguments.as_slice() else {
        return println!("usage: cargo bench --bench all -- numerics FOLDER [NAME]");
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
    if crate::common::is_check() {
        write(folder, "second");
        assert!(compare(folder));
        std::fs::remove_dir_all(folder).unwrap();
    }
    if !agree {
        std::process::exit(1);
    }
}
