//! What clips teach.

mod solver;

use std::path::Path;

use nalgebra::{Point2, Point3};

use super::candidates::missed;
use super::photographs::Photographs;
use super::renderings::NIGHTS;
use super::{CandidateCrops, Example, Examples, Fits, Pictures, Prepared, Sampler, Start, Target, prepare, teach};
use crate::localise::Localiser;
use crate::model::VERIFIER_RADIUS;
use crate::testing::{formula, root, scratch};
use crate::train::recipe::{FitConfig, Phase, Recipe};
use crate::train::testing::{on, synthetic};
use crate::train::{TrainConfig, TrainSettings};
use gravisight_clips::{Clip, Clips};
use gravisight_geometry::camera::Outline;
use gravisight_geometry::random::Stream;
use gravisight_synth::RandomScenes;
use gravisight_track::SOLVER_VERSION;

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

/// What a run learns, and how many clips were fitted for it.
fn prepared(config: &TrainConfig, file: &Path) -> (Vec<Example>, Option<Fits>, usize) {
    let mut fitted = 0;
    let Prepared { examples, fits, .. } =
        prepare(&config.recipe, config.paths.train().unwrap(), file, &mut |done, _| fitted = done).unwrap();
    (examples.frames, fits, fitted)
}

#[test]
fn clips_are_fitted_again_when_anything_that_matters_has_changed() {
    let folder = |name: &str, change: fn(&mut Clip)| {
        synthetic(name, 1, 0, |clip| {
            clip.frames.truncate(45);
            change(clip);
        })
    };
    let same = folder("fits-same", |_| {});
    let labels = folder("fits-labels", |clip| {
        clip.frames.iter_mut().for_each(|frame| frame.image = frame.image.map(|[x, y]| [x + 0.2, y]));
    });
    let scene = folder("fits-scene", |clip| clip.scene.as_mut().unwrap().gravity[2] *= 1.01);
    let config = |clips: &Path, extra: &str| TrainSettings::read(&on("fits", clips, "physics-fit", extra)).unwrap();
    let config = |clips: &Path, extra: &str| config(clips, extra).config().unwrap();
    let file = scratch("fits-kept").join("fits.jsonl");
    let (first, fits, fitted) = prepared(&config(&same, ""), &file);
    assert!(fitted == 1 && !file.exists(), "only a run that starts keeps them");
    fits.unwrap().save(&file).unwrap();
    // What does not matter to the fit does not cost another.
    let (again, _, fitted) = prepared(&config(&same, "seed = 8"), &file);
    assert_eq!((again, fitted), (first.clone(), 0));
    let none = file.with_file_name("none");
    for (clips, extra) in [
        (&labels, ""),
        (&scene, ""),
        (&same, "contact = { model = \"spring\", stiffness = 990.0 }"),
        (&same, "label_noise_px = 0.3"),
        (&same, "fit = { noise_px = 0.4 }"),
    ] {
        let config = config(clips, extra);
        let (found, fits, fitted) = prepared(&config, &file);
        assert_eq!((&found, fitted), (&prepared(&config, &none).0, 1), "{extra}");
        assert!(found != first, "{extra}");
        // and then kept in the place of the old ones
        let renewed = file.with_file_name("renewed");
        fits.unwrap().save(&renewed).unwrap();
        assert_eq!(prepared(&config, &renewed).2, 0, "{extra}");
    }
}

#[test]
fn fits_of_another_solver_are_made_again() {
    let clips = synthetic("fits-solver", 1, 0, |clip| clip.frames.truncate(45));
    let config = TrainSettings::read(&on("fits-solver-run", &clips, "physics-fit", "")).unwrap().config().unwrap();
    let clips = Clips::read(&clips).unwrap().clips;
    let file = scratch("fits-solver-kept").join("fits.jsonl");
    let (_, fits, _) = prepared(&config, &file);
    fits.unwrap().save(&file).unwrap();
    let read = |version: u32| Fits::of_solver(version, &file, &clips, &config.recipe.fit).unwrap().is_some();
    assert!(read(SOLVER_VERSION) && !read(SOLVER_VERSION + 1));
}

