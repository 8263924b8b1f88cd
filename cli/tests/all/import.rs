//! Other people's formats: what is read is what is there, what is wrong is refused by name, nothing is left half-written.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::common::{copy_tree, root, scratch};
use gravisight::Camera;
use gravisight::Scene;
use gravisight::{Clip, Clips};
use gravisight::{Error, Result};
use gravisight_cli::import::{Format, ImportOptions, ImportReport, import};
use nalgebra::distance;
use proptest::prelude::*;
use serde_json::Value;

/// Largest difference from what the generator says, px, m, s.
const TOLERANCE: f64 = 1e-6;
/// Name in expected.json, format, source below the fixtures, frames a second where the format does not say.
type Set = (&'static str, Format, &'static str, Option<f64>);
/// Every set of the fixtures.
const SETS: [Set; 11] = [
    ("sd", Format::Sd, "sd", None),
    ("spring", Format::Spring, "spring", None),
    ("rd", Format::Rd, "rd", None),
    ("coco", Format::Coco, "coco/instances.json", Some(25.0)),
    ("cvat_images", Format::Cvat, "cvat/images.xml", Some(50.0)),
    ("cvat_video", Format::Cvat, "cvat/rally.xml", Some(50.0)),
    ("tracknet", Format::Tracknet, "tracknet", Some(30.0)),
    ("yolo", Format::Yolo, "yolo", Some(50.0)),
    ("labelme", Format::Labelme, "labelme", Some(50.0)),
    ("label_studio", Format::LabelStudio, "label_studio/project-4.json", Some(50.0)),
    ("label_studio_video", Format::LabelStudio, "label_studio_video/clip.json", Some(50.0)),
];

fn fixtures() -> PathBuf {
    root().join("tests/golden/import")
}

fn options((_, format, _, fps): Set) -> ImportOptions {
    let own = matches!(format, Format::Sd | Format::Spring | Format::Rd);
    let camera = (!own).then(|| Camera::from_file(&fixtures().join("camera.json")).unwrap());
    let category = (!own && format != Format::Tracknet).then(|| "ball".to_string());
    ImportOptions { camera, fps, category, ..ImportOptions::default() }
}

fn set(name: &str) -> Set {
    SETS.into_iter().find(|set| set.0 == name).unwrap()
}

fn imported(set: Set, from: &Path, out: &Path) -> Result<ImportReport> {
    import(set.1, &from.join(set.2), out, &options(set), &mut |_, _| ())
}

/// A copy of the fixtures' folder of `set`, to be spoilt.
fn copy(set: Set, name: &str) -> PathBuf {
    let to = scratch(name);
    let folder = set.2.split('/').next().unwrap();
    copy_tree(&fixtures().join(folder), &to.join(folder));
    to
}

fn is_close(found: &[f64], expected: &Value) -> bool {
    let expected: Vec<f64> = serde_json::from_value(expected.clone()).unwrap();
    found.len() == expected.len() && found.iter().zip(&expected).all(|(one, other)| (one - other).abs() < TOLERANCE)
}

fn assert_is(clip: &Clip, folder: &Path, expected: &Value) {
    let id = &clip.id;
    assert!((clip.fps - expected["fps"].as_f64().unwrap()).abs() < 1e-5, "{id}: {} a second", clip.fps);
    let camera = Camera::from_json(&expected["camera"].to_string(), "expected").unwrap();
    assert_eq!(clip.camera.size(), camera.size());
    for point in [[0.0, 0.0, 0.0], [0.3, -0.2, 0.5], [-0.4, 0.1, 0.2]].map(Into::into) {
        let [found, expected] = [&clip.camera, &camera].map(|camera| camera.image_from_world(&point).unwrap());
        assert!(distance(&found, &expected) < TOLERANCE, "{id}: {found} {expected}");
    }
    let frames = expected["frames"].as_array().unwrap();
    assert_eq!(clip.frames.len(), frames.len(), "{id}");
    for (frame, expected) in clip.frames.iter().zip(frames) {
        assert!((frame.t - expected["t"].as_f64().unwrap()).abs() < TOLERANCE, "{id}: {frame:?} {expected}");
        for (found, expected) in [
            (frame.image.as_ref().map(|image| image.as_slice()), &expected["image"]),
            (frame.world.as_ref().map(|world| world.as_slice()), &expected["world"]),
        ] {
            assert!(found.map_or(expected.is_null(), |found| is_close(found, expected)), "{id}: {found:?} {expected}");
        }
        assert_eq!(frame.visible, frame.image.is_some());
        let source = fixtures().join(expected["source"].as_str().unwrap());
        let written = folder.join(&frame.file);
        assert!(std::fs::read(&written).unwrap() == std::fs::read(&source).unwrap(), "{written:?} {source:?}");
    }
}

