//! Spectators in the stands: most sit still, some move, wave or flash.

use nalgebra::{Point3, Vector3};
use rand::RngExt;

use super::super::random::canvas::{PaintColour, mix};
use super::easel::Easel;
use super::person::dyed;
use super::place::{Place, ROW, Style};
use gravisight_geometry::camera::Camera;
use gravisight_geometry::random::{Random, Stream, mixed};

/// From seat to seat, m.
const SEAT: f64 = 0.52;
/// Seats from one aisle to the next.
const AISLES: usize = 16;
/// How far outside the picture somebody is who may reach into it, px.
const MARGIN: f64 = 40.0;
/// Fractions of the spectators that move, and of these that wave.
const RESTLESS: std::ops::Range<f64> = 0.02..0.2;
const WAVING: f64 = 0.12;
/// Most that move: each is drawn in every frame.
const MOST_RESTLESS: usize = 400;
/// Cameras that flash a second, at most.
const FLASHES: f64 = 3.0;
/// What is left of a spectator's colours: their clothes are duller than players'.
const DULL: f32 = 0.75;

/// Somebody on a seat.
#[derive(Debug, Clone)]
struct Spectator {
    at: Point3<f64>,
    shirt: PaintColour,
    skin: PaintColour,
    hair: PaintColour,
    /// How far they move, m, how often a second, from where on.
    sway: [f64; 3],
    waves: bool,
}

/// All of them, the far ones first.
#[derive(Debug, Clone)]
pub(crate) struct Crowd {
    still: Vec<Spectator>,
    restless: Vec<Spectator>,
    /// Flashes a second.
    flashes: f64,
    dim: f32,
    seed: u64,
}

impl Spectator {
    fn draw(at: Point3<f64>, random: &mut Random) -> Self {
        let shirt: PaintColour = match random.random_range(0..4) {
            0 => [random.random_range(0.6..0.95); 3],
            1 => [random.random_range(0.03..0.2); 3],
            _ => dyed(random),
        };
        Self {
            at,
            shirt: shirt.map(|value| value * DULL),
            skin: mix([0.8, 0.6, 0.47], [0.35, 0.22, 0.16], random.random_range(0.0..1.0)),
            hair: [random.random_range(0.03..0.35); 3],
            sway: [
                random.random_range(0.02..0.15),
                random.random_range(0.1..1.2),
                random.random_range(0.0..std::f64::consts::TAU),
            ],
            waves: random.random_bool(WAVING),
        }
    }

    fn paint(&self, easel: &mut Easel, time: Option<f64>) {
        let [reach, rate, phase] = self.sway;
        let turn = std::f64::consts::TAU * rate * time.unwrap_or(0.0) + phase;
        let moved = if time.is_some() { reach * turn.sin() } else { 0.0 };
        let at = self.at + Vector3::new(moved, 0.4 * moved, 0.3 * moved.abs());
        let lap = at + Vector3::z() * 0.15;
        let neck = at + Vector3::z() * 0.55;
        easel.limb(&lap, &neck, 0.2, self.shirt);
        easel.sphere(&(neck + Vector3::z() * 0.27), 0.115, self.skin);
        easel.sphere(&(neck + Vector3::z() * 0.33), 0.1, self.hair);
        if time.is_some() && self.waves {
            let up = 0.45 + 0.15 * (3.0 * turn).cos();
            let side = if phase > 3.0 { 0.25 } else { -0.25 };
            let hand = neck + Vector3::new(side + 0.25 * (5.0 * turn).sin(), 0.0, up);
            easel.limb(&(neck + Vector3::new(side, 0.0, -0.05)), &hand, 0.05, self.skin);
            easel.sphere(&hand, 0.07, self.skin);
        }
    }
}

impl Crowd {
    /// Those of a place that a camera can see, the far ones first.
    pub fn draw(place: &Place, camera: &Camera, seed: u64, random: &mut Random) -> Self {
        let mut crowd = Self { still: vec![], restless: vec![], flashes: 0.0, dim: place.dim, seed };
        if place.style != Style::Stadium {
            return crowd;
        }
        let eye = camera.world_from_camera(&Point3::origin());
        let (full, restless) = (random.random_range(0.35..0.97), random.random_range(RESTLESS));
        crowd.flashes = random.random_range(0.0..1.0_f64).powi(2) * FLASHES;
        let mut all = Vec::new();
        for (axis, side) in [(0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0)] {
            // A stand that the camera itself is on is behind it.
            if side * eye[axis] <= place.room[axis] {
                for at in seats(place, axis, side, full, random) {
                    if let Some(depth) = depth_if_seen(camera, &at) {
                        all.push((depth, Spectator::draw(at, random)));
                    }
                }
            }
        }
        all.sort_by(|a, b| b.0.total_cmp(&a.0));
        let restless = restless.min(MOST_RESTLESS as f64 / all.len().max(1) as f64);
        for (_, spectator) in all {
            let of = if random.random_bool(restless) { &mut crowd.restless } else { &mut crowd.still };
            of.push(spectator);
        }
        crowd
    }

    /// Those that never move.
    pub fn paint_still(&self, easel: &mut Easel) {
        easel.light = self.dim;
        self.still.iter().for_each(|spectator| spectator.paint(easel, None));
        easel.light = 1.0;
    }

    /// The others, at a time, s, in a frame of `lasts` s.
    pub fn paint_restless(&self, easel: &mut Easel, time: f64, lasts: f64) {
        easel.light = self.dim;
        self.restless.iter().for_each(|spectator| spectator.paint(easel, Some(time)));
        easel.light = 1.0;
        let random = &mut Stream::FrameNoise.of(mixed(self.seed, (1e4 * time) as u64, 1));
        if !self.still.is_empty() && random.random_bool((self.flashes * lasts).min(1.0)) {
            let flash = &self.still[random.random_range(0..self.still.len())];
            easel.sphere(&(flash.at + Vector3::z() * 0.8), random.random_range(0.08..0.2), [1.3, 1.3, 1.35]);
        }
    }
}

/// The taken seats of the stand on a side along an axis, m; so `full` is it.
fn seats(place: &Place, axis: usize, side: f64, full: f64, random: &mut Random) -> Vec<Point3<f64>> {
    let mut taken = Vec::new();
    for row in 0..(place.depth / ROW[1]) as usize {
        let back = (row as f64 + 0.6) * ROW[1];
        let half = place.room[1 - axis] + 0.7 * back;
        for seat in (0..(2.0 * half / SEAT) as usize).filter(|seat| seat % AISLES != 0) {
            if random.random_bool(full) {
                let along = seat as f64 * SEAT - half + random.random_range(-0.1..0.1);
                let mut at = Point3::new(along, along, place.fence + place.rise * back);
                at[axis] = side * (place.room[axis] + back);
                taken.push(at);
            }
        }
    }
    taken
}

/// How far before the camera a place is, m, if it is in the picture or near it.
fn depth_if_seen(camera: &Camera, at: &Point3<f64>) -> Option<f64> {
    let seen = camera.camera_from_world(at);
    let [width, height] = camera.size().xy();
    let image = (seen.z > 1.0).then(|| camera.image_from_camera(&seen).ok()).flatten()?;
    let near = (-MARGIN..width + MARGIN).contains(&image.x) && (-MARGIN..height + 2.0 * MARGIN).contains(&image.y);
    near.then_some(seen.z)
}
