//! A second look: a place where the ball may be, enlarged (or made smaller) until the ball has the radius that the network
//! reads best, and read again. A third of the first look's error is left, and what is no ball is told better.

use image::RgbImage;
use nalgebra::Point2;

use super::Localiser;
use super::outline::refined;
use super::size::{Reading, SIGMA_OF_SCALE, peaks, softmax};
use crate::camera::{Camera, Outline};
use crate::error::Result;
use crate::image::{Filter, resized};
use crate::size::Size;

/// Side of what is looked at again, px of the network's input.
const SIDE: u32 = 128;
/// Radius that the ball is brought to, px of the network's input: among those that it reads best.
const RADIUS: f64 = 23.0;
/// Strongest enlargement: beyond it there is nothing more to be seen.
const MOST_ENLARGED: f64 = 6.0;
/// Places that are looked at again at most, and the share of the first one's confidence that makes a place worth it.
pub(super) const LOOKED_AT: usize = 4;
const WORTH: f64 = 0.2;
/// What is left of the confidence in a place where a second look shows no ball.
const NOT_SEEN: f64 = 0.5;
/// Places of the enlarged part among which the ball is looked for.
const PLACES: usize = 3;
/// Largest share of a view's side from its middle to where the ball may be.
const MOST_REACH: f64 = 0.36;
/// Largest ratio of the second look's radius to the first's, or the inverse.
const SAME_SIZE: f64 = 2.0;

/// A square part of a picture.
struct View {
    start: [u32; 2],
    side: u32,
    /// Px of the network's input to one of the picture's.
    enlarged: f64,
}

impl View {
    /// The part in which the ball of `outline` has about the `radius`, in the middle where the picture's edges allow it.
    fn around(outline: &Outline, radius: f64, rgb: &RgbImage) -> Self {
        let enlarged = (radius / outline.radius).min(MOST_ENLARGED);
        let (width, height) = rgb.dimensions();
        let side = ((f64::from(SIDE) / enlarged).round() as u32).clamp(1, width.min(height));
        let start = |at: f64, all: u32| ((at + 0.5 - f64::from(side) / 2.0).round().max(0.0) as u32).min(all - side);
        let start = [start(outline.centre.x, width), start(outline.centre.y, height)];
        Self { start, side, enlarged: f64::from(SIDE) / f64::from(side) }
    }

    fn of(&self, rgb: &RgbImage) -> RgbImage {
        resized(rgb, self.start, Size::square(self.side), Size::square(SIDE), Filter::Bicubic)
    }

    /// An outline in this view, in the picture.
    fn in_picture(&self, image: [f64; 2], radius: f64) -> Outline {
        let at = |axis: usize| (image[axis] + 0.5) / self.enlarged - 0.5 + f64::from(self.start[axis]);
        Outline { centre: Point2::new(at(0), at(1)), radius: radius / self.enlarged }
    }
}

impl Localiser {
    /// The `readings` of the picture `rgb`, the likeliest first, after a second look at those that may be the ball: the
    /// likeliest `count` first. `camera` took the picture, if that is known.
    pub(super) async fn look_closer(
        &self,
        rgb: &RgbImage,
        camera: Option<&Camera>,
        readings: Vec<Reading>,
        count: usize,
    ) -> Result<Vec<Reading>> {
        let worth = readings.first().map_or(0.0, |first| WORTH * first.confidence);
        let mut seen = Vec::with_capacity(readings.len());
        for (place, reading) in readings.into_iter().enumerate() {
            let look = place < count || reading.confidence >= worth;
            seen.push(if look { self.closer(rgb, camera, reading).await? } else { reading });
        }
        seen.sort_by(|a, b| b.confidence.total_cmp(&a.confidence));
        seen.truncate(count);
        Ok(seen)
    }

    /// `reading` after a second look.
    async fn closer(&self, rgb: &RgbImage, camera: Option<&Camera>, reading: Reading) -> Result<Reading> {
        let seen = self.look_at(rgb, &reading.outline, reading.outline.radius).await?;
        Ok(match seen {
            Some(seen) => {
                let confidence = (reading.confidence * seen.confidence).sqrt();
                refined(rgb, camera, Reading { confidence, ..seen })
            }
            None => Reading { confidence: NOT_SEEN * reading.confidence, ..reading },
        })
    }

    /// The ball that is at most `reach` px from the middle of `outline` and about as large; none where a closer look shows none.
    pub(super) async fn look_at(&self, rgb: &RgbImage, outline: &Outline, reach: f64) -> Result<Option<Reading>> {
        // All of what may be the ball is to be in view.
        let view = View::around(outline, RADIUS.min(outline.radius * MOST_REACH * f64::from(SIDE) / reach), rgb);
        let field = self.one_field(&view.of(rgb), 0, 0, Size::square(SIDE)).await?;
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
