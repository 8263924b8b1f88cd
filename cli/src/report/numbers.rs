//! The chapters of numbers: how far off, where, and whether the model knows.

use std::collections::BTreeMap;

use super::paper::{PaperCamera, PaperScore};
use super::plots::{ACCENT, Axis, FOUND, Mark, OTHER, chart};
use super::{Report, cm, html};
use gravisight::parts::{ConfidenceKind, Statistic};
use gravisight::{Metrics, Result, Sample};

/// Bars of the histogram.
const BARS: usize = 40;
/// Fraction of the pictures that the histogram shows; a few far outliers would squeeze all others into one bar.
const SHOWN: f64 = 0.99;

/// The numbers to read first.
pub fn tiles(metrics: &Metrics) -> Vec<[String; 3]> {
    let words = |value: Option<f64>, factor: f64, digits: usize| {
        value.map_or("–".into(), |value| format!("{:.digits$}", value * factor))
    };
    let tile = |name: &str, statistic: &Statistic, factor: f64, digits: usize, unit: &str| {
        let [mean, std, median] =
            [statistic.mean, statistic.std, statistic.median].map(|value| words(value, factor, digits));
        [name.to_string(), format!("{mean} {unit}"), format!("± {std}, median {median}")]
    };
    let mut visible = tile("… ball in view", &metrics.dtg_visible, 100.0, 1, "cm");
    visible[2] = format!("{} of {} pictures", metrics.dtg_visible.n, metrics.dtg.n);
    let (network, with_decoding) = (&metrics.seconds_per_picture.network, &metrics.seconds_per_picture.with_decoding);
    let [network, with_decoding] = [network, with_decoding].map(|seconds| words(seconds.median, 1e3, 1));
    vec![
        tile("Distance to truth", &metrics.dtg, 100.0, 1, "cm"),
        visible,
        tile("… relative to distance", &metrics.dtg_relative, 100.0, 2, "%"),
        tile("Error in the picture", &metrics.image_error_px, 1.0, 2, "px"),
        ["Time per picture".into(), format!("{network} ms"), format!("{with_decoding} with decoding (medians)")],
    ]
}

/// DtG of all pictures and by depth.
pub fn accuracy(report: &Report<'_>, metrics: &Metrics) -> Result<String> {
    let mut dtg: Vec<f64> = report.samples.iter().map(Sample::dtg).collect();
    dtg.sort_by(f64::total_cmp);
    let shown = dtg[((dtg.len() - 1) as f64 * SHOWN).round() as usize] * 100.0;
    let edges: Vec<f64> = (0..=BARS).map(|edge| (shown * edge as f64 / BARS as f64).max(1e-9 * edge as f64)).collect();
    let within = |low: f64, high: f64| dtg.iter().filter(|&&value| (low..high).contains(&(value * 100.0))).count();
    let fraction = |count: usize| 100.0 * count as f64 / dtg.len() as f64;
    let heights: Vec<f64> = edges.windows(2).map(|side| fraction(within(side[0], side[1]))).collect();
    let beyond = dtg.iter().filter(|&&value| value * 100.0 >= edges[BARS]).count();
    let top = heights.iter().copied().fold(0.0, f64::max) * 1.05;
    let histogram = chart(
        &Axis::new("distance to ground truth, cm", 0.0..edges[BARS]),
        &Axis::new("pictures, %", 0.0..top.max(1.0)),
        &[Mark::Bars { edges, heights }],
    )?;
    let largest = dtg.last().copied().unwrap_or_default();
    let caption = format!("Distribution of errors. {beyond} pictures lie beyond the axis, up to {} cm", cm(largest));
    let (by_depth, table) = by_depth(report, metrics)?;
    let keys = [("accent", "mean"), ("found", "median")];
    let cards = [html::figure(&histogram, &caption, &[]), html::figure(&by_depth, "By true depth", &keys)];
    let lead = "Distance to ground truth (DtG) is the distance in space between the position found and the true \
                one. All pictures count, also those in which something hides the ball. A depth bin includes its \
                lower edge; the last one also includes its upper edge.";
    Ok(html::section("How far off", lead, &(html::row("", &cards) + &table)))
}

/// The chart and the table by depth.
fn by_depth(report: &Report<'_>, metrics: &Metrics) -> Result<(String, String)> {
    let edges = report.bins.edges();
    let of = |value: Option<f64>| value.unwrap_or_default() * 100.0;
    let heights: Vec<f64> = metrics.dtg_binned.iter().map(|bin| of(bin.mean)).collect();
    let top = heights.iter().copied().fold(0.0, f64::max).max(0.1) * 1.1;
    let middles = edges.windows(2).map(|side| (side[0] + side[1]) / 2.0);
    let seen = middles.zip(&metrics.dtg_binned).filter(|(_, bin)| bin.n > 0);
    let medians = seen.map(|(middle, bin)| (middle, of(bin.median))).collect();
    let row = |(side, bin): (&[f64], &Statistic)| {
        let depth = format!("{:.2}–{:.2} m", side[0], side[1]);
        [vec![depth], cells(bin)].concat()
    };
    let rows: Vec<_> = edges.windows(2).zip(&metrics.dtg_binned).map(row).collect();
    // One depth alone still has a width to be drawn.
    let range = edges[0]..edges[edges.len() - 1].max(edges[0] + 1e-3);
    let marks = [Mark::Bars { edges: edges.clone(), heights }, Mark::Dots(medians, FOUND)];
    let drawing = chart(&Axis::new("true depth, m", range), &Axis::new("DtG, cm", 0.0..top), &marks)?;
    Ok((drawing, html::table(&["Depth", "Pictures", "DtG, cm", "Median"], &rows)))
}

