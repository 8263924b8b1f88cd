//! Scenes of common sports.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use serde::Deserialize;

use super::scene::{Contact, Cuboid, Floor, Scene, Wall};
use crate::error::{Error, Result};

/// Standard gravity, m/s².
const GRAVITY: [f64; 3] = [0.0, 0.0, -9.81];

/// What a sport is played on, in the world frame of the court of its name, and with which ball.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct Place {
    #[serde(rename = "about")]
    _about: String,
    ball: String,
    #[serde(default)]
    contact: Contact,
    floor: Option<Floor>,
    #[serde(default)]
    walls: Vec<Wall>,
    #[serde(default)]
    boxes: Vec<Cuboid>,
    #[serde(default)]
    lines: Vec<[[f64; 3]; 2]>,
    #[serde(default)]
    net: Vec<[f64; 3]>,
}

/// Every place, by name.
static PLACES: LazyLock<BTreeMap<String, Place>> =
    LazyLock::new(|| serde_json::from_str(include_str!("places.json")).unwrap_or_default());

impl Scene {
    /// Names of the scenes of common sports, `floor` (nothing but a level one) and `free` (nothing to touch).
    pub fn names() -> Vec<&'static str> {
        PLACES.keys().map(String::as_str).collect()
    }

    /// The scene of a common sport.
    ///
    /// # Errors
    /// [`Error::Value`] with the names there are.
    pub fn named(name: &str) -> Result<Self> {
        let place = PLACES.get(name).cloned().ok_or_else(|| {
            Error::value("scene", "name", format!("cannot be `{name}`; there are {}", Self::names().join(", ")))
        })?;
        let Place { ball, contact, floor, walls, boxes, lines, net, .. } = place;
        let empty = Self::new(GRAVITY, 1.0);
        Self { contact, floor, walls, boxes, lines, net, ..empty }.with_ball(&ball)
    }

    /// The scene of a common sport, or the one that a file holds: what the command takes for a scene.
    ///
    /// # Errors
    /// As [`Self::from_file`]; [`Error::Value`] for neither a file nor a name.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn open(name_or_path: &std::path::Path) -> Result<Self> {
        match name_or_path.to_str() {
            Some(name) if PLACES.contains_key(name) && !name_or_path.exists() => Self::named(name),
            Some(name) if !name_or_path.exists() && name_or_path.extension().is_none() => Self::named(name),
            _ => Self::from_file(name_or_path),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_scene_is_one_that_can_be_fitted() {
        assert_eq!(Scene::names().len(), 9);
        for name in Scene::names() {
            let scene = Scene::named(name).unwrap();
            scene.check(name).unwrap();
            assert!(scene.ball.spin_sigma.is_some() && matches!(scene.contact, Contact::Bounce { .. }), "{name}");
            let written = serde_json::to_string(&scene).unwrap();
            assert_eq!(Scene::from_json(&written, name).unwrap(), scene);
        }
        let error = Scene::named("cricket").unwrap_err().to_string();
        assert!(error.contains("table-tennis"), "{error}");
    }
}
