//! What no ball does: starts inside walls, lost balls, scenes that cannot be, random numbers.

use super::scenes::{ELASTIC, SOFT, forecaster, scene, state, tight};
use crate::{Contact, Cuboid, Floor, Forecast, ForecastOptions, Forecaster, Scene, Spring, State, Status, Wall};
use nalgebra::Matrix6;
use proptest::prelude::*;

#[test]
fn ordinary_scenes_never_run_into_the_step_limit() {
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let small = || prop::array::uniform3(-2.0..2.0_f64);
    let cuboid = (small(), prop::array::uniform3(0.1..1.0_f64), -3.0..3.0_f64)
        .prop_map(|(position, half_size, yaw)| Cuboid::upright(position, half_size, yaw));
    let contact = prop_oneof![
        (100.0..2000.0_f64, 20.0..200.0_f64).prop_map(|(c, beta)| Contact::Penalty { c, beta, beta_box: beta }),
        (500.0..5000.0_f64).prop_map(|stiffness| Contact::Spring { stiffness }),
        (0.0..=1.0_f64, 0.0..1.0_f64).prop_map(|(restitution, friction)| Contact::bounce(restitution, friction)),
    ];
    let tether = prop::option::of((0.5..20.0_f64, small()));
    let strategy =
        (contact, prop::collection::vec(cuboid, 0..4), tether, 0.0..10.0_f64, small(), small(), 0.0..300.0_f64);
    for _ in 0..2000 {
        use proptest::strategy::ValueTree as _;
        let (contact, boxes, spring, gravity, r, v, offset) = strategy.new_tree(&mut runner).unwrap().current();
        let mut room = scene(contact, gravity, 0.15);
        (room.boxes, room.floor) = (boxes, Some(Floor { height: -2.0 }));
        room.spring = spring.map(|(stiffness, anchor)| Spring { stiffness, anchor });
        // far from the origin rounding is coarser
        for cuboid in &mut room.boxes {
            cuboid.position[0] += offset;
        }
        if let Some(spring) = &mut room.spring {
            spring.anchor[0] += offset;
        }
        let start = state([r[0] + offset, r[1], r[2]], v);
        let forecast = forecaster(&room, ForecastOptions { step_limit: 20_000, ..ForecastOptions::default() })
            .forecast(&start, &[1.0, 3.0]);
        assert!(!matches!(forecast.status, Status::StepLimit { .. }), "{:?} {room:?} {start:?}", forecast.status);
    }
}

#[test]
fn a_start_inside_a_soft_wall_is_not_launched() {
    let paper = Contact::Penalty { c: 1000.0, beta: 200.0, beta_box: 66.0 };
    for contact in [paper, SOFT, ELASTIC] {
        let mut room = scene(contact.clone(), 1.0, 0.2);
        room.boxes = vec![Cuboid::upright([2.0, 0.0, 0.5], [0.6, 0.6, 0.5], 0.5)];
        let forecaster = forecaster(&room, tight());
        // below the floor, by 5 cm and by 5 m, in a box's middle, at its side, under its edge in the floor
        for r in [[0.0, 0.0, -0.05], [0.3, 0.0, -5.0], [2.0, 0.0, 0.5], [1.6, 0.0, 0.4], [2.3, 0.2, -0.3]] {
            let forecast = forecaster.forecast_with_jacobians(&state(r, [0.1, 0.0, 0.0]), &[0.0, 0.25, 0.5, 1.0]);
            assert_eq!(forecast.status, Status::StartInside, "{contact:?} {r:?}");
            let moved = forecast.moved.unwrap();
            assert!(moved.clear && moved.depth > 0.0, "{moved:?}");
            let fastest = forecast.states.iter().map(|state| state.velocity.norm()).fold(0.0, f64::max);
            // falling a box's height under 1 m/s² gives 1.5 m/s
            assert!(fastest < 1.6, "{contact:?} {r:?}: {fastest} m/s");
            let largest = forecast.jacobians.iter().map(Matrix6::amax).fold(0.0, f64::max);
            assert!(largest < 50.0, "{contact:?} {r:?}: {largest}");
        }
    }
    // at an edge's very line the way out turns without bound; the Jacobian does not
    let mut block = scene(ELASTIC, 1.0, 0.2);
    block.boxes = vec![Cuboid::upright([0.0, 0.0, 0.0], [0.5; 3], 0.0)];
    block.floor = None;
    for off in [1e-3, 1e-6, 1e-12] {
        let start = state([0.5 + off, 0.0, 0.5 + off], [0.0; 3]);
        let forecast = forecaster(&block, tight()).forecast_with_jacobians(&start, &[0.0]);
        assert_eq!(forecast.status, Status::StartInside);
        assert!(forecast.jacobians[0].amax() < 2.1, "{off}: {}", forecast.jacobians[0]);
    }
}

