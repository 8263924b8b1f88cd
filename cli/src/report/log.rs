//! The curves of a training run's `log.jsonl`.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::{Map, Value};

use super::html;
use super::plots::{self, ACCENT, Axis, FOUND, Mark, OTHER, TRUTH};
use gravisight::internal::read_text;
use gravisight::{Error, Result};

/// Most points of a drawn curve; what lies between two is averaged.
const POINTS: usize = 200;
/// Numbers of a line that are no losses.
const OTHERS: [&str; 6] = ["step", "steps", "seconds", "waited", "gradient_norm", "learning_rate"];

/// Colours of several curves in one chart, and their names in the style sheet.
const COLOURS: [(plotters::style::RGBColor, &str); 4] =
    [(ACCENT, "accent"), (FOUND, "found"), (TRUTH, "truth"), (OTHER, "other")];

/// A curve: step and value.
type Curve = Vec<(f64, f64)>;

/// A training run's `log.jsonl`: its curves by name.
#[derive(Debug, Clone, Default)]
pub struct Log {
    /// Every number of a line that is a loss.
    losses: BTreeMap<String, Curve>,
    /// Every number of the validation; of a statistic the mean.
    validation: BTreeMap<String, Curve>,
}

/// The chapter on the training whose log is `log`.
///
/// # Errors
/// [`Error::Format`] where a curve cannot be drawn.
pub fn chapter(log: &Log) -> Result<String> {
    let Log { losses, validation } = log;
    let mut cards = Vec::new();
    let several: Vec<_> = losses.iter().zip(COLOURS.iter().cycle()).collect();
    let keys: Vec<_> = several.iter().map(|((name, _), (_, class))| (*class, name.as_str())).collect();
    let curves = several.iter().map(|((_, curve), (colour, _))| (*curve, *colour));
    cards.push(html::figure(&drawn(curves, "loss")?, "Losses", &keys));
    for (name, curve) in validation {
        let unit = match name.as_str() {
            "dtg" => "m",
            name if name.ends_with("_px") => "px",
            _ => "",
        };
        let drawing = drawn([(curve, ACCENT)].into_iter(), unit)?;
        cards.push(html::figure(&drawing, &format!("Validation: {name}"), &[]));
    }
    let lead = "Vertical axes are logarithmic. Each point of a loss curve is the mean over the steps up to the next point. Validation \
                scores the averaged weights; those with the lowest forecast_px, the median forecast error, are kept. The other scores are \
                means. If a curve is still falling, train for more steps.";
    Ok(html::section("How it was trained", lead, &html::row("", &cards)))
}

/// A chart of curves by step, on a logarithmic scale.
fn drawn<'a>(
    curves: impl Iterator<Item = (&'a Curve, plotters::style::RGBColor)>,
    label: &'static str,
) -> Result<String> {
    let curves: Vec<(Curve, _)> = curves.map(|(curve, colour)| (thinned(curve), colour)).collect();
    let points = || curves.iter().flat_map(|(curve, _)| curve.iter().copied());
    let x = Axis::new("step", 0.0..points().map(|point| point.0).fold(1.0, f64::max));
    let y = Axis { log: true, ..Axis::around(label, points().map(|point| point.1)) };
    let marks: Vec<Mark> = curves.iter().map(|(curve, colour)| Mark::Line(curve.clone(), *colour)).collect();
    plots::chart(&x, &y, &marks)
}

impl Log {
    /// Reads the log at `path`.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] with the line.
    pub fn read(path: &Path) -> Result<Self> {
        let text = read_text(path)?;
        let mut curves = Self::default();
        for (index, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
            let what = || format!("{}:{}", path.display(), index + 1);
            let fields: Map<String, Value> = serde_json::from_str(line).map_err(Error::format(what()))?;
            let step = fields.get("step").and_then(Value::as_f64);
            let step = step.ok_or_else(|| {
                Error::format(what())("missing field `step`: is this the log.jsonl of a training run?")
            })?;
            for (name, value) in fields.iter().filter(|(name, _)| !OTHERS.contains(&name.as_str())) {
                if let Some(value) = value.as_f64() {
                    curves.losses.entry(name.clone()).or_default().push((step, value));
                }
            }
            for (name, statistic) in fields.get("validation").and_then(Value::as_object).into_iter().flatten() {
                if let Some(value) = statistic["mean"].as_f64().or(statistic.as_f64()) {
                    curves.validation.entry(name.clone()).or_default().push((step, value));
                }
            }
        }
        // A loss that is always zero is none of this run's.
        curves.losses.retain(|_, curve| curve.iter().any(|&(_, value)| value != 0.0));
        Ok(curves)
    }
}

/// At most [`POINTS`] points of `curve`, each a mean; decimal logarithms. What has none is left out.
fn thinned(curve: &Curve) -> Curve {
    let every = curve.len().div_ceil(POINTS).max(1);
    let mean = |part: &[(f64, f64)]| {
        let count = part.len() as f64;
        (part.iter().map(|point| point.0).sum::<f64>() / count, part.iter().map(|point| point.1).sum::<f64>() / count)
    };
    curve.chunks(every).map(mean).filter(|point| point.1 > 0.0).map(|(step, value)| (step, value.log10())).collect()
}
