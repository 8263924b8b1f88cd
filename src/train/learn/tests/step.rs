//! A training step: its losses, their gradients, what it does to the weights.

use burn::module::{Module as _, ModuleMapper, ModuleVisitor, Param};
use burn::optim::{AdamWConfig, GradientsParams, ModuleOptimizer};
use burn::tensor::{Device, Tensor, TensorData};
use pollster::block_on;

use super::super::ema::Ema;
use super::super::knowledge::Knowledge;
use super::super::loss::map_losses;
use super::super::optimiser::AdamW;
use super::super::step::{StepOptions, step};
use crate::model::{BackboneConfig, HeadConfig, HeatmapConfig, Pen, PenConfig, PenOutput, load_backbone, save};
use crate::testing::{alone, formula, formula_tensor, safetensors_of, vector};
use crate::train::examples::{Batch, Labels};
use crate::train::recipe::HeatmapLoss;

const CROSS_ENTROPY: HeatmapLoss = HeatmapLoss::CrossEntropy { sigma: 4.0 };

pub(super) fn tiny() -> PenConfig {
    let backbone = BackboneConfig::Compact { stem: 4, stages: [4, 6, 8, 8], pyramid: 4, input_channels: 3 };
    PenConfig { backbone, ..PenConfig::compact(7.4) }
}

/// A batch of two pictures from the formula, balls inside.
pub(super) fn batch() -> Batch {
    let pictures = formula("batch", 2 * 3 * 32 * 64).into_iter().map(|value| value as f32).collect();
    Batch {
        pictures,
        channels: 3,
        size: [32, 64],
        labels: Labels {
            picture: vec![0, 1],
            image: vec![Some([20.3, 11.8]), Some([47.1, 20.2])],
            depth: vec![7.0, 8.1],
            depth_weight: vec![1.0, 0.6],
        },
        windows: vec![],
    }
}

pub(super) fn options(learning_rate: f64) -> StepOptions {
    StepOptions {
        heatmap_loss: CROSS_ENTROPY,
        depth_weight: 0.2,
        future_weight: 0.0,
        robust_px: None,
        depth_transition: 0.05,
        centre_weight: 0.0,
        clip_norm: 5.0,
        learning_rate,
    }
}

#[test]
fn repeated_steps_on_one_batch_learn_it() {
    let _alone = alone();
    let device = Device::flex().autodiff();
    device.seed(5);
    let mut pen = Pen::new(&tiny(), &device).unwrap();
    let mut optimiser = AdamW::new(1e-4, 1e-5);
    let mut losses = Vec::new();
    for _ in 0..60 {
        let (next, report) =
            block_on(step(pen, &mut optimiser, batch(), &options(1e-2), &mut Knowledge::default(), &device)).unwrap();
        pen = next;
        losses.push(report.loss);
    }
    assert!(losses[59] < 0.6 * losses[0], "{} -> {}", losses[0], losses[59]);
}

#[test]
fn the_optimiser_is_burns_to_the_bit_and_goes_on_from_its_moments() {
    let _alone = alone();
    let device = Device::flex().autodiff();
    device.seed(6);
    let first = Pen::new(&tiny(), &device).unwrap();
    let gradients = |pen: &Pen| {
        let pictures = TensorData::new(batch().pictures, [2, 32, 64, 3]);
        let output = pen.forward(Tensor::from_data(pictures, &device));
        let loss = map_losses(output, &batch().labels, &tiny(), CROSS_ENTROPY, 0.05, true);
        GradientsParams::from_grads((loss.heatmap + loss.depth).backward(), pen)
    };
    let mut burns: ModuleOptimizer = AdamWConfig::new().with_weight_decay(0.01).init();
    let (mut theirs, mut ours, mut optimiser) = (first.clone(), first, AdamW::new(0.01, 1e-5));
    for step in 0..5 {
        let these = gradients(&theirs);
        theirs = burns.step(1e-2, theirs, these);
        let these = gradients(&ours);
        ours = optimiser.step(1e-2, ours, these);
        assert!(save(&theirs.valid()).unwrap() == save(&ours.valid()).unwrap(), "step {step}");
        // As after a stop.
        optimiser = AdamW::after(0.01, 1e-5, step + 1, &optimiser.moments(&ours));
    }
}

