//! How well a model that reads sizes finds balls in photographs: `cargo bench --bench all -- photographs FOLDER [CARD [SHEET.png [SIDE]]]`.
//!
//! `FOLDER/labels.csv` has a row a ball: `file`, `x`, `y`, and `radius_x_px` and `radius_y_px`, or `radius_px`; perhaps `source`, `quality` (`A`: the
//! radius is right to a tenth) and `unstretch` (a radius counts only where that is 1). All other pictures in the folder and below it show no
//! ball. The cameras are not known, so one is made up for each picture (focal length: the longer side), and depths are not scored.
//!
//! *First*: the first detection is within half a radius, at least 3 px, of a labelled ball. *Found*: and its confidence is 0.5 or more. *Wrong*:
//! something else has that confidence. `SHEET.png` gets a row a miss, the surest first: the ball, and the first detection. With `SIDE` only a
//! square region of that many pixels is searched, which contains the ball somewhere, as where a user names a region.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use gravisight::internal::RandomScenes;
use gravisight::{Camera, Card, Device, LocaliseOptions, Localiser, Picture, Region, Size};
use image::imageops::{FilterType, crop_imm, overlay, resize};
use image::{Rgb, RgbImage};
use pollster::block_on;

/// The ball's radius, m: scales the depths, which are not scored.
const BALL_RADIUS: f64 = 0.11;
/// Detections of each picture that are scored.
const CANDIDATES: usize = 5;
/// Least distance within which a ball is found, px.
const NEAR_PX: f64 = 3.0;
/// Confidence from which on a detection is reported, and one from which on it should be right.
const THRESHOLDS: [f64; 2] = [0.5, 0.9];
/// Upper ends of the groups of radii, px.
const RADII: [f64; 6] = [4.0, 8.0, 16.0, 32.0, 64.0, f64::INFINITY];
/// How far a radius may be off to count as right.
const RADIUS_TOLERANCE: f64 = 0.1;
/// The contact sheet's rows at most, and the side of a picture in it, px.
const ROWS: usize = 40;
const TILE: u32 = 128;

/// A row of the labels.
#[derive(Debug, Clone, serde::Deserialize)]
struct Ball {
    file: String,
    x: f64,
    y: f64,
    radius_px: Option<f64>,
    radius_x_px: Option<f64>,
    radius_y_px: Option<f64>,
    #[serde(default)]
    source: String,
    quality: Option<String>,
    unstretch: Option<f64>,
}

impl Ball {
    fn radius(&self) -> f64 {
        let halves = || Some((self.radius_x_px? * self.radius_y_px?).sqrt());
        self.radius_px.or_else(halves).expect("a radius")
    }

    fn is_sized(&self) -> bool {
        self.quality.as_deref().is_none_or(|grade| grade == "A") && self.unstretch.is_none_or(|factor| factor == 1.0)
    }

    fn is_at(&self, [x, y]: [f64; 2]) -> bool {
        (x - self.x).hypot(y - self.y) <= NEAR_PX.max(self.radius() / 2.0)
    }
}

/// A detection: confidence, position and radius, px.
struct Found {
    confidence: f64,
    image: [f64; 2],
    radius: f64,
}

/// Sums over photographs.
#[derive(Default)]
struct Row {
    count: usize,
    first: usize,
    among: usize,
    found: usize,
    wrong: usize,
    ratios: Vec<f64>,
}

impl Row {
    fn add(&mut self, balls: &[Ball], detections: &[Found]) {
        let ball_of = |found: &Found| balls.iter().find(|ball| ball.is_at(found.image));
        let is_sure = detections.first().is_some_and(|first| first.confidence >= THRESHOLDS[0]);
        self.count += 1;
        self.among += usize::from(detections.iter().any(|found| ball_of(found).is_some()));
        match detections.first().and_then(|first| Some((first, ball_of(first)?))) {
            Some((first, ball)) => {
                self.first += 1;
                self.found += usize::from(is_sure);
                self.ratios.extend(ball.is_sized().then(|| first.radius / ball.radius()));
            }
            None => self.wrong += usize::from(is_sure),
        }
    }

    fn print(&mut self, name: &str) {
        let [first, among, found, wrong] = [self.first, self.among, self.found, self.wrong].map(|it| self.percent(it));
        self.ratios.sort_by(f64::total_cmp);
        let radius = match &self.ratios[..] {
            [] => "-".to_string(),
            ratios => {
                let near = ratios.iter().filter(|&&ratio| (ratio - 1.0).abs() <= RADIUS_TOLERANCE).count();
                let near = percent(near, ratios.len());
                format!("{:.2}, {near:.0} % of {}", ratios[ratios.len() / 2], ratios.len())
            }
        };
        println!("| {name} | {} | {first:.0} | {among:.0} | {found:.0} | {wrong:.0} | {radius} |", self.count);
    }

