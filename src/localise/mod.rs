//! One picture, one camera, one model: the ball's 3D position.
//!
//! The only room that knows both model and camera.

mod saliency;
#[cfg(test)]
mod tests;

use burn::tensor::activation::softmax;
use burn::tensor::{Device, Transaction};
use nalgebra::Point2;
use serde::Serialize;

pub use self::saliency::Saliency;
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::image::Picture;
use crate::model::{self, Card, Pen, PenConfig, PenRunner};
use crate::size::Size;

/// Largest difference between two devices' maps that rounding explains: of a probability, and of a
/// depth as a share of the largest in the training data.
const DEVICE_TOLERANCE: f32 = 1e-2;

/// A loaded model on a device, ready for pictures.
pub struct Localiser {
    runner: PenRunner,
    config: PenConfig,
    card: Card,
    device: Device,
}

/// What [`Localiser::localise`] does besides finding the ball.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LocaliseOptions {
    /// Return the network's maps, too ([`Localisation::maps`]).
    pub maps: bool,
}

/// Where the ball is. Serialises as FORMATS.md's `localise` result.
#[derive(Debug, Clone, Serialize)]
pub struct Localisation {
    /// 2D position in the picture given, px (first pixel's centre is (0, 0)).
    pub image: [f64; 2],
    /// Camera z, m.
    pub depth: f64,
    /// Position in the camera frame, m.
    pub camera: [f64; 3],
    /// Position in the world frame, m.
    pub world: [f64; 3],
    /// Share of the heatmap's mass around the position found, 0 to 1.
    pub confidence: f64,
    /// What a user should know about this result, in words.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// The network's maps, where asked for.
    #[serde(skip)]
    pub maps: Option<Maps>,
}

/// The network's maps over the whole picture (where it was padded to the input's shape, to within a
/// cell); row-major.
#[derive(Debug, Clone)]
pub struct Maps {
    /// Cells in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Probability of each cell.
    pub heatmap: Vec<f32>,
    /// Depth (camera z) of each cell, m.
    pub depth: Vec<f32>,
}

impl Localisation {
    /// Distance to the true position in the world frame, m: DtG of one picture (paper, "Evaluation Metrics").
    pub fn dtg(&self, truth: [f64; 3]) -> f64 {
        nalgebra::distance(&self.world.into(), &truth.into())
    }
}

impl Localiser {
    /// Loads `weights` on `device` after checking them against `card`.
    ///
    /// # Errors
    /// [`Error::WeightsFile`], [`Error::WeightsSha256`], [`Error::WeightsArchitecture`],
    /// [`Error::WeightsNotFinite`].
    pub fn new(card: Card, weights: Vec<u8>, device: &Device) -> Result<Self> {
        card.check_weights(&weights)?;
        let pen = model::load(&card.architecture, weights, device)?;
        Ok(Self::from_pen(pen, card, device))
    }

    /// A localiser from a network already in memory.
    pub fn from_pen(pen: Pen, card: Card, device: &Device) -> Self {
        let config = pen.config().clone();
        let runner = pen.runner(card.input, device);
        Self { runner, config, card, device: device.clone() }
    }

    /// The model's card.
    pub fn card(&self) -> &Card {
        &self.card
    }

    /// Radius around the position found that [`Localisation::confidence`] speaks of, px of a picture of `size`.
    pub fn confidence_radius(&self, size: Size) -> f64 {
        let ([width, height], [columns, rows]) = (size.xy(), self.card.input.xy());
        model::CONFIDENCE_RADIUS * (width / columns).max(height / rows)
    }

    /// Runs the network once on an empty picture, so that the first real one pays for nothing
    /// (memory, and on a GPU the compilation of its kernels).
    ///
    /// # Errors
    /// [`Error::OutputNotFinite`], [`Error::Device`].
    pub async fn warm_up(&self) -> Result<()> {
        self.run(self.test_pattern()).await.map(|_| ())
    }

