//! What an evaluation found, as one HTML file that needs nothing else: no network, no other file.

pub mod doubts;
mod findings;
mod flights;
mod html;
mod log;
mod numbers;
mod paper;
mod pictures;
mod plots;
pub mod track2d;
mod trajectory;

use gravisight::internal::write_whole;
use gravisight::parts::Bins;
use gravisight::{Clips, Error, Localiser, Metrics, Result, Sample};
use std::path::Path;

pub use flights::{Flights, write as write_flights};
pub use log::Log;

/// What a report is made of.
pub struct Report<'a> {
    /// The model.
    pub localiser: &'a Localiser,
    /// The clips that it was scored on.
    pub clips: &'a Clips,
    /// Its results, from [`gravisight::score`] with the same model and clips.
    pub samples: &'a [Sample],
    /// Depth bins.
    pub bins: Bins,
    /// The log of the run that made the model, for its curves.
    pub log: Option<&'a Log>,
}

/// Writes `report` to `path`, whole. Runs the model again on the few frames whose pictures are shown.
///
/// The paper's numbers stand beside ours where the clips are the paper's: where their ids say so and, for the synthetic
/// sets, their scenes are the paper's environments.
///
/// # Errors
/// [`Error::Data`] for a report without samples; as [`gravisight::score`] for the
/// pictures; [`Error::Io`] for a file that cannot be written.
pub fn write(path: &Path, report: &Report<'_>) -> Result<()> {
    if report.samples.is_empty() {
        let reason = "no picture was scored, so there is nothing to report".into();
        return Err(Error::Data { what: path.display().to_string(), reason });
    }
    let metrics = Metrics::of(report.samples, report.bins);
    let mut body = format!("<header>\n{}</header>\n<main>\n", head(report));
    body += &html::tiles(&numbers::tiles(&metrics));
    body += &numbers::accuracy(report, &metrics)?;
    body += &numbers::places(report);
    body += &numbers::confidence(&metrics)?;
    body += &trajectory::chapter(report)?;
    body += &pictures::worst(report)?;
    body += &pictures::saliency(report)?;
    if let Some(log) = report.log {
        body += &log::chapter(log)?;
    }
    body += "</main>\n";
    write_whole(path, html::page(&title(report), &body).as_bytes())
}

fn title(report: &Report<'_>) -> String {
    format!("{} on {}", report.localiser.card().name, folder(report))
}

/// The clips folder's name; the rest of its path is nobody's business.
fn folder(report: &Report<'_>) -> String {
    let folder = &report.clips.folder;
    let whole = folder.canonicalize();
    let whole = whole.as_ref().unwrap_or(folder);
    whole.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn head(report: &Report<'_>) -> String {
    let card = report.localiser.card();
    let mut clips: Vec<usize> = report.samples.iter().map(|sample| sample.place[0]).collect();
    clips.dedup();
    let count = report.samples.len();
    let what = format!("{count} pictures of {} clips, in {}.", clips.len(), folder(report));
    let model = format!("Trained on {}. {}", card.training_data, card.description);
    [html::text("h1", &card.name), html::text("p", &what), html::text("p", &model)].concat()
}

/// `value` metres in cm, as people read it.
fn cm(value: f64) -> String {
    let value = value * 100.0;
    if value < 10.0 { format!("{value:.1}") } else { format!("{value:.0}") }
}
