//! Parts of a video's frames around its ball and around what looks like one: what detector and verifier learn from.

use std::sync::Arc;

use image::{RgbImage, imageops};
use nalgebra::Point2;
use rand::RngExt;

use super::super::examples::{Batch, CROP_RADII, Labels, jittered};
use crate::localise::Localiser;
use crate::localise::crop::{Crop, CropSize, DETECTOR_CROP, VERIFIER_CROP};
use crate::localise::verifier::stacked;
use crate::model::VERIFIER_SIDE;
use gravisight_geometry::camera::Outline;
use gravisight_geometry::error::Result;
use gravisight_geometry::image::{Filter, Normalisation, Picture, resized};
use gravisight_geometry::random::{Random, Stream, mixed};
use gravisight_geometry::size::Size;

/// Side of a patch, px of the video: at least this, and so many radii, so that the verifier's surroundings fit.
const SIDE: f64 = 256.0;
const RADII: f64 = 20.0;
/// What looks like a ball in a frame, and how many of it become patches.
const DETECTIONS: usize = 6;
const NEGATIVES: usize = 3;
/// A detection is the ball's own within so many radii of it.
const OWN: f64 = 2.0;
/// Scales at which a patch is shown: the ball may be nearer or farther.
const SCALES: [f64; 2] = [0.75, 1.33];
/// Fraction of the detector's pictures that are magnified as in its second pass.
const SECOND_PASS: f64 = 0.5;
/// Largest change of contrast (a factor) and of brightness (levels).
const CONTRAST: f64 = 1.2;
const BRIGHTNESS: f64 = 20.0;
/// Fraction of the verifier's crops that are of a ball, and of the detector's mosaics that have one.
const BALLS: f64 = 0.6;
const MOSAICS_WITH_BALL: f64 = 0.85;
/// Tiles along each side of a mosaic. The heatmap of a picture is a distribution: a network that sees only small windows learns nothing of how
/// likely a ball in one is beside the rest of the frame.
const TILES: u32 = 2;
/// Patches of a frame at random places.
const ANYWHERE: usize = 2;

/// A part of a frame.
#[derive(Debug, Clone)]
pub struct Patch {
    /// Its pixels, which detector and verifier share.
    pub rgb: Arc<RgbImage>,
    /// The ball, px of the patch, if it is in it.
    pub ball: Option<Outline>,
    /// What it was cut around, px of it: the ball, or what looks like one.
    pub about: Outline,
    /// The flight whose frame it is of.
    pub flight: usize,
}

/// Cuts the patches of a frame that shows the ball of outline `ball`: one about it, and one about each of the likeliest other
/// detections of `localiser`. The place in them is random by `seed`.
///
/// # Errors
/// As [`Localiser::localise`].
pub async fn cut(
    localiser: &Localiser,
    picture: &Picture,
    (ball, flight): (&Outline, usize),
    seed: u64,
) -> Result<Vec<Patch>> {
    let mut random = Stream::Candidates.of(seed);
    let found = localiser.search(picture, None, None, None, DETECTIONS, false).await?.detections;
    let is_own = |outline: &Outline| (outline.centre - ball.centre).norm() < OWN * ball.radius.max(outline.radius);
    let others = found.into_iter().map(|detection| detection.outline).filter(|outline| !is_own(outline));
    let (width, height) = picture.rgb().dimensions();
    let anywhere: Vec<Outline> = (0..ANYWHERE)
        .map(|_| {
            let at = [width, height].map(|side| random.random_range(0.0..f64::from(side)));
            Outline { centre: at.into(), radius: ball.radius }
        })
        .filter(|outline| !is_own(outline))
        .collect();
    let abouts = std::iter::once(*ball).chain(others.take(NEGATIVES)).chain(anywhere);
    Ok(abouts.map(|about| patch(picture.rgb(), ball, about, flight, &mut random)).collect())
}

