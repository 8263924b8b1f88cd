//! Footage as hard as real footage is: crowds, screens, people who swing and step, things like balls, cameras that sway and pan,
//! frames shown twice, low bitrates; of each frame the truth, also of clips that show no ball.
//!
//! A clip is drawn from (kind, empty, seed) alone. Its plays are those of the still set beside it.

pub(super) mod boards;
mod cast;
mod clock;
pub(super) mod crowd;
pub(super) mod develop;
pub(super) mod easel;
mod filming;
mod lettering;
mod motion;
pub(super) mod person;
pub(super) mod place;
pub(super) mod props;
#[cfg(test)]
mod tests;
mod view;

use std::sync::OnceLock;

use nalgebra::Point3;
use rand::RngExt;

use self::cast::{Actor, Scenario, cast};
use self::clock::Clock;
use self::develop::Developing;
use self::filming::Set;
pub use self::motion::Moves;
use self::motion::Way;
use self::place::Place;
use self::props::Captions;
use super::broadcast::play::Play;
use super::broadcast::{Filmed, Kind, stage};
use super::random::canvas::PaintColour;
use gravisight_geometry::camera::Camera;
use gravisight_geometry::error::Result;
use gravisight_geometry::random::{Random, Stream};
use gravisight_physics::{Forecaster, Scene};

/// Frames of the longest clip.
const MOST_FRAMES: f64 = 300.0;
/// Strength of the shadows of people and balls.
const SHADOWS: std::ops::Range<f32> = 0.0..0.45;
/// Bits a pixel of a video by bitrate, and how often it is made by quality; x264's quality then.
const BITS: std::ops::Range<f64> = 0.012..0.08;
const BY_QUALITY: f64 = 0.3;
const QUALITIES: std::ops::RangeInclusive<u8> = 26..=33;
/// Time from a picture that is coded by itself to the next, s.
const GROUPS: std::ops::Range<f64> = 0.5..4.0;

/// How a clip is to be compressed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Compression {
    /// x264's constant rate factor.
    Quality(u8),
    /// A broadcast's.
    Rate {
        /// Bits a second.
        bits: f64,
        /// Frames from one that is coded by itself to the next.
        group: usize,
    },
}

/// A clip in the making.
pub struct Recording {
    /// Where.
    pub scene: Scene,
    /// Frames a second, as shown.
    pub fps: f64,
    /// How its camera moves.
    pub moves: Moves,
    /// Times of hits, s, and places; none of an empty clip.
    pub hits: Vec<(f64, [f64; 3])>,
    /// Times of contacts, s, places and surfaces; none of an empty clip.
    pub bounces: Vec<(f64, [f64; 3], String)>,
    /// How it is to be compressed.
    pub compression: Compression,
    clock: Clock,
    count: usize,
    way: Way,
    lasts: f64,
    /// None of an empty clip.
    ball: Option<Ball>,
    place: Place,
    actors: Vec<Actor>,
    captions: Captions,
    developing: Developing,
    shadows: f32,
    paint: PaintColour,
    set: OnceLock<Set>,
    seed: u64,
    name: String,
}

/// A ball with its play.
struct Ball {
    forecaster: Forecaster,
    play: Play,
    light: [f32; 2],
}

