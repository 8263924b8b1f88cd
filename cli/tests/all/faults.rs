//! What goes wrong around the command: no room, no right to write, files that are not there or go away, clocks that are set back,
//! clips that are broken, another run in the same place. It says so in words, ends with 1, and nothing that was there is lost.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant, SystemTime};

use crate::common::{copy_tree, root, scratch};
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

/// A small file system of a test's own, which is taken away again.
#[cfg(target_os = "linux")]
struct Mounted(PathBuf);

#[cfg(target_os = "linux")]
impl Mounted {
    /// At `folder`; none, and it says so, where nothing may be mounted.
    fn at(folder: PathBuf, options: &str) -> Option<Self> {
        std::fs::create_dir_all(&folder).unwrap();
        let mount = Command::new("mount").args(["-t", "tmpfs", "-o", options, "tmpfs"]).arg(&folder).output();
        match mount.is_ok_and(|output| output.status.success()) {
            true => Some(Self(folder)),
            false => {
                println!("nothing may be mounted here: not tried");
                None
            }
        }
    }
}

#[cfg(target_os = "linux")]
impl Drop for Mounted {
    fn drop(&mut self) {
        Command::new("umount").arg(&self.0).status().ok();
    }
}

const CAMERA: &str = "tests/golden/import/camera.json";

/// Runs that write into `folder`, each with the name of what it writes there. `about` is a folder with what they read.
fn writers(about: &Path, folder: &Path) -> Vec<(&'static str, Vec<String>)> {
    let frames = "tests/samples/frames/train_e1_c1_0000";
    let clips = Clips::read(&root().join("tests/samples")).unwrap();
    let camera = about.join("camera.json");
    std::fs::write(&camera, serde_json::to_string(&clips.clips[0].camera).unwrap()).unwrap();
    let drawn = "import --from cvat tests/golden/import/cvat/rally.xml --category ball --track";
    let lines = [
        ("clips", format!("import --from tracknet tests/golden/import/tracknet --camera {CAMERA} --fps 30 --out")),
        ("track.csv", drawn.into()),
        ("labels", format!("label {frames} --camera {} --fps 15 --out", camera.display())),
        ("ball.csv", format!("track {frames} --fps 15 --out")),
        ("ball.html", format!("track {frames} --fps 15 --report")),
        ("ball.mp4", format!("track {frames} --fps 15 --overlay")),
    ];
    let words = |line: &str, name: &str| {
        let out = folder.join(name).to_str().unwrap().to_string();
        line.split(' ').map(String::from).chain([out]).collect()
    };
    lines.iter().map(|(name, line)| (*name, words(line, name))).collect()
}

#[test]
#[cfg(target_os = "linux")]
fn on_a_full_disk_it_says_so_and_what_was_there_stays() {
    let folder = scratch("full-disk");
    let Some(disk) = Mounted::at(folder.join("disk"), "size=256k") else { return };
    for (name, _) in writers(&folder, &disk.0).iter().filter(|(name, _)| name.contains('.')) {
        std::fs::write(disk.0.join(name), "theirs").unwrap();
    }
    let room = 256 * 1024;
    std::fs::write(disk.0.join("full"), vec![0; room]).unwrap_err();
    for (name, arguments) in writers(&folder, &disk.0) {
        let said = refused(&gravisight().args(&arguments).output().unwrap());
        assert!(said.contains("No space left") && said.contains(disk.0.to_str().unwrap()), "{name}: {said}");
        let kept = std::fs::read_to_string(disk.0.join(name)).unwrap_or_default();
        assert!(kept == if name.contains('.') { "theirs" } else { "" }, "{name} is half written");
        let left: Vec<_> = std::fs::read_dir(&disk.0).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        assert!(left.iter().all(|name| !name.to_string_lossy().starts_with('.')), "{name}: {left:?} is left");
    }
}

#[test]
#[cfg(target_os = "linux")]
fn in_a_folder_that_can_only_be_read_it_says_so() {
    let folder = scratch("read-only");
    let Some(disk) = Mounted::at(folder.join("disk"), "ro,size=256k") else { return };
    for (name, arguments) in writers(&folder, &disk.0) {
        let said = refused(&gravisight().args(&arguments).output().unwrap());
        assert!(said.contains("Read-only") && said.contains(disk.0.to_str().unwrap()), "{name}: {said}");
    }
}

/// An import of TrackNet's layout.
fn importing(source: &Path, out: &Path) -> Command {
    let mut command = gravisight();
    command.args(["import", "--from", "tracknet", text(source), "--camera", CAMERA]);
    command.args(["--fps", "30", "--out", text(out)]);
    command
}

