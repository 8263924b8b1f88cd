//! Boxes in any orientation.

use nalgebra::{Point3, Rotation3, UnitQuaternion, Vector3};
use proptest::prelude::*;

use super::scenes::{ELASTIC, SOFT, forecaster, scene, tight};
use crate::scene::Rotation;
use crate::{Case, Contact, Cuboid, State};

fn matrix(turn: &Rotation3<f64>) -> Rotation {
    Rotation::Matrix(std::array::from_fn(|row| std::array::from_fn(|column| turn[(row, column)])))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// A world that is turned as a whole, gravity and all, is the same world.
    #[test]
    fn a_turned_world_is_the_same_world(
        axis in prop::array::uniform3(-3.0..3.0_f64),
        yaw in 0.0..6.0_f64,
        from in prop::array::uniform2(-0.3..0.3_f64),
        velocity in prop::array::uniform3(-1.0..1.0_f64),
        contact in prop::sample::select(vec![ELASTIC, SOFT, Contact::bounce(0.7, 0.3), Contact::Penalty { c: 1000.0, beta: 200.0, beta_box: 66.0 }]),
        quaternion in any::<bool>(),
    ) {
        let turn = Rotation3::from_scaled_axis(Vector3::from(axis));
        let mut upright = scene(contact, 9.81, 0.05);
        upright.floor = None;
        upright.boxes = vec![Cuboid::upright([0.1, 0.0, -0.2], [0.8, 0.6, 0.2], yaw)];
        let mut turned = upright.clone();
        turned.gravity = (turn * Vector3::from(upright.gravity)).into();
        let whole = turn * Rotation3::from_axis_angle(&Vector3::z_axis(), yaw);
        let rotation = match quaternion {
            true => {
                let q = UnitQuaternion::from_rotation_matrix(&whole);
                Rotation::Quaternion([2.0 * q.w, 2.0 * q.i, 2.0 * q.j, 2.0 * q.k])
            }
            false => matrix(&whole),
        };
        let position = (turn * Vector3::from(upright.boxes[0].position)).into();
        turned.boxes = vec![Cuboid { position, yaw: 0.0, rotation: Some(rotation), ..upright.boxes[0].clone() }];
        let start = State { position: Point3::new(from[0], from[1], 0.5), velocity: velocity.into(), spin: Vector3::new(3.0, -5.0, 8.0) };
        let there = State { position: turn * start.position, velocity: turn * start.velocity, spin: turn * start.spin };
        let times: Vec<f64> = (1..=8).map(|step| 0.06 * f64::from(step)).collect();
        let expected = forecaster(&upright, tight()).forecast(&start, &times);
        let found = forecaster(&turned, tight()).forecast(&there, &times);
        prop_assert_eq!(found.states.len(), expected.states.len());
        for (found, expected) in found.states.iter().zip(&expected.states) {
            prop_assert!((found.position - turn * expected.position).norm() < 1e-6, "{:?} {:?}", found, expected);
            prop_assert!((found.spin - turn * expected.spin).norm() < 1e-4);
        }
    }
}

#[test]
fn reference_cases_may_hold_tilted_blocks() {
    // A block lying on its side is an upright one with other sides: the axes of r_o = R·(r − p) are x, z, −y.
    let case = |block: &str| {
        let text = format!(
            r#"{{"cases": [{{"name": "block", "r0": [0.05, 0.3, 1.0], "v0": [0, 0, -1], "times": [0.1, 0.2, 0.3, 0.4],
                "system": {{"g": 9.81, "c": 1000, "beta": 200, "beta_o": 66, "floor": false, "wall_x": null, "wall_y": null,
                "obstacles": [{block}], "spring": null}}}}]}}"#
        );
        Case::all_from_json(&text, "cases").map(|mut cases| cases.remove(0))
    };
    let upright =
        case(r#"{"l": 0.4, "w": 0.3, "h": 0.5, "R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "p": [0, 0.25, 0]}"#).unwrap();
    let lying =
        case(r#"{"l": 0.4, "w": 0.25, "h": 0.6, "R": [[1, 0, 0], [0, 0, 1], [0, -1, 0]], "p": [0, 0.55, 0.25]}"#)
            .unwrap();
    let states = |case: &Case| forecaster(&case.scene, tight()).forecast(&case.start, &case.times).states;
    let (upright, lying) = (states(&upright), states(&lying));
    assert_eq!(upright.len(), 4);
    for (a, b) in upright.iter().zip(&lying) {
        assert!((a.position - b.position).norm() < 1e-9, "{a:?} {b:?}");
    }
    let crooked = case(r#"{"l": 1, "w": 1, "h": 1, "R": [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]], "p": [0, 0, 0]}"#);
    let message = crooked.unwrap_err().to_string();
    assert!(message.contains("boxes[0].rotation"), "{message}");
}
