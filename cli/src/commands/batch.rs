//! `gravisight batch`.

use std::ffi::{OsStr, OsString};
use std::io::{self, Write as _};
use std::iter;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};
use clap::{ArgMatches, Args, CommandFactory as _};
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};

use super::fit::PARTLY;
use super::print_line;
use crate::{cameras, model};
use gravisight::internal::{ANY, SD_L, SOLVER_VERSION, read_text, sha256_hex, write_whole};

/// Subcommands that a batch runs: those whose result is one JSON object an input.
const KNOWN: [&str; 5] = ["track", "label", "localise", "evaluate", "fit"];
/// What stands for an input, and for where its other files go (without an ending).
const INPUT: &str = "{}";
const STEM: &str = "{out}";
/// Options whose files a subcommand writes; all others that name a file or a folder read it.
const WRITTEN: [&str; 5] = ["cameras", "out", "overlay", "report", "plot"];
/// File of the results' folder that says which subcommand made it.
const MANIFEST: &str = "batch.json";
/// Hexadecimal digits of the hash of an input's path in the name of its results: one collision in 4 million lists of a thousand.
const NAME_DIGITS: usize = 12;

/// Run a subcommand for each line of a list: many videos, on as many machines as there are.
///
/// Finished inputs are skipped, so to resume a batch that was stopped or killed, start it again. An input that fails does not stop the
/// others; the next start retries it. A result is reused only by the same version of gravisight, and only while the files that the
/// subcommand reads are unchanged. Exit status: 0 if the whole shard is done, 3 if some inputs failed.
#[derive(Args)]
#[command(after_help = "\
For each input, OUT gets NAME.json: what the subcommand prints with --json, written once it is complete. NAME is the input's name and a \
hash of its path. A line of JSON is printed for each input; `result` is the path of NAME.json. Use one OUT per subcommand and set of options.\n\
{} stands for the input; {out} stands for OUT/NAME, to name the subcommand's other files:\n\n  \
gravisight batch videos.txt --out results -- track {} --camera camera.json --scene tennis --report {out}.html\n  \
seq 0 7 | parallel gravisight batch videos.txt --shard {}/8 --out results -- track '{}' --camera …\n\n\
docs/many-videos.md has recipes for GNU parallel, Slurm and Kubernetes.")]
pub struct Arguments {
    /// The inputs, one per line; empty lines and lines that begin with # are ignored. Paths are relative to the list's folder.
    #[arg(value_name = "LIST")]
    list: PathBuf,
    /// Process only every Nth input, starting at the Ith (counted from 0).
    #[arg(long, value_name = "I/N", default_value = "0/1", value_parser = shard)]
    shard: Shard,
    /// Folder of the results.
    #[arg(long, value_name = "OUT")]
    out: PathBuf,
    /// The subcommand and its options.
    #[arg(last = true, required = true, value_name = "SUBCOMMAND")]
    command: Vec<OsString>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Shard {
    index: usize,
    count: usize,
}

fn shard(text: &str) -> Result<Shard, String> {
    let parts = text.split_once('/').and_then(|(index, count)| Some((index.parse().ok()?, count.parse().ok()?)));
    match parts {
        Some((index, count)) if index < count => Ok(Shard { index, count }),
        _ => Err(format!("`{text}` is not I/N with I from 0 to N - 1, such as 0/8")),
    }
}

/// An input and the name of its results, which depends on its path alone.
struct Item {
    input: PathBuf,
    name: String,
}

pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    let name = arguments.command.first().and_then(|name| name.to_str()).unwrap_or_default();
    ensure!(KNOWN.contains(&name), "`{name}` cannot be run as a batch; choose one of {}", KNOWN.join(", "));
    ensure!(
        arguments.command.iter().any(|argument| argument.to_string_lossy().contains(INPUT)),
        "the subcommand names no input: write {INPUT} in place of the input"
    );
    let items = items(&arguments.list)?;
    if let Some(Item { input, name }) = items.first() {
        // Wrong usage is wrong for every input.
        if let Err(error) = parsed(&arguments.command, input, &arguments.out.join(name)) {
            error.exit();
        }
    }
    claim(&arguments.out, &arguments.command)?;
    let Shard { index, count } = arguments.shard;
    let mut failed = 0;
    for item in items.iter().skip(index).step_by(count) {
        let line = done(arguments, item)?;
        failed += usize::from(line["status"] == "failed");
        print_line(line)?;
    }
    Ok(if failed > 0 { ExitCode::from(PARTLY) } else { ExitCode::SUCCESS })
}