    /// Refuses a device whose maps differ from those of `reference`, the same model on another
    /// device, on a test pattern. Warms up both.
    ///
    /// # Errors
    /// [`Error::Device`] with the difference; else as [`Self::warm_up`].
    pub async fn check_against(&self, reference: &Self) -> Result<()> {
        let found = self.run(self.test_pattern()).await?;
        let expected = reference.run(self.test_pattern()).await?;
        let largest = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        let heatmap = largest(&found.probability, &expected.probability);
        let most = expected.depth_map.iter().copied().fold(f32::MIN_POSITIVE, f32::max);
        let depth = largest(&found.depth_map, &expected.depth_map) / most;
        if heatmap.max(depth) <= DEVICE_TOLERANCE {
            return Ok(());
        }
        let reason = format!(
            "its output is wrong (off by {heatmap:.1e} in the heatmap, {depth:.1e} of the largest depth \
             from the CPU's), so it is not used"
        );
        Err(Error::Device { device: device_name(&self.device), reason })
    }

    /// A picture's worth of values with every frequency in it, `[height, width, 3]`.
    fn test_pattern(&self) -> Vec<f32> {
        let count = 3 * self.card.input.pixels();
        (0..count).map(|index| ((index as f64).powf(1.5) * 0.01).sin() as f32).collect()
    }

    /// The ball's position in `picture`, taken by `camera` (scaled to the picture where the aspect
    /// ratio agrees).
    ///
    /// # Errors
    /// [`Error::CameraMismatch`] for a camera of another aspect ratio; [`Error::OutputNotFinite`]
    /// and [`Error::Device`] for a device that fails; [`Error::Distortion`] for a position outside
    /// the lens model's range.
    pub async fn localise(&self, picture: &Picture, camera: &Camera, options: LocaliseOptions) -> Result<Localisation> {
        let size = picture.size();
        let camera_of_picture = camera.for_picture(size)?;
        let input = picture.network_input(self.card.input, &self.card.normalisation);
        let raw = self.run(input.values).await?;

        let (given, content) = (size.xy(), input.content.xy());
        let scale = [0, 1].map(|axis| given[axis] / content[axis]);
        let image: [f64; 2] = std::array::from_fn(|axis| (raw.image[axis] + 0.5) * scale[axis] - 0.5);
        let in_camera = camera_of_picture.camera_from_image(&Point2::from(image), raw.depth)?;
        let in_world = camera_of_picture.world_from_camera(&in_camera);
        let stride = self.config.output_stride();
        let mut notes = picture.notes().to_vec();
        if size != camera.size() {
            notes.push(format!("camera.json is for a {} picture; scaled to this one's {size}", camera.size()));
        }
        let confidence = model::confidence(&raw.probability, raw.width, stride, raw.image);
        if let Some(threshold) = self.card.confidence_threshold.filter(|&threshold| confidence < threshold) {
            notes.push(format!("there is probably no ball: the confidence is below the model's {threshold:.2}"));
        }
        Ok(Localisation {
            image,
            depth: raw.depth,
            camera: in_camera.coords.into(),
            world: in_world.coords.into(),
            confidence,
            notes,
            maps: options.maps.then(|| raw.maps(input.content, stride)),
        })
    }

    /// Runs the network on one normalised picture `[height, width, 3]` and reads its maps back.
    async fn run(&self, values: Vec<f32>) -> Result<RawOutput> {
        let output = self.runner.run(values);
        let [_, _, cells] = output.depth.dims();
        let depth_map = output.depth.clone();
        let decoded = model::decode(output, &self.config);
        let failed = |reason: String| Error::Device { device: device_name(&self.device), reason };
        let data = Transaction::default()
            .register(decoded.image)
            .register(decoded.depth)
            .register(decoded.probability)
            .register(depth_map)
            .execute_async()
            .await
            .map_err(|error| failed(error.to_string()))?;
        let parts: Vec<Vec<f32>> = data.iter().map(|part| part.iter::<f32>().collect()).collect();
        let Ok([image, depth, probability, depth_map]) = <[Vec<f32>; 4]>::try_from(parts) else {
            return Err(failed("the read-back returned another number of tensors than asked for".into()));
        };
        if [&image, &depth, &probability, &depth_map].into_iter().flatten().any(|value| !value.is_finite()) {
            return Err(Error::OutputNotFinite { device: device_name(&self.device) });
        }
        Ok(RawOutput {
            image: [f64::from(image[0]), f64::from(image[1])],
            depth: f64::from(depth[0]),
            probability,
            depth_map,
            width: cells,
        })
    }
}

