//! The verifier, a second-stage classifier: from a candidate's crop and its surroundings, the log-odds that it is a ball. A
//! logistic regression combines them with those of the two passes of the detector.

use std::f64::consts::PI;

use image::RgbImage;
use nalgebra::{Point2, distance};

use super::Localiser;
use super::candidate::{FirstPass, MAX_CANDIDATES, detections_in_crop, is_same_ball};
use super::crop::{Crop, VERIFIER_CROP};
use crate::model::{CONFIDENCE_RADIUS, DetectionCalibration, MOTION_SIDE, PICTURE_CHANNELS};
use gravisight_geometry::camera::{Detection, Outline};
use gravisight_geometry::error::Result;
use gravisight_geometry::image::{Normalisation, Picture};
use gravisight_geometry::size::Size;

/// Probability by the first pass alone from which a candidate gets a second pass. Below it are 34 % of those 2,857 candidates, and none that
/// both passes and the verifier give 0.5 (below 0.05 neither, below 0.1 six): `scripts/fit-weights confidence FOLDER` prints it. Of those bounds
/// this one was chosen on frames of two broadcasts, where larger ones lose balls that are the likeliest detection (`docs/experiments.md`).
const MIN_FIRST_PASS: f64 = 0.005;
/// Cells of the heatmap at which the last feature is 0: those of a picture of 256×256 px.
const REFERENCE_CELLS: f64 = 4096.0;
/// Distance of a ball from the middle of a stack up to which it is the candidate's, px of the stack.
pub(crate) const STACK_REACH: f64 = 5.0;
/// Least probability whose log-odds enter the regression; the largest is as far from 1.
const MIN_PROBABILITY: f64 = 1e-3;

/// The features of the logistic regression that gives a candidate's probability.
#[doc(hidden)]
#[derive(Debug, Clone, Copy)]
pub struct Evidence {
    /// The candidate's outline.
    pub outline: Outline,
    /// The log-odds of the first pass, of the second pass and of the verifier, and the logarithm of the number of cells searched
    /// (over [`REFERENCE_CELLS`]).
    pub features: [f64; 4],
}

impl Evidence {
    /// From the three confidences (first pass, second pass, verifier; 0 to 1 each) and the cells searched.
    pub(super) fn new(outline: Outline, confidences: [f64; 3], cells: usize) -> Self {
        let [first, crop, verifier] = confidences.map(log_odds);
        Self { outline, features: [first, crop, verifier, log_cells(cells)] }
    }

    /// The probability that the candidate is a ball.
    pub fn probability(&self, calibration: &DetectionCalibration) -> f64 {
        logistic(calibration.ball_log_odds, self.features)
    }
}

/// Whether a candidate of this confidence in the first pass over so many cells is likely enough for a second pass.
pub(super) fn is_worth_a_second_pass(calibration: &DetectionCalibration, confidence: f64, cells: usize) -> bool {
    logistic(calibration.first_pass_log_odds, [log_odds(confidence), log_cells(cells)]) >= MIN_FIRST_PASS
}

/// The log-odds of a probability, as the regression takes them.
fn log_odds(probability: f64) -> f64 {
    let probability = probability.clamp(MIN_PROBABILITY, 1.0 - MIN_PROBABILITY);
    (probability / (1.0 - probability)).ln()
}

/// The logarithm of the number of cells searched, as the regression takes it.
fn log_cells(cells: usize) -> f64 {
    (cells.max(1) as f64 / REFERENCE_CELLS).ln()
}

/// The probability of a logistic regression: its bias first, then a weight for each of the features.
fn logistic<const WEIGHTS: usize, const FEATURES: usize>(weights: [f64; WEIGHTS], features: [f64; FEATURES]) -> f64 {
    let sum: f64 = features.iter().zip(&weights[1..]).map(|(value, weight)| weight * value).sum();
    1.0 / (1.0 + (-(weights[0] + sum)).exp())
}

