//! From a 2D track of one camera to the 3D trajectory that explains it best.
//!
//! Gravity (or any known force) gives the scale: a free flight's images determine position and
//! velocity linearly ([`seed`]). From there the trajectory grows frame by frame through contacts,
//! refined all along ([`chain`]); several starts are grown, and the best parts of all are joined.

mod chain;
mod parameters;
mod problem;
mod seed;

use nalgebra::{Matrix3, Point2, Point3, Vector2};

use self::chain::{Chain, Loss};
pub use self::parameters::{Estimate, Parameter};
use self::problem::Problem;
use super::columns::{Column, part};
use super::forecast::{Forecaster, State};
use super::scene::Contact;
use crate::camera::Camera;
use crate::error::{Error, Result};

/// Fewest observations that determine a flight: six numbers, two an observation, and one to spare.
const FEWEST: usize = 4;
/// Smallest standard deviation of labels that is believed, px.
const SMALLEST_NOISE: f64 = 0.03;
/// Frames that a trajectory grows by between two refinements; where one choice fails, the next may not.
const GROWTH: [usize; 3] = [4, 7, 2];
/// Frames near an end that tell whether it is right.
const END: usize = 8;
/// Frames behind the growing end that are refined with it.
const REACH: usize = 30;
/// Mean cost of the frames at an end (2 is to be expected) above which other continuations are tried.
const BAD_END: f64 = 3.5;
/// Mean cost at which a chain grows no further.
const LOST_END: f64 = 25.0;
/// How far, in standard deviations of the end's position.
const SHIFTS: [f64; 10] = [-0.3, 0.3, -0.7, 0.7, -1.2, 1.2, -2.0, 2.0, -3.2, 3.2];
/// Loss while growing and at the end, in standard deviations.
const GROWING: Loss = Loss::Huber(3.0);
const FINAL: Loss = Loss::Cauchy(3.0);
/// Residual, in standard deviations, of an outlier.
const OUTLIER: f64 = 4.0;
/// Cost of an interval across which two trajectories are joined that the laws do not join, at most.
const JOIN: f64 = 60.0;
/// Standard deviation of a known spin, rad/s.
const KNOWN_SPIN: f64 = 1e-3;
/// Standard deviation of a spin that is to be estimated, rad/s.
const UNKNOWN_SPIN: f64 = 200.0;
/// Transitions a frame, on average, after which no more starts are grown.
const SEARCH: usize = 6000;
/// Difference of cost below which two trajectories explain the track equally well.
const SAME: f64 = 2.0;
/// How far the best is moved in search of a better one, in standard deviations.
const POLISH: [f64; 4] = [-1.0, 1.0, -2.5, 2.5];
/// Cost, in units of what noise alone costs, at which a trajectory explains its track.
const EXPLAINED: f64 = 1.3;
/// Distance from the neighbours' line, in units of its median, beyond which a label is not used to start with.
const SUSPECT: f64 = 10.0;
/// Rounds in which the labels' noise is estimated anew.
const NOISE_ROUNDS: usize = 2;

/// One frame of a track.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// s.
    pub time: f64,
    /// The ball's centre in the picture, px; `None` where it was not seen.
    pub image: Option<Point2<f64>>,
}

/// How a track is fitted.
#[derive(Debug, Clone, PartialEq)]
pub struct FitOptions {
    /// Standard deviation of the 2D labels, px; estimated from the track where `None`.
    pub noise_px: Option<f64>,
    /// Starts that are grown to whole trajectories, at most.
    pub starts: usize,
    /// What is unknown of the ball: the scene's value is where the search for it starts.
    pub estimate: Vec<Parameter>,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self { noise_px: None, starts: 24, estimate: vec![] }
    }
}

/// The fitted ball at one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedFrame {
    /// s.
    pub time: f64,
    /// Position and velocity in the world.
    pub state: State,
    /// Covariance of the position, m²: the labels' noise and the laws' own uncertainty, and the
    /// spread of other trajectories that explain the track nearly as well.
    pub covariance: Matrix3<f64>,
    /// Projection minus label, px.
    pub residual_px: Option<Vector2<f64>>,
    /// Whether the label does not belong to the trajectory.
    pub outlier: bool,
}

impl FittedFrame {
    /// Root mean square error of the position to expect, m.
    pub fn sigma(&self) -> f64 {
        self.covariance.trace().max(0.0).sqrt()
    }
}

