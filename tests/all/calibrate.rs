//! Cameras from labelled points: `cargo test --test all calibrate:: -- --nocapture` prints how far off they are.

use crate::clicking::Noise;
use crate::common::looking;
use gravisight::camera::CalibrationMethod;
use gravisight::parts::{Distortion, LensModel};
use gravisight::{Calibration, Camera, Court, Points, Scene, Size, Unknowns, calibrate};
use nalgebra::{Matrix3, Point2, Point3, Rotation3, Vector3};
use proptest::prelude::*;
use serde_json::Value;

const ONLY_POSE: Unknowns = Unknowns { focal: false, principal_point: false, distortion: 0 };

/// Clicks on `world` as `camera` sees it, with noise, px.
fn clicked(camera: &Camera, world: &[[f64; 3]], known: bool, noise: f64, seed: u64) -> Points {
    let mut random = Noise(seed);
    let world: Vec<Point3<f64>> = world.iter().map(|&point| Point3::from(point)).collect();
    let mut click = |point| {
        let image = camera.image_from_world(point).unwrap();
        Point2::new(image.x + noise * random.normal(), image.y + noise * random.normal())
    };
    Points {
        size: camera.size(),
        intrinsic: known.then(|| *camera.intrinsic()),
        distortion: Distortion::default(),
        names: Vec::new(),
        image: world.iter().map(&mut click).collect(),
        lines: Vec::new(),
        sigma: None,
        world,
    }
}

fn centre(camera: &Camera) -> Point3<f64> {
    camera.world_from_camera(&Point3::origin())
}

/// Indices of the clicks that were left out.
fn wrong_clicks(found: &Calibration) -> Vec<usize> {
    found.outliers.iter().map(|click| click.index).collect()
}

fn rotation(camera: &Camera) -> Matrix3<f64> {
    let origin = camera.camera_from_world(&Point3::origin());
    Matrix3::from_columns(
        &[0, 1, 2].map(|axis| camera.camera_from_world(&Point3::from(Vector3::ith(axis, 1.0))) - origin),
    )
}

/// Distance of two cameras: places, m, and directions, rad.
fn apart(a: &Camera, b: &Camera) -> (f64, f64) {
    let turn = Rotation3::from_matrix_unchecked(rotation(a) * rotation(b).transpose());
    // The angle by its sine: an arc cosine is blind to small ones.
    let m = turn.matrix();
    let sine = Vector3::new(m[(2, 1)] - m[(1, 2)], m[(0, 2)] - m[(2, 0)], m[(1, 0)] - m[(0, 1)]).norm() / 2.0;
    ((centre(a) - centre(b)).norm(), sine.asin())
}

/// Two heights of a box's corners.
const BOX: [[f64; 3]; 8] = [
    [0.0, 0.0, 0.0],
    [2.0, 0.0, 0.0],
    [2.0, 3.0, 0.0],
    [0.0, 3.0, 0.0],
    [0.0, 0.0, 1.5],
    [2.0, 0.0, 1.5],
    [2.0, 3.0, 1.5],
    [0.0, 3.0, 1.5],
];

#[test]
fn the_optimum_is_the_references() {
    let golden: Value = serde_json::from_str(include_str!("../golden/camera.json")).unwrap();
    let read = |value: &Value| -> Vec<Vec<f64>> { serde_json::from_value(value.clone()).unwrap() };
    let mut worst = (0.0_f64, 0.0_f64);
    for (index, case) in golden["calibration"].as_array().unwrap().iter().enumerate() {
        let matrix = |rows: &[Vec<f64>]| Matrix3::from_fn(|i, j| rows[i][j]);
        let points = Points {
            lines: Vec::new(),
            sigma: None,
            size: Size::new(384, 224),
            intrinsic: Some(matrix(&read(&case["M_int"]))),
            distortion: Distortion::default(),
            names: Vec::new(),
            world: read(&case["world"]).iter().map(|p| Point3::new(p[0], p[1], p[2])).collect(),
            image: read(&case["image"]).iter().map(|p| Point2::new(p[0], p[1])).collect(),
        };
        let optimum = read(&case["M_ext_opt"]);
        let translation = Vector3::from_fn(|i, _| optimum[i][3]);
        let expected = Camera::new(
            Size::new(384, 224),
            *points.intrinsic.as_ref().unwrap(),
            Distortion::default(),
            matrix(&optimum),
            translation,
        )
        .unwrap();
        let found = calibrate(&points, &ONLY_POSE).unwrap();
        assert!(found.outliers.is_empty(), "case {index}: {:?}", found.outliers);
        let cost = found.rms_px * found.rms_px * points.image.len() as f64;
        let reference = case["cost_opt"].as_f64().unwrap();
        assert!(cost <= reference * (1.0 + 1e-9) + 1e-12, "case {index}: {cost} px² instead of {reference}");
        let (place, direction) = apart(&found.camera, &expected);
        assert!(place < 1e-6 && direction < 1e-6, "case {index}: {place} m, {direction} rad");
        worst = (worst.0.max(place), worst.1.max(direction));
    }
    println!("16 reference cases: at most {:.1e} m and {:.1e} rad from the optimum", worst.0, worst.1);
}

