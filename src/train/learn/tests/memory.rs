//! Whether a run fits the memory.

use burn::tensor::Device;

use super::super::memory::{Kept, check_against};
use super::step::tiny;
use crate::model::Pen;
use crate::testing::alone;
use crate::train::examples::Examples;
use crate::train::recipe::{Phase, Recipe, Supervision};
use crate::train::testing::synthetic;
use gravisight_clips::Clips;
use gravisight_geometry::size::Size;

#[test]
fn pictures_count_as_they_are_kept_not_as_the_network_sees_them() {
    let _alone = alone();
    let phase = Phase { steps: 1, batch: 1, crop: None, learning_rate: 1e-3, final_learning_rate: 0.0, warm_up: 0 };
    let recipe = Recipe {
        architecture: Some(tiny()),
        cache_mb: 4096,
        ..Recipe::new("t".into(), Supervision::Future2dGt, Size::square(224), vec![phase])
    };
    // Ten times as large along each side as what the network sees.
    let large = Size::square(2240);
    let folder = synthetic("memory", 2, 0, |clip| {
        clip.camera = clip.camera.resized(large).unwrap();
        clip.frames.iter_mut().for_each(|frame| frame.image = frame.image.map(|image| image.map(|at| 10.0 * at)));
    });
    let examples = Examples::of_labels(&recipe, Clips::read(&folder).unwrap()).unwrap();
    let bytes = 3 * large.pixels();
    assert_eq!(examples.picture_bytes(), [examples.frames.len() * bytes, 2 * bytes]);

    let pen = Pen::new(&tiny(), &Device::flex()).unwrap();
    let [frames, empty] = examples.picture_bytes();
    let kept = Kept { frames, empty, scored: 3 * bytes };
    let check = |free: usize, recipe: &Recipe| check_against(free, recipe, &pen, kept, true);
    let pictures = (examples.frames.len() + 2 + 3) * bytes;
    let whole = pictures + pen.training_bytes(1, recipe.input);
    check(whole, &recipe).unwrap();
    let error = check(whole - 1, &recipe).unwrap_err().to_string();
    assert!(error.contains("cache_mb"), "{error}");
    // A GPU has its own memory for the steps.
    check_against(pictures, &recipe, &pen, kept, false).unwrap();
    // With a smaller cache pictures are decoded again; empty scenes are kept in any case, unless none is shown.
    let small = Recipe { cache_mb: 1, ..recipe };
    let least = 2 * (1 << 20) + 2 * bytes + pen.training_bytes(1, small.input);
    check(least, &small).unwrap();
    check(least - 1, &small).unwrap_err();
    check(least - 2 * bytes, &Recipe { empty_fraction: 0.0, ..small }).unwrap();
}
