//! How well a model that reads sizes does on renderings of random scenes it was not trained on, by size of the ball, and a
//! sheet of the 24 worst: `cargo bench --bench all -- random CARD PHOTOGRAPHS SHEET.png`.

use std::path::Path;

use burn::tensor::Device;
use gravisight::internal::{Apparent, RandomScenes, median, read_photographs};
use gravisight::{Camera, Card, LocaliseOptions, Localiser, Picture, Size};
use image::{Rgb, RgbImage};
use pollster::block_on;

/// Pictures, and the seed of the first: a training's seeds come from a hash.
const COUNT: u64 = 1000;
const FIRST: u64 = 1 << 40;
/// Side of the pictures, px.
const SIDE: u32 = 256;
/// Upper ends of the bins of radii, px.
const BINS: [f64; 4] = [4.0, 10.0, 25.0, 60.0];
/// Way during the exposure, in radii, up to which a ball is still.
const STILL: f64 = 0.3;
/// Pictures of the sheet, and in a row of it.
const SHEET: usize = 24;
const COLUMNS: usize = 6;

struct Scored {
    picture: RgbImage,
    ball: Apparent,
    image: [f64; 2],
    radius: f64,
    confidence: f64,
    sigmas: f64,
}

impl Scored {
    fn error(&self) -> f64 {
        (self.radius / self.ball.radius).ln().abs()
    }

    /// From the image of the ball's centre, to which its outline's lies a little farther out.
    fn offset(&self) -> f64 {
        let Apparent { centre, radius, focal, principal_point, .. } = self.ball;
        let nearer = 1.0 / (1.0 + (radius / focal).powi(2));
        let off =
            |axis: usize| self.image[axis] - principal_point[axis] - (centre[axis] - principal_point[axis]) * nearer;
        off(0).hypot(off(1))
    }

    fn found(&self) -> bool {
        self.offset() < self.ball.radius.max(2.0)
    }

    fn plain(&self) -> bool {
        self.ball.visible > 0.98
    }
}

fn circle(picture: &mut RgbImage, [x, y]: [f64; 2], radius: f64, colour: Rgb<u8>) {
    for step in 0..720 {
        let (sin, cos) = f64::from(step).to_radians().sin_cos();
        let (x, y) = (x + radius * cos, y + radius * sin);
        if x >= 0.0 && y >= 0.0 && x < f64::from(picture.width()) && y < f64::from(picture.height()) {
            picture.put_pixel(x as u32, y as u32, colour);
        }
    }
}

/// The camera that sees the ball so; of a picture without one, any.
fn camera(ball: Option<&Apparent>) -> Camera {
    let middle = f64::from(SIDE) / 2.0 - 0.5;
    let (focal, [x, y]) = ball.map_or((500.0, [middle; 2]), |ball| (ball.focal, ball.principal_point));
    let camera = format!(
        r#"{{"intrinsic": [[{focal}, 0, {x}], [0, {focal}, {y}], [0, 0, 1]], "width": {SIDE}, "height": {SIDE},
            "camera_from_world": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}}"#
    );
    Camera::from_json(&camera, "camera").unwrap()
}

