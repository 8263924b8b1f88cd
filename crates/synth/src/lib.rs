//! The paper's synthetic data sets, and a room in the place of its real one, made by one of two engines: the built-in one (the
//! forecaster and a ray-caster), or the paper's, MuJoCo.
//!
//! Clips are drawn from (seed, split, environment, camera, number) alone, so SD-S is a part of SD-M, and SD-M of SD-L.
//! Both engines draw the same starts. One whose ball leaves the picture is drawn again; there the engines' paths,
//! millimetres apart (after many bounces centimetres), may in rare cases disagree, and a clip differ.
#![deny(missing_docs, unsafe_code)]
#![warn(clippy::unwrap_used)]
#![cfg_attr(test, allow(clippy::unwrap_used))]
// What only the command and native training use; the native build says what nobody does.
#![cfg_attr(target_arch = "wasm32", allow(dead_code, unused_imports))]

#[cfg(not(target_arch = "wasm32"))]
mod broadcast;
#[cfg(not(target_arch = "wasm32"))]
mod courts;
#[cfg(not(target_arch = "wasm32"))]
mod flights;
#[cfg(not(target_arch = "wasm32"))]
mod footage;
mod looking;
#[cfg(all(feature = "mujoco", libmujoco))]
mod mujoco;
mod paths;
mod random;
mod render;
mod scenes;
mod sets;
mod studio;
#[cfg(test)]
mod tests;

use image::RgbImage;
use nalgebra::{Point3, Vector2};

#[cfg(not(target_arch = "wasm32"))]
pub use self::broadcast::{Film, Filmed, Kind};
#[cfg(not(target_arch = "wasm32"))]
pub use self::courts::{CourtPicture, courts};
#[cfg(not(target_arch = "wasm32"))]
pub use self::flights::{Balls, Drawn, Flights};
#[cfg(not(target_arch = "wasm32"))]
pub use self::footage::{Compression, Moves, Recording};
pub use self::looking::looking;
#[cfg(all(feature = "mujoco", libmujoco))]
use self::mujoco::Mujoco;
use self::paths::simulated;
#[doc(hidden)]
pub use self::random::Spot;
pub use self::random::{Apparent, Drawing, LARGEST, LabelledBall, LabelledPhotograph, RandomScenes, SMALLEST};
use self::render::Renderer;
use self::scenes::Paper;
pub use self::sets::{Set, Shot, Site, Split};
use gravisight_clips::{Clip, Frame};
use gravisight_geometry::camera::Camera;
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::random::{Stream, normal_pair};
use gravisight_geometry::size::Size;
use gravisight_physics::{Forecaster, Scene, State};

/// Starts drawn before a clip is given up.
const TRIES: usize = 10_000;

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
        simulated(&self.0.forecaster, start, times)
    }

    fn picture(&mut self, centre: &Point3<f64>) -> Result<RgbImage> {
        Ok(self.0.renderer.frame(centre))
    }

    fn depth(&mut self, centre: &Point3<f64>) -> Result<Vec<f32>> {
        self.0.renderer.depth(centre)
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
        let camera = paper.camera(shot.site, shot.camera, size)?;
        let scene = shot.scene()?;
        let renderer = Renderer::new(paper, shot.site, &camera, None)?;
        let label_noise = if shot.site == Site::Room { paper.room.label_noise_px } else { 0.0 };
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
        self.renderer = Renderer::new(self.paper, self.shot.site, &self.camera, Some(disturbance))?;
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
        let (fps, count) = match self.shot.site {
            Site::Environment(_) => (self.paper.fps, (bouncing.seconds * self.paper.fps).round() as usize),
            Site::Spring => (self.paper.fps, (spring.seconds * self.paper.fps).round() as usize),
            Site::Room => (room.fps, room.frames),
        };
        let times: Vec<f64> = (0..count).map(|frame| frame as f64 / fps).collect();
        let path = (0..TRIES).find_map(|_| self.path(engine, &mut random, &times)).ok_or_else(|| {
            let reason = format!("none of {TRIES} random starts keeps the ball in the picture; choose another seed");
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
}
