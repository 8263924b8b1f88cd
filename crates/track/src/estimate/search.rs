//! The search for the right structure: trajectories grow from change point to change point with whatever can happen there; the most
//! probable ones are kept, and then tried with one thing changed at a time ([`super::changes`]).

use std::ops::RangeInclusive;
use std::sync::Arc;

use nalgebra::{Point2, Vector3};
use rayon::prelude::*;

use super::change_points::{CLEAR, ChangePoint, FAINT, change_points};
use super::grow::{BEAM, NARROW};
use super::model::{Loss, Model};
use super::rays::{BallisticFlight, BallisticQuery, Plane};
use super::solve::Hypothesis;
use super::trajectory::{Begin, Segment, Span, Trajectory};
use gravisight_physics::{Column, FORCES, Obstacle, column, part};

/// Velocities away from the camera that a first flight is tried with, in standard deviations: they are hardly seen.
pub(super) const DEPARTURES: [f64; 3] = [0.0, 1.0, -1.0];
/// Segments at the growing end that are refined.
const OPEN: usize = 3;
/// Steps of a growing trajectory, of one that is tried, and to the end.
const GROW: usize = 8;
const TRY: usize = 5;
const FINISH: usize = 30;
/// Of the hypotheses tried in a round, those that are refined to the end; rounds, and by how much a change must lower the cost (−2 ln).
const FINISHED: usize = 8;
const ROUNDS: usize = 8;
const LEAST_COST_REDUCTION: f64 = 0.5;
/// Increase of the cost (−2 ln) up to which a change is still refined; segments to either side of a change that are refined with it.
const MOST_COST_INCREASE: f64 = 15.0;
const BESIDE: usize = 1;
/// By how much a ray may miss what the ball met, m: labels are noisy, and edges are edges.
const MISSED: f64 = 0.06;
/// How firmly a ball is where it is seen to touch something, where a contact is known to be, and where a hit is thought to be, m.
const FIRM: f64 = 0.01;
pub(super) const KNOWN: f64 = 0.03;
pub(super) const LOOSE: f64 = 0.5;
/// By how much a bounce's velocity may seem to be off its law where the spin is not known, m/s.
const UNLAWFUL: f64 = 1.0;
/// Least time between two events, and of an event from the first and last frame, s.
pub(super) const APART: f64 = 1e-4;

/// The search's view of a track.
pub struct Search<'a> {
    pub model: &'a Model<'a>,
    pub(super) plane: Plane,
    pub(super) times: Arc<Vec<f64>>,
    /// Times and places in the plane of the labels, s, px.
    pub(super) labels: Vec<(f64, Point2<f64>)>,
    /// Standard deviation of the labels to start with, px.
    pub(super) noise: f64,
    /// Most hits.
    hits: Option<usize>,
    pub(super) change_points: [Vec<ChangePoint>; 2],
}

impl<'a> Search<'a> {
    /// Of the model's track with these `times`, its labels noisy by about `noise` px.
    pub fn new(model: &'a Model<'a>, times: Arc<Vec<f64>>, noise: f64, hits: Option<usize>) -> Option<Self> {
        let plane = Plane::of(model.observations)?;
        let labels: Vec<(f64, Point2<f64>)> =
            plane.labels(model.observations).into_iter().map(|(frame, point)| (times[frame], point)).collect();
        if labels.is_empty() {
            return None;
        }
        let change_points = change_points(&labels, noise, [CLEAR, FAINT]);
        Some(Self { model, plane, times, labels, noise, hits, change_points })
    }

    /// The same with another model of the same track.
    pub(super) fn with_model<'b>(&self, model: &'b Model<'b>) -> Search<'b> {
        let Self { plane, times, labels, noise, hits, change_points, .. } = self;
        let (times, labels) = (times.clone(), labels.clone());
        Search { model, plane: *plane, times, labels, noise: *noise, hits: *hits, change_points: change_points.clone() }
    }

    /// Hypotheses that may explain the track, the most probable first; frames from the first label to the last.
    pub fn found(&self) -> Vec<Hypothesis> {
        if self.model.lasting {
            return self.through_contacts();
        }
        let [clear, all] = &self.change_points;
        let differ = !clear.iter().map(|point| point.time).eq(all.iter().map(|point| point.time));
        let mut point_sets = vec![all];
        point_sets.extend(differ.then_some(clear));
        let unseen = self.with_unseen(all);
        let (mut found, mut chained): (Vec<Hypothesis>, Vec<Hypothesis>) = rayon::join(
            || point_sets.par_iter().flat_map_iter(|points| self.grown(points, BEAM)).collect(),
            || [true, false].par_iter().filter_map(|&tied| self.chained(&unseen, tied)).collect(),
        );
        // If both searches lead to the same hypothesis, one is improved; else each, since neither is always better.
        let leads = [&found, &chained].map(|all| best(all.clone(), 1).pop());
        if let [Some(first), Some(second)] = &leads
            && !first.is_like(second)
        {
            rayon::join(|| self.improve(&mut found), || self.improve(&mut chained));
        } else {
            self.improve(&mut found);
        }
        found.extend(chained);
        best(found, BEAM)
    }

