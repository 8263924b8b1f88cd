//! The JSON card beside a weights file.

use std::path::Path;

use safetensors::SafeTensors;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::backbone::PICTURE_CHANNELS;
use super::config::{MOTION_SIDE, PenConfig, VERIFIER_SIDE};
use gravisight_geometry::error::{Error, Result, json_refusal};
use gravisight_geometry::image::Normalisation;
use gravisight_geometry::size::Size;

/// Added to the error about a file that is no card.
const EXPECTED: &str = "a model's card is the JSON file NAME.json beside its weights NAME.safetensors; `gravisight train` writes one, and \
                        the project's folder models/ has some";
/// Version of the format of cards and weights files that this version of the crate reads and writes. 2: the verifier's tensors have the
/// prefix `verifier.`, and its architecture is the card's field `verifier` (both were `closer`); cards state their version.
pub const CARD_VERSION: u32 = 2;
/// Largest input side a card may ask for, px.
const MAX_INPUT_SIDE: u32 = 4096;

/// A model's card: what is needed to run it, and how well it does.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify), tsify(hashmap_as_object))]
#[serde(deny_unknown_fields)]
pub struct Card {
    /// The model's name.
    pub name: String,
    /// Version of the format of card and weights file: 2.
    pub version: u32,
    /// File name of the weights, beside the card.
    pub weights: String,
    /// SHA-256 of the weights file, lower-case hexadecimal.
    pub sha256: String,
    /// Architecture.
    #[cfg_attr(target_arch = "wasm32", tsify(type = "Record<string, unknown>"))]
    pub architecture: PenConfig,
    /// Architecture of the verifier, whose tensors are in the same file with the prefix `verifier.`; absent where there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(target_arch = "wasm32", tsify(type = "Record<string, unknown>"))]
    pub verifier: Option<PenConfig>,
    /// Architecture of the motion network, which [`VideoTracker`](crate::VideoTracker) uses; its tensors are in the same file with the
    /// prefix `motion.`. Absent where there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(target_arch = "wasm32", tsify(type = "Record<string, unknown>"))]
    pub motion: Option<PenConfig>,
    /// Size of the network's input.
    pub input: Size,
    /// Normalisation of the network's input.
    pub normalisation: Normalisation,
    /// What depth comes from; absent where the network gives it itself, of the scene that it knows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth_from: Option<DepthFrom>,
    /// Smallest and largest depth (camera z) in the training data, m; absent where depth comes from size.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth_range: Option<[f64; 2]>,
    /// Smallest and largest apparent radius in the training data, px; where depth comes from size.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub radius_range: Option<[f64; 2]>,
    /// Confidence (of [`Card::confidence_kind`]) below which no ball is found: half of what nearly all (99.5 %) of the visible balls of
    /// the validation clips exceed; where depth comes from size that of the equal error rate (as large a fraction of the balls below as
    /// of the pictures without one above).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub confidence_threshold: Option<f64>,
    /// Weights behind the confidence and σ of a model that reads sizes, fitted to it; where absent, those of `any`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration: Option<DetectionCalibration>,
    /// Name of the training data.
    pub training_data: String,
    /// How it was trained and what to expect, in plain words.
    pub description: String,
    /// Metrics on the test split, as `gravisight evaluate --json` prints them; empty before that.
    #[cfg_attr(target_arch = "wasm32", tsify(type = "{ dtg?: Statistic; image_error_px?: Statistic } | null"))]
    pub metrics: serde_json::Value,
    /// Licence of the weights.
    pub licence: String,
}

/// What a model's depth comes from, besides the scene it knows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(rename_all = "lowercase")]
pub enum DepthFrom {
    /// The ball's apparent size, and its radius, which the user gives.
    Size,
}

/// What a model's confidence in a position is: a number from 0 to 1, of which each kind means another.
///
/// A tracked video's frames have a confidence of their own ([`TrackedFrame`](crate::parts::TrackedFrame)).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(rename_all = "kebab-case")]
pub enum ConfidenceKind {
    /// The fraction of the heatmap's mass within 12 px (of the network's input) of the position found. Of a model that reads
    /// sizes the geometric mean of that in the picture and in the crop. It is well calibrated where a ball is within that
    /// distance in as large a fraction of the pictures.
    HeatmapMass,
    /// The probability that what was found is a ball: of a model with a verifier ([`Card::verifier`]), by a logistic regression on
    /// its log-odds and those of the heatmaps. It is well calibrated where the ball is inside the outline found in as large a
    /// fraction of the pictures.
    BallProbability,
}