#[test]
fn every_format_gives_what_its_generator_put_in() {
    let text = std::fs::read_to_string(fixtures().join("expected.json")).unwrap();
    let expected: Value = serde_json::from_str(&text).unwrap();
    for set in SETS {
        let out = scratch("every").join(set.0);
        let report = imported(set, &fixtures(), &out).unwrap();
        assert!(report.refused.is_empty(), "{:?}", report.refused);
        let clips = Clips::read(&out).unwrap();
        let expected = expected[set.0].as_object().unwrap();
        assert_eq!(clips.clips.len(), expected.len(), "{}", set.0);
        for clip in &clips.clips {
            assert_is(clip, &out, expected.get(&clip.id).unwrap_or_else(|| panic!("{}", clip.id)));
            assert!(clip.frames.iter().all(|frame| clips.picture(clip, frame).is_ok()));
        }
        let frames = || clips.clips.iter().flat_map(|clip| &clip.frames);
        assert_eq!(report.frames, frames().count());
        assert_eq!(report.labels, frames().filter(|frame| frame.image.is_some()).count());
        assert_eq!(report.positions, frames().filter(|frame| frame.world.is_some()).count());
        let both = frames().filter(|frame| frame.image.is_some() && frame.world.is_some()).count();
        assert_eq!(report.reprojection_px.len(), both);
        assert!(report.reprojection_px.iter().all(|distance| *distance < TOLERANCE));
    }
}

#[test]
fn frames_that_were_left_out_stay_gaps_in_time() {
    let out = scratch("gaps");
    let report = imported(set("rd"), &fixtures(), &out.join("rd")).unwrap();
    assert_eq!(report.gaps, 1);
    let clips = Clips::read(&out.join("rd")).unwrap().clips;
    assert_eq!(clips.iter().map(|clip| clip.frames.len()).collect::<Vec<_>>(), [16, 4]);
    let frames = &clips[0].frames;
    assert!((frames[10].t - frames[9].t - 0.05).abs() < 1e-6);
    // images 1, 2, 4 and 10 of a film
    assert_eq!(imported(set("coco"), &fixtures(), &out.join("coco")).unwrap().gaps, 2);
}

#[test]
fn any_level_of_a_published_set_can_be_given() {
    let out = scratch("levels");
    for (index, (name, below, id)) in [
        ("sd", "sd/synthetic_dataset/train", "train/env1/cam1/0007"),
        ("sd", "sd/synthetic_dataset/test/xml2/camera8/0", "test/env3/cam9/0000"),
        ("spring", "spring/ball_carousel/val", "val/spring/cam1/0003"),
        ("rd", "rd/real_dataset/train/camera1/0", "train/real/cam1/0000/00"),
    ]
    .into_iter()
    .enumerate()
    {
        let out = out.join(index.to_string());
        import(set(name).1, &fixtures().join(below), &out, &options(set(name)), &mut |_, _| ()).unwrap();
        assert_eq!(Clips::read(&out).unwrap().clips[0].id, id);
    }
}

#[test]
fn a_scene_is_attached_and_clips_are_cut_on_request() {
    let scene = Scene::new([0.0, 0.0, -1.0], 0.2);
    let asked = ImportOptions { scene: Some(scene.clone()), clip_frames: Some(4), ..ImportOptions::default() };
    let out = scratch("scene").join("out");
    let report = import(Format::Sd, &fixtures().join("sd"), &out, &asked, &mut |_, _| ()).unwrap();
    assert_eq!((report.clips, report.scenes, report.frames), (4, 4, 11));
    let clips = Clips::read(&out).unwrap().clips;
    assert!(clips.iter().all(|clip| clip.scene.as_ref() == Some(&scene)));
    assert!(clips.iter().any(|clip| clip.id == "train/env1/cam1/0007/01" && clip.frames.len() == 2));
    let none = ImportOptions { clip_frames: Some(0), ..ImportOptions::default() };
    assert!(import(Format::Sd, &fixtures().join("sd"), &out.join("no"), &none, &mut |_, _| ()).is_err());
}

#[test]
fn tables_may_have_semicolons_marks_and_carriage_returns() {
    let set = set("sd");
    let from = copy(set, "odd_tables");
    let table = from.join("sd/synthetic_dataset/train/xml0/camera0/7/label.csv");
    let text = std::fs::read_to_string(&table).unwrap();
    let (header, rows) = text.split_once('\n').unwrap();
    let odd = [
        format!("\u{feff}{}\r\n{}", header.replace(',', ";"), rows.replace(',', ";").replace('\n', "\r\n")),
        // a header of one kind, rows of the other, decimal commas, empty lines, a separator at the end
        format!("{header}\n\n{}", rows.replace(',', ";").replace('.', ",").replace('\n', ";\n\n")),
        format!("\"{}\"\n{rows}", header.replace(", ", "\",\"")),
        // a cell with the separator in it
        format!("\"by, and when\",{header}\n\"A, 3 May\",{}", rows.trim_end().replace('\n', "\n\"B, 4 May\",")),
    ];
    let read = |out: &str| {
        imported(set, &from, &from.join(out)).unwrap();
        Clips::read(&from.join(out)).unwrap().clips.iter().map(|clip| clip.to_line().unwrap()).collect::<Vec<_>>()
    };
    let plain = read("plain");
    for (index, odd) in odd.into_iter().enumerate() {
        std::fs::write(&table, odd).unwrap();
        assert_eq!(read(&index.to_string()), plain);
    }
}

