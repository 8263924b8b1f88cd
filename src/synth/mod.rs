//! The paper's synthetic data sets, and a room in the place of its real one, made by one of two engines: the built-in one (the
//! forecaster and a ray-caster), or the paper's, MuJoCo.
//!
//! Clips are drawn from (seed, split, environment, camera, number) alone, so SD-S is a part of SD-M, and SD-M of SD-L.
//! Both engines draw the same starts. One whose ball leaves the picture is drawn again; there the engines' paths,
//! millimetres apart (after many bounces centimetres), may in rare cases disagree, and a clip differ.

#[cfg(not(target_arch = "wasm32"))]
mod broadcast;
mod looking;
#[cfg(all(feature = "mujoco", libmujoco))]
mod mujoco;
mod random;
mod render;
mod scenes;
mod studio;
#[cfg(test)]
mod tests;

use std::f64::consts::TAU;

use image::RgbImage;
use nalgebra::{Point3, Vector2, Vector3};
use rand::RngExt;

#[cfg(not(target_arch = "wasm32"))]
pub use self::broadcast::{Film, Filmed, Kind};
pub use self::looking::looking;
#[cfg(all(feature = "mujoco", libmujoco))]
use self::mujoco::Mujoco;
#[cfg(not(target_arch = "wasm32"))]
#[cfg(not(target_arch = "wasm32"))]
pub(crate) use self::random::Spot;
pub use self::random::{Apparent, Drawing, LARGEST, RandomScenes, SMALLEST};
use self::render::Renderer;
use self::scenes::Paper;
use crate::camera::Camera;
use crate::clips::{Clip, Frame};
use crate::error::{Error, Result};
use crate::physics::{Forecaster, Scene, State, Status};
use crate::random::{Random, Stream, normal_pair};
use crate::size::Size;

/// Starts drawn before a clip is given up.
const TRIES: usize = 10_000;

/// A data set of the paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Set {
    /// One environment, one camera.
    SdS,
    /// One environment; training cameras 1 to 6, test cameras 1 to 9.
    SdM,
    /// Three environments, cameras as SD-M.
    SdL,
    /// A ball on a spring.
    Spring,
    /// The rendered room that stands in for the paper's real data set, which cannot be had: two cameras, labels as if clicked.
    Rd,
}

/// Which part of a set; parts never share a start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Split {
    /// To learn from.
    Train,
    /// To choose with.
    Val,
    /// To report.
    Test,
}

impl Split {
    /// As in clip ids.
    pub fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Val => "val",
            Self::Test => "test",
        }
    }
}

/// Where a ball moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// One of the paper's environments, by its number.
    Environment(usize),
    /// Around the fixed ball that the spring pulls it to.
    Spring,
    /// The room of the rendered RD.
    Room,
}

/// One place and one camera of a set: a studio in which clips are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shot {
    /// Where.
    pub place: Place,
    /// The paper's number of the camera; the spring has one of its own.
    pub camera: usize,
}

impl Set {
    /// Its shots.
    pub fn shots(self, split: Split) -> Vec<Shot> {
        let cameras = match (self, split) {
            (Self::SdS | Self::Spring, _) => 1..=1,
            (Self::Rd, _) => 1..=2,
            (_, Split::Train) => 1..=6,
            _ => 1..=9,
        };
        let places = match self {
            Self::Spring => vec![Place::Spring],
            Self::SdS | Self::SdM => vec![Place::Environment(1)],
            Self::SdL => [1, 2, 3].map(Place::Environment).to_vec(),
            Self::Rd => vec![Place::Room],
        };
        places.into_iter().flat_map(|place| cameras.clone().map(move |camera| Shot { place, camera })).collect()
    }
}

impl Shot {
    /// What the physics needs to know of its environment, or of the spring set.
    ///
    /// # Errors
    /// [`Error::Data`] for an environment that the paper does not have.
    pub fn scene(&self) -> Result<Scene> {
        Paper::get()?.scene(self.place)
    }

    /// How many clips of it the paper has in `split`.
    ///
    /// # Errors
    /// [`Error::Data`] for a camera that the paper does not have.
    pub fn clips(&self, split: Split) -> Result<usize> {
        let paper = Paper::get()?;
        let of_room = || paper.room.clips.get(split.name())?.get(self.camera.checked_sub(1)?).copied();
        match self.place {
            Place::Environment(_) | Place::Spring => Ok(100),
            Place::Room => of_room().ok_or_else(|| {
                let reason = format!("there is no camera {}", self.camera);
                Error::Data { what: "--set".into(), reason }
            }),
        }
    }

