//! Training: it learns, its gradients are right, it resumes exactly, it refuses what cannot train.

mod common;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use burn::module::{Module as _, ModuleMapper, ModuleVisitor, Param};
use burn::optim::{AdamWConfig, GradientsParams, ModuleOptimizer};
use burn::tensor::{Device, Tensor, TensorData};
use common::{formula, formula_tensor, root, safetensors_of, scratch, vector};
use gravisight::error::Error;
use gravisight::model::{BackboneConfig, HeadConfig, Pen, PenConfig, PenOutput, load_backbone_timm, save};
use gravisight::physics::{Forecaster, Scene, State};
use gravisight::train::ema::Ema;
use gravisight::train::forecast::forecast;
use gravisight::train::loss::{HeatmapLoss, Labels, labels_3d};
use gravisight::train::run::{self, Progress};
use gravisight::train::step::{Batch, StepOptions, step};
use nalgebra::{Point3, Vector3};

const CROSS_ENTROPY: HeatmapLoss = HeatmapLoss::CrossEntropy { sigma: 4.0 };

/// Held by each test that makes networks: Burn has one random generator for all threads.
fn alone() -> MutexGuard<'static, ()> {
    static ONE: Mutex<()> = Mutex::new(());
    ONE.lock().unwrap_or_else(PoisonError::into_inner)
}

fn tiny() -> PenConfig {
    let backbone = BackboneConfig::Compact { stem: 4, stages: [4, 6, 8, 8], pyramid: 4 };
    PenConfig { backbone, ..PenConfig::compact(7.4) }
}

/// A run configuration on the samples, its folder, extra lines for the top level.
fn configuration(name: &str, extra: &str) -> PathBuf {
    let samples = root().join("tests/samples");
    let text = format!(
        r#"
name = "t"
train = {samples:?}
validation = {samples:?}
out = "out"
supervision = "3d-gt"
checkpoint_every = 2
validate_frames = 2
input = {{ width = 64, height = 64 }}
{extra}
[architecture]
backbone = {{ kind = "compact", stem = 4, stages = [4, 6, 8, 8], pyramid = 4 }}
head = {{ kind = "depthwise" }}
heatmap = {{ beta = 1.0 }}
depth = {{ activation = "exp", scale = 7.4 }}

[[phases]]
steps = 4
batch = 3
crop = 32
learning_rate = 1e-3
[[phases]]
steps = 3
batch = 2
learning_rate = 1e-3
"#
    );
    let path = scratch(name).join("run.toml");
    std::fs::write(&path, text).unwrap();
    path
}

fn start(path: &Path, observe: &mut dyn FnMut(&Progress)) -> Result<PathBuf, Error> {
    run::start(run::read_config(path)?, &Device::flex(), observe)
}

#[test]
fn a_run_killed_at_any_step_resumes_to_the_same_weights() {
    let _alone = alone();
    let whole = configuration("whole", "");
    let card = start(&whole, &mut |_| {}).unwrap();
    let expected = std::fs::read(card.with_extension("safetensors")).unwrap();
    let log = |folder: &Path| std::fs::read_to_string(folder.join("out/log.jsonl")).unwrap().lines().count();
    assert_eq!(log(whole.parent().unwrap()), 7);
    for kill_after in [1, 3, 5, 6] {
        let path = configuration(&format!("killed_{kill_after}"), "");
        let folder = path.parent().unwrap().to_path_buf();
        let mut observe = |progress: &Progress| assert!(progress.step < kill_after, "killed by the test");
        catch_unwind(AssertUnwindSafe(|| start(&path, &mut observe))).unwrap_err();
        let card = run::resume(&folder.join("out"), &Device::flex(), &mut |_| {}).unwrap();
        let found = std::fs::read(card.with_extension("safetensors")).unwrap();
        assert!(found == expected, "killed after {kill_after}");
        assert_eq!(log(&folder), 7);
    }
}

