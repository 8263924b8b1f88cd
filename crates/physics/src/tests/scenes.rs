//! Scenes, states and forecasters that tests of the physics share.

use crate::{Contact, ForecastOptions, Forecaster, Integrator, Scene, State};
use nalgebra::{Point3, Vector3};

pub fn scene(contact: Contact, gravity: f64, radius: f64) -> Scene {
    let text =
        format!(r#"{{"gravity": [0, 0, {}], "ball": {{"radius": {radius}}}, "floor": {{"height": 0}}}}"#, -gravity);
    Scene { contact, ..Scene::from_json(&text, "test").unwrap() }
}

pub fn state(r: [f64; 3], v: [f64; 3]) -> State {
    State { position: Point3::from(r), velocity: v.into(), spin: Vector3::zeros() }
}

pub fn tight() -> ForecastOptions {
    ForecastOptions { integrator: Integrator::DormandPrince { rtol: 1e-11, atol: 1e-12 }, ..ForecastOptions::default() }
}

pub fn forecaster(scene: &Scene, options: ForecastOptions) -> Forecaster {
    Forecaster::new(scene).unwrap().with_options(options).unwrap()
}

pub const ELASTIC: Contact = Contact::bounce(1.0, 0.0);
pub const SOFT: Contact = Contact::Spring { stiffness: 1000.0 };
