//! The paper's synthetic data sets, made by one of two engines: the built-in one (the forecaster's `spring` contact and
//! a ray-caster), or the paper's, MuJoCo.
//!
//! Clips are drawn from (seed, split, environment, camera, number) alone, so SD-S is a part of SD-M, and SD-M of SD-L.
//! Both engines draw the same starts. One whose ball leaves the picture is drawn again; there the engines' paths,
//! millimetres apart (after many bounces centimetres), may in rare cases disagree, and a clip differ.

#[cfg(not(target_arch = "wasm32"))]
mod broadcast;
#[cfg(all(feature = "mujoco", libmujoco))]
mod mujoco;
mod random;
mod render;
mod scenes;
mod studio;
#[cfg(test)]
mod tests;

use std::f64::consts::TAU;
use std::ops::Range;

use image::RgbImage;
use nalgebra::{Point3, Vector3};
use rand::RngExt;

#[cfg(not(target_arch = "wasm32"))]
pub use self::broadcast::{Film, Filmed, Kind};
#[cfg(all(feature = "mujoco", libmujoco))]
use self::mujoco::Mujoco;
#[cfg(not(target_arch = "wasm32"))]
pub use self::random::{Apparent, Drawing, LARGEST, RandomScenes, SMALLEST};
use self::render::Renderer;
use self::scenes::Paper;
use crate::camera::Camera;
use crate::clips::{Clip, Frame};
use crate::error::{Error, Result};
use crate::physics::{Forecaster, Scene, State, Status};
use crate::random::{Random, Stream};

/// Starts drawn before a clip is given up.
const TRIES: usize = 10_000;
/// How far a spring's starting speed may be from that of a circle, as a share.
const SPRING_SPEED: Range<f64> = 0.9..1.1;

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

/// One place and one camera of a set: a studio in which clips are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shot {
    /// The paper's number of the environment; none for the spring.
    pub environment: Option<usize>,
    /// The paper's number of the camera; the spring has one of its own.
    pub camera: usize,
}

impl Set {
    /// Its shots.
    pub fn shots(self, split: Split) -> Vec<Shot> {
        let cameras = match (self, split) {
            (Self::SdS | Self::Spring, _) => 1..=1,
            (_, Split::Test) => 1..=9,
            _ => 1..=6,
        };
        let environments = match self {
            Self::Spring => vec![None],
            Self::SdS | Self::SdM => vec![Some(1)],
            Self::SdL => vec![Some(1), Some(2), Some(3)],
        };
        let shots =
            environments.into_iter().flat_map(|environment| cameras.clone().map(move |camera| (environment, camera)));
        shots.map(|(environment, camera)| Shot { environment, camera }).collect()
    }
}

impl Shot {
    /// What the physics needs to know of its environment, or of the spring set.
    ///
    /// # Errors
    /// [`Error::Data`] for an environment that the paper does not have.
    pub fn scene(&self) -> Result<Scene> {
        let paper = Paper::get()?;
        self.environment.map_or_else(|| paper.spring_scene(), |environment| paper.scene(environment))
    }

    /// A clip's id: `train/env1/cam1/0007`, `train/spring/0007`.
    pub fn id(&self, split: Split, number: usize) -> String {
        let split = split.name();
        match self.environment {
            Some(environment) => format!("{split}/env{environment}/cam{}/{number:04}", self.camera),
            None => format!("{split}/spring/{number:04}"),
        }
    }

    /// The folder of a clip's pictures, inside the set's.
    pub fn folder(&self, split: Split, number: usize) -> String {
        let split = split.name();
        match self.environment {
            Some(environment) => format!("frames/{split}_e{environment}_c{}_{number:04}", self.camera),
            None => format!("frames/{split}_spring_{number:04}"),
        }
    }
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
}

/// The engine that is always there: a studio's forecaster and ray-caster.
struct Builtin<'a>(&'a Studio);

impl Engine for Builtin<'_> {
    fn path(&mut self, start: &State, times: &[f64]) -> Option<Vec<Point3<f64>>> {
        let forecast = self.0.forecaster.forecast(start, times);
        let whole = forecast.status == Status::Ok;
        whole.then(|| forecast.states.iter().map(|state| state.position).collect())
    }

    fn picture(&mut self, centre: &Point3<f64>) -> Result<RgbImage> {
        Ok(self.0.renderer.frame(centre))
    }
}

