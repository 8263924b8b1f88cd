//! From a tracked video to labels: the frames of flights that are sure to be the ball's.

use std::collections::BTreeMap;

use nalgebra::Point2;

use gravisight_geometry::camera::{Camera, Outline};
use gravisight_geometry::statistics::median;
use gravisight_track::{EstimatorConfig, TrackedFrame, TrackedVideo, common_size_sigma};

/// Probability from which a frame of a track in pixels alone is a label.
const SURE: f64 = 0.9;
/// The same in a flight that physics explains: the flight as a whole is the evidence.
const SURE_IN_FLIGHT: f64 = 0.5;
/// Fewest labels of a flight: a parabola has three numbers an axis, and as many again say whether it is one.
const FEWEST: usize = 6;
/// How far beside the outline, px, a person marks a ball, as for the tracker.
const SEED_PX: f64 = 6.0;
/// Frames without the ball that a flight may have between two with it.
const GAP: usize = 2;
/// How far the ball may be from where constant acceleration through the three labels before puts it: as a fraction of its way from frame to
/// frame, and px, three standard deviations of that of labels good to 1 px (√20). Beyond, it was hit.
const HIT: f64 = 0.5;
const HIT_PX: f64 = 13.4;

/// The ball in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlightLabel {
    /// Its outline, px.
    pub outline: Outline,
    /// Which of the video's flights it belongs to.
    pub flight: usize,
    /// Whether the radius follows from the distance that physics finds, in pixels of the camera.
    pub by_physics: bool,
}

/// The labels of `tracked` by the index of the frame. Where camera and scene were known, only flights count that physics explains; in pixels
/// alone, runs of frames in which the ball is sure, cut where it is hit. `seeds` are frames and places (px) in which a person saw the ball: a
/// flight through one counts whatever the tracker's probability. With `ball`, the camera and the ball's radius (m), a size is the one at
/// the distance that physics finds, where that is known better than the size that was measured.
pub fn flight_labels(
    tracked: &TrackedVideo,
    seeds: &[(usize, [f64; 2])],
    ball: Option<(&Camera, f64)>,
) -> BTreeMap<usize, FlightLabel> {
    let mut labels = BTreeMap::new();
    let mut number = 0;
    for flight in flights(tracked, seeds) {
        let radii = flight.iter().filter_map(|frame| frame.radius_px);
        let Some(usual) = median(radii.collect::<Vec<f64>>()) else { continue };
        let mut count = 0;
        for frame in &flight {
            let Some(centre) = frame.image else { continue };
            let explained = ball.and_then(|(camera, radius)| explained_radius(frame, camera, radius, usual));
            let outline = Outline { centre, radius: explained.or(frame.radius_px).unwrap_or(usual) };
            labels.insert(frame.frame, FlightLabel { outline, flight: number, by_physics: explained.is_some() });
            count += 1;
        }
        number += usize::from(count > 0);
    }
    labels
}

/// The apparent radius (px) at the distance that physics finds, of a camera that stands still; none where that is no better than measured radii
/// of about `usual` px.
fn explained_radius(frame: &TrackedFrame, camera: &Camera, radius: f64, usual: f64) -> Option<f64> {
    let (Some(world), Some(sigma), Some(true), Some(0.0)) =
        (frame.world, frame.sigma, frame.explained, frame.camera_sigma_px)
    else {
        return None;
    };
    let ball = camera.camera_from_world(&world);
    let measured = common_size_sigma(EstimatorConfig::default().size_sigma, usual);
    (sigma < measured * ball.coords.norm()).then(|| camera.outline(&ball, radius).ok()).flatten().map(|it| it.radius)
}