fn items(list: &Path) -> Result<Vec<Item>> {
    let text = read_text(list)?;
    let folder = list.parent().unwrap_or(Path::new(""));
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
    let items = lines.map(|line| {
        let input = folder.join(line);
        let stem = input.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let whole = std::path::absolute(&input).with_context(|| input.display().to_string())?;
        let hash = sha256_hex(whole.as_os_str().as_encoded_bytes());
        Ok(Item { name: format!("{stem}-{}", &hash[..NAME_DIGITS]), input })
    });
    let items = items.collect::<Result<Vec<Item>>>()?;
    ensure!(!items.is_empty(), "{}: lists no inputs", list.display());
    Ok(items)
}

/// Takes the folder `out` for the results of `command`: a new one, an empty one, or one in which such results are.
fn claim(out: &Path, command: &[OsString]) -> Result<()> {
    let words: Vec<String> = command.iter().map(|word| word.to_string_lossy().into_owned()).collect();
    std::fs::create_dir_all(out).with_context(|| out.display().to_string())?;
    let manifest = out.join(MANIFEST);
    let entries = std::fs::read_dir(out).with_context(|| out.display().to_string())?;
    let names = entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned());
    let foreign = names.filter(|name| !name.starts_with('.')).min();
    // Another shard may have come first just now.
    if !manifest.exists() {
        if let Some(name) = foreign {
            bail!("{}: holds `{name}`, which was not written by a batch; give another --out", out.display());
        }
        write_whole(&manifest, format!("{:#}\n", json!({"command": words})).as_bytes())?;
    }
    let found: Value = serde_json::from_str(&read_text(&manifest)?)
        .with_context(|| format!("{}: was not written by a batch; give another --out", manifest.display()))?;
    if found["command"] != json!(words) {
        let theirs: Vec<&str> = found["command"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
        bail!("{}: holds the results of another command, `{}`; give another --out", out.display(), theirs.join(" "));
    }
    Ok(())
}

/// What a result depends on, as a hash: the versions of this program and of its solver, its built-in models, the subcommand, and what is in
/// every file and folder that the subcommand reads for the input.
fn key(command: &[OsString], input: &Path, stem: &Path) -> Result<String> {
    let mut hash = Sha256::new();
    let solver = SOLVER_VERSION.to_string();
    // A card holds the hash of its weights.
    let parts = [env!("CARGO_PKG_VERSION"), solver.as_str(), ANY.0, SD_L.0].map(str::as_bytes).into_iter();
    for part in parts.chain(command.iter().map(|word| word.as_encoded_bytes())) {
        hash.update(part.len().to_le_bytes());
        hash.update(part);
    }
    for path in read_by(command, input, stem)? {
        add(&mut hash, &path).with_context(|| path.display().to_string())?;
    }
    Ok(format!("{:x}", hash.finalize()))
}

/// The files and folders that the subcommand reads for an input, as its own parser takes the words apart.
fn read_by(command: &[OsString], input: &Path, stem: &Path) -> Result<Vec<PathBuf>> {
    let matches = parsed(command, input, stem)?;
    let (name, matches) = matches.subcommand().context("names no subcommand")?;
    let all = super::Arguments::command();
    let known = all.find_subcommand(name).context("is an unknown subcommand")?;
    let mut paths = Vec::new();
    for argument in known.get_arguments().map(|argument| argument.get_id().as_str()) {
        if WRITTEN.contains(&argument) {
            continue;
        }
        for value in matches.get_raw(argument).into_iter().flatten().map(Path::new) {
            match argument {
                "model" => paths.extend(model::files(value)),
                "camera" => paths.extend(cameras::files(value)),
                _ => paths.push(value.to_path_buf()),
            }
        }
    }
    // A sport's name, a number, an input that is not there: the subcommand says what is wrong with it.
    paths.retain(|path| path.exists());
    Ok(paths)
}

/// The subcommand as it runs for an input, taken apart.
fn parsed(command: &[OsString], input: &Path, stem: &Path) -> Result<ArgMatches, clap::Error> {
    let words = command.iter().map(|word| filled(word, input, stem));
    super::Arguments::command().try_get_matches_from(iter::once("gravisight".into()).chain(words))
}

/// Adds what is in a file or, name by name, in a folder.
fn add(hash: &mut Sha256, path: &Path) -> io::Result<()> {
    if !path.is_dir() {
        return add_file(hash, path);
    }
    let mut entries: Vec<PathBuf> =
        std::fs::read_dir(path)?.map(|entry| Ok(entry?.path())).collect::<io::Result<_>>()?;
    entries.sort();
    for entry in entries {
        hash.update(entry.file_name().unwrap_or_default().as_encoded_bytes());
        hash.update([0]);
        add(hash, &entry)?;
    }
    Ok(())
}

