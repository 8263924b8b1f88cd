//! What the tests of training share.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

use gravisight::data::synth::{Engine as _, Shot, Split, Studio};
use gravisight::data::{Clip, Clips};
use nalgebra::Point3;

use super::scratch;

/// Held by each test that makes networks: Burn has one random generator for all threads.
pub fn alone() -> MutexGuard<'static, ()> {
    static ONE: Mutex<()> = Mutex::new(());
    ONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A clips folder of `count` clips of 90 frames by the built-in engine, seen by camera `camera`, each changed; only the first
/// `drawn` frames of each have pictures.
pub fn seen_by(camera: usize, name: &str, count: usize, drawn: usize, change: impl Fn(&mut Clip)) -> PathBuf {
    let folder = scratch(name).join("clips");
    std::fs::create_dir_all(&folder).unwrap();
    let studio = Studio::new(Shot { environment: Some(1), camera }).unwrap();
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
