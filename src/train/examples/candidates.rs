//! The verifier's training data: crops of random scenes around a model's candidates.
//!
//! The detector's false positives are the examples that teach most, and nothing drawn on purpose resembles them. So the verifier
//! learns from the detector's own candidates, and from balls that the detector may have missed.

use std::path::Path;

use burn::tensor::Device;
use image::RgbImage;
use nalgebra::{Point2, Vector2, distance};
use rand::RngExt;
use rayon::iter::{IntoParallelIterator, ParallelIterator};

use super::super::recipe::{Phase, Recipe};
use super::photographs::Photographs;
use super::renderings::NIGHTS;
use super::{Batch, Labels};
use crate::localise::Localiser;
use crate::localise::crop::{Crop, VERIFIER_CROP};
use crate::localise::verifier::stacked;
use crate::model::{Card, VERIFIER_RADIUS, VERIFIER_SIDE};
use gravisight_geometry::camera::Outline;
use gravisight_geometry::error::Result;
use gravisight_geometry::image::{Filter, Normalisation, Picture, resized};
use gravisight_geometry::random::{Random, Stream, mixed};
use gravisight_geometry::size::Size;
use gravisight_synth::{RandomScenes, Spot};

/// Side of the scenes that are drawn, px, and most balls in one.
const SIDE: u32 = 256;
const MOST_BALLS: usize = 2;
/// Crops of a scene: of the detector's candidates at most, and in all.
const CANDIDATES_OF_SCENE: usize = 3;
const CROPS_OF_SCENE: usize = 4;
/// Probability that a ball gets a crop although the detector may have missed it.
const MISSED: f64 = 0.5;
/// Candidates of each photograph that are kept as hard negatives to draw scenes around, at its own size and at half of it.
const HARD_NEGATIVES: usize = 8;
/// Fraction of the scenes that are drawn around one of them, where there are any.
const AROUND_NEGATIVE: f64 = 0.5;
/// Weight of each candidate beside its confidence when one is drawn.
const MIN_WEIGHT: f64 = 0.1;
/// Jitter of a crop: standard deviation of log(radius), and of its centre along each axis, radii.
const JITTER: [f64; 2] = [0.12, 0.12];
/// Probability that a crop is wider than usual, as for a ball whose position is known only roughly; and by how much at most.
const WIDER: f64 = 0.2;
const WIDEST: f64 = 2.5;
/// Radii of the balls that are labels of a crop, px of it: others are too small or too large for the crop's candidate.
pub const CROP_RADII: [f64; 2] = [VERIFIER_RADIUS / 2.5, VERIFIER_RADIUS * 2.0];
/// Step of the seeds of crops to score with: no run is so long.
const SCORED: u64 = u64::MAX;

/// A crop around a candidate, in the verifier's input, with its labels.
pub struct LabelledCrop {
    /// The crop, of [`VERIFIER_SIDE`] px, and its surroundings, of the same size.
    pub views: [RgbImage; 2],
    /// The outlines of the balls in the crop, px of it.
    pub balls: Vec<Outline>,
}

/// Draws batches of crops.
pub struct CandidateCrops {
    scenes: RandomScenes,
    pub(super) detector: Localiser,
    seed: u64,
    normalisation: Normalisation,
    /// Of each photograph without a ball the detector's false positives, with their weights.
    negatives: Vec<Vec<(Spot, f64)>>,
}

impl CandidateCrops {
    /// By `recipe`, around the candidates of the model whose card is `detector`, with the photographs of `folder`, if any, as
    /// backgrounds.
    ///
    /// # Errors
    /// As [`read_photographs`], [`Card::with_weights`] and [`Localiser::new`].
    pub fn new(recipe: &Recipe, folder: Option<&Path>, detector: &Path) -> Result<Self> {
        let (card, weights) = Card::with_weights(detector)?;
        let detector = Localiser::new(card, weights, &Device::flex())?;
        Self::of(recipe, folder.map(Photographs::read).transpose()?.unwrap_or_default(), detector)
    }

