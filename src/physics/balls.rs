//! Balls of common sports.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use serde::Deserialize;

use super::scene::{Ball, Contact, Scene};
use crate::error::{Error, Result};

/// A ball, what it does on the ground of its sport, and where the numbers come from.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct Preset {
    #[serde(rename = "about")]
    _about: String,
    #[serde(rename = "source")]
    _source: String,
    ball: Ball,
    contact: Contact,
}

/// Every ball, by name.
static BALLS: LazyLock<BTreeMap<String, Preset>> =
    LazyLock::new(|| serde_json::from_str(include_str!("balls.json")).unwrap_or_default());

impl Scene {
    /// Names of the balls of common sports.
    pub fn ball_names() -> Vec<&'static str> {
        BALLS.keys().map(String::as_str).collect()
    }

    /// The scene with the ball of a common sport, and with that one's bounces where the scene says nothing of them (its
    /// contact is the ideal one). What the numbers are and where they come from: `balls.json`.
    ///
    /// # Errors
    /// [`Error::Value`] with the names there are.
    pub fn with_ball(mut self, name: &str) -> Result<Self> {
        let preset = BALLS.get(name).ok_or_else(|| {
            Error::value("ball", "name", format!("cannot be `{name}`; there are {}", Self::ball_names().join(", ")))
        })?;
        self.ball = preset.ball.clone();
        if self.contact == Contact::default() {
            self.contact = preset.contact.clone();
        }
        Ok(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_ball_makes_a_scene() {
        assert_eq!(Scene::ball_names().len(), 9);
        for name in Scene::ball_names() {
            let scene = Scene::new([0.0, 0.0, -9.81], 0.1).with_ball(name).unwrap();
            scene.check(name).unwrap();
            assert!(matches!(scene.contact, Contact::Bounce { restitution, .. } if restitution < 1.0), "{name}");
            assert!(scene.ball.spin_sigma.unwrap() * scene.ball.radius < 8.0, "{name}");
        }
        let error = Scene::new([0.0; 3], 0.1).with_ball("cricket").unwrap_err().to_string();
        assert!(error.contains("table-tennis"), "{error}");
    }
}
