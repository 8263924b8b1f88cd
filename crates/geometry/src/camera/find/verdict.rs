//! Whether a court was found: sure, probable or not, and why.

use serde::Serialize;

use super::judge::Features;
use super::model::CourtModel;

/// How far a found court can be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(rename_all = "kebab-case")]
pub enum CourtVerdict {
    /// No court was found.
    None,
    /// Show it and let the user check it.
    Probable,
    /// The camera is right with a probability of at least 0.95.
    Sure,
}

/// Lines that must be seen, and those along and across the court: four fix a camera, so a fifth has to agree.
const FEWEST: usize = 5;
const FEWEST_OF_EACH: usize = 2;
/// Numbers that the log-odds are linear in; the first is 1.
#[doc(hidden)]
pub const FEATURES: usize = 9;
/// Log-odds that a camera is right: weights of [`Case::row`]. Fitted by `scripts/fit-weights courts` to
/// every other court of `synth --set courts --split train --clips 16`.
const LOG_ODDS: [f64; FEATURES] = [-3.62, 2.40, -1.32, -6.13, -1.05, 1.70, 4.08, 0.79, 2.62];
/// Their means over the right cameras that it was fitted to: what a court is usually like.
const GOOD: [f64; FEATURES] = [1.0, 0.90, 0.06, 0.58, 0.55, 0.40, 0.95, 6.93, -0.25];
/// Most odds: there is always a chance that a court of another size is painted.
const MOST_ODDS: f64 = 1e4;
/// Score below which a court counts as of this score, units.
const LEAST_SCORE: f64 = 0.05;
/// What is added to the fraction of the paint that is explained, before its logarithm is taken.
const LEAST_EXPLAINED: f64 = 0.05;
/// Probability from which on a camera is sure, and from which on it is shown.
const SURE: f64 = 0.95;
const PROBABLE: f64 = 0.5;

/// What a verdict depends on.
pub(super) struct Case<'a> {
    pub model: &'a CourtModel,
    pub features: &'a Features,
    pub runner_up: f64,
    /// px of a picture 1280 px wide.
    pub rms: f64,
}

impl Case<'_> {
    /// What the log-odds are linear in.
    pub(super) fn row(&self) -> [f64; FEATURES] {
        let Features { recall, beyond, score, explained, visible, seen, .. } = *self.features;
        let score = score.max(LEAST_SCORE);
        let explained = explained + LEAST_EXPLAINED;
        let rival = (self.runner_up / score).clamp(0.0, 2.0);
        [
            1.0,
            recall,
            beyond,
            rival,
            self.rms,
            score.ln(),
            seen as f64 / visible.max(1) as f64,
            seen as f64,
            explained.ln(),
        ]
    }

    /// Whether enough is seen to fix a camera.
    pub(super) fn is_enough(&self) -> bool {
        self.refusal().is_none()
    }

    /// The odds that the camera is right.
    pub(super) fn odds(&self) -> f64 {
        if !self.is_enough() {
            return 0.0;
        }
        let log_odds: f64 = self.row().iter().zip(LOG_ODDS).map(|(value, weight)| value * weight).sum();
        log_odds.exp().min(MOST_ODDS)
    }

    /// Whether nothing else has to be tried.
    pub(super) fn is_sure(&self) -> bool {
        let odds = self.odds();
        odds / (1.0 + odds) >= SURE
    }

    /// The verdict of a camera that is right with this probability.
    pub(super) fn verdict(&self, probability: f64) -> CourtVerdict {
        match probability {
            _ if !self.is_enough() => CourtVerdict::None,
            probability if probability >= SURE => CourtVerdict::Sure,
            probability if probability >= PROBABLE => CourtVerdict::Probable,
            _ => CourtVerdict::None,
        }
    }

    /// The reason for it, in words.
    pub(super) fn reason(&self, verdict: CourtVerdict) -> String {
        let Self { model, features, .. } = self;
        if let Some(refusal) = self.refusal() {
            return refusal;
        }
        let found =
            format!("{} of the {} lines in view of a {} court were found", features.seen, features.visible, model.name);
        match verdict {
            CourtVerdict::Sure => found,
            _ => format!("{found}, but {}", self.doubt()),
        }
    }

    /// Why too little is seen to fix a camera; [`None`] if it is enough.
    fn refusal(&self) -> Option<String> {
        let (court, features) = (&self.model.name, self.features);
        if features.visible < FEWEST {
            return Some(format!("{} lines of a {court} court are in view; {FEWEST} are needed", features.visible));
        }
        if features.seen < FEWEST {
            return Some(format!(
                "{} of the {} lines in view of a {court} court were found; {FEWEST} are needed",
                features.seen, features.visible
            ));
        }
        (features.along < FEWEST_OF_EACH || features.across < FEWEST_OF_EACH).then(|| {
            format!(
                "{} lines along a {court} court and {} across it were found; {FEWEST_OF_EACH} of each are needed",
                features.along, features.across
            )
        })
    }

    /// What speaks most against it, in words.
    fn doubt(&self) -> String {
        let court = &self.model.name;
        let percent = (100.0 * self.features.recall).round();
        let doubts = [
            format!("only {percent} % of their length is seen"),
            "lines continue beyond where those of the court end".into(),
            format!("they also fit a {court} court in another position"),
            format!("they are {:.1} px from those of the court on average", self.rms),
            "the court is small in the picture".into(),
            "others are missing".into(),
            "they are few".into(),
            "many other lines of this colour are in the picture".into(),
        ];
        let against =
            self.row().into_iter().zip(GOOD).zip(LOG_ODDS).map(|((value, good), weight)| weight * (value - good));
        let against: Vec<f64> = against.skip(1).collect();
        let worst = (0..doubts.len()).min_by(|&a, &b| against[a].total_cmp(&against[b]));
        worst.map_or_else(String::new, |worst| doubts[worst].clone())
    }
}
