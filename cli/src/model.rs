//! `--model`.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use gravisight::{Card, Device, Localiser};

/// The model that `--model` defaults to, built into the command.
const DEFAULT_CARD: &str = include_str!("../../models/sd-l.json");
const DEFAULT_WEIGHTS: &[u8] = include_bytes!("../../models/sd-l.safetensors");

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

/// Loads `--model`, or the built-in model.
pub fn open(model: Option<&Path>, device: &Device) -> Result<Localiser> {
    let Some(model) = model else {
        let card = Card::from_json(DEFAULT_CARD, "built-in model")?;
        return Ok(Localiser::new(card, DEFAULT_WEIGHTS.to_vec(), device)?);
    };
    let path = card_path(model);
    let (card, weights) = Card::with_weights(&path)?;
    let name = path.with_file_name(&card.weights);
    Localiser::new(card, weights, device).with_context(|| name.display().to_string())
}