#[test]
fn fits_of_before_they_said_what_they_were_of_are_made_again() {
    let clips = synthetic("fits-old", 1, 0, |clip| clip.frames.truncate(45));
    let config = TrainSettings::read(&on("fits-old-run", &clips, "physics-fit", "")).unwrap().config().unwrap();
    let file = scratch("fits-old-kept").join("fits.jsonl");
    let (first, fits, _) = prepared(&config, &file);
    fits.unwrap().save(&file).unwrap();
    let text = std::fs::read_to_string(&file).unwrap();
    std::fs::write(&file, text.split_once('\n').unwrap().1).unwrap();
    assert_eq!(prepared(&config, &file).2, 1);
    assert_eq!(prepared(&config, &file).0, first);
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
    let examples = Examples::new(&recipe, clips.clone(), frames.collect()).unwrap();
    let error = Sampler::new(&recipe, examples, Pictures::new(clips.clone(), 0)).err().unwrap().to_string();
    assert!(error.contains(&clips.clips[0].id) && error.contains("scene"), "{error}");
}

/// The sampler of a recipe of future losses whose windows start from three pictures, on clips of 30 frames, two of which hide the
/// ball of one.
fn of_windows(name: &str, supervision: &str, extra: &str) -> (TrainConfig, Sampler) {
    let folder = synthetic(name, 2, 30, |clip| {
        clip.frames.truncate(30);
        clip.frames.iter_mut().for_each(|frame| frame.visible = true);
        if clip.id.ends_with("0001") {
            clip.frames[3].visible = false;
        }
    });
    let extra = format!("augmentation = {{ brightness = 0.0, noise = 0.0 }}\nempty_fraction = 0.0\n{extra}");
    let mut settings = TrainSettings::read(&on(&format!("{name}-run"), &folder, supervision, &extra)).unwrap();
    settings.set("phases=[{steps=4,batch=40,crop=32,learning_rate=1e-3}]").unwrap();
    let config = settings.config().unwrap();
    let Prepared { examples, .. } = prepare(&config.recipe, &folder, &folder.join("fits"), &mut |_, _| {}).unwrap();
    let pictures = Pictures::new(examples.clips.clone(), 0);
    let sampler = Sampler::new(&config.recipe, examples, pictures).unwrap();
    (config, sampler)
}

#[test]
fn of_a_sequence_every_picture_is_the_middle_of_a_window() {
    let future = r#"future = { ahead = [4, 8, 15], velocity = "pictures", sequence = 18 }"#;
    let (config, sampler) = of_windows("sequence", "future-2d-predict", future);
    let phase = Phase { batch: 40, ..config.recipe.phases[0] };
    let batch = sampler.batch(&phase, 3).unwrap();
    // Two sequences of 18; the last four frames have none of the frames ahead in theirs.
    assert_eq!((batch.count(), batch.windows.len()), (36, 2 * 13));
    for (index, window) in batch.windows.iter().enumerate() {
        let (sequence, middle) = (index / 13, index % 13 + 1);
        assert_eq!(window.first, 18 * sequence + middle - 1);
        let Start::Pictures { times, .. } = window.start else { panic!("starts from pictures") };
        let frame = 1.0 / 15.0;
        assert!((times[0] + frame).abs() < 1e-9 && times[1] == 0.0 && (times[2] - frame).abs() < 1e-9);
        let expected: Vec<usize> = [4, 8, 15].into_iter().filter(|by| middle + by < 18).collect();
        assert_eq!(window.ahead.len(), expected.len());
        for ((time, target), by) in window.ahead.iter().zip(expected) {
            let Target::Predicted { picture, .. } = target else { panic!("meets a picture's own position") };
            assert_eq!(*picture, 18 * sequence + middle + by);
            assert!((time - by as f64 * frame).abs() < 1e-9);
        }
    }
    let windows = sampler.examples().windows(&config.recipe);
    let first_of = |clip: usize| windows.iter().filter(move |(of, _)| *of == clip).map(|(_, first)| *first);
    assert_eq!(first_of(0).collect::<Vec<_>>(), (0..=12).collect::<Vec<_>>());
    assert_eq!(first_of(1).collect::<Vec<_>>(), (4..=12).collect::<Vec<_>>(), "none across a hidden ball");
}

