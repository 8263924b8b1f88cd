//! The search for the right flights: starts from contacts whose place the picture gives, and from gravity; kink by kink.

use nalgebra::{Point3, Vector3};

use super::course::{Course, Event, Kind};
use super::motion::Moving;
use super::rays::Rays;
use super::task::Task;
use crate::track::estimate::change_points::ChangePoint;
use crate::track::fit::loss::Loss;

/// Accelerations tried for a flight whose spin is unknown, in units of gravity's.
const PULLS: [f64; 3] = [0.6, 1.0, 1.4];
/// Courses that are followed from kink to kink.
const BEAM: usize = 6;
/// What another event costs, in squared standard deviations of a label.
const BOUNCE_PRICE: f64 = 10.0;
const HIT_PRICE: f64 = 70.0;
/// Where a hit that is not seen is tried, as shares of the way to the next event.
const SPLITS: [f64; 2] = [0.35, 0.7];
/// Of the courses tried in a round, those that are refined to the end.
const FINISHED: usize = 6;
/// Rounds of search beside the best course, and by how much it must be bettered for another.
const ROUNDS: usize = 4;
const GAIN: f64 = 1.0;
/// Events at the growing end whose flights are refined with it.
const OPEN: usize = 3;
/// A growing course's cost over that of the finished one, whose loss lets go of outliers, at most.
const SLACK: f64 = 1.5;
const GROWING: Loss = Loss::Huber(2.5);
pub const FINAL: Loss = Loss::Cauchy(2.5);

/// A course and its cost, prices of its events included.
#[derive(Debug, Clone)]
pub struct Found {
    pub course: Course,
    pub cost: f64,
}

/// When each frame was taken, as far as the picture alone tells, s.
pub fn slipped(task: &Task) -> Vec<f64> {
    let mut times = task.times.clone();
    for &(frame, by) in &task.slips {
        times[frame..].iter_mut().for_each(|time| *time += by);
    }
    times
}

/// The spin, of those that do it the smallest, with which the air adds `acceleration` to a ball's of `velocity`.
fn spin_for(task: &Task, acceleration: Vector3<f64>, velocity: &Vector3<f64>) -> Vector3<f64> {
    let lift = task.laws.lift();
    if lift == 0.0 {
        return Vector3::zeros();
    }
    let spin = velocity.cross(&acceleration) / (lift * velocity.norm_squared().max(1.0));
    let longest = 2.0 * task.priors.spin;
    spin * (longest / spin.norm().max(longest))
}

/// Courses of at most so many `hits` that may explain the track, the best first; none where it is clear that they cost more
/// than `limit`. Courses grow along the clear ones of the `kinks`, and along all, the faint ones too. Only frames from the first label to the last.
pub fn searched(task: &Task, kinks: [Vec<ChangePoint>; 2], hits: Option<usize>, limit: f64) -> Vec<Found> {
    let rays = Rays::of(task);
    let [clear, all] = &kinks;
    let mut found = grown(task, &rays, all, hits, limit);
    if !clear.iter().map(|kink| kink.time).eq(all.iter().map(|kink| kink.time)) {
        found.extend(grown(task, &rays, clear, hits, limit));
    }
    improve(task, &rays, all, hits, &mut found);
    best(found, BEAM)
}

