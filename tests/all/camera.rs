//! The camera against a reference that is not ours, its inverse laws, and what it refuses.

use crate::common::golden;
use gravisight::Error;
use gravisight::parts::{Distortion, LensModel};
use gravisight::{Camera, Size};
use nalgebra::{Matrix3, Point2, Point3, Rotation3, Vector3};
use proptest::prelude::*;
use serde_json::{Value, json};

/// Largest difference from the reference.
const TOLERANCE: f64 = 1e-9;

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    serde_json::from_value::<Vec<f64>>(value.clone()).unwrap().try_into().unwrap()
}

fn camera_file(case: &Value) -> Value {
    json!({"width": case["size"][0], "height": case["size"][1], "intrinsic": case["M_int"],
           "camera_from_world": case["M_ext"]})
}

fn parse(file: &Value) -> Result<Camera, Error> {
    Camera::from_json(&file.to_string(), "camera.json")
}

/// A camera of the samples.
fn good() -> Value {
    json!({"width": 224, "height": 224,
           "intrinsic": [[270.39, 0.0, 111.5], [0.0, 270.39, 111.5], [0.0, 0.0, 1.0]],
           "camera_from_world": [[1.0, 0.0, 0.0, 0.5], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 4.0], [0.0, 0.0, 0.0, 1.0]]})
}

fn assert_close(found: &[f64], expected: &[f64], what: &str) {
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() <= TOLERANCE, "{what}: {found} {expected}");
    }
}

#[test]
fn projection_and_its_inverse_equal_the_reference() {
    let file: Value = serde_json::from_slice(&golden("camera.json")).unwrap();
    let cases = file["projection"].as_array().unwrap();
    assert!(cases.len() > 3);
    for case in cases {
        let camera = parse(&camera_file(case)).unwrap();
        let in_world = Point3::from(numbers::<3>(&case["world"]));
        let in_camera = camera.camera_from_world(&in_world);
        assert_close(in_camera.coords.as_slice(), &numbers::<3>(&case["camera"]), "camera");
        let (image, d_world) = camera.image_from_world_with_jacobian(&in_world).unwrap();
        assert_close(image.coords.as_slice(), &numbers::<2>(&case["image"]), "image");
        for row in 0..2 {
            let found: Vec<f64> = d_world.row(row).iter().copied().collect();
            assert_close(&found, &numbers::<3>(&case["duv_dworld"][row]), "duv_dworld");
        }
        let depth = case["depth"].as_f64().unwrap();
        let (back, d_image) = camera.world_from_image_with_jacobian(&image, depth).unwrap();
        assert_close(back.coords.as_slice(), in_world.coords.as_slice(), "world");
        for row in 0..3 {
            let found: Vec<f64> = d_image.row(row).iter().copied().collect();
            assert_close(&found, &numbers::<3>(&case["dworld_d_uvz"][row]), "dworld_d_uvz");
        }
    }
}

/// Real lenses: barrel and pincushion with tangential terms, rational, fisheye.
fn any_lens() -> impl Strategy<Value = Distortion> {
    let brown = (-0.3..0.2_f64, -0.05..0.1_f64, -0.01..0.01_f64, -0.01..0.01_f64, -0.02..0.02_f64)
        .prop_map(|(k1, k2, p1, p2, k3)| Distortion { k1, k2, p1, p2, k3, ..Distortion::default() });
    let rational = (brown.clone(), -0.3..0.3_f64, -0.2..0.2_f64, -0.05..0.05_f64)
        .prop_map(|(lens, k4, k5, k6)| Distortion { k4, k5, k6, ..lens });
    let fisheye = (-0.05..0.1_f64, -0.02..0.02_f64, -0.01..0.01_f64, -0.002..0.002_f64)
        .prop_map(|(k1, k2, k3, k4)| Distortion { model: LensModel::Fisheye, k1, k2, k3, k4, ..Distortion::default() });
    prop_oneof![brown, rational, fisheye]
}