#[test]
fn the_guards_jacobian_is_its_derivative() {
    let mut room = scene(SOFT, 1.0, 0.2);
    room.boxes = vec![Cuboid::upright([2.0, 0.0, 0.5], [0.6, 0.6, 0.5], 0.5)];
    let forecaster = forecaster(&room, tight());
    for r in [[0.0, 0.0, -0.3], [2.0, 0.1, 0.8]] {
        let at = |r: [f64; 3]| forecaster.forecast_with_jacobians(&state(r, [0.1, 0.2, 0.0]), &[0.4]);
        let jacobian = at(r).jacobians[0];
        for axis in 0..3 {
            let shifted = |by: f64| {
                let mut r = r;
                r[axis] += by;
                at(r).states[0].position
            };
            let difference = (shifted(1e-6) - shifted(-1e-6)) / 2e-6;
            for row in 0..3 {
                assert!(
                    (difference[row] - jacobian[(row, axis)]).abs() < 1e-6,
                    "{r:?} {axis}\n{jacobian}\n{difference}"
                );
            }
        }
    }
}

#[test]
fn friction_cannot_be_undone_and_the_forecast_says_so() {
    let rough = scene(Contact::bounce(0.8, 0.3), 9.81, 0.1);
    let forecast = forecaster(&rough, tight()).forecast(&state([0.0, 0.0, 0.5], [1.0, 0.0, 3.0]), &[-0.1, -1.0]);
    assert!(
        matches!(forecast.status, Status::Irreversible { time } if (-0.2..-0.1).contains(&time)),
        "{:?}",
        forecast.status
    );
    assert_eq!(forecast.states.len(), 2);
    // without rebound, it may have lain there
    let dead = scene(Contact::bounce(0.0, 0.0), 0.0, 0.1);
    let forecast = forecaster(&dead, tight()).forecast(&state([0.0, 0.0, 0.3], [0.0, 0.0, 1.0]), &[-0.5, -2.0]);
    assert!(!forecast.status.is_exact() && forecast.states.iter().all(|state| state.velocity.norm() <= 1.0));
}

#[test]
fn losing_the_ball_is_a_status() {
    let mut empty = scene(ELASTIC, 9.81, 0.1);
    empty.floor = None;
    let limits = ForecastOptions { region: 100.0, step_limit: 50, ..ForecastOptions::default() };
    let forecast = forecaster(&empty, limits).forecast(&state([0.0; 3], [0.0; 3]), &[1.0, 100.0, 200.0]);
    assert!(
        forecast.status == Status::LeftRegion { time: 100.0 } && forecast.states.len() == 1,
        "{:?}",
        forecast.status
    );
    empty.ball.drag_coefficient = 0.1;
    let forecast = forecaster(&empty, limits).forecast(&state([0.0; 3], [0.0; 3]), &[1.0, 100.0, 200.0]);
    assert!(matches!(forecast.status, Status::StepLimit { .. }), "{:?}", forecast.status);
    assert_eq!(forecast.states.len(), 1);
    assert_eq!(forecast.times, [1.0]);
    let late_first = forecaster(&empty, limits).forecast(&state([0.0; 3], [0.0; 3]), &[200.0, 1.0]);
    assert_eq!((late_first.times.as_slice(), late_first.states.len()), ([1.0].as_slice(), 1));
    let forecast = forecaster(&empty, limits).forecast(&state([f64::NAN, 0.0, 0.0], [0.0; 3]), &[1.0]);
    assert!(matches!(forecast.status, Status::NotFinite { .. }) && forecast.states.is_empty());
}