#[test]
fn exact_clicks_give_the_camera_with_focal_length_and_lens() {
    let lens = Distortion { k1: -0.21, k2: 0.05, ..Distortion::default() };
    for (lens, distortion) in [(Distortion::default(), 0), (lens, 2)] {
        let camera = looking([6.0, -5.0, 3.0], [1.0, 1.5, 0.5], 900.0, Size::new(1280, 720), lens);
        let mut world = BOX.to_vec();
        world.extend([[1.0, 1.0, 0.7], [0.3, 2.2, 1.1], [1.7, 0.4, 0.2], [0.9, 2.9, 0.4]]);
        let unknowns = Unknowns { focal: true, distortion, ..ONLY_POSE };
        let found = calibrate(&clicked(&camera, &world, false, 0.0, 1), &unknowns).unwrap();
        let (place, direction) = apart(&found.camera, &camera);
        assert!(place < 1e-6 && direction < 1e-6, "{place} m, {direction} rad");
        assert!((found.camera.intrinsic()[(0, 0)] - 900.0).abs() < 1e-4);
        assert!((found.camera.distortion().k1 - lens.k1).abs() < 1e-6);
        assert_eq!(found.method, CalibrationMethod::DirectLinearTransform);
    }
}

#[test]
fn four_points_of_a_plane_are_enough() {
    let camera = looking([3.0, -8.0, 4.0], [0.0, 0.0, 0.0], 700.0, Size::new(960, 540), Distortion::default());
    let corners = [[-4.5, -9.0 + 7.0, 0.0], [4.5, -2.0, 0.0], [4.5, 9.0, 0.0], [-4.5, 9.0, 0.0]];
    for known in [true, false] {
        let found = calibrate(&clicked(&camera, &corners, known, 0.0, 1), &ONLY_POSE).unwrap();
        let (place, direction) = apart(&found.camera, &camera);
        assert!(place < 1e-6 && direction < 1e-6, "intrinsic known: {known}: {place} m, {direction} rad");
        assert_eq!(found.method, CalibrationMethod::Homography);
    }
}

#[test]
fn every_court_calibrates_from_clicks_of_half_a_pixel() {
    for name in Court::names() {
        let court = Court::named(name).unwrap();
        let reach = court.points.values().map(|p| p[0].hypot(p[1])).fold(0.0, f64::max);
        let camera = looking(
            [0.6 * reach, -1.9 * reach, 0.9 * reach],
            [0.0, 0.0, 0.0],
            1400.0,
            Size::new(1920, 1080),
            Distortion::default(),
        );
        let world: Vec<[f64; 3]> = court.points.values().copied().collect();
        let found = calibrate(&clicked(&camera, &world, false, 0.5, 7), &ONLY_POSE).unwrap();
        let (place, direction) = apart(&found.camera, &camera);
        println!(
            "{name}: {} points, camera {:.1} cm of {reach:.1} m off, {:.3}°",
            world.len(),
            100.0 * place,
            direction.to_degrees()
        );
        assert!(place < 0.02 * reach && direction < 0.01, "{name}: {place} m");
        assert!(found.outliers.is_empty() && (0.3..0.8).contains(&found.noise_px), "{name}: {:?}", found.outliers);
    }
}

