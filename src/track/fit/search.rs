//! The search for the right trajectory: growth from several starts, and the joining of what they found.

use super::chain::{Chain, Contacts, Shift};
use super::labels::residual_noise;
use super::loss::Loss;
use super::problem::{Problem, Slack};
use super::{FitOptions, seed, unexplained};
use crate::error::Result;
use crate::physics::Column;

/// Loss while growing and at the end, in standard deviations.
pub(super) const GROWING: Loss = Loss::Huber(3.0);
pub(super) const FINAL: Loss = Loss::Cauchy(3.0);
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
/// Cost of an interval across which two trajectories are joined that the laws do not join, at most.
const JOIN: f64 = 60.0;
/// Transitions a frame, on average, after which no more starts are grown.
const SEARCH: usize = 6000;
/// Difference of cost below which two trajectories explain the track equally well.
const SAME: f64 = 2.0;
/// How far the best is moved in search of a better one, in standard deviations.
const POLISH: [f64; 4] = [-1.0, 1.0, -2.5, 2.5];
/// Rounds in which the labels' noise is estimated anew.
const NOISE_ROUNDS: usize = 2;
/// Cost, in units of what noise alone costs, at which a trajectory explains its track.
pub(super) const EXPLAINED: f64 = 1.3;

/// Trajectories that explain the track, and pieces of such; finds the labels' noise where it is not given.
pub(super) fn searched<const D: usize>(problem: &mut Problem, options: &FitOptions) -> Result<Vec<Chain<D>>> {
    let mut chains: Vec<Chain<D>> = Vec::new();
    let seeds = seed::seeds(problem, options.starts);
    // laws that are known badly deserve a longer search
    let limit = if problem.slack == Slack::default() { SEARCH } else { 2 * SEARCH };
    'search: for growth in GROWTH {
        for seed in &seeds {
            let chain = Chain { first: seed.first, states: seed.states.clone() };
            chains.extend(grown(problem, chain, growth, LOST_END));
            if settled(problem, &chains) || problem.tired(limit) {
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
        if problem.tired(2 * SEARCH) {
            break;
        }
        for by in POLISH {
            let Some(mut chain) = best.shifted(problem, &Shift { frame, by, contacts: Contacts::Loose }, FINAL) else {
                continue;
            };
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
pub(super) fn best_of<const D: usize>(problem: &Problem, chains: &[Chain<D>]) -> Option<(usize, f64)> {
    let whole = chains.iter().enumerate().filter(|(_, chain)| chain.states.len() == problem.len());
    let costs = whole.map(|(index, chain)| (index, chain.total_cost(problem, FINAL)));
    let (best, cost) = costs.min_by(|(_, a), (_, b)| a.total_cmp(b))?;
    let seen = problem.rays.iter().flatten().count();
    Some((best, cost / (2 * seen) as f64))
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
            let shift = |by: f64| Shift { frame, by, contacts: Contacts::Held };
            let shifted = SHIFTS.iter().filter_map(|&by| chain.shifted(problem, &shift(by), GROWING));
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
