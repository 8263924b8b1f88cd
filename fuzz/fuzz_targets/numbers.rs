//! Numbers of any size: forecasts, fits, courts' lines.
#![no_main]

use arbitrary::Arbitrary;
use gravisight::{Camera, FitOptions, Forecaster, Observation, Scene, State};
use libfuzzer_sys::fuzz_target;

#[derive(Arbitrary, Debug)]
struct Input {
    scene: u8,
    start: [f64; 6],
    times: Vec<f64>,
    focal: f64,
    pose: [f64; 3],
    seen: Vec<(u16, f32, f32, Option<(f32, f32)>)>,
}

fuzz_target!(|input: Input| {
    let names = Scene::names();
    let Ok(scene) = Scene::named(names[usize::from(input.scene) % names.len()]) else { return };
    let Ok(forecaster) = Forecaster::new(&scene) else { return };
    let [x, y, z, u, v, w] = input.start;
    let state = State { position: [x, y, z].into(), velocity: [u, v, w].into(), spin: [0.0; 3].into() };
    // Of more, the limit of steps ends a forecast: a fifth of a second, but many of them here, with every access checked.
    let times: Vec<f64> = input.times.iter().map(|time| time % 5.0).take(8).collect();
    let found = forecaster.forecast(&state, &times);
    assert!(found.states.iter().all(|state| state.position.iter().all(|value| value.is_finite())));
    let [a, b, c] = input.pose;
    let text = format!(
        r#"{{"width":640,"height":360,"intrinsic":[[{0:?},0,319.5],[0,{0:?},179.5],[0,0,1]],
            "camera_from_world":[[1,0,0,{a:?}],[0,0,-1,{b:?}],[0,1,0,{c:?}],[0,0,0,1]]}}"#,
        input.focal
    );
    let Ok(camera) = Camera::from_json(&text, "camera") else { return };
    let observations: Vec<Observation> = (input.seen.iter().take(24).enumerate())
        .map(|(index, (gap, x, y, radius))| Observation {
            time: index as f64 / 50.0 + f64::from(*gap) * 1e-6,
            image: Some([f64::from(*x), f64::from(*y)].into()),
            radius: radius.map(|(radius, sigma)| [f64::from(radius), f64::from(sigma)]),
        })
        .collect();
    if let Ok(fit) = forecaster.fit(&camera, &observations, &FitOptions::default()) {
        assert!(fit.frames.iter().all(|frame| frame.world.iter().all(|value| value.is_finite())));
    }
});
