//! What is returned of a court that was searched.

use nalgebra::{Matrix3, Point3};
use serde::Serialize;

use super::judge::IS_SEEN;
use super::model::SINGLES;
use super::verdict::CourtVerdict;
use super::{Candidate, WORKING_SIDE};
use crate::camera::{Calibration, Camera, Court, CourtLine, Distortion, Points, Unknowns, calibrate_by_lines};
use crate::error::{Error, Result};
use crate::image::Picture;
use crate::size::Size;

/// 1-σ of where a found camera puts the court's points, as a fraction of the picture's width. Measured on 29 scenes with clicks: most are
/// within 0.1 to 0.5 % at their worst point.
const SIGMA: f64 = 0.002;

/// Other cameras less probable than this are not worth a look.
const LEAST_OTHER: f64 = 0.01;

/// A court that [`find_court`](super::find_court) searched in a picture.
#[derive(Debug, Clone, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify), tsify(missing_as_null))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct FoundCourt {
    /// How far the camera can be trusted.
    pub verdict: CourtVerdict,
    /// Probability that the camera puts every point of the court in view within 1 % of the picture's width of its place; 0 where no camera
    /// fits.
    pub probability: f64,
    /// Why, in words.
    pub reason: String,
    /// The court's name; `tennis-singles` for a tennis court without the side lines for doubles.
    pub court: String,
    /// The camera, for pictures of the given size; null where no court was found. It stands at the near end of the court: a half-turn of
    /// the court looks the same.
    pub camera: Option<Camera>,
    /// The lines searched for, in the order of the court's; a table's are followed by the tape of its net. Empty where no camera fits.
    pub lines: Vec<FoundLine>,
    /// How well the best camera fits: length of lines seen less what is missing or unexplained, in picture widths.
    pub score: f64,
    /// Score of the best camera that puts the court elsewhere; 0 where there is none.
    pub runner_up: f64,
    /// Fraction of the length of the lines in view that is seen, 0 to 1.
    pub recall: f64,
    /// Fraction of what lies just beyond the lines' ends that is painted as well, 0 to 1; about 0 for the right court.
    pub beyond: f64,
    /// Root mean square distance of the lines from the paint, px of the given picture.
    pub rms_px: f64,
    /// 1-σ of where the camera puts the court's points, px of the given picture; 0 where no camera fits.
    pub sigma_px: f64,
    /// Other cameras that may be the right one, the likeliest first: another position of the same court, or another court. A half-turn of
    /// the court is none.
    pub others: Vec<OtherCourt>,
}

/// Another camera that the lines of a picture fit.
#[derive(Debug, Clone, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct OtherCourt {
    /// The court's name, as in [`FoundCourt::court`].
    pub court: String,
    /// The camera, for pictures of the given size.
    pub camera: Camera,
    /// Probability that it is the right one, as in [`FoundCourt::probability`].
    pub probability: f64,
}

/// A painted line of a court that was searched.
#[derive(Debug, Clone, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct FoundLine {
    /// The line, as it is on this court.
    pub line: CourtLine,
    /// Whether the best camera has it in view.
    pub is_expected: bool,
    /// Whether it was found there.
    pub is_seen: bool,
    /// Fraction of it in the picture that is seen, 0 to 1.
    pub fraction: f64,
}

impl Candidate {
    /// The camera of pictures of the `given` size, from the view of the `working` one.
    ///
    /// # Errors
    /// As [`Camera::new`].
    pub(super) fn camera(&self, working: Size, given: Size) -> Result<Camera> {
        let Self { view, bend, .. } = self;
        let unit = f64::from(working.width.max(working.height));
        let [x, y] = view.centre.into();
        let intrinsic = Matrix3::new(view.focal, 0.0, x, 0.0, view.focal, y, 0.0, 0.0, 1.0);
        // In focal lengths instead of widths.
        let distortion = Distortion { k1: bend * (view.focal / unit).powi(2), ..Distortion::default() };
        Camera::new(working, intrinsic, distortion, view.rotation, view.translation)?.resized(given)
    }
}