#[test]
fn a_backbone_from_timm_weights_goes_on_learning() {
    let _alone = alone();
    let device = Device::flex().autodiff();
    device.seed(2);
    let head = HeadConfig::Paper { channels: [4, 4, 4] };
    let backbone = BackboneConfig::ResNet34 { width: 4 };
    let config = PenConfig { backbone, head, heatmap: HeatmapConfig { beta: 0.2 }, ..PenConfig::paper() };
    let pen = Pen::new(&config, &device).unwrap();
    let bytes = save(&pen).unwrap();
    let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let timm = file.tensors().into_iter().filter_map(|(name, view)| {
        let name = name.strip_prefix("backbone.")?.to_string();
        let values = formula_tensor(&name, view.shape());
        Some((name, view.shape().to_vec(), values))
    });
    let pen = load_backbone(pen, safetensors_of(timm.collect())).unwrap();
    let kernel = |pen: &Pen| {
        let bytes = save(pen).unwrap();
        vector(&safetensors::SafeTensors::deserialize(&bytes).unwrap().tensor("backbone.conv1.weight").unwrap())
    };
    let before = kernel(&pen);
    assert_eq!(before, formula_tensor("conv1.weight", &[4, 3, 7, 7]));
    let mut optimiser = AdamW::new(1e-4, 1e-5);
    let (pen, report) =
        block_on(step(pen, &mut optimiser, batch(), &options(1e-2), &mut Knowledge::default(), &device)).unwrap();
    assert!(report.loss.is_finite());
    let moved = kernel(&pen).iter().zip(&before).filter(|(after, before)| after != before).count();
    assert!(moved > before.len() / 2, "{moved} of {}", before.len());
}

#[test]
fn a_diverging_step_reports_it_and_leaves_the_weights_alone() {
    let _alone = alone();
    let device = Device::flex().autodiff();
    let pen = Pen::new(&tiny(), &device).unwrap();
    let before = save(&pen).unwrap();
    let mut optimiser = AdamW::new(1e-4, 1e-5);
    let mut bad = batch();
    bad.pictures[7] = f32::NAN;
    let (pen, report) =
        block_on(step(pen, &mut optimiser, bad, &options(1e-2), &mut Knowledge::default(), &device)).unwrap();
    assert!(!report.loss.is_finite());
    let (before, after) = (before, save(&pen).unwrap());
    let read = |bytes: &[u8]| {
        let file = safetensors::SafeTensors::deserialize(bytes).unwrap();
        vector(&file.tensor("backbone.stem.conv.weight").unwrap())
    };
    assert_eq!(read(&before), read(&after));
}

/// Adds these numbers to the first parameter of rank `RANK`.
struct Nudge<const RANK: usize>(Option<Vec<f32>>);

impl<const RANK: usize> ModuleMapper for Nudge<RANK> {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        if D != RANK {
            return param;
        }
        let Some(by) = self.0.take() else { return param };
        param.map(|tensor| {
            let values = tensor.to_data().try_to_vec::<f32>().unwrap();
            let values: Vec<f32> = values.iter().zip(by).map(|(value, by)| value + by).collect();
            Tensor::from_data(TensorData::new(values, tensor.dims()), &tensor.device()).require_grad()
        })
    }
}

/// The gradient of the first parameter of rank `RANK`.
struct First<'a, const RANK: usize>(&'a GradientsParams, Option<Vec<f32>>);

impl<const RANK: usize> ModuleVisitor for First<'_, RANK> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        if D == RANK && self.1.is_none() {
            self.1 = Some(self.0.get::<D>(param.id).unwrap().into_data().try_to_vec().unwrap());
        }
    }
}

#[test]
fn the_losses_gradients_equal_central_differences() {
    // On the maps themselves, where the loss is smooth: every cell's derivative by both losses.
    let device = Device::flex().autodiff();
    let maps = |name: &str, scale: f64, offset: f64| -> Vec<f32> {
        formula(name, 2 * 8 * 16).into_iter().map(|value| (offset + scale * value) as f32).collect()
    };
    let (heatmap, depth) = (maps("heatmap", 1.0, 0.0), maps("depth", 0.5, 7.0));
    let labels = batch().labels;
    for loss in [CROSS_ENTROPY, HeatmapLoss::Mse { amplitude: 3.0, sigma: 4.0 }] {
        let total = |heatmap: &Tensor<3>, depth: &Tensor<3>| {
            let output = PenOutput { heatmap: heatmap.clone(), depth: depth.clone(), log_scale: None };
            let losses = map_losses(output, &labels, &tiny(), loss, 0.05, false);
            losses.heatmap + losses.depth.mul_scalar(0.2)
        };
        let tensor = |values: &[f32]| Tensor::<3>::from_data(TensorData::new(values.to_vec(), [2, 8, 16]), &device);
        let (h, d) = (tensor(&heatmap).require_grad(), tensor(&depth).require_grad());
        let gradients = total(&h, &d).backward();
        let read = |tensor: Tensor<3>| tensor.into_data().try_to_vec::<f32>().unwrap();
        let (dh, dd) = (read(h.grad(&gradients).unwrap()), read(d.grad(&gradients).unwrap()));
        let at =
            |heatmap: &[f32], depth: &[f32]| f64::from(total(&tensor(heatmap), &tensor(depth)).into_scalar::<f32>());
        let step = 1e-2_f32;
        for index in (0..256).step_by(17) {
            let moved = |values: &[f32], by: f32| {
                let mut values = values.to_vec();
                values[index] += by;
                values
            };
            let heat =
                (at(&moved(&heatmap, step), &depth) - at(&moved(&heatmap, -step), &depth)) / f64::from(2.0 * step);
            assert!((heat - f64::from(dh[index])).abs() < 2e-3, "{loss:?} heatmap {index}: {heat} {}", dh[index]);
            let deep =
                (at(&heatmap, &moved(&depth, step)) - at(&heatmap, &moved(&depth, -step))) / f64::from(2.0 * step);
            assert!((deep - f64::from(dd[index])).abs() < 2e-3, "{loss:?} depth {index}: {deep} {}", dd[index]);
        }
    }
}

