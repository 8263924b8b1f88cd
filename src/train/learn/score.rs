//! Scores of a network on clips it does not learn from.

use nalgebra::{Matrix6, Point2, Point3, Vector3, Vector6, distance};
use serde::Serialize;

use super::super::examples::Pictures;
#[cfg(not(target_arch = "wasm32"))]
use super::super::examples::{LabelledCrop, Renderings};
use super::laws::LearnedLaws;
use crate::evaluate::Statistic;
use crate::localise::{LocaliseOptions, Localiser, Position};
use gravisight_clips::Clip;
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::image::Picture;
use gravisight_geometry::statistics::median;
use gravisight_physics::{Forecaster, State};
#[cfg(not(target_arch = "wasm32"))]
use gravisight_synth::Apparent;

/// Frames on each side of a frame from whose positions its velocity is found.
const REACH: usize = 5;
/// Fewest positions that a state is fitted to.
const FEWEST: usize = 5;
/// Frames from a state to the label that its forecast must meet (the paper's largest Δn).
const AHEAD: usize = 15;
/// Gauss–Newton steps of a state's fit; the first comes within millimetres.
const FIT_STEPS: usize = 3;

/// Fraction of the visible balls whose confidence may be lower than the one stated.
const BELOW: f64 = 0.005;

/// How good a network is.
#[derive(Debug, Clone, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify), tsify(rename = "TuneScore", missing_as_null))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct Score {
    /// Median forecast error, px: a state is fitted to the network's positions in t ± 5 frames by the scene's physics,
    /// and its forecasts at t ± 15 frames are compared with the 2D labels. Needs no 3D truth, and orders networks as
    /// their distance to the truth does. A forecast that fails counts as infinite. Absent where no clip has a scene
    /// or is long enough.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(target_arch = "wasm32", tsify(optional))]
    pub forecast_px: Option<f64>,
    /// Confidence that all but 0.5 % of the visible balls exceed.
    pub least_confidence: f64,
    /// 2D error, px.
    pub image_error_px: Statistic,
    /// Distance to ground truth, m; without values where the clips have no 3D truth. For looking at, not for choosing.
    pub dtg: Statistic,
}

/// Scores `localiser` on about `frames` frames of the clips of `pictures`: whole clips, evenly spread; on all where absent.
/// Their scenes are under `laws`.
///
/// # Errors
/// [`Error::Data`] where no frame has a label, and for a picture that cannot be localised; as
/// [`Pictures::with`].
pub async fn score(
    localiser: &Localiser,
    pictures: &Pictures,
    frames: Option<usize>,
    laws: &LearnedLaws,
) -> Result<Score> {
    let clips = pictures.clips();
    let count = frames.map_or(clips.len(), |frames| clips_with(frames, clips));
    let (mut forecast, mut image, mut dtg, mut confidence) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for index in 0..count {
        let clip = index * clips.len() / count;
        let found = positions(localiser, pictures, clip).await?;
        let clip = &clips[clip];
        for (frame, found) in clip.frames.iter().zip(&found) {
            let (Some(found), Some(label)) = (found, frame.image) else { continue };
            confidence.push(found.confidence);
            image.push(distance(&found.image, &Point2::from(label)));
            dtg.extend(frame.world.map(|truth| distance(&found.world, &Point3::from(truth))));
        }
        if let Some(scene) = &clip.scene {
            forecast.extend(forecast_errors(clip, &Forecaster::new(&laws.scene(scene))?, &found));
        }
    }
    if image.is_empty() {
        let reason = "no frame shows the ball (`visible`: true), so there is nothing to score against".into();
        return Err(Error::Data { what: "validation clips".into(), reason });
    }
    confidence.sort_by(f64::total_cmp);
    Ok(Score {
        forecast_px: median(forecast),
        least_confidence: confidence[(BELOW * confidence.len() as f64) as usize],
        image_error_px: Statistic::of(image),
        dtg: Statistic::of(dtg),
    })
}

/// How many of `clips` hold about `frames` frames, if they are alike: at least one.
pub(super) fn clips_with(frames: usize, clips: &[Clip]) -> usize {
    let all: usize = clips.iter().map(|clip| clip.frames.len()).sum();
    // Counts of frames may be as large as a `usize` holds: all that there are.
    (frames.min(all) * clips.len()).div_ceil(all.max(1)).clamp(1, clips.len())
}

/// How good a network is that reads sizes, on renderings of random scenes.
#[derive(Debug, Clone, Serialize)]
pub struct SizeScore {
    /// Median error of the radius as a fraction of it: of balls of at least 4 px, wholly seen.
    pub radius_error: f64,
    /// The same error of all balls.
    pub radius_error_of_all: Statistic,
    /// Fraction of all balls whose radius is off by more than 30 %.
    pub gross: f64,
    /// Fractions of all balls whose error is within one and two of the stated standard deviations.
    pub coverage: [f64; 2],
    /// 2D error, px.
    pub image_error_px: Statistic,
    /// Confidence that as large a fraction of the balls (wholly seen, of at least 4 px) stays below as of the pictures without
    /// a ball exceeds.
    pub confidence_threshold: f64,
    /// That fraction.
    pub confused: f64,
}