/// Cameras with real lenses and skew.
fn any_camera() -> impl Strategy<Value = Camera> {
    let pose = (-3.0..3.0_f64, -3.0..3.0_f64, -3.0..3.0_f64, -5.0..5.0_f64, -5.0..5.0_f64, -5.0..5.0_f64);
    (any_lens(), pose, 300.0..1500.0_f64, -5.0..5.0_f64).prop_map(|(distortion, (a, b, c, x, y, z), f, skew)| {
        let intrinsic = Matrix3::new(f, skew, 320.0, 0.0, 1.1 * f, 240.0, 0.0, 0.0, 1.0);
        let rotation = Rotation3::from_scaled_axis(Vector3::new(a, b, c)).into_inner();
        Camera::new(Size::new(640, 480), intrinsic, distortion, rotation, Vector3::new(x, y, z)).unwrap()
    })
}

proptest! {
    #[test]
    fn unprojecting_a_projected_point_gives_it_back(
        camera in any_camera(), x in -0.45..0.45_f64, y in -0.35..0.35_f64, depth in 0.3..30.0_f64,
    ) {
        let in_world = camera.world_from_camera(&Point3::new(x * depth, y * depth, depth));
        let image = camera.image_from_world(&in_world).unwrap();
        let back = camera.world_from_image(&image, depth).unwrap();
        prop_assert!((back - in_world).norm() < 1e-8 * depth.max(1.0), "{}", (back - in_world).norm());
    }

    #[test]
    fn jacobians_equal_central_differences(camera in any_camera(), x in -0.4..0.4_f64, y in -0.3..0.3_f64, depth in 1.0..10.0_f64) {
        let step = 1e-5;
        let in_camera = Point3::new(x * depth, y * depth, depth);
        let (image, jacobian) = camera.image_from_camera_with_jacobian(&in_camera).unwrap();
        for axis in 0..3 {
            let offset = Vector3::ith(axis, step);
            let plus = camera.image_from_camera(&(in_camera + offset)).unwrap();
            let minus = camera.image_from_camera(&(in_camera - offset)).unwrap();
            let difference = (plus - minus) / (2.0 * step) - jacobian.column(axis);
            prop_assert!(difference.norm() < 1e-4 * jacobian.norm(), "d image / d camera {axis}: {difference}");
        }
        let (_, inverse) = camera.world_from_image_with_jacobian(&image, depth).unwrap();
        for axis in 0..3 {
            let offset = Vector3::ith(axis, step);
            let at = |sign: f64| {
                let moved = Point2::new(image.x + sign * offset.x, image.y + sign * offset.y);
                camera.world_from_image(&moved, depth + sign * offset.z).unwrap()
            };
            let difference = (at(1.0) - at(-1.0)) / (2.0 * step) - inverse.column(axis);
            prop_assert!(difference.norm() < 1e-4 * inverse.norm(), "d world / d image {axis}: {difference}");
        }
    }

    #[test]
    fn a_resized_camera_sees_a_point_where_the_resized_picture_shows_it(
        camera in any_camera(), x in -0.4..0.4_f64, y in -0.3..0.3_f64, width in 100..2000_u32, height in 100..2000_u32,
    ) {
        let in_world = camera.world_from_camera(&Point3::new(x * 3.0, y * 3.0, 3.0));
        let image = camera.image_from_world(&in_world).unwrap();
        let resized = camera.resized(Size { width, height }).unwrap().image_from_world(&in_world).unwrap();
        // Pixel-centre rule: the picture spans [-1/2, size - 1/2].
        prop_assert!(((image.x + 0.5) / 640.0 - (resized.x + 0.5) / f64::from(width)).abs() < 1e-9);
        prop_assert!(((image.y + 0.5) / 480.0 - (resized.y + 0.5) / f64::from(height)).abs() < 1e-9);
        let cropped = camera.cropped([10.0, 20.0], Size::square(100)).unwrap().image_from_world(&in_world).unwrap();
        prop_assert!((cropped - Point2::new(image.x - 10.0, image.y - 20.0)).norm() < 1e-9);
    }

    #[test]
    fn camera_json_survives_writing_and_reading(camera in any_camera()) {
        let text = serde_json::to_string(&camera).unwrap();
        let back = Camera::from_json(&text, "camera.json").unwrap();
        prop_assert_eq!(back.size(), Size::new(640, 480));
        prop_assert!((back.intrinsic() - camera.intrinsic()).amax() < 1e-9);
        let point = Point3::new(1.0, 2.0, 3.0);
        prop_assert!((back.camera_from_world(&point) - camera.camera_from_world(&point)).norm() < 1e-12);
        prop_assert_eq!(back.distortion().model, camera.distortion().model);
        let coefficients = |camera: &Camera| [camera.distortion().k1, camera.distortion().p2, camera.distortion().k4, camera.distortion().k6];
        for (found, written) in coefficients(&back).iter().zip(coefficients(&camera)) {
            prop_assert!((found - written).abs() < 1e-12);
        }
    }
}