/// A fitted trajectory.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// One a frame of the track, seen or not.
    pub frames: Vec<FittedFrame>,
    /// Standard deviation of the labels, px: the one given, or found.
    pub noise_px: f64,
    /// Root mean square residual of the labels that are no outliers, px.
    pub rms_px: f64,
    /// Whether the trajectory explains the labels to about their noise. If not, a force is unknown, the
    /// scene or the camera wrong, or the right trajectory was not found.
    pub explained: bool,
    /// The numbers of the scene that were to be estimated.
    pub estimates: Vec<Estimate>,
    /// Spin at the first frame, rad/s: the scene's, or the one found.
    pub spin: [f64; 3],
}

impl Forecaster {
    /// The trajectory through `observations` (by time) that the scene's physics allows and whose image
    /// explains them best.
    ///
    /// # Errors
    /// [`Error::Fit`] for times that do not ascend, fewer than four observations, or a track that no
    /// trajectory in front of the camera explains; the camera's errors for a label outside its lens model.
    pub fn fit(&self, camera: &Camera, observations: &[Observation], options: &FitOptions) -> Result<Fit> {
        check(observations)?;
        // The spin matters where air or friction turns it into forces.
        let ball = &self.scene().ball;
        let rubs = matches!(self.scene().contact, Contact::Bounce { friction, .. } if friction > 0.0);
        match ball.lift_coefficient != 0.0 || rubs || options.estimate.contains(&Parameter::Spin) {
            true => self.fit_chain::<9>(camera, observations, options),
            false => self.fit_chain::<6>(camera, observations, options),
        }
    }

    fn fit_chain<const D: usize>(
        &self,
        camera: &Camera,
        observations: &[Observation],
        options: &FitOptions,
    ) -> Result<Fit> {
        let spin_sigma = if options.estimate.contains(&Parameter::Spin) { UNKNOWN_SPIN } else { KNOWN_SPIN };
        let trusted = trusted(observations);
        let noise = options.noise_px.unwrap_or_else(|| noise_of(&trusted)).max(SMALLEST_NOISE);
        let mut problem = Problem::new(self, camera, observations, &trusted, noise, spin_sigma)?;
        let numbers: Vec<Parameter> = options.estimate.iter().copied().filter(|&p| p != Parameter::Spin).collect();
        problem.slack = parameters::slack(&numbers);
        let chains = searched::<D>(&mut problem, options)?;
        if numbers.is_empty() {
            return finished(&problem, &chains, vec![]).ok_or_else(unexplained);
        }
        let found = parameters::searched(&mut problem, &chains, &numbers, options.noise_px.is_none())?;
        let problem = problem.with(&found.forecaster);
        let mut fit = finished(&problem, &[found.chain], found.estimates).ok_or_else(unexplained)?;
        for (frame, spread) in fit.frames.iter_mut().zip(found.spread) {
            frame.covariance += spread;
        }
        Ok(fit)
    }
}

fn unexplained() -> Error {
    let reason = "no trajectory in front of the camera explains the track; check camera.json, scene.json and fps";
    Error::Fit { reason: reason.into() }
}

/// Trajectories that explain the track, and pieces of such; finds the labels' noise where it is not given.
fn searched<const D: usize>(problem: &mut Problem, options: &FitOptions) -> Result<Vec<Chain<D>>> {
    let mut chains: Vec<Chain<D>> = Vec::new();
    let seeds = seed::seeds(problem, options.starts);
    'search: for growth in GROWTH {
        for seed in &seeds {
            let chain = Chain { first: seed.first, states: seed.states.clone() };
            chains.extend(grown(problem, chain, growth, LOST_END));
            if settled(problem, &chains) || problem.tired(SEARCH) {
                break 'search;
            }
        }
    }
    chains.extend(joined(problem, &chains));
    if best_of(problem, &chains).is_none() {
        // nothing explains the whole track: the longest piece, come what may
        let longest = chains.iter().max_by_key(|chain| chain.states.len()).cloned();
        chains.extend(longest.and_then(|chain| grown(problem, chain, GROWTH[0], f64::INFINITY)));
    }
    let (best, _) = best_of(problem, &chains).ok_or_else(unexplained)?;
    chains.push(polished(problem, chains[best].clone()));
    for _ in 0..NOISE_ROUNDS {
        if options.noise_px.is_none() {
            let (best, _) = best_of(problem, &chains).ok_or_else(unexplained)?;
            problem.sigma = residual_noise(problem, &chains[best]);
        }
        for chain in chains.iter_mut().filter(|chain| chain.states.len() == problem.len()) {
            chain.refine(problem, (0, problem.len()), FINAL, 15);
        }
    }
    Ok(chains)
}

