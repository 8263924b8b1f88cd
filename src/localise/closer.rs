//! The second pass: a candidate's crop is scaled until the ball has the radius that the network measures best, and measured
//! again, which leaves a third of the error. The verifier, where the model has one, estimates from the crop whether it is a ball at
//! all: it was trained on the first pass's candidates.

use std::f64::consts::PI;

use image::{Rgb, RgbImage};
use nalgebra::Point2;

use super::Localiser;
use super::outline::refined;
use super::size::{Field, First, Reading, SIGMA_OF_SCALE, peaks, softmax};
use crate::camera::{Camera, Outline};
use crate::error::Result;
#[cfg(not(target_arch = "wasm32"))]
use crate::image::Picture;
use crate::image::{Filter, Normalisation, resized};
use crate::model::{CLOSER_RADIUS, CLOSER_SIDE, CONFIDENCE_RADIUS, PICTURE_CHANNELS, Peak};
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
/// How many times as wide the verifier's second picture is: a head is known by its shoulders, a lamp by its row.
const WIDER: f64 = 3.0;
/// What lies beyond the picture's edges in it: the middle grey of the normalisation.
const BEYOND: Rgb<u8> = Rgb([124, 116, 104]);
/// Strongest enlargement: beyond it there is nothing more to be seen.
const MOST_ENLARGED: f64 = 6.0;
/// Candidates of the second pass at most, and the fraction of the first one's confidence that a candidate needs for it.
pub(super) const LOOKED_AT: usize = 8;
const WORTH: f64 = 0.05;
/// Factor on the confidence of a candidate in whose crop no ball is found.
const NOT_SEEN: f64 = 0.5;
/// Peaks of the crop among which the ball is searched.
const PLACES: usize = 3;
/// Largest share of a view's side from its middle to where the ball may be.
const MOST_REACH: f64 = 0.36;
/// Largest ratio of the crop's radius to the first pass's, or the inverse.
const SAME_SIZE: f64 = 2.0;

/// Log-odds of a ball: the bias, and the weights of the log-odds of first pass, crop and verifier and of the logarithm of the cells
/// that were searched. `cargo bench --bench photographs -- fit FOLDER` fits them.
const ODDS: [f64; 5] = [-0.152, 1.005, 0.469, 0.455, -0.686];
/// Cells that the last of them counts from: those of a picture of 256×256 px.
const USUAL_CELLS: f64 = 4096.0;
/// Least probability that enters the regression; the largest is as far from 1.
const LEAST: f64 = 1e-3;

/// What is known of a candidate when its probability is estimated.
#[doc(hidden)]
#[derive(Debug, Clone, Copy)]
pub struct Evidence {
    /// Its outline.
    pub outline: Outline,
    /// What the weights are of: the log-odds of first pass, crop and verifier, and the logarithm of the cells that were searched.
    pub features: [f64; 4],
}

impl Evidence {
    /// Of three confidences, 0 to 1 each, among so many cells.
    fn new(outline: Outline, said: [f64; 3], cells: usize) -> Self {
        let log_odds = |share: f64| {
            let share = share.clamp(LEAST, 1.0 - LEAST);
            (share / (1.0 - share)).ln()
        };
        let [first, crop, verifier] = said.map(log_odds);
        Self { outline, features: [first, crop, verifier, (cells.max(1) as f64 / USUAL_CELLS).ln()] }
    }

    /// The probability that it is a ball.
    fn probability(&self) -> f64 {
        let [alone, weights @ ..] = ODDS;
        let sum: f64 = self.features.iter().zip(weights).map(|(value, weight)| weight * value).sum();
        1.0 / (1.0 + (-(alone + sum)).exp())
    }
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

    /// What the verifier sees: the view, and what is around it, as large.
    pub(crate) fn with_surroundings(&self, rgb: &RgbImage) -> [RgbImage; 2] {
        [self.of(rgb), self.surroundings(rgb)]
    }

