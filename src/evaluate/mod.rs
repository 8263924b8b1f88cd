//! Metrics, with units: how far off the positions found are.

mod depth_map;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use nalgebra::{Point2, Point3, distance};
use serde::Serialize;

pub use self::depth_map::{DepthMapScore, score_depth_maps};
use crate::localise::{ConfidenceKind, Localisation, LocaliseOptions, Localiser};
use gravisight_clips::{Clip, Clips};
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::size::Size;

/// Groups of equally many pictures in the confidence calibration.
const CONFIDENCE_GROUPS: usize = 10;

/// One picture's result beside its truth.
#[derive(Debug, Clone)]
pub struct Sample {
    /// The clip's id; the parts that begin with `env` and `cam` name environment and camera.
    pub clip: String,
    /// The clip's place in [`Clips::clips`] and the frame's in the clip.
    pub place: [usize; 2],
    /// Whether any of the ball is seen; where not, it is hidden and its labels come from elsewhere.
    pub visible: bool,
    /// Position found, world frame, m.
    pub found: Point3<f64>,
    /// True position, world frame, m.
    pub truth: Point3<f64>,
    /// The ball's radius that was given to the model, m.
    pub ball_radius: Option<f64>,
    /// Depth found (camera z), m.
    pub found_depth: f64,
    /// Its standard deviation, m, where the model says it.
    pub depth_sigma: Option<f64>,
    /// True depth (camera z), m.
    pub true_depth: f64,
    /// True distance from the camera, m.
    pub true_range: f64,
    /// 2D position found, px.
    pub found_image: Point2<f64>,
    /// 2D label, px.
    pub true_image: Point2<f64>,
    /// The model's confidence, 0 to 1, of the kind that follows.
    pub confidence: f64,
    /// What the confidence is.
    pub confidence_kind: ConfidenceKind,
    /// Radius around the position found within which the label shows it to be right in the sense of the confidence, px of the
    /// picture: 12 px of the network's input of a [`ConfidenceKind::HeatmapMass`], the outline's own radius of a
    /// [`ConfidenceKind::BallProbability`].
    pub confidence_radius: f64,
    /// Time to read and decode the picture's file, s.
    pub seconds_to_decode: f64,
    /// Time from the decoded picture to the position, s.
    pub seconds_to_localise: f64,
}

/// Mean, standard deviation (of the population), median and number of values.
/// All NaN-free: without values they are absent.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify), tsify(missing_as_null))]
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

/// Depth bins of the binned DtG (paper, eq. for DtG_b): `count` of equal width between `z_min` and `z_max`.
///
/// A bin holds its lower edge, the last one its upper edge, too; what lies outside is in none. (The
/// paper closes every bin at both ends, so that a depth on an inner edge would count twice.)
#[derive(Debug, Clone, Copy)]
pub struct Bins {
    /// Number of bins.
    pub count: usize,
    /// Lower edge of the first, m.
    pub z_min: f64,
    /// Upper edge of the last, m.
    pub z_max: f64,
}

/// What `evaluate --json` prints (`docs/formats.md`). Lengths in m.
#[derive(Debug, Clone, Serialize)]
pub struct Metrics {
    /// Distance to ground truth, of all pictures, also those in which something hides the ball (as the paper has it).
    pub dtg: Statistic,
    /// The same of the pictures in which some of the ball is seen.
    pub dtg_visible: Statistic,
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
    /// What the model's confidence is; absent without pictures.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub confidence_kind: Option<ConfidenceKind>,
    /// How well the confidence is calibrated: the pictures in groups of equally many, the least confident first.
    pub calibration: Vec<CalibrationGroup>,
    /// Error of the depth as a fraction of the true one, of the pictures in which some of the ball is seen; of models that say
    /// how sure they are of a depth, as are the next two.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_error_relative: Option<Statistic>,
    /// Fractions of those pictures whose depth is within one and two of the stated standard deviations.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_coverage: Option<BTreeMap<u8, f64>>,
    /// Fraction of those pictures whose depth is off by more than 30 %.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gross: Option<f64>,
    /// Time a picture takes.
    pub seconds_per_picture: Seconds,
}

/// Error of a depth, as a fraction of it, beyond which it is grossly wrong.
const GROSS: f64 = 0.3;

/// A group of pictures with similar confidence.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CalibrationGroup {
    /// The model's confidence. It is well calibrated where its mean is [`Self::near`].
    pub confidence: Statistic,
    /// Fraction of the pictures in which the position found is right in the sense of the confidence: its 2D label lies within
    /// [`Sample::confidence_radius`].
    pub near: f64,
    /// Distance to ground truth, m.
    pub dtg: Statistic,
}

