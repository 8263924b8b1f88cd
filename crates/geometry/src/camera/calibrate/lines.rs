//! A court's painted lines, which pull the camera that clicks gave to a fraction of a pixel.
//!
//! Lines that fit worse than they should count as much less (Helmert's estimation of variance components).
//!
//! Where each line is expected, the picture is searched across it, as far as the camera is unsure there; straight lines that most
//! samples speak for count, with the clicks, in one least-squares problem; and again with what that camera expects.

use nalgebra::{DVector, Point2, Point3, Vector2};

use serde::Serialize;

use super::lens::{NO_LENS, two_sided};
use super::paint::{Expected, Grey, SIGNS, find};
use super::refine::{Guess, Refined, Seen, refine};
use super::{Calibration, Points, Problem, Unknowns, check_lens, refuse, with_found_lens};
use crate::camera::court::CourtLine;
use crate::camera::fold::Range;
use crate::error::Result;
use crate::image::Picture;
use crate::size::Size;

/// How often lines are searched and the camera moved.
const ROUNDS: usize = 6;
/// Samples of a line.
const SPACING: Spacing = Spacing { every: 3.0, most: 250 };
/// A line with fewer is too short.
const LEAST_SAMPLES: usize = 12;
/// Steps in which a line's length in the picture is measured.
const STEPS: usize = 64;
/// Share of a line over which its direction in the picture is taken.
const A_LITTLE: f64 = 1e-3;
/// A line of less is not searched, px: it cannot be seen.
const LEAST_WIDTH: f64 = 0.3;
/// Search no less and no more than this, px, and so many σ.
const LEAST_SEARCH: f64 = 2.5;
const MOST_SEARCH: f64 = 40.0;
const SIGMAS: f64 = 3.0;
/// 1-σ of one sample, px; of all of a line alike: of what is seen, px, and of where it was painted, as a share of its width.
const SAMPLE_SIGMA: f64 = 0.4;
const LINE_SIGMA: f64 = 0.12;
const PAINTED_SIGMA: f64 = 0.08;
/// A line's samples tell two things, however many they are: its offset and its tilt.
const PER_LINE: f64 = 2.0;
/// The share of what is told that is not used up by the unknowns is not taken to be less.
const LEAST_REDUNDANCY: f64 = 0.1;
/// Found lines that are needed.
const FEWEST_LINES: usize = 3;
/// Clicks that would still be unlike each other at this share of their distance from where the lines say are not of this camera.
const FAR_OFF: f64 = 0.5;

/// A painted line as a calibration by lines saw it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct LineSeen {
    /// Its index in the court's lines.
    pub index: usize,
    /// Whether the picture should show it.
    pub is_expected: bool,
    /// Share of its samples in the picture that speak for it; 0 where it was not found.
    pub share: f64,
    /// Root mean square distance of these from where the camera puts the line, px; 0 where it was not found.
    pub rms_px: f64,
}

