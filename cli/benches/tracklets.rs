//! Fits the weights by which `track` tells a ball's paths from others (`WeightsConfig` in `crates/track/src/video/config/`; with a model without a motion
//! network `without_motion`) and how paths fall without a camera (`FallConfig`), and prints both: `cargo bench --package gravisight-cli --bench all -- tracklets MODEL.JSON VIDEO LABELS.csv
//! [VIDEO LABELS.csv …]`, of videos that nothing is reported of. `scripts/fit-weights tracklets` runs it. Camera and scene of `x.mp4` are
//! `x.camera.json` and `x.scene.json`, where they are.
//!
//! A logistic regression on the tracklets of all videos, each video of the same weight, in which no evidence for a ball speaks against one. A tracklet is
//! the ball's where most of its frames with a label are within the ball's radius, or 4 px. The numbers of the fall are those of a list, one after the
//! other, with the greatest likelihood.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use gravisight::internal::{Hypotheses, TrackletFeatures};
use gravisight::track::{FallConfig, TrackerConfig};
use gravisight::{Camera, Card, Device, Localiser, Scene, VideoTracker};
use gravisight_cli::footage::Footage;
use nalgebra::{DMatrix, DVector};

/// Distance within which a hand label is met, px.
const NEAR_PX: f64 = 4.0;
/// Fraction of a tracklet's labelled frames that must be the ball's, and below which it is another thing's; between, it is neither.
const MOST: f64 = 0.7;
const FEW: f64 = 0.3;
/// Newton's steps of the logistic regression, and the strength of its prior.
const NEWTON_STEPS: usize = 60;
const RIDGE: f64 = 0.5;
/// Features that are evidence for a ball: the gain, the networks', the bend.
const FOR_A_BALL: [usize; 7] = [2, 3, 4, 5, 6, 7, 8];

/// The ball's place and radius by frame, px; none where it is not visible.
type Labels = HashMap<usize, Option<[f64; 3]>>;

fn labels(path: &Path) -> Labels {
    let mut table = csv::Reader::from_path(path).unwrap();
    let names = table.headers().unwrap().clone();
    let column = |name: &str| names.iter().position(|it| it == name);
    let row = |row: csv::StringRecord| {
        let number = |name: &str| column(name).and_then(|index| row.get(index)?.parse::<f64>().ok());
        let ball = number("Visibility")
            .filter(|&it| it > 0.0)
            .and_then(|_| Some([number("X")?, number("Y")?, number("Radius").unwrap_or(0.0)]));
        (number("Frame").unwrap() as usize, ball)
    };
    table.records().map(|record| row(record.unwrap())).collect()
}

/// Features of tracklets, and whether they are the ball.
type Rows = Vec<(DVector<f64>, f64)>;

/// Times that the numbers of the fall are gone through.
const ROUNDS: usize = 2;

/// A video that was tracked.
struct Video {
    name: String,
    tracker: VideoTracker,
    place: Option<(Camera, Scene)>,
    labels: Labels,
}

impl Video {
    fn open(localiser: &Arc<Localiser>, video: &Path, labels: Labels, fps: Option<f64>) -> Self {
        let footage = Footage::open(&[video.to_path_buf()], fps).unwrap();
        let times = footage.times().to_vec();
        let beside = |ending: &str| Some(video.with_extension(ending)).filter(|path| path.exists());
        let camera = beside("camera.json").map(|path| Camera::from_file(&path).unwrap());
        let scene = beside("scene.json").map(|path| Scene::open(&path).unwrap());
        let mut tracker = VideoTracker::new(localiser.clone(), camera.clone());
        let mut add = |frame: usize, picture| Ok(pollster::block_on(tracker.add(picture, times[frame]))?);
        footage.each(0..times.len(), &mut add).unwrap();
        pollster::block_on(tracker.end()).unwrap();
        Self { name: video.display().to_string(), tracker, place: camera.zip(scene), labels }
    }

