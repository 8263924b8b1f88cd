//! What the laws of motion conserve and promise: orders of convergence, energy, reversal, contact times, rest.

use std::sync::Arc;

use super::scenes::{ELASTIC, SOFT, forecaster, scene, state, tight};
use crate::{Contact, Cuboid, Floor, ForecastOptions, Forecaster, Integrator, Potential, Spring, State, Status, Wall};
use nalgebra::{Point3, Vector3};
use proptest::prelude::*;

/// An anharmonic, anisotropic bowl.
#[derive(Debug)]
struct Bowl;

impl Potential for Bowl {
    fn value(&self, r: &Vector3<f64>) -> f64 {
        0.25 * r.norm_squared().powi(2) + r.x * r.y
    }

    fn gradient(&self, r: &Vector3<f64>) -> Vector3<f64> {
        r * r.norm_squared() + Vector3::new(r.y, r.x, 0.0)
    }
}

fn bowl(options: ForecastOptions) -> Forecaster {
    let mut empty = scene(ELASTIC, 1.0, 0.1);
    empty.floor = None;
    forecaster(&empty, options).with_potential(Arc::new(Bowl))
}

/// Slope of log(error) over log(step), of positions and Jacobians together.
fn order(integrator: impl Fn(f64) -> Integrator) -> f64 {
    let start = state([0.6, -0.2, 0.3], [0.1, 0.8, -0.4]);
    let run = |options| bowl(options).forecast_with_jacobians(&start, &[1.0]);
    let reference = run(ForecastOptions {
        integrator: Integrator::DormandPrince { rtol: 1e-13, atol: 1e-14 },
        ..ForecastOptions::default()
    });
    let error = |step: f64| {
        let found = run(ForecastOptions { integrator: integrator(step), max_step: step, ..ForecastOptions::default() });
        let off = (found.states[0].position - reference.states[0].position).norm();
        off.max((found.jacobians[0] - reference.jacobians[0]).norm())
    };
    (error(0.1) / error(0.025)).log(4.0)
}

#[test]
fn integrators_converge_with_their_order() {
    // a tolerance that never cuts a step leaves the method's own order
    let fifth = order(|_| Integrator::DormandPrince { rtol: 1.0, atol: 1.0 });
    let fourth = order(|step| Integrator::RungeKutta4 { step });
    let second = order(|step| Integrator::VelocityVerlet { step });
    println!("orders {fifth:.2} {fourth:.2} {second:.2}");
    for (found, expected) in [(fifth, 5.0), (fourth, 4.0), (second, 2.0)] {
        assert!((found - expected).abs() < 0.3, "{found} {expected}");
    }
}

#[test]
fn closed_forms_and_integrators_agree() {
    let mut orbit = scene(ELASTIC, 0.0, 0.1);
    (orbit.floor, orbit.spring) = (None, Some(Spring { stiffness: 3.0, anchor: [0.1, 0.2, 0.3] }));
    let mut box_ = scene(SOFT, 1.0, 0.2);
    box_.boxes = vec![Cuboid::upright([0.3, 0.0, 0.2], [0.5, 0.4, 0.3], 0.4)];
    let times: Vec<f64> = (1..=40).map(|frame| f64::from(frame) / 15.0).collect();
    for scene in [orbit, scene(ELASTIC, 1.0, 0.2), scene(SOFT, 1.0, 0.2), box_] {
        let start = state([0.2, -0.1, 1.5], [0.3, 0.2, -0.4]);
        let closed = forecaster(&scene, tight()).forecast_with_jacobians(&start, &times);
        let numeric = forecaster(&scene, ForecastOptions { closed_forms: false, ..tight() })
            .forecast_with_jacobians(&start, &times);
        for (a, b) in closed.states.iter().zip(&numeric.states) {
            assert!((a.position - b.position).norm() < 1e-8, "{scene:?} {a:?} {b:?}");
        }
        for (a, b) in closed.jacobians.iter().zip(&numeric.jacobians) {
            assert!((a - b).norm() < 1e-6 * a.norm(), "{scene:?}\n{a}\n{b}");
        }
    }
}