    /// A clip's id: `train/env1/cam1/0007`, `train/spring/0007`, `train/room/cam1/0007`.
    pub fn id(&self, split: Split, number: usize) -> String {
        let split = split.name();
        match self.place {
            Place::Environment(environment) => format!("{split}/env{environment}/cam{}/{number:04}", self.camera),
            Place::Spring => format!("{split}/spring/{number:04}"),
            Place::Room => format!("{split}/room/cam{}/{number:04}", self.camera),
        }
    }

    /// The folder of a clip's pictures, inside the set's.
    pub fn folder(&self, split: Split, number: usize) -> String {
        let split = split.name();
        match self.place {
            Place::Environment(environment) => format!("frames/{split}_e{environment}_c{}_{number:04}", self.camera),
            Place::Spring => format!("frames/{split}_spring_{number:04}"),
            Place::Room => format!("frames/{split}_room_c{}_{number:04}", self.camera),
        }
    }
}

/// What a clip to test with has that its scene does not say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Disturbance {
    /// A wind from the side, all the time.
    Wind,
    /// Somebody pushes the ball once.
    Hand,
    /// The ball that is drawn is a quarter larger.
    Ball,
    /// What is drawn behind the ball is an empty floor of another colour.
    Background,
}

/// What simulates and draws. Each thread has its own.
pub trait Engine {
    /// Where the ball's centre is (world frame, m) at `times` (s from the start, rising); [`None`] for a start that
    /// cannot be followed to the end.
    fn path(&mut self, start: &State, times: &[f64]) -> Option<Vec<Point3<f64>>>;

    /// The picture with the ball at `centre` (world frame, m).
    ///
    /// # Errors
    /// [`Error::Device`] if what draws fails.
    fn picture(&mut self, centre: &Point3<f64>) -> Result<RgbImage>;

    /// How far what each of its pixels shows is from the camera, along its axis, m, row by row; infinite where nothing is.
    /// Boxes that are seen through do not count.
    ///
    /// # Errors
    /// [`Error::Device`] if what draws fails.
    fn depth(&mut self, centre: &Point3<f64>) -> Result<Vec<f32>>;
}

/// The engine that is always there: a studio's forecaster and ray-caster.
struct Builtin<'a>(&'a Studio);

impl Engine for Builtin<'_> {
    fn path(&mut self, start: &State, times: &[f64]) -> Option<Vec<Point3<f64>>> {
        followed(&self.0.forecaster, start, times)
    }

    fn picture(&mut self, centre: &Point3<f64>) -> Result<RgbImage> {
        Ok(self.0.renderer.frame(centre))
    }

    fn depth(&mut self, centre: &Point3<f64>) -> Result<Vec<f32>> {
        self.0.renderer.depth(centre)
    }
}

/// Positions at `times`; [`None`] for a start that cannot be followed to the end.
fn followed(forecaster: &Forecaster, start: &State, times: &[f64]) -> Option<Vec<Point3<f64>>> {
    let forecast = forecaster.forecast(start, times);
    let whole = forecast.status == Status::Ok;
    whole.then(|| forecast.states.iter().map(|state| state.position).collect())
}

/// Knows one shot: draws its starts and labels its clips, whatever the engine.
pub struct Studio {
    paper: &'static Paper,
    shot: Shot,
    camera: Camera,
    scene: Scene,
    forecaster: Forecaster,
    renderer: Renderer,
    disturbance: Option<Disturbance>,
    /// Standard deviation of the 2D labels, px.
    label_noise: f64,
}

impl Studio {
    /// Prepares a shot.
    ///
    /// # Errors
    /// [`Error::Data`] for an environment or camera that the paper does not have.
    pub fn new(shot: Shot) -> Result<Self> {
        Self::of_size(shot, None)
    }

