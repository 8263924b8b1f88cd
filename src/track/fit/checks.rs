//! What is asked of a fit: which tracks, and which options with which scene.

use nalgebra::Point2;

use super::{FEWEST, Observation};
use crate::camera::Camera;
use crate::error::{Error, Result};

/// How far outside the picture a label may be that a tracker has made up there, a share of the side.
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
        "{outside} of {} labels lie outside the camera's picture of {width}×{height} px: is the track of a video in \
         another resolution?",
        labels.len()
    );
    Err(Error::Fit { reason })
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
pub(super) fn check_seen(usable: &[Observation], refused: &[Option<String>]) -> Result<()> {
    let seen = usable.iter().filter(|observation| observation.image.is_some()).count();
    let outside = match refused.iter().flatten().count() {
        0 => String::new(),
        count => format!(" ({count} labels that the camera's lens model does not reach left out)"),
    };
    match seen {
        FEWEST.. => Ok(()),
        _ => {
            let reason = format!("the ball is seen in {seen} frames{outside}; at least {FEWEST} are needed");
            Err(Error::Fit { reason })
        }
    }
}