fn patch(rgb: &RgbImage, ball: &Outline, about: Outline, flight: usize, random: &mut Random) -> Patch {
    let (width, height) = rgb.dimensions();
    let side = (SIDE.max(RADII * about.radius).round() as u32).min(width.min(height));
    // What it is about lies anywhere in the middle half.
    let mut start = |at: f64, all: u32| {
        let shift = random.random_range(-0.25..0.25) * f64::from(side);
        ((at - f64::from(side) / 2.0 + shift).round().max(0.0) as u32).min(all - side)
    };
    let start = [start(about.centre.x, width), start(about.centre.y, height)];
    let moved = |outline: &Outline| Outline {
        centre: Point2::new(outline.centre.x - f64::from(start[0]), outline.centre.y - f64::from(start[1])),
        radius: outline.radius,
    };
    let own = moved(ball);
    let inside = |at: f64| (-own.radius..f64::from(side) + own.radius).contains(&at);
    Patch {
        rgb: imageops::crop_imm(rgb, start[0], start[1], side, side).to_image().into(),
        ball: own.centre.iter().all(|&at| inside(at)).then_some(own),
        about: moved(&about),
        flight,
    }
}

/// Draws batches from patches.
pub struct PatchSampler {
    balls: Vec<Patch>,
    others: Vec<Patch>,
    normalisation: Normalisation,
    seed: u64,
}

/// One of a batch's pictures: its views, and the balls in the first of them.
struct View {
    views: Vec<RgbImage>,
    balls: Vec<Outline>,
}

impl PatchSampler {
    /// Of patches of which at least one shows a ball.
    pub fn new(patches: Vec<Patch>, normalisation: Normalisation, seed: u64) -> Self {
        let (balls, others) = patches.into_iter().partition(|patch| patch.ball == Some(patch.about));
        Self { balls, others, normalisation, seed }
    }

    /// `count` mosaics of `side` px for the detector, in step `step`: windows of the frames and crops as its second pass sees them, one of a ball
    /// in most.
    pub fn for_detector(&self, count: usize, side: u32, step: usize) -> Batch {
        let mosaic = |index: usize| {
            let tile_side = side / TILES;
            let mut random = Stream::Augmentation.of(mixed(self.seed, step as u64, index as u64));
            let with_ball = random.random_bool(MOSAICS_WITH_BALL).then(|| random.random_range(0..TILES * TILES));
            let mut mosaic = View { views: vec![RgbImage::new(side, side)], balls: vec![] };
            for tile in 0..TILES * TILES {
                let of_ball = with_ball == Some(tile) || self.others.is_empty();
                let number = index * (TILES * TILES) as usize + tile as usize;
                let (patch, mut random) = self.chosen(step, number, of_ball);
                let shown = match random.random_bool(SECOND_PASS) {
                    true => magnified(&patch, DETECTOR_CROP, &mut random, false),
                    false => window(&patch, tile_side, &mut random),
                };
                let at = [tile % TILES, tile / TILES].map(|cell| cell * tile_side);
                let views = shown.views.iter().take(1);
                views.for_each(|view| imageops::replace(&mut mosaic.views[0], view, at[0].into(), at[1].into()));
                let moved = |ball: Outline| Outline {
                    centre: Point2::new(ball.centre.x + f64::from(at[0]), ball.centre.y + f64::from(at[1])),
                    ..ball
                };
                mosaic.balls.extend(shown.balls.into_iter().map(moved));
            }
            mosaic
        };
        self.batch((0..count).map(mosaic).collect(), side)
    }

    /// `count` crops for the verifier, in step `step`.
    pub fn for_verifier(&self, count: usize, step: usize) -> Batch {
        let view = |index: usize| {
            let of_ball = Stream::Augmentation.of(mixed(self.seed, step as u64, index as u64)).random_bool(BALLS);
            let (patch, mut random) = self.chosen(step, index, of_ball || self.others.is_empty());
            magnified(&patch, VERIFIER_CROP, &mut random, true)
        };
        self.batch((0..count).map(view).collect(), VERIFIER_SIDE)
    }

    /// A patch as it is shown once: mirrored or not, brighter or darker.
    fn chosen(&self, step: usize, index: usize, of_ball: bool) -> (Patch, Random) {
        let mut random = Stream::Batch.of(mixed(self.seed, step as u64, index as u64));
        let patches = if of_ball { &self.balls } else { &self.others };
        let mut patch = patches[random.random_range(0..patches.len())].clone();
        if random.random_bool(0.5) {
            patch.rgb = imageops::flip_horizontal(&*patch.rgb).into();
            let last = f64::from(patch.rgb.width() - 1);
            for outline in patch.ball.iter_mut().chain([&mut patch.about]) {
                outline.centre.x = last - outline.centre.x;
            }
        }
        let contrast = random.random_range(-CONTRAST.ln()..CONTRAST.ln()).exp();
        let brightness = random.random_range(-BRIGHTNESS..BRIGHTNESS);
        for level in Arc::make_mut(&mut patch.rgb).iter_mut() {
            *level = ((f64::from(*level) - 128.0) * contrast + 128.0 + brightness).clamp(0.0, 255.0) as u8;
        }
        (patch, random)
    }

