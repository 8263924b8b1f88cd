//! Numbers of how candidates are found in pictures.

use serde::{Deserialize, Serialize};

/// Which frames show the one before again, and when frames were taken.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
#[serde(default, deny_unknown_fields)]
pub struct RepeatsConfig {
    /// Change of a level that is counted, levels. Source: chosen by hand.
    pub least_change: u8,
    /// Pixels that changed, as a fraction of the usual count, below which a frame repeats the one before. Source: chosen by hand.
    pub fraction: f64,
    /// Last frames that tell how much usually changes. Source: chosen by hand.
    pub usual_frames: usize,
    /// Change of a level that encoding a frame again does not reach, levels. Source: chosen by hand.
    pub strong_change: u8,
    /// Pixels that changed so much, as a fraction of those in the frames before and after, below which a frame repeats the one before.
    /// Repeated frames reach up to 0.06, others 0.7 and more. Source: chosen on broadcasts of 25 frames a second shown as 30.
    pub strong_fraction: f64,
    /// Pixels that have to change so much in the frames before and after for that. Source: chosen by hand.
    pub strong_pixels: f64,
    /// Repeated frames that make a cadence. Source: chosen by hand.
    pub cadence_repeats: usize,
    /// By how much of an interval the times of even frames may differ. Source: chosen by hand.
    pub uneven: f64,
    /// Frames after one that tell whether it is repeated. Source: chosen by hand.
    pub frames_after: usize,
    /// Expected repeats in a row that may go unrecognised: as many as it takes to find a cadence. Source: chosen by hand.
    pub most_unrecognised: usize,
}

impl Default for RepeatsConfig {
    fn default() -> Self {
        Self {
            least_change: 2,
            fraction: 0.02,
            usual_frames: 50,
            strong_change: 12,
            strong_fraction: 0.15,
            strong_pixels: 50.0,
            cadence_repeats: 4,
            uneven: 0.2,
            frames_after: 2,
            most_unrecognised: 4,
        }
    }
}

/// How frames are registered to the first view: by patches of a key frame that are found again.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
#[serde(default, deny_unknown_fields)]
pub struct RegistrationConfig {
    /// Cells along the picture's sides in which one patch each is chosen. Source: chosen by hand.
    pub cells: [usize; 2],
    /// Distance of the places that are tried for a patch, px. Source: chosen by hand.
    pub step: usize,
    /// Least gradient (root mean square) in a patch's weakest direction, levels/px. Source: chosen by hand.
    pub texture: f64,
    /// How far from its predicted place a patch is searched, px. Source: chosen by hand.
    pub reach: usize,
    /// The same where the camera stood still before, px. Source: chosen by hand.
    pub reach_still: usize,
    /// Largest mean difference of a patch that is found again, as a fraction of its own contrast. Source: chosen by hand.
    pub alike: f64,
    /// What noise may add to that, levels. Source: chosen by hand.
    pub noise: f64,
    /// Fewest patches that make a homography. Source: chosen by hand.
    pub fewest: usize,
    /// Fraction of the patches that are found that has to agree. Source: chosen by hand.
    pub agree: f64,
    /// Fraction of the patches in view that has to agree. Source: chosen by hand.
    pub agree_of_all: f64,
    /// Distance within which a patch agrees with the others, px. Source: chosen by hand.
    pub near: f64,
    /// Pairs of patches of which a motion is tried. Source: chosen by hand.
    pub tries: usize,
    /// Rounds of the robust fit of a homography. Source: chosen by hand.
    pub rounds: usize,
    /// Standard deviation of a patch's place, px. Source: chosen by hand.
    pub place_sigma: f64,
    /// Standard deviation of the change of aspect and shear from one frame to the next. Source: chosen by hand.
    pub shear_sigma: f64,
    /// Standard deviation of the change of the perspective terms from one frame to the next, a half width. Source: chosen by hand.
    pub perspective_sigma: f64,
    /// How far a whole picture is searched, as a fraction of its width. Source: chosen by hand.
    pub coarse_reach: f64,
    /// Difference of a pixel in that search that counts at most, levels: some of the picture moves. Source: chosen by hand.
    pub coarse_most: u8,
    /// Fraction of a key frame's patches in view at which another key frame takes over. Source: chosen by hand.
    pub least_in_view: f64,
    /// Displacement from a key frame, as a fraction of the width, at which another key frame takes over. Source: chosen by hand.
    pub farthest: f64,
    /// Displacement from an older key frame, as a fraction of the width, within which it takes over again. Source: chosen by hand.
    pub returned: f64,
    /// Displacement below which a frame is not warped, px: the mean over the picture. Source: chosen by hand.
    pub still_px: f64,
    /// Displacement from which a frame counts as another view than the first, px: the mean over the picture. Source: chosen by hand.
    pub elsewhere_px: f64,
    /// Frames between searches for the first view while another one is shown. Source: chosen by hand.
    pub return_every: usize,
    /// How far off (1-σ) the first view's camera is from where a court's lines show it, px. Source: measured on clicks, 0.3 to 3 px
    /// (`docs/experiments.md`).
    pub court_first_sigma: f64,
    /// The same of later frames as they are registered. Source: measured on two simulated pans, median along an axis.
    pub court_registered_sigma: f64,
    /// The same of a frame that is not registered, after the one before. Source: measured on seven simulated pans, which move by up to 9.5 px a
    /// frame along an axis.
    pub court_lost_sigma: f64,
    /// Displacement, as a fraction of the width, from which frames are stabilised about another one. Source: chosen by hand.
    pub canvas_moved: f64,
    /// Change of size from which frames are stabilised about another one. Source: chosen by hand.
    pub canvas_scaled: f64,
}

