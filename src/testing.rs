//! What the tests share: those beside the code, and those in `tests/` and `cli/`, which include this file.
//! What needs nothing of the library is in `crates/testing`.
#![allow(dead_code, missing_docs, clippy::unwrap_used)] // each uses its part

use std::path::PathBuf;

use gravisight::internal::{Engine as _, Random, Shot, Site, Split, Studio};
use gravisight::parts::Distortion;
use gravisight::{Camera, Card, Clip, Clips, Size};
pub use gravisight_testing::*;
use nalgebra::{Point3, Vector3};

/// The card of tests/golden/tiny.safetensors.
pub fn tiny_card() -> Card {
    Card::from_json(std::str::from_utf8(&golden("tiny.json")).unwrap(), "tiny.json").unwrap()
}

/// A camera that stands at `at` and looks at `to`, m; its focal length is in px.
pub fn looking(at: [f64; 3], to: [f64; 3], focal: f64, size: Size, distortion: Distortion) -> Camera {
    let (at, to) = (Vector3::from(at), Vector3::from(to));
    gravisight::internal::looking(at, (to - at).normalize(), focal, size, distortion).unwrap()
}

/// A standard normal number.
pub fn normal(random: &mut Random) -> f64 {
    gravisight::internal::normal_pair(random)[0]
}

/// The median of some values, the upper of two.
pub fn median(values: &[f64]) -> f64 {
    gravisight::internal::median(values.iter().copied()).unwrap()
}

/// A clips folder of `count` clips of 90 frames by the built-in engine, seen by camera `camera`, each changed; only the first
/// `drawn` frames of each have pictures.
pub fn seen_by(camera: usize, name: &str, count: usize, drawn: usize, change: impl Fn(&mut Clip)) -> PathBuf {
    let folder = scratch(name).join("clips");
    std::fs::create_dir_all(&folder).unwrap();
    let studio = Studio::new(Shot { site: Site::Environment(1), camera }).unwrap();
    let clips = (0..count).map(|number| {
        let mut engine = studio.builtin();
        let mut clip = studio.clip(&mut engine, 7, Split::Train, number).unwrap();
        for frame in clip.frames.iter().take(drawn) {
            let picture = engine.picture(&Point3::from(frame.world.unwrap())).unwrap();
            let file = folder.join(&frame.file);
            std::fs::create_dir_all(file.parent().unwrap()).unwrap();
            picture.save(file).unwrap();
        }
        change(&mut clip);
        clip
    });
    let clips = Clips { folder: folder.clone(), clips: clips.collect() };
    clips.write_index().unwrap();
    folder
}