    fn batch(&self, views: Vec<View>, side: u32) -> Batch {
        let channels = 3 * views.first().map_or(1, |view| view.views.len());
        let mut labels = Labels::default();
        let mut pictures = Vec::with_capacity(views.len() * channels * Size::square(side).pixels());
        for (index, View { views, balls }) in views.iter().enumerate() {
            pictures.extend(stacked(views, &self.normalisation));
            let mut label = |ball: Option<&Outline>| {
                labels.picture.push(index);
                labels.image.push(ball.map(|ball| ball.centre.coords.into()));
                labels.depth.push(ball.map_or(1.0, |ball| ball.radius));
                labels.depth_weight.push(f64::from(u8::from(ball.is_some())));
            };
            if balls.is_empty() {
                label(None);
            }
            balls.iter().for_each(|ball| label(Some(ball)));
        }
        Batch { pictures, size: [side as usize; 2], channels, labels, windows: vec![] }
    }
}

/// A crop about a patch's candidate, as a pass over it sees it.
fn magnified(patch: &Patch, size: CropSize, random: &mut Random, with_surroundings: bool) -> View {
    let outline = jittered(&patch.about, random);
    let crop = Crop::around(&outline, outline.radius, &patch.rgb, size);
    let ball = patch.ball.map(|ball| crop.crop_from_picture(&ball));
    let side = f64::from(size.side());
    let inside = |ball: &Outline| {
        ball.centre.iter().all(|at| (0.0..side - 1.0).contains(at))
            // The verifier sees balls of about the candidate's size.
            && (!with_surroundings || (CROP_RADII[0]..CROP_RADII[1]).contains(&ball.radius))
    };
    let views = match with_surroundings {
        true => crop.with_surroundings(&patch.rgb).to_vec(),
        false => vec![crop.pixels(&patch.rgb)],
    };
    View { views, balls: ball.filter(inside).into_iter().collect() }
}

/// A window of a patch at another scale, with what the patch is about anywhere in it.
fn window(patch: &Patch, side: u32, random: &mut Random) -> View {
    let whole = patch.rgb.width();
    let scale = random.random_range(SCALES[0].ln()..SCALES[1].ln()).exp().max(f64::from(side) / f64::from(whole));
    let part = ((f64::from(side) / scale).round() as u32).clamp(1, whole);
    let scale = f64::from(side) / f64::from(part);
    let mut start = |at: f64| {
        let least = (at - f64::from(part)).max(0.0) as u32;
        let most = (at.max(0.0) as u32).min(whole - part);
        random.random_range(least.min(most)..=most)
    };
    let start = [start(patch.about.centre.x), start(patch.about.centre.y)];
    let moved = |ball: Outline| {
        let at = |axis: usize| (ball.centre[axis] - f64::from(start[axis]) + 0.5) * scale - 0.5;
        Outline { centre: Point2::new(at(0), at(1)), radius: ball.radius * scale }
    };
    let inside = |ball: &Outline| ball.centre.iter().all(|at| (0.0..f64::from(side) - 1.0).contains(at));
    let view = resized(&patch.rgb, start, Size::square(part), Size::square(side), Filter::Bilinear);
    View { views: vec![view], balls: patch.ball.map(moved).filter(inside).into_iter().collect() }
}

/// Two batches of pictures of one size as one.
pub fn joined(mut first: Batch, second: Batch) -> Batch {
    let count = first.count();
    first.pictures.extend(second.pictures);
    let Labels { picture, image, depth, depth_weight } = second.labels;
    first.labels.picture.extend(picture.into_iter().map(|index| index + count));
    first.labels.image.extend(image);
    first.labels.depth.extend(depth);
    first.labels.depth_weight.extend(depth_weight);
    first
}
