//! From a 2D track of one camera to the 3D trajectory that explains it best.
//!
//! Gravity (or any known force) gives the scale: a free flight's images determine position and
//! velocity linearly ([`seed`]). From there the trajectory grows frame by frame through contacts,
//! refined all along ([`chain`]); several starts are grown, and the best parts of all are joined.

mod chain;
mod checks;
mod json;
mod labels;
mod loss;
mod parameters;
mod problem;
mod search;
mod seed;
mod tridiagonal;

use nalgebra::{Matrix3, Point2, Point3, Vector2};

use self::chain::Chain;
use self::checks::{check, check_inside, check_seen, within_lens};
use self::labels::SMALLEST_NOISE;
pub use self::labels::{noise_of, trusted};
pub use self::parameters::{Estimate, Parameter};
use self::problem::Problem;
use self::search::{EXPLAINED, FINAL, best_of, searched};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::physics::{Contact, Forecaster, Impact, State, part};
use crate::track::estimate::{EstimatorConfig, estimated};

/// Fewest observations that determine a flight: six numbers, two an observation, and one to spare.
const FEWEST: usize = 4;
/// Residual, in standard deviations, of an outlier.
const OUTLIER: f64 = 4.0;
/// Largest noise of labels that is believed, as a share of the picture's width.
const LARGEST_NOISE: f64 = 0.01;
/// Standard deviation of a known spin, rad/s.
const KNOWN_SPIN: f64 = 1e-3;
/// Standard deviation of a spin that is to be estimated, rad/s.
const UNKNOWN_SPIN: f64 = 200.0;

/// Raised with every change of what the same track is fitted to: fits that are kept (by a training run) are then made again.
/// `train::examples::tests::solver` compares with the fits of this version.
pub const SOLVER_VERSION: u32 = 2;

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
#[derive(Debug, Clone, PartialEq)]
pub struct FitOptions {
    /// Standard deviation of the 2D labels, px; estimated from the track where `None`.
    pub noise_px: Option<f64>,
    /// Starts that are grown to whole trajectories, at most.
    pub starts: usize,
    /// What is to be found of the ball beside its trajectory; the scene's value is where the search for it starts. Of a ball
    /// whose spin is unknown the fit finds drag and restitution anyway ([`Fit::estimates`]): there is nothing to name.
    pub estimate: Vec<Parameter>,
    /// Most hits (of a racket, a foot, a hand) that the track may hold; as many as explain it where `None`. Where the spin is
    /// known, or to be found by name, there are none.
    pub hits: Option<usize>,
    /// The camera moved by one standard deviation along each independent direction of its uncertainty
    /// ([`Calibration::one_sigma`](crate::Calibration::one_sigma)): what that changes enters σ. Where the spin is unknown
    /// only; empty: the camera is right.
    pub cameras: Vec<Camera>,
    /// Whether the observations' times are right, as a video's own are: no lost frames are looked for then.
    pub times_known: bool,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self { noise_px: None, starts: 24, estimate: vec![], hits: None, cameras: vec![], times_known: false }
    }
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
    /// The numbers of the scene that were to be estimated; where the spin is unknown also what is known to some percent
    /// only, drag and restitution.
    pub estimates: Vec<Estimate>,
    /// Spin at the first frame, rad/s: the scene's, or the one found.
    pub spin: [f64; 3],
    /// The numbers that it was judged by, of a ball whose spin is unknown.
    pub config: Option<EstimatorConfig>,
}

impl Forecaster {
    /// The trajectory through `observations` (by time) that the scene's physics allows and whose image
    /// explains them best.
    ///
    /// # Errors
    /// [`Error::Fit`] for times that do not ascend, fewer than four observations, a track that no trajectory in front of the
    /// camera explains, or where the ball's spin is unknown and `options` name drag or restitution without it, or the
    /// forecaster has a potential or options of its own. A label outside the camera's lens model costs itself alone
    /// (its `refused`).
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
        let mut fit = match self.is_spin_unknown() && self.estimates_spin(options)? {
            true => estimated(self, camera, &usable, options)?,
            false => self.fit_known(camera, &usable, options)?,
        };
        for (frame, refused) in fit.frames.iter_mut().zip(refused) {
            frame.outlier |= refused.is_some();
            frame.refused = refused;
        }
        fit.notes.splice(0..0, notes);
        Ok(fit)
    }

    /// A fit by the forecaster itself, of a ball whose spin is known or to be found with the rest.
    fn fit_known(&self, camera: &Camera, usable: &[Observation], options: &FitOptions) -> Result<Fit> {
        // The spin matters where air or friction turns it into forces.
        let rubs = matches!(self.scene().contact, Contact::Bounce { friction, .. } if friction > 0.0);
        let spins = self.scene().ball.lift_coefficient != 0.0 || rubs || options.estimate.contains(&Parameter::Spin);
        let mut fit = match spins {
            true => self.fit_chain::<9>(camera, usable, options)?,
            false => self.fit_chain::<6>(camera, usable, options)?,
        };
        if !options.cameras.is_empty() {
            fit.notes.push(
                "σ leaves the camera's own uncertainty out: it is known only where the ball's spin is not".into(),
            );
        }
        Ok(fit)
    }

    fn fit_chain<const D: usize>(
        &self,
        camera: &Camera,
        observations: &[Observation],
        options: &FitOptions,
    ) -> Result<Fit> {
        let spin_sigma = if options.estimate.contains(&Parameter::Spin) { UNKNOWN_SPIN } else { KNOWN_SPIN };
        let trusted = trusted(observations);
        let noise = options.noise_px.unwrap_or_else(|| noise_of(&trusted)).max(SMALLEST_NOISE);
        let mut problem = Problem::new(self, camera, observations, &trusted, noise, spin_sigma)?;
        let numbers = parameters::numbers(options);
        problem.slack = parameters::slack(&numbers);
        let chains = searched::<D>(&mut problem, options)?;
        if numbers.is_empty() {
            return finished(&problem, &chains, vec![]).ok_or_else(unexplained);
        }
        let found = parameters::searched(&mut problem, &chains, options)?;
        let problem = problem.with(&found.forecaster);
        let mut fit = finished(&problem, &[found.chain], found.estimates).ok_or_else(unexplained)?;
        for (frame, spread) in fit.frames.iter_mut().zip(found.spread) {
            frame.covariance += spread;
        }
        Ok(fit)
    }
}

