//! The camera of a video by the court that it shows.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use gravisight::{Calibration, Court, CourtVerdict, FoundCourt, Picture, Unknowns, find_court};
use image::RgbImage;

use crate::footage::Footage;
use crate::import::is_picture;

/// Stands for every court whose lines are known.
pub const AUTO: &str = "auto";

/// The court of a sport's name, if its lines are known.
pub fn of_scene(scene: &Path) -> Option<String> {
    Court::with_lines(scene.to_str()?).map(String::from)
}

/// Frames of a video of which each pixel's median is searched where the first frame does not show enough: people move in half a second. The
/// camera has to stand still meanwhile.
const FRAMES: usize = 15;

/// Searches a court in pictures: in the first, and where that is not sure, in the median of all. Returns what was searched, too.
///
/// # Errors
/// For a court whose lines are not known.
pub fn search(pictures: Vec<Picture>, court: &str) -> Result<(FoundCourt, Picture)> {
    let median = (pictures.len() > 2).then(|| median(&pictures));
    let first = pictures.into_iter().next().context("no frames")?;
    let found = find_court(&first, court)?;
    if found.verdict != CourtVerdict::Sure
        && let Some(median) = median
    {
        let without_people = find_court(&median, court)?;
        if without_people.probability > found.probability {
            return Ok((without_people, median));
        }
    }
    Ok((found, first))
}

/// The first frames of a video, or a picture.
///
/// # Errors
/// What they cannot be read for.
pub fn first_frames(shown: &Path) -> Result<Vec<Picture>> {
    if is_picture(shown) {
        return Ok(vec![Picture::open(shown).with_context(|| shown.display().to_string())?]);
    }
    Footage::beginning(shown, FRAMES)
}

/// The median of each pixel's levels.
fn median(pictures: &[Picture]) -> Picture {
    let bytes: Vec<&[u8]> = pictures.iter().map(|picture| picture.rgb().as_raw().as_slice()).collect();
    let mut levels = vec![0; bytes.len()];
    let middle = levels.len() / 2;
    let all = (0..bytes[0].len()).map(|index| {
        levels.iter_mut().zip(&bytes).for_each(|(level, bytes)| *level = bytes[index]);
        *levels.select_nth_unstable(middle).1
    });
    let (width, height) = pictures[0].rgb().dimensions();
    let rgb = RgbImage::from_raw(width, height, all.collect());
    rgb.map_or_else(|| pictures[0].clone(), Picture::from_rgb)
}

/// The camera of a video's first frame by its court, for measuring without anybody who checks it.
///
/// # Errors
/// Where no court is surely found, with what to do.
pub fn camera(footage: &Footage, court: &str) -> Result<(FoundCourt, Calibration)> {
    let mut pictures = Vec::new();
    footage.each(0..FRAMES, &mut |_, picture| {
        pictures.push(picture);
        Ok(())
    })?;
    let (found, picture) = search(pictures, court)?;
    let (name, percent) = (footage.name(), 100.0 * found.probability);
    ensure!(
        found.verdict != CourtVerdict::None,
        "no camera: {}; mark some of its points (`gravisight calibrate --help`), and give --camera",
        found.reason
    );
    ensure!(
        found.verdict == CourtVerdict::Sure,
        "no camera: the {court} court is found with a probability of only {percent:.0} %: {}; check it with `gravisight calibrate {name} \
         --court {court} --out camera.json --overlay court.png`, then give --camera camera.json",
        found.reason
    );
    let calibration = found.calibrate(&picture, &Unknowns::default());
    let calibration = calibration.with_context(|| format!("no camera: it cannot be refined ({})", found.reason))?;
    Ok((found, calibration))
}
