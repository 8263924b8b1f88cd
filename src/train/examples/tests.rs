//! What clips teach.

use nalgebra::Point3;

use super::{Example, Examples, Pictures, Sampler, teach};
use crate::data::Clips;
use crate::testing::formula;
use crate::train::TrainSettings;
use crate::train::recipe::FitConfig;
use crate::train::testing::{on, synthetic};

#[test]
fn physics_teaches_depths_from_2d_labels_alone() {
    let folder = synthetic("taught", 2, 0, |_| {});
    for clip in Clips::read(&folder).unwrap().clips {
        let mut blind = clip.clone();
        blind.frames.iter_mut().for_each(|frame| frame.world = None);
        let taught = teach(&blind, &FitConfig::default());
        assert_eq!(taught.left_out, None);
        assert!(taught.frames.iter().flatten().count() > 80);
        for (frame, taught) in clip.frames.iter().zip(&taught.frames) {
            let Some(taught) = taught else { continue };
            let truth = clip.camera.camera_from_world(&Point3::from(frame.world.unwrap())).z;
            assert!((taught.depth - truth).abs() < 0.05, "{} {truth}", taught.depth);
        }
    }
}

#[test]
fn of_noisy_labels_the_fit_makes_better_2d_targets() {
    let folder = synthetic("noisy", 1, 0, |_| {});
    let clip = Clips::read(&folder).unwrap().clips.remove(0);
    let mut noisy = clip.clone();
    let noise = formula("noise", 2 * clip.frames.len());
    let spread = (noise.iter().map(|value| value * value).sum::<f64>() / noise.len() as f64).sqrt();
    for (frame, by) in noisy.frames.iter_mut().zip(noise.chunks_exact(2)) {
        frame.image = frame.image.map(|[x, y]| [x + by[0] / spread, y + by[1] / spread]);
    }
    let taught = teach(&noisy, &FitConfig::default());
    let error = |images: Vec<Option<[f64; 2]>>| {
        let pairs = images.into_iter().zip(&clip.frames).filter_map(|(image, frame)| Some((image?, frame.image?)));
        let squares: Vec<f64> = pairs.map(|(a, b)| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    };
    let labels = error(noisy.frames.iter().map(|frame| frame.image).collect());
    let targets = error(taught.frames.iter().map(|frame| frame.map(|frame| frame.image)).collect());
    assert!(targets < 0.5 * labels, "{targets} {labels}");
}

#[test]
fn a_clip_without_a_scene_is_not_forecast_by_anothers() {
    let folder = synthetic("no-scene", 2, 0, |clip| clip.frames.truncate(45));
    let path = on("no-scene-run", &folder, "future-2d-gt", "");
    let recipe = TrainSettings::read(&path).unwrap().config().unwrap().recipe;
    let mut clips = Clips::read(&folder).unwrap();
    clips.clips[0].scene = None;
    let frames = (0..2).flat_map(|clip| {
        let frames = clips.clips[clip].frames.iter().enumerate();
        frames.filter_map(move |(frame, it)| Some(Example { clip, frame, image: it.image?, depth: None }))
    });
    let examples = Examples::new(&recipe, clips.clone(), frames.collect(), vec![]).unwrap();
    let error = Sampler::new(&recipe, examples, Pictures::new(clips.clone(), 0)).err().unwrap().to_string();
    assert!(error.contains(&clips.clips[0].id) && error.contains("scene"), "{error}");
}
