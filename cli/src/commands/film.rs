//! `gravisight synth --set broadcast`.

use std::path::Path;

use anyhow::{Context, Result};
use gravisight::internal::{Film, Filmed, Kind, Split, write_whole};
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use serde_json::json;

use super::print_line;
use crate::video::Encoder;

/// x264's qualities that clips are compressed with, by turns: good phones', broadcasts', bad streams'.
const QUALITIES: [u8; 3] = [18, 23, 28];
/// Clips of a part of the set.
const PART: u64 = 1_000_000;

/// Films `count` clips of each kind into `out`: a video each, its camera and scene, and the truth.
pub fn run(out: &Path, split: Split, count: usize, seed: u64, as_json: bool) -> Result<()> {
    std::fs::create_dir_all(out).with_context(|| out.display().to_string())?;
    let clips: Vec<(Kind, usize)> =
        (0..count).flat_map(|number| Kind::ALL.into_iter().map(move |kind| (kind, number))).collect();
    let part = match split {
        Split::Train => 0,
        Split::Val => PART,
        Split::Test => 2 * PART,
    };
    let frames: Result<Vec<usize>> = clips
        .into_par_iter()
        .map(|(kind, number)| film(out, kind, number, seed.wrapping_add(part).wrapping_add(number as u64)))
        .collect();
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
    let mut table = String::from("Frame,Visibility,X,Y,Time,Radius,WorldX,WorldY,WorldZ\n");
    for frame in 0..film.count() {
        let (picture, Filmed { time, world: [x, y, z], image: [u, v], radius_px, visible }) = film.frame(frame)?;
        encoder.write(&picture)?;
        table +=
            &format!("{frame},{},{u:.3},{v:.3},{time:.6},{radius_px:.3},{x:.4},{y:.4},{z:.4}\n", u8::from(visible));
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
