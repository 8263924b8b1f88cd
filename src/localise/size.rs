//! Depth from apparent size: a picture at its own resolution, or a part of it; several places where the ball may be.

use burn::tensor::Transaction;
use image::RgbImage;
use nalgebra::{Matrix3, Point2, Point3};

use super::closer::LOOKED_AT;
use super::outline::refined;
use super::possible::Possible;
use super::{Candidate, Localisation, LocaliseOptions, Localiser, Maps, Region, device_name};
use crate::camera::{Camera, Measured, Outline};
use crate::error::{Error, Result};
use crate::image::{Filter, Picture, resized, tile};
use crate::model::{self, Peak};
use crate::size::Size;

/// Longer side of the picture in which large balls are searched, px, and the confidence from which a candidate goes on.
const SPOTTED_SIDE: u32 = 448;
const SPOTTED: f64 = 0.15;
/// Most pixels that the network sees at once: a little more than 1920×1088. Larger pictures are searched in tiles.
const MOST_PIXELS: usize = 2_200_000;
/// Side of a tile, and by how much neighbours overlap, px: twice what a ball of the largest radius needs around it.
const TILE: u32 = 1024;
const OVERLAP: u32 = 256;
/// How much smaller a picture is seen once more, for balls too large at its own resolution.
const SHRUNK: u32 = 4;
/// Smallest side of a picture that is seen smaller, px (of the smaller one).
const LEAST_SHRUNK: u32 = 48;
/// Largest radius that is read at a picture's own resolution where a smaller one is there to be read, px.
const LARGE: f64 = 45.0;
/// Candidates that are searched at least: the confidence of the first depends on the others.
const PLACES: usize = 8;
/// The same where it is known where the ball can be, which refuses some.
const MORE_PLACES: usize = 30;
/// Cells that the network saw in training; many more of them add up to more doubt than each was worth.
const CELLS: f64 = 4096.0;
/// Standard deviation of log(radius) over the scale of its Laplace distribution: between that distribution's own, √2, and
/// the 1.15 that hold 68 % of it.
pub(super) const SIGMA_OF_SCALE: f64 = 1.3;
/// Standard deviation of the centre along each axis over that of the radius, as of a circle laid through noisy points.
const CENTRE_OF_RADIUS: f64 = std::f64::consts::SQRT_2;
/// Largest radius that is taken for one in metres, m.
const LARGEST_BALL: f64 = 1.0;
/// Angle off the camera's axis beyond which few lenses are without distortion, degrees.
const WIDE: f64 = 40.0;

/// A place where the ball may be, px of the picture.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reading {
    /// The ball's outline.
    pub outline: Outline,
    /// Standard deviation of log(radius).
    pub log_sigma: f64,
    /// Fraction of the heatmap's mass around the centre, 0 to 1; after the verifier the probability that it is a ball.
    pub confidence: f64,
}

/// What was found in a picture.
pub(crate) struct Found {
    /// Places of the ball, the likeliest first.
    pub readings: Vec<Reading>,
    /// The network's maps, where asked for.
    pub maps: Option<Maps>,
    /// Places that cannot be the ball, the surest first, and why.
    pub refused: Vec<(Reading, String)>,
}

/// What the first pass found.
pub(crate) struct First {
    /// Candidates, the likeliest first.
    pub readings: Vec<Reading>,
    /// The network's maps, where asked for.
    pub maps: Option<Maps>,
    /// Cells among which these were found.
    pub cells: usize,
}

/// Maps of a part of a picture, row-major.
pub(super) struct Field {
    columns: usize,
    stride: usize,
    pub(super) logits: Vec<f32>,
    radius: Vec<f32>,
    log_scale: Vec<f32>,
}

impl Localiser {
    /// Refuses what a model that reads sizes cannot do with `options`: the ball's radius, m.
    pub(super) fn ball_radius(&self, options: &LocaliseOptions) -> Result<f64> {
        let refuse = |reason: String| Err(Error::value("ball", "radius", reason));
        match options.ball_radius {
            None => refuse(format!(
                "is missing: model `{}` reads a ball's apparent size, of which its real one makes a depth; give the radius in \
                 metres (`--ball-radius 0.0335`, `ball: {{ radius: 0.0335 }}`, or a scene)",
                self.card.name
            )),
            Some(radius) if !(radius.is_finite() && radius > 0.0) => {
                refuse(format!("must be a positive number of metres, not {radius}"))
            }
            Some(radius) => Ok(radius),
        }
    }

