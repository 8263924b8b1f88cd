//! How many clips a score looks at, and what it forecasts.

use nalgebra::{Point3, Vector3};

use super::super::score::{clips_with, fitted};
use crate::testing::root;
use gravisight_clips::Clips;
use gravisight_physics::{Forecaster, Scene};

#[test]
fn however_many_frames_are_asked_for_no_more_than_all_clips_are_scored() {
    let clips = Clips::read(&root().join("tests/samples")).unwrap().clips;
    assert_eq!(clips.len(), 2);
    // Twice the third is the first number that a `usize` does not hold.
    for (frames, expected) in [(1, 1), (usize::MAX, 2), (usize::MAX / 2 + 1, 2)] {
        assert_eq!(clips_with(frames, &clips), expected, "{frames}");
    }
}

/// A ball whose spin is nearly gone after a second: what the air does to it at the start is not what it does later.
const CURVED: &str = r#"{"gravity": [0, 0, -9.81], "ball": {"radius": 0.02, "mass": 0.0027, "lift_coefficient": 0.6,
    "spin": [0, 0, 300], "spin_decay": 3.0}}"#;

#[test]
fn a_state_fitted_in_the_middle_of_a_flight_has_the_spin_of_then() {
    let forecaster = Forecaster::new(&Scene::from_json(CURVED, "scene").unwrap()).unwrap();
    let start = forecaster.scene().start(Point3::new(0.0, 0.0, 1.0), Vector3::new(8.0, 0.0, 3.0));
    let middle = 1.0;
    let off: Vec<f64> = (-5..=5).map(|frame| f64::from(frame) / 60.0).collect();
    let times: Vec<f64> = off.iter().map(|by| middle + by).chain([middle + 0.25]).collect();
    let truth = forecaster.forecast(&start, &times).states;
    let points: Vec<_> = off.iter().zip(&truth).map(|(&time, state)| (time, state.position)).collect();
    let error = |since_start: f64| {
        let state = fitted(&forecaster, &points, since_start).unwrap();
        (forecaster.forecast(&state, &[0.25]).states[0].position - truth[11].position).norm()
    };
    println!("{:.1e} m; with the spin of the start {:.1e} m", error(middle), error(0.0));
    assert!(error(middle) < 1e-5 && error(0.0) > 0.02);
}
