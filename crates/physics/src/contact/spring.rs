//! The `spring` contact model: a sphere pushed out along the contact normal by `stiffness` times its penetration.

use nalgebra::{Matrix3, Vector3};

use crate::columns::{Columns, part};
use crate::force::{Forces, Partials};
use crate::motion::approach::{TOUCH, first_contact};
use crate::motion::closed_form::{ClosedForm, Press};
use crate::motion::integrate::Flow;
use crate::motion::run::{Depth, Model, Run, crossing};
use crate::obstacle::{Obstacle, Shape, into_box};
use crate::scene::Scene;

/// Time by which a ball that presses on is let pass a face's rim, s.
const EDGE_HAIR: f64 = 1e-12;
/// Share of the radius by which a ball may be squashed.
const SQUASHED: f64 = 0.5;
/// Gap below which a ball touches, m.
const TOUCHING: f64 = 1e-9;

#[derive(Debug, Clone)]
pub(crate) struct Elastic {
    /// Per unit mass, 1/s².
    stiffness: f64,
    radius: f64,
}

/// The forces, and the obstacles that the sphere presses on.
///
/// Which ones is fixed for the length of a contact, so that forces are smooth within it.
struct Pressing<'a> {
    forces: &'a Forces,
    ball: &'a Elastic,
    obstacles: &'a [Obstacle],
    /// One flag an obstacle.
    active: &'a [bool],
}

impl Flow for Pressing<'_> {
    fn spins(&self) -> bool {
        self.forces.spins()
    }

    #[inline]
    fn derivative_into<const M: usize>(&self, y: &Columns<M>, out: &mut Columns<M>) {
        let stiffness = self.ball.stiffness;
        let press = |r: &Vector3<f64>, mut partials: Option<&mut Partials>| {
            let mut a = Vector3::zeros();
            for (obstacle, _) in self.obstacles.iter().zip(self.active).filter(|(_, active)| **active) {
                let near = obstacle.nearest(r);
                let depth = self.ball.radius - near.distance;
                a += stiffness * depth * near.normal;
                if let Some(partials) = &mut partials {
                    partials.position += stiffness * (near.curvature * depth - near.normal * near.normal.transpose());
                }
            }
            a
        };
        self.forces.slope(y, press, out);
    }
}

/// Which obstacles the sphere presses on, if any.
type Pressed = Option<Vec<bool>>;

impl Model for Elastic {
    type Phase = Pressed;

    fn reversed(self) -> Self {
        self
    }

    /// Ordinary: squashed by up to half the radius. Deeper ones go to touching.
    fn depth(&self, _: &Obstacle) -> Depth {
        Depth { lowest: self.radius * (1.0 - SQUASHED), target: self.radius, touching: self.radius }
    }

    fn reach(&self) -> f64 {
        self.radius + TOUCHING
    }

    fn potential_energy(&self, obstacles: &[Obstacle], r: &Vector3<f64>) -> f64 {
        let depth = |obstacle: &Obstacle| (self.radius - obstacle.distance(r)).max(0.0);
        obstacles.iter().map(|obstacle| 0.5 * self.stiffness * depth(obstacle).powi(2)).sum()
    }

    fn first<const M: usize>(&self, run: &Run<M>) -> Pressed {
        let r = run.y.position();
        some_of(run.obstacles.iter().map(|obstacle| obstacle.distance(&r) < self.radius - TOUCH).collect())
    }

    fn advance<const M: usize>(&self, run: &mut Run<M>, pressed: Pressed) -> Pressed {
        let Some(active) = pressed else {
            let touched = run.fly(self.radius)?;
            run.record(touched);
            return Some((0..run.obstacles.len()).map(|index| index == touched).collect());
        };
        match self.pressed_on_face(run, &active) {
            Some(pressed) => pressed,
            None => self.pressed(run, active),
        }
    }
}

impl Elastic {
    pub fn new(scene: &Scene, stiffness: f64) -> Self {
        Self { stiffness, radius: scene.ball.radius }
    }

    /// A soft ball on one face, in closed form; `None` where there is none, or it may leave the face's region.
    fn pressed_on_face<const M: usize>(&self, run: &mut Run<M>, active: &[bool]) -> Option<Pressed> {
        let linear = run.closed_form()?;
        let mut pressed = (0..active.len()).filter(|&index| active[index]);
        let (index, None) = (pressed.next()?, pressed.next()) else { return None };
        let (obstacle, r) = (&run.obstacles[index], run.y.position());
        let near = obstacle.nearest(&r);
        if near.curvature != Matrix3::zeros() {
            return None;
        }
        let level = near.normal.dot(&r) - near.distance + self.radius;
        let press = Press { normal: near.normal, stiffness: self.stiffness, level };
        let arc = ClosedForm { linear, spin_decay: run.forces.spin_decay(), press: Some(press) };
        let head = run.y.head();
        let (release, depth) = arc.release(&head, &press);
        if depth >= self.radius {
            return None; // the centre enters, where another face may be nearer
        }
        let mut duration = release.min(run.time_left());
        if let Shape::Cuboid { centre, half, turn } = &obstacle.shape {
            let beyond = |t: f64| into_box(arc.at(&head, t).position() - centre, turn).abs() - half;
            let (before, after) = (beyond(0.0), beyond(duration));
            for axis in (0..3).filter(|&axis| before[axis] < 0.0 && after[axis] > 0.0) {
                duration = duration.min(duration * crossing(|theta| beyond(duration * theta)[axis], true));
            }
        }
        let released = duration == release;
        let mut active = active.to_vec();
        let reached = run.follow(&arc, &[index], self.radius, duration);
        if let Some(other) = reached.obstacle {
            active[other] = true;
            run.record(other);
        } else if reached.time < duration {
            // not there yet
        } else if released {
            return Some(None);
        } else {
            // on over the rim: a hair beyond it, so that the edge is what is nearest
            run.y = arc.at(&run.y, EDGE_HAIR);
            run.t += EDGE_HAIR;
            run.emit();
        }
        Some(Some(active))
    }

    /// Pressing on `active` obstacles, by steps.
    fn pressed<const M: usize>(&self, run: &mut Run<M>, mut active: Vec<bool>) -> Pressed {
        let now = active.clone();
        let pressing = Pressing { forces: run.forces, ball: self, obstacles: run.obstacles, active: &now };
        let Some(step) = run.trial(&pressing, f64::INFINITY) else { return Some(active) };
        let pressed: Vec<usize> = (0..active.len()).filter(|&index| active[index]).collect();
        let reached = first_contact(run.obstacles, &pressed, self.radius, &step, step.h);
        let (mut until, mut changed) = (reached.time / step.h, reached.obstacle);
        let end = step.end.position();
        for &index in pressed.iter().filter(|&&index| run.obstacles[index].distance(&end) >= self.radius) {
            let gap = |theta: f64| run.obstacles[index].distance(&part(&step.at(theta), 0)) - self.radius;
            let theta = crossing(gap, true);
            if theta < until || changed.is_none() && theta <= until {
                (until, changed) = (theta, Some(index));
            }
        }
        if until >= 1.0 && changed.is_none() {
            run.commit(&step);
            run.slope = Some(step.last);
            return Some(active);
        }
        run.commit_until(&pressing, step, until);
        if let Some(index) = changed {
            active[index] = !active[index];
            if active[index] {
                run.record(index);
            }
        }
        some_of(active)
    }
}

fn some_of(active: Vec<bool>) -> Pressed {
    active.contains(&true).then_some(active)
}