/// The best courses along these kinks.
fn grown(task: &Task, rays: &Rays, kinks: &[ChangePoint], hits: Option<usize>, limit: f64) -> Vec<Found> {
    let times = slipped(task);
    let seen: Vec<usize> = (0..task.times.len()).filter(|&frame| rays.ideal[frame].is_some()).collect();
    let (Some(&first), Some(&last)) = (seen.first(), seen.last()) else { return vec![] };
    if last < first + 2 {
        return vec![];
    }
    let end_before = |kink: Option<&ChangePoint>| match kink {
        Some(kink) => times.partition_point(|&time| time < kink.time).max(first + 2).min(last),
        None => last,
    };
    let gravity = *task.laws.gravity();
    let slips: Vec<f64> = task.slips.iter().map(|slip| slip.1).collect();
    let mut beam: Vec<Found> = vec![];
    let end = end_before(kinks.first());
    for pull in PULLS {
        let Some(mut start) = rays.ballistic(first..=end - 1, times[first], None, gravity * pull) else {
            continue;
        };
        start.spin = spin_for(task, gravity * (pull - 1.0), &start.velocity);
        let course = Course { first, last: end, start, events: vec![], off: [0.0; 3], slips: slips.clone() };
        beam.extend(kept(task, &course, 10));
    }
    for (index, kink) in kinks.iter().enumerate() {
        let (begin, end) = (end_before(Some(kink)), end_before(kinks.get(index + 1)));
        let mut next: Vec<Found> = vec![];
        let mut options: Vec<(Kind, Vector3<f64>)> = vec![];
        for (number, obstacle) in task.obstacles.iter().enumerate() {
            options.extend(rays.contact(task, &kink.image, obstacle).map(|at| (Kind::Bounce(number), at)));
        }
        // A flight from the very start is found anew from each contact.
        for &(kind, at) in &options {
            for pull in PULLS {
                let Some(mut before) = rays.ballistic(first..=begin - 1, kink.time, Some(at), gravity * pull) else {
                    continue;
                };
                before.spin = spin_for(task, gravity * (pull - 1.0), &before.velocity);
                let start = task.laws.moved(&before, times[first] - kink.time, &[0.0; 3]);
                let fresh = Course { first, last: begin, start, events: vec![], off: [0.0; 3], slips: slips.clone() };
                if beam.iter().all(|found| !found.course.events.is_empty()) && index > 0 {
                    continue;
                }
                next.extend(after(task, rays, &fresh, kind, at, kink.time, begin..=end));
            }
        }
        for Found { course, .. } in &beam {
            let mut longer = course.clone();
            longer.last = end;
            next.extend(kept(task, &longer, 8));
            let there = task.laws.moved(
                &task.path(course).frames[course.last - course.first],
                kink.time - times[course.last],
                &course.off,
            );
            next.extend(after(task, rays, course, Kind::Hit, there.position, kink.time, begin..=end));
            for &(kind, at) in &options {
                for aimed in aimed(task, course, at, kink.time) {
                    next.extend(after(task, rays, &aimed, kind, at, kink.time, begin..=end));
                }
            }
        }
        let allowed = |found: &Found| hits.is_none_or(|most| count_hits(&found.course) <= most);
        next.retain(|found| allowed(found) && found.cost < SLACK * limit);
        beam = best(next, BEAM);
    }
    let finished = |found: &Found| {
        let (course, cost) = task.refined(&found.course, FINAL, 30)?;
        Some(Found { cost: cost + price(&course), course })
    };
    beam.iter().take(4).filter_map(finished).collect()
}

/// Looks for better courses beside the best one, as long as there are any: with an event left out, of another kind, or where
/// a kink has none. What went wrong at one kink is often told only by later ones.
fn improve(task: &Task, rays: &Rays, kinks: &[ChangePoint], hits: Option<usize>, all: &mut Vec<Found>) {
    for _ in 0..ROUNDS {
        let Some(best) = best(all.clone(), 1).pop() else { return };
        let mut tried = vec![];
        for index in 0..best.course.events.len() {
            let mut fewer = best.course.clone();
            fewer.events.remove(index);
            tried.push(fewer);
            tried.extend(anchored(task, rays, &best.course, index));
            tried.extend(split(task, rays, &best.course, index));
        }
        for kink in kinks {
            let near = |event: &Event| (event.time - kink.time).abs() < 2.0 * task.interval;
            if !best.course.events.iter().any(near) {
                tried.extend(inserted(task, rays, &best.course, kink));
            }
        }
        let allowed = |course: &Course| hits.is_none_or(|most| count_hits(course) <= most);
        let refined = |course: &Course| {
            let (course, cost) = task.refined(course, GROWING, 4)?;
            Some(Found { cost: cost + price(&course), course })
        };
        let found: Vec<Found> = tried.iter().filter(|course| allowed(course)).filter_map(refined).collect();
        let finished = |found: &Found| {
            let (course, cost) = task.refined(&found.course, FINAL, 30)?;
            Some(Found { cost: cost + price(&course), course })
        };
        let better: Vec<Found> = self::best(found, FINISHED).iter().filter_map(finished).collect();
        let improved = better.iter().any(|found| found.cost < best.cost - GAIN);
        all.extend(better);
        if !improved {
            return;
        }
    }
}

