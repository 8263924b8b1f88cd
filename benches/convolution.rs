//! Time of PEN's inference and of its training step as ratios to PyTorch and ONNX Runtime: the same network, weights
//! and pictures, the same number of threads, runs taken in turns.
//!
//! `benches/convolution` prepares the peers and runs this, then the same in Chromium; without the peers
//! (`cargo bench --bench all -- convolution`) only our own times are printed. Arguments: parts of the jobs' names.

use std::hint::black_box;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

use burn::tensor::{Device, Tensor, TensorData};
use gravisight::internal::{
    BackboneConfig, Batch, CARD_VERSION, HeadConfig, HeatmapLoss, Labels, Normalisation, Pen, PenConfig, PenOutput,
    median, save, sha256_hex,
};
use gravisight::{Card, Size};
use serde_json::{Value, json};

use crate::training;

/// Side of the pictures, px.
const SIDE: usize = 224;
/// Seconds that each of the contestants may compute for one row.
const PATIENCE: f64 = 6.0;
const ROUNDS: usize = 25;
/// Runs in a contestant's turn.
const TURN: usize = 5;
/// How long a turn's runs go on before they count: they bring memory back into the caches and threads back onto
/// their cores.
const WARM_UP: Duration = Duration::from_millis(40);
/// Lets the other contestants' threads fall asleep.
const PAUSE: Duration = Duration::from_millis(40);
/// Standard deviation of the heatmap's target, px.
const SIGMA: f64 = 4.0;

struct Job {
    name: &'static str,
    config: PenConfig,
    threads: usize,
    batch: usize,
    side: usize,
    training: bool,
    /// Largest ratio to the fastest peer.
    limit: f64,
}

impl Job {
    /// The network's name, before the batch and the threads.
    fn file_name(&self) -> &str {
        self.name.split([' ', '/']).next().unwrap_or(self.name)
    }
}

fn jobs() -> Vec<Job> {
    let compact = || PenConfig::compact(7.4);
    let narrow = PenConfig { head: HeadConfig::Paper { channels: [64, 64, 64] }, ..PenConfig::paper() };
    let job =
        |name, config, threads, batch, limit| Job { name, config, threads, batch, side: SIDE, training: false, limit };
    let training =
        |name, side| Job { name, config: compact(), threads: 2, batch: 24, side, training: true, limit: 1.0 };
    vec![
        job("compact b1 t1", compact(), 1, 1, 0.8),
        job("compact b1 t2", compact(), 2, 1, 0.8),
        job("compact b8 t1", compact(), 1, 8, 0.8),
        job("compact b8 t2", compact(), 2, 8, 0.8),
        job("resnet34/64 b1 t2", narrow, 2, 1, 1.0),
        job("paper b1 t2", PenConfig::paper(), 2, 1, 1.0),
        training("train 24x128 t2", 128),
        training("train 24x224 t2", 224),
    ]
}

/// Multiplications and additions of one forward pass of a network, by counting those of each layer.
pub(crate) fn flops(config: &PenConfig, side: usize) -> f64 {
    let conv = |input: usize, output: usize, kernel: usize, stride: usize| {
        2.0 * (input * output * kernel * kernel * (side / stride).pow(2)) as f64
    };
    let block = |channels: usize, stride: usize| 2.0 * conv(channels, channels, 3, stride);
    match (&config.backbone, &config.head) {
        (&BackboneConfig::Compact { stem, stages, pyramid, .. }, _) => {
            let inputs = [stem, stages[0], stages[1], stages[2]];
            let stages = inputs.into_iter().zip(stages).enumerate().map(|(index, (input, output))| {
                let stride = 4 << index;
                conv(input, output, 3, stride) + block(output, stride) + conv(output, pyramid, 1, stride)
            });
            let head = conv(pyramid, 1, 7, 4) + conv(pyramid, pyramid, 1, 4) + conv(pyramid, 1, 1, 4);
            conv(3, stem, 5, 2) + stages.sum::<f64>() + conv(pyramid, pyramid, 3, 4) + 2.0 * head
        }
        (&BackboneConfig::ResNet34 { width }, HeadConfig::Paper { channels: [a, b, c] }) => {
            let down = |width, stride| conv(width, 2 * width, 3, stride) + conv(width, 2 * width, 1, stride);
            let layers = 3.0 * block(width, 4)
                + down(width, 8)
                + 3.5 * block(2 * width, 8)
                + down(2 * width, 16)
                + 5.5 * block(4 * width, 16);
            let head = conv(8 * width, *a, 1, 2) + conv(*a, *b, 7, 2) + conv(*b, *c, 7, 2) + conv(*c, 1, 1, 2);
            conv(3, width, 7, 2) + layers + 2.0 * head
        }
        _ => f64::NAN,
    }
}

