//! The forecaster (PAF): where a ball will be, and how that depends on its start.

use std::sync::Arc;

use nalgebra::{Matrix6, Point3, SMatrix, Vector3};
use serde::{Deserialize, Serialize};

use super::columns::{Column, Columns, WITH_JACOBIAN, WITH_SPIN_JACOBIAN, part};
use super::engine::Engine;
use super::field::{Field, Linear, Potential};
use super::guard::{Moved, moved_out};
use super::impact::Rigid;
use super::integrate::Integrator;
use super::obstacle::{Obstacle, Surface};
use super::scene::{Contact, Scene};
use crate::error::{Error, Result};

/// Longest step, s: one frame at the paper's 15 frames a second. Times asked for are steps' ends, too.
const MAX_STEP: f64 = 1.0 / 15.0;
/// Distance from the origin at which a ball is lost, m.
const REGION: f64 = 1e4;
/// Widths (1/β) of a soft wall within which the ball is in contact with it.
const SOFT_WALL_WIDTHS: f64 = 8.0;
/// Steps after which a trajectory is given up.
const STEP_LIMIT: usize = 100_000;

/// How a state moves on; the Jacobian is that of its first `D` components.
#[derive(Debug, Clone)]
pub(super) struct Transition<const D: usize> {
    pub end: Column,
    pub jacobian: SMatrix<f64, D, D>,
    /// Whether anything is touched on the way.
    pub contact: bool,
}

/// A ball at one instant, in the world frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// Its centre, m.
    pub position: Point3<f64>,
    /// m/s.
    pub velocity: Vector3<f64>,
}

/// How a forecast is computed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct Options {
    /// Solver where no closed form is used.
    pub integrator: Integrator,
    /// Use closed forms where they exist: arcs between contacts without drag and spin, the linear spring.
    pub closed_forms: bool,
    /// Longest step, s. Adaptive steps without a cap tunnel through boxes.
    pub max_step: f64,
    /// Steps, tried or made, after which a trajectory is given up.
    pub step_limit: usize,
    /// Distance from the world's origin beyond which a ball is lost, m.
    pub region: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            integrator: Integrator::default(),
            closed_forms: true,
            max_step: MAX_STEP,
            step_limit: STEP_LIMIT,
            region: REGION,
        }
    }
}

/// How a forecast ended. Where it stopped early, states exist only for the times before.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Status {
    /// Whole.
    Ok,
    /// Whole; the start lay inside an obstacle and was moved out ([`Forecast::moved`]).
    StartInside,
    /// Backwards through a contact that cannot be undone (friction, or no rebound) at this time, s:
    /// states before it are those of a contact without friction.
    Irreversible {
        /// s.
        time: f64,
    },
    /// Stopped: too many steps.
    StepLimit {
        /// s.
        time: f64,
    },
    /// Stopped: farther from the origin than [`Options::region`].
    LeftRegion {
        /// s.
        time: f64,
    },
    /// Stopped: a start, or a force, that is not finite.
    NotFinite {
        /// s.
        time: f64,
    },
}

impl Status {
    /// Whether there is a state for every time.
    pub fn is_whole(&self) -> bool {
        matches!(self, Self::Ok | Self::StartInside | Self::Irreversible { .. })
    }

    /// Stable name, for programs.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::StartInside => "start-inside",
            Self::Irreversible { .. } => "irreversible",
            Self::StepLimit { .. } => "step-limit",
            Self::LeftRegion { .. } => "left-region",
            Self::NotFinite { .. } => "not-finite",
        }
    }
}

/// The ball touches an obstacle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Impact {
    /// s.
    pub time: f64,
    /// What it touches.
    pub surface: Surface,
    /// Its centre, m.
    pub position: Vector3<f64>,
    /// Speed at which it approaches, m/s.
    pub speed: f64,
    /// ∂time/∂(position, velocity at the start), s/m and s; zero without Jacobians.
    pub time_gradient: [f64; 6],
}