    fn percent(&self, count: usize) -> f64 {
        percent(count, self.count)
    }
}

fn percent(count: usize, of: usize) -> f64 {
    100.0 * count as f64 / of.max(1) as f64
}

fn localiser(card: Option<&String>) -> Localiser {
    let card = card.map_or(concat!(env!("CARGO_MANIFEST_DIR"), "/models/any.json"), String::as_str);
    let (card, weights) = Card::with_weights(Path::new(card)).unwrap();
    Localiser::new(card, weights, &Device::flex()).unwrap()
}

/// A square of `side` px in a picture of `size` that contains the ball, at a place that depends on the ball's.
fn region_about(ball: &Ball, side: u32, size: Size) -> Region {
    let side = side.min(size.width).min(size.height);
    let corner = |at: f64, other: f64, room: u32| {
        let part = 0.1 + 0.8 * (at + 0.37 * other).rem_euclid(7.0) / 7.0;
        (at - part * f64::from(side)).clamp(0.0, f64::from(room - side)) as u32
    };
    let [left, top] = [corner(ball.x, ball.y, size.width), corner(ball.y, ball.x, size.height)];
    Region { left, top, width: side, height: side }
}

fn detections(localiser: &Localiser, path: &Path, about: Option<(&Ball, u32)>) -> Vec<Found> {
    let picture = Picture::decode(&std::fs::read(path).unwrap()).unwrap();
    let Size { width, height } = picture.size();
    let [focal, x, y] = [f64::from(width.max(height)), f64::from(width - 1) / 2.0, f64::from(height - 1) / 2.0];
    // 1.6 m above the ground and level.
    let camera = format!(
        r#"{{"intrinsic": [[{focal}, 0, {x}], [0, {focal}, {y}], [0, 0, 1]], "width": {width}, "height": {height},
            "camera_from_world": [[1, 0, 0, 0], [0, 0, -1, 1.6], [0, 1, 0, 0], [0, 0, 0, 1]]}}"#
    );
    let camera = Camera::from_json(&camera, "camera").unwrap();
    let region = about.map(|(ball, side)| region_about(ball, side, picture.size()));
    let options = LocaliseOptions {
        ball_radius: Some(BALL_RADIUS),
        candidates: CANDIDATES,
        region,
        ..LocaliseOptions::default()
    };
    let found = block_on(localiser.localise(&picture, &camera, options)).unwrap();
    let found = found.candidates.iter();
    found.map(|it| Found { confidence: it.confidence, image: it.image, radius: it.radius_px }).collect()
}

/// The pictures in `folder` and below it.
fn pictures(folder: &Path) -> Vec<PathBuf> {
    let mut files = vec![];
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let ending = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        if path.is_dir() {
            files.extend(pictures(&path));
        } else if ["jpg", "jpeg", "png", "webp"].contains(&ending.as_str()) {
            files.push(path);
        }
    }
    files.sort();
    files
}

