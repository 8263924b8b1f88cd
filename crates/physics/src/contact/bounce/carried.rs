//! Being carried by obstacles: resting, sliding, rolling.

use nalgebra::Vector3;

use super::rest::{Carried, ROLLING_SLIP, Support, free_directions, normal_reaction};
use super::{Bounce, rest_speed};
use crate::columns::{Column, Columns, part};
use crate::motion::approach::{STILL, first_contact};
use crate::motion::integrate::{Flow as _, Step};
use crate::motion::run::{Run, crossing};
use crate::obstacle::{Nearest, Shape, into_box, out_of_box};

/// Where a slide is stopped, as a share of the way to its end: at the end itself its direction is lost.
const SLIDE_END: f64 = 1.0 - 1e-7;
/// Gap within which a carried ball touches, m.
const CARRIED_GAP: f64 = 1e-8;
/// Cosine of the angle within which two normals are one surface's.
const PARALLEL: f64 = 1.0 - 1e-6;
/// Slip up to which a rolling sphere still rolls, m/s: what rounding adds up to.
const KEPT_SLIP: f64 = 10.0 * ROLLING_SLIP;
/// Step of a sphere that begins to slip, s; longer where its slip would not show after it.
const FIRST_SLIP: f64 = 1e-4;

/// What ends a motion on a support.
#[derive(Debug, Clone, Copy)]
enum Event {
    /// The slide has ended.
    Rolls,
    /// The grip no longer suffices.
    Slips,
    /// The rim of the face is reached.
    Rim,
}

impl Bounce {
    /// What carries the ball now: the surfaces it touches, does not leave and is pressed on.
    pub(super) fn support<const M: usize>(&self, run: &Run<M>) -> Option<Support> {
        let (r, v) = (run.y.position(), run.y.velocity());
        let mut a = part(&run.forces.derivative(&run.y.head()).0[0], 1);
        let mut touching: Vec<_> = run
            .obstacles
            .iter()
            .enumerate()
            .filter(|(_, obstacle)| obstacle.distance(&r) - self.rigid.radius <= CARRIED_GAP)
            .map(|(index, obstacle)| (index, obstacle.nearest(&r)))
            .filter(|(_, near)| near.normal.dot(&v).abs() <= STILL.max(rest_speed(normal_reaction(near, &a, &v))))
            .collect();
        // Where a face and an edge lie flush, the face carries.
        let reaction = |near: &Nearest| normal_reaction(near, &a, &v);
        touching.sort_by(|(_, one), (_, other)| reaction(other).total_cmp(&reaction(one)));
        let mut normals: Vec<Vector3<f64>> = Vec::new();
        let mut contacts = Vec::new();
        for (index, near) in touching {
            if contacts.len() < 3 && normal_reaction(&near, &a, &v) > STILL {
                contacts.push(index);
                normals.push(near.normal);
                a = free_directions(&normals) * a;
            }
        }
        (!contacts.is_empty()).then_some(Support { contacts, rolling: false })
    }

    /// Obstacles that need no looking for contacts: those that carry, and those that lie flush with them.
    fn flush<const M: usize>(&self, run: &Run<M>, support: &Support) -> Vec<usize> {
        let r = run.y.position();
        let near: Vec<_> = support.contacts.iter().map(|&index| run.obstacles[index].nearest(&r).normal).collect();
        let lies_flush = |index: &usize| {
            let other = run.obstacles[*index].nearest(&r);
            let touches = other.distance - self.rigid.radius <= CARRIED_GAP;
            support.contacts.contains(index) || (touches && near.iter().any(|n| n.dot(&other.normal) > PARALLEL))
        };
        (0..run.obstacles.len()).filter(lies_flush).collect()
    }

    pub(super) fn carried<const M: usize>(&self, run: &mut Run<M>, before: Support) -> Option<Support> {
        let mut support = self.support(run)?;
        if self.backwards {
            run.irreversible.get_or_insert(run.t);
        }
        run.y = self.carrier(run, &support).project(&run.y);
        let slip = self.carrier(run, &support).slip(&run.y.position(), &run.y.velocity(), &run.y.spin());
        let kept = before.rolling && before.contacts == support.contacts;
        let limit = if kept { KEPT_SLIP } else { ROLLING_SLIP };
        support.rolling = slip.is_some_and(|slip| slip.norm() <= limit);
        let now = support.clone();
        let carrier = self.carrier(run, &now);
        // A sphere whose grip does not suffice begins to slip; its friction has no direction before it does.
        let lacking = if support.rolling { carrier.lacking_grip(&run.y.0[0]) } else { -1.0 };
        let slips = lacking > 0.0;
        let longest =
            if slips { FIRST_SLIP.max(2.0 * KEPT_SLIP / (lacking * self.rigid.mobility())) } else { f64::INFINITY };
        let Some(step) = run.trial(&carrier, longest) else { return Some(support) };
        let (end, event) = self.first_event(run, &carrier, &step, slip.filter(|_| !support.rolling), slips);
        let reached = first_contact(run.obstacles, &self.flush(run, &support), self.rigid.radius, &step, step.h * end);
        if reached.obstacle.is_some() || reached.time < step.h * end {
            let theta = reached.time / step.h;
            run.commit_until(&carrier, step, theta);
            // what lies flush with the support is rolled onto, not hit
            let hit = reached.obstacle.filter(|obstacle| !self.flush(run, &support).contains(obstacle));
            return hit.map_or(Some(support), |obstacle| self.touch(run, obstacle));
        }
        let short = run.shortened(&carrier, step, end);
        let slope_before = carrier.derivative(&short.end.head());
        run.commit(&short);
        match event {
            Some(Event::Rolls) => self.start_rolling(run, &mut support, &slope_before),
            Some(Event::Rim) => self.pass_edge(run, &support, &slope_before),
            Some(Event::Slips) | None => {}
        }
        Some(support)
    }

