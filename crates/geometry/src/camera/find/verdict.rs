//! Whether a court was found: sure, probable or not, and why.

use serde::Serialize;

use super::judge::Features;

/// How far a found court can be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(rename_all = "kebab-case")]
pub enum CourtVerdict {
    /// No court was found.
    None,
    /// Show it and let the user check it: of 14 such courts 3 were 1 to 3 % of the picture's width off.
    Probable,
    /// The camera is right: of 16 such courts none was more than 1.05 % of the picture's width off.
    Sure,
}

/// Limits of a verdict.
struct Limits {
    /// Least score, units.
    score: f64,
    /// Least fraction of the lines' length that is seen.
    recall: f64,
    /// Least fraction of the lines in view that are seen.
    seen: f64,
    /// Most score of the runner-up, relative to the best.
    runner_up: f64,
    /// Most fraction of what is seen beyond the lines' ends.
    beyond: f64,
    /// Most distance of the lines from their ridges, root mean square, px of a picture 1280 px wide.
    rms: f64,
}

/// Lines that must be seen, and those along and across the court: four fix a camera, so a fifth has to agree.
const FEWEST: usize = 5;
const FEWEST_OF_EACH: usize = 2;
/// Set on six tennis courts, two tables and a badminton court; on 142 courts with clicks 16 were sure and right, none sure and wrong.
const SURE: Limits = Limits { score: 0.8, recall: 0.88, seen: 0.8, runner_up: 0.8, beyond: 0.25, rms: 1.3 };
/// A table has few and short lines.
const SURE_TABLE: Limits = Limits { score: 0.35, recall: 0.93, seen: 0.8, runner_up: 0.92, beyond: 0.12, rms: 1.3 };
/// On the same 142 courts, 11 were probable and right, and 3 wrong by 1 to 3 %.
const PROBABLE: Limits = Limits { score: 0.35, recall: 0.8, seen: 0.75, runner_up: 0.95, beyond: 0.3, rms: 1.5 };

/// What a verdict depends on.
pub(super) struct Case<'a> {
    /// The court's name.
    pub court: &'a str,
    pub is_table: bool,
    pub features: &'a Features,
    pub runner_up: f64,
    /// px of a picture 1280 px wide.
    pub rms: f64,
}

impl Case<'_> {
    /// The verdict and the reason for it, in words.
    pub(super) fn verdict(&self) -> (CourtVerdict, String) {
        let (visible, seen) = (self.features.visible, self.features.seen);
        let found = format!("{seen} of the {visible} lines in view of a {} court were found", self.court);
        match (self.refusal(if self.is_table { &SURE_TABLE } else { &SURE }), self.refusal(&PROBABLE)) {
            (None, _) => (CourtVerdict::Sure, found),
            (Some(reason), None) => (CourtVerdict::Probable, format!("{found}, but {reason}")),
            (_, Some(reason)) => (CourtVerdict::None, reason),
        }
    }

    /// Why the limits are not met; [`None`] if they are.
    fn refusal(&self, limits: &Limits) -> Option<String> {
        let Self { court, features, .. } = self;
        let percent = |fraction: f64| (100.0 * fraction).round();
        if features.visible < FEWEST {
            return Some(format!("{} lines of a {court} court are in view; {FEWEST} are needed", features.visible));
        }
        let needed = FEWEST.max((limits.seen * features.visible as f64).ceil() as usize);
        if features.seen < needed {
            return Some(format!(
                "{} of the {} lines in view of a {court} court were found; {needed} are needed",
                features.seen, features.visible
            ));
        }
        if features.along < FEWEST_OF_EACH || features.across < FEWEST_OF_EACH {
            return Some(format!(
                "{} lines along a {court} court and {} across it were found; {FEWEST_OF_EACH} of each are needed",
                features.along, features.across
            ));
        }
        if features.recall <= limits.recall {
            let (seen, least) = (percent(features.recall), percent(limits.recall));
            return Some(format!("{seen} % of the lines of a {court} court are seen; more than {least} % are needed"));
        }
        if features.score.is_nan() || features.score <= limits.score {
            return Some(format!("what is seen of a {court} court is too small or too unlike one"));
        }
        if self.runner_up >= limits.runner_up * features.score {
            return Some(format!("the lines also fit a {court} court in another position"));
        }
        if features.beyond >= limits.beyond {
            return Some(format!("lines continue beyond where those of a {court} court end"));
        }
        (self.rms >= limits.rms || self.rms.is_nan())
            .then(|| format!("the lines are {:.1} px from those of a {court} court on average", self.rms))
    }
}
