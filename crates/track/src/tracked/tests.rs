use super::*;
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
