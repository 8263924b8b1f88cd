//! The verifier's training data: crops of random scenes around a model's candidates.
//!
//! What a first look takes for a ball and is none teaches most, and no drawing by hand has its like. So the model's own
//! proposals are what is learned from, beside the balls that it may have missed.

use std::path::Path;

use burn::tensor::Device;
use image::RgbImage;
use nalgebra::{Point2, Vector2, distance};
use rand::RngExt;
use rayon::iter::{IntoParallelIterator, ParallelIterator};

use super::super::recipe::{Phase, Recipe};
use super::renderings::{NIGHTS, read_photographs};
use super::{Batch, Labels};
use crate::camera::Outline;
use crate::error::Result;
use crate::image::{Filter, Normalisation, Picture, resized};
use crate::localise::Localiser;
use crate::localise::closer::{CLOSER, View, stacked};
use crate::model::{CLOSER_RADIUS, CLOSER_SIDE, Card};
use crate::random::{Random, Stream, mixed};
use crate::size::Size;
use crate::synth::{RandomScenes, Spot};

/// Side of the scenes that are drawn, px, and most balls in one.
const SIDE: u32 = 256;
const MOST_BALLS: usize = 2;
/// Places that a scene is looked at in: most of those that the model proposes, and all.
const PROPOSED: usize = 3;
const VIEWS: usize = 4;
/// How often a ball is looked at although it was not proposed.
const MISSED: f64 = 0.5;
/// Candidates of each photograph that are kept as places to draw scenes about, at its own size and at half of it.
const FOUND: usize = 8;
/// Share of the scenes that are drawn about one of them, where there are any.
const ABOUT_ONE: f64 = 0.5;
/// What each candidate counts beside its confidence when one is drawn.
const ANY_CANDIDATE: f64 = 0.1;
/// How rough a place is: standard deviation of log(radius), and of its centre along each axis, radii.
const ROUGH: [f64; 2] = [0.12, 0.12];
/// How often a place is seen from farther away, as one of which is known only roughly where the ball is; how far at most.
const FARTHER: f64 = 0.2;
const FARTHEST: f64 = 2.5;
/// Radii of the balls that a view is of, px of the view: others are too small or too large to be what was proposed.
const RADII: [f64; 2] = [CLOSER_RADIUS / 2.5, CLOSER_RADIUS * 2.0];
/// Step of the seeds of places to score with: no run is so long.
const SCORED: u64 = u64::MAX;

/// A crop around a candidate, as the verifier sees it.
pub struct Seen {
    /// The crop, of [`CLOSER_SIDE`] px, and what is around it, as large.
    pub views: [RgbImage; 2],
    /// The outlines of the balls in the crop, px of it.
    pub balls: Vec<Outline>,
}

/// Draws batches of places.
pub struct Places {
    scenes: RandomScenes,
    pub(super) first: Localiser,
    seed: u64,
    normalisation: Normalisation,
    /// Of each photograph without a ball the candidates in it, with what each counts.
    spots: Vec<Vec<(Spot, f64)>>,
}

