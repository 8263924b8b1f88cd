//! Renderings of random scenes as training pictures, and as pictures to score with.

use std::path::Path;

use rayon::iter::{IntoParallelIterator, ParallelIterator};

use super::super::recipe::{Phase, Recipe};
use super::photographs::Photographs;
use super::{Batch, Labels};
use gravisight_geometry::error::Result;
use gravisight_geometry::image::Normalisation;
use gravisight_geometry::random::mixed;
use gravisight_geometry::size::Size;
use gravisight_synth::{Apparent, Drawing, RandomScenes};

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
    /// As [`Photographs::read`].
    pub fn new(recipe: &Recipe, folder: Option<&Path>) -> Result<Self> {
        Ok(Self::of(recipe, folder.map(Photographs::read).transpose()?.unwrap_or_default()))
    }

    /// The same with these photographs.
    pub fn of(recipe: &Recipe, photographs: Photographs) -> Self {
        let Photographs { plain, labelled } = photographs;
        let count = plain.len() + labelled.len();
        Self {
            scenes: RandomScenes::new(plain, recipe.empty_fraction).with_nights(NIGHTS).with_labelled(labelled),
            seed: recipe.seed,
            input: recipe.input,
            normalisation: recipe.normalisation,
            photographs: count,
        }
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
                batch.labels.depth_weight.push(f64::from(u8::from(ball.is_some_and(|ball| ball.is_sized))));
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
