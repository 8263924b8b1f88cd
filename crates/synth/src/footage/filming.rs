//! Paints a clip's frames: what stands still once for all, the rest from far to near in each.

use image::RgbImage;
use nalgebra::Point3;

use super::super::broadcast::{Filmed, Kind, stage};
use super::super::random::canvas::Canvas;
use super::boards::Board;
use super::cast::Actor;
use super::crowd::Crowd;
use super::easel::{Easel, Rays};
use super::{Ball, Recording, develop, props};
use gravisight_geometry::camera::Camera;
use gravisight_geometry::error::Result;
use gravisight_geometry::random::{Stream, mixed};

/// Parts of an exposure in which a ball is drawn, and most in which what stands still is.
const EXPOSURES: usize = 24;
const MOST_TAPS: usize = 4;
/// Way of the picture in a part of an exposure, px.
const TAP: f64 = 1.5;
/// Least distance before the camera of people who are drawn, m.
const NEAREST: f64 = 0.8;

/// What stands still, painted once, and who moves in the stands.
pub(super) struct Set {
    panorama: Canvas,
    taken: Camera,
    crowd: Crowd,
}

impl Recording {
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
        let mut net = false;
        for (beyond, actor) in self.far_to_near(easel.camera, time, truth) {
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

    /// People and the ball (where none is named) in the order in which they are painted, and whether each is beyond the net, or
    /// farther than the table.
    fn far_to_near(&self, camera: &Camera, time: f64, truth: Option<&Filmed>) -> Vec<(bool, Option<&Actor>)> {
        let eye = camera.world_from_camera(&Point3::origin());
        let table = self.place.kind == Kind::TableTennis;
        let depth = |at: &Point3<f64>| camera.camera_from_world(at).z;
        let middle = depth(&Point3::origin());
        let beyond = |at: &Point3<f64>, depth: f64| if table { depth > middle } else { at.y * eye.y < 0.0 };
        let people = self.actors.iter().map(|actor| (actor.feet(time), Some(actor)));
        let mut all: Vec<(bool, f64, Option<&Actor>)> = people
            .map(|(feet, actor)| (beyond(&feet, depth(&feet)), depth(&feet), actor))
            .filter(|(_, depth, _)| *depth > NEAREST)
            .collect();
        if let Some(truth) = truth {
            let at = Point3::from(truth.world);
            // What is over the table is never behind it.
            let over = table && at.z > self.scene.boxes.first().map_or(0.0, |cuboid| cuboid.position[2]);
            let depth = if over { depth(&at).min(middle) } else { depth(&at) };
            all.push((beyond(&at, depth) && !over, depth, None));
        }
        all.sort_by(|a, b| b.0.cmp(&a.0).then(b.1.total_cmp(&a.1)));
        all.into_iter().map(|(beyond, _, actor)| (beyond, actor)).collect()
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
        if body.feet.z == 0.0 {
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
