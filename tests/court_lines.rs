//! A camera by a few clicks and a court's painted lines: `cargo test --test court_lines -- --nocapture` prints how far off it is.
//! The pictures are drawn here, pixel by pixel from the ground's paint.

#![cfg(not(target_arch = "wasm32"))]

mod clicking;
mod common;

use clicking::Noise;
use common::{looking, median};
use gravisight::parts::Distortion;
use gravisight::{Camera, Court, CourtLine, Picture, Points, Size, Unknowns, calibrate, calibrate_by_lines};
use image::{Rgb, RgbImage};
use nalgebra::{Point2, Point3, Vector3};

const SIZE: Size = Size { width: 1280, height: 720 };
/// Rays a pixel, along each side.
const RAYS: u32 = 3;
const NEAR_AND_FAR: [&str; 4] =
    ["near doubles corner left", "near doubles corner right", "far doubles corner left", "far doubles corner right"];

fn between(random: &mut Noise, least: f64, most: f64) -> f64 {
    least + (most - least) * random.uniform()
}

/// A camera behind a tennis court, at the height of broadcast or of a fence.
fn behind(random: &mut Noise, distortion: Distortion) -> Camera {
    let at = [between(random, -4.0, 4.0), between(random, -26.0, -20.0), between(random, 4.0, 10.0)];
    let to = [between(random, -1.0, 1.0), between(random, -3.0, 0.0), 0.0];
    looking(at, to, between(random, 1200.0, 1500.0), SIZE, distortion)
}

/// What a court looks like: painted lines of the widths that there really are, people before them, texture, noise.
struct Look {
    lines: Vec<CourtLine>,
    ground: [f64; 3],
    paint: f64,
    people: Vec<[f64; 4]>,
    noise: f64,
}

impl Look {
    fn of(court: &str, random: &mut Noise) -> Self {
        let mut lines = Court::named(court).unwrap().lines.clone();
        // Base lines are 5 to 10 cm wide, and no paint is quite where it should be.
        let widest = lines.iter().map(|line| line.width).fold(0.0, f64::max);
        for line in &mut lines {
            if line.width == widest {
                line.width *= between(random, 0.5, 1.0);
            }
            let off = 0.08 * line.width.min(0.05) * random.normal();
            let aside = line.paint.map_or_else(|| Vector3::new(1.0, 0.0, 0.0), Vector3::from) * off;
            for end in [&mut line.from, &mut line.to] {
                *end = (Vector3::from(*end) + aside).into();
            }
        }
        let ground = [between(random, 30.0, 130.0), between(random, 40.0, 120.0), between(random, 40.0, 150.0)];
        let person = |random: &mut Noise| {
            let [x, y] = [between(random, 0.0, 1200.0), between(random, 100.0, 600.0)];
            [x, y, x + between(random, 20.0, 60.0), y + between(random, 60.0, 150.0)]
        };
        let people = (0..4).map(|_| person(random)).collect();
        Self { lines, ground, paint: between(random, 190.0, 245.0), people, noise: 3.0 }
    }

    fn is_painted(&self, at: &Point3<f64>) -> bool {
        self.lines.iter().any(|line| {
            let [from, to] = [line.from, line.to].map(Vector3::from);
            let along = (to - from).normalize();
            let way = at.coords - from;
            let share = way.dot(&along) / (to - from).norm();
            let aside = way.dot(&line.paint.map_or_else(|| Vector3::z().cross(&along), Vector3::from));
            let within = if line.paint.is_some() { 0.0..=line.width } else { -line.width / 2.0..=line.width / 2.0 };
            (0.0..=1.0).contains(&share) && within.contains(&aside)
        })
    }