impl Places {
    /// By `recipe`, where the model of the card `first` proposes them, with the photographs of `folder`, if any, as
    /// backgrounds.
    ///
    /// # Errors
    /// As [`read_photographs`], [`Card::with_weights`] and [`Localiser::new`].
    pub fn new(recipe: &Recipe, folder: Option<&Path>, first: &Path) -> Result<Self> {
        let photographs = folder.map(read_photographs).transpose()?.unwrap_or_default();
        let (card, weights) = Card::with_weights(first)?;
        let first = Localiser::new(card, weights, &Device::flex())?;
        let spots = (0..photographs.len()).into_par_iter();
        let spots = spots.map(|number| spots_in(&first, number, &photographs[number])).collect::<Result<Vec<_>>>()?;
        Ok(Self {
            scenes: RandomScenes::new(photographs, recipe.empty_share).with_nights(NIGHTS),
            first,
            seed: recipe.seed,
            normalisation: recipe.normalisation,
            spots: spots.into_iter().filter(|spots| !spots.is_empty()).collect(),
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
        let scene = |index: usize| self.scene(mixed(self.seed, step as u64, index as u64));
        let scenes: Vec<Result<Vec<Seen>>> = (0..phase.batch.div_ceil(VIEWS)).into_par_iter().map(scene).collect();
        let scenes = scenes.into_iter().collect::<Result<Vec<_>>>()?;
        let mut batch = Batch {
            pictures: Vec::with_capacity(6 * Size::square(CLOSER_SIDE).pixels() * phase.batch),
            size: [CLOSER_SIDE as usize; 2],
            channels: 6,
            labels: Labels::default(),
            windows: vec![],
        };
        for (index, seen) in scenes.into_iter().flatten().take(phase.batch).enumerate() {
            batch.pictures.extend(stacked(&seen.views, &self.normalisation));
            let mut label = |ball: Option<&Outline>| {
                batch.labels.picture.push(index);
                batch.labels.image.push(ball.map(|ball| ball.centre.coords.into()));
                batch.labels.depth.push(ball.map_or(1.0, |ball| ball.radius));
                batch.labels.depth_weight.push(f64::from(u8::from(ball.is_some())));
            };
            if seen.balls.is_empty() {
                label(None);
            }
            seen.balls.iter().for_each(|ball| label(Some(ball)));
        }
        Ok(batch)
    }

    /// The places of the `index`-th scene to score with; none is ever trained on.
    ///
    /// # Errors
    /// As [`Self::batch`].
    pub fn scored(&self, index: usize) -> Result<Vec<Seen>> {
        self.scene(mixed(self.seed, SCORED, index as u64))
    }

    /// A place to draw a scene about, in some of them.
    fn spot(&self, random: &mut Random) -> Option<&Spot> {
        if self.spots.is_empty() || !random.random_bool(ABOUT_ONE) {
            return None;
        }
        let spots = &self.spots[random.random_range(0..self.spots.len())];
        let mut left = random.random_range(0.0..spots.iter().map(|(_, weight)| weight).sum());
        let chosen = spots.iter().find(|(_, weight)| {
            left -= weight;
            left < 0.0
        });
        chosen.or(spots.last()).map(|(spot, _)| spot)
    }

    /// The places of a scene: as many of each.
    fn scene(&self, seed: u64) -> Result<Vec<Seen>> {
        let mut random = Stream::Places.of(seed);
        let (drawing, about) = match self.spot(&mut random) {
            Some(spot) => {
                let (drawing, centre, radius) = self.scenes.draw_about(Size::square(SIDE), seed, MOST_BALLS, spot);
                (drawing, Some(Outline { centre: centre.map(f64::from).into(), radius: f64::from(radius) }))
            }
            None => (self.scenes.draw(Size::square(SIDE), seed, MOST_BALLS), None),
        };
        let picture = Picture::from_rgb(drawing.picture());
        let first = pollster::block_on(self.first.first_look(&picture, None, PROPOSED, false))?;
        let proposed = first.readings.iter().take(PROPOSED).map(|reading| reading.outline);
        let balls: Vec<Outline> =
            (drawing.balls.iter()).map(|ball| Outline { centre: ball.centre.into(), radius: ball.radius }).collect();
        let missed = missed(&balls, &mut random);
        let mut places: Vec<Outline> = about.into_iter().chain(proposed).chain(missed).take(VIEWS).collect();
        while places.len() < VIEWS {
            let side = f64::from(SIDE - 1);
            let centre = Point2::new(random.random_range(0.0..side), random.random_range(0.0..side));
            places.push(Outline { centre, radius: random.random_range(1.5_f64.ln()..50_f64.ln()).exp() });
        }
        let seen = |place: Outline| {
            let place = roughly(&place, &mut random);
            let farther = if random.random_bool(FARTHER) { random.random_range(1.0..FARTHEST) } else { 1.0 };
            let view = View::around(&place, place.radius * farther, picture.rgb(), CLOSER);
            let within = |ball: &Outline| {
                let inside = |at: f64| (0.0..f64::from(CLOSER_SIDE) - 1.0).contains(&at);
                (RADII[0]..RADII[1]).contains(&ball.radius) && ball.centre.iter().all(|&at| inside(at))
            };
            Seen {
                views: view.with_surroundings(picture.rgb()),
                balls: balls.iter().map(|ball| view.in_view(ball)).filter(within).collect(),
            }
        };
        Ok(places.into_iter().map(seen).collect())
    }
}

/// What `first` takes for a ball in the photograph of a number, which shows none.
fn spots_in(first: &Localiser, number: usize, rgb: &RgbImage) -> Result<Vec<(Spot, f64)>> {
    let size = Size::new(rgb.width(), rgb.height());
    let half = Size::new(size.width / 2, size.height / 2);
    let mut spots = vec![];
    for (shrunk, scale) in [(size, 1.0), (half, 2.0)] {
        if shrunk.width.min(shrunk.height) < SIDE / 2 {
            continue;
        }
        let picture = Picture::from_rgb(resized(rgb, [0, 0], size, shrunk, Filter::Bilinear));
        let found = pollster::block_on(first.readings(&picture, None, None, None, FOUND, false))?.readings;
        spots.extend(found.into_iter().map(|reading| {
            let Outline { centre, radius } = reading.outline;
            let centre = [centre.x, centre.y].map(|at| ((at + 0.5) * scale - 0.5) as f32);
            let spot = Spot { photograph: number, centre, radius: (radius * scale) as f32 };
            (spot, ANY_CANDIDATE + reading.confidence)
        }));
    }
    Ok(spots)
}

/// The balls that are looked at although they were not proposed.
pub(super) fn missed(balls: &[Outline], random: &mut Random) -> Vec<Outline> {
    balls.iter().filter(|_| random.random_bool(MISSED)).copied().collect()
}

/// About `place`.
fn roughly(place: &Outline, random: &mut Random) -> Outline {
    // A sum of three is near enough to a normal distribution.
    let mut normal = || 2.0 * (0..3).map(|_| random.random_range(-0.5..0.5_f64)).sum::<f64>();
    let [of_radius, of_centre] = ROUGH;
    let moved = Vector2::new(normal(), normal()) * of_centre * place.radius;
    Outline { centre: place.centre + moved, radius: place.radius * (of_radius * normal()).exp() }
}

impl Seen {
    /// The ball in the middle, if one is there.
    pub fn ball(&self) -> Option<&Outline> {
        let middle = Point2::from([f64::from(CLOSER_SIDE - 1) / 2.0; 2]);
        self.balls.iter().min_by(|a, b| distance(&a.centre, &middle).total_cmp(&distance(&b.centre, &middle)))
    }
}
