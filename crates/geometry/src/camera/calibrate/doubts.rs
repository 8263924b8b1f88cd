//! What about a calibrated camera cannot be, or hardly: words for whoever clicked.

use nalgebra::{Point2, Point3, Vector2};

use super::{Calibration, Points, Unknowns, calibrated};
use crate::camera::Camera;
use crate::camera::doubts::LARGEST_BALL;

/// Below the ground by more than this, m, and so many σ.
const BELOW: f64 = 0.1;
const SIGMAS: f64 = 3.0;
/// A lens that moves the picture's corners by more than this share is none that cameras have without being a fisheye.
const BENT: f64 = 0.4;
/// Widest and narrowest picture, degrees.
const WIDEST: f64 = 130.0;
const NARROWEST: f64 = 1.0;
/// The camera's place is unsure by more than this share of its distance.
const VAGUE: f64 = 0.2;
/// Clicks' standard deviation from which something else is wrong, as a share of the picture's width: 10 px of 1920.
const ROUGH: f64 = 0.005;
/// What a careful click is off, px; and how many times better a court must fit that is seen from its side.
const CLICK: f64 = 2.0;
const TURNED: f64 = 3.0;
/// Share of the lines in the picture that may be missing.
const MISSING: f64 = 0.15;

/// Distance from a line within which points count as on it, a share of what they span.
const ON_LINE: f64 = 1e-3;

impl Camera {
    /// How far the lens moves the picture's corners at most, as a share of their way from the axis; none where it does not reach them.
    fn bend_of_corners(&self) -> Option<f64> {
        let [width, height] = self.size().xy();
        let inverse = self.intrinsic().try_inverse()?;
        let mut most: f64 = 0.0;
        for corner in [[0.0, 0.0], [width - 1.0, 0.0], [0.0, height - 1.0], [width - 1.0, height - 1.0]] {
            let seen: Vector2<f64> = (inverse * Point2::from(corner).coords.push(1.0)).xy();
            let ideal = self.distortion().undistort(seen).ok()?;
            most = most.max((seen - ideal).norm() / ideal.norm().max(f64::MIN_POSITIVE));
        }
        Some(most)
    }

    /// Whether the lens reaches the picture's corners, and bends them as lenses do.
    pub(super) fn sees_its_corners(&self) -> bool {
        self.bend_of_corners().is_some_and(|most| most <= BENT)
    }
}

impl Calibration {
    /// What is doubtful about the camera, in words: points in another unit, below the ground, a lens that no camera has, lines that
    /// are not where they should be. Empty where nothing is.
    pub(super) fn doubts_of(&self, points: &Points) -> Vec<String> {
        [
            self.unit(points),
            self.below(points),
            self.lens(),
            self.width(),
            self.vague(points),
            self.rough(points),
            self.turned(points),
            self.missing(),
            self.unlike(),
        ]
        .into_iter()
        .flatten()
        .collect()
    }

    fn unit(&self, points: &Points) -> Option<String> {
        let distance = self.mean_depth(points);
        let pixel = distance / self.camera.intrinsic()[(0, 0)];
        (pixel > LARGEST_BALL).then(|| {
            format!(
                "the points are {distance:.0} m from the camera, where a pixel covers {pixel:.2} m, too coarse to show a ball: is \
                 `world` in centimetres or millimetres instead of metres? If so, divide its numbers by 100 or 1000"
            )
        })
    }

    fn below(&self, points: &Points) -> Option<String> {
        let ground = points.world.iter().map(|point| point.z).fold(0.0, f64::min);
        let below = ground - self.centre.z;
        (below > BELOW.max(SIGMAS * self.sigma.centre.z)).then(|| {
            format!("the camera is {below:.1} m below the ground: are near and far, or left and right, swapped?")
        })
    }

    fn lens(&self) -> Option<String> {
        // No calibration finds a fisheye: it was given.
        if self.camera.distortion().is_fisheye() {
            return None;
        }
        match self.camera.bend_of_corners() {
            None => Some(
                "the estimated lens does not cover the picture's corners: estimate fewer distortion coefficients, or \
                 add points near the corners"
                    .into(),
            ),
            Some(most) => (most > BENT).then(|| {
                format!(
                    "the estimated lens distorts the picture's corners by {:.0} %: estimate fewer distortion \
                     coefficients, or add points near the corners",
                    100.0 * most
                )
            }),
        }
    }

