//! ∂depth/∂pixel against the depth of pictures that were really changed.

use burn::tensor::Device;
use image::{RgbImage, imageops};
use nalgebra::Point2;

use super::crop::{Crop, VERIFIER_CROP};
use super::{LocaliseOptions, Localiser, Saliency};
use crate::model::VERIFIER_SIDE;
use crate::testing::{golden, root, tiny_card};
use gravisight_geometry::camera::{Camera, Outline};
use gravisight_geometry::image::Picture;
use gravisight_geometry::size::Size;

/// Brightness added and taken away, of 255: the least that there is, since units that switch on or off bend the depth.
const STEP: u8 = 1;
/// Side of the squares of pixels that are changed together, px.
const SQUARE: u32 = 4;

fn localiser() -> Localiser {
    Localiser::new(tiny_card(), golden("tiny.safetensors"), &Device::flex()).unwrap()
}

/// A sample in the size of the tiny model's input, so that a pixel of it is one of the input.
fn small() -> RgbImage {
    let path = root().join("tests/samples/frames/test_e1_c1_0000/000.png");
    let picture = image::open(path).unwrap().into_rgb8();
    let mut picture = imageops::resize(&picture, 64, 64, imageops::FilterType::Triangle);
    // Room for the step.
    picture.pixels_mut().flat_map(|pixel| &mut pixel.0).for_each(|value| *value = (*value).clamp(STEP, 255 - STEP));
    picture
}

fn picture(rgb: &RgbImage) -> Picture {
    let rgba: Vec<u8> = rgb.pixels().flat_map(|pixel| [pixel.0[0], pixel.0[1], pixel.0[2], 255]).collect();
    Picture::from_rgba(&rgba, Size::new(rgb.width(), rgb.height())).unwrap()
}

fn depth(localiser: &Localiser, rgb: &RgbImage) -> f64 {
    let camera = r#"{"width": 64, "height": 64, "intrinsic": [[77, 0, 31.5], [0, 77, 31.5], [0, 0, 1]],
        "camera_from_world": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 8], [0, 0, 0, 1]]}"#;
    let camera = Camera::from_json(camera, "test").unwrap();
    pollster::block_on(localiser.localise(&picture(rgb), &camera, LocaliseOptions::default())).unwrap().depth
}

/// Sum of the saliency over the square at (x, y).
fn of_square(saliency: &Saliency, x: u32, y: u32) -> f64 {
    let pixels = (y..y + SQUARE).flat_map(|y| (x..x + SQUARE).map(move |x| (x, y)));
    pixels.map(|(x, y)| f64::from(saliency.values[y as usize * saliency.width + x as usize])).sum()
}

#[test]
fn brightening_some_pixels_moves_the_depth_as_the_saliency_says() {
    let localiser = localiser();
    let rgb = small();
    let saliency = pollster::block_on(localiser.saliency(&picture(&rgb))).unwrap();
    assert_eq!((saliency.width, saliency.height), (64, 64));
    assert!((saliency.depth.unwrap() - depth(&localiser, &rgb)).abs() < 1e-4);
    let squares = (0..64).step_by(SQUARE as usize);
    let mut squares: Vec<_> = squares.clone().flat_map(|y| squares.clone().map(move |x| (x, y))).collect();
    squares.sort_by(|a, b| of_square(&saliency, b.0, b.1).abs().total_cmp(&of_square(&saliency, a.0, a.1).abs()));
    let [mut off, mut all] = [0.0; 2];
    for &(x, y) in squares.iter().take(30) {
        let moved = |by: i16| {
            let mut rgb = rgb.clone();
            let pixels = (y..y + SQUARE).flat_map(|y| (x..x + SQUARE).map(move |x| (x, y)));
            for (x, y) in pixels {
                let pixel = rgb.get_pixel_mut(x, y);
                pixel.0 = pixel.0.map(|value| (i16::from(value) + by) as u8);
            }
            depth(&localiser, &rgb)
        };
        let slope = (moved(STEP.into()) - moved(-i16::from(STEP))) / (2.0 * f64::from(STEP) / 255.0);
        let expected = of_square(&saliency, x, y);
        println!("({x:2}, {y:2}): {slope:8.4} m by differences, {expected:8.4} m by autodiff");
        off += (slope - expected).powi(2);
        all += expected.powi(2);
    }
    // A unit that switches between the two pictures makes one square's difference wrong, not all of them.
    assert!((off / all).sqrt() < 0.08, "{:.3} of their root mean square", (off / all).sqrt());
}