    fn seen_by(&self, camera: &Camera, height: f64, random: &mut Noise) -> Picture {
        let eye = camera.world_from_camera(&Point3::origin());
        let mut picture = RgbImage::new(SIZE.width, SIZE.height);
        for (column, row, pixel) in picture.enumerate_pixels_mut() {
            let mut share = 0.0;
            for ray in 0..RAYS * RAYS {
                let part = |index: u32| (f64::from(index) + 0.5) / f64::from(RAYS) - 0.5;
                let at = Point2::new(f64::from(column) + part(ray % RAYS), f64::from(row) + part(ray / RAYS));
                let Ok(near) = camera.world_from_image(&at, 1.0) else { continue };
                let way = near - eye;
                let far = (height - eye.z) / way.z;
                if far > 0.0 && self.is_painted(&(eye + way * far)) {
                    share += 1.0 / f64::from(RAYS * RAYS);
                }
            }
            let [x, y] = [f64::from(column), f64::from(row)];
            let texture = 8.0 * (x / 37.0).sin() * (y / 23.0).cos();
            let is_person =
                self.people.iter().any(|&[left, top, right, bottom]| x > left && x < right && y > top && y < bottom);
            *pixel = Rgb(self.ground.map(|ground| {
                let value = if is_person { 200.0 - ground } else { ground + texture + share * (self.paint - ground) };
                (value + self.noise * random.normal()).clamp(0.0, 255.0) as u8
            }));
        }
        // A lens's and a compressor's blur.
        Picture::from_rgb(image::imageops::blur(&picture, 0.7))
    }
}

fn clicks(camera: &Camera, court: &str, names: &[&str], noise: f64, random: &mut Noise) -> Points {
    let court = Court::named(court).unwrap();
    let world: Vec<Point3<f64>> = names.iter().map(|&name| Point3::from(court.points[name])).collect();
    let mut click = |point| {
        let image = camera.image_from_world(point).unwrap();
        Point2::new(image.x + noise * random.normal(), image.y + noise * random.normal())
    };
    Points {
        size: SIZE,
        intrinsic: None,
        distortion: Distortion::default(),
        names: names.iter().map(|&name| name.into()).collect(),
        image: world.iter().map(&mut click).collect(),
        world,
        lines: court.lines.clone(),
    }
}

/// Where the two cameras place what is seen 1 m over the court, m apart (root mean square).
fn off(found: &Camera, truth: &Camera, [half_width, half_length, height]: [f64; 3]) -> f64 {
    let places =
        [-1.0, 0.0, 1.0].iter().flat_map(|x| [-1.0, 0.0, 1.0].map(|y| [x * half_width, y * half_length, height]));
    let square = |place: [f64; 3]| {
        let seen = truth.camera_from_world(&place.into());
        let image = truth.image_from_camera(&seen).unwrap();
        (found.world_from_image(&image, seen.z).unwrap() - Point3::from(place)).norm_squared()
    };
    (places.map(square).sum::<f64>() / 9.0).sqrt()
}

#[test]
fn lines_pull_four_clicks_to_a_fraction_of_a_pixel() {
    let mut random = Noise(5);
    let (mut before, mut after, mut sure) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..12 {
        let truth = behind(&mut random, Distortion::default());
        let picture = Look::of("tennis", &mut random).seen_by(&truth, 0.0, &mut random);
        let points = clicks(&truth, "tennis", &NEAR_AND_FAR, 2.0, &mut random);
        let clicked = calibrate(&points, &Unknowns::default()).unwrap();
        let lined = calibrate_by_lines(&points, &Unknowns::default(), &picture).unwrap();
        let place = |camera: &Camera| camera.world_from_camera(&Point3::origin());
        before.push(100.0 * off(&clicked.camera, &truth, [5.0, 11.0, 1.0]));
        after.push(100.0 * off(&lined.camera, &truth, [5.0, 11.0, 1.0]));
        let error = place(&lined.camera) - place(&truth);
        sure.extend((0..3).map(|axis| (error[axis] / lined.sigma.centre[axis]).abs()));
        println!(
            "{:6.1} {:6.1} cm, {} lines, focal {:+.2} % ± {:.2}, place {:.1} cm ± {:.1}",
            before.last().unwrap(),
            after.last().unwrap(),
            lined.lines.iter().filter(|line| line.share > 0.0).count(),
            100.0 * (lined.camera.intrinsic()[(0, 0)] / truth.intrinsic()[(0, 0)] - 1.0),
            100.0 * lined.sigma.focal_px / truth.intrinsic()[(0, 0)],
            100.0 * error.norm(),
            100.0 * lined.sigma.centre.norm(),
        );
    }
    let within = |sigmas: f64| sure.iter().filter(|off| **off < sigmas).count() as f64 / sure.len() as f64;
    println!("within 1 / 2 sigma {:.2} {:.2}", within(1.0), within(2.0));
    println!("median {:.1} -> {:.1} cm", median(&before), median(&after));
    assert!(median(&after) < 0.25 * median(&before));
    assert!((0.5..=0.95).contains(&within(1.0)) && within(2.0) > 0.85);
}

