//! The chapters of pictures: the worst ones, and what the depth looks at.

use image::RgbImage;
use image::imageops::{self, FilterType};

use super::{Report, cm, html};
use crate::draw;
use gravisight::{Error, LocaliseOptions, Picture, Result, Sample};

/// Clips whose worst picture is shown, and pictures whose saliency is.
const WORST: usize = 6;
const SALIENCIES: usize = 4;
/// Pictures of the clip that is shown.
pub const FRAMES: usize = 6;
/// Fractions of a picture's sides that the ball's picture and the saliency's show.
const ZOOM: f64 = 0.3;
const SALIENCY_ZOOM: f64 = 0.6;
const MARKS: [(&str, &str); 2] = [("found", "found"), ("truth", "true")];
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
    let lead = "The worst picture of each of the worst clips: the ball with the position found (cross) and the true \
                one (ring), the heatmap, and the depth map (bright is far).";
    Ok(html::section("Where it failed most", lead, &html::row("", &cards)))
}

/// Some pictures of one clip side by side; below each its heatmap and its depth map (all in the same colours).
pub fn strip(report: &Report<'_>, samples: &[&Sample]) -> Result<String> {
    let count = FRAMES.min(samples.len());
    let some = (0..count).map(|index| samples[index * (samples.len() - 1) / (count - 1).max(1)]);
    let mut frames = Vec::new();
    for sample in some {
        let picture = picture(report, sample)?;
        let clip = &report.clips.clips[sample.place[0]];
        let options = LocaliseOptions { maps: true, ball_radius: sample.ball_radius, ..LocaliseOptions::default() };
        let found = pollster::block_on(report.localiser.localise(&picture, &clip.camera, options))?;
        let Some(maps) = found.maps else { return Ok(String::new()) };
        frames.push((picture, maps, clip.frames[sample.place[1]].t));
    }
    let range = draw::depth_range(frames.iter().map(|(_, maps, _)| maps));
    let whole = |drawing: &RgbImage| {
        let sides = [drawing.width(), drawing.height()].map(f64::from);
        cut(drawing, sides.map(|side| side / 2.0), sides, "")
    };
    let mut drawings = Vec::new();
    for (picture, _, t) in &frames {
        drawings.push((whole(picture.rgb())?, format!("{t:.2} s")));
    }
    for (picture, maps, _) in &frames {
        drawings.push((whole(&draw::with_heatmap(picture.rgb(), maps))?, String::new()));
    }
    for (picture, maps, _) in &frames {
        drawings.push((whole(&draw::with_depth(picture.rgb(), maps, range))?, String::new()));
    }
    let caption = format!("Pictures, heatmaps and depth maps; depth from {:.1} (dark) to {:.1} m", range[0], range[1]);
    Ok(html::figure(&html::frames(&drawings), &caption, &[]))
}

/// A picture's card: with marks, with heatmap, with depth map.
fn bad(report: &Report<'_>, sample: &Sample) -> Result<String> {
    let picture = picture(report, sample)?;
    let camera = &report.clips.clips[sample.place[0]].camera;
    let options = LocaliseOptions { maps: true, ball_radius: sample.ball_radius, ..LocaliseOptions::default() };
    let found = pollster::block_on(report.localiser.localise(&picture, camera, options))?;
    let Some(maps) = found.maps else { return Ok(String::new()) };
    let range @ [nearest, farthest] = draw::depth_range([&maps].into_iter());
    let depth_map = draw::with_depth(picture.rgb(), &maps, range);
    let heatmap = draw::with_heatmap(picture.rgb(), &maps);
    let drawings = [
        (marked(picture.rgb(), sample, ZOOM)?, "ball".to_string()),
        (marked(&heatmap, sample, 1.0)?, "heatmap".to_string()),
        (marked(&depth_map, sample, 1.0)?, format!("depth, {nearest:.1}–{farthest:.1} m")),
    ];
    let hidden = if sample.visible { "" } else { ", ball hidden" };
    let caption = format!("{} cm off: {}, frame {}{hidden}", cm(sample.dtg()), sample.clip, sample.place[1]);
    let details = format!(
        "Depth {:.2} m, true depth {:.2} m. Error in the picture {:.1} px. Confidence {:.2}.",
        found.depth,
        sample.true_depth,
        sample.image_error(),
        sample.confidence
    );
    Ok(html::figure(&(html::strip(&drawings) + &html::text("p", &details)), &caption, &MARKS))
}

