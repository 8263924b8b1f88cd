//! Candidates: what the first pass hands to the second, and which detections are of the same ball.

use super::output_maps::OutputMaps;
use super::{Maps, Region};
use gravisight_geometry::camera::{Detection, Outline};

/// Candidates of the second pass at most.
pub(super) const MAX_CANDIDATES: usize = 8;
/// Peaks of a crop's heatmap among which the ball is searched.
const PEAKS_OF_CROP: usize = 3;
/// Largest ratio of two radii of the same ball, or its inverse.
pub(super) const MAX_RADIUS_RATIO: f64 = 2.0;

/// Result of the first pass.
pub(crate) struct FirstPass {
    /// Candidates, the likeliest first.
    pub candidates: Vec<Detection>,
    /// The network's maps, if requested.
    pub maps: Option<Maps>,
    /// Cells of the heatmap that were searched.
    pub cells: usize,
}

/// The highest peaks of a crop's heatmap, px of the crop.
pub(super) fn detections_in_crop(maps: &OutputMaps) -> Vec<Detection> {
    maps.peaks(PEAKS_OF_CROP).into_iter().map(Detection::from).collect()
}

/// Whether the centre of a detection lies in a region, if there is one.
pub(super) fn is_within(detection: &Detection, region: Option<Region>) -> bool {
    region.is_none_or(|region| region.contains(&detection.outline.centre))
}

/// Whether a detection may be of the ball of `outline`: at most `reach` px away and of a similar radius.
pub(super) fn is_same_ball(detection: &Detection, outline: &Outline, reach: f64) -> bool {
    (detection.outline.centre - outline.centre).norm() < reach
        && (MAX_RADIUS_RATIO.recip()..MAX_RADIUS_RATIO).contains(&(detection.outline.radius / outline.radius))
}