    /// The ball's position in `picture` by its apparent size.
    pub(super) async fn localise_by_size(
        &self,
        picture: &Picture,
        camera: &Camera,
        options: LocaliseOptions,
    ) -> Result<Localisation> {
        let radius = self.ball_radius(&options)?;
        let size = picture.size();
        let camera_of_picture = camera.for_picture(size)?;
        let possible =
            options.volume.map(|volume| Possible { camera: &camera_of_picture, ball_radius: radius, volume });
        let (count, maps) = (options.candidates.max(1), options.maps);
        let Found { mut readings, maps, refused } =
            self.readings(picture, Some(&camera_of_picture), options.region, possible.as_ref(), count, maps).await?;
        let none_possible = readings.is_empty();
        if let (true, Some((surest, _))) = (none_possible, refused.first()) {
            readings.push(Reading { confidence: 0.0, ..*surest });
        }
        let Some(best) = readings.first() else {
            return Err(Error::OutputNotFinite { device: device_name(&self.device) });
        };
        let centre = camera_of_picture.ball_from_outline(&best.outline, radius)?;
        if radius > LARGEST_BALL {
            let reason = format!(
                "is {radius} m, which puts the ball {:.0} m away; a radius is given in metres: {} for one of {radius} mm",
                centre.z,
                radius / 1000.0
            );
            return Err(Error::value("ball", "radius", reason));
        }
        let mut notes = picture.notes().to_vec();
        if size != camera.size() {
            notes.push(format!("camera.json is for a {} picture; scaled to this one's {size}", camera.size()));
        }
        let unfound = match none_possible {
            true => Some(
                "no ball found: no place in the picture can be it; the position is that of the likeliest one".into(),
            ),
            false => self.unsure(best.confidence),
        };
        let ball_found = unfound.is_none();
        notes.extend(unfound);
        if let Some((surest, reason)) = refused.first() {
            let Point2 { coords } = surest.outline.centre;
            notes.push(format!(
                "{} places were not taken for the ball, by where it can be; the surest, at ({:.0}, {:.0}) px with a confidence of {:.2}: \
                 {reason}",
                refused.len(),
                coords.x,
                coords.y,
                surest.confidence
            ));
        }
        let off_axis = centre.coords.xy().norm().atan2(centre.z).to_degrees();
        if off_axis > WIDE && camera.distortion().is_none() {
            notes.push(format!(
                "the ball is {off_axis:.0}° off the camera's axis, and camera.json models no lens distortion: if the lens has \
                 some, position and depth are off by as much as it bends there"
            ));
        }
        notes.extend(camera.doubts(None, &[]));
        let candidate = |reading: &Reading| candidate(reading, &camera_of_picture, radius).ok();
        let candidates = if options.candidates > 0 { readings.iter().filter_map(candidate).collect() } else { vec![] };
        let image = camera_of_picture.image_from_camera(&centre)?;
        let depth_sigma = best.log_sigma * centre.z;
        let maps = maps.map(|mut maps| {
            let focal = camera_of_picture.intrinsic().fixed_view::<2, 2>(0, 0).determinant().abs().sqrt();
            maps.depth.iter_mut().for_each(|value| *value = (focal * radius) as f32 / *value);
            maps
        });
        Ok(Localisation {
            image: image.coords.into(),
            depth: centre.z,
            depth_sigma: Some(depth_sigma),
            radius_px: Some(best.outline.radius),
            covariance: Some(covariance(best, &camera_of_picture, &image, centre.z)?),
            camera: centre.coords.into(),
            world: camera_of_picture.world_from_camera(&centre).coords.into(),
            ball_found,
            confidence: best.confidence,
            confidence_kind: self.card.confidence_kind(),
            candidates,
            notes,
            maps,
        })
    }

    /// Measures the ball that something else found at `image` with about the radius `radius_px`; `reach_px` from its middle it may
    /// still be (half a streak's length). `camera` took the picture; without one, balls are circles. None where the network sees
    /// no such ball.
    ///
    /// # Errors
    /// [`Error::Value`] where the model reads no sizes; [`Error::OutputNotFinite`] and [`Error::Device`].
    pub async fn measure(
        &self,
        picture: &Picture,
        camera: Option<&Camera>,
        image: [f64; 2],
        radius_px: f64,
        reach_px: f64,
    ) -> Result<Option<Measured>> {
        self.must_read_sizes()?;
        let outline = Outline { centre: image.into(), radius: radius_px };
        let found = self.look_at(picture.rgb(), &outline, reach_px.max(radius_px)).await?;
        let found = found.map(|reading| refined(picture.rgb(), camera, reading));
        Ok(found.map(|Reading { outline, log_sigma, confidence }| Measured {
            outline,
            radius_sigma_px: log_sigma * outline.radius,
            sigma_px: CENTRE_OF_RADIUS * log_sigma * outline.radius,
            confidence,
        }))
    }

