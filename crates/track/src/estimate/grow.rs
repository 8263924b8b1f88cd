//! Growth of trajectories from change point to change point.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::change_points::ChangePoint;
use super::search::{APART, DEPARTURES, KNOWN, LOOSE, Search, best};
use super::solve::Hypothesis;
use super::trajectory::{Begin, Segment, Trajectory};
use gravisight_physics::{Column, FORCES, part};

/// Hypotheses that are followed from change point to change point: of whole tracks; of flights by themselves, and for a first look.
pub(super) const BEAM: usize = 8;
pub(super) const NARROW: usize = 4;
/// Labels between two times at which an unseen hit is looked for, at least, and into how many parts that cuts a flight, at most.
const FEW: usize = 4;
const MOST_PARTS: usize = 4;
/// How near the ends of two trajectories are that count as the same, m.
const SAME: f64 = 0.05;
/// How surely a flight that is another's start must be worse than two (−2 ln) to be given up.
const HOPELESS: f64 = 30.0;

/// The best path to a change point, from hit to hit.
#[derive(Clone)]
struct PartialPath {
    cost: f64,
    /// The change point at which its last flight begins, and that flight.
    from: usize,
    flight: Trajectory,
}

impl Search<'_> {
    /// The most probable trajectories along these change points.
    pub(super) fn grown(&self, points: &[ChangePoint], size: usize) -> Vec<Hypothesis> {
        let mut last = vec![];
        self.grow((0, points), (true, size), |_, beam| {
            last = beam.to_vec();
            true
        });
        last.iter().filter_map(|found| self.finished(&found.trajectory)).collect()
    }

    /// The most probable trajectory of flights from hit to hit, each found by itself: what happens in one says little of the next, and
    /// its bounces say where it is. `tied`: it begins about where the one before ends.
    pub(super) fn chained(&self, points: &[ChangePoint], tied: bool) -> Option<Hypothesis> {
        // To the first label, to each change point, and to the last label.
        let mut paths: Vec<Option<PartialPath>> = vec![None; points.len() + 2];
        for from in 0..=points.len() {
            let mut model = self.model.with_observations(self.model.observations);
            let before = match (from, &paths[from]) {
                (0, _) => 0.0,
                (_, Some(path)) => {
                    // It begins about where the one before ends.
                    let end = part(&self.at(&path.flight, points[from - 1].time), 0);
                    if tied {
                        model.place = (end, Vector3::repeat(LOOSE));
                    }
                    path.cost + self.start_cost(tied)
                }
                _ => continue,
            };
            self.with_model(&model).grow((from, points), (false, NARROW), |to, beam| {
                let Some(found) = beam.first() else { return true };
                let cost = before + found.cost;
                let known = paths[to].as_ref().map_or(f64::INFINITY, |path| path.cost);
                if cost < known {
                    paths[to] = Some(PartialPath { cost, from, flight: found.trajectory.clone() });
                }
                cost < known + HOPELESS
            });
        }
        let mut flights = vec![];
        let mut at = points.len() + 1;
        while at > 0 {
            let path = paths[at].as_ref()?;
            flights.push((path.from, &path.flight));
            at = path.from;
        }
        flights.reverse();
        let mut whole = flights[0].1.clone();
        for (from, flight) in &flights[1..] {
            let time = points[from - 1].time;
            let (first, rest) = flight.segments.split_first()?;
            let state = self.flown(&first.state, time - first.time);
            whole.segments.push(Segment { begin: Begin::Hit, time, state });
            whole.segments.extend(rest);
            whole.last = flight.last;
            whole.noise = whole.noise.max(flight.noise);
        }
        self.is_allowed(&whole).then(|| self.joined(&whole)).flatten()
    }

    /// Change points, and between those that are far apart times at which a hit may be that does not bend the track.
    pub(super) fn with_unseen(&self, points: &[ChangePoint]) -> Vec<ChangePoint> {
        let ends = [self.labels[0].0, self.labels[self.labels.len() - 1].0];
        let times = || std::iter::once(ends[0]).chain(points.iter().map(|point| point.time)).chain([ends[1]]);
        let mut all = points.to_vec();
        for (from, to) in times().zip(times().skip(1)) {
            let own: Vec<_> = self.labels.iter().filter(|it| (from..to).contains(&it.0)).collect();
            let parts = (own.len() / FEW).min(MOST_PARTS);
            for part in 1..parts {
                let &&(time, image) = &own[part * own.len() / parts];
                all.push(ChangePoint { time: time - APART, image, bends: false });
            }
        }
        all.sort_by(|a, b| a.time.total_cmp(&b.time));
        all
    }

    /// What a flight after a hit costs because it is hardly tied to the one before, −2 ln: its velocity and spin may be any, and it
    /// begins nearer or farther.
    fn start_cost(&self, tied: bool) -> f64 {
        let (config, spin) = (&self.model.config, self.model.spin_sigma());
        let depth = if tied { LOOSE } else { self.plane.axis().abs().dot(&self.model.place.1) };
        let free = depth.ln() + 2.0 * KNOWN.ln() + 3.0 * config.speed.ln() + 3.0 * spin.ln();
        2.0 * (free - (config.hit_rate * self.interval()).ln()) - self.model.start_constant()
    }

    /// Grows trajectories from a change point (0: the first label) on and shows the most probable ones at every later one, until `visit`
    /// says that it is enough; with hits or without, following so many (`size`).
    fn grow(
        &self,
        (from, points): (usize, &[ChangePoint]),
        (hits, size): (bool, usize),
        mut visit: impl FnMut(usize, &[Hypothesis]) -> bool,
    ) {
        let times = &self.times;
        let begin = if from == 0 { f64::NEG_INFINITY } else { points[from - 1].time };
        let seen: Vec<usize> = (0..times.len())
            .filter(|&frame| self.model.observations[frame].ray.is_some() && times[frame] >= begin)
            .collect();
        let (Some(&first), Some(&last)) = (seen.first(), seen.last()) else { return };
        // Where frames before a change point end; with hits the next one goes with them, for it may as well be before the hit.
        let end_before = |point: Option<&ChangePoint>| match point {
            Some(point) => times.partition_point(|&time| time < point.time).max(first + 1).min(last + 1),
            None => last + 1,
        };
        let until = |end: usize| if hits { end.min(last) } else { end - 1 };
        let fresh = |state: Column, last: usize| Trajectory {
            segments: vec![Segment { begin: Begin::Start, time: times[first], state }],
            log_scales: [0.0; FORCES],
            log_size: 0.0,
            noise: self.noise,
            first,
            last,
            times: times.clone(),
        };
        let end = end_before(points.get(from));
        let departing = |&drift: &f64| {
            let found = self.ballistic(first..=end - 1, times[first], &[], drift)?;
            self.kept(&fresh(self.state(&found), until(end)), None)
        };
        let mut beam = best_ends(DEPARTURES.par_iter().filter_map(departing).collect(), size);
        if !visit(from + 1, &beam) {
            return;
        }
        for index in from..points.len() {
            let point = &points[index];
            let (begin, end) = (end_before(Some(point)), end_before(points.get(index + 1)));
            let last = until(end);
            let mut next: Vec<Hypothesis> = vec![];
            let options = if point.bends { self.contacts(&point.image, point.time) } else { vec![] };
            let time = point.time.clamp(times[first] + APART, (times[last] - APART).max(times[first] + APART));
            // A flight from the very start is found anew from each contact.
            if point.bends && (index == from || beam.iter().any(|found| found.trajectory.segments.len() == 1)) {
                let mut start = fresh([0.0; 9], last);
                start.segments.push(Segment { begin: Begin::Hit, time, state: [0.0; 9] });
                let contacts: Vec<_> = options.iter().flat_map(|it| DEPARTURES.map(|drift| (*it, drift))).collect();
                next.par_extend(contacts.into_par_iter().filter_map(|(option, drift)| {
                    self.better(self.with_contact(&start, (1, false), option, drift), None)
                }));
            }
            let longer = |parent: &Hypothesis| {
                let mut next: Vec<Hypothesis> = vec![];
                let mut longer = parent.trajectory.clone();
                longer.last = last;
                next.extend(self.kept(&longer, Some(parent)));
                next.extend(self.model.followed(&longer).and_then(|followed| self.kept(&followed, Some(parent))));
                if longer.segments.last().is_some_and(|last| last.time >= time) {
                    return next;
                }
                let there = self.at(&longer, time);
                let index = longer.segments.len();
                longer.segments.push(Segment { begin: Begin::Hit, time, state: there });
                let is_bounce = matches!(longer.segments[index - 1].begin, Begin::Bounce(_));
                for &option in options.iter().filter(|_| index > 1) {
                    let found = self.with_contact(&longer, (index, is_bounce), option, 0.0);
                    next.extend(self.better(found, Some(parent)));
                }
                if !hits {
                    return next;
                }
                let place: (f64, Vector3<f64>, f64) = (time, part(&there, 0), KNOWN);
                if let Some(flight) = self.ballistic(begin..=last, time, &[place], 0.0) {
                    longer.segments[index].state = self.state(&flight);
                    next.extend(self.kept(&longer, Some(parent)));
                }
                next
            };
            next.par_extend(beam.par_iter().flat_map_iter(longer));
            next.retain(|found| self.is_allowed(&found.trajectory));
            beam = best_ends(next, size);
            if !visit(index + 2, &beam) {
                return;
            }
        }
    }

    /// The better of trajectories that go on from `parent`.
    fn better(&self, found: Option<(f64, Vec<Trajectory>)>, parent: Option<&Hypothesis>) -> Option<Hypothesis> {
        let kept = found?.1.iter().filter_map(|it| self.kept(it, parent)).collect();
        best(kept, 1).pop()
    }
}

/// The most probable `count` whose ends differ: what was before a hit says nothing of what comes.
fn best_ends(mut all: Vec<Hypothesis>, count: usize) -> Vec<Hypothesis> {
    all.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let mut chosen: Vec<Hypothesis> = vec![];
    for found in all {
        let same = |other: &Hypothesis| {
            let kinds = |it: &Hypothesis| -> Vec<Begin> {
                let kinds: Vec<Begin> = it.trajectory.segments.iter().map(|segment| segment.begin).collect();
                let from = kinds.iter().rposition(|kind| *kind == Begin::Hit).unwrap_or(0);
                kinds[from..].to_vec()
            };
            let ends = [other, &found].map(|it| it.trajectory.segments.last().map(|last| last.state));
            let [Some(a), Some(b)] = ends else { return false };
            kinds(other) == kinds(&found) && (part(&a, 0) - part(&b, 0)).norm() < SAME
        };
        if chosen.len() < count && !chosen.iter().any(same) {
            chosen.push(found);
        }
    }
    chosen
}
