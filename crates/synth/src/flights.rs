//! Simulated flights of balls, drawn into real clips without a ball: the ball's place is known exactly, and everything else is real.
//!
//! A flight obeys the laws of motion of a sport's ball before an upright camera of random height, pitch and focal length. Most balls are cut
//! out of labelled photographs. What is drawn depends on the seed, the frames' times and the balls alone.

use image::RgbImage;
use nalgebra::{Matrix3, Point2, Point3, Vector3};
use rand::RngExt;

use super::looking;
use super::random::ball::{Layer, Look, Placed};
use super::random::canvas::Ellipse;
use super::random::{CutOut, LabelledPhotograph};
use gravisight_geometry::camera::{Camera, Distortion};
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::random::{Random, Stream, mixed, normal_pair};
use gravisight_geometry::size::Size;
use gravisight_physics::{Forecaster, Scene, Status};

// The ranges below are chosen, not fitted: wide enough for phones, broadcasts and action cameras.

/// Sports whose balls fly.
const SPORTS: [&str; 6] = ["tennis", "table-tennis", "volleyball", "basketball", "football", "baseball"];
/// Fraction of the balls that are cut out of photographs; the others are drawn.
const CUT_OUT: f64 = 0.7;
/// Radii at the start of a flight, px; at most this fraction of the picture's shorter side.
const RADII: [f64; 2] = [1.3, 45.0];
const LARGEST: f64 = 0.1;
/// Focal lengths, widths of the picture; heights of the camera above the floor, m; pitches, radians.
const FOCAL_LENGTHS: [f64; 2] = [0.7, 3.0];
const HEIGHTS: [f64; 2] = [0.8, 12.0];
const PITCHES: [f64; 2] = [-0.4, 0.25];
/// Exposure, fractions of the time from one frame to the next.
const EXPOSURES: [f64; 2] = [0.05, 1.0];
/// Time in which a flight reaches the point that it is aimed at, s; by what factor that is nearer or farther than its start; and how much longer
/// than that the flight lasts.
const DURATIONS: [f64; 2] = [0.12, 1.3];
const NEARER: f64 = 1.7;
const LONGER: [f64; 2] = [0.7, 1.6];
/// Fastest start, m/s, and the least way of a flight in the picture, radii.
const FASTEST: f64 = 70.0;
const LEAST_WAY: f64 = 6.0;
/// Fraction of the flights that begin where the last one ended, as after a hit; pauses before the others, s.
const HIT: f64 = 0.7;
const PAUSES: [f64; 2] = [0.1, 1.2];
/// Flights that are tried for one in the picture, and cameras.
const TRIES: usize = 400;
const CAMERAS: usize = 50;
/// Softness of the picture (weight of each neighbouring pixel) and noise of the ball's pixels, fractions of full scale.
const SOFTNESS: f32 = 0.22;
const NOISES: [f64; 2] = [0.002, 0.02];
/// Least difference of a ball's pixels from those behind it, fractions of full scale: nobody sees less.
const LEAST_CONTRAST: f32 = 0.05;

/// Balls to draw: those cut out of photographs, and any number of painted ones.
#[derive(Debug, Default)]
pub struct Balls(Vec<CutOut>);

impl Balls {
    /// The balls of photographs whose radius is known.
    pub fn of(photographs: &[LabelledPhotograph]) -> Self {
        Self(CutOut::all(photographs))
    }

    /// How many were cut out.
    pub fn count(&self) -> usize {
        self.0.len()
    }
}

/// A ball in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drawn {
    /// Its centre, px; the middle of its streak.
    pub image: [f64; 2],
    /// Radius, px.
    pub radius_px: f64,
    /// Whether it lies in the picture and stands out from what is behind it.
    pub visible: bool,
}

/// The flights of one ball through a clip.
pub struct Flights<'a> {
    camera: Camera,
    radius: f64,
    cut_out: Option<&'a CutOut>,
    look: u64,
    softness: f32,
    noise: f32,
    /// Of each frame, where the ball is when the shutter opens and closes, m; none between flights.
    path: Vec<Option<[Point3<f64>; 2]>>,
}