/// Weights of the logistic regressions and of the error model behind a detection's confidence and σ. `scripts/fit-weights` fits them to a
/// model.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(deny_unknown_fields)]
pub struct DetectionCalibration {
    /// Of the log-odds that a candidate is a ball: the bias, then one each for the log-odds of first pass, second pass and verifier, and
    /// for the logarithm of the number of cells searched over 4096.
    pub ball_log_odds: [f64; 5],
    /// The same by the first pass alone: the bias, then one for its log-odds and one for the cells.
    pub first_pass_log_odds: [f64; 3],
    /// Of the log-odds that a ball's edge gives its radius and not the network: the bias, then one each for the logarithm of the network's
    /// standard deviation of log(radius), the logarithm of the edge's rms over the radius, the fraction of the directions without an edge,
    /// and the disagreement of edge and network.
    pub edge_log_odds: [f64; 5],
    /// Of the logarithm of the standard deviation of log(radius), where there is an edge: as before.
    pub edge_log_sigma: [f64; 5],
    /// Factor on the network's own standard deviation where there is no edge.
    pub network_sigma_factor: f64,
}

impl Default for DetectionCalibration {
    /// For cards without these fields, such as those of models tuned from the `any` that learned from renderings alone: its own weights. The
    /// present `any` has its weights in its card. The confidence is by `scripts/fit-weights confidence` on the 45 photographs without a ball of the split
    /// `validation` of `scripts/photographs`, on which neither network was trained, each in eight drawings, every other one with a ball; the
    /// edge by `scripts/fit-weights edge`, on 12,000 random renderings before photographs (`docs/experiments.md`).
    fn default() -> Self {
        Self {
            ball_log_odds: [-1.494, 0.829, 0.486, 0.595, -0.111],
            first_pass_log_odds: [-0.750, 1.657, 0.319],
            edge_log_odds: [-4.33, 0.0, -2.23, -4.29, -0.76],
            edge_log_sigma: [1.63, 1.05, 0.69, 2.03, 0.24],
            network_sigma_factor: 1.8,
        }
    }
}

impl DetectionCalibration {
    fn is_finite(&self) -> bool {
        let Self { ball_log_odds, first_pass_log_odds, edge_log_odds, edge_log_sigma, network_sigma_factor } = self;
        let weights = [&ball_log_odds[..], first_pass_log_odds, edge_log_odds, edge_log_sigma];
        weights.concat().iter().all(|weight| weight.is_finite()) && network_sigma_factor.is_finite()
    }
}

impl Card {
    /// What the model's confidence is.
    pub fn confidence_kind(&self) -> ConfidenceKind {
        if self.verifier.is_some() { ConfidenceKind::BallProbability } else { ConfidenceKind::HeatmapMass }
    }

    /// Reads the text of a card; `what` names it in errors.
    ///
    /// # Errors
    /// [`Error::Format`] or [`Error::Value`] with the field.
    pub fn from_json(text: &str, what: &str) -> Result<Self> {
        let refuse = |error| Error::format(what)(json_refusal(&error)).expecting(EXPECTED);
        check_version(text, what)?;
        let card: Self = serde_json::from_str(text).map_err(refuse)?;
        check_input(&card.architecture, card.input, &card.normalisation, what)?;
        if card.architecture.input_channels() != PICTURE_CHANNELS {
            let reason = "must be 3: a model takes one picture (its verifier two)";
            return Err(Error::value(what, "architecture.backbone.input_channels", reason));
        }
        let second = [
            (&card.verifier, VERIFIER_SIDE, "verifier.depth.activation"),
            (&card.motion, MOTION_SIDE, "motion.depth.activation"),
        ];
        for (network, side, field) in second {
            let Some(network) = network else { continue };
            check_input(network, Size::square(side), &card.normalisation, what)?;
            if !network.depth.is_size() {
                return Err(Error::value(what, field, "must be \"radius\""));
            }
        }
        let is_size = card.depth_from == Some(DepthFrom::Size);
        if is_size != card.architecture.depth.is_size() {
            let reason = "must be \"size\" if the architecture's depth activation is \"radius\", and absent otherwise";
            return Err(Error::value(what, "depth_from", reason));
        }
        let (field, range) =
            if is_size { ("radius_range", card.radius_range) } else { ("depth_range", card.depth_range) };
        let in_order = |[least, most]: [f64; 2]| least.is_finite() && most.is_finite() && 0.0 < least && least <= most;
        if !range.is_some_and(in_order) {
            return Err(Error::value(what, field, "must be two positive numbers, the smaller first"));
        }
        if card.confidence_threshold.is_some_and(|threshold| !(0.0..=1.0).contains(&threshold)) {
            return Err(Error::value(what, "confidence_threshold", "must be from 0 to 1"));
        }
        if card.calibration.is_some_and(|of| !of.is_finite() || of.network_sigma_factor <= 0.0) {
            return Err(Error::value(
                what,
                "calibration",
                "needs finite weights and a positive `network_sigma_factor`",
            ));
        }
        Ok(card)
    }