/// Some pictures with ∂depth/∂pixel.
pub fn saliency(report: &Report<'_>) -> Result<String> {
    let mut sorted: Vec<&Sample> = report.samples.iter().collect();
    sorted.sort_by(|a, b| a.dtg().total_cmp(&b.dtg()));
    let count = SALIENCIES.min(sorted.len());
    let some = (0..count).map(|index| sorted[(2 * index + 1) * sorted.len() / (2 * count)]);
    let card = |sample: &Sample| -> Result<String> {
        let picture = picture(report, sample)?;
        let mut saliency = pollster::block_on(report.localiser.saliency(&picture))?;
        if saliency.depth.is_none() {
            // Fractions of the depth, to metres.
            saliency.values.iter_mut().for_each(|value| *value *= sample.found_depth as f32);
        }
        let (drawing, full) = draw::with_saliency(picture.rgb(), &saliency);
        let details = format!("Brightest: {:.1} cm. {}, frame {}", full * 100.0, sample.clip, sample.place[1]);
        let glow = part(&drawing, sample, SALIENCY_ZOOM, "")? + &html::text("p", &details);
        Ok(html::figure(&glow, &format!("{} cm off", cm(sample.dtg())), &[]))
    };
    let cards = some.map(card).collect::<Result<Vec<_>>>()?;
    let lead = "|∂depth/∂pixel|: how much the estimated depth would change if a pixel went from black to white \
                (paper, “Interpretation of the learning process”). Bright pixels are those from which the \
                network estimates the depth; colours show the square root, so that weak values are visible. \
                Sorted from good pictures to bad ones.";
    Ok(html::section("Pixels that determine the depth", lead, &html::row("four", &cards)))
}

/// The picture of `sample`.
fn picture(report: &Report<'_>, sample: &Sample) -> Result<Picture> {
    let [clip, frame] = sample.place;
    let missing = || Error::Data { what: sample.clip.clone(), reason: format!("there is no frame {frame} any more") };
    let clip = report.clips.clips.get(clip).ok_or_else(missing)?;
    report.clips.picture(clip, clip.frames.get(frame).ok_or_else(missing)?)
}

/// `drawing`, which has its picture's size, with the position found and the true one.
fn marked(drawing: &RgbImage, sample: &Sample, fraction: f64) -> Result<String> {
    let (found, truth) = (sample.found_image, sample.true_image);
    let size = f64::from(drawing.width().max(drawing.height())) * fraction;
    let (ring, inner, outer) = (size * 0.04, size * 0.025, size * 0.06);
    let strokes = [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)].map(|(dx, dy)| {
        let at = |distance: f64| format!("{:.2} {:.2}", found.x + dx * distance, found.y + dy * distance);
        format!("M{}L{}", at(inner), at(outer))
    });
    let marks = format!(
        "<g class=\"marks\" stroke-width=\"{:.2}\"><circle cx=\"{:.2}\" cy=\"{:.2}\" r=\"{ring:.2}\"/>\
         <path d=\"{}\"/></g>",
        size * 0.009,
        truth.x,
        truth.y,
        strokes.concat()
    );
    part(drawing, sample, fraction, &marks)
}

/// The part of `drawing` around the positions found and true whose sides are `fraction` of the whole's, or as large as
/// both need; `marks` (SVG, in px of the picture) lie over it.
fn part(drawing: &RgbImage, sample: &Sample, fraction: f64, marks: &str) -> Result<String> {
    let (found, truth) = (sample.found_image, sample.true_image);
    let sides = [drawing.width(), drawing.height()];
    let apart = [0, 1].map(|axis| 1.4 * (found[axis] - truth[axis]).abs() / f64::from(sides[axis]));
    let fraction = fraction.max(apart[0]).max(apart[1]).min(1.0);
    let middle = [0, 1].map(|axis| (found[axis] + truth[axis]) / 2.0);
    cut(drawing, middle, sides.map(|side| f64::from(side) * fraction), marks)
}

/// The part of `drawing` around `middle` of about the size `sides`, px; `marks` (SVG, in px of the picture) lie over it.
pub fn cut(drawing: &RgbImage, middle: [f64; 2], sides: [f64; 2], marks: &str) -> Result<String> {
    let all = [drawing.width(), drawing.height()];
    let [width, height] = [0, 1].map(|axis| (sides[axis].ceil() as u32).clamp(1, all[axis]));
    let [left, top]: [u32; 2] = std::array::from_fn(|axis| {
        let part = [width, height][axis];
        (middle[axis] - f64::from(part) / 2.0).clamp(0.0, f64::from(all[axis] - part)) as u32
    });
    let part = imageops::crop_imm(drawing, left, top, width, height).to_image();
    let longest = width.max(height);
    let png = match longest > LONGEST_SIDE {
        true => {
            let side = |side: u32| (u64::from(side) * u64::from(LONGEST_SIDE) / u64::from(longest)).max(1) as u32;
            draw::png(&imageops::resize(&part, side(width), side(height), FilterType::Triangle))?
        }
        false => draw::png(&part)?,
    };
    // Pixel coordinates: the first pixel's centre is (0, 0).
    let (x, y) = (f64::from(left) - 0.5, f64::from(top) - 0.5);
    Ok(format!(
        "<svg class=\"picture\" viewBox=\"{x} {y} {width} {height}\">\
         <image x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" href=\"{}\"/>{marks}</svg>\n",
        html::data_uri(&png)
    ))
}
