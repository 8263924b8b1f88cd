//! Vulkan, Metal or DX12 against the CPU; scripts/wgpu runs these, on a software Vulkan where there is no GPU.
#![cfg(feature = "wgpu")]

mod common;

use std::sync::LazyLock;

use burn::optim::{AdamWConfig, ModuleOptimizer};
use burn::tensor::Device;
use common::training::alone;
use common::{formula, root};
use gravisight::camera::Camera;
use gravisight::image::Picture;
use gravisight::localise::Localiser;
use gravisight::model::{self, BackboneConfig, Card, Pen, PenConfig};
use gravisight::train::loss::{HeatmapLoss, Labels};
use gravisight::train::step::{Batch, StepOptions, StepReport, step};
use pollster::block_on;
use serde_json::Value;

/// Largest distance of a position from the CPU's, m.
const POSITION: f64 = 1e-3;
/// Largest relative difference of a loss or a gradient's norm from the CPU's: sums of f32 in another order.
const RELATIVE: f64 = 1e-3;

/// A process opens it once.
static GPU: LazyLock<Device> = LazyLock::new(|| Device::wgpu_options().init().expect("no adapter"));

#[test]
fn the_samples_are_found_where_the_cpu_finds_them() {
    let _alone = alone();
    let (card, weights) = Card::with_weights(&root().join("models/sd-l.json")).unwrap();
    let [gpu, cpu] =
        [&*GPU, &Device::flex()].map(|device| Localiser::new(card.clone(), weights.clone(), device).unwrap());
    let folder = root().join("web/public/samples");
    let samples: Vec<Value> = serde_json::from_slice(&std::fs::read(folder.join("samples.json")).unwrap()).unwrap();
    assert!(!samples.is_empty());
    for sample in samples {
        let file = sample["file"].as_str().unwrap();
        let picture = Picture::open(&folder.join(file)).unwrap();
        let camera = Camera::from_json(&sample["camera"].to_string(), file).unwrap();
        let [here, there] = [&gpu, &cpu].map(|found| block_on(found.localise(&picture, &camera, false)).unwrap().world);
        let apart = (0..3).map(|axis| (here[axis] - there[axis]).powi(2)).sum::<f64>().sqrt();
        println!("{file}: {apart:.1e} m apart");
        assert!(apart < POSITION, "{file}: {here:?}, on the CPU {there:?}");
    }
}

/// Two pictures from the formula with a ball in each.
fn batch() -> Batch {
    Batch {
        pictures: formula("batch", 2 * 3 * 32 * 64).into_iter().map(|value| value as f32).collect(),
        size: [32, 64],
        labels: Labels {
            image: vec![Some([20.3, 11.8]), Some([47.1, 20.2])],
            depth: vec![7.0, 8.1],
            depth_weight: vec![1.0, 0.6],
        },
        windows: vec![],
    }
}

/// A step from these weights, and the one after it.
fn two_steps(config: &PenConfig, weights: &[u8], device: &Device) -> [StepReport; 2] {
    let device = device.clone().autodiff();
    let options = StepOptions {
        heatmap_loss: HeatmapLoss::CrossEntropy { sigma: 4.0 },
        depth_weight: 0.2,
        future_weight: 0.0,
        robust_px: None,
        depth_transition: 0.05,
        clip_norm: 5.0,
        learning_rate: 1e-2,
    };
    let mut optimiser: ModuleOptimizer = AdamWConfig::new().init();
    let pen = model::load(config, weights.to_vec(), &device).unwrap();
    let (pen, first) = block_on(step(pen, &mut optimiser, batch(), &options, &device)).unwrap();
    let (_, second) = block_on(step(pen, &mut optimiser, batch(), &options, &device)).unwrap();
    [first, second]
}

#[test]
fn a_training_step_does_what_the_cpus_does() {
    let _alone = alone();
    let backbone = BackboneConfig::Compact { stem: 4, stages: [4, 6, 8, 8], pyramid: 4 };
    let config = PenConfig { backbone, ..PenConfig::compact(7.4) };
    let cpu = Device::flex();
    cpu.seed(5);
    let weights = model::save(&Pen::new(&config, &cpu).unwrap()).unwrap();
    let [ours, expected] = [&*GPU, &cpu].map(|device| two_steps(&config, &weights, device));
    let numbers = |report: StepReport| [report.loss, report.heatmap, report.depth, report.gradient_norm];
    for (ours, expected) in ours.into_iter().zip(expected) {
        println!("{ours:?}\n{expected:?}");
        for (ours, expected) in numbers(ours).into_iter().zip(numbers(expected)) {
            assert!((ours - expected).abs() < RELATIVE * expected.abs(), "{ours}, on the CPU {expected}");
        }
    }
    assert!(expected[1].loss < expected[0].loss, "the step taught nothing: {expected:?}");
}