    /// The same in a small part of the time: along the clear change points only.
    pub fn quick(&self) -> Vec<Hypothesis> {
        if self.model.lasting {
            return self.through_contacts();
        }
        best(self.grown(&self.change_points[0], NARROW), BEAM)
    }

    /// When the clear change point of this number is, s, counted from 0.
    pub fn change_point(&self, number: usize) -> Option<f64> {
        self.change_points[0].get(number).map(|point| point.time)
    }

    pub(super) fn is_allowed(&self, trajectory: &Trajectory) -> bool {
        self.hits.is_none_or(|most| trajectory.hits() <= most)
    }

    /// The trajectory, whose parts may be apart where they should meet, refined.
    pub(super) fn joined(&self, trajectory: &Trajectory) -> Option<Hypothesis> {
        let near = self.model.refined(trajectory, &trajectory.all(), Loss::Growing, FINISH)?;
        self.finished(&near.trajectory)
    }

    pub(super) fn finished(&self, trajectory: &Trajectory) -> Option<Hypothesis> {
        self.model.refined(trajectory, &trajectory.all(), Loss::Mixture, FINISH)
    }

    /// The trajectory that goes on from `parent`, its last segments refined, if they can be. What is before those costs what it cost the
    /// parent.
    pub(super) fn kept(&self, trajectory: &Trajectory, parent: Option<&Hypothesis>) -> Option<Hypothesis> {
        let count = trajectory.segments.len();
        let span = count.saturating_sub(OPEN)..count;
        let settled = match parent.filter(|_| span.start > 0) {
            Some(parent) => {
                let open = span.start..parent.trajectory.segments.len();
                parent.cost - self.model.judged(parent.trajectory.clone(), &open)?.cost
            }
            None => 0.0,
        };
        let found = self.model.refined(trajectory, &span, Loss::Growing, GROW)?;
        Some(Hypothesis { cost: settled + found.cost, ..found })
    }

    /// The state of a flight, its spin what the acceleration asks for beside gravity and drag.
    pub(super) fn state(&self, flight: &BallisticFlight) -> Column {
        let mean = self.model.spin.0;
        let still = column(flight.position, flight.velocity, mean);
        let forced = self.model.forecaster.flight(&still, &[0.0; FORCES], false);
        let spin = forced.spin_for(&(flight.acceleration - forced.slope().1));
        let longest = 2.0 * self.model.spin_sigma();
        column(flight.position, flight.velocity, mean + spin * (longest / spin.norm().max(longest)))
    }

    pub(super) fn ballistic(
        &self,
        frames: RangeInclusive<usize>,
        time: f64,
        places: &[(f64, Vector3<f64>, f64)],
        drift: f64,
    ) -> Option<BallisticFlight> {
        let velocity = self.plane.axis() * (drift * self.model.config.speed);
        self.model.ballistic(&self.times, &BallisticQuery { frames, time, places, velocity }, self.noise)
    }

    pub(super) fn flown(&self, state: &Column, dt: f64) -> Column {
        let mut flight = self.model.forecaster.flight(state, &[0.0; FORCES], false);
        flight.advance(dt);
        flight.state
    }

    /// Where a ball that is seen at a point of the plane touches each obstacle.
    pub(super) fn contacts(&self, image: &Point2<f64>, time: f64) -> Vec<(Begin, Vector3<f64>)> {
        let near = self.times.partition_point(|&other| other < time);
        let seen = self.model.observations.iter().enumerate().filter_map(|(frame, it)| Some((frame, it.ray.as_ref()?)));
        let Some((_, ray)) = seen.min_by_key(|(frame, _)| frame.abs_diff(near)) else { return vec![] };
        let direction = self.plane.direction(image);
        let radius = self.model.rigid.radius;
        let of = |(index, obstacle): (usize, &Obstacle)| {
            let points = obstacle.touching(&ray.origin, &direction, radius, MISSED);
            let seen = points
                .into_iter()
                .filter(|point| self.model.obstacles.iter().all(|other| other.between(&ray.origin, point) < MISSED));
            seen.map(|point| (Begin::Bounce(index), point)).collect::<Vec<_>>()
        };
        self.model.obstacles.iter().enumerate().flat_map(of).collect()
    }

