//! `gravisight synth --set broadcast` and `--set footage`.

use std::path::Path;

use anyhow::{Context, Result};
use gravisight::internal::{Film, Filmed, Kind, Moves, Recording, Split, write_whole};
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use serde_json::json;

use super::print_line;
use crate::video::Encoder;

/// x264's qualities that clips are compressed with, by turns: good phones', broadcasts', bad streams'.
const QUALITIES: [u8; 3] = [18, 23, 28];
/// Clips of a part of the set.
const PART: u64 = 1_000_000;

/// First line of a truth.
const COLUMNS: &str = "Frame,Visibility,X,Y,Time,Radius,WorldX,WorldY,WorldZ\n";

/// Films `count` clips of each kind into `out`: a video each, its camera and scene, and the truth.
pub fn run(out: &Path, split: Split, count: usize, seed: u64, as_json: bool) -> Result<()> {
    let clips = (0..count).flat_map(|number| Kind::ALL.into_iter().map(move |kind| (kind, number))).collect();
    let seed = seed_of(split, seed);
    all(out, clips, as_json, |(kind, number)| film(out, kind, number, seed.wrapping_add(number as u64)))
}

/// Films as many clips that are as hard as real footage, and for each number one that shows no ball.
pub fn run_footage(out: &Path, split: Split, count: usize, seed: u64, as_json: bool) -> Result<()> {
    let of_number = |number: usize| {
        let empty = (Kind::ALL[number % Kind::ALL.len()], true, number);
        Kind::ALL.into_iter().map(move |kind| (kind, false, number)).chain([empty])
    };
    let clips = (0..count).flat_map(of_number).collect();
    let seed = seed_of(split, seed);
    all(out, clips, as_json, |(kind, empty, number)| record(out, kind, empty, number, seed.wrapping_add(number as u64)))
}

/// The seed of a part of the set.
pub(super) fn seed_of(split: Split, seed: u64) -> u64 {
    seed.wrapping_add(match split {
        Split::Train => 0,
        Split::Val => PART,
        Split::Test => 2 * PART,
    })
}

/// Makes all `clips` with `make`, which returns the number of a clip's frames.
fn all<T: Send>(
    out: &Path,
    clips: Vec<T>,
    as_json: bool,
    make: impl Fn(T) -> Result<usize> + Sync + Send,
) -> Result<()> {
    std::fs::create_dir_all(out).with_context(|| out.display().to_string())?;
    let frames: Result<Vec<usize>> = clips.into_par_iter().map(make).collect();
    let frames = frames?;
    let (clips, frames) = (frames.len(), frames.iter().sum::<usize>());
    match as_json {
        true => print_line(json!({"clips": clips, "frames": frames}))?,
        false => print_line(format_args!("{clips} clips, {frames} frames in {}", out.display()))?,
    }
    Ok(())
}

/// Films a clip, unless it is there; the number of its frames.
fn film(out: &Path, kind: Kind, number: usize, seed: u64) -> Result<usize> {
    let file = |ending: &str| out.join(format!("{}-{number:03}.{ending}", kind.name()));
    let video = file("mp4");
    let film = Film::draw(kind, seed)?;
    if video.exists() {
        return Ok(film.count());
    }
    let mut encoder = Encoder::new(&video, film.camera.size(), film.fps, QUALITIES[number % QUALITIES.len()])?;
    let mut table = String::from(COLUMNS);
    for frame in 0..film.count() {
        let (picture, truth) = film.frame(frame)?;
        encoder.write(&picture)?;
        table += &line(frame, &truth);
    }
    write_whole(&file("camera.json"), serde_json::to_string(&film.camera)?.as_bytes())?;
    write_whole(&file("scene.json"), serde_json::to_string(&film.scene)?.as_bytes())?;
    write_whole(&file("truth.csv"), table.as_bytes())?;
    let contacts = json!({"hits": film.hits, "bounces": film.bounces});
    write_whole(&file("truth.json"), contacts.to_string().as_bytes())?;
    // The video comes last: where it is, all is.
    encoder.finish()?;
    Ok(film.count())
}

/// A frame's line of the truth.
fn line(frame: usize, truth: &Filmed) -> String {
    let Filmed { time, world: [x, y, z], image: [u, v], radius_px, visible } = truth;
    format!("{frame},{},{u:.3},{v:.3},{time:.6},{radius_px:.3},{x:.4},{y:.4},{z:.4}\n", u8::from(*visible))
}

/// Films a clip as hard as real footage, unless it is there; the number of its frames.
fn record(out: &Path, kind: Kind, empty: bool, number: usize, seed: u64) -> Result<usize> {
    let name = if empty { "empty" } else { kind.name() };
    let file = |ending: &str| out.join(format!("{name}-{number:03}.{ending}"));
    let video = file("mp4");
    let clip = Recording::draw(kind, empty, seed)?;
    let frames = 0..clip.count();
    if video.exists() {
        return Ok(frames.len());
    }
    let first = clip.camera(0)?;
    let mut encoder = Encoder::compressed(&video, first.size(), clip.fps, clip.compression)?;
    let mut table = String::from(COLUMNS);
    let mut shown = None;
    for frame in frames.clone() {
        // A repeated frame is given again, and compressed again.
        let (picture, truth) = match shown.take().filter(|_| clip.repeats(frame)) {
            Some(before) => before,
            None => clip.frame(frame)?,
        };
        encoder.write(&picture)?;
        table += &match &truth {
            Some(truth) => line(frame, truth),
            None => format!("{frame},0,0,0,{:.6},0,0,0,0\n", clip.time(frame)),
        };
        shown = Some((picture, truth));
    }
    write_whole(&file("camera.json"), serde_json::to_string(&first)?.as_bytes())?;
    if clip.moves != Moves::Still {
        let cameras: gravisight::Result<Vec<_>> = frames.clone().map(|frame| clip.camera(frame)).collect();
        write_whole(&file("cameras.json"), serde_json::to_string(&cameras?)?.as_bytes())?;
    }
    write_whole(&file("scene.json"), serde_json::to_string(&clip.scene)?.as_bytes())?;
    write_whole(&file("truth.csv"), table.as_bytes())?;
    let repeated: Vec<usize> = frames.clone().filter(|&frame| clip.repeats(frame)).collect();
    let truth = json!({
        "hits": clip.hits, "bounces": clip.bounces, "repeated": repeated, "moves": clip.moves.name(),
        "fps": clip.fps, "filmed_fps": clip.filmed_fps(), "kind": kind.name(), "ball": !empty,
    });
    write_whole(&file("truth.json"), truth.to_string().as_bytes())?;
    // The video comes last: where it is, all is.
    encoder.finish()?;
    Ok(frames.len())
}
