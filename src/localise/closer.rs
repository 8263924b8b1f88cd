//! The second pass: a candidate's crop is scaled until the ball has the radius that the network measures best, and measured
//! again, which leaves a third of the error. The verifier, where the model has one, estimates from the crop whether it is a ball at
//! all: it was trained on the first pass's candidates.

use std::f64::consts::PI;

use image::RgbImage;
use nalgebra::Point2;

use super::Localiser;
use super::outline::refined;
use super::size::{Reading, SIGMA_OF_SCALE, peaks, softmax};
use crate::camera::{Camera, Outline};
use crate::error::Result;
use crate::image::{Filter, resized};
use crate::model::{CLOSER_RADIUS, CLOSER_SIDE, CONFIDENCE_RADIUS};
use crate::size::Size;

/// How a candidate is enlarged for the second pass.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Glass {
    /// Side of what is seen, px of the network's input.
    side: u32,
    /// Radius that the ball is brought to, px of the network's input.
    radius: f64,
}

/// For a detector that measures its own candidates again: a radius among those that it measures best.
const OWN: Glass = Glass { side: 128, radius: 23.0 };
/// For the verifier.
pub(crate) const CLOSER: Glass = Glass { side: CLOSER_SIDE, radius: CLOSER_RADIUS };
/// Strongest enlargement: beyond it there is nothing more to be seen.
const MOST_ENLARGED: f64 = 6.0;
/// Candidates of the second pass at most, and the fraction of the first one's confidence that a candidate needs for it.
pub(super) const LOOKED_AT: usize = 4;
const WORTH: f64 = 0.2;
/// Factor on the confidence of a candidate in whose crop no ball is found.
const NOT_SEEN: f64 = 0.5;
/// Peaks of the crop among which the ball is searched.
const PLACES: usize = 3;
/// Largest share of a view's side from its middle to where the ball may be.
const MOST_REACH: f64 = 0.36;
/// Largest ratio of the crop's radius to the first pass's, or the inverse.
const SAME_SIZE: f64 = 2.0;

/// Log-odds of a ball: the bias, and the weights of the log-odds of first pass, crop and verifier. A logistic
/// regression on 20,000 candidates of the first pass in random renderings, of which a sixth were balls.
const ODDS: [f64; 4] = [-0.26, 0.71, 0.19, 0.76];
/// Least probability that enters the regression; the largest is as far from 1.
const LEAST: f64 = 1e-3;

/// Probability of a ball from the three confidences, 0 to 1 each.
fn likely(said: [f64; 3]) -> f64 {
    let log_odds = |share: f64| {
        let share = share.clamp(LEAST, 1.0 - LEAST);
        (share / (1.0 - share)).ln()
    };
    let [alone, weights @ ..] = ODDS;
    let sum: f64 = said.iter().zip(weights).map(|(&share, weight)| weight * log_odds(share)).sum();
    1.0 / (1.0 + (-(alone + sum)).exp())
}

/// A square part of a picture.
pub(crate) struct View {
    start: [u32; 2],
    side: u32,
    glass: Glass,
    /// Px of the network's input to one of the picture's.
    enlarged: f64,
}

impl View {
    /// The part of `rgb` in which the ball of `outline` has about the glass's radius, in the middle where the picture's edges
    /// allow it; the ball may be `reach` px from there.
    pub(crate) fn around(outline: &Outline, reach: f64, rgb: &RgbImage, glass: Glass) -> Self {
        // All of what may be the ball is to be in view.
        let radius = glass.radius.min(outline.radius * MOST_REACH * f64::from(glass.side) / reach);
        let enlarged = (radius / outline.radius).min(MOST_ENLARGED);
        let (width, height) = rgb.dimensions();
        let side = ((f64::from(glass.side) / enlarged).round() as u32).clamp(1, width.min(height));
        let start = |at: f64, all: u32| ((at + 0.5 - f64::from(side) / 2.0).round().max(0.0) as u32).min(all - side);
        let start = [start(outline.centre.x, width), start(outline.centre.y, height)];
        Self { start, side, glass, enlarged: f64::from(glass.side) / f64::from(side) }
    }

    pub(crate) fn of(&self, rgb: &RgbImage) -> RgbImage {
        resized(rgb, self.start, Size::square(self.side), Size::square(self.glass.side), Filter::Bicubic)
    }

    /// An outline in this view, in the picture.
    fn in_picture(&self, image: [f64; 2], radius: f64) -> Outline {
        let at = |axis: usize| (image[axis] + 0.5) / self.enlarged - 0.5 + f64::from(self.start[axis]);
        Outline { centre: Point2::new(at(0), at(1)), radius: radius / self.enlarged }
    }