/// States at the times asked for, in their order.
#[derive(Debug, Clone, PartialEq)]
pub struct Forecast {
    /// One state a time; fewer where `status` says that it stopped.
    pub states: Vec<State>,
    /// ∂(position, velocity at the time)/∂(position, velocity at the start), one a state; empty where not asked for.
    pub jacobians: Vec<Matrix6<f64>>,
    /// Contacts by time. `penalty` has none.
    pub impacts: Vec<Impact>,
    /// How it ended.
    pub status: Status,
    /// What was done about a start inside an obstacle.
    pub moved: Option<Moved>,
    /// Steps, tried or made.
    pub steps: usize,
}

/// The laws of motion in a scene: the paper's physics-aware forecaster.
///
/// ```
/// use gravisight::physics::{Forecaster, Scene, State};
/// use nalgebra::{Point3, Vector3};
///
/// let scene = Scene::from_json(
///     r#"{"gravity": [0, 0, -9.81], "ball": {"radius": 0.03}, "floor": {"height": 0},
///         "contact": {"model": "bounce", "restitution": 0.75}}"#, "scene")?;
/// let start = State { position: Point3::new(0.0, 0.0, 1.0), velocity: Vector3::new(1.0, 0.0, 0.0) };
/// let forecast = Forecaster::new(&scene)?.forecast_with_jacobians(&start, &[0.1, 0.6]);
/// assert!(forecast.status.is_whole());
/// assert_eq!(forecast.impacts.len(), 1);
/// # Ok::<(), gravisight::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Forecaster {
    scene: Scene,
    options: Options,
    obstacles: Vec<Obstacle>,
    forwards: Field,
    backwards: Field,
}

impl Forecaster {
    /// The forecaster of a scene, with default options.
    ///
    /// # Errors
    /// As [`Scene::check`].
    pub fn new(scene: &Scene) -> Result<Self> {
        scene.check("scene")?;
        let obstacles = Obstacle::of(scene);
        let forwards = Field::new(scene, &obstacles, None);
        let backwards = forwards.reversed();
        Ok(Self { scene: scene.clone(), options: Options::default(), obstacles, forwards, backwards })
    }

    /// The same with other options.
    ///
    /// # Errors
    /// [`Error::Value`] for a tolerance, step or limit that is not positive.
    pub fn with_options(mut self, options: Options) -> Result<Self> {
        let positive = |field: &str, value: f64| match value > 0.0 {
            true => Ok(()),
            false => Err(Error::value("forecast options", field, format!("must be greater than zero, not {value}"))),
        };
        match options.integrator {
            Integrator::DormandPrince { rtol, atol } => {
                positive("rtol", rtol)?;
                positive("atol", atol)?;
            }
            Integrator::RungeKutta4 { step } | Integrator::VelocityVerlet { step } => positive("step", step)?,
        }
        positive("max_step", options.max_step)?;
        positive("region", options.region)?;
        self.options = options;
        Ok(self)
    }

    /// The same with a potential of the user's own on top of the scene's forces.
    pub fn with_potential(mut self, potential: Arc<dyn Potential>) -> Self {
        self.forwards = Field::new(&self.scene, &self.obstacles, Some(potential));
        self.backwards = self.forwards.reversed();
        self
    }

