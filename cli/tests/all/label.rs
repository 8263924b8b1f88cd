//! `gravisight label` as a user meets it.

use std::process::{Command, Output};

use crate::common::{root, scratch};
use gravisight::{Clips, Track};
use serde_json::{Value, json};

fn gravisight(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gravisight")).args(arguments).current_dir(root()).output().unwrap()
}

#[test]
fn the_command_turns_a_clips_folder_into_a_labelled_one() {
    let folder = scratch("label");
    let [given, out] = ["given", "new"].map(|name| folder.join(name));
    let [given_path, path] = [&given, &out].map(|folder| folder.to_str().unwrap());
    let made = gravisight(&["synth", "--set", "sd-s", "--split", "val", "--clips", "2", "--out", given_path]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let output = gravisight(&["label", given_path, "--out", path, "--json"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((report["frames"].as_u64(), report["clips"].as_array().map(Vec::len)), (Some(180), Some(2)));
    let clips = Clips::read(&out).unwrap();
    let truth = Clips::read(&given).unwrap();
    let pairs = clips.clips.iter().zip(&truth.clips).flat_map(|(ours, theirs)| ours.frames.iter().zip(&theirs.frames));
    let (mut offs, mut seen) = (vec![], 0);
    for (ours, theirs) in pairs {
        seen += usize::from(theirs.visible);
        let both = ours.image.filter(|_| ours.visible).zip(theirs.image);
        offs.extend(both.map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])));
    }
    assert_eq!(report["labelled"].as_u64(), Some(offs.len() as u64), "{report}");
    let right = offs.iter().filter(|off| **off < 1.0).count();
    println!("{} of {seen} labelled, {right} of them within 1 px: {offs:.2?}", offs.len());
    assert!(offs.len() >= seen * 98 / 100 && right >= seen * 97 / 100, "{right} of {seen} within 1 px: {offs:.2?}");
    let clip = &clips.clips[0];
    assert!(clip.frames.iter().all(|frame| frame.world.is_none() && clips.picture(clip, frame).is_ok()));
    let name = clip.id.replace('/', "_");
    let table = std::fs::read_to_string(out.join(format!("labels/{name}.csv"))).unwrap();
    assert_eq!(table.lines().count(), 91);
    let again = gravisight(&["label", given_path, "--out", path]);
    assert!(!again.status.success() && String::from_utf8_lossy(&again.stderr).contains("already"));
}

#[test]
fn the_command_turns_a_folder_of_frames_into_a_track_or_into_cvats_xml() {
    let folder = scratch("label-frames");
    let camera = serde_json::to_string(&Clips::read(&root().join("tests/samples")).unwrap().clips[0].camera).unwrap();
    let camera_file = folder.join("camera.json");
    std::fs::write(&camera_file, camera).unwrap();
    let (camera, frames) = (camera_file.to_str().unwrap(), "tests/samples/frames/train_e1_c1_0000");
    let (track, cvat) = (folder.join("track"), folder.join("cvat"));
    let label = |out: &str, format| {
        gravisight(&["label", frames, "--out", out, "--camera", camera, "--fps", "15", "--format", format])
    };
    assert!(label(track.to_str().unwrap(), "csv").status.success());
    assert!(label(cvat.to_str().unwrap(), "cvat").status.success());
    let track = Track::from_file(&track.join("train_e1_c1_0000.csv")).unwrap();
    assert_eq!(track.points.len(), 12);
    let xml = std::fs::read_to_string(cvat.join("annotations.xml")).unwrap();
    assert_eq!(xml.matches("<image ").count(), 12);
    assert!(cvat.join("frames/train_e1_c1_0000/000011.png").is_file() && !cvat.join("clips.jsonl").exists());
}

#[test]
fn the_command_says_what_is_missing_and_leaves_nothing() {
    let folder = scratch("label-missing");
    let out = folder.join("out");
    let path = out.to_str().unwrap();
    let video = folder.join("video.mp4");
    std::fs::write(&video, "no video").unwrap();
    let camera = folder.join("camera.json");
    let file = json!({"width": 128, "height": 128, "intrinsic": [[500, 0, 63.5], [0, 500, 63.5], [0, 0, 1]],
        "camera_from_world": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]});
    std::fs::write(&camera, file.to_string()).unwrap();
    let (video, camera) = (video.to_str().unwrap(), camera.to_str().unwrap());
    let frames = "tests/samples/frames/train_e1_c1_0000";
    let cases: [(&[&str], &str); 7] = [
        (&[frames], "--camera"),
        (&[frames, "--camera", camera], "--fps"),
        (&[frames, "--camera", camera, "--fps", "15"], "224×224"),
        (&[frames, "--camera", camera, "--fps", "0"], "--fps"),
        (&["src", "--camera", camera, "--fps", "15"], "no PNG"),
        (&["tests/samples", "--camera", camera], "clips folder"),
        (&["no/such/folder", "--camera", camera], "no such"),
    ];
    for (arguments, named) in cases {
        let output = gravisight(&[&["label"], arguments, &["--out", path]].concat());
        let message = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(1) && message.contains(named), "{arguments:?}: {message}");
        assert!(!out.exists(), "{arguments:?}");
    }
    // Nothing is on this path.
    let mut command = Command::new(env!("CARGO_BIN_EXE_gravisight"));
    command.args(["label", video, "--camera", camera, "--out", path]).env("PATH", &folder).current_dir(root());
    let output = command.output().unwrap();
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(1) && message.contains("ffmpeg"), "{message}");
}
