//! The part of a run in which a soft ball presses on obstacles (`spring`).

use nalgebra::Matrix3;

use super::arc::{Arc, Press, first_contact};
use super::columns::part;
use super::engine::{Engine, Phase, crossing};
use super::field::{Flow as _, Pressing};
use super::obstacle::{Shape, into_box};
use super::scene::Contact;

/// Time by which a ball that presses on is let pass a face's rim, s.
const EDGE_HAIR: f64 = 1e-12;

impl<const M: usize> Engine<'_, M> {
    /// A soft ball on one face, in closed form; `None` where there is none, or it may leave the face's region.
    fn pressed_on_face(&mut self, stiffness: f64, active: &[bool]) -> Option<Phase> {
        let linear = self.closed_form()?;
        let mut pressed = (0..active.len()).filter(|&index| active[index]);
        let (index, None) = (pressed.next()?, pressed.next()) else { return None };
        let (obstacle, r, radius) = (&self.obstacles[index], self.y.position(), self.rigid.radius);
        let near = obstacle.nearest(&r);
        if near.curvature != Matrix3::zeros() {
            return None;
        }
        let level = near.normal.dot(&r) - near.distance + radius;
        let press = Press { normal: near.normal, stiffness, level };
        let arc = Arc { linear, spin_decay: self.field.spin_decay(), press: Some(press) };
        let head = self.head();
        let (release, depth) = arc.release(&head, &press);
        if depth >= radius {
            return None; // the centre enters, where another face may be nearer
        }
        let last = self.times.last().map_or(0.0, |last| last - self.t);
        let mut duration = release.min(last);
        if let Shape::Cuboid { centre, half, cos, sin } = &obstacle.shape {
            let beyond = |t: f64| into_box(arc.state_at(&head, t).0 - centre, *cos, *sin).abs() - half;
            let (before, after) = (beyond(0.0), beyond(duration));
            for axis in (0..3).filter(|&axis| before[axis] < 0.0 && after[axis] > 0.0) {
                duration = duration.min(duration * crossing(|theta| beyond(duration * theta)[axis], true));
            }
        }
        let released = duration == release;
        let mut active = active.to_vec();
        if let Some(other) = self.follow(&arc, &[index], radius, duration) {
            active[other] = true;
            self.record(other);
        } else if released {
            active[index] = false;
            return Some(Phase::Flight);
        } else {
            // on over the rim: a hair beyond it, so that the edge is what is nearest
            self.y = arc.at(&self.y, EDGE_HAIR);
            self.t += EDGE_HAIR;
            self.emit();
        }
        Some(Phase::Pressed(active))
    }

    /// Pressing on `active` obstacles, by steps.
    pub(super) fn pressed(&mut self, mut active: Vec<bool>) -> Phase {
        let Contact::Spring { stiffness } = *self.contact else { return Phase::Flight };
        if let Some(phase) = self.pressed_on_face(stiffness, &active) {
            return phase;
        }
        let now = active.clone();
        let pressing = Pressing { field: self.field, active: &now, stiffness };
        let Some(step) = self.trial(&pressing, f64::INFINITY) else {
            self.stuck();
            return Phase::Pressed(active);
        };
        let radius = self.rigid.radius;
        let pressed: Vec<usize> = (0..active.len()).filter(|&index| active[index]).collect();
        let path = |t: f64| step.state_at(t);
        let a = part(&pressing.derivative(&self.head()).0[0], 1);
        let hit = first_contact(self.obstacles, &pressed, radius, path, &a, step.acceleration_bound(), step.h);
        let mut first = hit.map(|(time, index)| (time / step.h, index));
        let end = step.end.position();
        for &index in pressed.iter().filter(|&&index| self.obstacles[index].distance(&end) >= radius) {
            let gap = |theta: f64| self.obstacles[index].distance(&part(&step.at(theta), 0)) - radius;
            let theta = crossing(gap, true);
            if first.is_none_or(|(earliest, _)| theta < earliest) {
                first = Some((theta, index));
            }
        }
        let Some((theta, index)) = first else {
            self.commit(&step);
            self.slope = Some(step.last);
            return Phase::Pressed(active);
        };
        if theta > 0.0 {
            let step = self.shortened(&pressing, step, theta);
            self.commit(&step);
        }
        active[index] = !active[index];
        if active[index] {
            self.record(index);
        }
        if active.contains(&true) { Phase::Pressed(active) } else { Phase::Flight }
    }
}
