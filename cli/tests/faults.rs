//! What goes wrong around the command: no room, no right to write, files that are not there, clips that are broken, another run in
//! the same place. It says so in words, ends with 1, and nothing that was there is lost.

mod common;

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use common::{root, scratch};
use gravisight::{Clips, TrainSettings};

fn gravisight() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_gravisight"));
    command.current_dir(root());
    command
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// What the command said, where it ended with 1.
fn refused(output: &Output) -> String {
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(!said.contains("panicked"), "{said}");
    said
}

fn synth(out: &Path) -> Vec<&str> {
    vec!["synth", "--set", "sd-s", "--split", "val", "--clips", "3", "--seed", "5", "--out", text(out)]
}

/// A run of the command that may write files of at most `kib` KiB, as on a disk without room.
#[cfg(unix)]
fn without_room(arguments: &[&str], kib: u32) -> Output {
    // The signal would end it at once, as no full disk does.
    let shell = format!("trap '' XFSZ; ulimit -f {}; exec \"$0\" \"$@\"", kib * 2);
    let mut command = Command::new("sh");
    command.args(["-c", &shell, env!("CARGO_BIN_EXE_gravisight")]).args(arguments).current_dir(root());
    command.output().unwrap()
}

/// Names of the files in a folder that are not hidden.
fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> = entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.retain(|name| !name.starts_with('.'));
    names.sort();
    names
}

#[test]
#[cfg(unix)]
fn without_room_it_says_so_and_goes_on_once_there_is() {
    let folder = scratch("no-room");
    let out = folder.join("clips");
    let said = refused(&without_room(&synth(&out), 8));
    assert!(said.contains("clips") && said.contains("large"), "{said}");
    assert!(Clips::read(&out).is_err());
    assert!(gravisight().args(synth(&out)).output().unwrap().status.success());
    assert_eq!(Clips::read(&out).unwrap().clips.len(), 3);
    // An import leaves nothing.
    let track = "tests/golden/import/tracknet";
    let camera = "tests/golden/import/camera.json";
    let imported = folder.join("imported");
    let arguments =
        ["import", "--from", "tracknet", track, "--camera", camera, "--fps", "30", "--out", text(&imported)];
    let said = refused(&without_room(&arguments, 0));
    assert!(said.contains("large"), "{said}");
    assert!(names(&folder) == ["clips"], "{:?}", names(&folder));
    assert!(gravisight().args(arguments).output().unwrap().status.success());
}

#[test]
#[cfg(unix)]
fn a_run_without_room_for_a_checkpoint_goes_on_from_the_one_before() {
    let folder = scratch("no-room-to-learn");
    let samples = root().join("tests/samples");
    let run = folder.join("run");
    let settings = format!(
        "name = \"t\"\ntrain = {samples:?}\nvalidation = {samples:?}\nout = {run:?}\nsupervision = \"3d-gt\"\n\
         checkpoint_every = 2\nvalidate_frames = 2\ninput = {{ width = 64, height = 64 }}\n\
         [architecture]\nbackbone = {{ kind = \"compact\", stem = 4, stages = [4, 6, 8, 8], pyramid = 4 }}\n\
         head = {{ kind = \"depthwise\" }}\nheatmap = {{ beta = 1.0 }}\n\
         depth = {{ activation = \"exp\", scale = 7.4 }}\n[[phases]]\nsteps = 6\nbatch = 2\ncrop = 32\nlearning_rate = 1e-3\n"
    );
    let file = folder.join("run.toml");
    std::fs::write(&file, settings).unwrap();
    assert!(TrainSettings::read(&file).is_ok());
    let said = refused(&without_room(&["train", "--config", text(&file)], 8));
    assert!(said.contains("large"), "{said}");
    let made = gravisight().args(["train", "--resume", text(&run)]).output().unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    assert!(run.join("t.json").is_file() && run.join("t.safetensors").is_file());
}

