//! The numbers of the tracker.

mod evidence;
mod flight;
mod pictures;

use serde::{Deserialize, Serialize};

pub use self::evidence::{AssociationConfig, EvidenceConfig, QueriesConfig, RadiiConfig, SlowConfig, WeightsConfig};
pub use self::flight::{ClutterConfig, FallConfig, FlightConfig, GravityConfig, TrackletsConfig};
pub use self::pictures::{BackgroundConfig, BlobsConfig, RegistrationConfig, RepeatsConfig};
use gravisight_geometry::error::{Error, Result};

/// All numbers by which a ball is tracked in a video, by topic. Each says where it comes from. Those that a file leaves out are as in
/// [`TrackerConfig::default`].
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
#[serde(default, deny_unknown_fields)]
pub struct TrackerConfig {
    /// What the flight of a ball allows.
    pub flight: FlightConfig,
    /// Which frames show the one before again, and when frames were taken.
    pub repeats: RepeatsConfig,
    /// How frames are registered to the first view: by patches of a key frame that are found again.
    pub registration: RegistrationConfig,
    /// What stands still, and what differs from it.
    pub background: BackgroundConfig,
    /// Which parts of a frame that differ are candidates.
    pub blobs: BlobsConfig,
    /// How dense candidates are by chance.
    pub clutter: ClutterConfig,
    /// How candidates are linked to tracklets.
    pub tracklets: TrackletsConfig,
    /// What the networks' answers mean.
    pub evidence: EvidenceConfig,
    /// What the networks are asked while frames come.
    pub queries: QueriesConfig,
    /// A ball that hardly moves: it is part of its own background.
    pub slow: SlowConfig,
    /// Whether a path bends as gravity bends that of a ball.
    pub gravity: GravityConfig,
    /// The same where neither camera nor ball is known.
    pub fall: FallConfig,
    /// The log-odds that a tracklet is the ball's.
    pub weights: WeightsConfig,
    /// Which tracklets are one ball's.
    pub association: AssociationConfig,
    /// How well the radii of the reported balls are known.
    pub radii: RadiiConfig,
}

/// Largest number that is accepted: a larger one only takes time and memory.
const MOST: f64 = 1e6;

impl TrackerConfig {
    /// Of a file that holds the numbers that differ, as `gravisight track --json` prints them; in a browser also as results hold them.
    ///
    /// # Errors
    /// [`Error::Format`] for another form; as [`Self::check`].
    pub fn from_json(text: &str) -> Result<Self> {
        let value: serde_json::Value = serde_json::from_str(text).map_err(Error::format("config"))?;
        #[cfg(target_arch = "wasm32")]
        let value = camel_case(value);
        let config: Self = serde_json::from_value(value).map_err(Error::format("config"))?;
        config.check().map(|()| config)
    }

    /// Refuses what makes no tracker.
    ///
    /// # Errors
    /// [`Error::Value`] for a number that is not finite, for a probability that is none, and for one that is not positive but for log-odds
    /// and what may be 0.
    pub fn check(&self) -> Result<()> {
        check_numbers(&serde_json::to_value(self).unwrap_or_default(), "", &|value| value.is_finite(), "finite")?;
        let Self { association, evidence, tracklets, gravity, fall, weights, .. } = *self;
        if !(0.0..1.0).contains(&association.min_confidence) {
            let reason = format!("must be at least 0 and less than 1, not {}", association.min_confidence);
            return Err(Error::value("config", "association.min_confidence", reason));
        }
        let probabilities = [
            ("evidence.seen", evidence.seen),
            ("evidence.seen_alone", evidence.seen_alone),
            ("evidence.measured_from", evidence.measured_from),
            ("evidence.least_probability", 2.0 * evidence.least_probability),
            ("gravity.steady_fraction", gravity.steady_fraction),
            ("fall.slowed_fraction", fall.slowed_fraction),
            ("fall.own_gravity", fall.own_gravity),
            ("fall.untold", fall.untold),
        ];
        if let Some((name, _)) = probabilities.into_iter().find(|(_, value)| !(*value > 0.0 && *value < 1.0)) {
            return Err(Error::value("config", name, "must be a probability"));
        }
        if gravity.least > gravity.most {
            return Err(Error::value("config", "gravity.least", format!("must be at most {}", gravity.most)));
        }
        // A tracklet's next step needs two blobs.
        if tracklets.recent < 2 {
            return Err(Error::value("config", "tracklets.recent", "must be at least 2"));
        }
        // All others are positive.
        let others = Self {
            association: AssociationConfig {
                min_confidence: 1.0,
                confirmed: 1.0,
                continuation: 1.0,
                free_overlap: 1,
                most_filled: 1,
                ..association
            },
            tracklets: TrackletsConfig {
                min_gain: 1.0,
                strong_gain: 1.0,
                least_per_blob: 1.0,
                max_missed: 1,
                ..tracklets
            },
            gravity: GravityConfig { least: 1.0, ..gravity },
            weights: WeightsConfig { with_motion: [1.0; 9], without_motion: [1.0; 9], ..weights },
            ..*self
        };
        let is_positive = |value: f64| value > 0.0 && value <= MOST;
        check_numbers(
            &serde_json::to_value(others).unwrap_or_default(),
            "",
            &is_positive,
            "positive, and at most a million",
        )
    }
}