/// Noise of labels beyond which they are no labels of a ball, px.
fn largest_noise(camera: &Camera) -> f64 {
    LARGEST_NOISE * f64::from(camera.size().width)
}

pub(super) fn unexplained() -> Error {
    let reason = "no trajectory in front of the camera explains the track; check camera.json, scene.json and fps";
    Error::Fit { reason: reason.into() }
}

/// The result, with covariances.
fn finished<const D: usize>(problem: &Problem, chains: &[Chain<D>], estimates: Vec<Estimate>) -> Option<Fit> {
    let (best, excess) = best_of(problem, chains)?;
    let best = &chains[best];
    let covariances = best.covariances(problem, FINAL)?;
    let cost = best.total_cost(problem, FINAL);
    // Where even the best explains badly, its own covariance says little, and more of the others count.
    let explained = excess < EXPLAINED * EXPLAINED && problem.sigma < largest_noise(problem.camera);
    let temperature = if explained { 1.0 } else { excess * excess };
    let others: Vec<(f64, &Chain<D>)> = chains
        .iter()
        .filter(|chain| chain.states.len() == problem.len())
        .map(|chain| ((-0.5 * (chain.total_cost(problem, FINAL) - cost) / temperature).min(0.0).exp(), chain))
        .filter(|(weight, _)| *weight > 1e-6)
        .collect();
    let all = others.iter().map(|(weight, _)| weight).sum::<f64>();
    let mut squares = Vec::new();
    let frames = (0..problem.len())
        .map(|frame| {
            let state = best.at(frame)?;
            let own = &covariances[frame];
            let mut covariance = own.fixed_view::<3, 3>(0, 0) * temperature;
            for (weight, other) in &others {
                let off = part(other.at(frame)?, 0) - part(state, 0);
                covariance += off * off.transpose() * (*weight / all);
            }
            let residual_px = best.observed(problem, frame, FINAL).map(|(_, _, residual)| residual);
            let outlier = residual_px.is_some_and(|residual| residual.norm() > OUTLIER * problem.sigma);
            squares.extend(residual_px.filter(|_| !outlier).map(|residual| residual.norm_squared() / 2.0));
            Some(FittedFrame {
                time: problem.observations[frame].time,
                state: State { position: Point3::from(part(state, 0)), velocity: part(state, 1), spin: part(state, 2) },
                covariance,
                residual_px,
                outlier,
                flight: 0,
                refused: None,
            })
        })
        .collect::<Option<Vec<FittedFrame>>>()?;
    let rms_px = (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt();
    let touched = (0..problem.len() - 1).flat_map(|frame| {
        let start = problem.observations[frame].time;
        let forecast = problem.forecaster.forecast(&frames[frame].state, &[problem.interval(frame)]);
        forecast.impacts.into_iter().map(move |impact| Impact { time: start + impact.time, ..impact })
    });
    let impacts = touched.collect();
    let spin = part(best.at(0)?, 2).into();
    let reason = (!explained).then(|| {
        format!("no trajectory that the scene allows explains the labels (the best leaves {rms_px:.2} px rms, or breaks the laws)")
    });
    let speed_sigma = {
        let along = frames[0].state.velocity.normalize();
        (along.transpose() * covariances[0].fixed_view::<3, 3>(3, 3) * along)[(0, 0)].max(0.0).sqrt()
    };
    let spin_sigma = std::array::from_fn(|axis| match D {
        9 => covariances[0][(6 + axis, 6 + axis)].max(0.0).sqrt(),
        _ => 0.0,
    });
    let flight = Flight {
        start: frames[0].time,
        end: frames[frames.len() - 1].time,
        speed: [frames[0].state.velocity.norm(), speed_sigma],
        spin,
        spin_sigma,
        explained,
        reason,
    };
    let (flights, hits, notes) = (vec![flight], vec![], vec![]);
    let within_lines = vec![];
    Some(Fit {
        frames,
        noise_px: problem.sigma,
        rms_px,
        explained,
        impacts,
        within_lines,
        flights,
        hits,
        notes,
        estimates,
        spin,
        config: None,
    })
}
