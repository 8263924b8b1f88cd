//! The report on a video agrees with its numbers.

use super::*;
use crate::{FitOptions, TrackPoint, TrackedFrame};
use gravisight_geometry::camera::Distortion;
use gravisight_geometry::size::Size;
use gravisight_physics::Forecaster;
use gravisight_synth::looking;
use nalgebra::Vector3;

#[test]
fn a_video_without_a_flight_is_not_explained_in_any_of_its_words() {
    let view = Vector3::new(0.0, 4.0, -0.5).normalize();
    let camera =
        looking(Vector3::new(0.0, -4.0, 1.5), view, 600.0, Size::new(640, 480), Distortion::default()).unwrap();
    let scene = Scene::new([0.0, 0.0, -9.81], 0.02).with_floor(0.0);
    for (seen, verdict, headline) in
        [(0, "no flying ball", "No flying ball"), (3, "not explained", "no positions in metres")]
    {
        let mut video = TrackedVideo { frames: vec![TrackedFrame::default(); 20], ..TrackedVideo::default() };
        for (number, frame) in video.frames.iter_mut().enumerate() {
            let at = (number < seen).then_some(100.0 + 5.0 * number as f64);
            frame.followed.point = TrackPoint {
                frame: number as u64,
                visibility: at.is_some().into(),
                x: at,
                y: at,
                time: Some(number as f64 / 50.0),
                ..TrackPoint::default()
            };
        }
        video.fit(&Forecaster::new(&scene).unwrap(), &camera, &FitOptions::default(), |_, _| ()).unwrap();
        assert_eq!((video.found(), video.flights.len(), video.explained), (seen, 0, Some(false)));
        assert!(video.verdict.starts_with(verdict), "{}", video.verdict);
        let findings = Findings::of_video(&video, Some((&camera, &scene)));
        assert!(findings.headline.contains(headline), "{}", findings.headline);
    }
}