#[test]
fn scenes_that_cannot_be_are_refused_with_the_field() {
    let refused = |text: &str| Scene::from_json(text, "scene.json").unwrap_err().to_string();
    for (text, words) in [
        (r#"{"gravity": [0, 0, -9.81]}"#, "missing field `ball`"),
        (r#"{"ball": {"radius": 0.1}}"#, "missing field `gravity`"),
        (r#"{"gravity": [0, 0, -9.81], "ball": {"radius": 0.1}, "flor": {"height": 0}}"#, "unknown field `flor`"),
        (r#"{"gravity": [0, 0, -9.81], "ball": {"radius": -0.1}}"#, "`ball.radius` must be greater than zero"),
        (r#"{"gravity": [0, 0, -9.81], "ball": {"radius": 33.5}}"#, "`ball.radius` is 33.5 m, larger than any ball"),
        (
            r#"{"gravity": [0, 0, -9.81], "ball": {"radius": 0.1}, "contact": {"model": "glue"}}"#,
            "unknown variant `glue`",
        ),
        (
            r#"{"gravity": [0, 0, -9.81], "ball": {"radius": 0.1}, "contact": {"model": "bounce", "bounciness": 1}}"#,
            "unknown field `bounciness`",
        ),
        (
            r#"{"gravity": [0, 0, -9.81], "ball": {"radius": 0.1}, "contact": {"model": "bounce", "restitution": 1.5}}"#,
            "`contact.restitution` must be between 0 and 1",
        ),
        (r#"{"gravity": [0, 0, 1e300], "ball": {"radius": 0.1}}"#, "`gravity` must be a number up to"),
        (
            r#"{"gravity": [0, 0, -1], "ball": {"radius": 0.1}, "walls": [{"point": [0,0,0], "normal": [0,0,0]}]}"#,
            "walls[0].normal",
        ),
        (
            r#"{"gravity": [0, 0, -1], "ball": {"radius": 0.1}, "boxes": [{"position": [0,0,0], "half_size": [1,0,1]}]}"#,
            "boxes[0].half_size",
        ),
    ] {
        assert!(refused(text).contains(words), "{}", refused(text));
    }
}

fn any_contact() -> impl Strategy<Value = Contact> {
    prop_oneof![
        (0.0..1e4, 1.0..500.0, 1.0..200.0).prop_map(|(c, beta, beta_box)| Contact::Penalty { c, beta, beta_box }),
        (1.0..1e6).prop_map(|stiffness| Contact::Spring { stiffness }),
        (0.0..=1.0, 0.0..2.0).prop_map(|(restitution, friction)| Contact::bounce(restitution, friction)),
    ]
}

/// Numbers of every size, now and then absurd.
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![8 => -3.0..3.0, 1 => -1e3..1e3, 1 => prop::num::f64::ANY]
}

fn numbers() -> impl Strategy<Value = [f64; 3]> {
    prop::array::uniform3(number())
}

fn any_scene() -> impl Strategy<Value = Scene> {
    let cuboid = (numbers(), prop::array::uniform3(1e-3..3.0), number())
        .prop_map(|(position, half_size, yaw)| Cuboid::upright(position, half_size, yaw));
    let wall = (numbers(), numbers()).prop_map(|(point, normal)| Wall { point, normal });
    let boxes = (prop::collection::vec(cuboid, 0..4), prop::collection::vec(wall, 0..3));
    let forces = (numbers(), prop::option::of((0.0..100.0, numbers())), 0.0..1.0, -1.0..1.0, numbers(), 0.0..2.0);
    (any_contact(), boxes, prop::option::of(number()), forces, 1e-3..1.0).prop_map(
        |(contact, (boxes, walls), floor, (gravity, spring, drag, lift, spin, decay), radius)| {
            let mut out = scene(contact, 1.0, radius);
            (out.boxes, out.walls, out.gravity) = (boxes, walls, gravity);
            out.floor = floor.map(|height| Floor { height });
            out.spring = spring.map(|(stiffness, anchor)| Spring { stiffness, anchor });
            (out.ball.drag_coefficient, out.ball.lift_coefficient) = (drag, lift);
            (out.ball.spin, out.ball.spin_decay) = (spin, decay);
            out
        },
    )
}

fn whole_or_said(forecast: &Forecast, count: usize) -> Result<(), TestCaseError> {
    prop_assert_eq!(forecast.states.len(), forecast.jacobians.len());
    prop_assert!(forecast.states.len() == count || !forecast.status.is_whole(), "{:?}", forecast.status);
    let finite =
        |state: &State| state.position.iter().chain(&state.velocity).chain(&state.spin).all(|value| value.is_finite());
    prop_assert!(
        forecast.states.iter().all(finite) && forecast.jacobians.iter().all(|j| j.iter().all(|v| v.is_finite()))
    );
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 3000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn nothing_panics_or_runs_for_ever(scene in any_scene(), r in numbers(), v in numbers(), times in prop::collection::vec(-2.0..2.0_f64, 1..5)) {
        let Ok(forecaster) = Forecaster::new(&scene) else { return Ok(()) };
        let forecaster = forecaster.with_options(ForecastOptions { step_limit: 2000, ..ForecastOptions::default() }).unwrap();
        let forecast = forecaster.forecast_with_jacobians(&scene.start(r.into(), v.into()), &times);
        prop_assert!(forecast.steps <= 2 * 2001);
        whole_or_said(&forecast, times.len())?;
    }
}
