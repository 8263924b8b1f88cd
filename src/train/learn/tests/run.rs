//! Training runs: they learn, resume exactly, and refuse what cannot train.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use burn::tensor::Device;

use super::super::laws::LearnedLaws;
use super::super::score::score;
use crate::localise::Localiser;
use crate::model::Card;
use crate::testing::{alone, root, scratch, tiny_card};
use crate::train::examples::Pictures;
use crate::train::testing::{configuration, on, start, synthetic};
use crate::train::{TrainConfig, TrainEvent as Event, TrainSettings, Validation};
use gravisight_clips::{Clips, Frame};
use gravisight_geometry::error::Error;

#[test]
fn a_run_killed_at_any_step_resumes_to_the_same_weights() {
    let _alone = alone();
    let whole = configuration("whole", "");
    let card = start(&whole, &mut |_| {}).unwrap();
    let expected = std::fs::read(card.with_extension("safetensors")).unwrap();
    let log = |folder: &Path| std::fs::read_to_string(folder.join("out/log.jsonl")).unwrap().lines().count();
    assert_eq!(log(whole.parent().unwrap()), 7);
    for kill_after in [1, 3, 5, 6] {
        let path = configuration(&format!("killed_{kill_after}"), "");
        let folder = path.parent().unwrap().to_path_buf();
        let mut observe = |event: Event| match event {
            Event::Step(progress) => assert!(progress.step < kill_after, "killed by the test"),
            Event::Prepared { .. } | Event::Fitting { .. } => {}
        };
        catch_unwind(AssertUnwindSafe(|| start(&path, &mut observe))).unwrap_err();
        let card = TrainConfig::resume(&folder.join("out"), &Device::flex(), &mut |_| {}).unwrap();
        let found = std::fs::read(card.with_extension("safetensors")).unwrap();
        assert!(found == expected, "killed after {kill_after}");
        assert_eq!(log(&folder), 7);
    }
}

#[test]
fn a_finished_run_is_not_overwritten() {
    let _alone = alone();
    let path = configuration("finished", "");
    start(&path, &mut |_| {}).unwrap();
    let error = start(&path, &mut |_| {}).unwrap_err();
    assert!(error.to_string().contains("--resume"), "{error}");
}

#[test]
fn a_run_that_could_not_start_does_not_occupy_its_folder() {
    let _alone = alone();
    let path = configuration("could_not_start", "");
    let text = std::fs::read_to_string(&path).unwrap();
    let wrong = path.with_file_name("wrong.toml");
    let scale = "scale = 7.4";
    std::fs::write(&wrong, text.replace(&format!("activation = \"exp\", {scale}"), "activation = \"exp\", scale = -1"))
        .unwrap();
    start(&wrong, &mut |_| {}).unwrap_err();
    let no_clips = path.with_file_name("no_clips.toml");
    std::fs::write(&no_clips, text.replacen("tests/samples", "tests/golden", 1)).unwrap();
    start(&no_clips, &mut |_| {}).unwrap_err();
    start(&path, &mut |_| {}).unwrap();
}

#[test]
fn a_label_outside_the_picture_is_refused_by_name() {
    let path = configuration("outside", "");
    let error = start_on_first_clip(&path, |frame| frame["image"] = serde_json::json!([500.0, 20.0])).unwrap_err();
    assert!(error.to_string().contains("500") && error.to_string().contains("000.png"), "{error}");
}

/// Starts the run on the samples' first clip with its first frame changed.
fn start_on_first_clip(path: &Path, change: impl FnOnce(&mut serde_json::Value)) -> Result<PathBuf, Error> {
    let folder = path.parent().unwrap().join("clips");
    std::fs::create_dir_all(&folder).unwrap();
    let lines = std::fs::read_to_string(root().join("tests/samples/clips.jsonl")).unwrap();
    let mut first: serde_json::Value = serde_json::from_str(lines.lines().next().unwrap()).unwrap();
    change(&mut first["frames"][0]);
    std::fs::write(folder.join("clips.jsonl"), first.to_string()).unwrap();
    let text = std::fs::read_to_string(path).unwrap();
    std::fs::write(path, text.replacen(&format!("{:?}", root().join("tests/samples")), "\"clips\"", 1)).unwrap();
    start(path, &mut |_| {})
}

