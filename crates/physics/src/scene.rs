//! `scene.json` (`docs/formats.md`): what the physics needs to know of a place and its ball.

use nalgebra::{Matrix3, Point3, Quaternion, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use super::state::State;
use gravisight_geometry::error::{Error, Result, json_refusal};
use gravisight_geometry::volume::Volume;

/// Cosine of the largest angle between a wall's normal and a world axis at which the wall bounds the scene's volume.
const ALONG_AXIS: f64 = 0.9999;
/// How far a position may be outside the scene's volume: so many radii, and a place that was not measured better, m.
const PRESSED: f64 = 1.0;
const UNSURE: f64 = 0.1;

/// What a scene's file is, for who gave another.
const EXPECTED: &str = "a scene is a JSON object with gravity and ball at least; `gravisight scene tennis` prints one, and `gravisight \
                        scene` lists the sports whose names can be given instead (`Toolbox.scenes` in JavaScript)";

/// A place: gravity, a ball, what it can touch. World frame, z up; SI units, radians.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Gravitational acceleration, m/s².
    pub gravity: [f64; 3],
    /// The ball.
    pub ball: Ball,
    /// What happens when the ball touches something.
    #[serde(default)]
    pub contact: Contact,
    /// A horizontal floor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub floor: Option<Floor>,
    /// Infinite planes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub walls: Vec<Wall>,
    /// Boxes in any orientation.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub boxes: Vec<Cuboid>,
    /// A linear spring between the ball's centre and a fixed point.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spring: Option<Spring>,
    /// Lines on the ground and on walls, from a point to a point, m: to be drawn, and to calibrate by.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lines: Vec<[[f64; 3]; 2]>,
    /// The upper edge of a net, from post to post, m: to be drawn. What it does to the ball is a hit.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub net: Vec<[f64; 3]>,
    /// Where the ball can be in play: what a picture shows elsewhere is no ball of this scene.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bounds: Option<Bounds>,
}

/// A box along the world's axes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(deny_unknown_fields)]
pub struct Bounds {
    /// Its lowest corner, m.
    pub low: [f64; 3],
    /// Its highest corner, m.
    pub high: [f64; 3],
}

/// The ball's own properties.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(deny_unknown_fields)]
pub struct Ball {
    /// Radius, m.
    pub radius: f64,
    /// Mass, kg.
    #[serde(default = "one")]
    pub mass: f64,
    /// C_d of the drag ½·ρ·A·C_d·|v|·v.
    #[serde(default)]
    pub drag_coefficient: f64,
    /// C_l of the Magnus force ½·ρ·A·R·C_l·ω×v: lift coefficient per unit of the spin parameter R|ω|/|v|.
    #[serde(default)]
    pub lift_coefficient: f64,
    /// Density of the air ρ, kg/m³.
    #[serde(default = "air_density")]
    pub air_density: f64,
    /// Default angular velocity ω of a start, world axes, rad/s.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub spin: [f64; 3],
    /// Rate at which the spin decays in flight, 1/s; 0: constant.
    #[serde(default)]
    pub spin_decay: f64,
    /// Standard deviation of each component of a spin that is not known, rad/s; what the ball's surface reaches where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spin_sigma: Option<f64>,
    /// Standard deviation of the drag coefficient, as a share of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drag_sigma: Option<f64>,
    /// Speed above which its sport has never had it, m/s: a fit goes no faster.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed_max: Option<f64>,
    /// Moment of inertia / (mass·radius²): 2/5 for a solid ball, 2/3 for a hollow one.
    #[serde(default = "solid_ball")]
    pub inertia_factor: f64,
}

/// The contact models; `contact` in `docs/formats.md` says what their fields mean.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(tag = "model", rename_all = "snake_case", deny_unknown_fields)]
pub enum Contact {
    /// The paper's soft potentials (its eq. for V_F, V_W, V_O, signs as derived from them); the ball is a point.
    Penalty {
        /// Acceleration of the soft walls, m/s².
        #[serde(default = "penalty_c")]
        c: f64,
        /// Sharpness of floor, walls and gravity's ReLU, 1/m.
        #[serde(default = "penalty_beta")]
        beta: f64,
        /// Sharpness of the boxes, 1/m.
        #[serde(default = "penalty_beta_box")]
        beta_box: f64,
    },
    /// A sphere pushed out along the contact normal by `stiffness` times its penetration.
    Spring {
        /// Stiffness per unit mass, 1/s².
        #[serde(default = "sphere_stiffness")]
        stiffness: f64,
    },
    /// A rigid sphere, reflected at the instant of contact.
    Bounce {
        /// Normal speed after / before.
        #[serde(default = "one")]
        restitution: f64,
        /// Coulomb's coefficient for the tangential impulse at the contact point.
        #[serde(default)]
        friction: f64,
        /// Standard deviation of the restitution from one bounce to another, as a share of it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        restitution_sigma: Option<f64>,
        /// The same of what friction does to the velocity, as a share of the closing speed.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        friction_sigma: Option<f64>,
    },
}