    /// The same, for pictures of another size than the paper's; the vertical field of view stays.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn of_size(shot: Shot, size: Option<Size>) -> Result<Self> {
        let paper = Paper::get()?;
        let camera = paper.camera(shot.place, shot.camera, size)?;
        let scene = shot.scene()?;
        let renderer = Renderer::new(paper, shot.place, &camera, None)?;
        let label_noise = if shot.place == Place::Room { paper.room.label_noise_px } else { 0.0 };
        let forecaster = Forecaster::new(&scene)?;
        Ok(Self { paper, shot, forecaster, renderer, camera, scene, disturbance: None, label_noise })
    }

    /// The same, its 2D labels as if clicked with this standard deviation, px.
    #[must_use]
    pub fn with_label_noise(self, label_noise: f64) -> Self {
        Self { label_noise, ..self }
    }

    /// The same place where something happens, or is seen, that its scene does not say; the built-in engine draws it.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn disturbed(mut self, disturbance: Disturbance) -> Result<Self> {
        self.renderer = Renderer::new(self.paper, self.shot.place, &self.camera, Some(disturbance))?;
        self.disturbance = Some(disturbance);
        Ok(self)
    }

    /// The built-in engine.
    pub fn builtin(&self) -> impl Engine {
        Builtin(self)
    }

    /// The paper's engine, on this thread.
    ///
    /// # Errors
    /// [`Error::Device`] where there is no OpenGL to draw with; [`Error::Data`] for a scene that MuJoCo refuses.
    #[cfg(all(feature = "mujoco", libmujoco))]
    pub fn mujoco(&self) -> Result<impl Engine> {
        Mujoco::new(self)
    }

    /// The ray-caster.
    #[cfg(test)]
    fn renderer(&self) -> &Renderer {
        &self.renderer
    }

    /// The place and its ball.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The camera.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Clip `number` of a split with its labels; its pictures are the engine's at its frames' positions.
    ///
    /// # Errors
    /// [`Error::Data`] if no start keeps the ball in the picture.
    pub fn clip(&self, engine: &mut dyn Engine, seed: u64, split: Split, number: usize) -> Result<Clip> {
        let id = self.shot.id(split, number);
        let mut random = Stream::Scene.of_named(seed, &id);
        let Paper { spring, bouncing, room, .. } = self.paper;
        let (fps, count) = match self.shot.place {
            Place::Environment(_) => (self.paper.fps, (bouncing.seconds * self.paper.fps).round() as usize),
            Place::Spring => (self.paper.fps, (spring.seconds * self.paper.fps).round() as usize),
            Place::Room => (room.fps, room.frames),
        };
        let times: Vec<f64> = (0..count).map(|frame| frame as f64 / fps).collect();
        let path = (0..TRIES).find_map(|_| self.path(engine, &mut random, &times)).ok_or_else(|| {
            let reason = format!("no start of {TRIES} keeps the ball in the picture");
            Error::Data { what: id.clone(), reason }
        })?;
        let folder = self.shot.folder(split, number);
        let mut clicks = Stream::LabelNoise.of_named(seed, &id);
        let frames = path.iter().zip(&times).enumerate().map(|(index, (centre, &t))| {
            let error = Vector2::from(normal_pair::<f64>(&mut clicks)) * self.label_noise;
            Ok(Frame {
                file: format!("{folder}/{index:03}.png").into(),
                t,
                image: Some((self.camera.image_from_world(centre)? + error).into()),
                visible: self.renderer.visible(centre) > 0.0,
                world: Some(centre.coords.into()),
            })
        });
        let frames = frames.collect::<Result<_>>()?;
        Ok(Clip { id, fps, camera: self.camera.clone(), scene: Some(self.scene.clone()), frames })
    }

    /// A random ball's path; [`None`] if it leaves the picture.
    fn path(&self, engine: &mut dyn Engine, random: &mut Random, times: &[f64]) -> Option<Vec<Point3<f64>>> {
        let (start, later) = match self.shot.place {
            Place::Environment(_) => (self.thrown(random), 0.0),
            Place::Spring => (self.swung(random, times)?, 0.0),
            Place::Room => (self.thrown_in_room(random), random.random_range(0.0..self.paper.room.start.latest)),
        };
        // A start inside a box would be moved, or shot, out of it.
        if self.forecaster.forecast(&start, &[]).status != Status::Ok {
            return None;
        }
        let times: Vec<f64> = times.iter().map(|time| later + time).collect();
        let path = match self.disturbance {
            Some(Disturbance::Wind) => self.blown(&start, &times)?,
            Some(Disturbance::Hand) => self.pushed(&start, &times, random)?,
            Some(Disturbance::Ball | Disturbance::Background) | None => engine.path(&start, &times)?,
        };
        let [width, height] = self.camera.size().xy().map(|side| side - 1.0);
        let near_enough = |centre: &Point3<f64>| {
            let distance = self.camera.camera_from_world(centre).coords.norm();
            let start = &self.paper.room.start;
            self.shot.place != Place::Room || (start.nearest..=start.farthest).contains(&distance)
        };
        let inside = |centre: &Point3<f64>| {
            let image = self.camera.image_from_world(centre);
            image.is_ok_and(|image| (0.0..=width).contains(&image.x) && (0.0..=height).contains(&image.y))
        };
        path.iter().all(|centre| inside(centre) && near_enough(centre)).then_some(path)
    }

    /// A path in the wind.
    fn blown(&self, start: &State, times: &[f64]) -> Option<Vec<Point3<f64>>> {
        let mut scene = self.scene.clone();
        let wind = self.paper.disturbances.wind;
        scene.gravity = std::array::from_fn(|axis| scene.gravity[axis] + wind[axis]);
        followed(&Forecaster::new(&scene).ok()?, start, times)
    }

    /// A path with a push in a random direction at a random time.
    fn pushed(&self, start: &State, times: &[f64], random: &mut Random) -> Option<Vec<Point3<f64>>> {
        let hand = &self.paper.disturbances.hand;
        let moment =
            times.first()? + random.random_range(hand.between[0]..hand.between[1]) * (times.last()? - times.first()?);
        let direction = Vector3::from_fn(|_, _| normal_pair::<f64>(random)[0]).try_normalize(1e-9)?;
        let (before, after) = times.split_at(times.partition_point(|&time| time < moment));
        let mut path = followed(&self.forecaster, start, before)?;
        let mut state = *self.forecaster.forecast(start, &[moment]).states.first()?;
        state.velocity += direction * hand.speed;
        let after: Vec<f64> = after.iter().map(|time| time - moment).collect();
        path.extend(followed(&self.forecaster, &state, &after)?);
        Some(path)
    }

    /// A start of the bouncing ball: thrown gently inwards.
    fn thrown(&self, random: &mut Random) -> State {
        let start = &self.paper.bouncing.start;
        let mut between = |[low, high]: [f64; 2]| random.random_range(low..high);
        let position = Vector3::from_fn(|axis, _| between([start.low[axis], start.high[axis]]));
        let inwards = -position.xy().try_normalize(1e-9).unwrap_or_default();
        let speed = inwards * between(start.speed_inwards);
        let velocity = Vector3::new(speed.x, speed.y, between(start.speed_up));
        let jitter = Vector3::from_fn(|_, _| between([-start.jitter, start.jitter]));
        self.scene.start(Point3::from(position), velocity + jitter)
    }

    /// A throw as a person's in the room.
    fn thrown_in_room(&self, random: &mut Random) -> State {
        let start = &self.paper.room.start;
        let mut point =
            |low: [f64; 3], high: [f64; 3]| Vector3::from_fn(|axis, _| random.random_range(low[axis]..high[axis]));
        let (position, target) = (point(start.low, start.high), point(start.target_low, start.target_high));
        let direction = (target - position).try_normalize(1e-9).unwrap_or_else(Vector3::x);
        let [slow, fast] = start.speed;
        self.scene.start(Point3::from(position), direction * random.random_range(slow..fast))
    }

    /// A start of the ball on the spring: across its line to the anchor; [`None`] if it comes too near the anchor.
    fn swung(&self, random: &mut Random, times: &[f64]) -> Option<State> {
        let start = &self.paper.spring.start;
        let [low, high] = start.component;
        let position =
            Vector3::from_fn(|_, _| random.random_range(low..high) * if random.random::<bool>() { 1.0 } else { -1.0 });
        let frequency = self.paper.spring_frequency();
        let across = position.cross(&Vector3::z()).try_normalize(1e-9)?;
        let angle = random.random_range(0.0..TAU);
        let direction = across * angle.cos() + position.normalize().cross(&across) * angle.sin();
        let velocity = direction * frequency * position.norm() * random.random_range(start.speed[0]..start.speed[1]);
        let nearest = times.iter().map(|t| {
            let (sine, cosine) = (frequency * t).sin_cos();
            (position * cosine + velocity * (sine / frequency)).norm()
        });
        let far_enough = nearest.fold(f64::INFINITY, f64::min) >= start.least_distance;
        far_enough.then(|| self.scene.start(Point3::from(position), velocity))
    }
}