#[test]
fn a_row_is_read_when_it_was_whatever_part_of_the_picture_is_kept() {
    let camera = parse(&good()).unwrap().with_readout(0.02).unwrap();
    let height = f64::from(camera.size().height);
    let cropped = camera.cropped([10.0, 100.0], Size::new(50, 120)).unwrap();
    let again = cropped.cropped([3.0, 40.0], Size::new(20, 30)).unwrap();
    let written = Camera::from_json(&serde_json::to_string(&again).unwrap(), "camera.json").unwrap();
    for row in [0.0, 7.5, 29.0] {
        let expected = 0.02 * (row + 140.5) / height;
        assert!((camera.row_time(row + 140.0) - expected).abs() < 1e-12);
        for camera in [&again, &written] {
            assert!((camera.row_time(row) - expected).abs() < 1e-12, "{row}: {}", camera.row_time(row));
        }
        assert!((cropped.row_time(row + 40.0) - expected).abs() < 1e-12);
    }
    // Half as large, a row is two.
    let half = cropped.resized(Size::new(25, 60)).unwrap();
    assert!((half.row_time(19.5) - cropped.row_time(39.5)).abs() < 1e-12);
    let error = parse(&good()).unwrap().with_readout(f64::NAN).unwrap_err();
    assert!(error.to_string().contains("readout_s"), "{error}");
}

#[test]
fn a_point_behind_the_camera_has_no_image() {
    let camera = parse(&good()).unwrap();
    for depth in [-1.0, 0.0, f64::NAN] {
        let error = camera.image_from_camera(&Point3::new(0.0, 0.0, depth)).unwrap_err();
        assert!(matches!(error, Error::BehindCamera { .. }), "{error}");
    }
    assert!(matches!(camera.camera_from_image(&Point2::origin(), -2.0), Err(Error::BehindCamera { .. })));
}

#[test]
fn a_pixel_outside_the_lens_model_is_refused() {
    // r·(1 − r²) never exceeds 0.385: no ideal point has its image at r = 0.8.
    let lens = Distortion { k1: -1.0, ..Distortion::default() };
    let identity = Matrix3::identity();
    let intrinsic = Matrix3::new(100.0, 0.0, 50.0, 0.0, 100.0, 50.0, 0.0, 0.0, 1.0);
    let camera = Camera::new(Size::square(100), intrinsic, lens, identity, Vector3::zeros()).unwrap();
    let error = camera.camera_from_image(&Point2::new(130.0, 50.0), 1.0).unwrap_err();
    assert!(matches!(error, Error::Distortion { .. }), "{error}");
}

#[test]
fn a_pixel_beyond_the_lens_fold_is_not_found_on_a_later_branch() {
    // The image folds at a distorted radius of 0.6; the model grows again far outside.
    let lens = Distortion { k1: -0.5, k2: 0.1, ..Distortion::default() };
    assert!(lens.undistort([0.5, 0.0].into()).is_ok());
    for radius in [0.62, 0.9, 1.34, 3.0] {
        let error = lens.undistort([radius, 0.0].into()).unwrap_err();
        assert!(matches!(error, Error::Distortion { .. }), "{radius}: {error}");
    }
}

fn with_lens(lens: Distortion) -> Camera {
    let intrinsic = Matrix3::new(100.0, 0.0, 50.0, 0.0, 100.0, 50.0, 0.0, 0.0, 1.0);
    Camera::new(Size::square(100), intrinsic, lens, Matrix3::identity(), Vector3::zeros()).unwrap()
}