/// Reproducible numbers in [-1, 1).
pub(crate) fn noise(count: usize) -> Vec<f32> {
    let mut state = 0x2545_f491_4f6c_dd1d_u64;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 40) as f32 / (1 << 23) as f32 - 1.0
    };
    (0..count).map(|_| next()).collect()
}

/// PyTorch and ONNX Runtime in their own process.
struct Peers {
    child: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
}

impl Peers {
    fn start() -> Option<Self> {
        let python = std::env::var_os("GRAVISIGHT_PEERS")?;
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/peers/convolution.py");
        let mut child = Command::new(python)
            .arg(script)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("the peers start");
        let input = child.stdin.take().expect("a pipe");
        let output = BufReader::new(child.stdout.take().expect("a pipe"));
        Some(Self { child, input, output })
    }

    fn ask(&mut self, question: &Value) -> Value {
        writeln!(self.input, "{question}").expect("the peers listen");
        let mut line = String::new();
        self.output.read_line(&mut line).expect("the peers answer");
        serde_json::from_str(&line).expect("the peers answer in JSON")
    }

    fn seconds(&mut self, peer: &str) -> f64 {
        self.ask(&json!({ "run": peer }))["seconds"].as_f64().expect("a time")
    }
}

impl Drop for Peers {
    fn drop(&mut self) {
        self.child.kill().ok();
        self.child.wait().ok();
    }
}

fn seconds(run: &mut dyn FnMut()) -> f64 {
    let begin = Instant::now();
    run();
    begin.elapsed().as_secs_f64()
}

/// The best rate of a product of matrices that fits the cache, GFLOP/s: 1,024 × 256 × 256, by flex.
fn gemm_peak(threads: usize) -> f64 {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    pool.install(|| {
        let matrix =
            |rows: usize| Tensor::<2>::from_data(TensorData::new(noise(rows * 256), [rows, 256]), &Device::flex());
        let (x, weights) = (matrix(1024), matrix(256));
        let mut run = || drop(black_box(x.clone().matmul(weights.clone())));
        let best = (0..if crate::common::is_check() { 1 } else { 300 })
            .map(|_| seconds(&mut run))
            .fold(f64::INFINITY, f64::min);
        2.0 * 1024.0 * 256.0 * 256.0 / best / 1e9
    })
}

/// Heatmap targets as the peer needs them, `[batch, cells]`.
fn shares(labels: &Labels, cells: usize) -> Vec<Vec<f64>> {
    let centre = |cell: usize| cell as f64 * 4.0 + 1.5;
    let gaussian = |at: f64, centre: f64| (-0.5 * ((at - centre) / SIGMA).powi(2)).exp();
    let of = |&[x, y]: &[f64; 2]| {
        let values: Vec<f64> = (0..cells * cells)
            .map(|cell| gaussian(centre(cell % cells), x) * gaussian(centre(cell / cells), y))
            .collect();
        let mass: f64 = values.iter().sum();
        values.iter().map(|value| value / mass).collect()
    };
    labels.image.iter().flatten().map(of).collect()
}

/// Weights and card of a job's network, for benches/browser.
fn export(job: &Job, folder: &Path, weights: &Path) {
    let weights = std::fs::read(weights).expect("weights");
    let name = job.file_name();
    let card = Card {
        name: name.into(),
        version: CARD_VERSION,
        weights: format!("{name}.safetensors"),
        sha256: sha256_hex(&weights),
        architecture: job.config.clone(),
        verifier: None,
        motion: None,
        input: Size::square(SIDE as u32),
        normalisation: Normalisation::default(),
        depth_from: None,
        depth_range: Some([1.0, 20.0]),
        radius_range: None,
        confidence_threshold: None,
        calibration: None,
        training_data: "none".into(),
        description: "Random weights, for timing.".into(),
        metrics: json!({}),
        licence: "MIT OR Apache-2.0".into(),
    };
    std::fs::write(folder.join(&card.weights), weights).expect("room");
    std::fs::write(folder.join(name).with_extension("json"), serde_json::to_vec(&card).expect("a card")).expect("room");
}

