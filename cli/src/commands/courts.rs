//! `gravisight synth --set courts`.

use std::path::Path;

use anyhow::{Context, Result};
use gravisight::internal::{CourtPicture, Split, courts, write_whole};
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use serde_json::json;

use super::print_line;

/// The list of the pictures, which `cargo bench --bench all -- courts` reads, and its first line.
const LIST: &str = "courts.csv";
const COLUMNS: &str = "file,court,points\n";
/// What stands in the list in place of a camera where a picture does not show the court.
const NO_COURT: &str = "-";

/// Draws `count` pictures of each court into `out`, with their cameras, half as many that show none, and their list.
pub fn run(out: &Path, split: Split, count: usize, seed: u64, as_json: bool) -> Result<()> {
    std::fs::create_dir_all(out).with_context(|| out.display().to_string())?;
    let of_courts = (0..count).flat_map(|number| courts().into_iter().map(move |court| (Some(court), number)));
    let all: Vec<_> = of_courts.chain((0..count / 2).map(|number| (None, number))).collect();
    let lines = all.into_par_iter().map(|(court, number)| draw(out, court, split, number, seed));
    let lines = lines.collect::<Result<Vec<String>>>()?;
    write_whole(&out.join(LIST), (COLUMNS.to_string() + &lines.concat()).as_bytes())?;
    let pictures = lines.len();
    match as_json {
        true => print_line(json!({"pictures": pictures})),
        false => print_line(format_args!("{pictures} pictures in {}", out.display())),
    }
}

/// Draws a picture, unless it is there; its lines of the list.
fn draw(out: &Path, court: Option<&'static str>, split: Split, number: usize, seed: u64) -> Result<String> {
    let picture = CourtPicture::draw(court, split, number, seed)?;
    let (image, camera) = (format!("{}.jpg", picture.name()), format!("{}.camera.json", picture.name()));
    if !out.join(&image).exists() {
        write_whole(&out.join(&camera), serde_json::to_string(picture.camera())?.as_bytes())?;
        // The picture comes last: where it is, all is.
        write_whole(&out.join(&image), &picture.jpeg()?)?;
    }
    Ok(match court {
        Some(court) => format!("{image},{court},{camera}\n"),
        None => courts().into_iter().map(|court| format!("{image},{court},{NO_COURT}\n")).collect(),
    })
}