/// Changes `find` to `put` in a file of a copy of `set`, and gives why the clip was refused.
fn refusal(set: Set, file: &str, find: &str, put: &str) -> String {
    let from = copy(set, "refusal");
    let path = from.join(file);
    let text = String::from_utf8(std::fs::read(&path).unwrap()).unwrap();
    assert!(text.contains(find), "{file} holds no `{find}`");
    std::fs::write(&path, text.replacen(find, put, 1)).unwrap();
    let out = from.join("out");
    match imported(set, &from, &out) {
        Ok(report) => {
            assert_eq!(report.refused.len(), 1, "{file}: `{find}` to `{put}`");
            let clips = Clips::read(&out).unwrap();
            assert_eq!(clips.clips.len(), report.clips);
            // of the clip refused, nothing is left
            let refused = out.join(&report.refused[0].clip);
            assert!(!refused.exists() || report.refused[0].clip.starts_with('/'), "{refused:?}");
            report.refused[0].reason.to_string()
        }
        Err(error) => {
            assert!(!out.exists());
            let left = std::fs::read_dir(&from).unwrap().count();
            assert_eq!(left, 1, "temporary files are left");
            error.to_string()
        }
    }
}

#[test]
fn what_is_wrong_is_refused_with_file_and_line() {
    let sd = "sd/synthetic_dataset/train/xml0/camera0/7/";
    let rd = "rd/real_dataset/train/camera1/0/";
    let cases: [(&str, &str, &str, &str, &[&str]); 49] = [
        ("sd", "label.csv", "0.066666667", "nan", &["label.csv:3", "`t`", "finite"]),
        ("sd", "label.csv", "0.066666667", "-1", &["label.csv:3", "increase"]),
        ("sd", "label.csv", "ball imgy", "ball imgz", &["label.csv:1", "ball imgy"]),
        ("sd", "label.csv", "-0.800000000, 0.5", "-0.8x, 0.5", &["label.csv:2", "ball x", "-0.8x"]),
        ("sd", "label.csv", ", 1\n", "\n", &["label.csv:2", "ball visible"]),
        ("sd", "label.csv", "\n0.333333333", "\n#", &["label.csv:7"]),
        ("sd", "info.txt", "E\n", "F\n", &["info.txt", "`E`"]),
        ("sd", "info.txt", "28.97", "x", &["info.txt:7", "numbers"]),
        ("sd", "info.txt", "8.000000000", "-8.0", &["info.txt", "behind the camera"]),
        ("sd", "info.txt", "28.970000000", "5.0", &["info.txt", "do not belong"]),
        ("sd", "info.txt", "-0.642787610", "0.2", &["info.txt", "rotation"]),
        ("rd", "labels.csv", "ball_x;", "ball;", &["labels.csv:1", "ball_x"]),
        ("rd", "labels.csv", "\n;", "\nNaN;NaN", &["labels.csv:14", "ball_x"]),
        ("rd", "labels.csv", "\n;", "\n32;3", &["labels.csv:14", "outside"]),
        ("rd", "labels.csv", "\n;", "\n3;", &["labels.csv:14", "ball_y", "missing"]),
        ("rd", "labels.csv", "\n;", "", &["19 rows", "20"]),
        ("rd", "timestamps.csv", "1693000000140123455", "1693000000120123455", &["timestamps.csv:3", "increase"]),
        ("rd", "timestamps.csv", "1693000000140123455", "soon", &["timestamps.csv:3", "soon"]),
        ("rd", "metadata.csv", "4.0", "-4.0", &["metadata.csv:2", "max_depth"]),
        ("rd", "metadata.csv", "24;32;", "24;33;", &["33"]),
        ("coco", "coco/instances.json", "\"images\"", "\"pictures\"", &["instances.json", "images"]),
        ("coco", "coco/instances.json", "\"width\": 32", "\"width\": 64", &["shot", "64", "camera"]),
        ("coco", "coco/instances.json", "20.0,", "", &["annotations[", "keypoints"]),
        ("coco", "coco/instances.json", "    5.25,\n    7.5,", "5.25, -7.5,", &["shot1.png", "outside"]),
        ("coco", "coco/instances.json", "    5.25,\n    7.5,", "5.25, NaN,", &["line", "column"]),
        ("coco", "coco/instances.json", "\"name\": \"ball\"", "\"name\": \"bat\"", &["ball", "bat, racket"]),
        ("cvat_images", "cvat/images.xml", "</annotations>", "", &["images.xml"]),
        ("cvat_images", "cvat/images.xml", "annotations>", "notes>", &["images.xml"]),
        ("cvat_images", "cvat/images.xml", "width=\"32\"", "width=\"640\"", &["images.xml:4", "640"]),
        ("cvat_images", "cvat/images.xml", "4.5,10.75", "4.5 10.75", &["images.xml:5", "points"]),
        ("cvat_video", "cvat/rally.xml", "xtl=\"6.0\"", "xtl=\"NaN\"", &["rally.xml:4", "xtl"]),
        ("cvat_video", "cvat/rally.xml", "frame=\"6\"", "frame=\"60\"", &["rally.xml:9", "60", "count frames alike"]),
        ("tracknet", "tracknet/match/1_02.csv", "3;1;", "1;1;", &["1_02.csv:5", "ascend"]),
        ("tracknet", "tracknet/match/1_02.csv", "3;1;15.0", "3;1;", &["1_02.csv:5", "`X`", "missing"]),
        ("yolo", "yolo/labels/train/rally_000.txt", "\n1 ", "\n1.5 ", &["rally_000.txt:2", "class", "1.5"]),
        (
            "yolo",
            "yolo/labels/train/rally_000.txt",
            "0 0.5",
            "0 0.5 0.5 0.5 0.5",
            &["rally_000.txt:1", "must be a box"],
        ),
        ("yolo", "yolo/labels/train/rally_000.txt", "\n1 0.2", "\n1 1.2", &["rally_000.txt", "outside"]),
        (
            "yolo",
            "yolo/labels/train/rally_000.txt",
            "0 0.5",
            "1 0.5",
            &["rally_000.txt", "second `ball`", "--category"],
        ),
        ("yolo", "yolo/data.yaml", "1: ball", "1: bat", &["`ball`", "`bat`, `person`"]),
        ("yolo", "yolo/data.yaml", "names:", "names: [", &["data.yaml"]),
        ("labelme", "labelme/throw/1.json", "1.png", "7.png", &["7.png"]),
        ("labelme", "labelme/throw/1.json", "\"imageWidth\": 32", "\"imageWidth\": 64", &["1.json", "64×24", "camera"]),
        ("labelme", "labelme/throw/1.json", "\"circle\"", "\"point\"", &["1.json: shapes[0]", "2 points"]),
        ("labelme", "labelme/throw/1.json", "\"circle\"", "\"mask\"", &["1.json", "`mask`", "circle"]),
        ("labelme", "labelme/throw/1.json", "\"net\"", "\"ball\"", &["1.json", "second `ball`"]),
        ("labelme", "labelme/throw/1.json", "\"points\"", "\"dots\"", &["1.json", "points"]),
        (
            "label_studio",
            "label_studio/project-4.json",
            "\"original_width\": 32",
            "\"original_width\": 64",
            &["task 2", "64×24"],
        ),
        (
            "label_studio",
            "label_studio/project-4.json",
            "was_cancelled\": true",
            "was_cancelled\": false",
            &["task 24", "2 annotations"],
        ),
        (
            "label_studio_video",
            "label_studio_video/clip.json",
            "\"frame\": 3",
            "\"frame\": 1",
            &["task 7", "be unique"],
        ),
    ];
    for (name, file, find, put, named) in cases {
        let file = match name {
            "sd" => format!("{sd}{file}"),
            "rd" => format!("{rd}{file}"),
            _ => file.to_string(),
        };
        let reason = refusal(set(name), &file, find, put);
        assert!(named.iter().all(|part| reason.contains(part)), "{file}: `{find}` to `{put}`: {reason}");
    }
}

