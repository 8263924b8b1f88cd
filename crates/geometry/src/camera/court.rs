//! Known points of common courts.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::courts::{CourtTable, TABLES};
use crate::error::{Error, Result};

/// A court's named points. World frame: origin on the floor in the court's middle, x to the right and y away as seen
/// from the near end, z up; metres.
///
/// ```
/// # mod gravisight { pub use gravisight_geometry::{camera, camera::*, error::*, image::*, size::*}; }
/// use gravisight::Court;
///
/// # fn main() -> gravisight::Result<()> {
/// let court = Court::named("tennis")?;
/// assert_eq!(court.points["far service T"], [0.0, 6.4, 0.0]);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify), tsify(hashmap_as_object))]
#[serde(deny_unknown_fields)]
pub struct Court {
    /// Whose rules and which size.
    pub about: String,
    /// World coordinates of each point, m.
    pub points: BTreeMap<String, [f64; 3]>,
    /// What is painted on it; empty where that is not known.
    #[serde(default)]
    pub lines: Vec<CourtLine>,
}

/// A straight painted line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(deny_unknown_fields)]
pub struct CourtLine {
    /// One end, m: of the edge that the rules measure to, or of the line's middle where they measure to that.
    pub from: [f64; 3],
    /// The other end, m.
    pub to: [f64; 3],
    /// How wide the paint is, m. Some are wider than the rules' usual: what is measured counts, where it can be.
    pub width: f64,
    /// Direction in the world in which the paint lies from that edge (unit vector); absent: it lies on both sides.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub paint: Option<[f64; 3]>,
}

/// Every court, by name.
static COURTS: LazyLock<BTreeMap<&'static str, Court>> = LazyLock::new(|| {
    let court = |table: &CourtTable| Court {
        about: table.about.into(),
        points: table.points.iter().map(|&(name, at)| (name.into(), at)).collect(),
        lines: table.lines.to_vec(),
    };
    TABLES.iter().map(|table| (table.name, court(table))).collect()
});

impl CourtLine {
    /// Its two edges at a share of its length, m, the one that rules measure to first; [`None`] of a line that is none.
    #[doc(hidden)]
    pub fn edges(&self, share: f64) -> Option<[Point3<f64>; 2]> {
        let [from, to] = [self.from, self.to].map(Vector3::from);
        let at = Point3::from(from + share * (to - from));
        Some(match self.paint {
            Some(paint) => [at, at + Vector3::from(paint) * self.width],
            None => {
                let half = Vector3::z().cross(&(to - from)).try_normalize(0.0)? * (self.width / 2.0);
                [at - half, at + half]
            }
        })
    }

    /// Whether it can be painted.
    pub(crate) fn is_possible(&self) -> bool {
        let along = Vector3::from(self.to) - Vector3::from(self.from);
        let is_across = |paint: [f64; 3]| {
            let paint = Vector3::from(paint);
            (paint.norm() - 1.0).abs() < 1e-6 && paint.dot(&along).abs() < 1e-6 * along.norm()
        };
        along.norm() > 0.0
            && along.norm().is_finite()
            && self.width > 0.0
            && self.width.is_finite()
            && self.paint.is_none_or(is_across)
    }
}

impl Court {
    /// Names of all courts.
    pub fn names() -> Vec<&'static str> {
        COURTS.keys().copied().collect()
    }

    /// The court on which a sport is played, such as `basketball`, if its painted lines are known: the first whose name begins so.
    pub fn with_lines(sport: &str) -> Option<&'static str> {
        let is_of_sport =
            |name: &str| name == sport || name.strip_prefix(sport).is_some_and(|rest| rest.starts_with('-'));
        COURTS.iter().find(|(name, court)| is_of_sport(name) && !court.lines.is_empty()).map(|(name, _)| *name)
    }

    /// The court of a name.
    ///
    /// # Errors
    /// [`Error::Calibration`] with the names there are.
    pub fn named(name: &str) -> Result<&'static Self> {
        COURTS.get(name).ok_or_else(|| Error::Calibration {
            reason: format!("unknown court `{name}`; choose one of {}", Self::names().join(", ")),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sport_is_played_on_a_court_of_its_name() {
        let courts = ["tennis", "basketball", "table-tennis", "squash", "cards", ""].map(Court::with_lines);
        assert_eq!(courts, [Some("tennis"), Some("basketball-fiba"), Some("table-tennis"), None, None, None]);
    }

    #[test]
    fn every_court_has_its_own_name_and_points_of_their_own_names_and_lines_that_can_be_painted() {
        assert_eq!(Court::names().len(), TABLES.len());
        for table in &TABLES {
            let court = Court::named(table.name).unwrap();
            assert!(court.points.len() == table.points.len() && court.points.len() >= 15, "{}", table.name);
            assert!(court.lines.iter().all(CourtLine::is_possible), "{}", table.name);
        }
    }
}
