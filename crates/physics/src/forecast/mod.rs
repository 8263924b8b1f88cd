//! The forecaster (PAF): where a ball will be, and how that depends on its start.

pub mod flight;
mod guard;

use std::sync::Arc;

use nalgebra::{SMatrix, Vector3};

use self::guard::moved_out;
use super::columns::{Column, Columns, WITH_JACOBIAN, WITH_SPIN_JACOBIAN, part};
use super::contact::Contacts;
use super::force::{Forces, Potential};
use super::motion::run::Run;
use super::motion::{Forecast, ForecastOptions, Impact, Integrator, Status};
use super::obstacle::Obstacle;
use super::scene::Scene;
use super::state::State;
use gravisight_geometry::camera::Camera;
use gravisight_geometry::error::{Error, Result};

/// Largest speed of a start, m/s: beyond, its squares overflow.
const FASTEST: f64 = 1e9;

/// How a state moves on; the Jacobian is that of its first `D` components.
#[derive(Debug, Clone)]
#[doc(hidden)]
pub struct Transition<const D: usize> {
    pub end: Column,
    pub jacobian: SMatrix<f64, D, D>,
    /// Whether anything is touched on the way.
    pub contact: bool,
}

/// The laws of motion in a scene: the paper's physics-aware forecaster.
///
/// ```
/// # mod gravisight { pub use gravisight_geometry::error::*; pub use gravisight_physics::{self as physics, *}; }
/// use gravisight::{Forecaster, Scene};
/// use nalgebra::{Point3, Vector3};
///
/// let scene = Scene::from_json(
///     r#"{"gravity": [0, 0, -9.81], "ball": {"radius": 0.03}, "floor": {"height": 0},
///         "contact": {"model": "bounce", "restitution": 0.75}}"#, "scene")?;
/// let start = scene.start(Point3::new(0.0, 0.0, 1.0), Vector3::new(1.0, 0.0, 0.0));
/// let forecast = Forecaster::new(&scene)?.forecast_with_jacobians(&start, &[0.1, 0.6]);
/// assert!(forecast.status.is_whole());
/// assert_eq!(forecast.impacts.len(), 1);
/// # Ok::<(), gravisight::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Forecaster {
    scene: Scene,
    options: ForecastOptions,
    obstacles: Vec<Obstacle>,
    potential: Option<Arc<dyn Potential>>,
    forwards: Laws,
    backwards: Laws,
}

/// What moves the ball, in one direction of time.
#[derive(Debug, Clone)]
struct Laws {
    forces: Forces,
    contacts: Contacts,
}

/// What a trajectory is fitted to: `track`'s observations, which this crate is below of.
#[doc(hidden)]
pub trait Observed: Sized {
    type Options;
    type Fit;

    /// [`Forecaster::fit`].
    fn fit(
        forecaster: &Forecaster,
        camera: &Camera,
        observations: &[Self],
        options: &Self::Options,
    ) -> Result<Self::Fit>;
}

impl Forecaster {
    /// The forecaster of a scene, with default options.
    ///
    /// # Errors
    /// As [`Scene::check`].
    pub fn new(scene: &Scene) -> Result<Self> {
        scene.check("scene")?;
        Ok(Self::of(scene, ForecastOptions::default(), None))
    }

    fn of(scene: &Scene, options: ForecastOptions, potential: Option<Arc<dyn Potential>>) -> Self {
        let (forces, contacts) = (Forces::of(scene, potential.as_ref()), Contacts::of(scene));
        let backwards = Laws { forces: forces.reversed(), contacts: contacts.clone().reversed() };
        let forwards = Laws { forces, contacts };
        Self { scene: scene.clone(), options, obstacles: Obstacle::of(scene), potential, forwards, backwards }
    }

    /// The trajectory through `observations` (`gravisight::track::Observation`, by time) that the scene's physics allows and whose image
    /// explains them best. An example is at `gravisight::Fit`.
    ///
    /// # Errors
    /// [`Error::Fit`] for times that do not ascend, fewer than four observations, a track that no trajectory in front of the
    /// camera explains, or where `options` name a restitution that the scene's contact has not. [`Error::Value`] for a `config` of what is not positive. A label outside the camera's lens
    /// model costs itself alone (its `refused`).
    ///
    /// The forecaster's options hold for contacts that last; what flies freely is integrated with a step of its own.
    pub fn fit<O: Observed>(&self, camera: &Camera, observations: &[O], options: &O::Options) -> Result<O::Fit> {
        O::fit(self, camera, observations, options)
    }

