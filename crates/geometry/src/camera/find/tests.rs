//! Lines and courts that are drawn are found; what is no court is not.

use image::{Rgb, RgbImage};
use nalgebra::{Point2, Point3, SVector, Vector2};
use rand::RngExt;

use super::channel::Channel;
use super::lines::merged;
use super::model::CourtModel;
use super::ridges::ridges;
use super::segments::segments;
use super::testing::{WIDTH, drawn, view_of};
use super::view::View;
use super::*;
use crate::camera::{Court, Points, Unknowns, calibrate};
use crate::random::{Random, Stream, normal_pair};

const GROUND: [f64; 3] = [70.0, 105.0, 120.0];
const WHITE: [f64; 3] = [228.0, 230.0, 225.0];
const COURTS: [&str; 4] = ["tennis", "badminton", "volleyball", "table-tennis"];

/// A camera from which a court's lines are as wide as in real videos.
fn view(model: &CourtModel, random: &mut Random) -> View {
    view_of([model.size, model.height], [0.9, 2.0], [15.0, 40.0], random)
}

/// A channel of noise (1-σ 3 levels) on which a function of the position, px, is drawn.
fn channel(side: usize, random: &mut Random, value: impl Fn(Vector2<f64>) -> f64) -> Channel {
    let mut values = Vec::new();
    for at in 0..side * side {
        let [noise, _] = normal_pair::<f64>(random);
        values.push((value(Vector2::new((at % side) as f64, (at / side) as f64)) + 3.0 * noise) as f32);
    }
    Channel { values, width: side, height: side }
}

#[test]
fn a_drawn_line_of_any_width_and_direction_is_one_line_in_its_place() {
    let mut random = Stream::Scene.of(1);
    for number in 0..40 {
        let angle = random.random_range(0.0..std::f64::consts::PI);
        let width = random.random_range(1.5..6.0);
        let middle = Vector2::new(random.random_range(70.0..90.0), random.random_range(70.0..90.0));
        let normal = Vector2::new(-f64::sin(angle), f64::cos(angle));
        let along = Vector2::new(f64::cos(angle), f64::sin(angle));
        let picture = channel(160, &mut random, |at| {
            let share = (width / 2.0 + 0.5 - (at - middle).dot(&normal).abs()).clamp(0.0, 1.0);
            100.0 + if (at - middle).dot(&along).abs() < 55.0 { 90.0 * share } else { 0.0 }
        });
        let found = segments(&ridges(&picture, 5.0)).all;
        assert_eq!(merged(&found).len(), 1, "{number}: width {width}, angle {angle}, {found:?}");
        let longest = found.iter().max_by(|a, b| a.length().total_cmp(&b.length())).unwrap();
        let turned = super::maps::between(longest.direction(), angle).to_degrees();
        let off = (longest.middle().coords - middle).dot(&normal).abs();
        assert!(off < 0.2 && turned < 0.2, "{number}: width {width}, angle {angle}, off {off} px, {turned}°");
        assert!((longest.length() - 110.0).abs() < 8.0, "{number}: width {width}, {} px long", longest.length());
    }
}

#[test]
fn a_step_edge_is_no_ridge() {
    let mut random = Stream::Scene.of(2);
    for angle in [0.0, 0.3, 0.8, 1.3, 2.0] {
        let normal = Vector2::new(-f64::sin(angle), f64::cos(angle));
        let picture = channel(120, &mut random, |at| {
            100.0 + 60.0 * ((at - Vector2::repeat(60.0)).dot(&normal) + 0.5).clamp(0.0, 1.0)
        });
        let found = segments(&ridges(&picture, 5.0)).all;
        assert!(found.is_empty(), "{angle}: {found:?}");
    }
}

#[test]
fn texture_has_hardly_any_segments() {
    let mut random = Stream::Scene.of(3);
    let rough = channel(256, &mut random, |_| 0.0).blurred(1.2);
    let peak = rough.values.iter().fold(0.0, |peak: f32, value| peak.max(value.abs()));
    let texture = channel(256, &mut random, |at| {
        120.0 + f64::from(80.0 / peak * rough.values[at.y as usize * 256 + at.x as usize])
    });
    let found = segments(&ridges(&texture, 5.0));
    let covered = found.labels.iter().filter(|label| **label > 0).count() as f64 / found.labels.len() as f64;
    assert!(covered < 0.01, "{covered}");
}

