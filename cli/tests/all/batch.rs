//! `gravisight batch` as a user meets it: many inputs, some of which cannot be, workers that die.

use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use crate::common::{root, scratch};
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

/// What a line of a batch's output names as the result.
fn result_of(folder: &Path, line: &Value) -> Value {
    let path = folder.join(line["result"].as_str().unwrap());
    serde_json::from_slice(&std::fs::read(&path).unwrap_or_else(|error| panic!("{line}: {error}"))).unwrap()
}

const LOCALISE: [&str; 7] = ["--", "localise", "{}", "--camera", "camera.json", "--ball-radius", "0.2"];

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
    assert!(result_of(&folder, &said[7])["world"].is_array());
    // Mended, it is done.
    for number in [3, 5] {
        std::fs::copy(folder.join("1.png"), folder.join(format!("{number}.png"))).unwrap();
    }
    assert_eq!(batch("0/1").status.code(), Some(0));
    assert!(lines(&batch("0/1")).iter().all(|line| line["status"] == "was there"));
}

#[test]
fn a_result_is_its_inputs_wherever_that_stands_in_the_list() {
    let folder = folder_of("names", 1);
    let samples = root().join("web/public/samples");
    let list: Vec<Value> = serde_json::from_slice(&std::fs::read(samples.join("samples.json")).unwrap()).unwrap();
    for (index, place) in ["a", "b", "c"].iter().enumerate() {
        std::fs::create_dir(folder.join(place)).unwrap();
        let sample = samples.join(list[index]["file"].as_str().unwrap());
        std::fs::copy(sample, folder.join(place).join("ball.png")).unwrap();
    }
    let batch = |list: &str| {
        std::fs::write(folder.join("list.txt"), list).unwrap();
        let arguments = [&["batch", "list.txt", "--out", "results"][..], &LOCALISE].concat();
        let output = gravisight(&folder, &arguments).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        lines(&output)
    };
    let alone = |place: &str| -> Value {
        let picture = format!("{place}/ball.png");
        let localise = ["localise", &picture, "--camera", "camera.json", "--ball-radius", "0.2", "--json"];
        let output = gravisight(&folder, &localise).output().unwrap();
        serde_json::from_slice(&output.stdout).unwrap()
    };
    assert!(batch("a/ball.png\nb/ball.png\n").iter().all(|line| line["status"] == "done"));
    let said = batch("c/ball.png\na/ball.png\nb/ball.png\n");
    let status: Vec<&str> = said.iter().map(|line| line["status"].as_str().unwrap()).collect();
    assert_eq!(status, ["done", "was there", "was there"]);
    for (line, place) in said.iter().zip(["c", "a", "b"]) {
        assert_eq!(result_of(&folder, line)["world"], alone(place)["world"], "{place}");
    }
}

#[test]
fn what_has_changed_is_done_again_and_another_commands_folder_is_refused() {
    let folder = folder_of("changed", 3);
    let batch = |more: &[&str]| {
        let arguments = [&["batch", "list.txt", "--out", "results"][..], &LOCALISE, more].concat();
        gravisight(&folder, &arguments).output().unwrap()
    };
    let status = |output: &Output| -> Vec<String> {
        lines(output).iter().map(|line| line["status"].as_str().unwrap().into()).collect()
    };
    let first = batch(&[]);
    assert_eq!(status(&first), ["done"; 3]);
    // Another picture of the same name.
    std::fs::copy(folder.join("0.png"), folder.join("kept.png")).unwrap();
    image::open(folder.join("1.png")).unwrap().fliph().save(folder.join("1.png")).unwrap();
    let second = batch(&[]);
    assert_eq!(status(&second), ["was there", "done", "was there"]);
    // One that has become none: its old result does not stay.
    std::fs::write(folder.join("1.png"), b"no picture").unwrap();
    let third = batch(&[]);
    assert_eq!(status(&third), ["was there", "failed", "was there"]);
    assert!(!folder.join(lines(&third)[1]["result"].as_str().unwrap()).exists());
    std::fs::copy(folder.join("kept.png"), folder.join("1.png")).unwrap();
    // Another camera.
    let camera = std::fs::read_to_string(folder.join("camera.json")).unwrap();
    std::fs::write(folder.join("camera.json"), format!("{camera}\n")).unwrap();
    assert_eq!(status(&batch(&[])), ["done"; 3]);
    // Another command, and a folder that no batch made.
    let refused = |output: &Output, words: &str| {
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(1) && said.contains(words) && output.stdout.is_empty(), "{said}");
    };
    refused(&batch(&["--device", "cpu"]), "another command, `localise {} --camera camera.json --ball-radius 0.2`");
    let into = |out: &str| {
        let arguments = [&["batch", "list.txt", "--out", out][..], &LOCALISE].concat();
        gravisight(&folder, &arguments).output().unwrap()
    };
    refused(&into("."), "which was not written by a batch");
    assert_eq!(status(&batch(&[])), ["was there"; 3]);
}

#[test]
fn eight_workers_of_which_two_are_killed_do_all_once_started_again() {
    let folder = folder_of("workers", 64);
    let start = |shard: usize| {
        let shard = format!("{shard}/8");
        let arguments = [&["batch", "list.txt", "--shard", &shard, "--out", "results"][..], &LOCALISE].concat();
        let mut command = gravisight(&folder, &arguments);
        command.env("RAYON_NUM_THREADS", "1").stdout(Stdio::piped()).spawn().unwrap()
    };
    let mut workers: Vec<_> = (0..8).map(start).collect();
    // Killed as soon as they have done one of their eight.
    let mut before = vec![];
    for worker in &mut workers[2..4] {
        let mut line = String::new();
        BufReader::new(worker.stdout.take().unwrap()).read_line(&mut line).unwrap();
        worker.kill().unwrap();
        before.push(serde_json::from_str::<Value>(&line).unwrap());
    }
    for (shard, worker) in workers.into_iter().enumerate() {
        let killed = (2..4).contains(&shard);
        let output = worker.wait_with_output().unwrap();
        // A process that a signal ended has no code; 3: two pictures are none.
        assert_eq!(output.status.code(), if killed { None } else { Some(if shard == 5 { 3 } else { 0 }) }, "{shard}");
        assert_eq!(lines(&output).len(), if killed { 0 } else { 8 });
    }
    for (shard, before) in [2, 3].into_iter().zip(before) {
        let output = start(shard).wait_with_output().unwrap();
        let said = lines(&output);
        assert!(said.len() == 8 && said[0]["result"] == before["result"], "{}", said[0]);
        assert_eq!(said[0]["status"], if shard == 3 { "failed" } else { "was there" });
        let done = said.iter().filter(|line| line["status"] == "done").count();
        assert!(done >= 5, "a killed worker left only {done} of eight to do");
    }
    let all =
        gravisight(&folder, &[&["batch", "list.txt", "--out", "results"][..], &LOCALISE].concat()).output().unwrap();
    for (number, line) in lines(&all).iter().enumerate().filter(|(number, _)| ![3, 5].contains(number)) {
        assert_eq!(line["status"], "was there", "{number}");
        assert!(result_of(&folder, line)["world"].is_array());
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
    let guide = std::fs::read_to_string(root().join("docs/many-videos.md")).unwrap();
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
    let cases: [(&[&str], &str); 5] = [
        (&["batch", "list.txt", "--out", "r", "--", "train", "{}"], "cannot be run as a batch"),
        (&["batch", "list.txt", "--out", "r", "--", "localise", "{}", "--kamera", "c.json"], "--kamera"),
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
