//! A run's log: a line a step, and the same as a table.

use std::path::Path;

use gravisight_geometry::error::{Error, Result};

/// The log and its table in errors.
pub(super) const LOG: &str = "log.jsonl";
const LOG_CSV: &str = "log.csv";

/// The log as CSV: its numbers, of validations the forecast error and the means.
pub(super) fn table(log: &str) -> Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let names = ["step", "loss", "heatmap", "depth", "future", "gradient_norm", "learning_rate", "seconds", "waited"];
    let scores = ["forecast_px", "image_error_px", "dtg"];
    let write = |writer: &mut csv::Writer<Vec<u8>>, fields: Vec<String>| {
        writer.write_record(fields).map_err(Error::format(LOG_CSV))
    };
    write(&mut writer, names.into_iter().chain(scores).map(String::from).collect())?;
    for line in log.lines() {
        let fields: serde_json::Value = serde_json::from_str(line).map_err(Error::format(LOG))?;
        let text = |value: &serde_json::Value| value.as_f64().map_or(String::new(), |number| number.to_string());
        let score = |name: &str| {
            let value = &fields["validation"][name];
            text(value.get("mean").unwrap_or(value))
        };
        write(&mut writer, names.iter().map(|name| text(&fields[name])).chain(scores.map(score)).collect())?;
    }
    writer.into_inner().map_err(|error| Error::format(LOG_CSV)(error.to_string()))
}

/// The log's lines up to `step`; later ones belong to steps that were lost.
pub(super) fn log_until(path: &Path, step: usize) -> Result<String> {
    if step == 0 || !path.exists() {
        return Ok(String::new());
    }
    let text = gravisight_geometry::files::read_text(path)?;
    Ok(text.lines().take(step).flat_map(|line| [line, "\n"]).collect())
}
