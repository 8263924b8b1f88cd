//! The scenes of the paper's data sets, from `paper.json`: what both engines are fed with.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use nalgebra::{Matrix3, Vector3};
use serde::Deserialize;

use crate::camera::{Camera, Distortion};
use crate::error::{Error, Result};
use crate::physics::Scene;
use crate::size::Size;

/// All of the description.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Paper {
    #[serde(rename = "about")]
    _about: String,
    pub size: Size,
    pub field_of_view: f64,
    pub fps: f64,
    pub ball: Ball,
    pub light: Light,
    pub headlight: Headlight,
    pub material: Material,
    cameras: BTreeMap<String, [f64; 3]>,
    pub bouncing: Bouncing,
    pub spring: Spring,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Ball {
    pub radius: f64,
    pub mass: f64,
    pub colour: [f32; 3],
}

/// A spot light.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Light {
    pub position: [f64; 3],
    pub direction: [f64; 3],
    pub diffuse: f64,
    pub specular: f64,
    /// Half of the cone's opening, degrees.
    pub cutoff: f64,
    pub exponent: f64,
}

/// Light from the camera's direction.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Headlight {
    pub ambient: f64,
    pub diffuse: f64,
    pub specular: f64,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Material {
    pub specular: f64,
    pub shininess: f64,
}

/// The bouncing ball's sets (SD).
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Bouncing {
    pub seconds: f64,
    pub gravity: f64,
    pub stiffness: f64,
    pub floor: Floor,
    pub start: BouncingStart,
    environments: BTreeMap<String, Vec<Block>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Floor {
    pub colour: [f32; 3],
    pub reflectance: f64,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BouncingStart {
    pub low: [f64; 3],
    pub high: [f64; 3],
    pub speed_inwards: [f64; 2],
    pub speed_up: [f64; 2],
    pub jitter: f64,
}

/// A box.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Block {
    pub position: [f64; 3],
    pub half_size: [f64; 3],
    /// About z, degrees.
    pub yaw: f64,
    pub colour: [f32; 3],
    pub alpha: f64,
}

/// The spring's set.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Spring {
    pub seconds: f64,
    pub stiffness: f64,
    camera: [f64; 3],
    pub start: SpringStart,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SpringStart {
    pub component: [f64; 2],
    pub least_distance: f64,
}

/// Read once; the file is part of the crate, and a test reads all of it.
static PAPER: LazyLock<std::result::Result<Paper, String>> =
    LazyLock::new(|| serde_json::from_str(include_str!("paper.json")).map_err(|error| error.to_string()));

impl Paper {
    pub(super) fn get() -> Result<&'static Self> {
        PAPER.as_ref().map_err(Error::format("paper.json"))
    }

    /// Camera `number` (as in the paper) of the bouncing ball's sets.
    pub(super) fn camera(&self, number: usize) -> Result<Camera> {
        let placed = self.cameras.get(&number.to_string()).ok_or_else(|| Error::Data {
            what: "--set".into(),
            reason: format!("there is no camera {number}; there are 1 to {}", self.cameras.len()),
        })?;
        self.placed(placed)
    }

    /// The spring set's camera.
    pub(super) fn spring_camera(&self) -> Result<Camera> {
        self.placed(&self.spring.camera)
    }

    /// A camera at an azimuth, an elevation (degrees) and a distance (m), looking at the origin.
    fn placed(&self, &[azimuth, elevation, distance]: &[f64; 3]) -> Result<Camera> {
        let (a, e) = (azimuth.to_radians(), elevation.to_radians());
        let forward = Vector3::new(e.cos() * a.cos(), e.cos() * a.sin(), e.sin());
        let right = forward.cross(&Vector3::z()).normalize();
        let rotation = Matrix3::from_rows(&[right.transpose(), forward.cross(&right).transpose(), forward.transpose()]);
        let [width, height] = self.size.xy();
        let focal = height / 2.0 / (self.field_of_view.to_radians() / 2.0).tan();
        let middle = [(width - 1.0) / 2.0, (height - 1.0) / 2.0];
        let intrinsic = Matrix3::new(focal, 0.0, middle[0], 0.0, focal, middle[1], 0.0, 0.0, 1.0);
        Camera::new(self.size, intrinsic, Distortion::default(), rotation, rotation * forward * distance)
    }

    /// The boxes of an environment.
    pub(super) fn blocks(&self, environment: usize) -> Result<&[Block]> {
        let blocks = self.bouncing.environments.get(&environment.to_string());
        blocks.map(Vec::as_slice).ok_or_else(|| Error::Data {
            what: "--set".into(),
            reason: format!("there is no environment {environment}"),
        })
    }

    /// What the physics needs to know of an environment.
    pub(super) fn scene(&self, environment: usize) -> Result<Scene> {
        let boxes: Vec<_> = (self.blocks(environment)?.iter())
            .map(|block| {
                serde_json::json!({"position": block.position, "half_size": block.half_size, "yaw": block.yaw.to_radians()})
            })
            .collect();
        let scene = serde_json::json!({
            "gravity": [0.0, 0.0, -self.bouncing.gravity],
            "ball": {"radius": self.ball.radius, "mass": self.ball.mass},
            "contact": {"model": "spring", "stiffness": self.bouncing.stiffness},
            "floor": {"height": 0.0}, "boxes": boxes,
        });
        Scene::from_json(&scene.to_string(), "paper.json")
    }

    /// The same of the spring set.
    pub(super) fn spring_scene(&self) -> Result<Scene> {
        let scene = serde_json::json!({
            "gravity": [0.0, 0.0, 0.0],
            "ball": {"radius": self.ball.radius, "mass": self.ball.mass},
            "spring": {"stiffness": self.spring.stiffness, "anchor": [0.0, 0.0, 0.0]},
        });
        Scene::from_json(&scene.to_string(), "paper.json")
    }

    /// The spring's angular frequency, rad/s.
    pub(super) fn spring_frequency(&self) -> f64 {
        (self.spring.stiffness / self.ball.mass).sqrt()
    }
}