#[test]
fn with_true_positions_a_window_meets_those_of_its_frames_ahead() {
    let future = r#"future = { ahead = [4, 8], velocity = "pictures" }"#;
    let (config, sampler) = of_windows("true-positions", "future-3d-gt", future);
    let batch = sampler.batch(&Phase { batch: 10, ..config.recipe.phases[0] }, 0).unwrap();
    assert_eq!((batch.count(), batch.windows.len()), (10, 2));
    for (number, window) in batch.windows.iter().enumerate() {
        for (index, (_, target)) in window.ahead.iter().enumerate() {
            let &Target::True { picture, position, transform } = target else { panic!("meets the truth") };
            assert_eq!(picture, 5 * number + 3 + index);
            let seen = window.camera.image_from_camera(&Point3::from(position)).unwrap();
            let label = Point2::from(transform.clip_from_picture(batch.labels.image[picture].unwrap()));
            assert!((seen - label).norm() < 1e-6, "the truth is where the picture's label is");
        }
    }
}

#[test]
fn a_turned_camera_sees_the_scene_from_the_same_place() {
    let folder = synthetic("turned", 2, 0, |clip| clip.frames.truncate(20));
    let cameras = |extra: &str| {
        let config = TrainSettings::read(&on("turned-run", &folder, "3d-gt", extra)).unwrap().config().unwrap();
        let Prepared { examples, .. } = prepare(&config.recipe, &folder, &folder.join("fits"), &mut |_, _| {}).unwrap();
        examples.clips.clips.iter().map(|clip| clip.camera.clone()).collect::<Vec<_>>()
    };
    let (usual, turned) = (cameras(""), cameras("camera_off_degrees = 2.0"));
    for (a, b) in usual.iter().zip(&turned) {
        assert!((a.world_from_camera(&Point3::origin()) - b.world_from_camera(&Point3::origin())).norm() < 1e-9);
        let turn = b.rotation() * a.rotation().transpose();
        let angle = ((turn.trace() - 1.0) / 2.0).acos().to_degrees();
        assert!((angle - 2.0).abs() < 1e-6, "{angle}");
    }
    assert_eq!(turned[0].rotation(), turned[1].rotation(), "one camera, one error");
}

fn crops_of_any() -> (Recipe, CandidateCrops) {
    let mut settings = TrainSettings::preset("any-verifier").unwrap();
    settings.set("out=/nowhere").unwrap();
    let recipe = settings.config().unwrap().recipe;
    recipe.check().unwrap();
    let crops = CandidateCrops::new(&recipe, None, &root().join("models/any.json")).unwrap();
    (recipe, crops)
}

#[test]
fn a_batch_is_drawn_from_its_step_and_every_ball_lies_in_its_crop() {
    let (recipe, crops) = crops_of_any();
    let phase = Phase { batch: 30, ..recipe.phases[0] };
    let batch = crops.batch(&phase, 7).unwrap();
    let again = crops.batch(&phase, 7).unwrap();
    assert_eq!((&batch.pictures, &batch.labels.image), (&again.pictures, &again.labels.image));
    assert_ne!(batch.pictures, crops.batch(&phase, 8).unwrap().pictures);
    assert_eq!(batch.pictures.len(), 30 * 6 * 64 * 64);
    assert_eq!(batch.labels.picture.iter().max(), Some(&29));
    let (mut balls, mut none) = (0, 0);
    for (image, &radius) in batch.labels.image.iter().zip(&batch.labels.depth) {
        match image {
            Some(image) => {
                assert!(image.iter().all(|at| (0.0..63.0).contains(at)) && (4.0..25.0).contains(&radius));
                balls += 1;
            }
            None => none += 1,
        }
    }
    assert!(balls >= 5 && none >= 5, "{balls} {none}");
}