fn add_file(hash: &mut Sha256, path: &Path) -> io::Result<()> {
    let mut file = std::fs::File::open(path)?;
    let bytes = io::copy(&mut file, hash)?;
    hash.write_all(&bytes.to_le_bytes())
}

/// Does what an input needs; what came of it.
fn done(arguments: &Arguments, Item { input, name }: &Item) -> Result<Value> {
    let stem = arguments.out.join(name);
    let [result, made_of] = [format!("{name}.json"), format!(".{name}.key")].map(|name| arguments.out.join(name));
    let about = |status: &str| json!({"input": input, "status": status, "result": result});
    let key = key(&arguments.command, input, &stem).with_context(|| input.display().to_string())?;
    if result.exists() && std::fs::read_to_string(&made_of).is_ok_and(|of| of == key) {
        return Ok(about("was there"));
    }
    // Of another input, or of one that has changed: it must not stay for a result of this one.
    if result.exists() {
        std::fs::remove_file(&result).with_context(|| result.display().to_string())?;
    }
    let mut command = Command::new(std::env::current_exe().context("cannot find gravisight's own path")?);
    command.args(arguments.command.iter().map(|word| filled(word, input, &stem)));
    command.arg("--json").stdin(Stdio::null());
    let started = Instant::now();
    let output = command.output().context("cannot start gravisight again for an input")?;
    let seconds = (started.elapsed().as_secs_f64() * 100.0).round() / 100.0;
    let said = String::from_utf8_lossy(&output.stderr);
    let exit = output.status.code();
    let mut line = about("done");
    (line["seconds"], line["exit"]) = (json!(seconds), json!(exit));
    let whole = matches!(exit, Some(0)) || exit == Some(i32::from(PARTLY));
    match serde_json::from_slice::<Value>(&output.stdout) {
        Ok(found) if whole => {
            write_whole(&made_of, key.as_bytes())?;
            write_whole(&result, &output.stdout)?;
            if let Some(verdict) = found.get("verdict") {
                line["verdict"] = verdict.clone();
            }
        }
        _ => {
            line["status"] = json!("failed");
            // What a program says last is what ended it.
            line["error"] =
                json!(said.lines().rfind(|line| !line.trim().is_empty()).unwrap_or("it printed no error message"));
        }
    }
    Ok(line)
}

