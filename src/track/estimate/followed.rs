//! A trajectory through the contacts that it leads into, as their law has it.

use super::model::Model;
use super::trajectory::{Begin, Segment, Trajectory};
use crate::physics::{column, part};

/// Contacts that a flight is followed through at once, and the step of looking for them, s.
const FOLLOWED: usize = 3;
const LOOK: f64 = 0.01;
/// Least time between two contacts, s.
const APART: f64 = 1e-4;

impl Model<'_> {
    /// The trajectory through the contacts that its last segment leads into; none where there are none.
    pub fn followed(&self, trajectory: &Trajectory) -> Option<Trajectory> {
        let mut out = trajectory.clone();
        let end = out.times[out.last];
        for _ in 0..FOLLOWED {
            let last = *out.segments.last()?;
            let state = |time: f64| {
                let mut flight = self.forecaster.flight(&last.state, &out.log_scales, false);
                flight.advance(time - last.time);
                flight.state
            };
            let touched = |time: f64| {
                let state = state(time);
                let (at, velocity) = (part(&state, 0), part(&state, 1));
                let touches = |index: &usize| {
                    let near = self.obstacles[*index].nearest(&at);
                    near.distance < self.rigid.radius && near.normal.dot(&velocity) < 0.0
                };
                (0..self.obstacles.len()).find(touches)
            };
            let steps = ((end - last.time) / LOOK).ceil() as usize;
            let time = |step: usize| (last.time + LOOK * step as f64).min(end);
            let Some(step) = (1..=steps).find(|&step| touched(time(step)).is_some()) else { break };
            let (mut outside, mut inside) = (time(step - 1), time(step));
            let obstacle = touched(inside)?;
            for _ in 0..20 {
                let middle = (outside + inside) / 2.0;
                if touched(middle) == Some(obstacle) { inside = middle } else { outside = middle }
            }
            let at = state(inside);
            let [r, v, w] = [0, 1, 2].map(|index| part(&at, index));
            let normal = self.obstacles[obstacle].nearest(&r).normal;
            if normal.dot(&v) >= 0.0 || inside > end - APART || inside < last.time + APART {
                break;
            }
            let (v, w) = self.rigid.rebound(&normal, &v, &w);
            out.segments.push(Segment { begin: Begin::Bounce(obstacle), time: inside, state: column(r, v, w) });
        }
        (out.segments.len() > trajectory.segments.len()).then_some(out)
    }
}
