//! The model that a training makes: which weights, and what their card says. Runs and fine-tunings share it.

use super::super::examples::Examples;
#[cfg(not(target_arch = "wasm32"))]
use super::super::examples::Source;
use super::super::recipe::{Recipe, Select};
#[cfg(not(target_arch = "wasm32"))]
use super::super::recipe::{Supervision, Velocity};
use super::score::Score;
#[cfg(not(target_arch = "wasm32"))]
use crate::model::DepthFrom;
use crate::model::{self, Card, Pen, sha256_hex};
#[cfg(not(target_arch = "wasm32"))]
use crate::model::{CARD_VERSION, PenConfig};
use gravisight_geometry::error::Result;
#[cfg(not(target_arch = "wasm32"))]
use gravisight_synth::{LARGEST, SMALLEST};

/// The averaged weights that scored best so far.
#[derive(Debug, Clone)]
pub struct Best {
    /// Their forecast error, px, their DtG, m, or of what reads sizes the radius's error; less is better. Absent where there is none to
    /// be had: then the last count as best.
    pub score: Option<f64>,
    /// Confidence below which a picture is taken to be without the ball.
    pub confidence_threshold: f64,
    /// The network.
    pub average: Pen,
}

impl Best {
    /// Puts the weights `average` in the place of `best` unless that is better by what `select` names: whether it did.
    pub fn keep(best: &mut Option<Self>, scored: &Score, select: Select, average: Pen) -> bool {
        let score = match select {
            Select::Forecast => scored.forecast_px,
            Select::Dtg => scored.dtg.mean,
        };
        Self::keep_by(best, score, scored.least_confidence / 2.0, average)
    }

    /// The same, of any score of which less is better.
    pub fn keep_by(best: &mut Option<Self>, score: Option<f64>, confidence_threshold: f64, average: Pen) -> bool {
        let score = score.filter(|score| score.is_finite());
        let beaten = best.as_ref().is_none_or(|best| match (score, best.score) {
            (Some(new), Some(old)) => new < old,
            (new, old) => new.is_some() || old.is_none(),
        });
        if beaten {
            *best = Some(Self { score, confidence_threshold, average });
        }
        beaten
    }
}

/// The model made, in half precision: the `best` weights (where none could be scored: the `last`), and `card` with what is
/// known of them.
///
/// # Errors
/// [`Error::WeightsFile`](gravisight_geometry::error::Error::WeightsFile) where the weights cannot be written;
/// [`Error::Device`](gravisight_geometry::error::Error::Device) where they cannot be read.
pub async fn publish(card: Card, best: Option<&Best>, last: Pen) -> Result<(Card, Vec<u8>)> {
    let pen = best.map_or(&last, |best| &best.average);
    let weights = model::halved(&model::save(&model::on_cpu(pen).await?)?)?;
    let card = Card {
        weights: format!("{}.safetensors", card.name),
        sha256: sha256_hex(&weights),
        confidence_threshold: best.map(|best| best.confidence_threshold).or(card.confidence_threshold),
        metrics: serde_json::Value::Null,
        ..card
    };
    Ok((card, weights))
}

/// The card of a run's model, but for its weights; `data` names the training data where the recipe does not.
#[cfg(not(target_arch = "wasm32"))]
pub fn card_of_run(recipe: &Recipe, data: String, source: &Source, architecture: &PenConfig) -> Card {
    let depth_range = match source {
        Source::Clips(sampler) if !architecture.depth.is_size() => {
            let [nearest, _, farthest] = sampler.examples().depths();
            Some([nearest, farthest])
        }
        _ => None,
    };
    let training_data = match source {
        Source::Clips(sampler) => {
            let data = recipe.data_name.clone().unwrap_or(data);
            format!("{data}: {} frames", sampler.examples().frames.len())
        }
        Source::Motion(stacks) => {
            format!("{}: {} stacks of frames", recipe.data_name.clone().unwrap_or(data), stacks.count())
        }
        Source::Scenes(_) | Source::Candidates(_) => {
            let pictures: usize = recipe.phases.iter().map(|phase| phase.steps * phase.batch).sum();
            let photographs = source.photographs();
            let backgrounds = recipe
                .data_name
                .clone()
                .unwrap_or_else(|| format!("{photographs} photographs of `{data}` among the backgrounds"));
            format!("{pictures} renderings of random scenes; {backgrounds}")
        }
    };
    // With velocities from labels it is not the paper's.
    let of_paper = |name: &str| match recipe.future.velocity {
        Velocity::Pictures => format!(" (the paper's {name})"),
        Velocity::Labels => String::new(),
    };
    let taught = match recipe.supervision {
        Supervision::PhysicsFit => "2D labels and physics, fitted clip by clip".into(),
        Supervision::Future2dPredict => {
            format!("2D labels and physics, through forecasts of its own positions{}", of_paper("2D-predict"))
        }
        Supervision::Future2dGt => {
            format!("2D labels and physics, through forecasts of the labels{}", of_paper("2D-gt"))
        }
        Supervision::Rendered => "renderings of random scenes: apparent size, no labels".into(),
        Supervision::Candidates => "crops of renderings of random scenes, around a detector's candidates".into(),
        Supervision::Motion => "stacks of frames around what moves in videos".into(),
        Supervision::Future3dGt => format!("3D labels, by windows{}", of_paper("3D-gt")),
        Supervision::Labels3d => "3D labels".into(),
        Supervision::Mixed => format!(
            "3D labels of {:.0} % of the clips, 2D labels and physics of the others",
            100.0 * recipe.labelled_fraction
        ),
    };
    let supervision = format!("Trained with {taught}: {} steps, seed {}.", recipe.steps(), recipe.seed);
    Card {
        name: recipe.name.clone(),
        version: CARD_VERSION,
        weights: String::new(),
        sha256: String::new(),
        architecture: architecture.clone(),
        verifier: None,
        motion: None,
        input: recipe.input,
        normalisation: recipe.normalisation,
        depth_from: architecture.depth.is_size().then_some(DepthFrom::Size),
        depth_range,
        radius_range: architecture.depth.is_size().then_some([SMALLEST, LARGEST]),
        confidence_threshold: None,
        calibration: None,
        training_data,
        description: format!("{} {supervision}", recipe.description).trim().to_string(),
        metrics: serde_json::Value::Null,
        licence: recipe.licence.clone(),
    }
}

/// The card of a model that went on from the one of `card` for `steps` steps by `recipe`, on `examples` if any; but for its
/// weights.
pub fn card_of_fine_tuning(card: &Card, examples: Option<&Examples>, recipe: &Recipe, steps: usize) -> Card {
    let mut depth_range = card.depth_range;
    let mut training_data = card.training_data.clone();
    if let Some(examples) = examples {
        if examples.names_depths() {
            let [nearest, _, farthest] = examples.depths();
            depth_range = depth_range.map(|[least, most]| [least.min(nearest), most.max(farthest)]);
        }
        let (clips, frames) = (examples.clips.clips.len(), examples.frames.len());
        training_data += &format!("; then {frames} frames of {clips} clips given by the user");
    }
    let how = if recipe.supervision.is_future() { ", through forecasts" } else { "" };
    Card {
        name: format!("{}-tuned", card.name.trim_end_matches("-tuned")),
        depth_range,
        training_data,
        description: format!("{} Fine-tuned with 2D labels and physics{how}: {steps} steps.", card.description),
        ..card.clone()
    }
}
