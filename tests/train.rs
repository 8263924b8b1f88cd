//! Training: it learns, its gradients are right, it resumes exactly, it refuses what cannot train.

mod common;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use burn::module::{Module as _, ModuleMapper, ModuleVisitor, Param};
use burn::optim::{AdamWConfig, GradientsParams, ModuleOptimizer};
use burn::tensor::{Device, Tensor, TensorData};
use common::{formula, formula_tensor, root, safetensors_of, scratch, vector};
use gravisight::data::synth::{Engine as _, Shot, Split, Studio};
use gravisight::data::{Clip, Clips, Frame};
use gravisight::error::Error;
use gravisight::image::Picture;
use gravisight::localise::Localiser;
use gravisight::model::{BackboneConfig, Card, HeadConfig, Pen, PenConfig, PenOutput, load_backbone_timm, save};
use gravisight::physics::{Forecaster, Scene, State};
use gravisight::train::config::{FitConfig, TrainConfig};
use gravisight::train::ema::Ema;
use gravisight::train::fine_tune::{FineTuneOptions, FineTuner};
use gravisight::train::future::{Place, Target, Window, future, future_loss};
use gravisight::train::loss::{HeatmapLoss, Labels, map_losses};
use gravisight::train::pictures::Pictures;
use gravisight::train::recipe::{assignment, lay_over, preset, presets, read_fields};
use gravisight::train::run::{self, Event, Validation};
use gravisight::train::score::score;
use gravisight::train::step::{Batch, StepOptions, step};
use gravisight::train::teacher::teach;
use nalgebra::{Matrix2, Point3, Vector2, Vector3};

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

fn start(path: &Path, observe: &mut dyn FnMut(Event)) -> Result<PathBuf, Error> {
    run::start(TrainConfig::of(read_fields(path)?)?, &Device::flex(), observe)
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
        let mut observe = |event: Event| match event {
            Event::Step(progress) => assert!(progress.step < kill_after, "killed by the test"),
            Event::Prepared(_) | Event::Fitting { .. } => {}
        };
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
        ("augmentation = { noise = inf }", "noise"),
        ("name = \"a/b\"", "name"),
        ("heatmap_loss = { kind = \"cross_entropy\", sigma = 0.0 }", "sigma"),
        ("network = \"huge\"", "huge"),
    ] {
        let path = configuration("senseless", "");
        let text = std::fs::read_to_string(&path).unwrap();
        let field = extra.split(' ').next().unwrap();
        let kept: Vec<&str> = text.lines().filter(|line| !line.starts_with(field)).collect();
        std::fs::write(&path, format!("{extra}\n{}", kept.join("\n"))).unwrap();
        let error = read_fields(&path).and_then(TrainConfig::of).unwrap_err();
        assert!(error.to_string().contains(named), "{extra}: {error}");
    }
    for (from, to, named) in [("crop = 32", "crop = 33", "crop"), ("supervision = \"3d-gt\"", "", "supervision")] {
        let path = configuration("senseless", "");
        let text = std::fs::read_to_string(&path).unwrap().replace(from, to);
        std::fs::write(&path, text).unwrap();
        let error = read_fields(&path).and_then(TrainConfig::of).unwrap_err();
        assert!(error.to_string().contains(named), "{to}: {error}");
    }
}

#[test]
fn presets_files_and_flags_are_laid_over_each_other() {
    for name in presets() {
        let mut fields = preset(name).unwrap();
        lay_over(&mut fields, assignment("train=a").unwrap());
        lay_over(&mut fields, assignment("validation=b").unwrap());
        lay_over(&mut fields, assignment("out=c").unwrap());
        lay_over(&mut fields, assignment("augmentation.shift=8").unwrap());
        lay_over(&mut fields, assignment("augmentation.flip=0.5").unwrap());
        let config = TrainConfig::of(fields).unwrap();
        assert_eq!((config.augmentation.shift, config.augmentation.flip), (8, 0.5), "{name}");
        assert_eq!(config.train, Path::new("a"));
    }
    for wrong in ["seed", "=3", "a..b=3", "a b=3"] {
        assert!(assignment(wrong).is_err(), "{wrong}");
    }
    assert!(preset("huge").unwrap_err().to_string().contains("sd-s"));
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
        labels: Labels {
            image: vec![Some([20.3, 11.8]), Some([47.1, 20.2])],
            depth: vec![7.0, 8.1],
            depth_weight: vec![1.0, 0.6],
        },
        windows: vec![],
    }
}

