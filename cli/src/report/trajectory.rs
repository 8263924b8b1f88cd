//! The chapter on one trajectory, found and true.

use std::collections::BTreeMap;

use nalgebra::Point3;

use super::plots::{self, Axis, FOUND, Mark, TRUTH};
use super::{Report, cm, html, pictures};
use gravisight::parts::Statistic;
use gravisight::{Result, Sample};

const KEYS: [(&str, &str); 2] = [("found", "found"), ("truth", "true")];

/// Found and true path of the clip whose mean error is the median of all clips'; nothing where clips are single
/// pictures.
pub fn chapter(report: &Report<'_>) -> Result<String> {
    let Some((samples, mean)) = typical(report.samples) else { return Ok(String::new()) };
    let path =
        |of: fn(&Sample) -> Point3<f64>| -> Vec<Point3<f64>> { samples.iter().map(|sample| of(sample)).collect() };
    let [truth, found] = [path(|sample| sample.truth), path(|sample| sample.found)];
    let path = |points, colour| plots::PlottedPath { points, colour, shadow: true };
    let space = plots::space(&[path(&truth, TRUTH), path(&found, FOUND)])?;
    let clip = &report.clips.clips[samples[0].place[0]];
    let depths = |of: fn(&Sample) -> Point3<f64>| -> Vec<(f64, f64)> {
        let depth = |sample: &&Sample| clip.camera.camera_from_world(&of(sample)).z;
        samples.iter().map(|sample| (clip.frames[sample.place[1]].t, depth(sample))).collect()
    };
    let [truth, found] = [depths(|sample| sample.truth), depths(|sample| sample.found)];
    let both = || truth.iter().chain(&found);
    let x = Axis::around("time, s", both().map(|point| point.0));
    let y = Axis::around("depth, m", both().map(|point| point.1));
    let depth = plots::chart(&x, &y, &[Mark::Line(truth.clone(), TRUTH), Mark::Line(found.clone(), FOUND)])?;
    let cards = [
        html::figure(&space, "In space (m, z up), with its shadow on the ground", &KEYS),
        html::figure(&depth, "Depth over time", &KEYS),
    ];
    let lead = format!(
        "Clip {}: {} pictures, each localised on its own; mean error {} cm. This is the median clip: half of the \
         others are better.",
        clip.id,
        samples.len(),
        cm(mean)
    );
    let pictures = pictures::strip(report, &samples)?;
    Ok(html::section("A trajectory", &lead, &(html::row("", &cards) + &pictures)))
}

/// The samples of the clip in the middle, by mean DtG, of those with the most samples; and the mean.
fn typical(samples: &[Sample]) -> Option<(Vec<&Sample>, f64)> {
    let mut clips: BTreeMap<usize, Vec<&Sample>> = BTreeMap::new();
    for sample in samples {
        clips.entry(sample.place[0]).or_default().push(sample);
    }
    let most = clips.values().map(Vec::len).max().filter(|&most| most > 1)?;
    let mean = |samples: &[&Sample]| Statistic::of(samples.iter().map(|sample| sample.dtg())).mean.unwrap_or_default();
    let full = clips.into_values().filter(|samples| samples.len() == most);
    let mut sorted: Vec<_> = full.map(|samples| (mean(&samples), samples)).collect();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mean, samples) = sorted.swap_remove((sorted.len() - 1) / 2);
    Some((samples, mean))
}
