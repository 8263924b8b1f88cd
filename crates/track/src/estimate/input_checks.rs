//! What people get wrong, as hypotheses about the input: the same search with each put right, and the evidence of that.

use nalgebra::Point2;

use super::part::{Outcome, Part};
use crate::observation::Observation as Label;
use gravisight_geometry::camera::Camera;

/// −2 ln of the prior probability of each kind of input error: one in a hundred.
const PRIOR: f64 = 9.2;
/// How far outside the picture a label may be, a fraction of its side.
const OUTSIDE: f64 = 0.05;
/// Ratios of usual resolutions.
const RESOLUTIONS: [f64; 6] = [0.5, 2.0, 1.5, 2.0 / 3.0, 3.0, 1.0 / 3.0];
/// Ratios of usual frame rates, and what slow motion makes of them.
const RATES: [f64; 12] =
    [2.0, 0.5, 4.0, 0.25, 8.0, 0.125, 25.0 / 30.0, 30.0 / 25.0, 50.0 / 60.0, 60.0 / 50.0, 1.5, 2.0 / 3.0];

/// What may be wrong.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Check {
    Mirrored,
    UpsideDown,
    GravityUp,
    Resolution(f64),
    /// So many times as many frames a second.
    Rate(f64),
    /// The apparent sizes are so many times the radius.
    Size(f64),
}

impl Check {
    /// Those that a track is tried with: all where it is doubtful; else, of a single flight, at another
    /// rate and of another size, which would look as well explained.
    fn all(doubtful: bool, single: bool) -> Vec<Self> {
        if !doubtful {
            let rates = [2.0, 0.5, 1.5, 2.0 / 3.0].map(Self::Rate);
            let usual = rates.into_iter().chain([2.0, 0.5].map(Self::Size));
            return usual.filter(|_| single).collect();
        }
        let mut all = vec![Self::Mirrored, Self::UpsideDown, Self::GravityUp];
        all.extend(RESOLUTIONS.map(Self::Resolution));
        all.extend(RATES.map(Self::Rate));
        all.extend([2.0, 0.5].map(Self::Size));
        all
    }

    /// A label as it would be if this is what is wrong.
    fn righted(self, label: &Label, camera: &Camera) -> Label {
        let [right, bottom] = camera.size().xy().map(|side| side - 1.0);
        let image = label.image.map(|at| match self {
            Self::Mirrored => Point2::new(right - at.x, at.y),
            Self::UpsideDown => Point2::new(right - at.x, bottom - at.y),
            Self::GravityUp | Self::Rate(_) | Self::Size(_) => at,
            Self::Resolution(factor) => at.map(|at| (at + 0.5) * factor - 0.5),
        });
        let image = image.filter(|image| camera.camera_from_image(image, 1.0).is_ok());
        let radius = match self {
            Self::Resolution(factor) => label.radius.map(|radius| radius.map(|size| size * factor)),
            Self::Size(factor) => label.radius.map(|radius| radius.map(|size| size / factor)),
            _ => label.radius,
        };
        let time = if let Self::Rate(factor) = self { label.time / factor } else { label.time };
        Label { time, image, radius: radius.filter(|_| image.is_some()) }
    }

    /// What it changes about the labels' densities, −2 ln: those of a smaller picture are nearer to one another.
    fn density_cost(self, labels: &[Label]) -> f64 {
        let count = labels.iter().filter(|label| label.image.is_some()).count() as f64;
        match self {
            Self::Resolution(factor) => -4.0 * count * factor.ln(),
            _ => 0.0,
        }
    }

    /// −2 ln of its prior probability. The ratios of one kind of error divide the prior of that kind.
    fn prior_cost(self) -> f64 {
        let variants = match self {
            Self::Resolution(_) => RESOLUTIONS.len(),
            Self::Rate(_) => RATES.len(),
            Self::Size(_) => 2,
            _ => 1,
        };
        PRIOR + 2.0 * (variants as f64).ln()
    }