/// Time a picture takes, s.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Seconds {
    /// From the decoded picture to the position: the network, and what it takes to feed and read it.
    pub network: Statistic,
    /// From the file on, its decoding included.
    pub with_decoding: Statistic,
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

    /// Whether the position found is right in the sense of the confidence.
    fn is_near(&self) -> bool {
        self.image_error() <= self.confidence_radius
    }

    /// The part of the clip's id that begins with `prefix`, e.g. `cam1`.
    pub fn part(&self, prefix: &str) -> Option<&str> {
        self.clip.split('/').find(|part| part.starts_with(prefix))
    }
}

impl Bins {
    /// `count` bins from the nearest to the farthest ball of `samples`.
    pub fn over(samples: &[Sample], count: usize) -> Self {
        let depths = || samples.iter().map(|sample| sample.true_depth);
        Self { count, z_min: depths().fold(f64::INFINITY, f64::min), z_max: depths().fold(0.0, f64::max) }
    }

    /// The `count + 1` edges, ascending, m.
    pub fn edges(&self) -> Vec<f64> {
        let width = (self.z_max - self.z_min) / self.count as f64;
        let inner = (0..self.count).map(|index| self.z_min + index as f64 * width);
        inner.chain([self.z_max]).collect()
    }

    /// `samples` by bin, nearest first.
    pub fn sorted<'a>(&self, samples: &'a [Sample]) -> Vec<Vec<&'a Sample>> {
        let edges = self.edges();
        let mut bins = vec![Vec::new(); self.count];
        for sample in samples.iter().filter(|sample| (self.z_min..=self.z_max).contains(&sample.true_depth)) {
            let above = edges.partition_point(|&edge| edge <= sample.true_depth);
            bins[above.clamp(1, self.count) - 1].push(sample);
        }
        bins
    }
}

impl Metrics {
    /// Metrics of `samples` with DtG binned by `bins`.
    pub fn of(samples: &[Sample], bins: Bins) -> Self {
        let visible = samples.iter().filter(|sample| sample.visible);
        let with_sigma: Vec<(f64, f64, f64)> = (samples.iter().filter(|sample| sample.visible))
            .filter_map(|it| Some((it.found_depth - it.true_depth, it.true_depth, it.depth_sigma?)))
            .collect();
        let fraction = |of: &dyn Fn(&(f64, f64, f64)) -> bool| {
            (!with_sigma.is_empty())
                .then(|| with_sigma.iter().filter(|it| of(it)).count() as f64 / with_sigma.len() as f64)
        };
        let within = |times: u8| fraction(&|(error, _, sigma)| error.abs() <= f64::from(times) * sigma);
        let binned = bins.sorted(samples).into_iter().map(|bin| Statistic::of(bin.into_iter().map(Sample::dtg)));
        Self {
            dtg: Statistic::of(samples.iter().map(Sample::dtg)),
            dtg_visible: Statistic::of(visible.map(Sample::dtg)),
            dtg_binned: binned.collect(),
            dtg_relative: Statistic::of(samples.iter().map(|sample| sample.dtg() / sample.true_range)),
            image_error_px: Statistic::of(samples.iter().map(Sample::image_error)),
            per_camera: grouped(samples, "cam"),
            per_environment: grouped(samples, "env"),
            confidence_kind: samples.first().map(|sample| sample.confidence_kind),
            calibration: calibration(samples),
            depth_error_relative: (!with_sigma.is_empty())
                .then(|| Statistic::of(with_sigma.iter().map(|(error, depth, _)| error.abs() / depth))),
            depth_coverage: [1, 2].into_iter().map(|times| Some((times, within(times)?))).collect(),
            gross: fraction(&|(error, depth, _)| error.abs() > GROSS * depth),
            seconds_per_picture: Seconds {
                network: Statistic::of(samples.iter().map(|sample| sample.seconds_to_localise)),
                with_decoding: Statistic::of(
                    samples.iter().map(|sample| sample.seconds_to_decode + sample.seconds_to_localise),
                ),
            },
        }
    }
}

/// Groups of equally many samples (to within one), the least confident first; with few samples, fewer groups.
fn calibration(samples: &[Sample]) -> Vec<CalibrationGroup> {
    let mut sorted: Vec<&Sample> = samples.iter().collect();
    sorted.sort_by(|a, b| a.confidence.total_cmp(&b.confidence));
    let groups = CONFIDENCE_GROUPS.min(sorted.len());
    let group = |index| &sorted[index * sorted.len() / groups..(index + 1) * sorted.len() / groups];
    let summary = |group: &[&Sample]| CalibrationGroup {
        confidence: Statistic::of(group.iter().map(|sample| sample.confidence)),
        near: group.iter().filter(|sample| sample.is_near()).count() as f64 / group.len() as f64,
        dtg: Statistic::of(group.iter().map(|sample| sample.dtg())),
    };
    (0..groups).map(|index| summary(group(index))).collect()
}