#[test]
fn a_bent_lens_is_found_before_any_click_is_called_wrong() {
    let court = Court::named("tennis").unwrap();
    let world: Vec<[f64; 3]> = court.points.values().copied().filter(|point| point[2] == 0.0).collect();
    let (mut bent, mut wrong, mut worst) = (0, 0, 0.0_f64);
    let rounds = 12;
    for (index, [k1, k2]) in [[-0.15, 0.0], [-0.25, 0.08], [-0.38, 0.16]].into_iter().cycle().take(rounds).enumerate() {
        let lens = Distortion { k1, k2, ..Distortion::default() };
        let camera = looking([3.0, -22.0, 7.0], [0.0, 0.0, 0.0], 1300.0, Size::new(1920, 1080), lens);
        let points = clicked(&camera, &world, false, 1.0, 40 + index as u64);
        let found = calibrate(&points, &ONLY_POSE).unwrap();
        wrong += found.outliers.len();
        bent += usize::from(found.camera.distortion().k1 < -0.05);
        worst = worst.max(apart(&found.camera, &camera).0);
    }
    println!("{bent} of {rounds} lenses found, {wrong} clicks called wrong, camera at most {worst:.2} m off");
    assert!(bent >= rounds - 1 && wrong == 0 && worst < 0.6, "{bent} {wrong} {worst}");
    // A straight lens stays one, nearly always.
    let camera = looking([3.0, -22.0, 7.0], [0.0, 0.0, 0.0], 1300.0, Size::new(1920, 1080), Distortion::default());
    let straight = (0..20).filter(|&seed| {
        let found = calibrate(&clicked(&camera, &world, false, 1.0, 900 + seed), &ONLY_POSE).unwrap();
        found.camera.distortion().is_none()
    });
    let straight = straight.count();
    println!("{straight} of 20 straight lenses are straight");
    assert!(straight >= 18, "{straight}");
}

#[test]
fn anothers_intrinsic_is_doubted() {
    let court = Court::named("tennis").unwrap();
    let world: Vec<[f64; 3]> = court.points.values().copied().filter(|point| point[2] == 0.0).collect();
    let camera = looking([3.0, -22.0, 7.0], [0.0, 0.0, 0.0], 1300.0, Size::new(1920, 1080), Distortion::default());
    let mut points = clicked(&camera, &world, true, 1.0, 3);
    assert_eq!(calibrate(&points, &ONLY_POSE).unwrap().doubts, Vec::<String>::new());
    let intrinsic = points.intrinsic.as_mut().unwrap();
    (intrinsic[(0, 0)], intrinsic[(1, 1)]) = (700.0, 700.0);
    let doubts = calibrate(&points, &ONLY_POSE).unwrap().doubts;
    assert!(
        doubts.iter().any(|doubt| doubt.contains("`intrinsic`") && doubt.contains("misses the clicks by")),
        "{doubts:?}"
    );
}

#[test]
fn a_wrong_click_is_named_and_left_out() {
    let camera = looking([6.0, -5.0, 3.0], [1.0, 1.5, 0.5], 900.0, Size::new(1280, 720), Distortion::default());
    let mut world = BOX.to_vec();
    world.extend([[1.0, 1.0, 0.7], [0.3, 2.2, 1.1]]);
    for wrong in 0..world.len() {
        for known in [true, false] {
            let mut points = clicked(&camera, &world, known, 0.5, 11 + wrong as u64);
            points.image[wrong].x += 25.0;
            points.image[wrong].y -= 10.0;
            let found = calibrate(&points, &ONLY_POSE).unwrap();
            assert_eq!(wrong_clicks(&found), [wrong]);
            assert!(apart(&found.camera, &camera).0 < 5.0 * found.sigma.centre.norm());
        }
    }
    // Two points that were mixed up.
    let mut points = clicked(&camera, &world, true, 0.5, 5);
    points.image.swap(2, 6);
    assert_eq!(wrong_clicks(&calibrate(&points, &ONLY_POSE).unwrap()), [2, 6]);
}

#[test]
fn a_known_fisheye_gives_its_camera_and_is_not_estimated() {
    let lens = Distortion { model: LensModel::Fisheye, k1: 0.03, k2: -0.01, ..Distortion::default() };
    let camera = looking([2.5, -1.5, 3.0], [1.0, 1.5, 0.5], 420.0, Size::new(1280, 720), lens);
    let mut points = clicked(&camera, &BOX, true, 0.0, 1);
    points.distortion = lens;
    let found = calibrate(&points, &ONLY_POSE).unwrap();
    assert!(apart(&found.camera, &camera).0 < 1e-6);
    assert!(found.doubts.is_empty(), "{:?}", found.doubts);
    let error = calibrate(&points, &Unknowns { distortion: 2, ..ONLY_POSE }).unwrap_err().to_string();
    assert!(error.contains("fisheye"), "{error}");
}