    /// Whether it changes anything.
    fn concerns(self, labels: &[Label]) -> bool {
        !matches!(self, Self::Size(_)) || labels.iter().any(|label| label.radius.is_some())
    }

    fn message(self, part: &Part) -> String {
        let labels = part.labels;
        match self {
            Self::Mirrored => {
                "the track fits far better when mirrored: is the video mirrored, or the camera's x axis?".into()
            }
            Self::UpsideDown => "the track fits far better upside down: is the video or the camera upside down?".into(),
            Self::GravityUp => "with this camera the ball falls upwards: does the z axis of its world, or the scene's \
                                gravity, point the wrong way?"
                .into(),
            Self::Resolution(factor) => format!(
                "the track fits far better when {factor:.2} times as large: was it made from a video of \
                 another resolution?"
            ),
            Self::Size(factor) if part.options.sizes_measured => format!(
                "the track fits far better if the ball is {} as large as the scene's: check the ball's radius",
                if factor > 1.0 { "twice" } else { "half" }
            ),
            Self::Size(factor) => format!(
                "the track fits far better if its radii are {factor} times the ball's radius: are they {}?",
                if factor > 1.0 { "diameters" } else { "half the radius" }
            ),
            Self::Rate(factor) => {
                let rate = (labels.len() - 1) as f64 / (labels[labels.len() - 1].time - labels[0].time);
                format!(
                    "the track fits far better at {:.0} frames per second than at {rate:.0}: check the frame rate \
                     (--fps); is it slow motion?",
                    rate * factor
                )
            }
        }
    }
}

fn is_inside(label: &Label, camera: &Camera) -> bool {
    let within = |at: f64, side: f64| (-OUTSIDE * side..(1.0 + OUTSIDE) * side).contains(&at);
    let [width, height] = camera.size().xy();
    label.image.is_none_or(|at| within(at.x, width) && within(at.y, height))
}

/// A message about the most probable input error of a part of a track, if it is more probable than none. `given`: the outcome without
/// correction.
pub fn suspected(part: &Part, given: Option<&Outcome>) -> Option<String> {
    let doubtful = given.is_none_or(Outcome::is_odd);
    let single = given.is_none_or(Outcome::is_alone);
    let limit = given.map_or(f64::INFINITY, |given| given.cost);
    let hits = given.map_or(Some(0), |given| Some(given.fit.hits.len()));
    let tried = |check: Check| {
        let labels: Vec<Label> = part.labels.iter().map(|label| check.righted(label, part.camera)).collect();
        // All labels would be in the picture then.
        let count = |labels: &[Label]| labels.iter().filter(|label| label.image.is_some()).count();
        let lost = count(&labels) < count(part.labels) || !labels.iter().all(|label| is_inside(label, part.camera));
        if lost || !check.concerns(part.labels) {
            return None;
        }
        let limit = limit - check.density_cost(part.labels) - check.prior_cost();
        let found = match check {
            Check::GravityUp => {
                let mut scene = part.forecaster.scene().clone();
                scene.gravity = scene.gravity.map(|g| -g);
                let turned = part.forecaster.in_scene(&scene).ok()?;
                Part { forecaster: &turned, ..*part }.outcome_of(&labels, hits, limit)?
            }
            Check::Resolution(factor) => Part { scale: factor, ..*part }.outcome_of(&labels, hits, limit)?,
            Check::Rate(factor) => Part { clock: factor, ..*part }.outcome_of(&labels, hits, limit)?,
            _ => part.outcome_of(&labels, hits, limit)?,
        };
        // By how much more probable it is; of a part that nothing explains, by itself.
        let cost = found.cost + check.density_cost(part.labels) + check.prior_cost();
        (found.fit.explained && found.cost < limit).then_some((cost, check))
    };
    let found = Check::all(doubtful, single).into_iter().filter_map(tried).min_by(|a, b| a.0.total_cmp(&b.0));
    found.map(|(_, check)| check.message(part))
}
