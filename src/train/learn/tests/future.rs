//! The future loss: where forecasts start, what they teach, and its gradients.

use std::sync::Arc;

use burn::tensor::{Device, Tensor, TensorData};
use nalgebra::{Matrix2, Point3, Vector2, Vector3};
use pollster::block_on;

use super::super::future::{future, future_loss};
use super::super::knowledge::{Knowledge, OwnTrack};
use super::super::launch::Launch;
use super::super::laws::LearnedLaws;
use super::super::step::StepOptions;
use super::step::options;
use crate::testing::root;
use crate::train::examples::{PictureTransform, Start, Target, Window};
use crate::train::recipe::Law;
use gravisight_clips::Clips;
use gravisight_physics::{Forecaster, Scene};

/// Three balls' windows in a batch of twelve pictures (three of the start, one ahead): one flies, one bounces, one is
/// seen in a mirrored and scaled picture; and positions near the truth, but off.
fn windows() -> (Vec<[f64; 3]>, Vec<Window>) {
    let camera = Clips::read(&root().join("tests/samples")).unwrap().clips[0].camera.clone();
    let scene =
        r#"{"gravity": [0, 0, -1], "ball": {"radius": 0.2}, "contact": {"model": "spring"}, "floor": {"height": 0}}"#;
    let forecaster = Arc::new(Forecaster::new(&Scene::from_json(scene, "scene").unwrap()).unwrap());
    let plain = PictureTransform { linear: Matrix2::identity(), origin: Vector2::zeros(), zoom: 1.0 };
    let mirrored =
        PictureTransform { linear: Matrix2::new(-1.9, 0.3, 0.2, 2.0), origin: Vector2::new(200.0, 7.0), zoom: 1.2 };
    let starts = [
        ([0.4, 0.3, 2.0], [0.2, -0.3, 0.6]),
        ([-0.3, 0.2, 0.6], [0.4, 0.1, -0.5]),
        ([0.1, 0.5, 1.5], [-0.2, 0.3, 0.1]),
    ];
    let mut positions = Vec::new();
    let mut windows = Vec::new();
    for (number, (position, velocity)) in starts.into_iter().enumerate() {
        let transform = if number == 2 { mirrored } else { plain };
        let state = forecaster.scene().start(Point3::from(position), Vector3::from(velocity));
        let times = [-1.0 / 15.0, 0.0, 1.0 / 15.0, 1.0];
        let forecast = forecaster.forecast(&state, &times);
        let first = positions.len();
        for (index, state) in forecast.states.iter().enumerate() {
            let image = camera.image_from_world(&state.position).unwrap();
            let depth = camera.camera_from_world(&state.position).z;
            let off = 0.3 * (number as f64 + 1.0) * (index as f64 - 1.3);
            let drawn = transform.linear.try_inverse().unwrap() * (image.coords - transform.origin);
            positions.push([drawn[0] + off, drawn[1] - 0.5 * off, depth / transform.zoom + 0.02 * off]);
        }
        let target = match number {
            1 => Target::Label([100.0, 120.0]),
            _ => Target::Predicted { picture: first + 3, transform },
        };
        windows.push(Window {
            first,
            start: Start::Pictures { transforms: [transform; 3], times: [times[0], times[1], times[2]] },
            ball_radius: None,
            since_start: 0.0,
            camera: camera.clone(),
            forecaster: forecaster.clone(),
            ahead: vec![(1.0, target)],
        });
    }
    (positions, windows)
}

#[test]
fn the_future_losss_gradients_equal_central_differences() {
    let (positions, windows) = windows();
    for robust in [None, Some(5.0)] {
        let loss = future_loss(&positions, &windows, robust, &Knowledge::default());
        assert_eq!(loss.whole, 3);
        for picture in 0..positions.len() {
            for axis in 0..3 {
                let at = |by: f64| {
                    let mut moved = positions.clone();
                    moved[picture][axis] += by;
                    // targets are detached: they stay where they were
                    let fixed: Vec<Window> = windows.iter().map(|window| detached(window, &positions)).collect();
                    future_loss(&moved, &fixed, robust, &Knowledge::default()).value
                };
                let expected = (at(1e-6) - at(-1e-6)) / 2e-6;
                let found = loss.gradient[picture][axis];
                assert!(
                    (found - expected).abs() < 1e-5 * (1.0 + expected.abs()),
                    "{robust:?} {picture} {axis}: {found} {expected}"
                );
            }
        }
        assert_eq!(loss.gradient[3], [0.0; 3], "a target has no gradient");
    }
}

