//! From a 2D track of one camera to the 3D trajectory that explains it best.
//!
//! Gravity (or any known force) gives the scale; of a ball whose spin is unknown, contacts do. Here the labels are looked through; the
//! trajectory is estimated in [`crate::track::estimate`].

mod checks;
mod json;
mod labels;
mod parameters;

use nalgebra::{Matrix3, Point2, Point3, Vector2};

use self::checks::{check, check_inside, check_seen, within_lens};
pub use self::labels::{noise_of, trusted};
pub use self::parameters::{Estimate, Parameter};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::physics::{Forecaster, Impact, State};
use crate::track::estimate::{EstimatorConfig, estimated};

/// Fewest observations that determine a flight: six numbers, two an observation, and one to spare.
const FEWEST: usize = 4;

/// Raised with every change of what the same track is fitted to: fits that are kept (by a training run) are then made again.
/// `train::examples::tests::solver` compares with the fits of this version.
pub const SOLVER_VERSION: u32 = 3;

/// One frame of a track.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Observation {
    /// s.
    pub time: f64,
    /// The ball's centre in the picture, px; `None` where it was not seen.
    pub image: Option<Point2<f64>>,
    /// Semi-minor axis of its outline and that one's standard deviation, px, where they were measured.
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
    /// Whether the observations' times are right, as a video's own are: no lost frames are looked for then.
    pub times_known: bool,
}

/// The fitted ball at one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedFrame {
    /// s.
    pub time: f64,
    /// Position, velocity and spin in the world.
    pub state: State,
    /// Covariance of the position, m²: the labels' noise and the laws' own uncertainty, and the
    /// spread of other trajectories that explain the track nearly as well.
    pub covariance: Matrix3<f64>,
    /// Projection minus label, px.
    pub residual_px: Option<Vector2<f64>>,
    /// Whether the label does not belong to the trajectory.
    pub outlier: bool,
    /// Index of the flight that it belongs to.
    pub flight: usize,
    /// Why the label told nothing, in words, where the camera's lens model does not reach it: an outlier without
    /// residual.
    pub refused: Option<String>,
}

impl FittedFrame {
    /// Root mean square error of the position to expect, m.
    pub fn sigma(&self) -> f64 {
        self.covariance.trace().max(0.0).sqrt()
    }
}

/// A part of a trajectory in which only the scene acts on the ball.
#[derive(Debug, Clone, PartialEq)]
pub struct Flight {
    /// When it begins, s.
    pub start: f64,
    /// When it ends, s.
    pub end: f64,
    /// Speed at its start, m/s, and its standard deviation.
    pub speed: [f64; 2],
    /// Spin at its start, rad/s.
    pub spin: [f64; 3],
    /// Standard deviation of each component of the spin, rad/s.
    pub spin_sigma: [f64; 3],
    /// Whether its trajectory explains its labels to about their noise, and is known.
    pub explained: bool,
    /// Why not, in words.
    pub reason: Option<String>,
}

/// A place where the ball's way changes and the scene has nothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// s.
    pub time: f64,
    /// Index of the first frame after it.
    pub frame: usize,
    /// In the world, m.
    pub position: Point3<f64>,
}

/// A fitted trajectory: what [`Forecaster::fit`] makes of a 2D track.
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
/// assert!((fit.frames[39].state.position - truth[39].position).norm() < 0.01);
/// # Ok::<(), gravisight::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// One a frame of the track, seen or not.
    pub frames: Vec<FittedFrame>,
    /// Standard deviation of the labels, px: the one given, or found.
    pub noise_px: f64,
    /// Root mean square residual of the labels that are no outliers, px.
    pub rms_px: f64,
    /// Whether the trajectory explains the labels to about their noise and keeps the laws. If not, a force is
    /// unknown, the scene or the camera wrong, or the right trajectory was not found.
    pub explained: bool,
    /// Where the ball touches something, by time (s on the track's clock).
    pub impacts: Vec<Impact>,
    /// Of each of those the probability that it is within the scene's outermost lines ([`Scene::within_lines`](crate::physics::Scene::within_lines)).
    pub within_lines: Vec<Option<f64>>,
    /// From hit to hit, bounces between.
    pub flights: Vec<Flight>,
    /// Where something that the scene does not hold changes the ball's way.
    pub hits: Vec<Hit>,
    /// What is odd about the track, in words.
    pub notes: Vec<String>,
    /// Drag, where there is air, and restitution, where the ball bounces: the scene's own, as far as the track says no more.
    pub estimates: Vec<Estimate>,
    /// Spin at the first frame, rad/s: the scene's, or the one found.
    pub spin: [f64; 3],
    /// The numbers that it was judged by.
    pub config: Option<EstimatorConfig>,
}

impl Forecaster {
    /// The trajectory through `observations` (by time) that the scene's physics allows and whose image
    /// explains them best.
    ///
    /// # Errors
    /// [`Error::Fit`] for times that do not ascend, fewer than four observations, a track that no trajectory in front of the
    /// camera explains, or where `options` name a restitution that the scene's contact has not. A label outside the camera's lens
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
        let within =
            |impact: &Impact| self.scene().within_lines(&impact.position.into(), &fit.near(impact.time)?.covariance);
        fit.within_lines = fit.impacts.iter().map(within).collect();
        fit.notes.extend(doubts);
        Ok(fit)
    }

    fn fit_labels(&self, camera: &Camera, observations: &[Observation], options: &FitOptions) -> Result<Fit> {
        check(observations)?;
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
