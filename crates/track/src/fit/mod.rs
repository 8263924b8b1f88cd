//! From a 2D track of one camera to the 3D trajectory that explains it best.
//!
//! Gravity (or any known force) gives the scale; of a ball whose spin is unknown, contacts do. Here the labels are looked through; the
//! trajectory is estimated in [`crate::estimate`].

mod checks;
mod labels;
mod parameters;

use self::checks::{Refusal, check, check_inside, check_seen, within_lens};
use self::parameters::without_knowing;
use crate::config::FitOptions;
use crate::estimate::estimated;
use crate::observation::Observation;
use crate::result::Fit;
use gravisight_geometry::camera::Camera;
use gravisight_geometry::error::{Error, Result};
use gravisight_physics::{Forecaster, Observed};

/// Fewest observations that determine a flight: six numbers, two an observation, and one to spare.
const FEWEST: usize = 4;

/// Raised with every change of what the same track is fitted to: fits that are kept (by a training run) are then made again.
/// `train::examples::tests::solver` compares with the fits of this version.
pub const SOLVER_VERSION: u32 = 4;

impl Observed for Observation {
    type Options = FitOptions;
    type Fit = Fit;

    fn fit(forecaster: &Forecaster, camera: &Camera, observations: &[Self], options: &FitOptions) -> Result<Fit> {
        let scene = forecaster.scene();
        let doubts = camera.doubts(scene.floor.as_ref().map(|floor| floor.height), &scene.landmarks());
        let mut fit = fit_labels(forecaster, camera, observations, options).map_err(|error| match error {
            Error::Fit { reason } if !doubts.is_empty() => {
                Error::Fit { reason: format!("{reason}; {}", doubts.join("; ")) }
            }
            error => error,
        })?;
        fit.notes.extend(doubts);
        Ok(fit.concluded(scene))
    }
}

fn fit_labels(
    forecaster: &Forecaster,
    camera: &Camera,
    observations: &[Observation],
    options: &FitOptions,
) -> Result<Fit> {
    check(observations)?;
    options.config.map_or(Ok(()), |config| config.check())?;
    check_inside(camera, observations)?;
    let mut refused: Vec<Option<Refusal>> = vec![None; observations.len()];
    let mut taken = observations.to_vec();
    let mut notes = vec![];
    if let Some(repeats) = labels::repeats(observations) {
        for &frame in &repeats.frames {
            taken[frame].image = None;
            refused[frame] = Some(Refusal::Repeated);
        }
        let mut note = format!("{} frames repeat the previous ones and are left out", repeats.frames.len());
        if let Some(times) = repeats.times {
            taken.iter_mut().zip(times).for_each(|(seen, time)| seen.time = time);
            note +=
                ", and the other frames are spaced evenly, because the video's frame rate seems to have been raised";
        }
        notes.push(note);
    }
    // Rows' times are from those of their frames on.
    let (mut usable, outside) = within_lens(camera, &taken);
    for (refused, error) in refused.iter_mut().zip(outside) {
        *refused = refused.take().or(error.map(Refusal::OutsideLens));
    }
    if usable.windows(2).any(|pair| pair[1].time <= pair[0].time) {
        let reason = "the camera's readout_s is longer than the time between frames, so two frames would be read out at once; \
             check readout_s and the frame rate";
        return Err(Error::Fit { reason: reason.into() });
    }
    let strays = labels::strays(&usable, f64::from(camera.size().width));
    for &stray in &strays {
        usable[stray].image = None;
        refused[stray] = Some(Refusal::OtherPath);
    }
    check_seen(&usable, &refused)?;
    let mut fit = estimated(&without_knowing(forecaster, &options.estimate)?, camera, &usable, options)?;
    for (frame, refused) in fit.frames.iter_mut().zip(refused) {
        frame.outlier |= refused.is_some();
        frame.refused = refused.map(|refused| refused.to_string());
    }
    fit.notes.splice(0..0, notes);
    Ok(fit)
}