#[test]
fn for_a_model_that_reads_sizes_it_is_the_relative_change_of_depth() {
    let (card, weights) = crate::Card::with_weights(&root().join("models/any.json")).unwrap();
    let localiser = Localiser::new(card, weights, &Device::flex()).unwrap();
    let rgb = image::open(root().join("tests/samples/frames/test_e1_c1_0000/000.png")).unwrap().into_rgb8();
    let saliency = pollster::block_on(localiser.saliency(&picture(&rgb))).unwrap();
    assert_eq!((saliency.width, saliency.height, saliency.depth), (224, 224, None));
    // The first pass's radius.
    let log_depth = |rgb: &RgbImage| -> f64 {
        let first = pollster::block_on(localiser.first_pass(&picture(rgb), None, 1, false)).unwrap();
        -first.candidates[0].outline.radius.ln()
    };
    let squares = (0..224).step_by(SQUARE as usize);
    let mut squares: Vec<_> = squares.clone().flat_map(|y| squares.clone().map(move |x| (x, y))).collect();
    squares.sort_by(|a, b| of_square(&saliency, b.0, b.1).abs().total_cmp(&of_square(&saliency, a.0, a.1).abs()));
    let [mut off, mut all] = [0.0; 2];
    for &(x, y) in squares.iter().take(20) {
        let moved = |by: i16| {
            let mut rgb = rgb.clone();
            let pixels = (y..y + SQUARE).flat_map(|y| (x..x + SQUARE).map(move |x| (x, y)));
            for (x, y) in pixels {
                let pixel = rgb.get_pixel_mut(x, y);
                pixel.0 = pixel.0.map(|value| (i16::from(value) + by).clamp(0, 255) as u8);
            }
            log_depth(&rgb)
        };
        let slope = (moved(STEP.into()) - moved(-i16::from(STEP))) / (2.0 * f64::from(STEP) / 255.0);
        off += (slope - of_square(&saliency, x, y)).powi(2);
        all += of_square(&saliency, x, y).powi(2);
    }
    println!("off by {:.3} of their root mean square", (off / all).sqrt());
    // The detection is centred anew on each picture; the saliency keeps its centre.
    assert!((off / all).sqrt() < 0.3);
}

#[test]
fn a_wide_picture_has_the_saliency_of_the_part_that_it_fills() {
    let rgb = imageops::resize(&small(), 128, 64, imageops::FilterType::Triangle);
    let saliency = pollster::block_on(localiser().saliency(&picture(&rgb))).unwrap();
    assert_eq!((saliency.width, saliency.height, saliency.values.len()), (64, 32, 64 * 32));
}

#[test]
fn a_detection_outside_the_balls_volume_is_refused() {
    let (card, weights) = crate::Card::with_weights(&root().join("models/any.json")).unwrap();
    let localiser = Localiser::new(card, weights, &Device::flex()).unwrap();
    let clips = gravisight_clips::Clips::read(&root().join("tests/samples")).unwrap();
    let clip = &clips.clips[0];
    let picture = clips.picture(clip, &clip.frames[0]).unwrap();
    let scene = clip.scene.as_ref().unwrap();
    let localised = |volume| {
        let options = LocaliseOptions { ball_radius: Some(scene.ball.radius), volume, ..LocaliseOptions::default() };
        pollster::block_on(localiser.localise(&picture, &clip.camera, options)).unwrap()
    };
    let free = localised(None);
    let truth = clip.frames[0].world.unwrap();
    assert!(free.dtg(truth) < 0.2, "{} m", free.dtg(truth));
    // Where it is, it may be.
    let at_home = localised(scene.volume());
    assert_eq!((at_home.world, at_home.confidence), (free.world, free.confidence));
    // The ball is above the floor that this volume ends at.
    let cellar = gravisight_geometry::volume::Volume { low: [-50.0, -50.0, -9.0], high: [50.0, 50.0, -3.0] };
    let below = localised(Some(cellar));
    assert!(
        below.confidence < 0.5 && below.notes.iter().any(|note| note.starts_with("rejected detections")),
        "{below:?}"
    );
    // Nearer than anything in the picture: no confident detection can be the ball.
    let eye = clip.camera.world_from_camera(&nalgebra::Point3::origin()).coords;
    let near =
        gravisight_geometry::volume::Volume { low: (eye.add_scalar(-0.3)).into(), high: (eye.add_scalar(0.3)).into() };
    let none = localised(Some(near));
    assert!(none.confidence < 0.1 && none.notes.iter().any(|note| note.contains("no ball found")), "{none:?}");
}