/// Smallest radius of the balls whose error counts, px.
#[cfg(not(target_arch = "wasm32"))]
const COUNTED_RADIUS: f64 = 4.0;
/// Fraction of a ball that must be seen for it to count as wholly seen.
#[cfg(not(target_arch = "wasm32"))]
const WHOLLY: f64 = 0.98;
/// Error beyond which a radius is grossly wrong.
#[cfg(not(target_arch = "wasm32"))]
const GROSS: f64 = 0.3;

/// Scores `localiser` on `count` renderings.
///
/// # Errors
/// As [`Localiser::search`].
#[cfg(not(target_arch = "wasm32"))]
pub async fn score_sizes(localiser: &Localiser, renderings: &Renderings, count: usize) -> Result<SizeScore> {
    let (mut counted, mut errors, mut image) = (vec![], vec![], vec![]);
    let (mut seen, mut empty) = (vec![], vec![]);
    let mut within = [0_usize; 2];
    for index in 0..count {
        let drawing = renderings.scored(index);
        let found =
            localiser.search(&Picture::from_rgb(drawing.picture()), None, None, None, 1, false).await?.detections;
        let Some(found) = found.first() else { continue };
        // Of several in a photograph the nearest.
        let off = |ball: &Apparent| distance(&found.outline.centre, &Point2::from(ball.centre));
        let Some(ball) = drawing.balls.iter().min_by(|a, b| off(a).total_cmp(&off(b))) else {
            empty.push(found.confidence);
            continue;
        };
        let error = (found.outline.radius / ball.radius).ln();
        image.push(off(ball));
        if !ball.is_sized {
            continue;
        }
        errors.push(error.exp_m1().abs());
        for (number, within) in within.iter_mut().enumerate() {
            *within += usize::from(error.abs() <= (number + 1) as f64 * found.log_sigma);
        }
        if ball.visible >= WHOLLY && ball.radius >= COUNTED_RADIUS {
            seen.push(found.confidence);
            counted.push(error.exp_m1().abs());
        }
    }
    let (confidence_threshold, confused) = equal_error(&mut seen, &mut empty);
    let all = errors.len().max(1) as f64;
    Ok(SizeScore {
        radius_error: median(counted).unwrap_or(f64::NAN),
        gross: errors.iter().filter(|&&error| error > GROSS).count() as f64 / all,
        coverage: within.map(|count| count as f64 / all),
        radius_error_of_all: Statistic::of(errors),
        image_error_px: Statistic::of(image),
        confidence_threshold,
        confused,
    })
}

/// Scores `localiser`, a verifier or a motion network, on `count` groups of crops.
///
/// # Errors
/// As [`Localiser::search`].
#[cfg(not(target_arch = "wasm32"))]
pub async fn score_crops(
    localiser: &Localiser,
    crops: &dyn Fn(usize) -> Result<Vec<LabelledCrop>>,
    count: usize,
) -> Result<SizeScore> {
    let (mut errors, mut image, mut seen, mut empty) = (vec![], vec![], vec![], vec![]);
    let mut within = [0_usize; 2];
    for index in 0..count {
        for crop in crops(index)? {
            let found = localiser.verifier_detections(&crop.views).await?;
            let Some(found) = found.first() else { continue };
            let Some(ball) = crop.ball() else {
                empty.push(found.confidence);
                continue;
            };
            let error = (found.outline.radius / ball.radius).ln();
            image.push(distance(&found.outline.centre, &ball.centre));
            errors.push(error.exp_m1().abs());
            for (number, within) in within.iter_mut().enumerate() {
                *within += usize::from(error.abs() <= (number + 1) as f64 * found.log_sigma);
            }
            seen.push(found.confidence);
        }
    }
    let (confidence_threshold, confused) = equal_error(&mut seen, &mut empty);
    let all = errors.len().max(1) as f64;
    let of_all = Statistic::of(errors.clone());
    Ok(SizeScore {
        radius_error: of_all.median.unwrap_or(f64::NAN),
        gross: errors.iter().filter(|&&error| error > GROSS).count() as f64 / all,
        coverage: within.map(|count| count as f64 / all),
        radius_error_of_all: of_all,
        image_error_px: Statistic::of(image),
        confidence_threshold,
        confused,
    })
}

/// The threshold below which as large a fraction of `seen` lies as of `empty` lies above, and that fraction.
#[cfg(not(target_arch = "wasm32"))]
fn equal_error(seen: &mut [f64], empty: &mut [f64]) -> (f64, f64) {
    seen.sort_by(f64::total_cmp);
    empty.sort_by(f64::total_cmp);
    let below =
        |values: &[f64], at: f64| values.partition_point(|&value| value < at) as f64 / values.len().max(1) as f64;
    let missed = |at: f64| below(seen, at);
    let taken = |at: f64| 1.0 - below(empty, at);
    let crossing = seen.iter().copied().find(|&at| missed(at) >= taken(at)).unwrap_or(0.5);
    (crossing, missed(crossing).max(taken(crossing)))
}