impl<'a> Flights<'a> {
    /// For a clip of `size` whose frames are taken at `times`, s, ascending.
    ///
    /// # Errors
    /// [`Error::Data`] if no flight is found that is in the picture.
    pub fn draw(size: Size, times: &[f64], balls: &'a Balls, seed: u64) -> Result<Self> {
        let random = &mut Stream::Scene.of_named(seed, "flights");
        for _ in 0..CAMERAS {
            if let Some(flights) = Self::before_a_camera(size, times, balls, random)? {
                return Ok(flights);
            }
        }
        Err(Error::Data { what: "flights".into(), reason: "no flight is in the picture; choose another seed".into() })
    }

    /// Before a random camera; none where no flight is possible.
    fn before_a_camera(size: Size, times: &[f64], balls: &'a Balls, random: &mut Random) -> Result<Option<Self>> {
        let name = SPORTS[random.random_range(0..SPORTS.len())];
        let scene = Scene::named("floor")?.with_ball(name)?;
        let forecaster = Forecaster::new(&scene)?;
        let (pitch, height) = (random.random_range(PITCHES[0]..PITCHES[1]), between(random, HEIGHTS));
        let focal = between(random, FOCAL_LENGTHS) * f64::from(size.width.max(size.height));
        let forward = Vector3::new(0.0, pitch.cos(), pitch.sin());
        let camera = looking(Vector3::new(0.0, 0.0, height), forward, focal, size, Distortion::default())?;
        let shortest = f64::from(size.width.min(size.height));
        let radius_px = between(random, [RADII[0], RADII[1].min(LARGEST * shortest)]);
        let interval = match times {
            [first, .., last] => (last - first) / (times.len() - 1) as f64,
            _ => 0.0,
        };
        let exposure = between(random, EXPOSURES) * interval;
        let cut_out = (!balls.0.is_empty() && random.random_bool(CUT_OUT))
            .then(|| &balls.0[random.random_range(0..balls.0.len())])
            .filter(|cut_out| f64::from(cut_out.largest()) > NEARER * radius_px);
        let mut flights = Self {
            radius: scene.ball.radius,
            camera,
            cut_out,
            look: random.random_range(0..u64::MAX),
            softness: random.random_range(0.0..SOFTNESS),
            noise: between(random, NOISES) as f32,
            path: vec![None; times.len()],
        };
        let depth = focal * scene.ball.radius / radius_px;
        Ok(flights.fly(&scene, &forecaster, (times, exposure), depth, random).then_some(flights))
    }

    /// Fills the path with one flight after the other; the first starts at about `depth`, m. Whether there is one.
    fn fly(
        &mut self,
        scene: &Scene,
        forecaster: &Forecaster,
        (times, exposure): (&[f64], f64),
        depth: f64,
        random: &mut Random,
    ) -> bool {
        let last = times.last().copied().unwrap_or(0.0);
        let mut begin = times.first().copied().unwrap_or(0.0) + random.random_range(0.0..0.5);
        let mut hit: Option<Point3<f64>> = None;
        let mut flown = false;
        while begin < last {
            let frames: Vec<usize> = (0..times.len()).filter(|&frame| times[frame] - exposure / 2.0 >= begin).collect();
            let found = (0..TRIES).find_map(|attempt| {
                // A ball may be where no flight is possible.
                let from = hit.filter(|_| attempt < TRIES / 4);
                let (start, velocity, duration) = self.aimed(scene, from, depth, random)?;
                let lasts = duration * random.random_range(LONGER[0]..LONGER[1]);
                let frames: Vec<usize> =
                    frames.iter().copied().take_while(|&frame| times[frame] + exposure / 2.0 < begin + lasts).collect();
                let moments = frames.iter().flat_map(|&frame| [-0.5, 0.5].map(|half| times[frame] + half * exposure));
                let moments: Vec<f64> = moments.map(|time| time - begin).chain([lasts]).collect();
                let forecast = forecaster.forecast(&scene.start(start, velocity), &moments);
                let way: Vec<Point3<f64>> = forecast.states.iter().map(|state| state.position).collect();
                (forecast.status == Status::Ok).then_some((frames, way, lasts))
            });
            let Some((frames, way, lasts)) = found else { break };
            for (frame, ends) in frames.iter().zip(way.chunks_exact(2)) {
                self.path[*frame] = Some([ends[0], ends[1]]);
            }
            flown |= !frames.is_empty();
            hit = way.last().copied().filter(|at| self.is_inside(at) && random.random_bool(HIT));
            begin += lasts + if hit.is_some() { 0.0 } else { between(random, PAUSES) };
        }
        flown
    }

