//! Proposed labels as text: a table with confidences, a 2D track, CVAT's XML.

use std::fmt::Write as _;

use gravisight::internal::TrackPoint;
use gravisight::parts::Proposal;
use gravisight::{Error, Result, Size, Track};
use serde::Serialize;

/// CVAT's coordinates begin at the first pixel's corner, ours at its centre, px.
const CVAT_CORNER: f64 = 0.5;

/// One line of a table of proposals; empty fields where the ball is not seen.
#[derive(Serialize)]
struct ExportedFrame<'a> {
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
    let lines = pairs.map(|(frame, (label, file))| ExportedFrame {
        frame,
        file,
        x: label.map(|label| label.image[0]),
        y: label.map(|label| label.image[1]),
        radius: label.map(|label| label.radius_px),
        confidence: label.map(|label| label.confidence),
        doubtful: label.map(|label| label.doubtful),
    });
    let refuse = |message: String| Error::Format { what: "labels".into(), message };
    let mut writer = csv::Writer::from_writer(vec![]);
    for line in lines {
        writer.serialize(line).map_err(|error| refuse(error.to_string()))?;
    }
    let bytes = writer.into_inner().map_err(|error| refuse(error.to_string()))?;
    String::from_utf8(bytes).map_err(|error| refuse(error.to_string()))
}

/// The 2D track of a clip's labels; frames are numbered from 0.
pub fn track_of_labels(labels: &[Option<Proposal>]) -> Track {
    let point = |(frame, label): (usize, &Option<Proposal>)| TrackPoint {
        frame: frame as u64,
        visibility: label.is_some().into(),
        x: label.map(|label| label.image[0]),
        y: label.map(|label| label.image[1]),
        ..TrackPoint::default()
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_say_where_the_ball_is_and_where_it_is_not() {
        let label = Proposal { image: [1.5, 2.25], radius_px: 6.0, confidence: 0.5, doubtful: true };
        let table = labels_csv(&[Some(label), None], &["a.png".into(), "b.png".into()]).unwrap();
        assert_eq!(table, "frame,file,x,y,radius,confidence,doubtful\n0,a.png,1.5,2.25,6.0,0.5,true\n1,b.png,,,,,\n");
        let xml =
            cvat_xml([("a&\"b\".png", Size::new(64, 48), Some(label)), ("c.png", Size::new(64, 48), None)].into_iter());
        assert!(xml.contains("name=\"a&amp;&quot;b&quot;.png\" width=\"64\" height=\"48\""), "{xml}");
        // CVAT's origin is the first pixel's corner
        assert!(xml.contains("points=\"2.00,2.75\"") && xml.matches("<points").count() == 1, "{xml}");
    }
}
