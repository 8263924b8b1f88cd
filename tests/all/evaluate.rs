//! Metrics against numbers worked out by hand.

use std::cell::Cell;

use crate::common::{golden, root, tiny_card};
use gravisight::Card;
use gravisight::Clips;
use gravisight::Device;
use gravisight::Localiser;
use gravisight::parts::{Bins, ConfidenceKind, Statistic};
use gravisight::{Metrics, Sample, score};
use nalgebra::{Point2, Point3};

fn sample(clip: &str, error: f64, depth: f64) -> Sample {
    Sample {
        ball_radius: None,
        found_depth: depth,
        depth_sigma: None,
        clip: clip.into(),
        place: [0, 0],
        visible: true,
        found: Point3::new(error, 0.0, 0.0),
        truth: Point3::origin(),
        true_depth: depth,
        true_range: depth * 2.0,
        found_image: Point2::new(3.0, 4.0),
        true_image: Point2::origin(),
        confidence: 0.5,
        confidence_kind: ConfidenceKind::HeatmapMass,
        confidence_radius: 12.0,
        seconds_to_decode: 0.25,
        seconds_to_localise: 0.5,
    }
}

const BINS: Bins = Bins { count: 3, z_min: 1.0, z_max: 4.0 };

#[test]
fn a_statistic_is_mean_population_deviation_median_and_count() {
    let odd = Statistic::of([4.0, 1.0, 1.0]);
    assert_eq!((odd.mean, odd.median, odd.n), (Some(2.0), Some(1.0), 3));
    assert!((odd.std.unwrap() - 2.0_f64.sqrt()).abs() < 1e-12);
    assert_eq!(Statistic::of([1.0, 2.0, 4.0, 9.0]).median, Some(3.0));
    assert_eq!(serde_json::to_string(&Statistic::of([])).unwrap(), r#"{"mean":null,"std":null,"median":null,"n":0}"#);
}

#[test]
fn samples_are_grouped_by_camera_environment_and_depth() {
    let samples = [
        sample("test/env1/cam1/0000", 0.1, 1.0),
        sample("test/env1/cam2/0000", 0.3, 2.0),
        sample("test/env2/cam2/0001", 0.5, 3.0),
        sample("anything", 0.7, 4.0),
        sample("beyond", 9.0, 4.1),
    ];
    let metrics = Metrics::of(&samples, BINS);
    assert_eq!(metrics.dtg.n, 5);
    assert_eq!(metrics.image_error_px.mean, Some(5.0));
    let cameras: Vec<_> = metrics.per_camera.iter().map(|(name, found)| (name.as_str(), found.n)).collect();
    assert_eq!(cameras, [("cam1", 1), ("cam2", 2)]);
    assert!((metrics.per_camera["cam2"].mean.unwrap() - 0.4).abs() < 1e-12);
    assert_eq!(metrics.per_environment["env2"].n, 1);
    let bins: Vec<_> = metrics.dtg_binned.iter().map(|bin| bin.n).collect();
    assert_eq!(bins, [1, 1, 2]); // the last bin holds its upper edge; 4.1 m is in none
    assert!((metrics.dtg_relative.median.unwrap() - 0.3 / 4.0).abs() < 0.02);
}

#[test]
fn a_depth_on_an_edge_is_in_the_farther_bin_and_the_last_edge_in_the_last() {
    // The real data set's bins: their edges are no round numbers, and one is 0.7 only up to rounding.
    let bins = Bins { count: 3, z_min: 0.05, z_max: 2.0 };
    let edges = bins.edges();
    assert_eq!((edges[0], edges[3], edges.len()), (0.05, 2.0, 4));
    let samples: Vec<Sample> = edges.iter().map(|&edge| sample("a", 0.1, edge)).collect();
    let counts: Vec<usize> = Metrics::of(&samples, bins).dtg_binned.iter().map(|bin| bin.n).collect();
    assert_eq!(counts, [1, 1, 2]);
    let outside = [sample("a", 0.1, 0.05 - 1e-12), sample("a", 0.1, 2.0 + 1e-12)];
    assert!(Metrics::of(&outside, bins).dtg_binned.iter().all(|bin| bin.n == 0));
    let over = Bins::over(&[sample("a", 0.1, 3.0), sample("a", 0.1, 2.0), sample("a", 0.1, 5.0)], 4);
    assert_eq!((over.count, over.z_min, over.z_max), (4, 2.0, 5.0));
    // All balls at one depth.
    let counts =
        Bins { count: 2, z_min: 1.0, z_max: 1.0 }.sorted(&[sample("a", 0.1, 1.0)]).iter().map(Vec::len).sum::<usize>();
    assert_eq!(counts, 1);
}

#[test]
fn hidden_balls_count_in_the_first_number_and_not_in_the_second() {
    let hidden = Sample { visible: false, ..sample("a", 0.9, 1.0) };
    let metrics = Metrics::of(&[sample("a", 0.1, 1.0), sample("a", 0.3, 2.0), hidden], BINS);
    assert!((metrics.dtg.mean.unwrap() - 1.3 / 3.0).abs() < 1e-12);
    assert_eq!((metrics.dtg.n, metrics.dtg_visible.n), (3, 2));
    assert!((metrics.dtg_visible.mean.unwrap() - 0.2).abs() < 1e-12);
}

#[test]
fn the_calibration_says_how_often_the_ball_was_where_the_model_was_so_sure_of_it() {
    // 5 px off: near for a radius of 12 px, not for one of 4 px.
    let sure = |index: usize| Sample { confidence: 0.9, ..sample("a", 0.1 * index as f64, 1.0) };
    let unsure = |index: usize| Sample {
        confidence: 0.2,
        confidence_radius: if index == 0 { 12.0 } else { 4.0 },
        ..sample("a", 1.0, 1.0)
    };
    let samples: Vec<Sample> =
        (0..40).map(|index| if index % 2 == 0 { sure(0) } else { unsure(index % 4 - 1) }).collect();
    let groups = Metrics::of(&samples, BINS).calibration;
    assert_eq!(groups.len(), 10);
    assert!(groups.iter().all(|group| group.dtg.n == 4));
    assert!((groups[0].confidence.mean.unwrap() - 0.2).abs() < 1e-12);
    assert!((groups[..5].iter().map(|group| group.near).sum::<f64>() / 5.0 - 0.5).abs() < 1e-12);
    assert_eq!((groups[9].near, groups[9].dtg.mean), (1.0, Some(0.0)));
    assert_eq!(Metrics::of(&samples[..3], BINS).calibration.len(), 3, "three pictures make three groups");
    assert!(Metrics::of(&[], BINS).calibration.is_empty());
}

#[test]
fn the_time_of_a_picture_is_told_with_and_without_its_decoding() {
    let seconds = Metrics::of(&[sample("a", 0.1, 1.0)], BINS).seconds_per_picture;
    assert_eq!((seconds.network.mean, seconds.with_decoding.mean), (Some(0.5), Some(0.75)));
}

#[test]
fn the_time_is_told_by_the_callers_clock_and_by_no_other() {
    // A browser's wasm has no clock that the standard library knows.
    let localiser = Localiser::new(tiny_card(), golden("tiny.safetensors"), &Device::flex()).unwrap();
    let clips = Clips::read(&root().join("tests/samples")).unwrap();
    let now = Cell::new(0.0_f64);
    let clock = || now.replace(now.get() + 1.0).powi(2);
    let samples = pollster::block_on(score(&localiser, &clips, Some(2), None, &clock, &mut |_, _| {})).unwrap();
    let seconds: Vec<_> = samples.iter().map(|it| [it.seconds_to_decode, it.seconds_to_localise]).collect();
    assert_eq!(seconds, [[1.0, 3.0], [7.0, 9.0]]);
}

#[test]
fn a_confidence_is_compared_with_what_it_says() {
    let clips = Clips::read(&root().join("tests/samples")).unwrap();
    let scored =
        |localiser: &Localiser| pollster::block_on(score(localiser, &clips, Some(4), None, &|| 0.0, &mut |_, _| {}));
    // The fraction of a heatmap around the position: the same radius for each picture.
    let tiny = Localiser::new(tiny_card(), golden("tiny.safetensors"), &Device::flex()).unwrap();
    let samples = scored(&tiny).unwrap();
    assert_eq!(Metrics::of(&samples, BINS).confidence_kind, Some(ConfidenceKind::HeatmapMass));
    // 12 px of its input of 64, in pictures of 224.
    assert!(samples.iter().all(|it| (it.confidence_radius - 12.0 * 224.0 / 64.0).abs() < 1e-9));
    // The probability that it is a ball: the outline found says where that would be.
    let (card, weights) = Card::with_weights(&root().join("models/any.json")).unwrap();
    assert_eq!(card.confidence_kind(), ConfidenceKind::BallProbability);
    let samples = scored(&Localiser::new(card, weights, &Device::flex()).unwrap()).unwrap();
    let metrics = Metrics::of(&samples, BINS);
    assert_eq!(serde_json::to_value(&metrics).unwrap()["confidence_kind"], "ball-probability");
    // Balls of these pictures are of 4 to 11 px.
    assert!(samples.iter().all(|it| (2.0..12.0).contains(&it.confidence_radius)));
    assert!(samples.windows(2).any(|pair| pair[0].confidence_radius != pair[1].confidence_radius));
    let empty = serde_json::to_value(Metrics::of(&[], BINS)).unwrap();
    assert!(empty.get("confidence_kind").is_none());
}

#[test]
fn the_distance_is_euclidean() {
    let (found, truth) = (Point3::new(1.0, 2.0, 3.0), Point3::new(1.0, 5.0, 7.0));
    assert!((Sample { found, truth, ..sample("a", 0.0, 1.0) }.dtg() - 5.0).abs() < 1e-12);
}