/// The course with the hit of `index` as a bounce and a hit before or after it that bends the track too little to be seen:
/// of a ball that flies away from the camera, say.
fn split(task: &Task, rays: &Rays, course: &Course, index: usize) -> Vec<Course> {
    let event = course.events[index];
    if event.kind != Kind::Hit {
        return vec![];
    }
    let times = task.times_of(course);
    let before = index.checked_sub(1).map_or(times[course.first], |last| course.events[last].time);
    let after = course.events.get(index + 1).map_or(times[course.last], |next| next.time);
    let with_hit = |other: f64, share: f64| {
        let time = event.time + share * (other - event.time);
        let more = with_hit(task, course, time)?;
        Some(anchored(task, rays, &more, index + usize::from(other < event.time)))
    };
    let others = [before, after].into_iter().flat_map(|other| SPLITS.map(|share| (other, share)));
    others.filter_map(|(other, share)| with_hit(other, share)).flatten().collect()
}

/// The course with a hit that changes nothing at a time.
fn with_hit(task: &Task, course: &Course, time: f64) -> Option<Course> {
    let times = task.times_of(course);
    let index = course.events.partition_point(|event| event.time < time);
    let frame = times.partition_point(|&other| other <= time).saturating_sub(1);
    let path = task.path(course);
    let near = path.frames.get(frame.checked_sub(course.first)?)?;
    let (mut from, mut at) = (times[frame], *near);
    if let Some((event, moving)) = index.checked_sub(1).map(|last| (&course.events[last], path.before[last]))
        && event.time > from
    {
        (from, at) = (event.time, Moving { position: moving.position, velocity: event.velocity, spin: event.spin });
    }
    let there = task.laws.moved(&at, time - from, &course.off);
    let mut more = course.clone();
    more.events.insert(index, Event { kind: Kind::Hit, time, velocity: there.velocity, spin: there.spin });
    more.in_order(&times).then_some(more)
}

/// The course with another event at a kink.
fn inserted(task: &Task, rays: &Rays, course: &Course, kink: &ChangePoint) -> Vec<Course> {
    let Some(more) = with_hit(task, course, kink.time) else { return vec![] };
    let index = more.events.partition_point(|event| event.time < kink.time);
    let mut all = anchored(task, rays, &more, index);
    all.push(more);
    all
}

/// The course with the hit of `index` as a bounce on whatever it can be: the flights before and after it are aimed anew.
fn anchored(task: &Task, rays: &Rays, course: &Course, index: usize) -> Vec<Course> {
    let event = course.events[index];
    let (path, times) = (task.path(course), task.times_of(course));
    let (Kind::Hit, Some(before)) = (event.kind, path.before.get(index)) else { return vec![] };
    let Ok(image) = task.camera.image_from_world(&Point3::from(before.position)) else { return vec![] };
    let gravity = *task.laws.gravity();
    let aim = |from: &Vector3<f64>, to: &Vector3<f64>, lasting: f64, pull: f64| {
        let velocity = (to - from) / lasting - gravity * (pull * lasting / 2.0);
        (velocity, spin_for(task, gravity * (pull - 1.0), &velocity))
    };
    let mut all = vec![];
    for (number, obstacle) in task.obstacles.iter().enumerate() {
        let Some(at) = rays.contact(task, &image, obstacle) else { continue };
        for pull in PULLS {
            let mut next = course.clone();
            next.events[index].kind = Kind::Bounce(number);
            match index.checked_sub(1) {
                Some(last) => {
                    let (from, lasting) = (path.before[last].position, event.time - course.events[last].time);
                    (next.events[last].velocity, next.events[last].spin) = aim(&from, &at, lasting, pull);
                }
                None => {
                    let end = times.partition_point(|&time| time < event.time).saturating_sub(1);
                    let found = rays.ballistic(course.first..=end, event.time, Some(at), gravity * pull);
                    let Some(mut found) = found else { continue };
                    found.spin = spin_for(task, gravity * (pull - 1.0), &found.velocity);
                    next.start = task.laws.moved(&found, times[course.first] - event.time, &course.off);
                }
            }
            let (to, when) = match (path.before.get(index + 1), course.events.get(index + 1)) {
                (Some(moving), Some(event)) => (moving.position, event.time),
                _ => (path.frames[path.frames.len() - 1].position, times[course.last]),
            };
            if when > event.time + 1e-3 {
                (next.events[index].velocity, next.events[index].spin) = aim(&at, &to, when - event.time, 1.0);
            }
            all.push(next);
        }
    }
    all
}