#[test]
fn a_box_after_its_last_key_frame_stays_to_the_videos_end_however_long_the_tool_thinks_that_is() {
    let set = set("label_studio_video");
    let from = copy(set, "carried");
    let path = from.join(set.2);
    let text = std::fs::read_to_string(&path).unwrap();
    let at = |count: usize| {
        let goes_on = text.replace("\"frame\": 6, \"enabled\": false", "\"frame\": 5, \"enabled\": true");
        goes_on.replace("\"framesCount\": 6", &format!("\"framesCount\": {count}"))
    };
    // The folder has 6 frames; a duration in seconds may say one more.
    for count in [6, 7, 9] {
        std::fs::write(&path, at(count)).unwrap();
        let out = from.join(format!("out-{count}"));
        let report = imported(set, &from, &out).unwrap();
        assert!(
            report.refused.is_empty(),
            "{count}: {:?}",
            report.refused.iter().map(|each| &each.reason).collect::<Vec<_>>()
        );
        let frames = &Clips::read(&out).unwrap().clips[0].frames;
        let seen: Vec<bool> = frames.iter().map(|frame| frame.visible).collect();
        assert_eq!(seen, [true, true, true, false, true, true], "{count}");
        assert_eq!(frames[5].image, frames[4].image);
    }
    // A key frame is a person's: one that the video has not is refused.
    std::fs::write(&path, at(9).replace("\"frame\": 5", "\"frame\": 8")).unwrap();
    let error = imported(set, &from, &from.join("out-8")).unwrap_err().to_string();
    assert!(error.contains("1 refused") && error.contains("`frame 7` is not in"), "{error}");
}

