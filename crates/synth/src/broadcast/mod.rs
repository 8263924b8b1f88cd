//! Footage as people film it: sports by broadcast, gantry and phone, with people, blur, flicker and noise; of each frame the truth.
//!
//! For choosing and testing what follows a ball through a video. A clip is drawn from (kind, seed) alone.

pub(super) mod play;
pub(super) mod stage;
#[cfg(test)]
mod tests;

use nalgebra::{Point3, Vector3};
use rand::RngExt;

use self::play::Play;
use self::stage::Person;
use super::looking;
use super::random::canvas::{Canvas, Ellipse, PaintColour};
use super::random::noise::Normals;
use gravisight_geometry::camera::{Camera, Distortion};
use gravisight_geometry::error::Result;
use gravisight_geometry::random::{Random, Stream, mixed};
use gravisight_geometry::size::Size;
use gravisight_physics::{Forecaster, Scene};
use image::{Rgb, RgbImage};

/// Parts of an exposure.
const EXPOSURES: usize = 24;
/// Fraction of the clips in which another ball lies about, and of those that cut away.
const SECOND_BALL: f64 = 0.3;
const CUT: f64 = 0.15;
/// How long a cut is, s.
const CUT_LASTS: f64 = 0.4;

/// Colours that balls have.
const PAINTS: [PaintColour; 5] =
    [[0.8, 0.9, 0.2], [0.95, 0.95, 0.93], [0.95, 0.5, 0.1], [0.95, 0.85, 0.2], [0.75, 0.9, 0.25]];

/// What is filmed, and from where.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Tennis, as broadcast: high behind a baseline.
    Tennis,
    /// Table tennis, by a phone on a tripod.
    TableTennis,
    /// Volleyball, from a gantry.
    Volleyball,
    /// A ball thrown before a phone on a tripod.
    Toss,
}

/// A frame's truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Filmed {
    /// Middle of the exposure, s.
    pub time: f64,
    /// The ball's centre then, m.
    pub world: [f64; 3],
    /// Its image, px, and apparent radius.
    pub image: [f64; 2],
    /// px.
    pub radius_px: f64,
    /// Whether it is in the picture and nothing hides it.
    pub visible: bool,
}

/// A clip in the making.
pub struct Film {
    /// What took it.
    pub camera: Camera,
    /// Where.
    pub scene: Scene,
    /// Frames a second.
    pub fps: f64,
    /// Times of hits, s, and places.
    pub hits: Vec<(f64, [f64; 3])>,
    /// Times of contacts, s, places and surfaces.
    pub bounces: Vec<(f64, [f64; 3], String)>,
    forecaster: Forecaster,
    play: Play,
    people: Vec<Person>,
    empty: Canvas,
    paint: PaintColour,
    light: [f32; 2],
    /// How long the shutter is open, s.
    exposure: f64,
    noise: f32,
    flicker: [f64; 2],
    second: Option<Point3<f64>>,
    cut: Option<f64>,
    normals: Normals,
    seed: u64,
}

