//! What a fit finds. The command's JSON, the library and (in camelCase) the npm package have these very fields.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Point3, Vector2, Vector3};
use serde::{Serialize, Serializer};

use crate::config::{EstimatorConfig, Parameter};
use gravisight_geometry::camera::Camera;
use gravisight_physics::{Impact, Scene, State, Surface};

/// By how much times that are one may differ, s: rounding.
const SAME_TIME: f64 = 1e-9;
/// Probability from which what was tracked is the ball surely enough for its flight to be told as explained: chosen, not fitted. On simulated
/// footage with much that looks like a ball two in three detections are right at 0.8 to 0.9, and nearly nine in ten at 0.9 to 0.95.
const SURELY_BALL: f64 = 0.9;

/// The trajectory that physics allows and a 2D track's labels explain: what [`Forecaster::fit`](gravisight_physics::Forecaster::fit) finds.
///
/// By [`Forecaster::fit`](gravisight_physics::Forecaster::fit):
///
/// ```
/// # mod gravisight {
/// # pub use gravisight_geometry::{camera, camera::*, error::*, image::*, size::*};
/// # pub use gravisight_physics::*;
/// # pub use gravisight_track::{self as track, findings::*, *};
/// # }
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
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify), tsify(missing_as_null, hashmap_as_object))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct Fit {
    /// One a frame of the track, seen or not.
    pub frames: Vec<FittedFrame>,
    /// From hit to hit, bounces between.
    pub flights: Vec<Flight>,
    /// Where something that the scene does not hold changes the ball's path.
    pub hits: Vec<Hit>,
    /// Where the ball touches something of the scene, by time.
    pub impacts: Vec<FittedImpact>,
    /// Drag, where there is air, and restitution, where the ball bounces: the scene's own, as far as the track says no more.
    #[cfg_attr(target_arch = "wasm32", tsify(type = "Partial<Record<Parameter, Estimate>>"))]
    pub estimates: BTreeMap<Parameter, Estimate>,
    /// Spin at the first frame along the world's axes, rad/s: the scene's, or the one found.
    pub spin: [f64; 3],
    /// Standard deviation of the labels, px: given, or found.
    pub noise_px: f64,
    /// Root mean square residual of the labels that are no outliers, px.
    pub rms_px: f64,
    /// Whether every flight is explained: its trajectory explains its labels to about their noise, keeps the laws and is known. If not, a
    /// force is unknown, the scene or the camera is wrong, nothing tells the distance, or the right trajectory was not found.
    pub explained: bool,
    /// What to think of it, in a sentence.
    pub verdict: String,
    /// What is odd about the track, in words.
    pub notes: Vec<String>,
    /// How probable it is among what else was found.
    pub summary: FitSummary,
    /// The numbers that it was judged by.
    pub config: EstimatorConfig,
}

/// How probable a fit is.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct FitSummary {
    /// ln of the evidence: of the density (px⁻² a label) of the labels, given that there are these contacts, hits and lost frames. To be
    /// compared between fits of the same labels.
    pub log_evidence: f64,
    /// Structures (which contacts, hits and lost frames there are) that count, and the probability of the one that is told among them.
    pub structures: u32,
    /// See `structures`.
    pub probability: f64,
}

/// The fitted ball at one frame.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify), tsify(missing_as_null))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct FittedFrame {
    /// The frame's number: its index in the track, or the number that the track's file gives it.
    pub frame: usize,
    /// When it was taken, s.
    pub time: f64,
    /// The ball's centre in the world, m.
    pub world: Point3<f64>,
    /// Its velocity in the world, m/s.
    pub velocity: Vector3<f64>,
    /// The velocity's size, m/s.
    pub speed: f64,
    /// Its spin along the world's axes, rad/s.
    pub spin: Vector3<f64>,
    /// Root mean square error of the position to expect, m: the root of the covariance's trace.
    pub sigma: f64,
    /// Covariance of the position, m², by row: the labels' noise and the laws' own uncertainty, and the spread of other trajectories that
    /// explain the track nearly as well.
    #[serde(serialize_with = "by_row")]
    pub covariance: Matrix3<f64>,
    /// Projection minus label, px; null where the ball was not seen.
    pub residual_px: Option<Vector2<f64>>,
    /// Whether the label does not belong to the trajectory.
    pub outlier: bool,
    /// Index of the flight that it belongs to.
    pub flight: usize,
    /// Whether that flight is explained; where it is not, the position is not known.
    pub explained: bool,
    /// Why the label was left out, in words: an outlier without residual. Null where it was used, or there is none.
    pub refused: Option<String>,
}

