//! `gravisight synth`.

use std::io::Cursor;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use anyhow::{Context, Result, bail, ensure};
use clap::{Args, ValueEnum};
use image::{ImageBuffer, ImageFormat, Luma};
use nalgebra::Point3;
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use serde_json::{Value, json};

use super::{courts, film, flights, print_line, sheet};
use crate::choice::{Choice, one_of};
use crate::progress::Progress;
use gravisight::internal::{Claim, NewFolder, write_whole};
use gravisight::internal::{Disturbance, Set, Shot, Split, Studio};
use gravisight::{Clip, Clips, Size};

/// What made a folder, so that it is gone on with in the same way.
const SETTINGS: &str = "synth.json";
/// A clip's line, in its own folder from when it is whole.
const LINE: &str = "clip.json";
/// Clips of each kind of footage.
const FILMS: usize = 100;
/// Pictures of each court.
const COURTS: usize = 20;
/// Clips of each video with flights.
const FLIGHTS: usize = 2;
/// Sides that a picture may have, px.
const SIDES: RangeInclusive<u32> = 16..=4096;

/// Render the paper's synthetic data sets, a room like the one in its real data set, footage of sports, or pictures of courts.
#[derive(Args)]
pub struct Arguments {
    /// Which set: sd-s is a part of sd-m, and sd-m of sd-l.
    #[arg(long, value_parser = one_of(&SETS))]
    set: Made,
    /// Which split of the set.
    #[arg(long, value_parser = one_of(&SPLITS))]
    split: Split,
    /// Folder to create; an interrupted run is resumed.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Simulation and rendering engine.
    #[arg(long, value_enum, default_value = "builtin")]
    engine: EngineChoice,
    /// Clips per camera and environment [default: as in the paper, 100; for rd, 251, 34 and 81 over both cameras].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    clips: Option<u32>,
    /// Size of the pictures, px; the vertical field of view is kept [default: 224x224; for rd, 384x224].
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<Size>,
    /// Standard deviation of noise on the 2D labels, px [default: 0; for rd, 1.5].
    #[arg(long, value_name = "PX", value_parser = parse_noise)]
    label_noise: Option<f64>,
    /// Make test clips with a disturbance that their scenes do not describe (built-in engine).
    #[arg(long, value_name = "WHAT", value_parser = one_of(&DISTURBANCES))]
    disturb: Option<Disturbance>,
    /// Also write depth maps: beside each 000.png a 16-bit 000.depth.png, in mm along the camera's axis; 0 where there is nothing.
    #[arg(long)]
    depth: bool,
    /// With --set flights: folder of videos (*.mp4) without a ball, into which flights are drawn.
    #[arg(long, value_name = "DIR")]
    videos: Option<PathBuf>,
    /// With --set flights: folder of photographs with labels.csv, out of which balls are cut (`scripts/photographs`).
    #[arg(long, value_name = "DIR")]
    balls: Option<PathBuf>,
    /// Also write a picture of the set: a row for each camera and environment, with the world's axes (x red, y green, z blue; 1 or 0.1 m
    /// long), the ball's path, and five frames of a clip.
    #[arg(long, value_name = "FILE.png")]
    sheet: Option<PathBuf>,
    /// Another seed gives other clips.
    #[arg(long, value_name = "S", default_value_t = 20_231_130)]
    seed: u64,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// What `--set` names.
#[derive(Debug, Clone, Copy)]
enum Made {
    Clips(Set),
    Films,
    Footage,
    Flights,
    Courts,
}

const SETS: [Choice<Made>; 9] = [
    ("sd-s", "", Made::Clips(Set::SdS)),
    ("sd-m", "", Made::Clips(Set::SdM)),
    ("sd-l", "", Made::Clips(Set::SdL)),
    ("spring", "", Made::Clips(Set::Spring)),
    (
        "rd",
        "A rendered room that stands in for the paper's real data set: 60 frames a second, 2D labels as if clicked (σ 1.5 px)",
        Made::Clips(Set::Rd),
    ),
    (
        "broadcast",
        "Sports as people film them, as videos (needs ffmpeg); --clips sets how many of each of four kinds",
        Made::Films,
    ),
    (
        "footage",
        "Like broadcast, but as hard as real footage: crowds, screens, cameras that sway and pan, repeated frames, low \
         bitrates; plus as many clips without a ball as of each kind",
        Made::Footage,
    ),
    (
        "flights",
        "Simulated flights of balls cut out of photographs, drawn into real videos (needs ffmpeg, --videos and --balls); --clips sets how many of \
         each video",
        Made::Flights,
    ),
    (
        "courts",
        "Pictures of courts by random cameras, with the exact cameras, and pictures without a court; --clips sets how many of each court",
        Made::Courts,
    ),
];
const SPLITS: [Choice<Split>; 3] = [("train", "", Split::Train), ("val", "", Split::Val), ("test", "", Split::Test)];
const DISTURBANCES: [Choice<Disturbance>; 4] = [
    ("wind", "A wind from the side", Disturbance::Wind),
    ("hand", "A push at a random time", Disturbance::Hand),
    ("ball", "A ball that is a quarter larger than the scene's", Disturbance::Ball),
    ("background", "An empty floor of another colour behind the ball, with the same path", Disturbance::Background),
];

#[derive(Debug, Clone, Copy, ValueEnum)]
enum EngineChoice {
    /// The forecaster and a ray-caster.
    Builtin,
    /// MuJoCo, as in the paper; needs a build by scripts/mujoco.
    Mujoco,
}

impl EngineChoice {
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
    let split = arguments.split;
    let has_material = arguments.videos.is_some() || arguments.balls.is_some();
    ensure!(!has_material || matches!(arguments.set, Made::Flights), "--videos and --balls need --set flights");
    let set = match arguments.set {
        Made::Clips(set) => set,
        made @ (Made::Films | Made::Footage | Made::Flights | Made::Courts) => {
            let plain = arguments.size.is_none()
                && !arguments.depth
                && arguments.sheet.is_none()
                && arguments.disturb.is_none()
                && arguments.label_noise.is_none();
            ensure!(
                plain,
                "--set broadcast, footage, flights and courts cannot be combined with --size, --depth, --sheet, --label-noise or --disturb"
            );
            if let Made::Flights = made {
                let (Some(videos), Some(balls)) = (&arguments.videos, &arguments.balls) else {
                    bail!("--set flights needs --videos DIR and --balls DIR");
                };
                let clips = arguments.clips.map_or(FLIGHTS, |clips| clips as usize);
                return flights::run(&arguments.out, split, clips, arguments.seed, (videos, balls), arguments.json);
            }
            if let Made::Courts = made {
                let count = arguments.clips.map_or(COURTS, |clips| clips as usize);
                return courts::run(&arguments.out, split, count, arguments.seed, arguments.json);
            }
            let clips = arguments.clips.map_or(FILMS, |clips| clips as usize);
            let make = if matches!(made, Made::Films) { film::run } else { film::run_footage };
            return make(&arguments.out, split, clips, arguments.seed, arguments.json);
        }
    };
    let out = &arguments.out;
    let shots = set.shots(split);
    if arguments.disturb.is_some() && !matches!(arguments.engine, EngineChoice::Builtin) {
        bail!("--disturb needs --engine builtin");
    }
    // An engine that cannot work says so before there is a folder.
    arguments.engine.open(&Studio::of_size(shots[0], arguments.size)?)?;
    let mut settings = json!({"engine": arguments.engine.name(), "split": split.name(), "seed": arguments.seed});
    if let Some(size) = arguments.size {
        settings["size"] = json!(size.to_string());
    }
    if arguments.depth {
        settings["depth"] = json!(true);
    }
    if let Some(noise) = arguments.label_noise {
        settings["label_noise"] = json!(noise);
    }
    if let Some(disturbed) = arguments.disturb {
        settings["disturb"] = json!(format!("{disturbed:?}").to_lowercase());
    }
    let _claim = claim(out, &settings)?;
    let counts = shots.iter().map(|shot| match arguments.clips {
        Some(clips) => Ok(clips as usize),
        None => shot.clips(split),
    });
    let counts: Vec<usize> = counts.collect::<gravisight::Result<_>>()?;
    let all = counts.iter().sum::<usize>() as u64;
    let progress = Mutex::new((Progress::new(), 0_u64));
    let began = std::time::Instant::now();
    let (mut clips, mut firsts) = (Vec::new(), Vec::new());
    let mut drawn = 0;
    for (shot, count) in shots.into_iter().zip(counts) {
        let made = shoot(&arguments, shot, split, count, |clip| {
            if let Ok(mut progress) = progress.lock() {
                progress.1 += 1;
                let done = progress.1;
                progress.0.set(done, all, &clip.id);
            }
        })?;
        drawn += made.iter().map(|(_, new)| new).sum::<usize>();
        firsts.push(clips.len());
        clips.extend(made.into_iter().map(|(clip, _)| clip));
    }
    let frames: usize = clips.iter().map(|clip| clip.frames.len()).sum();
    let count = clips.len();
    let all = Clips { folder: out.clone(), clips };
    all.write_index()?;
    if let Some(path) = &arguments.sheet {
        let firsts: Vec<&Clip> = firsts.into_iter().filter_map(|first| all.clips.get(first)).collect();
        sheet::write(path, &all, &firsts)?;
    }
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
fn shoot(
    arguments: &Arguments,
    shot: Shot,
    split: Split,
    count: usize,
    done: impl Fn(&Clip) + Sync,
) -> Result<Vec<(Clip, usize)>> {
    let mut studio = Studio::of_size(shot, arguments.size)?;
    if let Some(noise) = arguments.label_noise {
        studio = studio.with_label_noise(noise);
    }
    if let Some(disturbed) = arguments.disturb {
        studio = studio.disturbed(disturbed)?;
    }
    let clips = (0..count).into_par_iter().map_init(
        || None,
        |opened, number| {
            let engine = match opened {
                Some(engine) => engine,
                None => opened.insert(arguments.engine.open(&studio)?),
            };
            let clip = studio.clip(engine.as_mut(), arguments.seed, split, number)?;
            let new = make(&arguments.out, engine.as_mut(), &clip, &shot.folder(split, number), arguments.depth)?;
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
                bail!("{}: already exists and was not made by synth; choose another --out", out.display());
            }
            std::fs::create_dir_all(out.join("frames")).with_context(|| out.display().to_string())?;
            write_whole(&file, settings.to_string().as_bytes())?;
        }
        Err(error) => return Err(error).with_context(|| file.display().to_string()),
    }
    Ok(Claim::of(out)?)
}

/// Draws a clip, unless it is there; how many pictures were drawn.
fn make(
    out: &Path,
    engine: &mut dyn gravisight::internal::Engine,
    clip: &Clip,
    folder: &str,
    with_depth: bool,
) -> Result<usize> {
    let place = out.join(folder);
    if place.join(LINE).is_file() {
        return Ok(0);
    }
    let new = NewFolder::at(&place)?;
    for frame in &clip.frames {
        let name = frame.file.file_name().context("a frame without a name")?;
        let centre = Point3::from(frame.world.context("a frame without a position")?);
        let file = new.path().join(name);
        // The folder appears as a whole; no picture needs to by itself.
        let write = |file: &Path, bytes| std::fs::write(file, bytes).with_context(|| file.display().to_string());
        write(&file, png(&engine.picture(&centre)?)?)?;
        if with_depth {
            let Size { width, height } = clip.camera.size();
            let depths = engine.depth(&centre)?.iter().map(|metres| millimetres(*metres)).collect();
            let depths = ImageBuffer::<Luma<u16>, _>::from_raw(width, height, depths)
                .context("a depth image of another size")?;
            write(&file.with_extension("depth.png"), png(&depths)?)?;
        }
    }
    write_whole(&new.path().join(LINE), clip.to_line()?.as_bytes())?;
    new.finish()?;
    Ok(clip.frames.len())
}

/// Whole millimetres; 0 where nothing is, or what is too far for them.
fn millimetres(metres: f32) -> u16 {
    let whole = (metres * 1000.0).round();
    if whole <= f32::from(u16::MAX) { whole as u16 } else { 0 }
}

fn png<P: image::PixelWithColorType>(picture: &ImageBuffer<P, Vec<P::Subpixel>>) -> Result<Vec<u8>>
where
    [P::Subpixel]: image::EncodableLayout,
{
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, ImageFormat::Png)?;
    Ok(bytes.into_inner())
}

/// A number of pixels.
fn parse_noise(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|px| (0.0..=100.0).contains(px)).ok_or_else(|| "must be from 0 to 100 px".into())
}

/// `384x224`.
pub(super) fn parse_size(text: &str) -> Result<Size, String> {
    let sides = text.split_once('x').and_then(|(width, height)| Some((width.parse().ok()?, height.parse().ok()?)));
    match sides {
        Some((width, height)) if SIDES.contains(&width) && SIDES.contains(&height) => Ok(Size::new(width, height)),
        _ => Err(format!("must be WIDTHxHEIGHT, as in 384x224, each from {} to {}", SIDES.start(), SIDES.end())),
    }
}
