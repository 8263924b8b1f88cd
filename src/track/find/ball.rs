//! What a clip tells of its ball once most of its frames are labelled: colour, and radius and place near each frame.

use super::evidence::{Candidate, median_colour};
use crate::contour::{Circle, RadiusPrior};
use crate::image::Levels;
use crate::statistics::median;

/// Frames to either side that tell the radius of one.
const RADIUS_FRAMES: usize = 4;
/// Error of a radius that is told by other frames, as a share and px.
const RADIUS_SHARE: f64 = 0.03;
const RADIUS_PX: f64 = 0.15;
/// Frames to either side that tell where the ball may be.
const PLACE_FRAMES: usize = 6;
/// Smallest spread of the ball's colour, levels: light and shade change it.
const LEAST_SPREAD: f64 = 12.0;
/// What a colour like the ball's speaks for a candidate, and what another at most speaks against it.
const LIKE: f64 = 1.5;
const UNLIKE: f64 = 5.0;
/// Gain of a candidate from which its colour is asked; most that are; fewest alike that tell the ball's.
const GOOD_GAIN: f64 = 2.0;
const MOST_COLOURS: usize = 600;
const FEWEST_LABELS: usize = 5;
/// Distance of colours that are one, levels.
const NEAR_COLOUR: f64 = 40.0;

/// The ball of a clip by a first labelling.
pub(super) struct Ball {
    /// Colour and its spread, levels.
    colour: Option<(Levels, f64)>,
    labels: Vec<Option<Candidate>>,
}

impl Ball {
    /// Its colour by the candidates of all frames.
    pub fn of(frames: &[Vec<Candidate>]) -> Self {
        let good: Vec<&Candidate> = frames.iter().flatten().filter(|candidate| candidate.gain > GOOD_GAIN).collect();
        let stride = good.len() / MOST_COLOURS + 1;
        let good: Vec<&Candidate> = good.into_iter().step_by(stride).collect();
        Self { colour: commonest(&good), labels: vec![] }
    }

    /// With a label or none for each frame.
    pub fn with(self, labels: Vec<Option<Candidate>>) -> Self {
        Self { labels, ..self }
    }

    /// The label of `frame`.
    pub fn label(&self, frame: usize) -> Option<Candidate> {
        self.labels.get(frame).copied().flatten()
    }

    /// Whether the clip tells the ball's colour.
    pub fn knows_colour(&self) -> bool {
        self.colour.is_some()
    }

    /// How unlike the ball's a colour is: 1 is ordinary; none where the ball's is not known.
    pub fn unlikeness(&self, colour: Levels) -> Option<f64> {
        self.colour.map(|(middle, spread)| distance(colour, middle) / spread)
    }

    /// What the colour speaks for a candidate, log of odds.
    pub fn colour_gain(&self, colour: Levels) -> f64 {
        self.unlikeness(colour).map_or(0.0, |off| LIKE - (0.5 * off * off).min(LIKE + UNLIKE))
    }

    /// The radius by the frames about `frame`, itself left out.
    pub fn radius(&self, frame: usize) -> Option<RadiusPrior> {
        let near = frame.saturating_sub(RADIUS_FRAMES)..(frame + RADIUS_FRAMES + 1).min(self.labels.len());
        let others = near.filter(|&other| other != frame).filter_map(|other| self.labels[other]);
        let radius = median(others.map(|label| label.outline.circle.radius))?;
        Some(RadiusPrior { radius, sigma: RADIUS_PX + RADIUS_SHARE * radius })
    }

    /// Where the ball may be in `frame` by the labels before and after it.
    pub fn places(&self, frame: usize) -> Vec<[f64; 2]> {
        let label = |at: usize| self.label(at).map(|label| (at, label.outline.circle));
        let before: Vec<_> = (1..=PLACE_FRAMES.min(frame)).filter_map(|back| label(frame - back)).take(2).collect();
        let after: Vec<_> = (1..=PLACE_FRAMES).filter_map(|ahead| label(frame + ahead)).take(2).collect();
        let mut places = Vec::new();
        if let (Some(a), Some(b)) = (before.first(), after.first()) {
            places.push(on_line(*a, *b, frame));
        }
        for pair in [before, after] {
            if let [near, far] = pair[..] {
                places.push(on_line(far, near, frame));
            }
        }
        places
    }
}

/// Where constant velocity through two labels is in `frame`.
fn on_line((first, a): (usize, Circle), (second, b): (usize, Circle), frame: usize) -> [f64; 2] {
    let share = (frame as f64 - first as f64) / (second as f64 - first as f64);
    [a.x + share * (b.x - a.x), a.y + share * (b.y - a.y)]
}

/// The colour that most speaks for, and its spread: a shadow's and a reflection's change with what is below.
fn commonest(good: &[&Candidate]) -> Option<(Levels, f64)> {
    let near = |colour: Levels| good.iter().filter(move |other| distance(other.colour, colour) < NEAR_COLOUR);
    let votes = |candidate: &&&Candidate| near(candidate.colour).map(|other| other.gain).sum::<f64>();
    let commonest = good.iter().max_by(|a, b| votes(a).total_cmp(&votes(b)))?;
    let alike: Vec<Levels> = near(commonest.colour).map(|other| other.colour).collect();
    let middle = median_colour(&alike);
    let spread = median(alike.iter().map(|colour| distance(*colour, middle)))?;
    (alike.len() >= FEWEST_LABELS).then_some((middle, LEAST_SPREAD.max(1.5 * spread)))
}

fn distance(a: Levels, b: Levels) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt()
}