/// A part of a trajectory in which only the scene acts on the ball.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify), tsify(missing_as_null))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct Flight {
    /// When it begins, s.
    pub start: f64,
    /// When it ends, s.
    pub end: f64,
    /// Speed at its start, m/s.
    pub speed_start: f64,
    /// Standard deviation of that, m/s.
    pub speed_sigma: f64,
    /// Spin at its start along the world's axes, rad/s.
    pub spin: [f64; 3],
    /// Standard deviation of each component of the spin, rad/s.
    pub spin_sigma: [f64; 3],
    /// Whether its trajectory explains its labels to about their noise, and is known.
    pub explained: bool,
    /// Why not, in words; null where it is explained.
    pub reason: Option<String>,
}

/// A hit of a racket, a foot, a hand: the ball's path changes and the scene has nothing there.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct Hit {
    /// s.
    pub time: f64,
    /// Number of the first frame after it.
    pub frame: usize,
    /// The ball's centre in the world, m.
    pub world: Point3<f64>,
    /// Whether the flights that it ends and begins are explained; where not, its place is not known.
    pub explained: bool,
}

/// Where the ball touches something of the scene.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify), tsify(missing_as_null))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct FittedImpact {
    /// s.
    pub time: f64,
    /// What it touches, as the scene names it.
    pub surface: Surface,
    /// The ball's centre in the world, m.
    pub world: Point3<f64>,
    /// Speed at which it approaches, m/s.
    pub speed: f64,
    /// Root mean square error of the ball's position to expect in the frame next to it, m.
    pub sigma: f64,
    /// Probability that it is within the scene's outermost lines; null where those go round nothing.
    pub within_lines: Option<f64>,
    /// Whether the flight that it belongs to is explained; where not, its place is not known.
    pub explained: bool,
}

/// A number of the scene that was estimated.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
pub struct Estimate {
    /// Its value, in the scene's unit.
    pub value: f64,
    /// Its standard deviation.
    pub sigma: f64,
}

fn by_row<S: Serializer>(matrix: &Matrix3<f64>, serializer: S) -> Result<S::Ok, S::Error> {
    <[[f64; 3]; 3]>::from(matrix.transpose()).serialize(serializer)
}

impl FittedFrame {
    /// The ball in `state` at a time (s), its position known to a covariance, m².
    pub(crate) fn new(time: f64, state: State, covariance: Matrix3<f64>) -> Self {
        let State { position: world, velocity, spin } = state;
        let mut frame = Self { time, world, velocity, speed: velocity.norm(), spin, ..Self::default() };
        frame.spread(&covariance);
        frame
    }

    /// Adds to the position's covariance, m².
    pub(crate) fn spread(&mut self, by: &Matrix3<f64>) {
        self.covariance += by;
        self.sigma = self.covariance.trace().max(0.0).sqrt();
    }

    /// Position, velocity and spin in the world.
    pub fn state(&self) -> State {
        State { position: self.world, velocity: self.velocity, spin: self.spin }
    }
}

impl From<Impact> for FittedImpact {
    fn from(Impact { time, surface, world, speed, .. }: Impact) -> Self {
        Self { time, surface, world, speed, sigma: f64::INFINITY, within_lines: None, explained: false }
    }
}

impl Flight {
    /// Speed at its start and its standard deviation, m/s; none where they are not known: it is not explained, or may as well
    /// stand still.
    pub fn known_speed(&self) -> Option<[f64; 2]> {
        (self.explained && self.speed_sigma < self.speed_start).then_some([self.speed_start, self.speed_sigma])
    }
}

impl Fit {
    /// 1-σ (m) of the positions that are known, ascending: those of explained flights, as far as σ is below the distance from the
    /// `camera` that saw them.
    pub fn known_sigmas(&self, camera: &Camera) -> Vec<f64> {
        let distance = |frame: &FittedFrame| camera.camera_from_world(&frame.world).coords.norm();
        let known = self.frames.iter().filter(|frame| frame.explained && frame.sigma < distance(frame));
        let mut sigmas: Vec<f64> = known.map(|frame| frame.sigma).collect();
        sigmas.sort_by(f64::total_cmp);
        sigmas
    }

    /// Numbers frames and hits as the track's own file does: `numbers`, one a frame.
    #[must_use]
    pub fn numbered(mut self, numbers: &[u64]) -> Self {
        self.frames.iter_mut().zip(numbers).for_each(|(frame, &number)| frame.frame = number as usize);
        for hit in &mut self.hits {
            hit.frame = self.frames.get(hit.frame).or(self.frames.last()).map_or(hit.frame, |after| after.frame);
        }
        self
    }

