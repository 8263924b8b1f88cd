//! What physics says of a clip: depths for the network to learn, from 2D labels alone.

use nalgebra::{Point2, Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::super::recipe::FitConfig;
use gravisight_clips::{Clip, Frame};
use gravisight_geometry::error::{Error, Result};
use gravisight_physics::{ForecastOptions, Forecaster, Scene};
use gravisight_track::{Fit, FitOptions, FittedFrame, Observation};

/// What physics says of one frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TaughtFrame {
    /// 2D position, px of the clip's picture: the label and the fitted trajectory, by their certainties.
    pub image: [f64; 2],
    /// Depth (camera z), m.
    pub depth: f64,
    /// Standard deviation of the depth, m.
    pub sigma: f64,
}

/// What physics says of one clip.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TaughtClip {
    /// The clip's id.
    pub id: String,
    /// One a frame of the clip; none where the ball is not between its first and last label, or too uncertain.
    pub frames: Vec<Option<TaughtFrame>>,
    /// Labels that were left out, by [`FittedFrame::refused`]: outside the lens model, repeated, or another ball's. They teach nothing.
    #[serde(skip_serializing_if = "is_zero", default)]
    pub refused: usize,
    /// Why the clip teaches nothing, in words.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub left_out: Option<String>,
}

/// Fits the scene's physics to the labels of `clip`'s visible frames. What cannot be fitted teaches nothing, and
/// says why.
pub fn teach(clip: &Clip, config: &FitConfig) -> TaughtClip {
    let taught = fit(clip, config).and_then(|fit| {
        let refused = fit.frames.iter().filter(|frame| frame.refused.is_some()).count();
        Ok((taught_frames(clip, &fit, config)?, refused))
    });
    let ((frames, refused), left_out) = match taught {
        Ok(taught) => (taught, None),
        Err(error) => ((vec![None; clip.frames.len()], 0), Some(error.to_string())),
    };
    TaughtClip { id: clip.id.clone(), frames, refused, left_out }
}

fn is_zero(count: &usize) -> bool {
    *count == 0
}

/// The clip's trajectory.
fn fit(clip: &Clip, config: &FitConfig) -> Result<Fit> {
    let scene = scene_of(clip)?;
    let observations: Vec<Observation> = clip.frames.iter().map(observation).collect();
    let options = options(config);
    let fit = forecaster(scene, config.numeric)?.fit(&clip.camera, &observations, &options)?;
    let refuse = |reason: String| Err(Error::Fit { reason });
    if !fit.explained {
        return refuse(format!("no trajectory explains its labels ({:.2} px rms at best)", fit.rms_px));
    }
    // A label that was left out teaches nothing, but says nothing against the clip either.
    let refused = fit.frames.iter().filter(|frame| frame.refused.is_some()).count();
    let labelled = observations.iter().filter(|observation| observation.image.is_some()).count() - refused;
    let outliers = fit.frames.iter().filter(|frame| frame.outlier).count() - refused;
    if outliers as f64 > config.largest_outlier_fraction * labelled as f64 {
        return refuse(format!("{outliers} of its {labelled} labels do not belong to its trajectory"));
    }
    Ok(fit)
}

/// How the solver is asked to fit.
pub(super) fn options(config: &FitConfig) -> FitOptions {
    FitOptions { noise_px: config.noise_px, ..FitOptions::default() }
}

/// The clip's scene.
///
/// # Errors
/// [`Error::Data`] with the clip where it has none.
pub(super) fn scene_of(clip: &Clip) -> Result<&Scene> {
    let reason = "has no `scene`, which training with physics needs; give it one, or train with 3D labels";
    clip.scene.as_ref().ok_or_else(|| Error::Data { what: format!("clip `{}`", clip.id), reason: reason.into() })
}

/// The forecaster of a scene; `numeric` without closed forms.
pub(super) fn forecaster(scene: &Scene, numeric: bool) -> Result<Forecaster> {
    Forecaster::new(scene)?.with_options(ForecastOptions { closed_forms: !numeric, ..ForecastOptions::default() })
}

/// A frame as the fit sees it: labels of hidden balls are not clicked by anyone.
fn observation(frame: &Frame) -> Observation {
    let image = frame.image.filter(|_| frame.visible).map(Point2::from);
    Observation { time: frame.t, image, radius: None }
}

fn taught_frames(clip: &Clip, fit: &Fit, config: &FitConfig) -> Result<Vec<Option<TaughtFrame>>> {
    let labelled = |frame: &Frame| frame.visible && frame.image.is_some();
    let first = clip.frames.iter().position(labelled).unwrap_or(0);
    let last = clip.frames.iter().rposition(labelled).unwrap_or(0);
    let frames = clip.frames.iter().zip(&fit.frames).enumerate().map(|(index, (frame, fitted))| {
        let taught = taught_frame(clip, frame, fitted, fit.noise_px).filter(|_| fitted.refused.is_none())?;
        let sure = taught.sigma <= config.largest_sigma && (first..=last).contains(&index);
        Some(taught).filter(|taught| sure && taught.depth > 0.0 && in_picture(clip, taught.image))
    });
    let frames: Vec<Option<TaughtFrame>> = frames.collect();
    if frames.iter().flatten().next().is_some() {
        return Ok(frames);
    }
    let surest = fit.frames.iter().map(|frame| frame.sigma).fold(f64::INFINITY, f64::min);
    let reason = format!("its trajectory is too uncertain everywhere (1-σ of {surest:.2} m at best)");
    Err(Error::Fit { reason })
}

/// What the trajectory says of a frame; none where the ball has no image.
fn taught_frame(clip: &Clip, frame: &Frame, fitted: &FittedFrame, noise_px: f64) -> Option<TaughtFrame> {
    let position = fitted.world;
    let (projected, jacobian) = clip.camera.image_from_world_with_jacobian(&position).ok()?;
    let covariance = jacobian * fitted.covariance * jacobian.transpose();
    let fitted_variance = covariance.trace().max(0.0) / 2.0;
    // The label itself is one of the fit's observations; of the two the surer one counts more.
    let label = frame.image.filter(|_| frame.visible && !fitted.outlier).map(Point2::from);
    let image = label.map_or(projected, |label| {
        let trust = noise_px * noise_px / (noise_px * noise_px + fitted_variance);
        label + (projected - label) * trust
    });
    let along = view_axis(clip, &position);
    let variance = (along.transpose() * fitted.covariance * along).x;
    Some(TaughtFrame {
        image: image.into(),
        depth: clip.camera.camera_from_world(&position).z,
        sigma: variance.max(0.0).sqrt(),
    })
}

/// The camera's z axis in the world frame.
fn view_axis(clip: &Clip, position: &Point3<f64>) -> Vector3<f64> {
    let depth = |point: &Point3<f64>| clip.camera.camera_from_world(point).z;
    Vector3::from_fn(|axis, _| depth(&(position + Vector3::ith(axis, 1.0))) - depth(position))
}

fn in_picture(clip: &Clip, image: [f64; 2]) -> bool {
    let size = clip.camera.size().xy();
    image.iter().zip(size).all(|(&at, side)| (-0.5..side - 0.5).contains(&at))
}
