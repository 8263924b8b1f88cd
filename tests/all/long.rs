//! Tracks of hundreds of labels, of a ball that nobody hits: what `fit` makes of them must not depend on how it goes through
//! them.
// Other tests take more of it.
use crate::common::normal;
use crate::table::camera;
#[allow(dead_code)]
use gravisight::internal::Random as ChaCha12Rng;
use gravisight::{Camera, Fit, FitOptions, Forecaster, Observation, Parameter, Scene, State};
use nalgebra::{Point2, Point3, Vector3};
use rand::SeedableRng;

const FPS: f64 = 60.0;
const RESTITUTION: f64 = 0.95;
const DRAG: f64 = 0.55;

fn forecaster(restitution: f64, drag: f64) -> Forecaster {
    let scene = serde_json::json!({"gravity": [0, 0, -9.81],
        "ball": {"radius": 0.0335, "mass": 0.0577, "drag_coefficient": drag, "lift_coefficient": 0.9, "inertia_factor": 0.55,
            "spin_sigma": 50},
        "contact": {"model": "bounce", "restitution": restitution, "friction": 0.3, "restitution_sigma": 0.05},
        "floor": {"height": -0.5}});
    Forecaster::new(&Scene::from_json(&scene.to_string(), "scene").unwrap()).unwrap()
}

fn view() -> Camera {
    camera([1.5, -6.0, 1.2])
}

/// States of a ball that bounces across the floor, a little more than 7 s long, and its labels, to half a pixel.
fn bouncing(seed: u64) -> (Vec<State>, Vec<Point3<f64>>, Vec<Observation>) {
    let forecaster = forecaster(RESTITUTION, DRAG);
    let start = State {
        position: Point3::new(-1.8, 0.3, 0.3),
        velocity: Vector3::new(0.6, -0.1, 0.0),
        spin: Vector3::new(20.0, -30.0, 10.0),
    };
    let times: Vec<f64> = (0..430).map(|frame| f64::from(frame) / FPS).collect();
    let forecast = forecaster.forecast(&start, &times);
    let mut random = ChaCha12Rng::seed_from_u64(seed);
    let label = |(state, &time): (&State, &f64)| {
        let image = view().image_from_world(&state.position).unwrap();
        let image = Point2::new(image.x + 0.5 * normal(&mut random), image.y + 0.5 * normal(&mut random));
        Observation { time, image: Some(image), radius: None }
    };
    let labels = forecast.states.iter().zip(&times).map(label).collect();
    let bounces = forecast.impacts.iter().map(|impact| impact.world).collect();
    (forecast.states, bounces, labels)
}

fn fitted(labels: &[Observation]) -> Fit {
    // Neither restitution nor drag is quite the scene's.
    let began = std::time::Instant::now();
    let fit = forecaster(0.93, 0.5).fit(&view(), labels, &FitOptions::default()).unwrap();
    println!("{} labels: {:.1} s; {}; {:?}", labels.len(), began.elapsed().as_secs_f64(), fit.verdict, fit.notes);
    fit
}

fn estimate(fit: &Fit, parameter: Parameter) -> [f64; 2] {
    let found = fit.estimates[&parameter];
    println!("{parameter:?} {:.4} ± {:.4}", found.value, found.sigma);
    [found.value, found.sigma]
}

#[test]
fn a_long_track_is_one_flight_where_nobody_hits_the_ball() {
    let (truth, bounces, labels) = bouncing(1);
    let fit = fitted(&labels);
    assert_eq!((fit.flights.len(), fit.hits.len()), (1, 0), "{}", fit.verdict);
    assert!(fit.explained && fit.notes.is_empty(), "{} {:?}", fit.verdict, fit.notes);
    assert!(fit.frames.iter().all(|frame| frame.flight == 0));
    assert!((fit.flights[0].start, fit.flights[0].end) == (labels[0].time, labels[labels.len() - 1].time));
    assert_eq!(fit.impacts.len(), bounces.len());
    for (found, truth) in fit.impacts.iter().zip(&bounces) {
        assert!((found.world - truth).norm() < 0.05, "{} {truth}", found.world);
    }
    let (first, last) = (fit.impacts[0].time, fit.impacts[fit.impacts.len() - 1].time);
    for (frame, truth) in fit.frames.iter().zip(&truth) {
        let off = (frame.world - truth.position).norm();
        let known = (first..last).contains(&frame.time);
        assert!(off < 4.0 * frame.sigma, "{off} m, sigma {} at {}", frame.sigma, frame.time);
        assert!(!known || off < 0.03, "{off} m at {}", frame.time);
    }
    // All of it says what the restitution is, not its beginning alone; the drag of a slow ball hardly shows.
    let beginning = fitted(&labels[..240]);
    for (parameter, truth) in [(Parameter::Restitution, RESTITUTION), (Parameter::Drag, DRAG)] {
        let ([value, sigma], [_, less]) = (estimate(&fit, parameter), estimate(&beginning, parameter));
        assert!((value - truth).abs() < 3.0 * sigma, "{parameter:?}: {value} ± {sigma}");
        let limit = if parameter == Parameter::Restitution { 0.95 } else { 1.0 };
        assert!(sigma < limit * less, "{parameter:?}: ± {sigma}, of the beginning ± {less}");
    }
}

#[test]
fn frames_that_are_lost_early_move_all_that_follows() {
    let (truth, _, mut labels) = bouncing(2);
    // Three frames are lost in the middle of a flight, and the rest is numbered on.
    labels.drain(84..87);
    for (frame, label) in labels.iter_mut().enumerate() {
        label.time = frame as f64 / FPS;
    }
    let fit = fitted(&labels);
    assert!(fit.notes.len() == 1 && fit.notes[0].contains("frames are missing before 1.4"), "{:?}", fit.notes);
    assert_eq!(fit.flights.len(), 1, "{}", fit.verdict);
    assert!(fit.frames.windows(2).all(|pair| pair[0].time < pair[1].time));
    let last = fit.frames.len() - 1;
    let late = fit.frames[last].time - (last + 3) as f64 / FPS;
    assert!(late.abs() < 0.25 / FPS, "the last frame is {late} s off");
    let off = (fit.frames[last - 20].world - truth[last - 17].position).norm();
    assert!(off < 0.05, "{off} m");
}
