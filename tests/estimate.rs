//! The estimator by evidence (`track/estimate`), which `fit` does not use yet: flights of table tennis by a simulator that shares no code
//! with the project (tests/golden/tt_flights.py), spins unknown, against its truth. Limits are what is reached and 30 % more.

#![cfg(not(target_arch = "wasm32"))]

mod common;
#[expect(dead_code)]
mod table;

use std::collections::BTreeMap;

use gravisight::internal::estimated;
use gravisight::{Camera, FitOptions, Forecaster, Observation, Scene};
use nalgebra::{Point2, Vector3};
use table::{SCENE, median};

#[derive(serde::Deserialize)]
struct Strokes {
    cameras: BTreeMap<String, Camera>,
    flights: Vec<Stroke>,
}

#[derive(serde::Deserialize)]
struct Stroke {
    times: Vec<f64>,
    bounce: f64,
    world: Vec<[f64; 3]>,
    labels: BTreeMap<String, Vec<Option<[f64; 2]>>>,
}

fn strokes() -> Strokes {
    serde_json::from_slice(&common::golden("tt_flights.json")).unwrap()
}

fn forecaster() -> Forecaster {
    Forecaster::new(&Scene::from_json(SCENE, "scene").unwrap().with_ball("table-tennis").unwrap()).unwrap()
}

/// The stroke's labels by a camera, its clock so many times as fast.
fn observations(stroke: &Stroke, view: &str, clock: f64) -> Vec<Observation> {
    let label = |(&time, label): (&f64, &Option<[f64; 2]>)| Observation {
        time: time / clock,
        image: label.map(Point2::from),
        radius: None,
    };
    stroke.times.iter().zip(&stroke.labels[view]).map(label).collect()
}

#[test]
fn flights_with_a_bounce_are_found() {
    let (strokes, forecaster) = (strokes(), forecaster());
    for (view, camera) in &strokes.cameras {
        let (mut means, mut ratios, mut bounces) = (vec![], vec![], 0);
        for stroke in &strokes.flights {
            let fit = estimated(&forecaster, camera, &observations(stroke, view, 1.0), &FitOptions::default()).unwrap();
            let off = fit.frames.iter().zip(&stroke.world).map(|(frame, truth)| {
                let error = (frame.state.position.coords - Vector3::from(*truth)).norm();
                (error, error / frame.sigma())
            });
            let (errors, of_sigma): (Vec<f64>, Vec<f64>) = off.unzip();
            assert!(!fit.explained || median(&errors) < 0.3, "{view}: {} m", median(&errors));
            bounces += usize::from(fit.impacts.iter().any(|impact| (impact.time - stroke.bounce).abs() < 0.02));
            means.push(errors.iter().sum::<f64>() / errors.len() as f64);
            ratios.extend(of_sigma);
        }
        let within = |times: f64| ratios.iter().filter(|ratio| **ratio < times).count() as f64 / ratios.len() as f64;
        println!(
            "{view:8} {:.1} cm; within 1 and 2 sigma {:.2} {:.2}",
            100.0 * median(&means),
            within(1.0),
            within(2.0)
        );
        let reached = match view.as_str() {
            "side" => 0.019,
            "oblique" => 0.044,
            _ => 0.048,
        };
        assert!(median(&means) < 1.3 * reached, "{view}: {} m", median(&means));
        assert_eq!(bounces, strokes.flights.len(), "{view}");
        assert!(within(1.0) > 0.61 && within(2.0) > 0.94, "{view}");
    }
}

#[test]
fn another_frame_rate_is_named_where_it_can_be_told() {
    let (strokes, forecaster) = (strokes(), forecaster());
    let (view, camera) = ("side", &strokes.cameras["side"]);
    let mut named = 0;
    for stroke in strokes.flights.iter().take(6) {
        let fit = estimated(&forecaster, camera, &observations(stroke, view, 2.0), &FitOptions::default());
        let words = fit.as_ref().map_or_else(|error| error.to_string(), |fit| fit.verdict());
        println!("{words}");
        named += usize::from(words.contains("frames a second"));
    }
    // Of a ball whose spin nobody knows a single bounce at twice the speed may be true, too.
    assert!(named >= 3, "{named} of 6");
}
