//! `--model`.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use burn::tensor::Device;
use gravisight::Localiser;
use gravisight::error::Error;
use gravisight::model::Card;

/// The model that `--model` defaults to, built into the command.
const DEFAULT_CARD: &str = include_str!("../../models/compact-sd-s.json");
const DEFAULT_WEIGHTS: &[u8] = include_bytes!("../../models/compact-sd-s.safetensors");

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
    let card = Card::from_file(&path)?;
    let weights = path.with_file_name(&card.weights);
    let bytes = std::fs::read(&weights).map_err(|cause| Error::Io { path: weights.clone(), cause })?;
    Localiser::new(card, bytes, device).with_context(|| weights.display().to_string())
}