    /// A flight's start, m, its velocity, m/s, and the time in which it reaches its aim, s: from `start`, if given, otherwise from a random
    /// place of the picture at about `depth`.
    fn aimed(
        &self,
        scene: &Scene,
        start: Option<Point3<f64>>,
        depth: f64,
        random: &mut Random,
    ) -> Option<(Point3<f64>, Vector3<f64>, f64)> {
        let [width, height] = self.camera.size().xy();
        let mut place = |depth: f64| {
            let at = Point2::new(random.random_range(-0.1..1.1) * width, random.random_range(-0.15..1.0) * height);
            let depth = depth * random.random_range(-NEARER.ln()..NEARER.ln()).exp();
            self.camera.world_from_image(&at, depth).ok().filter(|at| at.z > 1.5 * self.radius)
        };
        let start = match start {
            Some(start) => start,
            None => place(depth)?,
        };
        let aim = place(depth)?;
        let duration = between(random, DURATIONS);
        let velocity = (aim - start) / duration - Vector3::from(scene.gravity) * (duration / 2.0);
        let [from, to] = [start, aim].map(|at| self.camera.image_from_world(&at));
        let way = (to.ok()? - from.ok()?).norm();
        let radius_px = self.camera.intrinsic()[(1, 1)] * self.radius / depth;
        (velocity.norm() < FASTEST && way > LEAST_WAY * radius_px).then_some((start, velocity, duration))
    }

    fn is_inside(&self, at: &Point3<f64>) -> bool {
        let [width, height] = self.camera.size().xy();
        let inside = |at: Point2<f64>| (0.0..width).contains(&at.x) && (0.0..height).contains(&at.y);
        self.camera.image_from_world(at).is_ok_and(inside)
    }

    /// Draws the ball into a frame that shows the first one as `frame_from_first` maps it; where it is then.
    pub fn lay(&self, frame: usize, frame_from_first: &Matrix3<f64>, picture: &mut RgbImage) -> Option<Drawn> {
        let ends = self.path[frame]?;
        let depth = ends.iter().map(|at| self.camera.camera_from_world(at).z).sum::<f64>() / 2.0;
        if depth < 2.0 * self.radius {
            return None;
        }
        let mut images = [Point2::origin(); 2];
        for (image, at) in images.iter_mut().zip(&ends) {
            *image = frame_from_first.transform_point(&self.camera.image_from_world(at).ok()?);
        }
        let focal = self.camera.intrinsic()[(1, 1)];
        let centre = nalgebra::center(&images[0], &images[1]);
        let scale = enlargement(frame_from_first, &centre);
        let radius_px = focal * self.radius / depth * scale;
        let [width, height] = self.camera.size().xy();
        let inside = (0.0..width).contains(&centre.x) && (0.0..height).contains(&centre.y);
        let mut drawn = Drawn { image: centre.coords.into(), radius_px, visible: false };
        let near = |side: f64, at: f64| (-side / 2.0..1.5 * side).contains(&at);
        if !near(width, centre.x) || !near(height, centre.y) || radius_px > height.max(width) / 4.0 {
            return Some(drawn);
        }
        let streak = (images[1] - images[0]).map(|px| px as f32);
        let outline =
            Ellipse { centre: [centre.x as f32, centre.y as f32], semi: [radius_px as f32; 2], axis: [1.0, 0.0] };
        let principal_point = [width, height].map(|side| (side - 1.0) / 2.0);
        let placed = Placed { outline, streak: streak.into(), focal, principal_point };
        // The same look in every frame.
        let mut look = Stream::Scene.of(self.look);
        let layer = match self.cut_out {
            Some(cut_out) => cut_out.layer(&placed, &mut look),
            None => Layer::still(&placed, &Look::random(radius_px as f32, &mut look)),
        };
        let layer = layer.moved(streak.into()).softened(self.softness);
        let mut noise = Stream::FrameNoise.of(mixed(self.look, frame as u64, 0));
        let contrast = lay(&layer, picture, self.noise, &mut noise);
        drawn.visible = inside && contrast >= LEAST_CONTRAST;
        Some(drawn)
    }
}

