//! The search for the right structure: trajectories grow from change point to change point with whatever can happen there; the most
//! probable ones are kept, and then tried with one thing changed at a time.

use std::ops::RangeInclusive;
use std::sync::Arc;

use nalgebra::{Point2, Vector3};

use super::change_points::{CLEAR, ChangePoint, FAINT, change_points};
use super::model::{Loss, Model};
use super::rays::Plane;
use super::solve::Hypothesis;
use super::trajectory::{Begin, Segment, Trajectory};
use crate::physics::{Column, FORCES, Obstacle, column, part};

/// What is tried for a flight of which little is known: its acceleration in units of gravity's, for its spin is not known, and its
/// velocity away from the camera in standard deviations, which is hardly seen.
const STARTS: [(f64, f64); 5] = [(1.0, 0.0), (1.0, 1.0), (1.0, -1.0), (0.6, 0.0), (1.4, 0.0)];
/// Accelerations alone.
const PULLS: [f64; 3] = [0.6, 1.0, 1.4];
/// Hypotheses that are followed from change point to change point, and how many are kept in the end.
const BEAM: usize = 8;
/// Segments at the growing end that are refined.
const OPEN: usize = 3;
/// Steps of a growing trajectory, of one that is tried, and to the end.
const GROW: usize = 8;
const TRY: usize = 5;
const FINISH: usize = 30;
/// Of the hypotheses tried in a round, those that are refined to the end; rounds, and by how much one must better the best.
const FINISHED: usize = 8;
const ROUNDS: usize = 5;
const GAIN: f64 = 0.5;
/// Where a hit that is not seen is tried, as fractions of the way to the next event.
const SPLITS: [f64; 2] = [0.35, 0.7];
/// Labels at either end between which a contact is tried that no change point shows.
const ENDS: usize = 4;
/// By how much a ray may miss what the ball met, m: labels are noisy, and edges are edges.
const MISSED: f64 = 0.06;
/// Times of contacts that are tried are at least so far apart, s.
const TOGETHER: f64 = 0.015;
/// Least time between two events, and of an event from the first and last frame, s.
const APART: f64 = 1e-4;
/// Distances that are scanned, from the middle of where the ball can be, in standard deviations of that.
const SCAN: [f64; 7] = [-1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5];

/// The search's view of a track.
pub struct Search<'a> {
    pub model: &'a Model<'a>,
    plane: Plane,
    times: Arc<Vec<f64>>,
    /// Standard deviation of the labels to start with, px.
    noise: f64,
    /// Most hits.
    hits: Option<usize>,
    change_points: [Vec<ChangePoint>; 2],
}

impl<'a> Search<'a> {
    /// Of the model's track with these `times`, its labels noisy by about `noise` px.
    pub fn new(model: &'a Model<'a>, times: Arc<Vec<f64>>, noise: f64, hits: Option<usize>) -> Option<Self> {
        let plane = Plane::of(model.observations)?;
        let labels: Vec<(f64, Point2<f64>)> =
            plane.labels(model.observations).into_iter().map(|(frame, point)| (times[frame], point)).collect();
        let change_points = [CLEAR, FAINT].map(|price| change_points(&labels, noise, price));
        Some(Self { model, plane, times, noise, hits, change_points })
    }

    /// Hypotheses that may explain the track, the most probable first; frames from the first label to the last.
    pub fn found(&self) -> Vec<Hypothesis> {
        let [clear, all] = &self.change_points;
        let mut found = self.grown(all);
        if !clear.iter().map(|point| point.time).eq(all.iter().map(|point| point.time)) {
            found.extend(self.grown(clear));
        }
        self.improve(&mut found);
        best(found, BEAM)
    }

    /// The same in a small part of the time: along the clear change points only.
    pub fn quick(&self) -> Vec<Hypothesis> {
        best(self.grown(&self.change_points[0]), BEAM)
    }

    fn is_allowed(&self, trajectory: &Trajectory) -> bool {
        self.hits.is_none_or(|most| trajectory.hits() <= most)
    }

