//! One picture, one camera, one model: the ball's 3D position.
//!
//! The only room that knows both model and camera.

mod candidate;
pub(crate) mod crop;
mod edge_refinement;
mod network;
mod output_maps;
mod saliency;
mod search;
mod second_pass;
mod size;
#[cfg(test)]
mod tests;
mod together;
pub(crate) mod verifier;
mod volume_check;

use std::sync::{Arc, Mutex};

use burn::tensor::Device;
use nalgebra::{Point2, Point3};
use serde::{Deserialize, Serialize};

use self::network::device_name;
pub use self::saliency::Saliency;
pub(crate) use self::together::{Position, Taken};
pub use crate::model::ConfidenceKind;
use crate::model::{self, Card, DetectionCalibration, Pen, PenConfig, PenRunner};
use gravisight_geometry::camera::Camera;
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::image::{MIN_SIDE, Picture};
use gravisight_geometry::size::Size;
use gravisight_geometry::volume::Volume;

/// A loaded model on a device, ready for pictures.
///
/// ```no_run
/// # async fn localised() -> gravisight::Result<()> {
/// use gravisight::{Camera, Card, Device, LocaliseOptions, Localiser, Picture};
///
/// # let [card, camera] = [""; 2];
/// # let [weights, png] = [(); 2].map(|()| Vec::new());
/// let localiser = Localiser::new(Card::from_json(card, "any.json")?, weights, &Device::flex())?;
/// let camera = Camera::from_json(camera, "camera.json")?;
/// let options = LocaliseOptions { ball_radius: Some(0.0335), ..LocaliseOptions::default() };
/// let ball = localiser.localise(&Picture::decode(&png)?, &camera, options).await?;
/// let [x, y, z] = ball.world;
/// println!("{x:.2} {y:.2} {z:.2} m; depth ± {:?} m; confidence {:.2}", ball.depth_sigma, ball.confidence);
/// # Ok(())
/// # }
/// ```
pub struct Localiser {
    pen: Pen,
    /// The verifier, where there is one.
    verifier: Option<Arc<Localiser>>,
    /// The motion network, where there is one.
    motion: Option<Arc<Localiser>>,
    /// The last used comes last.
    runners: Mutex<Vec<(Size, Arc<PenRunner>)>>,
    config: PenConfig,
    card: Card,
    device: Device,
}

/// Options of [`Localiser::localise`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LocaliseOptions {
    /// Return the network's maps, too ([`Localisation::maps`]).
    pub maps: bool,
    /// The ball's radius, m: a model that reads sizes needs it, others do not.
    pub ball_radius: Option<f64>,
    /// Search region: the whole picture if absent; with models that read sizes.
    pub region: Option<Region>,
    /// Number of candidates to return ([`Localisation::candidates`]); with models that read sizes.
    pub candidates: usize,
    /// Where the ball can be ([`Scene::volume`](gravisight_physics::Scene::volume)): detections outside are refused; with models that read sizes.
    pub volume: Option<Volume>,
}

/// A part of a picture, px.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(deny_unknown_fields)]
pub struct Region {
    /// Its first column.
    pub left: u32,
    /// Its first row.
    pub top: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl Region {
    /// Whether a point of the picture (px, the middle of the first pixel is 0) lies on one of its pixels.
    pub(crate) fn contains(&self, at: &Point2<f64>) -> bool {
        let within = |at: f64, start: u32, side: u32| {
            let start = f64::from(start) - 0.5;
            (start..=start + f64::from(side)).contains(&at)
        };
        within(at.x, self.left, self.width) && within(at.y, self.top, self.height)
    }

    /// Refuses a region that is not in a picture of `size`, or too small to show a ball.
    fn check(&self, size: Size) -> Result<()> {
        let Self { left, top, width, height } = *self;
        let fits = |start: u32, side: u32, all: u32| start.checked_add(side).is_some_and(|end| end <= all);
        if width.min(height) >= MIN_SIDE && fits(left, width, size.width) && fits(top, height, size.height) {
            return Ok(());
        }
        let reason = format!(
            "{width}×{height} px at ({left}, {top}) must lie in the {size} picture and have sides of at least {MIN_SIDE} px"
        );
        Err(Error::value("options", "region", reason))
    }
}

/// One of several detections that may be the ball.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct Candidate {
    /// 2D position, px.
    pub image: [f64; 2],
    /// Apparent radius, px.
    pub radius_px: f64,
    /// Camera z, m.
    pub depth: f64,
    /// Its standard deviation, m.
    pub depth_sigma: f64,
    /// Position in the world frame, m.
    pub world: [f64; 3],
    /// Confidence, 0 to 1, of the kind of [`Localisation::confidence_kind`]. Those of several candidates need not add up to 1.
    pub confidence: f64,
}

