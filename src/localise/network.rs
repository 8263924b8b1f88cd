//! The network on its device: a runner for each size of input, its read-back, and the comparison of two devices.

use std::sync::{Arc, PoisonError};

use burn::tensor::{Device, Tensor, Transaction};

use super::{Localiser, Maps};
use crate::model::{self, PenRunner};
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::size::Size;
use gravisight_kernels::{for_each_of, threads};

/// Largest difference between two devices' maps that rounding explains: of a probability, and of a
/// depth as a fraction of the largest in the training data.
const DEVICE_TOLERANCE: f32 = 1e-2;

/// Sizes of input for which a runner is kept.
const MAX_RUNNERS: usize = 4;

impl Localiser {
    /// The network, ready for inputs of `size`.
    pub(super) fn runner(&self, size: Size) -> Arc<PenRunner> {
        let mut runners = self.runners.lock().unwrap_or_else(PoisonError::into_inner);
        let known = runners.iter().position(|(known, _)| *known == size);
        let (_, runner) = match known {
            Some(index) => runners.remove(index),
            None => (size, Arc::new(self.pen.clone().runner(size, &self.device))),
        };
        runners.push((size, runner.clone()));
        if runners.len() > MAX_RUNNERS {
            runners.remove(0);
        }
        runner
    }

    /// Whether the network runs on the CPU.
    pub(crate) fn runs_on_cpu(&self) -> bool {
        model::is_cpu(&self.device)
    }

    /// What `find`, which runs the network, says of each of `items`, in their order; of several at the same time where the network
    /// runs on the CPU's threads.
    ///
    /// # Errors
    /// The first of `find`'s.
    pub(crate) async fn find_each<T: Sync, R: Send>(
        &self,
        items: &[T],
        find: impl AsyncFn(&T) -> Result<R> + Sync,
    ) -> Result<Vec<R>> {
        if items.len() > 1 && threads() > 1 && self.runs_on_cpu() {
            let mut found: Vec<Option<Result<R>>> = items.iter().map(|_| None).collect();
            for_each_of(found.iter_mut().zip(items).collect(), |_, (found, item)| {
                *found = Some(pollster::block_on(find(item)));
            });
            return found.into_iter().flatten().collect();
        }
        let mut found = Vec::with_capacity(items.len());
        for item in items {
            found.push(find(item).await?);
        }
        Ok(found)
    }

    /// Runs the network once on an empty picture, so that the first real one pays for nothing
    /// (memory, and on a GPU the compilation of its kernels).
    ///
    /// # Errors
    /// [`Error::OutputNotFinite`], [`Error::Device`].
    pub async fn warm_up(&self) -> Result<()> {
        for (_, network) in self.networks() {
            network.run(network.test_pattern()).await?;
        }
        Ok(())
    }

    /// Refuses a device whose maps differ from those of `reference`, the same model on another
    /// device, on a test pattern. Warms up both.
    ///
    /// # Errors
    /// [`Error::Device`] with the difference; else as [`Self::warm_up`].
    pub async fn check_against(&self, reference: &Self) -> Result<()> {
        for ((name, network), (_, reference)) in self.networks().zip(reference.networks()) {
            network.check_network(name, reference).await?;
        }
        Ok(())
    }

    /// All networks of the model, by name.
    fn networks(&self) -> impl Iterator<Item = (&'static str, &Self)> {
        let Self { verifier, motion, .. } = self;
        let others = [("verifier", verifier.as_deref()), ("motion network", motion.as_deref())];
        [("network", self)].into_iter().chain(others.into_iter().filter_map(|(name, network)| Some((name, network?))))
    }

    async fn check_network(&self, name: &str, reference: &Self) -> Result<()> {
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
            "the output of the model's {name} is wrong (it differs from the CPU's by {heatmap:.1e} in the heatmap and \
             {depth:.1e} of the largest depth), so this device is not used"
        );
        Err(Error::Device { device: device_name(&self.device), reason })
    }

    /// An input's worth of values with every frequency in it.
    fn test_pattern(&self) -> Vec<f32> {
        let count = self.config.input_channels() * self.card.input.pixels();
        (0..count).map(|index| ((index as f64).powf(1.5) * 0.01).sin() as f32).collect()
    }

    /// Runs the network on one normalised picture `[height, width, 3]` and reads its maps back.
    pub(super) async fn run(&self, values: Vec<f32>) -> Result<RawOutput> {
        let output = self.runner(self.card.input).run(values);
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
            return Err(failed("the read-back returned another number of tensors than were registered".into()));
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

impl Localiser {
    /// Runs the network on normalised pictures `[batch, height, width, 3]`, one after the other in `values`, and reads back only
    /// what each shows. Several pictures cost a GPU hardly more than one.
    pub(super) async fn run_all(&self, values: Vec<f32>) -> Result<Vec<Seen>> {
        let decoded = model::decode(self.runner(self.card.input).run(values), &self.config);
        let [batch, _] = decoded.image.dims();
        let column = |values: Tensor<1>| values.reshape([batch, 1]);
        let confidences = column(decoded.confidences(self.config.output_stride()));
        let numbers = Tensor::cat(vec![decoded.image, column(decoded.depth), confidences], 1);
        let device = device_name(&self.device);
        let data = numbers.into_data_async().await;
        let data = data.map_err(|error| Error::Device { device: device.clone(), reason: error.to_string() })?;
        let numbers: Vec<f64> = data.iter::<f64>().collect();
        if numbers.iter().any(|number| !number.is_finite()) {
            return Err(Error::OutputNotFinite { device });
        }
        let (seen, []) = numbers.as_chunks::<4>() else { unreachable!("there are four columns") };
        Ok(seen.iter().map(|&[x, y, depth, confidence]| Seen { image: [x, y], depth, confidence }).collect())
    }
}

/// What the network sees in a picture, px of its input.
pub(super) struct Seen {
    pub(super) image: [f64; 2],
    pub(super) depth: f64,
    pub(super) confidence: f64,
}

/// The decoded output of the network for one picture, px of its input.
pub(super) struct RawOutput {
    pub(super) image: [f64; 2],
    pub(super) depth: f64,
    pub(super) probability: Vec<f32>,
    pub(super) depth_map: Vec<f32>,
    pub(super) width: usize,
}

impl RawOutput {
    /// The cells that cover the `content` part of the input.
    pub(super) fn maps(&self, content: Size, stride: usize) -> Maps {
        let [width, height] = [content.width, content.height].map(|side| (side as usize).div_ceil(stride));
        let part = |map: &[f32]| -> Vec<f32> {
            map.chunks_exact(self.width).take(height).flat_map(|row| &row[..width]).copied().collect()
        };
        Maps { width, height, heatmap: part(&self.probability), depth: part(&self.depth_map) }
    }
}

/// Name of a device for messages.
pub(super) fn device_name(device: &Device) -> String {
    format!("{device:?}")
}