    /// The same around the candidates of `detector`.
    ///
    /// # Errors
    /// As [`Localiser::localise`].
    pub fn of(recipe: &Recipe, photographs: Photographs, detector: Localiser) -> Result<Self> {
        let Photographs { plain: photographs, labelled } = photographs;
        // One after the other: each search runs on all threads, and one that waits for them would begin the next photograph, and the next.
        let negatives = (0..photographs.len()).map(|number| hard_negatives(&detector, number, &photographs[number]));
        let negatives = negatives.collect::<Result<Vec<_>>>()?;
        Ok(Self {
            scenes: RandomScenes::new(photographs, recipe.empty_fraction).with_nights(NIGHTS).with_labelled(labelled),
            detector,
            seed: recipe.seed,
            normalisation: recipe.normalisation,
            negatives: negatives.into_iter().filter(|spots| !spots.is_empty()).collect(),
        })
    }

    /// Photographs among the backgrounds.
    pub fn photographs(&self) -> usize {
        self.scenes.photographs().len()
    }

    /// The batch of step `step`: the same for the same seed and step.
    ///
    /// # Errors
    /// As [`Localiser::localise`].
    pub fn batch(&self, phase: &Phase, step: usize) -> Result<Batch> {
        let crops = |index: usize| self.crops_of_scene(mixed(self.seed, step as u64, index as u64));
        let scenes = (0..phase.batch.div_ceil(CROPS_OF_SCENE)).into_par_iter();
        let scenes = scenes.map(crops).collect::<Vec<Result<Vec<LabelledCrop>>>>();
        let scenes = scenes.into_iter().collect::<Result<Vec<_>>>()?;
        let mut batch = Batch {
            pictures: Vec::with_capacity(6 * Size::square(VERIFIER_SIDE).pixels() * phase.batch),
            size: [VERIFIER_SIDE as usize; 2],
            channels: 6,
            labels: Labels::default(),
            windows: vec![],
        };
        for (index, crop) in scenes.into_iter().flatten().take(phase.batch).enumerate() {
            batch.pictures.extend(stacked(&crop.views, &self.normalisation));
            let mut label = |ball: Option<&Outline>| {
                batch.labels.picture.push(index);
                batch.labels.image.push(ball.map(|ball| ball.centre.coords.into()));
                batch.labels.depth.push(ball.map_or(1.0, |ball| ball.radius));
                batch.labels.depth_weight.push(f64::from(u8::from(ball.is_some())));
            };
            if crop.balls.is_empty() {
                label(None);
            }
            crop.balls.iter().for_each(|ball| label(Some(ball)));
        }
        Ok(batch)
    }

    /// The crops of the `index`-th scene to score with; none is ever trained on.
    ///
    /// # Errors
    /// As [`Self::batch`].
    pub fn scored(&self, index: usize) -> Result<Vec<LabelledCrop>> {
        self.crops_of_scene(mixed(self.seed, SCORED, index as u64))
    }

    /// A hard negative to draw a scene around; none for some of the scenes.
    fn negative(&self, random: &mut Random) -> Option<&Spot> {
        if self.negatives.is_empty() || !random.random_bool(AROUND_NEGATIVE) {
            return None;
        }
        let spots = &self.negatives[random.random_range(0..self.negatives.len())];
        let mut left = random.random_range(0.0..spots.iter().map(|(_, weight)| weight).sum());
        let chosen = spots.iter().find(|(_, weight)| {
            left -= weight;
            left < 0.0
        });
        chosen.or(spots.last()).map(|(spot, _)| spot)
    }

