//! What a track says of one frame, and how noisy a track is.

use nalgebra::{Point2, Vector2};
use serde::Deserialize;

use gravisight_geometry::statistics::median;

/// Smallest standard deviation of labels that is believed, px.
const SMALLEST_NOISE: f64 = 0.03;
/// Distance from the neighbours' line, in units of its median, beyond which a label is not used to start with.
const SUSPECT: f64 = 10.0;

/// One frame of a track.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify), tsify(missing_as_null))]
#[serde(deny_unknown_fields)]
pub struct Observation {
    /// s.
    pub time: f64,
    /// The ball's centre in the picture, px; none where it was not seen.
    pub image: Option<Point2<f64>>,
    /// Semi-minor axis of its outline and that one's standard deviation, px, where they were measured.
    #[cfg_attr(target_arch = "wasm32", tsify(optional))]
    pub radius: Option<[f64; 2]>,
}

/// Observations without those that lie far off the line of their neighbours in the picture: a first look,
/// for starts and growth. At the end all labels count, and the loss lets go of outliers.
pub fn trusted(observations: &[Observation]) -> Vec<Observation> {
    let seen: Vec<usize> = (0..observations.len()).filter(|&frame| observations[frame].image.is_some()).collect();
    let at = |index: usize| observations[seen[index]].image.map_or(Vector2::zeros(), |image| image.coords);
    let line = |index: usize, i: usize, j: usize| {
        let [t, from, to] = [index, i, j].map(|index| observations[seen[index]].time);
        at(i) + (at(j) - at(i)) * ((t - from) / (to - from))
    };
    // From the median of the predictions by pairs of neighbours.
    let deviation = |index: usize| {
        let pairs = [(-1, 1), (-2, 2), (-2, -1), (1, 2), (-1, 2), (-2, 1)].into_iter();
        let neighbour = |by: isize| index.checked_add_signed(by).filter(|&other| other < seen.len());
        let predictions: Vec<_> = pairs.filter_map(|(i, j)| Some(line(index, neighbour(i)?, neighbour(j)?))).collect();
        let along = |axis: usize| median(predictions.iter().map(|point| point[axis])).unwrap_or(0.0);
        (at(index) - Vector2::new(along(0), along(1))).norm()
    };
    let deviations: Vec<f64> = (0..seen.len()).map(deviation).collect();
    let limit = SUSPECT * median(deviations.iter().copied()).unwrap_or(0.0).max(SMALLEST_NOISE);
    let mut out = observations.to_vec();
    for (index, _) in deviations.iter().enumerate().filter(|(_, deviation)| **deviation > limit) {
        out[seen[index]].image = None;
    }
    out
}

/// Noise of labels on a smooth track, px: from the third differences of labels that follow one another, divided by their
/// times.
pub fn noise_of(observations: &[Observation]) -> f64 {
    let seen: Vec<(f64, Point2<f64>)> = observations.iter().filter_map(|it| Some((it.time, it.image?))).collect();
    let sizes: Vec<f64> = seen
        .windows(4)
        .flat_map(|four| {
            let middle = (four[0].0 + four[3].0) / 2.0;
            let times = [0, 1, 2, 3].map(|i| (four[i].0 - middle) / (four[3].0 - four[0].0));
            let weight = |i: usize| (0..4).filter(|&j| j != i).map(|j| times[i] - times[j]).product::<f64>().recip();
            let weights = [0, 1, 2, 3].map(weight);
            let length = weights.iter().map(|weight| weight * weight).sum::<f64>().sqrt();
            let sum = (0..4).map(|i| four[i].1.coords * weights[i]).sum::<Vector2<f64>>() / length;
            [sum.x.abs(), sum.y.abs()]
        })
        .collect();
    let mut sizes = sizes;
    sizes.sort_by(f64::total_cmp);
    // A third of |N(0, σ)| is below 0.43 σ; kinks make the larger ones larger still.
    sizes.get(sizes.len() / 3).map_or(1.0, |size| size / 0.4307)
}
