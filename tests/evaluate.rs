//! Metrics against numbers worked out by hand.

use gravisight::evaluate::{Bins, Metrics, Sample, Statistic, distance_to_ground_truth};
use nalgebra::{Point2, Point3};

fn sample(clip: &str, error: f64, depth: f64) -> Sample {
    Sample {
        clip: clip.into(),
        found: Point3::new(error, 0.0, 0.0),
        truth: Point3::origin(),
        true_depth: depth,
        true_range: depth * 2.0,
        found_image: Point2::new(3.0, 4.0),
        true_image: Point2::origin(),
    }
}

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
    let metrics = Metrics::of(&samples, Bins { count: 3, z_min: 1.0, z_max: 4.0 });
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
fn the_distance_is_euclidean() {
    assert!((distance_to_ground_truth([1.0, 2.0, 3.0], [1.0, 5.0, 7.0]) - 5.0).abs() < 1e-12);
}
