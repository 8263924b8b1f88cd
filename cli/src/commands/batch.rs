//! `gravisight batch`.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use serde_json::{Value, json};

use super::fit::PARTLY;
use super::print_line;
use gravisight::internal::{read_text, write_whole};

/// Subcommands that a batch runs: those whose result is one JSON object an input.
const KNOWN: [&str; 5] = ["track", "label", "localise", "evaluate", "fit"];
/// What stands for an input, and for where its other files go (without an ending).
const INPUT: &str = "{}";
const STEM: &str = "{out}";

/// Run a subcommand for each line of a list: many videos, on as many machines as there are.
///
/// What is done is not done again, so a batch that was stopped or killed is simply started again; an input that fails does not stop the
/// others and is tried again the next time. Exit status: 0 where all of the shard is done, 3 where some failed.
#[derive(Args)]
#[command(after_help = "\
Of each input OUT gets NAME.json, what the subcommand prints with --json, once it is whole. A line of JSON is printed for each input.\n\
{} stands for the input, {out} for OUT/NAME, for the subcommand's other files:\n\n  \
gravisight batch videos.txt --out results -- track {} --camera camera.json --scene tennis --report {out}.html\n  \
seq 0 7 | parallel gravisight batch videos.txt --shard {}/8 --out results -- track '{}' --camera …\n\n\
docs/batch.md has recipes for GNU parallel, Slurm and Kubernetes.")]
pub struct Arguments {
    /// The inputs, one a line; empty lines and those that begin with # do not count. Paths are from the list's folder.
    #[arg(value_name = "LIST")]
    list: PathBuf,
    /// Only every Nth input, from the Ith on (from 0).
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

/// An input and the name of its results.
struct Item {
    input: PathBuf,
    name: String,
}

pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    let name = arguments.command.first().and_then(|name| name.to_str()).unwrap_or_default();
    ensure!(KNOWN.contains(&name), "`{name}` is no subcommand for a batch; there are {}", KNOWN.join(", "));
    ensure!(
        arguments.command.iter().any(|argument| argument.to_string_lossy().contains(INPUT)),
        "the subcommand names no input: write {INPUT} where it stands"
    );
    let items = items(&arguments.list)?;
    std::fs::create_dir_all(&arguments.out).with_context(|| arguments.out.display().to_string())?;
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
    let inputs: Vec<PathBuf> = lines.map(|line| folder.join(line)).collect();
    if inputs.is_empty() {
        bail!("{}: no input in it", list.display());
    }
    let stem = |input: &Path| input.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    inputs.iter().for_each(|input| *counts.entry(stem(input)).or_default() += 1);
    // Of two of one name the places in the list tell them apart, whatever the shards.
    let item = |(place, input): (usize, PathBuf)| {
        let stem = stem(&input);
        let name = if counts[&stem] > 1 { format!("{stem}-{place}") } else { stem };
        Item { input, name }
    };
    Ok(inputs.into_iter().enumerate().map(item).collect())
}

/// Does what an input needs; what came of it.
fn done(arguments: &Arguments, Item { input, name }: &Item) -> Result<Value> {
    let stem = arguments.out.join(name);
    let result = arguments.out.join(format!("{name}.json"));
    let about = |status: &str| json!({"input": input, "status": status, "result": result});
    if result.exists() {
        return Ok(about("was there"));
    }
    let mut command = Command::new(std::env::current_exe().context("this program's own path")?);
    for argument in &arguments.command {
        match argument.to_str() {
            Some(text) => command.arg(filled(text, input, &stem)),
            None => command.arg(argument),
        };
    }
    command.arg("--json").stdin(Stdio::null());
    let started = Instant::now();
    let output = command.output().context("this program, once more")?;
    let seconds = (started.elapsed().as_secs_f64() * 100.0).round() / 100.0;
    let said = String::from_utf8_lossy(&output.stderr);
    let exit = output.status.code();
    let mut line = about("done");
    (line["seconds"], line["exit"]) = (json!(seconds), json!(exit));
    let whole = matches!(exit, Some(0)) || exit == Some(i32::from(PARTLY));
    match serde_json::from_slice::<Value>(&output.stdout) {
        Ok(found) if whole => {
            write_whole(&result, &output.stdout)?;
            if let Some(verdict) = found.get("verdict") {
                line["verdict"] = verdict.clone();
            }
        }
        _ => {
            line["status"] = json!("failed");
            // What a program says last is what ended it.
            line["error"] = json!(said.lines().rfind(|line| !line.trim().is_empty()).unwrap_or("it said nothing"));
        }
    }
    Ok(line)
}

fn filled(argument: &str, input: &Path, stem: &Path) -> String {
    argument.replace(STEM, &stem.to_string_lossy()).replace(INPUT, &input.to_string_lossy())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_and_names() {
        assert_eq!(shard("3/8"), Ok(Shard { index: 3, count: 8 }));
        for wrong in ["8/8", "0/0", "a/b", "1", "-1/2"] {
            assert!(shard(wrong).unwrap_err().contains("0/8"), "{wrong}");
        }
        let filled = filled("--out={out}.csv:{}", Path::new("a/b.mp4"), Path::new("r/b"));
        assert_eq!(filled, "--out=r/b.csv:a/b.mp4");
    }
}
