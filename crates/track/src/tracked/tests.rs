use super::*;
use crate::video::{Candidate, TrackedBlob};
use gravisight_geometry::size::Size;

#[test]
fn a_ball_that_is_seen_too_shortly_for_a_flight_is_not_explained() {
    let seen = |(number, x): (usize, Option<f64>)| {
        let point = crate::TrackPoint {
            frame: number as u64,
            time: Some(number as f64 / 30.0),
            visibility: u8::from(x.is_some()),
            x,
            y: x.map(|_| 200.0),
            ..Default::default()
        };
        TrackedFrame::new((number, FollowedFrame { point, ..FollowedFrame::default() }))
    };
    let frames = [None, Some(100.0), Some(110.0), Some(121.0), None].into_iter().enumerate().map(seen).collect();
    let mut video = TrackedVideo { frames, ..TrackedVideo::default() };
    let scene = Scene::named("tennis").unwrap();
    let camera = r#"{"width": 640, "height": 480, "intrinsic": [[600, 0, 319.5], [0, 600, 239.5], [0, 0, 1]],
        "camera_from_world": [[1, 0, 0, 0], [0, 0, -1, 2], [0, 1, 0, 15], [0, 0, 0, 1]]}"#;
    let camera = Camera::from_json(camera, "camera").unwrap();
    assert_eq!(camera.size(), Size::new(640, 480));
    video.fit(&Forecaster::new(&scene).unwrap(), &camera, &FitOptions::default(), |_, _| {}).unwrap();
    assert!(video.flights.is_empty() && video.explained == Some(false), "{video:?}");
    assert!(video.verdict.starts_with("not explained"), "{}", video.verdict);
}

#[test]
fn of_a_long_list_the_first_items_are_named_and_the_others_counted() {
    let items: Vec<String> = (1..=7).map(|number| number.to_string()).collect();
    assert_eq!(listed(&items[..5], ", "), "1, 2, 3, 4, 5");
    assert_eq!(listed(&items, ", "), "1, 2, 3, 4, 5 and 2 more");
}

/// A tennis ball that is thrown up before a camera: where it is seen in 40 frames, px.
fn thrown() -> (Forecaster, Camera, Vec<[f64; 2]>) {
    let scene = Scene::named("floor").unwrap();
    let camera = r#"{"width": 1280, "height": 720, "intrinsic": [[900, 0, 639.5], [0, 900, 359.5], [0, 0, 1]],
        "camera_from_world": [[1, 0, 0, 0], [0, 0, -1, 1.5], [0, 1, 0, 6], [0, 0, 0, 1]]}"#;
    let camera = Camera::from_json(camera, "camera").unwrap();
    let forecaster = Forecaster::new(&scene).unwrap();
    let start = scene.start(Point3::new(-1.5, 0.0, 1.0), nalgebra::Vector3::new(3.0, 0.6, 5.0));
    let times: Vec<f64> = (0..40).map(|frame| f64::from(frame) / 40.0).collect();
    let at = |state: &gravisight_physics::State| camera.image_from_world(&state.position).unwrap().into();
    let path = forecaster.forecast(&start, &times).states.iter().map(at).collect();
    (forecaster, camera, path)
}

fn candidate(frame: usize, [x, y]: [f64; 2]) -> Candidate {
    let point = crate::TrackPoint {
        frame: frame as u64,
        time: Some(frame as f64 / 40.0),
        visibility: 1,
        x: Some(x + 0.3 * (frame as f64 * 7.7).sin()),
        y: Some(y + 0.3 * (frame as f64 * 5.1).cos()),
        sigma: Some(0.3),
        ..Default::default()
    };
    Candidate { point, ball: TrackedBlob { image: [x, y], radius_px: 5.0, reach_px: 5.0 } }
}

/// A video in which `seen` is followed, by frame, beside `candidates` and another track.
fn video(
    seen: impl Fn(usize) -> Option<[f64; 2]>,
    candidates: impl Fn(usize) -> Vec<[f64; 2]>,
    other: &[[f64; 2]],
) -> TrackedVideo {
    let frame = |number: usize| {
        let nothing =
            crate::TrackPoint { frame: number as u64, time: Some(number as f64 / 40.0), ..Default::default() };
        let ball = seen(number).map(|at| candidate(number, at));
        let point = ball.map_or(nothing, |ball| ball.point);
        let confidence = if ball.is_some() { 0.95 } else { 0.0 };
        let followed = FollowedFrame { point, ball: ball.map(|it| it.ball), confidence, ..Default::default() };
        TrackedFrame::new((number, followed))
    };
    let others = other.iter().enumerate().map(|(number, &at)| (number, candidate(number, at), 0.93)).collect();
    let alternatives = Alternatives {
        candidates: (0..40)
            .map(|frame| candidates(frame).into_iter().map(|at| candidate(frame, at)).collect())
            .collect(),
        tracks: if other.is_empty() { vec![] } else { vec![others] },
    };
    let tracks = if other.is_empty() { vec![] } else { vec![OtherTrack::default()] };
    TrackedVideo { frames: (0..40).map(frame).collect(), alternatives, tracks, ..Default::default() }
}

#[test]
fn labels_that_the_flight_contradicts_are_replaced_and_missing_ones_found() {
    let (forecaster, camera, path) = thrown();
    let away = |frame: usize| [path[frame][0] + 45.0, path[frame][1] - 30.0];
    // Followed: elsewhere in three frames, of which one has no candidate on the path; nowhere in four.
    let seen = |frame: usize| match frame {
        15..18 => Some(away(frame)),
        24..28 => None,
        _ => Some(path[frame]),
    };
    let candidates = |frame: usize| match frame {
        16 => vec![away(16)],
        _ => vec![away(frame), path[frame]],
    };
    let mut video = video(seen, candidates, &[]);
    video.fit(&forecaster, &camera, &FitOptions::default(), |_, _| {}).unwrap();
    assert_eq!(video.explained, Some(true), "{}", video.verdict);
    for (frame, at) in path.iter().enumerate() {
        let found = video.frames[frame].image;
        match frame {
            16 => assert!(video.frames[16].outlier, "{found:?}"),
            _ => assert!((found.unwrap() - Point2::from(*at)).norm() < 1.0, "{frame}: {found:?}"),
        }
    }
    assert!(video.frames[25].confidence > 0.9);
}

#[test]
fn where_no_flight_explains_what_was_followed_another_track_is_tried() {
    let (forecaster, camera, path) = thrown();
    let limb = |frame: usize| {
        let swing = frame as f64 / 3.0;
        Some([400.0 + 60.0 * swing.sin() + 25.0 * (2.3 * swing).cos(), 300.0 + 40.0 * (1.7 * swing).cos()])
    };
    let mut alone = video(limb, |_| vec![], &[]);
    alone.fit(&forecaster, &camera, &FitOptions::default(), |_, _| {}).unwrap();
    assert_eq!(alone.explained, Some(false), "{}", alone.verdict);
    let mut video = video(limb, |_| vec![], &path);
    video.fit(&forecaster, &camera, &FitOptions::default(), |_, _| {}).unwrap();
    assert_eq!(video.explained, Some(true), "{}", video.verdict);
    assert!((video.frames[20].image.unwrap() - Point2::from(path[20])).norm() < 1.0);
    assert!(video.notes.iter().any(|note| note.contains("another one")), "{:?}", video.notes);
}