pub fn run(arguments: &[String]) {
    let mut arguments = arguments.to_vec();
    if crate::common::is_check() {
        let folder = crate::common::scratch("random");
        RandomScenes::new(vec![], 0.0).draw(Size::square(SIDE), 0, 1).picture().save(folder.join("0.png")).unwrap();
        let sheet = folder.join("sheet.png");
        arguments = [Path::new("models/any.json"), &folder, &sheet].map(|path| path.to_string_lossy().into()).into();
    }
    let [card, photographs, sheet] = arguments.as_slice() else {
        return println!("usage: cargo bench --bench all -- random CARD PHOTOGRAPHS SHEET.png");
    };
    let path = Path::new(card);
    let card = Card::from_json(&std::fs::read_to_string(path).unwrap(), card).unwrap();
    let weights = std::fs::read(path.with_file_name(&card.weights)).unwrap();
    let localiser = Localiser::new(card, weights, &Device::flex()).unwrap();
    let scenes = RandomScenes::new(read_photographs(Path::new(photographs)).unwrap(), 0.1);
    let options = LocaliseOptions { ball_radius: Some(0.1), ..LocaliseOptions::default() };
    let (mut scored, mut empty) = (vec![], vec![]);
    for seed in FIRST..FIRST + if crate::common::is_check() { 24 } else { COUNT } {
        let drawing = scenes.draw(Size::square(SIDE), seed, 1);
        let picture = drawing.picture();
        let camera = camera(drawing.balls.first());
        let found = block_on(localiser.localise(&Picture::from_rgb(picture.clone()), &camera, options)).unwrap();
        let Some(&ball) = drawing.balls.first() else {
            empty.push(found.confidence);
            continue;
        };
        let radius = found.radius_px.unwrap();
        let sigma = found.depth_sigma.unwrap() / found.depth;
        let sigmas = (radius / ball.radius).ln().abs() / sigma;
        scored.push(Scored { picture, ball, image: found.image, radius, confidence: found.confidence, sigmas });
    }
    println!(
        "{:>14} {:>6} {:>9} {:>9} {:>9} {:>8} {:>7} {:>7}",
        "radius px", "balls", "not found", "radius %", "found's %", "2D px", "1 sigma", "2 sigma"
    );
    let mut from = 0.0;
    for to in BINS {
        for (name, plain) in [("seen wholly", true), ("covered", false)] {
            let of: Vec<&Scored> =
                scored.iter().filter(|it| (from..to).contains(&it.ball.radius) && it.plain() == plain).collect();
            let all = of.len().max(1) as f64;
            let fraction =
                |test: &dyn Fn(&Scored) -> bool| 100.0 * of.iter().filter(|it| test(it)).count() as f64 / all;
            println!(
                "{from:>4}-{to:<4} {name:<12} {:>5} {:>8.1}% {:>9.2} {:>9.2} {:>8.2} {:>6.0}% {:>6.0}%",
                of.len(),
                fraction(&|it| !it.found()),
                100.0 * median(of.iter().map(|it| it.error())).unwrap_or(f64::NAN),
                100.0 * median(of.iter().filter(|it| it.found()).map(|it| it.error())).unwrap_or(f64::NAN),
                median(of.iter().map(|it| it.offset())).unwrap_or(f64::NAN),
                fraction(&|it| it.sigmas <= 1.0),
                fraction(&|it| it.sigmas <= 2.0),
            );
        }
        from = to;
    }
    let large: Vec<&Scored> = scored.iter().filter(|it| it.plain() && it.ball.radius >= 4.0).collect();
    let still = |it: &Scored| it.ball.streak < STILL * it.ball.radius;
    for (name, test) in [
        ("all", &(|_: &Scored| true) as &dyn Fn(&Scored) -> bool),
        ("found, still", &|it| it.found() && still(it)),
        ("found, in motion", &|it| it.found() && !still(it)),
    ] {
        let errors: Vec<f64> = large.iter().filter(|it| test(it)).map(|it| it.error()).collect();
        println!(
            "wholly seen, from 4 px on, {name}: {} balls, {:.2} % off (median)",
            errors.len(),
            100.0 * median(errors).unwrap_or(f64::NAN)
        );
    }
    let mut confidences: Vec<f64> =
        scored.iter().filter(|it| it.plain() && it.ball.radius >= 4.0).map(|it| it.confidence).collect();
    confidences.sort_by(f64::total_cmp);
    empty.sort_by(f64::total_cmp);
    for missed in [0.01, 0.02, 0.05, 0.1] {
        let threshold = confidences[(missed * confidences.len() as f64) as usize];
        let taken = empty.iter().filter(|&&confidence| confidence >= threshold).count();
        println!(
            "threshold {threshold:.3}: misses {:.0} % of the balls from 4 px on, false positives in {taken} of {} pictures without one",
            100.0 * missed,
            empty.len()
        );
    }
    if let Some(threshold) = localiser.card().confidence_threshold {
        println!(
            "the card's threshold {threshold:.3}: misses {:.1} % of those balls, false positives in {} pictures without one",
            100.0 * confidences.partition_point(|&confidence| confidence < threshold) as f64 / confidences.len() as f64,
            empty.len() - empty.partition_point(|&confidence| confidence < threshold)
        );
    }
    scored.retain(|it| it.plain() && it.ball.radius >= 4.0);
    scored.sort_by(|a, b| b.error().total_cmp(&a.error()));
    let mut worst = RgbImage::new(COLUMNS as u32 * SIDE, (SHEET / COLUMNS) as u32 * SIDE);
    for (index, mut it) in scored.into_iter().take(SHEET).enumerate() {
        let (ball, image, radius) = (it.ball, it.image, it.radius);
        circle(&mut it.picture, ball.centre, ball.radius + 3.0, Rgb([0, 255, 0]));
        circle(&mut it.picture, image, radius, Rgb([255, 0, 0]));
        let (x, y) = (index % COLUMNS * SIDE as usize, index / COLUMNS * SIDE as usize);
        image::imageops::replace(&mut worst, &it.picture, x as i64, y as i64);
    }
    worst.save(sheet).unwrap();
    if crate::common::is_check() {
        std::fs::remove_dir_all(photographs).unwrap();
    }
}
