//! The output maps of a network that reads sizes: run on a part of a picture, at once or in tiles, and decoded into peaks.

use burn::tensor::Transaction;
use image::RgbImage;
use nalgebra::Point2;

use super::{Localiser, Maps, Region, device_name};
use crate::model::{self, Peak, SizeMaps};
use gravisight_geometry::camera::{Detection, Outline};
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::image::tile;
use gravisight_geometry::size::Size;

/// Most pixels that the network is run on at once: a little more than 1920×1088. Larger pictures are searched in tiles.
const MAX_PIXELS: usize = 2_200_000;
/// Side of a tile, and by how much neighbours overlap, px: twice what a ball of the largest radius needs around it.
const TILE: u32 = 1024;
const OVERLAP: u32 = 256;
/// Cells of the heatmap in training; the background of many more of them would outweigh a ball's peak.
const TRAINING_CELLS: f64 = 4096.0;
/// Standard deviation of log(radius) over the scale of its Laplace distribution: between that distribution's own, √2, and
/// the 1.15 within which 68 % of it lie. Chosen, not fitted.
const SIGMA_OF_SCALE: f64 = 1.3;

/// The output maps of a part of a picture, row-major.
pub(super) struct OutputMaps {
    columns: usize,
    stride: usize,
    logits: Vec<f32>,
    radius: Vec<f32>,
    log_scale: Vec<f32>,
}

impl OutputMaps {
    /// Probability of each cell: the heatmap's softmax. In f64, since there are hundreds of thousands of cells.
    pub(super) fn probability(&self) -> Vec<f32> {
        let most = self.logits.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let powers: Vec<f32> = self.logits.iter().map(|logit| (logit - most).exp()).collect();
        let sum: f64 = powers.iter().map(|&power| f64::from(power)).sum();
        powers.iter().map(|&power| (f64::from(power) / sum) as f32).collect()
    }

    /// The `count` highest peaks. A peak's confidence is its fraction of the mass of all peaks and of the background, of which a
    /// large picture has more than those in training: the background counts as if it had [`TRAINING_CELLS`] cells.
    pub(super) fn peaks(&self, count: usize) -> Vec<Peak> {
        let probability = self.probability();
        let cells = probability.len() as f64;
        let maps = SizeMaps {
            width: self.columns,
            stride: self.stride,
            probability,
            radius: self.radius.clone(),
            log_scale: self.log_scale.clone(),
        };
        let mut found = model::peaks(&maps, count);
        let in_peaks: f64 = found.iter().map(|peak| peak.confidence).sum();
        let all = in_peaks + (1.0 - in_peaks).max(0.0) * (TRAINING_CELLS / cells).min(1.0);
        found.iter_mut().for_each(|peak| peak.confidence = (peak.confidence / all).clamp(0.0, 1.0));
        found
    }

    /// The cells whose centres lie in the first `width` columns and `height` rows of pixels: the network's input is larger, a multiple of
    /// its strides.
    fn within(self, width: u32, height: u32) -> Self {
        let cells = |side: u32| (side as usize + self.stride / 2) / self.stride;
        let (columns, rows) = (cells(width), cells(height));
        let part = |map: &[f32]| -> Vec<f32> {
            map.chunks_exact(self.columns).take(rows).flat_map(|row| &row[..columns]).copied().collect()
        };
        let [logits, radius, log_scale] = [&self.logits, &self.radius, &self.log_scale].map(|map| part(map));
        Self { columns, stride: self.stride, logits, radius, log_scale }
    }

    /// Cells of the maps.
    pub(super) fn cells(&self) -> usize {
        self.logits.len()
    }

    /// The maps over a whole picture of `size`, of which only `region` was searched; the heatmap is 0 elsewhere. `depth` holds radii,
    /// px.
    pub(super) fn over_picture(&self, region: Region, size: Size) -> Maps {
        let (stride, probability) = (self.stride, self.probability());
        let [width, height] = [size.width, size.height].map(|side| (side as usize).div_ceil(stride));
        let mut maps = Maps { width, height, heatmap: vec![0.0; width * height], depth: vec![1.0; width * height] };
        let [left, top] = [region.left, region.top].map(|side| side as usize / stride);
        for (row, line) in probability.chunks_exact(self.columns).enumerate().take(height - top) {
            let count = self.columns.min(width - left);
            let to = (top + row) * width + left;
            maps.heatmap[to..to + count].copy_from_slice(&line[..count]);
            let from = row * self.columns;
            maps.depth[to..to + count].copy_from_slice(&self.radius[from..from + count]);
        }
        maps
    }
}

