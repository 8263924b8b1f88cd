//! How sure a label is: a logistic regression of "within 1 px of the truth" on what the label shows.
//!
//! Fitted on 6,892 labels of 84 rendered clips: three scenes, eight cameras; a dark and a grey ball; a fifth of the
//! clips with things painted in front and noise, an eighth with JPEG's traces, too. On pictures of another kind it
//! is a ranking, not a measured share.

use super::ball::Ball;
use super::evidence::Candidate;
use super::link::turn;
use super::vote::is_same;

/// The regression's weights: of 1 (0.7 below the fitted one: other clips are less tidy),
const BIAS: f64 = 13.1;
/// of the outline's coverage,
const COVERAGE: f64 = 17.9;
/// of the share of the inside that is not background (an outline with gaps is the ball's where a thing in front
/// hides both; on the ball's inside it is a chance circle),
const CHANGED: f64 = -10.6;
/// of the logarithm of the centre's standard deviation in px (it grows with rms, which weighs more),
const SIGMA: f64 = 2.2;
/// of the outline's rms, 1/px,
const RMS: f64 = -35.5;
/// of the radius' distance from its neighbours', in sigmas,
const RADIUS: f64 = -0.7;
/// of the colour's distance from the ball's, in spreads,
const COLOUR: f64 = -1.5;
/// of the turn, in ordinary turns,
const TURN: f64 = -0.25;
/// and of the gain over the next best candidate's.
const MARGIN: f64 = 0.67;
/// Bounds of what the regression was fitted on.
const MOST_RADIUS_OFF: f64 = 5.0;
const MOST_OFF: f64 = 3.0;
/// Most that any label is trusted.
const MOST: f64 = 0.99;
/// Most where nothing tells the ball from other round things: no background, or no colour.
const MOST_BLIND: f64 = 0.5;

/// Judges labels by the clip's others.
pub(super) struct Judge<'a> {
    pub ball: &'a Ball,
    /// Whether there is a background to compare with.
    pub background: bool,
}

impl Judge<'_> {
    /// Share of such labels that are within 1 px of the truth.
    pub fn confidence(&self, frame: usize, label: &Candidate, candidates: &[Candidate]) -> f64 {
        let circle = label.outline.circle;
        let radius_off = self.ball.radius(frame).map(|prior| (circle.radius - prior.radius).abs() / prior.sigma);
        let others = candidates.iter().filter(|other| !is_same(&other.outline.circle, &circle));
        let rival = others.map(|other| other.gain).fold(f64::NEG_INFINITY, f64::max);
        let odds = BIAS
            + COVERAGE * label.outline.coverage
            + CHANGED * label.changed
            + SIGMA * label.outline.sigma.max(f64::MIN_POSITIVE).ln()
            + RMS * label.outline.rms
            + RADIUS * radius_off.unwrap_or(MOST_OFF).min(MOST_RADIUS_OFF)
            + COLOUR * self.ball.unlikeness(label.colour).unwrap_or(MOST_OFF).min(MOST_OFF)
            + TURN * self.turn(frame).min(MOST_OFF)
            + MARGIN * (label.gain - rival).clamp(-MOST_OFF, MOST_OFF);
        let most = if self.background && self.ball.knows_colour() { MOST } else { MOST_BLIND };
        (1.0 / (1.0 + (-odds).exp())).clamp(0.0, most)
    }

    /// Turn at the label before, through this and the next; the most where one of the three is missing.
    fn turn(&self, frame: usize) -> f64 {
        let circle = |frame: Option<usize>| self.ball.label(frame?).map(|label| label.outline.circle);
        match [frame.checked_sub(1), Some(frame), Some(frame + 1)].map(circle) {
            [Some(a), Some(b), Some(c)] => turn([&a, &b, &c], [1.0, 1.0]),
            _ => MOST_OFF,
        }
    }
}