impl FoundCourt {
    /// No court, and no camera that fits one.
    pub(super) fn none(court: &str, reason: String) -> Result<Self> {
        Ok(Self {
            verdict: CourtVerdict::None,
            probability: 0.0,
            reason,
            court: court.into(),
            camera: None,
            lines: Vec::new(),
            score: 0.0,
            runner_up: 0.0,
            recall: 0.0,
            beyond: 0.0,
            rms_px: 0.0,
            sigma_px: 0.0,
            others: Vec::new(),
        })
    }

    /// From cameras of the working picture, the likeliest first, with their probabilities, to those of the given picture.
    ///
    /// # Errors
    /// As [`Camera::new`].
    pub(super) fn of(mut all: Vec<(Candidate, f64)>, working: Size, given: Size) -> Result<Self> {
        let others = all.split_off(1);
        let [(best, probability)] =
            <[_; 1]>::try_from(all).map_err(|_| Error::Calibration { reason: String::new() })?;
        let verdict = best.case().verdict(probability);
        let camera = match verdict {
            CourtVerdict::None => None,
            _ => Some(best.camera(working, given)?),
        };
        let others = others.into_iter().filter(|(_, probability)| *probability >= LEAST_OTHER);
        let others = others.map(|(other, probability)| {
            Ok(OtherCourt { camera: other.camera(working, given)?, court: other.model.name, probability })
        });
        let reason = best.case().reason(verdict);
        let Candidate { model, features, runner_up, rms, .. } = best;
        let lines = model.painted.into_iter().zip(&features.lines);
        let found_line = |(line, &(is_expected, fraction)): (CourtLine, &(bool, f64))| {
            let is_seen = is_expected && fraction > IS_SEEN;
            FoundLine { line, is_expected, is_seen, fraction }
        };
        let longer_side = f64::from(given.width.max(given.height));
        Ok(Self {
            verdict,
            probability,
            reason,
            court: model.name,
            camera,
            lines: lines.map(found_line).collect(),
            score: features.score,
            runner_up,
            recall: features.recall,
            beyond: features.beyond,
            rms_px: rms * longer_side / f64::from(WORKING_SIDE),
            sigma_px: SIGMA * longer_side,
            others: others.collect::<Result<_>>()?,
        })
    }

    /// The court's points where the camera puts them in the picture, and its lines, as if they had been clicked; [`None`] where no court
    /// was found.
    pub fn points(&self) -> Option<Points> {
        let camera = self.camera.as_ref()?;
        let mut points = Points::new(camera.size());
        points.distortion = *camera.distortion();
        points.sigma = Some(self.sigma_px);
        points.lines = self.lines.iter().map(|found| found.line.clone()).collect();
        let court = self.court.strip_suffix(SINGLES).unwrap_or(&self.court);
        let [width, height] = camera.size().xy();
        for (name, &at) in &Court::named(court).ok()?.points {
            let Ok(image) = camera.image_from_world(&Point3::from(at)) else { continue };
            if image.x >= 0.0 && image.y >= 0.0 && image.x < width && image.y < height {
                points.names.push(name.clone());
                points.world.push(at.into());
                points.image.push(image);
            }
        }
        Some(points)
    }

    /// The camera refined by the court's lines in the same picture, as
    /// [`calibrate_by_lines`] does from clicks. A lens that was found is estimated as well.
    ///
    /// # Errors
    /// [`Error::Calibration`] with [`Self::reason`] where no court was found, else as [`calibrate_by_lines`].
    pub fn calibrate(&self, picture: &Picture, unknowns: &Unknowns) -> Result<Calibration> {
        let points = self.points().ok_or_else(|| Error::Calibration { reason: self.reason.clone() })?;
        calibrate_by_lines(&points, unknowns, picture)
    }
}