#[test]
fn the_paper_s_spring_orbit_is_the_closed_formula() {
    let mut scene = scene(ELASTIC, 0.0, 0.1);
    (scene.floor, scene.spring, scene.ball.mass) = (None, Some(Spring { stiffness: 3.0, anchor: [0.0; 3] }), 2.0);
    let (start, t) = (state([1.0, 0.5, -0.7], [0.3, -1.2, 0.8]), 0.9);
    let omega = (3.0_f64 / 2.0).sqrt();
    let expected = start.position.coords * (omega * t).cos() + start.velocity * ((omega * t).sin() / omega);
    for closed_forms in [true, false] {
        let forecast = forecaster(&scene, ForecastOptions { closed_forms, ..tight() }).forecast(&start, &[t]);
        assert!((forecast.states[0].position.coords - expected).norm() < 1e-9);
    }
}

#[test]
fn energy_is_kept_over_a_hundred_bounces() {
    let mut room = scene(ELASTIC, 9.81, 0.05);
    room.walls = vec![
        Wall { point: [-1.0, 0.0, 0.0], normal: [1.0, 0.0, 0.0] },
        Wall { point: [1.0, 0.0, 0.0], normal: [-1.0, 0.0, 0.0] },
    ];
    room.boxes = vec![Cuboid::upright([0.0, 0.0, 0.1], [0.2, 0.3, 0.1], 0.3)];
    let start = state([-0.5, 0.05, 1.0], [1.7, 0.0, 0.3]);
    for (contact, closed_forms) in [
        (ELASTIC, true),
        (ELASTIC, false),
        (Contact::Spring { stiffness: 3e4 }, true),
        (Contact::Spring { stiffness: 3e4 }, false),
    ] {
        room.contact = contact.clone();
        let integrator = Integrator::DormandPrince { rtol: 1e-9, atol: 1e-9 };
        let forecaster = forecaster(&room, ForecastOptions { integrator, closed_forms, ..ForecastOptions::default() });
        let times: Vec<f64> = (1..=1200).map(|step| f64::from(step) * 0.05).collect();
        let forecast = forecaster.forecast(&start, &times);
        let index =
            forecast.states.iter().zip(&times).position(|(_, t)| forecast.impacts.get(99).is_some_and(|i| i.time < *t));
        let last = index.unwrap_or_else(|| panic!("{} bounces, {:?}", forecast.impacts.len(), forecast.status));
        let energy = forecaster.energy(&start);
        let worst = forecast.states[..=last]
            .iter()
            .map(|state| (forecaster.energy(state) / energy - 1.0).abs())
            .fold(0.0, f64::max);
        println!("{contact:?} closed {closed_forms}: {worst:.1e}");
        assert!(worst < 1e-6, "{contact:?}: {worst:e}");
    }
}

#[test]
fn the_contact_time_changes_as_the_implicit_function_theorem_says() {
    for contact in [SOFT, ELASTIC] {
        let forecaster = forecaster(&scene(contact, 9.81, 0.1), tight());
        let (z, vz) = (1.3, 0.7);
        let forecast = forecaster.forecast_with_jacobians(&state([0.0, 0.0, z], [0.4, 0.2, vz]), &[0.8]);
        let impact = forecast.impacts[0];
        let speed = (vz * vz + 2.0 * 9.81 * (z - 0.1)).sqrt();
        assert!((impact.time - (vz + speed) / 9.81).abs() < 1e-10);
        // z + vz·t − g·t²/2 = R  ⇒  dt/dz = 1/speed, dt/dvz = t/speed
        let expected = [0.0, 0.0, 1.0 / speed, 0.0, 0.0, impact.time / speed];
        let gradient = impact.time_gradient.unwrap();
        for (found, expected) in gradient.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-9, "{gradient:?}");
        }
        // Without Jacobians it is unknown, which is not zero.
        let plain = forecaster.forecast(&state([0.0, 0.0, z], [0.4, 0.2, vz]), &[0.8]);
        assert_eq!(plain.impacts[0].time_gradient, None);
    }
}

