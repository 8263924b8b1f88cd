//! The second pass over the candidates: a candidate's crop is scaled until the ball has the radius that the detector measures
//! best, and the detector is run on it again, which leaves a third of the error.

use image::RgbImage;

use super::candidate::{MAX_RADIUS_RATIO, detections_in_crop, is_same_ball, is_within};
use super::crop::{Crop, DETECTOR_CROP};
use super::edge_refinement::refine_by_edge;
use super::verifier::{Evidence, is_worth_a_second_pass};
use super::{Localiser, Region};
use gravisight_geometry::camera::{Camera, Detection, Outline};
use gravisight_geometry::error::Result;
use gravisight_geometry::size::Size;

/// Factor on the confidence of a candidate in whose crop no ball is detected, of a model without a verifier.
const MISSED_IN_CROP: f64 = 0.5;
impl Localiser {
    /// The `count` likeliest of the `candidates` in the picture `rgb` after the second pass, the likeliest first; `cells` cells of
    /// the heatmap were searched for them. `camera` took the picture, if that is known; the balls' centres lie in the `region`, if there is one.
    pub(super) async fn second_pass(
        &self,
        rgb: &RgbImage,
        (camera, region): (Option<&Camera>, Option<Region>),
        mut candidates: Vec<Detection>,
        cells: usize,
        count: usize,
    ) -> Result<Vec<Detection>> {
        // A model without a verifier, such as one that was fine-tuned, has confidences of its own.
        let calibration = self.calibration();
        let is_worth = |candidate: &Detection| {
            self.verifier.is_none() || is_worth_a_second_pass(&calibration, candidate.confidence, cells)
        };
        let mut rank = 0..;
        candidates.retain(|candidate| rank.next() < Some(count) || is_worth(candidate));
        let mut refined =
            self.find_each(&candidates, async |candidate| self.refine(rgb, region, cells, candidate).await).await?;
        refined.sort_by(|(a, _), (b, _)| b.confidence.total_cmp(&a.confidence));
        refined.truncate(count);
        let by_edge = |(detection, is_in_crop): (Detection, bool)| {
            let refined = is_in_crop.then(|| refine_by_edge(rgb, camera, detection, &calibration));
            refined.filter(|refined| is_within(refined, region)).unwrap_or(detection)
        };
        Ok(refined.into_iter().map(by_edge).collect())
    }

    /// `candidate` after the second pass and the verifier, and whether its crop shows a ball.
    async fn refine(
        &self,
        rgb: &RgbImage,
        region: Option<Region>,
        cells: usize,
        candidate: &Detection,
    ) -> Result<(Detection, bool)> {
        let (in_crop, evidence) = self.evidence_of(rgb, region, cells, candidate).await?;
        let confidence = match (&evidence, in_crop) {
            (Some(evidence), _) => evidence.probability(&self.calibration()),
            (None, Some(in_crop)) => (candidate.confidence * in_crop.confidence).sqrt(),
            (None, None) => MISSED_IN_CROP * candidate.confidence,
        };
        Ok((Detection { confidence, ..in_crop.unwrap_or_else(|| unmeasured(candidate)) }, in_crop.is_some()))
    }

    /// The detection in the crop of `candidate`, if there is one, and the features of its probability, where there is a verifier.
    pub(super) async fn evidence_of(
        &self,
        rgb: &RgbImage,
        region: Option<Region>,
        cells: usize,
        candidate: &Detection,
    ) -> Result<(Option<Detection>, Option<Evidence>)> {
        let in_crop = self.detect_in_crop(rgb, region, &candidate.outline, candidate.outline.radius).await?;
        let outline = in_crop.map_or(candidate.outline, |in_crop| in_crop.outline);
        let Some(verifier) = &self.verifier else { return Ok((in_crop, None)) };
        let verified = verifier.verify(rgb, &outline).await?;
        let confidences = [candidate.confidence, in_crop.map_or(0.0, |in_crop| in_crop.confidence), verified];
        Ok((in_crop, Some(Evidence::new(outline, confidences, cells))))
    }

    /// The ball in the `region`, at most `reach` px from the centre of `outline` and of a similar radius; [`None`] where its crop shows none.
    pub(super) async fn detect_in_crop(
        &self,
        rgb: &RgbImage,
        region: Option<Region>,
        outline: &Outline,
        reach: f64,
    ) -> Result<Option<Detection>> {
        let crop = Crop::around(outline, reach, rgb, DETECTOR_CROP);
        let maps = self.output_maps_at(&crop.pixels(rgb), 0, 0, Size::square(DETECTOR_CROP.side)).await?;
        let found = detections_in_crop(&maps).into_iter();
        let mut found =
            found.map(|detection| Detection { outline: crop.picture_from_crop(&detection.outline), ..detection });
        Ok(found.find(|detection| is_within(detection, region) && is_same_ball(detection, outline, reach)))
    }
}

/// A candidate in whose crop there is no ball whose radius is within [`MAX_RADIUS_RATIO`] of its own: it is not known better than to that.
fn unmeasured(candidate: &Detection) -> Detection {
    Detection { log_sigma: candidate.log_sigma.hypot(MAX_RADIUS_RATIO.ln()), ..*candidate }
}
