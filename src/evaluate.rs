//! Metrics, with units: how far off the positions found are.

use std::collections::BTreeMap;

use nalgebra::{Point2, Point3, distance};
use serde::Serialize;

use crate::data::{Clip, Clips, Frame};
use crate::error::{Error, Result};
use crate::localise::Localiser;

/// One picture's result beside its truth.
#[derive(Debug, Clone)]
pub struct Sample {
    /// The clip's id; the parts that begin with `env` and `cam` name environment and camera.
    pub clip: String,
    /// Position found, world frame, m.
    pub found: Point3<f64>,
    /// True position, world frame, m.
    pub truth: Point3<f64>,
    /// True depth (camera z), m.
    pub true_depth: f64,
    /// True distance from the camera, m.
    pub true_range: f64,
    /// 2D position found, px.
    pub found_image: Point2<f64>,
    /// 2D label, px.
    pub true_image: Point2<f64>,
}

/// Mean, standard deviation (of the population), median and number of values.
/// All NaN-free: without values they are absent.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Statistic {
    /// Mean.
    pub mean: Option<f64>,
    /// Standard deviation.
    pub std: Option<f64>,
    /// Median.
    pub median: Option<f64>,
    /// Number of values.
    pub n: usize,
}

/// Depth bins of the binned DtG (paper eq. for DtG_b).
#[derive(Debug, Clone, Copy)]
pub struct Bins {
    /// Number of bins.
    pub count: usize,
    /// Lower edge of the first, m.
    pub z_min: f64,
    /// Upper edge of the last, m.
    pub z_max: f64,
}

/// FORMATS.md's `evaluate` result. Lengths in m.
#[derive(Debug, Clone, Serialize)]
pub struct Metrics {
    /// Distance to ground truth.
    pub dtg: Statistic,
    /// DtG by true depth, nearest bin first.
    pub dtg_binned: Vec<Statistic>,
    /// DtG over the true distance from the camera (no unit).
    pub dtg_relative: Statistic,
    /// 2D error, px.
    pub image_error_px: Statistic,
    /// DtG by camera.
    pub per_camera: BTreeMap<String, Statistic>,
    /// DtG by environment.
    pub per_environment: BTreeMap<String, Statistic>,
}

impl Statistic {
    /// Of `values`.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Self {
        let mut values: Vec<f64> = values.into_iter().collect();
        values.sort_by(f64::total_cmp);
        let n = values.len();
        if n == 0 {
            return Self { mean: None, std: None, median: None, n };
        }
        let mean = values.iter().sum::<f64>() / n as f64;
        let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / n as f64;
        let median = (values[(n - 1) / 2] + values[n / 2]) / 2.0;
        Self { mean: Some(mean), std: Some(variance.sqrt()), median: Some(median), n }
    }
}

impl Sample {
    /// Distance to ground truth, m.
    pub fn dtg(&self) -> f64 {
        distance(&self.found, &self.truth)
    }

    /// Distance in the picture, px.
    pub fn image_error(&self) -> f64 {
        distance(&self.found_image, &self.true_image)
    }

    /// The part of the clip's id that begins with `prefix`, e.g. `cam1`.
    fn part(&self, prefix: &str) -> Option<&str> {
        self.clip.split('/').find(|part| part.starts_with(prefix))
    }
}

impl Metrics {
    /// Metrics of `samples` with DtG binned by `bins`.
    pub fn of(samples: &[Sample], bins: Bins) -> Self {
        let width = (bins.z_max - bins.z_min) / bins.count as f64;
        // The last bin holds its upper edge, as all of the paper's do; a sample counts once.
        let bin = |depth: f64| match depth {
            depth if depth < bins.z_min || depth > bins.z_max => None,
            depth => Some((((depth - bins.z_min) / width) as usize).min(bins.count - 1)),
        };
        let in_bin = |index| samples.iter().filter(move |sample| bin(sample.true_depth) == Some(index));
        Self {
            dtg: Statistic::of(samples.iter().map(Sample::dtg)),
            dtg_binned: (0..bins.count).map(|index| Statistic::of(in_bin(index).map(Sample::dtg))).collect(),
            dtg_relative: Statistic::of(samples.iter().map(|sample| sample.dtg() / sample.true_range)),
            image_error_px: Statistic::of(samples.iter().map(Sample::image_error)),
            per_camera: grouped(samples, "cam"),
            per_environment: grouped(samples, "env"),
        }
    }
}

/// DtG of the samples that share the part of the clip's id that begins with `prefix`.
fn grouped(samples: &[Sample], prefix: &str) -> BTreeMap<String, Statistic> {
    let mut groups: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for sample in samples {
        if let Some(name) = sample.part(prefix) {
            groups.entry(name.into()).or_default().push(sample.dtg());
        }
    }
    groups.into_iter().map(|(name, values)| (name, Statistic::of(values))).collect()
}

/// Runs `localiser` on every frame of `clips` that has a 2D and a 3D label, hidden balls included
/// (as the paper does); with `limit`, on about that many, evenly spread. `progress` gets the number
/// done and in all.
///
/// # Errors
/// As [`Clips::picture`] and [`Localiser::localise`]; [`Error::Data`] where no frame has labels.
pub async fn score(
    localiser: &Localiser,
    clips: &Clips,
    limit: Option<usize>,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Vec<Sample>> {
    let labelled: Vec<_> = clips.clips.iter().flat_map(labelled_frames).collect();
    if labelled.is_empty() {
        let reason = "no frame has both `image` and `world`, so there is nothing to score against".into();
        return Err(Error::Data { what: clips.folder.display().to_string(), reason });
    }
    let count = limit.map_or(labelled.len(), |limit| limit.min(labelled.len()));
    let mut samples = Vec::with_capacity(count);
    for index in 0..count {
        let (clip, frame, image, world) = labelled[index * labelled.len() / count];
        let picture = clips.picture(clip, frame)?;
        let found = localiser.localise(&picture, &clip.camera, false).await.map_err(|error| Error::Data {
            what: format!("clip `{}`, frame {}", clip.id, frame.file.display()),
            reason: error.to_string(),
        })?;
        let truth = Point3::from(world);
        let true_camera = clip.camera.camera_from_world(&truth);
        samples.push(Sample {
            clip: clip.id.clone(),
            found: Point3::from(found.world),
            truth,
            true_depth: true_camera.z,
            true_range: true_camera.coords.norm(),
            found_image: Point2::from(found.image),
            true_image: Point2::from(image),
        });
        progress(index + 1, count);
    }
    Ok(samples)
}

/// Frames of `clip` with both labels, and the labels.
fn labelled_frames(clip: &Clip) -> impl Iterator<Item = (&Clip, &Frame, [f64; 2], [f64; 3])> {
    clip.frames.iter().filter_map(move |frame| Some((clip, frame, frame.image?, frame.world?)))
}

/// Distance between a position found and the truth, m: DtG of one picture (paper, "Evaluation Metrics").
pub fn distance_to_ground_truth(found: [f64; 3], truth: [f64; 3]) -> f64 {
    distance(&Point3::from(found), &Point3::from(truth))
}
