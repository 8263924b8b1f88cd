//! Photographs to train on: those without a ball are backgrounds, those in `labels.csv` show labelled balls.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use image::RgbImage;
use rayon::iter::{IntoParallelIterator, IntoParallelRefIterator, ParallelIterator};

use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::image::{Filter, Picture, resized};
use gravisight_geometry::size::Size;
use gravisight_geometry::table::Table;
use gravisight_synth::{LabelledBall, LabelledPhotograph};

/// Longer side of the photographs that are kept, px: several crops wide, a few MB each.
const PHOTOGRAPH_SIDE: u32 = 1280;
/// Ends of the names of photographs' files.
const EXTENSIONS: [&str; 4] = ["jpg", "jpeg", "png", "webp"];
/// The file that names the balls in a folder's photographs.
const LABELS: &str = "labels.csv";
/// Largest aspect ratio of a ball's bounding box at which its radius counts as known. Partial occlusion elongates the
/// box.
const ROUND: f64 = 1.15;

/// What a folder of photographs holds.
#[derive(Debug, Default)]
pub struct Photographs {
    /// Those that are not labelled: no ball is in them.
    pub plain: Vec<RgbImage>,
    /// Those with balls.
    pub labelled: Vec<LabelledPhotograph>,
}

/// A row of the labels.
#[derive(Debug, Clone, Copy)]
struct Label {
    centre: [f64; 2],
    half: [f64; 2],
    is_tight: bool,
    /// The width scale factor that makes the pixels square; `None` if unknown.
    unstretch: Option<f64>,
}

impl Photographs {
    /// The photographs in `folder` and below it, in the order of their names, at most 1280 px long. `labels.csv` in it has a row a ball:
    /// `file` (relative to the folder), `x`, `y`, `radius_x_px` and `radius_y_px` or `radius_px` (px), and perhaps `quality` (`A`: the radius is
    /// right to a tenth) and `unstretch` (the factor on the picture's width that makes its pixels square; empty where unknown).
    ///
    /// # Errors
    /// [`Error::Io`] if the folder or a file cannot be read. [`Error::Data`] for a folder without photographs, a
    /// labelled file that is missing, a radius or `unstretch` that is not positive, or a damaged photograph.
    /// [`Error::Format`] if the table lacks a required column.
    pub fn read(folder: &Path) -> Result<Self> {
        let files = files(folder)?;
        let labels = labels(folder)?;
        if let Some(missing) = labels.keys().find(|file| !files.contains(file)) {
            let reason = format!("has labels in {LABELS}, but is not a photograph in {}", folder.display());
            return Err(Error::Data { what: missing.display().to_string(), reason });
        }
        let plain: Vec<&PathBuf> = files.iter().filter(|file| !labels.contains_key(*file)).collect();
        let plain = plain.into_par_iter().map(|file| Ok(kept(&open(file)?).0));
        let plain = plain.collect::<Result<Vec<RgbImage>>>()?;
        let labelled: Vec<_> = labels.into_iter().collect();
        let labelled = labelled.par_iter().map(|(file, balls)| Ok(of_labels(&open(file)?, balls)));
        let labelled = labelled.collect::<Result<Vec<Vec<LabelledPhotograph>>>>()?;
        Ok(Self { plain, labelled: labelled.into_iter().flatten().collect() })
    }
}

/// The photographs in `folder` and below it that no labels name.
///
/// # Errors
/// As [`Photographs::read`].
pub fn read_photographs(folder: &Path) -> Result<Vec<RgbImage>> {
    Ok(Photographs::read(folder)?.plain)
}

fn files(folder: &Path) -> Result<Vec<PathBuf>> {
    let (mut files, mut folders) = (vec![], vec![folder.to_path_buf()]);
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).map_err(Error::io(&folder))? {
            let path = entry.map_err(Error::io(&folder))?.path();
            let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
            if path.is_dir() {
                folders.push(path);
            } else if EXTENSIONS.contains(&extension.as_str()) {
                files.push(path);
            }
        }
    }
    files.sort();
    if files.is_empty() {
        let reason = format!("holds no photographs ({})", EXTENSIONS.join(", "));
        return Err(Error::Data { what: folder.display().to_string(), reason });
    }
    Ok(files)
}