#[test]
fn the_verifiers_input_is_the_crop_and_its_surroundings() {
    // Colours encode positions.
    let rgb = RgbImage::from_fn(250, 250, |x, y| image::Rgb([x as u8, y as u8, 0]));
    let side = VERIFIER_SIDE as i32;
    for [x, y] in [[125.0, 125.0], [20.0, 230.0]] {
        let outline = Outline { centre: Point2::new(x, y), radius: 12.0 };
        let [near, wide] = Crop::around(&outline, outline.radius, &rgb, VERIFIER_CROP).with_surroundings(&rgb);
        let at = |view: &RgbImage, x: i32, y: i32| view.get_pixel(x as u32, y as u32).0;
        let middle = at(&near, side / 2, side / 2);
        for (dx, dy) in [(0, 0), (6, -6), (-9, 9)] {
            // One pixel of the surroundings is three of the crop, which is at the scale of the picture here.
            let [red, green, blue] = at(&wide, side / 2 + dx, side / 2 + dy);
            let expected = [f64::from(middle[0]) + 3.0 * f64::from(dx), f64::from(middle[1]) + 3.0 * f64::from(dy)];
            let inside = expected.iter().all(|at| (2.0..248.0).contains(at));
            let off = [red, green].into_iter().zip(expected).map(|(is, should)| (f64::from(is) - should).abs());
            let off = off.fold(0.0, f64::max);
            assert!(if inside { off < 4.0 && blue == 0 } else { blue != 0 }, "{dx} {dy}: {red} {green} {blue}");
        }
    }
}

#[test]
fn every_network_of_a_model_is_compared_on_another_device() {
    let any = || {
        let (card, weights) = crate::model::Card::with_weights(&root().join("models/any.json")).unwrap();
        Localiser::new(card, weights, &Device::flex()).unwrap()
    };
    let (localiser, reference) = (any(), any());
    pollster::block_on(localiser.check_against(&reference)).unwrap();
    // Of which one is another: the motion network's place is taken by the verifier.
    let (mut wrong, mut other) = (any(), any());
    wrong.motion = other.verifier.take();
    let error = pollster::block_on(wrong.check_against(&reference)).unwrap_err().to_string();
    assert!(error.contains("motion network"), "{error}");
    let (mut wrong, mut other) = (any(), any());
    wrong.verifier = other.motion.take();
    let error = pollster::block_on(wrong.check_against(&reference)).unwrap_err().to_string();
    assert!(error.contains("verifier"), "{error}");
}

#[test]
fn pictures_together_give_the_positions_of_each_alone() {
    let localiser = localiser();
    let camera = r#"{"width": 224, "height": 224, "intrinsic": [[270, 0, 111.5], [0, 270, 111.5], [0, 0, 1]],
        "camera_from_world": [[1, 0, 0, 0.5], [0, 1, 0, 1], [0, 0, 1, 8], [0, 0, 0, 1]]}"#;
    let camera = Camera::from_json(camera, "test").unwrap();
    let mut pictures: Vec<Picture> = ["000", "008", "016"]
        .iter()
        .map(|name| Picture::open(&root().join(format!("tests/samples/frames/test_e1_c1_0000/{name}.png"))).unwrap())
        .collect();
    // Another size than the camera's and the input's.
    let enlarged = imageops::resize(pictures[0].rgb(), 448, 448, imageops::FilterType::Triangle);
    pictures.push(Picture::from_rgb(enlarged));
    let taken = pictures.iter().map(|picture| localiser.take(picture, &camera).unwrap()).collect();
    let together = pollster::block_on(localiser.positions(taken)).unwrap();
    assert_eq!(together.len(), pictures.len());
    for (found, picture) in together.into_iter().zip(&pictures) {
        let found = found.unwrap();
        let alone = pollster::block_on(localiser.localise(picture, &camera, LocaliseOptions::default())).unwrap();
        let off = |a: f64, b: f64| (a - b).abs() / b.abs().max(1.0);
        let pairs = [found.image.x, found.image.y, found.confidence].into_iter().chain(found.world.iter().copied());
        let expected = alone.image.into_iter().chain([alone.confidence]).chain(alone.world);
        for (together, alone) in pairs.zip(expected) {
            assert!(off(together, alone) < 1e-4, "{together}, alone {alone}");
        }
    }
}