#[test]
fn a_table_and_its_lens() {
    let mut random = Noise(7);
    let lens = Distortion { k1: -0.12, k2: 0.03, ..Distortion::default() };
    let truth = looking([2.6, -2.9, 2.1], [0.1, 0.1, 0.76], 1150.0, SIZE, lens);
    let names = [
        "near corner left",
        "near corner right",
        "far corner left",
        "far corner right",
        "net top left",
        "net top right",
    ];
    let points = clicks(&truth, "table-tennis", &names, 1.0, &mut random);
    let picture =
        Look { people: Vec::new(), ..Look::of("table-tennis", &mut random) }.seen_by(&truth, 0.76, &mut random);
    let unknowns = Unknowns { distortion: 2, ..Unknowns::default() };
    let lined = calibrate_by_lines(&points, &unknowns, &picture).unwrap();
    let by_itself = calibrate_by_lines(&points, &Unknowns::default(), &picture).unwrap();
    let [with, by_itself] = [lined, by_itself].map(|found| 100.0 * off(&found.camera, &truth, [0.7, 1.3, 0.9]));
    println!("{with:.1} cm, with one coefficient that the bowed lines ask for {by_itself:.1} cm");
    assert!(with < 0.9 && by_itself < 0.9);
}

#[test]
fn what_shows_no_such_lines_is_refused() {
    let mut random = Noise(9);
    let truth = behind(&mut random, Distortion::default());
    let look = Look::of("tennis", &mut random);
    let points = clicks(&truth, "tennis", &NEAR_AND_FAR, 1.0, &mut random);
    let said = |points: &Points, picture: &Picture| {
        calibrate_by_lines(points, &Unknowns::default(), picture).unwrap_err().to_string()
    };
    let bare = Look { lines: Vec::new(), ..look }.seen_by(&truth, 0.0, &mut random);
    let error = said(&points, &bare);
    assert!(error.contains("of 9 painted lines the picture shows"), "{error}");
    let error = said(&Points { lines: Vec::new(), ..points.clone() }, &bare);
    assert!(error.contains("`court`"), "{error}");
    let small = Picture::from_rgb(RgbImage::new(640, 360));
    assert!(said(&points, &small).contains("640×360"), "{}", said(&points, &small));
    // The singles court's corners clicked for the doubles court's.
    let look = Look::of("tennis", &mut random);
    let picture = look.seen_by(&truth, 0.0, &mut random);
    let singles = NEAR_AND_FAR.map(|name| name.replace("doubles", "singles"));
    let mut wrong = clicks(&truth, "tennis", &singles.each_ref().map(String::as_str), 1.0, &mut random);
    wrong.world = clicks(&truth, "tennis", &NEAR_AND_FAR, 0.0, &mut random).world;
    let found = calibrate_by_lines(&wrong, &Unknowns::default(), &picture).map(|found| found.doubts);
    assert!(
        found.as_ref().map_or(true, |doubts| doubts.iter().any(|doubt| doubt.contains("painted lines"))),
        "{found:?}"
    );
    let right =
        calibrate_by_lines(&clicks(&truth, "tennis", &NEAR_AND_FAR, 1.0, &mut random), &Unknowns::default(), &picture);
    assert_eq!(right.unwrap().doubts, [""; 0]);
}