    /// The same with other options.
    ///
    /// # Errors
    /// [`Error::Value`] for a tolerance, step or limit that is not positive.
    pub fn with_options(mut self, options: ForecastOptions) -> Result<Self> {
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
    pub fn with_potential(self, potential: Arc<dyn Potential>) -> Self {
        Self::of(&self.scene, self.options, Some(potential))
    }

    /// The same laws in another scene, options and the user's potential kept.
    ///
    /// # Errors
    /// As [`Scene::check`].
    pub fn in_scene(&self, scene: &Scene) -> Result<Self> {
        scene.check("scene")?;
        Ok(Self::of(scene, self.options, self.potential.clone()))
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// How it computes.
    pub fn options(&self) -> &ForecastOptions {
        &self.options
    }

    /// Kinetic and potential energy per unit mass, J/kg, without the spin's.
    pub fn energy(&self, state: &State) -> f64 {
        let (r, laws) = (&state.position.coords, &self.forwards);
        let potential = laws.forces.potential_energy(r) + laws.contacts.potential_energy(&self.obstacles, r);
        0.5 * state.velocity.norm_squared() + potential
    }

    /// Acceleration of a ball in this state, m/s².
    pub fn acceleration(&self, state: &State) -> Vector3<f64> {
        let (r, laws) = (&state.position.coords, &self.forwards);
        laws.forces.acceleration(r, &state.velocity, &state.spin) + laws.contacts.acceleration(&self.obstacles, r)
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
    #[doc(hidden)]
    pub fn transition<const D: usize>(&self, start: &Column, dt: f64) -> Option<Transition<D>> {
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
        let (columns, _) = moved_out(&self.forwards.contacts, &self.obstacles, &columns);
        let times = [dt.abs()];
        let (run, status) = self.run(columns, &times, dt < 0.0);
        if !status.is_whole() {
            return None;
        }
        let end = run.out.first()?;
        let touches = |column: &Column| self.touches(&part(column, 0));
        Some(Transition {
            contact: !run.impacts.is_empty() || touches(start) || touches(&end.0[0]),
            end: end.0[0],
            jacobian: SMatrix::from_fn(|row, column| end.0[column + 1][row]),
        })
    }

    /// Whether a ball here is in contact with anything.
    fn touches(&self, position: &Vector3<f64>) -> bool {
        let reach = self.forwards.contacts.reach();
        self.obstacles.iter().any(|obstacle| obstacle.distance(position) < reach)
    }

    /// Runs forwards and backwards as `times` ask, and puts the states into their order.
    fn both_ways<const M: usize>(&self, start: &State, times: &[f64]) -> Forecast {
        let empty = Forecast {
            times: vec![],
            states: vec![],
            jacobians: vec![],
            impacts: vec![],
            status: Status::NotFinite { time: 0.0 },
            moved: None,
            steps: 0,
        };
        let finite = start.is_finite() && times.iter().all(|time| time.is_finite());
        if !finite || start.velocity.norm() > FASTEST {
            return empty;
        }
        let columns = Columns::<M>::start(start.position.coords, start.velocity, start.spin);
        let (columns, moved) = moved_out(&self.forwards.contacts, &self.obstacles, &columns);
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
        in_order(&mut forecast, &places, times);
        forecast
    }

    /// A run from `start` to `times` (ascending, not negative; before the start if `backwards`), and how it ended.
    fn run<'a, const M: usize>(&'a self, start: Columns<M>, times: &'a [f64], backwards: bool) -> (Run<'a, M>, Status) {
        let laws = if backwards { &self.backwards } else { &self.forwards };
        let start = if backwards { start.mirrored() } else { start };
        let mut run = Run::new(&laws.forces, &self.obstacles, &self.options, start, times);
        let status = laws.contacts.drive(&mut run);
        if backwards {
            run.out.iter_mut().for_each(|y| *y = y.mirrored());
        }
        (run, status)
    }

    fn one_way<const M: usize>(&self, start: &Columns<M>, times: &[f64], backwards: bool) -> Forecast {
        let (run, status) = self.run(*start, times, backwards);
        let sign = if backwards { -1.0 } else { 1.0 };
        let impacts = run.impacts.iter().map(|impact| Impact {
            time: sign * impact.time,
            time_gradient: impact.time_gradient.map(|gradient| gradient.map(|by| sign * by)),
            ..*impact
        });
        Forecast {
            times: vec![],
            states: run.out.iter().map(Columns::state).collect(),
            jacobians: if M == 1 { vec![] } else { run.out.iter().map(Columns::jacobian).collect() },
            impacts: impacts.collect(),
            status: match status {
                Status::Irreversible { time } => Status::Irreversible { time: sign * time },
                Status::StepLimit { time } => Status::StepLimit { time: sign * time },
                Status::LeftRegion { time } => Status::LeftRegion { time: sign * time },
                Status::NotFinite { time } => Status::NotFinite { time: sign * time },
                whole => whole,
            },
            moved: None,
            steps: run.steps,
        }
    }
}

/// Puts states (and Jacobians) into the order of the times asked for; after an early stop, in ascending order of place.
fn in_order(forecast: &mut Forecast, places: &[usize], times: &[f64]) {
    let mut order: Vec<usize> = (0..places.len()).collect();
    order.sort_by_key(|&index| places[index]);
    forecast.times = order.iter().map(|&index| times[places[index]]).collect();
    forecast.states = order.iter().map(|&index| forecast.states[index]).collect();
    if !forecast.jacobians.is_empty() {
        forecast.jacobians = order.iter().map(|&index| forecast.jacobians[index]).collect();
    }
}
