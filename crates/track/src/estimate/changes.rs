//! Trajectories that differ from another in one event, for the search to try.

use nalgebra::Point2;

use super::observation::interval;
use super::rays::BallisticFlight;
use super::search::{APART, DEPARTURES, Search};
use super::trajectory::{Begin, Segment, Span, Trajectory};
use gravisight_physics::{column, part};

/// Where a hit that is not seen is tried, as fractions of the way to the next event.
const SPLITS: [f64; 2] = [0.35, 0.7];
/// Labels at either end between which a hit is tried that no change point shows.
const ENDS: usize = 4;
/// Times of events that are tried are at least so far apart, s.
const TOGETHER: f64 = 0.015;
/// Gaps between the labels of a flight in which a contact is looked for, at most, and how many contacts of a flight are tried.
const GAPS: usize = 40;
const BEST: usize = 2;
/// Distances that are scanned, from the middle of where the ball can be, in standard deviations of that, and how firmly.
const SCAN: [f64; 7] = [-1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5];
const SCANNED: f64 = 0.05;

impl Search<'_> {
    /// Trajectories that differ in one event: left out, of another kind, added, or where the trajectory leads into something. With each
    /// the segments that differ.
    pub(super) fn beside(&self, trajectory: &Trajectory) -> Vec<(Trajectory, Span)> {
        let mut tried = vec![];
        let count = trajectory.segments.len();
        for index in 1..count {
            let mut fewer = trajectory.clone();
            fewer.segments.remove(index);
            tried.push((fewer, index - 1..index));
            if trajectory.segments[index].begin == Begin::Hit {
                tried.extend(self.touching(trajectory, index).into_iter().map(|it| (it, index - 1..index + 1)));
                tried.extend(self.split(trajectory, index).into_iter().map(|it| (it, index - 1..index + 2)));
            } else {
                let mut hit = trajectory.clone();
                hit.segments[index].begin = Begin::Hit;
                tried.push((hit, index - 1..index + 1));
            }
            tried.extend(self.swapped(trajectory, index).into_iter().map(|it| (it, index - 1..index + 2)));
        }
        for index in 0..count {
            tried.extend(self.inserted(trajectory, index).into_iter().map(|it| (it, index..index + 2)));
        }
        for time in self.times_of_hits(trajectory) {
            if let Some((more, index)) = self.with_hit(trajectory, time) {
                tried.push((more, index - 1..index + 1));
            }
        }
        tried.extend(self.model.followed(trajectory).map(|it| {
            let all = it.segments.len();
            (it, count - 1..all)
        }));
        tried
    }

    /// Times at change points and near the ends at which nothing happens.
    fn times_of_hits(&self, trajectory: &Trajectory) -> Vec<f64> {
        let interval = self.interval();
        let is_near = |time: f64| trajectory.segments[1..].iter().any(|it| (it.time - time).abs() < interval);
        let gaps: Vec<f64> = self.labels.windows(2).map(|pair| (pair[0].0 + pair[1].0) / 2.0).collect();
        let ends = gaps.iter().take(ENDS).chain(gaps.iter().rev().take(ENDS)).copied();
        let points = self.change_points[1].iter().map(|point| point.time);
        let mut times: Vec<f64> = vec![];
        for time in points.chain(ends).filter(|&time| !is_near(time)) {
            if times.iter().all(|other| (other - time).abs() > TOGETHER) {
                times.push(time);
            }
        }
        times
    }

    /// Median time from frame to frame, s.
    pub(super) fn interval(&self) -> f64 {
        interval(self.times.iter().copied())
    }

    /// The trajectory with a hit that changes nothing at a time, and which segment that begins.
    fn with_hit(&self, trajectory: &Trajectory, time: f64) -> Option<(Trajectory, usize)> {
        let index = trajectory.segments.partition_point(|segment| segment.time < time);
        let mut more = trajectory.clone();
        more.segments.insert(index, Segment { begin: Begin::Hit, time, state: self.at(trajectory, time) });
        (index > 0 && more.is_in_order()).then_some((more, index))
    }

    /// Where a trajectory is seen in the plane at the beginning of a segment, px.
    fn image(&self, event: &Segment) -> Option<Point2<f64>> {
        let ray = self.model.observations.iter().find_map(|it| it.ray.as_ref())?;
        self.plane.point(&(event.position() - ray.origin))
    }

    /// The trajectory with the event of `index` as a contact with whatever it can be.
    fn touching(&self, trajectory: &Trajectory, index: usize) -> Vec<Trajectory> {
        let event = trajectory.segments[index];
        let Some(image) = self.image(&event) else { return vec![] };
        let drifts = if index == 1 { &DEPARTURES[..] } else { &DEPARTURES[..1] };
        let options = self.contacts(&image, event.time);
        let found = options.iter().flat_map(|&option| {
            drifts.iter().filter_map(move |&drift| self.with_contact(trajectory, (index, false), option, drift))
        });
        found.flat_map(|found| found.1).collect()
    }

    /// The trajectory with the hit of `index` as a contact and a hit before or after it that bends the track too little to be seen:
    /// of a ball that flies away from the camera, say.
    fn split(&self, trajectory: &Trajectory, index: usize) -> Vec<Trajectory> {
        let time = trajectory.segments[index].time;
        let before = trajectory.segments[index - 1].time;
        let after = trajectory.segments.get(index + 1).map_or(self.times[trajectory.last], |next| next.time);
        let others = [before, after].into_iter().flat_map(|other| SPLITS.map(|fraction| (other, fraction)));
        let split = others.filter_map(|(other, fraction)| {
            let (more, _) = self.with_hit(trajectory, time + fraction * (other - time))?;
            Some(self.touching(&more, index + usize::from(other < time)))
        });
        split.flatten().collect()
    }

    /// The trajectory with the contact and the hit that follow one another at `index` in the other order.
    fn swapped(&self, trajectory: &Trajectory, index: usize) -> Vec<Trajectory> {
        let Some(next) = trajectory.segments.get(index + 1) else { return vec![] };
        let contact = match (trajectory.segments[index].begin, next.begin) {
            (Begin::Hit, Begin::Bounce(_)) => index,
            (Begin::Bounce(_), Begin::Hit) => index + 1,
            _ => return vec![],
        };
        let mut hits = trajectory.clone();
        hits.segments[index].begin = Begin::Hit;
        hits.segments[index + 1].begin = Begin::Hit;
        self.touching(&hits, contact)
    }

    /// The trajectory with another contact on the flight of `index`, where that is nearest to the labels and to the contact's law.
    fn inserted(&self, trajectory: &Trajectory, index: usize) -> Vec<Trajectory> {
        let from = trajectory.segments[index].time;
        let to = trajectory.segments.get(index + 1).map_or(f64::INFINITY, |next| next.time);
        let own = |pair: &&[(f64, Point2<f64>)]| pair[1].0 > from && pair[0].0 < to;
        let pairs: Vec<_> = self.labels.windows(2).filter(own).collect();
        let step = pairs.len().div_ceil(GAPS).max(1);
        let drifts = if index == 0 { &DEPARTURES[..] } else { &DEPARTURES[..1] };
        let mut found: Vec<(f64, f64, Begin, Vec<Trajectory>)> = vec![];
        for pair in pairs.iter().step_by(step) {
            let (start, end) = (pair[0].0.max(from), pair[1].0.min(to));
            let time = (start + end) / 2.0;
            let along = (time - pair[0].0) / (pair[1].0 - pair[0].0);
            let image = Point2::from(pair[0].1.coords.lerp(&pair[1].1.coords, along));
            let Some((more, index)) = self.with_hit(trajectory, time) else { continue };
            for option in self.contacts(&image, time) {
                for &drift in drifts {
                    let contact = self.with_contact(&more, (index, false), option, drift);
                    found.extend(contact.map(|(cost, all)| (cost, time, option.0, all)));
                }
            }
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut chosen: Vec<(f64, f64, Begin, Vec<Trajectory>)> = vec![];
        for it in found {
            let near = |other: &(f64, f64, Begin, Vec<Trajectory>)| {
                other.2 == it.2 && (other.1 - it.1).abs() < 2.0 * self.interval()
            };
            if chosen.len() < BEST && !chosen.iter().any(near) {
                chosen.push(it);
            }
        }
        chosen.into_iter().flat_map(|it| it.3).filter(Trajectory::is_in_order).collect()
    }

    /// The same structure with the ball nearer or farther at the first label: what is seen of a flight along the line of sight may be
    /// explained by one that goes the other way.
    pub(super) fn scanned(&self, trajectory: &Trajectory) -> Vec<Trajectory> {
        let (place, sigma) = &self.model.place;
        let (Some(ray), Some(next)) = (&self.model.observations[trajectory.first].ray, trajectory.segments.get(1))
        else {
            return vec![];
        };
        let (middle, reach) = (ray.direction.dot(&(place - ray.origin)), self.plane.axis().abs().dot(sigma));
        let (begin, frames) = (self.times[trajectory.first], trajectory.frames(0));
        let at = |step: f64| {
            let distance = middle + step * reach;
            if distance <= 0.0 || next.time <= begin + APART {
                return None;
            }
            let places = [(begin, ray.at(distance), SCANNED), (next.time, next.position(), SCANNED)];
            let flight: BallisticFlight =
                self.ballistic(frames.start..=frames.end.checked_sub(1)?, begin, &places, 0.0)?;
            let mut scanned = trajectory.clone();
            scanned.segments[0].state = self.state(&flight);
            if let Begin::Bounce(obstacle) = next.begin {
                let arrived = self.flown(&scanned.segments[0].state, next.time - begin);
                let normal = self.model.obstacles[obstacle].nearest(&next.position()).normal;
                let (v, w) = self.model.rigid.rebound(&normal, &part(&arrived, 1), &part(&arrived, 2));
                scanned.segments[1].state = column(next.position(), v, w);
            }
            Some(scanned)
        };
        SCAN.into_iter().filter_map(at).collect()
    }
}
