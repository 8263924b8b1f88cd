//! Vulkan, Metal or DX12 against the CPU; scripts/wgpu runs these, on a software Vulkan where there is no GPU.
#![cfg(all(feature = "wgpu", not(target_arch = "wasm32")))]

#[path = "all/common.rs"]
mod common;

use std::sync::LazyLock;

use common::{golden, root, scratch, tiny_card};
use gravisight::{
    Camera, Card, Clip, Clips, Device, FineTuneOptions, FineTuner, LocaliseOptions, Localiser, Picture, TrainConfig,
    TrainSettings,
};
use pollster::block_on;
use serde_json::Value;

/// Steps that are compared: the second begins with the first's weights.
const STEPS: usize = 3;
/// Largest distance of a position from the CPU's, m.
const POSITION: f64 = 1e-3;
/// Largest relative difference of a loss from the CPU's: sums of f32 in another order.
const RELATIVE: f64 = 1e-3;

/// A process opens it once.
static GPU: LazyLock<Device> = LazyLock::new(|| Device::wgpu_options().init().expect("no adapter"));

#[test]
fn the_samples_are_found_where_the_cpu_finds_them() {
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
        let [here, there] = [&gpu, &cpu]
            .map(|found| block_on(found.localise(&picture, &camera, LocaliseOptions::default())).unwrap().world);
        let apart = (0..3).map(|axis| (here[axis] - there[axis]).powi(2)).sum::<f64>().sqrt();
        println!("{file}: {apart:.1e} m apart");
        assert!(apart < POSITION, "{file}: {here:?}, on the CPU {there:?}");
    }
}

#[test]
fn training_steps_do_what_the_cpus_do() {
    let clips = Clips::read(&root().join("tests/samples")).unwrap();
    let pictures = |clip: &Clip| clip.frames.iter().map(|frame| clips.picture(clip, frame).unwrap()).collect();
    let options =
        FineTuneOptions { steps: STEPS, batch: 2, crop: 32, learning_rate: 1e-2, ..FineTuneOptions::default() };
    let [ours, expected] = [&*GPU, &Device::flex()].map(|device| {
        let mut tuner = FineTuner::new(tiny_card(), golden("tiny.safetensors"), &options, device).unwrap();
        // A few frames are little for a fit: not every clip's are explained.
        let mut teaches =
            |clip: &&Clip| tuner.add_clip((*clip).clone(), pictures(clip), false).unwrap().left_out.is_none();
        let taught = clips.clips.iter().filter(|clip| teaches(clip)).count();
        assert!(taught > 0, "none of {} clips", clips.clips.len());
        let steps = (0..STEPS).map(|_| block_on(tuner.step()).unwrap().unwrap());
        steps.map(|step| [step.loss, step.heatmap, step.depth]).collect::<Vec<_>>()
    });
    println!("{ours:?}\n{expected:?}");
    for (ours, expected) in ours.iter().flatten().zip(expected.iter().flatten()) {
        assert!((ours - expected).abs() < RELATIVE * expected.abs(), "{ours}, on the CPU {expected}");
    }
}

/// From the start to the model, with a checkpoint and a best one on the way.
#[test]
fn a_training_ends_with_its_model() {
    let out = scratch("wgpu-run").join("out");
    let mut settings = TrainSettings::preset("sd-s").unwrap();
    for (name, folder) in [("train", root().join("tests/samples")), ("validation", root().join("tests/samples"))] {
        settings.set_path(name, &folder);
    }
    settings.set_path("out", &out);
    settings.set("phases=[{steps=2, batch=2, crop=64, learning_rate=1e-3}]").unwrap();
    settings.set("validate_frames=2").unwrap();
    let card = TrainConfig::start(settings.config().unwrap(), &GPU, &mut |_| {}).unwrap();
    let (card, weights) = Card::with_weights(&card).unwrap();
    Localiser::new(card, weights, &Device::flex()).unwrap();
}
