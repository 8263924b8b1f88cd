//! Depth maps against depth images.

use burn::tensor::Device;
use image::{ImageBuffer, Luma};

use super::depth_map::{correlation, score_depth_maps};
use crate::localise::{LocaliseOptions, Localiser};
use crate::testing::{golden, seen_by, tiny_card};
use gravisight_clips::Clips;

#[test]
fn correlation_is_pearsons() {
    assert!((correlation(&[[1.0, 2.0], [2.0, 4.0], [3.0, 6.0]]) - 1.0).abs() < 1e-12);
    assert!((correlation(&[[1.0, 3.0], [2.0, 2.0], [3.0, 1.0]]) + 1.0).abs() < 1e-12);
    // By hand: deviations (−1, 0, 1) and (−1, 1, 0) give 1 / √(2·2).
    assert!((correlation(&[[1.0, 0.0], [2.0, 2.0], [3.0, 1.0]]) - 0.5).abs() < 1e-12);
    assert_eq!(correlation(&[[1.0, 3.0], [1.0, 2.0]]), 0.0);
    assert_eq!(correlation(&[]), 0.0);
}

#[test]
fn a_map_is_compared_with_the_depth_image_beside_its_picture() {
    let folder = seen_by(1, "depth-maps", 1, 2, |clip| clip.frames.truncate(2));
    let clips = Clips::read(&folder).unwrap();
    let localiser = Localiser::new(tiny_card(), golden("tiny.safetensors"), &Device::flex()).unwrap();
    let score = |limit| pollster::block_on(score_depth_maps(&localiser, &clips, limit));
    assert_eq!(score(2).unwrap(), None, "there are no depth images");
    // The model's own map of each picture as its truth.
    let clip = &clips.clips[0];
    let size = clip.camera.size();
    for frame in &clip.frames {
        let picture = clips.picture(clip, frame).unwrap();
        let options = LocaliseOptions { maps: true, ..LocaliseOptions::default() };
        let maps = pollster::block_on(localiser.localise(&picture, &clip.camera, options)).unwrap().maps.unwrap();
        let cell = |at: u32, side: u32, cells: usize| (at as usize * cells / side as usize).min(cells - 1);
        let depths = ImageBuffer::from_fn(size.width, size.height, |x, y| {
            let [column, row] = [cell(x, size.width, maps.width), cell(y, size.height, maps.height)];
            Luma([(maps.depth[row * maps.width + column] * 2000.0).round() as u16])
        });
        depths.save(folder.join(&frame.file).with_extension("depth.png")).unwrap();
    }
    let found = score(2).unwrap().unwrap();
    assert!(found.correlation > 0.999, "{found:?}");
    let median = found.error_relative.median.unwrap();
    assert!((median - 0.5).abs() < 1e-3, "truths are twice what the map says: {median}");
    let small = ImageBuffer::<Luma<u16>, _>::from_pixel(3, 3, Luma([1]));
    small.save(folder.join(&clip.frames[0].file).with_extension("depth.png")).unwrap();
    let error = score(1).unwrap_err().to_string();
    assert!(error.contains("000.depth.png") && error.contains("3×3"), "{error}");
}