/// The same with the names of fields as they are in a browser.
#[cfg(any(target_arch = "wasm32", test))]
fn camel_case(value: serde_json::Value) -> serde_json::Value {
    let serde_json::Value::Object(fields) = value else { return value };
    let renamed = |name: &str| {
        let mut words = name.split('_');
        let first = words.next().unwrap_or_default().to_string();
        let capital = |word: &str| word.chars().take(1).flat_map(char::to_uppercase).collect::<String>();
        words.fold(first, |name, word| name + &capital(word) + word.get(1..).unwrap_or_default())
    };
    fields.into_iter().map(|(name, value)| (renamed(&name), camel_case(value))).collect()
}

/// Refuses a number of a tree that is not as it must be.
fn check_numbers(value: &serde_json::Value, path: &str, is_right: &impl Fn(f64) -> bool, must_be: &str) -> Result<()> {
    match value {
        serde_json::Value::Object(fields) => fields.iter().try_for_each(|(name, value)| {
            let path = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
            check_numbers(value, &path, is_right, must_be)
        }),
        serde_json::Value::Array(list) => {
            list.iter().try_for_each(|value| check_numbers(value, path, is_right, must_be))
        }
        // What is not finite has no form in JSON.
        number if number.as_f64().is_some_and(is_right) => Ok(()),
        number => Err(Error::value("config", path, format!("must be {must_be}, not {number}"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_may_hold_only_the_numbers_that_differ() {
        let config: TrackerConfig = serde_json::from_str(r#"{"tracklets": {"gate": 3.0}}"#).unwrap();
        let default = TrackerConfig::default();
        assert_eq!(config, TrackerConfig { tracklets: TrackletsConfig { gate: 3.0, ..default.tracklets }, ..default });
        assert!(serde_json::from_str::<TrackerConfig>(r#"{"tracklets": {"gates": 3.0}}"#).is_err());
    }

    #[test]
    fn a_browser_takes_the_names_of_both_forms() {
        let printed = serde_json::json!({"tracklets": {"min_gain": 7.0, "step_px": 2.0}, "slow": {"mostFrames": 3}});
        let expected = serde_json::json!({"tracklets": {"minGain": 7.0, "stepPx": 2.0}, "slow": {"mostFrames": 3}});
        assert_eq!(camel_case(printed), expected);
        let text = serde_json::to_string(&TrackerConfig::default()).unwrap();
        assert_eq!(TrackerConfig::from_json(&text).unwrap(), TrackerConfig::default());
        assert!(TrackerConfig::from_json(r#"{"tracklets": {"gate": 0}}"#).is_err());
    }

    #[test]
    fn what_makes_no_tracker_is_refused() {
        let refused = |text: &str| {
            let config: TrackerConfig = serde_json::from_str(text).unwrap();
            config.check().err().map(|error| error.to_string()).unwrap_or_default()
        };
        assert_eq!(TrackerConfig::default().check().err().map(|error| error.to_string()), None);
        assert_eq!(refused(r#"{"association": {"confirmed": -3, "min_confidence": 0}, "weights": {"seeded": 5}}"#), "");
        assert!(refused(r#"{"tracklets": {"gate": 0}}"#).contains("tracklets.gate"));
        assert!(refused(r#"{"registration": {"step": 0}}"#).contains("registration.step"));
        assert!(refused(r#"{"association": {"min_confidence": 1.5}}"#).contains("min_confidence"));
        assert!(refused(r#"{"evidence": {"seen": 1}}"#).contains("evidence.seen"));
        let mut config = TrackerConfig::default();
        config.weights.with_motion[2] = f64::NAN;
        assert!(config.check().unwrap_err().to_string().contains("weights.with"));
    }
}
