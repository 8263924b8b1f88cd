//! What may be wrong with a track or its scene that the laws explain badly, or only with hits: the same search with what
//! people get wrong put right.

use nalgebra::Point2;

use super::course::Course;
use super::motion::Laws;
use super::result::largest_strain;
use super::search::FINAL;
use super::task::Task;
use super::{Solved, solve};
use crate::camera::Camera;
use crate::physics::Forecaster;
use crate::track::fit::{FEWEST, FitOptions, Observation};

/// By how much what is put right must lower the cost to be told, in squared standard deviations.
const GAIN: f64 = 20.0;
/// By how much gravity left free must, the share of [`super::result::largest_strain`] from which it is tried, and the
/// least change of it that is told.
const GRAVITY_GAIN: f64 = 7.0;
const STRAINED: f64 = 0.35;
const GRAVITY_OFF: f64 = 0.1;
/// How free.
const FREE: f64 = 3.0;
/// Ratios of usual resolutions.
const RESOLUTIONS: [f64; 6] = [0.5, 2.0, 1.5, 2.0 / 3.0, 3.0, 1.0 / 3.0];

/// What people get wrong.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Suspect {
    Mirrored,
    Turned,
    GravityUp,
    Resolution(f64),
}

impl Suspect {
    fn all() -> impl Iterator<Item = Self> {
        [Self::Mirrored, Self::Turned, Self::GravityUp].into_iter().chain(RESOLUTIONS.map(Self::Resolution))
    }

    /// Where a label belongs if this is what is wrong.
    fn righted(self, label: Point2<f64>, camera: &Camera) -> Point2<f64> {
        let [right, bottom] = camera.size().xy().map(|side| side - 1.0);
        match self {
            Self::Mirrored => Point2::new(right - label.x, label.y),
            Self::Turned => Point2::new(right - label.x, bottom - label.y),
            Self::GravityUp => label,
            Self::Resolution(factor) => label.map(|at| (at + 0.5) * factor - 0.5),
        }
    }

    /// How many times as large it makes the picture.
    fn scale(self) -> f64 {
        if let Self::Resolution(factor) = self { factor } else { 1.0 }
    }

    fn words(self) -> String {
        match self {
            Self::Mirrored => {
                "a mirrored track would be explained far better: is the video mirrored, or the camera's x axis?".into()
            }
            Self::Turned => "a track turned upside down would be explained far better: is the video or the camera \
                             upside down?"
                .into(),
            Self::GravityUp => {
                "the ball falls upwards by this camera: does its world's z axis, or the scene's gravity, \
                                point the wrong way?"
                    .into()
            }
            Self::Resolution(factor) => format!(
                "a track {factor:.2} times as large would be explained far better: is it of a video in another \
                 resolution than the camera's?"
            ),
        }
    }
}

/// What is put right where it explains so much more than `given` (the track as it is) that it must be told, in words.
pub fn suspected(
    forecaster: &Forecaster,
    laws: &Laws,
    camera: &Camera,
    observations: &[Observation],
    options: &FitOptions,
    given: Option<&Solved>,
) -> Option<String> {
    let hits = given.map_or(0, |given| given.fit.hits.len());
    let doubtful = given.is_none_or(|given| given.doubtful);
    // Another gravity is the simpler explanation, if it is as good.
    let by_gravity = given.and_then(|given| given.gravity).unwrap_or(f64::INFINITY);
    let limit = given.map_or(f64::INFINITY, |given| given.cost.min(by_gravity) - GAIN);
    let tried = |suspect: Suspect| {
        // A track that is explained may at most be mirrored: its bounces would look like hits.
        if !doubtful && suspect != Suspect::Mirrored {
            return None;
        }
        let righted = |seen: &Observation| {
            let image = seen.image.map(|label| suspect.righted(label, camera));
            let image = image.filter(|image| camera.camera_from_image(image, 1.0).is_ok());
            let radius = seen.radius.map(|radius| radius.map(|size| size * suspect.scale()));
            Observation { image, radius, ..*seen }
        };
        let observations: Vec<Observation> = observations.iter().map(righted).collect();
        // The lens may reach few of the labels there.
        if observations.iter().filter(|seen| seen.image.is_some()).count() < FEWEST {
            return None;
        }
        let laws = if suspect == Suspect::GravityUp { laws.turned() } else { laws.clone() };
        let options = FitOptions { hits: Some(hits.saturating_sub(1)), ..options.clone() };
        let found = solve(forecaster, &laws, camera, &observations, &options, limit)?;
        (found.fit.explained && found.cost < limit).then_some((found.cost, suspect))
    };
    let found = Suspect::all().filter_map(tried).min_by(|a, b| a.0.total_cmp(&b.0));
    found.map(|(_, suspect)| suspect.words())
}

/// What gravity seems to be if that explains a course of `cost` far better, in words, and the cost then.
pub fn gravity(task: &Task, course: &Course, cost: f64) -> Option<(String, f64)> {
    let (freed, less) = task.with_gravity(FREE).refined(course, FINAL, 30)?;
    let share = 1.0 + freed.off[2];
    if cost - less < GRAVITY_GAIN || freed.off[2].abs() < GRAVITY_OFF {
        return None;
    }
    let rate = task.interval.recip();
    let words = match share > 0.1 {
        true => format!(
            "gravity would have to be {share:.2} times the scene's: are these {:.0} instead of {rate:.0} frames a second, \
             or are the scene's heights, or the camera, off?",
            rate / share.sqrt()
        ),
        false => "gravity would have to be none, or point the other way: check the scene's gravity and the camera's \
                  world axes"
            .into(),
    };
    Some((words, less))
}

/// Whether a strain is enough to look for what is wrong.
pub fn is_strained((strain, numbers): (f64, usize)) -> bool {
    strain > STRAINED * largest_strain(numbers)
}