/// The frames of each flight that teaches.
fn flights<'a>(tracked: &'a TrackedVideo, seeds: &[(usize, [f64; 2])]) -> Vec<Vec<&'a TrackedFrame>> {
    // A frame that repeats another has its ball.
    let shown_in = |seed: usize| tracked.frames.get(..=seed)?.iter().rposition(|frame| !frame.repeated);
    let seeds: Vec<(usize, Point2<f64>)> =
        seeds.iter().filter_map(|&(frame, at)| Some((shown_in(frame)?, at.into()))).collect();
    let is_seen = |frame: &TrackedFrame| {
        let reach = SEED_PX + frame.radius_px.unwrap_or(0.0);
        let is_here = |at: &Point2<f64>| frame.image.is_some_and(|image| (image - at).norm() <= reach);
        seeds.iter().any(|(seed, at)| *seed == frame.frame && is_here(at))
    };
    let is_seeded = |run: &[&TrackedFrame]| run.iter().any(|frame| is_seen(frame));
    let frames = tracked.frames.iter().filter(|frame| frame.image.is_some() && !frame.repeated && !frame.outlier);
    if tracked.explained.is_some() {
        let mut by_flight: BTreeMap<usize, Vec<&TrackedFrame>> = BTreeMap::new();
        for frame in frames.filter(|frame| frame.explained == Some(true) && frame.confidence >= SURE_IN_FLIGHT) {
            if let Some(flight) = frame.flight {
                by_flight.entry(flight).or_default().push(frame);
            }
        }
        return by_flight.into_values().filter(|flight| flight.len() >= FEWEST).collect();
    }
    // Pictures that repeat the one before take no time: films are stretched by them.
    let mut pictures = 0;
    let pictures: Vec<usize> = (tracked.frames.iter())
        .map(|frame| {
            pictures += usize::from(!frame.repeated);
            pictures
        })
        .collect();
    let mut runs: Vec<Vec<&TrackedFrame>> = vec![];
    for frame in frames {
        match runs.last_mut() {
            Some(run) if continues(run, frame, &pictures) => run.push(frame),
            _ => runs.push(vec![frame]),
        }
    }
    let is_sure = |run: &[&TrackedFrame]| {
        let sure = run.iter().filter(|frame| frame.confidence >= SURE).count();
        2 * sure > run.len()
    };
    runs.retain(|run| run.len() >= FEWEST && (is_sure(run) || is_seeded(run)));
    for run in &mut runs {
        if !is_seeded(run) {
            run.retain(|frame| frame.confidence >= SURE);
        }
    }
    runs.retain(|run| run.len() >= FEWEST);
    runs
}

