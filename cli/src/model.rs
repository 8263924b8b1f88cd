//! `--model`.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use gravisight::internal::{ANY, SD_L};
use gravisight::{Card, Device, Localiser};

/// Path of the card of `--model M`: M itself, M with `.json`, or beside M's `.safetensors`.
pub fn card_path(model: &Path) -> PathBuf {
    match model.extension().and_then(|extension| extension.to_str()) {
        Some("json") => model.to_path_buf(),
        Some("safetensors") => model.with_extension("json"),
        _ => {
            let mut name = model.as_os_str().to_owned();
            name.push(".json");
            name.into()
        }
    }
}

/// Loads `--model`, or a built-in one: with a ball's radius the one for any ball, without that of the paper's scenes.
pub fn open(model: Option<&Path>, ball_radius: Option<f64>, device: &Device) -> Result<Localiser> {
    let Some(model) = model else {
        let (card, weights) = if ball_radius.is_some() { ANY } else { SD_L };
        return Ok(Localiser::new(Card::from_json(card, "built-in model")?, weights.to_vec(), device)?);
    };
    let path = card_path(model);
    let (card, weights) = Card::with_weights(&path)?;
    let name = path.with_file_name(&card.weights);
    Localiser::new(card, weights, device).with_context(|| name.display().to_string())
}
