//! Footage as hard as real footage is: crowds, screens, people who swing and step, things like balls, cameras that sway and pan,
//! frames shown twice, low bitrates; of each frame the truth, also of clips that show no ball.
//!
//! A clip is drawn from (kind, empty, seed) alone. Its plays are those of the still set beside it.

mod boards;
mod cast;
mod clock;
mod crowd;
mod develop;
mod easel;
mod lettering;
mod motion;
mod person;
mod place;
mod props;
#[cfg(test)]
mod tests;
mod view;

use std::sync::OnceLock;

use image::RgbImage;
use nalgebra::Point3;
use rand::RngExt;

use self::boards::Board;
use self::cast::{Actor, Scenario, cast};
use self::clock::Clock;
use self::crowd::Crowd;
use self::develop::Developing;
use self::easel::{Easel, Rays};
pub use self::motion::Moves;
use self::motion::Way;
use self::place::Place;
use self::props::Captions;
use super::broadcast::play::Play;
use super::broadcast::{Filmed, Kind, stage};
use super::random::canvas::{Canvas, PaintColour};
use crate::camera::Camera;
use crate::error::Result;
use crate::physics::{Forecaster, Scene};
use crate::random::{Random, Stream, mixed};

/// Parts of an exposure in which a ball is drawn, and most in which what stands still is.
const EXPOSURES: usize = 24;
const MOST_TAPS: usize = 4;
/// Way of the picture in a part of an exposure, px.
const TAP: f64 = 1.5;
/// Frames of the longest clip.
const MOST_FRAMES: f64 = 300.0;
/// Fraction of the frames whose ball must be in the picture, and cameras that are tried for it.
const IN_PICTURE: f64 = 0.75;
const TRIES: usize = 40;
/// Times at which it is looked for.
const LOOKS: usize = 25;
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

/// What stands still, painted once, and who moves in the stands.
struct Set {
    panorama: Canvas,
    taken: Camera,
    crowd: Crowd,
}

