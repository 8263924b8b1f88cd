//! What a model finds in flights that it did not learn from.

use serde::Serialize;

use super::super::examples::LabelledCrop;
use super::stacks::CutStack;
use crate::localise::Localiser;
use crate::model::DetectionCalibration;
use gravisight_geometry::camera::Outline;
use gravisight_geometry::error::Result;
use gravisight_geometry::image::Picture;

/// Distance from the ball's centre, px, within which it is found; of a larger ball its radius.
const NEAR_PX: f64 = 4.0;
/// Probability from which a ball is reported.
const REPORTED: f64 = 0.5;

/// How well a model does on held-out flights.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify), tsify(missing_as_null))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct AdaptScore {
    /// Frames of held-out flights.
    pub balls: usize,
    /// Of those, frames in which the likeliest detection is the ball.
    pub first: usize,
    /// Of those, frames in which it is also reported.
    pub found: usize,
    /// Frames in which something else is reported.
    pub wrong: usize,
    /// Mean error of the radius as a fraction, where the ball is the likeliest detection and physics tells its distance; so is the error of the
    /// distance of a single picture.
    pub size_error: Option<f64>,
    /// Mean of the fractions of balls and of other things that the motion network takes for the other.
    pub motion_errors: Option<f64>,
}

impl AdaptScore {
    /// As cards hold it, in a browser, too.
    pub(super) fn metrics(&self) -> serde_json::Value {
        let Self { balls, first, found, wrong, size_error, motion_errors } = self;
        serde_json::json!({ "balls": balls, "first": first, "found": found, "wrong": wrong, "size_error": size_error, "motion_errors": motion_errors })
    }

    /// Whether it finds more balls at no more false ones, reported and ranked first together; or as many, with smaller errors of their sizes.
    pub fn finds_better_than(&self, other: &Self) -> bool {
        // A frame that is ranked worse and many more that are reported are a gain.
        let balls = |score: &Self| score.found + score.first;
        let measures_better =
            matches!((self.size_error, other.size_error), (Some(mine), Some(theirs)) if mine < theirs);
        let is_no_worse = self.wrong <= other.wrong && self.found >= other.found;
        is_no_worse && (balls(self) > balls(other) || balls(self) == balls(other) && measures_better)
    }

    /// Whether its motion network errs less.
    pub fn moves_better_than(&self, other: &Self) -> bool {
        matches!((self.motion_errors, other.motion_errors), (Some(mine), Some(theirs)) if mine < theirs)
    }
}

/// A frame to score on.
pub struct Scored {
    pub picture: Picture,
    /// The ball in it, px.
    pub ball: Outline,
    /// Whether its radius follows from the distance that physics finds.
    pub by_physics: bool,
    /// The flight that it is of.
    pub flight: usize,
}

/// Scores `localiser` on whole frames and on stacks.
///
/// # Errors
/// As [`Localiser::localise`].
pub async fn score(localiser: &Localiser, frames: &[&Scored], stacks: &[&CutStack]) -> Result<AdaptScore> {
    let mut score = AdaptScore { balls: frames.len(), ..AdaptScore::default() };
    let mut sizes = vec![];
    for Scored { picture, ball, by_physics, .. } in frames {
        let found = localiser.search(picture, None, None, None, 1, false).await?.detections;
        let Some(found) = found.first() else { continue };
        let is_ball = (ball.centre - found.outline.centre).norm() <= NEAR_PX.max(ball.radius);
        let is_reported = found.confidence >= REPORTED;
        score.first += usize::from(is_ball);
        score.found += usize::from(is_ball && is_reported);
        score.wrong += usize::from(!is_ball && is_reported);
        if is_ball && *by_physics {
            sizes.push((found.outline.radius / ball.radius).ln().abs());
        }
    }
    if !sizes.is_empty() {
        score.size_error = Some(sizes.iter().sum::<f64>() / sizes.len() as f64);
    }
    let mut errors = [[0_usize; 2]; 2];
    for stack in stacks {
        let views = LabelledCrop::of(&stack.record).views;
        let Some(probability) = localiser.moves_as_a_ball(&views).await? else { continue };
        let [wrong, all] = &mut errors[usize::from(stack.is_ball)];
        *wrong += usize::from((probability >= REPORTED) != stack.is_ball);
        *all += 1;
    }
    if errors.iter().all(|[_, all]| *all > 0) {
        score.motion_errors = Some(errors.iter().map(|[wrong, all]| *wrong as f64 / *all as f64).sum::<f64>() / 2.0);
    }
    Ok(score)
}