/// Whether a trajectory that explains the labels to their noise was found from two starts.
fn settled<const D: usize>(problem: &Problem, chains: &[Chain<D>]) -> bool {
    let Some((best, excess)) = best_of(problem, chains) else { return false };
    let cost = |chain: &Chain<D>| chain.total_cost(problem, FINAL);
    let whole = chains.iter().filter(|chain| chain.states.len() == problem.len());
    let as_good = whole.filter(|chain| cost(chain) < cost(&chains[best]) + SAME).count();
    excess < EXPLAINED && as_good >= 2
}

/// The chain, or a cheaper one found by moving its flights along what they know least.
fn polished<const D: usize>(problem: &Problem, mut best: Chain<D>) -> Chain<D> {
    let mut cost = best.total_cost(problem, FINAL);
    let last = problem.len() - 1;
    for frame in best.flights(problem) {
        for by in POLISH {
            let Some(mut chain) = best.shifted(problem, frame, by, true, FINAL) else { continue };
            chain.refine(problem, (0, last), GROWING, 8);
            chain.refine(problem, (0, last), FINAL, 8);
            let found = chain.total_cost(problem, FINAL);
            if found < cost - SAME {
                (best, cost) = (chain, found);
            }
        }
    }
    best
}

/// The cheapest chain, and its cost in units of what noise alone costs.
fn best_of<const D: usize>(problem: &Problem, chains: &[Chain<D>]) -> Option<(usize, f64)> {
    let whole = chains.iter().enumerate().filter(|(_, chain)| chain.states.len() == problem.len());
    let costs = whole.map(|(index, chain)| (index, chain.total_cost(problem, FINAL)));
    let (best, cost) = costs.min_by(|(_, a), (_, b)| a.total_cmp(b))?;
    let seen = problem.rays.iter().flatten().count();
    Some((best, cost / (2 * seen) as f64))
}

fn check(observations: &[Observation]) -> Result<()> {
    let refuse = |reason: String| Err(Error::Fit { reason });
    if let Some(index) = (1..observations.len()).find(|&i| !(observations[i].time > observations[i - 1].time)) {
        let times = [observations[index - 1].time, observations[index].time];
        return refuse(format!("times must ascend, but {} s is followed by {} s", times[0], times[1]));
    }
    let seen = observations.iter().filter(|observation| observation.image.is_some()).count();
    let finite = |o: &Observation| o.time.is_finite() && o.image.is_none_or(|p| p.x.is_finite() && p.y.is_finite());
    if !observations.iter().all(finite) {
        return refuse("the track holds NaN or infinity".into());
    }
    match seen {
        FEWEST.. => Ok(()),
        _ => refuse(format!("the ball is seen in {seen} frames; at least {FEWEST} are needed")),
    }
}