impl Kind {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Tennis, Self::TableTennis, Self::Volleyball, Self::Toss];

    /// As in file names.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tennis => "tennis",
            Self::TableTennis => "table-tennis",
            Self::Volleyball => "volleyball",
            Self::Toss => "toss",
        }
    }

    /// Half the court's width and length, m.
    pub(super) fn court(self) -> [f64; 2] {
        match self {
            Self::Tennis => [5.485, 11.885],
            Self::TableTennis => [3.5, 7.0],
            Self::Volleyball => [4.5, 9.0],
            Self::Toss => [1.5, 1.5],
        }
    }

    /// Where the ground ends, m.
    fn wall(self) -> f64 {
        match self {
            Self::Tennis => 18.0,
            Self::TableTennis => 8.0,
            Self::Volleyball => 15.0,
            Self::Toss => 4.0,
        }
    }

    /// Its place and ball.
    pub(super) fn scene(self) -> Result<Scene> {
        Scene::named(match self {
            Self::Toss => "floor",
            other => other.name(),
        })
    }

    /// Where the camera is and looks, m, its focal length as a fraction of the width, and the picture's size, px.
    fn view(self, random: &mut Random) -> ([f64; 3], [f64; 3], f64, [u32; 2]) {
        let mut between = |range: std::ops::Range<f64>| random.random_range(range);
        match self {
            Self::Tennis => (
                [between(-1.0..1.0), -between(24.0..32.0), between(7.0..11.0)],
                [0.0, between(-2.0..1.0), 0.0],
                between(1.35..1.6),
                [1920, 1080],
            ),
            Self::TableTennis => {
                let turn: f64 = between(-0.9..0.9);
                let far = between(3.8..5.0);
                (
                    [far * turn.cos(), far * turn.sin(), between(1.3..1.9)],
                    [0.0, 0.0, 0.9],
                    between(0.75..0.9),
                    [1280, 720],
                )
            }
            Self::Volleyball => (
                [between(14.0..19.0), between(-5.0..5.0), between(5.0..9.0)],
                [0.0, 0.0, 1.2],
                between(0.75..0.9),
                [1920, 1080],
            ),
            Self::Toss => (
                [between(-0.5..0.5), -between(4.0..6.5), between(0.9..1.7)],
                [0.0, 0.0, between(0.9..1.3)],
                between(0.8..1.1),
                [1280, 720],
            ),
        }
    }

    /// A ball's colour.
    pub(super) fn paint(self, random: &mut Random) -> PaintColour {
        match self {
            Self::Tennis => PAINTS[0],
            Self::TableTennis => PAINTS[random.random_range(1..3)],
            Self::Volleyball => PAINTS[random.random_range(1..4)],
            Self::Toss => PAINTS[random.random_range(0..5)],
        }
    }

    fn fps(self, random: &mut Random) -> f64 {
        let choices: &[f64] = match self {
            Self::Tennis => &[25.0, 50.0],
            Self::TableTennis => &[60.0, 120.0],
            Self::Volleyball => &[25.0, 50.0],
            Self::Toss => &[30.0, 60.0],
        };
        choices[random.random_range(0..choices.len())]
    }
}

impl Film {
    /// The clip of a kind and a seed.
    ///
    /// # Errors
    /// [`Error::Data`](gravisight_geometry::error::Error::Data) where none is found.
    pub fn draw(kind: Kind, seed: u64) -> Result<Self> {
        let seed = seed.wrapping_mul(Kind::ALL.len() as u64).wrapping_add(kind as u64);
        let random = &mut Stream::Scene.of(seed);
        let scene = kind.scene()?;
        let forecaster = Forecaster::new(&scene)?;
        let (eye, target, focal, size) = kind.view(random);
        let (eye, target) = (Vector3::from(eye), Vector3::from(target));
        let size = Size::new(size[0], size[1]);
        let focal = focal * f64::from(size.width);
        let camera = looking(eye, (target - eye).normalize(), focal, size, Distortion::default())?;
        let fps = kind.fps(random);
        let play = Play::draw(kind, &forecaster, random)?;
        let mut people = Vec::new();
        if kind != Kind::Toss {
            let [_, length] = kind.court();
            let length = if kind == Kind::TableTennis { 2.2 } else { length };
            for number in 0..random.random_range(2..=4) {
                let side = if number % 2 == 0 { 1.0 } else { -1.0 };
                people.push(Person::draw([random.random_range(-1.5..1.5), side * (length + 0.5)], random));
            }
        }
        let paint = kind.paint(random);
        let empty = stage::empty(kind, &camera, &scene, paint, random);
        let second = random.random_bool(SECOND_BALL).then(|| {
            let [x, y] = kind.court().map(|half| random.random_range(-half..half));
            Point3::new(x, y, scene.ball.radius)
        });
        let cut = random.random_bool(CUT).then(|| random.random_range(0.3..0.7) * play.end);
        Ok(Self {
            hits: play.hits.iter().map(|(time, at)| (*time, at.coords.into())).collect(),
            bounces: play
                .bounces
                .iter()
                .map(|(time, at, surface)| (*time, at.coords.into(), surface.clone()))
                .collect(),
            exposure: random.random_range(0.1..0.6) / fps.max(50.0),
            noise: random.random_range(0.002..0.015),
            flicker: [random.random_range(0.0..0.015), random.random_range(1.0..10.0)],
            light: [random.random_range(-0.7..0.7), -random.random_range(0.3..0.7)],
            normals: Normals::new(random),
            camera,
            scene,
            fps,
            forecaster,
            play,
            people,
            empty,
            paint,
            second,
            cut,
            seed,
        })
    }