#[test]
fn a_missing_extra_broken_or_larger_picture_refuses_its_clip_alone() {
    let folder = "sd/synthetic_dataset/train/xml0/camera0/7";
    let larger = root().join("tests/samples").join({
        let clips = Clips::read(&root().join("tests/samples")).unwrap();
        clips.clips[0].frames[0].file.clone()
    });
    type Spoil<'a> = &'a dyn Fn(&Path);
    let cases: [(&str, Spoil, &str); 6] = [
        (
            "gone",
            &|folder| std::fs::remove_file(folder.join("image-3.png")).unwrap(),
            "picture 3, listed in label.csv, is missing",
        ),
        ("extra", &|folder| drop(std::fs::copy(folder.join("image-3.png"), folder.join("image-6.png"))), "picture 6"),
        (
            "twice",
            &|folder| drop(std::fs::copy(folder.join("image-3.png"), folder.join("image-03.png"))),
            "same number",
        ),
        ("larger", &|folder| drop(std::fs::copy(&larger, folder.join("image-3.png"))), "224×224"),
        ("text", &|folder| std::fs::write(folder.join("image-3.png"), "no picture").unwrap(), "image-3.png"),
        (
            "short",
            &|folder| {
                let bytes = std::fs::read(folder.join("image-3.png")).unwrap();
                std::fs::write(folder.join("image-3.png"), &bytes[..bytes.len() - 20]).unwrap();
            },
            "image-3.png",
        ),
    ];
    for (name, spoil, named) in cases {
        let from = copy(set("sd"), "spoilt");
        spoil(&from.join(folder));
        let report = imported(set("sd"), &from, &from.join("out")).unwrap();
        assert_eq!((report.clips, report.refused.len()), (1, 1), "{name}");
        let refused = &report.refused[0];
        assert_eq!(refused.clip, "train/env1/cam1/0007");
        assert!(refused.reason.to_string().contains(named), "{name}: {}", refused.reason);
        assert!(!from.join("out/train/env1/cam1/0007").exists());
    }
}

#[test]
fn two_balls_in_a_picture_are_not_chosen_between() {
    let out = scratch("two_balls");
    let sets = ["coco", "cvat_video", "yolo", "labelme"];
    for (name, named) in sets.map(|name| (name, "--category")) {
        let any = ImportOptions { category: None, ..options(set(name)) };
        let result = import(set(name).1, &fixtures().join(set(name).2), &out.join(name), &any, &mut |_, _| ());
        let reason = match result {
            Ok(report) => report.refused[0].reason.to_string(),
            Err(error) => error.to_string(),
        };
        assert!(reason.contains(named), "{name}: {reason}");
    }
}

#[test]
fn an_archive_and_another_set_are_recognised() {
    let folder = scratch("another_set");
    let archive = folder.join("set.zip");
    std::fs::write(&archive, b"PK").unwrap();
    for (name, other) in [("sd", "rd"), ("rd", "sd"), ("spring", "rd")] {
        let refused = |source: &Path| {
            import(set(name).1, source, &folder.join("out"), &options(set(name)), &mut |_, _| ())
                .unwrap_err()
                .to_string()
        };
        let error = refused(&archive);
        assert!(error.contains("unpack"), "{name}: {error}");
        let error = refused(&fixtures().join(other));
        assert!(error.contains(&format!("--from {other}")), "{name}: {error}");
    }
    assert!(!folder.join("out").exists());
}

#[test]
fn nothing_is_written_where_something_is_or_where_no_clip_is_left() {
    let out = scratch("occupied");
    std::fs::write(out.join("mine"), "precious").unwrap();
    assert!(matches!(imported(set("sd"), &fixtures(), &out), Err(Error::Data { .. })));
    assert_eq!(std::fs::read_dir(&out).unwrap().count(), 1);
    for (index, set) in SETS.into_iter().enumerate() {
        let nothing = scratch("nothing");
        let out = nothing.join(index.to_string());
        let result = import(set.1, &nothing, &out, &options(set), &mut |_, _| ());
        assert!(result.is_err() && !out.exists(), "{}", set.0);
        let gone = import(set.1, &nothing.join("gone"), &out, &options(set), &mut |_, _| ());
        assert!(matches!(gone, Err(Error::Io { .. } | Error::Data { .. })) && !out.exists(), "{}", set.0);
        assert_eq!(std::fs::read_dir(&nothing).unwrap().count(), 0);
    }
}

#[test]
fn labels_where_tools_put_a_ball_that_is_not_visible_are_taken_as_that_and_counted() {
    let out = scratch("nowhere");
    for name in ["yolo", "labelme"] {
        assert_eq!(imported(set(name), &fixtures(), &out.join(name)).unwrap().nowhere, 1, "{name}");
    }
    let spoilt = [
        ("coco", "coco/instances.json", "    5.25,\n    7.5,", "    0, 0,"),
        ("cvat_images", "cvat/images.xml", "4.5,10.75", "-1,-1"),
        (
            "cvat_video",
            "cvat/rally.xml",
            "xtl=\"6.0\" ytl=\"11.75\" xbr=\"9.0\" ybr=\"14.75\"",
            "xtl=\"0\" ytl=\"0\" xbr=\"0\" ybr=\"0\"",
        ),
        ("tracknet", "tracknet/match/1_02.csv", "3;1;15.0;12.5", "3;1;-1;-1"),
        ("sd", "sd/synthetic_dataset/train/xml0/camera0/7/label.csv", "", ""),
    ];
    for (name, file, find, put) in spoilt {
        let from = copy(set(name), "nowhere_in");
        let text = std::fs::read_to_string(from.join(file)).unwrap();
        assert!(text.contains(find), "{file} holds no `{find}`: {text}");
        let before = imported(set(name), &from, &from.join("before")).unwrap();
        std::fs::write(from.join(file), text.replacen(find, put, 1)).unwrap();
        let report = imported(set(name), &from, &from.join("out")).unwrap();
        let taken = usize::from(!find.is_empty());
        assert_eq!((report.nowhere, report.labels), (taken, before.labels - taken), "{name}");
    }
    let arguments =
        ["import", "--from", "labelme", "labelme", "--class", "ball", "--camera", "camera.json", "--fps", "50"];
    let words = out.join("words");
    let arguments = [&arguments[..], &["--out", words.to_str().unwrap()]].concat();
    let said = String::from_utf8(gravisight(&arguments, None).stdout).unwrap();
    assert!(said.contains("NOTE: 1 frames have (0, 0) or (−1, −1): treated as not visible"), "{said}");
}

