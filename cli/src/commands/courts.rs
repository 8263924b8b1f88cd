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
        true => print_line(json!({"pictures": pictures}))?,
        false => print_line(format_args!("{pictures} pictures in {}", out.display()))?,
    }
    Ok(())
}

/// Draws a picture, unless it is there; its lines of the list.
fn draw(out: &Path, court: Option<&'static str>, split: Split, number: usize, seed: u64) -> Result<String> {
    let picture = CourtPicture::draw(court, split, number, seed)?;
    let (image, camera) = (format!("{}.jpg", picture.name()), format!("{}.camera.json", picture.name()));
    if !out.join(&image).exists() {
        if court.is_some() {
            write_whole(&out.join(&camera), serde_json::to_string(picture.camera())?.as_bytes())?;
        }
        // The picture comes last: where it is, all is.
        write_whole(&out.join(&image), &picture.jpeg()?)?;
    }
    Ok(match court {
        Some(court) => format!("{image},{court},{camera}\n"),
        None => courts().into_iter().map(|court| format!("{image},{court},{NO_COURT}\n")).collect(),
    })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use gravisight::Camera;

    use super::*;

    #[test]
    fn the_list_names_every_picture_and_its_camera_fits() {
        let out = std::env::temp_dir().join(format!("gravisight-courts-{}", std::process::id()));
        run(&out, Split::Val, 2, 7, true).unwrap();
        let list = std::fs::read_to_string(out.join(LIST)).unwrap();
        let mut named = BTreeSet::from([LIST.to_string()]);
        for line in list.strip_prefix(COLUMNS).unwrap().lines() {
            let [file, court, points] = line.split(',').collect::<Vec<_>>()[..] else { panic!("{line}") };
            named.insert(file.into());
            assert_eq!(points == NO_COURT, file.starts_with("empty"), "{line}");
            if points != NO_COURT {
                let (width, height) = image::image_dimensions(out.join(file)).unwrap();
                let camera = Camera::from_file(&out.join(points)).unwrap();
                assert_eq!(camera.size(), gravisight::Size::new(width, height));
                assert!(file.starts_with(court), "{line}");
                named.insert(points.into());
            }
        }
        let there: BTreeSet<String> =
            std::fs::read_dir(&out).unwrap().map(|it| it.unwrap().file_name().into_string().unwrap()).collect();
        assert_eq!(named, there);
        assert_eq!(there.len(), 1 + 2 * 2 * courts().len() + 1, "no camera of a picture without a court");
        std::fs::remove_dir_all(out).unwrap();
    }
}