    /// Reads a card's file.
    ///
    /// # Errors
    /// [`Error::Io`], else as [`Card::from_json`].
    pub fn from_file(path: &Path) -> Result<Self> {
        let text = gravisight_geometry::files::read_text(path).map_err(|error| error.expecting(EXPECTED))?;
        Self::from_json(&text, &path.display().to_string())
    }

    /// Reads a card's file, and the weights that it names.
    ///
    /// ```
    /// # fn main() -> gravisight::Result<()> {
    /// use gravisight::Card;
    ///
    /// let (card, weights) = Card::with_weights("models/any.json".as_ref())?;
    /// println!("{}: {} ({} bytes)", card.name, card.description, weights.len());
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// As [`Card::from_file`]; [`Error::Io`] for the weights.
    pub fn with_weights(path: &Path) -> Result<(Self, Vec<u8>)> {
        let card = Self::from_file(path)?;
        let weights = path.with_file_name(&card.weights);
        let bytes = gravisight_geometry::files::read(&weights)?;
        Ok((card, bytes))
    }

    /// Writes the card's file, whole.
    ///
    /// # Errors
    /// [`Error::Io`].
    #[cfg(not(target_arch = "wasm32"))]
    pub fn write(&self, path: &Path) -> Result<()> {
        gravisight_geometry::files::write_whole(path, self.to_json()?.as_bytes())
    }

    /// The text of the card's file.
    ///
    /// # Errors
    /// [`Error::Format`].
    pub fn to_json(&self) -> Result<String> {
        serde_json::to_string_pretty(self).map(|text| text + "\n").map_err(Error::format(&self.name))
    }

    /// Refuses weights that are not those this card speaks of.
    ///
    /// # Errors
    /// [`Error::WeightsFile`] for a file that is not whole, [`Error::WeightsSha256`] for another one.
    pub fn check_weights(&self, weights: &[u8]) -> Result<()> {
        SafeTensors::deserialize(weights).map_err(|error| Error::WeightsFile { reason: error.to_string() })?;
        let found = sha256_hex(weights);
        if found == self.sha256 {
            return Ok(());
        }
        Err(Error::WeightsSha256 { expected: self.sha256.clone(), found })
    }
}

/// Refuses a card of another version of the format. Text that is no card at all is left to the reader of its fields.
///
/// # Errors
/// [`Error::Value`].
fn check_version(text: &str, what: &str) -> Result<()> {
    let Ok(serde_json::Value::Object(fields)) = serde_json::from_str(text) else { return Ok(()) };
    let is_card = fields.contains_key("architecture") && fields.contains_key("sha256");
    let version = fields.get("version").map_or(1.into(), Clone::clone);
    if !is_card || version == CARD_VERSION {
        return Ok(());
    }
    let reason = format!(
        "must be {CARD_VERSION}, not {version}: the card uses another version of the model format; the project's \
         `scripts/migrate-models` converts models of version 1"
    );
    Err(Error::value(what, "version", reason))
}

/// Refuses an architecture, input size and normalisation that do not go together.
///
/// # Errors
/// [`Error::Value`] with the field, in `what`.
pub fn check_input(architecture: &PenConfig, input: Size, normalisation: &Normalisation, what: &str) -> Result<()> {
    architecture.check()?;
    let multiple = architecture.input_multiple();
    for side in [input.width, input.height] {
        if side == 0 || side % multiple != 0 || side > MAX_INPUT_SIDE {
            let reason = format!("sides must be multiples of {multiple} up to {MAX_INPUT_SIDE}, not {side}");
            return Err(Error::value(what, "input", reason));
        }
    }
    let Normalisation { mean, std } = normalisation;
    if mean.iter().any(|value| !value.is_finite()) || std.iter().any(|value| !(value.is_finite() && *value > 0.0)) {
        return Err(Error::value(what, "normalisation", "needs finite means and positive deviations"));
    }
    Ok(())
}

/// SHA-256 of `bytes`, lower-case hexadecimal.
pub fn sha256_hex(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}
