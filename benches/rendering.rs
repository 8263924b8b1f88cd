//! How many pictures of random scenes one core draws a second: `cargo bench --bench all -- rendering`. With `-- PHOTOGRAPHS SHEET`
//! also a sheet of 24 of them, with photographs of a folder behind some.

use std::path::Path;
use std::time::Instant;

use gravisight::Size;
use gravisight::internal::{Photographs, RandomScenes};
use image::RgbImage;

/// Pictures that are timed.
const COUNT: u64 = 2000;
/// Pictures of a sheet, and in a row of it.
const SHEET: [u32; 2] = [24, 6];

pub fn run(arguments: &[String]) {
    let count = if crate::common::is_check() { 4 } else { COUNT };
    let photographs = arguments.first().map(|folder| Photographs::read(Path::new(folder)).unwrap()).unwrap_or_default();
    println!("{} photographs, {} with labelled balls", photographs.plain.len(), photographs.labelled.len());
    let scenes = RandomScenes::new(photographs.plain, 0.07).with_labelled(photographs.labelled);
    for side in [128, 256] {
        let began = Instant::now();
        let balls: usize = (0..count).map(|seed| scenes.draw(Size::square(side), seed, 3).balls.len()).sum();
        let seconds = began.elapsed().as_secs_f64();
        println!("{side}x{side}: {:.0} pictures/s on one core, {balls} balls in {count}", count as f64 / seconds);
    }
    let Some(path) = arguments.get(1) else { return };
    let [count, columns] = SHEET;
    let side = 128;
    let mut sheet = RgbImage::new(columns * 2 * side, count / columns * 2 * side);
    for index in 0..count {
        let drawn = scenes.draw(Size::square(side), 100_000 + u64::from(index), 3).picture();
        let large = image::imageops::resize(&drawn, 2 * side, 2 * side, image::imageops::FilterType::Nearest);
        let (x, y) = (index % columns * 2 * side, index / columns * 2 * side);
        image::imageops::replace(&mut sheet, &large, i64::from(x), i64::from(y));
    }
    sheet.save(path).unwrap();
}
