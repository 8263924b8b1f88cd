//! The scenes of the paper's data sets and of the room in the place of its real one, from `paper.json`: what both engines are fed with.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use nalgebra::Vector3;
use serde::Deserialize;
use serde_json::json;

use super::{Site, looking};
use gravisight_geometry::camera::{Camera, Distortion};
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::size::Size;
use gravisight_physics::Scene;

/// All of the description.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Paper {
    #[serde(rename = "about")]
    _about: String,
    pub size: Size,
    pub field_of_view: f64,
    pub fps: f64,
    pub ball: BallLook,
    pub light: Light,
    pub headlight: Headlight,
    pub material: Material,
    cameras: BTreeMap<String, [f64; 3]>,
    pub bouncing: Bouncing,
    pub spring: SpringSet,
    pub disturbances: Disturbances,
    pub room: Room,
}

/// What clips to test with may have that their scenes do not say.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Disturbances {
    /// A constant acceleration, m/s².
    pub wind: [f64; 3],
    pub hand: Hand,
    pub ball_scale: f64,
    /// Colour of a floor with nothing on it.
    pub bare_floor: [f32; 3],
}

/// A push at some time of the clip.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Hand {
    /// Change of the velocity, m/s.
    pub speed: f64,
    /// When, as fractions of the clip's time.
    pub between: [f64; 2],
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BallLook {
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
    pub floor: SceneFloor,
    pub start: BouncingStart,
    environments: BTreeMap<String, Vec<SceneBlock>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SceneFloor {
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
pub(super) struct SceneBlock {
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
pub(super) struct SpringSet {
    pub seconds: f64,
    pub stiffness: f64,
    camera: [f64; 3],
    /// The ball in the centre, which does not move.
    pub anchor: BallLook,
    pub start: SpringStart,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SpringStart {
    pub component: [f64; 2],
    /// Of that of a circle, as a factor.
    pub speed: [f64; 2],
    pub least_distance: f64,
}

/// The room in the place of the paper's real data set: two walls and a box in the corner.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Room {
    size: Size,
    field_of_view: f64,
    pub fps: f64,
    pub frames: usize,
    gravity: f64,
    pub ball: BallLook,
    restitution: f64,
    friction: f64,
    cameras: BTreeMap<String, RoomCamera>,
    pub light: Light,
    pub floor: SceneFloor,
    pub walls: Vec<RoomWall>,
    boxes: Vec<SceneBlock>,
    /// Clips of each camera, by split.
    pub clips: BTreeMap<String, Vec<usize>>,
    /// Standard deviation of the 2D labels, as of clicks, px.
    pub label_noise_px: f64,
    pub start: RoomStart,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RoomCamera {
    position: [f64; 3],
    /// What it looks at.
    target: [f64; 3],
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RoomWall {
    pub point: [f64; 3],
    pub normal: [f64; 3],
    pub colour: [f32; 3],
}

/// A throw: from a place, at a speed, towards a target; the clip starts some time after.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RoomStart {
    pub low: [f64; 3],
    pub high: [f64; 3],
    pub speed: [f64; 2],
    pub target_low: [f64; 3],
    pub target_high: [f64; 3],
    /// Latest start of a clip after the throw, s.
    pub latest: f64,
    /// Distances from the camera, m.
    pub nearest: f64,
    pub farthest: f64,
}

/// Read once; the file is part of the crate, and a test reads all of it.
static PAPER: LazyLock<std::result::Result<Paper, String>> =
    LazyLock::new(|| serde_json::from_str(include_str!("paper.json")).map_err(|error| error.to_string()));

impl Paper {
    pub(super) fn get() -> Result<&'static Self> {
        PAPER.as_ref().map_err(Error::format("paper.json"))
    }

    /// Camera `number` (as in the paper) of a place; its pictures have `size`, or the paper's.
    pub(super) fn camera(&self, site: Site, number: usize, size: Option<Size>) -> Result<Camera> {
        let none = |count: usize| Error::Data {
            what: "--set".into(),
            reason: format!("there is no camera {number}; choose 1 to {count}"),
        };
        match site {
            Site::Environment(_) => {
                let placed = self.cameras.get(&number.to_string()).ok_or_else(|| none(self.cameras.len()))?;
                self.around_origin(placed, size)
            }
            Site::Spring => self.around_origin(&self.spring.camera, size),
            Site::Room => {
                let cameras = &self.room.cameras;
                let RoomCamera { position, target } =
                    cameras.get(&number.to_string()).ok_or_else(|| none(cameras.len()))?;
                let forward = (Vector3::from(*target) - Vector3::from(*position)).normalize();
                seeing(Vector3::from(*position), forward, size.unwrap_or(self.room.size), self.room.field_of_view)
            }
        }
    }

    /// A camera at an azimuth, an elevation (degrees) and a distance (m), looking at the origin.
    fn around_origin(&self, &[azimuth, elevation, distance]: &[f64; 3], size: Option<Size>) -> Result<Camera> {
        let (a, e) = (azimuth.to_radians(), elevation.to_radians());
        let forward = Vector3::new(e.cos() * a.cos(), e.cos() * a.sin(), e.sin());
        seeing(-forward * distance, forward, size.unwrap_or(self.size), self.field_of_view)
    }

    /// The ball that moves.
    pub(super) fn ball(&self, site: Site) -> &BallLook {
        if site == Site::Room { &self.room.ball } else { &self.ball }
    }

    /// The spot light.
    pub(super) fn light(&self, site: Site) -> &Light {
        if site == Site::Room { &self.room.light } else { &self.light }
    }

    /// The floor, where there is one.
    pub(super) fn floor(&self, site: Site) -> Option<&SceneFloor> {
        match site {
            Site::Environment(_) => Some(&self.bouncing.floor),
            Site::Spring => None,
            Site::Room => Some(&self.room.floor),
        }
    }

    /// The walls.
    pub(super) fn walls(&self, site: Site) -> &[RoomWall] {
        if site == Site::Room { &self.room.walls } else { &[] }
    }

    /// The ball in the centre, where there is one.
    pub(super) fn anchor(&self, site: Site) -> Option<&BallLook> {
        (site == Site::Spring).then_some(&self.spring.anchor)
    }

    /// The boxes.
    pub(super) fn blocks(&self, site: Site) -> Result<&[SceneBlock]> {
        match site {
            Site::Spring => Ok(&[]),
            Site::Room => Ok(&self.room.boxes),
            Site::Environment(number) => {
                let blocks = self.bouncing.environments.get(&number.to_string());
                blocks.map(Vec::as_slice).ok_or_else(|| Error::Data {
                    what: "--set".into(),
                    reason: format!("there is no environment {number}"),
                })
            }
        }
    }

    /// What the physics needs to know of a place.
    pub(super) fn scene(&self, site: Site) -> Result<Scene> {
        let BallLook { radius, mass, .. } = self.ball(site);
        let ball = json!({"radius": radius, "mass": mass});
        let boxes: Vec<_> = (self.blocks(site)?.iter())
            .map(|block| json!({"position": block.position, "half_size": block.half_size, "yaw": block.yaw.to_radians()}))
            .collect();
        let scene = match site {
            Site::Environment(_) => json!({
                "gravity": [0.0, 0.0, -self.bouncing.gravity],
                "ball": ball,
                "contact": {"model": "spring", "stiffness": self.bouncing.stiffness},
                "floor": {"height": 0.0}, "boxes": boxes,
            }),
            Site::Spring => json!({
                "gravity": [0.0, 0.0, 0.0],
                "ball": ball,
                "spring": {"stiffness": self.spring.stiffness, "anchor": [0.0, 0.0, 0.0]},
            }),
            Site::Room => {
                let wall = |wall: &RoomWall| json!({"point": wall.point, "normal": wall.normal});
                json!({
                    "gravity": [0.0, 0.0, -self.room.gravity],
                    "ball": ball,
                    "contact": {"model": "bounce", "restitution": self.room.restitution, "friction": self.room.friction},
                    "floor": {"height": 0.0}, "boxes": boxes,
                    "walls": self.room.walls.iter().map(wall).collect::<Vec<_>>(),
                })
            }
        };
        Scene::from_json(&scene.to_string(), "paper.json")
    }

    /// The spring's angular frequency, rad/s.
    pub(super) fn spring_frequency(&self) -> f64 {
        (self.spring.stiffness / self.ball.mass).sqrt()
    }
}

/// A camera at `position` that looks `forward`; `field_of_view` is vertical, degrees.
fn seeing(position: Vector3<f64>, forward: Vector3<f64>, size: Size, field_of_view: f64) -> Result<Camera> {
    let focal = f64::from(size.height) / 2.0 / (field_of_view.to_radians() / 2.0).tan();
    looking(position, forward, focal, size, Distortion::default())
}