#[test]
fn a_frame_without_3d_label_is_refused_by_name() {
    let path = configuration("no_world", "");
    let error = start_on_first_clip(&path, |frame| drop(frame.as_object_mut().unwrap().remove("world"))).unwrap_err();
    assert!(error.to_string().contains("world") && error.to_string().contains("000.png"), "{error}");
}

#[test]
fn every_supervision_runs_and_resumes_to_the_same_weights() {
    let _alone = alone();
    let folder = synthetic("supervised", 2, 45, |clip| clip.frames.truncate(45));
    let extra = "empty_fraction = 0.3\nvalidate_every = 2\naugmentation = { shift = 4, flip = 0.5, blur = 0.1, colour = 0.1, zoom = 0.1, roll_degrees = 5.0 }";
    let pictures = "future = { velocity = \"pictures\" }";
    for (number, (supervision, more)) in [
        ("physics-fit", ""),
        ("mixed", "labelled_fraction = 0.5"),
        ("future-2d-predict", ""),
        ("future-2d-predict", pictures),
        ("future-2d-gt", "future = { learn = [\"gravity\"] }"),
        ("future-2d-gt", pictures),
    ]
    .into_iter()
    .enumerate()
    {
        let of = |kind: &str| {
            on(&format!("{supervision}_{number}_{kind}"), &folder, supervision, &format!("{extra}\n{more}"))
        };
        let card = start(&of("whole"), &mut |_| {}).unwrap();
        let expected = std::fs::read(card.with_extension("safetensors")).unwrap();
        let path = of("killed");
        let mut observe = |event: Event| match event {
            Event::Step(progress) => assert!(progress.step < 5, "killed by the test"),
            Event::Prepared { clips, left_out, .. } => assert_eq!((clips, left_out.len()), (2, 0)),
            Event::Fitting { .. } => {}
        };
        catch_unwind(AssertUnwindSafe(|| start(&path, &mut observe))).unwrap_err();
        let card = TrainConfig::resume(&path.parent().unwrap().join("out"), &Device::flex(), &mut |_| {}).unwrap();
        let found = std::fs::read(card.with_extension("safetensors")).unwrap();
        assert!(found == expected, "{supervision}");
        let text = std::fs::read_to_string(card).unwrap();
        assert_eq!(text.contains("3D labels"), supervision == "mixed", "{supervision}: {text}");
    }
}

#[test]
fn the_weights_with_the_least_forecast_error_are_kept() {
    let _alone = alone();
    let folder = synthetic("best", 1, 45, |clip| {
        clip.frames.truncate(45);
        clip.frames.iter_mut().for_each(|frame| frame.world = None);
    });
    // the second phase ruins what the first has learned
    let path = on("best_run", &folder, "physics-fit", "validate_every = 1");
    let text = std::fs::read_to_string(&path).unwrap();
    let (first, second) = text.rsplit_once("learning_rate = 1e-3").unwrap();
    std::fs::write(&path, format!("{first}learning_rate = 2e-2{second}")).unwrap();
    let mut scores = Vec::new();
    let card = start(&path, &mut |event| {
        if let Event::Step(progress) = event
            && let Some(Validation::Score(score)) = &progress.validation
        {
            assert_eq!(score.dtg.n, 0, "there is no truth");
            scores.push((progress.step, score.forecast_px.unwrap()));
        }
    });
    let card = Card::from_file(&card.unwrap()).unwrap();
    assert_eq!(scores.len(), 7);
    let table = std::fs::read_to_string(path.with_file_name("out/log.csv")).unwrap();
    let lines: Vec<Vec<&str>> = table.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!((lines.len(), lines[0][0], lines[0][9]), (8, "step", "forecast_px"));
    // A number that is read from JSON may be off in its last bit.
    let same = |read: f64, score: f64| (read - score).abs() <= 1e-14 * score;
    assert!(same(lines[7][9].parse().unwrap(), scores[6].1), "{table}");
    let best = scores.iter().min_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
    let kept = std::fs::read_to_string(path.with_file_name("out/checkpoints/score.json")).unwrap();
    let kept: serde_json::Value = serde_json::from_str(&kept).unwrap();
    assert_eq!(kept["step"].as_u64().unwrap() as usize, best.0);
    assert!(same(kept["score"].as_f64().unwrap(), best.1), "{kept}");
    // and they are what is published, norms' statistics and all
    let device = Device::flex();
    let weights = std::fs::read(path.with_file_name("out/t.safetensors")).unwrap();
    let localiser = Localiser::new(card, weights, &device).unwrap();
    let published = pollster::block_on(score(
        &localiser,
        &Pictures::new(Clips::read(&folder).unwrap(), 0),
        Some(2),
        &LearnedLaws::default(),
    ))
    .unwrap();
    let published = published.forecast_px.unwrap();
    assert!((published - best.1).abs() < 0.01 * best.1, "{published} {scores:?}");
    assert!(scores.iter().any(|(_, score)| *score > 1.05 * best.1), "{scores:?}");
}