#[test]
fn the_loss_against_true_positions_is_what_the_paper_prints_and_has_its_gradient() {
    let (positions, windows) = windows();
    // What the fourth picture of each window must be: 20, −10 and 30 cm off what is found.
    let off = [0.2, -0.1, 0.3];
    let truths = windows.iter().map(|window| {
        let picture = window.first + 3;
        let Start::Pictures { transforms, .. } = window.start else { panic!() };
        let [x, y, depth] = positions[picture];
        let image = transforms[0].clip_from_picture([x, y]).into();
        let found = window.camera.camera_from_image(&image, depth * transforms[0].zoom).unwrap();
        let position = [0, 1, 2].map(|axis| found[axis] - off[axis]);
        Window { ahead: vec![(1.0, Target::True { picture, transform: transforms[0], position })], ..window.clone() }
    });
    let truths: Vec<Window> = truths.collect();
    let loss = future_loss(&positions, &truths, None, &Knowledge::default());
    assert!(
        (loss.value - 0.6 / 3.0).abs() < 1e-9,
        "the mean over windows and axes of the distances, m: {}",
        loss.value
    );
    for picture in 0..positions.len() {
        for axis in 0..3 {
            let at = |by: f64| {
                let mut moved = positions.clone();
                moved[picture][axis] += by;
                future_loss(&moved, &truths, None, &Knowledge::default()).value
            };
            let expected = (at(1e-6) - at(-1e-6)) / 2e-6;
            let found = loss.gradient[picture][axis];
            assert!((found - expected).abs() < 1e-6 * (1.0 + expected.abs()), "{picture} {axis}: {found} {expected}");
        }
    }
}