/// A horizontal plane; the ball is above it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(deny_unknown_fields)]
pub struct Floor {
    /// Its z, m.
    pub height: f64,
}

/// An infinite plane; the ball is on the side that `normal` points to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(deny_unknown_fields)]
pub struct Wall {
    /// A point of the plane, m.
    pub point: [f64; 3],
    /// Its normal, of any length.
    pub normal: [f64; 3],
}

/// A box.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(deny_unknown_fields)]
pub struct Cuboid {
    /// Its centre, m.
    pub position: [f64; 3],
    /// Half its extent along its own axes, m.
    pub half_size: [f64; 3],
    /// Angle from world x to its own x, about z, rad; of a box that stands upright.
    #[serde(default, skip_serializing_if = "is_zero_angle")]
    pub yaw: f64,
    /// Its orientation in place of `yaw`: a ramp, a tilted board.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotation: Option<Rotation>,
}

/// The orientation of a box: from its own axes to the world's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(untagged)]
pub enum Rotation {
    /// w, x, y, z; of any length.
    Quaternion([f64; 4]),
    /// By row.
    Matrix([[f64; 3]; 3]),
}

impl Rotation {
    /// Largest departure of a rotation's columns from being of length 1 and perpendicular.
    const CROOKED: f64 = 1e-6;

    /// The matrix; of a quaternion without length none that is finite.
    fn matrix(self) -> Matrix3<f64> {
        match self {
            Self::Quaternion([w, x, y, z]) => {
                *UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z)).to_rotation_matrix().matrix()
            }
            Self::Matrix(rows) => Matrix3::from_fn(|row, column| rows[row][column]),
        }
    }

    pub(super) fn is_proper(self) -> bool {
        let matrix = self.matrix();
        (matrix.tr_mul(&matrix) - Matrix3::identity()).amax() < Self::CROOKED && matrix.determinant() > 0.0
    }
}

impl Cuboid {
    /// One that stands upright, its own x `yaw` rad from the world's.
    pub const fn upright(position: [f64; 3], half_size: [f64; 3], yaw: f64) -> Self {
        Self { position, half_size, yaw, rotation: None }
    }

    /// Its own axes in the world's.
    pub fn world_from_box(&self) -> Matrix3<f64> {
        let (sin, cos) = self.yaw.sin_cos();
        let upright = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
        self.rotation.map_or(upright, Rotation::matrix)
    }
}

/// A spring that obeys Hooke's law.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(deny_unknown_fields)]
pub struct Spring {
    /// Stiffness k, N/m.
    pub stiffness: f64,
    /// Where it is fixed, m.
    #[serde(default)]
    pub anchor: [f64; 3],
}

impl Ball {
    /// A solid ball of 1 kg on which the air does nothing; `radius` in m.
    pub const fn new(radius: f64) -> Self {
        Self {
            radius,
            mass: one(),
            drag_coefficient: 0.0,
            lift_coefficient: 0.0,
            air_density: air_density(),
            spin: [0.0; 3],
            spin_decay: 0.0,
            spin_sigma: None,
            drag_sigma: None,
            speed_max: None,
            inertia_factor: solid_ball(),
        }
    }
}

impl Contact {
    /// A rigid sphere's, known exactly.
    pub const fn bounce(restitution: f64, friction: f64) -> Self {
        Self::Bounce { restitution, friction, restitution_sigma: None, friction_sigma: None }
    }
}

impl Default for Contact {
    /// The ideal: rigid, without loss or friction.
    fn default() -> Self {
        Self::bounce(1.0, 0.0)
    }
}

const fn one() -> f64 {
    1.0
}

/// The standard atmosphere's, at 20 °C.
const fn air_density() -> f64 {
    1.2
}

const fn solid_ball() -> f64 {
    0.4
}

/// The paper's c, m/s².
fn penalty_c() -> f64 {
    1000.0
}

/// The published value for the real data set, 1/m.
fn penalty_beta() -> f64 {
    200.0
}

/// The paper's β_o, 1/m.
fn penalty_beta_box() -> f64 {
    66.0
}

/// What the synthetic data set's simulator uses, 1/s².
fn sphere_stiffness() -> f64 {
    1000.0
}

fn is_zero_angle(angle: &f64) -> bool {
    *angle == 0.0
}

fn is_zero(vector: &[f64; 3]) -> bool {
    *vector == [0.0; 3]
}

