//! Which pixels the depth depends on.

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};

use super::{Localiser, device_name};
use crate::error::{Error, Result};
use crate::image::Picture;
use crate::model::decode;

/// How the depth found depends on the picture: paper, "Interpretation of the learning process".
#[derive(Debug, Clone)]
pub struct Saliency {
    /// Pixels in a row: those of the network's input that the picture fills.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// ∂depth/∂brightness of each pixel, row-major: the sum over the colour channels, each 1 at full
    /// brightness; m.
    pub values: Vec<f32>,
    /// The depth found, m.
    pub depth: f64,
}

impl Localiser {
    /// How the depth found in `picture` depends on each of its pixels, through the whole network and its
    /// decoding. Runs on the CPU, whatever the localiser's device.
    ///
    /// # Errors
    /// [`Error::OutputNotFinite`]; [`Error::Device`] where the gradients cannot be read; [`Error::Value`] for a model that
    /// reads sizes: its depth depends on the ball's outline, and on the radius given.
    pub fn saliency(&self, picture: &Picture) -> Result<Saliency> {
        if self.reads_size() {
            let reason =
                format!("is for models that give depth themselves; `{}` reads the ball's size", self.card.name);
            return Err(Error::value("saliency", "model", reason));
        }
        let device = Device::flex().autodiff();
        let input = picture.network_input(self.card.input, &self.card.normalisation);
        let [width, height] = [input.size.width, input.size.height].map(|side| side as usize);
        let values = TensorData::new(input.values, [1, height, width, 3]);
        let pictures = Tensor::<4>::from_data(values, &device).require_grad();
        // The weights are constants here, and the norms those of inference.
        let pen = self.pen.clone().freeze().to_device(&Device::flex()).train();
        let depth = decode(pen.forward(pictures.clone()), &self.config).depth;
        let failed = |reason: String| Error::Device { device: device_name(&device), reason };
        let gradient = pictures.grad(&depth.backward()).ok_or_else(|| failed("no gradient came back".into()))?;
        let numbers = |data: TensorData| data.iter::<f32>().collect::<Vec<f32>>();
        let depth = numbers(depth.into_data());
        // Brightness, not the normalised value.
        let std = self.card.normalisation.std;
        let sum = |pixel: &[f32]| pixel.iter().zip(std).map(|(gradient, std)| gradient / std).sum();
        let [columns, rows] = [input.content.width, input.content.height].map(|side| side as usize);
        let values: Vec<f32> = (numbers(gradient.into_data()).chunks_exact(3 * width).take(rows))
            .flat_map(|row| row.chunks_exact(3).take(columns).map(sum))
            .collect();
        if values.iter().chain(&depth).any(|value| !value.is_finite()) {
            return Err(Error::OutputNotFinite { device: device_name(&device) });
        }
        Ok(Saliency { width: columns, height: rows, values, depth: f64::from(depth[0]) })
    }
}
