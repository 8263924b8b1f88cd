//! The second pass over the candidates: a candidate's crop is scaled until the ball has the radius that the detector measures
//! best, and the detector is run on it again, which leaves a third of the error.

use image::RgbImage;

use super::Localiser;
use super::crop::{Crop, DETECTOR_CROP};
use super::edge_refinement::refine_by_edge;
use super::output_maps::OutputMaps;
use super::verifier::{Evidence, is_worth_a_second_pass};
use crate::camera::{Camera, Detection, Outline};
use crate::error::Result;
use crate::size::Size;

/// Candidates of the second pass at most.
pub(super) const MAX_CANDIDATES: usize = 8;
/// Factor on the confidence of a candidate in whose crop no ball is detected, of a model without a verifier.
const MISSED_IN_CROP: f64 = 0.5;
/// Peaks of a crop's heatmap among which the ball is searched.
const PEAKS_OF_CROP: usize = 3;
/// Largest ratio of two radii of the same ball, or its inverse.
const MAX_RADIUS_RATIO: f64 = 2.0;

impl Localiser {
    /// The `count` likeliest of the `candidates` in the picture `rgb` after the second pass, the likeliest first; `cells` cells of
    /// the heatmap were searched for them. `camera` took the picture, if that is known.
    pub(super) async fn second_pass(
        &self,
        rgb: &RgbImage,
        camera: Option<&Camera>,
        mut candidates: Vec<Detection>,
        cells: usize,
        count: usize,
    ) -> Result<Vec<Detection>> {
        // A model without a verifier, such as one that was fine-tuned, has confidences of its own.
        let is_worth =
            |candidate: &Detection| self.verifier.is_none() || is_worth_a_second_pass(candidate.confidence, cells);
        let mut rank = 0..;
        candidates.retain(|candidate| rank.next() < Some(count) || is_worth(candidate));
        let mut refined =
            self.find_each(&candidates, async |candidate| self.refine(rgb, cells, candidate).await).await?;
        refined.sort_by(|(a, _), (b, _)| b.confidence.total_cmp(&a.confidence));
        refined.truncate(count);
        let by_edge = |(detection, is_in_crop)| match is_in_crop {
            true => refine_by_edge(rgb, camera, detection),
            false => detection,
        };
        Ok(refined.into_iter().map(by_edge).collect())
    }

    /// `candidate` after the second pass and the verifier, and whether its crop shows a ball.
    async fn refine(&self, rgb: &RgbImage, cells: usize, candidate: &Detection) -> Result<(Detection, bool)> {
        let (in_crop, evidence) = self.evidence_of(rgb, cells, candidate).await?;
        let confidence = match (&evidence, in_crop) {
            (Some(evidence), _) => evidence.probability(),
            (None, Some(in_crop)) => (candidate.confidence * in_crop.confidence).sqrt(),
            (None, None) => MISSED_IN_CROP * candidate.confidence,
        };
        Ok((Detection { confidence, ..in_crop.unwrap_or(*candidate) }, in_crop.is_some()))
    }

    /// The detection in the crop of `candidate`, if there is one, and the features of its probability, where there is a verifier.
    pub(super) async fn evidence_of(
        &self,
        rgb: &RgbImage,
        cells: usize,
        candidate: &Detection,
    ) -> Result<(Option<Detection>, Option<Evidence>)> {
        let in_crop = self.detect_in_crop(rgb, &candidate.outline, candidate.outline.radius).await?;
        let outline = in_crop.map_or(candidate.outline, |in_crop| in_crop.outline);
        let Some(verifier) = &self.verifier else { return Ok((in_crop, None)) };
        let verified = verifier.verify(rgb, &outline).await?;
        let confidences = [candidate.confidence, in_crop.map_or(0.0, |in_crop| in_crop.confidence), verified];
        Ok((in_crop, Some(Evidence::new(outline, confidences, cells))))
    }

    /// The ball at most `reach` px from the centre of `outline` and of a similar radius; [`None`] where its crop shows none.
    pub(super) async fn detect_in_crop(
        &self,
        rgb: &RgbImage,
        outline: &Outline,
        reach: f64,
    ) -> Result<Option<Detection>> {
        let crop = Crop::around(outline, reach, rgb, DETECTOR_CROP);
        let maps = self.output_maps_at(&crop.pixels(rgb), 0, 0, Size::square(DETECTOR_CROP.side)).await?;
        let found = detections_in_crop(&maps).into_iter();
        let mut found =
            found.map(|detection| Detection { outline: crop.picture_from_crop(&detection.outline), ..detection });
        Ok(found.find(|detection| is_same_ball(detection, outline, reach)))
    }
}

/// The highest peaks of a crop's heatmap, px of the crop.
pub(super) fn detections_in_crop(maps: &OutputMaps) -> Vec<Detection> {
    maps.peaks(PEAKS_OF_CROP).into_iter().map(Detection::from).collect()
}

/// Whether a detection may be of the ball of `outline`: at most `reach` px away and of a similar radius.
pub(super) fn is_same_ball(detection: &Detection, outline: &Outline, reach: f64) -> bool {
    (detection.outline.centre - outline.centre).norm() < reach
        && (MAX_RADIUS_RATIO.recip()..MAX_RADIUS_RATIO).contains(&(detection.outline.radius / outline.radius))
}