#[test]
fn a_ball_drawn_in_pictures_becomes_a_track_with_radii() {
    let out = scratch("drawn");
    // By hand, of what make.py draws: half the smaller side of boxes of 4×3 px, and of 4×2; a circle's 2.5; of a point none.
    let expected: [(&str, &str, &[Option<f64>]); 3] = [
        ("yolo", "yolo", &[Some(1.5), None, None, None, Some(1.5)]),
        ("labelme", "labelme", &[Some(2.5), Some(2.0), Some(1.0), None, None]),
        ("label-studio", "label_studio/project-4.json", &[None, Some(1.5), Some(1.5), Some(1.5), None]),
    ];
    for (format, source, radii) in expected {
        let track = out.join(format!("{format}.csv"));
        let arguments =
            ["import", "--from", format, source, "--class", "ball", "--fps", "50", "--track", track.to_str().unwrap()];
        let output = gravisight(&arguments, None);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let track = gravisight::Track::from_file(&track).unwrap();
        let found: Vec<Option<f64>> = track.points.iter().map(|point| point.radius).collect();
        let close = |(one, other): (&Option<f64>, &Option<f64>)| match (one, other) {
            (Some(one), Some(other)) => (one - other).abs() < TOLERANCE,
            _ => one == other,
        };
        assert!(found.len() == radii.len() && found.iter().zip(radii).all(close), "{format}: {found:?}");
        assert!((track.points[4].time.unwrap() - track.points[0].time.unwrap() - 0.08).abs() < 1e-9);
    }
    let said = |source: &str, more: &[&str]| {
        let arguments = ["import", "--from", "label-studio", source, "--track", "/dev/null/track.csv"];
        String::from_utf8(gravisight(&[&arguments[..], more].concat(), None).stderr).unwrap()
    };
    assert!(said("label_studio_video/clip.json", &[]).contains("--camera"));
}

fn gravisight(arguments: &[&str], path: Option<&Path>) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_gravisight"));
    if let Some(path) = path {
        command.env("PATH", path);
    }
    command.args(arguments).current_dir(fixtures()).output().unwrap()
}

#[test]
fn the_command_reports_in_words_and_in_one_json_object() {
    let out = scratch("command");
    let [words, json] = ["words", "json"].map(|name| out.join(name).to_str().unwrap().to_string());
    let output = gravisight(&["import", "--from", "rd", "rd", "--out", &words], None);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(
        output.status.success() && text.contains("60.000 per second") && text.contains("scene      none"),
        "{text}"
    );
    let output = gravisight(&["import", "--from", "rd", "rd", "--out", &json, "--json"], None);
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["clips"], 2);
    assert_eq!([&report["frames"], &report["labels"], &report["positions"], &report["gaps"]], [20, 19, 18, 1]);
    assert!((report["fps"]["mean"].as_f64().unwrap() - 60.0).abs() < 1e-5);
    assert_eq!(report["reprojection_px"]["n"], 18);
    assert_eq!(report["refused"].as_array().unwrap().len(), 0);
    // there is something now
    let again = gravisight(&["import", "--from", "rd", "rd", "--out", &json, "--json"], None);
    assert_eq!((again.status.code(), again.stdout.len()), (Some(1), 0));
    assert_eq!(String::from_utf8(again.stderr).unwrap().lines().filter(|line| line.contains("gravisight:")).count(), 1);
}

#[test]
fn options_that_are_missing_or_mean_nothing_are_a_matter_of_usage() {
    let out = scratch("usage").join("out");
    let out = out.to_str().unwrap();
    for arguments in [
        &["--from", "coco", "coco/instances.json"][..],
        &["--from", "coco", "coco/instances.json", "--camera", "camera.json"],
        &["--from", "cvat", "cvat/rally.xml"],
        &["--from", "tracknet", "tracknet"],
        &["--from", "sd", "sd", "--fps", "3"],
        &["--from", "sd", "sd", "--camera", "camera.json"],
        &["--from", "tracknet", "tracknet", "--camera", "camera.json", "--category", "ball"],
        &["--from", "sd", "sd", "--clip-frames", "0"],
        &["--from", "voc", "sd"],
        &["--from", "yolo", "yolo"],
    ] {
        let output = gravisight(&[&["import", "--out", out], arguments].concat(), None);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
    }
    let wrong = ["import", "--from", "tracknet", "tracknet", "--camera", "camera.json", "--fps", "-3", "--out", out];
    assert_ne!(gravisight(&wrong, None).status.code(), Some(0));
    let frames = ["import", "--from", "tracknet", "tracknet", "--camera", "camera.json", "--out", out];
    let output = gravisight(&frames, None);
    assert!(output.status.code() == Some(1) && String::from_utf8_lossy(&output.stderr).contains("fps"));
}

