//! The search where contacts last and the forecaster leads through them: nothing is to be guessed but where the ball is. Flights through
//! short windows of labels grow to either side through whatever they touch; where one misses its next labels, it is tried nearer and
//! farther.

use rayon::prelude::*;

use super::model::{Loss, Model};
use super::search::{Search, best};
use super::solve::Hypothesis;
use super::trajectory::{Begin, Segment, Trajectory};
use crate::observation::{Observation as Label, trusted};
use gravisight_physics::{Column, FORCES, part};

/// Lengths of the windows, in labels.
const LENGTHS: [usize; 5] = [8, 12, 18, 26, 36];
/// Windows from which trajectories are grown, at most.
const STARTS: usize = 24;
/// Frames that a trajectory grows by between two refinements; where one choice fails, the next may not.
const GROWTH: [usize; 3] = [4, 7, 2];
/// Frames near an end that tell whether it is right; their mean cost (2 is to be expected) above which it is tried nearer and farther, and
/// at which it grows no further.
const END: usize = 8;
const BAD_END: f64 = 3.5;
const LOST_END: f64 = 25.0;
/// By how many standard deviations of its position.
const SHIFTS: [f64; 10] = [-0.3, 0.3, -0.7, 0.7, -1.2, 1.2, -2.0, 2.0, -3.2, 3.2];
/// The same for the flights of the best, in search of a better one, and how much less contacts hold then.
const POLISH: [f64; 4] = [-1.0, 1.0, -2.5, 2.5];
const LOOSE: f64 = 1e-3;
/// Frames of a flight that is worth moving.
const SHORTEST_FLIGHT: usize = 4;
/// Segments at a growing end that are refined.
const OPEN: usize = 4;
/// Rounds in which contacts may move to other frames, and steps of a refinement: growing, and of whole trajectories.
const ROUNDS: usize = 3;
const STEPS: usize = 8;
const WHOLE: usize = 20;
/// Mean cost of a label at which a trajectory explains its track (2 is to be expected), and −2 ln by which two are equally probable.
const EXPLAINED: f64 = 2.0 * 1.3 * 1.3;
const SAME: f64 = 2.0;
/// Misfit of a window (2 is to be expected) above which something else happens in it.
const STRAIGHT: f64 = 4.0;