#[test]
fn which_balls_are_missed_does_not_depend_on_darkness() {
    let scenes = RandomScenes::new(vec![], 0.0).with_nights(NIGHTS);
    let ball = Outline { centre: Point2::origin(), radius: 5.0 };
    let dark: Vec<u64> = (0..4000).filter(|&seed| scenes.night(seed).is_some()).collect();
    let missed = dark.iter().filter(|&&seed| !missed(&[ball], &mut Stream::Candidates.of(seed)).is_empty()).count();
    // Half of about 200; 30 are four standard deviations.
    assert!((150..250).contains(&dark.len()) && missed.abs_diff(dark.len() / 2) < 30, "{missed} of {}", dark.len());
}

/// The published verifier tells balls from other candidates in crops that it was not trained on.
#[test]
fn the_published_verifier_tells_balls_from_other_candidates() {
    let (_, crops) = crops_of_any();
    let (mut right, mut all) = (0, 0);
    for crop in (0..40).flat_map(|index| crops.scored(index).unwrap()) {
        let middle = Outline { centre: Point2::from([31.5; 2]), radius: VERIFIER_RADIUS };
        let outline = crop.ball().copied().unwrap_or(middle);
        let verifier = crops.detector.verifier().expect("`any` has a verifier");
        let found = pollster::block_on(verifier.verifier_detections(&crop.views)).unwrap();
        let probability = Localiser::ball_probability(&found, &outline, outline.radius);
        right += usize::from((probability > 0.5) == crop.ball().is_some());
        all += 1;
    }
    println!("{right} of {all} crops classified correctly");
    assert!(right * 100 >= all * 85, "{right} of {all}");
}

/// A folder with two photographs, one of them labelled.
fn labelled_folder(name: &str, rows: &str) -> std::path::PathBuf {
    let folder = scratch(name);
    for (file, width, height) in [("plain.png", 64, 48), ("ball.png", 80, 80)] {
        image::RgbImage::from_pixel(width, height, image::Rgb([90; 3])).save(folder.join(file)).unwrap();
    }
    let head = "file,x,y,radius_x_px,radius_y_px,quality,unstretch";
    std::fs::write(folder.join("labels.csv"), format!("{head}\n{rows}\n")).unwrap();
    folder
}

#[test]
fn labelled_photographs_are_no_backgrounds_and_stretched_ones_are_made_round() {
    let folder = labelled_folder("labelled", "ball.png,39.5,20,6,12,A,2\nball.png,10,60,6,6,B,2");
    let Photographs { plain, labelled } = Photographs::read(&folder).unwrap();
    assert_eq!((plain.len(), plain[0].dimensions()), (1, (64, 48)));
    let [stretched, round] = &labelled[..] else { panic!("{}", labelled.len()) };
    assert_eq!((stretched.rgb.dimensions(), round.rgb.dimensions()), ((80, 80), (160, 80)));
    assert!(stretched.balls.iter().all(|ball| !ball.is_sized));
    let [whole, loose] = &round.balls[..] else { panic!("{round:?}") };
    assert_eq!((whole.centre, whole.radius, whole.is_sized), ([79.5, 20.0], 12.0, true));
    // Of grade B, and as wide as high in a picture that is stretched: its larger half size is taken.
    assert_eq!((loose.centre, loose.radius, loose.is_sized), ([20.5, 60.0], 12.0, false));
}

#[test]
fn labels_that_cannot_teach_are_refused_by_name() {
    for (rows, expected) in [
        ("missing.png,1,2,3,3,A,1", "missing.png"),
        ("ball.png,1,2,0,3,A,1", "not positive"),
        ("ball.png,1,,3,3,A,1", "is missing"),
        ("ball.png,1,2,3,3,A,-1", "not positive"),
    ] {
        let error = Photographs::read(&labelled_folder("labels-refused", rows)).unwrap_err().to_string();
        assert!(error.contains(expected), "{rows}: {error}");
    }
}
