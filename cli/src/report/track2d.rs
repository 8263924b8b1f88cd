//! The ball in the picture, of a video with or without a camera: how often it was found, and how sure that is.

use gravisight::internal::median;
use gravisight::parts::OtherTrack;
use gravisight::{Result, Size, TrackedVideo};

use super::plots::{self, ACCENT, Axis, FOUND, Mark, OTHER};
use super::{doubts, html};

/// Times between which nothing is drawn are further apart than so many frames.
const LONG: usize = 1;

/// The chapter on the 2D track of a video of frames of `size`.
///
/// # Errors
/// [`gravisight::Error::Format`] where a chart cannot be drawn.
pub fn chapter(tracked: &TrackedVideo, size: Size) -> Result<String> {
    let own = || tracked.frames.iter().filter(|frame| !frame.repeated);
    let seen = || own().filter_map(|frame| Some((frame, frame.image?)));
    let all = own().count();
    let found = seen().count();
    if all == 0 {
        return Ok(String::new());
    }
    let doubtful = seen().filter(|(frame, _)| frame.confidence < doubts::DOUBTFUL).count();
    let (mut gap, mut longest) = (0, 0);
    let [first, last] = [seen().next(), seen().next_back()].map(|seen| seen.map(|(frame, _)| frame.frame));
    for frame in own().filter(|frame| Some(frame.frame) > first && Some(frame.frame) < last) {
        gap = if frame.image.is_some() { 0 } else { gap + 1 };
        longest = longest.max(gap);
    }
    let number = |value: Option<f64>, digits: usize| value.map_or("–".into(), |value| format!("{value:.digits$}"));
    let tile = |name: &str, value: String, note: String| [name.to_string(), value, note];
    let fraction = format!("{:.0} % of the frames", 100.0 * found as f64 / all as f64);
    let tiles = [
        tile("Ball found", format!("{found} of {all}"), fraction),
        tile(
            "Confidence",
            number(median(seen().map(|(frame, _)| frame.confidence)), 2),
            format!("median; {doubtful} frames below {}", doubts::DOUBTFUL),
        ),
        tile(
            "Radius",
            format!("{} px", number(median(seen().filter_map(|(frame, _)| frame.radius_px)), 1)),
            "median".into(),
        ),
        tile("Longest gap", format!("{longest} frames"), "between the first and the last frame with the ball".into()),
    ];
    let mut body = html::tiles(&tiles);
    let others = &tracked.tracks;
    if let Some(sure) = others.iter().map(|track| track.probability).reduce(f64::max) {
        let balls = if others.len() == 1 { "Another ball" } else { "Other balls" };
        let note = format!("the likeliest with a probability of {sure:.2}; see `tracks` in the JSON");
        body = html::tiles(&[&tiles[..], &[tile(balls, others.len().to_string(), note)]].concat());
    }
    if found > 0 {
        let y = Axis::new("y, px", f64::from(size.height)..0.0);
        let dots: Vec<(f64, f64)> = seen().map(|(_, at)| (at.x, at.y)).collect();
        let of_track = |track: &OtherTrack| track.frames.iter().map(|frame| frame.image.into()).collect();
        let mut marks: Vec<Mark> = others.iter().map(|track| Mark::Dots(of_track(track), OTHER)).collect();
        marks.extend(lines(tracked));
        marks.push(Mark::Dots(dots, FOUND));
        let path = plots::chart(&Axis::new("x, px", 0.0..f64::from(size.width)), &y, &marks)?;
        let sure: Vec<(f64, f64)> = seen().map(|(frame, _)| (frame.time, frame.confidence)).collect();
        let times = own().map(|frame| frame.time);
        let sure = plots::chart(
            &Axis::around("time, s", times),
            &Axis::new("confidence", 0.0..1.02),
            &[Mark::Dots(sure, ACCENT)],
        )?;
        let mut legend = vec![("found", "a frame")];
        legend.extend((!others.is_empty()).then_some(("other", "another ball")));
        body += &html::row(
            "",
            &[
                html::figure(&path, "Where the ball was found", &legend),
                html::figure(&sure, "Probability that this is the ball", &[("accent", "a frame")]),
            ],
        );
    }
    Ok(html::section("The ball in the picture", "Pixels; no camera is needed for this.", &body))
}

/// The way between neighbouring frames.
fn lines(tracked: &TrackedVideo) -> Vec<Mark> {
    let mut lines: Vec<Vec<(f64, f64)>> = Vec::new();
    let mut missed = LONG + 1;
    for frame in tracked.frames.iter().filter(|frame| !frame.repeated) {
        let Some(at) = frame.image else {
            missed += 1;
            continue;
        };
        match lines.last_mut().filter(|_| missed <= LONG) {
            Some(line) => line.push((at.x, at.y)),
            None => lines.push(vec![(at.x, at.y)]),
        }
        missed = 0;
    }
    lines.into_iter().filter(|line| line.len() > 1).map(|line| Mark::Line(line, FOUND)).collect()
}