pub fn run(arguments: &[String]) {
    let mut arguments = arguments.to_vec();
    if crate::common::is_check() {
        arguments.push(small_set().to_string_lossy().into_owned());
    }
    let [folder, rest @ ..] = arguments.as_slice() else {
        return println!("usage: cargo bench --bench all -- photographs FOLDER [CARD [SHEET.png [SIDE]]]");
    };
    let folder = Path::new(folder);
    let localiser = localiser(rest.first());
    let mut labels: BTreeMap<PathBuf, Vec<Ball>> = BTreeMap::new();
    if let Ok(mut table) = csv::Reader::from_path(folder.join("labels.csv")) {
        for ball in table.deserialize() {
            let ball: Ball = ball.unwrap();
            labels.entry(folder.join(&ball.file)).or_default().push(ball);
        }
    }

    let plain: Vec<PathBuf> = pictures(folder).into_iter().filter(|path| !labels.contains_key(path)).collect();
    let highest =
        |path: &PathBuf| detections(&localiser, path, None).iter().fold(0.0_f64, |most, it| most.max(it.confidence));
    let highest: Vec<f64> = plain.iter().map(highest).collect();
    let above = |limit: f64| percent(highest.iter().filter(|&&p| p >= limit).count(), highest.len());
    let [usual, high] = THRESHOLDS;
    println!(
        "{} photographs without a ball: something has a confidence of {usual} or more in {:.1} %, of {high} or more in {:.1} %\n",
        plain.len(),
        above(usual),
        above(high)
    );

    let labelled: Vec<(&PathBuf, &Vec<Ball>)> = labels.iter().collect();
    let side: Option<u32> = rest.get(2).map(|side| side.parse().expect("SIDE is a number of pixels"));
    let scored: Vec<Vec<Found>> =
        labelled.iter().map(|(path, balls)| detections(&localiser, path, side.map(|side| (&balls[0], side)))).collect();
    let group_of = |balls: &[Ball]| {
        let radius = balls.iter().map(Ball::radius).fold(0.0, f64::max);
        RADII.iter().position(|&end| radius < end).unwrap_or(RADII.len() - 1)
    };
    let (mut sources, mut groups, mut all) =
        (BTreeMap::<&str, Row>::new(), BTreeMap::<usize, Row>::new(), Row::default());
    for ((_, balls), found) in labelled.iter().zip(&scored) {
        sources.entry(&balls[0].source).or_default().add(balls, found);
        groups.entry(group_of(balls)).or_default().add(balls, found);
        all.add(balls, found);
    }
    println!(
        "| photographs with a ball | n | first, % | among {CANDIDATES}, % | found, % | wrong, % | radius over the label's: median, within 10 % |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- |");
    sources.iter_mut().for_each(|(source, row)| row.print(source));
    for (group, row) in &mut groups {
        let start = group.checked_sub(1).map_or(0.0, |before| RADII[before]);
        match RADII[*group] {
            end if end.is_finite() => row.print(&format!("radius {start} to {end} px")),
            _ => row.print(&format!("radius {start} px and more")),
        }
    }
    all.print("all");
    if let Some(path) = rest.get(1) {
        sheet(&labelled, &scored).save(path).unwrap();
    }
    if crate::common::is_check() {
        assert_eq!((plain.len(), all.count), (1, 1));
        std::fs::remove_dir_all(folder).unwrap();
    }
}

/// The misses, the surest error first: the labelled ball, and the first detection.
fn sheet(labelled: &[(&PathBuf, &Vec<Ball>)], scored: &[Vec<Found>]) -> RgbImage {
    let mut missed: Vec<(&PathBuf, &Ball, &Found)> = (labelled.iter().zip(scored))
        .filter_map(|((path, balls), found)| {
            let first = found.first().filter(|first| !balls.iter().any(|ball| ball.is_at(first.image)))?;
            Some((*path, &balls[0], first))
        })
        .collect();
    missed.sort_by(|a, b| b.2.confidence.total_cmp(&a.2.confidence));
    missed.truncate(ROWS);
    let rows = missed.len().div_ceil(4).max(1) as u32;
    let mut sheet = RgbImage::from_pixel(4 * (2 * TILE + 8), rows * (TILE + 4), Rgb([255; 3]));
    for (index, (path, ball, first)) in missed.into_iter().enumerate() {
        let rgb = image::open(path).unwrap().into_rgb8();
        let [column, row] = [index as u32 % 4, index as u32 / 4];
        for (place, (centre, radius)) in
            [([ball.x, ball.y], ball.radius()), (first.image, first.radius)].into_iter().enumerate()
        {
            let side = ((8.0 * radius) as u32).clamp(24, rgb.width().min(rgb.height()));
            let corner = |at: f64, room: u32| (at - f64::from(side) / 2.0).clamp(0.0, f64::from(room - side)) as u32;
            let part = crop_imm(&rgb, corner(centre[0], rgb.width()), corner(centre[1], rgb.height()), side, side);
            let tile = resize(&part.to_image(), TILE, TILE, FilterType::Triangle);
            let left = column * (2 * TILE + 8) + place as u32 * TILE;
            overlay(&mut sheet, &tile, i64::from(left), i64::from(row * (TILE + 4)));
        }
    }
    sheet
}

/// A rendering without a ball and one with, as such a folder.
fn small_set() -> PathBuf {
    let folder = crate::common::scratch("photographs");
    let scenes = RandomScenes::new(vec![], 0.5);
    let drawings: Vec<_> = (0..64).map(|seed| scenes.draw(Size::square(96), seed, 1)).collect();
    let empty = drawings.iter().find(|drawing| drawing.balls.is_empty()).unwrap();
    let with = drawings.iter().find(|drawing| !drawing.balls.is_empty()).unwrap();
    for (name, drawing) in [("without.png", empty), ("with.png", with)] {
        drawing.picture().save(folder.join(name)).unwrap();
    }
    let ball = with.balls[0];
    let [x, y] = ball.centre;
    let labels = format!("file,source,x,y,radius_px,quality\nwith.png,renderings,{x},{y},{},A\n", ball.radius);
    std::fs::write(folder.join("labels.csv"), labels).unwrap();
    folder
}
