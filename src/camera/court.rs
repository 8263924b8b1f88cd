//! Known points of common courts.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// A court's named points. World frame: origin on the floor in the court's middle, x to the right and y away as seen
/// from the near end, z up; metres.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify), tsify(hashmap_as_object))]
#[serde(deny_unknown_fields)]
pub struct Court {
    /// Whose rules and which size.
    pub about: String,
    /// World coordinates of each point, m.
    pub points: BTreeMap<String, [f64; 3]>,
}

/// Every court, by name.
static COURTS: LazyLock<BTreeMap<String, Court>> =
    LazyLock::new(|| serde_json::from_str(include_str!("courts.json")).unwrap_or_default());

impl Court {
    /// Names of all courts.
    pub fn names() -> Vec<&'static str> {
        COURTS.keys().map(String::as_str).collect()
    }

    /// The court of a name.
    ///
    /// # Errors
    /// [`Error::Calibration`] with the names there are.
    pub fn named(name: &str) -> Result<&'static Self> {
        COURTS.get(name).ok_or_else(|| Error::Calibration {
            reason: format!("there is no court `{name}`; there are {}", Self::names().join(", ")),
        })
    }
}