#[test]
fn a_dropped_ball_rebounds_with_its_restitution_and_grips_with_its_friction() {
    let ball = scene(Contact::bounce(0.75, 0.2), 9.81, 0.1);
    let after = |v: [f64; 3], spin: [f64; 3]| {
        let mut ball = ball.clone();
        ball.ball.spin = spin;
        let start = ball.start(Point3::new(0.0, 0.0, 0.1), v.into());
        let forecast = forecaster(&ball, tight()).forecast(&start, &[0.0, 1e-9]);
        forecast.states[1].velocity
    };
    // slides: Δv = µ(1 + e)·v_n
    assert!((after([3.0, 0.0, -2.0], [0.0; 3]) - Vector3::new(3.0 - 0.2 * 1.75 * 2.0, 0.0, 1.5)).norm() < 1e-6);
    // grips: a solid ball keeps 5/7 of a small tangential speed
    assert!((after([0.3, 0.0, -2.0], [0.0; 3]) - Vector3::new(0.3 * 5.0 / 7.0, 0.0, 1.5)).norm() < 1e-6);
    // rolls already (v = ω × R·n): nothing to rub
    assert!((after([0.3, 0.0, -2.0], [0.0, 3.0, 0.0]) - Vector3::new(0.3, 0.0, 1.5)).norm() < 1e-6);
    // topspin pushes it forward
    assert!(after([0.3, 0.0, -2.0], [0.0, 50.0, 0.0]).x > 0.3);
}

#[test]
fn a_ball_on_the_floor_stays_there() {
    for contact in [ELASTIC, Contact::bounce(0.5, 0.3)] {
        let forecast = forecaster(&scene(contact, 9.81, 0.1), tight())
            .forecast_with_jacobians(&state([1.0, 2.0, 0.1], [0.0; 3]), &[1.0, 10.0]);
        assert_eq!(forecast.status, Status::Ok);
        assert!((forecast.states[1].position - Point3::new(1.0, 2.0, 0.1)).norm() < 1e-12);
        assert!(forecast.steps < 1000, "{}", forecast.steps);
    }
    // a soft one sinks in by g/k and stays
    let rest = 0.1 - 9.81 / 1000.0;
    let forecast = forecaster(&scene(SOFT, 9.81, 0.1), tight()).forecast(&state([0.0, 0.0, rest], [0.0; 3]), &[5.0]);
    assert!((forecast.states[0].position.z - rest).abs() < 1e-9);
}

#[test]
fn bounces_end_in_rolling_without_counting_them_all() {
    let forecaster = forecaster(&scene(Contact::bounce(0.7, 0.4), 9.81, 0.1), tight());
    let forecast = forecaster.forecast_with_jacobians(&state([0.0, 0.0, 1.0], [2.0, 0.5, 0.0]), &[5.0, 6.0, 7.0]);
    assert_eq!(forecast.status, Status::Ok);
    assert!((10..60).contains(&forecast.impacts.len()), "{}", forecast.impacts.len());
    let [a, b, c] = [0, 1, 2].map(|index| forecast.states[index]);
    assert!((a.position.z - 0.1).abs() < 1e-9 && a.velocity.z == 0.0, "{a:?}");
    assert!((b.position - a.position - a.velocity).norm() < 1e-9 && (c.velocity - a.velocity).norm() < 1e-9);
    assert!(a.velocity.x > 1.0 && a.velocity.x < 2.0, "{a:?}");
}