/// DtG of the samples by the part of the clip's id that begins with `prefix`.
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
/// (as the paper does); with `limit`, on about that many, evenly spread. A model that reads sizes is given `ball_radius` (m), or
/// that of a clip's scene. `clock` tells the time, s since any moment: what
/// clock there is, only the caller knows. `progress` gets the number done and in all.
///
/// ```no_run
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let localiser: gravisight::Localiser = unimplemented!();
/// use gravisight::{Clips, Metrics, score};
/// use gravisight::evaluate::Bins;
///
/// let clips = Clips::read("clips".as_ref())?;
/// let start = std::time::Instant::now();
/// let clock = || start.elapsed().as_secs_f64();
/// let samples = pollster::block_on(score(&localiser, &clips, None, None, &clock, &mut |_, _| ()))?;
/// println!("DtG {:?} m", Metrics::of(&samples, Bins::over(&samples, 5)).dtg.mean);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// As [`Clips::picture`] and [`Localiser::localise`]; [`Error::Data`] where no frame has labels.
pub async fn score(
    localiser: &Localiser,
    clips: &Clips,
    limit: Option<usize>,
    ball_radius: Option<f64>,
    clock: &dyn Fn() -> f64,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Vec<Sample>> {
    let clips_with_places = clips.clips.iter().enumerate();
    let labelled: Vec<_> = clips_with_places.flat_map(|(place, clip)| labelled_frames(place, clip)).collect();
    if labelled.is_empty() {
        let reason = "no frame has both `image` and `world`, so there is nothing to score against".into();
        return Err(Error::Data { what: clips.folder.display().to_string(), reason });
    }
    let count = limit.map_or(labelled.len(), |limit| limit.min(labelled.len()));
    let mut samples = Vec::with_capacity(count);
    for index in 0..count {
        samples.push(sample(localiser, clips, &labelled[index * labelled.len() / count], ball_radius, clock).await?);
        progress(index + 1, count);
    }
    Ok(samples)
}

/// [`Sample::confidence_radius`] of what was `found` in a picture of `size`.
fn confidence_radius(localiser: &Localiser, found: &Localisation, size: Size) -> f64 {
    let outline = found.radius_px.filter(|_| found.confidence_kind == ConfidenceKind::BallProbability);
    outline.unwrap_or_else(|| localiser.confidence_radius(size))
}

/// A frame to score: its place, and its labels.
struct LabelledFrame {
    place: [usize; 2],
    image: Point2<f64>,
    world: Point3<f64>,
}

/// Frames of `clip`, which is at `place`, with both labels.
fn labelled_frames(place: usize, clip: &Clip) -> impl Iterator<Item = LabelledFrame> {
    clip.frames.iter().enumerate().filter_map(move |(index, frame)| {
        Some(LabelledFrame { place: [place, index], image: frame.image?.into(), world: frame.world?.into() })
    })
}

/// Runs `localiser` on one frame.
async fn sample(
    localiser: &Localiser,
    clips: &Clips,
    labelled: &LabelledFrame,
    ball_radius: Option<f64>,
    clock: &dyn Fn() -> f64,
) -> Result<Sample> {
    let &LabelledFrame { place, image, world } = labelled;
    let clip = &clips.clips[place[0]];
    let frame = &clip.frames[place[1]];
    let began = clock();
    let picture = clips.picture(clip, frame)?;
    let decoded = clock();
    let ball_radius = ball_radius.or_else(|| clip.scene.as_ref().map(|scene| scene.ball.radius));
    let options = LocaliseOptions { ball_radius, ..LocaliseOptions::default() };
    let found = localiser.localise(&picture, &clip.camera, options).await.map_err(|error| Error::Data {
        what: format!("clip `{}`, frame {}", clip.id, frame.file.display()),
        reason: error.to_string(),
    })?;
    let localised = clock();
    let true_camera = clip.camera.camera_from_world(&world);
    Ok(Sample {
        clip: clip.id.clone(),
        place,
        visible: frame.visible,
        found: Point3::from(found.world),
        truth: world,
        ball_radius,
        found_depth: found.depth,
        depth_sigma: found.depth_sigma,
        true_depth: true_camera.z,
        true_range: true_camera.coords.norm(),
        found_image: Point2::from(found.image),
        true_image: image,
        confidence: found.confidence,
        confidence_kind: found.confidence_kind,
        confidence_radius: confidence_radius(localiser, &found, picture.size()),
        seconds_to_decode: decoded - began,
        seconds_to_localise: localised - decoded,
    })
}