#[test]
fn labels_written_otherwise_are_recognised() {
    for (name, hint, change) in [
        ("swapped", "exchanged", (|frame| frame.image = frame.image.map(|[x, y]| [y, x])) as fn(&mut Frame)),
        ("slow", "twice", |frame| frame.t *= 2.0),
        ("fast", "half", |frame| frame.t /= 2.0),
        ("upward", "bottom", |frame| frame.image = frame.image.map(|[x, y]| [x, 223.0 - y])),
    ] {
        let folder = synthetic(name, 2, 0, |clip| clip.frames.iter_mut().for_each(change));
        let error =
            start(&on(&format!("{name}_run"), &folder, "physics-fit", ""), &mut |_| {}).unwrap_err().to_string();
        assert!(error.contains(hint) && error.contains("of 2 clips"), "{name}: {error}");
    }
}

#[test]
fn clips_that_cannot_teach_are_refused_by_name() {
    let short = synthetic("short", 1, 0, |clip| clip.frames.truncate(12));
    let brief = synthetic("brief", 1, 0, |clip| clip.frames.truncate(3));
    let invisible = synthetic("invisible", 1, 0, |clip| {
        clip.frames.iter_mut().for_each(|frame| (frame.visible, frame.image, frame.world) = (false, None, None));
    });
    let floating = synthetic("floating", 1, 0, |clip| clip.scene.as_mut().unwrap().gravity = [0.0; 3]);
    let nowhere = synthetic("nowhere", 1, 0, |clip| clip.scene = None);
    for (folder, supervision, named, more) in [
        (&short, "future-2d-gt", "17 frames", "future = { velocity = \"pictures\" }"),
        (&brief, "future-2d-gt", "5 frames", ""),
        (&floating, "future-2d-gt", "gravity", "future = { learn = [\"gravity\"] }"),
        (&short, "future-2d-gt", "no drag", "future = { learn = [\"drag\"] }"),
        (&invisible, "future-2d-gt", "visible", ""),
        (&invisible, "physics-fit", "explains 0 of 1", ""),
        (&invisible, "3d-gt", "visible", ""),
        (&floating, "physics-fit", "gravity", ""),
        (&floating, "future-2d-gt", "gravity", ""),
        (&nowhere, "physics-fit", "scene", ""),
    ] {
        let error = start(&on("refused", folder, supervision, more), &mut |_| {}).unwrap_err().to_string();
        assert!(error.contains(named), "{supervision}: {error}");
    }
}

#[test]
fn the_papers_own_recipe_makes_its_steps() {
    let _alone = alone();
    let folder = synthetic("paper", 1, 45, |clip| clip.frames.truncate(45));
    let mut settings = TrainSettings::preset("paper").unwrap();
    let out = scratch("paper-run").join("out");
    let [folder, out_text] = [&folder, &out].map(|path| path.to_str().unwrap().replace('\\', "/"));
    for field in [
        format!("train={folder}"),
        format!("validation={folder}"),
        format!("out={out_text}"),
        "validate_frames=1".into(),
        // The pictures are smaller, and fewer, than the paper's: this is to be seen within seconds.
        "input={width=64, height=64}".into(),
        "phases=[{steps=2, batch=6, learning_rate=2e-5}]".into(),
    ] {
        settings.set(&field).unwrap();
    }
    let mut losses = Vec::new();
    let mut observe = |event: Event| {
        if let Event::Step(progress) = event {
            losses.push([progress.loss, progress.heatmap, progress.future, progress.gradient_norm]);
        }
    };
    let card = TrainConfig::start(settings.config().unwrap(), &Device::flex(), &mut observe).unwrap();
    assert_eq!(losses.len(), 2);
    for [loss, heatmap, future, norm] in losses {
        // At β = 10 a random network's positions jump over the picture: a forecast may end behind the camera, and count as zero.
        assert!([loss, heatmap, future, norm].iter().all(|value| value.is_finite()) && norm > 0.0 && future >= 0.0);
    }
    assert!(Card::from_file(&card).is_ok());
}

