//! The watch over the loss survives a stop.

use burn::tensor::Device;
use pollster::block_on;

use super::super::trainer::{Trainer, TrainerState};
use super::step::{batch, tiny};
use crate::model::Pen;
use crate::testing::{alone, scratch};
use crate::train::examples::Batch;
use crate::train::recipe::{Phase, Recipe, Supervision};
use gravisight_geometry::error::Error;
use gravisight_geometry::size::Size;

/// A batch whose depths are nowhere near what was learned: the loss rises a hundredfold, and stays finite.
fn far_off() -> Batch {
    let mut batch = batch();
    batch.labels.depth = vec![7000.0, 8100.0];
    batch
}

/// The step at which a training stops that is given such batches.
fn stops_at(mut trainer: Trainer) -> usize {
    for _ in 0..20 {
        if let Err(error) = block_on(trainer.advance(far_off())) {
            assert!(matches!(error, Error::Diverged { .. }), "{error}");
            return trainer.step();
        }
    }
    panic!("it never stops");
}

#[test]
fn a_training_that_explodes_after_a_stop_is_stopped_at_the_same_step() {
    let _alone = alone();
    let device = Device::flex().autodiff();
    device.seed(3);
    let phase =
        |steps| Phase { steps, batch: 2, crop: None, learning_rate: 1e-3, final_learning_rate: 0.0, warm_up: 0 };
    let input = Size { width: 64, height: 32 };
    // Learned for `before` steps of a second phase: within its first steps there is no lowest loss yet.
    for before in [60, 5] {
        let recipe = Recipe {
            architecture: Some(tiny()),
            ..Recipe::new("t".into(), Supervision::PhysicsFit, input, vec![phase(30), phase(200)])
        };
        let blank = Pen::new(&tiny(), &device).unwrap();
        let mut trainer = Trainer::new(&recipe, TrainerState::first(&recipe, blank.clone()), &device);
        for _ in 0..30 + before {
            block_on(trainer.advance(batch())).unwrap();
        }
        let folder = scratch(&format!("watch-{before}"));
        let state = trainer.state();
        state.save(&folder).unwrap();
        let read = TrainerState::load_last(&folder, &blank, &recipe).unwrap().unwrap();
        assert_eq!(read.watch, state.watch);
        if before > 50 {
            assert_eq!(stops_at(Trainer::new(&recipe, read, &device)), stops_at(trainer));
        }
    }
}

#[test]
fn a_checkpoint_of_an_earlier_version_is_refused_rather_than_passed_over() {
    let _alone = alone();
    let folder = scratch("earlier");
    std::fs::create_dir(folder.join("step-00000100")).unwrap();
    let phase = Phase { steps: 3, batch: 2, crop: None, learning_rate: 1e-3, final_learning_rate: 0.0, warm_up: 0 };
    let recipe = Recipe::new("t".into(), Supervision::PhysicsFit, Size::square(64), vec![phase]);
    let blank = Pen::new(&tiny(), &Device::flex().autodiff()).unwrap();
    let error = TrainerState::load_last(&folder, &blank, &recipe).err().unwrap().to_string();
    assert!(error.contains("step-00000100") && error.contains("earlier version"), "{error}");
}