    /// Where large balls may be in a picture, roughly: one pass over it, made small.
    ///
    /// # Errors
    /// As [`Self::measure`].
    pub async fn spot(&self, picture: &Picture) -> Result<Vec<Outline>> {
        self.must_read_sizes()?;
        let rgb = picture.rgb();
        let (width, height) = rgb.dimensions();
        let shrink = f64::from(width.max(height)) / f64::from(SPOTTED_SIDE);
        let side = |side: u32| ((f64::from(side) / shrink).round() as u32).max(1);
        let small = match shrink > 1.0 {
            true => &resized(rgb, [0, 0], picture.size(), Size::new(side(width), side(height)), Filter::Bilinear),
            false => rgb,
        };
        let up = |side: u32| side.div_ceil(self.config.input_multiple()) * self.config.input_multiple();
        let field = self.one_field(small, 0, 0, Size::new(up(small.width()), up(small.height()))).await?;
        let scale = [f64::from(width) / f64::from(small.width()), f64::from(height) / f64::from(small.height())];
        let found = peaks(&field, softmax(&field.logits), PLACES).into_iter();
        let found = found.filter(|peak| peak.confidence >= SPOTTED).map(|peak| Outline {
            centre: Point2::from(std::array::from_fn(|axis| (peak.image[axis] + 0.5) * scale[axis] - 0.5)),
            radius: peak.radius * (scale[0] * scale[1]).sqrt(),
        });
        Ok(found.collect())
    }

    fn must_read_sizes(&self) -> Result<()> {
        if self.reads_size() {
            return Ok(());
        }
        let reason = format!("must read sizes, as `any` does; `{}` knows one scene", self.card.name);
        Err(Error::value("model", "depth_from", reason))
    }

    /// The likeliest `count` places of the ball in (a `region` of) `picture`, which `camera` took, if that is known, of those that are
    /// `possible`; where asked for, also the heatmap and the apparent radii.
    ///
    /// # Errors
    /// [`Error::Value`] for a region outside the picture; [`Error::OutputNotFinite`] and [`Error::Device`].
    pub(crate) async fn readings(
        &self,
        picture: &Picture,
        camera: Option<&Camera>,
        region: Option<Region>,
        possible: Option<&Possible<'_>>,
        count: usize,
        with_maps: bool,
    ) -> Result<Found> {
        // Where some of them cannot be, others are offered in their place.
        let places = if possible.is_some() { MORE_PLACES } else { PLACES };
        let First { mut readings, maps, cells } =
            self.first_look(picture, region, count.max(places), with_maps).await?;
        let mut refused = vec![];
        if let Some(possible) = possible {
            (readings, refused) = possible.part(readings);
        }
        readings.truncate(count.max(LOOKED_AT));
        let mut readings = self.look_closer(picture.rgb(), camera, readings, cells, count).await?;
        if let Some(possible) = possible {
            let (seen, impossible) = possible.part(readings);
            readings = seen;
            refused.splice(0..0, impossible);
            refused.sort_by(|(a, _), (b, _)| b.confidence.total_cmp(&a.confidence));
        }
        Ok(Found { readings, maps, refused })
    }