/// Knows one shot: draws its starts and labels its clips, whatever the engine.
pub struct Studio {
    paper: &'static Paper,
    shot: Shot,
    camera: Camera,
    scene: Scene,
    forecaster: Forecaster,
    renderer: Renderer,
}

impl Studio {
    /// Prepares a shot.
    ///
    /// # Errors
    /// [`Error::Data`] for an environment or camera that the paper does not have.
    pub fn new(shot: Shot) -> Result<Self> {
        let paper = Paper::get()?;
        let camera = match shot.environment {
            Some(_) => paper.camera(shot.camera)?,
            None => paper.spring_camera()?,
        };
        let scene = shot.scene()?;
        let renderer = Renderer::new(paper, shot.environment, &camera)?;
        Ok(Self { paper, shot, forecaster: Forecaster::new(&scene)?, renderer, camera, scene })
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
        let seconds = self.shot.environment.map_or(self.paper.spring.seconds, |_| self.paper.bouncing.seconds);
        let count = (seconds * self.paper.fps).round() as usize;
        let times: Vec<f64> = (0..count).map(|frame| frame as f64 / self.paper.fps).collect();
        let path = (0..TRIES).find_map(|_| self.path(engine, &mut random, &times)).ok_or_else(|| {
            let reason = format!("no start of {TRIES} keeps the ball in the picture");
            Error::Data { what: id.clone(), reason }
        })?;
        let folder = self.shot.folder(split, number);
        let frames = path.iter().zip(&times).enumerate().map(|(index, (centre, &t))| {
            Ok(Frame {
                file: format!("{folder}/{index:03}.png").into(),
                t,
                image: Some(self.camera.image_from_world(centre)?.into()),
                visible: self.renderer.visible(centre) > 0.0,
                world: Some(centre.coords.into()),
            })
        });
        let frames = frames.collect::<Result<_>>()?;
        Ok(Clip { id, fps: self.paper.fps, camera: self.camera.clone(), scene: Some(self.scene.clone()), frames })
    }

    /// A random ball's path; [`None`] if it leaves the picture.
    fn path(&self, engine: &mut dyn Engine, random: &mut Random, times: &[f64]) -> Option<Vec<Point3<f64>>> {
        let start = match self.shot.environment {
            Some(_) => self.thrown(random),
            None => self.swung(random, times)?,
        };
        // A start inside a box would be moved, or shot, out of it.
        if self.forecaster.forecast(&start, &[]).status != Status::Ok {
            return None;
        }
        let path = engine.path(&start, times)?;
        let [width, height] = self.paper.size.xy().map(|side| side - 1.0);
        let inside = |centre: &Point3<f64>| {
            let image = self.camera.image_from_world(centre);
            image.is_ok_and(|image| (0.0..=width).contains(&image.x) && (0.0..=height).contains(&image.y))
        };
        path.iter().all(inside).then_some(path)
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

    /// A start of the ball on the spring: across its line to the anchor, nearly in a circle; [`None`] if it comes too
    /// near the anchor.
    fn swung(&self, random: &mut Random, times: &[f64]) -> Option<State> {
        let start = &self.paper.spring.start;
        let [low, high] = start.component;
        let position =
            Vector3::from_fn(|_, _| random.random_range(low..high) * if random.random::<bool>() { 1.0 } else { -1.0 });
        let frequency = self.paper.spring_frequency();
        let across = position.cross(&Vector3::z()).try_normalize(1e-9)?;
        let angle = random.random_range(0.0..TAU);
        let direction = across * angle.cos() + position.normalize().cross(&across) * angle.sin();
        let velocity = direction * frequency * position.norm() * random.random_range(SPRING_SPEED);
        let nearest = times.iter().map(|t| {
            let (sine, cosine) = (frequency * t).sin_cos();
            (position * cosine + velocity * (sine / frequency)).norm()
        });
        let far_enough = nearest.fold(f64::INFINITY, f64::min) >= start.least_distance;
        far_enough.then(|| self.scene.start(Point3::from(position), velocity))
    }
}