    /// The crops of a scene, [`CROPS_OF_SCENE`]: of its hard negative, candidates and balls, and of random positions.
    fn crops_of_scene(&self, seed: u64) -> Result<Vec<LabelledCrop>> {
        let mut random = Stream::Candidates.of(seed);
        let (drawing, negative) = match self.negative(&mut random) {
            Some(spot) => {
                let (drawing, centre, radius) = self.scenes.draw_about(Size::square(SIDE), seed, MOST_BALLS, spot);
                (drawing, Some(Outline { centre: centre.map(f64::from).into(), radius: f64::from(radius) }))
            }
            None => (self.scenes.draw(Size::square(SIDE), seed, MOST_BALLS), None),
        };
        let picture = Picture::from_rgb(drawing.picture());
        let first = pollster::block_on(self.detector.first_pass(&picture, None, CANDIDATES_OF_SCENE, false))?;
        let candidates = first.candidates.iter().take(CANDIDATES_OF_SCENE).map(|candidate| candidate.outline);
        let balls: Vec<Outline> =
            (drawing.balls.iter()).map(|ball| Outline { centre: ball.centre.into(), radius: ball.radius }).collect();
        let missed = missed(&balls, &mut random);
        let mut outlines: Vec<Outline> =
            negative.into_iter().chain(candidates).chain(missed).take(CROPS_OF_SCENE).collect();
        while outlines.len() < CROPS_OF_SCENE {
            let side = f64::from(SIDE - 1);
            let centre = Point2::new(random.random_range(0.0..side), random.random_range(0.0..side));
            outlines.push(Outline { centre, radius: random.random_range(1.5_f64.ln()..50_f64.ln()).exp() });
        }
        let labelled = |outline: Outline| {
            let outline = jittered(&outline, &mut random);
            let wider = if random.random_bool(WIDER) { random.random_range(1.0..WIDEST) } else { 1.0 };
            let crop = Crop::around(&outline, outline.radius * wider, picture.rgb(), VERIFIER_CROP);
            let is_label = |ball: &Outline| {
                let inside = |at: f64| (0.0..f64::from(VERIFIER_SIDE) - 1.0).contains(&at);
                (CROP_RADII[0]..CROP_RADII[1]).contains(&ball.radius) && ball.centre.iter().all(|&at| inside(at))
            };
            LabelledCrop {
                views: crop.with_surroundings(picture.rgb()),
                balls: balls.iter().map(|ball| crop.crop_from_picture(ball)).filter(is_label).collect(),
            }
        };
        Ok(outlines.into_iter().map(labelled).collect())
    }
}

/// The detector's false positives in the photograph of index `number`, which shows no ball, with their weights.
fn hard_negatives(detector: &Localiser, number: usize, rgb: &RgbImage) -> Result<Vec<(Spot, f64)>> {
    let size = Size::new(rgb.width(), rgb.height());
    let half = Size::new(size.width / 2, size.height / 2);
    let mut spots = vec![];
    for (reduced, scale) in [(size, 1.0), (half, 2.0)] {
        if reduced.width.min(reduced.height) < SIDE / 2 {
            continue;
        }
        let picture = Picture::from_rgb(resized(rgb, [0, 0], size, reduced, Filter::Bilinear));
        let found = pollster::block_on(detector.search(&picture, None, None, None, HARD_NEGATIVES, false))?;
        spots.extend(found.detections.into_iter().map(|detection| {
            let Outline { centre, radius } = detection.outline;
            let centre = [centre.x, centre.y].map(|at| ((at + 0.5) * scale - 0.5) as f32);
            let spot = Spot { photograph: number, centre, radius: (radius * scale) as f32 };
            (spot, MIN_WEIGHT + detection.confidence)
        }));
    }
    Ok(spots)
}

/// The balls that get a crop although the detector may have missed them.
pub(super) fn missed(balls: &[Outline], random: &mut Random) -> Vec<Outline> {
    balls.iter().filter(|_| random.random_bool(MISSED)).copied().collect()
}

/// `outline` with random errors of centre and radius.
pub fn jittered(outline: &Outline, random: &mut Random) -> Outline {
    // The sum of three uniform deviates is close enough to a normal one.
    let mut normal = || 2.0 * (0..3).map(|_| random.random_range(-0.5..0.5_f64)).sum::<f64>();
    let [of_radius, of_centre] = JITTER;
    let moved = Vector2::new(normal(), normal()) * of_centre * outline.radius;
    Outline { centre: outline.centre + moved, radius: outline.radius * (of_radius * normal()).exp() }
}

impl LabelledCrop {
    /// The ball nearest to the crop's centre, if there is one.
    pub fn ball(&self) -> Option<&Outline> {
        let middle = Point2::from([f64::from(VERIFIER_SIDE - 1) / 2.0; 2]);
        self.balls.iter().min_by(|a, b| distance(&a.centre, &middle).total_cmp(&distance(&b.centre, &middle)))
    }
}