#[test]
fn a_click_that_the_known_lens_cannot_have_seen_is_left_out_by_name() {
    // The lens folds at a distorted radius of 0.574: 517 px from the picture's middle.
    let lens = Distortion { k1: -0.45, ..Distortion::default() };
    let camera = looking([6.0, -5.0, 3.0], [1.0, 1.5, 0.5], 900.0, Size::new(1280, 720), lens);
    let mut points = clicked(&camera, &BOX, true, 0.0, 1);
    points.distortion = lens;
    points.image[5] = Point2::new(5.0, 5.0);
    let found = calibrate(&points, &ONLY_POSE).unwrap();
    assert_eq!(wrong_clicks(&found), [5]);
    assert!(apart(&found.camera, &camera).0 < 1e-6);
    // Where too few are left, the answer says which one is missing.
    let mut few = clicked(&camera, &BOX[..4], true, 0.0, 1);
    few.distortion = lens;
    few.names = ["left", "right", "far right", "far left"].map(String::from).to_vec();
    few.image[2] = Point2::new(5.0, 5.0);
    let error = calibrate(&few, &ONLY_POSE).unwrap_err().to_string();
    assert!(error.contains("too few points (3)") && error.contains("`far right`"), "{error}");
}

#[test]
fn the_stated_uncertainty_is_the_one_found() {
    let camera = looking([6.0, -5.0, 3.0], [1.0, 1.5, 0.5], 900.0, Size::new(1280, 720), Distortion::default());
    let (image, depth) = (Point2::new(700.0, 300.0), 6.0);
    let ball = camera.world_from_image(&image, depth).unwrap();
    for known in [true, false] {
        let (mut squares, mut stated) = ([0.0; 2], [0.0; 2]);
        let rounds = 200;
        for seed in 0..rounds {
            let found = calibrate(&clicked(&camera, &BOX, known, 1.0, 1000 + seed), &ONLY_POSE).unwrap();
            squares[0] += (centre(&found.camera) - centre(&camera)).norm_squared();
            squares[1] += (found.camera.world_from_image(&image, depth).unwrap() - ball).norm_squared();
            stated[0] += found.sigma.centre.norm_squared();
            stated[1] += found.sigma_at(&image, depth).unwrap().norm_squared();
        }
        for (what, square, stated) in [("camera", squares[0], stated[0]), ("ball", squares[1], stated[1])] {
            let ratio = (stated / square).sqrt();
            println!("{what}, intrinsic known {known}: stated over found 1-σ {ratio:.2}");
            assert!((0.85..1.2).contains(&ratio), "{what}, intrinsic known {known}: {ratio}");
        }
    }
}

#[test]
fn few_clicks_do_not_claim_to_be_exact() {
    // A tennis court from behind: its corners, the service lines' ends and their middles.
    let court: [[f64; 3]; 8] = [
        [-5.485, -11.885, 0.0],
        [5.485, -11.885, 0.0],
        [-5.485, 11.885, 0.0],
        [5.485, 11.885, 0.0],
        [-4.115, -6.4, 0.0],
        [4.115, 6.4, 0.0],
        [4.115, -6.4, 0.0],
        [-4.115, 6.4, 0.0],
    ];
    let camera = looking([2.0, -24.0, 7.0], [0.0, -2.0, 0.5], 1900.0, Size::new(1920, 1080), Distortion::default());
    for count in [4, 5, 6, 8] {
        let (mut within, mut far_below, mut all) = ([0; 2], 0, 0);
        for noise in [0.75, 1.5, 3.0] {
            // Of more clicks more are tried without: that takes long.
            let found = (0..240 / count as u64).filter_map(|seed| {
                let found = calibrate(&clicked(&camera, &court[..count], false, noise, 77 + seed), &ONLY_POSE).ok()?;
                Some(((centre(&found.camera) - centre(&camera)).norm(), found.sigma.centre.norm()))
            });
            let found: Vec<(f64, f64)> = found.collect();
            let truth = (found.iter().map(|(error, _)| error * error).sum::<f64>() / found.len() as f64).sqrt();
            all += found.len();
            far_below += found.iter().filter(|(_, sigma)| *sigma < truth / 4.0).count();
            for (times, within) in within.iter_mut().enumerate() {
                *within += found.iter().filter(|(error, sigma)| *error < (times + 1) as f64 * sigma).count();
            }
        }
        let percent = |count: usize| 100.0 * count as f64 / all as f64;
        let [one, two, below] = [within[0], within[1], far_below].map(percent);
        println!(
            "{count} clicks: within 1 and 2 sigma {one:.0} and {two:.0} %; sigma below a quarter of the truth in {below:.1} %"
        );
        // The error is nearly all along the view: 68 and 95 % of a Gaussian's.
        assert!(all > 80 && below < 1.0, "{count} clicks: {below} %");
        assert!((60.0..92.0).contains(&one) && two > 88.0, "{count} clicks: {one} and {two} %");
    }
}

