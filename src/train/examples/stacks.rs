//! The motion network's training data: stacks of frames around what moves in videos, with the ball where it is.
//!
//! What moves and is no ball teaches most: limbs, spectators, boards. Stacks are cut from footage beforehand (`gravisight stacks`), at the
//! candidates that the tracker itself proposes; balls that fly are also drawn into those without one.

use std::path::{Path, PathBuf};

use image::RgbImage;
use nalgebra::Point2;
use rand::RngExt;
use rayon::iter::{IntoParallelIterator, ParallelIterator};

use super::super::recipe::{Phase, Recipe};
use super::candidates::LabelledCrop;
use super::{Batch, Labels};
use crate::localise::verifier::{STACK_REACH, stacked};
use gravisight_geometry::camera::Outline;
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::image::Normalisation;
use gravisight_geometry::random::{Random, Stream, mixed};
use gravisight_track::STACK_SIDE;

/// Bytes of one picture of a stack, and of a record: two pictures, and x, y and radius of the ball, px of the stack, NaN without one.
const PICTURE_BYTES: usize = 3 * (STACK_SIDE * STACK_SIDE) as usize;
const RECORD_BYTES: usize = 2 * PICTURE_BYTES + 12;
/// Fraction of a batch's stacks that show a ball in the middle, and of those that have it drawn in.
const BALLS: f64 = 0.4;
const DRAWN: f64 = 0.35;
/// Largest shift of a stack as it is shown, px along each axis: a candidate's centre is not the ball's.
const SHIFT: i64 = 2;
/// Largest change of contrast (a factor) and brightness (levels), and standard deviation of the noise added at most, levels.
const CONTRAST: f64 = 1.3;
const BRIGHTNESS: f64 = 25.0;
const NOISE: f64 = 4.0;
/// Radii and speeds (px, px a frame; of the stack) of balls that are drawn in, and the fraction of the time between frames that the shutter
/// is open.
const RADII: [f64; 2] = [1.6, 4.5];
const SPEEDS: [f64; 2] = [0.7, 40.0];
const SHUTTERS: [f64; 2] = [0.03, 0.6];
/// Least difference of a drawn ball's brightness from its background, levels.
const LEAST_DIFFERENCE: f64 = 22.0;
/// Parts of an exposure.
const EXPOSURES: usize = 12;
/// Step of the seeds of what is scored with: no run is so long.
const SCORED: u64 = u64::MAX;
/// Stacks scored at a time.
const SCORED_TOGETHER: usize = 16;

/// Draws batches of stacks.
#[derive(Debug)]
pub struct Stacks {
    /// Records with a ball in the middle, and others, by file: each file counts alike, however long its video is.
    balls: Vec<Vec<Vec<u8>>>,
    others: Vec<Vec<Vec<u8>>>,
    seed: u64,
    normalisation: Normalisation,
}

/// Writes a stack's pictures and its ball (x, y and radius, px of the stack), if it shows one, as a record of a file of stacks.
pub fn stack_record(pictures: &[RgbImage; 2], ball: Option<[f64; 3]>) -> Vec<u8> {
    let mut record = Vec::with_capacity(RECORD_BYTES);
    pictures.iter().for_each(|picture| record.extend(picture.as_raw()));
    ball.unwrap_or([f64::NAN; 3]).iter().for_each(|value| record.extend((*value as f32).to_le_bytes()));
    record
}

impl Stacks {
    /// Those in the files `*.stacks` of a folder.
    ///
    /// # Errors
    /// [`Error::Io`] for a folder that cannot be read, [`Error::Data`] for one without stacks.
    pub fn new(recipe: &Recipe, folder: &Path) -> Result<Self> {
        let entries = std::fs::read_dir(folder).map_err(Error::io(folder))?;
        let paths = entries.map(|entry| entry.map(|entry| entry.path()).map_err(Error::io(folder)));
        let mut paths = paths.collect::<Result<Vec<PathBuf>>>()?;
        paths.retain(|path| path.extension().is_some_and(|extension| extension == "stacks"));
        paths.sort();
        let of_file = |path: &PathBuf| {
            let bytes = gravisight_geometry::files::read(path)?;
            Ok(bytes.chunks_exact(RECORD_BYTES).map(<[u8]>::to_vec).collect())
        };
        let videos = paths.iter().map(of_file).collect::<Result<Vec<Vec<Vec<u8>>>>>()?;
        Self::of(recipe, videos).ok_or_else(|| {
            let reason = "holds no `*.stacks` with and without a ball; make them with `gravisight stacks`".into();
            Error::Data { what: folder.display().to_string(), reason }
        })
    }

    /// Of the records of several videos; none where there are not both balls and others.
    pub fn of(recipe: &Recipe, videos: Vec<Vec<Vec<u8>>>) -> Option<Self> {
        let (mut balls, mut others) = (vec![], vec![]);
        for records in videos {
            let (of_ball, other): (Vec<_>, Vec<_>) = records.into_iter().partition(|record| is_of_ball(record));
            balls.push(of_ball);
            others.push(other);
        }
        balls.retain(|records: &Vec<Vec<u8>>| !records.is_empty());
        others.retain(|records: &Vec<Vec<u8>>| !records.is_empty());
        if balls.is_empty() || others.is_empty() {
            return None;
        }
        Some(Self { balls, others, seed: recipe.seed, normalisation: recipe.normalisation })
    }

