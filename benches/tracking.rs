//! Following a ball through a video, decoding not counted: `cargo bench --bench all -- tracking VIDEO WIDTH HEIGHT FPS [MODEL]`.
//! The frames are decoded by an installed ffmpeg beforehand.

use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::Instant;

use gravisight::internal::BallTracker;
use gravisight::{Card, Device, Localiser, Picture, VideoTracker};

/// Frames of the beginning that are not timed: of them the background is made.
const FIRST: usize = 32;
/// Most frames that are held in memory.
const MOST: usize = 300;

fn frames(video: &str, width: u32, height: u32) -> Vec<image::RgbImage> {
    let arguments = ["-v", "error", "-i", video, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"];
    let mut ffmpeg = Command::new("ffmpeg").args(arguments).stdout(Stdio::piped()).spawn().expect("ffmpeg");
    let mut pixels = ffmpeg.stdout.take().expect("its output");
    let mut frames = Vec::new();
    let mut frame = vec![0; (3 * width * height) as usize];
    while frames.len() < MOST && pixels.read_exact(&mut frame).is_ok() {
        frames.push(image::RgbImage::from_raw(width, height, frame.clone()).expect("a whole frame"));
    }
    _ = ffmpeg.kill();
    _ = ffmpeg.wait();
    frames
}

fn print(name: &str, mut milliseconds: Vec<f64>) {
    milliseconds.drain(..FIRST.min(milliseconds.len()));
    let mean = milliseconds.iter().sum::<f64>() / milliseconds.len() as f64;
    milliseconds.sort_by(f64::total_cmp);
    let quantile = |share: f64| milliseconds[(share * (milliseconds.len() - 1) as f64) as usize];
    println!(
        "{name:<24} {mean:6.2} ms a frame ({:.0} a second), median {:.2}, 95 % {:.2}",
        1e3 / mean,
        quantile(0.5),
        quantile(0.95)
    );
}

pub fn run(arguments: &[String]) {
    if crate::common::is_check() {
        return time(&drawn(), 30.0, "models/any.json");
    }
    let [video, width, height, fps, rest @ ..] = arguments else {
        return println!("usage: cargo bench --bench all -- tracking VIDEO WIDTH HEIGHT FPS [MODEL]");
    };
    let fps: f64 = fps.parse().expect("frames a second");
    let frames = frames(video, width.parse().expect("pixels"), height.parse().expect("pixels"));
    println!("{} frames of {width}×{height}", frames.len());
    time(&frames, fps, rest.first().map_or("models/any.json", String::as_str));
}

/// A disc that flies before a grey wall.
fn drawn() -> Vec<image::RgbImage> {
    let frame = |number: usize| {
        let time = number as f64;
        let [u, v] = [10.0 + 3.0 * time, 60.0 - 4.0 * time + 0.08 * time * time];
        image::RgbImage::from_fn(192, 108, |x, y| {
            let inside = (f64::from(x) - u).hypot(f64::from(y) - v) < 4.0;
            image::Rgb(if inside { [230, 220, 60] } else { [90, 100, 110] })
        })
    };
    (0..FIRST + 12).map(frame).collect()
}

fn time(frames: &[image::RgbImage], fps: f64, model: &str) {
    let timed = |mut step: Box<dyn FnMut(usize, Picture) + '_>| -> Vec<f64> {
        let pictures = frames.iter().map(|frame| Picture::from_rgb(frame.clone()));
        let step = pictures.enumerate().map(|(number, picture)| {
            let start = Instant::now();
            step(number, picture);
            1e3 * start.elapsed().as_secs_f64()
        });
        step.collect()
    };
    let mut follower = BallTracker::new();
    print("what moves", timed(Box::new(|number, picture| follower.watch(picture, number as f64 / fps).unwrap())));
    let card = Card::from_json(&std::fs::read_to_string(model).expect("a model's card"), model).expect("a card");
    let weights = std::fs::read(Path::new(model).with_file_name(&card.weights)).expect("its weights");
    let localiser = Localiser::new(card, weights, &Device::flex()).expect("a model");
    let mut tracker = VideoTracker::new(Arc::new(localiser), None);
    let all = timed(Box::new(|number, picture| {
        pollster::block_on(tracker.add(picture, number as f64 / fps)).unwrap();
    }));
    print("and what the network sees", all);
}