/// Whether `next` belongs to the flight of `run`: it follows soon, and where the acceleration so far puts it. `pictures`
/// numbers the frames without those that repeat another.
fn continues(run: &[&TrackedFrame], next: &TrackedFrame, pictures: &[usize]) -> bool {
    let Some(last) = run.last() else { return true };
    if pictures[next.frame] - pictures[last.frame] > GAP + 1 {
        return false;
    }
    let [.., third, second, first] = run else { return true };
    let place = |frame: &TrackedFrame| frame.image;
    let (Some(c), Some(b), Some(a), Some(is)) = (place(third), place(second), place(first), place(next)) else {
        return true;
    };
    // Divided differences: frames may be missing between.
    let times = [third, second, first, next].map(|frame| pictures[frame.frame] as f64);
    let between = |from: Point2<f64>, to: Point2<f64>, apart: f64| (to - from) / apart;
    let (v1, v2) = (between(c, b, times[1] - times[0]), between(b, a, times[2] - times[1]));
    let acceleration = (v2 - v1) / (times[2] - times[0]);
    let ahead = times[3] - times[2];
    let expected = a + v2 * ahead + acceleration * ahead * (times[3] - times[1]);
    (is - expected).norm() < HIT_PX.max(HIT * (is - a).norm())
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::testing::looking;
    use gravisight_geometry::camera::Distortion;
    use gravisight_geometry::size::Size;

    /// A ball of 5 px at `place` of frame `0..count` with `confidence`.
    fn video(count: usize, confidence: f64, place: impl Fn(usize) -> Option<[f64; 2]>) -> TrackedVideo {
        let frame = |frame: usize| TrackedFrame {
            frame,
            image: place(frame).map(Point2::from),
            radius_px: Some(5.0),
            confidence,
            ..TrackedFrame::default()
        };
        let mut tracked = TrackedVideo::default();
        tracked.frames = (0..count).map(frame).collect();
        tracked
    }

    /// Thrown up at frame 0 and kicked every 12 frames: 6 px a frame².
    fn juggled(frame: usize) -> [f64; 2] {
        let t = (frame % 12) as f64;
        [300.0 + 2.0 * frame as f64, 400.0 - 33.0 * t + 3.0 * t * t]
    }

    #[test]
    fn a_kick_begins_another_flight_and_the_apex_of_one_does_not() {
        let labels = flight_labels(&video(36, 0.95, |frame| Some(juggled(frame))), &[], None);
        let flights: Vec<usize> = labels.values().map(|label| label.flight).collect();
        assert_eq!(labels.len(), 36);
        assert_eq!(flights.last(), Some(&2), "{flights:?}");
        let of_first = labels.iter().filter(|(_, label)| label.flight == 0).count();
        assert!((11..=13).contains(&of_first), "{of_first}");
    }

    #[test]
    fn a_film_with_repeated_frames_has_the_flights_that_it_had_without() {
        // Every sixth frame shows the one before.
        let mut tracked = video(40, 0.95, |frame| {
            let t = (frame - frame / 6) as f64;
            Some([30.0 * t, 400.0 - 30.0 * t + 0.6 * t * t])
        });
        tracked.frames.iter_mut().skip(6).step_by(6).for_each(|frame| (frame.repeated, frame.image) = (true, None));
        let labels = flight_labels(&tracked, &[], None);
        assert_eq!(labels.len(), 34);
        assert!(labels.values().all(|label| label.flight == 0));
    }

    #[test]
    fn what_is_not_sure_or_too_short_teaches_nothing_unless_a_person_saw_it() {
        let unsure = video(20, 0.6, |frame| Some([10.0 * frame as f64, 50.0]));
        assert!(flight_labels(&unsure, &[], None).is_empty());
        assert_eq!(flight_labels(&unsure, &[(7, [72.0, 48.0])], None).len(), 20);
        // The tracker followed something else.
        assert!(flight_labels(&unsure, &[(7, [170.0, 50.0])], None).is_empty());
        assert!(flight_labels(&unsure, &[(20, [200.0, 50.0])], None).is_empty());
        // Frame 8 shows frame 7 once more.
        let mut slow = video(20, 0.6, |frame| Some([10.0 * (frame - usize::from(frame > 7)) as f64, 50.0]));
        (slow.frames[8].repeated, slow.frames[8].image) = (true, None);
        assert_eq!(flight_labels(&slow, &[(8, [70.0, 50.0])], None).len(), 19);
        let short = video(20, 0.99, |frame| (frame < FEWEST - 1).then_some([10.0 * frame as f64, 50.0]));
        assert!(flight_labels(&short, &[], None).is_empty());
    }

    #[test]
    fn where_the_scene_is_known_only_explained_flights_teach() {
        let mut tracked = video(30, 0.99, |frame| Some([10.0 * frame as f64, 50.0]));
        tracked.explained = Some(false);
        for frame in &mut tracked.frames {
            frame.flight = Some(usize::from(frame.frame >= 15));
            frame.explained = Some(frame.frame >= 15);
        }
        let labels = flight_labels(&tracked, &[], None);
        assert_eq!(labels.keys().copied().collect::<Vec<_>>(), (15..30).collect::<Vec<_>>());
    }

    #[test]
    fn the_size_is_that_at_the_distance_of_physics_where_that_is_known_better() {
        let camera = looking([0.0; 3], [0.0, 4.0, 0.0], 400.0, Size::new(640, 480), Distortion::default());
        let mut tracked = video(10, 0.99, |frame| Some([10.0 * frame as f64, 50.0]));
        tracked.explained = Some(true);
        for frame in &mut tracked.frames {
            (frame.flight, frame.explained, frame.camera_sigma_px) = (Some(0), Some(true), Some(0.0));
            frame.world = Some(Point3::new(0.0, 4.0, 0.0));
            // The last ones are known worse than their radius.
            frame.sigma = Some(if frame.frame < 5 { 0.1 } else { 3.0 });
        }
        let radii: Vec<f64> =
            flight_labels(&tracked, &[], Some((&camera, 0.1))).values().map(|label| label.outline.radius).collect();
        let expected = camera.outline(&camera.camera_from_world(&Point3::new(0.0, 4.0, 0.0)), 0.1).unwrap().radius;
        assert!((expected - 5.0).abs() > 1.0, "{expected}");
        assert_eq!(radii, [[expected; 5], [5.0; 5]].concat());
    }
}