/// The balls of each labelled file.
fn labels(folder: &Path) -> Result<BTreeMap<PathBuf, Vec<Label>>> {
    let mut found: BTreeMap<PathBuf, Vec<Label>> = BTreeMap::new();
    let path = folder.join(LABELS);
    if !path.exists() {
        return Ok(found);
    }
    let table = Table::from_file(&path)?;
    let [file, x, y] = table.columns(["file", "x", "y"])?;
    let halves = match table.column_if_any("radius_px") {
        Some(radius) => [radius, radius],
        None => table.columns(["radius_x_px", "radius_y_px"])?,
    };
    let (quality, unstretch) = (table.column_if_any("quality"), table.column_if_any("unstretch"));
    for row in &table.rows {
        let [x, y, right, down] = row.numbers([x, y, halves[0], halves[1]])?;
        let name = row.text(file)?.unwrap_or_default();
        let factor = unstretch.map(|column| row.number_if_any(column)).transpose()?.unwrap_or(Some(1.0));
        if !(right > 0.0 && down > 0.0 && factor.is_none_or(|factor| factor > 0.0)) {
            let reason = "has a radius or an `unstretch` that is not positive";
            return Err(Error::Data { what: row.what.clone(), reason: reason.into() });
        }
        let is_tight = quality.map(|column| row.text(column)).transpose()?.flatten().is_none_or(|grade| grade == "A");
        let label = Label { centre: [x, y], half: [right, down], is_tight, unstretch: factor };
        found.entry(folder.join(name)).or_default().push(label);
    }
    Ok(found)
}

fn open(path: &Path) -> Result<RgbImage> {
    let named = |error: Error| match error {
        error @ Error::Io { .. } => error,
        error => Error::Data { what: path.display().to_string(), reason: error.to_string() },
    };
    Ok(Picture::open(path).map_err(named)?.into_rgb())
}

/// A photograph as it is kept, and its size over what it was.
fn kept(rgb: &RgbImage) -> (RgbImage, f64) {
    let scale = f64::from(PHOTOGRAPH_SIDE) / f64::from(rgb.width().max(rgb.height()));
    if scale >= 1.0 {
        return (rgb.clone(), 1.0);
    }
    let size = Size::new(rgb.width(), rgb.height());
    let [width, height] = [size.width, size.height].map(|side| ((f64::from(side) * scale) as u32).max(1));
    (resized(rgb, [0, 0], size, Size::new(width, height), Filter::Bilinear), scale)
}

/// Converts a labelled photograph to training photographs. A stretched photograph yields two: as it is, and with
/// square pixels. If the stretch is unknown, it yields only the original. The original of a stretched photograph does
/// not train size. It stays in the set because users also supply stretched pictures.
fn of_labels(rgb: &RgbImage, labels: &[Label]) -> Vec<LabelledPhotograph> {
    let factor = labels.first().and_then(|label| label.unstretch);
    let mut found = vec![];
    if factor != Some(1.0) {
        found.push(scaled(rgb, labels, 1.0, false));
    }
    if let Some(factor) = factor {
        found.push(scaled(rgb, labels, factor, true));
    }
    found
}

/// Scales the photograph's width by the factor `wider`, and its balls with it. `may_size` states whether their radii
/// may train size.
fn scaled(rgb: &RgbImage, labels: &[Label], wider: f64, may_size: bool) -> LabelledPhotograph {
    let size = Size::new(rgb.width(), rgb.height());
    let wide = Size::new((f64::from(size.width) * wider).round().max(1.0) as u32, size.height);
    let stretched = if wide == size { rgb.clone() } else { resized(rgb, [0, 0], size, wide, Filter::Bilinear) };
    let (rgb, scale) = kept(&stretched);
    let factors = [scale * f64::from(wide.width) / f64::from(size.width), scale];
    let ball = |label: &Label| {
        let half = [0, 1].map(|axis| factors[axis] * label.half[axis]);
        let is_round = half[0].max(half[1]) <= ROUND * half[0].min(half[1]);
        let is_sized = may_size && label.is_tight && is_round;
        let radius = if is_sized { (half[0] * half[1]).sqrt() } else { half[0].max(half[1]) };
        // A pixel's centre is a whole number, its edge half a pixel before.
        let centre = [0, 1].map(|axis| ((label.centre[axis] + 0.5) * factors[axis] - 0.5) as f32);
        LabelledBall { centre, radius: radius as f32, is_sized }
    };
    let balls = labels.iter().map(ball).collect();
    LabelledPhotograph { rgb, balls }
}