#[test]
fn points_that_fix_no_camera_are_refused_with_what_to_add() {
    let camera = looking([6.0, -5.0, 3.0], [1.0, 1.5, 0.5], 900.0, Size::new(1280, 720), Distortion::default());
    let refused = |world: &[[f64; 3]], known: bool| {
        calibrate(&clicked(&camera, world, known, 0.0, 1), &ONLY_POSE).unwrap_err().to_string()
    };
    let line: Vec<[f64; 3]> = (0..8).map(|i| [0.3 * f64::from(i), 0.2, 0.1]).collect();
    assert!(refused(&line, true).contains("one line"), "{}", refused(&line, true));
    assert!(refused(&BOX[..3], true).contains("too few"));
    let space = [BOX[0], BOX[2], BOX[5], BOX[7]];
    assert!(refused(&space, true).contains("at least 6"), "{}", refused(&space, true));
    // A plane that faces the camera does not tell the focal length from the distance.
    let facing = looking([0.0, -10.0, 0.0], [0.0, 0.0, 0.0], 900.0, Size::new(1280, 720), Distortion::default());
    let wall: Vec<[f64; 3]> = (0..9).map(|i| [f64::from(i % 3), 0.0, f64::from(i / 3)]).collect();
    let error = calibrate(&clicked(&facing, &wall, false, 0.0, 1), &ONLY_POSE).unwrap_err();
    assert!(error.to_string().contains("off the plane"), "{error}");
    assert_eq!(error.code(), "calibration");
    // A click 100 px off on a poster that faces the camera: the focal length grows without bound.
    let poster = Points {
        world: [[0.0, 1.0], [1.4, 1.0], [1.4, 0.0], [0.0, 0.0]].map(|[x, z]| Point3::new(x, 0.0, z)).to_vec(),
        image: [[273.0, 202.0], [1075.0, 189.0], [1187.0, 869.0], [261.0, 778.0]].map(Point2::from).to_vec(),
        size: Size::new(1920, 1080),
        ..clicked(&facing, &wall, false, 0.0, 1)
    };
    let error = calibrate(&poster, &Unknowns::default()).unwrap_err();
    assert!(error.code() == "calibration" && error.to_string().contains("on its point"), "{error}");
    // A world that is left-handed has its points behind the camera, or fits badly.
    let mut mirrored = clicked(&camera, &BOX, true, 0.0, 1);
    mirrored.world.iter_mut().for_each(|point| point.x = -point.x);
    assert!(calibrate(&mirrored, &ONLY_POSE).map_or(true, |found| found.rms_px > 10.0));
}

#[test]
fn points_on_a_line_and_points_in_centimetres_are_told() {
    // A tennis court's; four of the five on its left singles side line.
    let on_a_line = r#"{"width": 1920, "height": 1080, "court": "tennis", "names": ["far singles corner left", "far service line left",
        "near service line left", "near singles corner left", "far centre mark"],
        "image": [[1784.05, 1272.44], [1418.48, 775.2], [1182.3, 453.95], [1141.23, 398.1], [973.49, 1276.11]]}"#;
    let points = Points::from_json(on_a_line, "points.json").unwrap();
    let error = calibrate(&points, &Unknowns::default()).unwrap_err().to_string();
    assert!(error.contains("4 of these 5 points lie on one line") && error.contains("click more"), "{error}");
    let court = |scale: f64| {
        let corners = [[0.0, 0.0, 0.0], [10.97, 0.0, 0.0], [0.0, 23.77, 0.0], [10.97, 23.77, 0.0]];
        let world: Vec<[f64; 3]> = corners.iter().map(|corner| corner.map(|value| scale * value)).collect();
        let text = serde_json::json!({"width": 1920, "height": 1080, "world": world,
            "image": [[310, 812], [1679, 821.5], [618.5, 285], [1373, 286]]});
        let points = Points::from_json(&text.to_string(), "points.json").unwrap();
        calibrate(&points, &Unknowns::default()).unwrap().doubts
    };
    let units =
        |doubts: &[String]| doubts.iter().any(|doubt| doubt.contains("centimetres") && doubt.contains("divide"));
    assert!(!units(&court(1.0)), "{:?}", court(1.0));
    assert!(units(&court(100.0)) && units(&court(1000.0)), "{:?}", court(100.0));
}