#[test]
fn a_step_that_cannot_fit_the_memory_is_refused_before_the_start() {
    let _alone = alone();
    let path = configuration("memory", "");
    let text = std::fs::read_to_string(&path).unwrap().replacen("batch = 3", "batch = 100000000", 1);
    std::fs::write(&path, text).unwrap();
    let error = start(&path, &mut |_| {}).unwrap_err().to_string();
    assert!(error.contains("GB") && error.contains("batch"), "{error}");
    assert!(!path.with_file_name("out/run.toml").exists());
}

#[test]
fn fits_are_left_behind_by_runs_that_start_alone_and_resumed_with_what_they_are_of() {
    let _alone = alone();
    let folder = synthetic("left", 1, 45, |clip| clip.frames.truncate(45));
    let path = on("left-run", &folder, "physics-fit", "");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.replacen("batch = 3", "batch = 100000000", 1)).unwrap();
    start(&path, &mut |_| {}).unwrap_err();
    assert!(!path.with_file_name("out").exists(), "nothing is left behind");
    std::fs::write(&path, &text).unwrap();
    let mut stop = |event: Event| assert!(!matches!(event, Event::Step(_)), "killed by the test");
    catch_unwind(AssertUnwindSafe(|| start(&path, &mut stop))).unwrap_err();
    assert!(path.with_file_name("out/fits.jsonl").exists());
    // The labels are corrected before it goes on: it learns from them, as a run from the start does.
    let clips = Clips::read(&folder).unwrap();
    let index = std::fs::read_to_string(folder.join("clips.jsonl")).unwrap();
    let mut corrected = clips.clone();
    corrected.clips[0].frames.iter_mut().for_each(|frame| frame.image = frame.image.map(|[x, y]| [x + 0.5, y]));
    corrected.write_index().unwrap();
    assert_ne!(std::fs::read_to_string(folder.join("clips.jsonl")).unwrap(), index);
    let weights = |card: PathBuf| std::fs::read(card.with_extension("safetensors")).unwrap();
    let resumed = weights(TrainConfig::resume(&path.with_file_name("out"), &Device::flex(), &mut |_| {}).unwrap());
    let fresh = weights(start(&on("left-fresh", &folder, "physics-fit", ""), &mut |_| {}).unwrap());
    assert!(resumed == fresh);
}

#[test]
fn a_run_that_diverges_stops_and_says_so() {
    let _alone = alone();
    let path = configuration("diverges", "");
    let text = std::fs::read_to_string(&path).unwrap().replacen("learning_rate = 1e-3", "learning_rate = 1e12", 1);
    std::fs::write(&path, text.replacen("steps = 4", "steps = 400", 1)).unwrap();
    let error = start(&path, &mut |_| {}).unwrap_err();
    assert!(matches!(error, Error::Diverged { .. }), "{error}");
    assert!(error.to_string().contains("learning_rate"), "{error}");
}

#[test]
fn a_run_may_start_from_a_models_weights() {
    let _alone = alone();
    let extra = format!("start_from = {:?}", root().join("tests/golden/tiny.json"));
    let path = configuration("start-from", &extra);
    let mut first = None;
    let mut observe = |event: Event| {
        if let Event::Step(progress) = event {
            first.get_or_insert(progress.heatmap);
        }
    };
    let card = Card::from_file(&start(&path, &mut observe).unwrap()).unwrap();
    let tiny = tiny_card();
    assert_eq!((card.architecture, card.input), (tiny.architecture, tiny.input));
    let mut fresh = None;
    let mut observe = |event: Event| {
        if let Event::Step(progress) = event {
            fresh.get_or_insert(progress.heatmap);
        }
    };
    start(&configuration("start-fresh", ""), &mut observe).unwrap();
    assert!(first.unwrap() < fresh.unwrap() - 0.2, "{first:?} {fresh:?}");
}
