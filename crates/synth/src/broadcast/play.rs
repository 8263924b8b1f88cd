//! What the ball does: flights from player to player, each as the scene's physics has it.

use std::ops::Range;

use nalgebra::{Point3, Vector3};
use rand::RngExt;

use super::Kind;
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::random::Random;
use gravisight_physics::{Forecast, Forecaster, State};

/// Steps of a flight that is tried, s, and the longest.
const STEP: f64 = 0.01;
const LONGEST: usize = 300;
/// Tries before a flight is given up.
const TRIES: usize = 20_000;
/// Spins that are drawn, in the ball's own standard deviations.
const SPIN: f64 = 0.5;

/// A ball's way through a clip.
pub(crate) struct Play {
    /// When each flight begins, s, and how.
    starts: Vec<(f64, State)>,
    /// When the last one ends, s.
    pub end: f64,
    /// When and where it is hit, s and m.
    pub hits: Vec<(f64, Point3<f64>)>,
    /// When and where it touches something, and what.
    pub bounces: Vec<(f64, Point3<f64>, String)>,
}

impl Play {
    /// # Errors
    /// [`Error::Data`] where no flight is found: the scene is not the kind's.
    pub fn draw(kind: Kind, forecaster: &Forecaster, random: &mut Random) -> Result<Self> {
        let mut play = Self { starts: vec![], end: 0.0, hits: vec![], bounces: vec![] };
        let mut side = if random.random_bool(0.5) { 1.0 } else { -1.0 };
        let (flights, mut at) = kind.begins(side, random);
        for flight in 0..flights {
            let (start, forecast, length) = kind.flight(forecaster, side, at, random)?;
            if flight > 0 {
                play.hits.push((play.end, at));
            }
            let before = forecast.impacts.iter().filter(|impact| impact.time < length);
            let now = play.end;
            play.bounces.extend(before.map(|impact| (now + impact.time, impact.world, impact.surface.to_string())));
            at = forecaster.forecast(&start, &[length]).states[0].position;
            play.starts.push((now, start));
            play.end = now + length;
            side = -side;
        }
        Ok(play)
    }

    /// Where it begins.
    pub fn begins(&self) -> Point3<f64> {
        self.starts[0].1.position
    }

    /// Where the ball is, m, at a time between 0 and the end, s.
    pub fn at(&self, forecaster: &Forecaster, time: f64) -> Point3<f64> {
        let index = self.starts.partition_point(|(start, _)| *start <= time).saturating_sub(1);
        let (begun, start) = &self.starts[index];
        forecaster.forecast(start, &[(time - begun).max(1e-6)]).states[0].position
    }
}

/// What a flight must be.
struct FlightVolume {
    /// Velocity across, along (towards the other side) and up, m/s.
    across: Range<f64>,
    along: Range<f64>,
    up: Range<f64>,
}

impl Kind {
    /// Flights of a clip, and where the first begins.
    fn begins(self, side: f64, random: &mut Random) -> (usize, Point3<f64>) {
        let mut between = |range: Range<f64>| random.random_range(range);
        let at = match self {
            Self::Tennis => [between(-3.0..3.0), -side * between(10.0..12.0), between(0.6..1.4)],
            Self::TableTennis => [between(-0.5..0.5), -side * between(1.6..2.0), between(0.9..1.15)],
            Self::Volleyball => [between(-3.5..3.5), -side * between(3.0..8.0), between(0.8..2.2)],
            Self::Toss => [between(-0.8..0.8), between(-0.8..0.8), between(0.7..1.5)],
        };
        let flights = match self {
            Self::Toss => 1,
            _ => random.random_range(2..=4),
        };
        (flights, at.into())
    }

    /// A flight from `at`, its forecast and how long it lasts, s.
    fn flight(
        self,
        forecaster: &Forecaster,
        side: f64,
        at: Point3<f64>,
        random: &mut Random,
    ) -> Result<(State, Forecast, f64)> {
        let FlightVolume { across, along, up } = match self {
            Self::Tennis => FlightVolume { across: -5.0..5.0, along: 16.0..38.0, up: -2.0..7.0 },
            Self::TableTennis => FlightVolume { across: -1.5..1.5, along: 3.5..11.0, up: -1.0..3.0 },
            Self::Volleyball => FlightVolume { across: -4.0..4.0, along: -3.0..12.0, up: 2.0..9.0 },
            Self::Toss => FlightVolume { across: -1.5..1.5, along: -1.5..1.5, up: 2.0..5.5 },
        };
        let sigma = SPIN * forecaster.scene().ball.spin_sigma.unwrap_or(0.0);
        let times: Vec<f64> = (1..=LONGEST).map(|step| STEP * step as f64).collect();
        for _ in 0..TRIES {
            let [x, y, z] = [across.clone(), along.clone(), up.clone()].map(|range| random.random_range(range));
            let spin = Vector3::from_fn(|_, _| sigma * random.random_range(-1.7..1.7));
            let start = State { position: at, velocity: Vector3::new(x, side * y, z), spin };
            let forecast = forecaster.forecast(&start, &times);
            if let Some(length) = self.length(side, &forecast, random) {
                return Ok((start, forecast, length));
            }
        }
        Err(Error::Data {
            what: self.name().into(),
            reason: "no flight of this kind was found; choose another seed".into(),
        })
    }

    /// How long a flight is played, s; none where it is not one that is.
    fn length(self, side: f64, forecast: &Forecast, random: &mut Random) -> Option<f64> {
        let arrives = |far: f64| forecast.states.iter().position(|state| side * state.position.y > far);
        let over = |height: f64| {
            let at = forecast.states.iter().find(|state| side * state.position.y > 0.0);
            at.is_some_and(|state| state.position.z > height)
        };
        let played = |index: usize, low: f64, high: f64, wide: f64| {
            let state = forecast.states.get(index)?;
            let good = (low..high).contains(&state.position.z) && state.position.x.abs() < wide;
            good.then_some(forecast.times[index])
        };
        let one_bounce = |end: f64, from: f64, to: f64, wide: f64, surface: &str| {
            let mut before = forecast.impacts.iter().filter(|impact| impact.time < end);
            let first = before.next();
            before.next().is_none()
                && first.is_some_and(|impact| {
                    (from..to).contains(&(side * impact.world.y))
                        && impact.world.x.abs() < wide
                        && impact.surface.to_string().starts_with(surface)
                })
        };
        match self {
            Self::Tennis => {
                let end = played(arrives(11.5)?, 0.3, 2.0, 5.5)?;
                (over(1.05) && one_bounce(end, 3.0, 11.7, 4.1, "floor")).then_some(end)
            }
            Self::TableTennis => {
                let end = played(arrives(1.8)?, 0.8, 1.6, 1.2)?;
                (over(0.95) && one_bounce(end, 0.1, 1.35, 0.74, "boxes")).then_some(end)
            }
            Self::Volleyball => {
                let end = random.random_range(0.5..1.6);
                let index = (end / STEP) as usize;
                let length = played(index, 0.6, 3.0, 4.5)?;
                let inside = forecast.states[index].position.y.abs() < 9.0;
                (inside && forecast.impacts.iter().all(|impact| impact.time > length)).then_some(length)
            }
            Self::Toss => {
                let end = random.random_range(1.2..2.4);
                let state = forecast.states.get((end / STEP) as usize)?;
                let count = forecast.impacts.iter().filter(|impact| impact.time < end).count();
                (state.position.coords.norm() < 3.0 && (1..=3).contains(&count)).then_some(end)
            }
        }
    }
}