/// A folder with the track of the rally and `video`.
fn with_video(name: &str, video: &[u8]) -> PathBuf {
    let folder = scratch(name);
    std::fs::copy(fixtures().join("tracknet/rally_ball.csv"), folder.join("rally_ball.csv")).unwrap();
    std::fs::write(folder.join("rally.mkv"), video).unwrap();
    folder
}

fn import_track(folder: &Path, path: Option<&Path>) -> (Output, PathBuf) {
    let out = folder.join("out");
    let track = folder.join("rally_ball.csv");
    let arguments = [track.to_str().unwrap(), "--camera", "camera.json", "--out", out.to_str().unwrap()];
    (gravisight(&[&["import", "--from", "tracknet"], &arguments[..]].concat(), path), out)
}

#[test]
fn without_ffmpeg_a_video_is_refused_with_what_to_install() {
    let folder = with_video("no_ffmpeg", b"no video");
    let (output, out) = import_track(&folder, Some(&folder));
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(
        output.status.code() == Some(1) && said.contains("install ffmpeg") && said.contains("--pictures"),
        "{said}"
    );
    assert!(!out.exists());
}

#[test]
fn a_tracks_times_are_taken_for_pictures() {
    let folder = scratch("times");
    let from = fixtures().join("tracknet");
    let text = std::fs::read_to_string(from.join("rally_ball.csv")).unwrap();
    // 20 a second, one lost after the third; nothing is said of the fifth
    let times = ["Time", "0.95", "1", "1.05", "1.15", "1.25"];
    let lines: Vec<String> = text.lines().zip(times).map(|(line, time)| format!("{line},{time}\n")).collect();
    std::fs::write(folder.join("rally_ball.csv"), lines.concat()).unwrap();
    std::fs::create_dir(folder.join("rally")).unwrap();
    for picture in std::fs::read_dir(from.join("rally")).unwrap() {
        let path = picture.unwrap().path();
        std::fs::copy(&path, folder.join("rally").join(path.file_name().unwrap())).unwrap();
    }
    let (output, out) = import_track(&folder, None);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let clip = Clips::read(&out).unwrap().clips.remove(0);
    assert!((clip.fps - 20.0).abs() < 1e-9);
    let times: Vec<f64> = clip.frames.iter().map(|frame| (frame.t * 1e9).round() / 1e9).collect();
    assert_eq!(times, [1.0, 1.05, 1.15, 1.20, 1.25]);
}

/// Programs that answer as ffprobe and an old ffmpeg do.
#[cfg(unix)]
fn impostors(folder: &Path, times: &str) {
    use std::os::unix::fs::PermissionsExt as _;
    let frames = fixtures().join("tracknet/rally");
    let ffmpeg = format!(
        "#!/bin/sh\ncase \"$*\" in -version) echo 'ffmpeg version 4.4.2 Copyright'; exit 0;; *fps_mode*) echo \"Unrecognized option 'fps_mode'.\" >&2; exit 1;; esac\n\
         for i in 1 2 3 4 5; do /bin/cp {}/$i.png 00000$i.png; done\n",
        frames.display()
    );
    let packets =
        format!("for time in $(printf '{times}'); do echo \"packet|stream_index=0|pts_time=${{time%,}}\"; done");
    let header = "echo 'stream|index=0|r_frame_rate=20/1'; echo 'format|format_name=matroska,webm'";
    let ffprobe =
        format!("#!/bin/sh\ncase \"$*\" in *format_name*) {packets}; {header};; *) printf '{times}';; esac\n");
    for (name, text) in [("ffprobe", ffprobe), ("ffmpeg", ffmpeg)] {
        std::fs::write(folder.join(name), text).unwrap();
        std::fs::set_permissions(folder.join(name), std::fs::Permissions::from_mode(0o755)).unwrap();
    }
}

#[cfg(unix)]
#[test]
fn a_videos_times_are_read_not_guessed() {
    let folder = with_video("impostors", b"a video");
    // 20 a second, and two frames lost after the fourth
    impostors(&folder, "1.00\\n1.05,\\n1.10\\n1.15\\n1.30\\n1.35\\n");
    let (output, out) = import_track(&folder, Some(&folder));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let clip = Clips::read(&out).unwrap().clips.remove(0);
    assert!((clip.fps - 20.0).abs() < 1e-9);
    let times: Vec<f64> = clip.frames.iter().map(|frame| frame.t).collect();
    assert_eq!(times, [1.05, 1.10, 1.15, 1.30, 1.35]);
    assert_eq!(std::fs::read_dir(&out).unwrap().count(), 2, "decoded frames are left");
    for (times, named) in [
        ("N/A\\n", "give --fps"),
        ("0\\n1\\n2\\nN/A\\n4\\n5\\n", "5 of its 6 frames; give --fps"),
        ("0\\n1\\n2\\n", "ffmpeg"),
    ] {
        std::fs::remove_dir_all(&out).unwrap_or_default();
        impostors(&folder, times);
        let said = String::from_utf8(import_track(&folder, Some(&folder)).0.stderr).unwrap();
        assert!(said.contains(named), "{times}: {said}");
    }
}

