//! YOLO's labels: a text for each picture, a line for each box (class, centre, width and height as shares of the picture's sides,
//! and maybe a confidence). Format: docs.ultralytics.com/datasets/detect.

use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::ImportOptions;
use super::ball::Ball;
use super::drawn::{Drawing, Drawn, Shape};
use super::pictures::{files_below, is_picture, read_text};
use gravisight::{Error, Result};

/// Where a set says its classes' names: `names` of the first, lines of the others.
const DATA: &str = "data.yaml";
const CLASSES: [&str; 2] = ["classes.txt", "labels/classes.txt"];
/// Folders of pictures and of their labels, side by side.
const IMAGES: &str = "images";
const LABELS: &str = "labels";

/// `data.yaml`. It holds more; what is not needed is not looked at.
#[derive(Deserialize)]
struct Data {
    names: Option<Names>,
}

/// Names in their order, or by their numbers.
#[derive(Deserialize)]
#[serde(untagged)]
enum Names {
    List(Vec<String>),
    Map(std::collections::BTreeMap<usize, String>),
}

/// The boxes in the pictures below `source`, a folder or its `data.yaml`.
pub(super) fn drawn(source: &Path, options: &ImportOptions) -> Result<Drawn> {
    let root = if source.is_dir() { source } else { source.parent().unwrap_or(Path::new("")) };
    let data = if source.is_dir() { root.join(DATA) } else { source.to_path_buf() };
    let names = names(&data, root)?;
    let folder = options.pictures.as_deref().unwrap_or(root);
    if !folder.is_dir() {
        return Err(Error::Data { what: folder.display().to_string(), reason: "is not a folder of pictures".into() });
    }
    let picture = |file: PathBuf| {
        let within = file.strip_prefix(folder).unwrap_or(&file).to_path_buf();
        let size = match &options.camera {
            Some(camera) => camera.size().xy(),
            None => {
                let size = image::image_dimensions(&file).map_err(Error::format(file.display().to_string()))?;
                [size.0, size.1].map(f64::from)
            }
        };
        let labels = labels_of(&within, folder, root);
        let (what, shapes) = match labels {
            Some(path) => (path.display().to_string(), shapes(&path, &names, size)?),
            None => (file.display().to_string(), vec![]),
        };
        Ok(Drawing { name: without_images(&within), file, what, size: None, shapes })
    };
    let pictures = files_below(folder, &is_picture)?.into_iter().map(picture).collect::<Result<Vec<_>>>()?;
    Ok(Drawn { what: source.display().to_string(), pictures })
}

/// The classes' names; none where the set says none.
fn names(data: &Path, root: &Path) -> Result<Vec<(usize, String)>> {
    let named = match data.is_file() {
        true => {
            let refuse = Error::format(data.display().to_string());
            serde_saphyr::from_str::<Data>(&read_text(data)?).map_err(refuse)?.names
        }
        false => None,
    };
    Ok(match (named, CLASSES.iter().map(|name| root.join(name)).find(|path| path.is_file())) {
        (Some(Names::List(names)), _) => names.into_iter().enumerate().collect(),
        (Some(Names::Map(names)), _) => names.into_iter().collect(),
        (None, Some(path)) => read_text(&path)?.lines().map(|line| line.trim().into()).enumerate().collect(),
        (None, None) => vec![],
    })
}

/// A picture's path without folders that only tell pictures from labels.
fn without_images(picture: &Path) -> PathBuf {
    picture.iter().filter(|part| *part != IMAGES).collect()
}

/// The labels of a picture, which is `within` in `folder`: in `labels` beside its `images`, beside it, or in the set's folder.
fn labels_of(within: &Path, folder: &Path, root: &Path) -> Option<PathBuf> {
    let file = folder.join(within);
    let parts: Vec<_> = file.iter().collect();
    let parallel = parts.iter().rposition(|part| *part == IMAGES).map(|at| {
        let renamed = parts.iter().enumerate().map(|(index, part)| if index == at { LABELS.as_ref() } else { *part });
        renamed.collect::<PathBuf>()
    });
    let elsewhere = [root.join(within), root.join(LABELS).join(within)];
    let candidates = parallel.into_iter().chain([file]).chain(elsewhere);
    candidates.map(|path| path.with_extension("txt")).find(|path| path.is_file())
}

/// The boxes of a picture of that size, px.
fn shapes(path: &Path, names: &[(usize, String)], [width, height]: [f64; 2]) -> Result<Vec<Shape>> {
    let text = read_text(path)?;
    let lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let shape = |(index, line): (usize, &str)| {
        let refuse = |message: String| Error::Format { what: format!("{}:{}", path.display(), index + 1), message };
        let numbers = line.split_whitespace().map(|word| word.parse::<f64>().ok().filter(|number| number.is_finite()));
        let numbers: Option<Vec<f64>> = numbers.collect();
        let (class, x, y, w, h) = match numbers.as_deref() {
            Some(&[class, x, y, w, h] | &[class, x, y, w, h, _]) if class >= 0.0 && class.fract() == 0.0 => {
                (class, x, y, w, h)
            }
            _ => {
                let message = format!(
                    "must be a box (class, cx, cy, width, height and optionally a confidence), not `{}`",
                    line.trim()
                );
                return Err(refuse(message));
            }
        };
        let class = class as usize;
        let name = names.iter().find(|(number, _)| *number == class).map(|(_, name)| name.clone());
        let ball = Some(Ball::in_box([x * width, y * height], [w * width, h * height]));
        Ok(Shape { label: name.unwrap_or_else(|| class.to_string()), kind: "box".into(), ball })
    };
    lines.map(shape).collect()
}