    /// Fills in what follows from the rest: the frames' numbers, what belongs to an explained flight, how well contacts are known, and
    /// the verdict.
    pub(super) fn concluded(mut self, scene: &Scene) -> Self {
        for (index, frame) in self.frames.iter_mut().enumerate() {
            frame.frame = index;
            frame.explained = self.flights.get(frame.flight).is_some_and(|flight| flight.explained);
        }
        let (mut impacts, mut hits) = (std::mem::take(&mut self.impacts), std::mem::take(&mut self.hits));
        hits.iter_mut().for_each(|hit| hit.explained = self.is_explained_at(hit.time));
        for impact in &mut impacts {
            impact.explained = self.is_explained_at(impact.time);
            if let Some(near) = self.near(impact.time) {
                impact.sigma = near.sigma;
                impact.within_lines = scene.within_lines(&impact.world, &near.covariance);
            }
        }
        (self.impacts, self.hits) = (impacts, hits);
        self.verdict = self.verdict_text();
        self
    }

    /// The same of labels that are the ball's with a probability each (0 where there is none): a flight none of whose labels is the ball's as
    /// surely as [`SURELY_BALL`] is not explained, for the laws may as well explain another thing. Of one that has some, the laws speak for
    /// the others.
    pub(crate) fn doubted(mut self, probabilities: &[f64], scene: &Scene) -> Self {
        let mut surest = vec![0.0_f64; self.flights.len()];
        for (frame, &probability) in self.frames.iter().zip(probabilities) {
            if let Some(surest) = surest.get_mut(frame.flight).filter(|_| !frame.outlier) {
                *surest = surest.max(probability);
            }
        }
        for (flight, probability) in self.flights.iter_mut().zip(surest) {
            if flight.explained && probability < SURELY_BALL {
                flight.explained = false;
                flight.reason = Some(format!(
                    "the tracked object is the ball with a probability of only {:.0} %",
                    100.0 * probability
                ));
            }
        }
        self.explained = Self::all_explained(&self.flights);
        self.concluded(scene)
    }

    /// Whether there are flights, and each is explained.
    pub(crate) fn all_explained(flights: &[Flight]) -> bool {
        !flights.is_empty() && flights.iter().all(|flight| flight.explained)
    }

    /// Whether what happens at a time (s) belongs to explained flights alone; of a hit both count, the flight that it ends and
    /// the one that it begins.
    fn is_explained_at(&self, time: f64) -> bool {
        let mut own =
            self.flights.iter().filter(|it| (it.start - SAME_TIME..=it.end + SAME_TIME).contains(&time)).peekable();
        match own.peek() {
            Some(_) => own.all(|flight| flight.explained),
            None => self.near(time).is_some_and(|frame| frame.explained),
        }
    }

    /// The frame next to a time, s.
    fn near(&self, time: f64) -> Option<&FittedFrame> {
        self.frames.iter().min_by(|a, b| (a.time - time).abs().total_cmp(&(b.time - time).abs()))
    }

    /// The verdict, in one sentence.
    fn verdict_text(&self) -> String {
        let count = |number: usize, what: &str| format!("{number} {what}{}", if number == 1 { "" } else { "s" });
        let parts =
            [count(self.flights.len(), "flight"), count(self.hits.len(), "hit"), count(self.impacts.len(), "bounce")]
                .join(", ");
        let wrong = self.flights.iter().enumerate().filter_map(|(index, flight)| {
            Some(format!("flight {} is not explained: {}", index + 1, flight.reason.as_ref()?))
        });
        let wrong: Vec<String> = wrong.collect();
        match wrong.is_empty() {
            true => format!("explained: {parts}"),
            false if wrong.len() == self.flights.len() && wrong.len() == 1 => {
                format!("not explained: {}", self.flights[0].reason.as_deref().unwrap_or_default())
            }
            false => format!("not all explained: {parts}; {}", wrong.join("; ")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_laws_may_as_well_explain_what_is_hardly_the_ball() {
        let flight = |start: f64| Flight { start, end: start + 1.0, explained: true, ..Flight::default() };
        let frame =
            |index: usize| FittedFrame { time: 0.5 * index as f64, flight: index / 2, ..FittedFrame::default() };
        let fit = Fit {
            flights: vec![flight(0.0), flight(1.0)],
            frames: (0..4).map(frame).collect(),
            explained: true,
            ..Fit::default()
        };
        let scene = Scene::new([0.0, 0.0, -9.81], 0.1);
        let sure = fit.clone().doubted(&[0.99, 0.85, 0.0, 0.95], &scene);
        assert!(sure.explained && sure.frames.iter().all(|frame| frame.explained));
        let doubtful = fit.doubted(&[0.7, 0.8, 0.0, 0.95], &scene);
        assert_eq!(doubtful.frames.iter().map(|frame| frame.explained).collect::<Vec<_>>(), [false, false, true, true]);
        assert!(!doubtful.explained);
        assert!(doubtful.verdict.contains("with a probability of only 80 %"), "{}", doubtful.verdict);
    }
}
