//! Random starts of a studio's ball, and the paths that follow from them.

use std::f64::consts::TAU;

use nalgebra::{Point3, Vector3};
use rand::RngExt;

use super::{Disturbance, Engine, Site, Studio};
use gravisight_geometry::random::{Random, normal_pair};
use gravisight_physics::{Forecaster, State, Status};

/// Positions at `times`; [`None`] for a start that cannot be followed to the end.
pub(super) fn simulated(forecaster: &Forecaster, start: &State, times: &[f64]) -> Option<Vec<Point3<f64>>> {
    let forecast = forecaster.forecast(start, times);
    let whole = forecast.status == Status::Ok;
    whole.then(|| forecast.states.iter().map(|state| state.position).collect())
}

impl Studio {
    /// A random ball's path; [`None`] if it leaves the picture.
    pub(super) fn path(&self, engine: &mut dyn Engine, random: &mut Random, times: &[f64]) -> Option<Vec<Point3<f64>>> {
        let (start, later) = match self.shot.site {
            Site::Environment(_) => (self.thrown(random), 0.0),
            Site::Spring => (self.swung(random, times)?, 0.0),
            Site::Room => (self.thrown_in_room(random), random.random_range(0.0..self.paper.room.start.latest)),
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
            self.shot.site != Site::Room || (start.nearest..=start.farthest).contains(&distance)
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
        simulated(&Forecaster::new(&scene).ok()?, start, times)
    }

    /// A path with a push in a random direction at a random time.
    fn pushed(&self, start: &State, times: &[f64], random: &mut Random) -> Option<Vec<Point3<f64>>> {
        let hand = &self.paper.disturbances.hand;
        let moment =
            times.first()? + random.random_range(hand.between[0]..hand.between[1]) * (times.last()? - times.first()?);
        let direction = Vector3::from_fn(|_, _| normal_pair::<f64>(random)[0]).try_normalize(1e-9)?;
        let (before, after) = times.split_at(times.partition_point(|&time| time < moment));
        let mut path = simulated(&self.forecaster, start, before)?;
        let mut state = *self.forecaster.forecast(start, &[moment]).states.first()?;
        state.velocity += direction * hand.speed;
        let after: Vec<f64> = after.iter().map(|time| time - moment).collect();
        path.extend(simulated(&self.forecaster, &state, &after)?);
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
