//! The chapters of pictures: the worst ones, and what the depth looks at.

use image::RgbImage;
use image::imageops::{self, FilterType};

use super::{Report, cm, html};
use crate::draw;
use crate::error::{Error, Result};
use crate::evaluate::Sample;
use crate::image::Picture;

/// Clips whose worst picture is shown, and pictures whose saliency is.
const WORST: usize = 6;
const SALIENCIES: usize = 4;
/// Longest side of a picture in the file, px.
const LONGEST_SIDE: u32 = 448;

/// The worst picture of each of the worst clips.
pub fn worst(report: &Report<'_>) -> Result<String> {
    let mut sorted: Vec<&Sample> = report.samples.iter().collect();
    sorted.sort_by(|a, b| b.dtg().total_cmp(&a.dtg()));
    let mut clips = Vec::new();
    sorted.retain(|sample| {
        let new = !clips.contains(&sample.place[0]);
        clips.push(sample.place[0]);
        new
    });
    let cards = sorted.iter().take(WORST).map(|sample| bad(report, sample)).collect::<Result<Vec<_>>>()?;
    let lead = "The worst picture of each of the worst clips: the position found (cross) and the true one (ring), the heatmap, \
                and the depth map (bright is far).";
    Ok(html::section("Where it failed most", lead, &html::row("", &cards)))
}

/// A picture's card: with marks, with heatmap, with depth map.
fn bad(report: &Report<'_>, sample: &Sample) -> Result<String> {
    let picture = picture(report, sample)?;
    let camera = &report.clips.clips[sample.place[0]].camera;
    let found = pollster::block_on(report.localiser.localise(&picture, camera, true))?;
    let Some(maps) = found.maps else { return Ok(String::new()) };
    let (depth_map, [nearest, farthest]) = draw::with_depth(picture.rgb(), &maps);
    let heatmap = draw::with_heatmap(picture.rgb(), &maps);
    let pictures = [picture.rgb(), &heatmap, &depth_map];
    let drawings = pictures.map(|drawing| marked(drawing, sample)).into_iter().collect::<Result<String>>()?;
    let hidden = if sample.visible { "" } else { ", the ball is hidden" };
    let caption = format!(
        "{} cm off at {:.2} m, found at {:.2} m; {:.1} px off in the picture; confidence {:.2}{hidden}. {}, frame {}. \
         Depth map: {nearest:.1}–{farthest:.1} m",
        cm(sample.dtg()),
        sample.true_depth,
        found.depth,
        sample.image_error(),
        sample.confidence,
        sample.clip,
        sample.place[1],
    );
    let keys = [("found", "found"), ("truth", "true")];
    Ok(html::figure(&format!("<div class=\"strip\">{drawings}</div>\n"), &caption, &keys))
}

/// Some pictures with ∂depth/∂pixel.
pub fn saliency(report: &Report<'_>) -> Result<String> {
    let count = SALIENCIES.min(report.samples.len());
    // Evenly spread, away from the ends.
    let some = (0..count).map(|index| &report.samples[(2 * index + 1) * report.samples.len() / (2 * count)]);
    let card = |sample: &Sample| -> Result<String> {
        let picture = picture(report, sample)?;
        let (drawing, full) = draw::with_saliency(picture.rgb(), &report.localiser.saliency(&picture)?);
        let caption = format!("{}, frame {}. Brightest: {full:.1e} m", sample.clip, sample.place[1]);
        Ok(html::figure(&marked(&drawing, sample)?, &caption, &[]))
    };
    let cards = some.map(card).collect::<Result<Vec<_>>>()?;
    let lead = "|∂depth/∂pixel|: how far the depth found would move if a pixel got brighter, from black to white (paper, \
                “Interpretation of the learning process”). What glows is what the network measures the depth by. The scale \
                is that of a square root, so that weak traces show.";
    Ok(html::section("What the depth looks at", lead, &html::row("four", &cards)))
}

/// The picture of `sample`.
fn picture(report: &Report<'_>, sample: &Sample) -> Result<Picture> {
    let [clip, frame] = sample.place;
    let missing = || Error::Data { what: sample.clip.clone(), reason: format!("there is no frame {frame} any more") };
    let clip = report.clips.clips.get(clip).ok_or_else(missing)?;
    report.clips.picture(clip, clip.frames.get(frame).ok_or_else(missing)?)
}

/// `drawing`, which has its picture's size, with the position found and the true one.
fn marked(drawing: &RgbImage, sample: &Sample) -> Result<String> {
    let (width, height) = drawing.dimensions();
    let longest = width.max(height);
    let png = match longest > LONGEST_SIDE {
        true => {
            let side = |side: u32| (u64::from(side) * u64::from(LONGEST_SIDE) / u64::from(longest)).max(1) as u32;
            draw::png(&imageops::resize(drawing, side(width), side(height), FilterType::Triangle))?
        }
        false => draw::png(drawing)?,
    };
    let picture = html::data_uri(&png);
    let size = f64::from(longest);
    let (ring, inner, outer) = (size * 0.04, size * 0.025, size * 0.06);
    let (found, truth) = (sample.found_image, sample.true_image);
    let strokes = [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)].map(|(dx, dy)| {
        let at = |distance: f64| format!("{:.2} {:.2}", found.x + dx * distance, found.y + dy * distance);
        format!("M{}L{}", at(inner), at(outer))
    });
    // Pixel coordinates: the first pixel's centre is (0, 0).
    Ok(format!(
        "<svg class=\"picture\" viewBox=\"-0.5 -0.5 {width} {height}\" stroke-width=\"{:.2}\">\
         <image x=\"-0.5\" y=\"-0.5\" width=\"{width}\" height=\"{height}\" href=\"{picture}\"/>\
         <circle class=\"true-mark\" cx=\"{:.2}\" cy=\"{:.2}\" r=\"{ring:.2}\"/>\
         <path class=\"found-mark\" d=\"{}\"/></svg>\n",
        size * 0.009,
        truth.x,
        truth.y,
        strokes.concat()
    ))
}