    /// An outline in the picture, in this view.
    pub(crate) fn in_view(&self, outline: &Outline) -> Outline {
        let at = |axis: usize| (outline.centre[axis] - f64::from(self.start[axis]) + 0.5) * self.enlarged - 0.5;
        Outline { centre: Point2::new(at(0), at(1)), radius: outline.radius * self.enlarged }
    }
}

impl Localiser {
    /// The `readings` of the picture `rgb`, the likeliest first, after the second pass over those that may be the ball: the
    /// likeliest `count` first. `camera` took the picture, if that is known.
    pub(super) async fn look_closer(
        &self,
        rgb: &RgbImage,
        camera: Option<&Camera>,
        readings: Vec<Reading>,
        count: usize,
    ) -> Result<Vec<Reading>> {
        let worth = readings.first().map_or(0.0, |first| WORTH * first.confidence);
        let (mut seen, mut left) = (vec![], vec![]);
        for (place, reading) in readings.into_iter().enumerate() {
            match place < count || reading.confidence >= worth {
                true => seen.push(self.closer(rgb, camera, reading).await?),
                false => left.push(reading),
            }
        }
        // A candidate that the crop makes less likely lets others come first: these are measured as well.
        for reading in left {
            seen.sort_by(|a, b| b.confidence.total_cmp(&a.confidence));
            if seen.get(count.saturating_sub(1)).is_none_or(|last| last.confidence < reading.confidence) {
                seen.push(self.closer(rgb, camera, reading).await?);
            }
        }
        seen.sort_by(|a, b| b.confidence.total_cmp(&a.confidence));
        seen.truncate(count);
        Ok(seen)
    }

    /// `reading` after the second pass.
    async fn closer(&self, rgb: &RgbImage, camera: Option<&Camera>, reading: Reading) -> Result<Reading> {
        let seen = self.look_at(rgb, &reading.outline, reading.outline.radius).await?;
        let outline = seen.map_or(reading.outline, |seen| seen.outline);
        let judged = match &self.closer {
            Some(judge) => Some(judge.judged(rgb, &outline).await?),
            None => None,
        };
        let again = seen.map(|seen| seen.confidence);
        let confidence = match (judged, again) {
            (Some(judged), again) => likely([reading.confidence, again.unwrap_or(0.0), judged]),
            (None, Some(again)) => (reading.confidence * again).sqrt(),
            (None, None) => NOT_SEEN * reading.confidence,
        };
        Ok(match seen {
            Some(seen) => refined(rgb, camera, Reading { confidence, ..seen }),
            None => Reading { confidence, ..reading },
        })
    }

    /// The verifier, where there is one.
    #[cfg(test)]
    pub(crate) fn judge(&self) -> Option<&Self> {
        self.closer.as_deref()
    }

    /// How sure this network, which learned nothing else, is that `outline` is a ball's, 0 to 1.
    pub(crate) async fn judged(&self, rgb: &RgbImage, outline: &Outline) -> Result<f64> {
        let seen = self.look_through(CLOSER, rgb, outline, outline.radius).await?;
        // Of a heatmap that is the same everywhere, so much lies around any place.
        let chance = PI * CONFIDENCE_RADIUS.powi(2) / f64::from(CLOSER.side).powi(2);
        Ok(seen.map_or(0.0, |seen| ((seen.confidence - chance) / (1.0 - chance)).max(0.0)))
    }

    /// The ball that is at most `reach` px from the middle of `outline` and about as large; none where the crop shows none.
    pub(super) async fn look_at(&self, rgb: &RgbImage, outline: &Outline, reach: f64) -> Result<Option<Reading>> {
        self.look_through(OWN, rgb, outline, reach).await
    }

    /// The same through `glass`.
    async fn look_through(
        &self,
        glass: Glass,
        rgb: &RgbImage,
        outline: &Outline,
        reach: f64,
    ) -> Result<Option<Reading>> {
        let view = View::around(outline, reach, rgb, glass);
        let field = self.one_field(&view.of(rgb), 0, 0, Size::square(glass.side)).await?;
        let same = |found: &Reading| {
            (found.outline.centre - outline.centre).norm() < reach
                && (SAME_SIZE.recip()..SAME_SIZE).contains(&(found.outline.radius / outline.radius))
        };
        let found = peaks(&field, softmax(&field.logits), PLACES).into_iter().map(|peak| Reading {
            outline: view.in_picture(peak.image, peak.radius),
            log_sigma: SIGMA_OF_SCALE * peak.log_scale,
            confidence: peak.confidence,
        });
        Ok(found.into_iter().find(same))
    }
}