#[test]
fn a_ball_rolls_off_a_table_and_falls() {
    let mut room = scene(Contact::bounce(0.6, 0.3), 9.81, 0.05);
    room.boxes = vec![Cuboid::upright([0.0, 0.0, 0.4], [0.5, 0.5, 0.4], 0.0)];
    for speed in [0.2, 1.5] {
        let forecast = forecaster(&room, tight()).forecast(&state([0.0, 0.1, 0.85], [speed, 0.0, 0.0]), &[0.1, 10.0]);
        assert_eq!(forecast.status, Status::Ok, "{speed}");
        assert!((forecast.states[0].position.z - 0.85).abs() < 1e-9);
        let end = forecast.states[1].position;
        assert!((end.z - 0.05).abs() < 1e-6 && end.x > 0.55, "{speed}: {end}");
    }
}

#[test]
fn a_ball_slides_down_a_slope_as_friction_lets_it() {
    // 45°, µ = 0.2: slides with g(sin − µ cos); µ = 1: rolls with g·sin·5/7
    let slope = |friction: f64| {
        let mut hill = scene(Contact::bounce(0.5, friction), 9.81, 0.1);
        hill.floor = None;
        hill.walls = vec![Wall { point: [0.0; 3], normal: [1.0, 0.0, 1.0] }];
        let n = Vector3::new(1.0, 0.0, 1.0).normalize() * 0.1;
        let forecast = forecaster(&hill, tight()).forecast(&state(n.into(), [0.0; 3]), &[1.0]);
        forecast.states[0].velocity.norm()
    };
    let pull = 9.81 / 2.0_f64.sqrt();
    assert!((slope(0.2) - pull * 0.8).abs() < 1e-3, "{} {}", slope(0.2), pull * 0.8);
    assert!((slope(1.0) - pull * 5.0 / 7.0).abs() < 1e-3, "{} {}", slope(1.0), pull * 5.0 / 7.0);
}

#[test]
fn a_ball_rolls_over_the_seam_of_two_flush_boxes() {
    let mut table = scene(Contact::bounce(0.5, 0.3), 9.81, 0.1);
    let tile = |x: f64| Cuboid::upright([x, 0.0, -0.5], [0.5; 3], 0.0);
    table.boxes = vec![tile(1.0), tile(2.0)];
    for friction in [0.0, 0.3] {
        table.contact = Contact::bounce(0.5, friction);
        let rolling = state([0.0, 0.0, 0.1], [1.0, 0.0, 0.0]);
        let forecast = forecaster(&table, tight()).forecast_with_jacobians(&rolling, &[0.4, 1.0, 2.0, 3.0]);
        assert_eq!(forecast.status, Status::Ok, "{friction}");
        let speed = forecast.states[0].velocity.x;
        let end = forecast.states[3];
        assert!((end.velocity - Vector3::new(speed, 0.0, 0.0)).norm() < 1e-6, "{end:?}");
        assert!((end.position.z - 0.1).abs() < 1e-7 && forecast.impacts.is_empty(), "{end:?} {:?}", forecast.impacts);
    }
}

#[test]
fn a_rolling_ball_slips_where_its_grip_fails_and_loses_energy() {
    // tethered on a rough floor: Coulomb friction on a solid sphere, integrated here by small steps
    let mut tethered = scene(Contact::bounce(0.5, 0.2), 9.81, 0.1);
    tethered.spring = Some(Spring { stiffness: 50.0, anchor: [0.0, 0.0, 0.1] });
    let (mut x, mut v, mut spin_speed, dt) = (1.0_f64, 0.0_f64, 0.0_f64, 1e-6);
    for _ in 0..3_000_000 {
        let slip = v - spin_speed;
        let grip = 50.0 * x / 3.5; // what stops the slip from changing
        let friction = match slip.abs() < 1e-5 && grip.abs() <= 0.2 * 9.81 {
            true => grip,
            false if slip.abs() < 1e-5 => grip.signum() * 0.2 * 9.81,
            false => -slip.signum() * 0.2 * 9.81,
        };
        v += (-50.0 * x + friction) * dt;
        spin_speed -= 2.5 * friction * dt;
        x += v * dt;
    }
    let forecast = forecaster(&tethered, tight()).forecast(&state([1.0, 0.0, 0.1], [0.0; 3]), &[3.0]);
    assert_eq!(forecast.status, Status::Ok);
    println!("{x} {}", forecast.states[0].position.x);
    assert!((forecast.states[0].position.x - x).abs() < 2e-3, "{} {x}", forecast.states[0].position.x);
}