    /// The rows of its tracklets.
    fn rows(&self, hypotheses: &Hypotheses, config: &TrackerConfig) -> Rows {
        let of_tracklet = |TrackletFeatures { features, places }: TrackletFeatures| {
            let known = places.iter().filter_map(|(frame, [x, y])| {
                let ball = self.labels.get(frame)?;
                Some(ball.is_some_and(|[u, v, radius]| (x - u).hypot(y - v) < NEAR_PX.max(radius)))
            });
            let known: Vec<bool> = known.collect();
            let right = known.iter().filter(|&&it| it).count() as f64 / known.len().max(1) as f64;
            let is_known = 2 * known.len() >= places.len() && !(FEW..MOST).contains(&right);
            is_known.then(|| (DVector::from_row_slice(&features), f64::from(u8::from(right >= MOST))))
        };
        let place = self.place.as_ref().map(|(camera, scene)| (camera, scene));
        hypotheses.tracklet_features(place, config).into_iter().filter_map(of_tracklet).collect()
    }
}

/// The values of the fall's numbers that are tried.
fn tried(fall: &FallConfig) -> Vec<FallConfig> {
    let mut all = vec![];
    all.extend([0.35, 0.5, 0.6, 0.8].map(|part| FallConfig { part, ..*fall }));
    all.extend([0.9, 1.0, 1.1, 1.2, 1.3].map(|along| FallConfig { along, ..*fall }));
    let spreads = [[0.2, 0.4], [0.2, 0.6], [0.3, 0.6], [0.3, 1.0], [0.4, 0.8]];
    all.extend(spreads.map(|spread| FallConfig { spread, ..*fall }));
    all.extend([0.2, 0.3, 0.45, 0.6].map(|spread_across| FallConfig { spread_across, ..*fall }));
    all.extend([0.02, 0.05, 0.1, 0.2].map(|slowed_fraction| FallConfig { slowed_fraction, ..*fall }));
    all.extend([0.1, 0.2, 0.3, 0.5].map(|own_gravity| FallConfig { own_gravity, ..*fall }));
    all
}

/// Weights, and the mean log-likelihood of a video's tracklets by them.
fn fitted(videos: &[Rows]) -> Option<(DVector<f64>, f64)> {
    let videos = || videos.iter().filter(|rows| !rows.is_empty());
    let weighted = |rows: &Rows| -> Vec<(DVector<f64>, f64, f64)> {
        rows.iter().map(|(row, ball)| (row.clone(), *ball, 1.0 / rows.len() as f64)).collect()
    };
    let all: Vec<(DVector<f64>, f64, f64)> = videos().flat_map(weighted).collect();
    let size = all.first()?.0.len();
    let scale = all.len() as f64 / videos().count() as f64;
    // What would speak against a ball, which it is for, has no weight.
    let mut free = vec![true; size];
    let weights = loop {
        let weights = regression(&all, &free, scale);
        match (0..size).find(|index| FOR_A_BALL.contains(index) && weights[*index] < 0.0) {
            Some(index) => free[index] = false,
            None => break weights,
        }
    };
    let log = |(row, ball, weight): &(DVector<f64>, f64, f64)| {
        let log_odds = weights.dot(row);
        -weight * (if *ball > 0.5 { -log_odds } else { log_odds }).exp().ln_1p()
    };
    let likelihood = all.iter().map(log).sum::<f64>() / videos().count() as f64;
    Some((weights, likelihood))
}

