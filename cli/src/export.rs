//! Proposed labels as text: a table with confidences, CVAT's XML.

use std::fmt::Write as _;

use gravisight::parts::TrackedFrame;
use gravisight::{Error, Result, Size};
use serde::Serialize;

/// Confidence below which a person should look at a label.
pub const DOUBTFUL: f64 = 0.9;
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

/// Whether a person should look at a label: its confidence is low.
pub fn is_doubtful(label: &TrackedFrame) -> bool {
    label.image.is_some() && label.confidence < DOUBTFUL
}

/// CSV `frame,file,x,y,radius,confidence,doubtful` (px), a line for each frame; `files` names the pictures.
///
/// # Errors
/// [`crate::Error::Format`] where a number cannot be written.
pub fn labels_csv(labels: &[TrackedFrame], files: &[String]) -> Result<String> {
    let pairs = labels.iter().zip(files).enumerate();
    let lines = pairs.map(|(frame, (label, file))| ExportedFrame {
        frame,
        file,
        x: label.image.map(|image| image.x),
        y: label.image.map(|image| image.y),
        radius: label.image.and(label.radius_px),
        confidence: label.image.map(|_| label.confidence),
        doubtful: label.image.map(|_| is_doubtful(label)),
    });
    let refuse = |message: String| Error::Format { what: "labels".into(), message };
    let mut writer = csv::Writer::from_writer(vec![]);
    for line in lines {
        writer.serialize(line).map_err(|error| refuse(error.to_string()))?;
    }
    let bytes = writer.into_inner().map_err(|error| refuse(error.to_string()))?;
    String::from_utf8(bytes).map_err(|error| refuse(error.to_string()))
}

/// "CVAT for images 1.1": each picture (its name, width and height, label) with a point `ball` on the ball's centre.
pub fn cvat_xml<'a>(pictures: impl Iterator<Item = (&'a str, Size, TrackedFrame)>) -> String {
    let mut xml = String::from("<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<annotations>\n  <version>1.1</version>\n");
    for (number, (name, Size { width, height }, label)) in pictures.enumerate() {
        let name = escaped(name);
        let _ = write!(xml, "  <image id=\"{number}\" name=\"{name}\" width=\"{width}\" height=\"{height}\">");
        if let Some(image) = label.image {
            let (x, y) = (image.x + CVAT_CORNER, image.y + CVAT_CORNER);
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
        let label = TrackedFrame {
            image: Some([1.5, 2.25].into()),
            radius_px: Some(6.0),
            confidence: 0.5,
            ..TrackedFrame::default()
        };
        let none = TrackedFrame::default();
        let table = labels_csv(&[label, none], &["a.png".into(), "b.png".into()]).unwrap();
        assert_eq!(table, "frame,file,x,y,radius,confidence,doubtful\n0,a.png,1.5,2.25,6.0,0.5,true\n1,b.png,,,,,\n");
        let xml = cvat_xml([("a&\"b\".png", Size::new(64, 48), label), ("c.png", Size::new(64, 48), none)].into_iter());
        assert!(xml.contains("name=\"a&amp;&quot;b&quot;.png\" width=\"64\" height=\"48\""), "{xml}");
        // CVAT's origin is the first pixel's corner
        assert!(xml.contains("points=\"2.00,2.75\"") && xml.matches("<points").count() == 1, "{xml}");
    }
}