    pub fn finished(&self, hypothesis: &Hypothesis) -> Option<Hypothesis> {
        self.model.refined(&hypothesis.trajectory, 0, Loss::Mixture, FINISH)
    }

    /// The trajectory, its last segments refined, if they can be.
    fn kept(&self, trajectory: &Trajectory) -> Option<Hypothesis> {
        self.model.refined(trajectory, trajectory.segments.len().saturating_sub(OPEN), Loss::Growing, GROW)
    }

    /// A state of this position and velocity whose spin makes up for a pull that is not gravity's.
    fn state(&self, (position, velocity): (Vector3<f64>, Vector3<f64>), pull: f64) -> Column {
        let still = column(position, velocity, Vector3::zeros());
        let more = self.model.gravity() * (pull - 1.0);
        let spin = self.model.forecaster.flight(&still, &[0.0; FORCES], false).spin_for(&more);
        let longest = 2.0 * self.model.spin_sigma();
        column(position, velocity, spin * (longest / spin.norm().max(longest)))
    }

    fn ballistic(
        &self,
        frames: RangeInclusive<usize>,
        at: (f64, Option<Vector3<f64>>),
        (pull, drift): (f64, f64),
    ) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let forces = (self.model.gravity() * pull, self.plane.axis() * (drift * self.model.config.speed));
        self.model.ballistic(&self.times, frames, at, forces, self.noise)
    }

    fn flown(&self, state: &Column, dt: f64) -> Column {
        let mut flight = self.model.forecaster.flight(state, &[0.0; FORCES], false);
        flight.advance(dt);
        flight.state
    }

    /// Where a ball that is seen at a point of the plane touches each obstacle.
    fn contacts(&self, image: &Point2<f64>, time: f64) -> Vec<(Begin, Vector3<f64>)> {
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

    /// The most probable trajectories along these change points.
    fn grown(&self, points: &[ChangePoint]) -> Vec<Hypothesis> {
        let times = &self.times;
        let seen: Vec<usize> = (0..times.len()).filter(|&frame| self.model.observations[frame].ray.is_some()).collect();
        let (Some(&first), Some(&last)) = (seen.first(), seen.last()) else { return vec![] };
        if last < first + 2 {
            return vec![];
        }
        let end_before = |point: Option<&ChangePoint>| match point {
            Some(point) => times.partition_point(|&time| time < point.time).max(first + 2).min(last),
            None => last,
        };
        let fresh = |state: Column, last: usize| Trajectory {
            segments: vec![Segment { begin: Begin::Start, time: times[first], state }],
            log_scales: [0.0; FORCES],
            log_size: 0.0,
            noise: self.noise,
            first,
            last,
            times: times.clone(),
        };
        let mut beam: Vec<Hypothesis> = vec![];
        let end = end_before(points.first());
        for start in STARTS {
            let found = self.ballistic(first..=end - 1, (times[first], None), start);
            beam.extend(found.and_then(|found| self.kept(&fresh(self.state(found, start.0), end))));
        }
        for (index, point) in points.iter().enumerate() {
            let (begin, end) = (end_before(Some(point)), end_before(points.get(index + 1)));
            let mut next: Vec<Hypothesis> = vec![];
            let options = self.contacts(&point.image, point.time);
            // A flight from the very start is found anew from each contact.
            for &(kind, at) in &options {
                if beam.iter().all(|found| found.trajectory.segments.len() > 1) && index > 0 {
                    continue;
                }
                for start in STARTS {
                    let before = self.ballistic(first..=begin - 1, (point.time, Some(at)), start);
                    let Some(before) = before else { continue };
                    let start = self.flown(&self.state(before, start.0), times[first] - point.time);
                    next.extend(self.after(&fresh(start, begin), kind, at, point.time, begin..=end));
                }
            }
            for Hypothesis { trajectory, .. } in &beam {
                let mut longer = trajectory.clone();
                longer.last = end;
                next.extend(self.kept(&longer));
                next.extend(self.model.followed(&longer).and_then(|followed| self.kept(&followed)));
                let there = self.at(trajectory, point.time);
                next.extend(self.after(trajectory, Begin::Hit, part(&there, 0), point.time, begin..=end));
                for &(kind, at) in &options {
                    for aimed in self.aimed(trajectory, at, point.time) {
                        next.extend(self.after(&aimed, kind, at, point.time, begin..=end));
                    }
                }
            }
            next.retain(|found| self.is_allowed(&found.trajectory));
            beam = best(next, BEAM);
        }
        beam.iter().filter_map(|found| self.finished(found)).collect()
    }

    /// The state of a trajectory at a time.
    fn at(&self, trajectory: &Trajectory, time: f64) -> Column {
        let index = trajectory.segments.partition_point(|segment| segment.time <= time).saturating_sub(1);
        let segment = &trajectory.segments[index];
        let mut flight = self.model.forecaster.flight(&segment.state, &trajectory.log_scales, false);
        flight.advance(time - segment.time);
        flight.state
    }

    /// Looks for more probable trajectories beside the best one, as long as there are any.
    fn improve(&self, all: &mut Vec<Hypothesis>) {
        for _ in 0..ROUNDS {
            let Some(best) = best(all.clone(), 1).pop() else { return };
            let tried = self.beside(&best.trajectory);
            let tried = tried.iter().filter(|it| self.is_allowed(it));
            let found: Vec<Hypothesis> = tried.filter_map(|it| self.model.refined(it, 0, Loss::Growing, TRY)).collect();
            let mut better: Vec<Hypothesis> =
                self::best(found, FINISHED).iter().filter_map(|found| self.finished(found)).collect();
            let scanned = self.scanned(&best.trajectory);
            better.extend(scanned.iter().filter_map(|it| {
                let grown = self.model.refined(it, 0, Loss::Growing, GROW)?;
                self.finished(&grown)
            }));
            let improved = better.iter().any(|found| found.cost < best.cost - GAIN);
            all.extend(better);
            if !improved {
                return;
            }
        }
    }

    /// The same structure with the ball nearer or farther at the first label: what is seen of a flight along the line of sight may be
    /// explained by one that goes the other way.
    fn scanned(&self, trajectory: &Trajectory) -> Vec<Trajectory> {
        let (place, sigma) = &self.model.place;
        let (Some(ray), Some(next)) = (&self.model.observations[trajectory.first].ray, trajectory.segments.get(1))
        else {
            return vec![];
        };
        let (middle, reach) = (ray.direction.dot(&(place - ray.origin)), self.plane.axis().abs().dot(sigma));
        let lasting = next.time - self.times[trajectory.first];
        let at = |step: f64| {
            let distance = middle + step * reach;
            if distance <= 0.0 || lasting <= 0.0 {
                return None;
            }
            let from = ray.at(distance);
            let velocity = (next.position() - from) / lasting - self.model.gravity() * (lasting / 2.0);
            let mut scanned = trajectory.clone();
            scanned.segments[0].state = self.state((from, velocity), 1.0);
            if let Begin::Bounce(obstacle) = next.begin {
                let arrived = self.flown(&scanned.segments[0].state, lasting);
                let normal = self.model.obstacles[obstacle].nearest(&next.position()).normal;
                let (v, w) = self.model.rigid.rebound(&normal, &part(&arrived, 1), &part(&arrived, 2));
                scanned.segments[1].state = column(next.position(), v, w);
            }
            Some(scanned)
        };
        SCAN.into_iter().filter_map(at).collect()
    }

    /// Trajectories that differ in one event: left out, of another kind, added at a change point, at an end, or where the
    /// trajectory leads into something.
    fn beside(&self, trajectory: &Trajectory) -> Vec<Trajectory> {
        let mut tried = vec![];
        for index in 1..trajectory.segments.len() {
            let mut fewer = trajectory.clone();
            fewer.segments.remove(index);
            tried.push(fewer);
            if trajectory.segments[index].begin == Begin::Hit {
                tried.extend(self.anchored(trajectory, index));
                tried.extend(self.split(trajectory, index));
            } else {
                let mut hit = trajectory.clone();
                hit.segments[index].begin = Begin::Hit;
                tried.push(hit);
            }
        }
        let interval = self.interval();
        let is_near = |time: f64| trajectory.segments[1..].iter().any(|it| (it.time - time).abs() < interval);
        let seen: Vec<f64> = (trajectory.first..=trajectory.last)
            .filter(|&frame| self.model.observations[frame].ray.is_some())
            .map(|frame| self.times[frame])
            .collect();
        let gaps: Vec<f64> = seen.windows(2).map(|pair| (pair[0] + pair[1]) / 2.0).collect();
        let ends = gaps.iter().take(ENDS).chain(gaps.iter().rev().take(ENDS)).copied();
        let points = self.change_points[1].iter().map(|point| point.time);
        let mut times: Vec<f64> = vec![];
        for time in points.chain(ends).filter(|&time| !is_near(time)) {
            if times.iter().all(|other| (other - time).abs() > TOGETHER) {
                times.push(time);
            }
        }
        for time in times {
            if let Some((more, index)) = self.with_hit(trajectory, time) {
                tried.extend(self.anchored(&more, index));
                tried.push(more);
            }
        }
        tried.extend(self.model.followed(trajectory));
        tried
    }

    /// Median time from frame to frame, s.
    fn interval(&self) -> f64 {
        let mut gaps: Vec<f64> = self.times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        gaps.sort_by(f64::total_cmp);
        gaps[gaps.len() / 2]
    }

    /// The trajectory with the hit of `index` as a bounce and a hit before or after it that bends the track too little to be seen:
    /// of a ball that flies away from the camera, say.
    fn split(&self, trajectory: &Trajectory, index: usize) -> Vec<Trajectory> {
        let time = trajectory.segments[index].time;
        let before = trajectory.segments[index - 1].time;
        let after = trajectory.segments.get(index + 1).map_or(self.times[trajectory.last], |next| next.time);
        let others = [before, after].into_iter().flat_map(|other| SPLITS.map(|fraction| (other, fraction)));
        let split = others.filter_map(|(other, fraction)| {
            let (more, _) = self.with_hit(trajectory, time + fraction * (other - time))?;
            Some(self.anchored(&more, index + usize::from(other < time)))
        });
        split.flatten().collect()
    }

    /// The trajectory with a hit that changes nothing at a time, and which segment that begins.
    fn with_hit(&self, trajectory: &Trajectory, time: f64) -> Option<(Trajectory, usize)> {
        let index = trajectory.segments.partition_point(|segment| segment.time < time);
        let mut more = trajectory.clone();
        more.segments.insert(index, Segment { begin: Begin::Hit, time, state: self.at(trajectory, time) });
        (index > 0 && more.is_in_order()).then_some((more, index))
    }

    /// The trajectory with the hit of `index` as a bounce on whatever it can be: the flights before and after it are aimed anew.
    fn anchored(&self, trajectory: &Trajectory, index: usize) -> Vec<Trajectory> {
        let event = trajectory.segments[index];
        let seen = |ray: &super::observation::Ray| self.plane.point(&(event.position() - ray.origin));
        let ray = self.model.observations.iter().find_map(|it| it.ray.as_ref());
        let Some(image) = ray.and_then(seen) else { return vec![] };
        let gravity = self.model.gravity();
        let aim = |from: &Vector3<f64>, to: &Vector3<f64>, lasting: f64, pull: f64| {
            self.state((*from, (to - from) / lasting - gravity * (pull * lasting / 2.0)), pull)
        };
        let mut all = vec![];
        for (kind, at) in self.contacts(&image, event.time) {
            for (pull, drift) in STARTS {
                let mut next = trajectory.clone();
                next.segments[index].begin = kind;
                let before = trajectory.segments[index - 1];
                next.segments[index - 1].state = if index > 1 {
                    aim(&before.position(), &at, event.time - before.time, pull)
                } else {
                    let end = self.times.partition_point(|&time| time < event.time).saturating_sub(1);
                    let frames = trajectory.first..=end.max(trajectory.first);
                    let found = self.ballistic(frames, (event.time, Some(at)), (pull, drift));
                    let Some(found) = found else { continue };
                    self.flown(&self.state(found, pull), before.time - event.time)
                };
                let (to, when) = match trajectory.segments.get(index + 1) {
                    Some(next) => (next.position(), next.time),
                    None => (part(&self.at(trajectory, self.times[trajectory.last]), 0), self.times[trajectory.last]),
                };
                let arrived = self.flown(&next.segments[index - 1].state, event.time - before.time);
                next.segments[index].state = match when > event.time + 1e-3 {
                    true => aim(&at, &to, when - event.time, 1.0),
                    false => column(at, part(&event.state, 1), part(&arrived, 2)),
                };
                all.push(next.clone());
                // And as the law has it.
                if let Begin::Bounce(obstacle) = kind {
                    let normal = self.model.obstacles[obstacle].nearest(&at).normal;
                    let (v, w) = self.model.rigid.rebound(&normal, &part(&arrived, 1), &part(&arrived, 2));
                    next.segments[index].state = column(at, v, w);
                    all.push(next);
                }
            }
        }
        all
    }

    /// The trajectory with its last segment aimed at a place that it reaches at `time`: after a hit nothing else tells how far away
    /// it leads, and its spin is as open as a first flight's. After a bounce as it is.
    fn aimed(&self, trajectory: &Trajectory, at: Vector3<f64>, time: f64) -> Vec<Trajectory> {
        let Some(last) = trajectory.segments.last().filter(|last| last.begin == Begin::Hit) else {
            return vec![trajectory.clone()];
        };
        let lasting = time - last.time;
        if lasting <= 0.0 {
            return vec![];
        }
        let gravity = self.model.gravity();
        let aim = |pull: f64| {
            let velocity = (at - last.position()) / lasting - gravity * (pull * lasting / 2.0);
            let mut aimed = trajectory.clone();
            if let Some(segment) = aimed.segments.last_mut() {
                segment.state = self.state((last.position(), velocity), pull);
            }
            aimed
        };
        PULLS.into_iter().map(aim).collect()
    }

    /// The trajectory with an event at `time`, at a place known roughly, and a flight on from there through the frames of `range`.
    fn after(
        &self,
        trajectory: &Trajectory,
        begin: Begin,
        at: Vector3<f64>,
        time: f64,
        range: RangeInclusive<usize>,
    ) -> Option<Hypothesis> {
        let time = time.clamp(self.times[trajectory.first] + APART, self.times[*range.end()] - APART);
        if trajectory.segments.last().is_some_and(|last| last.time >= time) {
            return None;
        }
        let arrived = self.at(trajectory, time);
        let mut states = vec![];
        if let Begin::Bounce(obstacle) = begin {
            let normal = self.model.obstacles[obstacle].nearest(&at).normal;
            let (v, w) = self.model.rigid.rebound(&normal, &part(&arrived, 1), &part(&arrived, 2));
            states.push(column(at, v, w));
        }
        if let Some((position, velocity)) = self.ballistic(range.clone(), (time, Some(at)), (1.0, 0.0)) {
            states.push(column(position, velocity, Vector3::zeros()));
        }
        let with = |state: &Column| {
            let mut next = trajectory.clone();
            next.last = *range.end();
            next.segments.push(Segment { begin, time, state: *state });
            self.kept(&next)
        };
        best(states.iter().filter_map(with).collect(), 1).pop()
    }
}

/// The most probable `count` that differ.
pub fn best(mut all: Vec<Hypothesis>, count: usize) -> Vec<Hypothesis> {
    all.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let mut chosen: Vec<Hypothesis> = vec![];
    for found in all {
        let same = |other: &Hypothesis| {
            let kinds =
                |it: &Hypothesis| it.trajectory.segments.iter().map(|segment| segment.begin).collect::<Vec<_>>();
            let apart = other.trajectory.segments[0].position() - found.trajectory.segments[0].position();
            kinds(other) == kinds(&found) && apart.norm() < 0.02
        };
        if chosen.len() < count && !chosen.iter().any(same) {
            chosen.push(found);
        }
    }
    chosen
}
