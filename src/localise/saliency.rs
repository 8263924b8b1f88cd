//! Which pixels the depth depends on.

use burn::module::Module;
use burn::tensor::activation::softmax;
use burn::tensor::{Device, Tensor, TensorData};

use super::{Localiser, device_name};
use crate::model::{CONFIDENCE_RADIUS, PenOutput, cell_centre, decode};
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::image::{Picture, tile};
use gravisight_geometry::size::Size;

/// Side of the part of a picture around the ball on which a radius's saliency is computed, px: the network's receptive field is not
/// larger.
const SIDE: u32 = 256;

/// Added to the logit of a cell that is masked out.
const MASKED: f32 = -1e4;

/// How the depth found depends on the picture: paper, "Interpretation of the learning process".
#[derive(Debug, Clone)]
pub struct Saliency {
    /// Pixels in a row: those of the network's input that the picture fills; of a model that reads sizes the picture's.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// ∂depth/∂brightness of each pixel, row-major: the sum over the colour channels, each 1 at full brightness; m. Of a model that
    /// reads sizes ∂depth/∂brightness as a fraction of the depth (which needs no radius of the ball and no camera): of the first
    /// pass, without crop and edge refinement.
    pub values: Vec<f32>,
    /// The depth found, m; none of a model that reads sizes.
    pub depth: Option<f64>,
}

impl Localiser {
    /// How the depth found in `picture` depends on each of its pixels, through the whole network and its
    /// decoding. Runs on the CPU, whatever the localiser's device.
    ///
    /// # Errors
    /// [`Error::OutputNotFinite`]; [`Error::Device`] where the gradients cannot be read; of a model that reads sizes as
    /// [`Self::localise`].
    pub async fn saliency(&self, picture: &Picture) -> Result<Saliency> {
        if self.reads_size() {
            return self.saliency_of_size(picture).await;
        }
        let input = picture.network_input(self.card.input, &self.card.normalisation);
        let (size, content) = (input.size, input.content);
        let (gradient, depth) = self.slope(input.values, size, |output| decode(output, &self.config).depth)?;
        let [width, columns, rows] = [size.width, content.width, content.height].map(|side| side as usize);
        let values = gradient.chunks_exact(width).take(rows).flat_map(|row| &row[..columns]).copied().collect();
        Ok(Saliency { width: columns, height: rows, values, depth: Some(depth) })
    }

    async fn saliency_of_size(&self, picture: &Picture) -> Result<Saliency> {
        let Size { width, height } = picture.size();
        let mut values = vec![0.0; picture.size().pixels()];
        let candidates = self.first_pass(picture, None, 1, false).await?.candidates;
        if let Some(ball) = candidates.first() {
            let part = Size::square(SIDE);
            let start = |at: f64, side: u32| {
                (at - f64::from(SIDE) / 2.0).clamp(0.0, f64::from(side.saturating_sub(SIDE))) as u32
            };
            let (left, top) = (start(ball.outline.centre.x, width), start(ball.outline.centre.y, height));
            let centre = [ball.outline.centre.x - f64::from(left), ball.outline.centre.y - f64::from(top)];
            let input = tile(picture.rgb(), [left, top], part, &self.card.normalisation);
            let (gradient, _) = self.slope(input, part, |output| self.log_depth(output, centre))?;
            let seen = |start: u32, side: u32| SIDE.min(side - start) as usize;
            for (row, slopes) in gradient.chunks_exact(SIDE as usize).take(seen(top, height)).enumerate() {
                let first = (top as usize + row) * width as usize + left as usize;
                let seen = seen(left, width);
                values[first..first + seen].copy_from_slice(&slopes[..seen]);
            }
        }
        Ok(Saliency { width: width as usize, height: height as usize, values, depth: None })
    }

    /// The logarithm of the depth that the network measures around `centre` (px of its input), up to a constant: `[1]`.
    fn log_depth(&self, output: PenOutput, centre: [f64; 2]) -> Tensor<1> {
        let [batch, height, width] = output.heatmap.dims();
        let stride = self.config.output_stride();
        let far = |cell: usize| {
            let [x, y] = [cell_centre(cell % width, stride) - centre[0], cell_centre(cell / width, stride) - centre[1]];
            if x.hypot(y) > CONFIDENCE_RADIUS { MASKED } else { 0.0 }
        };
        let mask: Vec<f32> = (0..height * width).map(far).collect();
        let cells = [batch, height * width];
        let mask = Tensor::<2>::from_data(TensorData::new(mask, cells), &output.heatmap.device());
        let weights = softmax(output.heatmap.mul_scalar(self.config.heatmap.beta).reshape(cells) + mask, 1);
        (weights * output.depth.log().reshape(cells)).sum().neg()
    }

    /// The derivative of `read` of the output, a number `[1]`, by the brightness of each of `size` pixels of the network's input; and
    /// that number.
    fn slope(&self, input: Vec<f32>, size: Size, read: impl Fn(PenOutput) -> Tensor<1>) -> Result<(Vec<f32>, f64)> {
        let device = Device::flex().autodiff();
        let [width, height] = [size.width, size.height].map(|side| side as usize);
        let pictures = Tensor::<4>::from_data(TensorData::new(input, [1, height, width, 3]), &device).require_grad();
        // The weights are constants here, and the norms those of inference.
        let pen = self.pen.clone().freeze().to_device(&Device::flex()).train();
        let read = read(pen.forward(pictures.clone()));
        let failed = |reason: String| Error::Device { device: device_name(&device), reason };
        let gradient = pictures.grad(&read.backward()).ok_or_else(|| failed("no gradient came back".into()))?;
        let numbers = |data: TensorData| data.iter::<f32>().collect::<Vec<f32>>();
        let number = numbers(read.into_data());
        // Brightness, not the normalised value.
        let std = self.card.normalisation.std;
        let sum = |pixel: &[f32]| pixel.iter().zip(std).map(|(gradient, std)| gradient / std).sum();
        let slopes: Vec<f32> = numbers(gradient.into_data()).chunks_exact(3).map(sum).collect();
        if slopes.iter().chain(&number).any(|value| !value.is_finite()) {
            return Err(Error::OutputNotFinite { device: device_name(&device) });
        }
        Ok((slopes, f64::from(number[0])))
    }
}