    fn width(&self) -> Option<String> {
        let degrees = self.camera.field_of_view();
        (!(NARROWEST..=WIDEST).contains(&degrees)).then(|| {
            format!("the picture is {degrees:.1}° wide, which is implausible: give `intrinsic`, or add points at other depths")
        })
    }

    fn vague(&self, points: &Points) -> Option<String> {
        let distance = self.mean_depth(points);
        let sigma = self.sigma.centre.norm();
        (sigma > VAGUE * distance).then(|| {
            format!(
                "the clicks determine the camera's position only to ± {sigma:.1} m: add points farther apart, at \
                     other depths or heights"
            )
        })
    }

    fn rough(&self, points: &Points) -> Option<String> {
        let known =
            if points.intrinsic.is_some() { "is `intrinsic` for this camera and this picture size? " } else { "" };
        (self.noise_px > ROUGH * self.camera.size().xy()[0]).then(|| {
            format!(
                "the best camera misses the clicks by {:.0} px (root mean square), far more than a click's error: {known}Is every click on \
                 the right point?",
                self.rms_px
            )
        })
    }

    /// Whether the clicks fit better where near and far are taken for left and right: a table seen from its side.
    fn turned(&self, points: &Points) -> Option<String> {
        let most = |axis: usize| points.world.iter().map(|point| point[axis].abs()).fold(0.0, f64::max);
        let [x, y] = [most(0), most(1)];
        let is_corner = |point: &Point3<f64>| (point.x.abs(), point.y.abs()) == (x, y);
        if points.names.is_empty() || x == y || self.rms_px < CLICK || !points.world.iter().all(is_corner) {
            return None;
        }
        // A quarter of a turn, each corner onto the next one.
        let world = points.world.iter().map(|point| Point3::new(-point.y * x / y, point.x * y / x, point.z)).collect();
        let turned = calibrated(&Points { world, ..points.clone() }, &Unknowns::default()).ok()?;
        (TURNED * turned.rms_px < self.rms_px && turned.centre.z > 0.0).then(|| {
            format!(
                "the clicks are {:.1} px off as they are named, but only {:.1} px if the court is turned by 90°: its near end is fixed by \
                 the court's rules, not by where the camera stands (`gravisight calibrate --list` shows the points)",
                self.rms_px, turned.rms_px
            )
        })
    }

    fn unlike(&self) -> Option<String> {
        (!self.lines.is_empty() && self.are_clicks_unlike(1.0)).then(|| {
            format!(
                "the clicks are {:.1} px (root mean square) from where the painted lines put their points: is this the right court, and \
                 is every click on the right point?",
                self.rms_px
            )
        })
    }

    fn missing(&self) -> Option<String> {
        let expected: Vec<_> = self.lines.iter().filter(|line| line.is_expected).collect();
        let missing = expected.iter().filter(|line| line.share == 0.0).count();
        (missing as f64 > MISSING * expected.len() as f64).then(|| {
            format!(
                "{missing} of {} painted lines that the picture should show are not where this camera puts them: is every click on the \
                 right point?",
                expected.len()
            )
        })
    }
}

/// How many of the points (m) at most lie on one line.
pub(super) fn on_a_line(points: &[Point3<f64>]) -> usize {
    let length = points.iter().map(|point| (point - points[0]).norm()).fold(0.0, f64::max);
    let through = |from: &Point3<f64>, to: &Point3<f64>| {
        let along = (to - from).try_normalize(ON_LINE * length)?;
        Some(points.iter().filter(|point| (*point - from).cross(&along).norm() <= ON_LINE * length).count())
    };
    let pairs =
        points.iter().enumerate().flat_map(|(index, from)| points[index + 1..].iter().map(move |to| (from, to)));
    pairs.filter_map(|(from, to)| through(from, to)).max().unwrap_or(points.len())
}
