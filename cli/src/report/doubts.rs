//! What is doubtful of a tracked video, as pictures to look at.

use std::collections::BTreeMap;
use std::ops::Range;

use gravisight::TrackedVideo;
use image::RgbImage;

use super::{html, pictures};
use gravisight::Result;

/// Pictures at most.
const MOST: usize = 24;
/// Confidence below which a frame is worth a look.
pub(super) const DOUBTFUL: f64 = 0.9;
/// Frames without the ball, between others with it, that are worth a look.
const GONE: usize = 3;
/// Frames apart that two pictures of one reason are at least.
const APART: usize = 4;
/// Side of what is shown, in radii of the ball, and at least, px.
const SIDE: f64 = 10.0;
const LEAST_SIDE: f64 = 96.0;

/// A frame that a person should look at.
#[derive(Debug, Clone, PartialEq)]
pub struct Doubt {
    /// By index.
    pub frame: usize,
    /// The ball as it was found, or where it should be: centre and radius, px.
    pub ball: [f64; 3],
    /// In words.
    pub why: String,
}

/// Which kind of doubt; the worst first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum DoubtKind {
    Off,
    Unsure,
    Unexplained,
    Gone,
}

/// What is doubtful of `tracked`, by frame: the worst kinds first where there are too many.
pub fn doubts(tracked: &TrackedVideo) -> Vec<Doubt> {
    let mut found: Vec<(DoubtKind, Doubt)> = Vec::new();
    let mut add = |kind: DoubtKind, frame: usize, ball: [f64; 3], why: String| {
        let near = |(other, doubt): &(DoubtKind, Doubt)| {
            frame == doubt.frame || (*other == kind && frame.abs_diff(doubt.frame) < APART)
        };
        if !found.iter().any(near) {
            found.push((kind, Doubt { frame, ball, why }));
        }
    };
    let ball = |frame: usize| {
        let followed = &tracked.frames[frame].followed;
        let at = followed.point.image()?;
        let radius = followed.ball.as_ref().map_or(LEAST_SIDE / SIDE, |ball| ball.radius_px);
        Some([at.x, at.y, followed.point.radius.unwrap_or(radius)])
    };
    for segment in &tracked.segments {
        let Ok(fit) = &segment.fit else { continue };
        for (index, fitted) in fit.frames.iter().enumerate() {
            let frame = segment.frames.start + index;
            if let Some(ball) = ball(frame).filter(|_| fitted.outlier) {
                add(DoubtKind::Off, frame, ball, "the detection lies off the flight".into());
            }
        }
        for (number, flight) in fit.flights.iter().enumerate().filter(|(_, flight)| !flight.explained) {
            let of: Vec<usize> = (fit.frames.iter().enumerate())
                .filter(|(_, fitted)| fitted.flight == number)
                .map(|(index, _)| segment.frames.start + index)
                .filter(|&frame| ball(frame).is_some())
                .collect();
            if let Some(&frame) = of.get(of.len() / 2) {
                let why = flight.reason.clone().unwrap_or_else(|| "no flight fits its labels".into());
                add(DoubtKind::Unexplained, frame, ball(frame).unwrap_or_default(), format!("not explained: {why}"));
            }
        }
    }
    let seen: Vec<usize> = (0..tracked.frames.len()).filter(|&frame| ball(frame).is_some()).collect();
    for &frame in &seen {
        let confidence = tracked.frames[frame].confidence;
        if let Some(ball) = ball(frame).filter(|_| confidence < DOUBTFUL) {
            add(
                DoubtKind::Unsure,
                frame,
                ball,
                format!("the ball with a probability of only {:.0} %", 100.0 * confidence),
            );
        }
    }
    for pair in seen.windows(2) {
        let [before, after] = [pair[0], pair[1]];
        if let (true, Some(from), Some(to)) = (after - before > GONE, ball(before), ball(after)) {
            let middle = std::array::from_fn(|part| 0.5 * (from[part] + to[part]));
            let why = format!("no ball found from frame {} to {}", before + 1, after - 1);
            add(DoubtKind::Gone, usize::midpoint(before, after), middle, why);
        }
    }
    found.sort_by_key(|(kind, doubt)| (*kind, doubt.frame));
    found.truncate(MOST);
    let mut doubts: Vec<Doubt> = found.into_iter().map(|(_, doubt)| doubt).collect();
    doubts.sort_by_key(|doubt| doubt.frame);
    doubts
}

/// The frames to be looked at of `doubts`; none of nothing.
pub fn frames(doubts: &[Doubt]) -> Range<usize> {
    doubts.first().map_or(0..0, |first| first.frame..doubts[doubts.len() - 1].frame + 1)
}

/// How a doubt looks in the picture of its frame (HTML).
///
/// # Errors
/// [`gravisight::Error::Data`] for a picture that cannot be written as PNG.
pub fn look(doubt: &Doubt, rgb: &RgbImage) -> Result<String> {
    let [x, y, radius] = doubt.ball;
    let side = (SIDE * radius).max(LEAST_SIDE);
    let marks = format!(
        "<g class=\"marks\" stroke-width=\"{:.2}\"><circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"{:.2}\"/></g>",
        0.012 * side,
        radius + 0.02 * side
    );
    pictures::cut(rgb, [x, y], [side; 2], &marks)
}

/// The chapter of `looks` (by frame), the pictures of `doubts`; nothing where there are none.
pub fn chapter(doubts: &[Doubt], looks: &BTreeMap<usize, String>) -> String {
    let shown = doubts.iter().filter_map(|doubt| Some((doubt, looks.get(&doubt.frame)?)));
    let parts: Vec<(String, String)> =
        shown.map(|(doubt, look)| (look.clone(), format!("frame {}: {}", doubt.frame, doubt.why))).collect();
    if parts.is_empty() {
        return String::new();
    }
    let lead = "The ring marks where the ball was found, or is expected. If it is wrong, run again with --seed-label FRAME,X,Y at \
                the ball's position; the track is then recomputed.";
    html::section("Doubtful frames", lead, &html::strip(&parts))
}