#[test]
fn a_point_beyond_the_lens_fold_has_no_image_though_the_model_would_put_it_into_the_picture() {
    // r·(1 − 0.26·r² + 0.89·r⁴ − 3.4·r⁶) grows up to r = 0.62 only, and is 0 again at r = 0.87.
    let camera =
        with_lens(Distortion { k1: -0.26, k2: 0.89, p1: 0.004, p2: -0.002, k3: -3.4, ..Distortion::default() });
    for (radius, is_seen) in [(0.0, true), (0.5, true), (0.6, true), (0.64, false), (0.87, false), (40.0, false)] {
        for turn in 0..12 {
            let (sin, cos) = (f64::from(turn) * 0.52).sin_cos();
            let image = camera.image_from_camera(&Point3::new(3.0 * radius * cos, 3.0 * radius * sin, 3.0));
            match is_seen {
                true => assert!(image.is_ok(), "{radius}: {image:?}"),
                false => assert_eq!(image.unwrap_err().code(), "distortion", "{radius}"),
            }
        }
    }
    // A lens that nowhere folds sees everything in front of it.
    let wide = with_lens(Distortion { k1: -0.2, k2: 0.05, ..Distortion::default() });
    assert!(wide.image_from_camera(&Point3::new(20.0, 3.0, 1.0)).is_ok());
}

/// Points, and their images by OpenCV 5.0: `cv2.projectPoints` with these 8 coefficients, `cv2.fisheye.projectPoints` with these 4, no
/// rotation, no translation.
#[test]
fn rational_and_fisheye_lenses_equal_opencvs_and_their_inverse_gives_the_point_back() {
    let rational = Distortion {
        k1: 0.9,
        k2: -0.35,
        p1: 0.0012,
        p2: -0.0007,
        k3: 0.04,
        k4: 1.15,
        k5: -0.22,
        k6: 0.015,
        ..Distortion::default()
    };
    let fisheye =
        Distortion { model: LensModel::Fisheye, k1: 0.04, k2: -0.012, k3: 0.006, k4: -0.0011, ..Distortion::default() };
    let of_rational = [
        ([0.1, 0.2, 1.0], [741.273759783156, 560.940310558558]),
        ([-0.7, 0.35, 1.0], [18.105790225472, 672.927278037575]),
        ([0.55, -0.42, 1.0], [1141.380744194184, -17.267095948686]),
        ([-1.1, -0.8, 2.0], [138.461754215622, -0.990471319208]),
        ([0.9, 0.9, 1.0], [1302.597567980737, 1023.168197743209]),
    ];
    let of_fisheye = [
        ([0.1, 0.2, 1.0], [688.813293598859, 456.482309751060]),
        ([-0.7, 0.35, 1.0], [351.906020884821, 506.443668767766]),
        ([1.6, -1.1, 1.0], [1091.499777707436, 54.164214689362]),
        ([-3.0, -2.0, 1.0], [94.506118017673, -0.893160538267]),
        ([5.0, 0.9, 0.5], [1383.949964596095, 495.334156153850]),
    ];
    for (lens, [fx, fy], points) in [(rational, [1010.0, 1005.0], of_rational), (fisheye, [480.0, 478.0], of_fisheye)] {
        let intrinsic = Matrix3::new(fx, 0.0, 641.5, 0.0, fy, 362.25, 0.0, 0.0, 1.0);
        let camera = Camera::new(Size::new(1280, 720), intrinsic, lens, Matrix3::identity(), Vector3::zeros()).unwrap();
        for (point, expected) in points {
            let image = camera.image_from_camera(&point.into()).unwrap();
            assert_close(image.coords.as_slice(), &expected, "image");
            let again = camera.image_from_camera(&camera.camera_from_image(&image, point[2]).unwrap()).unwrap();
            assert_close(again.coords.as_slice(), &expected, "there and back");
        }
    }
}

#[test]
fn a_fisheye_ends_where_its_radius_no_longer_grows_or_beside_the_camera() {
    let equidistant = Distortion { model: LensModel::Fisheye, ..Distortion::default() };
    assert!((equidistant.undistort([0.25 * std::f64::consts::PI, 0.0].into()).unwrap().x - 1.0).abs() < 1e-12);
    assert_eq!(equidistant.undistort([1.6, 0.0].into()).unwrap_err().code(), "distortion");
    assert_eq!(equidistant.undistort([0.0, 0.0].into()).unwrap().norm(), 0.0);
    // θ·(1 − θ²/3) grows up to θ = 1, where it is 2/3.
    let folds = Distortion { k1: -1.0 / 3.0, ..equidistant };
    assert!(folds.undistort([0.0, 0.66].into()).is_ok() && folds.undistort([0.0, 0.67].into()).is_err());
    let camera = with_lens(folds);
    assert!(camera.image_from_camera(&Point3::new(0.99_f64.tan(), 0.0, 1.0)).is_ok());
    assert_eq!(camera.image_from_camera(&Point3::new(1.01_f64.tan(), 0.0, 1.0)).unwrap_err().code(), "distortion");
    assert_eq!(camera.image_from_camera(&Point3::new(1.0, 0.0, 0.0)).unwrap_err().code(), "behind-camera");
}