    /// Stacks in all.
    pub fn count(&self) -> usize {
        self.balls.iter().chain(&self.others).map(Vec::len).sum()
    }

    /// The batch of step `step`: the same for the same seed and step.
    pub fn batch(&self, phase: &Phase, step: usize) -> Batch {
        let drawn = (0..phase.batch).into_par_iter();
        let drawn: Vec<LabelledCrop> =
            drawn.map(|index| self.example(mixed(self.seed, step as u64, index as u64))).collect();
        let mut batch = Batch {
            pictures: Vec::with_capacity(2 * PICTURE_BYTES * drawn.len()),
            size: [STACK_SIDE as usize; 2],
            channels: 6,
            labels: Labels::default(),
            windows: vec![],
        };
        for (index, example) in drawn.iter().enumerate() {
            batch.pictures.extend(stacked(&example.views, &self.normalisation));
            let ball = example.balls.first();
            batch.labels.picture.push(index);
            batch.labels.image.push(ball.map(|ball| ball.centre.coords.into()));
            batch.labels.depth.push(ball.map_or(1.0, |ball| ball.radius));
            batch.labels.depth_weight.push(f64::from(u8::from(ball.is_some())));
        }
        batch
    }

    /// The `index`-th group of stacks to score with, as they were cut.
    pub fn scored(&self, index: usize) -> Vec<LabelledCrop> {
        let mut random = Stream::Candidates.of(mixed(self.seed, SCORED, index as u64));
        let mut chosen = |files: &[Vec<Vec<u8>>]| LabelledCrop::of(one_of(files, &mut random));
        (0..SCORED_TOGETHER).map(|number| chosen(if number % 2 == 0 { &self.balls } else { &self.others })).collect()
    }

    fn example(&self, seed: u64) -> LabelledCrop {
        let mut random = Stream::Candidates.of(seed);
        let (has_ball, is_drawn) = (random.random_bool(BALLS), random.random_bool(DRAWN));
        let record = match (has_ball, is_drawn) {
            (true, false) => one_of(&self.balls, &mut random),
            _ => one_of(&self.others, &mut random),
        };
        let mut example = LabelledCrop::of(record);
        if has_ball && is_drawn && example.balls.is_empty() {
            draw_ball(&mut example, &mut random);
        }
        change(&mut example, &mut random);
        example
    }
}

/// A random record of a random file.
fn one_of<'a>(files: &'a [Vec<Vec<u8>>], random: &mut Random) -> &'a [u8] {
    let records = &files[random.random_range(0..files.len())];
    &records[random.random_range(0..records.len())]
}

/// Whether a record shows a ball in the middle.
fn is_of_ball(record: &[u8]) -> bool {
    let middle = f64::from(STACK_SIDE - 1) / 2.0;
    ball_of(record).is_some_and(|[x, y, _]| (x - middle).hypot(y - middle) < STACK_REACH)
}