/// Observations without those that lie far off the line of their neighbours in the picture: a first look,
/// for starts and growth. At the end all labels count, and the loss lets go of outliers.
fn trusted(observations: &[Observation]) -> Vec<Observation> {
    let seen: Vec<usize> = (0..observations.len()).filter(|&frame| observations[frame].image.is_some()).collect();
    let at = |index: usize| observations[seen[index]].image.map_or(Vector2::zeros(), |image| image.coords);
    let line = |index: usize, i: usize, j: usize| {
        let [t, from, to] = [index, i, j].map(|index| observations[seen[index]].time);
        at(i) + (at(j) - at(i)) * ((t - from) / (to - from))
    };
    // the median of what pairs of neighbours say
    let deviation = |index: usize| {
        let pairs = [(-1, 1), (-2, 2), (-2, -1), (1, 2), (-1, 2), (-2, 1)].into_iter();
        let neighbour = |by: isize| index.checked_add_signed(by).filter(|&other| other < seen.len());
        let said: Vec<_> = pairs.filter_map(|(i, j)| Some(line(index, neighbour(i)?, neighbour(j)?))).collect();
        let along = |axis: usize| median(said.iter().map(|point| point[axis]).collect());
        (at(index) - Vector2::new(along(0), along(1))).norm()
    };
    let deviations: Vec<f64> = (0..seen.len()).map(deviation).collect();
    let limit = SUSPECT * median(deviations.clone()).max(SMALLEST_NOISE);
    let mut out = observations.to_vec();
    for (index, _) in deviations.iter().enumerate().filter(|(_, deviation)| **deviation > limit) {
        out[seen[index]].image = None;
    }
    out
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// Noise of labels on a smooth track, from its third differences, px.
fn noise_of(observations: &[Observation]) -> f64 {
    let sizes: Vec<f64> = observations
        .windows(4)
        .filter_map(|four| {
            let [a, b, c, d] = [0, 1, 2, 3].map(|i| four[i].image);
            let third = (d?.coords - a?.coords) + 3.0 * (b?.coords - c?.coords);
            Some([third.x.abs(), third.y.abs()])
        })
        .flatten()
        .collect();
    // median of |N(0, σ√20)|
    if sizes.is_empty() { 1.0 } else { median(sizes) / 0.6745 / 20.0_f64.sqrt() }
}

/// Noise of the labels around a trajectory, from the residuals' median, px; not smaller than is believed.
fn residual_noise<const D: usize>(problem: &Problem, chain: &Chain<D>) -> f64 {
    let residuals = (0..problem.len()).filter_map(|frame| Some(chain.observed(problem, frame, FINAL)?.2));
    let sizes: Vec<f64> = residuals.flat_map(|residual| [residual.x.abs(), residual.y.abs()]).collect();
    if sizes.is_empty() { 1.0 } else { (median(sizes) / 0.6745).max(SMALLEST_NOISE) }
}

/// A chain grown over the whole track.
///
/// Where the frames just reached are explained badly (the ball met a box that the chain passes, or the
/// other way round), the chain is also tried some standard deviations nearer and farther. Where none
/// of these explains them to `patience` (mean cost), the chain ends there; its good part may still be joined to others.
fn grown<const D: usize>(problem: &Problem, mut chain: Chain<D>, growth: usize, patience: f64) -> Option<Chain<D>> {
    let end = problem.len() - 1;
    chain.refine(problem, (chain.first, chain.last()), GROWING, 20);
    while chain.first > 0 || chain.last() < end {
        let mut next = extended(problem, &chain, growth, 8)?;
        let ends = [next.last(), next.first];
        let worst = ends.map(|end| misfit(problem, &next, end));
        if worst[0].max(worst[1]) > BAD_END {
            let frame = if worst[0] > worst[1] { chain.last() } else { chain.first };
            let shifted = SHIFTS.iter().filter_map(|&by| chain.shifted(problem, frame, by, false, GROWING));
            let others: Vec<Chain<D>> = shifted.filter_map(|chain| extended(problem, &chain, growth, 5)).collect();
            let cost = |chain: &Chain<D>| chain.total_cost(problem, GROWING);
            if let Some(best) = others.into_iter().min_by(|a, b| cost(a).total_cmp(&cost(b)))
                && cost(&best) < cost(&next)
            {
                next = best;
                next.refine(problem, (next.first, next.last()), GROWING, 8);
            }
        }
        let lost = misfit(problem, &next, next.last()).max(misfit(problem, &next, next.first)) > patience;
        chain = next;
        if lost {
            return Some(chain);
        }
    }
    chain.refine(problem, (0, end), GROWING, 10);
    chain.refine(problem, (0, end), FINAL, 10);
    Some(chain)
}

/// The chain some frames longer at both ends, and refined there.
fn extended<const D: usize>(problem: &Problem, chain: &Chain<D>, growth: usize, iterations: usize) -> Option<Chain<D>> {
    let mut chain = chain.clone();
    for _ in 0..growth {
        if chain.last() + 1 < problem.len() {
            let last = chain.states[chain.states.len() - 1];
            let next = problem.transition::<D>(&last, problem.interval(chain.last()))?;
            chain.states.push(next.end);
        }
        if chain.first > 0 {
            let before = problem.transition::<D>(&chain.states[0], -problem.interval(chain.first - 1))?;
            chain.states.insert(0, before.end);
            chain.first -= 1;
        }
    }
    if chain.states.len() <= 2 * REACH {
        chain.refine(problem, (chain.first, chain.last()), GROWING, iterations);
    } else {
        chain.refine(problem, (chain.last() - REACH, chain.last()), GROWING, iterations);
        chain.refine(problem, (chain.first, chain.first + REACH), GROWING, iterations);
    }
    Some(chain)
}

/// Mean cost of the observations near one end of a chain.
fn misfit<const D: usize>(problem: &Problem, chain: &Chain<D>, end: usize) -> f64 {
    let near = end.saturating_sub(END).max(chain.first)..=(end + END).min(chain.last());
    let costs: Vec<f64> = near.filter_map(|frame| Some(chain.observed(problem, frame, GROWING)?.0)).collect();
    costs.iter().sum::<f64>() / costs.len().max(1) as f64
}

/// The cheapest way through the chains' states (dynamic programming), refined.
fn joined<const D: usize>(problem: &Problem, chains: &[Chain<D>]) -> Option<Chain<D>> {
    let mut cost: Vec<f64> = chains.iter().map(|chain| observed_cost(problem, chain, 0)).collect();
    let mut from: Vec<Vec<usize>> = Vec::new();
    for frame in 1..problem.len() {
        let ends: Vec<Option<(Column, bool)>> = chains
            .iter()
            .map(|chain| problem.transition::<D>(chain.at(frame - 1)?, problem.interval(frame - 1)))
            .map(|transition| transition.map(|transition| (transition.end, transition.contact)))
            .collect();
        let step = |into: usize, out: usize| -> f64 {
            let (Some((end, contact)), Some(state)) = (ends[out], chains[into].at(frame)) else { return JOIN };
            let precision = problem.precision::<D>(frame - 1, contact.then_some([1.0, 1.0]));
            let square: f64 = (0..D).map(|i| precision[i] * (state[i] - end[i]).powi(2)).sum();
            if into == out { square.min(JOIN) } else { square.min(JOIN) + 1.0 }
        };
        let mut next = Vec::with_capacity(chains.len());
        let mut origins = Vec::with_capacity(chains.len());
        for into in 0..chains.len() {
            let total = |out: usize| cost[out] + step(into, out);
            let origin = (0..chains.len()).min_by(|&a, &b| total(a).total_cmp(&total(b)))?;
            next.push(total(origin) + observed_cost(problem, &chains[into], frame));
            origins.push(origin);
        }
        cost = next;
        from.push(origins);
    }
    let mut at = (0..chains.len()).min_by(|&a, &b| cost[a].total_cmp(&cost[b]))?;
    let mut states = vec![*chains[at].at(problem.len() - 1)?];
    for (frame, origins) in from.iter().enumerate().rev() {
        at = origins[at];
        states.insert(0, *chains[at].at(frame)?);
    }
    let mut path = Chain { first: 0, states };
    path.refine(problem, (0, problem.len()), GROWING, 20);
    path.refine(problem, (0, problem.len()), FINAL, 20);
    Some(path)
}

/// Cost of a frame's observation; infinite where the chain does not reach.
fn observed_cost<const D: usize>(problem: &Problem, chain: &Chain<D>, frame: usize) -> f64 {
    if chain.at(frame).is_none() {
        return f64::INFINITY;
    }
    chain.observed(problem, frame, FINAL).map_or(0.0, |(cost, _, _)| cost)
}

/// The result, with covariances.
fn finished<const D: usize>(problem: &Problem, chains: &[Chain<D>], estimates: Vec<Estimate>) -> Option<Fit> {
    let (best, excess) = best_of(problem, chains)?;
    let best = &chains[best];
    let covariances = best.covariances(problem, FINAL)?;
    let cost = best.total_cost(problem, FINAL);
    // Where even the best explains badly, its own covariance says little, and more of the others count.
    let explained = excess < EXPLAINED * EXPLAINED;
    let temperature = if explained { 1.0 } else { excess * excess };
    let others: Vec<(f64, &Chain<D>)> = chains
        .iter()
        .filter(|chain| chain.states.len() == problem.len())
        .map(|chain| ((-0.5 * (chain.total_cost(problem, FINAL) - cost) / temperature).min(0.0).exp(), chain))
        .filter(|(weight, _)| *weight > 1e-6)
        .collect();
    let all = others.iter().map(|(weight, _)| weight).sum::<f64>();
    let mut squares = Vec::new();
    let frames = (0..problem.len())
        .map(|frame| {
            let state = best.at(frame)?;
            let own = &covariances[frame];
            let mut covariance = own.fixed_view::<3, 3>(0, 0) * temperature;
            for (weight, other) in &others {
                let off = part(other.at(frame)?, 0) - part(state, 0);
                covariance += off * off.transpose() * (*weight / all);
            }
            let residual_px = best.observed(problem, frame, FINAL).map(|(_, _, residual)| residual);
            let outlier = residual_px.is_some_and(|residual| residual.norm() > OUTLIER * problem.sigma);
            squares.extend(residual_px.filter(|_| !outlier).map(|residual| residual.norm_squared() / 2.0));
            Some(FittedFrame {
                time: problem.observations[frame].time,
                state: State { position: Point3::from(part(state, 0)), velocity: part(state, 1) },
                covariance,
                residual_px,
                outlier,
            })
        })
        .collect::<Option<Vec<_>>>()?;
    let rms_px = (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt();
    let spin = part(best.at(0)?, 2).into();
    Some(Fit { frames, noise_px: problem.sigma, rms_px, explained, estimates, spin })
}
