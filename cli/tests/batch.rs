//! `gravisight batch` as a user meets it: many inputs, some of which cannot be, workers that die.

mod common;

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use common::{root, scratch};
use serde_json::Value;

fn gravisight(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_gravisight"));
    command.args(arguments).current_dir(folder);
    command
}

fn lines(output: &Output) -> Vec<Value> {
    String::from_utf8_lossy(&output.stdout).lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// A folder with pictures of the page's samples, of which two are broken or missing, their camera and a list of them.
fn folder_of(name: &str, count: usize) -> PathBuf {
    let folder = scratch(name);
    let samples = root().join("web/public/samples");
    let list: Vec<Value> = serde_json::from_slice(&std::fs::read(samples.join("samples.json")).unwrap()).unwrap();
    std::fs::write(folder.join("camera.json"), list[0]["camera"].to_string()).unwrap();
    let mut text = String::from("# pictures\n\n");
    for number in 0..count {
        let file = format!("{number}.png");
        text += &format!("{file}\n");
        match number {
            3 => std::fs::write(folder.join(&file), b"no picture").unwrap(),
            5 => continue,
            _ => drop(std::fs::copy(samples.join(list[0]["file"].as_str().unwrap()), folder.join(&file)).unwrap()),
        }
    }
    std::fs::write(folder.join("list.txt"), text).unwrap();
    folder
}

const LOCALISE: [&str; 5] = ["--", "localise", "{}", "--camera", "camera.json"];

#[test]
fn what_is_done_is_not_done_again_and_what_fails_stops_nothing() {
    let folder = folder_of("batch", 8);
    let batch = |shard: &str| {
        let arguments = [&["batch", "list.txt", "--shard", shard, "--out", "results"][..], &LOCALISE].concat();
        gravisight(&folder, &arguments).output().unwrap()
    };
    let first = batch("0/2");
    assert_eq!(first.status.code(), Some(0), "{}", String::from_utf8_lossy(&first.stderr));
    assert!(lines(&first).len() == 4 && lines(&first).iter().all(|line| line["status"] == "done"));
    let all = batch("0/1");
    assert_eq!(all.status.code(), Some(3));
    let said: Vec<Value> = lines(&all);
    let status: Vec<&str> = said.iter().map(|line| line["status"].as_str().unwrap()).collect();
    assert_eq!(status, ["was there", "done", "was there", "failed", "was there", "failed", "was there", "done"]);
    for number in [3, 5] {
        assert!(said[number]["error"].as_str().unwrap().contains(&format!("{number}.png")), "{}", said[number]);
    }
    let found: Value = serde_json::from_slice(&std::fs::read(folder.join("results/7.json")).unwrap()).unwrap();
    assert!(found["world"].is_array());
    // Mended, it is done.
    for number in [3, 5] {
        std::fs::copy(folder.join("1.png"), folder.join(format!("{number}.png"))).unwrap();
    }
    assert_eq!(batch("0/1").status.code(), Some(0));
    assert!(lines(&batch("0/1")).iter().all(|line| line["status"] == "was there"));
}

#[test]
fn eight_workers_of_which_two_are_killed_do_all_once_started_again() {
    let folder = folder_of("workers", 64);
    let start = |shard: usize| {
        let shard = format!("{shard}/8");
        let arguments = [&["batch", "list.txt", "--shard", &shard, "--out", "results"][..], &LOCALISE].concat();
        gravisight(&folder, &arguments).env("RAYON_NUM_THREADS", "1").stdout(Stdio::null()).spawn().unwrap()
    };
    let mut workers: Vec<_> = (0..8).map(start).collect();
    std::thread::sleep(Duration::from_millis(700));
    for worker in &mut workers[2..4] {
        worker.kill().unwrap();
    }
    for worker in &mut workers {
        worker.wait().unwrap();
    }
    for shard in [2, 3] {
        start(shard).wait().unwrap();
    }
    for number in (0..64).filter(|number| ![3, 5].contains(number)) {
        let path = folder.join(format!("results/{number}.json"));
        let found: Value =
            serde_json::from_slice(&std::fs::read(&path).unwrap_or_else(|error| panic!("{number}: {error}"))).unwrap();
        assert!(found["world"].is_array());
    }
    let stray = std::fs::read_dir(folder.join("results")).unwrap().filter(|entry| {
        let name = entry.as_ref().unwrap().file_name().to_string_lossy().into_owned();
        !name.starts_with('.') && !name.ends_with(".json")
    });
    assert_eq!(stray.count(), 0);
}

#[test]
fn the_recipe_for_parallel_works() {
    if Command::new("parallel").arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status().is_err() {
        println!("no GNU parallel here: its recipe was not run");
        return;
    }
    let folder = folder_of("parallel", 10);
    let guide = std::fs::read_to_string(root().join("docs/batch.md")).unwrap();
    let recipe = guide.split_once("```sh parallel\n").unwrap().1.split_once("```").unwrap().0;
    let path = Path::new(env!("CARGO_BIN_EXE_gravisight")).parent().unwrap();
    let path = format!("{}:{}", path.display(), std::env::var("PATH").unwrap());
    std::fs::rename(folder.join("list.txt"), folder.join("videos.txt")).unwrap();
    let output = Command::new("sh").args(["-c", recipe]).current_dir(&folder).env("PATH", path).output().unwrap();
    let done = lines(&output);
    assert_eq!(done.len(), 10, "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(done.iter().filter(|line| line["status"] == "done").count(), 8);
}

#[test]
fn what_is_no_batch_is_refused() {
    let folder = folder_of("refused", 2);
    let cases: [(&[&str], &str); 4] = [
        (&["batch", "list.txt", "--out", "r", "--", "train", "{}"], "no subcommand for a batch"),
        (&["batch", "list.txt", "--out", "r", "--", "track", "a.mp4"], "names no input"),
        (&["batch", "none.txt", "--out", "r", "--", "track", "{}"], "none.txt"),
        (&["batch", "list.txt", "--shard", "8/8", "--out", "r", "--", "track", "{}"], "0/8"),
    ];
    for (arguments, words) in cases {
        let output = gravisight(&folder, arguments).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && said.contains(words), "{arguments:?}: {said}");
    }
}