#[test]
fn a_finished_run_is_not_overwritten() {
    let _alone = alone();
    let path = configuration("finished", "");
    start(&path, &mut |_| {}).unwrap();
    let error = start(&path, &mut |_| {}).unwrap_err();
    assert!(error.to_string().contains("--resume"), "{error}");
}

#[test]
fn a_run_that_could_not_start_does_not_occupy_its_folder() {
    let _alone = alone();
    let path = configuration("could_not_start", "");
    let text = std::fs::read_to_string(&path).unwrap();
    let wrong = path.with_file_name("wrong.toml");
    let scale = "scale = 7.4";
    std::fs::write(&wrong, text.replace(&format!("activation = \"exp\", {scale}"), "activation = \"exp\", scale = -1"))
        .unwrap();
    start(&wrong, &mut |_| {}).unwrap_err();
    let no_clips = path.with_file_name("no_clips.toml");
    std::fs::write(&no_clips, text.replacen("tests/samples", "tests/golden", 1)).unwrap();
    start(&no_clips, &mut |_| {}).unwrap_err();
    start(&path, &mut |_| {}).unwrap();
}

#[test]
fn a_label_outside_the_picture_is_refused_by_name() {
    let path = configuration("outside", "");
    let error = start_on_first_clip(&path, |frame| frame["image"] = serde_json::json!([500.0, 20.0])).unwrap_err();
    assert!(error.to_string().contains("500") && error.to_string().contains("000.png"), "{error}");
}

/// Starts the run on the samples' first clip with its first frame changed.
fn start_on_first_clip(path: &Path, change: impl FnOnce(&mut serde_json::Value)) -> Result<PathBuf, Error> {
    let folder = path.parent().unwrap().join("clips");
    std::fs::create_dir_all(&folder).unwrap();
    let lines = std::fs::read_to_string(root().join("tests/samples/clips.jsonl")).unwrap();
    let mut first: serde_json::Value = serde_json::from_str(lines.lines().next().unwrap()).unwrap();
    change(&mut first["frames"][0]);
    std::fs::write(folder.join("clips.jsonl"), first.to_string()).unwrap();
    let text = std::fs::read_to_string(path).unwrap();
    std::fs::write(path, text.replacen(&format!("{:?}", root().join("tests/samples")), "\"clips\"", 1)).unwrap();
    start(path, &mut |_| {})
}

#[test]
fn senseless_configurations_are_refused_with_the_field() {
    for (extra, named) in [
        ("learning_rat = 1.0", "learning_rat"),
        ("ema_decay = 1.5", "ema_decay"),
        ("depth_weight = -1.0", "depth_weight"),
        ("checkpoint_every = 0", "checkpoint_every"),
        ("jitter = inf", "jitter"),
        ("name = \"a/b\"", "name"),
        ("heatmap_loss = { kind = \"cross_entropy\", sigma = 0.0 }", "sigma"),
        ("preset = \"huge\"", "huge"),
    ] {
        let path = configuration("senseless", "");
        let text = std::fs::read_to_string(&path).unwrap();
        let field = extra.split(' ').next().unwrap();
        let kept: Vec<&str> = text.lines().filter(|line| !line.starts_with(field)).collect();
        std::fs::write(&path, format!("{extra}\n{}", kept.join("\n"))).unwrap();
        let error = run::read_config(&path).unwrap_err();
        assert!(error.to_string().contains(named), "{extra}: {error}");
    }
    for (from, to, named) in [("crop = 32", "crop = 33", "crop"), ("supervision = \"3d-gt\"", "", "supervision")] {
        let path = configuration("senseless", "");
        let text = std::fs::read_to_string(&path).unwrap().replace(from, to);
        std::fs::write(&path, text).unwrap();
        let error = run::read_config(&path).unwrap_err();
        assert!(error.to_string().contains(named), "{to}: {error}");
    }
}