/// The ball of a record.
fn ball_of(record: &[u8]) -> Option<[f64; 3]> {
    let number = |index: usize| {
        let bytes = &record[2 * PICTURE_BYTES + 4 * index..][..4];
        f64::from(f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
    };
    let ball = [0, 1, 2].map(number);
    ball.iter().all(|value| value.is_finite()).then_some(ball)
}

impl LabelledCrop {
    /// The stack of a record.
    pub fn of(record: &[u8]) -> Self {
        let picture = |number: usize| {
            let bytes = record[number * PICTURE_BYTES..][..PICTURE_BYTES].to_vec();
            RgbImage::from_raw(STACK_SIDE, STACK_SIDE, bytes).unwrap_or_default()
        };
        let outline = |[x, y, radius]: [f64; 3]| Outline { centre: Point2::new(x, y), radius };
        // A ball that is elsewhere in the frame is none of the stack's.
        let inside = |ball: &[f64; 3]| ball[..2].iter().all(|at| (-0.5..f64::from(STACK_SIDE) - 0.5).contains(at));
        let balls = ball_of(record).filter(inside).map(outline);
        Self { views: [picture(0), picture(1)], balls: balls.into_iter().collect() }
    }
}

/// The picture and channel of a stack that hold the brightness of frame `number`, of five.
fn channel_of(number: usize) -> (usize, usize) {
    if number < 3 { (0, number) } else { (1, number - 3) }
}

/// Draws a ball that flies into a stack, in the middle in the third of its frames.
fn draw_ball(example: &mut LabelledCrop, random: &mut Random) {
    let between = |random: &mut Random, [least, most]: [f64; 2]| random.random_range(least.ln()..most.ln()).exp();
    let middle = f64::from(STACK_SIDE - 1) / 2.0;
    let centre = [0, 1].map(|_: i32| middle + random.random_range(-1.5..1.5));
    let (radius, speed, shutter) = (between(random, RADII), between(random, SPEEDS), between(random, SHUTTERS));
    let direction = random.random_range(0.0..std::f64::consts::TAU);
    let velocity = [speed * direction.cos(), speed * direction.sin()];
    let bend = [0, 1].map(|_: i32| random.random_range(-0.1..0.1) * speed);
    let background = f64::from(example.views[0].get_pixel(STACK_SIDE / 2, STACK_SIDE / 2)[2]);
    let brightness = loop {
        let level = random.random_range(10.0..250.0);
        if f64::abs(level - background) > LEAST_DIFFERENCE {
            break level;
        }
    };
    let shade = random.random_range(0.0..0.35);
    let tint: f64 = random.random_range(60.0..190.0);
    for number in 0..5 {
        let time = number as f64 - 2.0;
        let (picture, channel) = channel_of(number);
        let coverage = coverage(radius, |part: f64| {
            let at = time + (part - 0.5) * shutter;
            [0, 1].map(|axis| centre[axis] + velocity[axis] * at + bend[axis] * at * at / 2.0)
        });
        for (index, &(covered, height)) in coverage.iter().enumerate() {
            let (x, y) = (index as u32 % STACK_SIDE, index as u32 / STACK_SIDE);
            let blend = |level: &mut u8, of_ball: f64| {
                *level = (f64::from(*level) * (1.0 - covered) + of_ball * covered).clamp(0.0, 255.0) as u8;
            };
            // Lit from above.
            blend(&mut example.views[picture].get_pixel_mut(x, y)[channel], brightness * (1.0 - shade * height));
            if number == 2 {
                blend(&mut example.views[1].get_pixel_mut(x, y)[2], tint);
            }
        }
    }
    example.balls = vec![Outline { centre: centre.into(), radius }];
}

/// How much of each pixel a ball covers while the shutter is open, and how far down on it that is, -1 to 1.
fn coverage(radius: f64, place: impl Fn(f64) -> [f64; 2]) -> Vec<(f64, f64)> {
    let mut coverage = vec![(0.0, 0.0); (STACK_SIDE * STACK_SIDE) as usize];
    for part in 0..EXPOSURES {
        let [u, v] = place((part as f64 + 0.5) / EXPOSURES as f64);
        let range = |at: f64| {
            let bound = |value: f64| value.clamp(0.0, f64::from(STACK_SIDE)) as u32;
            bound(at - radius - 1.0)..bound(at + radius + 2.0)
        };
        for y in range(v) {
            for x in range(u) {
                let off = (f64::from(x) - u).hypot(f64::from(y) - v);
                let covered = (radius - off + 0.5).clamp(0.0, 1.0) / EXPOSURES as f64;
                let pixel = &mut coverage[(y * STACK_SIDE + x) as usize];
                *pixel = (pixel.0 + covered, (f64::from(y) - v) / radius);
            }
        }
    }
    coverage
}

/// Shows a stack otherwise: mirrored, in reverse, shifted, brighter or darker.
fn change(example: &mut LabelledCrop, random: &mut Random) {
    let (mirrored, reversed) = (random.random_bool(0.5), random.random_bool(0.5));
    let shift = [0, 1].map(|_: i32| random.random_range(-SHIFT..=SHIFT));
    let contrast = random.random_range(-CONTRAST.ln()..CONTRAST.ln()).exp();
    let brightness = random.random_range(-BRIGHTNESS..BRIGHTNESS);
    let noise = random.random_range(0.0..NOISE) * f64::from(u8::from(random.random_bool(0.5)));
    let old = example.views.clone();
    let last = i64::from(STACK_SIDE) - 1;
    let from = |x: u32, y: u32| {
        let x = if mirrored { last - i64::from(x) } else { i64::from(x) };
        [x - shift[0], i64::from(y) - shift[1]].map(|at| at.clamp(0, last) as u32)
    };
    for (view, picture) in example.views.iter_mut().enumerate() {
        for (x, y, pixel) in picture.enumerate_pixels_mut() {
            let [u, v] = from(x, y);
            for channel in 0..3 {
                let is_colour = view == 1 && channel == 2;
                let number = if view == 0 { channel } else { channel + 3 };
                let (of, at) = match (is_colour, reversed) {
                    (true, _) => (1, 2),
                    (false, true) => channel_of(4 - number),
                    (false, false) => channel_of(number),
                };
                let level = f64::from(old[of].get_pixel(u, v)[at]);
                let level = if is_colour { level } else { (level - 128.0) * contrast + 128.0 + brightness };
                let level = if noise > 0.0 { level + random.random_range(-noise..noise) } else { level };
                pixel[channel] = level.clamp(0.0, 255.0) as u8;
            }
        }
    }
    for ball in &mut example.balls {
        let x = ball.centre.x + shift[0] as f64;
        ball.centre = Point2::new(if mirrored { last as f64 - x } else { x }, ball.centre.y + shift[1] as f64);
    }
}