/// With the real programs; `scripts/setup --browser` installs them.
#[test]
fn a_real_video_is_read_frame_by_frame() {
    let folder = with_video("real_video", b"");
    let video = folder.join("rally.mkv");
    let mut encode = Command::new("ffmpeg");
    encode.args(["-v", "error", "-y", "-framerate", "12.5", "-i"]).arg(fixtures().join("tracknet/rally/%d.png"));
    let status = encode.args(["-c:v", "ffv1", "-pix_fmt", "bgr0"]).arg(&video).status();
    assert!(status.expect("this test needs ffmpeg: scripts/setup --browser").success());
    let (output, out) = import_track(&folder, None);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let clips = Clips::read(&out).unwrap();
    let clip = &clips.clips[0];
    assert!((clip.fps - 12.5).abs() < 1e-9 && clip.frames.len() == 5, "{} {:?}", clip.fps, clip.frames);
    for (index, frame) in clip.frames.iter().enumerate() {
        // the codec loses nothing
        let source = gravisight::Picture::open(&fixtures().join(format!("tracknet/rally/{}.png", index + 1))).unwrap();
        assert!(clips.picture(clip, frame).unwrap().rgb() == source.rgb(), "{index}");
    }
    std::fs::write(&video, &std::fs::read(&video).unwrap()[..300]).unwrap();
    std::fs::remove_dir_all(&out).unwrap();
    let (output, out) = import_track(&folder, None);
    assert!(output.status.code() == Some(1) && !out.exists());
}

/// Texts that readers trip over.
const TRAPS: [&str; 18] = [
    "nan",
    "inf",
    "-1e308",
    "1e999",
    ";",
    ",",
    "\r\n",
    "\0",
    "99999999999999999999",
    "-",
    "é",
    "<",
    "\"",
    "]",
    "..",
    "/",
    "",
    "0",
];

/// Arbitrary bytes, or `original` with some of it replaced.
fn spoilt(original: Vec<u8>) -> impl Strategy<Value = Vec<u8>> {
    let trap = prop::sample::select(TRAPS.to_vec()).prop_map(|trap| trap.as_bytes().to_vec());
    let text = prop_oneof![4 => trap, 1 => prop::collection::vec(any::<u8>(), 0..6)];
    let edits = prop::collection::vec((any::<prop::sample::Index>(), 0..12_usize, text), 1..4);
    let edited = edits.prop_map(move |edits| {
        let mut bytes = original.clone();
        for (at, length, text) in edits {
            let at = at.index(bytes.len() + 1);
            let until = (at + length).min(bytes.len());
            bytes.splice(at..until, text);
        }
        bytes
    });
    prop_oneof![1 => prop::collection::vec(any::<u8>(), 0..200), 9 => edited]
}

#[test]
fn spoilt_files_are_refused_or_read_but_never_a_panic_and_what_is_written_can_be_read() {
    let [sd, rd] = ["sd/synthetic_dataset/train/xml0/camera0/7/", "rd/real_dataset/train/camera1/"];
    let files = [
        ("sd", format!("{sd}label.csv")),
        ("sd", format!("{sd}info.txt")),
        ("sd", format!("{sd}image-2.png")),
        ("rd", format!("{rd}0/labels.csv")),
        ("rd", format!("{rd}0/timestamps.csv")),
        ("rd", format!("{rd}0/metadata.csv")),
        ("rd", format!("{rd}0/depth0004.png")),
        ("rd", format!("{rd}matrices.npz")),
        ("coco", "coco/instances.json".into()),
        ("cvat_images", "cvat/images.xml".into()),
        ("cvat_video", "cvat/rally.xml".into()),
        ("tracknet", "tracknet/match/1_02.csv".into()),
        ("yolo", "yolo/data.yaml".into()),
        ("yolo", "yolo/labels/train/rally_004.txt".into()),
        ("labelme", "labelme/throw/2.json".into()),
        ("label_studio", "label_studio/project-4.json".into()),
        ("label_studio_video", "label_studio_video/clip.json".into()),
    ];
    for (name, file) in files {
        let from = copy(set(name), "fuzz");
        let (path, out) = (from.join(&file), from.join("out"));
        let mut runner = proptest::test_runner::TestRunner::deterministic();
        let mut written = 0;
        for _ in 0..150 {
            use proptest::strategy::ValueTree as _;
            let bytes = spoilt(std::fs::read(fixtures().join(&file)).unwrap()).new_tree(&mut runner).unwrap().current();
            std::fs::write(&path, &bytes).unwrap();
            match imported(set(name), &from, &out) {
                Ok(report) => {
                    let clips = Clips::read(&out).unwrap();
                    assert_eq!(clips.clips.len(), report.clips);
                    for (clip, frame) in clips.clips.iter().flat_map(|clip| clip.frames.iter().map(move |f| (clip, f)))
                    {
                        clips.picture(clip, frame).unwrap();
                    }
                    written += 1;
                    std::fs::remove_dir_all(&out).unwrap();
                }
                Err(error) => assert!(!error.to_string().is_empty() && !out.exists()),
            }
        }
        println!("{file}: {written} of 150 imports gave clips");
    }
}
