//! How a camera moves: it turns about its own centre and zooms.

use nalgebra::{Point3, Rotation3, Vector3};
use rand::RngExt;

use super::super::looking;
use gravisight_geometry::camera::{Camera, Distortion};
use gravisight_geometry::error::Result;
use gravisight_geometry::random::Random;
use gravisight_geometry::size::Size;

/// Step of an operator's way, s.
const STEP: f64 = 0.02;
/// How far a hand-held picture goes at most from its middle, px of a picture of [`WIDE`] px.
const SWAY: std::ops::Range<f64> = 6.0..60.0;
const WIDE: f64 = 1280.0;
/// Slow parts of a hand's sway and its tremor: how often a second.
const SLOW: std::ops::Range<f64> = 0.12..1.1;
const TREMOR: std::ops::Range<f64> = 4.0..9.0;
/// Strength of the tremor, px of a picture of [`WIDE`] px: of hands, and of an operator.
const TREMBLES: [f64; 2] = [1.5, 0.3];
/// Roll of a hand-held camera, radians.
const ROLL: f64 = 0.03;
/// How much of the ball's way an operator follows, and how fast, 1/s.
const FOLLOWS: std::ops::Range<f64> = 0.25..0.9;
const HASTE: std::ops::Range<f64> = 1.5..4.0;
/// Strongest zoom, logarithm, and how often a second it comes and goes.
const ZOOM: f64 = 0.2;
const ZOOMS: std::ops::Range<f64> = 0.05..0.25;

/// How a clip's camera moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Moves {
    /// Not at all.
    Still,
    /// In somebody's hands.
    Sway,
    /// On a head: an operator follows the play, and zooms.
    Pan,
}

impl Moves {
    /// As in a clip's truth.
    pub fn name(self) -> &'static str {
        match self {
            Self::Still => "still",
            Self::Sway => "sway",
            Self::Pan => "pan",
        }
    }

    /// Half of the clips stand still, a quarter sways, a quarter pans.
    pub(super) fn draw(random: &mut Random) -> Self {
        match random.random_range(0..4) {
            0 | 1 => Self::Still,
            2 => Self::Sway,
            _ => Self::Pan,
        }
    }
}

/// Where a camera stands, looks in its middle position, and how large it sees.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stand {
    pub eye: Vector3<f64>,
    pub target: Vector3<f64>,
    /// px.
    pub focal: f64,
    pub size: Size,
    /// Radians about the axis.
    pub roll: f64,
}

/// A sine: strength of yaw, pitch and roll, radians; how often a second; where it begins, radians.
#[derive(Debug, Clone)]
struct Swing {
    strength: [f64; 3],
    rate: f64,
    phase: [f64; 3],
}

/// A camera's way through a clip.
#[derive(Debug, Clone)]
pub(super) struct Way {
    stand: Stand,
    swings: Vec<Swing>,
    /// Yaw and pitch that are added, radians, every [`STEP`].
    followed: Vec<[f64; 2]>,
    /// Strength, how often a second, phase.
    zoom: [f64; 3],
}

impl Stand {
    /// Yaw and pitch of a direction, radians.
    fn bearing(&self, to: Vector3<f64>) -> [f64; 2] {
        let way = to - self.eye;
        [way.y.atan2(way.x), way.z.atan2(way.x.hypot(way.y))]
    }

    /// Turned by so much, with a focal length of so many times its own.
    fn camera(&self, [yaw, pitch, roll]: [f64; 3], zoom: f64) -> Result<Camera> {
        let [own, height] = self.bearing(self.target);
        let (yaw, pitch) = (own + yaw, height + pitch);
        let forward = Vector3::new(pitch.cos() * yaw.cos(), pitch.cos() * yaw.sin(), pitch.sin());
        let upright = looking(self.eye, forward, zoom * self.focal, self.size, Distortion::default())?;
        Ok(upright.turned(&Rotation3::from_axis_angle(&Vector3::z_axis(), self.roll + roll)))
    }
}

impl Way {
    /// A way of `lasts` seconds; `ball` is where the ball is at a time.
    pub fn draw(
        stand: Stand,
        moves: Moves,
        lasts: f64,
        ball: impl Fn(f64) -> Point3<f64>,
        random: &mut Random,
    ) -> Self {
        let mut way = Self { stand, swings: vec![], followed: vec![], zoom: [0.0, 1.0, 0.0] };
        let wide = f64::from(stand.size.width.max(stand.size.height));
        let angle = |px: f64| px * wide / WIDE / stand.focal;
        match moves {
            Moves::Still => {}
            Moves::Sway => {
                let most = angle((random.random_range(SWAY.start.ln()..SWAY.end.ln())).exp());
                let roll = random.random_range(0.1..1.0) * ROLL;
                for _ in 0..3 {
                    way.swings.push(Swing::draw([most / 3.0, most / 4.0, roll / 3.0], SLOW, random));
                }
                way.tremble(angle(TREMBLES[0]), random);
            }
            Moves::Pan => {
                way.follow(lasts, ball, random);
                way.zoom = [
                    random.random_range(0.0..ZOOM),
                    random.random_range(ZOOMS),
                    random.random_range(0.0..std::f64::consts::TAU),
                ];
                way.tremble(angle(TREMBLES[1]), random);
            }
        }
        way
    }