/// As [`calibrate`](super::calibrate()), with the court's lines that are painted on what `picture` shows: four to six clicks are
/// enough. [`Calibration::lines`] says which were found. What the clicks alone cannot tell (a lens's distortion) the lines may.
///
/// # Errors
/// As [`calibrate`](super::calibrate()); [`Error::Calibration`](crate::error::Error::Calibration) where [`Points::lines`] is empty, too few
/// lines are found, they disagree with the clicks, or the picture has another size than the points.
pub fn calibrate_by_lines(points: &Points, unknowns: &Unknowns, picture: &Picture) -> Result<Calibration> {
    if points.lines.is_empty() {
        return Err(refuse("there is no painted line to look for: give a `court` whose lines are known, or `lines`"));
    }
    if picture.size() != points.size {
        let (shown, clicked) = (picture.size(), points.size);
        return Err(refuse(format!(
            "the picture with the lines is {shown} px, but the clicks are for a picture of {clicked} px"
        )));
    }
    let unknowns = &with_found_lens(points, unknowns);
    check_lens(points, unknowns)?;
    let whole = Problem::new(points, unknowns);
    // First what the clicks can tell.
    let clicked = Problem::new(points, &Unknowns { focal: unknowns.focal, ..Unknowns::default() });
    let (mut problem, ((start, method), outliers)) = clicked.by_clicks_and_lens()?;
    let noise = problem.noise(&start, &outliers);
    let click = |index| Seen {
        weight: noise.variance().sqrt().recip(),
        ..Seen::click(points.world[index], points.image[index])
    };
    let clicks: Vec<Seen> = (0..points.image.len()).filter(|index| !outliers.contains(index)).map(click).collect();

    let grey = Grey::of(picture.rgb());
    let mut camera = refine(start.guess, &problem.unknowns, &clicks).unwrap_or(start);
    let mut lines = Vec::new();
    // By how much the lines are farther off than they should be: so much less they count.
    let mut stretch = 1.0;
    for round in 0..ROUNDS {
        lines = problem.searched(&camera, stretch, &grey);
        if 2 * round >= ROUNDS && lines.len() >= FEWEST_LINES {
            let distortion = problem.unknowns.distortion.max(whole.unknowns.distortion);
            problem.unknowns = Unknowns { distortion, ..whole.unknowns };
        }
        let of_lines = lines.iter().flat_map(|line| line.seen.iter().copied());
        let seen: Vec<Seen> = of_lines.chain(clicks.iter().copied()).collect();
        let moved_by =
            |unknowns: &Unknowns| refine(camera.guess, unknowns, &seen).filter(|moved| moved.covariance.is_some());
        let Some(moved) = moved_by(&problem.unknowns) else { break };
        // Bowed lines ask for the lens.
        let bent = Unknowns { distortion: 1, ..problem.unknowns };
        let freedom = (PER_LINE as usize * lines.len() + 2 * clicks.len()).saturating_sub(bent.count());
        let with_lens = moved_by(&bent).filter(|bent| {
            let asked = 2 * round >= ROUNDS && lines.len() >= FEWEST_LINES && problem.unknowns.distortion == 0;
            let variance = (bent.cost / freedom.max(1) as f64).max(1.0);
            let better = (moved.cost - bent.cost).max(0.0);
            let pays = freedom > 0 && two_sided((better / variance).sqrt(), freedom) < NO_LENS;
            let reaches = bent.guess.camera(points.size).is_ok_and(|camera| camera.sees_its_corners());
            asked && points.distortion.is_none() && pays && reaches
        });
        if with_lens.is_some() {
            problem.unknowns = bent;
        }
        camera = with_lens.unwrap_or(moved);
        let told = PER_LINE * lines.len() as f64 + 2.0 * clicks.len() as f64;
        let redundancy = (1.0 - problem.unknowns.count() as f64 / told).max(LEAST_REDUNDANCY);
        let misfit = |line: &Painted| {
            let (_, rms) = line.off(&camera.guess, &problem.unknowns);
            (rms.powi(2) - SAMPLE_SIGMA.powi(2)).max(0.0) / (line.sigma / stretch).powi(2)
        };
        let misfits = lines.iter().map(misfit).sum::<f64>() / lines.len().max(1) as f64;
        stretch = (misfits / redundancy).sqrt().max(1.0);
    }
    if lines.len() < FEWEST_LINES {
        return Err(refuse(format!(
            "of {} painted lines, {} were found where the clicks put them, but {FEWEST_LINES} are needed; click more exactly, \
             or calibrate without the lines",
            points.lines.len(),
            lines.len()
        )));
    }
    let seen = (0..points.lines.len())
        .map(|index| match lines.iter().find(|line| line.index == index) {
            Some(line) => {
                let rms_px = line.off(&camera.guess, &problem.unknowns).1;
                LineSeen { index, is_expected: true, share: line.share, rms_px }
            }
            None => {
                let is_expected = problem.samples(&camera, &points.lines[index]).is_some();
                LineSeen { index, is_expected, share: 0.0, rms_px: 0.0 }
            }
        })
        .collect();
    // Lines farther off than they should be say that all is.
    let apart = |line: &Painted| (line.off(&camera.guess, &problem.unknowns).0 / line.sigma).powi(2);
    let variance = (lines.iter().map(apart).sum::<f64>() / lines.len() as f64).max(1.0);
    let mut result = problem.result((camera, method), outliers, noise, variance)?;
    if result.are_clicks_unlike(FAR_OFF) {
        return Err(refuse(format!(
            "the clicks are {:.1} px (root mean square) from where the detected lines put them: they may be another court's lines, or \
             the clicks may be on the wrong points; correct the clicks, or calibrate without the lines",
            result.rms_px
        )));
    }
    result.lines = seen;
    result.concluded(points)
}

