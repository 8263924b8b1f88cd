//! LabelMe's annotations: JSON, a file for each picture. Pixels count from the picture's corner.

use std::path::Path;

use serde::Deserialize;

use super::ball::Ball;
use super::drawn::{Drawing, Drawn, Shape};
use super::pictures::{files_below, has_extension, read_text};
use gravisight::{Error, Result};

/// A file. It holds more; what is not needed is not looked at. Other JSON has no shapes.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct File {
    shapes: Option<Vec<Outline>>,
    image_path: Option<String>,
    image_width: Option<f64>,
    image_height: Option<f64>,
}

#[derive(Deserialize)]
struct Outline {
    label: String,
    points: Vec<[f64; 2]>,
    /// Polygons had none at first.
    shape_type: Option<String>,
}

/// The shapes of a file, or of those below a folder.
pub(super) fn drawn(source: &Path) -> Result<Drawn> {
    let files = match source.is_dir() {
        true => files_below(source, &|path| has_extension(path, &["json"]))?,
        false => vec![source.to_path_buf()],
    };
    let root = if source.is_dir() { source } else { source.parent().unwrap_or(Path::new("")) };
    let mut pictures = Vec::new();
    for path in files {
        match drawing(&path, root)? {
            Some(picture) => pictures.push(picture),
            None if source.is_dir() => (),
            None => {
                let message = "is not a LabelMe file: it has no `shapes`".into();
                return Err(Error::Format { what: path.display().to_string(), message });
            }
        }
    }
    Ok(Drawn { what: source.display().to_string(), pictures })
}

/// What a file says of its picture; none where it is of another kind.
fn drawing(path: &Path, root: &Path) -> Result<Option<Drawing>> {
    let what = path.display().to_string();
    let file: File = serde_json::from_str(&read_text(path)?).map_err(Error::format(&what))?;
    let (Some(outlines), Some(picture)) = (file.shapes, file.image_path) else { return Ok(None) };
    let shape = |(index, outline): (usize, Outline)| {
        let refuse = |message| Error::Format { what: format!("{what}: shapes[{index}]"), message };
        let kind = outline.shape_type.unwrap_or_else(|| "polygon".into());
        let ball = ball(&kind, &outline.points).map_err(refuse)?;
        Ok(Shape { label: outline.label, kind, ball })
    };
    let shapes = outlines.into_iter().enumerate().map(shape).collect::<Result<_>>()?;
    Ok(Some(Drawing {
        name: path.strip_prefix(root).unwrap_or(path).to_path_buf(),
        // Those of Windows write its separators.
        file: path.with_file_name(picture.replace('\\', "/")),
        size: file.image_width.zip(file.image_height).map(<[f64; 2]>::from),
        shapes,
        what: what.clone(),
    }))
}

/// The ball by a shape's points; none for a kind that no ball is read from.
fn ball(kind: &str, points: &[[f64; 2]]) -> std::result::Result<Option<Ball>, String> {
    Ok(Some(match (kind, points) {
        ("point", &[point]) => Ball::at(point),
        // Its middle and a point on it.
        ("circle", &[[x, y], [on_x, on_y]]) => Ball::in_ellipse([x, y], [(on_x - x).hypot(on_y - y); 2]),
        ("rectangle", [_, _] | [_, _, _, _]) | ("polygon", [_, _, _, ..]) => {
            let side = |axis: usize| {
                let along = || points.iter().map(|point| point[axis]);
                let (low, high) = (along().fold(f64::INFINITY, f64::min), along().fold(f64::NEG_INFINITY, f64::max));
                [(low + high) / 2.0, high - low]
            };
            let ([x, width], [y, height]) = (side(0), side(1));
            Ball::in_box([x, y], [width, height])
        }
        ("point" | "circle" | "rectangle" | "polygon", _) => {
            return Err(format!("has {} points, the wrong number for a {kind}", points.len()));
        }
        _ => return Ok(None),
    }))
}
