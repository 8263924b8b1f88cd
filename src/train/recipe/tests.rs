//! What a run may be told.

use std::path::Path;

use crate::model::PenConfig;
use crate::testing::scratch;
use crate::train::testing::configuration;
use crate::train::{HeatmapLoss, TrainConfig, TrainSettings};

#[test]
fn senseless_configurations_are_refused_with_the_field() {
    for (extra, named) in [
        ("learning_rat = 1.0", "learning_rat"),
        ("ema_decay = 1.5", "ema_decay"),
        ("depth_weight = -1.0", "depth_weight"),
        ("checkpoint_every = 0", "checkpoint_every"),
        ("augmentation = { noise = inf }", "noise"),
        ("name = \"a/b\"", "name"),
        ("heatmap_loss = { kind = \"cross_entropy\", sigma = 0.0 }", "sigma"),
        ("network = \"huge\"", "huge"),
    ] {
        let path = configuration("senseless", "");
        let text = std::fs::read_to_string(&path).unwrap();
        let field = extra.split(' ').next().unwrap();
        let kept: Vec<&str> = text.lines().filter(|line| !line.starts_with(field)).collect();
        std::fs::write(&path, format!("{extra}\n{}", kept.join("\n"))).unwrap();
        let error = TrainSettings::read(&path).and_then(TrainSettings::config).unwrap_err();
        assert!(error.to_string().contains(named), "{extra}: {error}");
    }
    for (from, to, named) in [("crop = 32", "crop = 33", "crop"), ("supervision = \"3d-gt\"", "", "supervision")] {
        let path = configuration("senseless", "");
        let text = std::fs::read_to_string(&path).unwrap().replace(from, to);
        std::fs::write(&path, text).unwrap();
        let error = TrainSettings::read(&path).and_then(TrainSettings::config).unwrap_err();
        assert!(error.to_string().contains(named), "{to}: {error}");
    }
}

#[test]
fn presets_files_and_flags_are_laid_over_each_other() {
    for name in TrainSettings::presets() {
        let mut settings = TrainSettings::preset(name).unwrap();
        for field in ["train=a", "validation=b", "out=c", "augmentation.shift=8", "augmentation.flip=0.5"] {
            settings.set(field).unwrap();
        }
        let TrainConfig { recipe, paths } = settings.config().unwrap();
        assert_eq!((recipe.augmentation.shift, recipe.augmentation.flip), (8, 0.5), "{name}");
        assert_eq!(paths.train().unwrap(), Path::new("a"));
    }
    // Of another kind, with the fields of that kind alone.
    let mut settings = TrainSettings::preset("paper").unwrap();
    for field in [r#"heatmap_loss={kind="cross_entropy"}"#, r#"contact={model="bounce",restitution=0.8}"#, "out=c"] {
        settings.set(field).unwrap();
    }
    settings.set("heatmap_loss.sigma=3.0").unwrap();
    let recipe = settings.config().unwrap().recipe;
    assert_eq!(recipe.heatmap_loss(), HeatmapLoss::CrossEntropy { sigma: 3.0 });
    for wrong in ["seed", "=3", "a..b=3", "a b=3"] {
        assert!(TrainSettings::default().set(wrong).is_err(), "{wrong}");
    }
    assert!(TrainSettings::preset("huge").unwrap_err().to_string().contains("sd-s"));
}

#[test]
fn a_network_for_other_pictures_than_the_supervision_gives_is_refused() {
    for (preset, network, named) in [
        ("any-verifier", "compact-size", "use \"verifier\""),
        ("any-motion", "compact-size", "use \"motion\""),
        ("quick", "verifier", "use another network"),
    ] {
        let mut settings = TrainSettings::preset(preset).unwrap();
        for field in [format!("network={network}"), "out=c".into()] {
            settings.set(&field).unwrap();
        }
        let error = settings.config().unwrap_err().to_string();
        assert!(error.contains(named), "{preset}: {error}");
    }
}

#[test]
fn the_heatmap_loss_is_that_of_the_networks_head() {
    let mut settings = TrainSettings::preset("quick").unwrap();
    settings.set("out=c").unwrap();
    let mut recipe = settings.config().unwrap().recipe;
    assert!(matches!(recipe.heatmap_loss(), HeatmapLoss::CrossEntropy { sigma: 4.0 }));
    // A run that starts from a model takes its architecture.
    recipe.architecture = Some(PenConfig::paper());
    assert!(matches!(recipe.heatmap_loss(), HeatmapLoss::Mse { .. }));
}

#[test]
fn a_run_reads_what_it_saved() {
    for name in TrainSettings::presets() {
        let mut settings = TrainSettings::preset(name).unwrap();
        for field in ["train=/a", "validation=/b", "out=/c", "start_from=/d.json", "prior_depth=0.1"] {
            settings.set(field).unwrap();
        }
        let config = settings.config().unwrap();
        let file = scratch("saved").join("run.toml");
        std::fs::write(&file, config.to_toml().unwrap()).unwrap();
        let read = TrainConfig::saved_in(file.parent().unwrap()).unwrap();
        assert_eq!(format!("{:?}", read.recipe), format!("{:?}", config.recipe), "{name}");
        assert_eq!((read.paths.train, read.paths.start_from), (config.paths.train, config.paths.start_from));
    }
}

#[test]
fn a_run_that_was_saved_with_its_paths_among_the_other_fields_still_loads() {
    let file = scratch("saved-mixed").join("run.toml");
    let text = r#"
name = "t"
description = ""
licence = "not stated"
train = "/clips/train"
validation = "/clips/validation"
out = "/runs/t"
seed = 1
supervision = "physics-fit"
backbone_weights = "/weights.safetensors"

[fit]
half_weight_sigma = 0.05
largest_sigma = 0.3
largest_outlier_fraction = 0.2
numeric = false

[input]
width = 224
height = 224

[[phases]]
steps = 1500
batch = 24
crop = 128
learning_rate = 0.002
final_learning_rate = 0.0001
warm_up = 50
"#;
    std::fs::write(&file, text).unwrap();
    let TrainConfig { recipe, paths } = TrainConfig::saved_in(file.parent().unwrap()).unwrap();
    assert_eq!(
        (recipe.steps(), recipe.fit.largest_sigma, paths.train().unwrap()),
        (1500, 0.3, Path::new("/clips/train"))
    );
    assert_eq!(paths.backbone_weights.as_deref(), Some(Path::new("/weights.safetensors")));
    assert_eq!(paths.out, file.parent().unwrap(), "the folder may have moved");
}