/// A table seen from its side, whose corners were named as they lie in the picture.
#[test]
fn a_court_that_is_named_along_its_other_side_is_told() {
    let forward = Vector3::new(-3.0, 0.4, -1.2).normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    let rotation = Matrix3::from_rows(&[right, forward.cross(&right), forward].map(|row| row.transpose()));
    let place = Vector3::new(3.0, -0.4, 1.96);
    let image = |[x, y]: [f64; 2]| {
        let seen = rotation * (Vector3::new(x, y, 0.76) - place);
        [959.5 + 1500.0 * seen.x / seen.z, 539.5 + 1500.0 * seen.y / seen.z]
    };
    let names = ["near corner left", "near corner right", "far corner left", "far corner right"];
    let doubts = |corners: [[f64; 2]; 4]| {
        let text = serde_json::json!({"width": 1920, "height": 1080, "court": "table-tennis", "names": names,
            "image": corners.map(image)});
        let points = Points::from_json(&text.to_string(), "points.json").unwrap();
        calibrate(&points, &Unknowns::default()).map_or(vec![], |found| found.doubts)
    };
    let told = |doubts: &[String]| doubts.iter().any(|doubt| doubt.contains("turned by 90°"));
    let (x, y) = (0.7625, 1.37);
    let right_names = doubts([[-x, -y], [x, -y], [-x, y], [x, y]]);
    assert!(!told(&right_names), "{right_names:?}");
    let as_they_lie = doubts([[x, -y], [x, y], [-x, -y], [-x, y]]);
    assert!(told(&as_they_lie), "{as_they_lie:?}");
}

#[test]
fn files_are_read_with_their_errors() {
    let text = r#"{"width": 960, "height": 540, "court": "tennis", "names": ["near service T", "far service T"],
        "image": [[1, 2], [3, 4]]}"#;
    let points = Points::from_json(text, "points.json").unwrap();
    assert_eq!(points.world[0], Point3::new(0.0, -6.4, 0.0));
    for (text, expected) in [
        (text.replace("far service T", "far service X"), "not a point of tennis"),
        (text.replace("tennis", "tenis"), "choose one of badminton"),
        (text.replace("[3, 4]", "[3, 4], [5, 6]"), "has 3 points"),
        (text.replace("960", "0"), "width"),
        (text.replace("\"names\"", "\"nmes\""), "nmes"),
        (text.replace("[3, 4]", "[3, NaN]"), "points.json"),
        (text.replace("\"image\"", "\"sigma_px\": 0, \"image\""), "sigma_px"),
    ] {
        let error = Points::from_json(&text, "points.json").unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn odd_points_are_refused_or_give_finite_cameras(
        points in prop::collection::vec((prop::array::uniform3(prop_oneof![-9.0..9.0_f64, Just(0.0), Just(1e8)]), prop::array::uniform2(-2e3..2e3_f64)), 0..12),
        focal in any::<bool>(),
        principal_point in any::<bool>(),
        distortion in 0..6_usize,
        known in any::<bool>(),
    ) {
        let (world, image): (Vec<_>, Vec<_>) = points.into_iter().map(|(w, i)| (Point3::from(w), Point2::from(i))).unzip();
        let intrinsic = known.then(|| Matrix3::new(800.0, 0.0, 320.0, 0.0, 800.0, 240.0, 0.0, 0.0, 1.0));
        let points = Points { size: Size::new(640, 480), intrinsic, distortion: Distortion::default(), names: Vec::new(), world, image, lines: Vec::new(), sigma: None };
        if let Ok(found) = calibrate(&points, &Unknowns { focal, principal_point, distortion }) {
            prop_assert!(found.rms_px.is_finite() && found.sigma.centre.iter().all(|sigma| sigma.is_finite()));
        }
    }

    #[test]
    fn odd_texts_are_refused(text in ".{0,80}") {
        prop_assert!(Points::from_json(&text, "points.json").is_err());
    }
}

#[test]
fn a_scenes_lines_are_where_the_court_of_the_same_name_has_its_points() {
    for name in ["tennis", "volleyball", "badminton", "table-tennis", "pickleball"] {
        let scene = Scene::named(name).unwrap();
        let court = Court::named(name).unwrap();
        for corner in ["near corner left", "far corner right", "near doubles corner left", "far doubles corner right"] {
            if let Some(point) = court.points.get(corner) {
                assert!(scene.lines.iter().flatten().any(|end| end == point), "{name}: {corner}");
            }
        }
    }
}