impl Recording {
    /// The clip of a kind and a seed; an `empty` one shows no ball.
    ///
    /// # Errors
    /// [`gravisight_geometry::error::Error::Data`] where none is found.
    pub fn draw(kind: Kind, empty: bool, seed: u64) -> Result<Self> {
        let name = format!("footage/{}/{}", kind.name(), if empty { "empty" } else { "ball" });
        let random = &mut Stream::Scene.of_named(seed, &name);
        let scene = kind.scene()?;
        let forecaster = Forecaster::new(&scene)?;
        let play = Play::draw(kind, &forecaster, random)?;
        let official = view::official(kind, random);
        let clock = Clock::draw(official, random);
        let count = clock.frames(play.end.min(MOST_FRAMES / clock.shown));
        let lasts = clock.time(count.saturating_sub(1));
        let moves = Moves::draw(random);
        let at = |time: f64| play.at(&forecaster, time);
        let way = view::found_way(kind, official, moves, lasts, at, random)?;
        let hits = strokes(&play, lasts);
        let paint = kind.paint(random);
        let place = Place::draw(kind, official, paint, random);
        let actors =
            cast(&Scenario { kind, hits: &hits, lasts, room: place.room, chair: place.chair, official }, random);
        let size = way.at(0.0)?.size();
        let captions = if official { Captions::draw(size.xy(), random) } else { Captions::default() };
        let light = [random.random_range(-0.7..0.7), -random.random_range(0.3..0.7)];
        let known = |time: f64| !empty && time <= lasts;
        let bounces = play.bounces.iter().filter(|bounce| known(bounce.0));
        Ok(Self {
            hits: hits[1..].iter().filter(|hit| known(hit.0)).map(|(time, at)| (*time, at.coords.into())).collect(),
            bounces: bounces.map(|(time, at, surface)| (*time, at.coords.into(), surface.clone())).collect(),
            compression: compression(size.xy(), clock.shown, random),
            fps: clock.shown,
            developing: Developing::draw(random),
            shadows: random.random_range(SHADOWS),
            ball: (!empty).then_some(Ball { forecaster, play, light }),
            set: OnceLock::new(),
            scene,
            moves,
            clock,
            count,
            way,
            lasts,
            place,
            actors,
            captions,
            paint,
            seed,
            name,
        })
    }

    /// Frames.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Whether a frame is the one before it again.
    pub fn repeats(&self, frame: usize) -> bool {
        self.clock.repeats(frame)
    }

    /// Frames a second that were filmed; the others are repeated.
    pub fn filmed_fps(&self) -> f64 {
        self.clock.filmed
    }

    /// The camera of a frame.
    ///
    /// # Errors
    /// As [`Camera::new`].
    pub fn camera(&self, frame: usize) -> Result<Camera> {
        self.way.at(self.clock.time(frame))
    }

    /// A frame's truth, but for what may hide its ball; none where there is no ball.
    ///
    /// # Errors
    /// As [`Camera::new`].
    pub fn truth(&self, frame: usize) -> Result<Option<Filmed>> {
        let Some(Ball { forecaster, play, .. }) = &self.ball else { return Ok(None) };
        let time = self.clock.time(frame);
        let world = play.at(forecaster, time);
        let camera = self.camera(frame)?;
        let image = camera.image_from_world(&world)?;
        let radius_px = f64::from(stage::outline(&camera, self.scene.ball.radius, &world).semi[1]);
        let [width, height] = camera.size().xy();
        let visible = (0.0..width).contains(&image.x) && (0.0..height).contains(&image.y);
        Ok(Some(Filmed { time, world: world.coords.into(), image: image.coords.into(), radius_px, visible }))
    }

    /// When a frame was filmed, s.
    pub fn time(&self, frame: usize) -> f64 {
        self.clock.time(frame)
    }
}

/// When and where the ball is hit until a time, s and m; where the play begins is one.
fn strokes(play: &Play, lasts: f64) -> Vec<(f64, Point3<f64>)> {
    let first = std::iter::once((0.0, play.begins()));
    first.chain(play.hits.iter().copied()).filter(|hit| hit.0 <= lasts).collect()
}

fn compression([width, height]: [f64; 2], fps: f64, random: &mut Random) -> Compression {
    if random.random_bool(BY_QUALITY) {
        return Compression::Quality(random.random_range(QUALITIES));
    }
    let bits = random.random_range(BITS.start.ln()..BITS.end.ln()).exp() * width * height * fps;
    Compression::Rate { bits, group: ((random.random_range(GROUPS) * fps) as usize).max(1) }
}