#[test]
#[cfg(target_os = "linux")]
fn where_nothing_can_be_written_it_says_so() {
    // Not even for the superuser.
    for place in ["/proc/gravisight/clips", "/proc/gravisight"] {
        let said = refused(&gravisight().args(synth(Path::new(place))).output().unwrap());
        assert!(said.contains("/proc/gravisight"), "{said}");
    }
}

#[test]
fn a_second_run_in_the_same_folder_is_refused_with_the_firsts_number_and_a_killed_ones_lock_is_none() {
    let out = scratch("two-runs").join("clips");
    let mut many = synth(&out);
    many[6] = "200";
    let mut first = gravisight().args(&many).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let lock = out.join(".lock");
    let began = Instant::now();
    while std::fs::read_to_string(&lock).unwrap_or_default() != first.id().to_string() {
        assert!(began.elapsed() < Duration::from_secs(60), "no lock");
        std::thread::sleep(Duration::from_millis(10));
    }
    let said = refused(&gravisight().args(&many).output().unwrap());
    assert!(said.contains(&format!("process {}", first.id())), "{said}");
    first.kill().unwrap();
    first.wait().unwrap();
    assert!(gravisight().args(synth(&out)).output().unwrap().status.success());
}

/// A thousand clips of a frame each, of which every 27th is broken, and how many that are.
fn thousand(name: &str) -> (PathBuf, usize) {
    let folder = scratch(name);
    let sample = std::fs::read_to_string(root().join("tests/samples/clips.jsonl")).unwrap();
    let mut clip: serde_json::Value = serde_json::from_str(sample.lines().next().unwrap()).unwrap();
    let frame = clip["frames"][0].clone();
    let picture = root().join("tests/samples").join(frame["file"].as_str().unwrap());
    clip["frames"] = serde_json::json!([frame]);
    let file = folder.join(frame["file"].as_str().unwrap());
    std::fs::create_dir_all(file.parent().unwrap()).unwrap();
    std::fs::copy(picture, file).unwrap();
    let (mut lines, mut broken) = (String::new(), 0);
    for number in 0..1000 {
        let mut clip = clip.clone();
        clip["id"] = format!("clip-{number}").into();
        let mut line = clip.to_string();
        if number % 27 == 26 {
            line = match broken % 5 {
                0 => line[..line.len() / 2].to_string(),
                1 => line.replacen("\"camera\"", "\"kamera\"", 1),
                2 => line.replacen("frames/", "../frames/", 1),
                3 => line.replacen("\"fps\":15", "\"fps\":-15", 1),
                _ => line.replacen("\"t\":0", "\"t\":null", 1),
            };
            broken += 1;
        }
        lines += &format!("{line}\n");
    }
    std::fs::write(folder.join("clips.jsonl"), lines).unwrap();
    (folder, broken)
}

#[test]
fn of_a_thousand_clips_the_broken_ones_are_counted_and_named() {
    let (folder, broken) = thousand("thousand");
    assert_eq!(broken, 37);
    let arguments = ["evaluate", "--data", text(&folder), "--model", "models/sd-l"];
    let said = refused(&gravisight().args(arguments).output().unwrap());
    assert!(
        said.contains("37 of its 1000 clips") && said.contains("clips.jsonl:27") && said.contains("27 more"),
        "{said}"
    );
    assert!(said.contains("within the clips' folder") && said.contains("fps"), "{said}");
}

#[test]
fn a_picture_that_has_gone_is_named() {
    let (folder, _) = thousand("gone");
    let index = folder.join("clips.jsonl");
    let whole = std::fs::read_to_string(&index).unwrap();
    std::fs::write(&index, whole.lines().next().unwrap()).unwrap();
    let clips = Clips::read(&folder).unwrap();
    std::fs::remove_file(folder.join(&clips.clips[0].frames[0].file)).unwrap();
    let arguments = ["evaluate", "--data", text(&folder), "--model", "models/sd-l"];
    let said = refused(&gravisight().args(arguments).output().unwrap());
    assert!(said.contains(clips.clips[0].frames[0].file.to_str().unwrap()), "{said}");
}