    /// The same before the second pass: `count` candidates or more.
    ///
    /// # Errors
    /// As [`Self::readings`].
    pub(crate) async fn first_look(
        &self,
        picture: &Picture,
        region: Option<Region>,
        places: usize,
        with_maps: bool,
    ) -> Result<First> {
        let size = picture.size();
        let region = region.unwrap_or(Region { left: 0, top: 0, width: size.width, height: size.height });
        region.check(size)?;
        let Region { left, top, width, height } = region;
        let field = self.field(picture.rgb(), region).await?;
        let reading = |peak: Peak| Reading {
            outline: Outline {
                centre: Point2::new(peak.image[0] + f64::from(left), peak.image[1] + f64::from(top)),
                radius: peak.radius,
            },
            log_sigma: SIGMA_OF_SCALE * peak.log_scale,
            confidence: peak.confidence,
        };
        let probability = softmax(&field.logits);
        let cells = probability.len();
        let mut found = peaks(&field, probability.clone(), places);
        let maps = with_maps.then(|| self.whole_maps(&field, &probability, region, size));
        if width.min(height) / SHRUNK >= LEAST_SHRUNK {
            let shrunk = Size::new(width / SHRUNK, height / SHRUNK);
            let small = resized(picture.rgb(), [left, top], Size::new(width, height), shrunk, Filter::Bilinear);
            let all = Region { left: 0, top: 0, width: shrunk.width, height: shrunk.height };
            let field = self.field(&small, all).await?;
            let scale = [f64::from(width) / f64::from(shrunk.width), f64::from(height) / f64::from(shrunk.height)];
            let up = |image: [f64; 2]| std::array::from_fn::<f64, 2, _>(|axis| (image[axis] + 0.5) * scale[axis] - 0.5);
            let large = peaks(&field, softmax(&field.logits), places).into_iter().map(|peak| Peak {
                image: up(peak.image),
                radius: peak.radius * (scale[0] * scale[1]).sqrt(),
                ..peak
            });
            let large: Vec<Peak> = large.filter(|peak| peak.radius > LARGE).collect();
            // A ball is read once: a large one in the smaller picture.
            let same =
                |a: &Peak, b: &Peak| (a.image[0] - b.image[0]).hypot(a.image[1] - b.image[1]) < a.radius.max(b.radius);
            found.retain(|peak| {
                let twin = large.iter().find(|other| same(peak, other));
                twin.is_none_or(|twin| peak.radius <= LARGE && peak.confidence > twin.confidence)
            });
            let apart: Vec<Peak> =
                large.into_iter().filter(|peak| !found.iter().any(|other| same(peak, other))).collect();
            found.extend(apart);
        }
        found.sort_by(|a, b| b.confidence.total_cmp(&a.confidence));
        Ok(First { readings: found.into_iter().map(reading).collect(), maps, cells })
    }

    /// The network's maps of a part of a picture: at once, or tile by tile.
    async fn field(&self, rgb: &RgbImage, region: Region) -> Result<Field> {
        let multiple = self.config.input_multiple();
        let stride = self.config.output_stride();
        let up = |side: u32| side.div_ceil(multiple) * multiple;
        let Region { left, top, width, height } = region;
        if up(width) as usize * up(height) as usize <= MOST_PIXELS {
            return self.one_field(rgb, left, top, Size::new(up(width), up(height))).await;
        }
        let columns = up(width) as usize / stride;
        let rows = up(height) as usize / stride;
        let none = || vec![0.0; columns * rows];
        let mut whole = Field { columns, stride, logits: none(), radius: none(), log_scale: none() };
        let starts = |side: u32| -> Vec<u32> {
            let last = up(side).saturating_sub(TILE);
            (0..last).step_by((TILE - OVERLAP) as usize).chain([last]).collect()
        };
        for &y in &starts(height) {
            for &x in &starts(width) {
                let size = Size::new(TILE.min(up(width)), TILE.min(up(height)));
                let part = self.one_field(rgb, left + x, top + y, size).await?;
                // What is nearer to a tile's edge than half the overlap is better seen by its neighbour.
                let margin = |start: u32| if start == 0 { 0 } else { (OVERLAP / 2) as usize / stride };
                let (first_row, first_column) = (y as usize / stride, x as usize / stride);
                for row in margin(y)..part.logits.len() / part.columns {
                    let from = row * part.columns + margin(x)..(row + 1) * part.columns;
                    let to = (first_row + row) * columns + first_column + margin(x);
                    let to = to..to + from.len();
                    whole.logits[to.clone()].copy_from_slice(&part.logits[from.clone()]);
                    whole.radius[to.clone()].copy_from_slice(&part.radius[from.clone()]);
                    whole.log_scale[to].copy_from_slice(&part.log_scale[from]);
                }
            }
        }
        Ok(whole)
    }

    /// The network's maps of the part of `size` that begins at (`left`, `top`).
    pub(super) async fn one_field(&self, rgb: &RgbImage, left: u32, top: u32, size: Size) -> Result<Field> {
        self.field_of(tile(rgb, [left, top], size, &self.card.normalisation), size).await
    }

