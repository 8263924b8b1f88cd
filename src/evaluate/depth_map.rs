//! Whether a model's depth map shows the scene: against depth images.

use nalgebra::{Point2, distance};
use serde::Serialize;

use super::Statistic;
use crate::localise::{LocaliseOptions, Localiser};
use gravisight_clips::Clips;
use gravisight_geometry::error::{Error, Result};

/// How near to the ball the map is not compared, as a fraction of the picture's height: there it was taught.
const NEAR_BALL: f64 = 0.15;
/// A unit of a depth image, m.
const UNIT: f64 = 1e-3;

/// How well depth maps show the scenes, away from the ball.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct DepthMapScore {
    /// Pictures compared.
    pub pictures: usize,
    /// Correlation of the map's depth with the true one, over all cells (Pearson's; −1 to 1).
    pub correlation: f64,
    /// Error of a cell's depth as a fraction of the true one.
    pub error_relative: Statistic,
    /// The same of the best constant depth: what a map without any scene in it would reach.
    pub error_of_constant: Statistic,
}

/// Compares the depth maps of `localiser` with the depth images beside the pictures of `clips` (`000.depth.png` beside `000.png`:
/// 16 bits, mm along the camera's axis, 0 where nothing is), on about `limit` pictures. None where there are no such images, and
/// for a model that reads sizes, which has no depth map of its own.
///
/// # Errors
/// As [`Clips::picture`] and [`Localiser::localise`]; [`Error::Data`] for a depth image that cannot be read, or of another size.
pub async fn score_depth_maps(localiser: &Localiser, clips: &Clips, limit: usize) -> Result<Option<DepthMapScore>> {
    let frames: Vec<_> =
        clips.clips.iter().flat_map(|clip| clip.frames.iter().map(move |frame| (clip, frame))).collect();
    let beside = |file: &std::path::Path| clips.folder.join(file).with_extension("depth.png");
    let first = frames.first().map(|(_, frame)| beside(&frame.file));
    if localiser.reads_size() || limit == 0 || !first.is_some_and(|file| file.is_file()) {
        return Ok(None);
    }
    let count = limit.min(frames.len());
    let mut pairs: Vec<[f64; 2]> = Vec::new();
    for index in 0..count {
        let (clip, frame) = frames[index * frames.len() / count];
        let path = beside(&frame.file);
        let refuse = |reason: String| Error::Data { what: path.display().to_string(), reason };
        let depths = image::open(&path).map_err(|error| refuse(error.to_string()))?.into_luma16();
        let size = clip.camera.size();
        if depths.dimensions() != (size.width, size.height) {
            return Err(refuse(format!(
                "is {}×{} px, but its camera is for {size} px",
                depths.width(),
                depths.height()
            )));
        }
        let picture = clips.picture(clip, frame)?;
        let options = LocaliseOptions { maps: true, ..LocaliseOptions::default() };
        let found = localiser.localise(&picture, &clip.camera, options).await?;
        let ball = frame.image.unwrap_or(found.image);
        let Some(maps) = found.maps else { continue };
        let cells = [maps.width, maps.height].map(|count| count as f64);
        for (cell, depth) in maps.depth.iter().enumerate() {
            let at = [cell % maps.width, cell / maps.width];
            let at: [f64; 2] =
                std::array::from_fn(|axis| (at[axis] as f64 + 0.5) * size.xy()[axis] / cells[axis] - 0.5);
            let [x, y] = at.map(|at| at.round() as u32);
            let truth = f64::from(depths.get_pixel(x.min(size.width - 1), y.min(size.height - 1)).0[0]) * UNIT;
            let near = distance(&Point2::from(at), &Point2::from(ball)) < NEAR_BALL * f64::from(size.height);
            if truth > 0.0 && !near {
                pairs.push([f64::from(*depth), truth]);
            }
        }
    }
    let truths: Vec<f64> = pairs.iter().map(|[_, truth]| *truth).collect();
    let constant = Statistic::of(truths.iter().copied()).median.unwrap_or_default();
    Ok(Some(DepthMapScore {
        pictures: count,
        correlation: correlation(&pairs),
        error_relative: Statistic::of(pairs.iter().map(|[found, truth]| (found / truth - 1.0).abs())),
        error_of_constant: Statistic::of(truths.iter().map(|truth| (constant / truth - 1.0).abs())),
    }))
}

/// Pearson's correlation; 0 where either side is constant.
pub(super) fn correlation(pairs: &[[f64; 2]]) -> f64 {
    let mean = |side: usize| pairs.iter().map(|pair| pair[side]).sum::<f64>() / pairs.len().max(1) as f64;
    let means = [mean(0), mean(1)];
    let product =
        |a: usize, b: usize| pairs.iter().map(|pair| (pair[a] - means[a]) * (pair[b] - means[b])).sum::<f64>();
    let spread = (product(0, 0) * product(1, 1)).sqrt();
    if spread > 0.0 { product(0, 1) / spread } else { 0.0 }
}