#[test]
fn the_true_view_scores_higher_than_its_neighbours() {
    let mut random = Stream::Scene.of(4);
    for court in ["tennis", "badminton"] {
        let model = &CourtModel::of(court).unwrap()[0];
        let truth = view(model, &mut random);
        let evidence = Evidence::of(&drawn(model, &truth, GROUND, WHITE, &mut random), Paint::White);
        let scale = Scale { tolerance: 5.0, longest: 0.4 * evidence.unit(), samples: 24 };
        let scored = |view: &View| score(&evidence.maps, view, model.lines.iter().map(|line| &line.ends), &scale);
        let best = scored(&truth);
        let mut count = 0;
        while count < 1000 {
            let step = SVector::<f64, 7>::from_fn(|index, _| {
                let [random, _] = normal_pair::<f64>(&mut random);
                random * if index < 4 { 0.02 } else { 0.02 * truth.translation.norm() }
            });
            let other = truth.moved(&step);
            if apart(&truth, &other, model) > 5.0 {
                count += 1;
                assert!(
                    scored(&other) < best,
                    "{court}: {} of {best}, {} px off",
                    scored(&other),
                    apart(&truth, &other, model)
                );
            }
        }
    }
}

/// The greatest distance, as a fraction of the width, of a court's point from where the true view puts it; half-turns are the same.
fn worst(camera: &crate::camera::Camera, truth: &View, court: &str) -> f64 {
    let off = |truth: &View| {
        let off = |at: &[f64; 3]| {
            let image: Point2<f64> = camera.image_from_world(&Point3::from(*at)).ok()?;
            Some((image - truth.image(&Point3::from(*at))?).norm())
        };
        // Posts and nets are high above the lines.
        let low = Court::named(court).unwrap().points.values().filter(|at| at[2] <= 1.0);
        low.map(|at| off(at).unwrap_or(f64::INFINITY)).fold(0.0, f64::max) / WIDTH
    };
    off(truth).min(off(&truth.turned()))
}

fn found_in(rgb: &RgbImage, court: &str) -> FoundCourt {
    find_court(&Picture::from_rgb(rgb.clone()), court).unwrap()
}

#[test]
fn drawn_courts_are_found_to_a_hundredth_of_the_width() {
    let mut random = Stream::Scene.of(5);
    for court in COURTS {
        let model = &CourtModel::of(court).unwrap()[0];
        let mut sure = 0;
        for number in 0..5 {
            let truth = view(model, &mut random);
            let rgb = drawn(model, &truth, GROUND, WHITE, &mut random);
            let found = found_in(&rgb, court);
            println!("{court} {number}: {:?}, {}", found.verdict, found.reason);
            if found.verdict == CourtVerdict::Sure {
                sure += 1;
                let rough = worst(found.camera.as_ref().unwrap(), &truth, court);
                let refined = found.calibrate(&Picture::from_rgb(rgb), &Unknowns::default()).unwrap();
                let fine = worst(&refined.camera, &truth, court);
                println!("worst point off by {:.3} %, refined {:.3} %", 100.0 * rough, 100.0 * fine);
                assert!(rough < 0.01 && fine < 0.01, "{court} {number}: {rough}, {fine}");
            }
        }
        assert!(sure >= 4, "{court}: {sure} of 5 sure");
    }
}

#[test]
fn coloured_paint_is_found() {
    let mut random = Stream::Scene.of(6);
    // As bright as the ground: white paint's channel shows nothing.
    for (court, ground, paint) in [
        ("tennis", [60.0, 110.0, 90.0], [190.0, 60.0, 60.0]),
        ("volleyball", [190.0, 150.0, 100.0], [60.0, 80.0, 190.0]),
    ] {
        let model = &CourtModel::of(court).unwrap()[0];
        let truth = view(model, &mut random);
        let found = found_in(&drawn(model, &truth, ground, paint, &mut random), court);
        assert_eq!(found.verdict, CourtVerdict::Sure, "{court}: {}", found.reason);
        assert!(worst(found.camera.as_ref().unwrap(), &truth, court) < 0.01);
    }
}

