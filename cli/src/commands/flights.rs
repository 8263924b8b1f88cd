//! `gravisight synth --set flights`: simulated balls in real clips.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use gravisight::internal::{BallTracker, Balls, Compression, Drawn, Flights, Photographs, Split, mixed, write_whole};
use nalgebra::Matrix3;
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use serde_json::json;

use super::film::seed_of;
use super::print_line;
use crate::footage::Footage;
use crate::video::Encoder;

/// x264's qualities that clips are compressed with, by turns.
const QUALITIES: [u8; 4] = [20, 24, 28, 32];
/// Of every so many clips of a video, one shows every second frame, and one has several balls.
const HALVED_EVERY: u64 = 4;
const SEVERAL_EVERY: u64 = 5;
const SEVERAL: u64 = 3;
/// Fewest frames of a clip that is halved.
const FEWEST: usize = 50;

/// Draws flights into each video of the folder `videos`, `count` clips of each, into `out`: a video each and the truth of its balls. Balls are
/// cut out of the labelled photographs in `photographs`.
///
/// # Errors
/// What is wrong with the input, in words.
pub fn run(
    out: &Path,
    split: Split,
    count: usize,
    seed: u64,
    (videos, photographs): (&Path, &Path),
    as_json: bool,
) -> Result<()> {
    let balls = Balls::of(&Photographs::read(photographs)?.labelled);
    ensure!(balls.count() > 0, "{}: has no labelled ball of known size (labels.csv) to cut out", photographs.display());
    let entries = std::fs::read_dir(videos).with_context(|| videos.display().to_string())?;
    let paths: std::io::Result<Vec<PathBuf>> = entries.map(|entry| Ok(entry?.path())).collect();
    let mut paths = paths.with_context(|| videos.display().to_string())?;
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "mp4"));
    paths.sort();
    ensure!(!paths.is_empty(), "{}: has no videos (*.mp4)", videos.display());
    std::fs::create_dir_all(out).with_context(|| out.display().to_string())?;
    let seed = seed_of(split, seed);
    let frames = paths.iter().enumerate().collect::<Vec<_>>().into_par_iter().map(|(number, video)| {
        let seed = mixed(seed, number as u64, 0);
        draw(out, video, count, seed, &balls).with_context(|| video.display().to_string())
    });
    let frames = frames.collect::<Result<Vec<usize>>>()?.iter().sum::<usize>();
    let clips = paths.len() * count;
    match as_json {
        true => print_line(json!({"clips": clips, "frames": frames}))?,
        false => print_line(format_args!("{clips} clips, {frames} frames in {}", out.display()))?,
    }
    Ok(())
}

/// The homography to each frame of a video from the first one.
fn views(footage: &Footage) -> Result<Vec<Matrix3<f64>>> {
    let times = footage.times().to_vec();
    let mut tracker = BallTracker::new();
    footage.each(0..times.len(), &mut |frame, picture| Ok(tracker.watch(picture, times[frame])?))?;
    tracker.end();
    Ok(tracker.views_from_first())
}

/// Draws the clips of a video, unless they are there; the number of their frames.
fn draw(out: &Path, video: &Path, count: usize, seed: u64, balls: &Balls) -> Result<usize> {
    let footage = Footage::open(&[video.to_path_buf()], None)?;
    let size = footage.size().context("has no frames")?;
    let views = views(&footage)?;
    let stem = video.file_stem().unwrap_or_default().to_string_lossy();
    let mut drawn = 0;
    for number in 0..count as u64 {
        let file = |ending: &str| out.join(format!("{stem}-{number:02}.{ending}"));
        let halved = number % HALVED_EVERY == HALVED_EVERY - 1 && views.len() >= 2 * FEWEST;
        let every = if halved { 2 } else { 1 };
        let shown: Vec<usize> = (0..views.len()).step_by(every).collect();
        drawn += shown.len();
        if file("mp4").exists() {
            continue;
        }
        let times: Vec<f64> = shown.iter().map(|&frame| footage.times()[frame]).collect();
        let lasts = times[times.len() - 1] - times[0];
        let fps = (times.len() - 1).max(1) as f64 / lasts.max(f64::EPSILON);
        let several = number % SEVERAL_EVERY == SEVERAL_EVERY - 1;
        let flights = (0..if several { SEVERAL } else { 1 })
            .map(|ball| Flights::draw(size, &times, balls, mixed(seed, number, ball)))
            .collect::<gravisight::Result<Vec<Flights>>>()?;
        let compression = Compression::Quality(QUALITIES[number as usize % QUALITIES.len()]);
        let mut encoder = Encoder::compressed(&file("mp4"), size, fps, compression)?;
        let mut tables = vec![String::from("Frame,Visibility,X,Y,Time,Radius\n"); flights.len()];
        footage.each(0..views.len(), &mut |frame, picture| {
            if frame % every != 0 {
                return Ok(());
            }
            let (frame, view) = (frame / every, &views[frame]);
            let mut rgb = picture.into_rgb();
            for (flight, table) in flights.iter().zip(&mut tables) {
                let time = times[frame] - times[0];
                *table += &match flight.lay(frame, view, &mut rgb) {
                    Some(Drawn { image: [x, y], radius_px, visible: true }) => {
                        format!("{frame},1,{x:.3},{y:.3},{time:.6},{radius_px:.3}\n")
                    }
                    // Whether it can be seen is a matter of taste: no label.
                    Some(Drawn { image, .. }) if inside(image, size) => String::new(),
                    _ => format!("{frame},0,0,0,{time:.6},0\n"),
                };
            }
            Ok(encoder.write(&rgb)?)
        })?;
        for (ball, table) in tables.iter().enumerate() {
            let ending = if several { format!("ball{ball}.truth.csv") } else { "truth.csv".into() };
            write_whole(&file(&ending), table.as_bytes())?;
        }
        // The video comes last: where it is, all is.
        encoder.finish()?;
    }
    Ok(drawn)
}

fn inside([x, y]: [f64; 2], size: gravisight::Size) -> bool {
    let [width, height] = size.xy();
    (0.0..width).contains(&x) && (0.0..height).contains(&y)
}
