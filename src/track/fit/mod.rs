//! From a 2D track of one camera to the 3D trajectory that explains it best.
//!
//! Gravity (or any known force) gives the scale: a free flight's images determine position and
//! velocity linearly ([`seed`]). From there the trajectory grows frame by frame through contacts,
//! refined all along ([`chain`]); several starts are grown, and the best parts of all are joined.

mod chain;
mod checks;
mod labels;
mod loss;
mod outcome;
mod parameters;
mod problem;
mod search;
mod seed;
mod tridiagonal;

use std::collections::BTreeMap;

use nalgebra::{Point2, Point3};
use serde::Deserialize;

use self::chain::Chain;
use self::checks::{check, check_inside, check_seen, within_lens};
use self::labels::SMALLEST_NOISE;
pub use self::labels::{noise_of, trusted};
pub use self::outcome::{Estimate, Fit, FittedFrame, FittedImpact, Flight, Hit, Parameter};
use self::problem::Problem;
use self::search::{EXPLAINED, FINAL, best_of, searched};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::physics::{Contact, Forecaster, State, part};
use crate::track::estimate::estimated;

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
        fit.notes.extend(doubts);
        Ok(fit.concluded(self.scene()))
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
            return finished(&problem, &chains, BTreeMap::new()).ok_or_else(unexplained);
        }
        let found = parameters::searched(&mut problem, &chains, options)?;
        let problem = problem.with(&found.forecaster);
        let mut fit = finished(&problem, &[found.chain], found.estimates).ok_or_else(unexplained)?;
        fit.frames.iter_mut().zip(&found.spread).for_each(|(frame, spread)| frame.spread(spread));
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
fn finished<const D: usize>(
    problem: &Problem,
    chains: &[Chain<D>],
    estimates: BTreeMap<Parameter, Estimate>,
) -> Option<Fit> {
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
            let state =
                State { position: Point3::from(part(state, 0)), velocity: part(state, 1), spin: part(state, 2) };
            let fitted = FittedFrame::new(problem.observations[frame].time, state, covariance);
            Some(FittedFrame { residual_px, outlier, ..fitted })
        })
        .collect::<Option<Vec<FittedFrame>>>()?;
    let rms_px = (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt();
    let touched = (0..problem.len() - 1).flat_map(|frame| {
        let start = problem.observations[frame].time;
        let forecast = problem.forecaster.forecast(&frames[frame].state(), &[problem.interval(frame)]);
        forecast.impacts.into_iter().map(move |impact| FittedImpact { time: start + impact.time, ..impact.into() })
    });
    let impacts = touched.collect();
    let spin = part(best.at(0)?, 2).into();
    let reason = (!explained).then(|| {
        format!("no trajectory that the scene allows explains the labels (the best leaves {rms_px:.2} px rms, or breaks the laws)")
    });
    let speed_sigma = {
        let along = frames[0].velocity.normalize();
        (along.transpose() * covariances[0].fixed_view::<3, 3>(3, 3) * along)[(0, 0)].max(0.0).sqrt()
    };
    let spin_sigma = std::array::from_fn(|axis| match D {
        9 => covariances[0][(6 + axis, 6 + axis)].max(0.0).sqrt(),
        _ => 0.0,
    });
    let flight = Flight {
        start: frames[0].time,
        end: frames[frames.len() - 1].time,
        speed_start: frames[0].speed,
        speed_sigma,
        spin,
        spin_sigma,
        explained,
        reason,
    };
    Some(Fit {
        frames,
        noise_px: problem.sigma,
        rms_px,
        explained,
        impacts,
        flights: vec![flight],
        estimates,
        spin,
        ..Fit::default()
    })
}
