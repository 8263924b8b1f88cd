//! Checks of a track before it is fitted.

use std::fmt;

use nalgebra::Point2;

use super::FEWEST;
use crate::observation::Observation;
use gravisight_geometry::camera::Camera;
use gravisight_geometry::error::{Error, Result};

/// How far outside the picture a tracker may place a label, as a fraction of the side.
const OUTSIDE: f64 = 0.05;

/// Refuses times that do not ascend, and what is no number.
pub(super) fn check(observations: &[Observation]) -> Result<()> {
    let refuse = |reason: String| Err(Error::Fit { reason });
    if let Some(index) = (1..observations.len()).find(|&i| observations[i].time <= observations[i - 1].time) {
        let times = [observations[index - 1].time, observations[index].time];
        return refuse(format!("times must ascend, but {} s is followed by {} s", times[0], times[1]));
    }
    let finite = |o: &Observation| o.time.is_finite() && o.image.is_none_or(|p| p.x.is_finite() && p.y.is_finite());
    match observations.iter().all(finite) {
        true => Ok(()),
        false => refuse("the track holds NaN or infinity".into()),
    }
}

/// Refuses tracks of which a good part lies outside the picture: no tracker has seen a ball there.
pub(super) fn check_inside(camera: &Camera, observations: &[Observation]) -> Result<()> {
    let [width, height] = camera.size().xy();
    let inside = |image: &Point2<f64>| {
        let within = |at: f64, side: f64| (-OUTSIDE * side..(1.0 + OUTSIDE) * side).contains(&at);
        within(image.x, width) && within(image.y, height)
    };
    let labels: Vec<Point2<f64>> = observations.iter().filter_map(|seen| seen.image).collect();
    let outside = labels.iter().filter(|label| !inside(label)).count();
    if 4 * outside <= labels.len() {
        return Ok(());
    }
    let reason = format!(
        "{outside} of {} labels lie outside the camera's picture of {width}×{height} px: was the track made from a \
         video of another resolution?",
        labels.len()
    );
    Err(Error::Fit { reason })
}

/// Why a label is left out.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Refusal {
    /// Outside the range of the camera's lens model; holds the camera's error message.
    OutsideLens(String),
    Repeated,
    OtherPath,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OutsideLens(reason) => f.write_str(reason),
            Self::Repeated => f.write_str("repeats the previous frame"),
            Self::OtherPath => {
                f.write_str("lies on a different path from most labels: does it belong to another ball?")
            }
        }
    }
}

/// The observations without the labels that the camera's lens model does not reach, and why they are left out.
pub(super) fn within_lens(camera: &Camera, observations: &[Observation]) -> (Vec<Observation>, Vec<Option<String>>) {
    let usable = |observation: &Observation| {
        let refused = observation.image.and_then(|image| camera.camera_from_image(&image, 1.0).err());
        let image = observation.image.filter(|_| refused.is_none());
        // The row's time; where there is none, the middle one's.
        let row = image.map_or(f64::from(camera.size().height) / 2.0, |image| image.y);
        let time = observation.time + camera.row_time(row);
        (Observation { image, time, ..*observation }, refused.map(|error| error.to_string()))
    };
    observations.iter().map(usable).unzip()
}

/// Refuses tracks of too few labels.
pub(super) fn check_seen(usable: &[Observation], refused: &[Option<Refusal>]) -> Result<()> {
    let seen = usable.iter().filter(|observation| observation.image.is_some()).count();
    if seen >= FEWEST {
        return Ok(());
    }
    let count = |is_it: fn(&Refusal) -> bool| refused.iter().flatten().filter(|refused| is_it(refused)).count();
    let counts = [
        (count(|it| matches!(it, Refusal::OutsideLens(_))), "outside the camera's lens model"),
        (count(|it| *it == Refusal::Repeated), "in repeated frames"),
        (count(|it| *it == Refusal::OtherPath), "on another path"),
    ];
    let counted = counts.into_iter().filter(|(count, _)| *count > 0);
    let left_out: Vec<String> = counted.map(|(count, which)| format!("{count} {which}")).collect();
    let left_out = match left_out.as_slice() {
        [] => String::new(),
        left_out => format!(" (labels left out: {})", left_out.join(", ")),
    };
    let reason = format!("the ball is labelled in {seen} frames{left_out}; at least {FEWEST} are needed");
    Err(Error::Fit { reason })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_left_out_are_counted_by_their_reason() {
        let unseen = [Observation { time: 0.0, image: None, radius: None }];
        let outside = Refusal::OutsideLens("the point lies outside".into());
        let reasons = [outside, Refusal::Repeated, Refusal::Repeated, Refusal::OtherPath];
        let refused: Vec<Option<Refusal>> = reasons.into_iter().map(Some).chain([None]).collect();
        let message = check_seen(&unseen, &refused).unwrap_err().to_string();
        let counted = "(labels left out: 1 outside the camera's lens model, 2 in repeated frames, 1 on another path)";
        assert!(message.contains(counted), "{message}");
        let message = check_seen(&unseen, &[None]).unwrap_err().to_string();
        assert!(!message.contains("left out"), "{message}");
    }
}