#[test]
fn a_rational_lens_ends_where_its_denominator_is_zero() {
    // 1 − r²/4 is 0 at r = 2, where the image is infinitely far out; beyond, the model comes back from the other side.
    let camera = with_lens(Distortion { k4: -0.25, ..Distortion::default() });
    assert!(camera.image_from_camera(&Point3::new(0.0, 1.99, 1.0)).is_ok());
    assert_eq!(camera.image_from_camera(&Point3::new(0.0, 2.01, 1.0)).unwrap_err().code(), "distortion");
}

#[test]
fn coefficients_that_a_fisheye_does_not_have_are_refused() {
    let mut file = good();
    file["distortion"] = json!({"model": "fisheye", "k1": 0.1, "p1": 0.01});
    assert!(parse(&file).unwrap_err().to_string().contains("p1"));
    file["distortion"] = json!({"model": "fisheye", "k1": 0.1});
    assert!(parse(&file).unwrap().distortion().is_fisheye());
    file["distortion"] = json!({"model": "omni"});
    assert!(parse(&file).unwrap_err().to_string().contains("omni"));
}

proptest! {
    #[test]
    fn what_has_an_image_is_found_again_from_it(
        k1 in -1.0..0.5_f64, k2 in -1.0..1.0_f64, k3 in -4.0..4.0_f64, p1 in -0.05..0.05_f64, p2 in -0.05..0.05_f64,
        [k4, k5, k6] in prop_oneof![Just([0.0; 3]), [-1.0..1.0_f64, -1.0..1.0_f64, -1.0..1.0_f64]],
        x in -2.0..2.0_f64, y in -2.0..2.0_f64,
    ) {
        let camera = with_lens(Distortion { k1, k2, p1, p2, k3, k4, k5, k6, ..Distortion::default() });
        let point = Point3::new(x, y, 1.0);
        // At the fold itself two points meet in one image.
        prop_assume!(camera.image_from_camera(&Point3::new(1.02 * x, 1.02 * y, 1.0)).is_ok());
        let image = camera.image_from_camera(&point).unwrap();
        if let Ok(back) = camera.camera_from_image(&image, 1.0) {
            prop_assert!((back - point).norm() < 1e-6, "{point} has the image of {back}");
        }
    }
}

#[test]
fn a_camera_of_another_size_is_scaled_if_the_aspect_ratio_agrees_and_refused_otherwise() {
    let camera = parse(&good()).unwrap();
    let scaled = camera.for_picture(Size::square(448)).unwrap();
    assert!((scaled.intrinsic()[(0, 0)] - 2.0 * 270.39).abs() < 1e-9);
    assert!((scaled.intrinsic()[(0, 2)] - 223.5).abs() < 1e-9);
    let error = camera.for_picture(Size::new(640, 480)).unwrap_err();
    let Error::CameraMismatch { camera, picture } = &error else { panic!("{error}") };
    assert_eq!((*camera, *picture), (Size::square(224), Size::new(640, 480)));
    assert!(error.to_string().contains("224×224") && error.to_string().contains("640×480"), "{error}");
}

#[test]
fn bad_cameras_are_refused_with_the_field() {
    let cases: [(&str, Value, &str); 12] = [
        ("/intrinsic/0/2", json!(1e308), "1e9"),
        ("/camera_from_world/0/3", json!(1.7e308), "1e9"),
        ("/intrinsic/0/0", json!(0.0), "singular"),
        ("/intrinsic/0/0", json!(null), "invalid type"),
        ("/intrinsic/1/0", json!(3.0), "intrinsic"),
        ("/intrinsic/1/1", json!(-200.0), "focal"),
        ("/camera_from_world/0/0", json!(0.0), "singular"),
        ("/camera_from_world/0/0", json!(2.0), "rotation"),
        ("/camera_from_world/3/3", json!(2.0), "0 0 0 1"),
        ("/camera_from_world/1", json!([1.0, 2.0]), "invalid length"),
        ("/width", json!(0), "width"),
        ("/height", json!(1.5), "invalid type"),
    ];
    for (pointer, value, named) in cases {
        let mut file = good();
        *file.pointer_mut(pointer).unwrap() = value;
        let error = parse(&file).unwrap_err();
        assert!(error.to_string().contains(named), "{pointer}: {error}");
        assert!(error.code().starts_with("camera-"), "{}", error.code());
    }
    let huge = good().to_string().replace("270.39", "1e999");
    assert!(Camera::from_json(&huge, "camera.json").unwrap_err().to_string().contains("range"));
    let infinite = Matrix3::new(f64::INFINITY, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0);
    let error = Camera::new(Size::square(9), infinite, Distortion::default(), Matrix3::identity(), Vector3::zeros());
    assert!(error.unwrap_err().to_string().contains("NaN, infinity"));
}

