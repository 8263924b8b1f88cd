//! From a 2D track of one camera to the 3D trajectory that explains it best.
//!
//! Gravity (or any known force) gives the scale; of a ball whose spin is unknown, contacts do. Here the labels are looked through; the
//! trajectory is estimated in [`crate::track::estimate`].

mod checks;
mod labels;
mod outcome;
mod parameters;

use nalgebra::Point2;
use serde::Deserialize;

use self::checks::{check, check_inside, check_seen, within_lens};
pub use self::labels::{noise_of, trusted};
pub use self::outcome::{Estimate, Fit, FitSummary, FittedFrame, FittedImpact, Flight, Hit, Parameter};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::physics::Forecaster;
use crate::track::estimate::{EstimatorConfig, estimated};

/// Fewest observations that determine a flight: six numbers, two an observation, and one to spare.
const FEWEST: usize = 4;

/// Raised with every change of what the same track is fitted to: fits that are kept (by a training run) are then made again.
/// `train::examples::tests::solver` compares with the fits of this version.
pub const SOLVER_VERSION: u32 = 3;

/// One frame of a track.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify), tsify(missing_as_null))]
#[serde(deny_unknown_fields)]
pub struct Observation {
    /// s.
    pub time: f64,
    /// The ball's centre in the picture, px; none where it was not seen.
    pub image: Option<Point2<f64>>,
    /// Semi-minor axis of its outline and that one's standard deviation, px, where they were measured.
    #[cfg_attr(target_arch = "wasm32", tsify(optional))]
    pub radius: Option<[f64; 2]>,
}

/// How a track is fitted.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FitOptions {
    /// Standard deviation of the 2D labels, px; estimated from the track where `None`.
    pub noise_px: Option<f64>,
    /// What the scene does not know of the ball. Drag and restitution are estimated anyway ([`Fit::estimates`]), as far from the scene's
    /// as its `drag_sigma` and `restitution_sigma` allow; named here they may be almost any, and the spin, too.
    pub estimate: Vec<Parameter>,
    /// Most hits (of a racket, a foot, a hand) that the track may hold; as many as explain it where `None`. Of a ball whose contacts
    /// last there are none.
    pub hits: Option<usize>,
    /// The camera moved by one standard deviation along each independent direction of its uncertainty
    /// ([`Calibration::one_sigma`](crate::Calibration::one_sigma)): what that changes enters σ. Empty: the camera is right.
    pub cameras: Vec<Camera>,
    /// The numbers that trajectories are judged by; the scene's ([`EstimatorConfig::of`]) where `None`.
    pub config: Option<EstimatorConfig>,
    /// Whether the observations' times are right, as a video's own are: no lost frames are looked for then.
    pub times_known: bool,
}

impl Forecaster {
    /// The trajectory through `observations` (by time) that the scene's physics allows and whose image
    /// explains them best.
    ///
    /// ```
    /// use gravisight::camera::Distortion;
    /// use gravisight::track::Observation;
    /// use gravisight::{Camera, FitOptions, Forecaster, Scene, Size};
    /// use nalgebra::{Matrix3, Point3, Vector3};
    ///
    /// let intrinsic = Matrix3::new(900.0, 0.0, 639.5, 0.0, 900.0, 359.5, 0.0, 0.0, 1.0);
    /// let rotation = Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0);
    /// let translation = -rotation * Vector3::new(0.0, -4.0, 1.0);
    /// let camera = Camera::new(Size::new(1280, 720), intrinsic, Distortion::default(), rotation, translation)?;
    ///
    /// // A ball of 4 cm that bounces: what a tracker would have seen of it, at 50 frames a second.
    /// let forecaster = Forecaster::new(&Scene::new([0.0, 0.0, -9.81], 0.02).with_floor(0.0))?;
    /// let start = forecaster.scene().start(Point3::new(-1.0, 0.0, 1.0), Vector3::new(2.0, 0.5, 1.0));
    /// let times: Vec<f64> = (0..40).map(|frame| f64::from(frame) / 50.0).collect();
    /// let truth = forecaster.forecast(&start, &times).states;
    /// let label = |at: &Point3<f64>| camera.image_from_world(at);
    /// let observations = times.iter().zip(&truth).map(|(&time, state)| {
    ///     Ok(Observation { time, image: Some(label(&state.position)?), ..Observation::default() })
    /// });
    /// let observations: Vec<Observation> = observations.collect::<gravisight::Result<_>>()?;
    ///
    /// let fit = forecaster.fit(&camera, &observations, &FitOptions::default())?;
    /// assert!(fit.explained && fit.impacts.len() == 1);
    /// assert!((fit.frames[39].world - truth[39].position).norm() < 0.01);
    /// # Ok::<(), gravisight::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Fit`] for times that do not ascend, fewer than four observations, a track that no trajectory in front of the
    /// camera explains, or where `options` name a restitution that the scene's contact has not. [`Error::Value`] for a `config` of what is not positive. A label outside the camera's lens
    /// model costs itself alone (its `refused`).
    ///
    /// The forecaster's options hold for contacts that last; what flies freely is integrated with a step of its own.
    pub fn fit(&self, camera: &Camera, observations: &[Observation], options: &FitOptions) -> Result<Fit> {
        let doubts = camera.doubts(self.scene().floor.as_ref().map(|floor| floor.height), &self.scene().landmarks());
        let mut fit = self.fit_labels(camera, observations, options).map_err(|error| match error {
            Error::Fit { reason } if !doubts.is_empty() => {
                Error::Fit { reason: format!("{reason}; {}", doubts.join("; ")) }
            }
            error => error,
        })?;
        fit.notes.extend(doubts);
        Ok(fit.concluded(self.scene()))
    }

    fn fit_labels(&self, camera: &Camera, observations: &[Observation], options: &FitOptions) -> Result<Fit> {
        check(observations)?;
        options.config.map_or(Ok(()), |config| config.check())?;
        check_inside(camera, observations)?;
        let (mut usable, mut refused) = within_lens(camera, observations);
        let mut notes = vec![];
        if let Some(repeats) = labels::repeats(&usable) {
            for &frame in &repeats.frames {
                usable[frame].image = None;
                refused[frame] = Some("shows the frame before it again".into());
            }
            let mut note = format!("{} frames show the one before again: they are left out", repeats.frames.len());
            if let Some(times) = repeats.times {
                usable.iter_mut().zip(times).for_each(|(seen, time)| seen.time = time);
                note += ", and the others' times spread evenly, as if the video's rate had been raised";
            }
            notes.push(note);
        }
        if usable.windows(2).any(|pair| pair[1].time <= pair[0].time) {
            let reason =
                "the camera's readout_s is longer than frames are apart: rows of one would follow rows of the next";
            return Err(Error::Fit { reason: reason.into() });
        }
        let strays = labels::strays(&usable, f64::from(camera.size().width));
        for &stray in &strays {
            usable[stray].image = None;
            refused[stray] = Some("lies on another way than most labels: is it another ball's?".into());
        }
        check_seen(&usable, &refused)?;
        let mut fit = estimated(&self.without_knowing(&options.estimate)?, camera, &usable, options)?;
        for (frame, refused) in fit.frames.iter_mut().zip(refused) {
            frame.outlier |= refused.is_some();
            frame.refused = refused;
        }
        fit.notes.splice(0..0, notes);
        Ok(fit)
    }
}

pub(super) fn unexplained() -> Error {
    let reason = "no trajectory in front of the camera explains the track; check camera.json, scene.json and fps";
    Error::Fit { reason: reason.into() }
}
