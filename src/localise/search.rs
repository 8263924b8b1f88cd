//! The search for balls in a picture, by a model that reads sizes: the first pass over the whole picture or a region, and the
//! entrances that other rooms use.

use image::RgbImage;
use nalgebra::Point2;

use super::candidate::{FirstPass, MAX_CANDIDATES};
use super::edge_refinement::refine_by_edge;
use super::volume_check::VolumeCheck;
use super::{Localiser, Maps, Region};
use crate::model::Peak;
use gravisight_geometry::camera::{Camera, Detection, Outline};
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::image::{Filter, Picture, resized};
use gravisight_geometry::size::Size;

/// Longer side of the reduced picture in which large balls are searched, px; the confidence by the first pass that a proposal needs there, and its
/// least radius, px; most proposals.
const LARGE_BALL_SIDE: u32 = 448;
const LARGE_BALL_CONFIDENCE: f64 = 0.03;
const LARGE_BALL_RADIUS: f64 = 2.5;
const LARGE_BALLS: usize = 3;
/// Factor by which a picture is reduced for a second search, for balls too large at its own resolution.
const REDUCTION: u32 = 4;
/// Smallest side of a picture that is searched reduced, px (of the reduced one).
const MIN_REDUCED_SIDE: u32 = 48;
/// Largest radius that is read at a picture's own resolution where a smaller one is there to be read, px.
const MAX_RADIUS: f64 = 45.0;
/// Candidates of the first pass at least: the confidence of the first depends on the others.
const MIN_CANDIDATES: usize = 8;
/// The same with a [`VolumeCheck`], which refuses some.
const MIN_CANDIDATES_CHECKED: usize = 30;

/// Result of the search in a picture.
pub(crate) struct SearchResult {
    /// Detections, the likeliest first.
    pub detections: Vec<Detection>,
    /// The network's maps, if requested.
    pub maps: Option<Maps>,
    /// Detections that cannot be the ball, the most confident first, and why.
    pub refused: Vec<(Detection, String)>,
}

impl Localiser {
    /// Detects the ball near `image`, with a radius of about `radius_px`; its centre may be up to `reach_px` from there (half a
    /// streak's length). `camera` took the picture; without one, balls are circles. None where the network detects no such ball.
    ///
    /// # Errors
    /// [`Error::Value`] where the model reads no sizes; [`Error::OutputNotFinite`] and [`Error::Device`].
    pub async fn detect_near(
        &self,
        picture: &Picture,
        camera: Option<&Camera>,
        image: [f64; 2],
        radius_px: f64,
        reach_px: f64,
    ) -> Result<Option<Detection>> {
        self.must_read_sizes()?;
        let outline = Outline { centre: image.into(), radius: radius_px };
        let found = self.detect_in_crop(picture.rgb(), None, &outline, reach_px.max(radius_px)).await?;
        Ok(found.map(|detection| refine_by_edge(picture.rgb(), camera, detection, &self.calibration())))
    }

    /// The large balls that a picture may show, however unlikely: one pass over it, reduced, and a crop about each proposal. `camera` took the picture,
    /// if that is known.
    ///
    /// # Errors
    /// As [`Self::detect_near`].
    #[doc(hidden)]
    pub async fn propose(&self, picture: &Picture, camera: Option<&Camera>) -> Result<Vec<Detection>> {
        let near = async |Outline { centre, radius }: &Outline| {
            self.detect_near(picture, camera, centre.coords.into(), *radius, *radius).await
        };
        let found = self.find_each(&self.detect_large(picture).await?, near).await?;
        Ok(found.into_iter().flatten().collect())
    }

    /// Rough outlines of large balls in a picture: one pass over it, reduced.
    ///
    /// # Errors
    /// As [`Self::detect_near`].
    async fn detect_large(&self, picture: &Picture) -> Result<Vec<Outline>> {
        self.must_read_sizes()?;
        let rgb = picture.rgb();
        let (width, height) = rgb.dimensions();
        let reduction = f64::from(width.max(height)) / f64::from(LARGE_BALL_SIDE);
        let side = |side: u32| ((f64::from(side) / reduction).round() as u32).max(1);
        let small = match reduction > 1.0 {
            true => &resized(rgb, [0, 0], picture.size(), Size::new(side(width), side(height)), Filter::Bilinear),
            false => rgb,
        };
        let up = |side: u32| side.div_ceil(self.config.input_multiple()) * self.config.input_multiple();
        let maps = self.output_maps_at(small, 0, 0, Size::new(up(small.width()), up(small.height()))).await?;
        let scale = [f64::from(width) / f64::from(small.width()), f64::from(height) / f64::from(small.height())];
        let found = maps.peaks(MIN_CANDIDATES).into_iter();
        let found = found.filter(|peak| peak.confidence >= LARGE_BALL_CONFIDENCE && peak.radius >= LARGE_BALL_RADIUS);
        let found = found.take(LARGE_BALLS).map(|peak| Outline {
            centre: Point2::from(std::array::from_fn(|axis| (peak.image[axis] + 0.5) * scale[axis] - 0.5)),
            radius: peak.radius * (scale[0] * scale[1]).sqrt(),
        });
        Ok(found.collect())
    }