impl Search<'_> {
    /// The most probable trajectories.
    pub(super) fn through_contacts(&self) -> Vec<Hypothesis> {
        // To start with: labels on their neighbours' line, as noisy as they seem to be.
        let mut observations = self.model.observations.to_vec();
        for frame in self.strays() {
            observations[frame].ray = None;
        }
        let model = Model { noise: Some(self.noise), ..self.model.with_observations(&observations) };
        let search = self.with_model(&model);
        let starts = search.windows();
        let mut found: Vec<Hypothesis> = vec![];
        'search: for growth in GROWTH {
            for start in &starts {
                found.extend(search.grown_to_ends(start.clone(), growth));
                if search.is_settled(&found) {
                    break 'search;
                }
            }
        }
        let polished = best(found.clone(), 1).pop().and_then(|best| search.polished(best));
        found.extend(polished);
        let whole = best(found, STARTS);
        best(whole.par_iter().filter_map(|it| self.resettled(&it.trajectory, Loss::Mixture, WHOLE)).collect(), STARTS)
    }

    /// Frames whose labels are far off their neighbours' line.
    fn strays(&self) -> Vec<usize> {
        let labels = self.plane.labels(self.model.observations);
        let label = |&(frame, image): &(usize, _)| Label { time: self.times[frame], image: Some(image), radius: None };
        let trusted = trusted(&labels.iter().map(label).collect::<Vec<_>>());
        labels.iter().zip(trusted).filter(|(_, kept)| kept.image.is_none()).map(|(&(frame, _), _)| frame).collect()
    }

    /// Free flights through windows of labels, those whose distance is known best first, those beside a better one last.
    fn windows(&self) -> Vec<Trajectory> {
        let seen: Vec<usize> =
            (0..self.times.len()).filter(|&frame| self.model.observations[frame].ray.is_some()).collect();
        let mut all: Vec<(f64, Trajectory)> = vec![];
        for length in LENGTHS.into_iter().filter(|&length| length <= seen.len()) {
            let stride = (length / 4).max(1);
            let starts: Vec<usize> = (0..=seen.len() - length).step_by(stride).chain([seen.len() - length]).collect();
            all.par_extend(starts.par_iter().filter_map(|&start| self.window(&seen[start..start + length])));
        }
        if all.is_empty() {
            all.extend(self.window(&seen));
        }
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (mut chosen, mut beside): (Vec<Trajectory>, Vec<Trajectory>) = (vec![], vec![]);
        for (_, window) in all {
            let overlaps = |other: &Trajectory| {
                let shared = (window.last.min(other.last) + 1).saturating_sub(window.first.max(other.first));
                2 * shared > window.last + 1 - window.first
            };
            if chosen.iter().any(overlaps) { beside.push(window) } else { chosen.push(window) }
        }
        chosen.extend(beside);
        chosen.truncate(STARTS);
        chosen
    }

    /// The free flight through a window of labels, and how little it is to be relied on: σ of its inverse distance, more where it misses
    /// its labels.
    fn window(&self, seen: &[usize]) -> Option<(f64, Trajectory)> {
        let (first, last) = (*seen.first()?, *seen.last()?);
        let flight = self.ballistic(first..=last, self.times[first], &[], 0.0)?;
        let segments = vec![Segment { begin: Begin::Start, time: self.times[first], state: self.state(&flight) }];
        let (log_scales, times) = ([0.0; FORCES], self.times.clone());
        let start = Trajectory { segments, log_scales, log_size: 0.0, noise: self.noise, first, last, times };
        let found = self.model.refined(&start, &start.all(), Loss::Growing, STEPS)?.trajectory;
        let covariance = self.model.marginals(&found)?.segments[0].fixed_view::<3, 3>(1, 1).into_owned();
        let off = found.segments[0].position() - self.model.observations[first].ray.as_ref()?.origin;
        let sigma = (off.transpose() * covariance * off)[(0, 0)].max(0.0).sqrt() / off.norm();
        let misfit = self.misfit(&found, (first + last) / 2, last - first);
        let unreliable = sigma / off.norm_squared() * (misfit / STRAIGHT).max(1.0).powi(2);
        Some((unreliable, found))
    }

    /// A trajectory grown over the whole track; none where it misses the labels beyond hope on the way.
    fn grown_to_ends(&self, start: Trajectory, growth: usize) -> Option<Hypothesis> {
        let end = self.times.len() - 1;
        let mut at = start;
        while at.first > 0 || at.last < end {
            let mut next = self.extended(&at, growth)?;
            let misfits = |it: &Trajectory| [it.last, it.first].map(|frame| self.misfit(it, frame, END));
            let worst = misfits(&next);
            if worst[0].max(worst[1]) > BAD_END {
                let frame = if worst[0] > worst[1] { at.last } else { at.first };
                let shifted = SHIFTS.iter().filter_map(|&by| self.model.displaced(&at, frame, by, 1.0));
                let shifted: Vec<Trajectory> = shifted.collect();
                let others: Vec<Trajectory> = shifted.par_iter().filter_map(|it| self.extended(it, growth)).collect();
                let cost = |it: &Trajectory| self.total_cost(it, Loss::Growing);
                if let Some(better) = others.into_iter().min_by(|a, b| cost(a).total_cmp(&cost(b)))
                    && cost(&better) < cost(&next)
                {
                    next = self.resettled(&better, Loss::Growing, STEPS)?.trajectory;
                }
            }
            let [last, first] = misfits(&next);
            if last.max(first) > LOST_END {
                return None;
            }
            at = next;
        }
        let near = self.resettled(&at, Loss::Growing, WHOLE)?.trajectory;
        self.resettled(&near, Loss::Mixture, WHOLE)
    }

    /// A trajectory some frames longer at both ends, as the forecaster leads it there, its ends refined.
    fn extended(&self, trajectory: &Trajectory, by: usize) -> Option<Trajectory> {
        let (mut out, end) = (trajectory.clone(), self.times.len() - 1);
        for _ in 0..by {
            if out.last < end {
                let state = self.at(&out, self.times[out.last]);
                let time = self.times[out.last + 1];
                let next = self.model.forecaster.transition::<6>(&state, time - self.times[out.last])?;
                if next.contact {
                    out.segments.push(Segment { begin: Begin::LastingContact, time, state: next.end });
                }
                out.last += 1;
            }
            if out.first > 0 {
                let (time, first) = (self.times[out.first - 1], &mut out.segments[0]);
                let before = self.model.forecaster.transition::<6>(&first.state, time - first.time)?;
                let start = Segment { begin: Begin::Start, time, state: before.end };
                if before.contact {
                    first.begin = Begin::LastingContact;
                    out.segments.insert(0, start);
                } else {
                    *first = start;
                }
                out.first -= 1;
            }
        }
        for is_late in [true, false] {
            let count = out.segments.len();
            let span = if is_late { count.saturating_sub(OPEN)..count } else { 0..count.min(OPEN) };
            out = self.model.refined(&out, &span, Loss::Growing, STEPS)?.trajectory;
            out = self.resegmented(&out)?;
            if count <= OPEN {
                break;
            }
        }
        Some(out)
    }

    /// A trajectory refined, its contacts between the frames where it has them then.
    fn resettled(&self, trajectory: &Trajectory, loss: Loss, steps: usize) -> Option<Hypothesis> {
        let mut found = self.model.refined(trajectory, &trajectory.all(), loss, steps)?;
        for _ in 0..ROUNDS {
            let next = self.resegmented(&found.trajectory)?;
            if next.segments.len() == found.trajectory.segments.len()
                && next.segments.iter().zip(&found.trajectory.segments).all(|(a, b)| a.time == b.time)
            {
                break;
            }
            found = self.model.refined(&next, &next.all(), loss, steps)?;
        }
        Some(found)
    }

    /// A trajectory whose contacts are between the frames where the forecaster has them.
    fn resegmented(&self, trajectory: &Trajectory) -> Option<Trajectory> {
        let states = self.model.states(trajectory);
        let mut out = Trajectory { segments: vec![trajectory.segments[0]], ..trajectory.clone() };
        for frame in trajectory.first..trajectory.last {
            let (state, time) = (&states[frame - trajectory.first], self.times[frame + 1]);
            let next = self.model.forecaster.transition::<6>(state, time - self.times[frame])?;
            if next.contact {
                let known = trajectory.segments.iter().find(|segment| segment.time == time);
                let state = known.map_or(next.end, |known| known.state);
                out.segments.push(Segment { begin: Begin::LastingContact, time, state });
            }
        }
        Some(out)
    }

    /// Mean cost of the labels within so many frames of one.
    fn misfit(&self, trajectory: &Trajectory, frame: usize, reach: usize) -> f64 {
        let costs = self.costs(trajectory, Loss::Growing);
        let near = |(at, cost): &(usize, f64)| (at.abs_diff(frame) <= reach).then_some(*cost);
        let near: Vec<f64> = costs.iter().filter_map(near).collect();
        near.iter().sum::<f64>() / near.len().max(1) as f64
    }

    /// Cost of each label.
    fn costs(&self, trajectory: &Trajectory, loss: Loss) -> Vec<(usize, f64)> {
        let states = self.model.states(trajectory);
        let of = |(index, state): (usize, &Column)| {
            let (frame, noise) = (trajectory.first + index, trajectory.noise);
            let ray = self.model.observations[frame].ray.as_ref()?;
            let square = ray.residual(&part(state, 0)).map_or(f64::MAX, |(off, _)| off.norm_squared());
            Some((frame, self.model.label_cost(square / (noise * noise), noise, loss).0))
        };
        states.iter().enumerate().filter_map(of).collect()
    }

    fn total_cost(&self, trajectory: &Trajectory, loss: Loss) -> f64 {
        let law: f64 = self.model.prior_chi2(trajectory).iter().map(|(chi2, _)| chi2).sum();
        law + self.costs(trajectory, loss).iter().map(|(_, cost)| cost).sum::<f64>()
    }

    /// Whether a trajectory that explains the labels was found from two starts.
    fn is_settled(&self, found: &[Hypothesis]) -> bool {
        let Some(best) = found.iter().min_by(|a, b| a.cost.total_cmp(&b.cost)) else { return false };
        let costs = self.costs(&best.trajectory, Loss::Mixture);
        let mean = costs.iter().map(|(_, cost)| cost).sum::<f64>() / costs.len().max(1) as f64;
        mean < EXPLAINED && found.iter().filter(|it| it.cost < best.cost + SAME).count() >= 2
    }

    /// A more probable trajectory beside one, found by moving its flights along what they know least.
    fn polished(&self, mut best: Hypothesis) -> Option<Hypothesis> {
        for segment in best.trajectory.all() {
            let Some(frames) = best.trajectory.segments.get(segment).map(|_| best.trajectory.frames(segment)) else {
                break;
            };
            if frames.len() < SHORTEST_FLIGHT {
                continue;
            }
            for by in POLISH {
                let middle = (frames.start + frames.end) / 2;
                let moved = self.model.displaced(&best.trajectory, middle, by, LOOSE);
                let near = moved.and_then(|moved| self.resettled(&moved, Loss::Growing, STEPS));
                let found = near.and_then(|near| self.resettled(&near.trajectory, Loss::Mixture, STEPS));
                if let Some(found) = found.filter(|found| found.cost < best.cost - SAME) {
                    best = found;
                }
            }
        }
        Some(best)
    }
}