#[test]
fn pictures_that_vanish_while_they_are_read_are_named_and_nothing_half_read_is_left() {
    let folder = scratch("vanishing");
    let (mut refused_some, mut whole) = (0, 0);
    for number in 0..12 {
        let (source, out) = (folder.join(format!("set-{number}")), folder.join(format!("clips-{number}")));
        for copy in 0..40 {
            copy_tree(&root().join("tests/golden/import/tracknet/match"), &source.join(copy.to_string()));
        }
        let mut command = importing(&source, &out);
        let run = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(8 * number));
        std::fs::remove_dir_all(&source).unwrap();
        let output = run.wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
        assert!(!said.contains("panicked"), "{said}");
        match output.status.code() {
            Some(0) => {
                let clips = Clips::read(&out).unwrap();
                let pictures =
                    |clip: &gravisight::Clip| clip.frames.iter().all(|frame| clips.picture(clip, frame).is_ok());
                assert!(clips.clips.iter().all(|clip| clip.frames.len() == 5 && pictures(clip)));
                whole += 1;
            }
            Some(1) => {
                assert!(said.contains("set-") && !out.exists(), "{said}");
                refused_some += 1;
            }
            code => panic!("it ended with {code:?}: {said}"),
        }
    }
    println!("{whole} imports ended, {refused_some} were refused");
    assert!(names(&folder).iter().all(|name| name.starts_with("clips-")));
}

#[test]
fn files_of_the_future_as_after_a_clock_was_set_back_count_as_any_others() {
    let folder = scratch("future");
    let year = Duration::from_secs(365 * 24 * 3600);
    let later = |path: &Path| std::fs::File::open(path).unwrap().set_modified(SystemTime::now() + year).unwrap();
    let (tracks, _) = tracks_of(&folder, 2);
    tracks.iter().for_each(|track| later(track));
    let batch = || {
        let output = batch_of_fits(&folder, "0/1").output().unwrap();
        let lines = String::from_utf8(output.stdout).unwrap();
        lines
            .lines()
            .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap()["status"].clone())
            .collect::<Vec<_>>()
    };
    assert_eq!(batch(), ["done", "done"]);
    for entry in std::fs::read_dir(folder.join("results")).unwrap() {
        later(&entry.unwrap().path());
    }
    assert_eq!(batch(), ["was there", "was there"]);
    std::fs::write(&tracks[0], std::fs::read_to_string(&tracks[0]).unwrap() + "\n").unwrap();
    assert_eq!(batch(), ["done", "was there"]);
    // What a killed run left, of the future: another may be writing there.
    let left = folder.join(".clips.4294967294-0.tmp");
    std::fs::create_dir(&left).unwrap();
    std::fs::write(left.join(".lock"), "").unwrap();
    later(&left.join(".lock"));
    assert!(gravisight().args(synth(&folder.join("clips"))).output().unwrap().status.success());
    assert!(left.exists() && Clips::read(&folder.join("clips")).is_ok());
}

/// So many tracks of a ball that falls, every 27th of them broken, their list, camera and scene; and how many are broken.
fn tracks_of(folder: &Path, count: usize) -> (Vec<PathBuf>, usize) {
    let camera = r#"{"width": 1280, "height": 720, "intrinsic": [[900,0,639.5],[0,900,359.5],[0,0,1]],
        "camera_from_world": [[1,0,0,0],[0,0,-1,1.5],[0,1,0,4],[0,0,0,1]]}"#;
    std::fs::write(folder.join("camera.json"), camera).unwrap();
    let scene = r#"{"gravity": [0, 0, -9.81], "ball": {"radius": 0.1, "drag_coefficient": 0.0}}"#;
    std::fs::write(folder.join("scene.json"), scene).unwrap();
    let mut track = String::from("Frame,Visibility,X,Y\n");
    for frame in 0..6 {
        let t = f64::from(frame) / 60.0;
        track += &format!("{frame},1,{},{}\n", 572.0 + 112.5 * t, 134.5 + 225.0 * 4.905 * t * t);
    }
    let spoilt = ["", "Frame,X\n0,1\n", &track.replace("\n3,", "\n0,"), &track.replace("\n2,1,", "\n2,1,x")];
    let (mut list, mut broken, mut tracks) = (String::new(), 0, vec![]);
    for number in 0..count {
        let name = format!("{number}.csv");
        list += &format!("{name}\n");
        tracks.push(folder.join(&name));
        let is_broken = number % 27 == 26;
        // Every fifth of them is not there at all.
        match spoilt.get(broken % 5).filter(|_| is_broken) {
            Some(text) => std::fs::write(folder.join(&name), text).unwrap(),
            None if is_broken => (),
            None => std::fs::write(folder.join(&name), &track).unwrap(),
        }
        broken += usize::from(is_broken);
    }
    std::fs::write(folder.join("list.txt"), list).unwrap();
    (tracks, broken)
}