impl Default for RegistrationConfig {
    fn default() -> Self {
        Self {
            cells: [12, 8],
            step: 6,
            texture: 4.0,
            reach: 6,
            reach_still: 3,
            alike: 0.5,
            noise: 3.0,
            fewest: 8,
            agree: 0.5,
            agree_of_all: 0.3,
            near: 1.0,
            tries: 80,
            rounds: 3,
            place_sigma: 0.3,
            shear_sigma: 0.002,
            perspective_sigma: 0.003,
            coarse_reach: 0.2,
            coarse_most: 40,
            least_in_view: 0.6,
            farthest: 0.12,
            returned: 0.06,
            still_px: 0.35,
            elsewhere_px: 1.5,
            return_every: 4,
            court_first_sigma: 2.0,
            court_registered_sigma: 1.5,
            court_lost_sigma: 9.0,
            canvas_moved: 0.25,
            canvas_scaled: 1.3,
        }
    }
}

/// What stands still, and what differs from it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
#[serde(default, deny_unknown_fields)]
pub struct BackgroundConfig {
    /// Frames of which the first background is the median. Source: chosen by hand.
    pub first_frames: usize,
    /// The same for a shorter video. Source: chosen by hand.
    pub fewest_frames: usize,
    /// Least difference of two levels that counts, levels. Source: chosen by hand.
    pub least_contrast: u8,
    /// Least difference that counts, in median differences between a frame and the one before. Source: chosen by hand.
    pub contrast_of_noise: f64,
    /// Fraction of the range of the levels about a pixel that a difference must exceed while the camera moves. Half the range is what a
    /// registration that is half a pixel off makes of an edge. Source: chosen by hand.
    pub edge_tolerance: f64,
    /// Fraction of a picture's pixels that differ from the background where the camera moved, or another took over. Source: chosen by hand.
    pub moved: f64,
    /// Such frames in a row after which the background is made anew. Source: chosen by hand.
    pub moving_frames: usize,
}

impl Default for BackgroundConfig {
    fn default() -> Self {
        Self {
            first_frames: 15,
            fewest_frames: 5,
            least_contrast: 9,
            contrast_of_noise: 6.0,
            edge_tolerance: 0.5,
            moved: 0.35,
            moving_frames: 3,
        }
    }
}

/// Which parts of a frame that differ are candidates.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
#[serde(default, deny_unknown_fields)]
pub struct BlobsConfig {
    /// Smallest radius, px. Source: chosen by hand.
    pub least_radius: f64,
    /// Largest radius, as a fraction of the picture's shorter side. Source: chosen by hand.
    pub most_radius: f64,
    /// Fewest pixels. Source: chosen by hand.
    pub fewest_pixels: usize,
    /// Longest streak, in its widths. Source: chosen by hand.
    pub longest: f64,
    /// Least fraction of the ellipse with its moments that a part fills. Source: chosen by hand.
    pub least_filled: f64,
    /// Most parts of a frame that are kept. Source: chosen by hand.
    pub most: usize,
    /// Standard deviation of a part's place, px. Source: chosen by hand.
    pub place_px: f64,
    /// What is added to that, as a fraction of the part's reach. Source: chosen by hand.
    pub place_of_reach: f64,
    /// Least standard deviation of the place of what the detector finds, px. Source: chosen by hand.
    pub detected_sigma: f64,
    /// Length over width from which a blob keeps its length when the detector measures its width. Source: chosen by hand.
    pub streak: f64,
    /// How far from its middle a blob has to change for it to move, radii along each axis. Source: chosen by hand.
    pub moves_at: f64,
    /// Distance of two blobs' middles within which they are one, radii. Source: chosen by hand.
    pub same: f64,
    /// Least radius that is assumed for that, px. Source: chosen by hand.
    pub same_least: f64,
    /// Ratio of the radii below which they are one. Source: chosen by hand.
    pub same_radius: f64,
}

impl Default for BlobsConfig {
    fn default() -> Self {
        Self {
            least_radius: 1.0,
            most_radius: 1.0 / 8.0,
            fewest_pixels: 4,
            longest: 12.0,
            least_filled: 0.6,
            most: 60,
            place_px: 0.7,
            place_of_reach: 0.08,
            detected_sigma: 0.3,
            streak: 1.5,
            moves_at: 0.7,
            same: 0.7,
            same_least: 1.5,
            same_radius: 1.5,
        }
    }
}