/// Windows of one picture each, with exact 2D positions around: one flies, one has bounced just before, one is seen in a
/// mirrored and scaled picture and pulled by a spring. And positions near the truth, but off; and the truth's velocities.
fn lone_windows() -> (Vec<[f64; 3]>, Vec<Window>, Vec<Vector3<f64>>) {
    let camera = Clips::read(&root().join("tests/samples")).unwrap().clips[0].camera.clone();
    let [floor, spring] = [
        r#""contact": {"model": "spring"}, "floor": {"height": 0}"#,
        r#""spring": {"anchor": [0, 0, 2], "stiffness": 3.0}"#,
    ];
    let scene = |rest: &str| format!(r#"{{"gravity": [0, 0, -1], "ball": {{"radius": 0.2}}, {rest}}}"#);
    let plain = PictureTransform { linear: Matrix2::identity(), origin: Vector2::zeros(), zoom: 1.0 };
    let mirrored =
        PictureTransform { linear: Matrix2::new(-1.9, 0.3, 0.2, 2.0), origin: Vector2::new(200.0, 7.0), zoom: 1.2 };
    let starts = [
        ([0.4, 0.3, 2.0], [0.2, -0.3, 0.6], plain, floor),
        ([-0.3, 0.2, 0.34], [0.4, 0.1, 0.7], plain, floor),
        ([0.1, 0.5, 1.5], [-0.2, 0.3, 0.1], mirrored, spring),
    ];
    let (mut positions, mut windows, mut velocities) = (vec![], vec![], vec![]);
    for (first, (position, velocity, transform, rest)) in starts.into_iter().enumerate() {
        let read = |rest: &str| Arc::new(Forecaster::new(&Scene::from_json(&scene(rest), "scene").unwrap()).unwrap());
        let forecaster = read(rest);
        let free = if rest == spring { forecaster.clone() } else { read(r#""contact": {"model": "spring"}"#) };
        let state = forecaster.scene().start(Point3::from(position), Vector3::from(velocity));
        let times: Vec<f64> = (-5..=5).map(|frame| f64::from(frame) / 15.0).collect();
        let later = [-1.0, 1.0];
        let seen = |times: &[f64]| -> Vec<(f64, Target)> {
            let states = forecaster.forecast(&state, times).states;
            let images = states.iter().map(|state| camera.image_from_world(&state.position).unwrap());
            times.iter().copied().zip(images.map(|image| Target::Label(image.into()))).collect()
        };
        let image = camera.image_from_world(&state.position).unwrap();
        let drawn = transform.linear.try_inverse().unwrap() * (image.coords - transform.origin);
        positions.push([drawn[0], drawn[1], camera.camera_from_world(&state.position).z / transform.zoom]);
        velocities.push(state.velocity);
        windows.push(Window {
            first,
            start: Start::Track { transform, frame: [0, first], around: seen(&times), free },
            ball_radius: None,
            since_start: 0.0,
            camera: camera.clone(),
            forecaster: forecaster.clone(),
            ahead: seen(&later),
        });
    }
    (positions, windows, velocities)
}

/// The same seen by a network that reads apparent radii.
fn by_size() -> (Vec<[f64; 3]>, Vec<Window>, Vec<Vector3<f64>>) {
    let (mut positions, mut windows, velocities) = lone_windows();
    for (window, position) in windows.iter_mut().zip(&mut positions) {
        let Start::Track { transform, .. } = &window.start else { panic!("not a track") };
        let radius = window.forecaster.scene().ball.radius;
        let depth = position[2] * transform.zoom;
        let centre = window
            .camera
            .camera_from_image(&transform.clip_from_picture([position[0], position[1]]).into(), depth)
            .unwrap();
        let outline = window.camera.outline(&centre, radius).unwrap();
        let [x, y] = transform.picture_from_clip(outline.centre.into());
        *position = [x, y, outline.radius / transform.scale()];
        window.ball_radius = Some(radius);
    }
    (positions, windows, velocities)
}

#[test]
fn two_d_positions_around_a_picture_tell_its_velocity_to_a_contact() {
    for (positions, windows, velocities) in [lone_windows(), by_size()] {
        for (window, velocity) in windows.iter().zip(velocities) {
            let launch = Launch::of(window, &positions, &OwnTrack::new()).unwrap().unwrap();
            let off = (launch.velocity - velocity).norm();
            println!("{off:.1e} m/s off, weight {:.3}", launch.weight);
            assert!(off < 1e-6 && launch.weight > 0.999);
        }
        assert!(future_loss(&positions, &windows, None, &Knowledge::default()).value < 1e-4);
    }
}

#[test]
fn the_derivatives_of_a_start_from_one_picture_equal_central_differences() {
    let near = |(mut positions, windows, _): (Vec<[f64; 3]>, _, _)| -> (_, Vec<Window>) {
        positions.iter_mut().for_each(|[x, y, third]| [*x, *y, *third] = [*x + 0.7, *y - 0.4, *third * 1.04]);
        (positions, windows)
    };
    let both = [near(lone_windows()), near(by_size())];
    for (positions, window) in both.iter().flat_map(|(positions, all)| all.iter().map(move |one| (positions, one))) {
        let launch = |positions: &[[f64; 3]]| Launch::of(window, positions, &OwnTrack::new()).unwrap().unwrap();
        let (picture, of_position, of_velocity) = launch(positions).slopes[0];
        assert_eq!(picture, window.first);
        for axis in 0..3 {
            let at = |by: f64| {
                let mut moved = positions.clone();
                moved[picture][axis] += by;
                launch(&moved)
            };
            let (less, more) = (at(-1e-5), at(1e-5));
            let position = (more.position - less.position) / 2e-5;
            let velocity = (more.velocity - less.velocity) / 2e-5;
            assert!((position - of_position.column(axis)).norm() < 1e-6 * position.norm());
            assert!(
                (velocity - of_velocity.column(axis)).norm() < 1e-5 * velocity.norm().max(1e-3),
                "{axis}: {velocity}"
            );
        }
    }
}

#[test]
fn the_future_losss_gradient_by_laws_equals_central_differences() {
    let (mut positions, windows, _) = lone_windows();
    positions.iter_mut().for_each(|position| position[2] *= 1.03);
    let laws = LearnedLaws::new(&[Law::Gravity]).nudged(0, 0.1);
    let loss = |by: f64| {
        let knowledge = Knowledge { laws: laws.nudged(0, by), ..Knowledge::default() };
        future_loss(&positions, &windows[..1], Some(5.0), &knowledge)
    };
    let (found, expected) = (loss(0.0).by_law[0], (loss(1e-3).value - loss(-1e-3).value) / 2e-3);
    println!("{found} {expected}");
    // The weights, which are not to be learned, depend on gravity a little.
    assert!((found - expected).abs() < 0.05 * expected.abs(), "{found} {expected}");
}

#[test]
fn what_the_network_has_not_seen_yet_teaches_nothing_and_what_it_has_teaches_as_a_label() {
    let (mut positions, windows, _) = lone_windows();
    positions.iter_mut().for_each(|position| position[2] *= 1.04);
    let mut own = OwnTrack::new();
    let remembered = |windows: &[Window], own: &mut OwnTrack| -> Vec<Window> {
        let mut number = 0;
        let mut keep = |&(time, target): &(f64, Target)| {
            number += 1;
            let Target::Label(label) = target else { panic!("not a label") };
            own.insert([1, number], label);
            (time, Target::Remembered([1, number]))
        };
        let change = |window: &Window| {
            let Start::Track { transform, frame, around, free } = window.start.clone() else { panic!("not a track") };
            let around = around.iter().map(&mut keep).collect();
            let start = Start::Track { transform, frame, around, free };
            Window { start, ahead: window.ahead.iter().map(&mut keep).collect(), ..window.clone() }
        };
        windows.iter().map(change).collect()
    };
    let by_memory = remembered(&windows, &mut own);
    assert_eq!(future_loss(&positions, &by_memory, None, &Knowledge::default()).whole, 0);
    let knowledge = Knowledge { own, ..Knowledge::default() };
    assert_eq!(
        future_loss(&positions, &by_memory, None, &knowledge),
        future_loss(&positions, &windows, None, &knowledge)
    );
}

#[test]
fn a_window_in_the_middle_of_a_flight_is_forecast_with_the_spin_of_then() {
    let camera = Clips::read(&root().join("tests/samples")).unwrap().clips[0].camera.clone();
    let scene = r#"{"gravity": [0, 0, -1], "ball": {"radius": 0.2, "mass": 0.05, "lift_coefficient": 1.0,
        "spin": [0, 0, 20], "spin_decay": 3.0}}"#;
    let forecaster = Arc::new(Forecaster::new(&Scene::from_json(scene, "scene").unwrap()).unwrap());
    let start = forecaster.scene().start(Point3::new(-0.8, -0.4, 1.5), Vector3::new(0.8, 0.3, 0.4));
    let (middle, step, ahead) = (0.8, 1.0 / 120.0, 0.8);
    let truth = forecaster.forecast(&start, &[middle - step, middle, middle + step, middle + ahead]).states;
    let seen = |index: usize| camera.image_from_world(&truth[index].position).unwrap();
    let positions: Vec<[f64; 3]> = (0..3)
        .map(|index| [seen(index).x, seen(index).y, camera.camera_from_world(&truth[index].position).z])
        .collect();
    let transform = PictureTransform { linear: Matrix2::identity(), origin: Vector2::zeros(), zoom: 1.0 };
    let error = |since_start: f64| {
        let window = Window {
            first: 0,
            start: Start::Pictures { transforms: [transform; 3], times: [-step, 0.0, step] },
            ball_radius: None,
            since_start,
            camera: camera.clone(),
            forecaster: forecaster.clone(),
            ahead: vec![(ahead, Target::Label(seen(3).into()))],
        };
        future_loss(&positions, &[window], None, &Knowledge::default()).value
    };
    println!("{:.2} px; with the spin of the start {:.2} px", error(middle), error(0.0));
    assert!(error(middle) < 0.1 && error(0.0) > 1.0);
}

/// The window with its targets as they are at `positions`.
fn detached(window: &Window, positions: &[[f64; 3]]) -> Window {
    let fixed = |target: Target| match target {
        Target::Predicted { picture, transform } => {
            Target::Label(transform.clip_from_picture([positions[picture][0], positions[picture][1]]))
        }
        label => label,
    };
    Window { ahead: window.ahead.iter().map(|&(time, target)| (time, fixed(target))).collect(), ..window.clone() }
}

#[test]
fn the_future_loss_enters_the_graph_with_its_value_and_gradient() {
    let (positions, windows) = windows();
    let device = Device::flex().autodiff();
    let column = |axis: usize| -> Vec<f32> { positions.iter().map(|position| position[axis] as f32).collect() };
    let image: Vec<f32> = positions.iter().flat_map(|[x, y, _]| [*x as f32, *y as f32]).collect();
    let image = Tensor::<2>::from_data(TensorData::new(image, [12, 2]), &device).require_grad();
    let depth = Tensor::<1>::from_data(TensorData::new(column(2), [12]), &device).require_grad();
    let probability = Tensor::<3>::zeros([12, 1, 1], &device);
    let decoded = crate::model::Decoded { image: image.clone(), depth: depth.clone(), probability };
    let loss = block_on(future(
        &decoded,
        &windows,
        &StepOptions { robust_px: Some(5.0), ..options(1e-3) },
        &mut Knowledge::default(),
    ))
    .unwrap();
    let expected = future_loss(&positions, &windows, Some(5.0), &Knowledge::default());
    let value = f64::from(loss.clone().into_scalar::<f32>());
    assert!((value - expected.value).abs() < 1e-4 * expected.value, "{value} {}", expected.value);
    let gradients = loss.backward();
    let images: Vec<f64> = image.grad(&gradients).unwrap().into_data().iter::<f64>().collect();
    let depths: Vec<f64> = depth.grad(&gradients).unwrap().into_data().iter::<f64>().collect();
    for (index, [x, y, z]) in expected.gradient.iter().enumerate() {
        let found = [images[2 * index], images[2 * index + 1], depths[index]];
        for (found, expected) in found.iter().zip([x, y, z]) {
            assert!((found - expected).abs() < 1e-3 * (1.0 + expected.abs()), "{index}: {found} {expected}");
        }
    }
}

#[test]
fn a_forecast_that_fails_teaches_nothing() {
    let (mut positions, windows) = windows();
    let whole = future_loss(&positions, &windows, None, &Knowledge::default());
    positions[0][2] = f64::NAN;
    let loss = future_loss(&positions, &windows, None, &Knowledge::default());
    assert_eq!(loss.whole, 2);
    assert!(loss.value < whole.value && loss.gradient[..4].iter().flatten().all(|&slope| slope == 0.0));
    assert_eq!(loss.gradient[4..], whole.gradient[4..]);
}