/// A word of the subcommand, for an input.
fn filled(word: &OsStr, input: &Path, stem: &Path) -> OsString {
    match word.to_str() {
        Some(text) => text.replace(STEM, &stem.to_string_lossy()).replace(INPUT, &input.to_string_lossy()).into(),
        None => word.to_os_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A fresh folder.
    fn scratch(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("gravisight-batch-{name}-{}", std::process::id()));
        std::fs::remove_dir_all(&folder).unwrap_or_default();
        std::fs::create_dir_all(&folder).unwrap();
        folder
    }

    /// The key of a subcommand for an input in a folder of results.
    fn key_of(words: &[&str], input: &Path) -> String {
        let words: Vec<OsString> = words.iter().map(OsString::from).collect();
        key(&words, input, &input.with_extension("results")).unwrap()
    }

    fn text(path: &Path) -> &str {
        path.to_str().unwrap()
    }

    #[test]
    fn a_folder_is_hashed_name_by_name() {
        let folder = scratch("folder");
        let of = |files: &[(&str, &str)]| {
            std::fs::remove_dir_all(&folder).unwrap_or_default();
            std::fs::create_dir_all(folder.join("in")).unwrap();
            files.iter().for_each(|(name, text)| std::fs::write(folder.join(name), text).unwrap());
            key_of(&["label", "{}", "--out", "{out}"], &folder)
        };
        let one = of(&[("a", "x"), ("in/b", "y")]);
        assert_eq!(one, of(&[("in/b", "y"), ("a", "x")]));
        for other in
            [of(&[("a", "x"), ("in/b", "z")]), of(&[("a", "x"), ("in/c", "y")]), of(&[("a", "xy"), ("in/b", "")])]
        {
            assert_ne!(one, other);
        }
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn what_a_subcommand_reads_is_hashed() {
        let folder = scratch("read");
        let file = |name: &str| folder.join(name);
        // A camera of COLMAP as a folder and by its file, files beside the input, and clips.
        let [camera, images] = ["cameras.txt", "images.txt"].map(file);
        let joined = format!("--camera={}", text(&folder));
        let track = ["track", "{}", &joined, "--scene", "tennis", "--seed-label", "1,2,3"];
        let by_file = ["localise", "{}", "--camera", text(&camera)];
        let beside = ["fit", "--track", "{}", "--camera", "{}.json", "--scene", "tennis", "--out", "{}.csv"];
        let clips = ["evaluate", "--data", text(&folder), "--only", "{}", "--report", "{out}.html"];
        let input = file("input");
        let keys = || [&track[..], &by_file, &beside, &clips].map(|words| key_of(words, &input));
        let changed = |name: &str| {
            std::fs::write(file(name), "before").unwrap();
            let before = keys();
            std::fs::write(file(name), "after").unwrap();
            let after = keys();
            [0, 1, 2, 3].map(|at| before[at] != after[at])
        };
        std::fs::write(&camera, "1 PINHOLE 4 3 2 2 2 1.5").unwrap();
        std::fs::write(&images, "").unwrap();
        assert_eq!(changed("input"), [true, true, true, true]);
        assert_eq!(changed("images.txt"), [true, true, false, true]);
        assert_eq!(changed("input.json"), [true, false, true, true]);
        assert_eq!(changed("input.csv"), [true, false, false, true]);
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn a_folder_that_is_written_is_not_hashed() {
        let [folder, out] = [scratch("sigma"), scratch("written")];
        let [input, sigma] = ["track.csv", "sigma.json"].map(|name| folder.join(name));
        let words = ["fit", "--track", "{}", "--camera", "c.json", "--scene", "floor", "--camera-sigma", text(&sigma)];
        let written = [&words[..], &["--out", text(&out), "--plot", text(&out)]].concat();
        let before = key_of(&written, &input);
        std::fs::write(out.join("trajectory.csv"), "result").unwrap();
        assert_eq!(before, key_of(&written, &input));
        std::fs::write(&sigma, "{}").unwrap();
        assert_ne!(before, key_of(&written, &input));
        [folder, out].iter().for_each(|folder| std::fs::remove_dir_all(folder).unwrap());
    }

    #[test]
    fn a_model_is_hashed_by_its_card_and_its_weights_however_it_is_named() {
        let folder = scratch("model");
        let named = folder.join("own");
        let write = |note: &str, weights: &str| {
            let card = format!(r#"{{"weights": "trained.safetensors", "note": "{note}"}}"#);
            std::fs::write(named.with_extension("json"), card).unwrap();
            std::fs::write(folder.join("trained.safetensors"), weights).unwrap();
            let [json, tensors] = ["json", "safetensors"].map(|extension| named.with_extension(extension));
            let joined = format!("--model={}", named.display());
            let [named, json, tensors] = [&named, &json, &tensors].map(|path| vec!["--model", text(path)]);
            [named, json, tensors, vec![joined.as_str()]].map(|option| {
                let words = [&["localise", "{}", "--camera", "absent.json"][..], &option].concat();
                key_of(&words, Path::new("absent.png"))
            })
        };
        let [first, retrained, renamed, again] = [write("a", "x"), write("a", "y"), write("b", "x"), write("a", "x")];
        std::fs::remove_dir_all(&folder).unwrap();
        assert_eq!(first, again);
        for at in 0..4 {
            assert!(first[at] != retrained[at] && first[at] != renamed[at], "name {at}");
        }
    }

    #[test]
    fn what_writes_files_is_no_more_than_the_options_that_say_so() {
        let all = super::super::Arguments::command();
        for name in KNOWN {
            let known = all.find_subcommand(name).unwrap();
            for argument in known.get_arguments() {
                let help = argument.get_help().map(ToString::to_string).unwrap_or_default();
                let writes = help.starts_with("Write ") && argument.get_action().takes_values();
                let is_folder_to_make = name == "label" && argument.get_id() == "out";
                let id = argument.get_id().as_str();
                assert_eq!(WRITTEN.contains(&id), writes || is_folder_to_make, "{name} --{id}: {help}");
            }
        }
    }

    #[test]
    fn shards_and_names() {
        assert_eq!(shard("3/8"), Ok(Shard { index: 3, count: 8 }));
        for wrong in ["8/8", "0/0", "a/b", "1", "-1/2"] {
            assert!(shard(wrong).unwrap_err().contains("0/8"), "{wrong}");
        }
        let filled = filled("--out={out}.csv:{}".as_ref(), Path::new("a/b.mp4"), Path::new("r/b"));
        assert_eq!(filled, "--out=r/b.csv:a/b.mp4");
    }
}