    /// Where in a step on a support the motion changes first, if it does: share of the step, and how.
    fn first_event<const M: usize>(
        &self,
        run: &Run<M>,
        carrier: &Carried,
        step: &Step<M>,
        slide: Option<Vector3<f64>>,
        slips: bool,
    ) -> (f64, Option<Event>) {
        let mut first = (1.0, None);
        if let Some(slip) = slide {
            let along = |y: &Column| {
                let now = carrier.slip(&part(y, 0), &part(y, 1), &part(y, 2));
                now.map_or(0.0, |now| now.dot(&slip))
            };
            if along(&step.end.0[0]) <= 0.0 {
                first = (crossing(|theta| along(&step.at(theta)), false) * SLIDE_END, Some(Event::Rolls));
            }
        }
        if carrier.support.rolling && !slips && carrier.lacking_grip(&step.end.0[0]) > 0.0 {
            first = (crossing(|theta| carrier.lacking_grip(&step.at(theta)), true), Some(Event::Slips));
        }
        match self.leaves_face(run, carrier.support, step) {
            Some(theta) if theta < first.0 => (theta, Some(Event::Rim)),
            _ => first,
        }
    }

    /// Where within the step the sphere's centre passes the rim of the face that carries it.
    fn leaves_face<const M: usize>(&self, run: &Run<M>, support: &Support, step: &Step<M>) -> Option<f64> {
        let [index] = support.contacts.as_slice() else { return None };
        let Shape::Cuboid { centre, half, turn } = &run.obstacles[*index].shape else { return None };
        let beyond = |y: &Column| into_box(part(y, 0) - centre, turn).abs() - half;
        let (before, after) = (beyond(&step.start), beyond(&step.end.0[0]));
        let passed = (0..3).filter(|&axis| before[axis] < 0.0 && after[axis] > 0.0);
        let times = passed.map(|axis| crossing(|theta| beyond(&step.at(theta))[axis], true));
        times.min_by(f64::total_cmp)
    }

    /// The forces jump where a face ends in an edge: columns meet the rim at other times.
    fn pass_edge<const M: usize>(&self, run: &mut Run<M>, support: &Support, before: &Columns<1>) {
        let Some(&index) = support.contacts.first() else { return };
        let Shape::Cuboid { centre, half, turn } = &run.obstacles[index].shape else { return };
        let local = into_box(run.y.position() - centre, turn);
        // the rim just reached
        let beyond = local.abs() - half;
        let Some(axis) = (0..3).min_by(|&a, &b| beyond[a].abs().total_cmp(&beyond[b].abs())) else { return };
        let mut out = Vector3::zeros();
        out[axis] = local[axis].signum();
        let out = out_of_box(out, turn);
        // a hair beyond, where the edge's curvature counts
        let mut ahead = run.y;
        let nudge = out * (beyond[axis].abs() + 1e-12);
        for (value, by) in ahead.0[0].iter_mut().zip(nudge.iter()) {
            *value += by;
        }
        let after = self.carrier(run, support).derivative(&Columns::<1>([ahead.0[0]]));
        let speed = out.dot(&run.y.velocity());
        if speed > STILL {
            run.shift_columns(run.y.0.map(|column| -out.dot(&part(&column, 0)) / speed), before, &after);
        }
        run.y.0[0] = ahead.0[0];
    }

    /// A slide has ended in rolling.
    fn start_rolling<const M: usize>(&self, run: &mut Run<M>, support: &mut Support, before: &Columns<1>) {
        support.rolling = true;
        let near = run.obstacles[support.contacts[0]].nearest(&run.y.position());
        let (n, rigid) = (near.normal, self.rigid);
        let slip = rigid.slip(&n, &run.y.velocity(), &run.y.spin());
        let slip_change = rigid.slip(&n, &part(&before.0[0], 1), &part(&before.0[0], 2));
        let speed = slip.norm().max(f64::MIN_POSITIVE);
        let rate = slip_change.dot(&slip) / speed;
        let after = self.carrier(run, support).derivative(&run.y.head());
        let change = |column: Column| -rigid.slip(&n, &part(&column, 1), &part(&column, 2)).dot(&slip) / (speed * rate);
        run.shift_columns(run.y.0.map(change), before, &after);
        // what is left of the slip is taken away by a sticking contact
        for values in &mut run.y.0 {
            let left = rigid.slip(&n, &part(values, 1), &part(values, 2));
            let impulse = -left / rigid.mobility();
            let spin = rigid.spin_change(&n, &impulse);
            for axis in 0..3 {
                values[3 + axis] += impulse[axis];
                values[6 + axis] += spin[axis];
            }
        }
    }
}