fn contest(job: &Job, peers: Option<&mut Peers>, peak: f64) {
    let device = if job.training { Device::flex().autodiff() } else { Device::flex() };
    device.seed(1);
    let pen = Pen::new(&job.config, &device).expect("a network");
    let pictures = noise(job.batch * job.side * job.side * 3);
    let folder = std::env::temp_dir().join(format!("gravisight-bench-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let file = |name: &str| folder.join(name);
    std::fs::write(file("weights"), save(&pen).expect("weights")).expect("room");
    let bytes = |values: &[f32]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
    std::fs::write(file("picture"), bytes(&pictures)).expect("room");
    let path = |name: &str| -> PathBuf { file(name) };
    let mut load = json!({
        "config": job.config, "threads": job.threads, "batch": job.batch, "size": [job.side, job.side],
        "weights": path("weights"), "picture": path("picture"), "expected": path("expected"),
    });
    let wanted = std::env::var_os("GRAVISIGHT_EXPORT").map(PathBuf::from);
    if let Some(folder) = wanted.or_else(|| crate::common::is_check().then(|| folder.clone())) {
        export(job, &folder, &file("weights"));
        load["onnx"] = json!(folder.join(job.file_name()).with_extension("onnx"));
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(job.threads).build().expect("threads");
    let mut ours: Box<dyn FnMut() -> f64 + Send> = if job.training {
        let labels = training::labels(job.batch);
        load["share"] = json!(shares(&labels, job.side / 4).concat());
        load["depth"] = json!(labels.depth);
        let batch = Batch { pictures, size: [job.side; 2], channels: 3, labels, windows: vec![] };
        let loss = HeatmapLoss::CrossEntropy { sigma: SIGMA };
        let mut step = training::stepper(pen, batch, loss, &device);
        Box::new(move || step().0)
    } else {
        let runner = pen.runner(Size::square(job.side as u32), &device);
        let read = |output: PenOutput| -> Vec<f32> {
            [output.heatmap, output.depth]
                .into_iter()
                .flat_map(|map| map.into_data().iter::<f32>().collect::<Vec<_>>())
                .collect()
        };
        let found = pool.install(|| read(runner.run(pictures.clone())));
        std::fs::write(file("expected"), bytes(&found)).expect("room");
        Box::new(move || {
            let now = pictures.clone();
            let begin = Instant::now();
            drop(black_box(runner.run(now)));
            begin.elapsed().as_secs_f64()
        })
    };
    let mut run = || pool.install(&mut *ours);
    let mut contestants = vec!["ours".to_owned()];
    let mut difference = String::new();
    let mut peers = peers;
    if let Some(peers) = peers.as_deref_mut() {
        let answer = peers.ask(&json!({ "load": load }));
        contestants
            .extend(answer["peers"].as_array().expect("names").iter().filter_map(Value::as_str).map(str::to_owned));
        if let Some(share) = answer["difference"].as_f64() {
            difference = format!("  maps differ by {share:.0e}");
        }
    }
    let mut times = vec![Vec::new(); contestants.len()];
    let begin = Instant::now();
    run();
    for round in 0..if crate::common::is_check() { 1 } else { ROUNDS } {
        for (name, times) in contestants.iter().zip(&mut times) {
            std::thread::sleep(PAUSE);
            let mut once = || match (name.as_str(), peers.as_deref_mut()) {
                ("ours", _) | (_, None) => run(),
                (name, Some(peers)) => peers.seconds(name),
            };
            let begin = Instant::now();
            while begin.elapsed() < WARM_UP {
                once();
            }
            times.extend((0..TURN).map(|_| once()));
        }
        if round >= 4 && begin.elapsed().as_secs_f64() > PATIENCE * contestants.len() as f64 {
            break;
        }
    }
    let rounds = times[0].len();
    let medians: Vec<f64> = times.into_iter().filter_map(median).collect();
    let work = flops(&job.config, job.side) * job.batch as f64 * if job.training { 3.0 } else { 1.0 };
    let rate = work / medians[0] / 1e9;
    print!("{:18} {:9.2} ms {:7.0} GFLOP/s {:4.0} % ", job.name, 1e3 * medians[0], rate, 100.0 * rate / peak);
    if let Some(fastest) = medians[1..].iter().copied().reduce(f64::min) {
        let ratio = medians[0] / fastest;
        let mark = if ratio <= job.limit { "" } else { "  MISSED" };
        print!(" ratio {ratio:5.2} (at most {:.1}{mark})  ", job.limit);
    }
    for (name, seconds) in contestants.iter().zip(&medians).skip(1) {
        print!(" {name} {:.2} ms;", 1e3 * seconds);
    }
    println!(" {rounds} runs{difference}");
    std::fs::remove_dir_all(folder).ok();
}

pub fn run(arguments: &[String]) {
    let wanted = if crate::common::is_check() { vec!["compact b1 t1".into()] } else { arguments.to_vec() };
    let mut peers = Peers::start();
    let peaks = [1, 2].map(gemm_peak);
    println!("measured peak of a matrix product: {:.0} GFLOP/s on one thread, {:.0} on two", peaks[0], peaks[1]);
    println!("GFLOP/s are the network's own (direct) operations over the median time; fewer are carried out");
    for job in jobs() {
        if wanted.is_empty() || wanted.iter().any(|part| job.name.contains(part.as_str())) {
            contest(&job, peers.as_mut(), peaks[job.threads - 1]);
        }
    }
}