#[test]
fn a_soft_ball_on_the_floor_sees_a_thin_wall_on_its_way() {
    let mut room = scene(Contact::Spring { stiffness: 1e4 }, 9.81, 0.033);
    room.ball.drag_coefficient = 0.01;
    room.boxes = vec![Cuboid::upright([0.5, 0.0, 0.5], [0.005, 1.0, 0.5], 0.0)];
    for x in [0.0, 0.02, 0.04, 0.06, 0.08] {
        let start = state([x, 0.0, 0.033 - 9.81e-4], [2.5, 0.0, 0.0]);
        let forecast = forecaster(&room, ForecastOptions::default()).forecast(&start, &[0.5]);
        assert!(forecast.states[0].position.x < 0.5, "{x}: {:?}", forecast.states[0]);
    }
}

#[test]
fn a_light_gravity_does_not_glue_a_ball() {
    let mut moon = scene(ELASTIC, 1e-4, 0.1);
    moon.floor = Some(Floor { height: 0.0 });
    let forecaster = forecaster(&moon, tight());
    let start = state([0.0, 0.0, 0.101], [0.0; 3]);
    let forecast = forecaster.forecast(&start, &[5.0, 10.0]);
    for state in &forecast.states {
        assert!((forecaster.energy(state) / forecaster.energy(&start) - 1.0).abs() < 1e-9, "{state:?}");
    }
}

#[test]
fn a_user_s_own_potential_moves_the_ball_and_its_energy_is_kept() {
    let forecaster = bowl(tight());
    let start = state([0.6, -0.2, 0.3], [0.1, 0.8, -0.4]);
    let forecast = forecaster.forecast(&start, &[1.0, 5.0, 20.0]);
    for state in &forecast.states {
        let drift = (forecaster.energy(state) / forecaster.energy(&start) - 1.0).abs();
        assert!(drift < 1e-8, "{drift:e}");
    }
}

#[test]
fn times_come_in_any_order_and_a_batch_is_its_parts() {
    let forecaster = forecaster(&scene(SOFT, 1.0, 0.2), tight());
    let starts: Vec<State> = (0..20).map(|k| state([0.0, 0.0, 0.5 + 0.1 * f64::from(k)], [0.1, 0.2, -0.3])).collect();
    let batch = forecaster.forecast_batch(&starts, &[0.5, -0.3, 1.2, 0.0]);
    for (start, forecast) in starts.iter().zip(&batch) {
        assert_eq!(*forecast, forecaster.forecast_with_jacobians(start, &[0.5, -0.3, 1.2, 0.0]));
        for (index, &time) in [0.5, -0.3, 1.2, 0.0].iter().enumerate() {
            let alone = forecaster.forecast(start, &[time]).states[0];
            assert!((alone.position - forecast.states[index].position).norm() < 1e-9);
        }
    }
}