impl From<Peak> for Detection {
    fn from(peak: Peak) -> Self {
        Self {
            outline: Outline { centre: Point2::from(peak.image), radius: peak.radius },
            log_sigma: SIGMA_OF_SCALE * peak.log_scale,
            confidence: peak.confidence,
        }
    }
}

impl Localiser {
    /// The output maps of a part of a picture: at once, or tile by tile.
    pub(super) async fn output_maps(&self, rgb: &RgbImage, region: Region) -> Result<OutputMaps> {
        let multiple = self.config.input_multiple();
        let stride = self.config.output_stride();
        let up = |side: u32| side.div_ceil(multiple) * multiple;
        let Region { left, top, width, height } = region;
        if up(width) as usize * up(height) as usize <= MAX_PIXELS {
            let maps = self.output_maps_at(rgb, left, top, Size::new(up(width), up(height))).await?;
            return Ok(maps.within(width, height));
        }
        let columns = up(width) as usize / stride;
        let rows = up(height) as usize / stride;
        let none = || vec![0.0; columns * rows];
        let mut whole = OutputMaps { columns, stride, logits: none(), radius: none(), log_scale: none() };
        let starts = |side: u32| -> Vec<u32> {
            let last = up(side).saturating_sub(TILE);
            (0..last).step_by((TILE - OVERLAP) as usize).chain([last]).collect()
        };
        for &y in &starts(height) {
            for &x in &starts(width) {
                let size = Size::new(TILE.min(up(width)), TILE.min(up(height)));
                let part = self.output_maps_at(rgb, left + x, top + y, size).await?;
                // Within half the overlap of its edge a tile lacks context; its neighbour has it.
                let margin = |start: u32| if start == 0 { 0 } else { (OVERLAP / 2) as usize / stride };
                let (first_row, first_column) = (y as usize / stride, x as usize / stride);
                for row in margin(y)..part.logits.len() / part.columns {
                    let from = row * part.columns + margin(x)..(row + 1) * part.columns;
                    let to = (first_row + row) * columns + first_column + margin(x);
                    let to = to..to + from.len();
                    whole.logits[to.clone()].copy_from_slice(&part.logits[from.clone()]);
                    whole.radius[to.clone()].copy_from_slice(&part.radius[from.clone()]);
                    whole.log_scale[to].copy_from_slice(&part.log_scale[from]);
                }
            }
        }
        Ok(whole.within(width, height))
    }

    /// The output maps of the part of `size` that begins at (`left`, `top`).
    pub(super) async fn output_maps_at(&self, rgb: &RgbImage, left: u32, top: u32, size: Size) -> Result<OutputMaps> {
        self.output_maps_of(tile(rgb, [left, top], size, &self.card.normalisation), size).await
    }

    /// The output maps of a normalised input of `size`.
    pub(super) async fn output_maps_of(&self, values: Vec<f32>, size: Size) -> Result<OutputMaps> {
        let output = self.runner(size).run(values);
        let [_, _, columns] = output.depth.dims();
        let failed = |reason: String| Error::Device { device: device_name(&self.device), reason };
        let log_scale = output.log_scale.ok_or_else(|| failed("the network does not measure apparent size".into()))?;
        let data = Transaction::default()
            .register(output.heatmap.mul_scalar(self.config.heatmap.beta))
            .register(output.depth)
            .register(log_scale)
            .execute_async()
            .await
            .map_err(|error| failed(error.to_string()))?;
        let parts: Vec<Vec<f32>> = data.iter().map(|part| part.iter::<f32>().collect()).collect();
        let Ok([logits, radius, log_scale]) = <[Vec<f32>; 3]>::try_from(parts) else {
            return Err(failed("the read-back returned another number of tensors than were registered".into()));
        };
        if [&logits, &radius, &log_scale].into_iter().flatten().any(|value| !value.is_finite()) {
            return Err(Error::OutputNotFinite { device: device_name(&self.device) });
        }
        Ok(OutputMaps { columns, stride: self.config.output_stride(), logits, radius, log_scale })
    }
}