/// The course with its last flight aimed at a place that it reaches at `time`: after a hit nothing else tells how far away it
/// leads, and its spin is as open as a first flight's. After a bounce as it is.
fn aimed(task: &Task, course: &Course, at: Vector3<f64>, time: f64) -> Vec<Course> {
    let Some(last) = course.events.last().filter(|event| event.kind == Kind::Hit) else { return vec![course.clone()] };
    let lasting = time - last.time;
    let path = task.path(course);
    let (Some(from), true) = (path.before.last(), lasting > 0.0) else { return vec![] };
    let gravity = *task.laws.gravity();
    let aim = |pull: f64| {
        let mut aimed = course.clone();
        let velocity = (at - from.position) / lasting - gravity * (pull * lasting / 2.0);
        if let Some(event) = aimed.events.last_mut() {
            (event.velocity, event.spin) = (velocity, spin_for(task, gravity * (pull - 1.0), &velocity));
        }
        aimed
    };
    PULLS.into_iter().map(aim).collect()
}

/// The course with an event at `time`, at a place known roughly, and a flight on from there through the frames of `range`.
fn after(
    task: &Task,
    rays: &Rays,
    course: &Course,
    kind: Kind,
    at: Vector3<f64>,
    time: f64,
    range: std::ops::RangeInclusive<usize>,
) -> Option<Found> {
    let time = time.clamp(rays.times[course.first] + 1e-4, rays.times[*range.end()] - 1e-4);
    if course.events.last().is_some_and(|event| event.time >= time) {
        return None;
    }
    let moving = rays.ballistic(range.clone(), time, Some(at), *task.laws.gravity())?;
    if let Kind::Bounce(obstacle) = kind
        && task.obstacles[obstacle].nearest(&at).normal.dot(&moving.velocity) < -1.0
    {
        return None;
    }
    let mut next = course.clone();
    next.last = *range.end();
    next.events.push(Event { kind, time, velocity: moving.velocity, spin: Vector3::zeros() });
    kept(task, &next, 8)
}

/// The course, its last flights refined, if they can be.
fn kept(task: &Task, course: &Course, steps: usize) -> Option<Found> {
    let (course, cost) = task.refined_from(course.events.len().saturating_sub(OPEN), course, GROWING, steps)?;
    Some(Found { cost: cost + price(&course), course })
}

fn count_hits(course: &Course) -> usize {
    course.events.iter().filter(|event| event.kind == Kind::Hit).count()
}

/// What the events of a course cost.
pub fn price(course: &Course) -> f64 {
    let of = |kind| if kind == Kind::Hit { HIT_PRICE } else { BOUNCE_PRICE };
    course.events.iter().map(|event| of(event.kind)).sum()
}

/// The cheapest `count` that differ.
fn best(mut all: Vec<Found>, count: usize) -> Vec<Found> {
    all.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let mut chosen: Vec<Found> = vec![];
    for found in all {
        let same = |other: &Found| {
            let kinds = |found: &Found| found.course.events.iter().map(|event| event.kind).collect::<Vec<_>>();
            kinds(other) == kinds(&found) && (other.course.start.position - found.course.start.position).norm() < 0.02
        };
        if chosen.len() < count && !chosen.iter().any(same) {
            chosen.push(found);
        }
    }
    chosen
}