/// How a line is sampled.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spacing {
    /// Distance of samples, px.
    pub every: f64,
    /// Most samples of a line.
    pub most: usize,
}

/// A world point's image, px, and its derivatives.
pub(super) type Look<'a, D> = dyn Fn(&Point3<f64>) -> Option<(Point2<f64>, D)> + 'a;

/// A line that is expected in the picture.
pub(super) struct Line {
    /// Its index in the court's lines.
    pub index: usize,
    /// How wide the paint is, m.
    pub width: f64,
    pub samples: Vec<LineSample>,
}

/// A line that was found.
pub(super) struct Painted {
    index: usize,
    pub seen: Vec<Seen>,
    share: f64,
    /// 1-σ of all its samples alike, px.
    sigma: f64,
}

impl Painted {
    /// Mean distance of its samples from where a camera puts the line, px, and their root mean square.
    fn off(&self, guess: &Guess, unknowns: &Unknowns) -> (f64, f64) {
        let range = Range::of(&guess.distortion);
        let distance = |seen: &Seen| {
            let (error, _) = guess.error(&range, unknowns, &seen.world, &seen.image)?;
            seen.across.map(|across| across.dot(&error))
        };
        let all: Vec<f64> = self.seen.iter().filter_map(distance).collect();
        let count = all.len().max(1) as f64;
        (all.iter().sum::<f64>() / count, (all.iter().map(|off| off * off).sum::<f64>() / count).sqrt())
    }
}

/// A sample of a line: what the rules measure to, m; where it and the paint's middle are expected; 1-σ of the latter, px; pixels a
/// metre across the line.
#[derive(Debug)]
pub(super) struct LineSample {
    world: Point3<f64>,
    image: Point2<f64>,
    expected: Expected,
    sigma: f64,
    scale: f64,
}

impl LineSample {
    /// Samples of what a picture shows of a line; [`None`] of one that is too short or thin there. `look` tells a point's image, px, and its
    /// derivatives; `unsure` how far off (1-σ, px) it may be across the line.
    pub(super) fn of<D>(
        line: &CourtLine,
        size: Size,
        spacing: Spacing,
        look: &Look<'_, D>,
        unsure: &dyn Fn(&Vector2<f64>, &D) -> f64,
    ) -> Option<Vec<Self>> {
        let by_edge = line.paint.is_some();
        let image = |world: &Point3<f64>| Some(look(world)?.0);
        // What the rules measure to.
        let place = |share: f64| {
            let edges = line.edges(share)?;
            Some(if by_edge { edges[0] } else { nalgebra::center(&edges[0], &edges[1]) })
        };
        let shares = spaced(&|share| image(&place(share)?).filter(|at| within(at, size)), spacing)?;
        let sample = |share: f64| {
            let world = place(share)?;
            let edges = line.edges(share)?;
            let (middle, derivatives) = look(&nalgebra::center(&edges[0], &edges[1]))?;
            let along = image(&place(share + A_LITTLE)?)? - image(&place(share - A_LITTLE)?)?;
            let across = Vector2::new(-along.y, along.x).try_normalize(0.0)?;
            let width = across.dot(&(image(&edges[1])? - image(&edges[0])?));
            let across = across * width.signum();
            let expected = Expected { share, middle, across, half: width.abs() / 2.0, by_edge };
            let sigma = unsure(&across, &derivatives);
            Some(Self { world, image: image(&world)?, expected, sigma, scale: width.abs() / line.width })
        };
        let samples: Vec<Self> = shares.into_iter().filter_map(sample).collect();
        let width = samples.iter().map(|sample| 2.0 * sample.expected.half).sum::<f64>() / samples.len().max(1) as f64;
        (samples.len() >= LEAST_SAMPLES && width >= LEAST_WIDTH).then_some(samples)
    }
}