    /// The same laws in another scene, options and the user's potential kept.
    ///
    /// # Errors
    /// As [`Scene::check`].
    pub fn in_scene(&self, scene: &Scene) -> Result<Self> {
        let other = Self { options: self.options, ..Self::new(scene)? };
        Ok(match self.forwards.potential() {
            Some(potential) => other.with_potential(potential.clone()),
            None => other,
        })
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Kinetic and potential energy per unit mass, J/kg, without the spin's.
    pub fn energy(&self, state: &State) -> f64 {
        0.5 * state.velocity.norm_squared() + self.forwards.potential_energy(&state.position.coords)
    }

    /// Acceleration of a ball in this state with the scene's spin, m/s².
    pub fn acceleration(&self, state: &State) -> Vector3<f64> {
        let spin = self.scene.ball.spin.into();
        let mut partials = super::field::Partials::zero();
        self.forwards.acceleration::<false>(&state.position.coords, &state.velocity, &spin, &mut partials)
    }

    /// States at `times`, s after the start (negative: before it), in any order.
    pub fn forecast(&self, start: &State, times: &[f64]) -> Forecast {
        self.both_ways::<1>(start, times)
    }

    /// [`Self::forecast`] with the 6×6 Jacobian of each state by the start, by forward sensitivities.
    pub fn forecast_with_jacobians(&self, start: &State, times: &[f64]) -> Forecast {
        self.both_ways::<WITH_JACOBIAN>(start, times)
    }

    /// [`Self::forecast_with_jacobians`] of many starts; natively in parallel.
    pub fn forecast_batch(&self, starts: &[State], times: &[f64]) -> Vec<Forecast> {
        #[cfg(not(target_arch = "wasm32"))]
        {
            use rayon::prelude::*;
            starts.par_iter().map(|start| self.forecast_with_jacobians(start, times)).collect()
        }
        #[cfg(target_arch = "wasm32")]
        starts.iter().map(|start| self.forecast_with_jacobians(start, times)).collect()
    }

    /// Position, velocity and spin `dt` s later (negative: earlier), with the Jacobian of the first `D`
    /// components (6 or 9); `None` where the forecast stops before.
    pub(super) fn transition<const D: usize>(&self, start: &Column, dt: f64) -> Option<Transition<D>> {
        match D {
            6 => self.transition_of::<D, WITH_JACOBIAN>(start, dt),
            _ => self.transition_of::<D, WITH_SPIN_JACOBIAN>(start, dt),
        }
    }

    fn transition_of<const D: usize, const M: usize>(&self, start: &Column, dt: f64) -> Option<Transition<D>> {
        if !start.iter().all(|value| value.is_finite()) {
            return None;
        }
        let parts = [0, 1, 2].map(|index| part(start, index));
        let columns = Columns::<M>::start(parts[0], parts[1], parts[2]);
        let (columns, _) = moved_out(&self.scene, &self.obstacles, &columns);
        let times = [dt.abs()];
        let backwards = dt < 0.0;
        let columns = if backwards { mirrored(&columns) } else { columns };
        let mut engine = self.engine(columns, &times, backwards);
        let status = engine.run();
        if !status.is_whole() {
            return None;
        }
        let contact = !engine.impacts.is_empty();
        let end = engine.out.first().map(|y| if backwards { mirrored(y) } else { *y })?;
        let touches = |column: &Column| self.touches(&part(column, 0));
        Some(Transition {
            contact: contact || touches(start) || touches(&end.0[0]),
            end: end.0[0],
            jacobian: SMatrix::from_fn(|row, column| end.0[column + 1][row]),
        })
    }

    /// Whether a ball here is in contact with anything.
    fn touches(&self, position: &Vector3<f64>) -> bool {
        let reach = match self.scene.contact {
            Contact::Penalty { beta, beta_box, .. } => SOFT_WALL_WIDTHS / beta.min(beta_box),
            _ => self.scene.ball.radius + 1e-9,
        };
        self.obstacles.iter().any(|obstacle| obstacle.distance(position) < reach)
    }

    /// Accelerations that have a closed form; contacts, drag, spin and the user's potential left out.
    pub(super) fn linear_part(&self) -> Linear {
        self.forwards.linear_part()
    }

    /// The accelerations that [`Self::linear_part`] leaves out, contacts excepted, m/s².
    pub(super) fn nonlinear_acceleration(&self, r: &Vector3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
        let spin = self.scene.ball.spin.into();
        self.forwards.nonlinear_acceleration(r, v, &spin)
    }

    /// Runs forwards and backwards as `times` ask, and puts the states into their order.
    fn both_ways<const M: usize>(&self, start: &State, times: &[f64]) -> Forecast {
        let empty = Forecast {
            states: vec![],
            jacobians: vec![],
            impacts: vec![],
            status: Status::NotFinite { time: 0.0 },
            moved: None,
            steps: 0,
        };
        let finite = start.position.iter().chain(start.velocity.iter()).chain(times).all(|value| value.is_finite());
        if !finite {
            return empty;
        }
        let columns = Columns::<M>::start(start.position.coords, start.velocity, self.scene.ball.spin.into());
        let (columns, moved) = moved_out(&self.scene, &self.obstacles, &columns);
        let mut order: Vec<usize> = (0..times.len()).collect();
        order.sort_by(|&a, &b| times[a].total_cmp(&times[b]));
        let split = order.partition_point(|&index| times[index] < 0.0);
        let past: Vec<f64> = order[..split].iter().rev().map(|&index| -times[index]).collect();
        let future: Vec<f64> = order[split..].iter().map(|&index| times[index]).collect();
        let (earlier, mut forecast) = (self.one_way(&columns, &past, true), self.one_way(&columns, &future, false));
        let mut places: Vec<usize> = order[..split].iter().rev().copied().collect();
        places.truncate(earlier.states.len());
        places.extend(order[split..].iter().take(forecast.states.len()));
        forecast.states = earlier.states.iter().chain(&forecast.states).copied().collect();
        forecast.jacobians = earlier.jacobians.iter().chain(&forecast.jacobians).copied().collect();
        forecast.impacts = earlier.impacts.iter().rev().chain(&forecast.impacts).copied().collect();
        forecast.steps += earlier.steps;
        if !matches!(earlier.status, Status::Ok) && forecast.status.is_whole() {
            forecast.status = earlier.status;
        }
        if forecast.status == Status::Ok && moved.is_some() {
            forecast.status = Status::StartInside;
        }
        forecast.moved = moved;
        in_order(&mut forecast, &places);
        forecast
    }

    fn engine<'a, const M: usize>(&'a self, start: Columns<M>, times: &'a [f64], backwards: bool) -> Engine<'a, M> {
        let ball = &self.scene.ball;
        let (restitution, friction) = match self.scene.contact {
            Contact::Bounce { restitution, friction } => (restitution, friction),
            _ => (1.0, 0.0),
        };
        let restitution = if backwards { 1.0 / restitution } else { restitution };
        Engine {
            field: if backwards { &self.backwards } else { &self.forwards },
            obstacles: &self.obstacles,
            contact: &self.scene.contact,
            rigid: Rigid { radius: ball.radius, restitution, friction, inertia_factor: ball.inertia_factor },
            options: &self.options,
            backwards,
            times,
            y: start,
            t: 0.0,
            h: self.options.max_step,
            steps: 0,
            out: Vec::with_capacity(times.len()),
            impacts: vec![],
            irreversible: None,
        }
    }

    fn one_way<const M: usize>(&self, start: &Columns<M>, times: &[f64], backwards: bool) -> Forecast {
        let start = if backwards { mirrored(start) } else { *start };
        let mut engine = self.engine(start, times, backwards);
        let status = engine.run();
        engine.out.retain(Columns::is_finite);
        let sign = if backwards { -1.0 } else { 1.0 };
        let out: Vec<Columns<M>> = engine.out.iter().map(|y| if backwards { mirrored(y) } else { *y }).collect();
        let impacts = engine.impacts.iter().map(|impact| Impact {
            time: sign * impact.time,
            time_gradient: impact.time_gradient.map(|by| sign * by),
            ..*impact
        });
        let state = |y: &Columns<M>| State { position: Point3::from(y.position()), velocity: y.velocity() };
        Forecast {
            states: out.iter().map(state).collect(),
            jacobians: if M == 1 { vec![] } else { out.iter().map(Columns::jacobian).collect() },
            impacts: impacts.collect(),
            status: match status {
                Status::Irreversible { time } => Status::Irreversible { time: sign * time },
                Status::StepLimit { time } => Status::StepLimit { time: sign * time },
                Status::LeftRegion { time } => Status::LeftRegion { time: sign * time },
                Status::NotFinite { time } => Status::NotFinite { time: sign * time },
                whole => whole,
            },
            moved: None,
            steps: engine.steps,
        }
    }
}

/// (r, −v, −ω), in every column: the state as time runs the other way.
fn mirrored<const M: usize>(y: &Columns<M>) -> Columns<M> {
    let mut out = *y;
    for values in &mut out.0 {
        for value in &mut values[3..] {
            *value = -*value;
        }
    }
    out
}

/// Puts states (and Jacobians) into the order of the times asked for; after an early stop, in ascending order of place.
fn in_order(forecast: &mut Forecast, places: &[usize]) {
    let mut order: Vec<usize> = (0..places.len()).collect();
    order.sort_by_key(|&index| places[index]);
    forecast.states = order.iter().map(|&index| forecast.states[index]).collect();
    if !forecast.jacobians.is_empty() {
        forecast.jacobians = order.iter().map(|&index| forecast.jacobians[index]).collect();
    }
}