impl Scene {
    /// Where the ball's centre can be: within the scene's bounds, above its floor, before its walls (of those along the world's axes);
    /// none where the scene says nothing of it. A ball that is pressed, or not measured to the centimetre, is still inside.
    pub fn volume(&self) -> Option<Volume> {
        let mut volume = Volume::ALL;
        if let Some(Bounds { low, high }) = self.bounds {
            volume = Volume { low, high };
        }
        if let Some(floor) = &self.floor {
            volume.low[2] = volume.low[2].max(floor.height);
        }
        for wall in &self.walls {
            let normal = Vector3::from(wall.normal).normalize();
            for axis in 0..3 {
                if normal[axis] > ALONG_AXIS {
                    volume.low[axis] = volume.low[axis].max(wall.point[axis]);
                } else if normal[axis] < -ALONG_AXIS {
                    volume.high[axis] = volume.high[axis].min(wall.point[axis]);
                }
            }
        }
        let margin = PRESSED * self.ball.radius + UNSURE;
        volume.low.iter_mut().for_each(|side| *side -= margin);
        volume.high.iter_mut().for_each(|side| *side += margin);
        (volume != Volume::ALL).then_some(volume)
    }

    /// Points of what stands at a known place, m: ends of lines, a net, boxes. Empty where the scene has none of them.
    pub fn landmarks(&self) -> Vec<Point3<f64>> {
        let ends = self.lines.iter().flatten().chain(&self.net).chain(self.boxes.iter().map(|it| &it.position));
        ends.map(|&point| point.into()).collect()
    }

    /// Speed at which the ball falls steadily through the air, m/s; infinite without drag.
    #[doc(hidden)]
    pub fn terminal_speed(&self) -> f64 {
        let ball = &self.ball;
        let area = std::f64::consts::PI * ball.radius.powi(2);
        let pressure = 0.5 * ball.air_density * area * ball.drag_coefficient / ball.mass;
        (self.gravity.iter().map(|g| g * g).sum::<f64>().sqrt() / pressure).sqrt()
    }

    /// Nothing but a ball of 1 kg under gravity (m/s²); `radius` in m. All that a scene has besides are its fields; a sport's is
    /// [`Scene::named`], and its ball [`Scene::with_ball`].
    ///
    /// ```
    /// # mod gravisight { pub use gravisight_geometry::error::*; pub use gravisight_physics::{self as physics, *}; }
    /// use gravisight::physics::{Contact, Cuboid, Forecaster, Scene};
    ///
    /// let bench = Cuboid::upright([0.0, 2.0, 0.2], [0.5, 0.2, 0.2], 0.0);
    /// let mut scene = Scene::new([0.0, 0.0, -9.81], 0.0335).with_ball("tennis")?.with_floor(0.0);
    /// scene.boxes.push(bench);
    /// scene.contact = Contact::bounce(0.8, 0.5);
    /// let forecaster = Forecaster::new(&scene)?;
    /// let start = scene.start([0.0, 0.0, 1.0].into(), [0.0, 2.0, 0.0].into());
    /// assert_eq!(forecaster.forecast(&start, &[0.6]).impacts.len(), 1);
    /// # Ok::<(), gravisight::Error>(())
    /// ```
    pub fn new(gravity: [f64; 3], radius: f64) -> Self {
        Self {
            gravity,
            ball: Ball::new(radius),
            contact: Contact::default(),
            floor: None,
            walls: vec![],
            boxes: vec![],
            spring: None,
            lines: vec![],
            net: vec![],
            bounds: None,
        }
    }

    /// The scene with a level floor at this height, m.
    pub fn with_floor(self, height: f64) -> Self {
        Self { floor: Some(Floor { height }), ..self }
    }

    /// A start (m, m/s) with the scene's spin.
    pub fn start(&self, position: Point3<f64>, velocity: Vector3<f64>) -> State {
        State { position, velocity, spin: self.ball.spin.into() }
    }

    /// A state (m, m/s) in the middle of a flight, `time` s after the start: with what the air has left of the scene's
    /// spin.
    pub fn in_flight(&self, position: Point3<f64>, velocity: Vector3<f64>, time: f64) -> State {
        let start = self.start(position, velocity);
        State { spin: start.spin * (-self.ball.spin_decay * time).exp(), ..start }
    }

    /// Reads the text of a `scene.json`; `what` names it in errors.
    ///
    /// # Errors
    /// [`Error::Format`] for a text of another form (the field is named), else as [`Self::check`].
    pub fn from_json(text: &str, what: &str) -> Result<Self> {
        let refuse = |error| Error::format(what)(json_refusal(&error)).expecting(EXPECTED);
        let scene: Self = serde_json::from_str(text).map_err(refuse)?;
        scene.check(what)?;
        Ok(scene)
    }

    /// Reads a `scene.json` file.
    ///
    /// # Errors
    /// [`Error::Io`], else as [`Self::from_json`].
    #[cfg(not(target_arch = "wasm32"))]
    pub fn from_file(path: &std::path::Path) -> Result<Self> {
        let text = gravisight_geometry::files::read_text(path).map_err(|error| error.expecting(EXPECTED))?;
        Self::from_json(&text, &path.display().to_string())
    }
}