impl Line {
    /// The line as the picture shows it, `stretch` times as unsure as usual; `sign` is one of [`SIGNS`].
    fn found(&self, grey: &Grey, stretch: f64, sign: f32) -> Option<Painted> {
        let samples = &self.samples;
        let unsure = samples.iter().map(|sample| sample.sigma).fold(0.0, f64::max);
        let reach = SIGMAS * unsure + LEAST_SEARCH;
        if reach > MOST_SEARCH {
            return None;
        }
        let expected: Vec<Expected> = samples.iter().map(|sample| sample.expected).collect();
        let found = find(grey, &expected, reach, sign)?;
        let scale = samples.iter().map(|sample| sample.scale).sum::<f64>() / samples.len() as f64;
        let sigma = stretch * LINE_SIGMA.hypot(PAINTED_SIGMA * scale * self.width);
        let weight = 1.0 / SAMPLE_SIGMA.hypot(sigma * (found.len() as f64 / PER_LINE).sqrt());
        let seen = found.iter().map(|&(number, offset)| {
            let LineSample { world, image, expected: Expected { across, .. }, .. } = samples[number];
            Seen { world, image: image + across * offset, across: Some(across), weight }
        });
        let share = found.len() as f64 / samples.len() as f64;
        Some(Painted { index: self.index, seen: seen.collect(), share, sigma })
    }
}

/// Those of the lines that the picture shows, `stretch` times as unsure as usual: all bright or all dark, since they are of the same paint.
/// Beside a bright line, the ground between it and something else that is bright looks like a dark one.
pub(super) fn found(lines: &[Line], grey: &Grey, stretch: f64) -> Vec<Painted> {
    let of_sign =
        |sign: f32| -> Vec<Painted> { lines.iter().filter_map(|line| line.found(grey, stretch, sign)).collect() };
    let samples = |found: &Vec<Painted>| found.iter().map(|line| line.seen.len()).sum::<usize>();
    let [bright, dark] = SIGNS.map(of_sign);
    if samples(&dark) > samples(&bright) { dark } else { bright }
}

impl Problem<'_> {
    /// The lines as the picture shows them, `stretch` times as unsure as usual.
    fn searched(&self, camera: &Refined, stretch: f64, grey: &Grey) -> Vec<Painted> {
        let lines = self.points.lines.iter().enumerate();
        let expected = |(index, line): (usize, &CourtLine)| {
            Some(Line { index, width: line.width, samples: self.samples(camera, line)? })
        };
        found(&lines.filter_map(expected).collect::<Vec<_>>(), grey, stretch)
    }

    /// Samples of what the picture shows of a line; [`None`] of one that is too short or thin there.
    fn samples(&self, camera: &Refined, line: &CourtLine) -> Option<Vec<LineSample>> {
        let guess = &camera.guess;
        let covariance = camera.covariance.as_ref()?;
        let range = Range::of(&guess.distortion);
        let look = |world: &Point3<f64>| {
            let (image, derivatives) = guess.error(&range, &self.unknowns, world, &Point2::origin())?;
            Some((image.into(), derivatives))
        };
        let unsure = |across: &Vector2<f64>, derivatives: &Vec<Vector2<f64>>| {
            let row = DVector::from_iterator(derivatives.len(), derivatives.iter().map(|by| across.dot(by)));
            row.dot(&(covariance * &row)).max(0.0).sqrt()
        };
        LineSample::of(line, self.points.size, SPACING, &look, &unsure)
    }
}

fn within(at: &Point2<f64>, size: Size) -> bool {
    let [width, height] = size.xy();
    at.x >= 0.0 && at.y >= 0.0 && at.x <= width - 1.0 && at.y <= height - 1.0
}

/// Places along a line (0 to 1) evenly spaced in the picture, where it shows them; [`None`] where that is too little.
fn spaced(image: &dyn Fn(f64) -> Option<Point2<f64>>, spacing: Spacing) -> Option<Vec<f64>> {
    let share = |step: usize| step as f64 / STEPS as f64;
    let places: Vec<Option<Point2<f64>>> = (0..=STEPS).map(|step| image(share(step))).collect();
    let lengths: Vec<f64> =
        (places.windows(2)).map(|pair| if let [Some(a), Some(b)] = pair { (b - a).norm() } else { 0.0 }).collect();
    let length: f64 = lengths.iter().sum();
    let count = ((length / spacing.every) as usize).min(spacing.most);
    if count < LEAST_SAMPLES {
        return None;
    }
    let mut shares = Vec::new();
    let (mut step, mut before) = (0, 0.0);
    for number in 0..count {
        let at = length * (number as f64 + 0.5) / count as f64;
        while step + 1 < STEPS && before + lengths[step] < at {
            before += lengths[step];
            step += 1;
        }
        shares.push(share(step) + (at - before) / lengths[step].max(f64::MIN_POSITIVE) / STEPS as f64);
    }
    Some(shares)
}
