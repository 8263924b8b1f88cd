//! Proposed labels as text: a table with confidences, a 2D track, CVAT's XML.

use std::fmt::Write as _;

use serde::Serialize;

use super::Proposal;
use crate::data::track::{Track, TrackPoint, csv_of};
use crate::error::Result;
use crate::size::Size;

/// CVAT's coordinates begin at the first pixel's corner, ours at its centre, px.
const CVAT_CORNER: f64 = 0.5;

/// One line of a table of proposals; empty fields where the ball is not seen.
#[derive(Serialize)]
struct Line<'a> {
    frame: usize,
    file: &'a str,
    x: Option<f64>,
    y: Option<f64>,
    radius: Option<f64>,
    confidence: Option<f64>,
    doubtful: Option<bool>,
}

/// CSV `frame,file,x,y,radius,confidence,doubtful` (px), a line for each frame; `files` names the pictures.
///
/// # Errors
/// [`crate::Error::Format`] where a number cannot be written.
pub fn labels_csv(labels: &[Option<Proposal>], files: &[String]) -> Result<String> {
    let pairs = labels.iter().zip(files).enumerate();
    let lines = pairs.map(|(frame, (label, file))| Line {
        frame,
        file,
        x: label.map(|label| label.image[0]),
        y: label.map(|label| label.image[1]),
        radius: label.map(|label| label.radius_px),
        confidence: label.map(|label| label.confidence),
        doubtful: label.map(|label| label.doubtful),
    });
    csv_of(&lines.collect::<Vec<_>>())
}

/// The 2D track of a clip's labels; frames are numbered from 0.
pub fn track_of_labels(labels: &[Option<Proposal>]) -> Track {
    let point = |(frame, label): (usize, &Option<Proposal>)| TrackPoint {
        frame: frame as u64,
        visibility: label.is_some().into(),
        x: label.map(|label| label.image[0]),
        y: label.map(|label| label.image[1]),
    };
    Track { points: labels.iter().enumerate().map(point).collect() }
}

/// "CVAT for images 1.1": each picture (its name, width and height, label) with a point `ball` on the ball's centre.
pub fn cvat_xml<'a>(pictures: impl Iterator<Item = (&'a str, Size, Option<Proposal>)>) -> String {
    let mut xml = String::from("<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<annotations>\n  <version>1.1</version>\n");
    for (number, (name, Size { width, height }, label)) in pictures.enumerate() {
        let name = escaped(name);
        let _ = write!(xml, "  <image id=\"{number}\" name=\"{name}\" width=\"{width}\" height=\"{height}\">");
        if let Some(Proposal { image: [x, y], .. }) = label {
            let (x, y) = (x + CVAT_CORNER, y + CVAT_CORNER);
            let _ = write!(
                xml,
                "\n    <points label=\"ball\" source=\"auto\" occluded=\"0\" points=\"{x:.2},{y:.2}\" z_order=\"0\"/>\n  "
            );
        }
        xml.push_str("</image>\n");
    }
    xml.push_str("</annotations>\n");
    xml
}

/// A text as it may stand in an attribute.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