    /// Frames.
    pub fn count(&self) -> usize {
        (self.play.end * self.fps) as usize
    }

    /// A frame's picture and truth.
    ///
    /// # Errors
    /// [`Error::Distortion`](gravisight_geometry::error::Error::Distortion) never: the cameras have no lens.
    pub fn frame(&self, number: usize) -> Result<(RgbImage, Filmed)> {
        let random = &mut Stream::FrameNoise.of(mixed(self.seed, number as u64, 0));
        let time = number as f64 / self.fps;
        let world = self.play.at(&self.forecaster, time);
        let image = self.camera.image_from_world(&world)?;
        let radius_px = f64::from(self.outline(&world).semi[1]);
        let mut canvas = self.empty.clone();
        let gone = self.cut.is_some_and(|cut| (cut..cut + CUT_LASTS).contains(&time));
        let [width, height] = self.camera.size().xy();
        let mut visible = (0.0..width).contains(&image.x) && (0.0..height).contains(&image.y) && !gone;
        if gone {
            // Another camera's picture.
            canvas.planes.iter_mut().for_each(|plane| plane.reverse());
        } else {
            if let Some(at) = &self.second {
                stage::ball(&mut canvas, &[self.outline(at)], self.paint, self.light);
            }
            let depth = |at: &Point3<f64>| self.camera.camera_from_world(at).z;
            let mut people: Vec<&Person> = self.people.iter().collect();
            people.sort_by(|a, b| depth(&b.feet(time)).total_cmp(&depth(&a.feet(time))));
            let (behind, before): (Vec<&Person>, Vec<&Person>) =
                people.into_iter().partition(|person| depth(&person.feet(time)) > depth(&world));
            behind.iter().for_each(|person| drop(person.paint(&mut canvas, &self.camera, time)));
            self.paint_ball(&mut canvas, time);
            for person in before {
                let hides = person.paint(&mut canvas, &self.camera, time);
                visible &= !hides.iter().any(|[x, y, half]| {
                    (image.x - f64::from(*x)).hypot(image.y - f64::from(*y)) < f64::from(*half) + 0.5 * radius_px
                });
            }
        }
        let [strength, rate] = self.flicker;
        let gain = (1.0 + strength * (std::f64::consts::TAU * rate * time).sin()) as f32;
        for plane in &mut canvas.planes {
            plane.iter_mut().for_each(|value| *value *= gain);
            self.normals.add(plane, self.noise, random);
        }
        let [red, green, blue] = &canvas.planes;
        let byte = |value: f32| (255.0 * value).round().clamp(0.0, 255.0) as u8;
        let picture = RgbImage::from_fn(canvas.width as u32, canvas.height as u32, |x, y| {
            let index = y as usize * canvas.width + x as usize;
            Rgb([red[index], green[index], blue[index]].map(byte))
        });
        Ok((picture, Filmed { time, world: world.coords.into(), image: image.coords.into(), radius_px, visible }))
    }

    fn outline(&self, at: &Point3<f64>) -> Ellipse {
        stage::outline(&self.camera, self.scene.ball.radius, at)
    }

    fn paint_ball(&self, canvas: &mut Canvas, time: f64) {
        let outlines: Vec<Ellipse> = (0..EXPOSURES)
            .map(|part| {
                let at = time + self.exposure * ((part as f64 + 0.5) / EXPOSURES as f64 - 0.5);
                self.outline(&self.play.at(&self.forecaster, at.max(0.0)))
            })
            .collect();
        stage::ball(canvas, &outlines, self.paint, self.light);
    }
}
