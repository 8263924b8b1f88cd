//! The trajectory estimator: from rays to flights between contacts whose place the scene knows and hits that it does not.
//!
//! Gravity alone does not tell how far away a ball of unknown spin is: its spin is worth a third of it. A contact does: there the
//! ball's ray meets the surface at one radius. So a [`trajectory`] is a list of segments, each with its state where it begins, tied by
//! continuity and, at contacts, by the contact's law. All that is known is a residual of one least-squares problem ([`model`], [`normal`],
//! [`solve`]): labels with a mixture of noise, rough labels and strays, whose scale is estimated along; apparent sizes; obstacles;
//! priors. Which contacts, hits and lost frames there are is a hypothesis; hypotheses are found by [`search`] and compared by their
//! evidence (Laplace's approximation; Kass and Raftery 1995, "Bayes factors").

mod change_points;
mod changes;
mod drops;
mod followed;
mod grow;
mod input_checks;
mod lasting;
mod links;
mod model;
mod net;
mod normal;
mod observation;
mod parameters;
mod part;
mod profile;
mod rays;
mod result;
mod search;
mod solve;
mod trajectory;

use std::ops::Range;

pub(super) use self::change_points::{CLEAR, MOST as MOST_POWER, PolynomialPiece};
use self::part::Part;
use crate::config::FitOptions;
use crate::observation::Observation as Label;
use crate::result::{Fit, FitSummary, FittedFrame, Flight, Hit};
use gravisight_geometry::camera::Camera;
use gravisight_geometry::error::{Error, Result};
use gravisight_physics::Forecaster;

/// Time without a label after which a track begins anew, s: what happens then says nothing about what was before.
const PAUSE: f64 = 0.6;
/// Fewest labels between two pauses.
const SHORTEST: usize = 6;
/// Longer than any ball is in the air between two labels, s: 100 m/s straight up, without air, come back after 20.
const LONGEST_FLIGHT: f64 = 60.0;

/// The flights that explain the labels best.
///
/// # Errors
/// [`Error::Fit`] for a track that nothing explains.
pub fn estimated(forecaster: &Forecaster, camera: &Camera, labels: &[Label], options: &FitOptions) -> Result<Fit> {
    let mut fits = vec![];
    let mut hits = options.hits;
    for range in parts(labels) {
        check_gaps(&labels[range.clone()])?;
        let options = FitOptions { hits, ..options.clone() };
        let part = Part { forecaster, camera, labels: &labels[range], options: &options, scale: 1.0, clock: 1.0 };
        let fit = part.fit()?;
        hits = hits.map(|most| most.saturating_sub(fit.hits.len()));
        fits.push(fit);
    }
    Ok(joined(forecaster, fits))
}

/// Ranges of frames between pauses.
fn parts(labels: &[Label]) -> Vec<Range<usize>> {
    let seen: Vec<usize> = (0..labels.len()).filter(|&frame| labels[frame].image.is_some()).collect();
    let (mut starts, mut count) = (vec![0], 1);
    for (index, pair) in seen.windows(2).enumerate() {
        let pause = labels[pair[1]].time - labels[pair[0]].time > PAUSE;
        let left = seen.len() - index - 1;
        if pause && count >= SHORTEST && left >= SHORTEST {
            starts.push(pair[1]);
            count = 0;
        }
        count += 1;
    }
    let ends = starts[1..].iter().copied().chain([labels.len()]);
    starts.iter().zip(ends).map(|(&start, end)| start..end).collect()
}

/// Refuses a part whose labels no flight connects, and that are too few to be two parts.
fn check_gaps(labels: &[Label]) -> Result<()> {
    let seen: Vec<f64> = labels.iter().filter(|label| label.image.is_some()).map(|label| label.time).collect();
    let Some(gap) = seen.windows(2).find(|pair| pair[1] - pair[0] > LONGEST_FLIGHT) else { return Ok(()) };
    let reason = format!(
        "the label after {:.3} s is over {LONGEST_FLIGHT:.0} s later, longer than any flight: are the times in seconds? \
         If so, remove the labels on the side of the gap that has fewer than {SHORTEST}",
        gap[0]
    );
    Err(Error::Fit { reason })
}

/// One result of the parts of a track.
fn joined(forecaster: &Forecaster, mut fits: Vec<Fit>) -> Fit {
    let estimates: Vec<_> = fits.iter().map(|fit| fit.estimates.clone()).collect();
    let mut whole = fits.remove(0);
    if fits.is_empty() {
        return whole;
    }
    whole.estimates = parameters::combined(forecaster, &estimates);
    let labels = |fit: &Fit| fit.frames.iter().filter(|frame| frame.residual_px.is_some()).count() as f64;
    for fit in fits {
        let (flights, frames) = (whole.flights.len(), whole.frames.len());
        let (before, own) = (labels(&whole), labels(&fit));
        let mean = |a: f64, b: f64| ((before * a * a + own * b * b) / (before + own).max(1.0)).sqrt();
        whole.noise_px = mean(whole.noise_px, fit.noise_px);
        whole.rms_px = mean(whole.rms_px, fit.rms_px);
        whole.frames.extend(fit.frames.into_iter().map(|it| FittedFrame { flight: flights + it.flight, ..it }));
        whole.flights.extend::<Vec<Flight>>(fit.flights);
        whole.hits.extend(fit.hits.iter().map(|hit| Hit { frame: frames + hit.frame, ..*hit }));
        whole.impacts.extend(fit.impacts);
        whole.explained &= fit.explained;
        whole.summary = FitSummary {
            log_evidence: whole.summary.log_evidence + fit.summary.log_evidence,
            // There are more than a number holds of a long track.
            structures: whole.summary.structures.saturating_mul(fit.summary.structures),
            probability: whole.summary.probability * fit.summary.probability,
        };
        let new: Vec<String> = fit.notes.into_iter().filter(|note| !whole.notes.contains(note)).collect();
        whole.notes.extend(new);
    }
    whole
}

#[cfg(test)]
mod tests {
    use super::*;
    use gravisight_physics::Scene;

    #[test]
    fn a_long_track_has_more_structures_than_a_number_holds() {
        let forecaster = Forecaster::new(&Scene::new([0.0, 0.0, -9.81], 0.02)).unwrap();
        let summary = FitSummary { structures: 8, probability: 0.5, log_evidence: -10.0 };
        let parts = vec![Fit { summary, explained: true, ..Fit::default() }; 100];
        let whole = joined(&forecaster, parts);
        assert_eq!(whole.summary.structures, u32::MAX);
    }
}