    /// The part of `rgb` that is [`WIDER`] times as wide, about the same middle, of the glass's side.
    fn surroundings(&self, rgb: &RgbImage) -> RgbImage {
        let whole = WIDER * f64::from(self.side);
        let shrunk = f64::from(self.glass.side) / whole;
        // Of each axis the part that is in the picture: its start and length there, and in the view.
        let parts = [(self.start[0], rgb.width()), (self.start[1], rgb.height())].map(|(start, all)| {
            let first = f64::from(start) + (f64::from(self.side) - whole) / 2.0;
            let from = first.max(0.0).floor() as u32;
            let to = ((first + whole).ceil() as u32).min(all);
            let at = (((f64::from(from) - first) * shrunk).round().max(0.0) as u32).min(self.glass.side - 1);
            let length = (f64::from(to - from) * shrunk).round().max(1.0) as u32;
            (from, to - from, at, length.min(self.glass.side - at))
        });
        let [(left, width, x, columns), (top, height, y, rows)] = parts;
        let size = Size::new(columns, rows);
        let part = resized(rgb, [left, top], Size::new(width, height), size, Filter::Bilinear);
        let mut seen = RgbImage::from_pixel(self.glass.side, self.glass.side, BEYOND);
        image::imageops::replace(&mut seen, &part, i64::from(x), i64::from(y));
        seen
    }

    /// An outline in this view, in the picture.
    fn in_picture(&self, outline: &Outline) -> Outline {
        let at = |axis: usize| (outline.centre[axis] + 0.5) / self.enlarged - 0.5 + f64::from(self.start[axis]);
        Outline { centre: Point2::new(at(0), at(1)), radius: outline.radius / self.enlarged }
    }

    /// An outline in the picture, in this view.
    pub(crate) fn in_view(&self, outline: &Outline) -> Outline {
        let at = |axis: usize| (outline.centre[axis] - f64::from(self.start[axis]) + 0.5) * self.enlarged - 0.5;
        Outline { centre: Point2::new(at(0), at(1)), radius: outline.radius * self.enlarged }
    }
}

impl Localiser {
    /// The `readings` of the picture `rgb`, the likeliest first, after the second pass over those that may be the ball: the
    /// likeliest `count` first, of `cells` that were searched. `camera` took the picture, if that is known.
    pub(super) async fn look_closer(
        &self,
        rgb: &RgbImage,
        camera: Option<&Camera>,
        readings: Vec<Reading>,
        cells: usize,
        count: usize,
    ) -> Result<Vec<Reading>> {
        let worth = readings.first().map_or(0.0, |first| WORTH * first.confidence);
        let (mut seen, mut left) = (vec![], vec![]);
        for (place, reading) in readings.into_iter().enumerate() {
            match place < count || reading.confidence >= worth {
                true => seen.push(self.closer(rgb, camera, cells, reading).await?),
                false => left.push(reading),
            }
        }
        // A candidate that the crop makes less likely lets others come first: these are measured as well.
        for reading in left {
            seen.sort_by(|a, b| b.confidence.total_cmp(&a.confidence));
            if seen.get(count.saturating_sub(1)).is_none_or(|last| last.confidence < reading.confidence) {
                seen.push(self.closer(rgb, camera, cells, reading).await?);
            }
        }
        seen.sort_by(|a, b| b.confidence.total_cmp(&a.confidence));
        seen.truncate(count);
        Ok(seen)
    }

    /// What is known of the likeliest candidates in a picture, by a model with a verifier: what its weights are fitted to.
    ///
    /// # Errors
    /// As [`Self::measure`](Localiser::measure).
    #[doc(hidden)]
    #[cfg(not(target_arch = "wasm32"))]
    pub async fn evidence(&self, picture: &Picture) -> Result<Vec<Evidence>> {
        let First { readings, cells, .. } = self.first_look(picture, None, LOOKED_AT, false).await?;
        let mut found = vec![];
        for reading in readings.iter().take(LOOKED_AT) {
            found.extend(self.weighed(picture.rgb(), cells, reading).await?.1);
        }
        Ok(found)
    }