/// Where the ball is.
#[derive(Debug, Clone, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify), tsify(missing_as_null))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct Localisation {
    /// 2D position in the picture given, px (first pixel's centre is (0, 0)).
    pub image: [f64; 2],
    /// Camera z, m.
    pub depth: f64,
    /// Its standard deviation, m; none where the model does not say it.
    pub depth_sigma: Option<f64>,
    /// Semi-minor axis of the ball's outline, px; of a model that reads sizes.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(target_arch = "wasm32", tsify(optional))]
    pub radius_px: Option<f64>,
    /// Covariance of the position in the world frame, m², by row; of a model that reads sizes.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(target_arch = "wasm32", tsify(optional))]
    pub covariance: Option<[[f64; 3]; 3]>,
    /// Position in the camera frame, m.
    pub camera: [f64; 3],
    /// Position in the world frame, m.
    pub world: [f64; 3],
    /// Whether a ball was found: its confidence reaches the model's `confidence_threshold`, and it lies in the volume in which it can be. If
    /// not, the position is that of the likeliest detection, and is not to be used.
    pub ball_found: bool,
    /// Confidence of the detection, 0 to 1, of the kind of [`Self::confidence_kind`]. Below the card's
    /// `confidence_threshold` no ball is found ([`Self::ball_found`]).
    pub confidence: f64,
    /// What the confidence is.
    pub confidence_kind: ConfidenceKind,
    /// The likeliest detections, the one above first; if requested ([`LocaliseOptions::candidates`]).
    #[serde(skip_serializing_if = "Vec::is_empty")]
    #[cfg_attr(target_arch = "wasm32", tsify(optional))]
    pub candidates: Vec<Candidate>,
    /// What a user should know about this result, in words.
    pub notes: Vec<String>,
    /// The network's maps, if requested.
    #[serde(skip)]
    pub maps: Option<Maps>,
}

/// The network's maps over the whole picture (where it was padded to the input's shape, to within a
/// cell); row-major.
#[derive(Debug, Clone)]
pub struct Maps {
    /// Cells in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Probability of each cell.
    pub heatmap: Vec<f32>,
    /// Depth (camera z) of each cell, m.
    pub depth: Vec<f32>,
}

impl Localisation {
    /// Notes what is doubtful about `camera` before points of the scene (m), beyond what was noted without them.
    pub fn doubt(&mut self, camera: &Camera, around: &[Point3<f64>]) {
        let new: Vec<String> =
            camera.doubts(None, around).into_iter().filter(|doubt| !self.notes.contains(doubt)).collect();
        self.notes.extend(new);
    }

    /// Distance to the true position in the world frame, m: DtG of one picture (paper, "Evaluation Metrics").
    pub fn dtg(&self, truth: [f64; 3]) -> f64 {
        nalgebra::distance(&self.world.into(), &truth.into())
    }
}

impl Localiser {
    /// Loads `weights` on `device` after checking them against `card`.
    ///
    /// # Errors
    /// [`Error::WeightsFile`], [`Error::WeightsSha256`], [`Error::WeightsArchitecture`],
    /// [`Error::WeightsNotFinite`].
    pub fn new(card: Card, weights: Vec<u8>, device: &Device) -> Result<Self> {
        card.check_weights(&weights)?;
        let [own, verifier, motion] = model::parted(&weights)?;
        let pen = model::load(&card.architecture, own, device)?;
        Self::of_parts(&card, pen, &[verifier, motion], device)
    }

    /// A localiser from a network already in memory.
    #[doc(hidden)]
    pub fn from_pen(pen: Pen, card: Card, device: &Device) -> Self {
        let config = pen.config().clone();
        let runners = Mutex::new(vec![(card.input, Arc::new(pen.clone().runner(card.input, device)))]);
        Self { pen, verifier: None, motion: None, runners, config, card, device: device.clone() }
    }