#[test]
fn a_frame_without_3d_label_is_refused_by_name() {
    let path = configuration("no_world", "");
    let error = start_on_first_clip(&path, |frame| drop(frame.as_object_mut().unwrap().remove("world"))).unwrap_err();
    assert!(error.to_string().contains("world") && error.to_string().contains("000.png"), "{error}");
}

/// A batch of two pictures from the formula, balls inside.
fn batch() -> Batch {
    let pictures = formula("batch", 2 * 3 * 32 * 64).into_iter().map(|value| value as f32).collect();
    Batch {
        pictures,
        size: [32, 64],
        labels: Labels { image: vec![[20.3, 11.8], [47.1, 20.2]], depth: vec![7.0, 8.1] },
    }
}

fn options(learning_rate: f64) -> StepOptions {
    StepOptions {
        heatmap_loss: CROSS_ENTROPY,
        depth_weight: 0.2,
        depth_transition: 0.05,
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
    let mut optimiser: ModuleOptimizer = AdamWConfig::new().init();
    let mut losses = Vec::new();
    for _ in 0..60 {
        let (next, report) = step(pen, &mut optimiser, batch(), &options(1e-2), &device);
        pen = next;
        losses.push(report.loss);
    }
    assert!(losses[59] < 0.6 * losses[0], "{} -> {}", losses[0], losses[59]);
}

#[test]
fn a_backbone_from_timm_weights_goes_on_learning() {
    let _alone = alone();
    let device = Device::flex().autodiff();
    device.seed(2);
    let head = HeadConfig::Paper { channels: [4, 4, 4] };
    let config = PenConfig { backbone: BackboneConfig::ResNet34 { width: 4 }, head, ..PenConfig::paper() };
    let pen = Pen::new(&config, &device).unwrap();
    let bytes = save(&pen).unwrap();
    let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let timm = file.tensors().into_iter().filter_map(|(name, view)| {
        let name = name.strip_prefix("backbone.")?.to_string();
        let values = formula_tensor(&name, view.shape());
        Some((name, view.shape().to_vec(), values))
    });
    let pen = load_backbone_timm(pen, safetensors_of(timm.collect())).unwrap();
    let kernel = |pen: &Pen| {
        let bytes = save(pen).unwrap();
        vector(&safetensors::SafeTensors::deserialize(&bytes).unwrap().tensor("backbone.conv1.weight").unwrap())
    };
    let before = kernel(&pen);
    assert_eq!(before, formula_tensor("conv1.weight", &[4, 3, 7, 7]));
    let mut optimiser: ModuleOptimizer = AdamWConfig::new().init();
    let (pen, report) = step(pen, &mut optimiser, batch(), &options(1e-2), &device);
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
    let mut optimiser: ModuleOptimizer = AdamWConfig::new().init();
    let mut bad = batch();
    bad.pictures[7] = f32::NAN;
    let (pen, report) = step(pen, &mut optimiser, bad, &options(1e-2), &device);
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
            let output = PenOutput { heatmap: heatmap.clone(), depth: depth.clone() };
            let losses = labels_3d(output, &labels, &tiny(), loss, 0.05);
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
    device.seed(11);
    let pen = Pen::new(&tiny(), &device).unwrap();
    let gradients = GradientsParams::from_grads(loss_of(&pen, &device).backward(), &pen);
    assert_slope::<4>(&pen, &gradients, &device);
    assert_slope::<1>(&pen, &gradients, &device);
}

fn loss_of(pen: &Pen, device: &Device) -> Tensor<1> {
    let batch = batch();
    let pictures = Tensor::from_data(TensorData::new(batch.pictures, [2, 32, 64, 3]), device);
    let losses = labels_3d(pen.forward(pictures), &batch.labels, &tiny(), CROSS_ENTROPY, 0.5);
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
    for (updates, decay) in [(0, 0.1), (100_000, 0.998)] {
        let mut ema = Ema::new(first.valid(), 0.998, updates);
        ema.update(&second);
        let moved = f64::from(stem(ema.model()) - start);
        assert!((moved - (1.0 - decay)).abs() < 1e-3, "{updates}: {moved}");
    }
}

/// A mean of squared positions and velocities, as a loss would be: its value and its gradient by the starts.
fn loss_through_forecast(starts: &[f32], scene: &Scene, times: &[f64]) -> (f64, Vec<f32>) {
    let device = Device::flex().autodiff();
    let batch = starts.len() / 6;
    let tensor = Tensor::<2>::from_data(TensorData::new(starts.to_vec(), [batch, 6]), &device).require_grad();
    let forecaster = Forecaster::new(scene).unwrap();
    let forecasts = pollster::block_on(forecast(tensor.clone(), &forecaster, times)).unwrap();
    let loss = forecasts.states.powi_scalar(2).sum();
    let value = f64::from(loss.clone().into_scalar::<f32>());
    let gradients = loss.backward();
    (value, tensor.grad(&gradients).unwrap().into_data().iter::<f32>().collect())
}

#[test]
fn gradients_flow_through_the_forecast_and_its_contacts() {
    let scene = Scene::from_json(
        r#"{"gravity": [0, 0, -1], "ball": {"radius": 0.2}, "contact": {"model": "spring"}, "floor": {"height": 0}}"#,
        "scene",
    );
    let (scene, times) = (scene.unwrap(), [-0.2, 0.5, 1.0]);
    // one that bounces, one that flies
    let starts = [0.3, -0.2, 0.6, 0.4, 0.1, -0.5, -0.5, 0.4, 2.0, 0.2, -0.3, 0.6_f32];
    let (_, gradient) = loss_through_forecast(&starts, &scene, &times);
    // differences of the same sum in f64, without tensors
    let loss = |starts: &[f64]| -> f64 {
        let forecaster = Forecaster::new(&scene).unwrap();
        let of = |n: &[f64]| {
            let start = State { position: Point3::new(n[0], n[1], n[2]), velocity: Vector3::new(n[3], n[4], n[5]) };
            let forecast = forecaster.forecast(&start, &times);
            forecast.states.iter().map(|s| s.position.coords.norm_squared() + s.velocity.norm_squared()).sum::<f64>()
        };
        starts.chunks_exact(6).map(of).sum()
    };
    for index in 0..starts.len() {
        let at = |by: f64| {
            let mut starts = starts.map(f64::from);
            starts[index] += by;
            loss(&starts)
        };
        let expected = (at(1e-5) - at(-1e-5)) / 2e-5;
        let found = f64::from(gradient[index]);
        assert!((found - expected).abs() < 1e-4 * (1.0 + expected.abs()), "{index}: {found} {expected}");
    }
}

#[test]
fn a_forecast_that_fails_has_no_value_and_no_gradient() {
    let scene = Scene::from_json(r#"{"gravity": [0, 0, -1], "ball": {"radius": 0.2}}"#, "scene").unwrap();
    let device = Device::flex().autodiff();
    let starts = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, f32::NAN, 0.0, 1.0, 0.0, 0.0, 0.0];
    let tensor = Tensor::<2>::from_data(TensorData::new(starts.to_vec(), [2, 6]), &device);
    let tensor = tensor.require_grad();
    let forecasts = pollster::block_on(forecast(tensor.clone(), &Forecaster::new(&scene).unwrap(), &[0.5])).unwrap();
    let states: Vec<f32> = forecasts.states.clone().into_data().iter().collect();
    assert!(
        states[..6].iter().any(|value| *value != 0.0) && states[6..].iter().all(|value| *value == 0.0),
        "{states:?}"
    );
    let gradient = tensor.grad(&forecasts.states.sum().backward()).unwrap();
    assert!(gradient.into_data().iter::<f32>().skip(6).all(|value| value == 0.0));
    assert_eq!(forecasts.valid.into_data().iter::<f32>().collect::<Vec<_>>(), [1.0, 0.0]);
    assert!(forecasts.statuses[1].code() == "not-finite");
}
