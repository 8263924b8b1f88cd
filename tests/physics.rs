//! The forecaster against references that are not ours, and against its own derivatives and conservation laws.

mod common;

use gravisight::physics::{Contact, Cuboid, Floor, Forecaster, Integrator, Options, Scene, Spring, State, Status, Wall};
use nalgebra::{Matrix6, Point3, Vector3};
use serde_json::Value;

/// The solver for comparisons.
fn precise() -> Options {
    Options { integrator: Integrator::DormandPrince { rtol: 1e-10, atol: 1e-11 }, ..Options::default() }
}

fn vector(value: &Value) -> Vector3<f64> {
    let number = |index: usize| value[index].as_f64().unwrap();
    Vector3::new(number(0), number(1), number(2))
}

fn state(r: Vector3<f64>, v: Vector3<f64>) -> State {
    State { position: Point3::from(r), velocity: v }
}

fn bare(contact: Contact, gravity: f64) -> Scene {
    let text = format!(r#"{{"gravity": [0, 0, {}], "ball": {{"radius": 0.2}}}}"#, -gravity);
    Scene { contact, ..Scene::from_json(&text, "test").unwrap() }
}

/// The scene of a reference case.
fn golden_scene(system: &Value) -> Scene {
    let number = |key: &str| system[key].as_f64();
    let contact = Contact::Penalty {
        c: number("c").unwrap(),
        beta: number("beta").unwrap(),
        beta_box: number("beta_o").unwrap(),
    };
    let mut scene = bare(contact, number("g").unwrap());
    scene.floor = system["floor"].as_bool().unwrap().then_some(Floor { height: 0.0 });
    let x = number("wall_x").map(|x| Wall { point: [x, 0.0, 0.0], normal: [1.0, 0.0, 0.0] });
    let y = number("wall_y").map(|y| Wall { point: [0.0, y, 0.0], normal: [0.0, -1.0, 0.0] });
    scene.walls = x.into_iter().chain(y).collect();
    let cuboid = |o: &Value| {
        let ([l, w, h], p) = (["l", "w", "h"].map(|key| o[key].as_f64().unwrap()), vector(&o["p"]));
        let yaw = o["R"][0][1].as_f64().unwrap().atan2(o["R"][0][0].as_f64().unwrap());
        Cuboid { position: [p.x, p.y, p.z + h / 2.0], half_size: [l, w, h / 2.0], yaw }
    };
    scene.boxes = system["obstacles"].as_array().unwrap().iter().map(cuboid).collect();
    if let Some(k) = system["spring"]["k"].as_f64() {
        scene.ball.mass = system["spring"]["m"].as_f64().unwrap();
        scene.spring = Some(Spring { stiffness: k, anchor: [0.0; 3] });
        scene.floor = None;
    }
    scene
}

struct Case {
    name: String,
    kind: String,
    scene: Scene,
    start: State,
    times: Vec<f64>,
    value: Value,
}

fn cases() -> Vec<Case> {
    let file: Value = serde_json::from_slice(&common::golden("forecast_penalty.json")).unwrap();
    let case = |value: &Value| Case {
        name: value["name"].as_str().unwrap().into(),
        kind: value["kind"].as_str().unwrap().into(),
        scene: golden_scene(&value["system"]),
        start: state(vector(&value["r0"]), vector(&value["v0"])),
        times: value["times"].as_array().unwrap().iter().map(|t| t.as_f64().unwrap()).collect(),
        value: value.clone(),
    };
    file["cases"].as_array().unwrap().iter().map(case).collect()
}

fn reference_jacobian(value: &Value) -> Matrix6<f64> {
    Matrix6::from_fn(|row, column| value[row][column].as_f64().unwrap())
}

#[test]
fn the_papers_equations_of_motion_agree_with_the_reference() {
    for case in cases() {
        let forecaster = Forecaster::new(&case.scene).unwrap().with_options(precise()).unwrap();
        let forecast = forecaster.forecast_with_jacobians(&case.start, &case.times);
        assert!(forecast.status.is_whole(), "{}: {:?}", case.name, forecast.status);
        if forecast.status == Status::StartInside {
            assert_eq!(case.kind, "odd", "{}", case.name);
            continue;
        }
        let tolerance = if case.kind == "smooth" { 1e-8 } else { 1e-5 };
        let mut worst = 0.0_f64;
        for (index, state) in forecast.states.iter().enumerate() {
            let off = (state.position.coords - vector(&case.value["r"][index])).norm();
            let off_v = (state.velocity - vector(&case.value["v"][index])).norm();
            worst = worst.max(off).max(off_v * 0.1);
            let Some(expected) = case.value["jacobian"].get(index).map(reference_jacobian) else { continue };
            let off = (forecast.jacobians[index] - expected).norm() / expected.norm();
            assert!(off < 1e-5, "{} jacobian {index}: {off:e}", case.name);
        }
        println!("{} {worst:e}", case.name);
        assert!(worst < tolerance, "{} ({}): {worst:e}", case.name, case.kind);
        let energy = forecaster.energy(&case.start) - 0.5 * case.start.velocity.norm_squared();
        let expected = case.value["V0"].as_f64().unwrap();
        assert!((energy - expected).abs() < 1e-9 * (1.0 + expected.abs()), "{}: {energy} {expected}", case.name);
    }
}
