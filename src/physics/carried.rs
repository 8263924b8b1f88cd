//! The part of a run in which obstacles carry the ball: resting, sliding, rolling (`bounce`).

use nalgebra::Vector3;

use super::arc::{STILL, first_contact};
use super::columns::{Column, Columns, part};
use super::engine::{Engine, Phase, REST_SPEED, crossing};
use super::field::Flow as _;
use super::integrate::Step;
use super::obstacle::{Shape, into_box, out_of_box};
use super::rest::{Carried, Support, free_directions, normal_reaction};

/// Where a slide is stopped, as a share of the way to its end: at the end itself its direction is lost.
const SLIDE_END: f64 = 1.0 - 1e-7;
/// Gap within which a carried ball touches, m.
const CARRIED_GAP: f64 = 1e-8;

impl<const M: usize> Engine<'_, M> {
    pub(super) fn carrier<'s>(&'s self, support: &'s Support) -> Carried<'s> {
        Carried { field: self.field, obstacles: self.obstacles, support, rigid: self.rigid }
    }

    /// What carries the ball now: the surfaces it touches, does not leave and is pressed on.
    pub(super) fn support(&self) -> Option<Support> {
        let (r, v) = (self.y.position(), self.y.velocity());
        let touching: Vec<_> = self
            .obstacles
            .iter()
            .enumerate()
            .filter(|(_, obstacle)| obstacle.distance(&r) - self.rigid.radius <= CARRIED_GAP)
            .map(|(index, obstacle)| (index, obstacle.nearest(&r)))
            .filter(|(_, near)| near.normal.dot(&v).abs() <= REST_SPEED)
            .collect();
        if touching.is_empty() {
            return None;
        }
        let mut a = part(&self.field.derivative(&self.head()).0[0], 1);
        let mut normals: Vec<Vector3<f64>> = Vec::new();
        let mut contacts = Vec::new();
        while let Some((index, near)) = touching
            .iter()
            .filter(|(index, _)| !contacts.contains(index))
            .find(|(_, near)| normal_reaction(near, &a, &v) > STILL && contacts.len() < 3)
        {
            contacts.push(*index);
            normals.push(near.normal);
            a = free_directions(&normals) * a;
        }
        (!contacts.is_empty()).then_some(Support { contacts, rolling: false })
    }

    pub(super) fn carried(&mut self, before: Support) -> Phase {
        let Some(mut support) = self.support() else { return Phase::Flight };
        if self.backwards && self.irreversible.is_none() {
            self.irreversible = Some(self.t);
        }
        self.y = self.carrier(&support).project(&self.y);
        let slip = self.carrier(&support).slip(&self.y.position(), &self.y.velocity(), &self.y.spin());
        let kept = before.rolling && before.contacts == support.contacts;
        support.rolling = kept || self.carrier(&support).rolls(&self.y);
        let (field, obstacles, rigid) = (self.field, self.obstacles, self.rigid);
        let now = support.clone();
        let carrier = Carried { field, obstacles, support: &now, rigid };
        let Some(step) = self.trial(&carrier, f64::INFINITY) else {
            self.stuck();
            return Phase::Carried(support);
        };
        let slides = slip.filter(|_| !support.rolling);
        let mut end = 1.0_f64;
        let mut stops = false;
        if let Some(slip) = slides {
            let along = |y: &Column| {
                let now = carrier.slip(&part(y, 0), &part(y, 1), &part(y, 2));
                now.map_or(0.0, |now| now.dot(&slip))
            };
            if along(&step.end.0[0]) <= 0.0 {
                end = crossing(|theta| along(&step.at(theta)), false) * SLIDE_END;
                stops = true;
            }
        }
        if let Some(theta) = self.leaves_face(&support, &step).filter(|&theta| theta < end) {
            (end, stops) = (theta, false);
        }
        let a = part(&carrier.derivative(&self.head()).0[0], 1);
        let path = |t: f64| {
            let y = step.at(t / step.h);
            (part(&y, 0), part(&y, 1))
        };
        let (skip, bound) = (&support.contacts, step.acceleration_bound());
        let hit = first_contact(self.obstacles, skip, self.rigid.radius, path, &a, bound, step.h * end);
        if let Some((time, obstacle)) = hit {
            if time > 0.0 {
                let theta = time / step.h;
                let step = self.shortened(&carrier, step, theta);
                self.commit(&step);
            }
            return self.touch(obstacle);
        }
        let short = self.shortened(&carrier, step, end);
        let slope_before = carrier.derivative(&Columns::<1>([short.end.0[0]]));
        self.commit(&short);
        if stops {
            self.start_rolling(&mut support, &slope_before);
        } else if end < 1.0 {
            self.pass_edge(&support, &slope_before);
        }
        Phase::Carried(support)
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