    /// The trajectory with its event of `index` as a contact at a place, the flights before (unless `kept`) and after it found anew: as the
    /// law has it, and as the labels after it have it. And how far the flights are from their labels and the law, in squared standard
    /// deviations.
    pub(super) fn with_contact(
        &self,
        trajectory: &Trajectory,
        (index, kept): (usize, bool),
        (kind, at): (Begin, Vector3<f64>),
        drift: f64,
    ) -> Option<(f64, Vec<Trajectory>)> {
        let Begin::Bounce(obstacle) = kind else { return None };
        let segments = &trajectory.segments;
        let (time, before) = (segments[index].time, &segments[index - 1]);
        let known = |it: &Segment| (it.time, it.position(), if it.begin == Begin::Hit { LOOSE } else { KNOWN });
        let mut places = vec![(time, at, FIRM)];
        let (mut cost, mut state) = (0.0, before.state);
        if !kept {
            places.extend((index > 1).then(|| known(before)));
            let frames = trajectory.frames(index - 1);
            let flight = self.ballistic(frames.start..=frames.end.checked_sub(1)?, before.time, &places, drift)?;
            (cost, state) = (flight.cost, self.state(&flight));
        }
        let obstacle = &self.model.obstacles[obstacle];
        let arrived = self.flown(&state, time - before.time);
        let normal = obstacle.nearest(&at).normal;
        if normal.dot(&part(&arrived, 1)) >= 0.0 {
            return None;
        }
        let (v, w) = self.model.rigid.rebound(&normal, &part(&arrived, 1), &part(&arrived, 2));
        places.truncate(1);
        places.extend(segments.get(index + 1).map(known));
        let frames = trajectory.frames(index);
        let after = frames.end.checked_sub(1).and_then(|end| self.ballistic(frames.start..=end, time, &places, 0.0));
        let with = |state_after: Column| {
            let mut next = trajectory.clone();
            next.segments[index - 1].state = state;
            next.segments[index] = Segment { begin: kind, time, state: state_after };
            next
        };
        let mut found = vec![with(column(at, v, w))];
        if let Some(after) = after {
            let noise = self.model.contact_noise(obstacle, &at, &arrived);
            let off = after.velocity - v;
            let along = normal.dot(&off);
            let across = (off - normal * along).norm_squared() / (noise.across.powi(2) + UNLAWFUL.powi(2));
            cost += after.cost + along * along / (noise.along.powi(2) + UNLAWFUL.powi(2)) + across;
            found.push(with(column(at, after.velocity, w)));
        }
        Some((cost, found))
    }

    /// The state of a trajectory at a time.
    pub(super) fn at(&self, trajectory: &Trajectory, time: f64) -> Column {
        let index = trajectory.segments.partition_point(|segment| segment.time <= time).saturating_sub(1);
        let segment = &trajectory.segments[index];
        let mut flight = self.model.forecaster.flight(&segment.state, &trajectory.log_scales, false);
        flight.advance(time - segment.time);
        flight.state
    }

    /// Looks for more probable trajectories beside the best one, as long as there are any. What differs in one place is judged by what is
    /// near that place.
    fn improve(&self, all: &mut Vec<Hypothesis>) {
        // What was tried already: where the trajectory has not changed since, it is not again.
        let mut before: Option<Trajectory> = None;
        for _ in 0..ROUNDS {
            let Some(best) = best(all.clone(), 1).pop() else { return };
            let tried = self.beside(&best.trajectory);
            let changes = tried.into_iter().filter(|(it, _)| self.is_allowed(it));
            let changes = changes.map(|(it, place)| Change::between(&best.trajectory, it, place));
            let is_new = |change: &Change| !before.as_ref().is_some_and(|it| change.is_in(it, &best.trajectory));
            let changes: Vec<Change> = changes.filter(is_new).collect();
            let mut spans: Vec<Span> = vec![];
            for Change { old, .. } in &changes {
                if !spans.contains(old) {
                    spans.push(old.clone());
                }
            }
            let refined = |it: &Trajectory, span: &Span| self.model.refined(it, span, Loss::Growing, TRY);
            let as_it_is = |span: &Span| refined(&best.trajectory, span).map(|found| found.cost);
            let as_it_is: Vec<Option<f64>> = spans.par_iter().map(as_it_is).collect();
            let refine = |change: Change| {
                let before = spans.iter().zip(&as_it_is).find(|(span, _)| **span == change.old)?.1.as_ref()?;
                let refined = refined(&change.trajectory, &change.new)?;
                let cost_reduction = before - refined.cost;
                (cost_reduction > -MOST_COST_INCREASE).then_some(Change {
                    cost_reduction,
                    trajectory: refined.trajectory,
                    ..change
                })
            };
            let mut found: Vec<Change> = changes.into_par_iter().filter_map(refine).collect();
            found.sort_by(|a, b| b.cost_reduction.total_cmp(&a.cost_reduction));
            let mut better: Vec<Hypothesis> = vec![];
            if let Some(together) = together(&best.trajectory, &found) {
                better.extend(self.finished(&together));
            }
            better.par_extend(found.par_iter().take(FINISHED).filter_map(|change| self.finished(&change.trajectory)));
            if before.is_none() {
                better.par_extend(self.scanned(&best.trajectory).par_iter().filter_map(|it| {
                    let grown = self.model.refined(it, &it.all(), Loss::Growing, GROW)?;
                    self.finished(&grown.trajectory)
                }));
            }
            better.retain(|it| self.is_allowed(&it.trajectory));
            let improved = better.iter().any(|found| found.cost < best.cost - LEAST_COST_REDUCTION);
            all.extend(better);
            if !improved {
                return;
            }
            before = Some(best.trajectory);
        }
    }
}

