//! Fine-tuning in memory, as the browser does it.

use burn::tensor::Device;

use crate::clips::{Clip, Clips};
use crate::error::Error;
use crate::image::Picture;
use crate::localise::{LocaliseOptions, Localiser};
use crate::model::Card;
use crate::testing::{alone, golden, root, seen_by, tiny_card};
use crate::train::{FineTuneOptions, FineTuner};

/// Clips by the built-in engine with their pictures in memory.
fn in_memory(camera: usize, name: &str, count: usize, frames: usize) -> Vec<(Clip, Vec<Picture>)> {
    let folder = seen_by(camera, name, count, frames, |clip| clip.frames.truncate(frames));
    let clips = Clips::read(&folder).unwrap();
    let pictures = |clip: &Clip| clip.frames.iter().map(|frame| clips.picture(clip, frame).unwrap()).collect();
    clips.clips.iter().map(|clip| (clip.clone(), pictures(clip))).collect()
}

/// Starts from the model of one camera.
fn tuner(options: &FineTuneOptions) -> FineTuner {
    let (card, weights) = Card::with_weights(&root().join("models/sd-s.json")).unwrap();
    FineTuner::new(card, weights, options, &Device::flex()).unwrap()
}

#[test]
fn a_model_is_fine_tuned_in_memory_and_its_export_finds_the_same() {
    let _alone = alone();
    let options = FineTuneOptions { steps: 60, batch: 6, ..FineTuneOptions::default() };
    let mut tuner = tuner(&options);
    let mut clips = in_memory(2, "tuned", 4, 45);
    let (held_out, pictures) = clips.pop().unwrap();
    let picture = pictures[7].clone();
    let camera = held_out.camera.clone();
    assert_eq!(tuner.add_clip(held_out, pictures, true).unwrap().left_out, None);
    for (mut clip, pictures) in clips {
        // Only the 2D labels teach.
        clip.frames.iter_mut().for_each(|frame| frame.world = None);
        assert!(tuner.add_clip(clip, pictures, false).unwrap().frames > 35);
    }
    let before = pollster::block_on(tuner.evaluate()).unwrap();
    let mut losses = Vec::new();
    while let Some(step) = pollster::block_on(tuner.step()).unwrap() {
        losses.push(step.loss);
    }
    assert_eq!(losses.len(), 60);
    let after = pollster::block_on(tuner.evaluate()).unwrap();
    println!("{:?} -> {:?} px, {:?} -> {:?} m", before.forecast_px, after.forecast_px, before.dtg.mean, after.dtg.mean);
    assert!(after.forecast_px.unwrap() < 0.8 * before.forecast_px.unwrap(), "{before:?} {after:?}");
    assert!(after.dtg.mean.unwrap() < 0.8 * before.dtg.mean.unwrap(), "{before:?} {after:?}");
    let find = |localiser: &Localiser| {
        pollster::block_on(localiser.localise(&picture, &camera, LocaliseOptions::default())).unwrap().world
    };
    let here = find(&tuner.localiser());
    let (card, weights) = pollster::block_on(tuner.export()).unwrap();
    assert_eq!((card.name.as_str(), card.weights.as_str()), ("sd-s-tuned", "sd-s-tuned.safetensors"));
    let card = Card::from_json(&card.to_json().unwrap(), "exported").unwrap();
    let there = find(&Localiser::new(card, weights, &Device::flex()).unwrap());
    // Weights are kept in half precision.
    let apart = (0..3).map(|axis| (here[axis] - there[axis]).powi(2)).sum::<f64>().sqrt();
    assert!(apart < 0.05, "{here:?} {there:?}");
}

#[test]
fn a_fine_tuning_refuses_what_it_cannot_learn_from() {
    let _alone = alone();
    let options = FineTuneOptions { steps: 2, batch: 2, crop: 32, ..FineTuneOptions::default() };
    let mut tuner = tuner(&options);
    let said = |result: Result<_, Error>| result.map(|_: ()| ()).unwrap_err().to_string();
    let (clip, pictures) = in_memory(1, "refused", 1, 30).remove(0);
    let fewer = tuner.add_clip(clip.clone(), pictures[1..].to_vec(), false);
    assert!(said(fewer.map(|_| ())).contains("30 frames and 29 pictures"));
    let mut nowhere = clip.clone();
    nowhere.scene = None;
    assert!(said(tuner.add_clip(nowhere, pictures.clone(), false).map(|_| ())).contains("scene"));
    let mut other = clip.clone();
    other.camera = other.camera.resized(gravisight::Size::square(448)).unwrap();
    assert!(said(tuner.add_clip(other, pictures.clone(), false).map(|_| ())).contains("px"));
    assert!(said(pollster::block_on(tuner.evaluate()).map(|_| ())).contains("held out"));
    // Labels that no physics explains: the clip is named and left out, and a run of such clips does not start.
    let mut wrong = clip.clone();
    for (index, frame) in wrong.frames.iter_mut().enumerate() {
        frame.image = Some([30.0 + 37.0 * ((index * 7) % 5) as f64, 30.0 + 41.0 * ((index * 3) % 4) as f64]);
    }
    assert!(tuner.add_clip(wrong, pictures.clone(), false).unwrap().left_out.is_some());
    assert!(said(pollster::block_on(tuner.step()).map(|_| ())).contains("physics explains none"));
    let senseless = FineTuneOptions { crop: 33, ..options };
    let refused = FineTuner::new(tiny_card(), golden("tiny.safetensors"), &senseless, &Device::flex());
    assert!(refused.err().unwrap().to_string().contains("crop"));
}

#[test]
fn where_no_forecast_can_be_scored_the_last_weights_are_exported() {
    let _alone = alone();
    let options = FineTuneOptions { steps: 3, batch: 2, crop: 32, ..FineTuneOptions::default() };
    let mut tuner = FineTuner::new(tiny_card(), golden("tiny.safetensors"), &options, &Device::flex()).unwrap();
    let (clip, pictures) = in_memory(1, "unscored", 1, 30).remove(0);
    let mut short = clip.clone();
    short.frames.truncate(8);
    tuner.add_clip(short, pictures[..8].to_vec(), true).unwrap();
    tuner.add_clip(clip, pictures, false).unwrap();
    let export = |tuner: &mut FineTuner| {
        assert_eq!(pollster::block_on(tuner.evaluate()).unwrap().forecast_px, None);
        pollster::block_on(tuner.export()).unwrap()
    };
    let (_, before) = export(&mut tuner);
    while pollster::block_on(tuner.step()).unwrap().is_some() {}
    let (card, after) = export(&mut tuner);
    assert!(before != after, "what was learned is lost");
    assert!(card.confidence_threshold.is_some());
}