/// Standard deviation of log(radius) over the scale of its Laplace distribution: between that distribution's own, √2, and
/// the 1.15 that hold 68 % of it.
const SIGMA_OF_SCALE: f64 = 1.3;

/// What a network that reads sizes says of a picture, px of it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reading {
    /// Centre of the ball's outline.
    pub image: [f64; 2],
    /// Semi-minor axis of the ball's outline.
    pub size: f64,
    /// Standard deviation of log(size).
    pub log_sigma: f64,
    /// Share of the heatmap's mass around the centre, 0 to 1.
    pub confidence: f64,
}

impl Localiser {
    /// The likeliest place and size of the ball in `picture`, by a network that reads sizes, without any camera.
    ///
    /// # Errors
    /// [`Error::OutputNotFinite`] and [`Error::Device`].
    pub(crate) async fn read(&self, picture: &Picture) -> Result<Reading> {
        let input = picture.network_input(self.card.input, &self.card.normalisation);
        let maps = self.size_maps(input.values).await?;
        let (given, content) = (picture.size().xy(), input.content.xy());
        let scale = [0, 1].map(|axis| given[axis] / content[axis]);
        let Some(peak) = model::peaks(&maps, 1).pop() else {
            return Err(Error::OutputNotFinite { device: device_name(&self.device) });
        };
        Ok(Reading {
            image: std::array::from_fn(|axis| (peak.image[axis] + 0.5) * scale[axis] - 0.5),
            size: peak.radius * (scale[0] * scale[1]).sqrt(),
            log_sigma: SIGMA_OF_SCALE * peak.log_scale,
            confidence: peak.confidence,
        })
    }

    /// Runs a network that reads sizes on one normalised picture `[height, width, 3]` and reads its maps back.
    async fn size_maps(&self, values: Vec<f32>) -> Result<model::Maps> {
        let output = self.runner.run(values);
        let [_, height, width] = output.depth.dims();
        let failed = |reason: String| Error::Device { device: device_name(&self.device), reason };
        let logits = output.heatmap.mul_scalar(self.config.heatmap.beta).reshape([1, height * width]);
        let log_scale = output.log_scale.ok_or_else(|| failed("the network does not read sizes".into()))?;
        let data = Transaction::default()
            .register(softmax(logits, 1))
            .register(output.depth)
            .register(log_scale)
            .execute_async()
            .await
            .map_err(|error| failed(error.to_string()))?;
        let parts: Vec<Vec<f32>> = data.iter().map(|part| part.iter::<f32>().collect()).collect();
        let Ok([probability, radius, log_scale]) = <[Vec<f32>; 3]>::try_from(parts) else {
            return Err(failed("the read-back returned another number of tensors than asked for".into()));
        };
        if [&probability, &radius, &log_scale].into_iter().flatten().any(|value| !value.is_finite()) {
            return Err(Error::OutputNotFinite { device: device_name(&self.device) });
        }
        Ok(model::Maps { width, stride: self.config.output_stride(), probability, radius, log_scale })
    }
}

/// What the network says of one picture, in the frame of its input.
struct RawOutput {
    image: [f64; 2],
    depth: f64,
    probability: Vec<f32>,
    depth_map: Vec<f32>,
    width: usize,
}

impl RawOutput {
    /// The cells that cover the `content` part of the input.
    fn maps(&self, content: Size, stride: usize) -> Maps {
        let [width, height] = [content.width, content.height].map(|side| (side as usize).div_ceil(stride));
        let part = |map: &[f32]| -> Vec<f32> {
            map.chunks_exact(self.width).take(height).flat_map(|row| &row[..width]).copied().collect()
        };
        Maps { width, height, heatmap: part(&self.probability), depth: part(&self.depth_map) }
    }
}

/// Name of a device for messages.
fn device_name(device: &Device) -> String {
    format!("{device:?}")
}