#[test]
fn a_tennis_court_for_singles_is_found_as_such() {
    let mut random = Stream::Scene.of(7);
    let model = &CourtModel::of("tennis").unwrap()[1];
    let truth = view(model, &mut random);
    let rgb = drawn(model, &truth, GROUND, WHITE, &mut random);
    let found = found_in(&rgb, "tennis");
    assert_eq!((found.verdict, found.court.as_str()), (CourtVerdict::Sure, "tennis-singles"), "{}", found.reason);
    let refined = found.calibrate(&Picture::from_rgb(rgb), &Unknowns::default()).unwrap();
    assert!(refined.doubts.is_empty() && worst(&refined.camera, &truth, "tennis") < 0.01, "{:?}", refined.doubts);
}

#[test]
fn points_that_a_found_camera_placed_count_as_four_and_may_be_moved() {
    let mut random = Stream::Scene.of(9);
    let model = &CourtModel::of("tennis").unwrap()[0];
    let rgb = drawn(model, &view(model, &mut random), GROUND, WHITE, &mut random);
    let found = found_in(&rgb, "tennis");
    let seen: Vec<&FoundLine> = found.lines.iter().filter(|line| line.is_seen).collect();
    assert!(seen.len() >= 5 && seen.iter().all(|line| line.is_expected && line.fraction > 0.5), "{}", found.reason);

    let placed = found.points().unwrap();
    assert_eq!(placed.sigma, Some(found.sigma_px));
    let clicked = Points { sigma: None, ..placed.clone() };
    let sigma = |points: &Points| calibrate(points, &Unknowns::default()).unwrap().sigma.centre.norm();
    let of_four = found.sigma_px * (placed.image.len() as f64 / 4.0).sqrt();
    assert!(sigma(&placed) > 0.5 * of_four * sigma(&clicked), "{} m, {} m", sigma(&placed), sigma(&clicked));

    // By less than they may be off.
    let moved = |points: &Points| {
        let mut points = points.clone();
        points.image[0].x += 1.5 * found.sigma_px;
        calibrate(&points, &Unknowns::default()).unwrap().outliers.len()
    };
    assert_eq!([moved(&placed), moved(&clicked)], [0, 1]);
}

#[test]
fn another_sports_court_is_never_surely_the_one_asked_for() {
    let mut random = Stream::Scene.of(8);
    for painted in COURTS {
        let model = &CourtModel::of(painted).unwrap()[0];
        let rgb = drawn(model, &view(model, &mut random), GROUND, WHITE, &mut random);
        for asked in COURTS.into_iter().filter(|asked| *asked != painted) {
            let found = found_in(&rgb, asked);
            println!("{painted} for {asked}: {:?}, {}", found.verdict, found.reason);
            assert_ne!(found.verdict, CourtVerdict::Sure, "{painted} for {asked}");
        }
    }
}

#[test]
fn pictures_without_a_court_have_none_and_say_why() {
    let mut random = Stream::Scene.of(9);
    let plain = |width, height, level: u8| RgbImage::from_pixel(width, height, Rgb([level; 3]));
    let noise = RgbImage::from_fn(400, 300, |_, _| Rgb([random.random_range(0..=255_u8); 3]));
    let grid = RgbImage::from_fn(400, 300, |x, y| Rgb([if x % 40 < 3 || y % 30 < 3 { 230 } else { 60 }; 3]));
    let stripes = RgbImage::from_fn(400, 300, |x, _| Rgb([if x % 25 < 3 { 230 } else { 60 }; 3]));
    let mut pictures = vec![noise, grid, stripes];
    for (width, height) in [(1, 1), (2, 300), (15, 15), (16, 16), (33, 17), (5000, 20), (300, 200)] {
        pictures.extend([plain(width, height, 0), plain(width, height, 255)]);
    }
    for rgb in pictures {
        for court in ["tennis", "table-tennis"] {
            let found = found_in(&rgb, court);
            let size = rgb.dimensions();
            assert!(
                found.verdict == CourtVerdict::None && found.camera.is_none(),
                "{size:?} {court}: {}",
                found.reason
            );
            assert!(!found.reason.is_empty() && found.points().is_none() && found.score.is_finite());
        }
    }
}

