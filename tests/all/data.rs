//! Reading clips, and the lines that are refused.

use crate::common::{root, scratch};
use gravisight::Error;
use gravisight::track::TrackPoint;
use gravisight::{Clips, Track};
use nalgebra::Point2;
use serde_json::{Value, json};

fn samples() -> Vec<Value> {
    let text = std::fs::read_to_string(root().join("tests/samples/clips.jsonl")).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// Reads a folder with this one line, and files beside it.
fn read_line(name: &str, line: &str, files: &[(&str, String)]) -> Result<Clips, Error> {
    let folder = scratch(name);
    std::fs::write(folder.join("clips.jsonl"), line).unwrap();
    for (file, text) in files {
        std::fs::write(folder.join(file), text).unwrap();
    }
    Clips::read(&folder)
}

#[test]
fn labels_of_the_samples_are_where_their_camera_sees_the_ball() {
    let clips = Clips::read(&root().join("tests/samples")).unwrap();
    assert_eq!(clips.clips.len(), 2);
    for (clip, frame) in clips.clips.iter().flat_map(|clip| clip.frames.iter().map(move |frame| (clip, frame))) {
        let image = clip.camera.image_from_world(&frame.world.unwrap().into()).unwrap();
        let label = frame.image.unwrap();
        assert!((image.x - label[0]).hypot(image.y - label[1]) < 1e-9);
        assert_eq!(clips.picture(clip, frame).unwrap().size(), gravisight::Size::square(224));
    }
}

#[test]
fn camera_and_scene_may_be_files() {
    let mut line = samples().remove(0);
    let files = [("camera.json", line["camera"].to_string()), ("scene.json", line["scene"].to_string())];
    let inline = read_line("inline", &line.to_string(), &[]).unwrap();
    line["camera"] = json!("camera.json");
    line["scene"] = json!("scene.json");
    let by_path = read_line("by_path", &line.to_string(), &files).unwrap();
    assert_eq!(by_path.clips[0].camera, inline.clips[0].camera);
    assert_eq!(by_path.clips[0].scene, inline.clips[0].scene);
}

#[test]
fn bad_lines_are_refused_with_line_and_field() {
    type Change = dyn Fn(&mut Value);
    let cases: [(&str, &Change, &str); 7] = [
        ("unknown_field", &|line| line["colour"] = json!("red"), "colour"),
        ("unknown_frame_field", &|line| line["frames"][0]["blur"] = json!(1), "blur"),
        ("unknown_camera_field", &|line| line["camera"]["zoom"] = json!(1), "zoom"),
        ("no_camera", &|line| drop(line.as_object_mut().unwrap().remove("camera")), "camera"),
        ("no_fps", &|line| drop(line.as_object_mut().unwrap().remove("fps")), "fps"),
        ("zero_fps", &|line| line["fps"] = json!(0), "fps"),
        ("no_label", &|line| drop(line["frames"][0].as_object_mut().unwrap().remove("image")), "frames[0].image"),
    ];
    for (name, change, named) in cases {
        let mut line = samples().remove(0);
        change(&mut line);
        let error = read_line(name, &format!("\n{line}\n"), &[]).unwrap_err();
        assert!(error.to_string().contains(named), "{name}: {error}");
        assert!(error.to_string().contains("clips.jsonl:2") || name.contains("camera"), "{name}: {error}");
    }
    assert!(matches!(read_line("empty", "\n", &[]), Err(Error::Data { .. })));
    assert!(matches!(Clips::read(&root().join("no such folder")), Err(Error::Io { .. })));
}

#[test]
fn a_picture_of_another_size_than_its_camera_is_refused() {
    let mut line = samples().remove(0);
    line["camera"]["width"] = json!(448);
    let clips = read_line("size", &line.to_string(), &[]).unwrap();
    let clips = Clips { folder: root().join("tests/samples"), ..clips };
    let clip = &clips.clips[0];
    let error = clips.picture(clip, &clip.frames[0]).unwrap_err();
    assert!(error.to_string().contains("448"), "{error}");
}

#[test]
fn a_scene_that_cannot_be_is_refused_with_its_line_and_field() {
    let mut line = samples().remove(0);
    line["scene"]["ball"]["radius"] = json!(-1.0);
    let error = read_line("bad_scene", &line.to_string(), &[]).unwrap_err().to_string();
    assert!(error.contains("clips.jsonl:1") && error.contains("ball.radius"), "{error}");
}

#[test]
fn a_track_is_read_as_it_was_written() {
    let text = "Frame,Visibility,X,Y\n3,1,1.5,2.25\n4,0,,\n7,1,-0.5,1e2\n";
    let track = Track::from_csv(text, "track").unwrap();
    assert_eq!(Track::from_csv(&track.to_csv().unwrap(), "again").unwrap(), track);
    assert_eq!(track.to_csv().unwrap(), "Frame,Visibility,X,Y\n3,1,1.5,2.25\n4,0,,\n7,1,-0.5,100.0\n");
    let (frames, observations) = track.observations(Some(10.0)).unwrap();
    assert_eq!(frames, [3, 4, 5, 6, 7]);
    let seen: Vec<bool> = observations.iter().map(|observation| observation.image.is_some()).collect();
    assert_eq!(seen, [true, false, false, false, true]);
    assert!((observations[0].time - 0.3).abs() < 1e-12 && observations[0].image.unwrap().y == 2.25);
    assert!(track.observations(Some(0.0)).is_err());
    assert!(track.observations(None).unwrap_err().to_string().contains("Time"));
}

#[test]
fn a_track_with_times_needs_no_frame_rate_and_has_none() {
    let text = "Frame,Visibility,X,Y,Time,Radius,RadiusSigma,Sigma\n\
                0,1,1,1,2.0,4.5,0.5,0.3\n1,1,2,2,2.033,4.5,,\n4,1,3,3,2.133,,,\n";
    let track = Track::from_csv(text, "track").unwrap();
    assert_eq!(Track::from_csv(&track.to_csv().unwrap(), "again").unwrap(), track);
    let first = track.points[0];
    assert_eq!([first.radius, first.radius_sigma, first.sigma], [Some(4.5), Some(0.5), Some(0.3)]);
    // Frames that are left out lie evenly between; a frame rate beside the times is not asked.
    for fps in [None, Some(30.0)] {
        let (_, observations) = track.observations(fps).unwrap();
        for (found, expected) in observations.iter().zip([2.0, 2.033, 2.0 + 0.2 / 3.0, 2.1, 2.133]) {
            assert!((found.time - expected).abs() < 0.001, "{} {expected}", found.time);
        }
    }
}

#[test]
fn tracks_of_other_programs_are_read() {
    let plain = Track::from_csv("Frame,Visibility,X,Y\n0,1,1.5,2.5\n2,0,0,0\n", "plain").unwrap();
    for text in [
        "\u{feff}Frame;Visibility;X;Y\r\n0;1;1,5;2,5\r\n\r\n2;0;0;0\r\n",
        "\"frame\",\"visibility\",\"x\",\"y\",\"note\"\n0,1,\"1.5\",2.5,\"left, low\"\n2,0,0,0,\n",
        "Frame\tVisibility\tX\tY\n0.0\ttrue\t1.5\t2.5\n2.0\tfalse\t0\t0\n",
    ] {
        assert_eq!(Track::from_csv(text, "other").unwrap(), plain, "{text}");
    }
}

#[test]
fn what_is_wrong_in_a_track_is_named_by_line_and_column() {
    let head = "Frame,Visibility,X,Y,Time,Sigma\n0,1,1,1,0.0,1\n\n";
    for (line, named) in [
        ("one,1,1,1,0.1,1", "`Frame`"),
        ("0,1,1,1,0.1,1", "`Frame` must ascend"),
        ("1,1,x,1,0.1,1", "`X`"),
        ("1,1,1,,0.1,1", "`Y` is missing"),
        ("1,1,1,1,nan,1", "`Time`"),
        ("1,1,1,1,0.0,1", "`Time` must ascend"),
        ("1,1,1,1,0.1,-1", "`Sigma`"),
        ("1,maybe,1,1,0.1,1", "`Visibility`"),
    ] {
        let error = Track::from_csv(&format!("{head}{line}\n"), "track.csv").unwrap_err();
        assert!(matches!(error, Error::Value { .. }), "{error:?}");
        let error = error.to_string();
        assert!(error.contains("track.csv:4") && error.contains(named), "{line}: {error}");
    }
    assert!(Track::from_csv("Frame,Y\n", "track.csv").unwrap_err().to_string().contains("`X`"));
}

#[test]
fn other_trackers_tables_are_read() {
    let seen = |text: &str| -> Vec<(u64, Option<[f64; 2]>)> {
        let track = Track::from_csv(text, "track").unwrap();
        track.points.iter().map(|point| (point.frame, point.image().map(|at| [at.x, at.y]))).collect()
    };
    assert_eq!(seen("frame,x,y\n0,100,200\n1,,\n"), [(0, Some([100.0, 200.0])), (1, None)]);
    assert_eq!(
        seen("frame_index,x_centroid,y_centroid,visibility\n0,8,2,1\n4,-1,-1,0\n"),
        [(0, Some([8.0, 2.0])), (4, None)]
    );
    // Marks of a ball that is not seen, whatever `Visibility` says.
    assert_eq!(
        seen("Frame,Visibility,X,Y\n0,1,-1,-1\n1,1,0,0\n2,1,0,7\n"),
        [(0, None), (1, None), (2, Some([0.0, 7.0]))]
    );
    assert_eq!(seen("731,298,141\n732,299,140\n"), [(731, Some([298.0, 141.0])), (732, Some([299.0, 140.0]))]);
    // Times stand for frames.
    let text = "timestamp_sec,x_center,y_center,confidence\n1.00,842,236,.9\n1.04,852,214,.9\n";
    let (frames, observations) = Track::from_csv(text, "track").unwrap().observations(None).unwrap();
    assert_eq!((frames, observations[1].time, observations[1].image.unwrap().x), (vec![0, 1], 1.04, 852.0));
    let error = Track::from_csv("x,y\n1,2\n", "track").unwrap_err().to_string();
    assert!(error.contains("no column `Frame`"), "{error}");
}

#[test]
fn a_track_of_points_is_the_one_of_its_text_and_is_refused_as_that_would_be() {
    let at = |frame, x, y| TrackPoint::seen(frame, Point2::new(x, y));
    let track = Track::new(vec![at(0, 1.5, 2.5), TrackPoint::unseen(1), at(2, 3.0, 4.0)]).unwrap();
    assert_eq!(Track::from_csv(&track.to_csv().unwrap(), "again").unwrap(), track);
    let timed = |frame, time| TrackPoint { time: Some(time), ..at(frame, 1.0, 1.0) };
    for (points, field, words) in [
        (vec![at(3, 1.0, 1.0), at(3, 1.0, 1.0)], "Frame", "3 follows 3"),
        (vec![timed(0, 0.5), timed(1, 0.4)], "Time", "0.4 s follows 0.5 s"),
        (vec![timed(0, 0.5), timed(1, f64::NAN)], "Time", "NaN"),
        (vec![timed(0, 0.5), at(1, 1.0, 1.0)], "Time", "1 of 2"),
    ] {
        let error = Track::new(points).unwrap_err();
        assert!(matches!(&error, Error::Value { field: found, .. } if found == field), "{error}");
        assert!(error.to_string().contains(words), "{error}");
    }
}
