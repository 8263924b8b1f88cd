//! The forecaster against references that are not ours, and against its own derivatives and conservation laws.

use crate::{
    Case, Contact, Cuboid, Floor, ForecastOptions, Forecaster, Integrator, Scene, Spring, State, Status, Wall,
};
use gravisight_testing::golden;
use nalgebra::{Matrix6, Point3, Vector3};
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};
use serde_json::Value;

/// The solver for comparisons.
fn precise() -> ForecastOptions {
    ForecastOptions { integrator: Integrator::DormandPrince { rtol: 1e-10, atol: 1e-11 }, ..ForecastOptions::default() }
}

fn vector(value: &Value) -> Vector3<f64> {
    let number = |index: usize| value[index].as_f64().unwrap();
    Vector3::new(number(0), number(1), number(2))
}

fn state(r: Vector3<f64>, v: Vector3<f64>) -> State {
    State { position: Point3::from(r), velocity: v, spin: Vector3::zeros() }
}

fn bare(contact: Contact, gravity: f64) -> Scene {
    let text = format!(r#"{{"gravity": [0, 0, {}], "ball": {{"radius": 0.2}}}}"#, -gravity);
    Scene { contact, ..Scene::from_json(&text, "test").unwrap() }
}

/// The reference's cases with what it says of them.
fn cases() -> Vec<(Case, Value)> {
    let bytes = golden("forecast_penalty.json");
    let file: Value = serde_json::from_slice(&bytes).unwrap();
    let cases = Case::all_from_json(std::str::from_utf8(&bytes).unwrap(), "forecast_penalty.json").unwrap();
    cases.into_iter().zip(file["cases"].as_array().unwrap().clone()).collect()
}

fn reference_jacobian(value: &Value) -> Matrix6<f64> {
    Matrix6::from_fn(|row, column| value[row][column].as_f64().unwrap())
}

#[test]
fn the_papers_equations_of_motion_agree_with_the_reference() {
    for (case, reference) in cases() {
        let forecaster = Forecaster::new(&case.scene).unwrap().with_options(precise()).unwrap();
        let forecast = forecaster.forecast_with_jacobians(&case.start, &case.times);
        assert!(forecast.status.is_whole(), "{}: {:?}", case.name, forecast.status);
        if forecast.status == Status::StartInside {
            assert_eq!(reference["kind"], "odd", "{}", case.name);
            continue;
        }
        let tolerance = if reference["kind"] == "smooth" { 1e-8 } else { 1e-5 };
        let mut worst = 0.0_f64;
        for (index, state) in forecast.states.iter().enumerate() {
            let off = (state.position.coords - vector(&reference["r"][index])).norm();
            let off_v = (state.velocity - vector(&reference["v"][index])).norm();
            worst = worst.max(off).max(off_v * 0.1);
            let Some(expected) = reference["jacobian"].get(index).map(reference_jacobian) else { continue };
            let off = (forecast.jacobians[index] - expected).norm() / expected.norm();
            assert!(off < 1e-5, "{} jacobian {index}: {off:e}", case.name);
        }
        println!("{} {worst:e}", case.name);
        assert!(worst < tolerance, "{} ({}): {worst:e}", case.name, reference["kind"]);
        let energy = forecaster.energy(&case.start) - 0.5 * case.start.velocity.norm_squared();
        let expected = reference["V0"].as_f64().unwrap();
        assert!((energy - expected).abs() < 1e-9 * (1.0 + expected.abs()), "{}: {energy} {expected}", case.name);
    }
}

// -- random scenes -----------------------------------------------------------------------------------------------

const COMPONENTS: usize = 6;

fn perturbed(start: &State, component: usize, by: f64) -> State {
    let mut out = *start;
    match component {
        0..3 => out.position[component] += by,
        _ => out.velocity[component - 3] += by,
    }
    out
}

/// Central differences with Richardson's extrapolation; `None` where another sequence of contacts, or a
/// disagreement between two step sizes, says that a kink lies in between.
fn differences(forecaster: &Forecaster, start: &State, time: f64, h: f64) -> Option<Matrix6<f64>> {
    let surfaces =
        |forecast: &crate::Forecast| -> Vec<_> { forecast.impacts.iter().map(|impact| impact.surface).collect() };
    let expected = surfaces(&forecaster.forecast(start, &[time]));
    let mut out = Matrix6::zeros();
    for component in 0..COMPONENTS {
        let difference = |h: f64| {
            let [plus, minus] = [h, -h].map(|by| forecaster.forecast(&perturbed(start, component, by), &[time]));
            let same = surfaces(&plus) == expected && surfaces(&minus) == expected;
            let whole = plus.status == Status::Ok && minus.status == Status::Ok;
            if !(same && whole) {
                return None;
            }
            let (p, m) = (plus.states[0], minus.states[0]);
            let (dr, dv) = ((p.position - m.position) / (2.0 * h), (p.velocity - m.velocity) / (2.0 * h));
            Some([dr.x, dr.y, dr.z, dv.x, dv.y, dv.z])
        };
        let (coarse, fine) = (difference(h)?, difference(h / 2.0)?);
        for row in 0..COMPONENTS {
            let estimate = (4.0 * fine[row] - coarse[row]) / 3.0;
            if (fine[row] - coarse[row]).abs() > 1e-4 * (1.0 + estimate.abs()) {
                return None;
            }
            out[(row, component)] = estimate;
        }
    }
    Some(out)
}

/// Scenes as random numbers make them: floor, wall, up to three boxes, every force.
fn scenes(contact: impl Strategy<Value = Contact>) -> impl Strategy<Value = Scene> {
    let cuboid = (prop::array::uniform3(-2.0..2.0), prop::array::uniform3(0.2..1.0), -3.0..3.0)
        .prop_map(|(position, half_size, yaw)| Cuboid::upright(position, half_size, yaw));
    let wall = (-4.0..-3.0, -0.5..0.5).prop_map(|(x, tilt)| Wall { point: [x, 0.0, 0.0], normal: [1.0, tilt, 0.2] });
    let air = (prop::bool::ANY, 0.0..0.6, 0.0..0.5, prop::array::uniform3(-20.0..20.0), 0.0..0.5);
    let spring = prop::option::of((0.5..4.0, prop::array::uniform3(-1.0..1.0)));
    let parts = (contact, prop::collection::vec(cuboid, 0..=3), prop::option::of(wall), air, spring, 0.5..10.0);
    parts.prop_map(|(contact, boxes, wall, (airy, drag, lift, spin, decay), spring, gravity)| {
        let mut scene = bare(contact, gravity);
        scene.ball.radius = 0.1;
        scene.ball.mass = 0.05;
        scene.floor = Some(Floor { height: -1.5 });
        (scene.boxes, scene.walls) = (boxes, wall.into_iter().collect());
        scene.ball.spin = spin;
        if airy {
            (scene.ball.drag_coefficient, scene.ball.lift_coefficient, scene.ball.spin_decay) = (drag, lift, decay);
        }
        scene.spring = spring.map(|(k, anchor)| Spring { stiffness: k * 0.05, anchor });
        scene
    })
}

fn starts() -> impl Strategy<Value = State> {
    (prop::array::uniform3(-2.5..2.5), prop::array::uniform3(-3.0..3.0))
        .prop_map(|(r, v)| state(Vector3::from(r) + Vector3::z(), v.into()))
}

/// `count` random values, the same on every machine.
fn drawn<T>(count: usize, strategy: impl Strategy<Value = T>) -> Vec<T> {
    let mut runner = TestRunner::new_with_rng(Config::default(), TestRng::deterministic_rng(RngAlgorithm::ChaCha));
    (0..count).map(|_| strategy.new_tree(&mut runner).unwrap().current()).collect()
}

/// Compares Jacobians with central differences on random scenes, at least `contacts` of them through a contact.
fn jacobians_agree(contact: BoxedStrategy<Contact>, contacts: usize, h: f64) {
    let (mut with_contact, mut compared) = (0, 0);
    for (scene, start, time) in drawn(400, (scenes(contact), starts(), 0.3..1.5)) {
        let options = ForecastOptions {
            integrator: Integrator::DormandPrince { rtol: 1e-11, atol: 1e-12 },
            ..ForecastOptions::default()
        };
        let forecaster = Forecaster::new(&scene).unwrap().with_options(options).unwrap();
        let start = scene.start(start.position, start.velocity);
        let forecast = forecaster.forecast_with_jacobians(&start, &[time]);
        if forecast.status != Status::Ok {
            continue; // a start inside an obstacle is tested on its own
        }
        let Some(expected) = differences(&forecaster, &start, time, h) else { continue };
        let off = (forecast.jacobians[0] - expected).norm() / expected.norm();
        assert!(
            off < 1e-4,
            "{off:e}\n{}\n{expected}\n{scene:?}\n{start:?} {time} {:?}",
            forecast.jacobians[0],
            forecast.impacts
        );
        compared += 1;
        with_contact += usize::from(!forecast.impacts.is_empty());
    }
    println!("{compared} compared, {with_contact} with contacts");
    assert!(compared >= 100, "{compared}");
    assert!(with_contact >= contacts, "{with_contact}");
}

#[test]
fn jacobians_of_soft_potentials_are_their_differences() {
    let contact = Just(Contact::Penalty { c: 300.0, beta: 30.0, beta_box: 20.0 });
    jacobians_agree(contact.boxed(), 0, 1e-5);
}

#[test]
fn jacobians_through_elastic_contacts_are_their_differences() {
    // stiff enough that the centre stays outside: inside a box the nearest face, and with it the force, jumps
    let contact = (5e3..2e4).prop_map(|stiffness| Contact::Spring { stiffness });
    jacobians_agree(contact.boxed(), 50, 1e-5);
}

#[test]
fn jacobians_through_rigid_bounces_are_their_differences() {
    let contact = (0.3..1.0, prop_oneof![Just(0.0), 0.05..0.8])
        .prop_map(|(restitution, friction)| Contact::bounce(restitution, friction));
    jacobians_agree(contact.boxed(), 50, 1e-6);
}

// -- the simulator's truth ---------------------------------------------------------------------------------------

#[derive(serde::Deserialize)]
struct Track {
    id: String,
    world: Vec<[f64; 3]>,
    velocity: Vec<[f64; 3]>,
    scene: Value,
}

fn tracks() -> Vec<Track> {
    serde_json::from_slice(&golden("tracks.json")).unwrap()
}

#[test]
fn mujocos_ball_is_where_the_forecast_says_to_a_centimetre_after_fifteen_frames() {
    let times: Vec<f64> = (1..=15).map(|frame| f64::from(frame) / 15.0).collect();
    let mut errors: [Vec<f64>; 15] = Default::default();
    for track in tracks() {
        let forecaster = Forecaster::new(&Scene::from_json(&track.scene.to_string(), &track.id).unwrap()).unwrap();
        let start = |frame: usize| state(track.world[frame].into(), track.velocity[frame].into());
        let last = track.world.len() - 15;
        let starts: Vec<State> = (0..last).map(start).collect();
        for (frame, forecast) in forecaster.forecast_batch(&starts, &times).into_iter().enumerate() {
            assert_eq!(forecast.status, Status::Ok, "{} {frame}", track.id);
            for (ahead, state) in forecast.states.iter().enumerate() {
                let truth = Vector3::from(track.world[frame + ahead + 1]);
                errors[ahead].push((state.position.coords - truth).norm());
            }
        }
    }
    let mean = |errors: &Vec<f64>| errors.iter().sum::<f64>() / errors.len() as f64;
    println!(
        "mean error after 4, 8, 15 frames: {:.5} {:.5} {:.5} m",
        mean(&errors[3]),
        mean(&errors[7]),
        mean(&errors[14])
    );
    assert!(mean(&errors[14]) < 0.01, "{}", mean(&errors[14]));
}