fn options(learning_rate: f64) -> StepOptions {
    StepOptions {
        heatmap_loss: CROSS_ENTROPY,
        depth_weight: 0.2,
        future_weight: 0.0,
        robust_px: None,
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
            let losses = map_losses(output, &labels, &tiny(), loss, 0.05);
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
        PenConfig { backbone, head: HeadConfig::Paper { channels: [6, 6, 4] }, ..PenConfig::paper() }
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
    let losses = map_losses(pen.forward(pictures), &batch.labels, pen.config(), CROSS_ENTROPY, 0.5);
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

/// A clips folder of `count` clips of 90 frames by the built-in engine, each changed; only the first `drawn` frames of
/// each have pictures.
fn synthetic(name: &str, count: usize, drawn: usize, change: impl Fn(&mut Clip)) -> PathBuf {
    seen_by(1, name, count, drawn, change)
}

/// The same, seen by camera `camera`.
fn seen_by(camera: usize, name: &str, count: usize, drawn: usize, change: impl Fn(&mut Clip)) -> PathBuf {
    let folder = scratch(name).join("clips");
    std::fs::create_dir_all(&folder).unwrap();
    let studio = Studio::new(Shot { environment: Some(1), camera }).unwrap();
    let clips = (0..count).map(|number| {
        let mut engine = studio.builtin();
        let mut clip = studio.clip(&mut engine, 7, Split::Train, number).unwrap();
        for frame in clip.frames.iter().take(drawn) {
            let picture = engine.picture(&Point3::from(frame.world.unwrap())).unwrap();
            let file = folder.join(&frame.file);
            std::fs::create_dir_all(file.parent().unwrap()).unwrap();
            picture.save(file).unwrap();
        }
        change(&mut clip);
        clip
    });
    let clips = Clips { folder: folder.clone(), clips: clips.collect() };
    clips.write_index().unwrap();
    folder
}

/// A configuration with other clips and another supervision.
fn on(name: &str, clips: &Path, supervision: &str, extra: &str) -> PathBuf {
    let path = configuration(name, extra);
    let text = std::fs::read_to_string(&path).unwrap();
    let samples = format!("{:?}", root().join("tests/samples"));
    let text = text.replace(&samples, &format!("{clips:?}")).replace("3d-gt", supervision);
    std::fs::write(&path, text).unwrap();
    path
}

#[test]
fn physics_teaches_depths_from_2d_labels_alone() {
    let folder = synthetic("taught", 2, 0, |_| {});
    for clip in Clips::read(&folder).unwrap().clips {
        let mut blind = clip.clone();
        blind.frames.iter_mut().for_each(|frame| frame.world = None);
        let taught = teach(&blind, &FitConfig::default());
        assert_eq!(taught.left_out, None);
        assert!(taught.frames.iter().flatten().count() > 80);
        for (frame, taught) in clip.frames.iter().zip(&taught.frames) {
            let Some(taught) = taught else { continue };
            let truth = clip.camera.camera_from_world(&Point3::from(frame.world.unwrap())).z;
            assert!((taught.depth - truth).abs() < 0.05, "{} {truth}", taught.depth);
        }
    }
}

#[test]
fn of_noisy_labels_the_fit_makes_better_2d_targets() {
    let folder = synthetic("noisy", 1, 0, |_| {});
    let clip = Clips::read(&folder).unwrap().clips.remove(0);
    let mut noisy = clip.clone();
    let noise = formula("noise", 2 * clip.frames.len());
    let spread = (noise.iter().map(|value| value * value).sum::<f64>() / noise.len() as f64).sqrt();
    for (frame, by) in noisy.frames.iter_mut().zip(noise.chunks_exact(2)) {
        frame.image = frame.image.map(|[x, y]| [x + by[0] / spread, y + by[1] / spread]);
    }
    let taught = teach(&noisy, &FitConfig::default());
    let error = |images: Vec<Option<[f64; 2]>>| {
        let pairs = images.into_iter().zip(&clip.frames).filter_map(|(image, frame)| Some((image?, frame.image?)));
        let squares: Vec<f64> = pairs.map(|(a, b)| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    };
    let labels = error(noisy.frames.iter().map(|frame| frame.image).collect());
    let targets = error(taught.frames.iter().map(|frame| frame.map(|frame| frame.image)).collect());
    assert!(targets < 0.5 * labels, "{targets} {labels}");
}

#[test]
fn every_supervision_runs_and_resumes_to_the_same_weights() {
    let _alone = alone();
    let folder = synthetic("supervised", 2, 45, |clip| clip.frames.truncate(45));
    let extra = "empty_share = 0.3\nvalidate_every = 2\naugmentation = { shift = 4, flip = 0.5, blur = 0.1, colour = 0.1, zoom = 0.1, roll_degrees = 5.0 }";
    for (supervision, more) in
        [("physics-fit", ""), ("mixed", "labelled_share = 0.5"), ("future-2d-predict", ""), ("future-2d-gt", "")]
    {
        let of = |kind: &str| on(&format!("{supervision}_{kind}"), &folder, supervision, &format!("{extra}\n{more}"));
        let card = start(&of("whole"), &mut |_| {}).unwrap();
        let expected = std::fs::read(card.with_extension("safetensors")).unwrap();
        let path = of("killed");
        let mut observe = |event: Event| match event {
            Event::Step(progress) => assert!(progress.step < 5, "killed by the test"),
            Event::Prepared(prepared) => assert_eq!((prepared.clips, prepared.left_out.len()), (2, 0)),
            Event::Fitting { .. } => {}
        };
        catch_unwind(AssertUnwindSafe(|| start(&path, &mut observe))).unwrap_err();
        let card = run::resume(&path.parent().unwrap().join("out"), &Device::flex(), &mut |_| {}).unwrap();
        let found = std::fs::read(card.with_extension("safetensors")).unwrap();
        assert!(found == expected, "{supervision}");
        let text = std::fs::read_to_string(card).unwrap();
        assert_eq!(text.contains("3D labels"), supervision == "mixed", "{supervision}: {text}");
    }
}

#[test]
fn the_weights_with_the_least_forecast_error_are_kept() {
    let _alone = alone();
    let folder = synthetic("best", 1, 45, |clip| {
        clip.frames.truncate(45);
        clip.frames.iter_mut().for_each(|frame| frame.world = None);
    });
    // the second phase ruins what the first has learned
    let path = on("best_run", &folder, "physics-fit", "validate_every = 1");
    let text = std::fs::read_to_string(&path).unwrap();
    let (first, second) = text.rsplit_once("learning_rate = 1e-3").unwrap();
    std::fs::write(&path, format!("{first}learning_rate = 2e-2{second}")).unwrap();
    let mut scores = Vec::new();
    let card = start(&path, &mut |event| {
        if let Event::Step(progress) = event
            && let Some(Validation::Score(score)) = &progress.validation
        {
            assert_eq!(score.dtg.n, 0, "there is no truth");
            scores.push((progress.step, score.forecast_px.unwrap()));
        }
    });
    let card = Card::from_file(&card.unwrap()).unwrap();
    assert_eq!(scores.len(), 7);
    let table = std::fs::read_to_string(path.with_file_name("out/log.csv")).unwrap();
    let lines: Vec<Vec<&str>> = table.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!((lines.len(), lines[0][0], lines[0][9]), (8, "step", "forecast_px"));
    assert_eq!(lines[7][9].parse::<f64>().unwrap(), scores[6].1);
    let best = scores.iter().min_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
    let kept = std::fs::read_to_string(path.with_file_name("out/checkpoints/score.json")).unwrap();
    let kept: serde_json::Value = serde_json::from_str(&kept).unwrap();
    assert_eq!((kept["step"].as_u64().unwrap() as usize, kept["score"].as_f64().unwrap()), *best);
    // and they are what is published, norms' statistics and all
    let device = Device::flex();
    let weights = std::fs::read(path.with_file_name("out/t.safetensors")).unwrap();
    let localiser = Localiser::new(card, weights, &device).unwrap();
    let published = pollster::block_on(score(&localiser, &Pictures::new(Clips::read(&folder).unwrap(), 0), 2)).unwrap();
    let published = published.forecast_px.unwrap();
    assert!((published - best.1).abs() < 0.01 * best.1, "{published} {scores:?}");
    assert!(scores.iter().any(|(_, score)| *score > 1.05 * best.1), "{scores:?}");
}

#[test]
fn labels_written_otherwise_are_recognised() {
    for (name, hint, change) in [
        ("swapped", "exchanged", (|frame| frame.image = frame.image.map(|[x, y]| [y, x])) as fn(&mut Frame)),
        ("slow", "twice", |frame| frame.t *= 2.0),
        ("fast", "half", |frame| frame.t /= 2.0),
        ("upward", "bottom", |frame| frame.image = frame.image.map(|[x, y]| [x, 223.0 - y])),
    ] {
        let folder = synthetic(name, 2, 0, |clip| clip.frames.iter_mut().for_each(change));
        let error =
            start(&on(&format!("{name}_run"), &folder, "physics-fit", ""), &mut |_| {}).unwrap_err().to_string();
        assert!(error.contains(hint) && error.contains("of 2 clips"), "{name}: {error}");
    }
}

#[test]
fn clips_that_cannot_teach_are_refused_by_name() {
    let short = synthetic("short", 1, 0, |clip| clip.frames.truncate(12));
    let invisible = synthetic("invisible", 1, 0, |clip| {
        clip.frames.iter_mut().for_each(|frame| (frame.visible, frame.image, frame.world) = (false, None, None));
    });
    let floating = synthetic("floating", 1, 0, |clip| clip.scene.as_mut().unwrap().gravity = [0.0; 3]);
    let nowhere = synthetic("nowhere", 1, 0, |clip| clip.scene = None);
    for (folder, supervision, named) in [
        (&short, "future-2d-predict", "17 frames"),
        (&invisible, "future-2d-gt", "visible"),
        (&invisible, "physics-fit", "explains 0 of 1"),
        (&invisible, "3d-gt", "visible"),
        (&floating, "physics-fit", "gravity"),
        (&floating, "future-2d-gt", "gravity"),
        (&nowhere, "physics-fit", "scene"),
    ] {
        let error = start(&on("refused", folder, supervision, ""), &mut |_| {}).unwrap_err().to_string();
        assert!(error.contains(named), "{supervision}: {error}");
    }
}

#[test]
fn the_papers_own_recipe_makes_its_steps() {
    let _alone = alone();
    let folder = synthetic("paper", 1, 45, |clip| clip.frames.truncate(45));
    let mut fields = preset("paper").unwrap();
    let out = scratch("paper-run").join("out");
    let [folder, out_text] = [&folder, &out].map(|path| path.to_str().unwrap().replace('\\', "/"));
    for field in [
        format!("train={folder}"),
        format!("validation={folder}"),
        format!("out={out_text}"),
        "validate_frames=1".into(),
        // The pictures are smaller, and fewer, than the paper's: this is to be seen within seconds.
        "input={width=64, height=64}".into(),
        "phases=[{steps=2, batch=6, learning_rate=2e-5}]".into(),
    ] {
        lay_over(&mut fields, assignment(&field).unwrap());
    }
    let mut losses = Vec::new();
    let mut observe = |event: Event| {
        if let Event::Step(progress) = event {
            losses.push([progress.loss, progress.heatmap, progress.future, progress.gradient_norm]);
        }
    };
    let card = run::start(TrainConfig::of(fields).unwrap(), &Device::flex(), &mut observe).unwrap();
    assert_eq!(losses.len(), 2);
    for [loss, heatmap, future, norm] in losses {
        assert!([loss, heatmap, future, norm].iter().all(|value| value.is_finite()) && norm > 0.0 && future > 0.0);
    }
    assert!(Card::from_file(&card).is_ok());
}

#[test]
fn a_step_that_cannot_fit_the_memory_is_refused_before_the_start() {
    let _alone = alone();
    let path = configuration("memory", "");
    let text = std::fs::read_to_string(&path).unwrap().replacen("batch = 3", "batch = 100000000", 1);
    std::fs::write(&path, text).unwrap();
    let error = start(&path, &mut |_| {}).unwrap_err().to_string();
    assert!(error.contains("GB") && error.contains("batch"), "{error}");
    assert!(!path.with_file_name("out/run.toml").exists());
}

#[test]
fn a_run_that_diverges_stops_and_says_so() {
    let _alone = alone();
    let path = configuration("diverges", "");
    let text = std::fs::read_to_string(&path).unwrap().replacen("learning_rate = 1e-3", "learning_rate = 1e12", 1);
    std::fs::write(&path, text.replacen("steps = 4", "steps = 400", 1)).unwrap();
    let error = start(&path, &mut |_| {}).unwrap_err();
    assert!(matches!(error, Error::Diverged { .. }), "{error}");
    assert!(error.to_string().contains("learning_rate"), "{error}");
}

/// Three balls' windows in a batch of twelve pictures (three of the start, one ahead): one flies, one bounces, one is
/// seen in a mirrored and scaled picture; and positions near the truth, but off.
fn windows() -> (Vec<[f64; 3]>, Vec<Window>) {
    let camera = Clips::read(&root().join("tests/samples")).unwrap().clips[0].camera.clone();
    let scene =
        r#"{"gravity": [0, 0, -1], "ball": {"radius": 0.2}, "contact": {"model": "spring"}, "floor": {"height": 0}}"#;
    let forecaster = Arc::new(Forecaster::new(&Scene::from_json(scene, "scene").unwrap()).unwrap());
    let plain = Place { linear: Matrix2::identity(), origin: Vector2::zeros(), zoom: 1.0 };
    let mirrored = Place { linear: Matrix2::new(-1.9, 0.3, 0.2, 2.0), origin: Vector2::new(200.0, 7.0), zoom: 1.2 };
    let starts = [
        ([0.4, 0.3, 2.0], [0.2, -0.3, 0.6]),
        ([-0.3, 0.2, 0.6], [0.4, 0.1, -0.5]),
        ([0.1, 0.5, 1.5], [-0.2, 0.3, 0.1]),
    ];
    let mut positions = Vec::new();
    let mut windows = Vec::new();
    for (number, (position, velocity)) in starts.into_iter().enumerate() {
        let place = if number == 2 { mirrored } else { plain };
        let state = State { position: Point3::from(position), velocity: Vector3::from(velocity) };
        let times = [-1.0 / 15.0, 0.0, 1.0 / 15.0, 1.0];
        let forecast = forecaster.forecast(&state, &times);
        let first = positions.len();
        for (index, state) in forecast.states.iter().enumerate() {
            let image = camera.image_from_world(&state.position).unwrap();
            let depth = camera.camera_from_world(&state.position).z;
            let off = 0.3 * (number as f64 + 1.0) * (index as f64 - 1.3);
            let drawn = place.linear.try_inverse().unwrap() * (image.coords - place.origin);
            positions.push([drawn[0] + off, drawn[1] - 0.5 * off, depth / place.zoom + 0.02 * off]);
        }
        let target = match number {
            1 => Target::Label([100.0, 120.0]),
            _ => Target::Predicted { picture: first + 3, place },
        };
        windows.push(Window {
            first,
            places: [place; 3],
            times: [times[0], times[1], times[2]],
            camera: camera.clone(),
            forecaster: forecaster.clone(),
            ahead: vec![(1.0, target)],
        });
    }
    (positions, windows)
}

#[test]
fn the_future_losss_gradients_equal_central_differences() {
    let (positions, windows) = windows();
    for robust in [None, Some(5.0)] {
        let loss = future_loss(&positions, &windows, robust);
        assert_eq!(loss.whole, 3);
        for picture in 0..positions.len() {
            for axis in 0..3 {
                let at = |by: f64| {
                    let mut moved = positions.clone();
                    moved[picture][axis] += by;
                    // targets are detached: they stay where they were
                    let fixed: Vec<Window> = windows.iter().map(|window| detached(window, &positions)).collect();
                    future_loss(&moved, &fixed, robust).value
                };
                let expected = (at(1e-6) - at(-1e-6)) / 2e-6;
                let found = loss.gradient[picture][axis];
                assert!(
                    (found - expected).abs() < 1e-5 * (1.0 + expected.abs()),
                    "{robust:?} {picture} {axis}: {found} {expected}"
                );
            }
        }
        assert_eq!(loss.gradient[3], [0.0; 3], "a target has no gradient");
    }
}

/// The window with its targets as they are at `positions`.
fn detached(window: &Window, positions: &[[f64; 3]]) -> Window {
    let fixed = |target: Target| match target {
        Target::Predicted { picture, place } => {
            Target::Label(place.in_clip([positions[picture][0], positions[picture][1]]))
        }
        label => label,
    };
    Window { ahead: window.ahead.iter().map(|&(time, target)| (time, fixed(target))).collect(), ..window.clone() }
}

#[test]
fn the_future_loss_enters_the_graph_with_its_value_and_gradient() {
    let (positions, windows) = windows();
    let device = Device::flex().autodiff();
    let column = |axis: usize| -> Vec<f32> { positions.iter().map(|position| position[axis] as f32).collect() };
    let image: Vec<f32> = positions.iter().flat_map(|[x, y, _]| [*x as f32, *y as f32]).collect();
    let image = Tensor::<2>::from_data(TensorData::new(image, [12, 2]), &device).require_grad();
    let depth = Tensor::<1>::from_data(TensorData::new(column(2), [12]), &device).require_grad();
    let probability = Tensor::<3>::zeros([12, 1, 1], &device);
    let decoded = gravisight::model::Decoded { image: image.clone(), depth: depth.clone(), probability };
    let loss = future(&decoded, &windows, Some(5.0));
    let expected = future_loss(&positions, &windows, Some(5.0));
    let value = f64::from(loss.clone().into_scalar::<f32>());
    assert!((value - expected.value).abs() < 1e-4 * expected.value, "{value} {}", expected.value);
    let gradients = loss.backward();
    let images: Vec<f64> = image.grad(&gradients).unwrap().into_data().iter::<f64>().collect();
    let depths: Vec<f64> = depth.grad(&gradients).unwrap().into_data().iter::<f64>().collect();
    for (index, [x, y, z]) in expected.gradient.iter().enumerate() {
        let found = [images[2 * index], images[2 * index + 1], depths[index]];
        for (found, expected) in found.iter().zip([x, y, z]) {
            assert!((found - expected).abs() < 1e-3 * (1.0 + expected.abs()), "{index}: {found} {expected}");
        }
    }
}

#[test]
fn a_forecast_that_fails_teaches_nothing() {
    let (mut positions, windows) = windows();
    let whole = future_loss(&positions, &windows, None);
    positions[0][2] = f64::NAN;
    let loss = future_loss(&positions, &windows, None);
    assert_eq!(loss.whole, 2);
    assert!(loss.value < whole.value && loss.gradient[..4].iter().flatten().all(|&slope| slope == 0.0));
    assert_eq!(loss.gradient[4..], whole.gradient[4..]);
}

/// Clips by the built-in engine with their pictures in memory.
fn in_memory(camera: usize, name: &str, count: usize, frames: usize) -> Vec<(Clip, Vec<Picture>)> {
    let folder = seen_by(camera, name, count, frames, |clip| clip.frames.truncate(frames));
    let clips = Clips::read(&folder).unwrap();
    let pictures = |clip: &Clip| clip.frames.iter().map(|frame| clips.picture(clip, frame).unwrap()).collect();
    clips.clips.iter().map(|clip| (clip.clone(), pictures(clip))).collect()
}

/// Starts from the model of one camera.
fn tuner(options: &FineTuneOptions) -> FineTuner {
    let (card, weights) = Card::with_weights(&root().join("models/sd-s.json")).unwrap();
    FineTuner::new(card, weights, options, &Device::flex()).unwrap()
}

#[test]
fn a_model_is_fine_tuned_in_memory_and_its_export_finds_the_same() {
    let _alone = alone();
    let options = FineTuneOptions { steps: 60, batch: 6, ..FineTuneOptions::default() };
    let mut tuner = tuner(&options);
    let mut clips = in_memory(2, "tuned", 4, 45);
    let (held_out, pictures) = clips.pop().unwrap();
    let picture = pictures[7].clone();
    let camera = held_out.camera.clone();
    assert_eq!(tuner.add_clip(held_out, pictures, true).unwrap().left_out, None);
    for (mut clip, pictures) in clips {
        // Only the 2D labels teach.
        clip.frames.iter_mut().for_each(|frame| frame.world = None);
        assert!(tuner.add_clip(clip, pictures, false).unwrap().frames > 35);
    }
    let before = pollster::block_on(tuner.evaluate()).unwrap();
    let mut losses = Vec::new();
    while let Some(step) = tuner.step().unwrap() {
        losses.push(step.loss);
    }
    assert_eq!(losses.len(), 60);
    let after = pollster::block_on(tuner.evaluate()).unwrap();
    println!("{:?} -> {:?} px, {:?} -> {:?} m", before.forecast_px, after.forecast_px, before.dtg.mean, after.dtg.mean);
    assert!(after.forecast_px.unwrap() < 0.8 * before.forecast_px.unwrap(), "{before:?} {after:?}");
    assert!(after.dtg.mean.unwrap() < 0.8 * before.dtg.mean.unwrap(), "{before:?} {after:?}");
    let find = |localiser: &Localiser| pollster::block_on(localiser.localise(&picture, &camera, false)).unwrap().world;
    let here = find(&tuner.localiser());
    let (card, weights) = tuner.export().unwrap();
    assert_eq!((card.name.as_str(), card.weights.as_str()), ("sd-s-tuned", "sd-s-tuned.safetensors"));
    let card = Card::from_json(&card.to_json().unwrap(), "exported").unwrap();
    let there = find(&Localiser::new(card, weights, &Device::flex()).unwrap());
    // Weights are kept in half precision.
    let apart = (0..3).map(|axis| (here[axis] - there[axis]).powi(2)).sum::<f64>().sqrt();
    assert!(apart < 0.05, "{here:?} {there:?}");
}

#[test]
fn a_fine_tuning_refuses_what_it_cannot_learn_from() {
    let _alone = alone();
    let options = FineTuneOptions { steps: 2, batch: 2, crop: 32, ..FineTuneOptions::default() };
    let mut tuner = tuner(&options);
    let said = |result: Result<_, Error>| result.map(|_: ()| ()).unwrap_err().to_string();
    let (clip, pictures) = in_memory(1, "refused", 1, 30).remove(0);
    let fewer = tuner.add_clip(clip.clone(), pictures[1..].to_vec(), false);
    assert!(said(fewer.map(|_| ())).contains("30 frames and 29 pictures"));
    let mut nowhere = clip.clone();
    nowhere.scene = None;
    assert!(said(tuner.add_clip(nowhere, pictures.clone(), false).map(|_| ())).contains("scene"));
    let mut other = clip.clone();
    other.camera = other.camera.resized([448, 448]).unwrap();
    assert!(said(tuner.add_clip(other, pictures.clone(), false).map(|_| ())).contains("px"));
    assert!(said(pollster::block_on(tuner.evaluate()).map(|_| ())).contains("held out"));
    // Labels that no physics explains: the clip is named and left out, and a run of such clips does not start.
    let mut wrong = clip.clone();
    for (index, frame) in wrong.frames.iter_mut().enumerate() {
        frame.image = Some([30.0 + 37.0 * ((index * 7) % 5) as f64, 30.0 + 41.0 * ((index * 3) % 4) as f64]);
    }
    assert!(tuner.add_clip(wrong, pictures.clone(), false).unwrap().left_out.is_some());
    assert!(said(tuner.step().map(|_| ())).contains("physics explains none"));
    let senseless = FineTuneOptions { crop: 33, ..options };
    let card = Card::from_json(include_str!("golden/tiny.json"), "tiny").unwrap();
    let refused = FineTuner::new(card, common::golden("tiny.safetensors"), &senseless, &Device::flex());
    assert!(refused.err().unwrap().to_string().contains("crop"));
}

#[test]
fn a_run_may_start_from_a_models_weights() {
    let _alone = alone();
    let extra = format!("start_from = {:?}", root().join("tests/golden/tiny.json"));
    let path = configuration("start-from", &extra);
    let mut first = None;
    let mut observe = |event: Event| {
        if let Event::Step(progress) = event {
            first.get_or_insert(progress.heatmap);
        }
    };
    let card = Card::from_file(&start(&path, &mut observe).unwrap()).unwrap();
    let tiny = Card::from_json(include_str!("golden/tiny.json"), "tiny").unwrap();
    assert_eq!((card.architecture, card.input), (tiny.architecture, tiny.input));
    let mut fresh = None;
    let mut observe = |event: Event| {
        if let Event::Step(progress) = event {
            fresh.get_or_insert(progress.heatmap);
        }
    };
    start(&configuration("start-fresh", ""), &mut observe).unwrap();
    assert!(first.unwrap() < fresh.unwrap() - 0.2, "{first:?} {fresh:?}");
}
