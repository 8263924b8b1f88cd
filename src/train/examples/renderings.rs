//! Renderings of random scenes as training pictures, and as pictures to score with.

use std::path::Path;

use image::RgbImage;
use rayon::iter::{IntoParallelIterator, IntoParallelRefIterator, ParallelIterator};

use super::super::recipe::{Phase, Recipe};
use super::{Batch, Labels};
use crate::error::{Error, Result};
use crate::image::{Filter, Normalisation, Picture, resized};
use crate::random::mixed;
use crate::size::Size;
use crate::synth::{Apparent, Drawing, RandomScenes};

/// Longer side of the photographs that are kept, px: several crops wide, a few MB each.
const PHOTOGRAPH_SIDE: u32 = 1280;
/// Ends of the names of photographs' files.
const EXTENSIONS: [&str; 4] = ["jpg", "jpeg", "png", "webp"];
/// Fraction of the scenes that are dark and lit from the camera.
pub(super) const NIGHTS: f64 = 0.05;
/// Most balls in a picture that is trained with: each teaches as much as one alone.
const MOST_BALLS: usize = 3;
/// The step whose seeds are those of pictures to score with: no run is so long.
const SCORED: u64 = u64::MAX;

/// Draws batches of random scenes.
#[derive(Debug)]
pub struct Renderings {
    scenes: RandomScenes,
    seed: u64,
    input: Size,
    normalisation: Normalisation,
    photographs: usize,
}

impl Renderings {
    /// By `recipe`, with the photographs of `folder`, if any, as backgrounds.
    ///
    /// # Errors
    /// [`Error::Io`] for a folder that cannot be read, [`Error::Data`] for one without photographs; for a damaged one as
    /// [`Picture::open`].
    pub fn new(recipe: &Recipe, folder: Option<&Path>) -> Result<Self> {
        let photographs = folder.map(self::read_photographs).transpose()?.unwrap_or_default();
        let count = photographs.len();
        Ok(Self {
            scenes: RandomScenes::new(photographs, recipe.empty_fraction).with_nights(NIGHTS),
            seed: recipe.seed,
            input: recipe.input,
            normalisation: recipe.normalisation,
            photographs: count,
        })
    }

    /// Photographs among the backgrounds.
    pub fn photographs(&self) -> usize {
        self.photographs
    }

    /// The batch of step `step`: the same for the same seed and step.
    pub fn batch(&self, phase: &Phase, step: usize) -> Batch {
        let size = phase.crop.map_or(self.input, Size::square);
        let draw = |index: usize| self.scenes.draw(size, mixed(self.seed, step as u64, index as u64), MOST_BALLS);
        let drawn: Vec<Drawing> = (0..phase.batch).into_par_iter().map(draw).collect();
        let mut batch = Batch {
            pictures: Vec::with_capacity(3 * size.pixels() * drawn.len()),
            size: [size.height as usize, size.width as usize],
            channels: 3,
            labels: Labels::default(),
            windows: vec![],
        };
        let Normalisation { mean, std } = self.normalisation;
        for (index, drawing) in drawn.iter().enumerate() {
            let normalised = |pixel: [f32; 3]| std::array::from_fn::<f32, 3, _>(|at| (pixel[at] - mean[at]) / std[at]);
            batch.pictures.extend(drawing.rgb().flat_map(normalised));
            let mut label = |ball: Option<&Apparent>| {
                batch.labels.picture.push(index);
                batch.labels.image.push(ball.map(|ball| ball.centre));
                batch.labels.depth.push(ball.map_or(1.0, |ball| ball.radius));
                batch.labels.depth_weight.push(f64::from(u8::from(ball.is_some())));
            };
            if drawing.balls.is_empty() {
                label(None);
            }
            drawing.balls.iter().for_each(|ball| label(Some(ball)));
        }
        batch
    }

    /// The `index`-th picture to score with, with one ball at most; none is ever trained on.
    pub fn scored(&self, index: usize) -> Drawing {
        self.scenes.draw(self.input, mixed(self.seed, SCORED, index as u64), 1)
    }
}

/// The photographs in `folder` and below it, in the order of their names, at most 1280 px long.
///
/// # Errors
/// [`Error::Io`] for a folder that cannot be read, [`Error::Data`] for one without photographs; for a damaged one as
/// [`Picture::open`].
pub fn read_photographs(folder: &Path) -> Result<Vec<RgbImage>> {
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
    let read = |path: &std::path::PathBuf| {
        let named = |error: Error| match error {
            error @ Error::Io { .. } => error,
            error => Error::Data { what: path.display().to_string(), reason: error.to_string() },
        };
        let rgb = Picture::open(path).map_err(named)?.rgb().clone();
        let scale = f64::from(PHOTOGRAPH_SIDE) / f64::from(rgb.width().max(rgb.height()));
        if scale >= 1.0 {
            return Ok(rgb);
        }
        let size = Size::new(rgb.width(), rgb.height());
        let [width, height] = [size.width, size.height].map(|side| ((f64::from(side) * scale) as u32).max(1));
        Ok(resized(&rgb, [0, 0], size, Size::new(width, height), Filter::Bilinear))
    };
    files.par_iter().map(read).collect()
}