fn batch_of_fits(folder: &Path, shard: &str) -> Command {
    let mut command = gravisight();
    let fit = ["fit", "--track", "{}", "--camera", "camera.json", "--scene", "scene.json", "--fps", "60"];
    command.current_dir(folder).env("RAYON_NUM_THREADS", "1");
    command.args(["batch", "list.txt", "--shard", shard, "--out", "results", "--"]).args(fit);
    command
}

#[test]
fn of_many_tracks_the_broken_ones_fail_alone_and_two_runs_share_a_folder() {
    let folder = scratch("many-tracks");
    // A thousand take minutes: scripts/torture.
    let count = if std::env::var_os("TORTURE").is_some() { 1000 } else { 160 };
    let (_, broken) = tracks_of(&folder, count);
    assert_eq!(broken, count / 27);
    let start = |shard| batch_of_fits(&folder, shard).stdout(Stdio::piped()).spawn().unwrap();
    let runs = [start("0/2"), start("1/2")].map(|run| run.wait_with_output().unwrap());
    let mut failed = vec![];
    for output in runs {
        assert_eq!(output.status.code(), Some(3), "{}", String::from_utf8_lossy(&output.stderr));
        let lines = String::from_utf8(output.stdout).unwrap();
        assert_eq!(lines.lines().count(), count / 2);
        let lines = lines.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
        failed.extend(lines.filter(|line| line["status"] == "failed"));
    }
    assert_eq!(failed.len(), broken);
    for line in failed {
        let (input, error) = (line["input"].as_str().unwrap(), line["error"].as_str().unwrap());
        assert!(error.contains(input) && !error.contains("panicked"), "{line}");
    }
    let results = names(&folder.join("results"));
    assert_eq!(results.len(), count - broken + 1, "each has a result, and there is batch.json");
    let whole = |name: &String| {
        std::fs::read(folder.join("results").join(name))
            .is_ok_and(|bytes| serde_json::from_slice::<serde_json::Value>(&bytes).is_ok())
    };
    assert!(results.iter().all(whole));
}

#[test]
fn of_a_thousand_clips_the_broken_ones_are_left_out_of_an_import() {
    let folder = scratch("thousand-imports");
    let source = folder.join("set");
    let spoil: [(&str, &str); 4] =
        [("3;1;", "1;1;"), ("3;1;15.0", "3;1;"), ("Frame", "Fram"), ("3;1;15.0", "3;1;99.0")];
    let mut broken = 0;
    for number in 0..1000 {
        let place = source.join(number.to_string());
        copy_tree(&root().join("tests/golden/import/tracknet/match"), &place);
        if number % 27 == 26 {
            let table = place.join("1_02.csv");
            let whole = std::fs::read_to_string(&table).unwrap();
            match spoil.get(broken % 5) {
                Some((find, put)) => std::fs::write(&table, whole.replacen(find, put, 1)).unwrap(),
                None => std::fs::remove_file(place.join("1_02/3.png")).unwrap(),
            }
            broken += 1;
        }
    }
    let out = folder.join("clips");
    let arguments = [
        "import",
        "--from",
        "tracknet",
        text(&source),
        "--camera",
        CAMERA,
        "--fps",
        "30",
        "--out",
        text(&out),
        "--json",
    ];
    let output = gravisight().args(arguments).output().unwrap();
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(
        (broken, report["clips"].as_u64(), report["refused"].as_array().map(Vec::len)),
        (37, Some(963), Some(37))
    );
    for (refused, number) in report["refused"].as_array().unwrap().iter().zip(0..) {
        let reason = refused["reason"].as_str().unwrap();
        assert!(reason.contains("set/"), "{number}: {refused}");
    }
    assert_eq!(Clips::read(&out).unwrap().clips.len(), 963);
}

#[test]
fn of_two_imports_into_one_folder_one_is_whole_and_the_other_says_why_not() {
    let folder = scratch("two-imports");
    let source = folder.join("set");
    for copy in 0..60 {
        copy_tree(&root().join("tests/golden/import/tracknet/match"), &source.join(copy.to_string()));
    }
    let out = folder.join("clips");
    let start = || {
        let mut command = importing(&source, &out);
        command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
    };
    let runs = [start(), start()].map(|run| run.wait_with_output().unwrap());
    let mut codes = runs.each_ref().map(|output| output.status.code());
    codes.sort();
    assert_eq!(codes, [Some(0), Some(1)], "{runs:?}");
    let said = runs.iter().find(|output| !output.status.success()).map(refused).unwrap();
    assert!(said.contains("clips"), "{said}");
    assert_eq!(Clips::read(&out).unwrap().clips.len(), 60);
    assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 2, "something is left beside it");
}