#[test]
fn too_few_lines_are_said_to_be_too_few() {
    let mut random = Stream::Scene.of(10);
    let mut model = CourtModel::of("tennis").unwrap().swap_remove(0);
    let truth = view(&model, &mut random);
    // Only the outer rectangle is painted.
    model.painted.truncate(4);
    let found = found_in(&drawn(&model, &truth, GROUND, WHITE, &mut random), "tennis");
    assert_eq!(found.verdict, CourtVerdict::None, "{}", found.reason);
    assert!(found.reason.contains("needed"), "{}", found.reason);
}

/// A picture as a lens bends it that puts a point at radius r, in widths, at r·(1 + `bend`·r²).
fn bent(straight: &RgbImage, bend: f64) -> RgbImage {
    let centre = Vector2::new(f64::from(straight.width()) - 1.0, f64::from(straight.height()) - 1.0) / 2.0;
    RgbImage::from_fn(straight.width(), straight.height(), |column, row| {
        let bent = Vector2::new(f64::from(column), f64::from(row)) - centre;
        let mut off = bent;
        for _ in 0..20 {
            off = bent / (1.0 + bend * off.norm_squared() / WIDTH.powi(2));
        }
        let levels = crate::image::levels_between(straight, centre.x + off.x, centre.y + off.y);
        levels.map_or(Rgb([60, 60, 60]), |levels| Rgb(levels.map(|level| level.round() as u8)))
    })
}

#[test]
fn a_court_behind_a_bent_lens_is_found() {
    let mut random = Stream::Scene.of(12);
    let model = &CourtModel::of("tennis").unwrap()[0];
    for bend in [-0.25, -0.4] {
        let truth = view_of([model.size, model.height], [0.7, 0.9], [20.0, 35.0], &mut random);
        let rgb = bent(&drawn(model, &truth, GROUND, WHITE, &mut random), bend);
        let found = found_in(&rgb, "tennis");
        println!("{bend}: {:?}, {}", found.verdict, found.reason);
        assert_ne!(found.verdict, CourtVerdict::None, "{bend}: {}", found.reason);
        let refined = found.calibrate(&Picture::from_rgb(rgb), &Unknowns::default()).unwrap();
        // Where the lens puts the court's points.
        let off = |truth: &View| {
            let off = |at: [f64; 3]| {
                let ideal = truth.image(&Point3::from(at))?.coords - truth.centre;
                let seen = truth.centre + ideal * (1.0 + bend * ideal.norm_squared() / WIDTH.powi(2));
                let is_in = seen.x > 0.0 && seen.y > 0.0 && seen.x < WIDTH && seen.y < super::testing::HEIGHT;
                is_in.then(|| (refined.camera.image_from_world(&at.into()).unwrap().coords - seen).norm() / WIDTH)
            };
            let low = Court::named("tennis").unwrap().points.values().filter(|at| at[2] == 0.0);
            low.filter_map(|at| off(*at)).fold(0.0, f64::max)
        };
        let worst = off(&truth).min(off(&truth.turned()));
        assert!(worst < 0.01, "{bend}: {worst}");
    }
}

#[test]
fn families_of_parallel_lines_find_a_court_without_its_corners() {
    let mut random = Stream::Scene.of(13);
    let model = &CourtModel::of("tennis").unwrap()[0];
    let truth = view(model, &mut random);
    let evidence = Evidence::of(&drawn(model, &truth, GROUND, WHITE, &mut random), Paint::White);
    let found = Search::new(&evidence, model).by_families(&vanishing::families(&evidence));
    let off = found.iter().map(|found| apart(&found.view, &truth, model)).fold(f64::INFINITY, f64::min);
    assert!(off < 0.01 * WIDTH, "{off} px");
}