    pub(crate) fn must_read_sizes(&self) -> Result<()> {
        if self.reads_size() {
            return Ok(());
        }
        let reason = format!("must be \"size\", as in `any`; `{}` knows only one scene", self.card.name);
        Err(Error::value("model", "depth_from", reason))
    }

    /// The `count` likeliest balls in (a `region` of) `picture` after both passes, of those that pass `check`. `camera` took the
    /// picture, if that is known. With `with_maps` also the heatmap and the apparent radii.
    ///
    /// # Errors
    /// [`Error::Value`] for a region outside the picture; [`Error::OutputNotFinite`] and [`Error::Device`].
    ///
    /// The centre of each detection lies in the region.
    pub(crate) async fn search(
        &self,
        picture: &Picture,
        camera: Option<&Camera>,
        region: Option<Region>,
        check: Option<&VolumeCheck<'_>>,
        count: usize,
        with_maps: bool,
    ) -> Result<SearchResult> {
        // More candidates, to replace those that the check refuses.
        let least = if check.is_some() { MIN_CANDIDATES_CHECKED } else { MIN_CANDIDATES };
        let FirstPass { mut candidates, maps, cells } =
            self.first_pass(picture, region, count.max(least), with_maps).await?;
        let mut refused = vec![];
        if let Some(check) = check {
            (candidates, refused) = check.partition(candidates);
        }
        candidates.truncate(count.max(MAX_CANDIDATES));
        let mut detections = self.second_pass(picture.rgb(), (camera, region), candidates, cells, count).await?;
        if let Some(check) = check {
            let (passed, failed) = check.partition(detections);
            detections = passed;
            refused.splice(0..0, failed);
            refused.sort_by(|(a, _), (b, _)| b.confidence.total_cmp(&a.confidence));
        }
        Ok(SearchResult { detections, maps, refused })
    }

    /// The first pass: `count` candidates or more.
    ///
    /// # Errors
    /// As [`Self::search`].
    pub(crate) async fn first_pass(
        &self,
        picture: &Picture,
        region: Option<Region>,
        count: usize,
        with_maps: bool,
    ) -> Result<FirstPass> {
        let size = picture.size();
        let region = region.unwrap_or(Region { left: 0, top: 0, width: size.width, height: size.height });
        region.check(size)?;
        let maps = self.output_maps(picture.rgb(), region).await?;
        let cells = maps.cells();
        let mut found = maps.peaks(count);
        let maps = with_maps.then(|| maps.over_picture(region, size));
        let large = self.large_peaks(picture.rgb(), region, count).await?;
        // Of two peaks of one ball one counts: that of the reduced picture, where the ball is large.
        let is_same =
            |a: &Peak, b: &Peak| (a.image[0] - b.image[0]).hypot(a.image[1] - b.image[1]) < a.radius.max(b.radius);
        found.retain(|peak| {
            let twin = large.iter().find(|other| is_same(peak, other));
            twin.is_none_or(|twin| peak.radius <= MAX_RADIUS && peak.confidence > twin.confidence)
        });
        let others: Vec<Peak> =
            large.into_iter().filter(|peak| !found.iter().any(|other| is_same(peak, other))).collect();
        found.extend(others);
        found.sort_by(|a, b| b.confidence.total_cmp(&a.confidence));
        let origin = [f64::from(region.left), f64::from(region.top)];
        let in_picture = |peak: Peak| Peak { image: [0, 1].map(|axis| peak.image[axis] + origin[axis]), ..peak };
        Ok(FirstPass { candidates: found.into_iter().map(|peak| in_picture(peak).into()).collect(), maps, cells })
    }

    /// The peaks of balls larger than [`MAX_RADIUS`] in a region's reduced picture, px of the region; none where that would be too
    /// small.
    async fn large_peaks(&self, rgb: &RgbImage, region: Region, count: usize) -> Result<Vec<Peak>> {
        let Region { left, top, width, height } = region;
        if width.min(height) / REDUCTION < MIN_REDUCED_SIDE {
            return Ok(vec![]);
        }
        let reduced = Size::new(width / REDUCTION, height / REDUCTION);
        let small = resized(rgb, [left, top], Size::new(width, height), reduced, Filter::Bilinear);
        let all = Region { left: 0, top: 0, width: reduced.width, height: reduced.height };
        let maps = self.output_maps(&small, all).await?;
        let scale = [f64::from(width) / f64::from(reduced.width), f64::from(height) / f64::from(reduced.height)];
        let up = |image: [f64; 2]| std::array::from_fn::<f64, 2, _>(|axis| (image[axis] + 0.5) * scale[axis] - 0.5);
        let peaks = maps.peaks(count).into_iter().map(|peak| Peak {
            image: up(peak.image),
            radius: peak.radius * (scale[0] * scale[1]).sqrt(),
            ..peak
        });
        Ok(peaks.filter(|peak| peak.radius > MAX_RADIUS).collect())
    }
}