/// Lays a ball over a picture; its mean difference from what was behind it, times the largest fraction of a pixel that it covers.
fn lay(layer: &Layer, picture: &mut RgbImage, noise: f32, random: &mut Random) -> f32 {
    let (mut difference, mut covered, mut most) = (0.0, 0.0, 0.0_f32);
    for (index, value) in layer.values.iter().enumerate().filter(|(_, value)| value[3] > 0.0) {
        let (x, y) = (layer.left + (index % layer.width) as i32, layer.top + (index / layer.width) as i32);
        let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y)) else { continue };
        if x >= picture.width() || y >= picture.height() {
            continue;
        }
        let noise = noise * value[3] * normal_pair::<f32>(random)[0];
        most = most.max(value[3]);
        for (level, colour) in picture.get_pixel_mut(x, y).0.iter_mut().zip(value) {
            let before = f32::from(*level) / 255.0;
            difference += (colour - value[3] * before).abs();
            covered += value[3];
            *level = (255.0 * (before * (1.0 - value[3]) + colour + noise) + 0.5).clamp(0.0, 255.0) as u8;
        }
    }
    if covered > 0.0 { most * difference / covered } else { 0.0 }
}

/// Root of the factor by which a homography enlarges areas at a point.
fn enlargement(homography: &Matrix3<f64>, at: &Point2<f64>) -> f64 {
    let depth = (homography * at.to_homogeneous()).z;
    (homography.determinant() / depth.powi(3)).abs().sqrt()
}

/// A random number between two, evenly distributed in its logarithm.
fn between(random: &mut Random, [least, most]: [f64; 2]) -> f64 {
    random.random_range(least.ln()..most.ln()).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times() -> Vec<f64> {
        (0..90).map(|frame| f64::from(frame) / 30.0).collect()
    }

    #[test]
    fn a_ball_is_drawn_where_it_is_said_to_be_and_falls_as_gravity_makes_it() {
        let balls = Balls::default();
        let (mut seen, mut falls) = (0, 0);
        for seed in 0..20 {
            let flights = Flights::draw(Size::new(640, 360), &times(), &balls, seed).unwrap();
            for frame in 0..90 {
                let mut picture = RgbImage::from_pixel(640, 360, image::Rgb([90, 100, 110]));
                let before = picture.clone();
                let Some(ball) = flights.lay(frame, &Matrix3::identity(), &mut picture).filter(|ball| ball.visible)
                else {
                    continue;
                };
                seen += 1;
                let differs = |x: u32, y: u32| picture.get_pixel(x, y) != before.get_pixel(x, y);
                let all = (0..360).flat_map(|y| (0..640).map(move |x| (x, y)));
                let changed: Vec<[f64; 2]> =
                    all.filter(|&(x, y)| differs(x, y)).map(|(x, y)| [f64::from(x), f64::from(y)]).collect();
                let whole = |at: [f64; 2]| (60.0..580.0).contains(&at[0]) && (60.0..300.0).contains(&at[1]);
                if whole(ball.image) {
                    let mean = [0, 1].map(|axis| changed.iter().map(|at| at[axis]).sum::<f64>() / changed.len() as f64);
                    let off = (mean[0] - ball.image[0]).hypot(mean[1] - ball.image[1]);
                    assert!(off < 1.0 + 0.2 * ball.radius_px, "seed {seed} frame {frame}: {off} px");
                }
            }
            for three in flights.path.windows(3) {
                if let [Some(a), Some(b), Some(c)] = three {
                    let bend = (c[0].z - 2.0 * b[0].z + a[0].z) * 900.0;
                    falls += i32::from((-14.0..-6.0).contains(&bend));
                }
            }
        }
        assert!(seen > 400 && falls > 400, "{seen} {falls}");
    }

    #[test]
    fn what_is_drawn_depends_on_the_seed_alone() {
        let balls = Balls::default();
        let draw = |seed| {
            let flights = Flights::draw(Size::new(320, 240), &times(), &balls, seed).unwrap();
            (0..90)
                .map(|frame| flights.lay(frame, &Matrix3::identity(), &mut RgbImage::new(320, 240)))
                .collect::<Vec<_>>()
        };
        assert_eq!(draw(3), draw(3));
        assert_ne!(draw(3), draw(4));
    }
}
