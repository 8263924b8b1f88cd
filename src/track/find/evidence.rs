//! What speaks for a circle being the ball: its inside.

use image::RgbImage;

use super::background::Background;
use crate::contour::{Circle, Contour};
use crate::image::{Levels, levels_at};
use crate::statistics::median;

/// Rings of samples inside a circle, and samples on each.
const RINGS: usize = 5;
const SAMPLES: usize = 16;
/// Radius of the outermost ring, in radii: within, edges' blur does not reach.
const OUTERMOST: f64 = 0.8;
/// Radius of the ring about a circle, in radii, and least distance between the two, px; samples on it.
const RING: f64 = 1.3;
const RING_PX: f64 = 2.5;
const RING_SAMPLES: usize = 32;
/// Share of the difference from the background that one factor for all pixels and channels may leave unexplained
/// in a shadow.
const SHADE: f32 = 0.03;

// What speaks for and against a circle, logs of odds, tuned by hand on rendered clips.
/// A whole outline's gain over one of which so much is there that nothing speaks for or against it.
const COVERED: f64 = 8.0;
const HALF_COVERED: f64 = 0.45;
/// Radius from which an outline's edge has pixels enough that noise does not make it, px.
const SURE_RADIUS: f64 = 5.0;
/// Against each pixel of rms above that of a sharp outline: ball and shadow taken for one circle have more.
const BLURRED: f64 = 4.0;
const SHARP: f64 = 0.25;
/// Against what lies inside another thing, a spot on it: by the share of the ring about it that is not background.
const SPOT: f64 = 6.0;
const HALF_SURROUNDED: f64 = 0.6;
/// For an inside that is not background.
const CHANGED: f64 = 2.0;
const HALF_CHANGED: f64 = 0.6;
/// Against a shadow.
const SHADED: f64 = 4.0;

/// A circle that may be the ball.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    pub outline: Contour,
    /// Median colour of what is not background inside.
    pub colour: Levels,
    /// Share of the inside that is not background, 0..1.
    pub changed: f64,
    /// Share of a ring about it that is not background, 0..1.
    pub surround: f64,
    /// How much the inside looks like the background in a shadow, 0..1.
    pub shade: f64,
    /// Log of the odds that it is the ball, so far as the circle itself tells.
    pub gain: f64,
}

impl Candidate {
    pub fn of(outline: Contour, frame: &RgbImage, background: &Background) -> Self {
        let differs = |place: &&(usize, usize)| background.differs(frame, place.0, place.1);
        let inside = inside(&outline.circle, frame);
        let mut changed: Vec<Levels> = inside.iter().filter(differs).map(|&(x, y)| levels_at(frame, x, y)).collect();
        let share = changed.len() as f64 / inside.len().max(1) as f64;
        if changed.is_empty() {
            changed = inside.iter().map(|&(x, y)| levels_at(frame, x, y)).collect();
        }
        let colour = median_colour(&changed);
        let ring = ring(&outline.circle, frame);
        let surround = ring.iter().filter(differs).count();
        let surround = surround as f64 / ring.len().max(1) as f64;
        let shade = background.still.as_ref().map_or(0.0, |still| {
            let pairs: Vec<[Levels; 2]> =
                inside.iter().map(|&(x, y)| [levels_at(frame, x, y), levels_at(still, x, y)]).collect();
            shade(&pairs)
        });
        let mut candidate = Self { outline, colour, changed: share, surround, shade, gain: 0.0 };
        candidate.gain = candidate.shape_gain();
        candidate
    }

    /// Log of the odds by the outline and the inside's difference from the background.
    fn shape_gain(&self) -> f64 {
        let Contour { circle, coverage, rms, .. } = self.outline;
        let outline = COVERED * (coverage - HALF_COVERED) * (circle.radius / SURE_RADIUS).min(1.0);
        let blurred = BLURRED * (rms - SHARP).max(0.0);
        let spot = SPOT * (self.surround - HALF_SURROUNDED).max(0.0);
        outline - blurred - spot + CHANGED * (self.changed - HALF_CHANGED) - SHADED * self.shade
    }
}

/// Pixels inside a circle and the picture, evenly spread.
fn inside(circle: &Circle, frame: &RgbImage) -> Vec<(usize, usize)> {
    let mut pixels = Vec::with_capacity(RINGS * SAMPLES);
    for ring in 0..RINGS {
        // Rings of equal areas.
        let distance = OUTERMOST * circle.radius * ((ring as f64 + 0.5) / RINGS as f64).sqrt();
        for sample in 0..SAMPLES {
            let (sin, cos) = (std::f64::consts::TAU * sample as f64 / SAMPLES as f64).sin_cos();
            pixels.extend(pixel(circle.x + distance * cos, circle.y + distance * sin, frame));
        }
    }
    pixels
}

/// Pixels on a ring about a circle.
fn ring(circle: &Circle, frame: &RgbImage) -> Vec<(usize, usize)> {
    let distance = (RING * circle.radius).max(circle.radius + RING_PX);
    let place = |sample: usize| {
        let (sin, cos) = (std::f64::consts::TAU * sample as f64 / RING_SAMPLES as f64).sin_cos();
        pixel(circle.x + distance * cos, circle.y + distance * sin, frame)
    };
    (0..RING_SAMPLES).filter_map(place).collect()
}

/// The pixel at a place in the picture.
fn pixel(x: f64, y: f64, frame: &RgbImage) -> Option<(usize, usize)> {
    let (x, y) = (x.round(), y.round());
    let inside = x >= 0.0 && y >= 0.0 && x < f64::from(frame.width()) && y < f64::from(frame.height());
    inside.then_some((x as usize, y as usize))
}

/// Median of each channel; black of nothing.
pub(super) fn median_colour(colours: &[Levels]) -> Levels {
    let channel = |channel: usize| colours.iter().map(move |colour| f64::from(colour[channel]));
    std::array::from_fn(|number| median(channel(number)).unwrap_or_default() as f32)
}

/// How well one factor below 1 makes the frame's pixels of the background's, 0..1.
fn shade(pairs: &[[Levels; 2]]) -> f64 {
    let (mut cross, mut square) = (0.0_f32, f32::MIN_POSITIVE);
    for [frame, still] in pairs {
        for channel in 0..3 {
            cross += frame[channel] * still[channel];
            square += still[channel] * still[channel];
        }
    }
    let factor = cross / square;
    if !(0.2..1.0).contains(&factor) {
        return 0.0;
    }
    let (mut left, mut all) = (0.0_f32, f32::MIN_POSITIVE);
    for [frame, still] in pairs {
        for channel in 0..3 {
            left += (frame[channel] - factor * still[channel]).powi(2);
            all += (frame[channel] - still[channel]).powi(2);
        }
    }
    f64::from((-left / all / SHADE).exp())
}
