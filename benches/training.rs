//! Time of a training step of the small network and of the paper's, on the CPU or, in a build with `--features wgpu,fusion`, on a GPU.
//!
//! `cargo bench --features wgpu,fusion --bench all -- training --device wgpu`. With `CUBECL_DEBUG_OPTION=profile` and
//! `CUBECL_DEBUG_LOG=FILE` CubeCL writes a line for each kernel that it starts. Arguments: parts of the networks' names. `--batch N` and
//! `--side PX` change the pictures; with `--peak TFLOPS` a share of the device's peak is printed. `benches/convolution` compares a step on the
//! CPU with PyTorch's.

use std::time::Instant;

use burn::tensor::Device;
use gravisight::internal::{AdamW, Batch, HeatmapLoss, Labels, Pen, PenConfig, StepOptions, median, step};

use crate::convolution::{flops, noise};

/// Steps that are timed; the one before compiles kernels.
const STEPS: usize = 5;

/// Labels of `batch` pictures.
pub(crate) fn labels(batch: usize) -> Labels {
    let middle = |index: usize| 20.0 + 3.0 * index as f64;
    Labels {
        picture: (0..batch).collect(),
        image: (0..batch).map(|index| Some([middle(index), middle(batch - index)])).collect(),
        depth: (0..batch).map(|index| 5.0 + 0.2 * index as f64).collect(),
        depth_weight: vec![1.0; batch],
    }
}

/// Makes steps of `pen`, all on the same batch: each says its seconds and its loss.
pub(crate) fn stepper(
    pen: Pen,
    batch: Batch,
    heatmap_loss: HeatmapLoss,
    device: &Device,
) -> impl FnMut() -> (f64, f64) + Send + use<> {
    let options = StepOptions {
        heatmap_loss,
        depth_weight: 0.2,
        future_weight: 0.0,
        robust_px: None,
        depth_transition: 0.5,
        centre_weight: 0.0,
        clip_norm: 1.0,
        learning_rate: 1e-3,
    };
    let device = device.clone();
    let mut optimiser = AdamW::new(0.0, 1e-5);
    let mut pen = Some(pen);
    // The next step's batch is made beforehand.
    let mut next = Some(batch.clone());
    move || {
        let (before, now) = (pen.take().expect("a network"), next.take().expect("a batch"));
        let begin = Instant::now();
        let mut knowledge = Default::default();
        let made = step(before, &mut optimiser, now, &options, &mut knowledge, &device);
        let (after, report) = pollster::block_on(made).expect("a step");
        let time = begin.elapsed().as_secs_f64();
        pen = Some(after);
        next = Some(batch.clone());
        (time, report.loss)
    }
}

/// The value of an option of this bench.
fn option(name: &str) -> Option<String> {
    std::env::args().skip_while(|argument| argument != name).nth(1)
}

/// The same as a number.
fn number(name: &str) -> Option<f64> {
    option(name).map(|text| text.parse().unwrap_or_else(|_| panic!("{name} takes a number, not `{text}`")))
}

/// `--device`, CPU where it is not given.
fn device(name: Option<&str>) -> Device {
    match name {
        None | Some("cpu") => Device::flex(),
        #[cfg(feature = "wgpu")]
        Some("wgpu") => {
            let gpu = gravisight::Gpu::open().expect("a GPU");
            println!("{}", gpu.name);
            gpu.device
        }
        Some(other) => panic!("no device `{other}` in this build; cpu, or wgpu with --features wgpu,fusion"),
    }
}

pub fn run(arguments: &[String]) {
    // An option does not come with the arguments, but its value does.
    let values: Vec<String> = ["--device", "--batch", "--side", "--peak"].into_iter().filter_map(option).collect();
    let wanted: Vec<&String> = arguments.iter().filter(|argument| !values.contains(argument)).collect();
    let device = device(option("--device").as_deref()).autodiff();
    let published = HeatmapLoss::Mse { amplitude: 100.0, sigma: 2.0 };
    let small = HeatmapLoss::CrossEntropy { sigma: 4.0 };
    for (name, config, batch, side, loss) in
        [("compact", PenConfig::compact(7.4), 24, 128, small), ("paper", PenConfig::paper(), 12, 224, published)]
    {
        let is_wanted = wanted.is_empty() || wanted.iter().any(|part| name.contains(part.as_str()));
        // A check takes the small one.
        if !is_wanted || (crate::common::is_check() && name == "paper") {
            continue;
        }
        let (batch, side) = (
            number("--batch").map_or(batch, |given| given as usize),
            number("--side").map_or(side, |given| given as usize),
        );
        device.seed(1);
        let pen = Pen::new(&config, &device).expect("a network");
        let pictures = noise(batch * side * side * 3);
        let batch_of = Batch { pictures, size: [side; 2], channels: 3, labels: labels(batch), windows: vec![] };
        let mut step = stepper(pen, batch_of, loss, &device);
        let (first, loss) = step();
        let steps = if crate::common::is_check() { 1 } else { STEPS };
        let time = median((0..steps).map(|_| step().0).collect::<Vec<f64>>()).unwrap_or(f64::NAN);
        let rate = 3.0 * flops(&config, side) * batch as f64 / time / 1e9;
        let share =
            number("--peak").map_or(String::new(), |peak| format!(" ({:.1} % of the peak)", rate / peak / 10.0));
        println!(
            "{name:8} {batch} × {side}²: {:9.1} ms a step, {rate:7.0} GFLOP/s{share}; the first {first:.1} s, its loss {loss:.6}",
            1e3 * time
        );
    }
}
