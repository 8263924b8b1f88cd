//! The part of a run in which obstacles carry the ball: resting, sliding, rolling (`bounce`).

use nalgebra::Vector3;

use super::arc::{STILL, first_contact};
use super::columns::{Column, Columns, part};
use super::engine::{Engine, Phase, crossing, rest_speed};
use super::field::Flow as _;
use super::integrate::Step;
use super::obstacle::{Nearest, Shape, into_box, out_of_box};
use super::rest::{Carried, ROLLING_SLIP, Support, free_directions, normal_reaction};

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

impl<const M: usize> Engine<'_, M> {
    pub(super) fn carrier<'s>(&'s self, support: &'s Support) -> Carried<'s> {
        Carried { field: self.field, obstacles: self.obstacles, support, rigid: self.rigid }
    }

    /// What carries the ball now: the surfaces it touches, does not leave and is pressed on.
    pub(super) fn support(&self) -> Option<Support> {
        let (r, v) = (self.y.position(), self.y.velocity());
        let mut a = part(&self.field.derivative(&self.head()).0[0], 1);
        let mut touching: Vec<_> = self
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
    fn flush(&self, support: &Support) -> Vec<usize> {
        let r = self.y.position();
        let near: Vec<_> = support.contacts.iter().map(|&index| self.obstacles[index].nearest(&r).normal).collect();
        let lies_flush = |index: &usize| {
            let other = self.obstacles[*index].nearest(&r);
            let touches = other.distance - self.rigid.radius <= CARRIED_GAP;
            support.contacts.contains(index) || (touches && near.iter().any(|n| n.dot(&other.normal) > PARALLEL))
        };
        (0..self.obstacles.len()).filter(lies_flush).collect()
    }

    pub(super) fn carried(&mut self, before: Support) -> Phase {
        let Some(mut support) = self.support() else { return Phase::Flight };
        if self.backwards && self.irreversible.is_none() {
            self.irreversible = Some(self.t);
        }
        self.y = self.carrier(&support).project(&self.y);
        let slip = self.carrier(&support).slip(&self.y.position(), &self.y.velocity(), &self.y.spin());
        let kept = before.rolling && before.contacts == support.contacts;
        let limit = if kept { KEPT_SLIP } else { ROLLING_SLIP };
        support.rolling = slip.is_some_and(|slip| slip.norm() <= limit);
        let (field, obstacles, rigid) = (self.field, self.obstacles, self.rigid);
        let now = support.clone();
        let carrier = Carried { field, obstacles, support: &now, rigid };
        // A sphere whose grip does not suffice begins to slip; its friction has no direction before it does.
        let lacking = if support.rolling { carrier.lacking_grip(&self.y.0[0]) } else { -1.0 };
        let slips = lacking > 0.0;
        let longest =
            if slips { FIRST_SLIP.max(2.0 * KEPT_SLIP / (lacking * rigid.mobility())) } else { f64::INFINITY };
        let Some(step) = self.trial(&carrier, longest) else {
            self.stuck();
            return Phase::Carried(support);
        };
        let (end, event) = self.first_event(&carrier, &step, slip.filter(|_| !support.rolling), slips);
        let a = part(&carrier.derivative(&self.head()).0[0], 1);
        let path = |t: f64| step.state_at(t);
        let (skip, bound) = (self.flush(&support), step.acceleration_bound());
        let hit = first_contact(self.obstacles, &skip, self.rigid.radius, path, &a, bound, step.h * end);
        if let Some((time, obstacle)) = hit {
            if time > 0.0 {
                let theta = time / step.h;
                let step = self.shortened(&carrier, step, theta);
                self.commit(&step);
            }
            // what lies flush with the support is rolled onto, not hit
            let rolled_onto = self.flush(&support).contains(&obstacle);
            return if rolled_onto { Phase::Carried(support) } else { self.touch(obstacle) };
        }
        let short = self.shortened(&carrier, step, end);
        let slope_before = carrier.derivative(&Columns::<1>([short.end.0[0]]));
        self.commit(&short);
        match event {
            Some(Event::Rolls) => self.start_rolling(&mut support, &slope_before),
            Some(Event::Rim) => self.pass_edge(&support, &slope_before),
            Some(Event::Slips) | None => {}
        }
        Phase::Carried(support)
    }

    /// Where in a step on a support the motion changes first, if it does: share of the step, and how.
    fn first_event(
        &self,
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
        match self.leaves_face(carrier.support, step) {
            Some(theta) if theta < first.0 => (theta, Some(Event::Rim)),
            _ => first,
        }
    }

    /// Where within the step the sphere's centre passes the rim of the face that carries it.
    fn leaves_face(&self, support: &Support, step: &Step<M>) -> Option<f64> {
        let [index] = support.contacts.as_slice() else { return None };
        let Shape::Cuboid { centre, half, cos, sin } = &self.obstacles[*index].shape else { return None };
        let beyond = |y: &Column| into_box(part(y, 0) - centre, *cos, *sin).abs() - half;
        let (before, after) = (beyond(&step.start), beyond(&step.end.0[0]));
        let passed = (0..3).filter(|&axis| before[axis] < 0.0 && after[axis] > 0.0);
        let times = passed.map(|axis| crossing(|theta| beyond(&step.at(theta))[axis], true));
        times.min_by(f64::total_cmp)
    }

    /// The forces jump where a face ends in an edge: columns meet the rim at other times.
    fn pass_edge(&mut self, support: &Support, before: &Columns<1>) {
        let Some(&index) = support.contacts.first() else { return };
        let Shape::Cuboid { centre, half, cos, sin } = &self.obstacles[index].shape else { return };
        let local = into_box(self.y.position() - centre, *cos, *sin);
        // the rim just reached
        let beyond = local.abs() - half;
        let Some(axis) = (0..3).min_by(|&a, &b| beyond[a].abs().total_cmp(&beyond[b].abs())) else { return };
        let mut out = Vector3::zeros();
        out[axis] = local[axis].signum();
        let out = out_of_box(out, *cos, *sin);
        // a hair beyond, where the edge's curvature counts
        let mut ahead = self.y;
        let nudge = out * (beyond[axis].abs() + 1e-12);
        for (value, by) in ahead.0[0].iter_mut().zip(nudge.iter()) {
            *value += by;
        }
        let after = self.carrier(support).derivative(&Columns::<1>([ahead.0[0]]));
        let speed = out.dot(&self.y.velocity());
        if speed > STILL {
            self.shift_columns(self.y.0.map(|column| -out.dot(&part(&column, 0)) / speed), before, &after);
        }
        self.y.0[0] = ahead.0[0];
    }

    /// A slide has ended in rolling.
    fn start_rolling(&mut self, support: &mut Support, before: &Columns<1>) {
        support.rolling = true;
        let near = self.obstacles[support.contacts[0]].nearest(&self.y.position());
        let (n, rigid) = (near.normal, self.rigid);
        let slip = rigid.slip(&n, &self.y.velocity(), &self.y.spin());
        let slip_change = rigid.slip(&n, &part(&before.0[0], 1), &part(&before.0[0], 2));
        let speed = slip.norm().max(f64::MIN_POSITIVE);
        let rate = slip_change.dot(&slip) / speed;
        let after = self.carrier(support).derivative(&self.head());
        let change = |column: Column| -rigid.slip(&n, &part(&column, 1), &part(&column, 2)).dot(&slip) / (speed * rate);
        self.shift_columns(self.y.0.map(change), before, &after);
        // what is left of the slip is taken away by a sticking contact
        for values in &mut self.y.0 {
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