#[test]
fn unknown_and_missing_fields_are_named() {
    let mut file = good();
    file["focal"] = json!(3);
    assert!(parse(&file).unwrap_err().to_string().contains("focal"));
    let mut file = good();
    file["distortion"] = json!({"k7": 1.0});
    assert!(parse(&file).unwrap_err().to_string().contains("k7"));
    for field in ["width", "height", "intrinsic", "camera_from_world"] {
        let mut file = good();
        file.as_object_mut().unwrap().remove(field);
        assert!(parse(&file).unwrap_err().to_string().contains(field));
    }
}

/// At (0, −6, 2), looking at the origin: where a court's landmarks are.
fn standing(change: impl Fn(&mut Matrix3<f64>, &mut Matrix3<f64>, &mut Vector3<f64>)) -> Camera {
    let forward = Vector3::new(0.0, 6.0, -2.0).normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    let mut rotation = Matrix3::from_rows(&[right.transpose(), forward.cross(&right).transpose(), forward.transpose()]);
    let mut intrinsic = Matrix3::new(900.0, 0.0, 639.5, 0.0, 900.0, 359.5, 0.0, 0.0, 1.0);
    let mut translation = -(rotation * Vector3::new(0.0, -6.0, 2.0));
    change(&mut intrinsic, &mut rotation, &mut translation);
    Camera::new(Size::new(1280, 720), intrinsic, Distortion::default(), rotation, translation).unwrap()
}

#[test]
fn a_camera_that_cannot_be_is_doubted_in_words() {
    let around = [[-1.0, 0.0, 0.0], [1.0, 0.5, 0.3]].map(Point3::from);
    assert_eq!(standing(|_, _, _| ()).doubts(Some(0.0), &around), Vec::<String>::new());
    assert_eq!(standing(|_, _, _| ()).doubts(None, &[]), Vec::<String>::new());
    type Change = fn(&mut Matrix3<f64>, &mut Matrix3<f64>, &mut Vector3<f64>);
    let cases: [(&str, Change); 7] = [
        ("below", |_, rotation, translation| *translation = -(*rotation * Vector3::new(0.0, -6.0, -2.0))),
        ("divide the last column", |_, _, translation| *translation *= 1000.0),
        ("principal point", |intrinsic, _, _| intrinsic[(0, 2)] = 1919.5),
        ("differ by a factor of", |intrinsic, _, _| intrinsic[(1, 1)] = 500.0),
        ("has no lens distortion", |intrinsic, _, _| (intrinsic[(0, 0)], intrinsic[(1, 1)]) = (400.0, 400.0)),
        ("upside down", |_, rotation, translation| {
            let half_turn = Matrix3::from_diagonal(&Vector3::new(-1.0, -1.0, 1.0));
            (*rotation, *translation) = (half_turn * *rotation, half_turn * *translation);
        }),
        ("were inverted", |_, rotation, translation| {
            (*rotation, *translation) = (rotation.transpose(), -(rotation.transpose() * *translation));
        }),
    ];
    for (words, change) in cases {
        let doubts = standing(change).doubts(Some(0.0), &around);
        assert!(doubts.iter().any(|doubt| doubt.contains(words)), "{words}: {doubts:?}");
    }
    let elsewhere = [[0.0, -40.0, 0.0]].map(Point3::from);
    let doubts = standing(|_, _, _| ()).doubts(Some(0.0), &elsewhere);
    assert!(doubts.len() == 1 && doubts[0].contains("no part of the scene"), "{doubts:?}");
}