    /// Of a network in memory, and the weights of the verifier and the motion network that `card` names.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub(crate) fn of_parts(card: &Card, pen: Pen, beside: &[Vec<u8>; 2], device: &Device) -> Result<Self> {
        let [verifier, motion] = beside;
        let verifier = Self::second(card, &card.verifier, verifier.clone(), model::VERIFIER_SIDE, device)?;
        let motion = Self::second(card, &card.motion, motion.clone(), model::MOTION_SIDE, device)?;
        Ok(Self { verifier, motion, ..Self::from_pen(pen, card.clone(), device) })
    }

    /// Another network of the model of `card`, where it has one.
    fn second(
        card: &Card,
        architecture: &Option<PenConfig>,
        weights: Vec<u8>,
        side: u32,
        device: &Device,
    ) -> Result<Option<Arc<Self>>> {
        let Some(architecture) = architecture.clone() else { return Ok(None) };
        let pen = model::load(&architecture, weights, device)?;
        let card = Card { architecture, verifier: None, motion: None, input: Size::square(side), ..card.clone() };
        Ok(Some(Arc::new(Self::from_pen(pen, card, device))))
    }

    /// The same with the verifier and the motion network of `other`.
    pub(crate) fn with_networks_of(self, other: &Self) -> Self {
        Self { verifier: other.verifier.clone(), motion: other.motion.clone(), ..self }
    }

    /// Whether the model reads apparent sizes, and needs the ball's radius.
    pub fn reads_size(&self) -> bool {
        self.config.depth.is_size()
    }

    /// The weights behind confidence and σ.
    fn calibration(&self) -> DetectionCalibration {
        self.card.calibration.unwrap_or_default()
    }

    /// The model's card.
    pub fn card(&self) -> &Card {
        &self.card
    }

    /// Radius around the position found within which a heatmap's mass counts ([`ConfidenceKind::HeatmapMass`]), px of a picture of
    /// `size`.
    pub fn confidence_radius(&self, size: Size) -> f64 {
        if self.reads_size() {
            return model::CONFIDENCE_RADIUS;
        }
        let ([width, height], [columns, rows]) = (size.xy(), self.card.input.xy());
        model::CONFIDENCE_RADIUS * (width / columns).max(height / rows)
    }

    /// The ball's position in `picture`, taken by `camera` (scaled to the picture where the aspect
    /// ratio agrees).
    ///
    /// # Errors
    /// [`Error::CameraMismatch`] for a camera of another aspect ratio; [`Error::OutputNotFinite`]
    /// and [`Error::Device`] for a device that fails; [`Error::Distortion`] for a position outside
    /// the lens model's range; [`Error::Value`] for a ball's radius that is missing or not one in metres, a region outside
    /// the picture, and for options that the model cannot follow.
    pub async fn localise(&self, picture: &Picture, camera: &Camera, options: LocaliseOptions) -> Result<Localisation> {
        if self.reads_size() {
            return self.localise_by_size(picture, camera, options).await;
        }
        let given = [
            ("region", options.region.is_some()),
            ("candidates", options.candidates > 0),
            ("volume", options.volume.is_some()),
        ];
        for (field, given) in given {
            if given {
                let reason =
                    format!("is only for models that measure apparent size; `{}` takes whole pictures", self.card.name);
                return Err(Error::value("options", field, reason));
            }
        }
        let size = picture.size();
        let Taken { values, view } = self.take(picture, camera)?;
        let raw = self.run(values).await?;
        let (image, in_camera) = view.position(raw.image, raw.depth)?;
        let in_world = view.camera.world_from_camera(&in_camera);
        let stride = self.config.output_stride();
        let mut notes = picture.notes().to_vec();
        if size != camera.size() {
            notes.push(format!(
                "camera.json is for a {} picture; it was scaled to this picture's {size}",
                camera.size()
            ));
        }
        notes.extend(camera.doubts(None, &[]));
        let confidence = model::confidence(&raw.probability, raw.width, stride, raw.image);
        let not_found = self.below_threshold(confidence);
        let ball_found = not_found.is_none();
        notes.extend(not_found);
        Ok(Localisation {
            image,
            depth: raw.depth,
            depth_sigma: None,
            radius_px: None,
            covariance: None,
            candidates: vec![],
            camera: in_camera.coords.into(),
            world: in_world.coords.into(),
            ball_found,
            confidence,
            confidence_kind: self.card.confidence_kind(),
            notes,
            maps: options.maps.then(|| raw.maps(view.content, stride)),
        })
    }

    /// Why no ball is found where the confidence is as low as this.
    fn below_threshold(&self, confidence: f64) -> Option<String> {
        let threshold = self.card.confidence_threshold.filter(|&threshold| confidence < threshold)?;
        Some(format!(
            "no ball found: the confidence is below the model's threshold of {threshold:.2}; the position is that of \
             the likeliest detection"
        ))
    }
}
