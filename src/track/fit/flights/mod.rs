//! Flights of a ball whose spin nobody knows, between contacts whose place the scene knows and hits that it does not.
//!
//! Gravity alone does not tell how far away such a ball is: its spin is worth a third of it. A contact does: there the ball's
//! ray meets the surface at one radius. So the track's change points ([`change_points`]) are tried as contacts with whatever they can be, and
//! as hits ([`search`]); a [`course`] of a few numbers a flight is refined against all that is known ([`task`]).

mod clock;
mod course;
mod motion;
mod parts;
mod rays;
mod refine;
mod result;
mod search;
mod suspects;
mod task;
mod whole;

use nalgebra::{Point2, Point3};

pub use self::motion::Laws;
pub use self::parts::fitted;
use self::search::searched;
use self::task::{Priors, Task};
use super::labels::{SMALLEST_NOISE, noise_of, trusted};
use super::{Fit, FitOptions, Observation, unexplained};
use crate::camera::{Camera, Outline};
use crate::error::{Error, Result};
use crate::physics::{Contact, Forecaster, Obstacle, Scene};
use crate::track::estimate::change_points::{CLEAR, FAINT, change_points};

/// Error of labels that differs little from frame to frame, px.
const SLOW_NOISE: f64 = 0.5;
/// Where the scene does not say more: speed of the ball's surface by a spin of one standard deviation, m/s; standard
/// deviations of drag, lift and gravity (which stands for the clock's rate and the scene's size), shares; of a bounce's normal and tangential speed, shares of the closing speed.
const SPIN_SPEED: f64 = 4.0;
const DRAG: f64 = 0.15;
const LIFT: f64 = 0.1;
const GRAVITY: f64 = 0.01;
const RESTITUTION: f64 = 0.07;
const FRICTION: f64 = 0.2;

/// The laws of a scene whose flights are found here: its ball's spin matters and is not known.
pub fn laws(scene: &Scene) -> Option<Laws> {
    let laws = Laws::of(scene)?;
    let matters = laws.lift() != 0.0 || laws.rigid.friction > 0.0;
    (matters && scene.ball.spin == [0.0; 3]).then_some(laws)
}

impl Priors {
    fn of(scene: &Scene) -> Self {
        let ball = &scene.ball;
        let (restitution, friction) = match scene.contact {
            Contact::Bounce { restitution_sigma, friction_sigma, .. } => (restitution_sigma, friction_sigma),
            _ => (None, None),
        };
        Self {
            spin: ball.spin_sigma.unwrap_or(SPIN_SPEED / ball.radius),
            forces: [ball.drag_sigma.unwrap_or(DRAG), LIFT, GRAVITY],
            restitution: restitution.unwrap_or(RESTITUTION),
            friction: friction.unwrap_or(FRICTION),
        }
    }
}

/// The flights that explain the observations of a window best.
fn fitted_window(
    forecaster: &Forecaster,
    laws: &Laws,
    camera: &Camera,
    observations: &[Observation],
    options: &FitOptions,
) -> Result<Solved> {
    let solved = solve(forecaster, laws, camera, observations, options, f64::INFINITY);
    let odd = solved.as_ref().is_none_or(|Solved { fit, doubtful, .. }| {
        *doubtful || !fit.hits.is_empty() && fit.hits.len() >= fit.impacts.len()
    });
    let suspected = odd.then(|| suspects::suspected(forecaster, laws, camera, observations, options, solved.as_ref()));
    let suspected = suspected.flatten();
    let Some(mut solved) = solved else {
        return Err(suspected.map_or_else(unexplained, |reason| Error::Fit { reason }));
    };
    if let Some(reason) = suspected {
        let fit = &mut solved.fit;
        fit.explained = false;
        for flight in &mut fit.flights {
            (flight.explained, flight.reason) = (false, Some(reason.clone()));
        }
        fit.frames.iter_mut().for_each(|frame| result::widen(camera, frame));
    }
    Ok(solved)
}

/// What the search makes of a window.
struct Solved {
    /// Its notes and estimates are those of `notes`, `drag` and `rebounds`.
    fit: Fit,
    notes: Vec<Note>,
    /// Logarithm of the drag over the scene's: mean and variance.
    drag: [f64; 2],
    rebounds: Vec<Rebound>,
    /// Of its course, in squared standard deviations.
    cost: f64,
    /// The same with another gravity, where that is far less.
    gravity: Option<f64>,
    /// Whether labels or laws do not fit; not merely that the distance is unknown.
    doubtful: bool,
}

/// What is odd about a track.
#[derive(Clone)]
struct Note {
    /// When, s; of something that lasts none.
    time: Option<f64>,
    words: String,
}

/// A bounce that says what the restitution is.
#[derive(Clone, Copy)]
struct Rebound {
    /// s.
    time: f64,
    restitution: f64,
    variance: f64,
}

/// The flights that explain the observations of a window best; none where that costs more than `limit`, or nothing does.
fn solve(
    forecaster: &Forecaster,
    laws: &Laws,
    camera: &Camera,
    observations: &[Observation],
    options: &FitOptions,
    limit: f64,
) -> Option<Solved> {
    let trusted = trusted(observations);
    let noise = options.noise_px.unwrap_or_else(|| noise_of(&trusted)).max(SMALLEST_NOISE);
    let sigma = noise.hypot(SLOW_NOISE);
    let obstacles = Obstacle::of(forecaster.scene());
    let radius = laws.rigid.radius;
    let depth = |seen: &Observation| {
        let [size, deviation] = seen.radius.filter(|[size, _]| *size > 0.0)?;
        let depth = camera.ball_from_outline(&Outline { centre: seen.image?, radius: size }, radius).ok()?.z;
        Some([depth, depth * deviation / size])
    };
    let times: Vec<f64> = observations.iter().map(|seen| seen.time).collect();
    let mut gaps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    gaps.sort_by(f64::total_cmp);
    let interval = gaps[gaps.len() / 2];
    let seen: Vec<(usize, Point2<f64>)> =
        trusted.iter().enumerate().filter_map(|(frame, it)| Some((frame, it.image?))).collect();
    let labels: Vec<(f64, Point2<f64>)> = seen.iter().map(|&(frame, at)| (times[frame], at)).collect();
    let slips = if options.times_known { vec![] } else { clock::slips(&labels, interval, sigma) };
    let task = Task {
        laws: laws.clone(),
        obstacles: &obstacles,
        camera,
        eye: camera.world_from_camera(&Point3::origin()).coords,
        observations: &trusted,
        slips: slips.iter().map(|slip| (seen[slip.label].0, slip.frames * interval)).collect(),
        interval,
        times,
        depths: observations.iter().map(depth).collect(),
        sigma,
        priors: Priors::of(forecaster.scene()),
    };
    let slipped = search::slipped(&task);
    let labels: Vec<(f64, Point2<f64>)> = seen.iter().map(|&(frame, at)| (slipped[frame], at)).collect();
    let found = searched(&task, [CLEAR, FAINT].map(|price| change_points(&labels, sigma, price)), options.hits, limit);
    // In the end all labels count, and the loss lets go of outliers.
    result::fit_of(&Task { observations, ..task }, &found, noise, &options.cameras)
}