/// A trajectory that differs from another in one place.
struct Change {
    trajectory: Trajectory,
    /// Segments about that place, of the other and of this one.
    old: Span,
    new: Span,
    /// By how much it lowers the cost, −2 ln.
    cost_reduction: f64,
}

impl Change {
    /// `place`: the segments of `trajectory` that are not the other's.
    fn between(other: &Trajectory, trajectory: Trajectory, place: Span) -> Self {
        let count = trajectory.segments.len();
        let new = place.start.saturating_sub(BESIDE)..(place.end + BESIDE).min(count);
        let old = new.start..new.end + other.segments.len() - count;
        Self { trajectory, old, new, cost_reduction: 0.0 }
    }

    /// Whether `before` was as `now` is, where this change is.
    fn is_in(&self, before: &Trajectory, now: &Trajectory) -> bool {
        let own = &now.segments[self.old.clone()];
        let (from, to) =
            (own[0].time - APART, now.segments.get(self.old.end).map_or(f64::INFINITY, |it| it.time + APART));
        let of = |it: &Segment| (from - 0.01..to + 0.01).contains(&it.time);
        let [a, b] = [before, now].map(|it| it.segments.iter().filter(|it| of(it)).copied().collect::<Vec<_>>());
        let same = |(a, b): (&Segment, &Segment)| {
            a.begin == b.begin && (a.time - b.time).abs() < 0.01 && (a.position() - b.position()).norm() < 0.05
        };
        a.len() == b.len() && a.iter().zip(&b).all(same)
    }
}

/// The trajectory with all changes that lower the cost and concern different segments, the best ones first; none if there is at most one
/// such change.
fn together(trajectory: &Trajectory, changes: &[Change]) -> Option<Trajectory> {
    let mut chosen: Vec<&Change> = vec![];
    for change in changes.iter().filter(|change| change.cost_reduction > LEAST_COST_REDUCTION) {
        if chosen.iter().all(|it| it.old.end <= change.old.start || change.old.end <= it.old.start) {
            chosen.push(change);
        }
    }
    chosen.sort_by_key(|change| change.old.start);
    let mut out = trajectory.clone();
    for change in chosen.iter().rev() {
        out.segments.splice(change.old.clone(), change.trajectory.segments[change.new.clone()].iter().copied());
    }
    (chosen.len() > 1 && out.is_in_order()).then_some(out)
}

/// The most probable `count` that differ.
pub fn best(mut all: Vec<Hypothesis>, count: usize) -> Vec<Hypothesis> {
    all.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let mut chosen: Vec<Hypothesis> = vec![];
    for found in all {
        let same = |other: &Hypothesis| other.is_like(&found);
        if chosen.len() < count && !chosen.iter().any(same) {
            chosen.push(found);
        }
    }
    chosen
}

impl Hypothesis {
    /// Whether it is another's: the same contacts and hits from the same start.
    fn is_like(&self, other: &Hypothesis) -> bool {
        let kinds = |it: &Hypothesis| it.trajectory.segments.iter().map(|segment| segment.begin).collect::<Vec<_>>();
        let apart = other.trajectory.segments[0].position() - self.trajectory.segments[0].position();
        kinds(other) == kinds(self) && apart.norm() < 0.02
    }
}
