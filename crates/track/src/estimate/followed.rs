//! A trajectory through the contacts that it leads into, as their law has it.

use super::model::Model;
use super::trajectory::{Begin, Segment, Trajectory};
use gravisight_physics::{column, part};

/// Contacts that a flight is followed through at once by the search, and at most.
const FOLLOWED: usize = 3;
const MOST_FOLLOWED: usize = 40;
/// Least time between two contacts, s.
const APART: f64 = 1e-4;

impl Model<'_> {
    /// The trajectory through the first contacts that its last segment leads into; none where there are none.
    pub fn followed(&self, trajectory: &Trajectory) -> Option<Trajectory> {
        let out = self.through_contacts(trajectory, trajectory.times[trajectory.last], FOLLOWED);
        (out.segments.len() > trajectory.segments.len()).then_some(out)
    }

    /// The trajectory through all contacts that its last segment leads into up to the track's last frame: what is not seen any more bounces
    /// as the law has it. Its frames stay those that it was found on.
    pub(super) fn followed_on(&self, trajectory: &Trajectory) -> Trajectory {
        let end = trajectory.times[trajectory.times.len() - 1];
        self.through_contacts(trajectory, end, MOST_FOLLOWED)
    }

    fn through_contacts(&self, trajectory: &Trajectory, end: f64, most: usize) -> Trajectory {
        let mut out = trajectory.clone();
        for _ in 0..most {
            let Some(last) = out.segments.last().copied() else { break };
            let mut flight = self.forecaster.flight(&last.state, &out.log_scales, false);
            let touched = flight.advance_to_contact(&self.obstacles, self.rigid.radius, end - last.time);
            let Some((elapsed, obstacle)) = touched else { break };
            let time = last.time + elapsed;
            let [r, v, w] = [0, 1, 2].map(|index| part(&flight.state, index));
            let normal = self.obstacles[obstacle].nearest(&r).normal;
            if normal.dot(&v) >= 0.0 || time > end - APART || time < last.time + APART {
                break;
            }
            let (v, w) = self.rigid.rebound(&normal, &v, &w);
            out.segments.push(Segment { begin: Begin::Bounce(obstacle), time, state: column(r, v, w) });
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use nalgebra::Vector3;

    use super::*;
    use crate::config::EstimatorConfig;
    use crate::estimate::observation::RayObservation;
    use gravisight_physics::{FORCES, Forecaster, Scene, State};

    #[test]
    fn a_fast_ball_bounces_off_a_thin_board() {
        // 2 cm, through which the ball would fly in 2 ms.
        let scene = r#"{"gravity": [0, 0, -9.81], "ball": {"radius": 0.02},
            "boxes": [{"position": [0, 2.013, 1], "half_size": [2, 0.01, 2]}],
            "contact": {"model": "bounce", "restitution": 0.8}}"#;
        let forecaster = Forecaster::new(&Scene::from_json(scene, "scene").unwrap()).unwrap();
        let times = [0.0, 0.2];
        let observations = times.map(|time| RayObservation { time, ray: None, log_distance: None });
        let model = Model::new(&forecaster, &observations, [1e6, 1.0, 1.0], None, EstimatorConfig::default());
        let (position, velocity) = (Vector3::new(0.1, 0.0, 1.0), Vector3::new(0.0, 30.0, 1.0));
        let state = column(position, velocity, Vector3::zeros());
        let trajectory = Trajectory {
            segments: vec![Segment { begin: Begin::Start, time: 0.0, state }],
            log_scales: [0.0; FORCES],
            log_size: 0.0,
            noise: 1.0,
            first: 0,
            last: 1,
            times: Arc::new(times.to_vec()),
        };
        let followed = model.followed(&trajectory).unwrap();
        let start = State { position: position.into(), velocity, spin: Vector3::zeros() };
        let impacts = forecaster.forecast(&start, &times).impacts;
        assert_eq!((followed.segments.len(), impacts.len()), (2, 1));
        let touched = followed.segments[1];
        assert!((touched.time - impacts[0].time).abs() < 1e-7, "{} s, {} s", touched.time, impacts[0].time);
        assert!((touched.position() - impacts[0].world.coords).norm() < 1e-6);
    }
}
