//! Texts that others wrote: cameras, scenes, points, cards, tracks. What is read is written again and read as the same.
#![no_main]

use gravisight::{Camera, Card, Points, Scene, Track, Unknowns, calibrate};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Some((which, rest)) = bytes.split_first() else { return };
    let Ok(text) = std::str::from_utf8(rest) else { return };
    match which % 5 {
        0 => {
            let Ok(camera) = Camera::from_json(text, "camera") else { return };
            let centre = one_metre_away(&camera);
            assert!(centre.is_none_or(f64::is_finite));
        }
        1 => {
            if let Ok(scene) = Scene::from_json(text, "scene") {
                let _ = scene.check("scene");
            }
        }
        2 => {
            if let Ok(points) = Points::from_json(text, "points")
                && points.world.len() < 40
            {
                let _ = calibrate(&points, &Unknowns::default());
            }
        }
        3 => drop(Card::from_json(text, "card")),
        _ => {
            if let Ok(track) = Track::from_csv(text, "track") {
                let _ = track.observations(Some(50.0));
                let again = Track::from_csv(&track.to_csv().unwrap(), "again").unwrap();
                assert_eq!(again.points.len(), track.points.len());
            }
        }
    }
});

/// How far away a camera puts what it sees at 1 m, along its axis.
fn one_metre_away(camera: &Camera) -> Option<f64> {
    let [width, height] = camera.size().xy();
    let at = camera.world_from_image(&[width / 2.0, height / 2.0].into(), 1.0).ok()?;
    Some(at.x + at.y + at.z)
}