/// Pictures that a network sees at once.
const TOGETHER: usize = 32;

/// What the network finds in each frame that shows the ball.
async fn positions(localiser: &Localiser, pictures: &Pictures, number: usize) -> Result<Vec<Option<Position>>> {
    let clip = &pictures.clips()[number];
    let shown: Vec<usize> = (0..clip.frames.len()).filter(|&index| clip.frames[index].visible).collect();
    let name = |index: usize| format!("clip `{}`, frame {}", clip.id, clip.frames[index].file.display());
    let failed = |index: usize, error: Error| Error::Data { what: name(index), reason: error.to_string() };
    let mut found: Vec<Option<Position>> = clip.frames.iter().map(|_| None).collect();
    if localiser.reads_size() {
        for index in shown {
            let picture = pictures.with(number, index, Picture::clone)?;
            let ball_radius = clip.scene.as_ref().map(|scene| scene.ball.radius);
            let options = LocaliseOptions { ball_radius, ..LocaliseOptions::default() };
            let ball = localiser.localise(&picture, &clip.camera, options).await;
            let ball = ball.map_err(|error| failed(index, error))?;
            let (world, image) = (Point3::from(ball.world), Point2::from(ball.image));
            found[index] = Some(Position { image, world, confidence: ball.confidence });
        }
        return Ok(found);
    }
    for together in shown.chunks(TOGETHER) {
        let mut taken = Vec::with_capacity(together.len());
        for &index in together {
            let picture = pictures.with(number, index, |picture| localiser.take(picture, &clip.camera))?;
            taken.push(picture.map_err(|error| failed(index, error))?);
        }
        let positions = localiser.positions(taken).await.map_err(|error| failed(together[0], error))?;
        for (&index, position) in together.iter().zip(positions) {
            found[index] = Some(position.map_err(|error| failed(index, error))?);
        }
    }
    Ok(found)
}

/// Forecast errors of all frames from which a label is within reach, px.
fn forecast_errors(clip: &Clip, forecaster: &Forecaster, found: &[Option<Position>]) -> Vec<f64> {
    let frames = &clip.frames;
    let mut errors = Vec::new();
    for middle in 0..frames.len() {
        let near = middle.saturating_sub(REACH)..(middle + REACH + 1).min(frames.len());
        let points: Vec<(f64, Point3<f64>)> =
            near.filter_map(|frame| Some((frames[frame].t - frames[middle].t, found[frame].as_ref()?.world))).collect();
        if points.len() < FEWEST || found[middle].is_none() {
            continue;
        }
        let state = fitted(forecaster, &points, frames[middle].t - frames[0].t);
        let later = [middle.checked_sub(AHEAD), Some(middle + AHEAD)].into_iter().flatten();
        for other in later.filter(|&other| other < frames.len()) {
            let Some(label) = frames[other].image.filter(|_| frames[other].visible) else { continue };
            let error = state.and_then(|state| {
                let forecast = forecaster.forecast(&state, &[frames[other].t - frames[middle].t]);
                let image = clip.camera.image_from_world(&forecast.states.first()?.position).ok()?;
                Some(distance(&image, &Point2::from(label)))
            });
            errors.push(error.filter(|error| error.is_finite()).unwrap_or(f64::INFINITY));
        }
    }
    errors
}

/// The state at time 0, `since_start` s after the clip's first frame, whose trajectory passes nearest to `points` (s, m),
/// by least squares.
pub(super) fn fitted(forecaster: &Forecaster, points: &[(f64, Point3<f64>)], since_start: f64) -> Option<State> {
    let (first, last) = (points.first()?, points.last()?);
    let nearest = points.iter().min_by(|a, b| a.0.abs().total_cmp(&b.0.abs()))?;
    let velocity = (last.1 - first.1) / (last.0 - first.0);
    let mut state = forecaster.scene().in_flight(nearest.1, velocity, since_start);
    let times: Vec<f64> = points.iter().map(|(time, _)| *time).collect();
    for _ in 0..FIT_STEPS {
        let forecast = forecaster.forecast_with_jacobians(&state, &times);
        if forecast.states.len() != times.len() {
            return None;
        }
        let (mut normal, mut right) = (Matrix6::zeros(), Vector6::zeros());
        for ((at, jacobian), (_, point)) in forecast.states.iter().zip(&forecast.jacobians).zip(points) {
            let rows = jacobian.fixed_view::<3, 6>(0, 0);
            normal += rows.transpose() * rows;
            right += rows.transpose() * (point - at.position);
        }
        let step = normal.cholesky()?.solve(&right);
        state.position += Vector3::new(step[0], step[1], step[2]);
        state.velocity += Vector3::new(step[3], step[4], step[5]);
    }
    Some(state)
}