    /// The network's maps of a normalised input of `size`.
    pub(super) async fn field_of(&self, values: Vec<f32>, size: Size) -> Result<Field> {
        let output = self.runner(size).run(values);
        let [_, _, columns] = output.depth.dims();
        let failed = |reason: String| Error::Device { device: device_name(&self.device), reason };
        let log_scale = output.log_scale.ok_or_else(|| failed("the network does not read sizes".into()))?;
        let data = Transaction::default()
            .register(output.heatmap.mul_scalar(self.config.heatmap.beta))
            .register(output.depth)
            .register(log_scale)
            .execute_async()
            .await
            .map_err(|error| failed(error.to_string()))?;
        let parts: Vec<Vec<f32>> = data.iter().map(|part| part.iter::<f32>().collect()).collect();
        let Ok([logits, radius, log_scale]) = <[Vec<f32>; 3]>::try_from(parts) else {
            return Err(failed("the read-back returned another number of tensors than asked for".into()));
        };
        if [&logits, &radius, &log_scale].into_iter().flatten().any(|value| !value.is_finite()) {
            return Err(Error::OutputNotFinite { device: device_name(&self.device) });
        }
        Ok(Field { columns, stride: self.config.output_stride(), logits, radius, log_scale })
    }

    /// Maps over the whole picture, of which only a `region` was seen: nothing is elsewhere. `depth` holds radii.
    fn whole_maps(&self, field: &Field, probability: &[f32], region: Region, size: Size) -> Maps {
        let stride = field.stride;
        let [width, height] = [size.width, size.height].map(|side| (side as usize).div_ceil(stride));
        let mut maps = Maps { width, height, heatmap: vec![0.0; width * height], depth: vec![1.0; width * height] };
        let [left, top] = [region.left, region.top].map(|side| side as usize / stride);
        for (row, line) in probability.chunks_exact(field.columns).enumerate().take(height - top) {
            let count = field.columns.min(width - left);
            let to = (top + row) * width + left;
            maps.heatmap[to..to + count].copy_from_slice(&line[..count]);
            let from = row * field.columns;
            maps.depth[to..to + count].copy_from_slice(&field.radius[from..from + count]);
        }
        maps
    }
}

/// Softmax, in f64: hundreds of thousands of cells.
pub(super) fn softmax(logits: &[f32]) -> Vec<f32> {
    let most = logits.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let powers: Vec<f32> = logits.iter().map(|logit| (logit - most).exp()).collect();
    let sum: f64 = powers.iter().map(|&power| f64::from(power)).sum();
    powers.iter().map(|&power| (f64::from(power) / sum) as f32).collect()
}

/// The likeliest places. Their confidence is the share of a place's mass in that of all places and of what lies around, of
/// which a large picture has more than the network was taught with.
pub(super) fn peaks(field: &Field, probability: Vec<f32>, count: usize) -> Vec<Peak> {
    let cells = probability.len() as f64;
    let maps = model::Maps {
        width: field.columns,
        stride: field.stride,
        probability,
        radius: field.radius.clone(),
        log_scale: field.log_scale.clone(),
    };
    let mut found = model::peaks(&maps, count);
    let taken: f64 = found.iter().map(|peak| peak.confidence).sum();
    let all = taken + (1.0 - taken).max(0.0) * (CELLS / cells).min(1.0);
    found.iter_mut().for_each(|peak| peak.confidence = (peak.confidence / all).clamp(0.0, 1.0));
    found
}

fn candidate(reading: &Reading, camera: &Camera, radius: f64) -> Result<Candidate> {
    let centre = camera.ball_from_outline(&reading.outline, radius)?;
    Ok(Candidate {
        image: camera.image_from_camera(&centre)?.coords.into(),
        radius_px: reading.outline.radius,
        depth: centre.z,
        depth_sigma: reading.log_sigma * centre.z,
        world: camera.world_from_camera(&centre).coords.into(),
        confidence: reading.confidence,
    })
}

/// Covariance of the position in the world, m²: of the centre along each axis of the picture and of the depth.
fn covariance(reading: &Reading, camera: &Camera, image: &Point2<f64>, depth: f64) -> Result<[[f64; 3]; 3]> {
    let (_, jacobian): (Point3<f64>, Matrix3<f64>) = camera.world_from_image_with_jacobian(image, depth)?;
    let centre = (CENTRE_OF_RADIUS * reading.log_sigma * reading.outline.radius).powi(2);
    let own = Matrix3::from_diagonal(&[centre, centre, (reading.log_sigma * depth).powi(2)].into());
    let covariance = jacobian * own * jacobian.transpose();
    // Rounding leaves it symmetric only nearly.
    let symmetric = (covariance + covariance.transpose()) / 2.0;
    Ok(std::array::from_fn(|row| std::array::from_fn(|column| symmetric[(row, column)])))
}