    /// The ball in the crop of `reading`, if it shows one; what is known of it, where there is a verifier.
    async fn weighed(
        &self,
        rgb: &RgbImage,
        cells: usize,
        reading: &Reading,
    ) -> Result<(Option<Reading>, Option<Evidence>)> {
        let seen = self.look_at(rgb, &reading.outline, reading.outline.radius).await?;
        let outline = seen.map_or(reading.outline, |seen| seen.outline);
        let Some(judge) = &self.closer else { return Ok((seen, None)) };
        let judged = judge.judged(rgb, &outline).await?;
        let said = [reading.confidence, seen.map_or(0.0, |seen| seen.confidence), judged];
        Ok((seen, Some(Evidence::new(outline, said, cells))))
    }

    /// `reading` after the second pass.
    async fn closer(&self, rgb: &RgbImage, camera: Option<&Camera>, cells: usize, reading: Reading) -> Result<Reading> {
        let (seen, evidence) = self.weighed(rgb, cells, &reading).await?;
        let confidence = match (&evidence, seen) {
            (Some(evidence), _) => evidence.probability(),
            (None, Some(seen)) => (reading.confidence * seen.confidence).sqrt(),
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
        let view = View::around(outline, outline.radius, rgb, CLOSER);
        let found = self.places_in(&view.with_surroundings(rgb)).await?;
        let outline = view.in_view(outline);
        Ok(Self::sure_of(&found, &outline, outline.radius))
    }

    /// How sure a verifier is of the ball of `outline`, at most `reach` px away, by what it found.
    pub(crate) fn sure_of(found: &[Reading], outline: &Outline, reach: f64) -> f64 {
        let seen = found.iter().find(|reading| is_same(reading, outline, reach));
        // Of a heatmap that is the same everywhere, so much lies around any place.
        let chance = PI * CONFIDENCE_RADIUS.powi(2) / f64::from(CLOSER.side).powi(2);
        seen.map_or(0.0, |seen| ((seen.confidence - chance) / (1.0 - chance)).max(0.0))
    }

    /// Where this network, a verifier, sees balls in a view (the first of `views`), px of it.
    pub(crate) async fn places_in(&self, views: &[RgbImage; 2]) -> Result<Vec<Reading>> {
        let count = self.config.input_channels() / PICTURE_CHANNELS;
        let size = Size::new(views[0].width(), views[0].height());
        let field = self.field_of(stacked(&views[..count], &self.card.normalisation), size).await?;
        Ok(in_field(&field))
    }

    /// The ball that is at most `reach` px from the middle of `outline` and about as large; none where the crop shows none.
    pub(super) async fn look_at(&self, rgb: &RgbImage, outline: &Outline, reach: f64) -> Result<Option<Reading>> {
        let view = View::around(outline, reach, rgb, OWN);
        let field = self.one_field(&view.of(rgb), 0, 0, Size::square(OWN.side)).await?;
        let found = in_field(&field).into_iter();
        let mut found = found.map(|reading| Reading { outline: view.in_picture(&reading.outline), ..reading });
        Ok(found.find(|reading| is_same(reading, outline, reach)))
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

/// The places that a field's heatmap is highest at, px of its picture.
fn in_field(field: &Field) -> Vec<Reading> {
    let reading = |peak: Peak| Reading {
        outline: Outline { centre: peak.image.into(), radius: peak.radius },
        log_sigma: SIGMA_OF_SCALE * peak.log_scale,
        confidence: peak.confidence,
    };
    peaks(field, softmax(&field.logits), PLACES).into_iter().map(reading).collect()
}

/// Whether a reading may be of the ball of `outline`, at most `reach` px away and about as large.
fn is_same(found: &Reading, outline: &Outline, reach: f64) -> bool {
    (found.outline.centre - outline.centre).norm() < reach
        && (SAME_SIZE.recip()..SAME_SIZE).contains(&(found.outline.radius / outline.radius))
}