#[test]
fn gradients_through_the_whole_network_equal_central_differences() {
    // The stem's convolution (first of rank 4) and its norm (first of rank 1): the longest ways.
    let _alone = alone();
    let device = Device::flex().autodiff();
    let convnext = |response_norm: bool| {
        let backbone = BackboneConfig::ConvNext { depths: [1, 1, 1, 1], widths: [4, 6, 8, 8], response_norm };
        let (head, heatmap) = (HeadConfig::Paper { channels: [6, 6, 4] }, HeatmapConfig { beta: 0.2 });
        PenConfig { backbone, head, heatmap, ..PenConfig::paper() }
    };
    for config in [tiny(), convnext(false), convnext(true)] {
        device.seed(11);
        let pen = Pen::new(&config, &device).unwrap();
        let gradients = GradientsParams::from_grads(loss_of(&pen, &device).backward(), &pen);
        assert_slope::<4>(&pen, &gradients, &device);
        assert_slope::<1>(&pen, &gradients, &device);
    }
}

fn loss_of(pen: &Pen, device: &Device) -> Tensor<1> {
    let batch = batch();
    let pictures = Tensor::from_data(TensorData::new(batch.pictures, [2, 32, 64, 3]), device);
    let losses = map_losses(pen.forward(pictures), &batch.labels, pen.config(), CROSS_ENTROPY, 0.5, false);
    losses.heatmap + losses.depth.mul_scalar(0.2)
}

/// Along its own direction the gradient's slope is its norm. A short step: the network has many kinks.
fn assert_slope<const RANK: usize>(pen: &Pen, gradients: &GradientsParams, device: &Device) {
    let mut first = First::<RANK>(gradients, None);
    pen.visit(&mut first);
    let gradient = first.1.unwrap();
    let norm = gradient.iter().map(|value| value * value).sum::<f32>().sqrt();
    let step = 1e-4;
    let at = |step: f32| {
        let by = gradient.iter().map(|value| value * step / norm).collect();
        let moved = pen.clone().map(&mut Nudge::<RANK>(Some(by)));
        f64::from(loss_of(&moved, device).into_scalar::<f32>())
    };
    let slope = (at(step) - at(-step)) / f64::from(2.0 * step);
    assert!((slope / f64::from(norm) - 1.0).abs() < 0.02, "rank {RANK}: {slope} {norm}");
}

#[test]
fn the_average_moves_by_its_decay_from_a_tenth_up() {
    let _alone = alone();
    let device = Device::flex().autodiff();
    device.seed(1);
    let first = Pen::new(&tiny(), &device).unwrap();
    let second = first.clone().map(&mut Nudge::<4>(Some(vec![1.0; 4 * 3 * 5 * 5])));
    let stem = |pen: &Pen| {
        let bytes = save(pen).unwrap();
        let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
        vector(&file.tensor("backbone.stem.conv.weight").unwrap())[0]
    };
    let start = stem(&first);
    // Without a warm-up, as in the paper, it is the full decay from the first update on.
    for (updates, decay) in [(Some(0), 0.1), (Some(100_000), 0.998), (None, 0.998)] {
        let mut ema = Ema::new(first.valid(), 0.998, updates);
        ema.update(&second);
        let moved = f64::from(stem(&ema.model()) - start);
        assert!((moved - (1.0 - decay)).abs() < 1e-3, "{updates:?}: {moved}");
    }
}