    fn tremble(&mut self, most: f64, random: &mut Random) {
        for _ in 0..2 {
            let strength = most * random.random_range(0.1..0.5);
            self.swings.push(Swing::draw([strength, strength, 0.2 * strength], TREMOR, random));
        }
    }

    /// A head with inertia that goes after the ball.
    fn follow(&mut self, lasts: f64, ball: impl Fn(f64) -> Point3<f64>, random: &mut Random) {
        let (fraction, haste) = (random.random_range(FOLLOWS), random.random_range(HASTE));
        let middle = self.stand.bearing(self.stand.target);
        // Up and down an operator hardly follows.
        let fractions = [fraction, 0.25 * fraction];
        let goal = |time: f64| -> [f64; 2] {
            let seen = self.stand.bearing(ball(time).coords);
            std::array::from_fn(|axis| {
                let off = seen[axis] - middle[axis];
                let off = off - std::f64::consts::TAU * (off / std::f64::consts::TAU).round();
                fractions[axis] * off.clamp(-0.6, 0.6)
            })
        };
        let (mut at, mut speed) = (goal(0.0), [0.0; 2]);
        let mut followed = Vec::new();
        for step in 0..=(lasts / STEP) as usize + 2 {
            followed.push(at);
            let to = goal((step as f64 * STEP).min(lasts));
            for axis in 0..2 {
                // Critically damped.
                speed[axis] += STEP * (haste * haste * (to[axis] - at[axis]) - 2.0 * haste * speed[axis]);
                at[axis] += STEP * speed[axis];
            }
        }
        self.followed = followed;
    }

    /// The camera at a time, s.
    ///
    /// # Errors
    /// As [`Camera::new`].
    pub fn at(&self, time: f64) -> Result<Camera> {
        let mut turned = [0.0; 3];
        for swing in &self.swings {
            for (axis, turned) in turned.iter_mut().enumerate() {
                *turned += swing.strength[axis] * (std::f64::consts::TAU * swing.rate * time + swing.phase[axis]).sin();
            }
        }
        if let Some(last) = self.followed.len().checked_sub(2) {
            let place = (time.max(0.0) / STEP).min(last as f64);
            let (index, fraction) = (place as usize, place.fract());
            let [a, b] = [self.followed[index], self.followed[(index + 1).min(last + 1)]];
            (0..2).for_each(|axis| turned[axis] += a[axis] + fraction * (b[axis] - a[axis]));
        }
        let [strength, rate, phase] = self.zoom;
        let zoom = (strength * (std::f64::consts::TAU * rate * time + phase).sin()).exp();
        self.stand.camera(turned, zoom)
    }

    /// A camera of the same centre and middle direction that sees all that is seen until `lasts`, s.
    ///
    /// # Errors
    /// As [`Camera::new`].
    pub fn panorama(&self, lasts: f64) -> Result<Camera> {
        let middle = self.stand.camera([0.0; 3], 1.0)?;
        let [width, height] = self.stand.size.xy();
        let mut bounds = [0.0, 0.0, width - 1.0, height - 1.0];
        let mut time = 0.0;
        while time <= lasts + STEP {
            let camera = self.at(time)?;
            for corner in [[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]] {
                let far = camera.world_from_image(&corner.into(), 1.0)?;
                let at = middle.image_from_world(&far)?;
                bounds = [bounds[0].min(at.x), bounds[1].min(at.y), bounds[2].max(at.x), bounds[3].max(at.y)];
            }
            time += STEP;
        }
        if self.swings.is_empty() && self.followed.is_empty() {
            return Ok(middle);
        }
        let [left, top] = [bounds[0].floor() - 3.0, bounds[1].floor() - 3.0];
        let size = Size::new((bounds[2] - left) as u32 + 4, (bounds[3] - top) as u32 + 4);
        middle.cropped([left, top], size)
    }
}

impl Swing {
    fn draw(strength: [f64; 3], rates: std::ops::Range<f64>, random: &mut Random) -> Self {
        let mut phase = || random.random_range(0.0..std::f64::consts::TAU);
        Self { strength, phase: [phase(), phase(), phase()], rate: random.random_range(rates) }
    }
}
