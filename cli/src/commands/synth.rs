//! `gravisight synth`.

use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use anyhow::{Context, Result, bail, ensure};
use clap::{Args, ValueEnum};
use image::{ImageFormat, RgbImage};
use nalgebra::Point3;
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use serde_json::{Value, json};

use super::{film, print_line};
use crate::progress::Progress;
use gravisight::internal::{Claim, NewFolder, write_whole};
use gravisight::internal::{Set, Shot, Split, Studio};
use gravisight::{Clip, Clips};

/// What made a folder, so that it is gone on with in the same way.
const SETTINGS: &str = "synth.json";
/// A clip's line, in its own folder from when it is whole.
const LINE: &str = "clip.json";

/// Make the paper's synthetic data sets, or footage of sports.
#[derive(Args)]
pub struct Arguments {
    /// Which set: sd-s is a part of sd-m, and sd-m of sd-l.
    #[arg(long, value_enum)]
    set: SetName,
    /// Which part of it.
    #[arg(long, value_enum)]
    split: SplitName,
    /// Folder to make; one that was interrupted is gone on with.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// What simulates and draws.
    #[arg(long, value_enum, default_value = "builtin")]
    engine: Engine,
    /// Clips for each camera of each environment.
    #[arg(long, value_name = "N", default_value_t = 100)]
    clips: usize,
    /// Another seed gives other clips.
    #[arg(long, value_name = "S", default_value_t = 20_231_130)]
    seed: u64,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum SetName {
    SdS,
    SdM,
    SdL,
    Spring,
    /// Sports as people film them, as videos (needs ffmpeg): --clips of each of four kinds.
    Broadcast,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum SplitName {
    Train,
    Val,
    Test,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Engine {
    /// The forecaster and a ray-caster.
    Builtin,
    /// The paper's, MuJoCo, in a build by scripts/mujoco.
    Mujoco,
}

impl Engine {
    /// As in a folder's settings.
    fn name(self) -> &'static str {
        match self {
            Self::Builtin => "builtin",
            Self::Mujoco => "mujoco",
        }
    }

    /// Ready for a studio's shot, on this thread.
    fn open(self, studio: &Studio) -> Result<Box<dyn gravisight::internal::Engine + '_>> {
        match self {
            Self::Builtin => Ok(Box::new(studio.builtin())),
            #[cfg(all(feature = "mujoco", libmujoco))]
            Self::Mujoco => Ok(Box::new(studio.mujoco()?)),
            #[cfg(not(all(feature = "mujoco", libmujoco)))]
            Self::Mujoco => bail!(
                "this build has no MuJoCo; run scripts/mujoco, which fetches it and builds the command with it, \
                 or use --engine builtin"
            ),
        }
    }
}

pub fn run(arguments: Arguments) -> Result<()> {
    ensure!(arguments.clips > 0, "--clips must be at least 1");
    let split = match arguments.split {
        SplitName::Train => Split::Train,
        SplitName::Val => Split::Val,
        SplitName::Test => Split::Test,
    };
    let set = match arguments.set {
        SetName::SdS => Set::SdS,
        SetName::SdM => Set::SdM,
        SetName::SdL => Set::SdL,
        SetName::Spring => Set::Spring,
        SetName::Broadcast => return film::run(&arguments.out, split, arguments.clips, arguments.seed, arguments.json),
    };
    let out = &arguments.out;
    let shots = set.shots(split);
    // An engine that cannot work says so before there is a folder.
    arguments.engine.open(&Studio::new(shots[0])?)?;
    let _claim =
        claim(out, &json!({"engine": arguments.engine.name(), "split": split.name(), "seed": arguments.seed}))?;
    let all = (shots.len() * arguments.clips) as u64;
    let progress = Mutex::new((Progress::new(), 0_u64));
    let began = std::time::Instant::now();
    let mut clips = Vec::new();
    let mut drawn = 0;
    for shot in shots {
        let made = shoot(&arguments, shot, split, |clip| {
            if let Ok(mut progress) = progress.lock() {
                progress.1 += 1;
                let done = progress.1;
                progress.0.set(done, all, &clip.id);
            }
        })?;
        drawn += made.iter().map(|(_, new)| new).sum::<usize>();
        clips.extend(made.into_iter().map(|(clip, _)| clip));
    }
    let frames: usize = clips.iter().map(|clip| clip.frames.len()).sum();
    let count = clips.len();
    Clips { folder: out.clone(), clips }.write_index()?;
    if let Ok((progress, _)) = progress.into_inner() {
        progress.finish();
    }
    let seconds = began.elapsed().as_secs_f64();
    match arguments.json {
        true => print_line(json!({"clips": count, "frames": frames, "frames_drawn": drawn, "seconds": seconds}))?,
        false => print_line(format_args!(
            "{count} clips, {frames} frames in {} ({drawn} drawn now, {:.0} a second)",
            out.display(),
            drawn as f64 / seconds
        ))?,
    }
    Ok(())
}

/// Makes a shot's clips; with each, how many pictures were drawn. `done` is told of each.
fn shoot(arguments: &Arguments, shot: Shot, split: Split, done: impl Fn(&Clip) + Sync) -> Result<Vec<(Clip, usize)>> {
    let studio = Studio::new(shot)?;
    let clips = (0..arguments.clips).into_par_iter().map_init(
        || None,
        |opened, number| {
            let engine = match opened {
                Some(engine) => engine,
                None => opened.insert(arguments.engine.open(&studio)?),
            };
            let clip = studio.clip(engine.as_mut(), arguments.seed, split, number)?;
            let new = make(&arguments.out, engine.as_mut(), &clip, &shot.folder(split, number))?;
            done(&clip);
            Ok((clip, new))
        },
    );
    clips.collect()
}

/// Makes the folder, or checks that it was begun in the same way.
fn claim(out: &Path, settings: &Value) -> Result<Claim> {
    let file = out.join(SETTINGS);
    match std::fs::read_to_string(&file) {
        Ok(text) => {
            let before: Value = serde_json::from_str(&text).with_context(|| file.display().to_string())?;
            ensure!(
                before == *settings,
                "{}: was made with {before}, not {settings}; choose another --out",
                out.display()
            );
        }
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            if std::fs::read_dir(out).is_ok_and(|mut entries| entries.next().is_some()) {
                bail!("{}: is there already and was not made by synth; choose another --out", out.display());
            }
            std::fs::create_dir_all(out.join("frames")).with_context(|| out.display().to_string())?;
            write_whole(&file, settings.to_string().as_bytes())?;
        }
        Err(error) => return Err(error).with_context(|| file.display().to_string()),
    }
    Ok(Claim::of(out)?)
}

/// Draws a clip, unless it is there; how many pictures were drawn.
fn make(out: &Path, engine: &mut dyn gravisight::internal::Engine, clip: &Clip, folder: &str) -> Result<usize> {
    let place = out.join(folder);
    if place.join(LINE).is_file() {
        return Ok(0);
    }
    let new = NewFolder::at(&place)?;
    for frame in &clip.frames {
        let name = frame.file.file_name().context("a frame without a name")?;
        let picture = engine.picture(&Point3::from(frame.world.context("a frame without a position")?))?;
        let file = new.path().join(name);
        // The folder appears as a whole; no picture needs to by itself.
        std::fs::write(&file, png(&picture)?).with_context(|| file.display().to_string())?;
    }
    write_whole(&new.path().join(LINE), clip.to_line()?.as_bytes())?;
    new.finish()?;
    Ok(clip.frames.len())
}

fn png(picture: &RgbImage) -> Result<Vec<u8>> {
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, ImageFormat::Png)?;
    Ok(bytes.into_inner())
}