#[test]
fn a_forecast_goes_on_from_its_own_states_with_the_spin_that_is_left() {
    let mut curve = scene(Contact::bounce(0.8, 0.3), 9.81, 0.03);
    (curve.ball.mass, curve.ball.lift_coefficient, curve.ball.spin_decay) = (0.003, 0.6, 1.0);
    curve.ball.spin = [20.0, 150.0, 80.0];
    let forecaster = forecaster(&curve, tight());
    let start = curve.start(Point3::new(0.0, 0.0, 0.6), Vector3::new(3.0, 0.5, 0.0));
    let whole = forecaster.forecast(&start, &[0.2, 0.9]);
    assert!(!whole.impacts.is_empty() && whole.states[0].spin != start.spin);
    let rest = forecaster.forecast(&whole.states[0], &[0.7]);
    assert!((rest.states[0].position - whole.states[1].position).norm() < 1e-7, "{rest:?} {whole:?}");
    assert!((rest.states[0].spin - whole.states[1].spin).norm() < 1e-4);
}

#[test]
fn a_spin_that_decays_fast_is_solved_as_well_as_the_path() {
    let mut curve = scene(ELASTIC, 0.0, 0.1);
    (curve.floor, curve.ball.lift_coefficient, curve.ball.spin_decay) = (None, 1e-6, 40.0);
    curve.ball.spin = [0.0, 0.0, 100.0];
    let start = curve.start(Point3::origin(), Vector3::new(1.0, 0.0, 0.0));
    let spin = forecaster(&curve, ForecastOptions::default()).forecast(&start, &[0.2]).states[0].spin.z;
    let expected = 100.0 * (-8.0_f64).exp();
    assert!((spin - expected).abs() < 1e-2, "{spin} {expected}");
}

#[test]
fn strong_forces_and_thin_boxes_let_no_ball_through() {
    let mut room = scene(ELASTIC, 9.81, 0.01);
    room.floor = None;
    room.boxes = vec![Cuboid::upright([1.0, 0.0, 0.0], [1e-4, 50.0, 50.0], 0.0)];
    (room.ball.mass, room.ball.drag_coefficient, room.ball.lift_coefficient) = (0.002, 3.0, 4.0);
    room.spring = Some(Spring { stiffness: 0.5, anchor: [3.0, 0.0, 0.0] });
    for contact in [ELASTIC, Contact::Spring { stiffness: 1e9 }] {
        room.contact = contact;
        for rtol in [1e-6, 1e-3] {
            let integrator = Integrator::DormandPrince { rtol, atol: rtol };
            let forecaster = forecaster(&room, ForecastOptions { integrator, ..ForecastOptions::default() });
            for case in 0..60 {
                room.ball.spin = [0.0, 0.0, f64::from(case - 30) * 10.0];
                let start = room.start(
                    Point3::new(-0.1 * f64::from(case % 7), 0.3, 0.0),
                    Vector3::new(3.0 * f64::from(case), 8.0, -3.0),
                );
                let forecast = forecaster.forecast(&start, &[0.1, 0.2, 0.3]);
                assert!(forecast.states.iter().all(|state| state.position.x < 1.0), "{rtol} {case} {forecast:?}");
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 3000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn time_runs_back_to_the_start(x in -1.0..1.0_f64, z in 0.4..2.0_f64, v in prop::array::uniform3(-2.0..2.0_f64), time in 0.1..2.0_f64, model in 0..3) {
        let contact = [Contact::Penalty { c: 100.0, beta: 30.0, beta_box: 20.0 }, Contact::Spring { stiffness: 3000.0 }, ELASTIC][model as usize].clone();
        let mut room = scene(contact, 2.0, 0.15);
        room.boxes = vec![Cuboid::upright([1.8, 0.2, 0.3], [0.4, 0.7, 0.6], 0.6)];
        let forecaster = forecaster(&room, tight());
        let start = state([x, 0.1, z], v);
        let there = forecaster.forecast(&start, &[time]);
        prop_assume!(there.status == Status::Ok);
        let back = forecaster.forecast_with_jacobians(&there.states[0], &[-time]);
        prop_assume!(back.status == Status::Ok); // an end inside a contact is squashed further than half its radius
        let off = (back.states[0].position - start.position).norm();
        prop_assert!(off < 1e-5 * (1.0 + back.jacobians[0].amax()), "{off:e} {:?}", there.impacts);
    }
}
