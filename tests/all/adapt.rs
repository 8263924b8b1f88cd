//! Adapting a model to a ball, in memory: a run that is put aside and gone on with.

use gravisight::track::TrackedFrame;
use gravisight::{AdaptOptions, Adapter, Card, Device, Error, Picture, TrackedVideo};
use image::{Rgb, RgbImage};
use nalgebra::Point2;

use crate::common::root;

/// Frames of a flight, between frames without the ball.
const FLIGHT: usize = 10;
const PAUSE: usize = 10;
const FPS: f64 = 50.0;

/// The ball of frame `frame` of two flights.
fn ball(frame: usize) -> Option<[f64; 2]> {
    let t = (frame % (FLIGHT + PAUSE)) as f64;
    let t = t - PAUSE as f64;
    (t >= 0.0).then_some([30.0 + 18.0 * t, 130.0 - 24.0 * t + 2.5 * t * t])
}

fn picture(frame: usize) -> Picture {
    let rgb = RgbImage::from_fn(224, 176, |x, y| {
        let off = ball(frame).map_or(f64::INFINITY, |[u, v]| (f64::from(x) - u).hypot(f64::from(y) - v));
        let ground = [70 + (x * 7 + y * 3) as u8 % 40, 90 + (x + y * 5) as u8 % 30, 60 + (x * y) as u8 % 20];
        // An arm that waves.
        let arm = 60.0 + 30.0 * (frame as f64 * 0.7).sin();
        let is_arm = (f64::from(x) - arm).abs() < 5.0 && (140..165).contains(&y);
        if off < 6.0 {
            Rgb([225, 215, 60])
        } else if is_arm {
            Rgb([190, 140, 120])
        } else {
            Rgb(ground)
        }
    });
    Picture::from_rgb(rgb)
}

fn tracked() -> TrackedVideo {
    let frame = |frame: usize| TrackedFrame {
        frame,
        time: frame as f64 / FPS,
        image: ball(frame).map(Point2::from),
        radius_px: ball(frame).map(|_| 6.0),
        confidence: if ball(frame).is_some() { 0.97 } else { 0.0 },
        ..TrackedFrame::default()
    };
    let mut tracked = TrackedVideo::default();
    tracked.frames = (0..2 * (FLIGHT + PAUSE)).map(frame).collect();
    tracked
}

fn give(adapter: &mut Adapter, tracked: &TrackedVideo) {
    adapter.begin(tracked, &[], None).unwrap();
    for frame in 0..tracked.frames.len() {
        pollster::block_on(adapter.add(picture(frame), frame as f64 / FPS)).unwrap();
    }
    pollster::block_on(adapter.end()).unwrap();
}

fn steps(adapter: &mut Adapter, count: usize) -> Vec<f64> {
    (0..count).map_while(|_| pollster::block_on(adapter.step()).unwrap().map(|step| step.loss)).collect()
}

#[test]
fn a_run_that_was_put_aside_ends_as_if_it_had_not_stopped() {
    let (card, weights) = Card::with_weights(&root().join("models/any.json")).unwrap();
    let options = AdaptOptions { steps: 2, ..AdaptOptions::default() };
    let mut whole = Adapter::new(card, weights, &options, &Device::flex()).unwrap();
    assert!(matches!(pollster::block_on(whole.checkpoint()), Err(Error::Value { .. })));
    give(&mut whole, &tracked());
    let mut losses = steps(&mut whole, 3);
    assert_eq!(whole.progress(), [3, 6]);
    let aside = pollster::block_on(whole.checkpoint()).unwrap();
    losses.extend(steps(&mut whole, 9));
    assert_eq!((losses.len(), whole.progress()), (6, [6, 6]));

    let mut resumed = Adapter::resume(&aside, &Device::flex()).unwrap();
    assert_eq!(resumed.progress(), [3, 6]);
    give(&mut resumed, &tracked());
    assert_eq!(steps(&mut resumed, 9), losses[3..]);
    let ends = [&whole, &resumed].map(|adapter| pollster::block_on(adapter.checkpoint()).unwrap());
    assert!(ends[0] == ends[1]);

    // What is no file's name costs nothing: it can be finished again.
    let error = pollster::block_on(whole.finish("../ball")).unwrap_err().to_string();
    assert!(error.contains("file name"), "{error}");

    let error = whole.begin(&tracked(), &[], None).unwrap_err().to_string();
    assert!(error.contains("add all videos before the first step"), "{error}");

    let mut others = Adapter::resume(&aside, &Device::flex()).unwrap();
    let mut shorter = tracked();
    shorter.frames.truncate(FLIGHT + PAUSE - 1);
    give(&mut others, &shorter);
    give(&mut others, &shorter);
    let error = pollster::block_on(others.step()).unwrap_err().to_string();
    assert!(error.contains("saved run") && error.contains("same videos"), "{error}");
    assert!(Adapter::resume(&aside[..aside.len() - 9], &Device::flex()).is_err());
}

#[test]
fn a_video_is_taken_whole_or_not_at_all() {
    let (card, weights) = Card::with_weights(&root().join("models/any.json")).unwrap();
    let options = AdaptOptions { steps: 1, ..AdaptOptions::default() };
    let mut adapter = Adapter::new(card, weights, &options, &Device::flex()).unwrap();
    let mut later = tracked();
    later.frames.remove(0);
    let error = adapter.begin(&later, &[], None).unwrap_err().to_string();
    assert!(error.contains("entry 0 is frame 1"), "{error}");

    // Frames that were left out would have the labels of others.
    adapter.begin(&tracked(), &[], None).unwrap();
    pollster::block_on(adapter.add(picture(0), 0.0)).unwrap();
    let error = pollster::block_on(adapter.add(picture(1), 0.0)).unwrap_err().to_string();
    assert!(error.contains("must be later"), "{error}");
    for frame in 1..FLIGHT + PAUSE {
        pollster::block_on(adapter.add(picture(frame), frame as f64 / FPS)).unwrap();
    }
    assert!(adapter.picture_bytes() > 0);
    for error in [adapter.begin(&tracked(), &[], None).unwrap_err(), pollster::block_on(adapter.step()).unwrap_err()] {
        assert!(error.to_string().contains("only 20 of 40 frames"), "{error}");
    }
    let error = pollster::block_on(adapter.end()).unwrap_err().to_string();
    assert!(error.contains("20 frames were given, but 40 were tracked"), "{error}");
    assert_eq!(adapter.picture_bytes(), 0);
    let error = pollster::block_on(adapter.step()).unwrap_err().to_string();
    assert!(error.contains("0 usable flights found"), "{error}");

    give(&mut adapter, &tracked());
    assert_eq!(steps(&mut adapter, 1).len(), 1);
    let error = pollster::block_on(adapter.finish("ball")).unwrap_err().to_string();
    assert!(error.contains("has completed only 1 of 3 steps"), "{error}");
}