/// Number, mean ± deviation and median of DtG, the lengths in cm.
fn cells(statistic: &Statistic) -> Vec<String> {
    let words = |value: Option<f64>| value.map_or("–".into(), cm);
    let mean = match statistic.n {
        0 => "–".into(),
        _ => format!("{} ± {}", words(statistic.mean), words(statistic.std)),
    };
    vec![statistic.n.to_string(), mean, words(statistic.median)]
}

/// The table by environment and camera, the paper's numbers beside; nothing where clips name neither.
pub fn places(report: &Report<'_>) -> String {
    let mut rows = Vec::new();
    let mut add = |name: &str, samples: &[&Sample], scores: Vec<PaperScore>| {
        let words = |(model, mean, deviation): &PaperScore| format!("{mean} ± {deviation} ({model})");
        let theirs: Vec<String> = scores.iter().map(words).collect();
        let ours = Statistic::of(samples.iter().map(|sample| sample.dtg()));
        let theirs = if theirs.is_empty() { "–".into() } else { theirs.join("\n") };
        rows.push([vec![name.to_string()], cells(&ours), vec![theirs]].concat());
    };
    let place = |samples: &[&Sample]| -> Option<PaperCamera> {
        let mut places = samples.iter().map(|sample| PaperCamera::of(&report.clips.clips[sample.place[0]]));
        let first = places.next()??;
        places.all(|place| place.is_some_and(|place| place.same_environment(first))).then_some(first)
    };
    let all: Vec<&Sample> = report.samples.iter().collect();
    for (environment, samples) in grouped(&all, "env") {
        if !environment.is_empty() {
            add(&environment, &samples, place(&samples).map_or_else(Vec::new, PaperCamera::environment_scores));
        }
        for (camera, samples) in grouped(&samples, "cam") {
            let scores = place(&samples).map_or_else(Vec::new, PaperCamera::scores);
            if !camera.is_empty() || !scores.is_empty() {
                let name = format!("{environment} {camera}");
                add(if name.trim().is_empty() { "all" } else { name.trim() }, &samples, scores);
            }
        }
    }
    if rows.is_empty() {
        return String::new();
    }
    let head = ["Where", "Pictures", "DtG, cm", "Median", "The paper, cm"];
    let lead = "Environments and cameras are named as in the clips' ids. The paper's numbers (mean ± standard \
                deviation, and the model) are shown only for clips from its data sets; those of an environment are \
                over all its nine cameras.";
    html::section("Environments and cameras", lead, &html::table(&head, &rows))
}

/// `samples` by the part of their clips' ids that begins with `prefix`; empty where they have none.
fn grouped<'a>(samples: &[&'a Sample], prefix: &str) -> BTreeMap<String, Vec<&'a Sample>> {
    let mut groups: BTreeMap<String, Vec<&Sample>> = BTreeMap::new();
    for &sample in samples {
        groups.entry(sample.part(prefix).unwrap_or_default().into()).or_default().push(sample);
    }
    groups
}

/// How well the confidence is calibrated.
pub fn confidence(metrics: &Metrics) -> Result<String> {
    let groups = || metrics.calibration.iter().map(|group| (group.confidence.mean.unwrap_or_default(), group));
    let near: Vec<(f64, f64)> = groups().map(|(confidence, group)| (confidence, group.near)).collect();
    let dtg: Vec<(f64, f64)> =
        groups().map(|(confidence, group)| (confidence, group.dtg.mean.unwrap_or_default() * 100.0)).collect();
    let (right, about) = match metrics.confidence_kind {
        Some(ConfidenceKind::BallProbability) => (
            "fraction in which the detection is the ball",
            "The confidence is the probability that the detection is the ball. It counts as the ball if the label lies inside the \
             detected outline.",
        ),
        Some(ConfidenceKind::HeatmapMass) | None => (
            "fraction found within 12 px",
            "The confidence is the fraction of the heatmap that lies within 12 px (of the network's input) of the position found.",
        ),
    };
    // Both axes alike, so that the diagonal is one.
    let least = near.iter().flat_map(|&(a, b)| [a, b]).fold(1.0, f64::min);
    let ends = (least - 0.05 * (1.0 - least) - 0.005).max(0.0)..1.0 + 0.02 * (1.0 - least) + 0.002;
    let diagonal = vec![(ends.start, ends.start), (1.0, 1.0)];
    let calibration = chart(
        &Axis::new("confidence", ends.clone()),
        &Axis::new(right, ends),
        &[Mark::Line(diagonal, OTHER), Mark::Line(near.clone(), ACCENT), Mark::Dots(near, ACCENT)],
    )?;
    let top = dtg.iter().map(|point| point.1).fold(0.1, f64::max) * 1.1;
    let error = chart(
        &Axis::around("confidence", dtg.iter().map(|point| point.0)),
        &Axis::new("mean DtG, cm", 0.0..top),
        &[Mark::Line(dtg.clone(), ACCENT), Mark::Dots(dtg, ACCENT)],
    )?;
    let keys = [("accent", "this model"), ("other", "perfect calibration")];
    let cards = [
        html::figure(&calibration, "Confidence against accuracy", &keys),
        html::figure(&error, "Distance to ground truth by confidence", &[]),
    ];
    let lead = format!(
        "{about} Pictures are sorted by confidence into groups of equal size; each dot is a group. Above the line the model is \
         under-confident, below it over-confident."
    );
    Ok(html::section("Calibration of the confidence", &lead, &html::row("", &cards)))
}