impl Recording {
    /// The clip of a kind and a seed; an `empty` one shows no ball.
    ///
    /// # Errors
    /// [`crate::Error::Data`] where none is found.
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
        let way = found_way(kind, official, moves, lasts, at, random)?;
        let hits: Vec<(f64, Point3<f64>)> =
            std::iter::once((0.0, play.begins())).chain(play.hits.iter().copied()).filter(|hit| hit.0 <= lasts).collect();
        let paint = kind.paint(random);
        let place = Place::draw(kind, official, paint, random);
        let actors = cast(&Scenario { kind, hits: &hits, lasts, room: place.room, official }, random);
        let size = way.at(0.0)?.size();
        let captions = if official { Captions::draw(size.xy(), random) } else { Captions::default() };
        let light = [random.random_range(-0.7..0.7), -random.random_range(0.3..0.7)];
        let known = |time: f64| !empty && time <= lasts;
        Ok(Self {
            hits: hits[1..].iter().filter(|hit| known(hit.0)).map(|(time, at)| (*time, at.coords.into())).collect(),
            bounces: play
                .bounces
                .iter()
                .filter(|bounce| known(bounce.0))
                .map(|(time, at, surface)| (*time, at.coords.into(), surface.clone()))
                .collect(),
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

    /// A frame's picture and truth; no truth where there is no ball.
    ///
    /// # Errors
    /// As [`Camera::new`].
    pub fn frame(&self, frame: usize) -> Result<(RgbImage, Option<Filmed>)> {
        let (time, camera) = (self.time(frame), self.camera(frame)?);
        let random = &mut Stream::FrameNoise.of(mixed(self.seed, self.clock.source(frame) as u64, 2));
        let set = self.set()?;
        let cameras = self.exposed(time, &camera)?;
        let mut easel = Easel::new(develop::cut(&set.panorama, &set.taken, &cameras), &camera);
        let smear = cameras.len() as f32 - 1.0;
        easel.blurred(TAP as f32 * smear);
        set.crowd.paint_restless(&mut easel, time, 1.0 / self.clock.filmed);
        let rays = Rays::of(&camera);
        for board in self.boards(&camera, true) {
            board.paint(&mut easel, &rays, time, 1.0);
        }
        let mut truth = self.truth(frame)?;
        self.paint_play(&mut easel, time, smear, truth.as_ref())?;
        let place = truth.map_or([-1.0; 2], |truth| truth.image);
        let (hidden, mut canvas) = (easel.hidden, easel.canvas);
        let covered = self.captions.paint(&mut canvas, time, place);
        if let Some(truth) = &mut truth {
            truth.visible &= !hidden && !covered;
        }
        Ok((self.developing.develop(canvas, time, random), truth))
    }

    /// The cameras of the parts of an exposure: more of one in which it moves fast.
    fn exposed(&self, time: f64, camera: &Camera) -> Result<Vec<Camera>> {
        let half = 0.5 * self.clock.exposure;
        let [first, last] = [self.way.at(time - half)?, self.way.at(time + half)?];
        let [width, height] = camera.size().xy();
        let ahead = first.world_from_image(&[0.5 * width, 0.5 * height].into(), 10.0)?;
        let moved = (last.image_from_world(&ahead)? - first.image_from_world(&ahead)?).norm();
        let taps = ((moved / TAP).ceil() as usize).clamp(1, MOST_TAPS);
        if taps == 1 {
            return Ok(vec![camera.clone()]);
        }
        let part = |tap: usize| self.way.at(time + 2.0 * half * ((tap as f64 + 0.5) / taps as f64 - 0.5));
        (0..taps).map(part).collect()
    }

    /// Boards that a camera sees from the front: screens, or printed ones.
    fn boards(&self, camera: &Camera, screens: bool) -> impl Iterator<Item = &Board> {
        let eye = camera.world_from_camera(&Point3::origin());
        self.place.boards.iter().filter(move |board| board.screen == screens && self.place.faces(&eye, board))
    }

    /// What stands still, painted when it is first asked for.
    fn set(&self) -> Result<&Set> {
        if let Some(set) = self.set.get() {
            return Ok(set);
        }
        let random = &mut Stream::Scene.of_named(self.seed, &format!("{}/set", self.name));
        let taken = self.way.panorama(self.lasts)?;
        let crowd = Crowd::draw(&self.place, &taken, self.seed, random);
        let mut easel = Easel::new(self.place.picture(&taken, random), &taken);
        crowd.paint_still(&mut easel);
        let rays = Rays::of(&taken);
        for board in self.boards(&taken, false) {
            board.paint(&mut easel, &rays, 0.0, 0.9);
        }
        stage::lines(&mut easel.canvas, &taken, self.place.kind);
        let lying = self.ball.is_some().then_some((self.scene.ball.radius, self.paint));
        props::paint(&mut easel, &self.place, lying, random);
        let panorama = easel.canvas;
        Ok(self.set.get_or_init(|| Set { panorama, taken, crowd }))
    }

    /// People, net or table, and the ball, from far to near.
    fn paint_play(&self, easel: &mut Easel, time: f64, smear: f32, truth: Option<&Filmed>) -> Result<()> {
        let camera = easel.camera;
        let eye = camera.world_from_camera(&Point3::origin());
        let table = self.place.kind == Kind::TableTennis;
        let middle = camera.camera_from_world(&Point3::origin()).z;
        // Beyond the net, or farther than the table.
        let beyond = |at: &Point3<f64>, depth: f64| if table { depth > middle } else { at.y * eye.y < 0.0 };
        let depth = |at: &Point3<f64>| camera.camera_from_world(at).z;
        let mut all: Vec<(bool, f64, Option<&Actor>)> = self
            .actors
            .iter()
            .map(|actor| {
                let feet = actor.feet(time);
                let depth = depth(&feet);
                (beyond(&feet, depth), depth, Some(actor))
            })
            .filter(|(_, depth, _)| *depth > 0.8)
            .collect();
        if let Some(truth) = truth {
            let at = Point3::from(truth.world);
            let depth = depth(&at);
            // What is over the table is never behind it.
            let over = table && at.z > self.scene.boxes.first().map_or(0.0, |cuboid| cuboid.position[2]);
            all.push((beyond(&at, depth) && !over, if over { depth.min(middle) } else { depth }, None));
        }
        all.sort_by(|a, b| (b.0, b.1).partial_cmp(&(a.0, a.1)).unwrap_or(std::cmp::Ordering::Equal));
        let mut net = false;
        for (beyond, _, actor) in all {
            if !beyond && !std::mem::replace(&mut net, true) {
                self.paint_net(easel);
            }
            match actor {
                Some(actor) => self.paint_actor(easel, actor, time, smear),
                None => self.paint_ball(easel, time, truth)?,
            }
        }
        if !net {
            self.paint_net(easel);
        }
        Ok(())
    }

    fn paint_net(&self, easel: &mut Easel) {
        let kind = self.place.kind;
        if kind == Kind::TableTennis {
            for [x, y] in [[-0.6, -1.1], [0.6, -1.1], [-0.6, 1.1], [0.6, 1.1]] {
                easel.limb(&Point3::new(x, y, 0.0), &Point3::new(x, y, 0.74), 0.03, [0.12; 3]);
            }
            stage::tops(&mut easel.canvas, easel.camera, &self.scene, self.place.inner);
            stage::lines(&mut easel.canvas, easel.camera, kind);
        }
        stage::net(&mut easel.canvas, easel.camera, &self.scene, kind);
        if kind != Kind::TableTennis
            && let [first, .., last] = self.scene.net[..]
        {
            for [x, y, z] in [first, last] {
                easel.limb(&Point3::new(x, y, 0.0), &Point3::new(x, y, z), 0.04, [0.2; 3]);
            }
        }
    }

    fn paint_actor(&self, easel: &mut Easel, actor: &Actor, time: f64, smear: f32) {
        let feet = actor.feet(time);
        let scale = easel.seen(&feet).map_or(0.0, |(_, scale)| scale);
        let [speed, _] = actor.speed(time);
        easel.blurred((0.6 * speed * self.clock.exposure * scale) as f32 + TAP as f32 * smear);
        let body = actor.body(time);
        if body.feet.z < 0.1 {
            easel.shadow(&feet, 0.45, self.shadows);
        }
        body.paint(easel, actor.look());
        easel.blurred(TAP as f32 * smear);
    }

    fn paint_ball(&self, easel: &mut Easel, time: f64, truth: Option<&Filmed>) -> Result<()> {
        let (Some(Ball { forecaster, play, light }), Some(truth)) = (&self.ball, truth) else { return Ok(()) };
        let outlines: Result<Vec<_>> = (0..EXPOSURES)
            .map(|part| {
                let at = time + self.clock.exposure * ((part as f64 + 0.5) / EXPOSURES as f64 - 0.5);
                Ok(stage::outline(&self.way.at(at)?, self.scene.ball.radius, &play.at(forecaster, at.max(0.0))))
            })
            .collect();
        let [x, y, height] = truth.world;
        let fades = 1.0 / (1.0 + height as f32);
        easel.shadow(&Point3::new(x, y, 0.0), self.scene.ball.radius * (1.0 + 0.2 * height), self.shadows * fades);
        stage::ball(&mut easel.canvas, &outlines?, self.paint, *light);
        easel.watch(truth.image.map(|at| at as f32), truth.radius_px as f32);
        Ok(())
    }
}

/// A camera's way in which the ball is mostly in the picture.
fn found_way(
    kind: Kind,
    official: bool,
    moves: Moves,
    lasts: f64,
    ball: impl Fn(f64) -> Point3<f64>,
    random: &mut Random,
) -> Result<Way> {
    let mut best: Option<(f64, Way)> = None;
    for _ in 0..TRIES {
        let way = Way::draw(view::stand(kind, official, random), moves, lasts, &ball, random);
        let mut seen = 0;
        for look in 0..LOOKS {
            let time = lasts * look as f64 / (LOOKS - 1) as f64;
            let camera = way.at(time)?;
            let [width, height] = camera.size().xy();
            let at = camera.camera_from_world(&ball(time));
            let inside = at.z > 0.5
                && camera
                    .image_from_camera(&at)
                    .is_ok_and(|at| (0.0..width).contains(&at.x) && (0.0..height).contains(&at.y));
            seen += usize::from(inside);
        }
        let fraction = seen as f64 / LOOKS as f64;
        if best.as_ref().is_none_or(|(most, _)| fraction > *most) {
            best = Some((fraction, way));
        }
        if fraction >= IN_PICTURE {
            break;
        }
    }
    best.map(|(_, way)| way).ok_or_else(|| crate::Error::Data {
        what: kind.name().into(),
        reason: "no camera was found that sees the ball".into(),
    })
}

fn compression([width, height]: [f64; 2], fps: f64, random: &mut Random) -> Compression {
    if random.random_bool(BY_QUALITY) {
        return Compression::Quality(random.random_range(QUALITIES));
    }
    let bits = random.random_range(BITS.start.ln()..BITS.end.ln()).exp() * width * height * fps;
    Compression::Rate { bits, group: ((random.random_range(GROUPS) * fps) as usize).max(1) }
}