impl Localiser {
    /// The features of the likeliest candidates in a picture, of a model with a verifier: what
    /// [`DetectionCalibration::ball_log_odds`] is fitted to.
    ///
    /// # Errors
    /// As [`Localiser::detect_near`].
    #[doc(hidden)]
    pub async fn evidence(&self, picture: &Picture) -> Result<Vec<Evidence>> {
        let FirstPass { candidates, cells, .. } = self.first_pass(picture, None, MAX_CANDIDATES, false).await?;
        let mut found = vec![];
        for candidate in candidates.iter().take(MAX_CANDIDATES) {
            found.extend(self.evidence_of(picture.rgb(), None, cells, candidate).await?.1);
        }
        Ok(found)
    }

    /// The verifier, where there is one.
    #[cfg(test)]
    pub(crate) fn verifier(&self) -> Option<&Self> {
        self.verifier.as_deref()
    }

    /// The probability that `outline` is a ball's, 0 to 1, by this network, a verifier, alone.
    pub(super) async fn verify(&self, rgb: &RgbImage, outline: &Outline) -> Result<f64> {
        let crop = Crop::around(outline, outline.radius, rgb, VERIFIER_CROP);
        let found = self.verifier_detections(&crop.with_surroundings(rgb)).await?;
        let outline = crop.crop_from_picture(outline);
        Ok(Self::ball_probability(&found, &outline, outline.radius))
    }

    /// The probability of the ball of `outline`, at most `reach` px away, by what a verifier detected.
    pub(crate) fn ball_probability(found: &[Detection], outline: &Outline, reach: f64) -> f64 {
        let found = found.iter().find(|detection| is_same_ball(detection, outline, reach));
        // A flat heatmap has this fraction of its mass around any point.
        let chance = PI * CONFIDENCE_RADIUS.powi(2) / f64::from(VERIFIER_CROP.side).powi(2);
        found.map_or(0.0, |found| ((found.confidence - chance) / (1.0 - chance)).max(0.0))
    }

    /// The probability that a ball is in the middle of a stack of frames, 0 to 1, by the motion network; none where there is none.
    ///
    /// # Errors
    /// [`Error::OutputNotFinite`](gravisight_geometry::error::Error::OutputNotFinite) and [`Error::Device`](gravisight_geometry::error::Error::Device).
    pub(crate) async fn moves_as_a_ball(&self, pictures: &[RgbImage; 2]) -> Result<Option<f64>> {
        let Some(motion) = &self.motion else { return Ok(None) };
        Ok(Some(Self::probability_in_stack(&motion.verifier_detections(pictures).await?)))
    }

    /// The probability of a ball in the middle of a stack by what the motion network detected.
    pub(crate) fn probability_in_stack(found: &[Detection]) -> f64 {
        let middle = Point2::from([f64::from(MOTION_SIDE - 1) / 2.0; 2]);
        let found = found.iter().filter(|detection| distance(&detection.outline.centre, &middle) < STACK_REACH);
        found.map(|detection| detection.confidence).fold(0.0, f64::max)
    }

    /// The balls that this network, a verifier, detects in a crop (the first of `views`; the second shows its surroundings), px of
    /// the crop.
    pub(crate) async fn verifier_detections(&self, views: &[RgbImage; 2]) -> Result<Vec<Detection>> {
        let count = self.config.input_channels() / PICTURE_CHANNELS;
        let size = Size::new(views[0].width(), views[0].height());
        let maps = self.output_maps_of(stacked(&views[..count], &self.card.normalisation), size).await?;
        Ok(detections_in_crop(&maps))
    }
}

/// Pictures of one size as a network's input, `[height, width, 3 · pictures]`, normalised.
pub(crate) fn stacked(pictures: &[RgbImage], Normalisation { mean, std }: &Normalisation) -> Vec<f32> {
    let count = pictures.first().map_or(0, |first| first.as_raw().len() / PICTURE_CHANNELS);
    let mut values = Vec::with_capacity(PICTURE_CHANNELS * pictures.len() * count);
    for pixel in 0..count {
        for picture in pictures {
            let pixel = &picture.as_raw()[PICTURE_CHANNELS * pixel..][..PICTURE_CHANNELS];
            values.extend((0..PICTURE_CHANNELS).map(|at| (f32::from(pixel[at]) / 255.0 - mean[at]) / std[at]));
        }
    }
    values
}