pub fn run(arguments: &[String]) {
    let mut arguments = arguments.to_vec();
    let fps = crate::common::is_check().then_some(30.0);
    if crate::common::is_check() {
        let model = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/any.json");
        arguments = std::iter::once(model.to_string()).chain(drawn()).collect();
    }
    let [model, clips @ ..] = arguments.as_slice() else {
        return println!(
            "usage: cargo bench --package gravisight-cli --bench all -- tracklets MODEL.JSON VIDEO LABELS.csv …"
        );
    };
    let (card, weights) = Card::with_weights(Path::new(model)).unwrap();
    let localiser = Arc::new(Localiser::new(card, weights, &Device::flex()).unwrap());
    let open = |clip: &[String]| {
        let [video, table] = [&clip[0], &clip[1]].map(PathBuf::from);
        Video::open(&localiser, &video, labels(&table), fps)
    };
    let videos: Vec<Video> = clips.chunks_exact(2).map(open).collect();
    let hypotheses: Vec<Hypotheses> = videos.iter().map(|video| video.tracker.hypotheses().unwrap()).collect();
    let rows = |config: &TrackerConfig| -> Vec<Rows> {
        let of_video = |(video, hypotheses): (&Video, &Hypotheses)| video.rows(hypotheses, config);
        videos.iter().zip(&hypotheses).map(of_video).collect()
    };
    let mut config = TrackerConfig::default();
    let found = rows(&config);
    for (video, rows) in videos.iter().zip(&found) {
        let balls: f64 = rows.iter().map(|(_, ball)| ball).sum();
        println!("{}: {} tracklets, {balls} the ball's", video.name, rows.len());
    }
    let Some((mut weights, mut best)) = fitted(&found) else { return println!("no tracklets") };
    let has_motion = localiser.card().motion.is_some();
    for _ in 0..ROUNDS {
        // How a path falls depends on the weights of the rest.
        for index in 0..tried(&config.fall).len() {
            let mut next = TrackerConfig { fall: tried(&config.fall)[index], ..config };
            let own: [f64; 9] = std::array::from_fn(|index| weights[index]);
            if has_motion {
                next.weights.with_motion = own
            } else {
                next.weights.without_motion = own
            }
            if let Some((other, likelihood)) = fitted(&rows(&next)).filter(|(_, likelihood)| *likelihood > best) {
                (config, weights, best) = (next, other, likelihood);
            }
        }
    }
    let listed: Vec<String> = weights.iter().map(|weight| format!("{weight:.3}")).collect();
    println!("mean log-likelihood {best:.4}; weights: [{}]; {:?}", listed.join(", "), config.fall);
    if crate::common::is_check() {
        std::fs::remove_dir_all(&clips[0]).unwrap();
    }
}

/// The weights of rows with their labels and weights, whose columns are `free` or have no weight.
fn regression(all: &[(DVector<f64>, f64, f64)], free: &[bool], scale: f64) -> DVector<f64> {
    let size = free.len();
    let mut weights = DVector::<f64>::zeros(size);
    // The constant is free.
    let ridge = DVector::from_fn(size, |index, _| if index == 0 { 1e-6 } else { RIDGE });
    let mask = DVector::from_fn(size, |index, _| f64::from(u8::from(free[index])));
    for _ in 0..NEWTON_STEPS {
        let mut gradient = -weights.component_mul(&ridge);
        let mut hessian = DMatrix::from_diagonal(&ridge);
        for (row, ball, weight) in all {
            let row = row.component_mul(&mask);
            let probability = 1.0 / (1.0 + (-weights.dot(&row)).exp());
            gradient += &row * ((ball - probability) * weight * scale);
            hessian += &row * row.transpose() * (probability * (1.0 - probability) * weight * scale);
        }
        weights += hessian.cholesky().unwrap().solve(&gradient);
    }
    weights
}

/// Frames of a disc that flies before a grey wall, and its labels.
fn drawn() -> [String; 2] {
    let folder = crate::common::scratch("tracklets");
    let mut labels = String::from("Frame,Visibility,X,Y,Radius\n");
    for number in 0..32 {
        let time = f64::from(number);
        let [u, v] = [10.0 + 4.0 * time, 80.0 - 5.0 * time + 0.14 * time * time];
        let frame = image::RgbImage::from_fn(160, 96, |x, y| {
            let inside = (f64::from(x) - u).hypot(f64::from(y) - v) < 5.0;
            image::Rgb(if inside { [230, 220, 60] } else { [90, 100, 110] })
        });
        frame.save(folder.join(format!("{number:02}.png"))).unwrap();
        labels += &format!("{number},1,{u},{v},5\n");
    }
    let table = folder.join("labels.csv");
    std::fs::write(&table, labels).unwrap();
    [folder.to_string_lossy().into(), table.to_string_lossy().into()]
}
