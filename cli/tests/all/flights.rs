//! Simulated flights in real clips, and the stacks that are cut out of them.

use std::path::Path;
use std::process::{Command, Output};

use gravisight::Track;
use serde_json::Value;

use crate::common::{root, scratch};

fn gravisight(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gravisight")).args(arguments).current_dir(root()).output().unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Bytes of a record of `*.stacks`: two pictures of 64×64 px and three numbers.
const RECORD: usize = 2 * 3 * 64 * 64 + 12;

#[test]
fn flights_are_drawn_into_a_video_and_cut_into_stacks() {
    let folder = scratch("flights");
    let [videos, photographs, out] = ["videos", "photographs", "out"].map(|name| folder.join(name));
    [&videos, &photographs].into_iter().for_each(|folder| std::fs::create_dir_all(folder).unwrap());
    let mut film = Command::new("ffmpeg");
    film.args(["-v", "error", "-f", "lavfi", "-i", "color=c=0x5a646e:size=320x180:rate=25:duration=4"]);
    assert!(film.args(["-crf", "18"]).arg(videos.join("wall.mp4")).status().unwrap().success());
    let ball = image::RgbImage::from_fn(120, 120, |x, y| {
        let inside = (f64::from(x) - 60.0).hypot(f64::from(y) - 60.0) < 40.0;
        image::Rgb(if inside { [250, 240, 20] } else { [20, 20, 20] })
    });
    ball.save(photographs.join("ball.png")).unwrap();
    std::fs::write(photographs.join("labels.csv"), "file,x,y,radius_px\nball.png,60,60,40\n").unwrap();
    let videos_and_balls = ["--videos", text(&videos), "--balls", text(&photographs)];
    let arguments = ["synth", "--set", "flights", "--split", "train", "--clips", "5", "--out", text(&out), "--json"];
    let output = gravisight(&[&arguments[..], &videos_and_balls[..]].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let made: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&made["clips"], &made["frames"]), (&5.into(), &(4 * 100 + 50).into()));
    // The fourth clip shows every second frame; the fifth has three balls.
    let truth = |name: &str| Track::from_file(&out.join(format!("{name}.truth.csv"))).unwrap();
    assert!(truth("wall-03").points.iter().all(|point| point.frame < 50));
    let several = ["wall-04.ball0", "wall-04.ball1", "wall-04.ball2"].map(truth);
    assert!(several.iter().all(|ball| ball.points.len() > 50));
    let video = |name: &str| out.join(format!("{name}.mp4"));
    let mut balls = 0;
    for (clip, tables) in [("wall-00", vec!["wall-00"]), ("wall-04", vec!["wall-04.ball0", "wall-04.ball1"])] {
        let stacks = folder.join(format!("{clip}.stacks"));
        let tables: Vec<_> = tables.into_iter().map(|name| out.join(format!("{name}.truth.csv"))).collect();
        let clip = video(clip);
        let mut arguments = vec!["stacks", text(&clip)];
        arguments.extend(tables.iter().map(|table| text(table)));
        arguments.extend(["--out", text(&stacks)]);
        let output = gravisight(&arguments);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let records = std::fs::read(&stacks).unwrap();
        assert_eq!(records.len() % RECORD, 0);
        let is_ball =
            |record: &&[u8]| !f32::from_le_bytes(record[RECORD - 12..RECORD - 8].try_into().unwrap()).is_nan();
        balls += records.chunks_exact(RECORD).filter(is_ball).count();
    }
    assert!(balls > 20, "{balls}");
    let refused = gravisight(&arguments);
    assert!(String::from_utf8_lossy(&refused.stderr).contains("--set flights needs --videos DIR and --balls DIR"));
    let other = gravisight(
        &[&["synth", "--set", "sd-s", "--split", "train", "--out", text(&out)][..], &videos_and_balls].concat(),
    );
    assert!(String::from_utf8_lossy(&other.stderr).contains("need --set flights"));
}