/// Standard deviation of the bias of the log-odds before anything was seen.
const BIAS_SIGMA: f64 = 2.0;
/// Halvings of the interval that holds the bias: to a thousandth from the 4·10⁵ of 10⁵ candidates.
const HALVINGS: usize = 30;

/// The weights of the confidence of `localiser` with the bias that is likeliest by the candidates in `frames`. A ball that the networks have
/// learned is surer than one that they have not.
///
/// # Errors
/// As [`Localiser::localise`].
pub async fn calibrated(
    localiser: &Localiser,
    calibration: DetectionCalibration,
    frames: &[&Scored],
) -> Result<DetectionCalibration> {
    let mut seen = vec![];
    for Scored { picture, ball, .. } in frames {
        for evidence in localiser.evidence(picture).await? {
            let is_ball = (ball.centre - evidence.outline.centre).norm() <= NEAR_PX.max(ball.radius);
            let probability = evidence.probability(&calibration).clamp(1e-9, 1.0 - 1e-9);
            seen.push(((probability / (1.0 - probability)).ln(), f64::from(u8::from(is_ball))));
        }
    }
    let mut calibration = calibration;
    calibration.ball_log_odds[0] += likeliest_bias(&seen);
    Ok(calibration)
}

/// The likeliest bias of log-odds of which each `is_ball` (1) or not (0), with its prior. The slope of the likelihood falls with the bias, so it is
/// zero once; Newton's steps would jump to and fro across it.
fn likeliest_bias(seen: &[(f64, f64)]) -> f64 {
    let slope = |bias: f64| {
        let probability = |log_odds: f64| 1.0 / (1.0 + (-(log_odds + bias)).exp());
        let of_seen = seen.iter().map(|(log_odds, is_ball)| is_ball - probability(*log_odds));
        of_seen.sum::<f64>() - bias / BIAS_SIGMA.powi(2)
    };
    // One candidate's part of the slope is less than 1.
    let widest = BIAS_SIGMA.powi(2) * seen.len() as f64;
    let (mut low, mut high) = (-widest, widest);
    for _ in 0..HALVINGS {
        let middle = f64::midpoint(low, high);
        if slope(middle) > 0.0 { low = middle } else { high = middle }
    }
    f64::midpoint(low, high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bias_is_where_the_slope_is_zero_however_sure_the_networks_were_of_the_contrary() {
        let seen = |balls: (usize, f64), others: (usize, f64)| {
            let of = |(count, log_odds): (usize, f64), is_ball: f64| vec![(log_odds, is_ball); count];
            [of(balls, 1.0), of(others, 0.0)].concat()
        };
        for (balls, others) in
            [((8, -3.0), (40, -6.0)), ((12, -2.0), (96, -11.0)), ((4, 5.0), (30, 2.0)), ((9, 0.0), (9, 0.0))]
        {
            let seen = seen(balls, others);
            let bias = likeliest_bias(&seen);
            let expected: f64 = seen.iter().map(|(log_odds, _)| 1.0 / (1.0 + (-(log_odds + bias)).exp())).sum();
            assert!((balls.0 as f64 - expected - bias / 4.0).abs() < 1e-3, "{balls:?} {others:?}: {bias}");
        }
        // Balls at −3 among others at −6 are balls at least in half of the cases.
        assert!(likeliest_bias(&seen((8, -3.0), (40, -6.0))) > 2.5);
        assert!(likeliest_bias(&[]).abs() < 1e-9);
    }

    #[test]
    fn balls_that_are_reported_outweigh_a_rank_and_no_false_one() {
        let score = |first, found, wrong, size_error| AdaptScore {
            balls: 8,
            first,
            found,
            wrong,
            size_error,
            motion_errors: None,
        };
        let before = score(7, 0, 0, Some(0.05));
        for better in [score(6, 6, 0, None), score(8, 0, 0, None), score(7, 0, 0, Some(0.04))] {
            assert!(better.finds_better_than(&before), "{better:?}");
        }
        for worse in [score(7, 7, 1, None), score(1, 1, 0, None), score(6, 1, 0, Some(0.06)), before] {
            assert!(!worse.finds_better_than(&before), "{worse:?}");
        }
        assert!(!score(8, 5, 0, None).finds_better_than(&score(6, 6, 0, None)));
    }
}
